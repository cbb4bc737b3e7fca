//! Loads that turn with the rod.

use std::ops::Range;

use nalgebra::Vector2;

use crate::fluid::force::{EdgeForce, Force, ForceAccumulator, Kinematics, PowerKind};
use crate::fluid::validity::Validity;
use crate::linear::{Block, Direction, pair};

/// A force of constant size in the axes of the edge before its node, like that of a jet or of a propeller: F = f_t t + f_n n. It has
/// no potential; ∂F/∂e = (f_t n − f_n t) nᵀ/ℓ.
#[derive(Debug, Clone, Copy)]
pub struct FollowerLoad {
    edge: usize,
    /// The end of the edge that it acts on.
    end: usize,
    /// f_t and f_n, N.
    force: Vector2<f64>,
}

impl FollowerLoad {
    /// The force (N) along and across the edge before `node`, at the head along and across the first edge.
    pub fn new(node: usize, force: Vector2<f64>) -> Self {
        Self { edge: node.saturating_sub(1), end: usize::from(node > 0), force }
    }
}

impl Force for FollowerLoad {
    fn name(&self) -> &'static str {
        "follower load"
    }

    fn validity(&self) -> Validity {
        Validity { range: "any motion", bounds: &[], source: "by definition" }
    }

    fn is_of_fluid(&self) -> bool {
        false
    }

    fn is_the_same_everywhere(&self) -> bool {
        true
    }

    fn is_linear(&self) -> bool {
        true // in the velocities, on which it does not depend
    }

    fn power_kind(&self) -> Option<PowerKind> {
        Some(PowerKind::Other)
    }

    fn evaluate(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut ForceAccumulator<'_>,
    ) {
        if !edges.contains(&self.edge) {
            return;
        }
        let edge = &rod.edges[self.edge];
        let (t, n) = (edge.t, edge.n());
        let mut on = EdgeForce::ZERO;
        let turned = (n * self.force.x - t * self.force.y) * (along.map_or(0.0, |along| along.q) * edge.per_length);
        on.force[self.end] = pair(-(t * self.force.x + n * self.force.y));
        on.edge[self.end] = Block::outer(-turned, pair(n));
        sums.one(self.edge - edges.start, &on);
    }
}
