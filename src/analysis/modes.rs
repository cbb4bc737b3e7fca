//! Natural frequencies and mode shapes of the discrete rod: K φ = ω² M φ at the straight, unstressed rest state.
//!
//! K is the model's own Jacobian there, without actuation, drag and loads; M is the lumped mass with the added mass of the fluid
//! and the moment of inertia of a body. In a straight rod the two axes decouple: motion across it bends, motion along it
//! stretches. A held head excludes node 0; a head on a hinge adds its arc φL as an unknown of bending, with the inertia of the
//! rotor and the stiffness of the servo. Rigid modes are dropped: those of a free rod, and the rotation about a hinge without a
//! servo. Source: R. W. Clough & J. Penzien, Dynamics of Structures (1975), chapter 12.
//!
//! All frequencies are computed from dense matrices, at a cost that grows as N³. Rounding errors in the first bending frequency
//! grow as N⁴ (3·10⁻⁶ of its square at N = 1000). The lowest modes of finer rods are computed by a Krylov iteration with (K +
//! σM)⁻¹, applied in the chain form: its cost grows as N, EI/ΔL³ is never formed, and the frequencies are accurate to 10⁻⁸ on any
//! mesh.

use std::fmt::Write;
use std::sync::{Arc, Mutex, PoisonError};

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::matrix_free::LinOp;
use faer::matrix_free::eigen::{PartialEigenParams, partial_eigen_scratch, partial_self_adjoint_eigen};
use faer::{Col, Mat, MatMut, MatRef, Par, Side};

use super::rest::{self, FreeUnknowns};
use crate::error::{Error, Result};
use crate::integrator::{Integrator, METHODS, stability_limit};
use crate::linear::{BandMatrix, ChainMatrix, Direction, Riccati};
use crate::model::{Dynamics, Model};
use crate::rod::{Damping, Rod};
use crate::system::{Form, System};

/// Up to this many nodes shapes are computed from dense matrices. Beyond, eigenvectors lose digits (2e-8 of the first frequency
/// at 129 nodes); the Krylov iteration needs at least that many nodes.
pub const MAX_DENSE_NODES: usize = 65;

/// Convergence of the Krylov iteration, relative to the largest eigenvalue of (K + σM)⁻¹M.
const TOLERANCE: f64 = 1e-12;

/// Inverse iterations for the first frequency alone, at most. Each divides the error by the square of (ω₂² + σ)/(ω₁² + σ), 2 to 4 for a
/// uniform rod.
const MAX_INVERSE_ITERATIONS: usize = 200;

/// The direction in which a mode moves the rod.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModeKind {
    /// Across the rod.
    Bending,
    /// Along the rod.
    Stretching,
}

impl ModeKind {
    const BOTH: [Self; 2] = [Self::Bending, Self::Stretching];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bending => "bending",
            Self::Stretching => "stretching",
        }
    }

    /// Its coordinate of a node: x or y.
    fn entry(self) -> usize {
        match self {
            Self::Bending => 1,
            Self::Stretching => 0,
        }
    }

    /// Number of its rigid modes in a free rod: one along the rod; two across it, translation and rotation.
    fn rigid(self) -> usize {
        match self {
            Self::Bending => 2,
            Self::Stretching => 1,
        }
    }
}

/// One natural mode of the free or held rod, without drag.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// The direction in which the mode moves the rod.
    pub axis: ModeKind,
    /// Angular frequency ω, rad/s.
    pub frequency: f64,
    /// Displacement of every node along the axis, scaled to a maximum of 1.
    pub shape: Vec<f64>,
    /// Displacement of the arc φL of a hinge; zero without one.
    pub arc: f64,
}

impl Mode {
    /// The displacement of a free unknown.
    fn at(&self, free: FreeUnknowns, unknown: usize) -> f64 {
        if free.is_arc(unknown) { self.arc } else { self.shape[unknown / 2] }
    }
}

/// The natural angular frequencies of a rod (rad/s), in increasing order and without rigid modes, with the damping by drag.
#[derive(Debug, Clone, PartialEq)]
pub struct Modes {
    /// Bending, motion across the rod: N − 2 frequencies for a free rod, N − 1 with a held head, and one more with a head on a
    /// servo hinge.
    pub bending: Vec<f64>,
    /// Stretching, motion along the rod: N − 1 frequencies in both cases.
    pub stretching: Vec<f64>,
    /// The largest ratio of drag to inertia of a node, across the rod and along it, at rest, 1/s.
    pub drag: [f64; 2],
    /// A bound of the increase of the largest ω² by taut winches, which are excluded from the frequencies, 1/s².
    pub winches: f64,
}

impl Modes {
    /// The modes of `rod` in vacuum; its head is held if it has a joint at node 0.
    ///
    /// # Errors
    /// [`Error::Linear`] if the eigenvalue iteration does not converge.
    pub fn of(rod: &Rod) -> Result<Self> {
        Self::of_model(rest::bare(rod.clone()))
    }

    /// The modes of the rod of `model` with its hinge and added mass.
    ///
    /// # Errors
    /// Errors of [`of`](Self::of).
    pub fn of_model(model: Model) -> Result<Self> {
        let winches = model.tendons.stiffness_over_inertia(&model.rod);
        Self::of_matrices(&Matrices::of_natural_modes(model)?, winches)
    }

    /// The modes of M and K of `matrices`, where K contains only rod and servo; see [`winches`](Self::winches) for the rest.
    ///
    /// # Errors
    /// Errors of [`of`](Self::of).
    pub fn of_matrices(matrices: &Matrices, winches: f64) -> Result<Self> {
        let [bending, stretching] = ModeKind::BOTH.map(|axis| {
            let (scaled, _) = matrices.scaled(axis)?;
            let squares = scaled.self_adjoint_eigenvalues(Side::Lower).map_err(|e| matrices.failed(&e))?;
            Ok(squares.into_iter().skip(matrices.rigid(axis)).map(|square| square.max(0.0).sqrt()).collect())
        });
        let drag = ModeKind::BOTH.map(|axis| matrices.largest_damping(axis));
        Ok(Self { bending: bending?, stretching: stretching?, drag, winches })
    }

    /// The lowest frequency of all.
    pub fn lowest(&self) -> f64 {
        self.bending.iter().chain(&self.stretching).copied().fold(f64::INFINITY, f64::min)
    }

    /// The highest frequency of all.
    pub fn highest(&self) -> f64 {
        self.bending.iter().chain(&self.stretching).copied().fold(0.0, f64::max)
    }

    /// The steps of an explicit method, symplectic Euler, that amplify no mode, see [`stable_steps`](Self::stable_steps).
    pub fn explicit_steps(&self, damping: Option<&Damping>) -> Option<StableSteps> {
        let method = METHODS.iter().find(|method| !method.implicit)?;
        self.stable_steps(&*(method.build)(&method.defaults()), damping)
    }

    /// The highest frequency of each kind.
    pub fn highest_of_each(&self) -> HighestFrequencies {
        let highest = |frequencies: &Vec<f64>| frequencies.last().copied().unwrap_or_default();
        let frequencies = [&self.bending, &self.stretching].map(highest);
        HighestFrequencies { frequencies, drag: self.drag, winches: self.winches }
    }

    /// The [stable steps](HighestFrequencies::stable_steps) of its highest modes.
    pub fn stable_steps(&self, method: &dyn Integrator, damping: Option<&Damping>) -> Option<StableSteps> {
        self.highest_of_each().stable_steps(method, damping)
    }
}

/// The highest frequencies of bending and stretching, or upper bounds of them, and what damps them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HighestFrequencies {
    /// Angular frequencies of the rod itself, rad/s.
    pub frequencies: [f64; 2],
    /// See [`Modes::drag`].
    pub drag: [f64; 2],
    /// See [`Modes::winches`].
    pub winches: f64,
}

impl HighestFrequencies {
    /// Upper bounds by sums of rows of M and K of `matrices` (S. A. Gershgorin, 1931), at a cost that grows as N; `None` where M is not
    /// diagonally dominant. Their [stable steps](Self::stable_steps) are at most those of the modes.
    pub fn bounds(matrices: &Matrices, winches: f64) -> Option<Self> {
        let [bending, stretching] = ModeKind::BOTH.map(|axis| matrices.highest_bound(axis));
        let drag = ModeKind::BOTH.map(|axis| matrices.largest_damping(axis));
        Some(Self { frequencies: [bending?, stretching?], drag, winches })
    }

    /// The steps of `method` that in theory amplify no mode of a rod with this `damping`; `None` if all steps are stable.
    /// Kelvin–Voigt damping gives a mode the damping ratio ζ = τω/2, and a drag c per inertia gives c/(2ω). With both, the
    /// largest stable step decreases as ω grows, so the highest mode of each kind is decisive. Some methods allow longer steps
    /// with drag, which need not act on the highest mode. Cables have no damping: with winches, 2ζω = τω₀² + c with the rod's own
    /// ω₀² = ω² − w.
    pub fn stable_steps(&self, method: &dyn Integrator, damping: Option<&Damping>) -> Option<StableSteps> {
        // The smallest and the largest along the rod.
        let ends = |times: &mut dyn Iterator<Item = &f64>| {
            times.fold([f64::INFINITY, 0.0_f64], |[least, most], time| [least.min(*time), most.max(*time)])
        };
        let times = damping
            .map_or([[0.0; 2]; 2], |damping| [ends(&mut damping.bending.iter()), ends(&mut damping.stretching.iter())]);
        let bounds =
            self.frequencies.into_iter().zip(times).zip(self.drag).filter_map(|((own, [least, most]), drag)| {
                let frequency = own.hypot(self.winches.sqrt());
                if frequency == 0.0 {
                    return None;
                }
                let ratios = [least * own * own, most * own * own + drag].map(|damping| 0.5 * damping / frequency);
                let limits = ratios.into_iter().filter_map(|ratio| stability_limit(method, ratio));
                let limit = limits.min_by(f64::total_cmp)?;
                Some(StableSteps { largest: limit / frequency, frequency, limit })
            });
        bounds.min_by(|a, b| a.largest.total_cmp(&b.largest))
    }
}

/// Steps that amplify no mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StableSteps {
    /// The largest of these steps, s.
    pub largest: f64,
    /// The frequency ω that limits them, rad/s.
    pub frequency: f64,
    /// The largest ωh for an oscillator of this frequency.
    pub limit: f64,
}

/// A model linearised about the straight, unloaded rest state of its rod: M q̈ + C q̇ + K q = 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Matrices {
    /// Inertia of each unknown, x and y of every node, kg, including the fluid around a straight rod. It is all of M except the
    /// moment of inertia of a body, which couples the first two nodes. The entry of the arc of a hinge is I/L².
    pub mass: Vec<f64>,
    /// Inertia M, kg.
    pub inertia: BandMatrix,
    /// Damping C by drag, the material and the bearing of a hinge, N s/m; `None` without damping. A drag that couples every node
    /// with every other one is excluded.
    pub damping: Option<BandMatrix>,
    /// Stiffness K, N/m.
    pub stiffness: BandMatrix,
    /// The unknowns that are free to move.
    pub free: FreeUnknowns,
}

impl Matrices {
    /// The matrices of the [`unloaded`](rest::unloaded) `model`; in layers, for a rod that lies along x from the origin.
    ///
    /// # Errors
    /// Errors of [`System::assemble`].
    pub fn of(model: Model) -> Result<Self> {
        let by_drag = !model.forces.is_empty() && model.forces.global().is_none();
        let damped = by_drag || model.is_damped();
        let free = FreeUnknowns::of(&model);
        let mut dynamics = Dynamics::new(Arc::new(rest::unloaded(model)));
        let straight = dynamics.first_state();
        let mut along = |direction: Direction| rest::derivative(&mut dynamics, &straight, direction);
        let inertia = along(Direction::ACCELERATIONS)?;
        Ok(Self {
            mass: (0..inertia.unknowns()).map(|i| inertia.entry(i, i)).collect(),
            inertia,
            stiffness: along(Direction::POSITIONS)?,
            damping: if damped { Some(along(Direction::VELOCITIES)?) } else { None },
            free,
        })
    }

    /// The same for natural modes: K contains only the rod and the servo of its hinge, and C excludes the damping of the
    /// material.
    ///
    /// # Errors
    /// Errors of [`of`](Self::of).
    pub fn of_natural_modes(mut model: Model) -> Result<Self> {
        model.rod.damping = None;
        let alone = Model { hinge: model.hinge.clone(), ..rest::bare(model.rod.clone()) };
        Ok(Self { stiffness: Self::of(alone)?.stiffness, ..Self::of(model)? })
    }

    /// Inertia per length (kg/m) across the rod at its middle, for a common motion of the whole rod.
    pub fn line_density(&self, spacing: f64) -> f64 {
        let k = self.nodes() / 2;
        self.inertia.coupled(k).map(|j| self.inertia.entry(2 * k + 1, 2 * j + 1)).sum::<f64>() / spacing
    }

    /// True if M is diagonal (lumped).
    fn is_lumped(&self) -> bool {
        let alone = |k: usize| {
            let mut beside = self.inertia.coupled(k).filter(|j| *j != k).flat_map(|j| [2 * j, 2 * j + 1]);
            beside.all(|j| self.inertia.entry(2 * k, j) == 0.0 && self.inertia.entry(2 * k + 1, j) == 0.0)
        };
        (self.free.first..self.nodes()).all(alone)
    }

    fn nodes(&self) -> usize {
        self.mass.len() / 2
    }

    /// The free unknowns along the axis of unknown `i` to which `matrix` couples it.
    fn coupled(&self, matrix: &BandMatrix, i: usize) -> impl Iterator<Item = usize> + use<> {
        let (free, axis) = (self.free, self.free.axis(i));
        let near = matrix.coupled(i / 2).flat_map(|k| [2 * k, 2 * k + 1]);
        near.filter(move |j| free.contains(*j) && free.axis(*j) == axis)
    }

    /// The free unknowns along `axis`.
    fn along(&self, axis: ModeKind) -> Vec<usize> {
        self.free.along(axis.entry()).collect()
    }

    /// A bound of the ratio of damping to inertia of a mode, 1/s: the largest row sum of M^(-½) C M^(-½).
    fn largest_damping(&self, axis: ModeKind) -> f64 {
        let Some(damping) = &self.damping else { return 0.0 };
        let row = |i: usize| {
            let part = |j: usize| damping.entry(i, j).abs() / (self.mass[i] * self.mass[j]).sqrt();
            self.coupled(damping, i).map(part).sum()
        };
        self.free.along(axis.entry()).map(row).fold(0.0, f64::max)
    }

    /// A bound of the highest frequency along `axis`, rad/s. With M and K scaled by the root of the diagonal of M, ω² ≤ ‖M⁻¹‖ ‖K‖ in the
    /// norm of the largest sum of a row, and ‖M⁻¹‖ ≤ 1/min(1 − Σ|mᵢⱼ|), i ≠ j. `None` where M is not diagonally dominant.
    fn highest_bound(&self, axis: ModeKind) -> Option<f64> {
        let unknowns = || self.free.along(axis.entry());
        let scaled =
            |matrix: &BandMatrix, i: usize, j: usize| matrix.entry(i, j).abs() / (self.mass[i] * self.mass[j]).sqrt();
        let stiffness = |i: usize| self.coupled(&self.stiffness, i).map(|j| scaled(&self.stiffness, i, j)).sum::<f64>();
        let inertia = |i: usize| {
            let others = self.coupled(&self.inertia, i).filter(|j| *j != i);
            1.0 - others.map(|j| scaled(&self.inertia, i, j)).sum::<f64>()
        };
        let least = unknowns().map(inertia).fold(f64::INFINITY, f64::min);
        let largest = unknowns().map(stiffness).fold(0.0, f64::max);
        (least > 0.0).then(|| (largest / least).sqrt())
    }

    /// Damping ratio ζ = φᵀCφ / (2ω φᵀMφ) of a mode; `None` without damping.
    pub fn damping_ratio(&self, mode: &Mode) -> Option<f64> {
        let damping = self.damping.as_ref()?;
        let at = |i: usize| mode.at(self.free, i);
        let products = self.free.along(mode.axis.entry()).map(|i| {
            let times = |matrix: &BandMatrix| self.coupled(matrix, i).map(|j| matrix.entry(i, j) * at(j)).sum::<f64>();
            [at(i) * times(damping), at(i) * times(&self.inertia)]
        });
        let [lost, moved] = products.fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
        Some(lost / (2.0 * mode.frequency * moved))
    }

    /// The number of rigid modes along `axis`.
    fn rigid(&self, axis: ModeKind) -> usize {
        match axis {
            _ if self.free.first == 0 => axis.rigid(),
            ModeKind::Bending => usize::from(self.free.turns_freely),
            ModeKind::Stretching => 0,
        }
    }

    fn failed(&self, reason: &impl std::fmt::Debug) -> Error {
        Error::Linear { unknowns: self.nodes() - self.free.first, reason: format!("its eigenvalues: {reason:?}") }
    }

    /// The symmetric L⁻¹ K L⁻ᵀ along `axis`, and the factor L of M = L Lᵀ if it is not diagonal.
    fn scaled(&self, axis: ModeKind) -> Result<(Mat<f64>, Option<Mat<f64>>)> {
        let unknowns = self.along(axis);
        let free = unknowns.len();
        let of = |matrix: &BandMatrix, i: usize, j: usize| matrix.entry(unknowns[i], unknowns[j]);
        if self.is_lumped() {
            let inertia = |i: usize| self.mass[unknowns[i]];
            let scaled = |i: usize, j: usize| of(&self.stiffness, i, j) / (inertia(i) * inertia(j)).sqrt();
            return Ok((Mat::from_fn(free, free, scaled), None));
        }
        let mass = Mat::from_fn(free, free, |i, j| 0.5 * (of(&self.inertia, i, j) + of(&self.inertia, j, i)));
        let factors = mass.llt(Side::Lower).map_err(|e| self.failed(&e))?;
        let root = factors.L().to_owned();
        let stiffness = Mat::from_fn(free, free, |i, j| of(&self.stiffness, i, j));
        let left = forward(&root, &stiffness);
        let scaled = forward(&root, &left.transpose().to_owned());
        let symmetric = Mat::from_fn(free, free, |i, j| 0.5 * (scaled[(i, j)] + scaled[(j, i)]));
        Ok((symmetric, Some(root)))
    }

    /// All modes along `axis`, in increasing order.
    fn modes(&self, axis: ModeKind) -> Result<Vec<Mode>> {
        let (scaled, root) = self.scaled(axis)?;
        let unknowns = self.along(axis);
        let found = scaled.self_adjoint_eigen(Side::Lower).map_err(|e| self.failed(&e))?;
        let squares = found.S().column_vector();
        Ok((self.rigid(axis)..squares.nrows())
            .map(|j| {
                let mut moved: Vec<f64> = (0..squares.nrows()).map(|i| found.U()[(i, j)]).collect();
                match &root {
                    Some(root) => backward(root, &mut moved),
                    None => moved.iter_mut().zip(&unknowns).for_each(|(x, i)| *x /= self.mass[*i].sqrt()),
                }
                let moved = unknowns.iter().copied().zip(moved);
                mode(axis, squares[j].max(0.0).sqrt(), self.nodes(), self.free, moved)
            })
            .collect())
    }

    /// M, C and K in the Matrix Market exchange format, symmetric, each with a name. The unknowns are the arc of a hinge, if any,
    /// followed by x and y of every node that is free to move. Source: R. F. Boisvert, R. Pozo & K. A. Remington, NISTIR 5935
    /// (1996).
    pub fn matrix_market(&self) -> Vec<(&'static str, String)> {
        let mut texts = vec![
            ("mass.mtx", self.matrix_market_text("mass M, kg", &self.inertia)),
            ("stiffness.mtx", self.matrix_market_text("stiffness K, N/m", &self.stiffness)),
        ];
        if let Some(damping) = &self.damping {
            texts.push(("damping.mtx", self.matrix_market_text("drag C, N s/m", damping)));
        }
        texts
    }

    fn matrix_market_text(&self, what: &str, matrix: &BandMatrix) -> String {
        let unknowns: Vec<usize> = self.free.all().collect();
        let (mut lines, mut count) = (String::new(), 0);
        for (j, column) in unknowns.iter().enumerate() {
            let last = 2 * matrix.coupled(column / 2).end;
            for (i, row) in unknowns.iter().enumerate().skip(j).take_while(|(_, row)| **row < last) {
                let value = matrix.entry(*row, *column);
                if value != 0.0 {
                    count += 1;
                    let _ = writeln!(lines, "{} {} {value:e}", i + 1, j + 1); // writing to a String cannot fail
                }
            }
        }
        let (arc, held) = match self.free {
            FreeUnknowns { hinged: true, .. } => {
                ("the head's angle times the length, then ", "; node 0 is held and left out")
            }
            FreeUnknowns { first: 0, .. } => ("", ""),
            _ => ("", "; node 0 is held and left out"),
        };
        format!(
            "%%MatrixMarket matrix coordinate real symmetric\n% {what}, about the straight rod at rest; unknowns {arc}x, y of each node{held}\n{0} {0} {count}\n{lines}",
            unknowns.len()
        )
    }
}

/// The mode along `axis` of this `frequency` (rad/s), with the displacements `moved` of the free unknowns.
fn mode(
    axis: ModeKind,
    frequency: f64,
    nodes: usize,
    free: FreeUnknowns,
    moved: impl Iterator<Item = (usize, f64)>,
) -> Mode {
    let (mut shape, mut arc) = (vec![0.0; nodes], 0.0);
    for (i, x) in moved {
        if free.is_arc(i) {
            arc = x;
        } else {
            shape[i / 2] = x;
        }
    }
    let largest = shape.iter().fold(0.0, |max: f64, x| if x.abs() > max.abs() { *x } else { max });
    // The sum with zero makes 0 of −0.
    let normalised = |x: f64| x / largest + 0.0;
    shape.iter_mut().for_each(|x| *x = normalised(*x));
    Mode { axis, frequency, shape, arc: normalised(arc) }
}

/// Number of nodes to either side to which M, and therefore its root L, couples a node.
const BAND_HALF_WIDTH: usize = 2;

/// L⁻¹ B.
fn forward(root: &Mat<f64>, right: &Mat<f64>) -> Mat<f64> {
    let mut out = right.clone();
    for j in 0..out.ncols() {
        for i in 0..out.nrows() {
            let known: f64 = (i.saturating_sub(BAND_HALF_WIDTH)..i).map(|k| root[(i, k)] * out[(k, j)]).sum();
            out[(i, j)] = (out[(i, j)] - known) / root[(i, i)];
        }
    }
    out
}

/// Replaces `x` by L⁻ᵀ x.
fn backward(root: &Mat<f64>, x: &mut [f64]) {
    for i in (0..x.len()).rev() {
        let known: f64 = (i + 1..x.len().min(i + BAND_HALF_WIDTH + 1)).map(|k| root[(k, i)] * x[k]).sum();
        x[i] = (x[i] - known) / root[(i, i)];
    }
}

/// The `count` lowest modes of `rod` in vacuum, of both axes, in increasing order, but at most half as many as there are nodes.
///
/// # Errors
/// [`Error::Linear`] if the eigenvalue iteration does not converge.
pub fn lowest(rod: &Rod, count: usize) -> Result<Vec<Mode>> {
    lowest_of_model(rest::bare(rod.clone()), count)
}

/// The same for the rod of `model`, with its hinge and added mass.
///
/// # Errors
/// Errors of [`lowest`].
pub fn lowest_of_model(model: Model, count: usize) -> Result<Vec<Mode>> {
    let nodes = model.rod.nodes;
    let count = count.clamp(1, nodes / 2);
    let mut modes = if nodes <= MAX_DENSE_NODES {
        let matrices = Matrices::of_natural_modes(model)?;
        [matrices.modes(ModeKind::Bending)?, matrices.modes(ModeKind::Stretching)?].concat()
    } else {
        iterated(model, count)?
    };
    modes.sort_by(|a, b| a.frequency.total_cmp(&b.frequency));
    modes.truncate(count);
    Ok(modes)
}

/// Entries per row of the root of an inertia matrix, the diagonal last: a node is coupled with the two previous ones.
const REACH: usize = 6;

/// L of an inertia M = L Lᵀ in x and y of every node, row by row: entry `d` of row i is that of column i + d − 5.
struct Root {
    rows: Vec<[f64; REACH]>,
    /// The first entry that is not zero in all rows: the last entry if M is diagonal.
    first: usize,
}

impl Root {
    /// The root of `inertia` in the free unknowns; zero in the others.
    fn of(inertia: &BandMatrix, free: FreeUnknowns) -> Self {
        let mut rows = vec![[0.0; REACH]; 2 * free.nodes];
        for i in free.all() {
            for d in 0..REACH {
                let Some(j) = (i + d + 1).checked_sub(REACH).filter(|j| *j >= 2 * free.first || *j == i) else {
                    continue;
                };
                let own = if inertia.coupled(i / 2).contains(&(j / 2)) { inertia.entry(i, j) } else { 0.0 };
                // Σ L_ik L_jk over the columns k before j that both rows contain.
                let known: f64 = (0..REACH)
                    .filter_map(|e| {
                        let k = (i + e + 1).checked_sub(REACH).filter(|k| *k < j)?;
                        let at = (k + REACH - 1).checked_sub(j)?;
                        Some(rows[i][e] * rows[j][at])
                    })
                    .sum();
                rows[i][d] = if i == j { (own - known).max(0.0).sqrt() } else { (own - known) / rows[j][REACH - 1] };
            }
        }
        let first = (0..REACH).find(|d| rows.iter().any(|row| row[*d] != 0.0)).unwrap_or(REACH - 1);
        Self { rows, first }
    }

    /// The columns of row `i`, with their entries.
    fn row(&self, i: usize) -> impl Iterator<Item = (usize, f64)> {
        let column = move |(d, entry): (usize, &f64)| Some(((i + d + 1).checked_sub(REACH)?, *entry));
        self.rows[i].iter().enumerate().skip(self.first).filter_map(column)
    }

    /// Lᵀ x.
    fn transposed(&self, x: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; x.len()];
        for (i, x) in x.iter().enumerate() {
            self.row(i).for_each(|(j, entry)| out[j] += entry * x);
        }
        out
    }

    /// Replaces `x` by L⁻ᵀ x; entries of held nodes become zero.
    fn unscale(&self, x: &mut [f64]) {
        for i in (0..x.len()).rev() {
            let own = self.rows[i][REACH - 1];
            x[i] = if own == 0.0 { 0.0 } else { x[i] / own };
            let value = x[i];
            self.row(i).filter(|(j, _)| *j < i).for_each(|(j, entry)| x[j] -= entry * value);
        }
    }
}

/// Lᵀ (K + σM)⁻¹ L in x and y of every node, with M = L Lᵀ, without the rigid modes: its largest eigenvalues are 1/(ω² + σ).
struct ShiftInvert {
    free: FreeUnknowns,
    root: Root,
    /// The rigid modes, orthonormal in the unknowns Lᵀ x.
    rigid: Vec<Vec<f64>>,
    matrix: ChainMatrix,
    hinge: Option<EliminatedHinge>,
    work: Mutex<SolverWorkspace>,
}

/// The equation of a hinge, which the chain form eliminates: (k + σI) δφ − δM = r, with the moment M of the first joint.
struct EliminatedHinge {
    /// k + σI, N m.
    slope: f64,
    /// The ratio of arc to angle, m.
    length: f64,
    /// The factor that scales the equation of the joint to a force, N.
    per_radian: f64,
}

/// The solver, a right-hand side and its solution.
type SolverWorkspace = (Riccati, Vec<f64>, Vec<f64>);

impl std::fmt::Debug for ShiftInvert {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ShiftInvert").field("unknowns", &self.root.rows.len()).finish_non_exhaustive()
    }
}

impl ShiftInvert {
    /// The operator of the rod of `model`, and σ.
    fn of(mut model: Model) -> Result<(Self, f64)> {
        // Only the inertia of the fluid counts: stiffness is that of rod and servo, not of follower loads, for example.
        model.forces.0.retain(|force| force.is_inertial());
        let free = FreeUnknowns::of(&model);
        let mut dynamics = Dynamics::new(Arc::new(rest::unloaded(model)));
        let unbent = dynamics.first_state();
        let inertia = rest::derivative(&mut dynamics, &unbent, Direction::ACCELERATIONS)?;
        let straight = dynamics.first_state_in(Form::Chain);
        let model = Arc::clone(&dynamics.model);
        let rod = &model.rod;
        let across: f64 = (usize::from(free.hinged)..rod.nodes).map(|k| inertia.entry(2 * k + 1, 2 * k + 1)).sum();
        // σ is of the size of the first ω², so that K + σM is regular for a free rod too and nearly as well conditioned as K.
        let sigma = rod.ei / (across * rod.length.powi(3)) * 500.0;
        let mut matrix = ChainMatrix::new(rod.nodes);
        let mut residual = vec![0.0; matrix.unknowns()];
        dynamics.assemble_chain(&straight, Direction { q: 1.0, v: 0.0, a: sigma }, &mut residual, &mut matrix)?;
        let mut operator = Self {
            free,
            rigid: Vec::new(),
            work: Mutex::new((Riccati::new(rod.nodes), residual.clone(), residual)),
            hinge: model.hinge.as_ref().map(|hinge| EliminatedHinge {
                slope: hinge.stiffness + sigma * hinge.inertia,
                length: rod.length,
                per_radian: matrix.terms.scale[0],
            }),
            matrix,
            root: Root::of(&inertia, free),
        };
        let centre = if free.first == 0 { 0.5 * rod.length } else { 0.0 };
        let motions: &[fn(f64) -> [f64; 2]] = match free.first {
            0 => &[|_| [1.0, 0.0], |_| [0.0, 1.0], |s| [0.0, s]],
            _ if free.turns_freely => &[|s| [0.0, s]],
            _ => &[],
        };
        for motion in motions {
            let mut motion: Vec<f64> = (0..rod.nodes).flat_map(|k| motion(rod.arc_length(k) - centre)).collect();
            if free.hinged {
                motion[0] = rod.length;
            }
            let mut mode = operator.root.transposed(&motion);
            operator.without_rigid(&mut mode);
            let norm = mode.iter().map(|x| x * x).sum::<f64>().sqrt();
            mode.iter_mut().for_each(|x| *x /= norm);
            operator.rigid.push(mode);
        }
        Ok((operator, sigma))
    }

    /// A start vector with components of every mode.
    fn start(&self) -> Vec<f64> {
        let component = |i: usize| {
            let xi = (i / 2) as f64 / self.free.nodes as f64;
            (1.0 + xi).ln() + (37.0 * xi * xi).cos()
        };
        (0..self.nrows()).map(component).collect()
    }

    fn failed(&self, reason: String) -> Error {
        Error::Linear { unknowns: self.nrows(), reason }
    }

    fn without_rigid(&self, x: &mut [f64]) {
        for mode in &self.rigid {
            let share: f64 = mode.iter().zip(&*x).map(|(a, b)| a * b).sum();
            x.iter_mut().zip(mode).for_each(|(x, m)| *x -= share * m);
        }
    }

    fn apply_to(&self, x: &mut [f64]) {
        self.without_rigid(x);
        let mut work = self.work.lock().unwrap_or_else(PoisonError::into_inner); // overwritten by each use
        let (solver, rhs, solution) = &mut *work;
        rhs.fill(0.0);
        for i in 0..x.len() {
            rhs[6 * (i / 2) + i % 2] = self.root.row(i).map(|(j, entry)| entry * x[j]).sum();
        }
        let hinge = self.hinge.as_ref().map(|hinge| (hinge, std::mem::take(&mut rhs[0]) * hinge.length));
        if let Some((EliminatedHinge { slope, per_radian, .. }, moment)) = hinge {
            rhs[2] = per_radian * moment / slope;
        }
        solver.solve(&self.matrix, rhs, solution);
        let mut found: Vec<f64> = (0..x.len()).map(|i| solution[6 * (i / 2) + i % 2]).collect();
        if let Some((EliminatedHinge { slope, length, .. }, moment)) = hinge {
            found[0] = length * (moment + solution[2]) / slope;
        }
        x.copy_from_slice(&self.root.transposed(&found));
        self.without_rigid(x);
    }
}

impl LinOp<f64> for ShiftInvert {
    fn apply_scratch(&self, _: usize, _: Par) -> StackReq {
        StackReq::EMPTY
    }

    fn nrows(&self) -> usize {
        self.root.rows.len()
    }

    fn ncols(&self) -> usize {
        self.root.rows.len()
    }

    fn apply(&self, mut out: MatMut<'_, f64>, rhs: MatRef<'_, f64>, _: Par, _: &mut MemStack) {
        let mut x = vec![0.0; self.root.rows.len()];
        for j in 0..rhs.ncols() {
            x.iter_mut().enumerate().for_each(|(i, x)| *x = rhs[(i, j)]);
            self.apply_to(&mut x);
            x.iter().enumerate().for_each(|(i, x)| out[(i, j)] = *x);
        }
    }

    fn conj_apply(&self, out: MatMut<'_, f64>, rhs: MatRef<'_, f64>, par: Par, stack: &mut MemStack) {
        self.apply(out, rhs, par, stack);
    }
}

/// The lowest angular frequency of the rod of `model`, rad/s: the first of [`lowest_of_model`], at a tenth of its cost on fine meshes.
///
/// # Errors
/// Those of [`lowest_of_model`].
pub fn first_frequency(model: Model) -> Result<f64> {
    if model.rod.nodes <= MAX_DENSE_NODES {
        return Ok(lowest_of_model(model, 1)?.first().map_or(f64::INFINITY, |mode| mode.frequency));
    }
    let (operator, sigma) = ShiftInvert::of(model)?;
    let mut x = operator.start();
    let mut last = f64::INFINITY;
    for _ in 0..MAX_INVERSE_ITERATIONS {
        let norm = x.iter().map(|x| x * x).sum::<f64>().sqrt();
        x.iter_mut().for_each(|x| *x /= norm);
        let before = x.clone();
        operator.apply_to(&mut x);
        // Rayleigh's quotient of (ω² + σ)⁻¹.
        let quotient: f64 = before.iter().zip(&x).map(|(a, b)| a * b).sum();
        if (quotient - last).abs() <= TOLERANCE * quotient {
            return Ok((1.0 / quotient - sigma).max(0.0).sqrt());
        }
        last = quotient;
    }
    Err(operator.failed("its lowest frequency did not converge".to_string()))
}

fn iterated(model: Model, count: usize) -> Result<Vec<Mode>> {
    let (operator, sigma) = ShiftInvert::of(model)?;
    let (free, unknowns) = (operator.free, operator.nrows());
    let failed = |reason: String| operator.failed(reason);
    let start = operator.start();
    let start = Col::from_fn(unknowns, |i| start[i]);
    let start = &start / start.norm_l2();
    let (mut vectors, mut values) = (Mat::zeros(unknowns, count), vec![0.0; count]);
    let parameters = PartialEigenParams::default();
    let mut memory = MemBuffer::try_new(partial_eigen_scratch(&operator, count, Par::Seq, parameters))
        .map_err(|e| failed(format!("memory for its modes: {e:?}")))?;
    let info = partial_self_adjoint_eigen(
        vectors.as_mut(),
        &mut values,
        &operator,
        start.as_ref(),
        TOLERANCE,
        Par::Seq,
        MemStack::new(&mut memory),
        parameters,
    );
    let found = info.n_converged_eigen.min(count);
    if found < count {
        return Err(failed(format!("only {found} of its {count} lowest modes converged")));
    }
    let of = |j: usize| {
        let mut entries: Vec<f64> = (0..unknowns).map(|i| vectors[(i, j)]).collect();
        let share = |axis: ModeKind| free.along(axis.entry()).map(|i| entries[i].powi(2)).sum::<f64>();
        let axis = if share(ModeKind::Bending) >= share(ModeKind::Stretching) {
            ModeKind::Bending
        } else {
            ModeKind::Stretching
        };
        operator.root.unscale(&mut entries);
        let moved = free.along(axis.entry()).map(|i| (i, entries[i]));
        mode(axis, (1.0 / values[j] - sigma).max(0.0).sqrt(), free.nodes, free, moved)
    };
    Ok((0..found).map(of).collect())
}
