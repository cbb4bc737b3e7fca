//! The rod bent as a state says.

use nalgebra::Vector2;

use super::Dynamics;
use crate::fluid::Kinematics;
use crate::rod::bend::Joint;
use crate::rod::{Edge, elastic, node};
use crate::system::State;

/// A rod bent as `state` says, at the time and under the inputs that `dynamics` was moved to. It borrows both, so neither can
/// move on while it is looked at.
#[derive(Debug, Clone, Copy)]
pub struct DeformedRod<'a> {
    /// Model, inputs and what follows from the time.
    pub dynamics: &'a Dynamics,
    /// The state.
    pub state: &'a State,
}

impl<'a> DeformedRod<'a> {
    /// Its edges.
    pub fn edges(&self) -> &'a [Edge] {
        &self.dynamics.edges
    }

    /// Curvature κ_k, dimensionless, one entry per node, zero where there is no joint.
    pub fn kappa(&self) -> &'a [f64] {
        &self.dynamics.kappa
    }

    /// The joint at node `k`; zero where there is none.
    pub fn joint(&self, k: usize) -> Joint {
        let Dynamics { model, natural, kappa, .. } = self.dynamics;
        if model.rod.joints().contains(&k) {
            Joint::new(model.rod.joint[k], kappa[k], natural[k])
        } else {
            Joint::default()
        }
    }

    /// How it moves, and in which fluid.
    pub fn kinematics(&self) -> Kinematics<'a> {
        self.dynamics.moving(self.state)
    }

    /// The force (N) that its first edge carries.
    pub fn carried(&self) -> Vector2<f64> {
        match self.state.links.first() {
            Some(link) => link.force.into(),
            None => {
                let edge = &self.edges()[0];
                let tension = self.dynamics.model.rod.cells[0].tension(edge);
                elastic::force(edge, tension, &self.joint(0), &self.joint(1))
            }
        }
    }

    /// M a − F at node 0: the force (N) that a held head must exert.
    pub fn reaction(&self) -> Vector2<f64> {
        let model = &self.dynamics.model;
        let mut force = node(&self.state.a, 0) * model.rod.mass[0] - self.dynamics.load(0) - self.carried();
        model.forces.on_edges(&self.kinematics(), None, 0..1, |_, on| force += on.force(0));
        force
    }
}
