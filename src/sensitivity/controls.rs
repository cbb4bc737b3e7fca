//! What acts on a simulation over time, and the derivatives by all that it can be differentiated by at once.

use super::parameter::{ActuationShape, Parameter, ParameterEffect};
use crate::model::Dynamics;
use crate::rod::Rod;

/// Natural curvature and forces at every time of a simulation, the start's first, as of functions of time that are known there:
/// accelerations are not found anew where they change. With implicit Euler this is a host that sets them before each step.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Controls {
    /// Natural curvature (1/m) beside the actuation's: a row per time, one entry per joint. Its rate is not known, so the power
    /// of the actuation lacks it; the work has it.
    pub natural: Option<Vec<f64>>,
    /// Forces on the nodes (N): a row per time, two entries per node.
    pub force: Option<Vec<f64>>,
}

impl Controls {
    /// Takes over those of time `n`.
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

    /// How the natural curvature of each joint moves the equations.
    pub(super) fn effects(rod: &Rod, shape: &ActuationShape) -> Vec<ParameterEffect> {
        rod.joints().map(|k| Parameter::NaturalCurvature(k).effect(rod, shape)).collect()
    }
}

/// Weights w of Σ w y over all times of a simulation, one row per time; an empty list is all zero.
#[derive(Debug, Clone, Copy, Default)]
pub struct Weights<'a> {
    /// Of outputs.
    pub outputs: &'a [f64],
    /// Of positions, two entries per node.
    pub positions: &'a [f64],
    /// Of velocities, two entries per node.
    pub velocities: &'a [f64],
}

/// The derivatives of a weighted sum.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cotangents {
    /// By the parameters.
    pub parameters: Vec<f64>,
    /// By first positions and velocities, two entries per node, where these are given.
    pub start: [Vec<f64>; 2],
    /// By natural curvature, a row per time, one entry per joint, whether it is given or none.
    pub natural: Vec<f64>,
    /// By forces, a row per time, two entries per node, likewise.
    pub force: Vec<f64>,
}
