//! Froude–Krylov force: the effect of the pressure in an accelerating flow on the rod.
//!
//! A flow of uniform velocity u(t) has the pressure gradient −ρu̇, which exerts the same force on a body of volume V as
//! on the fluid that it displaces, ρVu̇. Every half of an edge acts on its own node. In the frame of the flow this is
//! the buoyancy in a field of gravity −u̇. Source: J. N. Newman, Marine Hydrodynamics (1977), section 4.17.

use std::ops::Range;

use nalgebra::Vector2;

use super::force::{EdgeForce, Force, ForceAccumulator, Kinematics, PowerKind};
use super::medium::{DENSITY, Key, Property};
use super::validity::Validity;
use crate::linear::{Block, Direction, pair};
use crate::rod::{EdgeValues, Rod, add};

/// The Froude–Krylov force on a rod.
#[derive(Debug)]
pub struct FroudeKrylov {
    /// Volume of both halves of every edge, m³.
    halves: EdgeValues<[f64; 2]>,
}

impl FroudeKrylov {
    /// The force on the volume of `rod`, and of the body whose centre is node 0.
    pub fn new(rod: &Rod) -> Self {
        let volume = |half: &crate::rod::HalfEdge| half.displaced * half.length;
        let mut halves: Vec<_> = rod.halves().map(|halves| halves.map(|h| volume(&h))).collect();
        if let (Some([centre, _]), Some(body)) = (halves.first_mut(), rod.body) {
            *centre += body.volume();
        }
        Self { halves: halves.into() }
    }
}

impl Force for FroudeKrylov {
    fn name(&self) -> &'static str {
        "froude-krylov"
    }

    fn validity(&self) -> Validity {
        Validity {
            range: "flows that are the same all around the rod",
            bounds: &[],
            source: "J. N. Newman, Marine Hydrodynamics (1977), section 4.17",
        }
    }

    fn is_of_fluid(&self) -> bool {
        true
    }

    fn is_the_same_everywhere(&self) -> bool {
        true
    }

    fn evaluate(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut ForceAccumulator<'_>,
    ) {
        if !self.is_on_edges(rod) {
            return;
        }
        let along = along.map_or(0.0, |direction| direction.q);
        sums.each(edges, |e| {
            let ends = [0, 1].map(|i| {
                let (here, volume) = (rod.here(e + i), self.halves[e][i]);
                let opposing = rod.fluid.acceleration * -volume;
                let by_place = pair(rod.normal() * (here.slope.density * along));
                (opposing * here.fluid.density, Block::outer(opposing, by_place))
            });
            EdgeForce::new(ends.map(|(force, _)| force), ends.map(|(_, own)| own), [Block::ZERO; 2])
        });
    }

    fn is_on_edges(&self, rod: &Kinematics<'_>) -> bool {
        rod.fluid.acceleration != Vector2::zeros()
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn power_kind(&self) -> Option<PowerKind> {
        Some(PowerKind::Flow)
    }

    fn parameters(&self) -> &[Key] {
        &[DENSITY]
    }

    fn add_by_parameter(&self, key: Key, rod: &Kinematics<'_>, out: &mut [f64]) -> [f64; 2] {
        let Some(property) = Property::of(key) else { return [0.0; 2] };
        for e in 0..rod.edges.len() {
            for (i, volume) in self.halves[e].iter().enumerate() {
                let by = rod.by_property(property, e + i).fluid.density;
                add(out, e + i, rod.fluid.acceleration * (-volume * by));
            }
        }
        [0.0; 2]
    }
}
