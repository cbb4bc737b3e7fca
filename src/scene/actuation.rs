//! `[actuation]`: the wave of natural curvature, or of active moment, that drives the rod.

use serde::de::Error;
use serde::{Deserialize, Deserializer};

use super::Scene;
use super::key_error::KeyError;
use super::keys_by_choice::KeysByChoice;
use super::rod::check_points;
use super::value::{self, Finite, NotNegative, Positive};
use crate::actuation::sine_wave::STEEPEST;
use crate::actuation::{Actuation, ActuationInputs, ActuationKind, KINDS};
use crate::error::nearest;
use crate::model::Drive;
use crate::rod::{Profile, Rod};

/// `[actuation]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ActuationTable {
    /// Kind of actuation.
    #[serde(deserialize_with = "kind")]
    #[cfg_attr(feature = "schema", schemars(with = "String"))]
    pub kind: &'static ActuationKind,
    /// Amplitude of the natural curvature for `travelling-wave` and `standing-wave`, in radians per reference length.
    pub kappa_amp: Option<Finite>,
    /// Amplitude of the active moment that bends each joint against its stiffness, N m, instead of `kappa_amp`.
    pub moment_amp_n_m: Option<Finite>,
    /// The largest natural curvature that the drive can produce, including that of a host, 1/m: for a commanded curvature x it
    /// produces y = m tanh(x/m). With `kappa_amp` or `slope`. By default unlimited.
    pub largest_1_m: Option<Positive>,
    /// The largest active moment that the drive can exert on a joint, including that of a host, N m. With `moment_amp_n_m`. By
    /// default unlimited.
    pub largest_moment_n_m: Option<Positive>,
    /// Time τ of a first-order lag between the command x of the wave and a host and the output y of the drive, s: τ dy/dt = x −
    /// y, before a limit. By default without lag.
    pub lag_s: Option<Positive>,
    /// Reference length of `kappa_amp`, m. By default 1 m, so that the amplitude is a curvature in 1/m.
    pub kappa_reference_length_m: Option<Positive>,
    /// Frequency of the wave, Hz.
    pub frequency_hz: NotNegative,
    /// Wavelength along the rod for `travelling-wave` and `sine-wave`, m.
    pub wavelength_m: Option<Positive>,
    /// Amplitudes of the second, third, … harmonic relative to the first, for `travelling-wave` and `standing-wave`.
    pub harmonics: Option<Vec<Finite>>,
    /// Largest slope bk of the curve y = b sin(kx − ωt), for `sine-wave`.
    pub slope: Option<Positive>,
    /// Envelope [e₀, e₁]: the amplitude is multiplied by e₀ + e₁ξ along the rod. By default [1, 0].
    #[serde(default = "even_envelope", deserialize_with = "value::pair")]
    pub envelope: [Finite; 2],
    /// Factor of the amplitude along the rod, as points [ξ, factor], linear between them.
    #[serde(default, deserialize_with = "value::optional_pairs")]
    pub amplitude_profile: Option<Vec<[NotNegative; 2]>>,
    /// Phase lag along the rod, as points [ξ, rad], linear between them. It is subtracted inside the sine, whereas the
    /// `phase_rad` of a head or a flow is added.
    #[serde(default, deserialize_with = "value::optional_pairs")]
    pub phase_profile_rad: Option<Vec<[Finite; 2]>>,
}

fn kind<'de, D: Deserializer<'de>>(from: D) -> Result<&'static ActuationKind, D::Error> {
    let name = String::deserialize(from)?;
    ActuationKind::named(&name).ok_or_else(|| {
        let names = || KINDS.iter().map(|kind| kind.name);
        let near = nearest(&name, names()).map_or(String::new(), |near| format!("; did you mean `{near}`?"));
        let listed = names().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
        D::Error::custom(value::refused(format_args!("{name:?}"), format_args!("{listed}{near}")))
    })
}

/// An actuation with its drive.
type Driven = (Box<dyn Actuation>, Drive);

fn even_envelope() -> [Finite; 2] {
    [Finite::constant(1.0), Finite::constant(0.0)]
}

impl ActuationTable {
    /// The keys that belong to a kind.
    pub(super) const KEYS_BY_KIND: KeysByChoice = KeysByChoice {
        table: "actuation",
        choices: &["kind"],
        keys: || KINDS.iter().flat_map(|kind| kind.keys).copied().collect(),
        accepted: |chosen| Some(ActuationKind::named(&chosen("kind")?)?.keys.to_vec()),
    };

    /// The given keys that apply to some kinds only.
    fn given(&self) -> impl Iterator<Item = &'static str> {
        let keys = [
            ("kappa_amp", self.kappa_amp.is_some()),
            ("moment_amp_n_m", self.moment_amp_n_m.is_some()),
            ("kappa_reference_length_m", self.kappa_reference_length_m.is_some()),
            ("wavelength_m", self.wavelength_m.is_some()),
            ("harmonics", self.harmonics.is_some()),
            ("slope", self.slope.is_some()),
        ];
        keys.into_iter().filter_map(|(key, given)| given.then_some(key))
    }

    pub(super) fn check(&self) -> Result<(), KeyError> {
        let fault = |key: &str, problem: String| Err(KeyError { key: format!("actuation.{key}"), problem });
        let kind = self.kind;
        if let Some(key) = self.given().find(|key| !kind.keys.contains(key)) {
            let owners = KINDS.iter().filter(|kind| kind.keys.contains(&key)).map(|kind| kind.name);
            let owners = owners.collect::<Vec<_>>().join(", ");
            return fault(key, format!("found with kind = \"{}\"; allowed: only with {owners}", kind.name));
        }
        let of_curvature = [
            ("kappa_amp", "found together with moment_amp_n_m; allowed: an amplitude of curvature or one of moment"),
            ("kappa_reference_length_m", "found with moment_amp_n_m; allowed: with kappa_amp, a curvature"),
        ];
        if self.moment_amp_n_m.is_some()
            && let Some((key, problem)) = of_curvature.into_iter().find(|(key, _)| self.given().any(|own| own == *key))
        {
            return fault(key, problem.into());
        }
        let limits = [
            ("largest_1_m", self.largest_1_m, self.moment_amp_n_m.is_none(), "kappa_amp or slope"),
            ("largest_moment_n_m", self.largest_moment_n_m, self.moment_amp_n_m.is_some(), "moment_amp_n_m"),
        ];
        for (key, limit, fits, drive) in limits {
            if limit.is_some() && !fits {
                return fault(key, format!("found without {drive}, whose limit it is; allowed: only with it"));
            }
        }
        let stands_for = |given: &str, key: &str| given == key || (given, key) == ("moment_amp_n_m", "kappa_amp");
        if let Some(key) = kind.needs.iter().find(|key| !self.given().any(|given| stands_for(given, key))) {
            let or = if *key == "kappa_amp" { "; moment_amp_n_m can replace it" } else { "" };
            return fault(key, format!("missing; kind = \"{}\" has no default for it{or}", kind.name));
        }
        if let Some(slope) = self.slope.map(Positive::get).filter(|slope| *slope > STEEPEST) {
            return fault("slope", format!("found {slope}; allowed: above 0, at most {STEEPEST}"));
        }
        if let Some(profile) = &self.amplitude_profile {
            let allowed = "points [xi, factor] with rising xi from 0 to 1";
            let points = profile.iter().map(|point| point.map(NotNegative::get));
            check_points("actuation.amplitude_profile", points, allowed, |_| true)?;
        }
        if let Some(profile) = &self.phase_profile_rad {
            let allowed = "points [xi, phase] with rising xi from 0 to 1";
            let points = profile.iter().map(|point| point.map(Finite::get));
            check_points("actuation.phase_profile_rad", points, allowed, |_| true)?;
        }
        Ok(())
    }

    /// κ_amp or the amplitude of the moment (N m), or the factor of a curvature that other keys define.
    pub(crate) fn amplitude(&self) -> f64 {
        self.moment_amp_n_m.or(self.kappa_amp).map_or(1.0, Finite::get)
    }

    /// The key of the number that scales the actuation.
    pub(crate) fn amplitude_key(&self) -> &'static str {
        match (self.slope, self.moment_amp_n_m) {
            (Some(_), _) => "actuation.slope",
            (None, Some(_)) => "actuation.moment_amp_n_m",
            (None, None) => "actuation.kappa_amp",
        }
    }

    /// The same actuation with its amplitude multiplied by `factor`.
    pub(super) fn times(mut self, factor: f64) -> Self {
        let amplitude = Some(Finite::constant(self.amplitude() * factor));
        *(if self.moment_amp_n_m.is_some() { &mut self.moment_amp_n_m } else { &mut self.kappa_amp }) = amplitude;
        self
    }

    /// The points of the profiles of amplitude and phase, empty by default.
    pub(crate) fn profiles(&self) -> [Vec<[f64; 2]>; 2] {
        let amplitude = self.amplitude_profile.iter().flatten().map(|point| point.map(NotNegative::get));
        let phase = self.phase_profile_rad.iter().flatten().map(|point| point.map(Finite::get));
        [amplitude.collect(), phase.collect()]
    }

    fn build(&self, rod: &Rod) -> Driven {
        let drive = Drive { amplitude: self.amplitude(), frequency: self.frequency_hz.get() };
        let harmonics: Vec<f64> = self.harmonics.iter().flatten().copied().map(Finite::get).collect();
        let actuation = (self.kind.build)(&ActuationInputs {
            nodes: rod.nodes,
            front: rod.front,
            spacing: rod.spacing,
            envelope: self.envelope.map(Finite::get),
            reference_length: match self.moment_amp_n_m {
                Some(_) => rod.spacing,
                None => self.kappa_reference_length_m.map_or(1.0, Positive::get),
            },
            wavelength: self.wavelength_m.map_or(f64::INFINITY, Positive::get),
            harmonics: &harmonics,
            slope: self.slope.map_or(0.0, Positive::get),
        });
        if self.amplitude_profile.is_none() && self.phase_profile_rad.is_none() {
            return (actuation, drive);
        }
        let [amplitude, phase] = self.profiles();
        let along = |points: &[[f64; 2]], default: f64| -> Vec<f64> {
            let profile = Profile::through(points.to_vec()).unwrap_or(default.into());
            (0..rod.nodes).map(|k| profile.at(rod.xi(k))).collect()
        };
        (actuation.profiled(&along(&amplitude, 1.0), &along(&phase, 0.0)), drive)
    }
}

impl Scene {
    /// The wavelength (m) of its actuation, if it has one.
    pub(crate) fn wavelength(&self) -> Option<f64> {
        Some(self.actuation.as_ref()?.wavelength_m?.get())
    }

    /// True if its actuation exerts active moments rather than natural curvatures.
    pub(crate) fn has_active_moments(&self) -> bool {
        self.actuation.as_ref().is_some_and(|actuation| actuation.moment_amp_n_m.is_some())
    }

    /// True if its actuation has a limit or a lag.
    #[cfg(feature = "design")]
    pub(crate) fn filters_drive(&self) -> bool {
        self.actuation.as_ref().is_some_and(|actuation| {
            actuation.lag_s.is_some() || actuation.largest_1_m.is_some() || actuation.largest_moment_n_m.is_some()
        })
    }

    /// The largest output of its actuation at a joint of `rod`, if it has a limit.
    pub(super) fn largest_drive(&self, rod: &Rod) -> Option<f64> {
        let actuation = self.actuation.as_ref()?;
        let curvature = actuation.largest_1_m.map(|most| most.get() * rod.spacing);
        actuation.largest_moment_n_m.map(Positive::get).or(curvature)
    }

    /// The actuation of its `rod`, with its drive.
    pub(super) fn drive(&self, rod: &Rod) -> Option<Driven> {
        self.actuation.as_ref().map(|actuation| actuation.build(rod))
    }
}
