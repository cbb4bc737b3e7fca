//! The fluid models that are compared: every drag law, with and without the reactive force.

use std::fmt;

use crate::error::Result;
use crate::fluid::laws::{DragLaw, LAWS, auto};
use crate::fluid::reactive::COUNTS;
use crate::fluid::uncertainty::Uncertainty;
use crate::fluid::validity::Validity;
use crate::scene::Scene;

/// A drag law, with or without the reactive force (the added mass of the water).
#[derive(Clone)]
pub struct FluidModel {
    pub law: &'static DragLaw,
    pub reactive: bool,
    /// True for the scene's own model.
    pub own: bool,
    /// True if the scene's motion is in its range of validity.
    pub holds: bool,
    /// Its published uncertainty.
    pub uncertainty: Option<Uncertainty>,
    /// Number of keys of the scene's drag table that this model does not use.
    pub dropped: usize,
    pub scene: Scene,
}

impl fmt::Display for FluidModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.law.with_reactive(self.reactive))
    }
}

impl fmt::Debug for FluidModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// All fluid models of a scene, and those that it cannot use, with the reason.
pub struct FluidModels {
    pub models: Vec<FluidModel>,
    pub refused: Vec<(String, String)>,
    /// Valid models with hydrodynamic interaction of distant parts that cannot be used on this mesh, with the reason.
    pub missing: Vec<(String, String)>,
    pub reynolds: f64,
    /// True if the added mass decides whether the rod is stable.
    pub water_decides: bool,
}

impl FluidModels {
    pub fn of(scene: &Scene) -> Result<Self> {
        let rod = scene.model()?.rod;
        if scene.medium.is_none() {
            return Err(scene.error("medium", "missing; without a fluid there is no law of it to compare".to_string()));
        }
        let regime = scene.regime().map_err(|reason| scene.error("", reason))?;
        let reynolds = regime.reynolds;
        let motion = scene.motion(&rod, regime.across);
        let (own_law, own_reactive) = scene.fluid_model(&rod);
        let (mut models, mut refused, mut missing) = (Vec::new(), Vec::new(), Vec::new());
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
                        if holds && law.is_nonlocal() {
                            missing.push((name.clone(), reason.clone()));
                        }
                        refused.push((name, reason));
                        continue;
                    }
                };
                if let Some(left) = left.filter(|_| !own) {
                    refused.push((name, format!("out of its range: {left}")));
                    continue;
                }
                let uncertainty = law.uncertainty(reynolds, reactive).filter(|_| holds);
                models.push(FluidModel { law, reactive, own, holds, uncertainty, dropped, scene });
            }
        }
        Ok(Self { models, refused, missing, reynolds, water_decides: regime.water_decides_stability() })
    }
}

/// The index of the most accurate of `models`: the one that drops the fewest keys of the scene, among those the one of the least
/// uncertainty, and among equally uncertain ones that of the largest range.
pub fn most_accurate<'a>(models: impl Iterator<Item = (usize, &'a FluidModel)>, held: bool) -> Option<usize> {
    let known = models
        .filter_map(|(i, model)| Some((i, model.dropped, model.uncertainty?.measured(held)[0], model.law.reynolds)));
    known.min_by(|a, b| a.1.cmp(&b.1).then(a.2.total_cmp(&b.2)).then(b.3.total_cmp(&a.3))).map(|(i, ..)| i)
}
