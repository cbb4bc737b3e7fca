//! `caudal study fluid`: the same motion under every law of the fluid that can hold, and which of them the scene needs.
//!
//! Rungs are the laws of drag, each with the water that the rod accelerates and without. The highest rung is the one of those that
//! hold at the scene's Reynolds number which leaves out least of what the scene says and is least uncertain by what is published
//! of it. Differences are against it, and mean nothing below its own uncertainty.

mod figures;
mod swim;
mod words;

use std::fmt;

use serde::{Deserialize, Serialize};

use self::swim::Swim;
use self::words::Report;
use super::{Desk, Studied};
use crate::error::Result;
use crate::fluid::laws::{DragLaw, LAWS, auto};
use crate::fluid::reactive::COUNTS;
use crate::fluid::uncertainty::Uncertainty;
use crate::fluid::validity::Validity;
use crate::jobs;
use crate::scene::{HeadKind, Scene};

/// What is asked for.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Fluid {}

/// A law of drag, with the water that the rod accelerates or without.
#[derive(Clone)]
struct Rung {
    law: &'static DragLaw,
    reactive: bool,
    /// It is the scene's own.
    own: bool,
    /// The scene's motion is in its range.
    holds: bool,
    /// What is published of it.
    uncertainty: Option<Uncertainty>,
    /// Keys of the scene's drag that it cannot hold.
    dropped: usize,
    scene: Scene,
}

impl fmt::Display for Rung {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.law.with_reactive(self.reactive))
    }
}

impl fmt::Debug for Rung {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// All rungs of a scene, and those that it cannot have, with the reason.
struct Ladder {
    rungs: Vec<Rung>,
    refused: Vec<(String, String)>,
    reynolds: f64,
    /// The water's inertia counts for whether the rod is stable.
    water_decides: bool,
}

impl Ladder {
    fn of(scene: &Scene) -> Result<Self> {
        let model = scene.model()?;
        if scene.medium.is_none() {
            return Err(scene.error("medium", "missing; without a fluid there is no law of it to compare".to_string()));
        }
        let regime = scene.regime().map_err(|reason| scene.error("", reason))?;
        let reynolds = regime.reynolds;
        let motion = scene.motion(&model.rod, regime.across);
        let (own_law, own_reactive) = scene.fluid_model(&model.rod);
        let (mut rungs, mut refused) = (Vec::new(), Vec::new());
        for law in LAWS.iter().filter(|law| law.name != auto::LAW.name) {
            for reactive in [false, true] {
                let own = own_law == Some(law) && own_reactive == reactive;
                let name = law.with_reactive(reactive);
                let water = Validity { bounds: if reactive { const { &[COUNTS] } } else { &[] }, ..law.validity };
                let left = law.validity.beyond(&motion).or_else(|| water.beyond(&motion));
                let holds = left.is_none();
                let (scene, dropped) = match scene.with_fluid(law, reactive) {
                    Ok(other) => other,
                    Err(reason) => {
                        refused.push((name, reason));
                        continue;
                    }
                };
                if let Some(left) = left.filter(|_| !own) {
                    refused.push((name, format!("out of its range: {left}")));
                    continue;
                }
                let uncertainty = law.uncertainty(reynolds, reactive).filter(|_| holds);
                rungs.push(Rung { law, reactive, own, holds, uncertainty, dropped, scene });
            }
        }
        Ok(Self { rungs, refused, reynolds, water_decides: regime.water_decides_stability() })
    }
}

/// The index of the highest of `rungs`: it drops fewest keys of the scene, and of those it is least uncertain.
fn highest<'a>(rungs: impl Iterator<Item = (usize, &'a Rung)>, held: bool) -> Option<usize> {
    let known = rungs.filter_map(|(i, rung)| Some((i, rung.dropped, rung.uncertainty?.measured(held)[0])));
    known.min_by(|a, b| a.1.cmp(&b.1).then(a.2.total_cmp(&b.2))).map(|(i, ..)| i)
}

/// Runs `scene` under every law that can hold.
///
/// # Errors
/// Those of [`Scene::model`]; [`Error::Scene`](crate::Error::Scene) without a medium; [`Error::Write`](crate::Error::Write),
/// [`Error::Journal`](crate::Error::Journal).
pub(super) fn fluid(scene: &Scene, _: &Fluid, desk: Desk<'_>) -> Result<Studied> {
    let ladder = Ladder::of(scene)?;
    let run = |rung: &Rung| Swim::of(&rung.scene, desk.interrupted);
    let swims = match desk.work("laws", scene, &ladder.rungs, jobs::cores(), run)? {
        Ok(swims) => swims,
        Err(interrupted) => return Ok(interrupted),
    };
    let held = scene.head.kind != HeadKind::Free;
    let complete = ladder.rungs.iter().enumerate().filter(|(i, _)| swims[*i].means.is_some());
    let reference = highest(complete.clone(), held).or(complete.clone().find(|(_, rung)| rung.own).map(|(i, _)| i));
    Ok(Studied::Complete(Report { scene, ladder: &ladder, swims: &swims, reference, held }.findings()))
}
