//! Loads that rotate with the rod.

use std::ops::Range;

use nalgebra::Vector2;

use crate::fluid::force::{EdgeForce, Force, ForceAccumulator, Kinematics, PowerKind};
use crate::fluid::validity::Validity;
use crate::linear::{Block, Direction, pair};

/// A load that rotates with an edge.
#[derive(Debug, Clone, Copy)]
struct FollowerLoad {
    edge: usize,
    /// The end of the edge on which it acts.
    end: usize,
    /// f_t and f_n, N.
    force: Vector2<f64>,
}

/// Follower forces: constant forces in the axes of the edges before their nodes, such as jets or propellers,
/// F = f_t t + f_n n. They have no potential; ∂F/∂e = (f_t n − f_n t) nᵀ/ℓ.
#[derive(Debug, Clone)]
pub struct FollowerLoads {
    /// Sorted by edge.
    loads: Vec<FollowerLoad>,
}

impl FollowerLoads {
    /// Forces (N) along and across the edge before each node; at the head, along and across the first edge.
    pub fn new(at_nodes: impl IntoIterator<Item = (usize, Vector2<f64>)>) -> Self {
        let load = |(node, force): (usize, _)| FollowerLoad {
            edge: node.saturating_sub(1),
            end: usize::from(node > 0),
            force,
        };
        let mut loads: Vec<_> = at_nodes.into_iter().map(load).collect();
        loads.sort_by_key(|load| load.edge);
        Self { loads }
    }
}

impl Force for FollowerLoads {
    fn name(&self) -> &'static str {
        "follower loads"
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
        let first = self.loads.partition_point(|load| load.edge < edges.start);
        for load in self.loads[first..].iter().take_while(|load| load.edge < edges.end) {
            let edge = &rod.edges[load.edge];
            let (t, n) = (edge.t, edge.n());
            let mut on = EdgeForce::ZERO;
            let turned = (n * load.force.x - t * load.force.y) * (along.map_or(0.0, |along| along.q) * edge.per_length);
            on.force[load.end] = pair(-(t * load.force.x + n * load.force.y));
            on.edge[load.end] = Block::outer(-turned, pair(n));
            sums.one(load.edge - edges.start, &on);
        }
    }
}
