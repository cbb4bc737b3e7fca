//! The models of a scene that `solver.model` selects from: the full rod, and cheaper reduced models that omit elasticity or
//! inertia.
//!
//! Each model advances the same [`State`], the positions, velocities and accelerations of all nodes, so the stepper, variables,
//! outputs and sweeps work with all of them.

pub mod comparison;
mod dormand_prince;
pub mod fluid_estimates;
mod full;
pub mod model_estimates;
mod motion_and_power;
mod overdamped;
mod rigid_motion;
mod shape;
mod time_scales;

use std::sync::Arc;

use crate::error::Result;
use crate::integrator::{Integrator, StepError, StepWeights};
use crate::model::{Dynamics, Mechanics, Model};
use crate::newton::Newton;
use crate::system::State;
pub use comparison::{Differences, ErrorMeasure};
pub use fluid_estimates::{FluidChoice, FluidEstimates};
pub(crate) use full::MODEL as FULL;
pub use model_estimates::{Estimate, Estimates};
pub use motion_and_power::MotionAndPower;

/// All models, the cheapest first. To add one, write its file and list it here.
pub static MODELS: &[&ModelKind] = &[&shape::MODEL, &overdamped::MODEL, &full::MODEL];

/// A kind of model: its name, its limits, and how it is built.
#[derive(Debug)]
pub struct ModelKind {
    /// Name in a scene.
    pub name: &'static str,
    /// The terms that it includes and those that it omits.
    pub meaning: &'static str,
    /// Name of its own integrator; `None` if it uses the integrator of the scene.
    pub method: Option<&'static str>,
    /// True if it is undefined without drag.
    pub needs_drag: bool,
    /// Selects its estimated errors; `None` if it omits nothing.
    pub estimate: Option<fn(&Estimates) -> &Estimate>,
    /// The reason why it cannot simulate a model for a duration (s), if any.
    pub refuses: fn(&Arc<Model>, f64) -> Option<String>,
    /// Builds its stepper, with the integrator of the scene.
    pub build: fn(Box<dyn Integrator>) -> Box<dyn ModelStepper>,
}

impl ModelKind {
    /// The model of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        MODELS.iter().copied().find(|kind| kind.name == name)
    }
}

/// The kind of model that a run uses, and the reason.
#[derive(Debug, Clone)]
pub struct ModelChoice {
    /// The kind of model.
    pub kind: &'static ModelKind,
    /// The reason, if the program chose it.
    pub reason: Option<String>,
    /// The estimates that the choice is based on.
    pub estimates: Option<Estimates>,
}

impl ModelChoice {
    /// The model that a scene specifies.
    pub fn asked(kind: &'static ModelKind) -> Self {
        Self { kind, reason: None, estimates: None }
    }

    /// The cheapest model whose estimated errors in `measures` do not exceed `accuracy`; `drag` tells whether the scene has drag.
    pub fn of(estimates: Estimates, accuracy: f64, measures: &[ErrorMeasure], drag: bool) -> Self {
        let (mut taken, mut reasons) = (&full::MODEL, Vec::new());
        for kind in MODELS.iter().filter(|kind| drag || !kind.needs_drag) {
            let Some(estimate) = kind.estimate else { continue };
            match estimate(&estimates).as_ref().map(|errors| errors.largest(measures)) {
                Ok(Some((measure, error))) if error <= accuracy => {
                    let [name, relative] = measure.meaning();
                    reasons = vec![format!(
                        "its largest estimated error, of the {name}, is {error:.1e} of {relative}: within the accuracy {accuracy:e}"
                    )];
                    taken = kind;
                    break;
                }
                Ok(Some((measure, error))) => reasons.push(format!(
                    "{}: estimated error of the {} {error:.1e}, above the accuracy {accuracy:e}",
                    kind.name,
                    measure.meaning()[0]
                )),
                Ok(None) => {}
                Err(reason) => reasons.push(format!("{}: {reason}", kind.name)),
            }
        }
        Self { kind: taken, reason: Some(reasons.join("; ")), estimates: Some(estimates) }
    }

    /// The largest estimated error of a cheaper model stated in this [`reason`](Self::reason) for its choice, and its measure.
    pub fn stated_error(reason: &str) -> Option<(ErrorMeasure, f64)> {
        let (name, rest) = reason.strip_prefix("its largest estimated error, of the ")?.split_once(", is ")?;
        let measure = ErrorMeasure::ALL.into_iter().find(|measure| measure.meaning()[0] == name)?;
        Some((measure, rest.split(' ').next()?.parse().ok()?))
    }
}

/// Advances the state of a rod in time, by the equations of one kind of model.
pub trait ModelStepper: std::fmt::Debug + Send + Sync {
    /// The mechanics of the rod that the model includes.
    fn mechanics(&self) -> Mechanics;

    /// Order of convergence in the step size.
    fn order(&self) -> u32;

    /// The largest error of a fixed step, relative to the length. A step with a larger error is halved.
    fn error_limit(&self) -> f64 {
        f64::INFINITY
    }

    /// Prepares a run from `state`, as placed by a [`Start`](crate::start::Start), and makes it consistent with the model.
    ///
    /// # Errors
    /// Errors of [`Newton::iterate`].
    fn begin(&mut self, dynamics: &mut Dynamics, newton: &mut Newton, state: &mut State) -> Result<()>;

    /// Makes `state` consistent with the model again after a jump of inputs.
    ///
    /// # Errors
    /// Errors of [`Newton::iterate`].
    fn reinitialise(&mut self, dynamics: &mut Dynamics, newton: &mut Newton, state: &mut State) -> Result<()>;

    /// Steps as [`Integrator::step`] does.
    ///
    /// # Errors
    /// Errors of [`Integrator::step`].
    fn step(
        &mut self,
        dynamics: &mut Dynamics,
        newton: &mut Newton,
        from: &State,
        h: f64,
        to: &mut State,
    ) -> Result<StepError>;

    /// The weights of a step of `h` (s), if it solves the full model by a one-stage method.
    fn rule(&self, _h: f64) -> Option<StepWeights> {
        None
    }

    /// The integrator of the full model, whose steps can be linearised; `None` for a reduced model.
    fn integrator(&self) -> Option<&dyn Integrator> {
        None
    }

    /// True if it has dense output as accurate as the end of the step. Work is then integrated with the midpoint too.
    fn has_dense_output(&self) -> bool {
        false
    }

    /// Writes the state at time `t` (s) of the last step, which began at `from`, to `out`. Called only if it
    /// [has dense output](Self::has_dense_output).
    fn interpolate(&mut self, _dynamics: &mut Dynamics, _from: &State, _t: f64, _out: &mut State) {}
}

impl From<Box<dyn Integrator>> for Box<dyn ModelStepper> {
    /// The full model.
    fn from(integrator: Box<dyn Integrator>) -> Self {
        (full::MODEL.build)(integrator)
    }
}
