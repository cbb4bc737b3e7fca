//! A model at rest and its derivatives in that state, the starting point of every linear analysis.
//!
//! [`unloaded`] is the straight rod in still fluid without loads; natural modes are computed about this state. [`held_still`]
//! keeps flow, loads and tensions, and removes the drives of the rod: the rest state of such a model need not be straight. Both
//! keep a hinge with its servo, whose angle is an additional unknown, see [`FreeUnknowns`].

use nalgebra::Vector2;

use crate::error::Result;
use crate::fluid::{Fluid, Forces};
use crate::head::{Hinge, Signal};
use crate::linear::{BandMatrix, Direction};
use crate::model::{Dynamics, Model};
use crate::rod::Rod;
use crate::start::Start;
use crate::system::{Linearisation, State, System};
use crate::tendons::Tendons;

/// The straight `rod` along x from the origin, in vacuum; its head is held if it has a joint at node 0.
pub fn bare(rod: Rod) -> Model {
    Model {
        actuation: None,
        active_moments: false,
        largest_drive: None,
        lag: None,
        tendons: Tendons::default(),
        hinge: None,
        start: Start::Jump,
        forces: Forces::default(),
        fluid: Fluid::NONE,
        flow: None,
        load: None,
        layers: None,
        buoyancy: None,
        head: (rod.first_joint == 0).then(|| [0.0; 3].map(Signal::Constant)),
        head_input: Default::default(),
        spin: 0.0,
        initial_curvature: None,
        rod,
    }
}

/// The straight rod of `model`, in its fluid at rest and with its hinge, whose commanded angle equals its angle.
pub fn unloaded(model: Model) -> Model {
    let Model { rod, forces, fluid, layers, hinge, .. } = model;
    Model {
        forces,
        fluid: Fluid { flow: Vector2::zeros(), acceleration: Vector2::zeros(), ..fluid },
        layers,
        hinge: hinge.map(without_torque),
        ..bare(rod)
    }
}

/// `model` without its drives: actuation, start, motion of the head, and a varying torque. The head stays at its pose at time
/// zero.
pub fn held_still(model: Model) -> Model {
    let still = |signal: &Signal| Signal::Constant(signal.at(0.0).value);
    let steady = |hinge: Hinge| if hinge.torque.constant().is_some() { hinge } else { without_torque(hinge) };
    Model {
        actuation: None,
        lag: None,
        start: Start::Jump,
        spin: 0.0,
        initial_curvature: None,
        head: model.head.map(|motion| motion.each_ref().map(still)),
        hinge: model.hinge.map(steady),
        ..model
    }
}

fn without_torque(hinge: Hinge) -> Hinge {
    Hinge { torque: Signal::Constant(0.0), ..hinge }
}

/// The derivative of the equation of motion of `dynamics` at `state` along `direction`, for all nodes. A held node has the rows
/// of a free one. A node held by a hinge has none, and the arc of the hinge takes the place of its x.
///
/// # Errors
/// Errors of [`System::assemble`].
pub(super) fn derivative(dynamics: &mut Dynamics, state: &State, direction: Direction) -> Result<BandMatrix> {
    let nodes = dynamics.nodes();
    let mut matrix = BandMatrix::new(nodes);
    let mut residual = vec![0.0; 2 * nodes];
    let linearisation = Some(Linearisation { matrix: &mut matrix, direction });
    if dynamics.model.hinge.is_some() {
        dynamics.assemble(state, &mut residual, linearisation)?;
    } else {
        dynamics.unconstrained(state, &mut residual, linearisation)?;
    }
    Ok(matrix)
}

/// The unknowns that are free to move, by their index in the matrices of `derivative`: x and y of every node, without those of a
/// held head, and the arc φL of a hinge, in the place of x of node 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FreeUnknowns {
    /// The first free node: 1 if the head is held.
    pub first: usize,
    /// The number of nodes.
    pub nodes: usize,
    /// True if the head is on a hinge.
    pub hinged: bool,
    /// True if the hinge has no servo, so that the straight rod turns about it without a force.
    pub turns_freely: bool,
}

impl FreeUnknowns {
    /// The free unknowns of `model`.
    pub fn of(model: &Model) -> Self {
        Self {
            first: usize::from(model.head.is_some()),
            nodes: model.rod.nodes,
            hinged: model.hinge.is_some(),
            turns_freely: model.hinge.as_ref().is_some_and(|hinge| hinge.stiffness == 0.0),
        }
    }

    /// True if `unknown` is free.
    pub fn contains(&self, unknown: usize) -> bool {
        self.is_arc(unknown) || (2 * self.first..2 * self.nodes).contains(&unknown)
    }

    /// All free unknowns, in increasing order.
    pub fn all(&self) -> impl Iterator<Item = usize> + use<> {
        self.hinged.then_some(0).into_iter().chain(2 * self.first..2 * self.nodes)
    }

    /// The free unknowns along x (0) or y (1) of a rod that lies along x. Turning the head moves such a rod along y.
    pub fn along(&self, axis: usize) -> impl Iterator<Item = usize> + use<> {
        let free = *self;
        self.all().filter(move |i| free.axis(*i) == axis)
    }

    /// The axis along which an unknown moves such a rod.
    pub fn axis(&self, unknown: usize) -> usize {
        if self.is_arc(unknown) { 1 } else { unknown % 2 }
    }

    /// True if `unknown` is the arc of a hinge.
    pub fn is_arc(&self, unknown: usize) -> bool {
        self.hinged && unknown == 0
    }
}
