//! The ladder of models of one scene: the whole rod, and cheaper models that keep less of its mechanics.
//!
//! Every rung moves the same [`State`]: positions, velocities and accelerations of all nodes. So stepper, variables,
//! outputs and sweeps are the same for each.

pub mod estimate;
pub mod fluids;
mod full;
pub mod measure;
mod overdamped;
mod rigid;
mod runge_kutta;
mod shape;

use std::sync::Arc;

use crate::error::Result;
use crate::integrator::{Integrator, StepError, StepWeights};
use crate::model::{Dynamics, Mechanics, Model};
use crate::newton::Newton;
use crate::system::State;
pub use estimate::{Estimate, Estimates};
pub use fluids::{FluidChoice, FluidEstimates};
pub(crate) use full::RUNG as FULL;
pub use measure::{Differences, Measure};

/// All rungs, the cheapest first; adding one is its file and its line here.
pub static RUNGS: &[&Rung] = &[&shape::RUNG, &overdamped::RUNG, &full::RUNG];

/// What is known of a rung, and how to make it.
#[derive(Debug)]
pub struct Rung {
    /// Name in a scene.
    pub name: &'static str,
    /// What it keeps and what it leaves out.
    pub meaning: &'static str,
    /// What it is solved by; `None`: by the scene's integrator.
    pub method: Option<&'static str>,
    /// True where it makes no sense without drag.
    pub needs_drag: bool,
    /// What is estimated of its errors; `None`: it leaves nothing out.
    pub estimate: Option<fn(&Estimates) -> &Estimate>,
    /// Why it cannot run a model for so long (s), where it cannot.
    pub refuses: fn(&Arc<Model>, f64) -> Option<String>,
    /// The rung, for a scene with that integrator.
    pub build: fn(Box<dyn Integrator>) -> Box<dyn Mover>,
}

impl Rung {
    /// The rung of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        RUNGS.iter().copied().find(|rung| rung.name == name)
    }
}

/// A rung, and why it was taken.
#[derive(Debug, Clone)]
pub struct Choice {
    /// The rung.
    pub rung: &'static Rung,
    /// Why, where the program has chosen.
    pub reason: Option<String>,
    /// What the program has chosen by.
    pub estimates: Option<Estimates>,
}

impl Choice {
    /// The rung that a scene names.
    pub fn asked(rung: &'static Rung) -> Self {
        Self { rung, reason: None, estimates: None }
    }

    /// The cheapest rung whose estimated errors of `measures` are at most `accuracy`; `drag` says whether there is any.
    pub fn of(estimates: Estimates, accuracy: f64, measures: &[Measure], drag: bool) -> Self {
        let (mut taken, mut reasons) = (&full::RUNG, Vec::new());
        for rung in RUNGS.iter().filter(|rung| drag || !rung.needs_drag) {
            let Some(estimate) = rung.estimate else { continue };
            match estimate(&estimates).as_ref().map(|errors| errors.worst(measures)) {
                Ok(Some((measure, error))) if error <= accuracy => {
                    let [name, relative] = measure.meaning();
                    reasons = vec![format!(
                        "its largest estimated error, of the {name}, is {error:.1e} of {relative}: within the accuracy {accuracy:e}"
                    )];
                    taken = rung;
                    break;
                }
                Ok(Some((measure, error))) => reasons.push(format!(
                    "{}: estimated error of the {} {error:.1e}, above the accuracy {accuracy:e}",
                    rung.name,
                    measure.meaning()[0]
                )),
                Ok(None) => {}
                Err(reason) => reasons.push(format!("{}: {reason}", rung.name)),
            }
        }
        Self { rung: taken, reason: Some(reasons.join("; ")), estimates: Some(estimates) }
    }
}

/// A rung at work: it moves the state of a rod.
pub trait Mover: std::fmt::Debug + Send {
    /// What it keeps of the rod's mechanics.
    fn mechanics(&self) -> Mechanics;

    /// Order of convergence in the step size.
    fn order(&self) -> u32;

    /// Largest error of a step over the length where the scene gives the step; it is halved where it has more.
    fn limit(&self) -> f64 {
        f64::INFINITY
    }

    /// Prepares for a run from `state`, a [`Start`](crate::start::Start), and makes it one of its own.
    ///
    /// # Errors
    /// Those of [`Newton::iterate`].
    fn begin(&mut self, dynamics: &mut Dynamics, newton: &mut Newton, state: &mut State) -> Result<()>;

    /// Makes `state` one of its own again after inputs have changed.
    ///
    /// # Errors
    /// Those of [`Newton::iterate`].
    fn settle(&mut self, dynamics: &mut Dynamics, newton: &mut Newton, state: &mut State) -> Result<()>;

    /// Steps as [`Integrator::step`] does.
    ///
    /// # Errors
    /// Those of [`Integrator::step`].
    fn step(
        &mut self,
        dynamics: &mut Dynamics,
        newton: &mut Newton,
        from: &State,
        h: f64,
        to: &mut State,
    ) -> Result<StepError>;

    /// The rule of its steps of `h` (s), where it solves the whole model by a method of one stage.
    fn rule(&self, _h: f64) -> Option<StepWeights> {
        None
    }

    /// True where it knows the state within a step as well as at its end: work is read in the middle too.
    fn knows_between(&self) -> bool {
        false
    }

    /// Writes the state at time `t` (s) of the last step, which began at `from`, to `out`; only where it
    /// [knows](Self::knows_between) it.
    fn between(&mut self, _dynamics: &mut Dynamics, _from: &State, _t: f64, _out: &mut State) {}
}

impl From<Box<dyn Integrator>> for Box<dyn Mover> {
    /// The whole model.
    fn from(integrator: Box<dyn Integrator>) -> Self {
        (full::RUNG.build)(integrator)
    }
}
