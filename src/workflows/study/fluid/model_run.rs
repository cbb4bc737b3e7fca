//! A run with one fluid model: its means, the forces of each source along the rod and over a cycle, and frames for the animation.

use std::ops::{ControlFlow, RangeInclusive};
use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use crate::cycle::{ACTUATION_POWER, EFFICIENCY};
use crate::error::{Error, Result};
use crate::fluid::force::visit_alone;
use crate::fluid::{Force, body};
use crate::reduced::MotionAndPower;
use crate::report::sampling::{Sampling, fastest_drive};
use crate::report::{DrawnRod, Frame, RodMotion, drawn_nodes};
use crate::rod::{Edge, Rod, node};
use crate::scene::Scene;
use crate::spectrum::Spectrum;
use crate::stepper::Stepper;
use crate::study::study_run::{RunOptions, StudyRun};
use crate::variable::View;

/// Number of times in the last period at which forces are sampled.
pub const PHASES: usize = 48;
/// Frames of the animation.
const FRAMES: RangeInclusive<usize> = 120..=240;
/// Most points per frame.
const MAX_FRAME_POINTS: usize = 40;

/// Short runs are repeated in order to time them.
const RUN_OPTIONS: RunOptions = RunOptions { samples: 8, push: None, halving: true, timed: true };

/// The forces of one source on the rod, along and across the head's direction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ForceBreakdown {
    /// Name of the source.
    pub name: String,
    /// Mean force per length over the last period at each node, N/m.
    pub along: Vec<f64>,
    /// Root mean square of the force per length across the head's direction, N/m.
    pub across: Vec<f64>,
    /// Total force at each of [`PHASES`] equidistant times of the last period, N.
    pub cycle: Vec<f64>,
}

/// A run with one fluid model.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FluidModelRun {
    /// Its cost, and its failure, if any.
    pub run: StudyRun,
    /// Means of motion and power.
    pub means: Option<MotionAndPower>,
    /// Mean power of the actuation (W) and efficiency.
    pub actuation_power: Option<f64>,
    pub efficiency: Option<f64>,
    /// Forces by source.
    pub parts: Vec<ForceBreakdown>,
    /// Its motion, if it has been run.
    pub motion: Option<RodMotion>,
}

/// Equidistant times.
struct SampleTimes {
    next: usize,
    count: usize,
    from: f64,
    by: f64,
}

impl SampleTimes {
    /// The next time, if it is not after `now`.
    fn pass(&mut self, now: f64) -> Option<f64> {
        let t = self.from + self.by * self.next as f64;
        (self.next < self.count && t <= now).then(|| {
            self.next += 1;
            t
        })
    }
}

impl FluidModelRun {
    /// Runs `scene`; `None` if it was interrupted.
    pub fn of(scene: &Scene, interrupted: &AtomicBool) -> Option<Self> {
        let run = StudyRun::of(scene, RUN_OPTIONS, interrupted)?;
        let mut swim =
            Self { run, means: None, actuation_power: None, efficiency: None, parts: Vec::new(), motion: None };
        if swim.is_complete()
            && let Err(error) = swim.follow(scene, interrupted)
        {
            swim.run.failure = Some((crate::study::study_run::Failure::Step, 0.0, error.to_string()));
        }
        (!interrupted.load(Ordering::Relaxed)).then_some(swim)
    }

    /// True if the run reached its end.
    pub fn is_complete(&self) -> bool {
        self.run.is_complete(RUN_OPTIONS)
    }

    fn follow(&mut self, scene: &Scene, interrupted: &AtomicBool) -> Result<()> {
        let mut stepper = Stepper::of(scene)?;
        let duration = scene.solver.duration_s.get();
        let period = Spectrum::of_model(stepper.model()).slowest().map(f64::recip).filter(|period| *period < duration);
        let last = period.unwrap_or(duration);
        let mut phases = SampleTimes {
            next: 0,
            count: PHASES,
            from: duration - last * (1.0 - 0.5 / PHASES as f64),
            by: last / PHASES as f64,
        };
        let drive = fastest_drive(scene, stepper.model());
        let sampling = Sampling::of(duration, drive, &FRAMES);
        let played = sampling.last.unwrap_or(duration);
        let count = (played / sampling.spacing).round().max(1.0);
        let mut shown = SampleTimes { next: 0, count: count as usize + 1, from: duration - played, by: played / count };
        let causes = scene.parts_of_fluid(&stepper.model().rod)?;
        let mut forces = ForceSamples::new(causes.iter().map(|(_, force)| &**force).collect());
        let model = stepper.model();
        let rod = DrawnRod::at(Some(model), drawn_nodes(model.rod.nodes, MAX_FRAME_POINTS));
        let frame = |view: &View<'_>| Frame::of(view, rod.nodes());
        let mut frames = Vec::new();
        if shown.pass(0.0).is_some() {
            frames.push(frame(&stepper.view()));
        }
        let mut failed = None;
        for span in scene.spans() {
            let whole = stepper.advance_until_failure(span, |stepper| {
                if interrupted.load(Ordering::Relaxed) {
                    return ControlFlow::Break(());
                }
                // Rounding may place the end slightly before the last time.
                let now = stepper.time() + 1e-9 * duration;
                while let Some(t) = shown.pass(now) {
                    match at(stepper, t, frame) {
                        Ok(frame) => frames.push(frame),
                        Err(error) => failed = Some(error),
                    }
                }
                while let Some(t) = phases.pass(now) {
                    if let Err(error) = at(stepper, t, |view| forces.look(view)) {
                        failed = Some(error);
                    }
                }
                if failed.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            })?;
            if !whole {
                break;
            }
        }
        if let Some(error) = failed {
            return Err(error);
        }
        let dynamics = stepper.view().dynamics;
        self.means = MotionAndPower::of(stepper.cycles(), dynamics);
        let averages = stepper.cycles().averages(dynamics);
        (self.actuation_power, self.efficiency) = (averages.mean(&ACTUATION_POWER), averages.mean(&EFFICIENCY));
        let is_of_last_periods = sampling.last.is_some();
        self.motion = Some(RodMotion { rod, frames, drive, is_of_last_periods });
        let names = causes.iter().map(|(name, _)| *name);
        self.parts = names.enumerate().map(|(i, name)| forces.part(&stepper.model().rod, i, name)).collect();
        Ok(())
    }
}

/// The result of `look` at time `t`. Dense output does not exist within the first part of a halved step; the end of the step is used then.
fn at<T>(stepper: &mut Stepper, t: f64, mut look: impl FnMut(&View<'_>) -> T) -> Result<T> {
    match stepper.at(t, &mut look) {
        Err(Error::OutsideStep { .. }) => Ok(look(&stepper.view())),
        outcome => outcome,
    }
}

/// The forces of each source on each node, at all sampled times.
struct ForceSamples<'a> {
    causes: Vec<&'a dyn Force>,
    /// Nodal forces for each time and source, N.
    seen: Vec<Vec<Vec<Vector2<f64>>>>,
    /// Sum of the head's directions.
    ahead: Vector2<f64>,
}

impl<'a> ForceSamples<'a> {
    fn new(causes: Vec<&'a dyn Force>) -> Self {
        Self { causes, seen: Vec::with_capacity(PHASES), ahead: Vector2::zeros() }
    }

    fn look(&mut self, view: &View<'_>) {
        let state = view.state;
        let nodes = state.q.len() / 2;
        let edges: Vec<Edge> = (1..nodes).map(|k| Edge::new(node(&state.q, k) - node(&state.q, k - 1))).collect();
        let moving = view.dynamics.kinematics_of(state.t, &edges, [&state.q, &state.v, &state.a]);
        self.ahead -= edges[0].t;
        let of = |force: &&dyn Force| {
            let mut given = vec![Vector2::zeros(); nodes];
            visit_alone(*force, &moving, |k, opposing| given[k] -= opposing);
            given
        };
        self.seen.push(self.causes.iter().map(of).collect());
    }

    /// The forces of source `i`.
    fn part(&self, rod: &Rod, i: usize, name: &str) -> ForceBreakdown {
        let ahead = self.ahead.try_normalize(0.0).unwrap_or(Vector2::x());
        let times = self.seen.len().max(1) as f64;
        let first = usize::from(rod.body.is_some());
        // The drag and inertia of a body act on the link between body and rod, not along the rod.
        let spread = if [body::DRAG, body::INERTIA].contains(&name) { 0.0 } else { 1.0 };
        let per_length = |k: usize| {
            let ends = k == first || k + 1 == rod.nodes;
            spread / (times * rod.spacing * if ends { 0.5 } else { 1.0 })
        };
        let sum = |k: usize, of: &dyn Fn(Vector2<f64>) -> f64| self.seen.iter().map(|at| of(at[i][k])).sum::<f64>();
        ForceBreakdown {
            name: name.to_string(),
            along: (first..rod.nodes).map(|k| sum(k, &|force| force.dot(&ahead)) * per_length(k)).collect(),
            across: (first..rod.nodes)
                .map(|k| (sum(k, &|force| force.perp(&ahead).powi(2)) / times).sqrt() * times * per_length(k))
                .collect(),
            cycle: self.seen.iter().map(|at| at[i].iter().map(|force| force.dot(&ahead)).sum()).collect(),
        }
    }
}
