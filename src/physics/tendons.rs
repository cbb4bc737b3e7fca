//! Tendons: cables along the rod, offset from its centreline, that pull its edges together and bend its joints.
//!
//! A cable at the distance d to the left of the rod, from node a to node b, is shorter than the rod by
//! 2 d tan(θ_k/2) = d κ_k at every joint that it passes. Its length is Λ = Σ ℓ_e − d Σ κ_k, exactly. A tension T does the
//! work −T dΛ: it adds T to the tension of the edges, a [`Force`], and an active moment T d to the joints, see
//! [`ActiveMoments`](crate::model::ActiveMoments). A tendon that begins where a held head or a body holds the rod is
//! attached to it, and passes the half-cell joint there.
//!
//! A winch prescribes a length instead, through the stiffness of the cable: T = f(Λ − Λ_c). T then depends on the
//! motion of all nodes along the cable, and Newton's matrix has a part that couples them all, f′ ∂Λ/∂x ∂Λ/∂xᵀ, see
//! [`RankOne`](crate::system::RankOne).

use std::ops::Range;
use std::sync::Arc;

use nalgebra::Vector2;

use crate::fluid::force::{EdgeForce, Force, ForceAccumulator, Kinematics, PowerKind};
use crate::fluid::validity::Validity;
use crate::head::{Sample, Signal};
use crate::linear::{Block, Direction, pair};
use crate::rod::{Edge, Rod, bend, node};

/// Maximum number of tendons of a rod.
pub const MAX_TENDONS: usize = 4;

/// A tendon.
#[derive(Debug, Clone, PartialEq)]
pub struct Tendon {
    /// Distance d from the centreline, m; positive to the left of the rod, from head to tip.
    pub offset: f64,
    /// The edges along which it runs.
    pub edges: Range<usize>,
    /// The joints that it passes.
    pub joints: Range<usize>,
    /// The tension or the winch that pulls it.
    pub pull: Pull,
}

/// What pulls a tendon.
#[derive(Debug, Clone, PartialEq)]
pub enum Pull {
    /// A tension, N, without the start ramp and without the host's contribution.
    Tension(Signal),
    /// A winch.
    Winch(Winch),
}

/// A winch that prescribes the length of a tendon through its stiffness.
#[derive(Debug, Clone, PartialEq)]
pub struct Winch {
    /// Stiffness k of the cable, N/m.
    pub stiffness: f64,
    /// Unstretched length Λ_c of the cable, m, without the start ramp, which leads there from the straight rod, and
    /// without the host's contribution.
    pub length: Signal,
    /// The stretch w over which the cable takes up its slack, m.
    pub take_up: f64,
}

impl Winch {
    /// The tension T (N) of a cable stretched by x, and dT/dx: zero below x = 0, T = k x²/2w up to w, and
    /// T = k (x − w/2) beyond.
    pub fn tension(&self, stretch: f64) -> [f64; 2] {
        let Self { stiffness, take_up, .. } = *self;
        let part = (stretch / take_up).clamp(0.0, 1.0);
        let tension = if part > 0.0 { stiffness * part * (stretch - 0.5 * part * take_up) } else { 0.0 };
        [tension, stiffness * part]
    }
}

impl Tendon {
    /// The tendon from `xi[0]` to `xi[1]` of `rod`, each rounded to the nearest node; `None` if there is no joint in
    /// between. `pull` returns what pulls it, given its length (m) along the straight rod.
    pub fn along(rod: &Rod, offset: f64, xi: [f64; 2], pull: impl FnOnce(f64) -> Pull) -> Option<Self> {
        let last = rod.nodes - 1;
        let [from, to] = xi.map(|xi| rod.front + (xi * (last - rod.front) as f64).round() as usize);
        let first = if from == rod.front { rod.first_joint.max(from) } else { from + 1 };
        (first < to).then(|| Self {
            offset,
            edges: from..to,
            joints: first..to,
            pull: pull(rest_length(rod, from..to)),
        })
    }

    /// The winch that pulls it, if there is one.
    pub fn winch(&self) -> Option<&Winch> {
        match &self.pull {
            Pull::Tension(_) => None,
            Pull::Winch(winch) => Some(winch),
        }
    }

    /// The tension (N), or the length (m) that a winch prescribes.
    pub fn signal(&self) -> &Signal {
        match &self.pull {
            Pull::Tension(signal) | Pull::Winch(Winch { length: signal, .. }) => signal,
        }
    }

    /// Σ ℓ_e of its edges, m.
    pub fn edge_length(&self, edges: &[Edge]) -> f64 {
        edges[self.edges.clone()].iter().map(|edge| edge.length).sum()
    }

    /// The length Λ (m) along these `edges`, at joint curvatures `kappa`.
    pub fn length(&self, edges: &[Edge], kappa: &[f64]) -> f64 {
        self.edge_length(edges) - self.offset * kappa[self.joints.clone()].iter().sum::<f64>()
    }

    /// Calls `add` with the contributions to ∂Λ/∂x at each node, at joint curvatures `kappa`.
    pub fn visit_length_slopes(&self, edges: &[Edge], kappa: &[f64], mut add: impl FnMut(usize, Vector2<f64>)) {
        self.visit_slopes(edges, &mut add);
        for k in self.joints.clone() {
            let size = self.offset * bend::curvature_per_turning(kappa[k]);
            // A joint turns by the rotation of its edge minus that of the edge before.
            let around = [Some((k, -size)), k.checked_sub(1).map(|before| (before, size))];
            for (e, size) in around.into_iter().flatten() {
                let across = edges[e].n() * (size * edges[e].per_length);
                add(e, -across);
                add(e + 1, across);
            }
        }
    }

    /// Calls `add` with −t at the start and t at the end of each of its edges, the contributions to ∂(Σ ℓ_e)/∂x.
    pub fn visit_slopes(&self, edges: &[Edge], mut add: impl FnMut(usize, Vector2<f64>)) {
        for e in self.edges.clone() {
            add(e, -edges[e].t);
            add(e + 1, edges[e].t);
        }
    }

    /// The rate of Σ ℓ_e (m/s) at node velocities `v`.
    pub fn edge_length_rate(&self, edges: &[Edge], v: &[f64]) -> f64 {
        self.edges.clone().map(|e| edges[e].t.dot(&(node(v, e + 1) - node(v, e)))).sum()
    }
}

/// The rest length (m) of these edges of `rod`.
pub(crate) fn rest_length(rod: &Rod, edges: Range<usize>) -> f64 {
    edges.map(|e| rod.cells[e].rest).sum()
}

/// The tension `pull` (N), or zero if it is negative: a cable does not push.
pub(crate) fn slack_below_zero(pull: Sample) -> Sample {
    if pull.value > 0.0 || pull.value == 0.0 && pull.rate > 0.0 { pull } else { Sample::default() }
}

/// The tendons of a rod, and the force of their tension on the edges: F = −T t on the end of an edge, T t on its start,
/// with ∂(T t)/∂e = T n nᵀ/ℓ.
#[derive(Debug, Clone, Default)]
pub struct Tendons(Arc<[Tendon]>);

impl Tendons {
    /// These tendons, at most [`MAX_TENDONS`].
    pub fn new(tendons: Vec<Tendon>) -> Self {
        Self(tendons.into())
    }
}

#[cfg(feature = "faer")]
impl Tendons {
    /// An upper bound of what taut winches add to the largest ω² (1/s²) of the straight `rod`: Σ k Σ |∂Λ/∂x|²/m over
    /// the free nodes.
    pub(crate) fn stiffness_over_inertia(&self, rod: &Rod) -> f64 {
        let edges: Vec<Edge> = (0..rod.nodes - 1).map(|e| Edge::along(Vector2::x(), rod.cells[e].rest)).collect();
        let straight = vec![0.0; rod.nodes];
        let of = |tendon: &Tendon| {
            let mut slopes = vec![Vector2::zeros(); rod.nodes];
            tendon.visit_length_slopes(&edges, &straight, |k, slope| slopes[k] += slope);
            let free = slopes.iter().zip(&rod.mass).skip(usize::from(rod.first_joint == 0));
            let sum: f64 = free.map(|(slope, mass)| slope.norm_squared() / mass).sum();
            tendon.winch().map_or(0.0, |winch| winch.stiffness * sum)
        };
        self.iter().map(of).sum()
    }
}

impl std::ops::Deref for Tendons {
    type Target = [Tendon];

    fn deref(&self) -> &[Tendon] {
        &self.0
    }
}

impl Force for Tendons {
    fn name(&self) -> &'static str {
        "tendons"
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
        Some(PowerKind::Drive)
    }

    fn evaluate(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut ForceAccumulator<'_>,
    ) {
        for (tendon, tension) in self.iter().zip(rod.tensions).filter(|(_, tension)| **tension != 0.0) {
            let shared = tendon.edges.start.max(edges.start)..tendon.edges.end.min(edges.end);
            for e in shared {
                let edge = &rod.edges[e];
                let slope = Block::outer(
                    edge.n() * (tension * along.map_or(0.0, |along| along.q) * edge.per_length),
                    pair(edge.n()),
                );
                let pull = pair(edge.t * *tension);
                let on = EdgeForce { force: [-pull, pull], own: [Block::ZERO; 2], edge: [Block::ZERO - slope, slope] };
                sums.one(e - edges.start, &on);
            }
        }
    }
}
