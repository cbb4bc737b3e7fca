//! `caudal study fluid`: the same motion with each fluid model, and which of them the scene needs.
//!
//! Each drag law is run with and without the reactive force. The reference is the most accurate of the models that are valid at the
//! scene's Reynolds number: the one that ignores the fewest keys of the scene and has the smallest published uncertainty. Differences
//! from it that are below its own uncertainty are meaningless.

mod explanations;
mod figures;
mod fluid_models;
mod model_run;

use serde::{Deserialize, Serialize};

use self::explanations::FluidReport;
use self::fluid_models::{FluidModel, FluidModels, most_accurate};
use self::model_run::FluidModelRun;
use super::runner::{StudyOutcome, StudyRunner};
use crate::error::Result;
use crate::jobs;
use crate::scene::{HeadKind, Scene};

/// Options of the study.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FluidOptions {}

/// Runs `scene` with each valid fluid model.
///
/// # Errors
/// Those of [`Scene::model`]; [`Error::Scene`](crate::Error::Scene) without a medium; [`Error::Write`](crate::Error::Write),
/// [`Error::Journal`](crate::Error::Journal).
pub(super) fn fluid(scene: &Scene, _: &FluidOptions, runner: StudyRunner<'_>) -> Result<StudyOutcome> {
    let models = FluidModels::of(scene)?;
    let run = |model: &FluidModel| FluidModelRun::of(&model.scene, runner.interrupted);
    let swims = match runner.run_all("laws", scene, &models.models, jobs::cores(), run)? {
        Ok(swims) => swims,
        Err(interrupted) => return Ok(interrupted),
    };
    let held = scene.head.kind != HeadKind::Free;
    let complete = models.models.iter().enumerate().filter(|(i, _)| swims[*i].means.is_some());
    let reference =
        most_accurate(complete.clone(), held).or(complete.clone().find(|(_, model)| model.own).map(|(i, _)| i));
    Ok(StudyOutcome::Complete(FluidReport { scene, models: &models, swims: &swims, reference, held }.findings()))
}
