//! The cross-section, and how it changes along the rod.

use std::f64::consts::PI;

/// An annulus with outer and inner radius in metres; a disc where the inner radius is zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// Outer radius R_o, m.
    pub outer: f64,
    /// Inner radius R_i, m; zero for a solid rod.
    pub inner: f64,
}

impl Section {
    /// A = π(R_o² − R_i²), m².
    pub fn area(&self) -> f64 {
        PI * (self.outer.powi(2) - self.inner.powi(2))
    }

    /// I = π/4 (R_o⁴ − R_i⁴), m⁴.
    pub fn inertia(&self) -> f64 {
        PI / 4.0 * (self.outer.powi(4) - self.inner.powi(4))
    }

    /// Radius √(A/π) of the disc of equal area, m.
    pub fn equivalent_radius(&self) -> f64 {
        (self.area() / PI).sqrt()
    }
}

/// A quantity along the rod: points (ξ, value) with rising ξ = s/L, linear in between, constant outside.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile(Vec<[f64; 2]>);

impl From<f64> for Profile {
    /// The same value everywhere.
    fn from(value: f64) -> Self {
        Self(vec![[0.0, value]])
    }
}

impl Profile {
    /// The profile through points (ξ, value) with rising ξ; `None` without points.
    pub fn through(points: Vec<[f64; 2]>) -> Option<Self> {
        if points.is_empty() { None } else { Some(Self(points)) }
    }

    /// The value at `xi`.
    pub fn at(&self, xi: f64) -> f64 {
        let Self(points) = self;
        let after = points.partition_point(|p| p[0] <= xi);
        match (points.get(after.wrapping_sub(1)), points.get(after)) {
            (Some(&[x0, f0]), Some(&[x1, f1])) => f0 + (f1 - f0) * (xi - x0) / (x1 - x0),
            (Some(p), None) | (None, Some(p)) => p[1],
            (None, None) => 0.0, // there is a point
        }
    }

    /// Where its points are, ξ.
    pub fn places(&self) -> impl Iterator<Item = f64> {
        self.0.iter().map(|p| p[0])
    }

    /// True where the value is the same everywhere.
    pub fn is_even(&self) -> bool {
        self.0.iter().all(|p| p[1] == self.0[0][1])
    }

    /// The largest value.
    pub fn largest(&self) -> f64 {
        self.0.iter().fold(f64::NEG_INFINITY, |max, p| max.max(p[1]))
    }
}

/// What a rod is like across, along its length.
#[derive(Debug, Clone, PartialEq)]
pub struct Sections {
    /// Outer radius R_o, m: half the breadth in the plane of motion.
    pub outer: Profile,
    /// Inner radius R_i, m.
    pub inner: Profile,
    /// Depth D across the plane of motion, m; twice the outer radius where it is not given.
    pub depth: Option<Profile>,
    /// Density, kg/m³.
    pub density: Profile,
    /// Factor on the mass.
    pub mass_factor: Profile,
}

/// Means over half of an edge, for the forces that act on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Half {
    /// Its length, m.
    pub length: f64,
    /// Arc length at its middle, m.
    pub middle: f64,
    /// Outer radius, m.
    pub radius: f64,
    /// Radius √(A/π) of the disc of the material's area, m.
    pub equivalent_radius: f64,
    /// Depth D, m.
    pub depth: f64,
    /// Mean of D², m².
    pub depth_squared: f64,
    /// πR_o², the area that displaces fluid, m².
    pub displaced: f64,
}

/// Abscissae and weights of Gauss's rule with three points on 0 … 1, exact for polynomials of degree 5.
const GAUSS: [[f64; 2]; 3] =
    [[0.112_701_665_379_258_31, 5.0 / 18.0], [0.5, 8.0 / 18.0], [0.887_298_334_620_741_7, 5.0 / 18.0]];

impl Sections {
    /// The same `section` and `density` (kg/m³) everywhere, as deep as it is broad.
    pub fn even(section: Section, density: f64) -> Self {
        Self {
            outer: section.outer.into(),
            inner: section.inner.into(),
            depth: None,
            density: density.into(),
            mass_factor: 1.0.into(),
        }
    }

    /// The section at `xi`.
    pub fn at(&self, xi: f64) -> Section {
        Section { outer: self.outer.at(xi), inner: self.inner.at(xi) }
    }

    /// Depth across the plane of motion at `xi`, m.
    pub fn depth_at(&self, xi: f64) -> f64 {
        self.depth.as_ref().map_or_else(|| 2.0 * self.outer.at(xi), |depth| depth.at(xi))
    }

    /// Mass per length at `xi`, kg/m.
    pub fn line_density(&self, xi: f64) -> f64 {
        self.density.at(xi) * self.at(xi).area() * self.mass_factor.at(xi)
    }

    /// All profiles.
    pub fn profiles(&self) -> impl Iterator<Item = &Profile> {
        [&self.outer, &self.inner, &self.density, &self.mass_factor].into_iter().chain(&self.depth)
    }

    /// The mean of `quantity` from `from` to `to` (ξ), exact for polynomials of degree 5 in profiles that are linear in
    /// between their points.
    pub fn mean(&self, from: f64, to: f64, quantity: impl Fn(f64) -> f64) -> f64 {
        if self.profiles().all(Profile::is_even) {
            return quantity(from);
        }
        let mut ends = vec![from, to];
        ends.extend(self.profiles().flat_map(|p| &p.0).map(|p| p[0]).filter(|xi| *xi > from && *xi < to));
        ends.sort_by(f64::total_cmp);
        let piece = |ends: &[f64]| {
            let span = ends[1] - ends[0];
            span * GAUSS.iter().map(|[x, weight]| weight * quantity(ends[0] + span * x)).sum::<f64>()
        };
        ends.windows(2).map(piece).sum::<f64>() / (to - from)
    }

    /// Half of an edge from arc length `start` over `length` (m), on a rod of `whole` metres.
    pub fn half(&self, start: f64, length: f64, whole: f64) -> Half {
        let (from, to) = (start / whole, (start + length) / whole);
        let mean = |quantity: &dyn Fn(f64) -> f64| self.mean(from, to, quantity);
        Half {
            length,
            middle: start + 0.5 * length,
            radius: mean(&|xi| self.outer.at(xi)),
            equivalent_radius: mean(&|xi| self.at(xi).equivalent_radius()),
            depth: mean(&|xi| self.depth_at(xi)),
            depth_squared: mean(&|xi| self.depth_at(xi).powi(2)),
            displaced: mean(&|xi| PI * self.outer.at(xi).powi(2)),
        }
    }
}
