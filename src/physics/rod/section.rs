//! The cross-section, and its variation along the rod.

use std::f64::consts::{FRAC_PI_2, PI};

use serde::Deserialize;

/// The outline of a cross-section: thickness t = 2R_o in the plane of motion, depth D across it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Shape {
    /// A round core of radius R_o. If the depth differs from 2R_o, it has a membrane that only the fluid feels.
    Round,
    /// An ellipse with axes t and D.
    Ellipse,
    /// A rectangle with sides t and D.
    Rectangle,
}

impl Shape {
    /// The name in a scene.
    pub fn name(self) -> &'static str {
        match self {
            Self::Round => "round",
            Self::Ellipse => "ellipse",
            Self::Rectangle => "rectangle",
        }
    }
}

/// A cross-section, solid or with a similar hole in the ratio R_i/R_o.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// Outline.
    pub shape: Shape,
    /// Outer radius R_o, m: half the thickness in the plane of motion.
    pub outer: f64,
    /// Inner radius R_i, m: half the thickness of the hole; zero for a solid rod.
    pub inner: f64,
    /// Depth D across the plane of motion, m.
    pub depth: f64,
}

impl Section {
    /// A disc or an annulus of these radii (m).
    pub fn round(outer: f64, inner: f64) -> Self {
        Self { shape: Shape::Round, outer, inner, depth: 2.0 * outer }
    }

    /// Thickness t over depth D.
    fn aspect(&self) -> f64 {
        2.0 * self.outer / self.depth
    }

    /// A quantity of the solid section that scales with this power of length, minus that of the hole.
    fn less_hole(&self, solid: f64, order: i32) -> f64 {
        solid * (1.0 - (self.inner / self.outer).powi(order))
    }

    /// Area A of the material, m²: πR_o² of the disc, ¼πtD of the ellipse, tD of the rectangle, minus that of the hole.
    pub fn area(&self) -> f64 {
        match self.shape {
            Shape::Round => PI * (self.outer.powi(2) - self.inner.powi(2)),
            Shape::Ellipse | Shape::Rectangle => self.less_hole(self.displaced(), 2),
        }
    }

    /// Thickness of the wall in the plane of motion and across it, m; for a solid section half of its own. The ratio of
    /// the two is t/D, except in a round section, whose wall is uniform.
    pub fn walls(&self) -> [f64; 2] {
        let wall = self.outer - self.inner;
        [wall, if self.shape == Shape::Round { wall } else { wall / self.aspect() }]
    }

    /// Semi-axes of the outline of the material, m, in the plane of motion and across it.
    pub fn semi_axes(&self) -> [f64; 2] {
        [self.outer, if self.shape == Shape::Round { self.outer } else { 0.5 * self.depth }]
    }

    /// Area inside the outline, m², which displaces fluid.
    pub fn displaced(&self) -> f64 {
        match self.shape {
            Shape::Round => PI * self.outer.powi(2),
            Shape::Ellipse => PI * self.outer * (0.5 * self.depth),
            Shape::Rectangle => 2.0 * self.outer * self.depth,
        }
    }

    /// Second moment of area I for bending in the plane of motion, m⁴: ¼πR_o⁴ of the disc, ¼πa³b of the ellipse with
    /// a = R_o and b = D/2, Dt³/12 of the rectangle, minus that of the hole.
    pub fn inertia(&self) -> f64 {
        match self.shape {
            Shape::Round => PI / 4.0 * (self.outer.powi(4) - self.inner.powi(4)),
            Shape::Ellipse => self.less_hole(PI / 4.0 * self.outer.powi(3) * (0.5 * self.depth), 4),
            Shape::Rectangle => self.less_hole(self.depth * (2.0 * self.outer).powi(3) / 12.0, 4),
        }
    }

    /// Second moment of area for bending across the plane of motion, m⁴: [`inertia`](Self::inertia) with t and D
    /// exchanged.
    pub fn inertia_across(&self) -> f64 {
        match self.shape {
            Shape::Round => self.inertia(),
            Shape::Ellipse => self.less_hole(PI / 4.0 * self.outer * (0.5 * self.depth).powi(3), 4),
            Shape::Rectangle => self.less_hole(2.0 * self.outer * self.depth.powi(3) / 12.0, 4),
        }
    }

    /// Torsion constant J, m⁴: ½πR_o⁴ of the disc and πa³b³/(a² + b²) of the ellipse, minus that of the hole, whose
    /// edge is a line of the shear stress; Dt³ (1/3 − 64/π⁵ t/D Σ tanh(nπD/2t)/n⁵) over odd n of the rectangle with
    /// sides D ≥ t. `None` for the rectangle with a hole, which has no closed form. Source: S. Timoshenko & J. N.
    /// Goodier, Theory of Elasticity (1970), chapter 10.
    pub fn torsion(&self) -> Option<f64> {
        let (a, b) = (self.outer, 0.5 * self.depth);
        match self.shape {
            Shape::Round => Some(2.0 * self.inertia()),
            Shape::Ellipse => Some(self.less_hole(PI * (a * b).powi(3) / (a * a + b * b), 4)),
            Shape::Rectangle if self.inner > 0.0 => None,
            Shape::Rectangle => {
                let (thin, deep) = (2.0 * a.min(b), 2.0 * a.max(b));
                // tanh x = 1 − 2/(e²ˣ + 1), and Σ 1/n⁵ is 31/32 ζ(5).
                let term = |n: i32| 2.0 / (f64::from(n).powi(5) * ((f64::from(n) * PI * deep / thin).exp() + 1.0));
                let sum = 31.0 / 32.0 * ZETA_5 - (0..8).map(|i| term(2 * i + 1)).sum::<f64>();
                Some(deep * thin.powi(3) * (1.0 / 3.0 - 64.0 / PI.powi(5) * thin / deep * sum))
            }
        }
    }

    /// Perimeter of the outline, m. For a round core with a membrane it is that of the ellipse around both, by
    /// Ramanujan's formula (at most 0.4 % too short), which is exact for the disc.
    pub fn perimeter(&self) -> f64 {
        match self.shape {
            Shape::Round => {
                let (a, b) = (self.depth * 0.5, 2.0 * self.outer * 0.5);
                ((a + b) * 3.0 - ((a * 3.0 + b) * (a + b * 3.0)).sqrt()) * PI
            }
            Shape::Ellipse => {
                let (small, large) = (self.outer.min(0.5 * self.depth), self.outer.max(0.5 * self.depth));
                let flat = (small / large).powi(2);
                // E = (E − (1 − m)K) + (1 − m)K.
                let [complete, without] = elliptic(1.0 - flat, flat);
                4.0 * large * (without + flat * complete)
            }
            Shape::Rectangle => 2.0 * (2.0 * self.outer + self.depth),
        }
    }

    /// Radius √(A/π) of a disc of the area of the material, m.
    pub fn equivalent_radius(&self) -> f64 {
        (self.area() / PI).sqrt()
    }

    /// Conformal radius of the outline, m: slow flow far from a slender rod is that around a round rod of this radius.
    /// R_o of a round core, whose membrane is ignored; ¼(t + D) of the ellipse; about 0.295 (t + D) of a rectangle near
    /// the square. Source: G. K. Batchelor, J. Fluid Mech. 44 (1970).
    pub fn slender_radius(&self) -> f64 {
        match self.shape {
            Shape::Round => self.outer,
            Shape::Ellipse => 0.5 * (self.outer + 0.5 * self.depth),
            Shape::Rectangle if self.depth == 0.0 => 0.5 * self.outer,
            Shape::Rectangle => self.depth * conformal(self.aspect())[1],
        }
    }

    /// The term that slow flow across a slender rod adds to the logarithm of [`slender_radius`](Self::slender_radius):
    /// t/(t + D), which is ½ for a round rod and 0 for a plate that moves broadside. It is the limit of A. Oberbeck's
    /// ellipsoid (J. Reine Angew. Math. 81, 1876), exact for the ellipse and the plate, and also used for the
    /// rectangle.
    pub fn slender_across(&self) -> f64 {
        match self.shape {
            Shape::Round => 0.5,
            Shape::Ellipse | Shape::Rectangle => 2.0 * self.outer / (2.0 * self.outer + self.depth),
        }
    }

    /// The added mass per length for motion across the section in the plane, over ¼πρ, m²: D² of ellipse, disc and
    /// membrane; C D² of the rectangle, where C increases from 1 (a plate, t = 0) through 1.513 (a square). Exact, by
    /// the conformal map of the exterior. Sources: J. N. Newman, Marine Hydrodynamics (1977), table 4.3; R. D. Blevins,
    /// Formulas for Natural Frequency and Mode Shape (1979), table 14-1.
    pub fn added(&self) -> f64 {
        match self.shape {
            Shape::Round | Shape::Ellipse => self.depth.powi(2),
            Shape::Rectangle if self.depth == 0.0 => 0.0,
            Shape::Rectangle => {
                let aspect = self.aspect();
                let [m, radius] = conformal(aspect);
                // m_a = ρ(4πmR² − tD).
                self.depth.powi(2) * (16.0 * m * radius * radius - 4.0 / PI * aspect)
            }
        }
    }

    /// Form drag coefficient C_d, based on the depth, in flow across the section. Ellipse, disc and membrane:
    /// 2 − 0.9 t/D, from 2 for a plate to 1.1 for the disc and thicker sections (S. F. Hoerner, Fluid-Dynamic Drag,
    /// 1965). Rectangle with sharp edges: 2 up to t/D = 0.2, 2.4 at 0.7, 1.0 at 5 and 0.9 from 10 on, linear in ln(t/D)
    /// in between (EN 1991-1-4:2005, figure 7.23).
    pub fn form_drag(&self) -> f64 {
        match self.shape {
            Shape::Round | Shape::Ellipse => 2.0 - self.slim() * 0.9,
            Shape::Rectangle => {
                Profile(RECTANGLE_FORM_DRAG.map(|[aspect, drag]| [aspect.ln(), drag]).into()).at(self.aspect().ln())
            }
        }
    }

    /// Thickness over depth, at most 1.
    pub fn slim(&self) -> f64 {
        self.aspect().min(1.0)
    }
}

/// Form drag coefficient of rectangles over the ratio of thickness to depth.
const RECTANGLE_FORM_DRAG: [[f64; 2]; 4] = [[0.2, 2.0], [0.7, 2.4], [5.0, 1.0], [10.0, 0.9]];

/// Riemann's ζ(5).
const ZETA_5: f64 = 1.036_927_755_143_37;

/// K(m) and S(m) = E(m) − (1 − m)K(m) = ∫ √(m − sin²φ) dφ up to sin²φ = m, for the parameter m = k² and `rest` = 1 − m,
/// by the arithmetic-geometric mean, without a difference of close numbers. Source: M. Abramowitz & I. A. Stegun,
/// section 17.6.
fn elliptic(m: f64, rest: f64) -> [f64; 2] {
    let (mut a, mut b) = (1.0, rest.sqrt());
    let (mut sum, mut factor) = (0.5 * m, 1.0);
    // c₁ = (1 − √(1 − m))/2.
    let mut c = 0.5 * m / (1.0 + b);
    while c > f64::EPSILON * a {
        sum -= factor * c * c;
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
        (c, factor) = (0.25 * c * c / (0.5 * (a + b)), 2.0 * factor);
    }
    let complete = FRAC_PI_2 / a;
    [complete, complete * sum]
}

/// The conformal map of the exterior of a rectangle, of this thickness over depth, to that of a circle: m = sin²α,
/// where the corners are at ±α, and the circle's radius over the depth. The map is dz/dζ = R √(ζ⁴ − 2ζ² cos 2α + 1)/ζ²,
/// so that D/2 = 2R S(m) and t/2 = 2R S(1 − m), with S as in [`elliptic`].
fn conformal(aspect: f64) -> [f64; 2] {
    let thin = aspect.min(aspect.recip());
    // Solves S(x)/S(1 − x) = thin. The left side is convex, so Newton's method decreases monotonically from ½; the
    // slope is ¼π/S(1 − x)² (Legendre).
    let sides = |x: f64| [elliptic(1.0 - x, x)[1], elliptic(x, 1.0 - x)[1]];
    let (mut x, mut next) = (1.0, 0.5);
    let mut long = 1.0;
    while 0.0 < next && next < x {
        x = next;
        let short;
        [long, short] = sides(x);
        next = x - (short / long - thin) * 4.0 / PI * long * long;
    }
    if aspect <= 1.0 { [1.0 - x, 0.25 / long] } else { [x, 0.25 * aspect / long] }
}

/// A quantity along the rod: points (ξ, value) with increasing ξ = s/L, linear in between, constant outside.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile(Vec<[f64; 2]>);

impl From<f64> for Profile {
    /// The same value everywhere.
    fn from(value: f64) -> Self {
        Self(vec![[0.0, value]])
    }
}

impl Profile {
    /// The profile through points (ξ, value) with increasing ξ; `None` without points.
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
            (None, None) => 0.0, // not reached: there is at least one point
        }
    }

    /// The ξ of its points.
    pub fn places(&self) -> impl Iterator<Item = f64> {
        self.0.iter().map(|p| p[0])
    }

    /// The ξ of its points strictly between `from` and `to`.
    fn places_between(&self, from: f64, to: f64) -> impl Iterator<Item = f64> {
        let [first, last] = [self.0.partition_point(|p| p[0] <= from), self.0.partition_point(|p| p[0] < to)];
        self.0[first.min(last)..last].iter().map(|p| p[0])
    }

    /// True if the value is the same everywhere.
    pub fn is_even(&self) -> bool {
        self.0.iter().all(|p| p[1] == self.0[0][1])
    }

    /// The profile with every value multiplied by `factor`.
    #[must_use]
    pub fn times(&self, factor: f64) -> Self {
        Self(self.0.iter().map(|[xi, value]| [*xi, value * factor]).collect())
    }

    /// The largest value.
    pub fn largest(&self) -> f64 {
        self.0.iter().fold(f64::NEG_INFINITY, |max, p| max.max(p[1]))
    }
}

/// The cross-sections along a rod, with density and mass.
#[derive(Debug, Clone, PartialEq)]
pub struct Sections {
    /// Outline.
    pub shape: Shape,
    /// Outer radius R_o, m: half the thickness in the plane of motion.
    pub outer: Profile,
    /// Inner radius R_i, m.
    pub inner: Profile,
    /// Depth D across the plane of motion, m; by default twice the outer radius.
    pub depth: Option<Profile>,
    /// Density, kg/m³.
    pub density: Profile,
    /// Factor on the mass.
    pub mass_factor: Profile,
    /// Measured stiffness and mass.
    pub measured: Measured,
}

/// Measured stiffness and mass, each replacing the value computed from sections and material.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Measured {
    /// Axial stiffness EA, N.
    pub axial: Option<Profile>,
    /// Bending stiffness EI, N m².
    pub bending: Option<Profile>,
    /// Mass per length, kg/m.
    pub mass: Option<Profile>,
}

/// Means over half of an edge, for the forces that act on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfEdge {
    /// Length, m.
    pub length: f64,
    /// Arc length at the middle, m.
    pub middle: f64,
    /// Outline of the section.
    pub shape: Shape,
    /// Outer radius R_o, m.
    pub outer: f64,
    /// Radius for slow flow far from the rod, m, see [`Section::slender_radius`].
    pub radius: f64,
    /// Term that slow flow across the section adds to the logarithm of that radius, see [`Section::slender_across`].
    pub slender_across: f64,
    /// Radius √(A/π) of a disc of the area of the material, m.
    pub equivalent_radius: f64,
    /// Depth D, m.
    pub depth: f64,
    /// Added mass per length over ¼πρ, m², see [`Section::added`].
    pub added: f64,
    /// Area that displaces fluid, m².
    pub displaced: f64,
}

impl HalfEdge {
    /// The solid section with these mean dimensions.
    pub fn section(&self) -> Section {
        Section { shape: self.shape, outer: self.outer, inner: 0.0, depth: self.depth }
    }
}

/// Nodes and weights of the three-point Gauss rule on 0 … 1, exact for polynomials of degree 5.
const GAUSS: [[f64; 2]; 3] =
    [[0.112_701_665_379_258_31, 5.0 / 18.0], [0.5, 8.0 / 18.0], [0.887_298_334_620_741_7, 5.0 / 18.0]];

impl Sections {
    /// The same `section` and `density` (kg/m³) everywhere.
    pub fn even(section: Section, density: f64) -> Self {
        Self {
            shape: section.shape,
            outer: section.outer.into(),
            inner: section.inner.into(),
            depth: Some(section.depth.into()),
            density: density.into(),
            mass_factor: 1.0.into(),
            measured: Measured::default(),
        }
    }

    /// The section at `xi`.
    pub fn at(&self, xi: f64) -> Section {
        Section { shape: self.shape, outer: self.outer.at(xi), inner: self.inner.at(xi), depth: self.depth_at(xi) }
    }

    /// Depth across the plane of motion at `xi`, m.
    pub fn depth_at(&self, xi: f64) -> f64 {
        self.depth.as_ref().map_or_else(|| 2.0 * self.outer.at(xi), |depth| depth.at(xi))
    }

    /// True if the outline is not round, or there is a membrane.
    pub fn is_flat(&self) -> bool {
        let membrane = |depth: &Profile| {
            depth.places().chain(self.outer.places()).any(|xi| depth.at(xi) != 2.0 * self.outer.at(xi))
        };
        self.shape != Shape::Round || self.depth.as_ref().is_some_and(membrane)
    }

    /// Maximum of [`Section::slender_radius`] along the rod, m. It is at a point of a profile, because the radius is
    /// convex in between.
    pub fn largest_radius(&self) -> f64 {
        let places = self.outer.places().chain(self.depth.iter().flat_map(Profile::places));
        places.fold(0.0, |most: f64, xi| most.max(self.at(xi).slender_radius()))
    }

    /// Maximum extent across the plane of motion, m: half the depth, including a membrane, and at least the radius of a
    /// round core.
    pub fn reach_across(&self) -> f64 {
        let places = self.outer.places().chain(self.depth.iter().flat_map(Profile::places));
        let round = |xi: f64| if self.shape == Shape::Round { self.outer.at(xi) } else { 0.0 };
        places.fold(0.0, |most: f64, xi| most.max(0.5 * self.depth_at(xi)).max(round(xi)))
    }

    /// Mass per length at `xi`, kg/m.
    pub fn line_density(&self, xi: f64) -> f64 {
        let material = match &self.measured.mass {
            Some(mass) => mass.at(xi),
            None => self.density.at(xi) * self.at(xi).area(),
        };
        material * self.mass_factor.at(xi)
    }

    /// Bending stiffness EI at `xi`, N m², for Young's modulus `youngs` (Pa).
    pub fn bending_stiffness(&self, youngs: f64, xi: f64) -> f64 {
        self.measured.bending.as_ref().map_or_else(|| youngs * self.at(xi).inertia(), |bending| bending.at(xi))
    }

    /// Axial stiffness EA at `xi`, N, for Young's modulus `youngs` (Pa).
    pub fn axial_stiffness_at(&self, youngs: f64, xi: f64) -> f64 {
        self.measured.axial.as_ref().map_or_else(|| youngs * self.at(xi).area(), |axial| axial.at(xi))
    }

    /// Mean axial stiffness EA from `from` to `to` (ξ), N.
    pub fn axial_stiffness(&self, youngs: f64, from: f64, to: f64) -> f64 {
        match &self.measured.axial {
            Some(axial) => self.mean(from, to, |xi| axial.at(xi)),
            None => youngs * self.mean(from, to, |xi| self.at(xi).area()),
        }
    }

    /// All profiles.
    pub fn profiles(&self) -> impl Iterator<Item = &Profile> {
        let Measured { axial, bending, mass } = &self.measured;
        let own = [&self.outer, &self.inner, &self.density, &self.mass_factor].into_iter();
        own.chain(&self.depth).chain(axial).chain(bending).chain(mass)
    }

    /// True if the section is the same all along the rod.
    pub fn is_even(&self) -> bool {
        self.profiles().all(Profile::is_even)
    }

    /// The mean of `quantity` from `from` to `to` (ξ), exact for polynomials of degree 5 in profiles that are linear
    /// between their points.
    pub fn mean(&self, from: f64, to: f64, quantity: impl Fn(f64) -> f64) -> f64 {
        if self.is_even() {
            return quantity(from);
        }
        let mut ends = vec![from, to];
        ends.extend(self.profiles().flat_map(|profile| profile.places_between(from, to)));
        ends.sort_by(f64::total_cmp);
        let piece = |ends: &[f64]| {
            let span = ends[1] - ends[0];
            span * GAUSS.iter().map(|[x, weight]| weight * quantity(ends[0] + span * x)).sum::<f64>()
        };
        ends.windows(2).map(piece).sum::<f64>() / (to - from)
    }

    /// Half of an edge, from arc length `start` over `length` (m), on a rod of length `whole` (m).
    pub fn half(&self, start: f64, length: f64, whole: f64) -> HalfEdge {
        let (from, to) = (start / whole, (start + length) / whole);
        let mean = |quantity: &dyn Fn(f64) -> f64| self.mean(from, to, quantity);
        HalfEdge {
            length,
            middle: start + 0.5 * length,
            shape: self.shape,
            outer: mean(&|xi| self.outer.at(xi)),
            radius: mean(&|xi| self.at(xi).slender_radius()),
            slender_across: mean(&|xi| self.at(xi).slender_across()),
            equivalent_radius: mean(&|xi| self.at(xi).equivalent_radius()),
            depth: mean(&|xi| self.depth_at(xi)),
            added: mean(&|xi| self.at(xi).added()),
            displaced: mean(&|xi| self.at(xi).displaced()),
        }
    }
}
