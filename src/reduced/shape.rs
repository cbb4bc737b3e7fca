//! The shape model: an inextensible chain whose curvature is prescribed as the natural one, 2 tan(θ_k/2) = κ̄_k(t). Only its
//! rigid motion is unknown.
//!
//! Momenta are those of rod and fluid together, see [`rigid`](super::rigid_motion). The equations are not stiff, so the
//! integrator is explicit. With a held head there are no unknowns: the chain follows the head.
//!
//! A jump of inputs makes the shape jump: the centre of mass, its velocity and Λ stay, and the new shape is rotated to fit the
//! old one best (mass-weighted least squares).

use std::sync::Arc;

use super::dormand_prince::{DormandPrinceStep, ORDER};
use super::rigid_motion::{RIGID_COORDINATES, RigidChain, RigidMotion};
use super::time_scales::TimeScales;
use super::{ModelKind, ModelStepper};
use crate::error::{Error, Result};
use crate::integrator::StepError;
use crate::model::{Dynamics, Mechanics, Model};
use crate::newton::Newton;
use crate::system::State;

/// Its entry in the table of models.
pub static MODEL: ModelKind = ModelKind {
    name: "shape",
    meaning: "the rigid motion of the prescribed shape: inertia of rod and fluid, and drag, without elasticity",
    method: Some("Dormand-Prince 5(4)"),
    needs_drag: false,
    estimate: Some(|estimates| &estimates.shape),
    refuses: unsuitable,
    build: |_| Box::new(ShapeStepper::default()),
};

/// The largest error of a step, relative to the length.
const ERROR_LIMIT: f64 = 1e-8;

/// The longest stable step, in multiples of the time in which drag stops the rod.
const STABLE: f64 = 3.3;

/// The largest number of steps of a run: half a minute of computing for ten nodes.
const MAX_STEPS: f64 = 1e7;

/// Steps per second for which the explicit method is stable while drag stops a free rod.
pub fn stable_rate(model: &Model, times: &TimeScales) -> f64 {
    if model.head.is_none() { 1.0 / (STABLE * times.stops[0]) } else { 0.0 }
}

/// The reason why this model cannot solve a run of `duration` (s): the rod starts with another curvature, or the run would take
/// too many steps.
fn unsuitable(model: &Arc<Model>, duration: f64) -> Option<String> {
    if model.initial_curvature.is_some() {
        return Some(
            "start.curvature_1_m bends the rod away from its natural curvature, which this model prescribes; allowed: \"overdamped\" or \"full\"".into(),
        );
    }
    let times = TimeScales::of(&Dynamics::new(Arc::clone(model)), duration);
    let steps = stable_rate(model, &times) * duration;
    (steps > MAX_STEPS).then(|| {
        format!(
            "drag stops this rod within {:.1e} s, which the explicit method of the shape model resolves in {steps:.1e} steps; allowed: a model that fits, \"overdamped\" or \"full\"",
            times.stops[0]
        )
    })
}

/// The method and its last step.
#[derive(Debug)]
struct ShapeStepper {
    chain: RigidChain,
    acceleration: Vec<f64>,
    active: Vec<f64>,
    step: DormandPrinceStep<RIGID_COORDINATES>,
}

impl Default for ShapeStepper {
    fn default() -> Self {
        Self {
            chain: RigidChain::default(),
            acceleration: Vec::new(),
            active: Vec::new(),
            step: DormandPrinceStep::none(),
        }
    }
}

/// The rates of the rigid motion of the prescribed shape at time `t` (s).
pub fn rates_at(chain: &mut RigidChain, dynamics: &mut Dynamics, t: f64, rigid: &RigidMotion) -> RigidMotion {
    dynamics.evaluate_at(t);
    chain.rates(dynamics, [&dynamics.natural, &dynamics.natural_rate], rigid)
}

impl ShapeStepper {
    /// Writes the state at time `t` of the rigid motion `rigid` with its `rates`.
    fn place(&mut self, dynamics: &mut Dynamics, t: f64, motion: Option<[&RigidMotion; 2]>, state: &mut State) {
        dynamics.evaluate_at(t);
        dynamics.natural_acceleration(t, &mut self.acceleration, &mut self.active);
        state.t = t;
        let (chain, natural) = (&mut self.chain, [&dynamics.natural[..], &dynamics.natural_rate, &self.acceleration]);
        match motion {
            Some([rigid, rates]) => chain.place(dynamics, natural, rigid, rates),
            None => chain.place_on_head(&dynamics.model.rod, natural, &dynamics.held.unwrap_or_default()),
        }
        state.q.copy_from_slice(&chain.x);
        state.v.copy_from_slice(&chain.v);
        state.a.copy_from_slice(&chain.a);
    }
}

impl ModelStepper for ShapeStepper {
    fn mechanics(&self) -> Mechanics {
        Mechanics::Shape
    }

    fn order(&self) -> u32 {
        ORDER
    }

    fn error_limit(&self) -> f64 {
        ERROR_LIMIT
    }

    fn begin(&mut self, dynamics: &mut Dynamics, newton: &mut Newton, state: &mut State) -> Result<()> {
        self.chain = RigidChain::new(&dynamics.model.rod);
        self.acceleration.resize(dynamics.model.rod.nodes, 0.0);
        self.reinitialise(dynamics, newton, state)
    }

    fn reinitialise(&mut self, dynamics: &mut Dynamics, _: &mut Newton, state: &mut State) -> Result<()> {
        if dynamics.model.head.is_some() {
            self.place(dynamics, state.t, None, state);
            return Ok(());
        }
        dynamics.evaluate_at(state.t);
        let rigid = self.chain.fit_state(dynamics, [&dynamics.natural, &dynamics.natural_rate], state);
        let rates = rates_at(&mut self.chain, dynamics, state.t, &rigid);
        state.memory.clear();
        state.memory.extend(rigid.iter().chain(&rates));
        self.place(dynamics, state.t, Some([&rigid, &rates]), state);
        Ok(())
    }

    fn step(
        &mut self,
        dynamics: &mut Dynamics,
        _: &mut Newton,
        from: &State,
        h: f64,
        to: &mut State,
    ) -> Result<StepError> {
        let Some((&rigid, rates)) = from.memory.split_first_chunk::<RIGID_COORDINATES>() else {
            self.place(dynamics, to.t, None, to);
            return Ok(StepError::default());
        };
        let rates = rates.first_chunk().copied().unwrap_or([0.0; RIGID_COORDINATES]);
        let chain = &mut self.chain;
        self.step = DormandPrinceStep::new(from.t, rigid, rates, h, |t, rigid| rates_at(chain, dynamics, t, rigid));
        let (error, length) = (self.step.error(), dynamics.model.rod.length);
        let [x, y, turn, vx, vy, momentum] = error.map(f64::abs);
        let error = StepError {
            position: x.max(y) + length * turn,
            velocity: vx.max(vy) + length * momentum / self.chain.inertia,
        };
        if !(error.position + error.velocity).is_finite() {
            return Err(Error::NotFinite { time_s: to.t, node: 0, what: "the motion of the shape" });
        }
        let (end, rates) = (self.step.end, self.step.rate());
        to.memory.clear();
        to.memory.extend(end.iter().chain(&rates));
        self.place(dynamics, to.t, Some([&end, &rates]), to);
        Ok(error)
    }

    fn has_dense_output(&self) -> bool {
        true
    }

    fn interpolate(&mut self, dynamics: &mut Dynamics, from: &State, t: f64, out: &mut State) {
        if from.memory.is_empty() {
            self.place(dynamics, t, None, out);
        } else {
            let rigid = self.step.at(t);
            let rates = rates_at(&mut self.chain, dynamics, t, &rigid);
            self.place(dynamics, t, Some([&rigid, &rates]), out);
        }
    }
}
