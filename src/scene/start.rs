//! `[start]`: how a run begins.

use serde::Deserialize;

use super::key_error::KeyError;
use super::keys_by_choice::KeysByChoice;
use super::value::{Finite, NumberOrProfile, Positive, refused};
use super::{HeadKind, HeadTable};
use crate::rod::Rod;
use crate::start::Start;

/// `[start]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct StartTable {
    /// How the actuation begins. By default `shaped`.
    #[serde(default)]
    pub kind: StartKind,
    /// Duration of the ramp, s; only with `kind = "ramp"`.
    pub ramp_s: Option<Positive>,
    /// Curvature of the rod at the start, 1/m: the rod is held in this shape and released at rest. With `kind = "shaped"` it is
    /// added to the natural curvature.
    pub curvature_1_m: Option<NumberOrProfile<Finite>>,
    /// Initial angular velocity of the whole rod about its centre of mass, rad/s; only with a free head.
    pub spin_rad_s: Option<Finite>,
}

/// Kinds of start, see [`Start`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum StartKind {
    /// The straight rod at rest is released into the full actuation at once.
    Jump,
    /// The actuation of the straight rod at rest grows smoothly from zero over `ramp_s`.
    Ramp,
    /// The rod starts in the shape of its natural curvature and moves with it, without momentum.
    #[default]
    Shaped,
}

impl StartTable {
    /// The keys that belong to a kind.
    pub(super) const KEYS_BY_KIND: KeysByChoice = KeysByChoice {
        table: "start",
        choices: &["kind"],
        keys: || vec!["ramp_s"],
        accepted: |chosen| Some(if chosen("kind")? == "ramp" { vec!["ramp_s"] } else { Vec::new() }),
    };

    pub(super) fn check(&self, head: &HeadTable) -> Result<(), KeyError> {
        let fault = |key: &str, problem: &str| Err(KeyError { key: key.into(), problem: problem.into() });
        match (self.kind, &self.ramp_s) {
            (StartKind::Ramp, None) => return fault("start.ramp_s", "missing; a ramp has no default duration"),
            (StartKind::Jump | StartKind::Shaped, Some(_)) => {
                return fault("start.ramp_s", "found without kind = \"ramp\"; allowed: only with it");
            }
            _ => {}
        }
        if self.spin_rad_s.is_some() && head.kind != HeadKind::Free {
            return fault("start.spin_rad_s", "found with a held head; allowed: only with a free one");
        }
        match self.curvature_1_m.as_ref().and_then(NumberOrProfile::disorder) {
            None => Ok(()),
            Some(found) => fault(
                "start.curvature_1_m",
                &refused(found, "a number, or points [xi, 1/m] with rising xi from 0 to 1"),
            ),
        }
    }

    /// The curvature κ of every node of `rod` at the start, in addition to that of the kind of start; `None` without.
    pub(super) fn initial_curvature(&self, rod: &Rod) -> Option<Vec<f64>> {
        let profile = self.curvature_1_m.as_ref()?.profile();
        let mut initial_curvature = (0..rod.nodes).map(|k| profile.at(rod.xi(k)) * rod.spacing).collect::<Vec<f64>>();
        rod.at_joints(&mut initial_curvature);
        Some(initial_curvature)
    }

    pub(super) fn build(&self) -> Start {
        match (self.kind, self.ramp_s) {
            (StartKind::Ramp, Some(duration)) => Start::Ramp { duration: duration.get() },
            (StartKind::Jump, _) => Start::Jump,
            _ => Start::Shaped,
        }
    }
}
