//! `[rod]`: damping of the material.

use std::f64::consts::TAU;
use std::fmt;

use serde::de::value::{F64Deserializer, MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserialize, Deserializer, Error, MapAccess, SeqAccess, Visitor};

use super::Scene;
use super::fluid::DragTable;
use super::key_error::KeyError;
use super::value::{NotNegative, NumberOrProfile, SignalValue};
use crate::head::Signal;
use crate::rod::{DampedRate, MaterialDamping};

/// The damping time τ of a material: one for stretching and bending, or one for each.
#[derive(Debug, Clone, PartialEq)]
pub struct DampingTime {
    /// τ of stretching, s.
    pub stretch: NumberOrProfile<NotNegative>,
    /// τ of bending, s.
    pub bending: NumberOrProfile<NotNegative>,
}

/// The keys of a damping time with separate numbers for stretching and bending.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields, expecting = "{ stretch, bending }")]
struct DampingTimeKeys {
    #[serde(default = "none")]
    stretch: NumberOrProfile<NotNegative>,
    #[serde(default = "none")]
    bending: NumberOrProfile<NotNegative>,
}

fn none() -> NumberOrProfile<NotNegative> {
    NumberOrProfile::<NotNegative>::constant(0.0)
}

impl<'de> Deserialize<'de> for DampingTime {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OneOrEach;
        impl<'de> Visitor<'de> for OneOrEach {
            type Value = DampingTime;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number, points [[xi, number], …], or { stretch, bending }")
            }

            fn visit_f64<E: Error>(self, x: f64) -> Result<DampingTime, E> {
                NumberOrProfile::deserialize(F64Deserializer::new(x)).map(DampingTime::of)
            }

            fn visit_i64<E: Error>(self, x: i64) -> Result<DampingTime, E> {
                self.visit_f64(x as f64)
            }

            fn visit_u64<E: Error>(self, x: u64) -> Result<DampingTime, E> {
                self.visit_f64(x as f64)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<DampingTime, A::Error> {
                NumberOrProfile::deserialize(SeqAccessDeserializer::new(seq)).map(DampingTime::of)
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<DampingTime, A::Error> {
                let DampingTimeKeys { stretch, bending } =
                    DampingTimeKeys::deserialize(MapAccessDeserializer::new(map))?;
                Ok(DampingTime { stretch, bending })
            }
        }
        deserializer.deserialize_any(OneOrEach)
    }
}

impl DampingTime {
    fn of(both: NumberOrProfile<NotNegative>) -> Self {
        Self { stretch: both.clone(), bending: both }
    }

    /// The same number for both; not checked.
    pub(super) fn constant(number: f64) -> Self {
        Self::of(NumberOrProfile::<NotNegative>::constant(number))
    }

    /// The common number of both, if there is one.
    pub fn number(&self) -> Option<NotNegative> {
        self.bending.number().filter(|_| self.stretch == self.bending)
    }

    /// The numbers of stretching and of bending, if both are numbers.
    pub fn numbers(&self) -> Option<[NotNegative; 2]> {
        Some([self.stretch.number()?, self.bending.number()?])
    }

    /// The points [ξ, τ] of both, if both have the same profile.
    pub fn points(&self) -> Option<&[[f64; 2]]> {
        self.bending.points().filter(|_| self.stretch == self.bending)
    }
}

impl Scene {
    /// Returns an error for a loss factor if no frequency is known, or more than one.
    pub(super) fn check_loss_factor(&self) -> Result<(), KeyError> {
        if self.rod.loss_factor.is_none() {
            return Ok(());
        }
        let problem = match self.loss_frequencies()[..] {
            [_] => return Ok(()),
            [] => "found without a frequency; allowed: with rod.loss_frequency_hz, or where the actuation, the head or a tendon has one".to_string(),
            [first, second, ..] => format!(
                "found with motions of {first} and {second} Hz, so that its frequency is ambiguous; allowed: with rod.loss_frequency_hz"
            ),
        };
        Err(KeyError { key: "rod.loss_factor".into(), problem })
    }

    /// Returns an error for forces of a fluid on a rod without radius.
    pub(super) fn check_radius(&self) -> Result<(), KeyError> {
        let law = |drag: &DragTable| drag.law.as_deref().unwrap_or_default() != "coefficients";
        let asks = [
            ("a drag law other than \"coefficients\"", self.drag.as_ref().is_some_and(law)),
            ("[reactive]", self.reactive.is_some()),
            ("buoyancy", self.loads.as_ref().is_some_and(|loads| loads.buoyancy)),
        ];
        self.rod.ask_for_radius(asks)
    }

    /// The frequencies (Hz) at which the loss factor may apply: its own, or else those of the actuation, the head and the tendons
    /// that move the rod. If nothing moves the rod, the first frequency of a drive of zero amplitude.
    fn loss_frequencies(&self) -> Vec<f64> {
        if let Some(own) = self.rod.loss_frequency_hz {
            return vec![own.get()];
        }
        let of = |signal: &SignalValue| match signal.formula() {
            Some(Signal::Sinusoid { frequency, amplitude, .. }) => Some((frequency.abs(), amplitude != &0.0)),
            _ => None,
        };
        let head = self.head.signals().chain(self.tendon_signals()).filter_map(of);
        let actuation = self.actuation.as_ref();
        let driven = actuation.map(|actuation| (actuation.frequency_hz.get(), actuation.amplitude() != 0.0));
        let all: Vec<(f64, bool)> = driven.into_iter().chain(head).filter(|(frequency, _)| *frequency > 0.0).collect();
        let moves = all.iter().any(|(_, moves)| *moves);
        let mut frequencies: Vec<f64> = all.iter().filter(|own| own.1 == moves).map(|own| own.0).collect();
        frequencies.dedup();
        if moves { frequencies } else { frequencies.into_iter().take(1).collect() }
    }

    /// Returns an error for `damping_of = "elastic"` with active moments, which do not change the natural curvature.
    pub(super) fn check_damped_rate(&self) -> std::result::Result<(), KeyError> {
        let moments = if self.has_active_moments() { Some("actuation.moment_amp_n_m") } else { None };
        let moments = moments.or((!self.tendons.is_empty()).then_some("[[tendons]]"));
        if let Some(moments) = moments.filter(|_| self.rod.damping_of == Some(DampedRate::Elastic)) {
            return Err(KeyError {
                key: "rod.damping_of".into(),
                problem: format!(
                    "found \"elastic\" with {moments}: moments do not change the natural curvature, so the total curvature is the elastic one; allowed: \"whole\""
                ),
            });
        }
        Ok(())
    }

    /// The damping of the rod's material, if it has any.
    pub(super) fn damping(&self) -> Option<MaterialDamping> {
        let table = &self.rod;
        let [stretching, bending] = match (&table.damping_time_s, &table.loss_factor) {
            (Some(time), _) => [time.stretch.profile(), time.bending.profile()],
            (None, Some(loss)) => {
                let per_loss = 1.0 / (TAU * self.loss_frequencies().first()?);
                let time = loss.profile().times(per_loss);
                [time.clone(), time]
            }
            (None, None) => return None,
        };
        let rate = table.damping_of.unwrap_or_default();
        Some(MaterialDamping { stretching, bending, rate })
    }
}

#[cfg(feature = "schema")]
impl schemars::JsonSchema for DampingTime {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> std::borrow::Cow<'static, str> {
        "DampingTime".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        let time = NumberOrProfile::<NotNegative>::json_schema(generator);
        let each = schemars::json_schema!({
            "type": "object",
            "properties": { "stretch": time, "bending": time },
            "additionalProperties": false
        });
        schemars::json_schema!({ "anyOf": [time, each] })
    }
}
