//! Derivatives by any number of a scene, of which the equations know no derivative by themselves.
//!
//! The scene is made again with the number at p ± δ and p ± 2δ, and what is wanted at one state (the residual, a reading, a
//! first position) is differenced over these with the formula of fourth order. Nothing is differenced in time: the simulation
//! is differentiated as by any other parameter, and no solve is added. With δ = 2·10⁻⁴ p truncation and rounding are both
//! about 10⁻¹² of what is differenced. At a kink the derivative is the mean of those on both sides.
//!
//! What moves the flow alone, as the flow itself and its shear, acts through velocities against it only, so its derivatives are those
//! by velocities: of the scene's moves only the flow's own is differenced, in which it is linear. A rod at rest in water has no others,
//! as there the drag's roots and squares of the speed are steeper than differences see.

use nalgebra::Vector2;

use super::controls::Controls;
use super::ends::Ends;
use super::output::{At, Gradient, Output, Point, centre_of};
use super::problem::Steps;
use crate::actuation::Actuation;
use crate::error::{Error, Result};
use crate::fluid::force;
use crate::model::{DeformedRod, Dynamics, Inputs, Model};
use crate::rod::{add, node};
use crate::system::{State, System};

/// δ over the size of the number.
const STEP: f64 = 2e-4;

/// Places over δ, with the weights of their values over 1/δ.
const PLACES: [[f64; 2]; 4] = [[-2.0, 1.0 / 12.0], [-1.0, -2.0 / 3.0], [1.0, 2.0 / 3.0], [2.0, -1.0 / 12.0]];

/// The same to one side, where the other has no scene.
const BELOW: [[f64; 2]; 5] = [[0.0, 25.0 / 12.0], [-1.0, -4.0], [-2.0, 3.0], [-3.0, -4.0 / 3.0], [-4.0, 0.25]];

/// A scene with one of its numbers moved a little, to each of the places of the difference.
#[derive(Debug)]
pub struct Moved {
    pub(super) places: Vec<Place>,
    nodes: usize,
    residual: Vec<f64>,
    /// What moves the flow alone.
    flow: Option<Flow>,
}

/// The derivative of the flow.
#[derive(Debug)]
struct Flow {
    /// At the nodes, two entries per node.
    nodes: Vec<f64>,
    /// At the body's centre.
    centre: Vector2<f64>,
    /// As many zeros.
    still: Vec<f64>,
}

/// The scene at one place.
#[derive(Debug)]
pub(super) struct Place {
    pub(super) dynamics: Dynamics,
    /// The actuation as the scene has it.
    pub(super) actuation: Option<Box<dyn Actuation>>,
    weight: f64,
    ends: Ends,
    state: State,
}

impl Moved {
    /// Of a scene whose number is `own` and of this `size`, which `model` makes again with another: the model as it is used, and
    /// another one whose actuation is kept as the scene has it. See [`flowing`](Self::flowing) for what moves the flow alone.
    ///
    /// # Errors
    /// Those of `model`.
    pub fn of(own: f64, size: f64, mut model: impl FnMut(f64) -> Result<[Model; 2]>) -> Result<Self> {
        let step = STEP * size;
        let mut place = |[at, weight]: [f64; 2]| {
            let [used, kept] = model(own + at * step)?;
            let nodes = used.rod.nodes;
            Ok::<_, Error>(Place {
                dynamics: Dynamics::new(used.into()),
                actuation: kept.actuation.map(|(actuation, _)| actuation),
                weight: weight / step,
                ends: Ends::new(nodes),
                state: State::zeros(2 * nodes),
            })
        };
        let above = BELOW.map(|[at, weight]| [-at, -weight]);
        let mut failed = None;
        for places in [&PLACES[..], &BELOW, &above] {
            match places.iter().map(|at| place(*at)).collect::<Result<Vec<Place>>>() {
                Ok(places) => {
                    let nodes = places.first().map_or(0, |place| place.state.q.len() / 2);
                    return Ok(Self { places, nodes, residual: Vec::new(), flow: None });
                }
                Err(error) => failed = failed.or(Some(error)),
            }
        }
        Err(failed.unwrap_or(Error::Step(step)))
    }

    /// Of a scene with so many nodes whose number cannot be another one by itself, as a flow across an interface: no derivatives.
    pub fn nowhere(nodes: usize) -> Self {
        Self { places: Vec::new(), nodes, residual: Vec::new(), flow: None }
    }

    /// The same, of a number that moves the flow alone.
    pub fn flowing(self) -> Self {
        let zeros = || vec![0.0; 2 * self.nodes];
        Self { flow: Some(Flow { nodes: zeros(), centre: Vector2::zeros(), still: zeros() }), ..self }
    }

    /// The derivative of a number.
    pub(super) fn by(&mut self, mut value: impl FnMut(&mut Place) -> Result<f64>) -> Result<f64> {
        let mut sum = 0.0;
        for place in &mut self.places {
            sum += place.weight * value(place)?;
        }
        Ok(sum)
    }

    /// The derivative of a number of the model.
    pub fn by_model(&self, value: impl Fn(&Model) -> f64) -> f64 {
        self.places.iter().map(|place| place.weight * value(&place.dynamics.model)).sum()
    }

    /// Moves on to the time of the state of `bent`, number `n` of `steps`, with the steps beside it where they are `wanted`; writes
    /// f_p to `force`, two entries per node.
    pub(super) fn look(
        &mut self,
        bent: &DeformedRod<'_>,
        (controls, steps, n): (&Controls, Steps, usize),
        wanted: bool,
        force: &mut [f64],
    ) -> Result<()> {
        force.fill(0.0);
        let state = bent.state;
        let Self { places, residual, flow, .. } = self;
        residual.resize(force.len(), 0.0);
        if let Some(Flow { nodes, centre, still }) = flow {
            nodes.fill(0.0);
            *centre = Vector2::zeros();
            for Place { dynamics, weight, .. } in places {
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
        for Place { dynamics, weight, ends, state: own, .. } in places {
            if wanted {
                ends.look(dynamics, controls, steps, n);
            } else {
                controls.apply(dynamics, n);
            }
            own.clone_from(state);
            dynamics.move_to(state.t, own);
            dynamics.unconstrained(own, residual, None)?;
            force.iter_mut().zip(&*residual).for_each(|(f, r)| *f += *weight * r);
        }
        Ok(())
    }

    /// The derivatives of the first positions and velocities.
    pub(super) fn first(&mut self) -> [Vec<f64>; 2] {
        let mut by = [vec![0.0; 2 * self.nodes], vec![0.0; 2 * self.nodes]];
        for Place { dynamics, weight, .. } in &mut self.places {
            let state = dynamics.first_state();
            for (by, values) in by.iter_mut().zip([&state.q, &state.v]) {
                by.iter_mut().zip(values).for_each(|(by, value)| *by += *weight * value);
            }
        }
        by
    }

    /// `factor` times the derivative of the quantities of `output` (`share` none), or of the share in its work of the step to here
    /// (0) or from here (1), where the state stays and `gradient` is so much times the other derivatives.
    pub(super) fn output(
        &mut self,
        (output, gradient, factor): (&Output, &Gradient, f64),
        share: Option<usize>,
        point: &Point,
        scratch: &mut Gradient,
    ) -> Result<f64> {
        if let Some(Flow { nodes, centre, .. }) = &self.flow {
            return Ok(gradient.by_flow(nodes, *centre));
        }
        let by = self.by(|Place { dynamics, ends, state, .. }| {
            let at = At { bent: dynamics.shape(state)?, point };
            Ok(match share {
                None => output.now.iter().map(|(c, quantity)| c * quantity.add(&at, 0.0, scratch)).sum(),
                Some(i) => {
                    let span = &ends.spans[i];
                    output.work.iter().map(|(c, work)| c * work.add(&at, span, i == 0, 0.0, scratch)).sum()
                }
            })
        });
        by.map(|by| factor * by)
    }
}
