//! The discrete elastic rod: section, mesh, elastic elements and mass; no time, no fluid.
//!
//! Both energies depend on the nodes only through edge vectors, so the elements return derivatives with respect to
//! edges.

pub mod bend;
pub mod damping;
pub mod edge_force;
mod edge_values;
pub mod elastic;
pub(crate) mod energies;
pub(crate) mod lengths;
pub mod section;
pub mod spheroid;
pub mod stretch;

use nalgebra::Vector2;
use serde::Deserialize;

use crate::linear::{Pair, Real};

pub use damping::{DampedRate, Damping, MaterialDamping};
pub use edge_values::EdgeValues;
pub use section::{HalfEdge, Measured, Profile, Section, Sections, Shape};
pub use spheroid::Spheroid;
pub use stretch::Cell;

/// An edge vector as unit tangent and length (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge<T = f64> {
    /// Unit tangent.
    pub t: Vector2<T>,
    /// Length ℓ, m.
    pub length: T,
    /// 1/ℓ, 1/m.
    pub per_length: T,
}

impl Edge {
    /// The edge along the unit tangent `t`, of `length` (m).
    #[inline]
    pub fn along(t: Vector2<f64>, length: f64) -> Self {
        Self { t, length, per_length: 1.0 / length }
    }
}

impl<T: Real> Edge<T> {
    /// The edge along `vector`; its tangent is not finite if the vector is zero.
    #[inline(always)]
    pub fn new(vector: Vector2<T>) -> Self {
        let length = (vector.x * vector.x + vector.y * vector.y).sqrt();
        let per_length = length.like(1.0) / length;
        Self { t: Vector2::new(vector.x * per_length, vector.y * per_length), length, per_length }
    }

    /// Unit normal, the tangent turned by +90°.
    #[inline(always)]
    pub fn n(&self) -> Vector2<T> {
        Vector2::new(-self.t.y, self.t.x)
    }

    /// The components along and across the edge of a vector at each of its ends, as pairs over both ends.
    #[inline(always)]
    pub(crate) fn components(&self, ends: [T::Pair; 2]) -> [T::Pair; 2] {
        let [x, y] = T::Pair::transpose(ends);
        [x * self.t.x + y * self.t.y, y * self.t.x - x * self.t.y]
    }

    /// The vectors at both ends whose components are `along` and `across`.
    #[inline(always)]
    pub(crate) fn vectors(&self, along: T::Pair, across: T::Pair) -> [T::Pair; 2] {
        T::Pair::transpose([along * self.t.x - across * self.t.y, along * self.t.y + across * self.t.x])
    }
}

/// Node `k` of a flat array of two entries per node.
#[inline]
pub fn node(values: &[f64], k: usize) -> Vector2<f64> {
    Vector2::new(values[2 * k], values[2 * k + 1])
}

/// Adds `vector` to node `k` of a flat array.
#[inline]
pub fn add(values: &mut [f64], k: usize, vector: Vector2<f64>) {
    values[2 * k] += vector.x;
    values[2 * k + 1] += vector.y;
}

/// How the mass of edges is lumped at nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum MassLumping {
    /// ρAΔL at every node, as in the source study; total mass ρAL·N/(N−1), mesh error of first order.
    Uniform,
    /// The mass of each half edge at its own node; total mass ∫ρA ds, mesh error of second order.
    #[default]
    Tributary,
}

/// The relative bending stiffness along the rod, a factor on Young's modulus times the section's moment of area.
#[derive(Debug, Clone, PartialEq)]
pub enum Stiffness {
    /// 1 + a(1 − ξ).
    Gradient(f64),
    /// Any profile.
    Profile(Profile),
}

impl Stiffness {
    /// The factor at `xi`.
    pub fn factor(&self, xi: f64) -> f64 {
        match self {
            Self::Gradient(a) => 1.0 + a * (1.0 - xi),
            Self::Profile(profile) => profile.at(xi),
        }
    }
}

/// A straight rod of N nodes at equal spacing, or of N − 1 behind a body, ready for assembly.
#[derive(Debug, Clone, PartialEq)]
pub struct Rod {
    /// Number of nodes N ≥ 3, including the centre of a body.
    pub nodes: usize,
    /// Length L, m.
    pub length: f64,
    /// Node spacing at rest ΔL, m: L/(N−1), or L/(N−2) behind a body.
    pub spacing: f64,
    /// Cross-sections along the rod.
    pub sections: Sections,
    /// Largest stretching stiffness EA = Y A of an edge, N.
    pub ea: f64,
    /// Largest bending stiffness EI = Y I at a node, before the factor along the rod, N m².
    pub ei: f64,
    /// Young's modulus Y, Pa.
    pub youngs: f64,
    /// Rest length and axial stiffness of each edge.
    pub cells: EdgeValues<Cell>,
    /// First node of the rod: 0, or 1 if node 0 is the centre of a body and the first edge is the neck between them.
    pub front: usize,
    /// The body whose centre is node 0.
    pub body: Option<Spheroid>,
    /// First node with a joint: 1, or 0 if the head is held and a half-cell joint acts on the first edge.
    pub first_joint: usize,
    /// Stiffness B (N m) of the energy ½B(κ−κ̄)² of the joint at each node: EI_k/ΔL inside, 2EI₀/ΔL for the half-cell
    /// joint between a held head, or a body, and the rod, zero where there is no joint.
    pub joint: Vec<f64>,
    /// Damping of the material; `None` if it is elastic.
    pub damping: Option<Damping>,
    /// Mass of each node, kg.
    pub mass: Vec<f64>,
    total_mass: f64,
    /// EI at the front end, N m².
    front_stiffness: f64,
}

/// Sections and material from which a rod is built.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Cross-sections and density along the rod.
    pub sections: Sections,
    /// Young's modulus Y, Pa.
    pub youngs: f64,
    /// Factor on the bending stiffness along the rod.
    pub stiffness: Stiffness,
    /// Damping; `None` if the material is elastic.
    pub damping: Option<MaterialDamping>,
}

impl Rod {
    /// The straight rod of `nodes` nodes and `length` metres; a held head adds a half-cell joint at node 0.
    pub fn new(nodes: usize, length: f64, material: &Material, lumping: MassLumping, held_head: bool) -> Self {
        let Material { sections, youngs, stiffness, .. } = material;
        let edges = nodes - 1;
        let spacing = length / edges as f64;
        let xi = |k: usize| k as f64 / edges as f64;
        let ei = |k: usize| sections.bending_stiffness(*youngs, xi(k));
        let ea: Vec<f64> = (0..edges).map(|e| sections.axial_stiffness(*youngs, xi(e), xi(e + 1))).collect();
        let mut joint = vec![0.0; nodes];
        for (k, b) in joint.iter_mut().enumerate().take(edges).skip(1) {
            *b = ei(k) * stiffness.factor(xi(k)) / spacing;
        }
        if held_head {
            joint[0] = 2.0 * ei(0) * stiffness.factor(0.0) / spacing;
        }
        let mass: Vec<f64> = match lumping {
            MassLumping::Uniform => (0..nodes).map(|k| sections.line_density(xi(k)) * spacing).collect(),
            MassLumping::Tributary => {
                let half = |from: f64, to: f64| 0.5 * spacing * sections.mean(from, to, |xi| sections.line_density(xi));
                let middle = |e: usize| (e as f64 + 0.5) / edges as f64;
                let before = |k: usize| if k > 0 { half(middle(k - 1), xi(k)) } else { 0.0 };
                let after = |k: usize| if k < edges { half(xi(k), middle(k)) } else { 0.0 };
                (0..nodes).map(|k| before(k) + after(k)).collect()
            }
        };
        let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
        Self {
            nodes,
            length,
            spacing,
            sections: sections.clone(),
            youngs: *youngs,
            ea: largest(&mut ea.iter().copied()),
            ei: largest(&mut (0..nodes).map(ei)),
            cells: ea.iter().map(|ea| Cell { rest: spacing, axial: ea / spacing }).collect::<Vec<_>>().into(),
            front: 0,
            body: None,
            first_joint: usize::from(!held_head),
            joint,
            damping: material.damping.as_ref().map(|damping| damping.on_mesh(nodes)),
            total_mass: mass.iter().sum(),
            front_stiffness: ei(0) * stiffness.factor(0.0),
            mass,
        }
    }

    /// The same rod behind a rigid `body` of `mass` (kg), whose centre is a new node 0. A straight neck joins it to the
    /// rod, with the length of the body's semi-axis and the EA of the rod's first edge. The rod starts with a half-cell
    /// joint there, as at a held head: second order in the mesh.
    #[must_use]
    pub fn behind_body(mut self, mass: f64, body: Spheroid) -> Self {
        let neck = body.along;
        let axial = self.cells[0].axial * self.spacing / neck;
        let cells = std::iter::once(Cell { rest: neck, axial }).chain(self.cells.iter().copied());
        self.cells = cells.collect::<Vec<_>>().into();
        self.joint[0] = 2.0 * self.front_stiffness / self.spacing;
        self.joint.insert(0, 0.0);
        self.damping = self.damping.map(Damping::behind_neck);
        self.mass.insert(0, mass);
        self.total_mass += mass;
        (self.nodes, self.front, self.first_joint) = (self.nodes + 1, 1, 1);
        self.body = Some(body);
        self
    }

    /// Time scale of bending L²√(ρA/EI), s.
    pub fn bending_time(&self) -> f64 {
        self.length * self.length * (self.total_mass() / (self.length * self.ei)).sqrt()
    }

    /// The shortest edge at rest, m.
    pub fn shortest(&self) -> f64 {
        self.cells[0].rest.min(self.spacing)
    }

    /// EA L²/EI, the square of the slenderness ratio, with the smallest EI of a joint.
    pub fn slenderness_squared(&self) -> f64 {
        let least = self.joints().map(|k| self.joint_stiffness(k)).fold(self.ei, f64::min);
        self.ea * self.length * self.length / least
    }

    /// The nodes that carry a joint.
    pub fn joints(&self) -> std::ops::Range<usize> {
        self.first_joint..self.nodes - 1
    }

    /// The fraction of a cell that the joint at node `k` represents. The half-cell joint at the front of the rod is
    /// twice as stiff as a full joint and takes half of its natural curvature.
    pub fn joint_part(&self, k: usize) -> f64 {
        if k == self.front { 0.5 } else { 1.0 }
    }

    /// Converts the `values` of whole cells, one entry per node, to those of the joints: zero where there is no joint,
    /// half at a half-cell joint.
    pub fn at_joints(&self, values: &mut [f64]) {
        values[..self.first_joint].fill(0.0);
        values[self.nodes - 1] = 0.0;
        if self.first_joint == self.front {
            values[self.front] *= 0.5;
        }
    }

    /// Bending stiffness EI_k at the joint of node `k`, N m².
    pub fn joint_stiffness(&self, k: usize) -> f64 {
        self.joint[k] * self.spacing * self.joint_part(k)
    }

    /// Bending stiffness EI of the section at node `k`, before the factor along the rod, N m².
    pub fn section_stiffness(&self, k: usize) -> f64 {
        self.sections.bending_stiffness(self.youngs, self.xi(k))
    }

    /// Arc length of node `k` from the front of the rod, m; negative for the centre of a body.
    pub fn arc_length(&self, k: usize) -> f64 {
        if k < self.front { -self.cells[0].rest } else { (k - self.front) as f64 * self.spacing }
    }

    /// Arc length of node `k` over the length; 0 for the centre of a body.
    pub fn xi(&self, k: usize) -> f64 {
        k.saturating_sub(self.front) as f64 / (self.nodes - self.front - 1) as f64
    }

    /// Both halves of every edge. Those of a neck have no length, because no force acts on it.
    pub fn halves(&self) -> impl Iterator<Item = [HalfEdge; 2]> {
        let half = 0.5 * self.spacing;
        let first = self.sections.half(0.0, half, self.length);
        let neck = HalfEdge { length: 0.0, middle: 0.0, ..first };
        let even = self.sections.is_even();
        let of = move |start: f64| match even {
            true => HalfEdge { middle: start + 0.5 * half, ..first },
            false => self.sections.half(start, half, self.length),
        };
        let along = (self.front..self.nodes - 1).map(move |e| self.arc_length(e)).map(move |s| [of(s), of(s + half)]);
        (0..self.front).map(move |_| [neck; 2]).chain(along)
    }

    /// Volume of the displaced fluid, including that of a body, m³.
    pub fn displaced_volume(&self) -> f64 {
        let rod: f64 = self.halves().flatten().map(|half| half.displaced * half.length).sum();
        rod + self.body.as_ref().map_or(0.0, Spheroid::volume)
    }

    /// Total mass, including that of a body, kg.
    pub fn total_mass(&self) -> f64 {
        self.total_mass
    }

    /// Moment of inertia of the straight rod about its head, kg m².
    pub fn inertia_about_head(&self) -> f64 {
        (0..self.nodes).map(|k| self.mass[k] * self.arc_length(k).powi(2)).sum()
    }

    /// Mass-weighted mean of a flat array of two entries per node.
    pub fn mean(&self, values: &[f64]) -> Vector2<f64> {
        let sum: Vector2<f64> = self.mass.iter().enumerate().map(|(k, m)| node(values, k) * *m).sum();
        sum / self.total_mass
    }
}
