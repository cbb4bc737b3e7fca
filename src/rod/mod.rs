//! The discrete elastic rod: section, mesh, elastic elements and mass; no time, no fluid.
//!
//! Both energies depend on the nodes through edge vectors only, so the elements give derivatives with respect to edges.

pub mod bend;
pub mod elastic;
pub mod mass;
pub mod section;
pub mod stretch;

use nalgebra::{Matrix2, Vector2};

pub use mass::MassLumping;
pub use section::Section;

/// An edge vector as unit tangent and length (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// Unit tangent.
    pub t: Vector2<f64>,
    /// Length ℓ, m.
    pub length: f64,
    /// 1/ℓ, 1/m.
    pub per_length: f64,
}

impl Edge {
    /// The edge along `vector`; its tangent is not finite where the vector is zero.
    #[inline]
    pub fn new(vector: Vector2<f64>) -> Self {
        let length = vector.norm();
        let per_length = 1.0 / length;
        Self { t: vector * per_length, length, per_length }
    }

    /// The edge along the unit tangent `t`, of `length` (m).
    #[inline]
    pub fn along(t: Vector2<f64>, length: f64) -> Self {
        Self { t, length, per_length: 1.0 / length }
    }

    /// Unit normal, the tangent turned by +90°.
    #[inline]
    pub fn n(&self) -> Vector2<f64> {
        Vector2::new(-self.t.y, self.t.x)
    }
}

/// What opposes the motion of half an edge, lumped to its node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfEdge {
    /// The force, N.
    pub force: Vector2<f64>,
    /// ∂(force)/∂v, v the velocity of the node, N s/m.
    pub by_velocity: Matrix2<f64>,
    /// ∂(force)/∂φ, φ the direction of the edge, N.
    pub by_direction: Vector2<f64>,
}

/// Node `k` of a flat array of two entries a node.
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

/// The relative bending stiffness EI(ξ)/EI along the rod, ξ = s/L.
#[derive(Debug, Clone, PartialEq)]
pub enum Stiffness {
    /// 1 + a(1 − ξ).
    Gradient(f64),
    /// Points (ξ, factor) with rising ξ; linear in between, constant outside.
    Profile(Vec<[f64; 2]>),
}

impl Stiffness {
    /// The factor at `xi`.
    pub fn factor(&self, xi: f64) -> f64 {
        match self {
            Self::Gradient(a) => 1.0 + a * (1.0 - xi),
            Self::Profile(points) => interpolated(points, xi).unwrap_or(1.0),
        }
    }
}

/// The value at `xi` of points (ξ, value) with rising ξ: linear in between, constant outside; none without points.
pub(crate) fn interpolated(points: &[[f64; 2]], xi: f64) -> Option<f64> {
    let after = points.partition_point(|p| p[0] <= xi);
    match (points.get(after.wrapping_sub(1)), points.get(after)) {
        (Some(&[x0, f0]), Some(&[x1, f1])) => Some(f0 + (f1 - f0) * (xi - x0) / (x1 - x0)),
        (Some(p), None) | (None, Some(p)) => Some(p[1]),
        (None, None) => None,
    }
}

/// A straight rod of N nodes at equal spacing, ready for assembly.
#[derive(Debug, Clone, PartialEq)]
pub struct Rod {
    /// Number of nodes N ≥ 3.
    pub nodes: usize,
    /// Length L, m.
    pub length: f64,
    /// Node spacing at rest ΔL = L/(N−1), m.
    pub spacing: f64,
    /// Cross-section.
    pub section: Section,
    /// Stretching stiffness EA = Y A, N.
    pub ea: f64,
    /// Bending stiffness EI = Y I before the profile, N m².
    pub ei: f64,
    /// First node with a joint: 1, or 0 where the head is held and a half-cell joint acts on the first edge.
    pub first_joint: usize,
    /// Stiffness B (N m) of the energy ½B(κ−κ̄)² of the joint at each node: EI_k/ΔL inside, 2EI₀/ΔL for the half-cell
    /// joint of a held head, zero where there is no joint.
    pub joint: Vec<f64>,
    /// Mass of each node, kg.
    pub mass: Vec<f64>,
    total_mass: f64,
}

/// What a rod is made from.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Cross-section.
    pub section: Section,
    /// Young's modulus Y, Pa.
    pub youngs: f64,
    /// Density ρ, kg/m³.
    pub density: f64,
    /// Bending stiffness along the rod.
    pub stiffness: Stiffness,
}

impl Rod {
    /// The straight rod of `nodes` nodes and `length` metres; a held head adds a half-cell joint at node 0.
    pub fn new(nodes: usize, length: f64, material: &Material, lumping: MassLumping, held_head: bool) -> Self {
        let Material { section, youngs, density, stiffness } = material;
        let spacing = length / (nodes - 1) as f64;
        let (ea, ei) = (youngs * section.area(), youngs * section.inertia());
        let mut joint = vec![0.0; nodes];
        for (k, b) in joint.iter_mut().enumerate().take(nodes - 1).skip(1) {
            *b = ei * stiffness.factor(k as f64 / (nodes - 1) as f64) / spacing;
        }
        if held_head {
            joint[0] = 2.0 * ei * stiffness.factor(0.0) / spacing;
        }
        let mass = lumping.masses(nodes, density * section.area() * spacing);
        Self {
            nodes,
            length,
            spacing,
            section: *section,
            ea,
            ei,
            first_joint: usize::from(!held_head),
            joint,
            total_mass: mass.iter().sum(),
            mass,
        }
    }

    /// The nodes that carry a joint.
    pub fn joints(&self) -> std::ops::Range<usize> {
        self.first_joint..self.nodes - 1
    }

    /// Arc length of node `k`, m.
    pub fn arc_length(&self, k: usize) -> f64 {
        k as f64 * self.spacing
    }

    /// Total mass, kg.
    pub fn total_mass(&self) -> f64 {
        self.total_mass
    }

    /// Mass-weighted mean of a flat array of two entries a node.
    pub fn mean(&self, values: &[f64]) -> Vector2<f64> {
        let sum: Vector2<f64> = self.mass.iter().enumerate().map(|(k, m)| node(values, k) * *m).sum();
        sum / self.total_mass
    }
}
