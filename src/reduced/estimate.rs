//! How far the cheaper models are from the whole one, without running it, and whether they are cheaper.
//!
//! What decides is how fast drag stops the rod: β = ωτ, τ = m/c the longest time in which it stops a node, ω the frequency of
//! the fastest drive, is inertia against drag.
//!
//! *Shape.* The joint moments m_k that hold the rod in its natural curvature say how far a rod of finite stiffness would
//! deviate from it: δκ_k = m_k/(EI_k/ΔL), quasi-static and to first order. The rigid motion of the prescribed shape is followed,
//! then that of the shape with δκ on top: their difference is what a model without elasticity leaves out. To that comes the
//! ringing with which the rod takes up its deviation, for force and moment on a held head.
//!
//! *Overdamped.* What it leaves out of a motion of frequency ω is β of it, however the rod bends; and at the start the τ in which
//! the rod takes up its speed. A free rod swims by a small difference of large forces: there the rigid motion without inertia is
//! followed, then the same with the inertia it leaves out, −M a, as a load.
//!
//! Nothing here takes drag to be linear. Where an estimate cannot be trusted, or costs more than a tenth of the run it may
//! spare, there is a reason instead of a number.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::Vector2;

use crate::error::Error;
use crate::fluid::Kinematics;
use crate::head::{Row, STEPS_A_PERIOD, Sample, hermite};
use crate::integrator::StepControl;
use crate::model::{Dynamics, Model};
use crate::rod::{Edge, bend, node};
use crate::spectrum::Spectrum;
use crate::start::Start;
use crate::system::State;

use super::measure::{Course, Differences, Measure, Point};
use super::rigid::{Chain, RIGID, Rigid};
use super::runge_kutta::Step;
use super::shape::STABLE;

/// The estimated errors of a cheaper model, or why there are none.
pub type Estimate = std::result::Result<Differences, String>;

/// What is estimated of the cheaper models of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimates {
    /// The shape model.
    pub shape: Estimate,
    /// The overdamped model.
    pub overdamped: Estimate,
    /// The tolerance with which steps of either add no more than [`SHARE_OF_STEPS`] of what that error leaves of the accuracy asked for;
    /// the estimates have them in it.
    pub tolerance: f64,
    /// What they have cost, in Newton iterations of the scene.
    pub work: f64,
}

/// The run that a cheaper model may spare.
#[derive(Debug, Clone, Copy)]
pub struct Run {
    /// Its duration, s.
    pub duration: f64,
    /// Nodes of the scene; the estimates may be made on fewer.
    pub nodes: usize,
    /// How the whole model chooses its steps, and how a cheaper one would.
    pub pace: [StepControl; 2],
    /// Newton iterations of a step of the whole model, about.
    pub iterations: f64,
    /// The accuracy asked for, and of what.
    pub accuracy: f64,
    /// What it is asked of.
    pub measures: [Option<Measure>; 4],
}

/// The part of the whole model's work that estimates may take, and the part they are planned with: that work is known
/// beforehand to a factor of 4.1 at best (measured on 2000 scenes).
const SHARE: f64 = 0.1;
const PLANNED: f64 = 0.022;

/// Steps of the estimates in a period of the fastest drive.
const STEPS: f64 = 10.0;

/// The part of what a cheaper model's own error leaves of the accuracy that its steps may take, and the least tolerance for it. The error
/// of the tip's way was found to be 0.3 … 1.7 of the tolerance times the length.
pub const SHARE_OF_STEPS: f64 = 0.5;
const LEAST_TOLERANCE: f64 = 1e-8;

/// Steps over which a held rod takes up its deviation.
const TAKEN_UP: f64 = 4.0;

/// Most steps of an explicit method: half a minute of ten nodes.
const MOST_STEPS: f64 = 1e7;

/// Work per node, in Newton iterations (75 ns), measured on scenes of 9 and 33 nodes: of reading a step; of a step of `shape`;
/// of a step of the estimates, both motions together; of a step of them without inertia.
const READING: f64 = 0.7;
const SHAPE_STEP: f64 = 3.5;
/// The same over that where the momentum of the water is part of the motion: 7.8 in all (an eel of 17 nodes).
const WATER: f64 = 2.2;
const FOLLOWED_STEP: f64 = 6.5;
const CREEPING_STEP: f64 = 22.0;

/// Newton iterations of adaptive steps in a period of the drive, measured on eight scenes: the whole model's 290 … 580 with a
/// tolerance of 1e-3, 2.5 times as many with 1e-4 (`baseline-smooth`); the overdamped one's up to 550 with 1e-4 and 900 with 1e-5.
const WHOLE_PERIOD: f64 = 300.0;
const OVERDAMPED_PERIOD: f64 = 550.0;

/// Part of that which is left for a free rod that loads or a flow carry along: its steps are as long as that motion allows.
const CARRIED: f64 = 0.25;

/// Periods of the slowest drive that an estimate covers at least, after the ramp, unless the run is shorter.
const PERIODS: f64 = 2.0;

/// Total deviation (rad) up to which motions are linear in it.
const LINEAR: f64 = 0.1;

/// Largest compression of the rod, over EI/L²: a clamped rod buckles at 2.5.
const SLENDER: f64 = 0.5;

/// β from which on inertia is no correction any more.
const CREEPING: f64 = 0.05;

/// What is not known of the force and moment of the whole model itself, relative: with a tolerance of 1e-6 its steps leave 2e-4 …
/// 7e-4 (measured), of stretching waves that they do not resolve. And its rounding, in roundings of EA and EI/L a node: stiff
/// rods of some micrometres feel drag that is as small.
const LOADS: f64 = 2.5e-4;
const ROUNDINGS: f64 = 4.0;

/// The estimates are this many times the differences found, of which most are right to a few per cent: a rod that rings, as none
/// of the motions followed does, is off by twice as much, and what is left out of the drive's harmonics by more.
const MARGIN: f64 = 4.0;

/// Largest error of a step of the motions followed, over the length.
const TOLERANCE: f64 = 1e-6;

/// Why there is no estimate.
struct Unknown(String);

impl From<Error> for Unknown {
    fn from(error: Error) -> Self {
        Self(format!("its error cannot be estimated: {error}"))
    }
}

fn unknown<T>(reason: impl Into<String>) -> Result<T, Unknown> {
    Err(Unknown(reason.into()))
}

/// Why the shape model cannot be run for `duration` (s), where it would take too many steps.
pub fn endless(model: &Arc<Model>, duration: f64) -> Option<String> {
    let pace = StepControl::Fixed(duration);
    let walk = Walk::new(
        model,
        Run {
            duration,
            nodes: model.rod.nodes,
            pace: [pace; 2],
            iterations: 1.0,
            accuracy: f64::INFINITY,
            measures: [None; 4],
        },
    );
    let steps = walk.stable_rate() * duration;
    (steps > MOST_STEPS).then(|| {
        format!(
            "drag stops this rod within {:.1e} s, which the explicit method of the shape model resolves in {steps:.1e} steps; allowed: a model that fits, \"overdamped\" or \"full\"",
            walk.times.stops[0]
        )
    })
}

impl Estimates {
    /// None of any model, for that reason.
    pub fn none(reason: &str) -> Self {
        let tolerance = LEAST_TOLERANCE;
        Self { shape: Err(reason.to_string()), overdamped: Err(reason.to_string()), tolerance, work: 0.0 }
    }

    /// The estimates for `run` of `model`.
    pub fn of(model: &Arc<Model>, run: Run) -> Self {
        let mut walk = Walk::new(model, run);
        let checked = |estimate: Result<Differences, Unknown>| {
            let errors = estimate.map_err(|Unknown(reason)| reason)?;
            if errors.are_finite() {
                Ok(errors)
            } else {
                Err("its error cannot be estimated: it is not finite".to_string())
            }
        };
        let (shape, overdamped) = (checked(walk.shape()), checked(walk.overdamped()));
        let work = walk.work * model.rod.nodes as f64 / run.nodes as f64;
        Self { shape, overdamped, tolerance: walk.tolerance(), work }
    }
}

/// A rod whose motions are followed.
struct Walk {
    run: Run,
    /// Done so far, in Newton iterations.
    work: f64,
    dynamics: Dynamics,
    chain: Chain,
    state: State,
    times: Times,
    /// Mass of the fluid that goes with the rod across itself, kg.
    added: f64,
    /// The tolerance of the cheaper model's steps.
    tolerance: f64,
    acceleration: Vec<f64>,
    moment: Vec<f64>,
    applied: Vec<f64>,
    curvature: [Vec<f64>; 3],
}

/// The times that decide what a motion is like, s.
#[derive(Debug, Clone, Copy)]
struct Times {
    /// The shortest period of what drives the rod, and the longest; infinite for what does not repeat itself.
    periods: [f64; 2],
    /// In which drag stops a node: the shortest time, and the longest.
    stops: [f64; 2],
}

/// A motion that was followed: its course, and what changes along it.
struct Track {
    course: Course,
    /// Of every joint (its deviation) or entry (its velocity), at the times of the course.
    values: Vec<Vec<f64>>,
    /// Largest Σ|δκ_k|, rad.
    deviation: f64,
    /// Largest sum of the forces on the nodes, N.
    force: f64,
}

impl Track {
    /// Value `k` at time `t` by cubic polynomials; at a time of the course, the mean of both sides.
    fn at(&self, k: usize, t: f64) -> Sample {
        let points = &self.course.points;
        let last = points.len() - 1;
        let slope = |a: usize, b: usize| (self.values[b][k] - self.values[a][k]) / (points[b].time - points[a].time);
        let row = |i: usize| Row {
            time: points[i].time,
            value: self.values[i][k],
            rate: match i {
                0 => slope(0, 1),
                i if i == last => slope(i - 1, i),
                i => {
                    let [before, after] = [points[i].time - points[i - 1].time, points[i + 1].time - points[i].time];
                    (slope(i - 1, i) * after + slope(i, i + 1) * before) / (before + after)
                }
            },
        };
        let after = points.partition_point(|point| point.time <= t).clamp(1, last);
        let here = hermite(&row(after - 1), &row(after), t);
        if after < 2 || t != points[after - 1].time {
            return here;
        }
        let before = hermite(&row(after - 2), &row(after - 1), t);
        Sample { acceleration: 0.5 * (here.acceleration + before.acceleration), ..here }
    }
}

impl Walk {
    fn new(model: &Arc<Model>, run: Run) -> Self {
        let nodes = model.rod.nodes;
        let zeros = || vec![0.0; nodes];
        let mut walk = Self {
            run,
            work: 0.0,
            dynamics: Dynamics::new(Arc::clone(model)),
            chain: Chain::new(&model.rod),
            state: State::zeros(2 * nodes),
            times: Times { periods: [f64::INFINITY; 2], stops: [f64::INFINITY; 2] },
            added: 0.0,
            tolerance: f64::INFINITY,
            acceleration: zeros(),
            moment: zeros(),
            applied: vec![0.0; 2 * nodes],
            curvature: [zeros(), zeros(), zeros()],
        };
        walk.added = walk.chain.added_mass(&walk.dynamics);
        walk.times = Times { periods: walk.periods(), stops: walk.stops() };
        walk
    }

    fn periods(&self) -> [f64; 2] {
        let model = &self.dynamics.model;
        let spectrum = Spectrum::of_model(model);
        let ramp = match model.start {
            Start::Ramp { duration } if model.actuation.is_some() => duration,
            _ => f64::INFINITY,
        };
        let shortest = spectrum.fastest().map_or(f64::INFINITY, f64::recip).min(ramp);
        let longest = if spectrum.is_transient { f64::INFINITY } else { spectrum.slowest().map_or(0.0, f64::recip) };
        [shortest, longest]
    }

    /// From the forces on a straight rod that moves along itself and across, about as fast as its tip is driven.
    fn stops(&mut self) -> [f64; 2] {
        let Self { dynamics, applied, .. } = self;
        let rod = &dynamics.model.rod;
        if dynamics.model.forces.is_empty() {
            return [f64::INFINITY; 2];
        }
        let fluid = dynamics.inputs.fluid;
        let speed = rod.length / self.times.periods[0].min(self.run.duration);
        let edges: Vec<Edge> = rod.cells.iter().map(|cell| Edge::along(Vector2::x(), cell.rest)).collect();
        let q: Vec<f64> = (0..rod.nodes).flat_map(|k| [rod.arc_length(k), 0.0]).collect();
        let a = vec![0.0; 2 * rod.nodes];
        let mut forces = |v: Vector2<f64>| {
            let v: Vec<f64> = (0..2 * rod.nodes).map(|i| (fluid.flow + v)[i % 2]).collect();
            let moving = Kinematics::within(fluid, &edges, [&q, &v, &a]);
            dynamics.write_applied_without_inertia(&moving, applied);
            applied.clone()
        };
        let still = forces(Vector2::zeros());
        let mut stops = [f64::INFINITY, 0.0];
        for direction in [Vector2::x(), Vector2::y()] {
            let moving = forces(direction * speed);
            for (k, mass) in rod.mass.iter().enumerate() {
                let stop = mass * speed / (node(&moving, k) - node(&still, k)).norm();
                stops = [stops[0].min(stop), stops[1].max(stop)];
            }
        }
        stops
    }

    /// β = ωτ of the fastest drive and the node that drag stops last.
    fn inertia(&self) -> f64 {
        TAU * self.times.stops[1] / self.times.periods[0]
    }

    /// The work of the whole model, in Newton iterations per node.
    fn whole_work(&self) -> f64 {
        let Run { duration, iterations, pace: [pace, _], .. } = self.run;
        match pace {
            StepControl::Fixed(step) => duration / step * (iterations + READING),
            StepControl::Adaptive(tolerance) => {
                let model = &self.dynamics.model;
                let flows = model.flow.is_some() || model.fluid.flow != Vector2::zeros();
                let flow = !model.forces.is_empty() && flows;
                let carried = model.head.is_none() && (flow || model.load.is_some());
                let period = if carried { CARRIED * WHOLE_PERIOD } else { WHOLE_PERIOD };
                duration / self.times.periods[0] * period * (1e-3 / tolerance).powf(0.45)
            }
        }
    }

    /// How many steps of that many iterations per node an estimate may take.
    fn affordable(&self, step: f64) -> f64 {
        let part = self.run.nodes as f64 / self.dynamics.model.rod.nodes as f64;
        PLANNED * self.whole_work() * part / step
    }

    /// What both models cannot do without: a start that fits, and a drive whose periods say how long to look.
    fn admitted(&mut self) -> Result<(), Unknown> {
        self.dynamics.look_at(0.0);
        let strained = self.dynamics.natural.iter().any(|k| *k != 0.0);
        let moving = self.dynamics.held.is_some_and(|pose| pose.iter().any(|s| s.rate != 0.0));
        let model = &self.dynamics.model;
        if model.start != Start::Shaped && (strained || moving) {
            return unknown("the rod is released into its motion at once, and rings");
        }
        if !self.times.periods[0].is_finite() {
            return unknown("nothing drives the rod, so no period says how long to look");
        }
        Ok(())
    }

    /// The tolerance of a cheaper model's steps.
    fn tolerance(&self) -> f64 {
        match self.run.pace[1] {
            StepControl::Adaptive(tolerance) => self.tolerance.min(tolerance),
            StepControl::Fixed(_) => self.tolerance,
        }
    }

    /// What is estimated from the `errors` found of a model that moves as `course`: with its margin, and with the errors of the model's
    /// steps, for which their tolerance is made small enough.
    fn with_steps(&mut self, errors: Differences, course: &Course) -> Differences {
        let (errors, per_length) = (errors.map(|error| MARGIN * error), course.per_length());
        let needed = self.run.measures.into_iter().flatten().filter_map(|measure| {
            let left = self.run.accuracy - errors.get(measure)?;
            Some(SHARE_OF_STEPS * left / per_length.get(measure)?)
        });
        let needed = needed.fold(f64::INFINITY, f64::min);
        // A model that is not accurate enough needs no steps.
        if needed > 0.0 {
            self.tolerance = self.tolerance.min(needed.max(LEAST_TOLERANCE));
        }
        let tolerance = self.tolerance();
        errors.with(per_length, |error, per_length| error + tolerance * per_length)
    }

    /// The time that an estimate covers with `rate` steps a second of that much work.
    fn covered(&self, rate: f64, step: f64) -> Result<f64, Unknown> {
        let ramp = match self.dynamics.model.start {
            Start::Ramp { duration } => duration,
            _ => 0.0,
        };
        let least = (ramp + PERIODS * self.times.periods[1]).min(self.run.duration);
        let covered = (self.affordable(step) / rate).min(self.run.duration);
        if covered < least {
            return unknown(format!("an estimate would cost more than {} % of the run", 100.0 * SHARE));
        }
        // It ends in the same phase as the run: means over other parts of a period are no small differences of large loads.
        let period = self.times.periods[1];
        let left_out = ((self.run.duration - covered) / period).ceil();
        if covered >= self.run.duration || !(left_out * period).is_finite() {
            return Ok(covered);
        }
        let in_phase = self.run.duration - left_out * period;
        Ok(if in_phase < least { in_phase + period } else { in_phase })
    }

    /// Steps a second of the estimates.
    fn rate(&self) -> f64 {
        (STEPS / self.times.periods[0]).max(20.0 / self.run.duration)
    }

    /// Steps a second that an explicit method needs where drag stops a free rod.
    fn stable_rate(&self) -> f64 {
        if self.dynamics.model.head.is_none() { 1.0 / (STABLE * self.times.stops[0]) } else { 0.0 }
    }

    /// What a step of the shape costs over one without the water's inertia.
    fn dearer(&self) -> f64 {
        if self.dynamics.model.forces.are_inertial() { WATER } else { 1.0 }
    }

    fn shape(&mut self) -> Result<Differences, Unknown> {
        self.admitted()?;
        let stable = self.stable_rate();
        let steps = stable.max(STEPS_A_PERIOD / self.times.periods[0]) * self.run.duration;
        let whole = self.whole_work();
        let step = SHAPE_STEP * self.dearer();
        if steps * step >= whole {
            return unknown(format!(
                "it is not cheaper: about {steps:.1e} steps, where the whole model takes the time of {:.1e}",
                whole / step
            ));
        }
        let rate = self.rate().max(stable);
        let covered = self.covered(rate, FOLLOWED_STEP * self.dearer())?;
        let plain = self.follow(true, covered, (1.5 * rate * covered) as usize + 20)?;
        self.check(&plain)?;
        let bent = self.follow_bent(&plain)?;
        let errors = self.extrapolated(&bent, &plain.course);
        let errors = self.with_loads(errors, &plain, self.ringing(covered));
        Ok(self.with_steps(errors, &bent))
    }

    /// Refuses what bends or could buckle so far that a first order says nothing.
    fn check(&self, track: &Track) -> Result<(), Unknown> {
        let rod = &self.dynamics.model.rod;
        if track.deviation > LINEAR {
            return unknown(format!("the rod deviates from its natural curvature by {:.1e} rad", track.deviation));
        }
        let weakest = rod.joints().map(|k| rod.joint[k]).fold(f64::INFINITY, f64::min) * rod.spacing;
        let compression = track.force * rod.length * rod.length / weakest;
        if compression > SLENDER {
            return unknown(format!("the forces on the rod are {compression:.1e} EI/L² and may buckle it"));
        }
        Ok(())
    }

    /// The differences of `found` from `truth`, grown over what the run lasts longer as they grow over about their second half, a whole
    /// number of periods.
    fn extrapolated(&self, truth: &Course, found: &Course) -> Differences {
        let duration = self.run.duration;
        let all = truth.differences(found);
        let last = truth.points.last().map_or(duration, |point| point.time);
        let longer = duration / last;
        if longer <= 1.0 + 1e-9 {
            return all;
        }
        let period = self.times.periods[1];
        let late = (0.5 * last / period).floor() * period;
        let until = if late > 0.0 && late < last { last - late } else { 0.5 * last };
        let half = truth.points.partition_point(|point| point.time <= until * (1.0 + 1e-9));
        let early = truth.first(half).differences(&found.first(half));
        let doublings = (last / until).log2();
        all.with(early, |all, early| {
            let power = if all > early { ((all / early).log2() / doublings).min(2.0) } else { 0.0 };
            all * longer.powf(power)
        })
    }

    /// Root mean square over `time` (s) of the ringing with which a held rod takes up the loads that its deviation must hold,
    /// over its first amplitude: it dies out with drag, or, where drag is strong, with the rod's stiffness against it.
    fn ringing(&self, time: f64) -> f64 {
        let rod = &self.dynamics.model.rod;
        let stop = self.times.stops[1];
        let weakest = rod.joints().map(|k| rod.joint[k]).fold(f64::INFINITY, f64::min) * rod.spacing;
        let mass = rod.total_mass() + self.added;
        let frequency = 3.516 * (weakest / (mass * rod.length.powi(3))).sqrt();
        let decay = if 2.0 * stop * frequency > 1.0 { 0.5 / stop } else { frequency * frequency * stop };
        if decay > 0.0 { (0.5 / (decay * time)).sqrt().min(1.0) } else { 1.0 }
    }

    /// Adds to errors of force and moment on a held head the first loads of `track`, which last by the part `lasting`, and
    /// what the whole model itself does not know them by.
    fn with_loads(&self, errors: Differences, track: &Track, lasting: f64) -> Differences {
        let rod = &self.dynamics.model.rod;
        let points = &track.course.points;
        let of = |size: &dyn Fn(&Point) -> f64, rounding: f64| {
            let count = points.len() as f64;
            let square = (points.iter().map(|point| size(point).powi(2)).sum::<f64>() / count).sqrt();
            let first = points.first().map_or(0.0, size);
            if square > 0.0 { LOADS + (lasting * first + rounding) / square } else { f64::INFINITY }
        };
        let nodes = self.run.nodes as f64;
        let rounding = ROUNDINGS * f64::EPSILON * nodes;
        let stiffness = [rod.ea, rod.ei / rod.length * nodes].map(|stiffness| rounding * stiffness);
        Differences {
            force: errors.force.map(|error| error + of(&|point| point.force.norm(), stiffness[0])),
            moment: errors.moment.map(|error| error + of(&|point| point.moment.abs(), stiffness[1])),
            ..errors
        }
    }

    fn overdamped(&mut self) -> Result<Differences, Unknown> {
        self.admitted()?;
        if self.dynamics.model.forces.are_inertial() {
            return unknown("it leaves out the inertia of the water, and with it the reactive force");
        }
        let inertia = self.inertia();
        if inertia > CREEPING {
            return unknown(format!("inertia is {inertia:.1e} of the drag"));
        }
        let Run { duration, pace: [_, pace], .. } = self.run;
        if let StepControl::Adaptive(tolerance) = pace {
            self.must_be_cheaper(tolerance)?;
        }
        // The net displacement, and means of loads, may be as small as the parts of a path that they are measured against.
        let periods = duration / self.times.periods[1];
        let late = self.times.stops[1] / duration;
        let held = self.dynamics.model.head.is_some();
        let covered = self.covered(self.rate(), if held { FOLLOWED_STEP } else { CREEPING_STEP })?;
        let drift = self.follow(false, covered, (1.5 * self.rate() * covered) as usize + 20)?;
        if held {
            let mean = inertia.max(late) * 25.0 / periods.min(25.0);
            let errors = Differences { displacement: mean, tip: inertia, force: Some(mean), moment: Some(mean) };
            let errors = self.with_loads(errors, &drift, (0.5 * late).sqrt());
            let errors = self.with_steps(errors, &drift.course);
            self.must_be_cheaper(self.tolerance())?;
            return Ok(errors);
        }
        self.check(&drift)?;
        let loaded = self.follow_loaded(&drift)?;
        let errors = self.extrapolated(&loaded, &drift.course);
        let errors = self.with_steps(errors.map(|error| error + inertia), &drift.course);
        self.must_be_cheaper(self.tolerance())?;
        Ok(errors)
    }

    /// Refuses the overdamped model where steps of that tolerance cost as much as the whole model.
    fn must_be_cheaper(&self, tolerance: f64) -> Result<(), Unknown> {
        let whole = self.whole_work();
        let periods = self.run.duration / self.times.periods[0];
        let work = periods * OVERDAMPED_PERIOD * (1e-4 / tolerance).powf(0.2);
        if work >= whole {
            return unknown(format!(
                "it is not cheaper: about {work:.1e} Newton iterations, the whole model's {whole:.1e}"
            ));
        }
        Ok(())
    }

    /// Follows the prescribed shape, with inertia or without, up to time `until` (s) in at most `steps` steps.
    fn follow(&mut self, inertia: bool, until: f64, steps: usize) -> Result<Track, Unknown> {
        let first = self.dynamics.first_state();
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        let mut rigid = self.chain.fit(&self.dynamics, natural, &first);
        let mut rates = self.rates(inertia, 0.0, &rigid);
        let course = Course::of(&self.dynamics.model);
        let mut track = Track { course, values: Vec::new(), deviation: 0.0, force: 0.0 };
        self.record(inertia, 0.0, &rigid, &rates, &mut track)?;
        let longest = (self.times.periods[0] / STEPS).min(self.run.duration / 20.0);
        let held = self.dynamics.model.head.is_some();
        let length = self.dynamics.model.rod.length;
        let (mut t, mut h) = (0.0, if held { longest } else { 0.1 * longest });
        for _ in 0..steps {
            self.work += if inertia || held { FOLLOWED_STEP * self.dearer() } else { CREEPING_STEP };
            h = h.min(longest).min(until - t);
            let to = if t + h >= until * (1.0 - 1e-9) { until } else { t + h };
            if held {
                (rigid, rates) = ([0.0; RIGID], [0.0; RIGID]);
            } else {
                let step = Step::new(t, rigid, rates, to - t, |t, rigid| self.rates(inertia, t, rigid));
                let [x, y, turn, ..] = step.error().map(f64::abs);
                let error = (x.max(y) + length * turn) / (length * TOLERANCE);
                let factor = 0.9 * error.powf(-0.2);
                if error.is_nan() || error > 1.0 {
                    h *= if factor.is_finite() { factor.max(0.1) } else { 0.1 };
                    continue;
                }
                (rigid, rates) = (step.end, step.rate());
                h *= factor.clamp(0.2, 5.0);
            }
            t = to;
            self.record(inertia, t, &rigid, &rates, &mut track)?;
            if t >= until {
                return Ok(track);
            }
        }
        unknown(format!("an estimate would cost more than {} % of the run", 100.0 * SHARE))
    }

    /// The rates of the rigid motion of the prescribed shape at time `t`.
    fn rates(&mut self, inertia: bool, t: f64, rigid: &Rigid) -> Rigid {
        if self.dynamics.model.head.is_some() {
            return [0.0; RIGID];
        }
        self.dynamics.look_at(t);
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        if inertia {
            self.chain.rates(&self.dynamics, natural, rigid)
        } else {
            self.chain.rates_without_inertia(&self.dynamics, natural, rigid)
        }
    }

    /// Places the rod at time `t` with the curvatures given, and reads it.
    fn place(
        &mut self,
        t: f64,
        curvature: Option<&[Vec<f64>; 3]>,
        rigid: &Rigid,
        rates: &Rigid,
    ) -> Result<Point, Unknown> {
        let dynamics = &mut self.dynamics;
        dynamics.look_at(t);
        dynamics.natural_acceleration(t, &mut self.acceleration);
        let natural = match curvature {
            Some(curvature) => [&curvature[0][..], &curvature[1], &curvature[2]],
            None => [&dynamics.natural[..], &dynamics.natural_rate, &self.acceleration],
        };
        let rod = &dynamics.model.rod;
        match &dynamics.held {
            Some(pose) => self.chain.hang(rod, natural, pose),
            None => self.chain.place(dynamics, natural, rigid, rates),
        }
        self.state.t = t;
        self.state.q.copy_from_slice(&self.chain.x);
        self.state.v.copy_from_slice(&self.chain.v);
        self.state.a.copy_from_slice(&self.chain.a);
        let held = dynamics.balance(&self.state, &mut self.moment)?;
        let first = dynamics.shape(&self.state)?.kappa()[0];
        let rod = &dynamics.model.rod;
        Ok(Point {
            time: t,
            com: rod.mean(&self.state.q),
            tip: node(&self.state.q, rod.nodes - 1),
            force: -held,
            moment: self.moment[0] * bend::curvature_per_turning(first),
        })
    }

    /// Adds the motion at time `t` to `track`: with inertia its deviations, without it its velocities.
    fn record(
        &mut self,
        inertia: bool,
        t: f64,
        rigid: &Rigid,
        rates: &Rigid,
        track: &mut Track,
    ) -> Result<(), Unknown> {
        let mut moving = *rigid;
        if !inertia {
            (moving[3], moving[4]) = (rates[0], rates[1]);
        }
        let mut point = self.place(t, None, &moving, rates)?;
        if !inertia {
            self.state.a.fill(0.0);
            point.force = -self.dynamics.balance(&self.state, &mut self.moment)?;
        }
        let bent = self.dynamics.shape(&self.state)?;
        bent.dynamics.write_applied(&bent.kinematics(), &mut self.applied);
        let rod = &self.dynamics.model.rod;
        let deviation: Vec<f64> = (0..rod.nodes)
            .map(|k| if rod.joints().contains(&k) { self.moment[k] / rod.joint[k] } else { 0.0 })
            .collect();
        track.deviation = track.deviation.max(deviation.iter().map(|d| d.abs()).sum());
        let forces = rod.mass.iter().enumerate();
        let force = forces.map(|(k, m)| (node(&self.applied, k) + node(&self.state.a, k) * *m).norm()).sum();
        track.force = track.force.max(force);
        track.values.push(if inertia { deviation } else { self.state.v.clone() });
        track.course.points.push(point);
        Ok(())
    }

    /// Follows the shape that deviates from its natural curvature as `plain` says, at its times. It starts without.
    fn follow_bent(&mut self, plain: &Track) -> Result<Course, Unknown> {
        let mut course = plain.course.emptied();
        let held = self.dynamics.model.head.is_some();
        // A held head feels the force with which the rod takes up its deviation: several of the times see it.
        let steps = if held { TAKEN_UP } else { 1.0 };
        let grows = Start::Ramp { duration: steps * self.times.periods[0] / STEPS };
        let first = self.dynamics.first_state();
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        let mut rigid = self.chain.fit(&self.dynamics, natural, &first);
        let mut rates = self.bent_rates(plain, &grows, 0.0, &rigid);
        let times = plain.course.points.iter().map(|point| point.time);
        let mut t = 0.0;
        for to in times {
            if !held && to > t {
                let step = Step::new(t, rigid, rates, to - t, |t, rigid| self.bent_rates(plain, &grows, t, rigid));
                (rigid, rates) = (step.end, step.rate());
            }
            t = to;
            self.bend(plain, &grows, t);
            let curvature = std::mem::take(&mut self.curvature);
            let point = self.place(t, Some(&curvature), &rigid, &rates);
            self.curvature = curvature;
            course.points.push(point?);
        }
        Ok(course)
    }

    fn bent_rates(&mut self, plain: &Track, grows: &Start, t: f64, rigid: &Rigid) -> Rigid {
        if self.dynamics.model.head.is_some() {
            return [0.0; RIGID];
        }
        self.bend(plain, grows, t);
        self.chain.rates(&self.dynamics, [&self.curvature[0], &self.curvature[1]], rigid)
    }

    /// Writes the natural curvatures at time `t` with the deviations of `plain`, their rates and second rates.
    fn bend(&mut self, plain: &Track, grows: &Start, t: f64) {
        self.dynamics.look_at(t);
        self.dynamics.natural_acceleration(t, &mut self.acceleration);
        let [gain, gain_rate] = grows.gain(t);
        let gain_acceleration = grows.gain_acceleration(t);
        for k in 0..self.acceleration.len() {
            let Sample { value, rate, acceleration } = plain.at(k, t);
            self.curvature[0][k] = self.dynamics.natural[k] + gain * value;
            self.curvature[1][k] = self.dynamics.natural_rate[k] + gain * rate + gain_rate * value;
            self.curvature[2][k] =
                self.acceleration[k] + gain * acceleration + 2.0 * gain_rate * rate + gain_acceleration * value;
        }
    }

    /// Follows the free rod's motion without inertia once more, with the inertia that `drift` leaves out as a load, and late by
    /// the time in which the rod takes up its speed.
    fn follow_loaded(&mut self, drift: &Track) -> Result<Course, Unknown> {
        let mut course = drift.course.emptied();
        let first = self.dynamics.first_state();
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        let mut rigid = self.chain.fit(&self.dynamics, natural, &first);
        let start = rigid;
        let own = self.dynamics.inputs.force.take();
        let mut rates = self.loaded_rates(drift, own.as_deref(), 0.0, &rigid);
        let late = self.times.stops[1];
        for axis in 0..3 {
            rigid[axis] = start[axis] - late * rates[axis];
        }
        let mut t = 0.0;
        for i in 0..drift.course.points.len() {
            let to = drift.course.points[i].time;
            if to > t {
                let own = own.as_deref();
                let step = Step::new(t, rigid, rates, to - t, |t, rigid| self.loaded_rates(drift, own, t, rigid));
                (rigid, rates) = (step.end, step.rate());
            }
            t = to;
            let point = self.place(t, None, &rigid, &rates)?;
            course.points.push(point);
        }
        self.dynamics.inputs.force = own;
        Ok(course)
    }

    fn loaded_rates(&mut self, drift: &Track, own: Option<&[f64]>, t: f64, rigid: &Rigid) -> Rigid {
        let rod = &self.dynamics.model.rod;
        let force = (0..2 * rod.nodes).map(|i| own.map_or(0.0, |own| own[i]) - rod.mass[i / 2] * drift.at(i, t).rate);
        self.dynamics.inputs.force = Some(force.collect());
        self.rates(false, t, rigid)
    }
}
