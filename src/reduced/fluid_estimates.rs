//! Estimated errors of simpler drag laws, without running the scene: its rod and drive are simulated with each law on a coarse
//! mesh, with fixed steps, over the first periods.
//!
//! Only mesh, steps and duration differ from the run. Drive, loads, flow and head are those of the scene, including their changes
//! over time.

use std::mem::swap;
use std::sync::Arc;

use nalgebra::Vector2;

use super::{ModelStepper, MotionAndPower};
use crate::cycle::{Cycles, MAX_CYCLES};
use crate::error::{Error, Result};
use crate::fluid::Fluid;
use crate::fluid::laws::DragLaw;
use crate::fluid::validity::TransverseMotion;
use crate::integrator::Method;
use crate::linear::SolverChoice as Linear;
use crate::metrics::{Measurements, RunMetrics};
use crate::model::{Dynamics, Model};
use crate::newton::Newton;
use crate::number_format::{percent, signed, significant, two_digits};
use crate::regime::{self, MeanMotion, Regime};
use crate::rod::node;
use crate::spectrum::Spectrum;
use crate::system::{Form, State};

/// Number of periods to simulate after a ramp, steps per period, and steps without a period.
pub const PERIODS: f64 = 8.0;
const STEPS_PER_PERIOD: f64 = 24.0;
const MIN_STEPS: f64 = 128.0;

/// The smallest number of periods of a run for which laws are compared, because the start dominates the motion in the first
/// period.
const LEAST_PERIODS: f64 = 2.0;

/// The largest change of motion and power that is reported as a number. A larger change only means that the motion is a different
/// one.
const MAX_CHANGE_IN_DIGITS: f64 = 10.0;

/// The largest number of steps, for drives with very different frequencies: half a second of computing for 17 nodes.
const MAX_STEPS: f64 = 2048.0;

/// Number of nodes per wavelength or, if that is longer, per rod; and the largest number of nodes.
const NODES_PER_WAVELENGTH: f64 = 16.0;
const MAX_NODES: u64 = 49;

/// Relative rounding of times.
const ROUNDING: f64 = 1e-9;

/// A rod is at rest if it moves less than this fraction of its length through the fluid in a whole run; such motion is rounding.
const AT_REST: f64 = 1e-12;

/// Tolerance of Newton's method relative to the length, and how many times failing steps are halved.
const NEWTON_TOLERANCE: f64 = 1e-7;
const MAX_HALVINGS: u32 = 2;

/// The integrator. It damps the velocity without oscillation if drag stops a rod within a small fraction of a step.
const METHOD: &str = "esdirk3";

/// Safety factor of estimated errors.
pub const SAFETY_FACTOR: f64 = 1.5;
/// The smallest estimated error.
pub const MIN_ERROR: f64 = 0.005;

/// The number of nodes for a rod that is `waves` wavelengths long.
pub fn nodes(waves: f64) -> u64 {
    ((NODES_PER_WAVELENGTH * waves.max(1.0)).ceil() as u64 + 1).min(MAX_NODES)
}

/// The simulated first part of a run, and its steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShortRun {
    /// Its duration, s.
    pub duration: f64,
    /// Number of equal steps.
    pub steps: u64,
    /// The longest period of the drive, s, if it is periodic.
    pub period: Option<f64>,
}

impl ShortRun {
    /// The part of a run of `duration` (s) to simulate: [`PERIODS`] longest periods of the drive after a ramp (s), or all of it
    /// without a period, in steps that resolve the highest frequency. If frequencies differ strongly, or a run without a period
    /// is long, the part is shortened so that the steps still resolve the highest frequency.
    pub fn of(spectrum: &Spectrum, duration: f64, ramp: f64) -> Self {
        let Some((slowest, fastest)) = spectrum.slowest().zip(spectrum.fastest()) else {
            return Self { duration, steps: MIN_STEPS as u64, period: None };
        };
        let repeats = if spectrum.is_transient { duration } else { duration.min(ramp + PERIODS / slowest) };
        let rate = STEPS_PER_PERIOD * fastest;
        let least = duration.min(ramp + PERIODS / fastest);
        let affordable = MAX_STEPS / rate;
        let duration = repeats.min(affordable.max(least));
        let steps = (rate * duration).ceil().clamp(STEPS_PER_PERIOD, MAX_STEPS.max(rate * least));
        Self { duration, steps: steps as u64, period: (!spectrum.is_transient).then_some(1.0 / slowest) }
    }

    /// Returns an error if a run of `duration` (s), of which this is a part, ends before the end of its second period, which is
    /// too short to compare laws.
    pub fn check_run_length(&self, duration: f64) -> std::result::Result<(), String> {
        let too_short = |period: &f64| duration * (1.0 + ROUNDING) < LEAST_PERIODS * period;
        let Some(period) = self.period.filter(too_short) else { return Ok(()) };
        let [duration, period] = [duration, period].map(|time| significant(time, 3));
        Err(format!(
            "the run of {duration} s is shorter than two beats of {period} s each, so all of it belongs to the start"
        ))
    }

    /// The number of periods at the end over which the motion is measured: whole periods except the first, at most
    /// [`MAX_CYCLES`]; 0 if the motion is measured over the whole run.
    fn measured_periods(&self) -> f64 {
        let whole = |period: f64| ((self.duration / period * (1.0 + ROUNDING)).floor() - 1.0).min(MAX_CYCLES as f64);
        self.period.map_or(0.0, whole).max(0.0)
    }

    /// The time (s) from which the motion is measured.
    fn measured_from(&self) -> f64 {
        let late = self.period.map(|period| self.measured_periods() * period).filter(|late| *late > 0.0);
        late.map_or(0.0, |late| self.duration - late)
    }
}

/// The result of a short run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShortRunResult {
    /// Motion and power.
    pub means: MotionAndPower,
    /// The motion of the rod relative to the fluid.
    pub motion: MeanMotion,
}

/// Simulates `model` over `span` from its start.
///
/// # Errors
/// Errors of a step; [`Error::NotFinite`] if there is no result.
pub fn simulate(model: &Arc<Model>, span: ShortRun) -> Result<ShortRunResult> {
    let mut outcome = simulate_steps(model, span, span.steps);
    for halved in 1..=MAX_HALVINGS {
        match &outcome {
            Err(error) if error.is_cured_by_smaller_step() => {
                outcome = simulate_steps(model, span, span.steps << (2 * halved));
            }
            _ => break,
        }
    }
    outcome
}

fn simulate_steps(model: &Arc<Model>, span: ShortRun, steps: u64) -> Result<ShortRunResult> {
    let duration = span.duration;
    let nothing = || Error::NotFinite { time_s: duration, node: 0, what: "the motion" };
    let mut dynamics = Dynamics::new(Arc::clone(model));
    let mut newton = Newton::with(Form::Positions, Linear::Auto, model.rod.nodes, NEWTON_TOLERANCE)?;
    let method = Method::named(METHOD).ok_or_else(nothing)?;
    let mut model_stepper: Box<dyn ModelStepper> = (method.build)(&method.defaults()).into();
    let mut state = dynamics.first_state_in(Form::Positions);
    model_stepper.begin(&mut dynamics, &mut newton, &mut state)?;
    let mut metrics = RunMetrics::start(&mut dynamics, &state)?;
    let mut cycles = Cycles::start_with_period(&dynamics, &state, &metrics, span.period);
    let (mut next, mut measurements) = (state.clone(), Measurements::new(model.rod.nodes));
    let mut samples = Vec::with_capacity(steps as usize + 1);
    samples.push(MotionSample::of(&dynamics, &state));
    for step in 1..=steps {
        next.t = duration * step as f64 / steps as f64;
        let h = next.t - state.t;
        model_stepper.step(&mut dynamics, &mut newton, &state, h, &mut next)?;
        measurements.measure(&mut dynamics, &next)?;
        let load = dynamics.load_work([state.t, next.t], &state.q, &next.q);
        metrics.count_step(&mut measurements, None, load, dynamics.head_mass())?;
        swap(&mut state, &mut next);
        cycles.follow(&dynamics, &state, &metrics, None);
        samples.push(MotionSample::of(&dynamics, &state));
    }
    let means = MotionAndPower::of(&cycles, &dynamics).ok_or_else(nothing)?;
    let from = samples.partition_point(|sample| sample.time <= span.measured_from() + ROUNDING * duration);
    let (measured, held) = (&samples[from.saturating_sub(1)..], model.head.is_some());
    let mut motion = motion(measured, span.measured_periods(), held);
    if motion.along.hypot(motion.across.speed) * duration < AT_REST * model.rod.length {
        motion.along = 0.0;
        motion.across = TransverseMotion { speed: 0.0, per_depth: 0.0, along: 0.0, ..motion.across };
    }
    Ok(ShortRunResult { means, motion })
}

/// The motion of the rod relative to the fluid at one time: mean squares over its nodes.
struct MotionSample {
    time: f64,
    along: f64,
    across: f64,
    /// Mean squares of the velocities across and along the rod over ν, 1/m².
    per_depth: [f64; 2],
    body: f64,
    density: f64,
    viscosity: f64,
    tip: Vector2<f64>,
    /// The origin for the motion of the tip: a held head, or the centre of mass of a free rod, m.
    from: Vector2<f64>,
}

impl MotionSample {
    /// The sample of `state`. `dynamics` must be at its time.
    fn of(dynamics: &Dynamics, State { t, q, v, .. }: &State) -> Self {
        let rod = &dynamics.model.rod;
        let last = rod.nodes - 1;
        let from = if dynamics.model.head.is_some() { node(q, 0) } else { rod.mean(q) };
        let mut sample = Self {
            time: *t,
            along: 0.0,
            across: 0.0,
            per_depth: [0.0; 2],
            body: 0.0,
            density: 0.0,
            viscosity: 0.0,
            tip: node(q, last),
            from,
        };
        if rod.body.is_some() {
            let Fluid { density, viscosity, flow, .. } = dynamics.fluid_at(node(q, 0));
            sample.body = (node(v, 0) - flow).norm_squared() * (density / viscosity).powi(2);
        }
        let part = 1.0 / (rod.nodes - rod.front) as f64;
        for k in rod.front..rod.nodes {
            let tangent = (node(q, (k + 1).min(last)) - node(q, k.saturating_sub(1).max(rod.front))).normalize();
            let Fluid { density, viscosity, flow, .. } = dynamics.fluid_at(node(q, k));
            let velocity = node(v, k) - flow;
            let along = tangent.dot(&velocity).powi(2);
            let across = tangent.perp(&velocity).powi(2);
            let ratio = (density / viscosity).powi(2);
            sample.along += part * along;
            sample.across += part * across;
            sample.per_depth[0] += part * across * ratio;
            sample.per_depth[1] += part * along * ratio;
            sample.density += part * density;
            sample.viscosity += part * viscosity;
        }
        sample
    }
}

/// The motion over equally spaced `samples`, the first at the start, which cover that many `periods`.
fn motion(samples: &[MotionSample], periods: f64, held: bool) -> MeanMotion {
    let later = samples.get(1..).unwrap_or_default();
    let mean = |of: fn(&MotionSample) -> f64| later.iter().map(of).sum::<f64>() / later.len().max(1) as f64;
    let root = |of: fn(&MotionSample) -> f64| mean(of).sqrt();
    // The motion of the reference point: the complete motion of a free rod's centre of mass, but only the mean motion of a held
    // head.
    let velocity = drift(samples, periods).filter(|_| held);
    let gone = |sample: &MotionSample| match (velocity, samples.first()) {
        (Some(velocity), Some(first)) => velocity * (sample.time - first.time),
        _ if held => Vector2::zeros(),
        _ => sample.from,
    };
    let tips: Vec<_> = later.iter().map(|sample| sample.tip - gone(sample)).collect();
    MeanMotion {
        along: root(|sample| sample.along),
        across: TransverseMotion {
            speed: root(|sample| sample.across),
            per_depth: root(|sample| sample.per_depth[0]),
            along: root(|sample| sample.per_depth[1]),
            body: root(|sample| sample.body),
            fluid: Fluid {
                density: mean(|sample| sample.density),
                viscosity: mean(|sample| sample.viscosity),
                ..Fluid::NONE
            },
        },
        tip: regime::half_width(&tips),
    }
}

/// The mean velocity of the origin over equally spaced `samples`, m/s, from its means over the first and the last of their
/// `periods`. The positions at the ends of the window would be inaccurate if the window is not a whole number of periods.
fn drift(samples: &[MotionSample], periods: f64) -> Option<Vector2<f64>> {
    let (first, last) = (samples.first()?, samples.last()?);
    let time = last.time - first.time;
    if periods < 2.0 {
        return (time > 0.0).then(|| (last.from - first.from) / time);
    }
    let later = &samples[1..];
    let count = (later.len() as f64 / periods).round() as usize;
    let mean = |part: &[MotionSample]| part.iter().map(|sample| sample.from).sum::<Vector2<f64>>() / count as f64;
    let [first, last] = [later.get(..count)?, later.get(later.len() - count..)?].map(mean);
    let between = time * (later.len() - count) as f64 / later.len() as f64;
    Some((last - first) / between)
}

/// A drag law, with or without added mass, and the result for the scene with it.
#[derive(Debug, Clone, PartialEq)]
pub struct FluidEstimate {
    /// The law.
    pub law: &'static DragLaw,
    /// True with added mass.
    pub reactive: bool,
    /// Motion and power of a short run.
    pub means: MotionAndPower,
    /// Estimated errors of motion and power relative to the most accurate law.
    pub errors: [f64; 2],
    /// Its published uncertainty in motion and power, within its range of validity.
    pub uncertainty: Option<[f64; 2]>,
}

impl FluidEstimate {
    /// Its name.
    pub fn name(&self) -> String {
        self.law.with_reactive(self.reactive)
    }
}

/// Estimates for the drag laws of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct FluidEstimates {
    /// The laws, from the cheapest to the most accurate. Errors are relative to the most accurate one.
    pub laws: Vec<FluidEstimate>,
    /// Published uncertainty of the most accurate law, in motion and power.
    pub uncertainty: [f64; 2],
    /// True if the motion is the thrust on a held head, false if it is a speed.
    pub held: bool,
    /// The flow around the rod with the first simulated law: the most accurate one that is valid at any Reynolds number, if possible.
    pub regime: Regime,
}

impl FluidEstimates {
    /// The estimates from the results of the scene with each law, the most accurate last.
    pub fn of(
        found: Vec<(&'static DragLaw, bool, MotionAndPower, Option<[f64; 2]>)>,
        uncertainty: [f64; 2],
        held: bool,
        regime: Regime,
    ) -> Option<Self> {
        let highest = found.last()?.2;
        let error = |difference: f64| (SAFETY_FACTOR * difference.abs()).max(MIN_ERROR);
        let count = found.len();
        let laws = found.into_iter().enumerate().map(|(i, (law, reactive, means, uncertainty))| FluidEstimate {
            law,
            reactive,
            means,
            uncertainty,
            errors: if i + 1 == count { [0.0; 2] } else { means.differences(&highest).map(error) },
        });
        let laws: Vec<_> = laws.collect();
        laws.iter().all(|law| law.errors.iter().all(|error| error.is_finite())).then_some(Self {
            laws,
            uncertainty,
            held,
            regime,
        })
    }

    /// The estimates of the `allowed` laws relative to the most accurate of them, or `None` if none is allowed.
    pub fn restricted_to(&self, allowed: impl Fn(&DragLaw, bool) -> bool) -> Option<Self> {
        let of = self.laws.iter().filter(|estimate| allowed(estimate.law, estimate.reactive));
        let found: Vec<_> =
            of.map(|estimate| (estimate.law, estimate.reactive, estimate.means, estimate.uncertainty)).collect();
        // A law with coefficients of the scene has no published uncertainty, nor has any law outside its range.
        let uncertainty = found.last()?.3.unwrap_or(self.uncertainty);
        Self::of(found, uncertainty, self.held, self.regime)
    }

    /// The estimate of a law.
    pub fn get(&self, law: &DragLaw, reactive: bool) -> Option<&FluidEstimate> {
        self.laws.iter().find(|estimate| estimate.law == law && estimate.reactive == reactive)
    }

    /// Describes these relative changes of motion and power, for messages.
    pub fn changes_in_words(&self, changes: [f64; 2]) -> String {
        let [motion, power] = changes.map(|part| match part {
            part if part.abs() <= MAX_CHANGE_IN_DIGITS => format!("change by {} %", signed(100.0 * part, 1)),
            part if part > 0.0 => "grow more than tenfold".to_string(),
            _ => "reverse and grow more than tenfold".to_string(),
        });
        let named = if self.held { "thrust" } else { "speed" };
        format!("the {named} would {motion} and the power would {power}")
    }

    /// Describes errors of motion and power, for messages.
    pub fn in_words(&self, [motion, power]: [f64; 2]) -> String {
        format!("{} in {}, {} in power", percent(motion), if self.held { "thrust" } else { "speed" }, percent(power))
    }
}

/// The drag law that the program chooses for a scene, and the reason.
#[derive(Debug, Clone, PartialEq)]
pub struct FluidChoice {
    /// The drag law, if the scene has drag.
    pub law: Option<&'static DragLaw>,
    /// True with added mass.
    pub reactive: bool,
    /// The reason.
    pub reason: String,
    /// Estimated errors of motion and power relative to the most accurate law, if there is another law; zero for the most
    /// accurate law itself.
    pub errors: Option<[f64; 2]>,
    /// Published uncertainty of the most accurate law, in motion and power, if there are estimates and it is known.
    pub uncertainty: Option<[f64; 2]>,
    /// True if the estimates describe a rod at rest: nothing in the scene moves it, and the estimates do not know a host that
    /// does.
    pub at_rest: bool,
}

/// The largest error of a simpler law, as a fraction of the uncertainty of the most accurate one.
pub const UNCERTAINTY_FRACTION: f64 = 0.25;

impl FluidChoice {
    /// A choice without estimates, for the given `reason`.
    pub fn without_estimates(law: Option<&'static DragLaw>, reactive: bool, reason: String) -> Self {
        Self { law, reactive, reason, errors: None, uncertainty: None, at_rest: false }
    }

    /// The cheapest `allowed` law whose error is small compared with the uncertainty of the most accurate one. It includes added mass if
    /// that decides the stability of the rod, because a motion from rest may not show it.
    pub fn of(estimates: &FluidEstimates, allowed: impl Fn(&DragLaw, bool) -> bool) -> Option<Self> {
        let all = estimates.laws.len();
        let open = estimates.restricted_to(&allowed)?;
        let is_kept = estimates.regime.water_decides_stability() && open.laws.iter().any(|law| law.reactive);
        let left_out = is_kept && open.laws.iter().any(|law| !law.reactive);
        let estimates = if is_kept { open.restricted_to(|_, reactive| reactive)? } else { open };
        let limits = estimates.uncertainty.map(|uncertain| UNCERTAINTY_FRACTION * uncertain);
        let highest = estimates.laws.last()?;
        let within = |law: &&FluidEstimate| law.errors.iter().zip(limits).all(|(error, limit)| *error <= limit);
        let excess =
            |law: &&FluidEstimate| law.errors.iter().zip(limits).map(|(e, limit)| e / limit).fold(0.0, f64::max);
        let taken = estimates.laws.iter().find(within).unwrap_or(highest);
        let mut reason = if taken == highest {
            let below = estimates.laws.iter().filter(|law| *law != highest);
            match below.min_by(|a, b| excess(a).total_cmp(&excess(b))) {
                Some(below) => format!(
                    "no simpler law is accurate enough: the estimated errors of {} are {}; a quarter of the uncertainty of {} is {}",
                    below.name(),
                    estimates.in_words(below.errors),
                    highest.name(),
                    estimates.in_words(limits)
                ),
                None if estimates.laws.len() < all => format!(
                    "no other law that auto may choose {reactive} added mass is valid here",
                    reactive = if highest.reactive { "with" } else { "without" }
                ),
                None => "no other law that auto may choose is valid here".to_string(),
            }
        } else {
            format!(
                "its estimated errors relative to {} are {}, within a quarter of the uncertainty of that law ({})",
                highest.name(),
                estimates.in_words(taken.errors),
                estimates.in_words(estimates.uncertainty)
            )
        };
        if left_out {
            reason = format!(
                "with added mass, because it may decide whether the rod is stable (¼πρD²U²L²/EI = {}; a clamped rod under a follower force at its tip flutters at {BECK}); {reason}",
                two_digits(estimates.regime.flow_velocity.powi(2)),
                BECK = regime::BECK
            );
        }
        Some(Self {
            law: Some(taken.law),
            reactive: taken.reactive,
            reason,
            errors: (estimates.laws.len() > 1).then_some(taken.errors),
            uncertainty: highest.uncertainty.filter(|both| both.iter().all(|part| part.is_finite())),
            at_rest: estimates.regime.counted_speed() == 0.0,
        })
    }

    /// Includes the changes of motion and power by `law`, which is valid and more accurate than all candidates, in the reason, the errors
    /// and the uncertainty.
    pub fn count(&mut self, law: &DragLaw, changes: [f64; 2], estimates: &FluidEstimates) {
        self.reason += &format!(
            "; {} is valid here and more accurate than these, but is not used: with it {}",
            law.name,
            estimates.changes_in_words(changes)
        );
        let known = self.errors.unwrap_or_default();
        self.errors = Some([0, 1].map(|i| known[i].max(SAFETY_FACTOR * changes[i].abs()).max(MIN_ERROR)));
        let published = law.uncertainty(estimates.regime.reynolds, self.reactive);
        self.uncertainty = published.map(|published| published.measured(estimates.held));
    }

    /// The chosen law, for messages.
    pub fn name(&self) -> String {
        match (self.law, self.reactive) {
            (Some(law), reactive) => law.with_reactive(reactive),
            (None, true) => "reactive".to_string(),
            (None, false) => "no force".to_string(),
        }
    }
}
