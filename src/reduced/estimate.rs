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
use crate::head::{Row, STEPS_A_PERIOD, Sample, hermite};
use crate::integrator::Pace;
use crate::model::{Dynamics, Model};
use crate::rod::{bend, node};
use crate::start::Start;
use crate::system::State;

use super::comparison::{Differences, ErrorMeasure, SeriesPoint, TimeSeries};
use super::rigid::{RIGID_COORDINATES, RigidChain, RigidMotion};
use super::runge_kutta::DormandPrinceStep;
use super::shape::stable_rate;
use super::time_scales::TimeScales;

/// The estimated errors of a cheaper model, or why there are none.
pub type Estimate = std::result::Result<Differences, String>;

/// What is estimated of the cheaper models of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimates {
    /// The shape model.
    pub shape: Estimate,
    /// The overdamped model.
    pub overdamped: Estimate,
    /// The tolerance with which steps of either add no more than [`STEP_ERROR_FRACTION`] of what that error leaves of the accuracy asked for;
    /// the estimates have them in it.
    pub tolerance: f64,
    /// What they have cost, in Newton iterations of the scene.
    pub work: f64,
}

/// The run that a cheaper model may spare.
#[derive(Debug, Clone, Copy)]
pub struct PlannedRun {
    /// Its duration, s.
    pub duration: f64,
    /// Nodes of the scene; the estimates may be made on fewer.
    pub nodes: usize,
    /// How the whole model chooses its steps, and how a cheaper one would.
    pub pace: [Pace; 2],
    /// Newton iterations of a step of the whole model, about.
    pub iterations: f64,
    /// The accuracy asked for, and of what.
    pub accuracy: f64,
    /// What it is asked of.
    pub measures: [Option<ErrorMeasure>; 4],
}

/// The part of the whole model's work that estimates may take, and the part they are planned with: that work is known
/// beforehand to a factor of 4.1 at best (measured on 2000 scenes).
const MAX_COST_FRACTION: f64 = 0.1;
const PLANNED_COST_FRACTION: f64 = 0.022;

/// Steps of the estimates in a period of the fastest drive.
const STEPS_PER_PERIOD: f64 = 10.0;

/// The part of what a cheaper model's own error leaves of the accuracy that its steps may take, and the least tolerance for it. The error
/// of the tip's way was found to be 0.3 … 1.7 of the tolerance times the length.
pub const STEP_ERROR_FRACTION: f64 = 0.5;
const MIN_TOLERANCE: f64 = 1e-8;

/// Steps over which a held rod takes up its deviation.
const LOADING_STEPS: f64 = 4.0;

/// Work per node, in Newton iterations (75 ns), measured on scenes of 9 and 33 nodes: of reading a step; of a step of `shape`;
/// of a step of the estimates, both motions together; of a step of them without inertia.
const MEASUREMENT_WORK: f64 = 0.7;
const SHAPE_STEP_WORK: f64 = 3.5;
/// The same over that where the momentum of the water is part of the motion: 7.8 in all (an eel of 17 nodes).
const ADDED_MASS_FACTOR: f64 = 2.2;
const RIGID_STEP_WORK: f64 = 6.5;
const CREEPING_STEP_WORK: f64 = 22.0;

/// Newton iterations of adaptive steps in a period of the drive, measured on eight scenes: the whole model's 290 … 580 with a
/// tolerance of 1e-3, 2.5 times as many with 1e-4 (`baseline-smooth`); the overdamped one's up to 550 with 1e-4 and 900 with 1e-5.
const FULL_MODEL_WORK_PER_PERIOD: f64 = 300.0;
const OVERDAMPED_WORK_PER_PERIOD: f64 = 550.0;

/// Part of that which is left for a free rod that loads or a flow carry along: its steps are as long as that motion allows.
const DRIFTING_WORK_FRACTION: f64 = 0.25;

/// Periods of the slowest drive that an estimate covers at least, after the ramp, unless the run is shorter.
const MIN_PERIODS: f64 = 2.0;

/// Total deviation (rad) up to which motions are linear in it.
const MAX_LINEAR_DEVIATION: f64 = 0.1;

/// Largest compression of the rod, over EI/L²: a clamped rod buckles at 2.5.
const MAX_COMPRESSION: f64 = 0.5;

/// β from which on inertia is no correction any more.
const MAX_INERTIA: f64 = 0.05;

/// What is not known of the force and moment of the whole model itself, relative: with a tolerance of 1e-6 its steps leave 2e-4 …
/// 7e-4 (measured), of stretching waves that they do not resolve. And its rounding, in roundings of EA and EI/L a node: stiff
/// rods of some micrometres feel drag that is as small.
const LOAD_UNCERTAINTY: f64 = 2.5e-4;
const ROUNDING_FACTOR: f64 = 4.0;

/// The estimates are this many times the differences found, of which most are right to a few per cent: a rod that rings, as none
/// of the motions followed does, is off by twice as much, and what is left out of the drive's harmonics by more.
const SAFETY_FACTOR: f64 = 4.0;

/// Largest error of a step of the motions followed, over the length.
const MAX_STEP_ERROR: f64 = 1e-6;

/// Why there is no estimate.
struct NoEstimate(String);

impl From<Error> for NoEstimate {
    fn from(error: Error) -> Self {
        Self(format!("its error cannot be estimated: {error}"))
    }
}

fn no_estimate<T>(reason: impl Into<String>) -> Result<T, NoEstimate> {
    Err(NoEstimate(reason.into()))
}

impl Estimates {
    /// None of any model, for that reason.
    pub fn none(reason: &str) -> Self {
        let tolerance = MIN_TOLERANCE;
        Self { shape: Err(reason.to_string()), overdamped: Err(reason.to_string()), tolerance, work: 0.0 }
    }

    /// The estimates for `run` of `model`.
    pub fn of(model: &Arc<Model>, run: PlannedRun) -> Self {
        let mut estimator = Estimator::new(model, run);
        let checked = |estimate: Result<Differences, NoEstimate>| {
            let errors = estimate.map_err(|NoEstimate(reason)| reason)?;
            if errors.are_finite() {
                Ok(errors)
            } else {
                Err("its error cannot be estimated: it is not finite".to_string())
            }
        };
        let (shape, overdamped) = (checked(estimator.shape()), checked(estimator.overdamped()));
        let work = estimator.work * model.rod.nodes as f64 / run.nodes as f64;
        Self { shape, overdamped, tolerance: estimator.tolerance(), work }
    }
}

/// A rod whose motions are followed.
struct Estimator {
    run: PlannedRun,
    /// Done so far, in Newton iterations.
    work: f64,
    dynamics: Dynamics,
    chain: RigidChain,
    state: State,
    times: TimeScales,
    /// Mass of the fluid that goes with the rod across itself, kg.
    added: f64,
    /// The tolerance of the cheaper model's steps.
    tolerance: f64,
    acceleration: Vec<f64>,
    moment: Vec<f64>,
    applied: Vec<f64>,
    curvature: [Vec<f64>; 3],
}

/// A motion that was followed: its course, and what changes along it.
struct SimulatedMotion {
    course: TimeSeries,
    /// Of every joint (its deviation) or entry (its velocity), at the times of the course.
    values: Vec<Vec<f64>>,
    /// Largest Σ|δκ_k|, rad.
    deviation: f64,
    /// Largest sum of the forces on the nodes, N.
    force: f64,
}

impl SimulatedMotion {
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

impl Estimator {
    fn new(model: &Arc<Model>, run: PlannedRun) -> Self {
        let nodes = model.rod.nodes;
        let zeros = || vec![0.0; nodes];
        let dynamics = Dynamics::new(Arc::clone(model));
        let times = TimeScales::of(&dynamics, run.duration);
        let mut estimator = Self {
            run,
            work: 0.0,
            dynamics,
            chain: RigidChain::new(&model.rod),
            state: State::zeros(2 * nodes),
            times,
            added: 0.0,
            tolerance: f64::INFINITY,
            acceleration: zeros(),
            moment: zeros(),
            applied: vec![0.0; 2 * nodes],
            curvature: [zeros(), zeros(), zeros()],
        };
        estimator.added = estimator.chain.added_mass(&estimator.dynamics);
        estimator
    }

    /// β = ωτ of the fastest drive and the node that drag stops last.
    fn inertia(&self) -> f64 {
        TAU * self.times.stops[1] / self.times.periods[0]
    }

    /// The work of the whole model, in Newton iterations per node.
    fn full_model_work(&self) -> f64 {
        let PlannedRun { duration, iterations, pace: [pace, _], .. } = self.run;
        match pace {
            Pace::Fixed(step) => duration / step * (iterations + MEASUREMENT_WORK),
            Pace::Adaptive(tolerance) => {
                let model = &self.dynamics.model;
                let flows = model.flow.is_some() || model.fluid.flow != Vector2::zeros();
                let flow = !model.forces.is_empty() && flows;
                let carried = model.head.is_none() && (flow || model.load.is_some());
                let period = if carried {
                    DRIFTING_WORK_FRACTION * FULL_MODEL_WORK_PER_PERIOD
                } else {
                    FULL_MODEL_WORK_PER_PERIOD
                };
                duration / self.times.periods[0] * period * (1e-3 / tolerance).powf(0.45)
            }
        }
    }

    /// How many steps of that many iterations per node an estimate may take.
    fn affordable_steps(&self, step: f64) -> f64 {
        let part = self.run.nodes as f64 / self.dynamics.model.rod.nodes as f64;
        PLANNED_COST_FRACTION * self.full_model_work() * part / step
    }

    /// What both models cannot do without: a start that fits, and a drive whose periods say how long to look.
    fn check_preconditions(&mut self) -> Result<(), NoEstimate> {
        self.dynamics.look_at(0.0);
        let strained = self.dynamics.natural.iter().any(|k| *k != 0.0);
        let moving = self.dynamics.held.is_some_and(|pose| pose.iter().any(|s| s.rate != 0.0));
        let model = &self.dynamics.model;
        if model.start != Start::Shaped && (strained || moving) {
            return no_estimate("the rod is released into its motion at once, and rings");
        }
        if !self.times.periods[0].is_finite() {
            return no_estimate("nothing drives the rod, so no period says how long to look");
        }
        Ok(())
    }

    /// The tolerance of a cheaper model's steps.
    fn tolerance(&self) -> f64 {
        match self.run.pace[1] {
            Pace::Adaptive(tolerance) => self.tolerance.min(tolerance),
            Pace::Fixed(_) => self.tolerance,
        }
    }

    /// What is estimated from the `errors` found of a model that moves as `course`: with its margin, and with the errors of the model's
    /// steps, for which their tolerance is made small enough.
    fn with_step_errors(&mut self, errors: Differences, course: &TimeSeries) -> Differences {
        let (errors, per_length) = (errors.map(|error| SAFETY_FACTOR * error), course.errors_per_length());
        let needed = self.run.measures.into_iter().flatten().filter_map(|measure| {
            let left = self.run.accuracy - errors.get(measure)?;
            Some(STEP_ERROR_FRACTION * left / per_length.get(measure)?)
        });
        let needed = needed.fold(f64::INFINITY, f64::min);
        // A model that is not accurate enough needs no steps.
        if needed > 0.0 {
            self.tolerance = self.tolerance.min(needed.max(MIN_TOLERANCE));
        }
        let tolerance = self.tolerance();
        errors.with(per_length, |error, per_length| error + tolerance * per_length)
    }

    /// The time that an estimate covers with `rate` steps a second of that much work.
    fn covered_time(&self, rate: f64, step: f64) -> Result<f64, NoEstimate> {
        let ramp = match self.dynamics.model.start {
            Start::Ramp { duration } => duration,
            _ => 0.0,
        };
        let least = (ramp + MIN_PERIODS * self.times.periods[1]).min(self.run.duration);
        let covered = (self.affordable_steps(step) / rate).min(self.run.duration);
        if covered < least {
            return no_estimate(format!("an estimate would cost more than {} % of the run", 100.0 * MAX_COST_FRACTION));
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
        (STEPS_PER_PERIOD / self.times.periods[0]).max(20.0 / self.run.duration)
    }

    /// What a step of the shape costs over one without the water's inertia.
    fn added_mass_factor(&self) -> f64 {
        if self.dynamics.model.forces.are_inertial() { ADDED_MASS_FACTOR } else { 1.0 }
    }

    fn shape(&mut self) -> Result<Differences, NoEstimate> {
        self.check_preconditions()?;
        let stable = stable_rate(&self.dynamics.model, &self.times);
        let steps = stable.max(STEPS_A_PERIOD / self.times.periods[0]) * self.run.duration;
        let whole = self.full_model_work();
        let step = SHAPE_STEP_WORK * self.added_mass_factor();
        if steps * step >= whole {
            return no_estimate(format!(
                "it is not cheaper: about {steps:.1e} steps, where the whole model takes the time of {:.1e}",
                whole / step
            ));
        }
        let rate = self.rate().max(stable);
        let covered = self.covered_time(rate, RIGID_STEP_WORK * self.added_mass_factor())?;
        let plain = self.simulate_shape(true, covered, (1.5 * rate * covered) as usize + 20)?;
        self.check_linearity(&plain)?;
        let bent = self.simulate_deviated(&plain)?;
        let errors = self.extrapolated(&bent, &plain.course);
        let errors = self.with_load_errors(errors, &plain, self.ringing(covered));
        Ok(self.with_step_errors(errors, &bent))
    }

    /// Refuses what bends or could buckle so far that a first order says nothing.
    fn check_linearity(&self, simulated: &SimulatedMotion) -> Result<(), NoEstimate> {
        let rod = &self.dynamics.model.rod;
        if simulated.deviation > MAX_LINEAR_DEVIATION {
            return no_estimate(format!(
                "the rod deviates from its natural curvature by {:.1e} rad",
                simulated.deviation
            ));
        }
        let weakest = rod.joints().map(|k| rod.joint[k]).fold(f64::INFINITY, f64::min) * rod.spacing;
        let compression = simulated.force * rod.length * rod.length / weakest;
        if compression > MAX_COMPRESSION {
            return no_estimate(format!("the forces on the rod are {compression:.1e} EI/L² and may buckle it"));
        }
        Ok(())
    }

    /// The differences of `found` from `truth`, grown over what the run lasts longer as they grow over about their second half, a whole
    /// number of periods.
    fn extrapolated(&self, truth: &TimeSeries, found: &TimeSeries) -> Differences {
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
        let early = truth.first_points(half).differences(&found.first_points(half));
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

    /// Adds to errors of force and moment on a held head the first loads of `simulated`, which last by the part `lasting`, and
    /// what the whole model itself does not know them by.
    fn with_load_errors(&self, errors: Differences, simulated: &SimulatedMotion, lasting: f64) -> Differences {
        let rod = &self.dynamics.model.rod;
        let points = &simulated.course.points;
        let of = |size: &dyn Fn(&SeriesPoint) -> f64, rounding: f64| {
            let count = points.len() as f64;
            let square = (points.iter().map(|point| size(point).powi(2)).sum::<f64>() / count).sqrt();
            let first = points.first().map_or(0.0, size);
            if square > 0.0 { LOAD_UNCERTAINTY + (lasting * first + rounding) / square } else { f64::INFINITY }
        };
        let nodes = self.run.nodes as f64;
        let rounding = ROUNDING_FACTOR * f64::EPSILON * nodes;
        let stiffness = [rod.ea, rod.ei / rod.length * nodes].map(|stiffness| rounding * stiffness);
        Differences {
            force: errors.force.map(|error| error + of(&|point| point.force.norm(), stiffness[0])),
            moment: errors.moment.map(|error| error + of(&|point| point.moment.abs(), stiffness[1])),
            ..errors
        }
    }

    fn overdamped(&mut self) -> Result<Differences, NoEstimate> {
        self.check_preconditions()?;
        if self.dynamics.model.forces.are_inertial() {
            return no_estimate("it leaves out the inertia of the water, and with it the reactive force");
        }
        let inertia = self.inertia();
        if inertia > MAX_INERTIA {
            return no_estimate(format!("inertia is {inertia:.1e} of the drag"));
        }
        let PlannedRun { duration, pace: [_, pace], .. } = self.run;
        if let Pace::Adaptive(tolerance) = pace {
            self.check_cost(tolerance)?;
        }
        // The net displacement, and means of loads, may be as small as the parts of a path that they are measured against.
        let periods = duration / self.times.periods[1];
        let late = self.times.stops[1] / duration;
        let held = self.dynamics.model.head.is_some();
        let covered = self.covered_time(self.rate(), if held { RIGID_STEP_WORK } else { CREEPING_STEP_WORK })?;
        let drift = self.simulate_shape(false, covered, (1.5 * self.rate() * covered) as usize + 20)?;
        if held {
            let mean = inertia.max(late) * 25.0 / periods.min(25.0);
            let errors = Differences { displacement: mean, tip: inertia, force: Some(mean), moment: Some(mean) };
            let errors = self.with_load_errors(errors, &drift, (0.5 * late).sqrt());
            let errors = self.with_step_errors(errors, &drift.course);
            self.check_cost(self.tolerance())?;
            return Ok(errors);
        }
        self.check_linearity(&drift)?;
        let loaded = self.simulate_with_inertial_load(&drift)?;
        let errors = self.extrapolated(&loaded, &drift.course);
        let errors = self.with_step_errors(errors.map(|error| error + inertia), &drift.course);
        self.check_cost(self.tolerance())?;
        Ok(errors)
    }

    /// Refuses the overdamped model where steps of that tolerance cost as much as the whole model.
    fn check_cost(&self, tolerance: f64) -> Result<(), NoEstimate> {
        let whole = self.full_model_work();
        let periods = self.run.duration / self.times.periods[0];
        let work = periods * OVERDAMPED_WORK_PER_PERIOD * (1e-4 / tolerance).powf(0.2);
        if work >= whole {
            return no_estimate(format!(
                "it is not cheaper: about {work:.1e} Newton iterations, the whole model's {whole:.1e}"
            ));
        }
        Ok(())
    }

    /// Follows the prescribed shape, with inertia or without, up to time `until` (s) in at most `steps` steps.
    fn simulate_shape(&mut self, inertia: bool, until: f64, steps: usize) -> Result<SimulatedMotion, NoEstimate> {
        let first = self.dynamics.first_state();
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        let mut rigid = self.chain.fit_state(&self.dynamics, natural, &first);
        let mut rates = self.rates(inertia, 0.0, &rigid);
        let course = TimeSeries::of(&self.dynamics.model);
        let mut simulated = SimulatedMotion { course, values: Vec::new(), deviation: 0.0, force: 0.0 };
        self.record(inertia, 0.0, &rigid, &rates, &mut simulated)?;
        let longest = (self.times.periods[0] / STEPS_PER_PERIOD).min(self.run.duration / 20.0);
        let held = self.dynamics.model.head.is_some();
        let length = self.dynamics.model.rod.length;
        let (mut t, mut h) = (0.0, if held { longest } else { 0.1 * longest });
        for _ in 0..steps {
            self.work += if inertia || held { RIGID_STEP_WORK * self.added_mass_factor() } else { CREEPING_STEP_WORK };
            h = h.min(longest).min(until - t);
            let to = if t + h >= until * (1.0 - 1e-9) { until } else { t + h };
            if held {
                (rigid, rates) = ([0.0; RIGID_COORDINATES], [0.0; RIGID_COORDINATES]);
            } else {
                let step = DormandPrinceStep::new(t, rigid, rates, to - t, |t, rigid| self.rates(inertia, t, rigid));
                let [x, y, turn, ..] = step.error().map(f64::abs);
                let error = (x.max(y) + length * turn) / (length * MAX_STEP_ERROR);
                let factor = 0.9 * error.powf(-0.2);
                if error.is_nan() || error > 1.0 {
                    h *= if factor.is_finite() { factor.max(0.1) } else { 0.1 };
                    continue;
                }
                (rigid, rates) = (step.end, step.rate());
                h *= factor.clamp(0.2, 5.0);
            }
            t = to;
            self.record(inertia, t, &rigid, &rates, &mut simulated)?;
            if t >= until {
                return Ok(simulated);
            }
        }
        no_estimate(format!("an estimate would cost more than {} % of the run", 100.0 * MAX_COST_FRACTION))
    }

    /// The rates of the rigid motion of the prescribed shape at time `t`.
    fn rates(&mut self, inertia: bool, t: f64, rigid: &RigidMotion) -> RigidMotion {
        if self.dynamics.model.head.is_some() {
            return [0.0; RIGID_COORDINATES];
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
        rigid: &RigidMotion,
        rates: &RigidMotion,
    ) -> Result<SeriesPoint, NoEstimate> {
        let dynamics = &mut self.dynamics;
        dynamics.look_at(t);
        dynamics.natural_acceleration(t, &mut self.acceleration);
        let natural = match curvature {
            Some(curvature) => [&curvature[0][..], &curvature[1], &curvature[2]],
            None => [&dynamics.natural[..], &dynamics.natural_rate, &self.acceleration],
        };
        let rod = &dynamics.model.rod;
        match &dynamics.held {
            Some(pose) => self.chain.place_on_head(rod, natural, pose),
            None => self.chain.place(dynamics, natural, rigid, rates),
        }
        self.state.t = t;
        self.state.q.copy_from_slice(&self.chain.x);
        self.state.v.copy_from_slice(&self.chain.v);
        self.state.a.copy_from_slice(&self.chain.a);
        let held = dynamics.balance(&self.state, &mut self.moment)?;
        let first = dynamics.shape(&self.state)?.kappa()[0];
        let rod = &dynamics.model.rod;
        Ok(SeriesPoint {
            time: t,
            com: rod.mean(&self.state.q),
            tip: node(&self.state.q, rod.nodes - 1),
            force: -held,
            moment: self.moment[0] * bend::curvature_per_turning(first),
        })
    }

    /// Adds the motion at time `t` to `simulated`: with inertia its deviations, without it its velocities.
    fn record(
        &mut self,
        inertia: bool,
        t: f64,
        rigid: &RigidMotion,
        rates: &RigidMotion,
        simulated: &mut SimulatedMotion,
    ) -> Result<(), NoEstimate> {
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
        simulated.deviation = simulated.deviation.max(deviation.iter().map(|d| d.abs()).sum());
        let forces = rod.mass.iter().enumerate();
        let force = forces.map(|(k, m)| (node(&self.applied, k) + node(&self.state.a, k) * *m).norm()).sum();
        simulated.force = simulated.force.max(force);
        simulated.values.push(if inertia { deviation } else { self.state.v.clone() });
        simulated.course.points.push(point);
        Ok(())
    }

    /// Follows the shape that deviates from its natural curvature as `plain` says, at its times. It starts without.
    fn simulate_deviated(&mut self, plain: &SimulatedMotion) -> Result<TimeSeries, NoEstimate> {
        let mut course = plain.course.without_points();
        let held = self.dynamics.model.head.is_some();
        // A held head feels the force with which the rod takes up its deviation: several of the times see it.
        let steps = if held { LOADING_STEPS } else { 1.0 };
        let grows = Start::Ramp { duration: steps * self.times.periods[0] / STEPS_PER_PERIOD };
        let first = self.dynamics.first_state();
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        let mut rigid = self.chain.fit_state(&self.dynamics, natural, &first);
        let mut rates = self.deviated_rates(plain, &grows, 0.0, &rigid);
        let times = plain.course.points.iter().map(|point| point.time);
        let mut t = 0.0;
        for to in times {
            if !held && to > t {
                let step = DormandPrinceStep::new(t, rigid, rates, to - t, |t, rigid| {
                    self.deviated_rates(plain, &grows, t, rigid)
                });
                (rigid, rates) = (step.end, step.rate());
            }
            t = to;
            self.deviate(plain, &grows, t);
            let curvature = std::mem::take(&mut self.curvature);
            let point = self.place(t, Some(&curvature), &rigid, &rates);
            self.curvature = curvature;
            course.points.push(point?);
        }
        Ok(course)
    }

    fn deviated_rates(&mut self, plain: &SimulatedMotion, grows: &Start, t: f64, rigid: &RigidMotion) -> RigidMotion {
        if self.dynamics.model.head.is_some() {
            return [0.0; RIGID_COORDINATES];
        }
        self.deviate(plain, grows, t);
        self.chain.rates(&self.dynamics, [&self.curvature[0], &self.curvature[1]], rigid)
    }

    /// Writes the natural curvatures at time `t` with the deviations of `plain`, their rates and second rates.
    fn deviate(&mut self, plain: &SimulatedMotion, grows: &Start, t: f64) {
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
    fn simulate_with_inertial_load(&mut self, drift: &SimulatedMotion) -> Result<TimeSeries, NoEstimate> {
        let mut course = drift.course.without_points();
        let first = self.dynamics.first_state();
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        let mut rigid = self.chain.fit_state(&self.dynamics, natural, &first);
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
                let step =
                    DormandPrinceStep::new(t, rigid, rates, to - t, |t, rigid| self.loaded_rates(drift, own, t, rigid));
                (rigid, rates) = (step.end, step.rate());
            }
            t = to;
            let point = self.place(t, None, &rigid, &rates)?;
            course.points.push(point);
        }
        self.dynamics.inputs.force = own;
        Ok(course)
    }

    fn loaded_rates(
        &mut self,
        drift: &SimulatedMotion,
        own: Option<&[f64]>,
        t: f64,
        rigid: &RigidMotion,
    ) -> RigidMotion {
        let rod = &self.dynamics.model.rod;
        let force = (0..2 * rod.nodes).map(|i| own.map_or(0.0, |own| own[i]) - rod.mass[i / 2] * drift.at(i, t).rate);
        self.dynamics.inputs.force = Some(force.collect());
        self.rates(false, t, rigid)
    }
}
