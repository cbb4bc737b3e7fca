//! A-priori error estimates of the reduced models, without running the full one, and estimates of their cost.
//!
//! The ratio of inertia to drag is β = ωτ, with the longest time τ = m/c in which drag stops a node, and the highest frequency ω
//! of the drive.
//!
//! *Shape.* The joint moments m_k that hold the rod in its natural curvature give the deviation of a rod of finite stiffness:
//! δκ_k = m_k/(EI_k/ΔL), quasi-static and to first order, minus τκ̄' if a damped material resists the rate of the natural
//! curvature. The rigid motion is simulated for the prescribed shape, and for the shape plus δκ. Their difference is the error of
//! a model without elasticity. For force and moment on a held head, the oscillation excited at the start is added.
//!
//! *Overdamped.* For a motion of frequency ω its relative error is β, regardless of how the rod bends, plus the delay τ at the
//! start. The propulsion of a free rod is a small difference of large forces. Its rigid motion without inertia is therefore
//! simulated twice, the second time with the omitted inertia −M a as a load.
//!
//! Drag need not be linear. If an estimate is unreliable, or would cost more than a tenth of the run that it may save, the result
//! is a reason instead of a number.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::Vector2;

use crate::error::Error;
use crate::head::{RESOLVING_STEPS_PER_PERIOD, Row, Sample, hermite};
use crate::integrator::StepControl;
use crate::model::{Dynamics, Model};
use crate::rod::{bend, node};
use crate::start::Start;
use crate::system::State;

use super::comparison::{Differences, ErrorMeasure, SeriesPoint, TimeSeries};
use super::dormand_prince::DormandPrinceStep;
use super::rigid_motion::{RIGID_COORDINATES, RigidChain, RigidMotion};
use super::shape::stable_rate;
use super::time_scales::TimeScales;

/// The estimated errors of a reduced model, or the reason why there are none.
pub type Estimate = std::result::Result<Differences, String>;

/// Estimates for the reduced models of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimates {
    /// Errors of the shape model.
    pub shape: Estimate,
    /// Errors of the overdamped model.
    pub overdamped: Estimate,
    /// The tolerance for steps of either model, chosen so that step errors use at most [`STEP_ERROR_FRACTION`] of the remaining
    /// accuracy. The estimates include the step errors.
    pub tolerance: f64,
    /// The cost of the estimates, in Newton iterations of the scene.
    pub work: f64,
}

/// The run of the full model that a reduced model may replace.
#[derive(Debug, Clone, Copy)]
pub struct FullModelRun {
    /// Its duration, s.
    pub duration: f64,
    /// Number of nodes of the scene. Estimates may use fewer.
    pub nodes: usize,
    /// Step control of the full model, and of a reduced one.
    pub step_control: [StepControl; 2],
    /// Approximate Newton iterations per step of the full model.
    pub iterations: f64,
    /// The requested accuracy.
    pub accuracy: f64,
    /// The measures to which the accuracy applies.
    pub measures: [Option<ErrorMeasure>; 4],
}

/// The largest cost of estimates as a fraction of the full model's cost, and the fraction used for planning. The cost is known in
/// advance only to within a factor of 4.1 (measured on 2000 scenes).
const MAX_COST_FRACTION: f64 = 0.1;
const PLANNED_COST_FRACTION: f64 = 0.022;

/// Steps of the estimates per shortest period of the drive.
const STEPS_PER_PERIOD: f64 = 10.0;

/// The fraction of the remaining accuracy that the steps of a reduced model may use, and the smallest tolerance for this. The
/// measured error of the tip's path is 0.3 … 1.7 times the tolerance times the length.
pub const STEP_ERROR_FRACTION: f64 = 0.5;
const MIN_TOLERANCE: f64 = 1e-8;

/// Steps over which the deviation of a held rod grows to its full size.
const LOADING_STEPS: f64 = 4.0;

/// Measured work per node in Newton iterations (75 ns), on scenes of 9 and 33 nodes: of measuring a step, of a step of `shape`, of a
/// step of both simulated motions, and of a step of both without inertia.
const MEASUREMENT_WORK: f64 = 0.7;
const SHAPE_STEP_WORK: f64 = 3.5;
/// Factor of the work of a step of `shape` with added mass: 7.8 in total (an eel of 17 nodes).
const ADDED_MASS_FACTOR: f64 = 2.2;
const RIGID_STEP_WORK: f64 = 6.5;
const CREEPING_STEP_WORK: f64 = 22.0;

/// Newton iterations of adaptive steps per period of the drive, measured on eight scenes: 290 … 580 for the full model with a tolerance
/// of 1e-3, 2.5 times as many with 1e-4 (`baseline-smooth`); up to 550 for the overdamped one with 1e-4, and 900 with 1e-5.
const FULL_MODEL_WORK_PER_PERIOD: f64 = 300.0;
const OVERDAMPED_WORK_PER_PERIOD: f64 = 550.0;

/// Factor of this work for a free rod that is carried by loads or a flow, because its steps are longer.
const DRIFTING_WORK_FRACTION: f64 = 0.25;

/// The smallest number of longest periods that an estimate covers after the ramp, unless the run is shorter.
const MIN_PERIODS: f64 = 2.0;

/// The largest total deviation (rad) for which motions are linear in the deviation.
const MAX_LINEAR_DEVIATION: f64 = 0.1;

/// The largest compression of the rod, in EI/L². A clamped rod buckles at 2.5.
const MAX_COMPRESSION: f64 = 0.5;

/// The largest β for which inertia is a correction.
const MAX_INERTIA: f64 = 0.05;

/// The relative uncertainty of force and moment of the full model itself: with a tolerance of 1e-6, unresolved stretching waves
/// leave 2e-4 … 7e-4 (measured). The second constant is its rounding error, in roundings of EA and EI/L per node, which is
/// comparable to the drag on stiff rods of some micrometres.
const LOAD_UNCERTAINTY: f64 = 2.5e-4;
const ROUNDING_FACTOR: f64 = 4.0;

/// The safety factor of the estimates. Most are accurate to a few per cent without it, but the error of an oscillating rod, which
/// the simulated motions do not include, is twice as large, and that of omitted harmonics of the drive larger still.
const SAFETY_FACTOR: f64 = 4.0;

/// The largest error of a step of the simulated motions, relative to the length.
const MAX_STEP_ERROR: f64 = 1e-6;

/// The reason why there is no estimate.
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
    /// No estimates for any model, for the given `reason`.
    pub fn none(reason: &str) -> Self {
        let tolerance = MIN_TOLERANCE;
        Self { shape: Err(reason.to_string()), overdamped: Err(reason.to_string()), tolerance, work: 0.0 }
    }

    /// The estimates for `run` of `model`.
    pub fn of(model: &Arc<Model>, run: FullModelRun) -> Self {
        let mut estimator = Estimator::new(model, run);
        let checked = |estimate: Result<Differences, NoEstimate>| {
            let errors = estimate.map_err(|NoEstimate(reason)| reason)?;
            if errors.are_finite() {
                Ok(errors)
            } else {
                Err("its error cannot be estimated: it is not finite".to_string())
            }
        };
        let shape = checked(estimator.shape());
        let is_accurate = |errors: &Differences| {
            let mut asked = run.measures.into_iter().flatten().filter_map(|measure| errors.get(measure));
            asked.all(|error| error <= run.accuracy)
        };
        if !shape.as_ref().is_ok_and(is_accurate) {
            // A model that is not chosen does not determine steps.
            estimator.tolerance = f64::INFINITY;
        }
        let overdamped = checked(estimator.overdamped());
        let work = estimator.work * model.rod.nodes as f64 / run.nodes as f64;
        Self { shape, overdamped, tolerance: estimator.tolerance(), work }
    }
}

/// Computes the estimates by simulating rigid motions of the rod.
struct Estimator {
    run: FullModelRun,
    /// Work done so far, in Newton iterations.
    work: f64,
    dynamics: Dynamics,
    chain: RigidChain,
    state: State,
    times: TimeScales,
    /// Added mass of the rod for motion across itself, kg.
    added: f64,
    /// The tolerance for steps of the reduced model.
    tolerance: f64,
    acceleration: Vec<f64>,
    active: Vec<f64>,
    moment: Vec<f64>,
    applied: Vec<f64>,
    curvature: [Vec<f64>; 3],
}

/// A simulated motion: its time series, and values along it.
struct SimulatedMotion {
    series: TimeSeries,
    /// Deviation of each joint, or velocity of each coordinate, at the times of the series.
    values: Vec<Vec<f64>>,
    /// Largest Σ|δκ_k|, rad.
    deviation: f64,
    /// Largest sum of the forces on the nodes, N.
    force: f64,
}

impl SimulatedMotion {
    /// Value `k` at time `t` by cubic interpolation. At a time of the series, its second derivative is the mean of both sides.
    fn at(&self, k: usize, t: f64) -> Sample {
        let points = &self.series.points;
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
    fn new(model: &Arc<Model>, run: FullModelRun) -> Self {
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
            active: Vec::new(),
            moment: zeros(),
            applied: vec![0.0; 2 * nodes],
            curvature: [zeros(), zeros(), zeros()],
        };
        estimator.added = estimator.chain.added_mass(&estimator.dynamics);
        estimator
    }

    /// β = ωτ of the highest frequency of the drive and the node that drag stops last.
    fn inertia(&self) -> f64 {
        TAU * self.times.stops[1] / self.times.periods[0]
    }

    /// The work of the full model, in Newton iterations per node.
    fn full_model_work(&self) -> f64 {
        let FullModelRun { duration, iterations, step_control: [step_control, _], .. } = self.run;
        match step_control {
            StepControl::Fixed(step) => duration / step * (iterations + MEASUREMENT_WORK),
            StepControl::Adaptive(tolerance) => {
                let model = &self.dynamics.model;
                let flows = model.flow.is_some() || model.fluid.flow != Vector2::zeros();
                let flow = !model.forces.is_empty() && flows;
                let is_carried = model.head.is_none() && (flow || model.load.is_some());
                let period = if is_carried {
                    DRIFTING_WORK_FRACTION * FULL_MODEL_WORK_PER_PERIOD
                } else {
                    FULL_MODEL_WORK_PER_PERIOD
                };
                duration / self.times.periods[0] * period * (1e-3 / tolerance).powf(0.45)
            }
        }
    }

    /// The number of steps that an estimate may take, if each costs `step` iterations per node.
    fn affordable_steps(&self, step: f64) -> f64 {
        let part = self.run.nodes as f64 / self.dynamics.model.rod.nodes as f64;
        PLANNED_COST_FRACTION * self.full_model_work() * part / step
    }

    /// Checks the preconditions of both models: a suitable start, and a periodic drive.
    fn check_preconditions(&mut self) -> Result<(), NoEstimate> {
        self.dynamics.evaluate_at(0.0);
        let strained = self.dynamics.natural.iter().any(|k| *k != 0.0);
        let moving = self.dynamics.held.is_some_and(|pose| pose.iter().any(|s| s.rate != 0.0));
        let model = &self.dynamics.model;
        if model.initial_curvature.is_some() {
            return no_estimate("the rod is released from an initial curvature, and vibrates");
        }
        if model.start != Start::Shaped && (strained || moving) {
            return no_estimate("the rod starts moving abruptly, and vibrates");
        }
        if !self.times.periods[0].is_finite() {
            return no_estimate("nothing drives the rod, so there is no period for an estimate");
        }
        Ok(())
    }

    /// The tolerance for steps of a reduced model.
    fn tolerance(&self) -> f64 {
        match self.run.step_control[1] {
            StepControl::Adaptive(tolerance) => self.tolerance.min(tolerance),
            StepControl::Fixed(_) => self.tolerance,
        }
    }

    /// The estimates from the `errors` of a model with the time series `series`: multiplied by the safety factor, plus the errors
    /// of the model's steps, whose tolerance is reduced as far as needed.
    fn with_step_errors(&mut self, errors: Differences, series: &TimeSeries) -> Differences {
        let (errors, per_length) = (errors.map(|error| SAFETY_FACTOR * error), series.errors_per_length());
        let needed = self.run.measures.into_iter().flatten().filter_map(|measure| {
            let left = self.run.accuracy - errors.get(measure)?;
            Some(STEP_ERROR_FRACTION * left / per_length.get(measure)?)
        });
        // A measure that is not accurate enough even with exact steps does not determine their tolerance.
        let needed = needed.filter(|needed| *needed > 0.0).fold(f64::INFINITY, f64::min);
        if needed.is_finite() {
            self.tolerance = self.tolerance.min(needed.max(MIN_TOLERANCE));
        }
        let tolerance = self.tolerance();
        errors.with(per_length, |error, per_length| error + tolerance * per_length)
    }

    /// The time that an estimate covers with `rate` steps per second that cost `step` each.
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
        // The estimate ends in the same phase as the run, because means over incomplete periods are not small differences of
        // large loads.
        let period = self.times.periods[1];
        let left_out = ((self.run.duration - covered) / period).ceil();
        if covered >= self.run.duration || !(left_out * period).is_finite() {
            return Ok(covered);
        }
        let in_phase = self.run.duration - left_out * period;
        Ok(if in_phase < least { in_phase + period } else { in_phase })
    }

    /// Steps per second of the estimates.
    fn rate(&self) -> f64 {
        (STEPS_PER_PERIOD / self.times.periods[0]).max(20.0 / self.run.duration)
    }

    /// The factor by which added mass increases the cost of a step of the shape model.
    fn added_mass_factor(&self) -> f64 {
        if self.dynamics.model.forces.are_inertial() { ADDED_MASS_FACTOR } else { 1.0 }
    }

    fn shape(&mut self) -> Result<Differences, NoEstimate> {
        self.check_preconditions()?;
        let stable = stable_rate(&self.dynamics.model, &self.times);
        let steps = stable.max(RESOLVING_STEPS_PER_PERIOD / self.times.periods[0]) * self.run.duration;
        let whole = self.full_model_work();
        let step = SHAPE_STEP_WORK * self.added_mass_factor();
        if steps * step >= whole {
            return no_estimate(format!(
                "it is not cheaper: about {steps:.1e} steps, while the full model needs the time of {:.1e}",
                whole / step
            ));
        }
        let rate = self.rate().max(stable);
        let covered = self.covered_time(rate, RIGID_STEP_WORK * self.added_mass_factor())?;
        let plain = self.simulate_shape(true, covered, (1.5 * rate * covered) as usize + 20)?;
        self.check_linearity(&plain)?;
        let bent = self.simulate_deviated(&plain)?;
        let errors = self.extrapolated(&bent, &plain.series);
        let errors = self.with_load_errors(errors, &plain, self.ringing(covered));
        Ok(self.with_step_errors(errors, &bent))
    }

    /// Checks that deviations are small and that the rod cannot buckle, so that a first-order estimate is valid.
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

    /// The differences of `found` from `truth`, extrapolated to the duration of the run by their growth over about the second
    /// half, a whole number of periods.
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

    /// Root mean square over `time` (s) of the oscillation that the loads excite in a held rod at the start, relative to its first amplitude.
    /// It decays by drag or, if drag is strong, by the stiffness of the rod against drag.
    fn ringing(&self, time: f64) -> f64 {
        let rod = &self.dynamics.model.rod;
        let stop = self.times.stops[1];
        let weakest = rod.joints().map(|k| rod.joint[k]).fold(f64::INFINITY, f64::min) * rod.spacing;
        let mass = rod.total_mass() + self.added;
        let frequency = 3.516 * (weakest / (mass * rod.length.powi(3))).sqrt();
        let decay = if 2.0 * stop * frequency > 1.0 { 0.5 / stop } else { frequency * frequency * stop };
        (0.5 / (decay * time)).sqrt().min(1.0)
    }

    /// Adds the fraction `lasting` of the initial loads of `simulated`, and the uncertainty of the full model, to the errors of
    /// force and moment on a held head.
    fn with_load_errors(&self, errors: Differences, simulated: &SimulatedMotion, lasting: f64) -> Differences {
        let rod = &self.dynamics.model.rod;
        let points = &simulated.series.points;
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
            return no_estimate("it leaves out added mass and thus the reactive force");
        }
        let inertia = self.inertia();
        if inertia > MAX_INERTIA {
            return no_estimate(format!(
                "inertia is {inertia:.1e} of the drag at the highest frequency of the drive, at the node with the longest relaxation time"
            ));
        }
        let FullModelRun { duration, step_control: [_, step_control], .. } = self.run;
        if let StepControl::Adaptive(tolerance) = step_control {
            self.check_cost(tolerance)?;
        }
        // The net displacement, and means of loads, may be as small as the fractions of a path to which their differences are
        // relative.
        let periods = duration / self.times.periods[1];
        let late = self.times.stops[1] / duration;
        let held = self.dynamics.model.head.is_some();
        let covered = self.covered_time(self.rate(), if held { RIGID_STEP_WORK } else { CREEPING_STEP_WORK })?;
        let drift = self.simulate_shape(false, covered, (1.5 * self.rate() * covered) as usize + 20)?;
        if held {
            let mean = inertia.max(late) * 25.0 / periods.min(25.0);
            let errors = Differences { displacement: mean, tip: inertia, force: Some(mean), moment: Some(mean) };
            let errors = self.with_load_errors(errors, &drift, (0.5 * late).sqrt());
            let errors = self.with_step_errors(errors, &drift.series);
            self.check_cost(self.tolerance())?;
            return Ok(errors);
        }
        self.check_linearity(&drift)?;
        let loaded = self.simulate_with_inertial_load(&drift)?;
        let errors = self.extrapolated(&loaded, &drift.series);
        let errors = self.with_step_errors(errors.map(|error| error + inertia), &drift.series);
        self.check_cost(self.tolerance())?;
        Ok(errors)
    }

    /// Checks that the overdamped model with that tolerance costs less than the full model.
    fn check_cost(&self, tolerance: f64) -> Result<(), NoEstimate> {
        let whole = self.full_model_work();
        let periods = self.run.duration / self.times.periods[0];
        let work = periods * OVERDAMPED_WORK_PER_PERIOD * (1e-4 / tolerance).powf(0.2);
        if work >= whole {
            return no_estimate(format!(
                "it is not cheaper: about {work:.1e} Newton iterations, while the full model needs {whole:.1e}"
            ));
        }
        Ok(())
    }

    /// Simulates the prescribed shape, with or without inertia, up to time `until` (s) in at most `steps` steps.
    fn simulate_shape(&mut self, inertia: bool, until: f64, steps: usize) -> Result<SimulatedMotion, NoEstimate> {
        let first = self.dynamics.first_state();
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        let mut rigid = self.chain.fit_state(&self.dynamics, natural, &first);
        let mut rates = self.rates(inertia, 0.0, &rigid);
        let series = TimeSeries::of(&self.dynamics.model);
        let mut simulated = SimulatedMotion { series, values: Vec::new(), deviation: 0.0, force: 0.0 };
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
        self.dynamics.evaluate_at(t);
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        if inertia {
            self.chain.rates(&self.dynamics, natural, rigid)
        } else {
            self.chain.rates_without_inertia(&self.dynamics, natural, rigid)
        }
    }

    /// Places the rod at time `t` with the given curvatures, and measures it.
    fn place(
        &mut self,
        t: f64,
        curvature: Option<&[Vec<f64>; 3]>,
        rigid: &RigidMotion,
        rates: &RigidMotion,
    ) -> Result<SeriesPoint, NoEstimate> {
        let dynamics = &mut self.dynamics;
        dynamics.evaluate_at(t);
        dynamics.natural_acceleration(t, &mut self.acceleration, &mut self.active);
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

    /// Adds the motion at time `t` to `simulated`: its deviations with inertia, its velocities without.
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
        let mut deviation = vec![0.0; rod.nodes];
        for k in rod.joints() {
            deviation[k] = self.moment[k] / rod.joint[k];
            if let Some(damping) = &rod.damping {
                let rate = self.dynamics.natural_rate[k];
                deviation[k] -= damping.bending[k] * (rate - damping.given(rate));
            }
        }
        simulated.deviation = simulated.deviation.max(deviation.iter().map(|d| d.abs()).sum());
        let forces = rod.mass.iter().enumerate();
        let force = forces.map(|(k, m)| (node(&self.applied, k) + node(&self.state.a, k) * *m).norm()).sum();
        simulated.force = simulated.force.max(force);
        simulated.values.push(if inertia { deviation } else { self.state.v.clone() });
        simulated.series.points.push(point);
        Ok(())
    }

    /// Simulates the shape with the deviations of `plain` added to its natural curvature, at the same times, starting from zero
    /// deviation.
    fn simulate_deviated(&mut self, plain: &SimulatedMotion) -> Result<TimeSeries, NoEstimate> {
        let mut series = plain.series.without_points();
        let held = self.dynamics.model.head.is_some();
        // The build-up of the deviation exerts a force on a held head; it is spread over several steps to be resolved.
        let steps = if held { LOADING_STEPS } else { 1.0 };
        let grows = Start::Ramp { duration: steps * self.times.periods[0] / STEPS_PER_PERIOD };
        let first = self.dynamics.first_state();
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        let mut rigid = self.chain.fit_state(&self.dynamics, natural, &first);
        let mut rates = self.deviated_rates(plain, &grows, 0.0, &rigid);
        let times = plain.series.points.iter().map(|point| point.time);
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
            series.points.push(point?);
        }
        Ok(series)
    }

    fn deviated_rates(&mut self, plain: &SimulatedMotion, grows: &Start, t: f64, rigid: &RigidMotion) -> RigidMotion {
        if self.dynamics.model.head.is_some() {
            return [0.0; RIGID_COORDINATES];
        }
        self.deviate(plain, grows, t);
        self.chain.rates(&self.dynamics, [&self.curvature[0], &self.curvature[1]], rigid)
    }

    /// Writes the natural curvatures at time `t` plus the deviations of `plain`, with their first and second rates.
    fn deviate(&mut self, plain: &SimulatedMotion, grows: &Start, t: f64) {
        self.dynamics.evaluate_at(t);
        self.dynamics.natural_acceleration(t, &mut self.acceleration, &mut self.active);
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

    /// Repeats the simulation of the free rod's motion without inertia, with the inertia omitted in `drift` as a load, delayed by
    /// the time in which the rod reaches its speed.
    fn simulate_with_inertial_load(&mut self, drift: &SimulatedMotion) -> Result<TimeSeries, NoEstimate> {
        let own = self.dynamics.inputs.force.take();
        let series = self.simulate_with(drift, own.as_deref());
        self.dynamics.inputs.force = own;
        series
    }

    /// The same, with this load added to the `own` force of the inputs.
    fn simulate_with(&mut self, drift: &SimulatedMotion, own: Option<&[f64]>) -> Result<TimeSeries, NoEstimate> {
        let mut series = drift.series.without_points();
        let first = self.dynamics.first_state();
        let natural = [&self.dynamics.natural[..], &self.dynamics.natural_rate];
        let mut rigid = self.chain.fit_state(&self.dynamics, natural, &first);
        let start = rigid;
        let mut rates = self.loaded_rates(drift, own, 0.0, &rigid);
        let late = self.times.stops[1];
        for axis in 0..3 {
            rigid[axis] = start[axis] - late * rates[axis];
        }
        let mut t = 0.0;
        for i in 0..drift.series.points.len() {
            let to = drift.series.points[i].time;
            if to > t {
                let step =
                    DormandPrinceStep::new(t, rigid, rates, to - t, |t, rigid| self.loaded_rates(drift, own, t, rigid));
                (rigid, rates) = (step.end, step.rate());
            }
            t = to;
            let point = self.place(t, None, &rigid, &rates)?;
            series.points.push(point);
        }
        Ok(series)
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
