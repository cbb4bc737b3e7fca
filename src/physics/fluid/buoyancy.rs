//! Buoyancy in a layered medium: −ρ(x) V g on every node, where V is the volume that it displaces.
//!
//! With gravity along the normal of the layers, the fluid at rest is in equilibrium, and buoyancy has the potential
//! V g·ν ∫ρ dh.

use std::ops::Range;

use nalgebra::Vector2;

use super::force::{EdgeForce, Force, ForceAccumulator, Kinematics, PowerKind, StateDerivatives};
use super::medium::{DENSITY, Key, LocalFluid, Property};
use super::validity::Validity;
use crate::linear::{Block, Direction, pair};
use crate::rod::{EdgeValues, Rod, add, node};

/// Buoyancy of a rod in layers.
#[derive(Debug)]
pub struct Buoyancy {
    gravity: Vector2<f64>,
    /// Volume of both halves of every edge, m³.
    halves: EdgeValues<[f64; 2]>,
}

impl Buoyancy {
    /// The buoyancy of `rod` under `gravity` (m/s²).
    pub fn new(rod: &Rod, gravity: Vector2<f64>) -> Self {
        Self {
            gravity,
            halves: rod.halves().map(|both| both.map(|h| h.displaced * h.length)).collect::<Vec<_>>().into(),
        }
    }
}

impl Force for Buoyancy {
    fn name(&self) -> &'static str {
        "buoyancy"
    }

    fn validity(&self) -> Validity {
        Validity { range: "layers across gravity, at rest", bounds: &[], source: "Archimedes" }
    }

    fn is_the_same_everywhere(&self) -> bool {
        true
    }

    fn is_of_fluid(&self) -> bool {
        false // independent of the flow
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn power_kind(&self) -> Option<PowerKind> {
        Some(PowerKind::Load)
    }

    fn evaluate(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut ForceAccumulator<'_>,
    ) {
        let (normal, by_place) = (pair(rod.normal()), along.map_or(0.0, |direction| direction.q));
        let on_edge = |k: usize, ends: [&LocalFluid; 2]| {
            let volumes = &self.halves[k];
            EdgeForce::new(
                [0, 1].map(|i| self.gravity * (volumes[i] * ends[i].fluid.density)),
                [0, 1].map(|i| Block::outer(self.gravity * (volumes[i] * ends[i].slope.density * by_place), normal)),
                [Block::ZERO; 2],
            )
        };
        match rod.everywhere() {
            Some(fluid) => {
                let here = fluid.into();
                sums.each(edges, |k| on_edge(k, [&here; 2]));
            }
            None => {
                let ends = rod.around.along(edges.clone()).windows(2);
                sums.each(edges.zip(ends), |(k, ends)| on_edge(k, [&ends[0], &ends[1]]));
            }
        }
    }

    fn energy(&self, rod: &Kinematics<'_>, factor: f64, mut by: Option<StateDerivatives<'_>>) -> f64 {
        let mut energy = 0.0;
        for (e, volumes) in self.halves.iter().enumerate() {
            for (k, volume) in [e, e + 1].into_iter().zip(volumes) {
                let x = node(rod.q, k);
                energy += volume
                    * match rod.layers {
                        Some(layers) => self.gravity.dot(&layers.normal) * layers.column(rod.fluid, layers.height(x)),
                        None => rod.fluid.density * self.gravity.dot(&x),
                    };
                if let Some(StateDerivatives { q, .. }) = &mut by {
                    add(q, k, self.gravity * (volume * rod.here(k).fluid.density * factor));
                }
            }
        }
        energy
    }

    fn parameters(&self) -> &[Key] {
        &[DENSITY]
    }

    fn add_by_parameter(&self, key: Key, rod: &Kinematics<'_>, out: &mut [f64]) -> [f64; 2] {
        let Some(property) = Property::of(key) else { return [0.0; 2] };
        let mut energy = 0.0;
        for (e, volumes) in self.halves.iter().enumerate() {
            for (k, volume) in [e, e + 1].into_iter().zip(volumes) {
                add(out, k, self.gravity * (volume * rod.by_property(property, k).fluid.density));
                energy += volume
                    * match rod.layers {
                        Some(layers) => {
                            let h = layers.height(node(rod.q, k));
                            self.gravity.dot(&layers.normal) * layers.column_by_property(rod.fluid, property, h)
                        }
                        None => f64::from(property == Property::Density(0)) * self.gravity.dot(&node(rod.q, k)),
                    };
            }
        }
        [energy, 0.0]
    }
}
