//! Newton's method for four rods, each in a SIMD lane: assembly, block-tridiagonal elimination, convergence, measurements.

use std::ops::Range;
use std::sync::Arc;

use fearless_simd::prelude::*;
use fearless_simd::{Avx2, Level, mask64x4};
use nalgebra::Vector2;
use wide::f64x2;

use super::WIDTH;
use super::forces::{BatchedForces, ForceTotals, LaneMotion, against, measure_drag};
use super::lanes::{Lanes, PairLanes, two};
use crate::fluid::force::{Powers, TipForce};
use crate::fluid::local::{self, Traction};
use crate::fluid::{Fluid, Force};
use crate::integrator::{StepWeights, changes};
use crate::linear::{Block, BlockBand, BlockRow, Direction, Number, Pair, ResidualSizes, prescribe};
use crate::metrics::BatchedMeasurements;
use crate::model::{Dynamics, Model, lengths_allowed};
use crate::newton::{Convergence, Iteration, MAX_ITERATIONS, SolveProgress};
use crate::rod::bend::{self, Joint};
use crate::rod::damping::{EdgeRate, Elastic, KelvinVoigt, MaterialLaw, StrainRates};
use crate::rod::edge_force::EdgeForce;
use crate::rod::elastic::{self, Deformed};
use crate::rod::energies::{MovingRod, RodSums};
use crate::rod::{Cell, Damping, Edge, EdgeValues, lengths};
use crate::stepper::Stepper;
use crate::stepper::presolved_step::PresolvedStep;
use crate::system::State;

/// One vector per node of each case.
type NodalVectors = Vec<[Lanes; 2]>;

/// Four rods in SIMD lanes, with a workspace. Lanes without a case repeat another case.
#[derive(Debug)]
pub struct Kernel {
    simd: Avx2,
    models: [Arc<Model>; WIDTH],
    rods: BatchedRods,
    others: BatchedForces,
    /// Viscosity and density of the fluids for which the coefficients of drag and of `others` were computed.
    fluids: [[f64; 2]; WIDTH],
    at: TimeDependent,
    before: StepStart,
    motion: NodalMotion,
    workspace: Workspace,
}

/// Constant properties of the rods.
#[derive(Debug)]
struct BatchedRods {
    /// True if the heads are held.
    held: bool,
    cells: EdgeValues<Cell<Lanes>>,
    mass: Vec<Lanes>,
    /// Bending stiffness of the joints.
    stiffness: Vec<Lanes>,
    /// Damping of the materials; `None` for elastic ones.
    damping: Option<Damping<Lanes>>,
    /// The nodes with a joint.
    joints: Range<usize>,
    /// Lengths of the halves of each edge, and drag coefficients along and across them, see
    /// [`coefficients`](crate::fluid::force::FusedForce::coefficients); empty without drag. `in_pass` is the index of this drag
    /// among the forces.
    drag: Vec<[PairLanes; 3]>,
    in_pass: Option<usize>,
    /// Smallest and largest length of an edge.
    lengths: [Lanes; 2],
    total_mass: Lanes,
}

/// Quantities that depend on time alone, at the end of the step.
#[derive(Debug)]
struct TimeDependent {
    natural: Vec<Lanes>,
    natural_rate: Vec<Lanes>,
    /// Tangent before the first joint of a held head.
    clamp_tangent: Option<Vector2<Lanes>>,
    /// The same tangent at the start of the step.
    clamp_tangent_before: Option<Vector2<Lanes>>,
    /// Angular velocity of a held head, rad/s.
    clamp_spin: Lanes,
    flow: Vector2<Lanes>,
    /// The fluid of each case.
    fluids: [Fluid; WIDTH],
    /// The loads of each [source](Dynamics::loads_by_source), and whether any case has loads of that source.
    loads: [NodalVectors; 3],
    loaded: [bool; 3],
    /// Position, velocity and acceleration of a held head.
    head: [[Lanes; 2]; 3],
}

#[derive(Debug)]
struct NodalMotion {
    q: NodalVectors,
    v: NodalVectors,
    a: NodalVectors,
}

/// The state at the start of a step, and the method's memory of earlier accelerations.
#[derive(Debug)]
struct StepStart {
    motion: NodalMotion,
    memory: NodalVectors,
}

#[derive(Debug)]
struct Workspace {
    edges: Vec<Edge<Lanes>>,
    /// The other forces on each edge; empty without other forces.
    around: Vec<EdgeForce<Lanes>>,
    /// Totals of each force.
    wholes: Vec<ForceTotals>,
    tips: Vec<BatchedTipForce>,
    joints: Vec<Joint<Lanes>>,
    /// Rates of strain of damped materials.
    rates: Option<StrainRates<Lanes>>,
    kappa: Vec<Lanes>,
    /// Moments conjugate to the curvatures.
    moment: Vec<Lanes>,
    rows: Vec<BlockRow<Lanes>>,
    residual: NodalVectors,
    solution: NodalVectors,
    band: BlockBand<Lanes>,
}

/// A force on the last node, with its contributions to the first three blocks of the last row.
#[derive(Debug, Clone, Copy)]
struct BatchedTipForce {
    force: [Lanes; 2],
    blocks: [[Lanes; 4]; 3],
}

impl BatchedTipForce {
    /// Sets the force of one case.
    fn set(&mut self, lane: usize, tip: &TipForce) {
        for (to, from) in self.force.iter_mut().zip(tip.force.iter()) {
            to.set(lane, *from);
        }
        for (to, block) in self.blocks.iter_mut().zip(tip.blocks()) {
            to.iter_mut().zip(block.transpose().iter()).for_each(|(to, from)| to.set(lane, *from));
        }
    }
}

impl Kernel {
    /// See [`Batch::of`](super::Batch::of).
    pub fn of(steppers: &[&Stepper]) -> Option<Self> {
        let simd = Level::new().as_avx2()?;
        let first = steppers.first()?;
        let alike = |stepper: &&Stepper| stepper.batch_key() == first.batch_key();
        if !(2..=WIDTH).contains(&steppers.len()) || first.batch_key().is_none() || !steppers.iter().all(alike) {
            return None;
        }
        let model = |lane: usize| steppers.get(lane).unwrap_or(first).model();
        let pack = |of: &dyn Fn(usize) -> f64| Lanes::new(simd, std::array::from_fn(of));
        let rod = |lane: usize| &model(lane).rod;
        let nodes = first.model().rod.nodes;
        let cell = |e: usize| Cell {
            rest: pack(&|lane| rod(lane).cells[e].rest),
            axial: pack(&|lane| rod(lane).cells[e].axial),
        };
        let in_pass = first.model().forces.in_pass().map(|(i, _)| i);
        let others = BatchedForces::of(simd, std::array::from_fn(model), in_pass)?;
        let coefficients = |lane: usize, e: usize| drag_coefficients(model(lane), model(lane).fluid, e);
        if in_pass.is_some() && (0..WIDTH).any(|lane| coefficients(lane, 0).is_none()) {
            return None;
        }
        let of_drag = |e: usize| {
            let cases: [_; WIDTH] = std::array::from_fn(|lane| coefficients(lane, e).unwrap_or_default());
            [0, 1, 2].map(|part| two(simd, |lane| cases[lane][part].to_array()))
        };
        let zero = pack(&|_| 0.0);
        let damping = first.model().rod.damping.as_ref().map(|Damping { rate, .. }| {
            let time = |of: &dyn Fn(&Damping) -> f64| pack(&|lane| rod(lane).damping.as_ref().map_or(0.0, of));
            let stretching = |e: usize| time(&|damping| damping.stretching[e]);
            Damping {
                stretching: EdgeValues::all((0..nodes - 1).map(stretching).collect(), stretching(nodes - 2)),
                bending: (0..nodes).map(|k| time(&|damping| damping.bending[k])).collect(),
                rate: *rate,
            }
        });
        let edge = Edge::new(Vector2::new(zero.like(1.0), zero));
        let vectors = || vec![[zero; 2]; nodes];
        let (dragged, around) =
            [in_pass.is_some(), others.are_on_edges()].map(|any| if any { nodes - 1 } else { 0 }).into();
        let none = Block::diagonal(zero);
        let nothing = EdgeForce { force: [PairLanes::new([zero; 2]); 2], own: [none; 2], edge: [none; 2] };
        let tip = BatchedTipForce { force: [zero; 2], blocks: [[zero; 4]; 3] };
        Some(Self {
            simd,
            models: std::array::from_fn(|lane| dynamics(steppers.get(lane).unwrap_or(first)).model.clone()),
            rods: BatchedRods {
                held: first.model().head.is_some(),
                cells: EdgeValues::all((0..nodes - 1).map(cell).collect(), cell(nodes - 2)),
                mass: (0..nodes).map(|k| pack(&|lane| rod(lane).mass[k])).collect(),
                stiffness: (0..nodes).map(|k| pack(&|lane| rod(lane).joint[k])).collect(),
                damping,
                joints: first.model().rod.joints(),
                drag: (0..dragged).map(of_drag).collect(),
                in_pass,
                lengths: [0, 1].map(|i| pack(&|lane| lengths_allowed(rod(lane))[i])),
                total_mass: pack(&|lane| rod(lane).total_mass()),
            },
            at: TimeDependent {
                natural: vec![zero; nodes],
                natural_rate: vec![zero; nodes],
                clamp_tangent: first.model().head.as_ref().map(|_| Vector2::new(zero, zero)),
                clamp_tangent_before: first.model().head.as_ref().map(|_| Vector2::new(zero, zero)),
                clamp_spin: zero,
                flow: Vector2::new(zero, zero),
                fluids: [Fluid::NONE; WIDTH],
                loads: std::array::from_fn(|_| vectors()),
                loaded: [false; 3],
                head: [[zero; 2]; 3],
            },
            before: StepStart { motion: NodalMotion { q: vectors(), v: vectors(), a: vectors() }, memory: vectors() },
            motion: NodalMotion { q: vectors(), v: vectors(), a: vectors() },
            workspace: Workspace {
                edges: vec![edge; nodes - 1],
                around: vec![nothing; around],
                wholes: vec![ForceTotals::none(zero); first.model().forces.0.len()],
                tips: vec![tip; others.tips()],
                joints: vec![Joint { couple: zero, stiffness: zero }; nodes],
                rates: first.model().rod.damping.as_ref().map(|_| StrainRates::zeros(nodes, zero)),
                kappa: vec![zero; nodes],
                moment: vec![zero; nodes],
                rows: vec![[[zero; 4]; 5]; nodes],
                residual: vectors(),
                solution: vectors(),
                band: BlockBand::of(nodes, zero),
            },
            fluids: std::array::from_fn(|lane| viscosity_and_density(model(lane).fluid)),
            others,
        })
    }

    /// See [`Batch::presolve`](super::Batch::presolve). `prepare` returns the next step of the stepper in a lane. Returns the
    /// number of solved steps.
    pub fn presolve(
        &mut self,
        steppers: &mut [Option<&mut Stepper>],
        prepare: impl Fn(usize, &mut Stepper) -> Option<PresolvedStep>,
    ) -> u64 {
        let mut steps: [Option<PresolvedStep>; WIDTH] = [None; WIDTH];
        for (lane, (step, stepper)) in steps.iter_mut().zip(steppers.iter_mut()).enumerate() {
            let known = stepper.as_mut().filter(|stepper| Arc::ptr_eq(&dynamics(stepper).model, &self.models[lane]));
            let prepared = known.and_then(|stepper| Some((prepare(lane, stepper)?, dynamics(stepper).inputs.fluid)));
            *step = prepared.filter(|(_, fluid)| self.enter(lane, *fluid)).map(|(step, _)| step);
        }
        let Some(kind) = steps.iter().flatten().map(PresolvedStep::kind).next() else { return 0 };
        // Steps of another kind are left to their steppers.
        for step in &mut steps {
            step.take_if(|step| step.kind() != kind);
        }
        let mut lanes = (0..WIDTH).filter(|lane| steps[*lane].is_some());
        let (Some(first), true) = (lanes.next(), lanes.next().is_some()) else { return 0 };
        self.at.loaded = [false; 3];
        for case in steppers.iter().flatten() {
            let sources = dynamics(case).loads_by_source();
            self.at.loaded.iter_mut().zip(sources).for_each(|(loaded, load)| *loaded |= load.is_some());
        }
        let mut progress: [Option<SolveProgress>; WIDTH] = [None; WIDTH]; // cases still iterating
        for lane in 0..WIDTH {
            let own = steppers.get(lane).and_then(Option::as_deref).filter(|_| steps[lane].is_some());
            let Some(case) = own.or(steppers[first].as_deref()) else { continue };
            let (states, start) = case.presolve_inputs();
            self.load(lane, dynamics(case), states);
            progress[lane] = own.map(|_| start);
        }
        self.guess(kind);
        let direction = kind.1.direction();
        let mut solved = [0; WIDTH]; // number of iterations of each converged case
        for iterations in 1..=MAX_ITERATIONS {
            let going = progress.each_ref().map(Option::is_some);
            if going == [false; WIDTH] {
                break;
            }
            let made = self.iterate(direction, going);
            for lane in 0..WIDTH {
                let verdict = progress[lane].as_mut().zip(made[lane]).map(|(own, step)| own.judge(step));
                if verdict == Some(Convergence::Continue) {
                    continue;
                }
                progress[lane] = None;
                // A case that does not converge at once, or only to the rounding floor, is solved by its own stepper.
                if verdict == Some(Convergence::Converged) {
                    solved[lane] = iterations;
                }
            }
        }
        let (ended, measured) = (self.end(), self.measure());
        for ((lane, stepper), step) in steppers.iter_mut().enumerate().zip(&steps) {
            if let (Some(stepper), Some(step), iterations @ 1..) = (stepper, step, solved[lane]) {
                // An invalid rod is diagnosed by its own stepper.
                let [meaningful, checked] = ended.of(lane);
                stepper.store_presolved(step, iterations, checked, |state| self.unload(lane, state));
                if meaningful {
                    stepper.store_presolved_measurements(
                        &measured.of(lane),
                        |rates| self.unload_rates(lane, rates),
                        |i, force| self.of_force(lane, i, force),
                        |kappa, moment, tangent| self.unload_shape(lane, kappa, moment, tangent),
                    );
                }
            }
        }
        solved.iter().filter(|iterations| **iterations > 0).count() as u64
    }

    /// Moves the case in `lane` to another `fluid` and recomputes its coefficients. Returns false if they cannot be batched.
    fn enter(&mut self, lane: usize, fluid: Fluid) -> bool {
        let other = viscosity_and_density(fluid);
        if self.fluids[lane] == other {
            return true;
        }
        let Self { models, rods, others, fluids, .. } = self;
        for (e, parts) in rods.drag.iter_mut().enumerate() {
            let Some(coefficients) = drag_coefficients(&models[lane], fluid, e) else { return false };
            parts.iter_mut().zip(coefficients).for_each(|(part, own)| part.set(lane, own.to_array()));
        }
        others.enter(lane, &models[lane].forces, fluid);
        fluids[lane] = other;
        true
    }

    /// Writes the initial guess of steps of this [kind](PresolvedStep::kind).
    fn guess(&mut self, kind: (f64, StepWeights, bool)) {
        let Self { simd, rods, at, before, motion, .. } = self;
        simd.vectorize(
            #[inline(always)]
            || guess(rods, at, before, motion, kind),
        );
    }

    /// Evaluates the geometry of the rods at the end of their steps.
    fn end(&mut self) -> StepChecks {
        let Self { simd, rods, at, before, motion, workspace, .. } = self;
        simd.vectorize(
            #[inline(always)]
            || StepChecks {
                least: bend(rods, at, motion, workspace),
                least_turn: {
                    let clamp_tangents =
                        at.clamp_tangent_before.zip(at.clamp_tangent).map(|(before, after)| [before, after]);
                    lengths::least_turn(clamp_tangents, &before.motion.q, &motion.q).unwrap_or(at.flow.x.like(0.0))
                },
            },
        )
    }

    /// Measures the rods at the end of their steps.
    fn measure(&mut self) -> BatchedMeasurements<Lanes> {
        let Self { simd, rods, others, at, motion, workspace, .. } = self;
        let sums = simd.vectorize(
            #[inline(always)]
            || measure(rods, at, motion, workspace),
        );
        others.measure(*simd, &motions(motion, &workspace.edges, at), &mut workspace.wholes);
        let held = simd.vectorize(
            #[inline(always)]
            || held(rods, at, motion, workspace),
        );
        BatchedMeasurements { sums, held }
    }

    /// Powers of force `i` on the case in `lane`, with the energy (J) and momentum (N s) that the force stores.
    fn of_force(&self, lane: usize, i: usize, force: &dyn Force) -> (Powers, (f64, Vector2<f64>)) {
        let Self { others, at, motion, workspace, .. } = self;
        let motions = motions(motion, &workspace.edges, at);
        others.of_case((i, force), lane, &motions, at.fluids[lane], &workspace.wholes)
    }

    /// Loads the start of a case's step, and the quantities that depend on the time of its end.
    fn load(&mut self, lane: usize, dynamics: &Dynamics, [from, to]: [&State; 2]) {
        let Self { at, before: StepStart { motion: NodalMotion { q, v, a }, memory }, .. } = self;
        for (to, from) in [(q, &from.q), (v, &from.v), (a, &from.a), (memory, &from.memory)] {
            write(to, lane, from, 1.0);
        }
        for (head, to) in at.head.iter_mut().zip([&to.q, &to.v, &to.a]) {
            write(std::slice::from_mut(head), lane, to, 1.0);
        }
        for (to, from) in [(&mut at.natural, &dynamics.natural), (&mut at.natural_rate, &dynamics.natural_rate)] {
            to.iter_mut().zip(from).for_each(|(to, from)| to.set(lane, *from));
        }
        write_vector(&mut at.flow, lane, dynamics.inputs.fluid.flow);
        at.fluids[lane] = dynamics.inputs.fluid;
        if let (Some(to), Some(clamp_tangent)) = (&mut at.clamp_tangent, dynamics.clamp_tangent()) {
            write_vector(to, lane, clamp_tangent);
        }
        at.clamp_spin.set(lane, dynamics.held.map_or(0.0, |[_, _, angle]| angle.rate));
        if let (Some(to), Some(clamp_tangent)) = (&mut at.clamp_tangent_before, dynamics.clamp_tangent_before(from)) {
            write_vector(to, lane, clamp_tangent);
        }
        let loads = at.loads.iter_mut().zip(at.loaded).zip(dynamics.loads_by_source());
        for ((to, _), load) in loads.filter(|((_, loaded), _)| *loaded) {
            match load {
                Some((force, factor)) => write(to, lane, force, factor),
                None => to.iter_mut().flatten().for_each(|x| x.set(lane, 0.0)),
            }
        }
    }

    /// Writes the solution of a case to `state`.
    fn unload(&self, lane: usize, state: &mut State) {
        let NodalMotion { q, v, a } = &self.motion;
        for (from, to) in [(q, &mut state.q), (v, &mut state.v), (a, &mut state.a)] {
            for (from, to) in from.iter().zip(to.as_chunks_mut().0) {
                *to = [from[0].get(lane), from[1].get(lane)];
            }
        }
    }

    /// Writes the rates of strain of a case with a damped material.
    fn unload_rates(&self, lane: usize, to: &mut StrainRates) {
        let Some(from) = &self.workspace.rates else { return };
        for (to, from) in to.edges.iter_mut().zip(&from.edges) {
            *to = EdgeRate { stretching: from.stretching.get(lane), spin: from.spin.get(lane) };
        }
        to.clamp_spin = from.clamp_spin.get(lane);
        for (to, from) in [(&mut to.joints, &from.joints), (&mut to.viscosity, &from.viscosity)] {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = from.get(lane));
        }
    }

    /// Writes the curvatures, moments and tangents of a case.
    fn unload_shape(&self, lane: usize, kappa: &mut [f64], moment: &mut [f64], tangent: &mut [Vector2<f64>]) {
        for (from, to) in [(&self.workspace.kappa, kappa), (&self.workspace.moment, moment)] {
            from.iter().zip(to).for_each(|(from, to)| *to = from.get(lane));
        }
        for (edge, tangent) in self.workspace.edges.iter().zip(tangent) {
            *tangent = Vector2::new(edge.t.x.get(lane), edge.t.y.get(lane));
        }
    }

    /// Makes one Newton iteration for the cases that are `going`. Returns `None` for a case whose rod is invalid (folded, or with
    /// an edge of zero length) or whose linear system is not solved to rounding.
    fn iterate(&mut self, direction: Direction, going: [bool; WIDTH]) -> [Option<Iteration>; WIDTH] {
        let Self { simd, models, rods, others, at, motion, workspace, .. } = self;
        let least = simd.vectorize(
            #[inline(always)]
            || bend(rods, at, motion, workspace),
        );
        if !others.are_none() {
            let motions = motions(motion, &workspace.edges, at);
            others.on_edges(*simd, &motions, direction, &mut workspace.around);
            for (lane, model) in models.iter().enumerate() {
                let mut tips = workspace.tips.iter_mut();
                others.on_tip(&model.forces, lane, &motions, at.fluids[lane], direction, |tip| {
                    if let Some(to) = tips.next() {
                        to.set(lane, &tip);
                    }
                });
            }
        }
        let going = mask64x4::simd_from(*simd, going.map(|going| if going { -1 } else { 0 }));
        let sizes = simd.vectorize(
            #[inline(always)]
            || solve(rods, at, motion, workspace, direction, going),
        );
        let fine = least.map(Lanes::to_array);
        let checked = sizes.in_lanes(Lanes::to_array);
        std::array::from_fn(|lane| {
            let checked = checked[lane].checked();
            let meaningful = fine.iter().all(|least| least[lane] > 0.0);
            (meaningful && checked.is_solved())
                .then_some(Iteration { increment: direction.q * checked.x, residual: checked.b })
        })
    }
}

/// The dynamics of a case.
fn dynamics(case: &Stepper) -> &Dynamics {
    case.view().dynamics
}

/// Writes `factor` times the nodal vectors of a case.
fn write(to: &mut [[Lanes; 2]], lane: usize, from: &[f64], factor: f64) {
    for (to, from) in to.iter_mut().zip(from.as_chunks::<2>().0) {
        to[0].set(lane, factor * from[0]);
        to[1].set(lane, factor * from[1]);
    }
}

fn write_vector(to: &mut Vector2<Lanes>, lane: usize, from: Vector2<f64>) {
    to.x.set(lane, from.x);
    to.y.set(lane, from.y);
}

impl TimeDependent {
    /// The nodal loads of all sources that occur.
    #[inline(always)]
    fn loads(&self) -> impl Iterator<Item = &NodalVectors> {
        self.loads.iter().zip(self.loaded).filter(|(_, loaded)| *loaded).map(|(load, _)| load)
    }
}

/// The lengths of the halves of edge `e`, and the coefficients of the drag linear in velocity along and across them in `fluid`.
fn drag_coefficients(model: &Model, fluid: Fluid, e: usize) -> Option<[f64x2; 3]> {
    let (i, drag) = model.forces.in_pass()?;
    // Only a force of the fluid whose powers are counted.
    let takes = model.forces.0[i].power_kind().is_some() && model.forces.0[i].is_of_fluid();
    drag.coefficients(fluid, e).filter(|_| takes)
}

/// The properties of a fluid that coefficients depend on.
fn viscosity_and_density(fluid: Fluid) -> [f64; 2] {
    [fluid.viscosity, fluid.density]
}

/// Validity of the rods at the ends of steps.
struct StepChecks {
    /// Smallest distances of edges and joints from invalid states.
    least: [Lanes; 3],
    /// See [`lengths::least_turn`].
    least_turn: Lanes,
}

impl StepChecks {
    /// Returns for one case whether its rod is valid, and whether it was valid throughout the step.
    fn of(&self, lane: usize) -> [bool; 2] {
        [self.least.iter().all(|least| least.get(lane) > 0.0), self.least_turn.get(lane) >= 0.0]
    }
}

impl BatchedMeasurements<Lanes> {
    /// The measurements of one case.
    fn of(&self, lane: usize) -> BatchedMeasurements {
        let one = |number: Lanes| number.get(lane);
        let two = |pair: PairLanes| f64x2::new(pair.to_array().map(one));
        let Self { sums, held } = self;
        BatchedMeasurements {
            sums: RodSums {
                bending: one(sums.bending),
                stretching: one(sums.stretching),
                kinetic: one(sums.kinetic),
                actuation: one(sums.actuation),
                moment_of_mass: two(sums.moment_of_mass),
                momentum: two(sums.momentum),
                strain: one(sums.strain),
            },
            held: Vector2::new(one(held.x), one(held.y)),
        }
    }
}

/// Evaluates the geometry of the rods, and the rates of strain of damped materials; returns the distances of edges and joints
/// from invalid states.
#[inline(always)]
fn bend(rods: &BatchedRods, at: &TimeDependent, motion: &NodalMotion, workspace: &mut Workspace) -> [Lanes; 3] {
    let (NodalMotion { q, v, .. }, Workspace { edges, joints, kappa, rates, .. }) = (motion, workspace);
    let zero = at.flow.x.like(0.0);
    let [mut short, mut long, mut folded] = [-zero.like(f64::INFINITY); 3];
    for (edge, ends) in edges.iter_mut().zip(q.windows(2)) {
        *edge = Edge::new(Vector2::new(ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]));
        (short, long) = (short.larger(-edge.length), long.larger(edge.length));
    }
    bend::joints(
        at.clamp_tangent,
        edges,
        &rods.stiffness,
        &at.natural,
        joints,
        kappa,
        #[inline(always)]
        |_, beyond_fold| folded = folded.larger(-beyond_fold),
    );
    if let Some((damping, rates)) = rods.damping.as_ref().zip(rates.as_mut()) {
        rates.clamp_spin = at.clamp_spin;
        rates.read_edges(edges, v);
        rates.read_joints(rods.joints.clone(), &rods.stiffness, damping, kappa, &at.natural_rate);
        damping.resist(rods.joints.clone(), &rods.stiffness, rates, [kappa, &at.natural_rate], joints);
    }
    let [shortest, longest] = rods.lengths;
    [-short - shortest, longest - long, -folded - zero.like(bend::FOLD)]
}

/// Writes the initial guess of a step, see [`Stage::guess`](crate::integrator).
#[inline(always)]
fn guess(
    rods: &BatchedRods,
    at: &TimeDependent,
    StepStart { motion: before, memory }: &StepStart,
    NodalMotion { q, v, a }: &mut NodalMotion,
    (h, rule, keeps_lengths): (f64, StepWeights, bool),
) {
    let (zero, direction) = (at.flow.x.like(0.0), rule.direction());
    let [change, most] = changes(h, &before.v, &before.a, zero);
    for (k, ((q, v), a)) in q.iter_mut().zip(&mut *v).zip(&mut *a).enumerate() {
        for i in 0..2 {
            let foot = rule.explicit_part(h, before.v[k][i], before.a[k][i], Some(memory[k][i]));
            let u = Lanes::where_at_most(change, most, foot.guess, foot.staying(direction));
            [q[i], v[i], a[i]] = foot.with(direction, before.q[k][i], u);
        }
    }
    if rods.held {
        [q[0], v[0], a[0]] = at.head;
    }
    if keeps_lengths {
        let free = (!rods.held).then_some(rods.total_mass);
        match &rods.damping {
            None => lengths::keep(&before.q, [q, v, a], &rods.mass, free, direction),
            Some(Damping { stretching, .. }) => {
                lengths::keep_tensions([&before.q, &before.v], [q, v, a], &rods.mass, free, direction, stretching);
            }
        }
    }
}

/// The motion of rods with these `edges`.
#[inline(always)]
fn motions<'a>(
    NodalMotion { q, v, a }: &'a NodalMotion,
    edges: &'a [Edge<Lanes>],
    at: &TimeDependent,
) -> LaneMotion<'a> {
    LaneMotion { edges, q, v, a, flow: PairLanes::new(at.flow.into()) }
}

/// Measures the rods, and the drag on them.
#[inline(always)]
fn measure(rods: &BatchedRods, at: &TimeDependent, motion: &NodalMotion, workspace: &mut Workspace) -> RodSums<Lanes> {
    let (Workspace { edges, kappa, moment, wholes, .. }, NodalMotion { q, v, .. }) = (workspace, motion);
    let zero = at.flow.x.like(0.0);
    bend::moments(&rods.stiffness, kappa, &at.natural, moment);
    let moving = MovingRod {
        cells: &rods.cells,
        edges,
        mass: &rods.mass,
        q,
        v,
        kappa,
        natural: &at.natural,
        natural_rate: &at.natural_rate,
        moment,
    };
    if let Some(i) = rods.in_pass {
        let halves = rods.drag.iter().map(
            #[inline(always)]
            |[lengths, along, across]| (*lengths, [*along, *across]),
        );
        wholes[i] = measure_drag(
            &motions(motion, edges, at),
            halves,
            #[inline(always)]
            |coefficients, u, w| Traction::linear(coefficients, u, w).0,
        );
    }
    RodSums::of(&moving, zero)
}

/// M a − F of a held node 0.
#[inline(always)]
fn held(
    rods: &BatchedRods,
    at: &TimeDependent,
    NodalMotion { a, .. }: &NodalMotion,
    workspace: &Workspace,
) -> Vector2<Lanes> {
    let (Workspace { edges, joints, wholes, rates, .. }, zero) = (workspace, at.flow.x.like(0.0));
    if !rods.held {
        return Vector2::new(zero, zero);
    }
    let (cell, edge) = (&rods.cells[0], &edges[0]);
    let elastic = cell.tension(edge);
    let damped = KelvinVoigt::of(rods.damping.as_ref(), rates.as_ref());
    let tension = damped.map_or(elastic, |damped| damped.tension(0, cell, elastic));
    let carried = elastic::force(edge, tension, &joints[0], &joints[1]);
    let load = at.loads().fold(
        [zero; 2],
        #[inline(always)]
        |sum, load| [sum[0] + load[0][0], sum[1] + load[0][1]],
    );
    let mut opposing = PairLanes::new([zero; 2]);
    for whole in wholes {
        opposing += whole.first;
    }
    let opposing = opposing.to_array();
    let push = |i: usize| a[0][i] * rods.mass[0] - load[i] - carried[i] + opposing[i];
    Vector2::new(push(0), push(1))
}

/// Assembles the linear system of rods of a `material`: inertia, elasticity, damping and forces on edges.
#[inline(always)]
fn assemble(
    material: impl MaterialLaw<Lanes>,
    rods: &BatchedRods,
    at: &TimeDependent,
    deformed: Deformed<'_, Lanes>,
    (v, others): (&NodalVectors, &[EdgeForce<Lanes>]),
    residual: &mut NodalVectors,
    (rows, direction): (&mut [BlockRow<Lanes>], Direction),
) {
    let flow = PairLanes::new(at.flow.into());
    let around = deformed.edges.iter().zip(v.windows(2)).enumerate().map(
        #[inline(always)]
        |(e, (edge, v))| {
            let others = others.get(e);
            let Some([lengths, along, across]) = rods.drag.get(e).copied() else { return others.copied() };
            let [u, w] = against(edge, v, flow);
            let mut on = local::around(edge, lengths, [u, w], Traction::linear([along, across], u, w), direction);
            if let Some(others) = others {
                on.add(others);
            }
            Some(on)
        },
    );
    deformed.assemble_with(material, around, residual, Some((rows, direction)));
}

/// Assembles and solves the linear system, and applies the increment.
#[inline(always)]
fn solve(
    rods: &BatchedRods,
    at: &TimeDependent,
    motion: &mut NodalMotion,
    Workspace { edges, joints, rates, around: others, tips, rows, residual, solution, band, .. }: &mut Workspace,
    direction: Direction,
    going: mask64x4<Avx2>,
) -> ResidualSizes<PairLanes> {
    let zero = at.flow.x.like(0.0);
    let deformed = Deformed { cells: &rods.cells, mass: &rods.mass, edges, joints, a: &motion.a };
    let around = (&motion.v, &others[..]);
    match KelvinVoigt::of(rods.damping.as_ref(), rates.as_ref()) {
        None => assemble(Elastic, rods, at, deformed, around, residual, (rows, direction)),
        Some(damped) => assemble(damped, rods, at, deformed, around, residual, (rows, direction)),
    }
    if let ([.., r], [.., row]) = (&mut residual[..], &mut rows[..]) {
        for tip in &*tips {
            *r = [r[0] + tip.force[0], r[1] + tip.force[1]];
            for (entry, block) in row.iter_mut().zip(&tip.blocks) {
                for (x, y) in entry.iter_mut().zip(block) {
                    *x += *y;
                }
            }
        }
    }
    for load in at.loads() {
        for (r, w) in residual.iter_mut().zip(load) {
            *r = [r[0] - w[0], r[1] - w[1]];
        }
    }
    if rods.held {
        residual[0] = [zero; 2];
        prescribe(rows, 0);
    }
    solution.copy_from_slice(residual);
    band.eliminate(rows, solution);
    let sizes = ResidualSizes::of(rows, solution, residual);
    let NodalMotion { q, v, a } = motion;
    for (((q, v), a), d) in q.iter_mut().zip(v).zip(a).zip(&*solution) {
        for i in 0..2 {
            let d = d[i].of(going);
            q[i] = q[i] - zero.like(direction.q) * d;
            v[i] = v[i] - zero.like(direction.v) * d;
            a[i] = a[i] - zero.like(direction.a) * d;
        }
    }
    sizes
}
