//! The linearised equations of a step, their factors, and their products and solves in both directions.

use nalgebra::{Matrix2, Vector2};

use crate::error::Result;
use crate::fluid::Force;
use crate::linear::{BandMatrix, BlockBand, BlockRow, Direction, HALF_BANDWIDTH, LinearSolver, PivotedLu};
use crate::model::{Dynamics, Model};
use crate::system::{Linearisation, State};

/// A solution with a larger backward error comes from the pivoted LU instead of the block band's.
const BACKWARD_ERROR: f64 = 1e-12;

/// The linearised equations at a time: matrices, factors and room to work in.
#[derive(Debug)]
pub(super) struct Equations {
    direction: Direction,
    /// J, as if nothing held the head.
    matrix: BandMatrix,
    /// J of a held head.
    held: Option<BandMatrix>,
    /// ∂f/∂v, where any force acts or the material is damped.
    damping: Option<BandMatrix>,
    /// ∂f/∂a, if it differs from the lumped mass.
    inertia: Option<BandMatrix>,
    /// The derivative of forces by a translation of the whole rod, for forces that depend on position.
    place: Option<Vec<Matrix2<f64>>>,
    band: BlockBand,
    /// Analysed when it is first needed; `pivoted`: it has the factors.
    lu: Option<PivotedLu>,
    pivoted: bool,
    residual: Vec<f64>,
    product: Vec<f64>,
}

impl Equations {
    pub(super) fn new(model: &Model) -> Result<Self> {
        let nodes = model.rod.nodes;
        let matrix = BandMatrix::new(nodes);
        let of = |there: bool| there.then(|| matrix.clone());
        let everywhere = model.layers.is_none() && model.forces.iter().all(Force::is_the_same_everywhere);
        Ok(Self {
            direction: Direction::POSITIONS,
            held: of(model.head.is_some()),
            damping: of(!model.forces.is_empty() || model.rod.damping.is_some()),
            inertia: of(model.forces.are_inertial()),
            place: (!everywhere).then(|| vec![Matrix2::zeros(); nodes]),
            band: BlockBand::analyse(&matrix)?,
            lu: None,
            pivoted: false,
            residual: vec![0.0; 2 * nodes],
            product: vec![0.0; 2 * nodes],
            matrix,
        })
    }

    pub(super) fn assemble(&mut self, dynamics: &mut Dynamics, state: &State, direction: Direction) -> Result<()> {
        self.direction = direction;
        let along = [
            (self.damping.as_mut(), Direction::VELOCITIES),
            (self.inertia.as_mut(), Direction::ACCELERATIONS),
            (Some(&mut self.matrix), direction),
        ];
        for (matrix, direction) in along {
            if let Some(matrix) = matrix {
                dynamics.unconstrained(state, &mut self.residual, Some(Linearisation { matrix, direction }))?;
            }
        }
        if let Some(place) = &mut self.place {
            place.fill(Matrix2::zeros());
            let bent = dynamics.shape(state)?;
            let (forces, edges) = (&bent.dynamics.model.forces, 0..bent.edges().len());
            let moving = bent.kinematics();
            forces.on_edges(&moving, Some(Direction::POSITIONS), edges, |e, on| {
                (0..2).for_each(|i| place[e + i] += Matrix2::from(on.own(i)));
            });
            for tip in forces.on_tip(&moving, Some(Direction::POSITIONS)) {
                place[moving.edges.len()] += tip.own;
            }
        }
        if let Some(held) = &mut self.held {
            held.clone_from(&self.matrix);
            held.prescribe(0);
        }
        Ok(())
    }

    /// The block of ∂f/∂q at row `i` and its `j`-th entry, times the direction's part of the positions.
    #[inline]
    fn stiffness(&self, i: usize, j: usize, block: &[f64; 4]) -> [f64; 4] {
        let mut block = *block;
        let others = [(&self.damping, self.direction.v), (&self.inertia, self.direction.a)];
        for (matrix, factor) in others.into_iter().filter_map(|(matrix, factor)| Some((matrix.as_ref()?, factor))) {
            let other = &matrix.rows()[i][j + HALF_BANDWIDTH - i];
            block.iter_mut().zip(other).for_each(|(block, other)| *block -= factor * other);
        }
        block
    }

    /// y = −A f_q x: −Σ (f_q)ᵢⱼ (xⱼ − xᵢ) over j ≠ i, and what moves with the place.
    pub(super) fn differences(&self, x: &[f64], y: &mut [f64]) {
        let x = x.as_chunks::<2>().0;
        for (i, (row, y)) in self.matrix.rows().iter().zip(y.as_chunks_mut::<2>().0).enumerate() {
            *y = [0.0; 2];
            for (j, block) in neighbours(i, row, x.len()) {
                let [a, b, c, d] = self.stiffness(i, j, block);
                let by = [x[j][0] - x[i][0], x[j][1] - x[i][1]];
                *y = [y[0] - (a * by[0] + b * by[1]), y[1] - (c * by[0] + d * by[1])];
            }
            if let Some(place) = &self.place {
                let moved = place[i] * Vector2::from(x[i]) * self.direction.q;
                *y = [y[0] - moved.x, y[1] - moved.y];
            }
        }
    }

    /// Its transpose: adds −A (f_q)ᵀ x to y.
    pub(super) fn add_differences_transposed(&self, x: &[f64], y: &mut [f64]) {
        let (x, y) = (x.as_chunks::<2>().0, y.as_chunks_mut::<2>().0);
        for (i, row) in self.matrix.rows().iter().enumerate() {
            for (j, block) in neighbours(i, row, x.len()) {
                let [a, b, c, d] = self.stiffness(i, j, block);
                let by = [a * x[i][0] + c * x[i][1], b * x[i][0] + d * x[i][1]];
                y[j] = [y[j][0] - by[0], y[j][1] - by[1]];
                y[i] = [y[i][0] + by[0], y[i][1] + by[1]];
            }
            if let Some(place) = &self.place {
                let moved = place[i].tr_mul(&Vector2::from(x[i])) * self.direction.q;
                y[i] = [y[i][0] - moved.x, y[i][1] - moved.y];
            }
        }
    }

    /// f_v x, or its transpose; zero without forces and damping.
    pub(super) fn damp(&mut self, x: &[f64], transposed: bool) -> &[f64] {
        match &self.damping {
            Some(damping) => damping.multiply(x, &mut self.product, transposed),
            None => self.product.fill(0.0),
        }
        &self.product
    }

    /// Replaces `rhs` by f_a⁻¹ rhs, where f_a is symmetric.
    pub(super) fn divide_by_inertia(&mut self, masses: &[f64], rhs: &mut [f64]) -> Result<()> {
        let Some(inertia) = &self.inertia else {
            for (k, mass) in masses.iter().enumerate() {
                rhs[2 * k] /= mass;
                rhs[2 * k + 1] /= mass;
            }
            return Ok(());
        };
        let mut inertia = inertia.clone();
        if self.held.is_some() {
            inertia.prescribe(0);
        }
        self.band.factor(&inertia)?;
        self.band.solve(rhs);
        Ok(())
    }

    /// Factors, and replaces the first right-hand side by A⁻¹ rhs, or by A⁻ᵀ rhs: so it is known that the band's
    /// factors are good, or the pivoted ones are taken.
    pub(super) fn factor(&mut self, rhs: &mut [f64], transposed: bool) -> Result<()> {
        self.pivoted = false;
        self.residual.copy_from_slice(rhs);
        self.band.factor(self.held.as_ref().unwrap_or(&self.matrix))?;
        self.solve(rhs, transposed);
        let matrix = self.held.as_ref().unwrap_or(&self.matrix);
        matrix.multiply(rhs, &mut self.product, transposed);
        let largest = |values: &[f64]| {
            values.iter().fold(0.0, |max: f64, x| if max.is_nan() || x.abs() <= max { max } else { x.abs() })
        };
        let diagonal =
            self.matrix.rows().iter().fold(0.0, |max: f64, row| max.max(row[2][0].abs()).max(row[2][3].abs()));
        self.product.iter_mut().zip(&self.residual).for_each(|(product, rhs)| *product -= rhs);
        if largest(&self.product) <= BACKWARD_ERROR * (diagonal * largest(rhs) + largest(&self.residual)) {
            return Ok(());
        }
        let lu = match &mut self.lu {
            Some(lu) => lu,
            none => none.insert(PivotedLu::analyse(matrix)?),
        };
        LinearSolver::factor(lu, matrix)?;
        self.pivoted = true;
        rhs.copy_from_slice(&self.residual);
        self.solve(rhs, transposed);
        Ok(())
    }

    pub(super) fn solve(&mut self, rhs: &mut [f64], transposed: bool) {
        match (&mut self.lu, transposed) {
            (Some(lu), false) if self.pivoted => lu.solve(rhs),
            (Some(lu), true) if self.pivoted => lu.solve_transposed(rhs),
            (_, false) => self.band.solve(rhs),
            (_, true) => self.band.solve_transposed(rhs),
        }
    }
}

/// The off-diagonal blocks of row `i`, with their columns.
#[inline]
fn neighbours(i: usize, row: &BlockRow, nodes: usize) -> impl Iterator<Item = (usize, &[f64; 4])> {
    let inside =
        move |(j, block): (usize, _)| (i + j).checked_sub(2).filter(|j| *j != i && *j < nodes).map(|j| (j, block));
    row.iter().enumerate().filter_map(inside)
}
