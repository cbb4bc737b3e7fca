//! Newton's method on four rods in lanes.

use std::sync::Arc;

use fearless_simd::prelude::*;
use fearless_simd::{Avx2, Level, mask64x4};
use nalgebra::Vector2;

use super::WIDTH;
use super::lanes::{Lanes, Two};
use crate::fluid::local::{self, Traction};
use crate::linear::{BlockBand, BlockRow, Number, Pair, Sizes, prescribe};
use crate::model::{Dynamics, Model, lengths_allowed};
use crate::newton::{Iteration, MAX_ITERATIONS, Progress, Verdict};
use crate::rod::bend::{self, Joint};
use crate::rod::elastic::Deformed;
use crate::rod::{Alike, Cell, Edge};
use crate::stepper::Stepper;
use crate::stepper::ahead::Ahead;
use crate::system::{Direction, State};

/// Vectors of each case, one a node.
type Nodes = Vec<[Lanes; 2]>;

/// The rods in lanes, with room to work in. Lanes without a case repeat another one.
#[derive(Debug)]
pub struct Kernel {
    simd: Avx2,
    models: [Arc<Model>; WIDTH],
    rods: Rods,
    at: Moment,
    motion: Motion,
    room: Room,
}

/// What of the rods does not change.
#[derive(Debug)]
struct Rods {
    /// True where the heads are held.
    held: bool,
    cells: Alike<Cell<Lanes>>,
    mass: Vec<Lanes>,
    /// Bending stiffness of the joints.
    stiffness: Vec<Lanes>,
    /// Lengths of the halves of every edge and drag along and across them, see
    /// [`coefficients`](crate::fluid::force::InPass::coefficients); empty without drag.
    drag: Vec<[Two; 3]>,
    /// The shortest and the longest that an edge may be.
    lengths: [Lanes; 2],
}

/// What depends on the time alone.
#[derive(Debug)]
struct Moment {
    natural: Vec<Lanes>,
    /// The tangent before the first joint of a held head.
    wall: Option<Vector2<Lanes>>,
    flow: Vector2<Lanes>,
    loads: Vec<Nodes>,
}

#[derive(Debug)]
struct Motion {
    q: Nodes,
    v: Nodes,
    a: Nodes,
}

#[derive(Debug)]
struct Room {
    edges: Vec<Edge<Lanes>>,
    joints: Vec<Joint<Lanes>>,
    kappa: Vec<Lanes>,
    rows: Vec<BlockRow<Lanes>>,
    residual: Nodes,
    solution: Nodes,
    band: BlockBand<Lanes>,
}

impl Kernel {
    /// See [`Batch::of`](super::Batch::of).
    pub fn of(steppers: &[&Stepper]) -> Option<Self> {
        let simd = Level::new().as_avx2()?;
        let first = steppers.first()?;
        let alike = |stepper: &&Stepper| stepper.shape_in_lanes() == first.shape_in_lanes();
        if !(2..=WIDTH).contains(&steppers.len()) || first.shape_in_lanes().is_none() || !steppers.iter().all(alike) {
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
        let drag = |e: usize, part: usize| {
            let end = |end: usize| {
                pack(&|lane| {
                    let model = model(lane);
                    let of = model.forces.proportional().and_then(|drag| drag.coefficients(model.fluid, e));
                    of.map_or(f64::NAN, |parts| parts[part].to_array()[end])
                })
            };
            Two::new([end(0), end(1)])
        };
        let zero = pack(&|_| 0.0);
        let edge = Edge::new(Vector2::new(zero.like(1.0), zero));
        let vectors = || vec![[zero; 2]; nodes];
        let loads = dynamics(first).loads().count();
        let edges = if first.model().forces.is_empty() { 0 } else { nodes - 1 };
        Some(Self {
            simd,
            models: std::array::from_fn(|lane| dynamics(steppers.get(lane).unwrap_or(first)).model.clone()),
            rods: Rods {
                held: first.model().head.is_some(),
                cells: Alike::all((0..nodes - 1).map(cell).collect(), cell(nodes - 2)),
                mass: (0..nodes).map(|k| pack(&|lane| rod(lane).mass[k])).collect(),
                stiffness: (0..nodes).map(|k| pack(&|lane| rod(lane).joint[k])).collect(),
                drag: (0..edges).map(|e| std::array::from_fn(|part| drag(e, part))).collect(),
                lengths: [0, 1].map(|i| pack(&|lane| lengths_allowed(rod(lane))[i])),
            },
            at: Moment {
                natural: vec![zero; nodes],
                wall: first.model().head.as_ref().map(|_| Vector2::new(zero, zero)),
                flow: Vector2::new(zero, zero),
                loads: vec![vectors(); loads],
            },
            motion: Motion { q: vectors(), v: vectors(), a: vectors() },
            room: Room {
                edges: vec![edge; nodes - 1],
                joints: vec![Joint { couple: zero, stiffness: zero }; nodes],
                kappa: vec![zero; nodes],
                rows: vec![[[zero; 4]; 5]; nodes],
                residual: vectors(),
                solution: vectors(),
                band: BlockBand::of(nodes, zero),
            },
        })
    }

    /// See [`Batch::solve_ahead`](super::Batch::solve_ahead); the number of steps that were solved.
    pub fn solve_ahead(&mut self, steppers: &mut [Option<&mut Stepper>]) -> u64 {
        let mut steps: [Option<Ahead>; WIDTH] = [None; WIDTH];
        for ((step, stepper), model) in steps.iter_mut().zip(steppers.iter_mut()).zip(&self.models) {
            let known = stepper.as_mut().filter(|stepper| Arc::ptr_eq(&dynamics(stepper).model, model));
            *step = known.and_then(|stepper| stepper.set_out_ahead());
        }
        let Some(direction) = steps.iter().flatten().map(Ahead::direction).next() else { return 0 };
        // Whoever takes another step takes it alone.
        let mut lanes = (0..WIDTH).filter(|lane| steps[*lane].is_some_and(|step| step.direction() == direction));
        let (Some(first), true) = (lanes.next(), lanes.next().is_some()) else { return 0 };
        let mut progress: [Option<Progress>; WIDTH] = [None; WIDTH]; // of those that go on
        for lane in 0..WIDTH {
            let step = steps[lane].filter(|step| step.direction() == direction);
            let own = steppers.get(lane).and_then(Option::as_deref).filter(|_| step.is_some());
            let Some(case) = own.or(steppers[first].as_deref()) else { continue };
            let (guess, start) = case.guessed();
            self.load(lane, dynamics(case), guess);
            progress[lane] = own.map(|_| start);
        }
        let mut solved = 0;
        for iterations in 1..=MAX_ITERATIONS {
            let going = progress.each_ref().map(Option::is_some);
            if going == [false; WIDTH] {
                break;
            }
            let made = self.iterate(direction, going);
            for lane in 0..WIDTH {
                let verdict = progress[lane].as_mut().zip(made[lane]).map(|(own, step)| own.judge(step));
                if verdict == Some(Verdict::GoOn) {
                    continue;
                }
                progress[lane] = None;
                // Who does not converge at once, or only to the floor of rounding, goes on alone.
                if let (Some(Verdict::Converged), Some(step), Some(Some(stepper))) =
                    (verdict, steps[lane], steppers.get_mut(lane))
                {
                    stepper.solved_ahead(step, iterations, |state| self.unload(lane, state));
                    solved += 1;
                }
            }
        }
        solved
    }

    /// Takes over the guess of a case and what depends on its time.
    fn load(&mut self, lane: usize, dynamics: &Dynamics, guess: &State) {
        let Self { at, motion: Motion { q, v, a }, .. } = self;
        for (to, from) in [(q, &guess.q), (v, &guess.v), (a, &guess.a)] {
            write(to, lane, from, 1.0);
        }
        for (to, natural) in at.natural.iter_mut().zip(&dynamics.natural) {
            to.set(lane, *natural);
        }
        write_vector(&mut at.flow, lane, dynamics.inputs.fluid.flow);
        if let (Some(to), Some(wall)) = (&mut at.wall, dynamics.wall()) {
            write_vector(to, lane, wall);
        }
        for (to, (force, factor)) in at.loads.iter_mut().zip(dynamics.loads()) {
            write(to, lane, force, factor);
        }
    }

    /// Writes the motion of a case to `state`.
    fn unload(&self, lane: usize, state: &mut State) {
        let Motion { q, v, a } = &self.motion;
        for (from, to) in [(q, &mut state.q), (v, &mut state.v), (a, &mut state.a)] {
            for (from, to) in from.iter().zip(to.as_chunks_mut().0) {
                *to = [from[0].get(lane), from[1].get(lane)];
            }
        }
    }

    /// One iteration of Newton's method; moves the cases that are `going`. `None` of a case whose rod has no meaning or whose system
    /// is not solved to rounding.
    fn iterate(&mut self, direction: Direction, going: [bool; WIDTH]) -> [Option<Iteration>; WIDTH] {
        let Self { simd, rods, at, motion, room, .. } = self;
        let going = mask64x4::simd_from(*simd, going.map(|going| if going { -1 } else { 0 }));
        let (sizes, least) = simd.vectorize(
            #[inline(always)]
            || iterate(rods, at, motion, room, direction, going),
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

/// The model of a case in motion.
fn dynamics(case: &Stepper) -> &Dynamics {
    case.view().dynamics
}

/// Writes `factor` times the vectors of a case, two numbers each.
fn write(to: &mut Nodes, lane: usize, from: &[f64], factor: f64) {
    for (to, from) in to.iter_mut().zip(from.as_chunks::<2>().0) {
        to[0].set(lane, factor * from[0]);
        to[1].set(lane, factor * from[1]);
    }
}

fn write_vector(to: &mut Vector2<Lanes>, lane: usize, from: Vector2<f64>) {
    to.x.set(lane, from.x);
    to.y.set(lane, from.y);
}

/// Assembles, solves and moves; by how much edges and joints are away from what has no meaning.
#[inline(always)]
fn iterate(
    rods: &Rods,
    at: &Moment,
    Motion { q, v, a }: &mut Motion,
    Room { edges, joints, kappa, rows, residual, solution, band }: &mut Room,
    direction: Direction,
    going: mask64x4<Avx2>,
) -> (Sizes<Two>, [Lanes; 3]) {
    let zero = at.flow.x.like(0.0);
    let [mut short, mut long, mut folded] = [-zero.like(f64::INFINITY); 3];
    for (edge, ends) in edges.iter_mut().zip(q.windows(2)) {
        *edge = Edge::new(Vector2::new(ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]));
        (short, long) = (short.larger(-edge.length), long.larger(edge.length));
    }
    bend::joints(
        at.wall,
        edges,
        &rods.stiffness,
        &at.natural,
        joints,
        kappa,
        #[inline(always)]
        |_, beyond_fold| folded = folded.larger(-beyond_fold),
    );
    let deformed = Deformed { cells: &rods.cells, mass: &rods.mass, edges: &*edges, joints: &*joints, a: &*a };
    let flow = Two::new(at.flow.into());
    let around = edges.iter().zip(v.windows(2)).enumerate().map(
        #[inline(always)]
        |(e, (edge, v))| {
            let [lengths, along, across] = rods.drag.get(e).copied()?;
            let [u, w] = edge.components([Two::new(v[0]) - flow, Two::new(v[1]) - flow]);
            Some(local::around(edge, lengths, [u, w], Traction::linear([along, across], u, w), direction))
        },
    );
    deformed.assemble(around, residual, Some((rows, direction)));
    for load in &at.loads {
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
    let sizes = Sizes::of(rows, solution, residual);
    for (((q, v), a), d) in q.iter_mut().zip(v).zip(a).zip(&*solution) {
        for i in 0..2 {
            let d = d[i].of(going);
            q[i] = q[i] - zero.like(direction.q) * d;
            v[i] = v[i] - zero.like(direction.v) * d;
            a[i] = a[i] - zero.like(direction.a) * d;
        }
    }
    let [shortest, longest] = rods.lengths;
    (sizes, [-short - shortest, longest - long, -folded - zero.like(bend::FOLD)])
}
