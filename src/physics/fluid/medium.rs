//! The fluid around the rod: one fluid, or several layers separated by parallel interfaces, with a flow that may be
//! sheared.
//!
//! With the height h = ν·x along the unit normal ν of all interfaces, density, viscosity and flow are those before the
//! first interface plus their jump at every interface, blended over its thickness: ρ(h) = ρ₀ + Σ_j (ρ_j − ρ_{j−1})
//! r(z_j), z = (h − offset)/thickness + ½ clamped to 0 … 1, r = 10z³ − 15z⁴ + 6z⁵. A medium is therefore twice
//! continuously differentiable, and exactly uniform outside its interfaces.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};
use wide::f64x2;

use crate::linear::pair;

/// A uniform fluid, or the fluid at a position.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Fluid {
    /// Dynamic viscosity μ, Pa s.
    pub viscosity: f64,
    /// Density ρ, kg/m³.
    pub density: f64,
    /// Background velocity u, m/s.
    pub flow: Vector2<f64>,
    /// Its rate u̇, m/s², which has the pressure gradient −ρu̇.
    pub acceleration: Vector2<f64>,
}

impl Fluid {
    /// No fluid, or no change of a fluid.
    pub const NONE: Self =
        Self { viscosity: 0.0, density: 0.0, flow: Vector2::new(0.0, 0.0), acceleration: Vector2::new(0.0, 0.0) };

    /// Adds `factor` times `other`.
    #[inline(always)]
    pub fn add(&mut self, other: &Self, factor: f64) {
        self.viscosity += factor * other.viscosity;
        self.density += factor * other.density;
        self.flow += other.flow * factor;
    }

    /// Clamps viscosity and density to zero from below.
    pub fn clamp(&mut self) {
        self.viscosity = self.viscosity.max(0.0);
        self.density = self.density.max(0.0);
    }
}

/// A parameter of a scene that forces may depend on, by its key.
pub type Key = &'static str;

/// The key of the viscosity, Pa s; with interfaces, that before the first one.
pub const VISCOSITY: Key = "medium.viscosity_pa_s";

/// The key of the density, kg/m³; with interfaces, that before the first one.
pub const DENSITY: Key = "medium.density_kg_m3";

/// Maximum number of interfaces of a medium.
pub const MAX_LAYERS: usize = 4;

/// The keys of viscosity (Pa s), density (kg/m³) and offset (m) of the fluid beyond every interface. Those of the first
/// one may also be written `medium.beyond`.
pub const LAYER_KEYS: [[Key; 3]; MAX_LAYERS] = [
    ["medium.layers.0.viscosity_pa_s", "medium.layers.0.density_kg_m3", "medium.layers.0.offset_m"],
    ["medium.layers.1.viscosity_pa_s", "medium.layers.1.density_kg_m3", "medium.layers.1.offset_m"],
    ["medium.layers.2.viscosity_pa_s", "medium.layers.2.density_kg_m3", "medium.layers.2.offset_m"],
    ["medium.layers.3.viscosity_pa_s", "medium.layers.3.density_kg_m3", "medium.layers.3.offset_m"],
];

/// The property of a medium that a key names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Property {
    /// The viscosity of layer 0 (before the first interface), 1, 2, …
    Viscosity(usize),
    /// The density of layer 0, 1, 2, …
    Density(usize),
    /// The offset of interface 0, 1, …
    Offset(usize),
}

impl Property {
    /// The property that `key` names, if it is one of a medium.
    pub fn of(key: Key) -> Option<Self> {
        match key {
            VISCOSITY => Some(Self::Viscosity(0)),
            DENSITY => Some(Self::Density(0)),
            "medium.beyond.viscosity_pa_s" => Some(Self::Viscosity(1)),
            "medium.beyond.density_kg_m3" => Some(Self::Density(1)),
            "medium.beyond.offset_m" => Some(Self::Offset(0)),
            _ => LAYER_KEYS.iter().enumerate().find_map(|(j, keys)| match keys.iter().position(|own| *own == key)? {
                0 => Some(Self::Viscosity(j + 1)),
                1 => Some(Self::Density(j + 1)),
                _ => Some(Self::Offset(j)),
            }),
        }
    }
}

/// An interface, and the fluid beyond it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Layer {
    /// Height of the middle of the interface, m.
    pub offset: f64,
    /// Thickness over which the fluids blend, m.
    pub thickness: f64,
    /// The fluid beyond; its flow is relative to that of the fluid before the first interface.
    pub fluid: Fluid,
}

impl Layer {
    /// Heights of both sides of the interface, m.
    #[inline(always)]
    fn ends(&self) -> [f64; 2] {
        let half = 0.5 * self.thickness;
        [self.offset - half, self.offset + half]
    }
}

/// The layers of a medium beyond its first fluid, and the shear of its flow.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Layers {
    /// Unit normal ν of all interfaces, pointing to the fluids beyond.
    pub normal: Vector2<f64>,
    /// Shear rate γ, 1/s: the flow gains γh along ν turned by −90°.
    pub shear: f64,
    count: usize,
    layers: [Layer; MAX_LAYERS],
}

/// The fluid at a position, and its derivatives along the normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalFluid {
    /// The fluid.
    pub fluid: Fluid,
    /// Its first derivative with respect to the height, per metre.
    pub slope: Fluid,
    /// The second derivative of its density, kg/m⁵.
    pub bend: f64,
}

/// A range of heights in which the medium is uniform, or changes everywhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    low: f64,
    high: f64,
    /// True if it changes.
    pub changes: bool,
}

impl From<Fluid> for LocalFluid {
    /// A uniform fluid.
    #[inline(always)]
    fn from(fluid: Fluid) -> Self {
        Self { fluid, slope: Fluid::NONE, bend: 0.0 }
    }
}

/// The changes of viscosities, densities and offsets, with their keys.
pub(crate) fn by_key<'a>(fluid: &Fluid, layers: Option<&'a Layers>) -> impl Iterator<Item = (Key, f64)> + use<'a> {
    let beyond =
        layers.into_iter().flat_map(Layers::iter).zip(LAYER_KEYS).flat_map(|(layer, [viscosity, density, offset])| {
            [(viscosity, layer.fluid.viscosity), (density, layer.fluid.density), (offset, layer.offset)]
        });
    [(VISCOSITY, fluid.viscosity), (DENSITY, fluid.density)].into_iter().chain(beyond)
}

/// r = 10z³ − 15z⁴ + 6z⁵ and its first two derivatives, for z clamped to 0 … 1.
#[inline(always)]
fn blend(z: f64) -> [f64; 3] {
    let z = z.clamp(0.0, 1.0);
    let rest = z * (1.0 - z);
    [z * z * z * (10.0 + z * (-15.0 + 6.0 * z)), 30.0 * rest * rest, 60.0 * rest * (1.0 - 2.0 * z)]
}

/// ∫₀ᶻ r, for any z.
fn blended(z: f64) -> f64 {
    let inside = z.clamp(0.0, 1.0);
    inside.powi(4) * (2.5 + inside * (-3.0 + inside)) + (z - 1.0).max(0.0)
}

impl Layers {
    const NOTHING: Layer = Layer { offset: 0.0, thickness: 0.0, fluid: Fluid::NONE };

    /// The layers beyond the interfaces of `layers`, in order; any beyond the first [`MAX_LAYERS`] are ignored.
    pub fn new(normal: Vector2<f64>, shear: f64, layers: impl IntoIterator<Item = Layer>) -> Self {
        let mut all = Self { normal, shear, count: 0, layers: [Self::NOTHING; MAX_LAYERS] };
        for (to, layer) in all.layers.iter_mut().zip(layers) {
            *to = layer;
            all.count += 1;
        }
        all
    }

    /// The layers beyond the first fluid, in the order of the interfaces.
    #[inline(always)]
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &Layer> + ExactSizeIterator {
        self.layers[..self.count].iter()
    }

    /// The layers beyond the first fluid, mutable.
    pub fn iter_mut(&mut self) -> impl ExactSizeIterator<Item = &mut Layer> {
        self.layers[..self.count].iter_mut()
    }

    /// Layer `j` beyond the first fluid.
    pub fn get(&self, j: usize) -> Option<&Layer> {
        self.layers[..self.count].get(j)
    }

    /// Layer `j` beyond the first fluid, mutable.
    pub fn get_mut(&mut self, j: usize) -> Option<&mut Layer> {
        self.layers[..self.count].get_mut(j)
    }

    /// The first interface that is not beyond the previous one, or overlaps it.
    pub fn overlap(&self) -> Option<usize> {
        let pairs = self.layers[..self.count].windows(2);
        let apart = |pair: &[Layer]| {
            let [low, high] = [&pair[0], &pair[1]].map(|layer| (layer.offset, 0.5 * layer.thickness));
            low.0 + low.1 <= high.0 - high.1
        };
        pairs.into_iter().position(|pair| !apart(pair)).map(|j| j + 1)
    }

    /// True if they flow like the fluid before the first interface.
    pub fn flow_together(&self) -> bool {
        self.shear == 0.0 && self.iter().all(|layer| layer.fluid.flow == Vector2::zeros())
    }

    /// The direction of the shear flow: the normal turned by −90°.
    #[inline(always)]
    pub fn along(&self) -> Vector2<f64> {
        Vector2::new(self.normal.y, -self.normal.x)
    }

    /// Height h (m) of the position `x`.
    #[inline(always)]
    pub fn height(&self, x: Vector2<f64>) -> f64 {
        self.normal.dot(&x)
    }

    /// The fluid at height `h` (m); `first` is the fluid before the first interface.
    #[inline(always)]
    pub fn at(&self, first: Fluid, h: f64) -> LocalFluid {
        let mut here = LocalFluid::from(first);
        for (layer, jump) in self.jumps(first) {
            let [low, high] = layer.ends();
            if h >= high {
                here.fluid.add(&jump, 1.0);
            } else if h > low {
                let per_thickness = 1.0 / layer.thickness;
                let [r, slope, bend] = blend((h - layer.offset) * per_thickness + 0.5);
                here.fluid.add(&jump, r);
                here.slope.add(&jump, slope * per_thickness);
                here.bend += jump.density * bend * per_thickness * per_thickness;
            }
        }
        if self.shear != 0.0 {
            here.fluid.flow += self.along() * (self.shear * h);
            here.slope.flow += self.along() * self.shear;
        }
        here
    }

    /// The layers, each with its difference from the fluid before it.
    #[inline(always)]
    fn jumps(&self, first: Fluid) -> impl Iterator<Item = (&Layer, Fluid)> {
        let mut before = Fluid { flow: Vector2::zeros(), ..first };
        self.iter().map(move |layer| {
            let mut jump = layer.fluid;
            jump.add(&before, -1.0);
            before = layer.fluid;
            (layer, jump)
        })
    }

    /// ∫ρ dh (kg/m²) up to height `h` (m); the part of the first fluid is counted from the first interface.
    pub fn column(&self, first: Fluid, h: f64) -> f64 {
        let start = self.iter().next().map_or(0.0, |layer| layer.offset);
        let beyond = |(layer, jump): (&Layer, Fluid)| {
            jump.density * layer.thickness * blended((h - layer.offset) / layer.thickness + 0.5)
        };
        first.density * (h - start) + self.jumps(first).map(beyond).sum::<f64>()
    }

    /// The range of heights around `h` (m) in which the medium is uniform, or in which it changes.
    pub fn span(&self, h: f64) -> Span {
        let mut span = Span { low: f64::NEG_INFINITY, high: f64::INFINITY, changes: self.shear != 0.0 };
        for [low, high] in self.iter().map(Layer::ends).filter(|_| self.shear == 0.0) {
            if h >= high {
                span.low = span.low.max(high);
            } else if h > low {
                return Span { low, high, changes: true };
            } else {
                span.high = span.high.min(low);
            }
        }
        span
    }

    /// The number of `places` before the first that is outside `span`; the first place is always counted.
    #[inline]
    pub fn within(&self, span: &Span, places: &[[f64; 2]]) -> usize {
        // Two places per SIMD operation.
        let (normal, low, high) = (pair(self.normal), f64x2::from(span.low), f64x2::from(span.high));
        let inside = |[one, other]: &[[f64; 2]; 2]| {
            let [x, y] = f64x2::transpose([f64x2::new(*one) * normal, f64x2::new(*other) * normal]);
            let h = x + y;
            (h.simd_ge(low) & h.simd_le(high)).to_bitmask()
        };
        let (pairs, rest) = places.as_chunks();
        let count = match pairs.iter().position(|pair| inside(pair) != 0b11) {
            Some(i) => 2 * i + usize::from(inside(&pairs[i]) == 0b01),
            None => 2 * pairs.len() + rest.iter().filter(|x| inside(&[**x; 2]) != 0).count(),
        };
        count.max(1)
    }

    /// Adds `factor` times offsets and fluids of `other`; the shear does not depend on time.
    pub fn add(&mut self, other: &Self, factor: f64) {
        for (to, from) in self.iter_mut().zip(other.iter()) {
            to.offset += factor * from.offset;
            to.fluid.add(&from.fluid, factor);
        }
    }

    /// Zero changes of offsets, fluids and shear.
    pub fn none(&self) -> Self {
        let mut none = Self { shear: 0.0, ..*self };
        none.iter_mut().for_each(|layer| *layer = Layer { thickness: layer.thickness, ..Self::NOTHING });
        none
    }

    /// The derivative of the fluid at height `h` (m), and of its slope, with respect to a property of the medium.
    pub fn by_property(&self, first: Fluid, property: Property, h: f64) -> LocalFluid {
        if let Property::Offset(j) = property {
            let Some((layer, jump)) = self.jumps(first).nth(j) else { return Fluid::NONE.into() };
            let per_thickness = 1.0 / layer.thickness;
            let [_, slope, bend] = blend((h - layer.offset) * per_thickness + 0.5);
            let mut here = LocalFluid::from(Fluid::NONE);
            here.fluid.add(&jump, -slope * per_thickness);
            here.slope.add(&jump, -bend * per_thickness * per_thickness);
            return here;
        }
        let (first, layers) = self.unit(property);
        layers.at(first, h)
    }

    /// The derivative of [`column`](Self::column) with respect to a property of the medium.
    pub fn column_by_property(&self, first: Fluid, property: Property, h: f64) -> f64 {
        if let Property::Offset(j) = property {
            let Some((layer, jump)) = self.jumps(first).nth(j) else { return 0.0 };
            let start = if j == 0 { first.density } else { 0.0 };
            return -start - jump.density * blend((h - layer.offset) / layer.thickness + 0.5)[0];
        }
        let (first, layers) = self.unit(property);
        layers.column(first, h)
    }

    /// A medium at rest in which this viscosity or density is one and all others are zero: the derivative of the medium
    /// with respect to it.
    fn unit(&self, property: Property) -> (Fluid, Self) {
        let alone = |j: usize| Fluid {
            viscosity: f64::from(property == Property::Viscosity(j)),
            density: f64::from(property == Property::Density(j)),
            ..Fluid::NONE
        };
        let mut layers = Self { shear: 0.0, ..*self };
        layers.iter_mut().enumerate().for_each(|(j, layer)| layer.fluid = alone(j + 1));
        (alone(0), layers)
    }
}
