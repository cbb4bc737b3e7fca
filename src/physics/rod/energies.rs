//! Sums over a moving rod: energies, momentum, the power of its actuation. Generic over one case and several SIMD
//! lanes.

use super::{Cell, Edge, EdgeValues};
use crate::linear::{Pair, Real};

/// A moving rod. Slices have one entry per node, except for edges and cells.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MovingRod<'a, T> {
    /// Rest length and axial stiffness of each edge.
    pub cells: &'a EdgeValues<Cell<T>>,
    /// Edges.
    pub edges: &'a [Edge<T>],
    /// Mass, kg.
    pub mass: &'a [T],
    /// Positions, m.
    pub q: &'a [[T; 2]],
    /// Velocities, m/s.
    pub v: &'a [[T; 2]],
    /// Curvature κ.
    pub kappa: &'a [T],
    /// Natural curvature κ̄.
    pub natural: &'a [T],
    /// dκ̄/dt, 1/s.
    pub natural_rate: &'a [T],
    /// Moment conjugate to κ, N m.
    pub moment: &'a [T],
}

/// Sums over a moving rod.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RodSums<T: Real = f64> {
    /// Bending energy Σ ½ m (κ − κ̄), J.
    pub bending: T,
    /// Stretching energy, J.
    pub stretching: T,
    /// Kinetic energy, J.
    pub kinetic: T,
    /// Power of the changing natural curvature, −Σ m dκ̄/dt, W.
    pub actuation: T,
    /// Σ of mass times position, kg m.
    pub moment_of_mass: T::Pair,
    /// Momentum, N s.
    pub momentum: T::Pair,
    /// Largest |ℓ/ℓ₀ − 1| of an edge.
    pub strain: T,
}

impl<T: Real> RodSums<T> {
    /// The sums over `rod`; `zero` selects the number type.
    #[inline(always)]
    pub fn of(rod: &MovingRod<'_, T>, zero: T) -> Self {
        let none = T::Pair::new([zero; 2]);
        let mut sums = Self {
            bending: zero,
            stretching: zero,
            kinetic: zero,
            actuation: zero,
            moment_of_mass: none,
            momentum: none,
            strain: zero,
        };
        let half = zero.like(0.5);
        let joints = rod.kappa.iter().zip(rod.natural).zip(rod.natural_rate).zip(rod.moment);
        for (((kappa, natural), rate), moment) in joints {
            sums.bending += half * *moment * (*kappa - *natural);
            sums.actuation = sums.actuation - *moment * *rate;
        }
        for ((mass, q), v) in rod.mass.iter().zip(rod.q).zip(rod.v) {
            let v = T::Pair::new(*v);
            let [x, y] = (v * v).to_array();
            sums.moment_of_mass += T::Pair::new(*q) * *mass;
            sums.kinetic += half * *mass * (x + y);
            sums.momentum += v * *mass;
        }
        for (edge, cell) in rod.edges.iter().zip(rod.cells.iter()) {
            sums.strain = sums.strain.larger((edge.length / cell.rest - zero.like(1.0)).abs());
            sums.stretching += cell.energy(edge);
        }
        sums
    }
}
