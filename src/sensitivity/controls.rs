//! Controls of a simulation over time, and the cotangents of an adjoint pass.

use super::parameter::{ActuationShape, Parameter, ParameterEffect};
use crate::model::Dynamics;
use crate::rod::Rod;

/// Natural curvature and forces at every time of a simulation, including the start, as samples of smooth functions of time:
/// accelerations are not reinitialised when they change. With implicit Euler this is equivalent to a host that sets them before
/// each step.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Controls {
    /// Natural curvature (1/m) added to that of the actuation: a row per time, one entry per joint. Its rate is unknown, and
    /// therefore missing in the power of the actuation but not in the work.
    pub natural: Option<Vec<f64>>,
    /// Forces on the nodes (N): a row per time, two entries per node.
    pub force: Option<Vec<f64>>,
}

impl Controls {
    /// Applies the controls of time `n`.
    pub(super) fn apply(&self, dynamics: &mut Dynamics, n: usize) {
        let (nodes, joints) = (dynamics.model.rod.nodes, dynamics.model.rod.joints());
        if let Some(natural) = &self.natural {
            let row = &natural[n * joints.len()..(n + 1) * joints.len()];
            dynamics.inputs.natural.get_or_insert_with(|| vec![0.0; nodes])[joints].copy_from_slice(row);
        }
        if let Some(force) = &self.force {
            let row = &force[2 * nodes * n..2 * nodes * (n + 1)];
            dynamics.inputs.force.get_or_insert_with(|| vec![0.0; 2 * nodes]).copy_from_slice(row);
        }
    }

    /// The effect of the natural curvature of each joint on the equations.
    pub(super) fn effects(rod: &Rod, shape: &ActuationShape) -> Vec<ParameterEffect> {
        rod.joints().map(|k| Parameter::NaturalCurvature(k).effect(rod, shape, &[])).collect()
    }
}

/// Weights w of Σ w y over all times of a simulation, in one row per time. An empty list is zero.
#[derive(Debug, Clone, Copy, Default)]
pub struct Weights<'a> {
    /// Weights of outputs.
    pub outputs: &'a [f64],
    /// Weights of positions, two entries per node.
    pub positions: &'a [f64],
    /// Weights of velocities, two entries per node.
    pub velocities: &'a [f64],
}

/// The derivatives of a weighted sum (cotangents).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cotangents {
    /// With respect to the parameters.
    pub parameters: Vec<f64>,
    /// With respect to initial positions and velocities, two entries per node.
    pub start: [Vec<f64>; 2],
    /// With respect to natural curvature, a row per time, one entry per joint.
    pub natural: Vec<f64>,
    /// With respect to forces, a row per time, two entries per node.
    pub force: Vec<f64>,
}
