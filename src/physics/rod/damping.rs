//! Kelvin–Voigt damping of a rod's material: each strain is resisted in proportion to its rate, with the time constant
//! τ = η/E.
//!
//! An edge carries the tension (EA/ℓ₀)(ℓ − ℓ₀ + τ ℓ̇), a joint the moment B(κ − κ̄ + τ r), conjugate to κ. The damped
//! rate r is κ̇ = s Ω, with s = dκ/dθ and Ω the difference of the angular velocities ω = (n·ė)/ℓ of the joint's edges.
//! With [`DampedRate::Elastic`] the rate of the natural curvature is subtracted. The dissipated power
//! (EA/ℓ₀) τ ℓ̇² + B τ r² is never negative.
//!
//! For a change δe of an edge vector with the factors c_q of positions and c_v of velocities, δω = w·δe with
//! w = ((c_v − c_q ℓ̇/ℓ) n − c_q ω t)/ℓ, and δℓ̇ = (c_v t + c_q ω n)·δe. These terms are in the same blocks as the
//! derivatives of elasticity.

use std::ops::Range;

use nalgebra::Vector2;
use serde::Deserialize;

use super::bend::{self, Joint};
use super::{Cell, Edge, EdgeValues, Profile, Rod};
use crate::linear::{Block, Direction, Real, pair};

/// The rate of curvature that the material resists.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum DampedRate {
    /// The rate of the total curvature: the passive material is parallel to the drive.
    #[default]
    Whole,
    /// The rate of the curvature relative to the natural one: the material itself grows or swells.
    Elastic,
}

/// The damping of a material along a rod.
#[derive(Debug, Clone, PartialEq)]
pub struct MaterialDamping {
    /// τ of stretching, s.
    pub stretching: Profile,
    /// τ of bending, s.
    pub bending: Profile,
    /// The rate of curvature that is resisted.
    pub rate: DampedRate,
}

impl MaterialDamping {
    /// The damping on a mesh of `nodes` nodes: evaluated at the middle of each edge and at the node of each joint.
    pub fn on_mesh(&self, nodes: usize) -> Damping {
        let edges = (nodes - 1) as f64;
        let middle = |e: usize| self.stretching.at((e as f64 + 0.5) / edges);
        Damping {
            stretching: (0..nodes - 1).map(middle).collect::<Vec<_>>().into(),
            bending: (0..nodes).map(|k| self.bending.at(k as f64 / edges)).collect(),
            rate: self.rate,
        }
    }
}

/// The damping of the material of a rod on a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Damping<T = f64> {
    /// τ of stretching, s, one value per edge.
    pub stretching: EdgeValues<T>,
    /// τ of bending, s, one entry per node.
    pub bending: Vec<T>,
    /// The rate of curvature that is resisted.
    pub rate: DampedRate,
}

/// Rate of the length and angular velocity of an edge.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct EdgeRate<T = f64> {
    /// Rate ℓ̇ of its length, m/s.
    pub stretching: T,
    /// Angular velocity ω, rad/s.
    pub spin: T,
}

impl<T: Real> EdgeRate<T> {
    /// The rates of an `edge` whose vector changes by `rate` (m/s).
    #[inline(always)]
    pub fn new(edge: &Edge<T>, rate: Vector2<T>) -> Self {
        let along = |direction: Vector2<T>| direction.x * rate.x + direction.y * rate.y;
        Self { stretching: along(edge.t), spin: along(edge.n()) * edge.per_length }
    }

    /// w: the derivative of ω with respect to the vector of `edge`, along `direction`.
    #[inline(always)]
    pub fn spin_slope(&self, edge: &Edge<T>, direction: Direction) -> Vector2<T> {
        let (c_q, c_v) = (edge.length.like(direction.q), edge.length.like(direction.v));
        let (along, across) = (c_q * self.spin, c_v - c_q * self.stretching * edge.per_length);
        let (t, n) = (edge.t, edge.n());
        Vector2::new((n.x * across - t.x * along) * edge.per_length, (n.y * across - t.y * along) * edge.per_length)
    }

    /// The derivative of ℓ̇ with respect to the vector of `edge`, along `direction`.
    #[inline(always)]
    pub fn stretching_slope(&self, edge: &Edge<T>, direction: Direction) -> Vector2<T> {
        let (c_q, c_v) = (edge.length.like(direction.q), edge.length.like(direction.v));
        let (t, n, across) = (edge.t, edge.n(), c_q * self.spin);
        Vector2::new(t.x * c_v + n.x * across, t.y * c_v + n.y * across)
    }
}

/// Strain rates of a rod at one time, and the viscosity of its joints.
#[derive(Debug, Clone)]
pub struct StrainRates<T = f64> {
    /// One entry per edge.
    pub edges: Vec<EdgeRate<T>>,
    /// Angular velocity (rad/s) of the clamp of the first edge; zero without a clamp.
    pub clamp_spin: T,
    /// The damped rate r (1/s) of each joint, one entry per node; zero where there is no joint.
    pub joints: Vec<T>,
    /// The derivative of a joint's couple with respect to Ω, B τ s² (N m s), one entry per node.
    pub viscosity: Vec<T>,
}

impl<T: Real> StrainRates<T> {
    /// Zero rates of a rod of `nodes` nodes; `zero` selects the number type.
    pub fn zeros(nodes: usize, zero: T) -> Self {
        Self {
            edges: vec![EdgeRate { stretching: zero, spin: zero }; nodes - 1],
            clamp_spin: zero,
            joints: vec![zero; nodes],
            viscosity: vec![zero; nodes],
        }
    }

    /// Computes the rates of `edges` from velocities `v` (m/s).
    #[inline(always)]
    pub fn read_edges(&mut self, edges: &[Edge<T>], v: &[[T; 2]]) {
        for ((rate, edge), ends) in self.edges.iter_mut().zip(edges).zip(v.windows(2)) {
            let [from, to] = [ends[0], ends[1]];
            *rate = EdgeRate::new(edge, Vector2::new(to[0] - from[0], to[1] - from[1]));
        }
    }

    /// The rate Ω (rad/s) of the turning angle at the joint of node `k`.
    #[inline(always)]
    pub fn turning(&self, k: usize) -> T {
        self.edges[k].spin - if k == 0 { self.clamp_spin } else { self.edges[k - 1].spin }
    }

    /// Computes the rates and viscosities of the `joints` of a rod from the rates of its edges and its clamp. The rod
    /// has the bending `stiffness` (N m), the curvatures `kappa`, and natural curvatures that change at `natural_rate`
    /// (1/s).
    #[inline(always)]
    pub fn read_joints(
        &mut self,
        joints: Range<usize>,
        stiffness: &[T],
        damping: &Damping<T>,
        kappa: &[T],
        natural_rate: &[T],
    ) {
        for k in joints {
            let s = bend::curvature_per_turning(kappa[k]);
            self.joints[k] = s * self.turning(k) - damping.given(natural_rate[k]);
            self.viscosity[k] = stiffness[k] * damping.bending[k] * s * s;
        }
    }
}

impl<T: Real> Damping<T> {
    /// The part of the rate of curvature that is not damped, if the natural curvature changes at `natural_rate` (1/s).
    #[inline(always)]
    pub fn given(&self, natural_rate: T) -> T {
        if self.rate == DampedRate::Elastic { natural_rate } else { natural_rate.like(0.0) }
    }

    /// `joint` at node `k`, of bending `stiffness` (N m) and curvature `kappa`, with the damping at the damped `rate`
    /// (1/s) added. Its stiffness is the derivative with respect to the turning angle at constant Ω.
    #[inline(always)]
    pub fn damped(&self, k: usize, stiffness: T, joint: Joint<T>, kappa: T, rate: T, natural_rate: T) -> Joint<T> {
        let (s, viscosity) = (bend::curvature_per_turning(kappa), stiffness * self.bending[k]);
        let given = self.given(natural_rate);
        // d/dθ of B τ s (s Ω − κ̄') with ds/dθ = κ s/2.
        let slope = viscosity * kappa.like(0.5) * kappa * s * (kappa.like(2.0) * rate + given);
        Joint { couple: joint.couple + viscosity * s * rate, stiffness: joint.stiffness + slope }
    }

    /// Adds the damping at these `rates` to the `joints` at `nodes` of a rod of bending `stiffness` (N m).
    #[inline(always)]
    pub fn resist(
        &self,
        nodes: Range<usize>,
        stiffness: &[T],
        rates: &StrainRates<T>,
        [kappa, natural_rate]: [&[T]; 2],
        joints: &mut [Joint<T>],
    ) {
        for k in nodes {
            joints[k] = self.damped(k, stiffness[k], joints[k], kappa[k], rates.joints[k], natural_rate[k]);
        }
    }
}

impl Damping {
    /// τ of bending (s) if it is the same for all joints of `rod`.
    pub fn uniform(&self, rod: &Rod) -> Option<f64> {
        let [least, most] = self.range(rod);
        (most - least <= 1e-9 * most).then_some(most)
    }

    /// Minimum and maximum of τ of bending (s) over the joints of `rod`.
    pub fn range(&self, rod: &Rod) -> [f64; 2] {
        let times = || rod.joints().map(|k| self.bending[k]);
        [times().fold(f64::INFINITY, f64::min), times().fold(0.0, f64::max)]
    }

    /// The damping behind a neck, which is damped like the first edge.
    pub(super) fn behind_neck(mut self) -> Self {
        let edges = std::iter::once(self.stretching[0]).chain(self.stretching.iter().copied());
        self.stretching = edges.collect::<Vec<_>>().into();
        self.bending.insert(0, 0.0);
        self
    }

    /// The curvature of joint `k` and its rate (1/s) if the joint follows `natural` without a moment: κ + τκ̇ = κ̄, or
    /// κ = κ̄ if the rate of the natural curvature is not damped. `natural` is a natural curvature with its rate,
    /// oscillating at `omega` (rad/s). The result is linear in `natural`.
    pub fn free_of_moment(&self, k: usize, omega: f64, natural: [f64; 2]) -> [f64; 2] {
        if self.rate == DampedRate::Elastic {
            return natural;
        }
        let ([curvature, rate], time) = (natural, self.bending[k]);
        let share = 1.0 / (1.0 + (omega * time).powi(2));
        [share * (curvature - time * rate), share * (rate + time * omega * omega * curvature)]
    }

    /// The first-order change of [`Damping::free_of_moment`] when `omega` changes by `by`.
    pub fn free_of_moment_by(&self, k: usize, omega: f64, by: f64, natural: [f64; 2]) -> [f64; 2] {
        if self.rate == DampedRate::Elastic {
            return [0.0; 2];
        }
        let time = self.bending[k];
        let slope = 2.0 * omega * time * by / (1.0 + (omega * time).powi(2));
        let [curvature, rate] = self.free_of_moment(k, omega, natural);
        [-slope * time * curvature, slope * (natural[0] - time * rate)]
    }

    /// The damping part (N m) of the moment conjugate to the curvature of joint `k` of `rod`, at the damped `rate`
    /// (1/s).
    #[inline(always)]
    pub fn moment(&self, rod: &Rod, k: usize, rate: f64) -> f64 {
        rod.joint[k] * self.bending[k] * rate
    }

    /// The damping part (N) of the tension of edge `e` of `rod`, whose length changes at the rate `stretching` (m/s).
    #[inline(always)]
    pub fn tension(&self, rod: &Rod, e: usize, stretching: f64) -> f64 {
        rod.cells[e].axial * self.stretching[e] * stretching
    }

    /// The power (W) that the material of `rod` dissipates at these strain `rates`.
    pub fn power(&self, rod: &Rod, rates: &StrainRates) -> f64 {
        let stretching = |(e, rate): (usize, &EdgeRate)| self.tension(rod, e, rate.stretching) * rate.stretching;
        let bending = |k: usize| self.moment(rod, k, rates.joints[k]) * rates.joints[k];
        rates.edges.iter().enumerate().map(stretching).sum::<f64>() + rod.joints().map(bending).sum::<f64>()
    }
}

/// The damping of the material in the assembly of a rod, see
/// [`Deformed::assemble_with`](super::elastic::Deformed::assemble_with).
pub trait MaterialLaw<T: Real>: Copy {
    /// The tension (N) of edge `e` with damping, given its elastic `tension` (N).
    fn tension(self, e: usize, cell: &Cell<T>, tension: T) -> T;

    /// `block`, minus the derivative of the force of edge `e` with respect to its own vector along `direction`, with
    /// the damping added.
    fn own(self, e: usize, edge: &Edge<T>, cell: &Cell<T>, block: Block<T>, direction: Direction) -> Block<T>;

    /// Minus the derivatives of the force of the edge before joint `k` with respect to the edge after it, elastic part
    /// `q`, and of the force of the edge after it with respect to the edge before it. Without damping the second is the
    /// transpose of `q`.
    fn couplings(self, k: usize, edges: [&Edge<T>; 2], q: Block<T>, direction: Direction) -> [Block<T>; 2];
}

/// An elastic material.
#[derive(Debug, Clone, Copy)]
pub struct Elastic;

impl<T: Real> MaterialLaw<T> for Elastic {
    #[inline(always)]
    fn tension(self, _: usize, _: &Cell<T>, tension: T) -> T {
        tension
    }

    #[inline(always)]
    fn own(self, _: usize, _: &Edge<T>, _: &Cell<T>, block: Block<T>, _: Direction) -> Block<T> {
        block
    }

    #[inline(always)]
    fn couplings(self, _: usize, _: [&Edge<T>; 2], q: Block<T>, _: Direction) -> [Block<T>; 2] {
        [q, q.transpose()]
    }
}

/// A Kelvin–Voigt material at some strain rates.
#[derive(Debug, Clone, Copy)]
pub struct KelvinVoigt<'a, T = f64> {
    /// Its damping.
    pub damping: &'a Damping<T>,
    /// The rates.
    pub rates: &'a StrainRates<T>,
}

impl<'a, T> KelvinVoigt<'a, T> {
    /// The material with this `damping` at these `rates`, if both are given.
    #[inline(always)]
    pub fn of(damping: Option<&'a Damping<T>>, rates: Option<&'a StrainRates<T>>) -> Option<Self> {
        Some(Self { damping: damping?, rates: rates? })
    }
}

impl KelvinVoigt<'_> {
    /// The damping part (N) of the tension of edge `e` of `rod`.
    pub fn tension_of_rate(self, rod: &Rod, e: usize) -> f64 {
        self.damping.tension(rod, e, self.rates.edges[e].stretching)
    }

    /// The damping part (N m) of the moment conjugate to the curvature of joint `k` of `rod`.
    pub fn moment_of_rate(self, rod: &Rod, k: usize) -> f64 {
        self.damping.moment(rod, k, self.rates.joints[k])
    }
}

impl<T: Real> MaterialLaw<T> for KelvinVoigt<'_, T> {
    #[inline(always)]
    fn tension(self, e: usize, cell: &Cell<T>, tension: T) -> T {
        tension + cell.axial * self.damping.stretching[e] * self.rates.edges[e].stretching
    }

    #[inline(always)]
    fn own(self, e: usize, edge: &Edge<T>, cell: &Cell<T>, block: Block<T>, direction: Direction) -> Block<T> {
        let (rate, viscosity) = (&self.rates.edges[e], &self.rates.viscosity);
        let along = pair(rate.stretching_slope(edge, direction)) * (cell.axial * self.damping.stretching[e]);
        let across = pair(rate.spin_slope(edge, direction)) * ((viscosity[e] + viscosity[e + 1]) * edge.per_length);
        block - (Block::outer(edge.t, along) + Block::outer(edge.n(), across))
    }

    #[inline(always)]
    fn couplings(self, k: usize, [before, after]: [&Edge<T>; 2], q: Block<T>, direction: Direction) -> [Block<T>; 2] {
        let slope = |e: usize, edge: &Edge<T>, by: &Edge<T>| {
            let slope = self.rates.edges[e].spin_slope(edge, direction);
            pair(slope) * (self.rates.viscosity[k] * by.per_length)
        };
        let by_after = Block::outer(before.n(), slope(k, after, before));
        let by_before = Block::outer(after.n(), slope(k - 1, before, after));
        [q + by_after, q.transpose() + by_before]
    }
}
