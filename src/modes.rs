//! Natural frequencies and mode shapes of the discrete rod: K φ = ω² M φ at the straight, unstressed rest state.
//!
//! K is the model's own Jacobian there, without actuation, drag and loads; M is the lumped mass. Along a straight rod the
//! two axes decouple: motion across it bends, motion along it stretches. A held head leaves node 0 out; the rigid modes of
//! a free rod are dropped. Source: R. W. Clough & J. Penzien, Dynamics of Structures (1975), chapter 12.
//!
//! All frequencies come from dense matrices, at a cost that grows as N³, and rounding reaches the first of bending as N⁴
//! (3·10⁻⁶ of its square at N = 1000). The lowest modes of finer rods come from a Krylov iteration with (K + σM)⁻¹, which
//! the chain form applies: its cost grows as N, EI/ΔL³ is never formed, and the frequencies are right to 10⁻⁸ on any mesh.

use std::fmt::Write;
use std::sync::{Arc, Mutex, PoisonError};

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::matrix_free::LinOp;
use faer::matrix_free::eigen::{PartialEigenParams, partial_eigen_scratch, partial_self_adjoint_eigen};
use faer::{Col, Mat, MatMut, MatRef, Par, Side};
use nalgebra::Vector2;

use crate::error::{Error, Result};
use crate::fluid::{Fluid, Forces, Layers};
use crate::head::Signal;
use crate::linear::{BandMatrix, ChainMatrix, Riccati};
use crate::model::{Dynamics, Model};
use crate::rod::Rod;
use crate::start::Start;
use crate::system::{Direction, Form, Linearisation, System};

/// Up to this many nodes shapes are computed from dense matrices: beyond, vectors lose digits (2e-8 of the first frequency
/// at 129 nodes), and the iteration needs that many.
const DENSE: usize = 65;

/// Convergence of the Krylov iteration, relative to the largest eigenvalue of (K + σM)⁻¹M.
const TOLERANCE: f64 = 1e-12;

/// Which way a mode moves the rod.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// Across it.
    Bending,
    /// Along it.
    Stretching,
}

impl Axis {
    const BOTH: [Self; 2] = [Self::Bending, Self::Stretching];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bending => "bending",
            Self::Stretching => "stretching",
        }
    }

    /// Its entry of a node: x or y.
    fn entry(self) -> usize {
        match self {
            Self::Bending => 1,
            Self::Stretching => 0,
        }
    }

    /// Its rigid modes in a free rod: along itself; across itself and around its centre.
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
    /// Which way it moves the rod.
    pub axis: Axis,
    /// Angular frequency ω, rad/s.
    pub frequency: f64,
    /// Displacement of every node along the axis; the largest is 1.
    pub shape: Vec<f64>,
}

/// The natural angular frequencies of a rod (rad/s), each list rising, without the rigid modes.
#[derive(Debug, Clone, PartialEq)]
pub struct Modes {
    /// Of bending: motion across the rod; N − 2 of a free rod, N − 1 of one with a held head.
    pub bending: Vec<f64>,
    /// Of stretching: motion along the rod; N − 1 of either.
    pub stretching: Vec<f64>,
}

impl Modes {
    /// The modes of `rod`, whose head is held where it has a joint at node 0.
    ///
    /// # Errors
    /// [`Error::Linear`] where the eigenvalue iteration does not converge.
    pub fn of(rod: &Rod) -> Result<Self> {
        let matrices = Matrices::of(rod, None)?;
        let [bending, stretching] = Axis::BOTH.map(|axis| {
            let squares =
                matrices.scaled(axis).self_adjoint_eigenvalues(Side::Lower).map_err(|e| matrices.failed(&e))?;
            Ok(squares.into_iter().skip(matrices.rigid(axis)).map(|square| square.max(0.0).sqrt()).collect())
        });
        Ok(Self { bending: bending?, stretching: stretching? })
    }

    /// The lowest of all.
    pub fn lowest(&self) -> f64 {
        self.bending.iter().chain(&self.stretching).copied().fold(f64::INFINITY, f64::min)
    }

    /// The highest of all: the one that bounds the step of an explicit method.
    pub fn highest(&self) -> f64 {
        self.bending.iter().chain(&self.stretching).copied().fold(0.0, f64::max)
    }
}

/// The rod linearised about its straight rest: M q̈ + C q̇ + K q = 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Matrices {
    /// Inertia of each unknown, x and y of every node, kg: that of the fluid around a straight rod included. It is all of M
    /// but for the moment of inertia of a body, which couples the first two nodes.
    pub mass: Vec<f64>,
    /// Inertia M, kg.
    pub inertia: BandMatrix,
    /// Drag C, N s/m; `None` without, and with a drag that couples every node with every other.
    pub damping: Option<BandMatrix>,
    /// Stiffness K, N/m.
    pub stiffness: BandMatrix,
    /// First node that is free to move: 1 where the head is held.
    pub first: usize,
}

impl Matrices {
    /// The matrices of `rod` in a fluid at rest, and of the forces there; in layers, of one that lies along x from the origin.
    ///
    /// # Errors
    /// Those of [`System::assemble`].
    pub fn of(rod: &Rod, outside: Option<(Forces, Fluid, Option<Layers>)>) -> Result<Self> {
        let damped = outside.as_ref().is_some_and(|(forces, ..)| !forces.is_empty() && forces.whole().is_none());
        let mut dynamics = at_rest(rod, outside);
        let straight = dynamics.first_state();
        let mut along = |direction: Direction| {
            let mut matrix = BandMatrix::new(rod.nodes);
            let linearisation = Linearisation { matrix: &mut matrix, direction };
            dynamics.unconstrained(&straight, &mut vec![0.0; 2 * rod.nodes], Some(linearisation))?;
            Ok::<_, Error>(matrix)
        };
        let inertia = along(Direction::ACCELERATIONS)?;
        Ok(Self {
            mass: (0..2 * rod.nodes).map(|i| inertia.entry(i, i)).collect(),
            inertia,
            stiffness: along(Direction::POSITIONS)?,
            damping: if damped { Some(along(Direction::VELOCITIES)?) } else { None },
            first: usize::from(is_held(rod)),
        })
    }

    /// Inertia of node `k` along `axis`, kg.
    fn inertia(&self, axis: Axis, k: usize) -> f64 {
        self.mass[2 * k + axis.entry()]
    }

    fn nodes(&self) -> usize {
        self.mass.len() / 2
    }

    /// Damping ratio ζ = φᵀCφ / (2ω φᵀMφ) of a mode in the drag; `None` without.
    pub fn damping_ratio(&self, mode: &Mode) -> Option<f64> {
        let damping = self.damping.as_ref()?;
        let i = mode.axis.entry();
        let products = mode.shape.iter().enumerate().skip(self.first).map(|(k, x)| {
            let near = || damping.coupled(k).filter(|j| *j >= self.first);
            let times =
                |matrix: &BandMatrix| near().map(|j| matrix.entry(2 * k + i, 2 * j + i) * mode.shape[j]).sum::<f64>();
            [x * times(damping), x * times(&self.inertia)]
        });
        let [lost, moved] = products.fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
        Some(lost / (2.0 * mode.frequency * moved))
    }

    fn rigid(&self, axis: Axis) -> usize {
        if self.first == 0 { axis.rigid() } else { 0 }
    }

    fn failed(&self, reason: &impl std::fmt::Debug) -> Error {
        Error::Linear { unknowns: self.nodes() - self.first, reason: format!("its eigenvalues: {reason:?}") }
    }

    /// The symmetric M^(−½) K M^(−½) along `axis`.
    fn scaled(&self, axis: Axis) -> Mat<f64> {
        let free = self.nodes() - self.first;
        Mat::from_fn(free, free, |i, j| {
            let (i, j) = (i + self.first, j + self.first);
            let inertia = self.inertia(axis, i) * self.inertia(axis, j);
            self.stiffness.entry(2 * i + axis.entry(), 2 * j + axis.entry()) / inertia.sqrt()
        })
    }

    /// All modes along `axis`, rising.
    fn modes(&self, axis: Axis) -> Result<Vec<Mode>> {
        let found = self.scaled(axis).self_adjoint_eigen(Side::Lower).map_err(|e| self.failed(&e))?;
        let squares = found.S().column_vector();
        Ok((self.rigid(axis)..squares.nrows())
            .map(|j| {
                let mut shape = vec![0.0; self.nodes()];
                for (k, x) in shape.iter_mut().enumerate().skip(self.first) {
                    *x = found.U()[(k - self.first, j)] / self.inertia(axis, k).sqrt();
                }
                Mode { axis, frequency: squares[j].max(0.0).sqrt(), shape: normed(shape) }
            })
            .collect())
    }

    /// M, C and K as texts in the Matrix Market exchange format, symmetric, each with a name; the unknowns are x and y of
    /// every node that is free to move. Source: R. F. Boisvert, R. Pozo & K. A. Remington, NISTIR 5935 (1996).
    pub fn matrix_market(&self) -> Vec<(&'static str, String)> {
        let mut texts = vec![
            ("mass.mtx", self.market("mass M, kg", &|i, j| self.inertia.entry(i, j))),
            ("stiffness.mtx", self.market("stiffness K, N/m", &|i, j| self.stiffness.entry(i, j))),
        ];
        if let Some(damping) = &self.damping {
            texts.push(("damping.mtx", self.market("drag C, N s/m", &|i, j| damping.entry(i, j))));
        }
        texts
    }

    fn market(&self, what: &str, entry: &dyn Fn(usize, usize) -> f64) -> String {
        let (first, last) = (2 * self.first, self.mass.len());
        let (mut lines, mut count) = (String::new(), 0);
        for j in first..last {
            for i in j..last.min(2 * self.stiffness.coupled(j / 2).end) {
                let value = entry(i, j);
                if value != 0.0 {
                    count += 1;
                    let _ = writeln!(lines, "{} {} {value:e}", i + 1 - first, j + 1 - first); // a String takes everything
                }
            }
        }
        let held = if self.first == 0 { "" } else { "; node 0 is held and left out" };
        format!(
            "%%MatrixMarket matrix coordinate real symmetric\n% {what}, about the straight rod at rest; unknowns x, y of each node{held}\n{0} {0} {count}\n{lines}",
            last - first
        )
    }
}

/// The `count` lowest modes of `rod` of either axis, rising, but at most half as many as there are nodes.
///
/// # Errors
/// [`Error::Linear`] where the eigenvalue iteration does not converge.
pub fn lowest(rod: &Rod, count: usize) -> Result<Vec<Mode>> {
    let count = count.clamp(1, rod.nodes / 2);
    let mut modes = if rod.nodes <= DENSE {
        let matrices = Matrices::of(rod, None)?;
        [matrices.modes(Axis::Bending)?, matrices.modes(Axis::Stretching)?].concat()
    } else {
        iterated(rod, count)?
    };
    modes.sort_by(|a, b| a.frequency.total_cmp(&b.frequency));
    modes.truncate(count);
    Ok(modes)
}

fn is_held(rod: &Rod) -> bool {
    rod.first_joint == 0
}

/// The rod and the forces on it alone, straight, in a fluid at rest.
fn at_rest(rod: &Rod, outside: Option<(Forces, Fluid, Option<Layers>)>) -> Dynamics {
    let (forces, fluid, layers) = outside.unwrap_or((Forces::default(), Fluid::NONE, None));
    Dynamics::new(Arc::new(Model {
        rod: rod.clone(),
        actuation: None,
        start: Start::Jump,
        forces,
        fluid: Fluid { flow: Vector2::zeros(), acceleration: Vector2::zeros(), ..fluid },
        flow: None,
        load: None,
        layers,
        buoyancy: None,
        head: is_held(rod).then(|| [0.0; 3].map(Signal::Constant)),
        head_input: Default::default(),
        spin: 0.0,
    }))
}

/// The shape with its largest entry 1.
fn normed(mut shape: Vec<f64>) -> Vec<f64> {
    let largest = shape.iter().fold(0.0, |max: f64, x| if x.abs() > max.abs() { *x } else { max });
    shape.iter_mut().for_each(|x| *x /= largest);
    shape
}

/// M^½ (K + σM)⁻¹ M^½ in x and y of every node, without the rigid modes: its largest eigenvalues are 1/(ω² + σ).
struct Inverse {
    root_mass: Vec<f64>,
    /// The rigid modes, orthonormal in the unknowns M^½ x.
    rigid: Vec<Vec<f64>>,
    matrix: ChainMatrix,
    work: Mutex<Work>,
}

/// The solver, a right-hand side and its solution.
type Work = (Riccati, Vec<f64>, Vec<f64>);

impl std::fmt::Debug for Inverse {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Inverse").field("unknowns", &self.root_mass.len()).finish_non_exhaustive()
    }
}

impl Inverse {
    fn without_rigid(&self, x: &mut [f64]) {
        for mode in &self.rigid {
            let share: f64 = mode.iter().zip(&*x).map(|(a, b)| a * b).sum();
            x.iter_mut().zip(mode).for_each(|(x, m)| *x -= share * m);
        }
    }

    fn apply_to(&self, x: &mut [f64]) {
        self.without_rigid(x);
        let mut work = self.work.lock().unwrap_or_else(PoisonError::into_inner); // each use fills it anew
        let (solver, rhs, solution) = &mut *work;
        rhs.fill(0.0);
        for (i, (x, root)) in x.iter().zip(&self.root_mass).enumerate() {
            rhs[6 * (i / 2) + i % 2] = x * root;
        }
        solver.solve(&self.matrix, rhs, solution);
        for (i, (x, root)) in x.iter_mut().zip(&self.root_mass).enumerate() {
            *x = solution[6 * (i / 2) + i % 2] * root;
        }
        self.without_rigid(x);
    }
}

impl LinOp<f64> for Inverse {
    fn apply_scratch(&self, _: usize, _: Par) -> StackReq {
        StackReq::EMPTY
    }

    fn nrows(&self) -> usize {
        self.root_mass.len()
    }

    fn ncols(&self) -> usize {
        self.root_mass.len()
    }

    fn apply(&self, mut out: MatMut<'_, f64>, rhs: MatRef<'_, f64>, _: Par, _: &mut MemStack) {
        let mut x = vec![0.0; self.root_mass.len()];
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

fn iterated(rod: &Rod, count: usize) -> Result<Vec<Mode>> {
    let failed = |reason: String| Error::Linear { unknowns: 2 * rod.nodes, reason };
    let mut dynamics = at_rest(rod, None);
    let straight = dynamics.first_state_in(Form::Chain);
    // σ is of the size of the first ω², so that K + σM is regular for a free rod too and nearly as good as K.
    let sigma = rod.ei / (rod.total_mass() * rod.length.powi(3)) * 500.0;
    let mut matrix = ChainMatrix::new(rod.nodes);
    let mut residual = vec![0.0; matrix.unknowns()];
    dynamics.assemble_chain(&straight, Direction { q: 1.0, v: 0.0, a: sigma }, &mut residual, &mut matrix)?;
    let held = is_held(rod);
    let mut root_mass: Vec<f64> = rod.mass.iter().flat_map(|m| [m.sqrt(); 2]).collect();
    if held {
        root_mass[..2].fill(0.0);
    }
    let mut operator = Inverse {
        rigid: Vec::new(),
        work: Mutex::new((Riccati::new(rod.nodes), residual.clone(), residual)),
        matrix,
        root_mass,
    };
    if !held {
        let centre = 0.5 * rod.length;
        let motions: [fn(f64) -> [f64; 2]; 3] = [|_| [1.0, 0.0], |_| [0.0, 1.0], |s| [0.0, s]];
        for motion in motions {
            let mut mode: Vec<f64> = (0..rod.nodes).flat_map(|k| motion(rod.arc_length(k) - centre)).collect();
            mode.iter_mut().zip(&operator.root_mass).for_each(|(x, root)| *x *= root);
            operator.without_rigid(&mut mode);
            let norm = mode.iter().map(|x| x * x).sum::<f64>().sqrt();
            mode.iter_mut().for_each(|x| *x /= norm);
            operator.rigid.push(mode);
        }
    }
    let unknowns = 2 * rod.nodes;
    // A start with something of every mode.
    let start = Col::from_fn(unknowns, |i| {
        let xi = (i / 2) as f64 / rod.nodes as f64;
        (1.0 + xi).ln() + (37.0 * xi * xi).cos()
    });
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
    let mode = |j: usize| {
        let share = |axis: Axis| (0..rod.nodes).map(|k| vectors[(2 * k + axis.entry(), j)].powi(2)).sum::<f64>();
        let axis = if share(Axis::Bending) >= share(Axis::Stretching) { Axis::Bending } else { Axis::Stretching };
        let shape = (0..rod.nodes).map(|k| vectors[(2 * k + axis.entry(), j)] / rod.mass[k].sqrt()).collect();
        Mode { axis, frequency: (1.0 / values[j] - sigma).max(0.0).sqrt(), shape: normed(shape) }
    };
    Ok((0..found).map(mode).collect())
}
