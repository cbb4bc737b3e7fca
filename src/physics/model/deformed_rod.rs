//! The rod deformed as in a state.

use nalgebra::Vector2;

use super::Dynamics;
use crate::fluid::Kinematics;
use crate::rod::bend::Joint;
use crate::rod::damping::{EdgeRate, KelvinVoigt};
use crate::rod::{DampedRate, Edge, elastic, node};
use crate::system::State;

/// The rod deformed as in `state`, at the current time and inputs of `dynamics`. It borrows both, so neither can change
/// while it is used.
#[derive(Debug, Clone, Copy)]
pub struct DeformedRod<'a> {
    /// Model, inputs and time-dependent quantities.
    pub dynamics: &'a Dynamics,
    /// The state.
    pub state: &'a State,
}

impl<'a> DeformedRod<'a> {
    /// The edges.
    pub fn edges(&self) -> &'a [Edge] {
        &self.dynamics.edges
    }

    /// Curvature κ_k, dimensionless, one entry per node, zero where there is no joint.
    pub fn kappa(&self) -> &'a [f64] {
        &self.dynamics.kappa
    }

    /// The joint at node `k`; zero where there is none.
    pub fn joint(&self, k: usize) -> Joint {
        let Dynamics { model, natural, natural_rate, kappa, .. } = self.dynamics;
        if !model.rod.joints().contains(&k) {
            return Joint::default();
        }
        let joint = Joint::new(model.rod.joint[k], kappa[k], natural[k]);
        match self.dynamics.damped() {
            None => joint,
            Some(KelvinVoigt { damping, rates }) => {
                damping.damped(k, model.rod.joint[k], joint, kappa[k], rates.joints[k], natural_rate[k])
            }
        }
    }

    /// τ r of the joint at node `k`: the contribution of the damped rate to κ − κ̄ in its moment; zero if the material
    /// is elastic.
    pub fn resisted_curvature(&self, k: usize) -> f64 {
        self.dynamics.damped().map_or(0.0, |damped| damped.damping.bending[k] * damped.rates.joints[k])
    }

    /// Bτ, the derivative of the moment of the joint at node `k` with respect to −dκ̄/dt, N m s; zero unless only the
    /// rate of the elastic curvature is damped.
    pub fn resisted_natural_rate(&self, k: usize) -> f64 {
        let of =
            |damped: KelvinVoigt<'_>| (damped.damping.rate == DampedRate::Elastic).then(|| damped.damping.bending[k]);
        self.dynamics.damped().and_then(of).map_or(0.0, |time| self.dynamics.model.rod.joint[k] * time)
    }

    /// The rate Ω (rad/s) of the turning angle at the joint of node `k`.
    pub fn spin(&self, k: usize) -> f64 {
        let clamp_spin = self.dynamics.held.map_or(0.0, |[_, _, angle]| angle.rate);
        self.edge_rate(k).spin - if k == 0 { clamp_spin } else { self.edge_rate(k - 1).spin }
    }

    /// Rate of the length and angular velocity of edge `e`.
    pub fn edge_rate(&self, e: usize) -> EdgeRate {
        match &self.dynamics.rates {
            Some(rates) => rates.edges[e],
            None => EdgeRate::new(&self.edges()[e], node(&self.state.v, e + 1) - node(&self.state.v, e)),
        }
    }

    /// The active moment M_k (N m) of the joint at node `k`, and its rate, N m/s.
    pub fn active_moment(&self, k: usize) -> [f64; 2] {
        self.dynamics.active.as_ref().map_or([0.0; 2], |active| [active.moment[k], active.rate[k]])
    }

    /// The damping part (N m) of the moment conjugate to the curvature of joint `k`.
    pub fn damping_moment(&self, k: usize) -> f64 {
        let rod = &self.dynamics.model.rod;
        self.dynamics.damped().map_or(0.0, |damped| damped.moment_of_rate(rod, k))
    }

    /// The natural curvature of the joint at node `k`, without the effect of active moments.
    pub fn given(&self, k: usize) -> f64 {
        self.dynamics.active.as_ref().map_or(self.dynamics.natural[k], |active| active.natural[k])
    }

    /// Rate of the natural curvature of the joint at node `k`, 1/s.
    pub fn given_rate(&self, k: usize) -> f64 {
        self.dynamics.active.as_ref().map_or(self.dynamics.natural_rate[k], |active| active.natural_rate[k])
    }

    /// The elastic moment (N m) of the joint at node `k`, B(κ − κ̄), where κ̄ is the natural curvature without active
    /// moments.
    pub fn elastic_moment(&self, k: usize) -> f64 {
        self.dynamics.model.rod.joint[k] * (self.kappa()[k] - self.given(k))
    }

    /// The part (N m) of the moment against which the changing natural curvature does work, without the active moment.
    pub fn driven_moment(&self, k: usize) -> f64 {
        let elastic = self.elastic_moment(k);
        if self.resisted_natural_rate(k) == 0.0 { elastic } else { elastic + self.damping_moment(k) }
    }

    /// The tension (N) of edge `e`.
    pub fn tension(&self, e: usize) -> f64 {
        let rod = &self.dynamics.model.rod;
        let elastic = rod.cells[e].tension(&self.edges()[e]);
        self.dynamics.damped().map_or(elastic, |damped| elastic + damped.tension_of_rate(rod, e))
    }

    /// Kinematics of the rod, and its fluid.
    pub fn kinematics(&self) -> Kinematics<'a> {
        self.dynamics.moving(self.state)
    }

    /// The force (N) that the first edge carries.
    pub fn first_edge_force(&self) -> Vector2<f64> {
        match self.state.links.first() {
            Some(link) => link.force.into(),
            None => elastic::force(&self.edges()[0], self.tension(0), &self.joint(0), &self.joint(1)),
        }
    }

    /// M a − F at node 0: the force (N) that a held head must exert.
    pub fn reaction(&self) -> Vector2<f64> {
        let model = &self.dynamics.model;
        let mut force = node(&self.state.a, 0) * model.rod.mass[0] - self.dynamics.load(0) - self.first_edge_force();
        model.forces.on_edges(&self.kinematics(), None, 0..1, |_, on| force += on.force(0));
        force
    }
}
