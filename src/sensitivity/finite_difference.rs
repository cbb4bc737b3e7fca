//! Finite differences of a scene: derivatives with respect to any of its numbers without an analytic derivative.
//!
//! The model of the scene is rebuilt with the number at p ± δ and p ± 2δ. The residual, an output or the initial state is
//! differenced over these models at one state, with the formula of fourth order. Nothing is differenced over time: the simulation
//! is differentiated as for any other parameter, without additional solves. With δ = 2·10⁻⁴ p, truncation and rounding errors are
//! both about 10⁻¹², relative to the largest force; with ten times smaller steps rounding was 4 to 10 times larger. At a kink the
//! result is the mean of the derivatives on both sides.
//!
//! A number that changes only the flow, such as its velocity or shear, acts through relative velocities. Its derivatives follow
//! from those with respect to velocities, and only the flow, which is linear in the number, is differenced. This also holds for a
//! rod at rest in water, where roots and squares of the speed in the drag are too steep for finite differences.

use nalgebra::Vector2;

use super::controls::Controls;
use super::output::{ActuatorState, Gradient, LocalDerivatives, Output, OutputContext, centre_of};
use super::step_ends::StepEnds;
use super::time_grid::TimeGrid;
use crate::actuation::Actuation;
use crate::error::{Error, Result};
use crate::fluid::force;
use crate::linear::Direction;
use crate::model::{DeformedRod, Dynamics, Inputs, Model};
use crate::rod::{add, node};
use crate::system::{State, System};

/// δ relative to the scale of the number.
const RELATIVE_STEP: f64 = 2e-4;

/// Central difference of fourth order: positions in δ, with their weights in 1/δ.
pub(super) const CENTRAL_STENCIL: [[f64; 2]; 4] =
    [[-2.0, 1.0 / 12.0], [-1.0, -2.0 / 3.0], [1.0, 2.0 / 3.0], [2.0, -1.0 / 12.0]];

/// One-sided difference of fourth order, used if there is no valid scene on the other side.
const BACKWARD_STENCIL: [[f64; 2]; 5] =
    [[0.0, 25.0 / 12.0], [-1.0, -4.0], [-2.0, 3.0], [-3.0, -4.0 / 3.0], [-4.0, 0.25]];

/// Finite difference with respect to one number of a scene: the perturbed scenes at all points of its stencil.
#[derive(Debug)]
pub struct FiniteDifference {
    pub(super) scenes: Vec<PerturbedScene>,
    nodes: usize,
    unknowns: usize,
    residual: Vec<f64>,
    /// Present if the number changes only the flow.
    flow: Option<FlowDerivative>,
}

/// The derivative of the flow velocity.
#[derive(Debug)]
struct FlowDerivative {
    /// At the nodes, two entries per node.
    nodes: Vec<f64>,
    /// At the body's centre.
    centre: Vector2<f64>,
    /// Zeros, two entries per node.
    still: Vec<f64>,
}

/// The scene at one point of the stencil.
#[derive(Debug)]
pub(super) struct PerturbedScene {
    pub(super) dynamics: Dynamics,
    /// The actuation of the scene.
    pub(super) actuation: Option<Box<dyn Actuation>>,
    weight: f64,
    ends: StepEnds,
    state: State,
}

impl FiniteDifference {
    /// The finite difference of a scene with respect to a number with the value `own` and the scale `size`. `model` builds the
    /// model for another value, twice: one to use, and one whose actuation stays unchanged. See [`of_flow`](Self::of_flow) for a
    /// number that changes only the flow.
    ///
    /// # Errors
    /// Errors of `model`.
    pub fn of(own: f64, size: f64, mut model: impl FnMut(f64) -> Result<[Model; 2]>) -> Result<Self> {
        let step = RELATIVE_STEP * size;
        let mut scene = |[at, weight]: [f64; 2]| {
            let [used, kept] = model(own + at * step)?;
            let (nodes, unknowns) = (used.rod.nodes, used.unknowns());
            Ok::<_, Error>(PerturbedScene {
                dynamics: Dynamics::new(used.into()),
                actuation: kept.actuation.map(|(actuation, _)| actuation),
                weight: weight / step,
                ends: StepEnds::new(nodes),
                state: State::zeros(unknowns),
            })
        };
        let above = BACKWARD_STENCIL.map(|[at, weight]| [-at, -weight]);
        let mut failed = None;
        for scenes in [&CENTRAL_STENCIL[..], &BACKWARD_STENCIL, &above] {
            match scenes.iter().map(|at| scene(*at)).collect::<Result<Vec<PerturbedScene>>>() {
                Ok(scenes) => {
                    let unknowns = scenes.first().map_or(0, |scene| scene.state.q.len());
                    return Ok(Self { scenes, ..Self::of_unknowns(unknowns) });
                }
                Err(error) => failed = failed.or(Some(error)),
            }
        }
        Err(failed.unwrap_or(Error::Step(step)))
    }

    /// A zero derivative, for a number that cannot change on its own, such as a flow across an interface.
    pub fn zero(model: &Model) -> Self {
        Self::of_unknowns(model.unknowns())
    }

    fn of_unknowns(unknowns: usize) -> Self {
        Self { scenes: Vec::new(), nodes: unknowns / 2, unknowns, residual: Vec::new(), flow: None }
    }

    /// Declares that the number changes only the flow.
    pub fn of_flow(self) -> Self {
        let zeros = || vec![0.0; 2 * self.nodes];
        Self { flow: Some(FlowDerivative { nodes: zeros(), centre: Vector2::zeros(), still: zeros() }), ..self }
    }

    /// The derivative of a value.
    pub(super) fn of_value(&mut self, mut value: impl FnMut(&mut PerturbedScene) -> Result<f64>) -> Result<f64> {
        let mut sum = 0.0;
        for scene in &mut self.scenes {
            sum += scene.weight * value(scene)?;
        }
        Ok(sum)
    }

    /// The derivative of a value of the model.
    pub fn of_model(&self, value: impl Fn(&Model) -> f64) -> f64 {
        self.scenes.iter().map(|scene| scene.weight * value(&scene.dynamics.model)).sum()
    }

    /// Moves to the time of the state of `bent`, which is number `n` of `steps`, with the adjacent steps if they are `wanted`.
    /// Writes f_p to `force`, in the order of a [`State`].
    pub(super) fn move_to(
        &mut self,
        bent: &DeformedRod<'_>,
        (controls, steps, n): (&Controls, TimeGrid, usize),
        wanted: bool,
        force: &mut [f64],
    ) -> Result<()> {
        force.fill(0.0);
        let state = bent.state;
        let Self { scenes, residual, flow, nodes, .. } = self;
        residual.resize(force.len(), 0.0);
        if let Some(FlowDerivative { nodes, centre, still }) = flow {
            nodes.fill(0.0);
            *centre = Vector2::zeros();
            for PerturbedScene { dynamics, weight, .. } in scenes {
                let Inputs { fluid, layers, .. } = &dynamics.inputs;
                let at = |x| layers.as_ref().map_or(*fluid, |layers| layers.at(*fluid, layers.height(x)).fluid);
                (0..dynamics.nodes()).for_each(|k| add(nodes, k, at(node(&state.q, k)).flow * *weight));
                *centre += at(centre_of(dynamics, state)).flow * *weight;
            }
            residual.iter_mut().zip(&*nodes).for_each(|(against, flow)| *against = -flow);
            for own in bent.dynamics.model.forces.iter().filter(|force| force.is_of_fluid()) {
                force::add_change(own, &bent.kinematics(), [still, residual, still], Vector2::zeros(), force);
            }
            return Ok(());
        }
        for PerturbedScene { dynamics, weight, ends, state: own, .. } in scenes {
            if wanted {
                ends.look(dynamics, controls, steps, n);
            } else {
                controls.apply(dynamics, n);
            }
            own.clone_from(state);
            dynamics.move_to(state.t, own);
            if dynamics.has_winches() {
                let tensions = dynamics.shape(own)?.dynamics.tensions_beside(bent.dynamics);
                dynamics.give_tensions(tensions);
            }
            dynamics.unconstrained(own, &mut residual[..2 * *nodes], None)?;
            if let (Some(last), Some(hinge)) =
                (residual.get_mut(2 * *nodes), dynamics.hinge_equation(Direction::POSITIONS))
            {
                *last = hinge.residual;
            }
            force.iter_mut().zip(&*residual).for_each(|(f, r)| *f += *weight * r);
        }
        Ok(())
    }

    /// The derivatives of the initial positions and velocities.
    pub(super) fn first(&mut self) -> [Vec<f64>; 2] {
        let mut by = [vec![0.0; self.unknowns], vec![0.0; self.unknowns]];
        for PerturbedScene { dynamics, weight, .. } in &mut self.scenes {
            let state = dynamics.first_state();
            for (by, values) in by.iter_mut().zip([&state.q, &state.v]) {
                by.iter_mut().zip(values).for_each(|(by, value)| *by += *weight * value);
            }
        }
        by
    }

    /// `factor` times the derivative at a fixed state of the quantities of `output` (`share` is `None`), or of its work in the
    /// step that ends here (0) or begins here (1); `gradient` holds the other derivatives, times `factor`.
    pub(super) fn output(
        &mut self,
        (output, gradient, factor): (&Output, &Gradient, f64),
        share: Option<(usize, Option<&ActuatorState>)>,
        point: &LocalDerivatives,
        scratch: &mut Gradient,
    ) -> Result<f64> {
        if let Some(FlowDerivative { nodes, centre, .. }) = &self.flow {
            return Ok(gradient.by_flow(nodes, *centre));
        }
        let by = self.of_value(|PerturbedScene { dynamics, ends, state, .. }| {
            let at = OutputContext { bent: dynamics.shape(state)?, point };
            Ok(match share {
                None => output.now.iter().map(|(c, quantity)| c * quantity.add(&at, 0.0, scratch)).sum(),
                Some((i, beyond)) => {
                    let span = (&ends.intervals[i], beyond);
                    output.work.iter().map(|(c, work)| c * work.add(&at, span, i == 0, 0.0, scratch)).sum()
                }
            })
        });
        by.map(|by| factor * by)
    }
}
