//! `[[tendons]]`: cables along the rod, pulled by a winch or a servo.

use serde::Deserialize;

use super::Scene;
use super::head::HeadKind;
use super::key_error::KeyError;
use super::value::{self, Finite, Positive, ScalarSignal, Share, SignalValue};
use crate::drives::{Drives, gives};
use crate::error::Result;
use crate::fluid::Force;
use crate::head::Signal;
use crate::number_format::number;
use crate::rod::Rod;
use crate::tendons::{MAX_TENDONS, Pull, Tendon, Tendons, Winch};

/// One of `[[tendons]]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct TendonTable {
    /// Distance from the centreline of the rod, m, positive to the left of the rod from head to tip: a tendon on the left bends the tip to
    /// the left.
    pub offset_m: Finite,
    /// Start of the tendon, as a fraction of the rod's length from the head, rounded to the nearest node. By default 0: fastened
    /// to the head or to the body that holds the rod there.
    #[serde(default)]
    pub from_xi: Option<Share>,
    /// End of the tendon. By default 1, the tip.
    #[serde(default)]
    pub to_xi: Option<Share>,
    /// Tension, N, at least 0: a number, a sinusoid or a table. By default 0, for a host that sets it. The ramp of the start
    /// applies to it.
    #[serde(default)]
    pub tension_n: Option<ScalarSignal>,
    /// Stiffness of the cable of a winch, N/m. The winch then prescribes a length through this cable, instead of a tension.
    #[serde(default)]
    pub stiffness_n_m: Option<Positive>,
    /// Length without tension that the winch gives the tendon, m: a number, a sinusoid or a table. By default its length along
    /// the straight rod, from which the ramp of the start begins.
    #[serde(default)]
    pub length_m: Option<ScalarSignal>,
    /// The stretch over which the cable takes up its slack, m. By default a thousandth of its length along the straight rod.
    #[serde(default)]
    pub take_up_m: Option<Positive>,
}

impl TendonTable {
    fn ends(&self) -> [f64; 2] {
        [self.from_xi.map_or(0.0, Share::get), self.to_xi.map_or(1.0, Share::get)]
    }

    /// True if it is pulled without a host: by a tension, or by a winch with a given length.
    fn is_pulled(&self) -> bool {
        let tension = self.tension_n.as_ref();
        let pulls = tension.is_some_and(|ScalarSignal(tension)| tension.formula().is_none_or(gives));
        pulls || self.length_m.is_some()
    }

    /// The largest moment with which it bends a rod of that `length` (m), N m, as far as it is known before the table is read.
    fn largest_moment(&self, length: f64) -> f64 {
        let range = |signal: &Option<ScalarSignal>| match signal.as_ref().and_then(|ScalarSignal(own)| own.formula()) {
            Some(Signal::Constant(value)) => Some([*value; 2]),
            Some(Signal::Sinusoid { offset, amplitude, .. }) => {
                Some([offset - amplitude.abs(), offset + amplitude.abs()])
            }
            _ => None,
        };
        let [from, to] = self.ends();
        let by_winch = self.stiffness_n_m.zip(range(&self.length_m));
        let pulled = by_winch.map(|(stiffness, [least, _])| stiffness.get() * ((to - from) * length - least).max(0.0));
        let tension = range(&self.tension_n).map(|[_, most]| most).or(pulled).unwrap_or(0.0);
        tension * self.offset_m.get().abs()
    }

    /// The smallest given tension, N, if it is known before the table is read.
    fn least_tension(&self) -> f64 {
        match self.tension_n.as_ref().and_then(|ScalarSignal(tension)| tension.formula()) {
            Some(Signal::Constant(tension)) => *tension,
            Some(Signal::Sinusoid { offset, amplitude, .. }) => offset - amplitude.abs(),
            _ => 0.0,
        }
    }
}

impl Scene {
    /// The drives of the body.
    pub fn drives(&self) -> Drives {
        let torque = self.head.torque_n_m.as_ref();
        Drives {
            actuation: self.actuation.is_some(),
            tendons: self.tendons.iter().any(TendonTable::is_pulled),
            torque: torque.is_some_and(|ScalarSignal(torque)| torque.formula().is_none_or(gives)),
        }
    }

    /// Checks the tendons.
    pub(super) fn check_tendons(&self) -> std::result::Result<(), KeyError> {
        let refuse = |key: String, problem: String| Err(KeyError { key, problem });
        if self.tendons.len() > MAX_TENDONS {
            let found = format!("{} tendons", self.tendons.len());
            let allowed = format!("at most {MAX_TENDONS}");
            return refuse(format!("tendons.{MAX_TENDONS}"), value::refused(found, allowed));
        }
        for (i, tendon) in self.tendons.iter().enumerate() {
            let [from, to] = tendon.ends();
            if from >= to {
                let found = format!("{to} with from_xi = {from}");
                return refuse(format!("tendons.{i}.to_xi"), value::refused(found, "a number beyond from_xi, up to 1"));
            }
            if tendon.stiffness_n_m.is_some() && tendon.tension_n.is_some() {
                let problem = "found with a tension_n; allowed: a tension, or a winch that gives a length_m through it";
                return refuse(format!("tendons.{i}.stiffness_n_m"), problem.into());
            }
            let of_winch = [("length_m", tendon.length_m.is_some()), ("take_up_m", tendon.take_up_m.is_some())];
            if let Some((key, _)) = of_winch.into_iter().find(|(_, given)| *given && tendon.stiffness_n_m.is_none()) {
                let problem =
                    "found without stiffness_n_m, the stiffness of the cable that a winch needs; allowed: only with it";
                return refuse(format!("tendons.{i}.{key}"), problem.into());
            }
            if tendon.stiffness_n_m.is_some() && self.head.kind == HeadKind::Hinged {
                let problem = "found with a hinged head; allowed: a tension_n there, or a winch on a free, clamped or driven head";
                return refuse(format!("tendons.{i}.stiffness_n_m"), problem.into());
            }
            let least = tendon.least_tension();
            if least < 0.0 {
                let found = format!("a tension of {} N", number(least));
                let allowed = "at least 0 at all times: a cable does not push; give the sinusoid an offset of its amplitude, or add a tendon on the other side";
                return refuse(format!("tendons.{i}.tension_n"), value::refused(found, allowed));
            }
        }
        Ok(())
    }

    /// True if any tendon is pulled by a winch.
    pub(crate) fn has_winches(&self) -> bool {
        self.tendons.iter().any(|tendon| tendon.stiffness_n_m.is_some())
    }

    /// The tendons of `rod`.
    pub(super) fn tendons_on(&self, rod: &Rod) -> Result<Tendons> {
        let tendon = |(i, table): (usize, &TendonTable)| {
            let tension = match &table.tension_n {
                Some(ScalarSignal(tension)) => self.signal(tension, 0, 1)?,
                None => Signal::Constant(0.0),
            };
            if let Signal::Table(rows) = &tension
                && let Some(row) = rows.iter().find(|row| row.value < 0.0)
            {
                let found = format!("a tension of {} N at {} s in the table", row.value, row.time);
                let allowed = "tensions of at least 0: a cable does not push";
                return Err(self.error(&format!("tendons.{i}.tension_n"), value::refused(found, allowed)));
            }
            let length = match &table.length_m {
                Some(ScalarSignal(length)) => Some(self.signal(length, 0, 1)?),
                None => None,
            };
            if let Some(least) = length.as_ref().map(|length: &Signal| length.range()[0]).filter(|least| *least <= 0.0)
            {
                let found = format!("a length of {} m", number(least));
                let allowed = "above 0 at all times: the length of the cable, close to that along the straight rod; use that as the offset of the sinusoid";
                return Err(self.error(&format!("tendons.{i}.length_m"), value::refused(found, allowed)));
            }
            let pull = |rest: f64| match table.stiffness_n_m {
                None => Pull::Tension(tension),
                Some(stiffness) => Pull::Winch(Winch {
                    stiffness: stiffness.get(),
                    length: length.unwrap_or(Signal::Constant(rest)),
                    take_up: table.take_up_m.map_or(1e-3 * rest, Positive::get),
                }),
            };
            let [from, to] = table.ends();
            Tendon::along(rod, table.offset_m.get(), [from, to], pull).ok_or_else(|| {
                let found = format!("{from} to {to}, between nodes without a joint");
                let allowed = format!(
                    "a tendon that passes a joint; those of this mesh are {} apart",
                    number(1.0 / (rod.nodes - rod.front - 1) as f64)
                );
                self.error(&format!("tendons.{i}.to_xi"), value::refused(found, allowed))
            })
        };
        self.tendons.iter().enumerate().map(tendon).collect::<Result<Vec<_>>>().map(Tendons::new)
    }

    /// The key of the drive of the tendon that bends the rod most.
    pub(super) fn strongest_tendon_key(&self) -> String {
        let length = self.rod.length_m.get();
        let moments = self.tendons.iter().map(|tendon| tendon.largest_moment(length)).enumerate();
        let strongest = moments.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(i, _)| i);
        let wound = self.tendons.get(strongest).is_some_and(|tendon| tendon.stiffness_n_m.is_some());
        format!("tendons.{strongest}.{}", if wound { "length_m" } else { "tension_n" })
    }

    /// The signals of its tendons.
    pub(super) fn tendon_signals(&self) -> impl Iterator<Item = &SignalValue> {
        let signals = self.tendons.iter().flat_map(|tendon| [&tendon.tension_n, &tendon.length_m]);
        signals.flatten().map(|ScalarSignal(signal)| signal)
    }
}

/// The force of the tendons on the edges, if there are any.
pub(super) fn force(tendons: &Tendons) -> Option<Box<dyn Force>> {
    (!tendons.is_empty()).then(|| Box::new(tendons.clone()) as Box<dyn Force>)
}
