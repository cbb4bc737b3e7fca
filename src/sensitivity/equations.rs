//! The linearised equations of a step, their factors, and products and solves with them and with their transpose.
//!
//! Vectors are in the order of a [`State`]: two entries per node, and the arc of a hinge. In the matrices, the equation of the
//! hinge takes the place of the first equation of node 0, as in a step. Winches couple all nodes along their cables, with the
//! same matrix in both directions.
//!
//! On fine meshes solutions are [refined](refinement).

mod refinement;
mod side_by_side;

use nalgebra::{DMatrix, Dyn, LU, Matrix2, Vector2};

use crate::error::Result;
use crate::fluid::{Force, force};
use crate::head::hinge::HingeEquation;
use crate::linear::{BandMatrix, BlockBand, BlockRow, Direction, HALF_BANDWIDTH, LinearSolver, PivotedLu};
use crate::model::{DeformedRod, Dynamics, Model};
use crate::newton;
use crate::system::{Linearisation, RankOne, State, System};

/// A solution with a larger backward error is replaced by that of the pivoted LU.
const BACKWARD_ERROR: f64 = 1e-12;

/// The derivatives of a force that couples every node with every other one, beyond the entries in the bands.
#[derive(Debug)]
struct GlobalCoupling {
    by_q: DMatrix<f64>,
    by_v: DMatrix<f64>,
    /// Factors of the complete J, or of its transpose.
    factors: Option<LU<f64, Dyn, Dyn>>,
}

impl GlobalCoupling {
    fn of(nodes: usize) -> Box<Self> {
        let zeros = || DMatrix::zeros(2 * nodes, 2 * nodes);
        Box::new(Self { by_q: zeros(), by_v: zeros(), factors: None })
    }

    /// Adds `factor` times `matrix`, or its transpose, times the node entries of `x` to `y`.
    fn add(matrix: &DMatrix<f64>, factor: f64, x: &[f64], y: &mut [f64], transposed: bool) {
        for (j, column) in matrix.column_iter().enumerate() {
            for (i, by) in column.iter().enumerate() {
                let (from, to) = if transposed { (i, j) } else { (j, i) };
                y[to] += factor * by * x[from];
            }
        }
    }
}

/// The linearised equations at a time: matrices, factors and work arrays.
#[derive(Debug)]
pub(super) struct Equations {
    direction: Direction,
    /// J without the constraint of a held head.
    matrix: BandMatrix,
    /// J with a held head.
    held: Option<BandMatrix>,
    /// ∂f/∂v, if any force acts or the material is damped.
    damping: Option<BandMatrix>,
    /// ∂f/∂a, if it differs from the lumped mass.
    inertia: Option<BandMatrix>,
    /// The derivative of forces with respect to a translation of the whole rod, for forces that depend on position.
    place: Option<Vec<Matrix2<f64>>>,
    /// The same with respect to the velocity of the whole rod, for a damped material if solutions are refined.
    drift: Option<Vec<Matrix2<f64>>>,
    /// The column sums of the derivatives of forces with respect to positions and to velocities, if solutions are refined.
    columns: Option<[Vec<Matrix2<f64>>; 2]>,
    masses: Vec<f64>,
    /// True if the relative rounding error of one solve may exceed [`refinement::FROM`].
    refines: bool,
    /// The equation of a hinge along positions, velocities and accelerations.
    hinge: Option<[HingeEquation; 3]>,
    /// The contributions of winches to the matrices, and A⁻¹ times their columns.
    winches: Vec<RankOne>,
    solved: Vec<Vec<f64>>,
    /// Couplings of every node with every other one.
    global: Option<Box<GlobalCoupling>>,
    band: BlockBand,
    /// Created on first use; `pivoted` is true if it holds the factors.
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
            damping: of(!model.forces.is_empty() || model.is_damped()),
            inertia: of(model.forces.are_inertial()),
            place: (!everywhere).then(|| vec![Matrix2::zeros(); nodes]),
            drift: None,
            columns: None,
            masses: model.rod.mass.clone(),
            refines: false,
            hinge: None,
            winches: Vec::new(),
            solved: Vec::new(),
            global: model.forces.global().map(|_| GlobalCoupling::of(nodes)),
            band: BlockBand::analyse(&matrix)?,
            lu: None,
            pivoted: false,
            residual: vec![0.0; 2 * nodes],
            product: vec![0.0; model.unknowns()],
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
        self.refines = refinement::is_needed(&dynamics.model.rod, direction);
        let nodes = self.masses.len();
        self.columns = self.refines.then(|| [0, 1].map(|_| vec![Matrix2::zeros(); nodes]));
        for (sums, along) in self.columns.iter_mut().flatten().zip([Direction::POSITIONS, Direction::VELOCITIES]) {
            write_column_sums(&dynamics.shape(state)?, along, sums);
        }
        self.drift = (self.refines && dynamics.model.is_damped()).then(|| vec![Matrix2::zeros(); nodes]);
        for (own, along) in [(&mut self.place, Direction::POSITIONS), (&mut self.drift, Direction::VELOCITIES)] {
            let Some(own) = own else { continue };
            own.fill(Matrix2::zeros());
            let bent = dynamics.shape(state)?;
            let (forces, edges) = (&bent.dynamics.model.forces, 0..bent.edges().len());
            let moving = bent.kinematics();
            forces.on_edges(&moving, Some(along), edges, |e, on| {
                (0..2).for_each(|i| own[e + i] += Matrix2::from(on.own(i)));
            });
            for tip in forces.on_tip(&moving, Some(along)) {
                own[moving.edges.len()] += tip.own;
            }
        }
        if let Some(global) = &mut self.global {
            let bent = dynamics.shape(state)?;
            if let Some(whole) = bent.dynamics.model.forces.global() {
                let moving = bent.kinematics();
                let (unknowns, flow) = (2 * moving.edges.len() + 2, Vector2::zeros());
                let (still, mut unit) = (vec![0.0; unknowns], vec![0.0; unknowns]);
                global.by_q.fill(0.0);
                global.by_v.fill(0.0);
                for j in 0..unknowns {
                    unit[j] = 1.0;
                    let mut banded = vec![0.0; unknowns];
                    force::add_banded_change(whole, &moving, [&unit, &still, &still], flow, &mut banded);
                    let column = global.by_q.data.as_mut_slice().chunks_mut(unknowns).nth(j).unwrap_or_default();
                    force::add_change(whole, &moving, [&unit, &still, &still], flow, column);
                    column.iter_mut().zip(banded).for_each(|(all, banded)| *all -= banded);
                    let column = global.by_v.data.as_mut_slice().chunks_mut(unknowns).nth(j).unwrap_or_default();
                    force::add_change(whole, &moving, [&still, &unit, &still], flow, column);
                    unit[j] = 0.0;
                }
            }
        }
        let [by_q, by_v, by_a] = [Direction::POSITIONS, Direction::VELOCITIES, Direction::ACCELERATIONS]
            .map(|direction| dynamics.hinge_equation(direction));
        self.hinge = by_q.zip(by_v).zip(by_a).map(|((q, v), a)| [q, v, a]);
        if let Some(held) = &mut self.held {
            held.clone_from(&self.matrix);
            held.prescribe(0);
            if let Some(equation) = dynamics.hinge_equation(direction) {
                equation.write(held);
            }
        }
        dynamics.couple_winches(direction);
        self.winches.clear();
        self.winches.extend_from_slice(dynamics.rank_ones());
        Ok(())
    }

    /// The block of ∂f/∂q at row `i` and its `j`-th entry, times the factor of positions in the direction.
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

    /// y = −A f_q x: −Σ (f_q)ᵢⱼ (xⱼ − xᵢ) over j ≠ i, plus the forces that depend on position.
    pub(super) fn differences(&self, x: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        self.add_along(x, y, false);
    }

    /// The transpose: adds −A (f_q)ᵀ x to y.
    pub(super) fn add_differences_transposed(&self, x: &[f64], y: &mut [f64]) {
        self.add_along(x, y, true);
    }

    fn add_along(&self, all: &[f64], sums: &mut [f64], transposed: bool) {
        let block = |i: usize, j: usize, block: &[f64; 4]| self.stiffness(i, j, block);
        let (place, factors) = (self.place.as_deref(), (-1.0, -self.direction.q));
        if transposed {
            let columns = self.columns.as_ref().map(|[by_place, _]| &by_place[..]);
            add_transposed_by_differences(&self.matrix, [place, columns], block, factors, all, sums);
        } else if let (None, Some([columns, _])) = (&self.held, &self.columns) {
            let mut own = vec![0.0; 2 * self.masses.len()];
            add_by_differences(&self.matrix, place, block, factors, all, &mut own);
            balance(&mut own, columns, -self.direction.q, all, &self.masses);
            sums.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        } else {
            add_by_differences(&self.matrix, place, block, factors, all, sums);
        }
        if let Some(global) = &self.global {
            GlobalCoupling::add(&global.by_q, -self.direction.q, all, sums, transposed);
        }
        for RankOne { column, row } in &self.winches {
            let size: f64 = row.iter().zip(all).map(|(row, x)| row * x).sum();
            sums.iter_mut().zip(column).for_each(|(sum, column)| *sum -= size * column);
        }
        if let Some([own, ..]) = &self.hinge {
            add_hinge(own, -self.direction.q, all, sums, transposed);
        }
    }

    /// f_v x, or its transpose; zero without forces and damping.
    pub(super) fn damp(&mut self, x: &[f64], transposed: bool) -> &[f64] {
        let nodes = 2 * self.matrix.rows().len();
        self.product.fill(0.0);
        match (&self.damping, &self.drift) {
            (Some(damping), Some(drift)) => {
                let (block, product) = (|_: usize, _: usize, block: &[f64; 4]| *block, &mut self.product[..]);
                if transposed {
                    let columns = self.columns.as_ref().map(|[_, by_drift]| &by_drift[..]);
                    add_transposed_by_differences(damping, [Some(drift), columns], block, (1.0, 1.0), x, product);
                } else {
                    add_by_differences(damping, Some(drift), block, (1.0, 1.0), x, product);
                    if let (None, Some([_, columns])) = (&self.held, &self.columns) {
                        balance(product, columns, 1.0, x, &self.masses);
                    }
                }
            }
            (Some(damping), None) => damping.multiply(&x[..nodes], &mut self.product[..nodes], transposed),
            (None, _) => {}
        }
        if let Some(global) = &self.global {
            GlobalCoupling::add(&global.by_v, 1.0, x, &mut self.product, transposed);
        }
        if let Some([_, own, _]) = &self.hinge {
            add_hinge(own, 1.0, x, &mut self.product, transposed);
        }
        &self.product
    }

    /// f_a x of the nodes, without their lumped masses; the remainder is zero without forces of inertia.
    pub(super) fn accelerate(&mut self, x: &[f64]) -> &[f64] {
        let nodes = 2 * self.matrix.rows().len();
        self.product.fill(0.0);
        if let Some(inertia) = &self.inertia {
            inertia.multiply(&x[..nodes], &mut self.product[..nodes], false);
        }
        &self.product
    }

    /// Adds f_a x to y.
    fn add_inertia(&mut self, masses: &[f64], x: &[f64], y: &mut [f64]) {
        if self.inertia.is_some() {
            y.iter_mut().zip(self.accelerate(x)).for_each(|(y, by)| *y += by);
        } else {
            for (k, mass) in masses.iter().enumerate() {
                y[2 * k] += mass * x[2 * k];
                y[2 * k + 1] += mass * x[2 * k + 1];
            }
        }
        if let Some([.., own]) = &self.hinge {
            y[2 * masses.len()] += own.own * x[2 * masses.len()];
        }
    }

    /// Replaces `rhs` by f_a⁻¹ rhs; f_a is symmetric.
    pub(super) fn divide_by_inertia(&mut self, masses: &[f64], rhs: &mut [f64]) -> Result<()> {
        if let Some([.., own]) = &self.hinge {
            rhs[2 * masses.len()] /= own.own;
        }
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
        self.band.solve(&mut rhs[..2 * masses.len()]);
        Ok(())
    }

    /// Factors, and replaces the first right-hand side by A⁻¹ rhs, or by A⁻ᵀ rhs. This first solve checks the factors of the
    /// band; if they are inaccurate, the pivoted LU is used.
    ///
    /// # Errors
    /// [`Error::Derivative`](crate::Error::Derivative) if refinement does not converge because the mesh is too fine.
    pub(super) fn factor(&mut self, rhs: &mut [f64], transposed: bool) -> Result<()> {
        let given = if self.refines { rhs.to_vec() } else { Vec::new() };
        self.factor_alone(rhs, transposed)?;
        self.refine(&given, rhs, transposed)
    }

    /// Replaces `rhs` by A⁻¹ rhs, or by A⁻ᵀ rhs; [`factor`](Self::factor) must be called first.
    ///
    /// # Errors
    /// Errors of [`factor`](Self::factor).
    pub(super) fn solve(&mut self, rhs: &mut [f64], transposed: bool) -> Result<()> {
        let given = if self.refines { rhs.to_vec() } else { Vec::new() };
        self.solve_alone(rhs, transposed);
        self.refine(&given, rhs, transposed)
    }

    fn factor_alone(&mut self, rhs: &mut [f64], transposed: bool) -> Result<()> {
        self.pivoted = false;
        self.with_hinge_first(rhs, |own, rhs| own.factor_band(rhs, transposed))?;
        self.solved.resize_with(self.winches.len(), Vec::new);
        let mut solved = std::mem::take(&mut self.solved);
        for (RankOne { column, .. }, solved) in self.winches.iter().zip(&mut solved) {
            solved.clone_from(column);
        }
        solved.iter_mut().for_each(|solved| self.solve_band(solved, transposed));
        self.solved = solved;
        newton::woodbury(&self.winches, &self.solved, rhs);
        Ok(())
    }

    fn solve_alone(&mut self, rhs: &mut [f64], transposed: bool) {
        self.with_hinge_first(rhs, |own, rhs| own.solve_band(rhs, transposed));
        newton::woodbury(&self.winches, &self.solved, rhs);
    }

    /// Calls `solve` with the entries of `rhs` in the order of the band, where the entry of a hinge replaces the first entry of
    /// node 0.
    fn with_hinge_first<T>(&mut self, rhs: &mut [f64], solve: impl FnOnce(&mut Self, &mut [f64]) -> T) -> T {
        let hinged = self.hinge.is_some();
        let (band, arc) = rhs.split_at_mut(2 * self.matrix.rows().len());
        if let (true, Some(arc)) = (hinged, arc.first()) {
            (band[0], band[1]) = (*arc, 0.0);
        }
        let done = solve(self, band);
        if let (true, Some(arc)) = (hinged, arc.first_mut()) {
            *arc = std::mem::take(&mut band[0]);
        }
        done
    }

    fn factor_band(&mut self, rhs: &mut [f64], transposed: bool) -> Result<()> {
        if let Some(global) = &mut self.global {
            let matrix = self.held.as_ref().unwrap_or(&self.matrix);
            let (unknowns, held) = (matrix.unknowns(), if self.held.is_some() { 2 } else { 0 });
            let Direction { q, v, .. } = self.direction;
            let whole = DMatrix::from_fn(unknowns, unknowns, |i, j| {
                let coupled = if i.min(j) < held { 0.0 } else { q * global.by_q[(i, j)] + v * global.by_v[(i, j)] };
                matrix.entry(i, j) + coupled
            });
            global.factors = Some(if transposed { whole.transpose() } else { whole }.lu());
            self.solve_band(rhs, transposed);
            return Ok(());
        }
        self.residual.copy_from_slice(rhs);
        self.band.factor(self.held.as_ref().unwrap_or(&self.matrix))?;
        self.solve_band(rhs, transposed);
        let matrix = self.held.as_ref().unwrap_or(&self.matrix);
        let product = &mut self.product[..rhs.len()];
        matrix.multiply(rhs, product, transposed);
        let diagonal =
            self.matrix.rows().iter().fold(0.0, |max: f64, row| max.max(row[2][0].abs()).max(row[2][3].abs()));
        product.iter_mut().zip(&self.residual).for_each(|(product, rhs)| *product -= rhs);
        if largest(product) <= BACKWARD_ERROR * (diagonal * largest(rhs) + largest(&self.residual)) {
            return Ok(());
        }
        let lu = match &mut self.lu {
            Some(lu) => lu,
            none => none.insert(PivotedLu::analyse(matrix)?),
        };
        LinearSolver::factor(lu, matrix)?;
        self.pivoted = true;
        rhs.copy_from_slice(&self.residual);
        self.solve_band(rhs, transposed);
        Ok(())
    }

    fn solve_band(&mut self, rhs: &mut [f64], transposed: bool) {
        if let Some(factors) = self.global.as_ref().and_then(|global| global.factors.as_ref()) {
            let mut x = DMatrix::from_column_slice(rhs.len(), 1, rhs);
            let solved = factors.solve_mut(&mut x);
            rhs.copy_from_slice(x.as_slice());
            if !solved {
                rhs.fill(f64::NAN);
            }
            return;
        }
        match (&mut self.lu, transposed) {
            (Some(lu), false) if self.pivoted => lu.solve(rhs),
            (Some(lu), true) if self.pivoted => lu.solve_transposed(rhs),
            (_, false) => self.band.solve(rhs),
            (_, true) => self.band.solve_transposed(rhs),
        }
    }
}

/// The largest modulus, or NaN if any entry is NaN.
fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |max: f64, x| if max.is_nan() || x.abs() <= max { max } else { x.abs() })
}

/// Adds `factor` times the derivatives of the equation of a hinge, and of the equations of node 1 with respect to its arc, times
/// `x` to `y`, or their transpose. The hinge moves with node 0, so its equation depends on the difference of both nodes; for node
/// 0, which is held by the hinge, the transpose adds nothing.
fn add_hinge(own: &HingeEquation, factor: f64, x: &[f64], y: &mut [f64], transposed: bool) {
    let (Some(&arc), Some(&[x_0, y_0, x_1, y_1])) = (x.last(), x.first_chunk()) else { return };
    let node = if transposed { [x_1, y_1] } else { [x_1 - x_0, y_1 - y_0] };
    let [by_node, by_arc] = if transposed { [own.by_arc, own.by_node] } else { [own.by_node, own.by_arc] };
    let sum = own.own * arc + by_node.x * node[0] + by_node.y * node[1];
    if let Some(last) = y.last_mut() {
        *last += factor * sum;
    }
    if let Some([x, y]) = y.get_mut(2..4).and_then(|node| node.first_chunk_mut()) {
        (*x, *y) = (*x + factor * by_arc.x * arc, *y + factor * by_arc.y * arc);
    }
}

/// Adds to y `factor` times a banded matrix times x, plus `rest` times the blocks `place` times x. The off-diagonal blocks of the
/// banded matrix are `block` of those of `matrix`, and its diagonal is minus their sum, so its terms have the size of differences
/// of x between nodes.
fn add_by_differences(
    matrix: &BandMatrix,
    place: Option<&[Matrix2<f64>]>,
    block: impl Fn(usize, usize, &[f64; 4]) -> [f64; 4],
    (factor, rest): (f64, f64),
    x: &[f64],
    y: &mut [f64],
) {
    let nodes = matrix.rows().len();
    let (x, y) = (&x.as_chunks::<2>().0[..nodes], &mut y.as_chunks_mut::<2>().0[..nodes]);
    for (i, row) in matrix.rows().iter().enumerate() {
        for (j, own) in neighbours(i, row, nodes) {
            let [a, b, c, d] = block(i, j, own);
            let by = [x[j][0] - x[i][0], x[j][1] - x[i][1]];
            y[i] = [y[i][0] + factor * (a * by[0] + b * by[1]), y[i][1] + factor * (c * by[0] + d * by[1])];
        }
        if let Some(place) = place {
            let moved = place[i] * Vector2::from(x[i]) * rest;
            y[i] = [y[i][0] + moved.x, y[i][1] + moved.y];
        }
    }
}

/// The same with the transpose. If the column sums `columns` of external forces are known, its terms also have the size of
/// differences of x, and a motion of the whole rod is free of the rounding errors of elastic forces, whose sum is zero.
fn add_transposed_by_differences(
    matrix: &BandMatrix,
    [place, columns]: [Option<&[Matrix2<f64>]>; 2],
    block: impl Fn(usize, usize, &[f64; 4]) -> [f64; 4],
    (factor, rest): (f64, f64),
    x: &[f64],
    y: &mut [f64],
) {
    let nodes = matrix.rows().len();
    let (x, y) = (&x.as_chunks::<2>().0[..nodes], &mut y.as_chunks_mut::<2>().0[..nodes]);
    for (i, row) in matrix.rows().iter().enumerate() {
        for (j, own) in neighbours(i, row, nodes) {
            let [a, b, c, d] = block(i, j, own);
            let with = if columns.is_some() { [x[i][0] - x[j][0], x[i][1] - x[j][1]] } else { x[i] };
            let by = [a * with[0] + c * with[1], b * with[0] + d * with[1]];
            y[j] = [y[j][0] + factor * by[0], y[j][1] + factor * by[1]];
            if columns.is_none() {
                y[i] = [y[i][0] - factor * by[0], y[i][1] - factor * by[1]];
            }
        }
        // The column sums already contain `place`.
        if let Some(place) = columns.or(place) {
            let moved = place[i].tr_mul(&Vector2::from(x[i])) * rest;
            y[i] = [y[i][0] + moved.x, y[i][1] + moved.y];
        }
    }
}

/// Distributes over the nodes, in proportion to their `masses`, the difference between the sum of the forces y and `factor` times
/// the sum of the external forces, with column sums `columns`, for nodes that move by x. Elastic forces have zero sum, so this
/// removes their rounding error from the motion of the whole rod.
fn balance(y: &mut [f64], columns: &[Matrix2<f64>], factor: f64, x: &[f64], masses: &[f64]) {
    let (x, y) = (x.as_chunks::<2>().0, y.as_chunks_mut::<2>().0);
    let outside: Vector2<f64> = columns.iter().zip(x).map(|(column, x)| column * Vector2::from(*x)).sum();
    let sum: Vector2<f64> = y.iter().zip(masses).map(|(y, _)| Vector2::from(*y)).sum();
    let excess = (sum - outside * factor) / masses.iter().sum::<f64>();
    for (y, mass) in y.iter_mut().zip(masses) {
        *y = [y[0] - mass * excess.x, y[1] - mass * excess.y];
    }
}

/// Writes the change of the total external force when a node moves along a direction: the column sums of the derivatives of
/// forces.
fn write_column_sums(bent: &DeformedRod<'_>, along: Direction, sums: &mut [Matrix2<f64>]) {
    sums.fill(Matrix2::zeros());
    let (forces, moving) = (&bent.dynamics.model.forces, bent.kinematics());
    forces.on_edges(&moving, Some(along), 0..moving.edges.len(), |e, on| {
        for i in 0..2 {
            let edge = Matrix2::from(on.edge(i));
            sums[e + i] += Matrix2::from(on.own(i));
            sums[e] -= edge;
            sums[e + 1] += edge;
        }
    });
    for tip in forces.on_tip(&moving, Some(along)) {
        let last = moving.edges.len();
        let [before, inner, own] = tip.blocks();
        for (k, block) in [(last.checked_sub(2), before), (Some(last - 1), inner), (Some(last), own)] {
            if let Some(k) = k {
                sums[k] += block;
            }
        }
    }
}

/// The off-diagonal blocks of row `i`, with their column indices.
#[inline]
fn neighbours(i: usize, row: &BlockRow, nodes: usize) -> impl Iterator<Item = (usize, &[f64; 4])> {
    let inside =
        move |(j, block): (usize, _)| (i + j).checked_sub(2).filter(|j| *j != i && *j < nodes).map(|j| (j, block));
    row.iter().enumerate().filter_map(inside)
}
