//! The matrix of the chain form and its elimination from the tip to the head.

use std::ops::{Add, Mul, Sub};

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::PivotedBand;

/// Unknowns of a node and of the edge that starts there: x, y, M, F_x, F_y, θ; the last node has the first three.
pub const UNKNOWNS_PER_NODE: usize = 6;

/// Largest backward error allowed in a solution by elimination: Newton's method then gains at least six digits per iteration, and
/// the error of its last increment, about 1e-10 of the length, is below rounding. Measured on the scenes of `models/` and
/// `tests/reference`: 2e-13 up to 129 nodes, 7e-12 at 513, 4e-11 at 4097, 5e-10 at 65 537, the largest where the solution itself is
/// rounding noise; no more iterations than with the band LU.
const BACKWARD_ERROR: f64 = 1e-6;

/// Node k with its joint, and the edge from there to node k+1: the entries of its six equations that are not 0 or 1, see
/// [`ChainMatrix`].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ChainRow {
    /// A: change of the force on node k with its position, [xx, xy, yx, yy], N/m.
    pub own: [f64; 4],
    /// p: change of that force with the direction θ_{k−1} of the previous edge, N.
    pub before: [f64; 2],
    /// s: change of that force with the direction θ_k of the edge, N.
    pub after: [f64; 2],
    /// dκ'/dθ of the joint, where κ' is the part of its curvature that carries the moment; zero without a joint.
    pub slope: f64,
    /// dκ'/dM of the joint, 1/(N m); without a joint, the factor, negated, of the equation M = 0.
    pub flexibility: f64,
    /// Unit tangent t of the edge.
    pub t: [f64; 2],
    /// dℓ/d(F·t) of the edge, m/N.
    pub compliance: f64,
    /// g, along the edge and across: change of the edge vector with θ_k, and of the moment along the edge with F, m.
    pub lever: [f64; 2],
    /// h: change of the moment along the edge with θ_k, N m.
    pub by_angle: f64,
}

impl ChainRow {
    /// Unit normal of the edge.
    #[inline(always)]
    fn n(&self) -> Vector2<f64> {
        Vector2::new(-self.t[1], self.t[0])
    }

    /// g.
    #[inline(always)]
    fn lever(&self) -> Vector2<f64> {
        Vector2::from(self.t) * self.lever[0] + self.n() * self.lever[1]
    }
}

/// The matrix of the chain form, six equations per node in six unknowns, where c is the factor of positions in the direction:
///
/// - node: A x_k + p θ_{k−1} + s θ_k + F_{k−1} − F_k, N,
/// - joint: `slope` (θ_k − θ_{k−1}) − `flexibility` M_k, dimensionless,
/// - along the edge: `compliance` t tᵀ F_k + g θ_k − c (x_{k+1} − x_k), m,
/// - around it: M_{k+1} − M_k + g·F_k + h θ_k, N m.
///
/// The equations of joints and edges are scaled to forces. If c is zero, those along the edge are t·F_k and θ_k. A held node 0 has
/// A x_0 alone, and its joint no edge before it.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainMatrix {
    rows: Vec<ChainRow>,
    /// The terms that are constant along the rod.
    pub terms: ChainTerms,
}

/// The terms of a [`ChainMatrix`] that are constant along the rod.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChainTerms {
    /// c, the factor of positions in the direction.
    pub moves: f64,
    /// The factors (N, N/m, 1/m) of the equations of joints, of edge vectors and of moments.
    pub scale: [f64; 3],
    /// Node 0 is held.
    pub held: bool,
}

/// The same matrix, stored by diagonals, for a band LU.
type Band = PivotedBand<3, 9>;

impl ChainMatrix {
    /// The zero matrix for a rod of `nodes` nodes.
    pub fn new(nodes: usize) -> Self {
        Self { rows: vec![ChainRow::default(); nodes], terms: ChainTerms { moves: 0.0, scale: [1.0; 3], held: false } }
    }

    /// Number of rows: six per node, three for the last.
    pub fn unknowns(&self) -> usize {
        UNKNOWNS_PER_NODE * self.rows.len() - 3
    }

    /// The rows, one per node, mutable; the last one has no edge.
    pub fn rows_mut(&mut self) -> &mut [ChainRow] {
        &mut self.rows
    }

    /// The entry at row `i`, column `j`.
    pub fn entry(&self, i: usize, j: usize) -> f64 {
        let row = self.diagonals(i / UNKNOWNS_PER_NODE)[i % UNKNOWNS_PER_NODE];
        (j + 3).checked_sub(i).and_then(|j| row.get(j)).copied().unwrap_or(0.0)
    }

    /// The equations of node `k` by diagonals; the fourth diagonal is the main one. Those of the last node's edge are zero.
    fn diagonals(&self, k: usize) -> [[f64; 9]; UNKNOWNS_PER_NODE] {
        let ChainRow { own, before: p, after: s, slope, flexibility, t, compliance, by_angle, .. } = self.rows[k];
        let lever = self.rows[k].lever();
        let ChainTerms { moves, scale: [joint, along, around], held } = self.terms;
        let prescribed = k == 0 && held;
        let starts = f64::from(k > 0); // 1 if an edge ends at the node
        let ends = f64::from(k + 1 < self.rows.len());
        let (f_before, f_after) = if prescribed { (0.0, 0.0) } else { (starts, -ends) };
        let [xx, xy, yx, yy] = own;
        let mut rows = [
            [f_before, 0.0, p[0], xx, xy, 0.0, f_after, 0.0, s[0]],
            [f_before, p[1], yx, yy, 0.0, 0.0, f_after, s[1], 0.0],
            [-joint * slope * starts, 0.0, 0.0, -joint * flexibility, 0.0, 0.0, joint * slope, 0.0, 0.0],
            [0.0; 9],
            [0.0; 9],
            [0.0; 9],
        ];
        if ends == 0.0 {
            return rows;
        }
        let c = along * moves;
        let stretch = |i: usize, j: usize| along * compliance * t[i] * t[j];
        if moves == 0.0 {
            rows[3] = [0.0, 0.0, 0.0, t[0], t[1], 0.0, 0.0, 0.0, 0.0];
            rows[4] = [0.0, 0.0, 0.0, 0.0, joint, 0.0, 0.0, 0.0, 0.0];
        } else {
            rows[3] = [c, 0.0, 0.0, stretch(0, 0), stretch(0, 1), along * lever[0], -c, 0.0, 0.0];
            rows[4] = [c, 0.0, stretch(1, 0), stretch(1, 1), along * lever[1], 0.0, -c, 0.0, 0.0];
        }
        rows[5] = [-around, around * lever[0], around * lever[1], around * by_angle, 0.0, 0.0, around, 0.0, 0.0];
        rows
    }

    /// Writes the matrix to `band`.
    fn write(&self, band: &mut Band) {
        for (k, rows) in band.rows_mut().chunks_mut(UNKNOWNS_PER_NODE).enumerate() {
            for (row, diagonals) in rows.iter_mut().zip(self.diagonals(k)) {
                *row = diagonals;
            }
        }
    }
}

/// An affine function x·(v₀, v₁) + v₂ θ + v₃ of the motion (x, θ) of a node and an edge there.
#[derive(Debug, Clone, Copy, Default)]
struct Affine([f64; 4]);

impl Add for Affine {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + other.0[i]))
    }
}

impl Sub for Affine {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] - other.0[i]))
    }
}

impl Mul<f64> for Affine {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        Self(self.0.map(|x| x * factor))
    }
}

impl Affine {
    /// Its value.
    #[inline(always)]
    fn at(self, x: Vector2<f64>, theta: f64) -> f64 {
        let Self([vx, vy, vt, v]) = self;
        (vx * x.x + vy * x.y) + (vt * theta + v)
    }

    /// Its derivative with respect to x along `direction`.
    #[inline(always)]
    fn along(self, direction: Vector2<f64>) -> f64 {
        self.0[0] * direction.x + self.0[1] * direction.y
    }

    /// The same function in terms of the start of a rigid edge, whose end moves by the lever times θ, minus the gap.
    #[inline(always)]
    fn at_rigid_start(self, edge: &ChainEdge) -> Self {
        self + Self([0.0, 0.0, self.along(edge.lever), -self.along(edge.gap)])
    }
}

/// The reaction −F_x, −F_y, −M of the rod beyond a cut to its motion (x, θ) there.
#[derive(Debug, Clone, Copy, Default)]
struct CondensedRod {
    force: [Affine; 2],
    moment: Affine,
}

/// The same at the start of an edge, with the force along the edge and across.
#[derive(Debug, Clone, Copy, Default)]
struct CondensedEdge {
    along: Affine,
    across: Affine,
    moment: Affine,
}

/// The equations of an edge for one elimination: x_{k+1} = x_k + `lever` θ_k + `compliance` t tᵀ F_k − `gap` and M_{k+1} = M_k −
/// g·F_k − h θ_k + `couple`.
struct ChainEdge {
    t: Vector2<f64>,
    lever: Vector2<f64>,
    compliance: f64,
    gap: Vector2<f64>,
    couple: f64,
}

/// The equation of a joint for one elimination: θ_k = θ_{k−1} + `flexibility` M_k + `turn`.
struct ChainJoint {
    flexibility: f64,
    turn: f64,
}

/// The factors that undo the scaling of the equations.
#[derive(Clone, Copy)]
struct RowCoefficients {
    per_move: f64,
    joint: f64,
    along: f64,
    around: f64,
}

impl RowCoefficients {
    fn new(ChainTerms { moves, scale: [joint, along, around], .. }: ChainTerms) -> Self {
        Self { per_move: 1.0 / moves, joint: 1.0 / joint, along: 1.0 / (along * moves), around: 1.0 / around }
    }

    #[inline(always)]
    fn edge(self, row: &ChainRow, rhs: &[f64; UNKNOWNS_PER_NODE]) -> ChainEdge {
        ChainEdge {
            t: row.t.into(),
            lever: row.lever() * self.per_move,
            compliance: row.compliance * self.per_move,
            gap: Vector2::new(rhs[3], rhs[4]) * self.along,
            couple: rhs[5] * self.around,
        }
    }

    #[inline(always)]
    fn joint(self, row: &ChainRow, rhs: &[f64; UNKNOWNS_PER_NODE]) -> ChainJoint {
        let per_slope = 1.0 / row.slope;
        ChainJoint { flexibility: row.flexibility * per_slope, turn: rhs[2] * (self.joint * per_slope) }
    }

    /// The moment if there is no joint.
    #[inline(always)]
    fn moment(self, row: &ChainRow, rhs: &[f64]) -> f64 {
        -rhs[2] * self.joint / row.flexibility
    }
}

/// The first two entries of `rhs`.
#[inline(always)]
fn on_node(rhs: &[f64]) -> Vector2<f64> {
    Vector2::new(rhs[0], rhs[1])
}

#[inline(always)]
fn block([xx, xy, yx, yy]: [f64; 4]) -> Matrix2<f64> {
    Matrix2::new(xx, xy, yx, yy)
}

impl CondensedRod {
    /// The last node, as seen from the end of the previous edge.
    fn tip(row: &ChainRow, rhs: &[f64], plain: RowCoefficients) -> Self {
        let [xx, xy, yx, yy] = row.own;
        let [x, y] = row.before;
        Self {
            force: [Affine([xx, xy, x, -rhs[0]]), Affine([yx, yy, y, -rhs[1]])],
            moment: Affine([0.0, 0.0, 0.0, -plain.moment(row, rhs)]),
        }
    }

    /// Transfers the reaction over an edge, from its end to its start.
    #[inline(always)]
    fn condense_edge(&self, row: &ChainRow, edge: &ChainEdge) -> CondensedEdge {
        let (t, [slip, length]) = (edge.t, row.lever);
        let [x, y] = self.force;
        let [along, across] = [x * t.x + y * t.y, y * t.x - x * t.y].map(|force| force.at_rigid_start(edge));
        // The edge stretches under the force along it.
        let along = along * (1.0 / (1.0 + edge.compliance * along.along(t)));
        let across = across - along * (edge.compliance * across.along(t));
        let moment = self.moment.at_rigid_start(edge) - along * (edge.compliance * self.moment.along(t));
        let moment = moment + Affine([0.0, 0.0, -row.by_angle, edge.couple]) + along * slip + across * length;
        CondensedEdge { along, across, moment }
    }
}

impl CondensedEdge {
    /// Eliminates the moment with the joint before it.
    #[inline(always)]
    fn jointed(&self, joint: &ChainJoint) -> Affine {
        let tt = self.moment.0[2];
        (self.moment + Affine([0.0, 0.0, 0.0, tt * joint.turn])) * (1.0 / (1.0 + joint.flexibility * tt))
    }

    /// Adds its first node and the joint there.
    #[inline(always)]
    fn joined(&self, row: &ChainRow, joint: &ChainJoint, rhs: &[f64; UNKNOWNS_PER_NODE]) -> CondensedRod {
        let moment = self.jointed(joint);
        let theta = Affine([0.0, 0.0, 1.0, joint.turn]) - moment * joint.flexibility; // direction of the edge beyond
        let [tx, ty] = row.t;
        let [xx, xy, yx, yy] = row.own;
        let force = [
            (self.along * tx - self.across * ty, [xx, xy, row.before[0], -rhs[0]], row.after[0]),
            (self.along * ty + self.across * tx, [yx, yy, row.before[1], -rhs[1]], row.after[1]),
        ];
        let force = force.map(|(Affine([x, y, by_theta, rest]), on_node, after)| {
            Affine(on_node) + Affine([x, y, 0.0, rest]) + theta * (by_theta + after)
        });
        CondensedRod { force, moment }
    }
}

/// Eliminates a [`ChainMatrix`] from the tip to the head, and falls back to a band LU with partial pivoting if that fails.
///
/// The rod beyond a cut reacts to the motion there with a force and a moment, −(F, M) = R (x, θ) + r, where R is its 3×3 dynamic
/// stiffness. Each link extends that part: an edge transfers R to its start, a node adds inertia and drag, and a compliance C, of
/// an edge to its tension or of a joint to its moment, takes R to (R⁻¹ + C)⁻¹, a rank-one update. So EI/ΔL³ is never formed, and
/// while R is positive definite no divisor is below 1. The motions then follow from the head. This is the Riccati transfer matrix
/// method (Horner & Pilkey, J. Mech. Des. 100, 1978, 297–302). Solutions are as accurate as by the band LU, also for a static
/// cantilever (measured: `tests/mechanics/chain.rs`). An iterate far from a solution may have an indefinite R, so every solution is
/// checked.
#[derive(Debug)]
pub struct Riccati {
    /// One per edge: the force at its start, the moment at its end.
    beyond: Vec<CondensedEdge>,
    /// The band LU, created on first use.
    lu: Option<Box<Band>>,
}

impl Riccati {
    /// Prepares for matrices of `nodes` nodes.
    pub fn new(nodes: usize) -> Self {
        Self { beyond: vec![CondensedEdge::default(); nodes - 1], lu: None }
    }

    /// Writes A⁻¹ `rhs` to `x`, non-finite values if A is singular; returns true if the band LU was needed.
    pub fn solve(&mut self, matrix: &ChainMatrix, rhs: &[f64], x: &mut [f64]) -> bool {
        if matrix.terms.moves == 0.0 {
            still(matrix, rhs, x);
            return false;
        }
        if self.eliminate(matrix, rhs, x) <= BACKWARD_ERROR {
            return false;
        }
        let lu = self.lu.get_or_insert_with(|| Box::new(Band::new(matrix.unknowns())));
        matrix.write(lu);
        x.copy_from_slice(rhs);
        lu.factor_and_solve(x);
        true
    }

    /// Returns the backward error, NaN if anything is not finite.
    fn eliminate(&mut self, matrix: &ChainMatrix, rhs: &[f64], x: &mut [f64]) -> f64 {
        let plain = RowCoefficients::new(matrix.terms);
        let ([rows @ .., tip], (rhs, rhs_tip)) = (&matrix.rows[..], rhs.as_chunks::<UNKNOWNS_PER_NODE>()) else {
            return f64::NAN;
        };
        let mut part = CondensedRod::tip(tip, rhs_tip, plain);
        let mut first = CondensedEdge::default();
        for ((row, rhs), beyond) in rows.iter().zip(rhs).zip(&mut self.beyond).rev() {
            first = part.condense_edge(row, &plain.edge(row, rhs));
            *beyond = CondensedEdge { moment: part.moment, ..first };
            part = first.joined(row, &plain.joint(row, rhs), rhs);
        }
        let ([head, ..], [rhs_head, ..]) = (rows, rhs) else { return f64::NAN };
        let (mut at, mut theta, mut moment);
        if matrix.terms.held {
            at = Vector2::new(rhs_head[0] / head.own[0], rhs_head[1] / head.own[3]);
            let joint = plain.joint(head, rhs_head);
            moment = -first.jointed(&joint).at(at, 0.0);
            theta = joint.turn + joint.flexibility * moment;
        } else {
            moment = plain.moment(head, rhs_head);
            // A joint that transmits the moment, without an edge before it.
            let through = ChainJoint { flexibility: 0.0, turn: 0.0 };
            let CondensedRod { force: [Affine(x), Affine(y)], moment: Affine(m) } =
                first.joined(head, &through, rhs_head);
            let whole = Matrix3::new(x[0], x[1], x[2], y[0], y[1], y[2], m[0], m[1], m[2]);
            let Some(motion) = whole.lu().solve(&-Vector3::new(x[3], y[3], m[3] + moment)) else { return f64::NAN };
            (at, theta) = (motion.xy(), motion.z);
        }
        // Back substitution from the head; `next` is the row of the node where an edge ends.
        let mut checked = RowSizes::default();
        let mut free = f64::from(!matrix.terms.held); // a clamp balances any force
        let (mut force_before, mut theta_before) = (Vector2::zeros(), 0.0);
        let (x, x_tip) = x.as_chunks_mut::<UNKNOWNS_PER_NODE>();
        let ends = rows.iter().skip(1).zip(rhs.iter().skip(1)).map(Some).chain(std::iter::once(None));
        for ((((row, rhs), beyond), x), next) in rows.iter().zip(rhs).zip(&self.beyond).zip(x).zip(ends) {
            let edge = plain.edge(row, rhs);
            let [along, across] = [beyond.along, beyond.across].map(|force| force.at(at, theta));
            let opposed = edge.t * along + row.n() * across;
            *x = [at.x, at.y, moment, -opposed.x, -opposed.y, theta];
            let (rigid, stretch) = (at + edge.lever * theta - edge.gap, edge.compliance * along);
            let end = rigid - edge.t * stretch;
            // Not taken from the moment at the end, whose result would have to be awaited.
            let moment_after = beyond.moment.along(edge.t) * stretch - beyond.moment.at(rigid, theta);
            let own = block(row.own) * at;
            let turned = Vector2::from(row.before) * theta_before + Vector2::from(row.after) * theta;
            let left = own + turned + force_before + opposed - on_node(rhs);
            // Checks the gap: positions are sums of it.
            checked.node([own, block(row.own) * edge.gap, opposed, on_node(rhs)], left * free);
            free = 1.0;
            let turning = row.lever[0] * along + row.lever[1] * across;
            let left = moment_after - moment - turning + row.by_angle * theta - edge.couple;
            checked.around([moment, turning, edge.couple], left, row.lever);
            (force_before, theta_before) = (-opposed, theta);
            (at, moment) = (end, moment_after);
            if let Some((row, rhs)) = next {
                let joint = plain.joint(row, rhs);
                theta += joint.turn + joint.flexibility * moment;
            }
        }
        x_tip.copy_from_slice(&[at.x, at.y, moment]);
        let own = block(tip.own) * at;
        let left = own + Vector2::from(tip.before) * theta_before + force_before - on_node(rhs_tip);
        checked.node([own, force_before, on_node(rhs_tip)], left);
        checked.error()
    }
}

/// Largest moduli of the residuals of two kinds of equations, and of their terms. The other two kinds, joints and edge vectors,
/// hold exactly because they were used to find the unknowns.
#[derive(Debug, Default)]
struct RowSizes {
    node: [f64; 2],
    around: [f64; 2],
    /// Largest lever that makes a moment of a force: rounding errors of forces enter moments through it.
    lever: f64,
    /// Not finite if any value is not.
    sum: f64,
}

#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    let b = b.abs();
    if b > a { b } else { a }
}

impl RowSizes {
    #[inline(always)]
    fn node<const N: usize>(&mut self, terms: [Vector2<f64>; N], left: Vector2<f64>) {
        let [size, residual] = &mut self.node;
        for i in 0..2 {
            *size = terms.iter().fold(*size, |size, term| larger(size, term[i]));
            *residual = larger(*residual, left[i]);
            self.sum += left[i];
        }
    }

    #[inline(always)]
    fn around(&mut self, terms: [f64; 3], left: f64, lever: [f64; 2]) {
        self.lever = lever.into_iter().fold(self.lever, larger);
        let [size, residual] = &mut self.around;
        *size = terms.into_iter().fold(*size, larger);
        *residual = larger(*residual, left);
        self.sum += left;
    }

    fn error(&self) -> f64 {
        if !self.sum.is_finite() {
            return f64::NAN;
        }
        let part = |[size, residual]: [f64; 2]| if residual == 0.0 { 0.0 } else { residual / size };
        let [size, residual] = self.around;
        part(self.node).max(part([size.max(self.lever * self.node[0]), residual]))
    }
}

/// The solution if no position moves: edges keep direction and stretch, so everything follows link by link.
fn still(matrix: &ChainMatrix, rhs: &[f64], x: &mut [f64]) {
    let ChainTerms { scale: [joint, _, around], held, .. } = matrix.terms;
    let (mut force_before, mut theta_before) = (Vector2::zeros(), 0.0);
    let moment = |row: &ChainRow, rhs: &[f64], turning: f64| (row.slope * turning - rhs[2] / joint) / row.flexibility;
    let theta = |rhs: &[f64]| rhs.get(4).map_or(0.0, |r| r / joint);
    let links = matrix.rows.iter().zip(rhs.chunks(UNKNOWNS_PER_NODE)).zip(x.chunks_mut(UNKNOWNS_PER_NODE)).enumerate();
    for (k, ((row, rhs_here), x)) in links {
        let turned = theta(rhs_here);
        let here = moment(row, rhs_here, turned - theta_before);
        let mut force = Vector2::zeros();
        if let ([_, _, _, along, _, left], Some(next)) = (rhs_here, matrix.rows.get(k + 1)) {
            let rhs_next = &rhs[UNKNOWNS_PER_NODE * (k + 1)..];
            let after = moment(next, rhs_next, theta(rhs_next) - turned);
            let (t, n) = (Vector2::from(row.t), row.n());
            let [slip, length] = row.lever;
            let turning = left / around - row.by_angle * turned - (after - here);
            force = t * *along + n * ((turning - slip * along) / length);
        }
        let by_angle = Vector2::from(row.before) * theta_before + Vector2::from(row.after) * turned;
        let pulled = if held && k == 0 { Vector2::zeros() } else { force - force_before };
        let moved = block(row.own).lu().solve(&(on_node(rhs_here) - by_angle + pulled));
        let [move_x, move_y] = moved.map_or([f64::NAN; 2], Into::into);
        for (x, value) in x.iter_mut().zip([move_x, move_y, here, force.x, force.y, turned]) {
            *x = value;
        }
        (force_before, theta_before) = (force, turned);
    }
}
