//! Performance of a swimmer: means over the last whole cycles of its drive (speed, thrust, power, efficiency) and their spread.
//!
//! A cycle is a period of the actuation, whose frequency a host may change; without an actuation it is the common period of the
//! sinusoids that drive head and flow. [`Cycles`] follows the run step by step and stores the increments of a few integrals over
//! each of the last [`MAX_CYCLES`] whole cycles: position, ∫u dt of the flow, ∫e dt of the head's axis e, ∫F dt and ∫M dt of a
//! held head, and work. A cycle may end within a step: the integrals are interpolated there by cubic Hermite polynomials of their
//! values and rates, to fourth order in the step. ∫F dt, ∫M dt and ∫e dt are integrated by the parabola through the ends of the
//! last three steps, or by Simpson's rule if the midpoint of a step is known; work is taken from [`RunMetrics`].
//!
//! [`MEASURES`] lists the measures of a cycle. They use its duration T, f = 1/T, the length L of the rod, the mean unit vector e
//! from the rod to the front of its head, and the mean velocity U relative to the flow, of the centre of mass or of a held head.
//! The mean of each is taken over the cycles, and its spread is the standard deviation √(Σ(x − x̄)²/(n − 1)).

pub mod derivatives;

use nalgebra::{SVector, Vector2};
use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};

use crate::fluid::{Fluid, Force};
use crate::head::MotorCommand;
use crate::head::Signal;
use crate::metrics::{Measurements, Power, RunMetrics};
use crate::model::{Dynamics, Inputs, Model};
use crate::number_format::percent;
use crate::rod::node;
use crate::system::State;
use crate::tendons::{MAX_TENDONS, Tendon};

/// The largest number of cycles that are stored and averaged.
pub const MAX_CYCLES: usize = 4;

/// Cycles count as periodic if their relative difference is at most this.
const PERIODIC_TOLERANCE: f64 = 0.01;

/// Differences of speed and thrust are relative to at least this fraction of the mean modulus, because means may nearly cancel
/// over a cycle. Lateral force and moment, which a symmetric beat cancels completely, are relative to the mean modulus itself.
const CANCELLATION_FLOOR: f64 = 0.1;

/// A moment is rounding if its lever, for the mean modulus of the force, is shorter than this fraction of the length; this occurs
/// for a rod driven along its own axis.
const LEAST_LEVER: f64 = 1e-6;

/// The names of the powers, in the order of the work in [`Integrals`].
const POWERS: [&str; index::ALL - index::WORK] = [
    "power of the actuation",
    "power into drag",
    "power of the loads",
    "power of the head",
    "power of the flow",
    "power into the wake",
    "power of other forces",
    "power into spray",
    "power into the material",
];

/// A swimmer that moves less than this fraction of its length per cycle is at rest. For a held head the second limit applies,
/// because the phases at the ends of cycles are rounded.
const MIN_DISTANCE: f64 = 1e-9;
const MIN_HELD_DISTANCE: f64 = 1e-7;

/// Rounding error of phases (in cycles) near integers, and of frequency ratios.
const PHASE_ROUNDING: f64 = 1e-9;

/// The parabola through the ends of three steps is not used if a step is more than this many times longer than the previous one.
const MAX_STEP_RATIO: f64 = 4.0;

/// True if loads and other forces drive a swimmer too: they supply more than a hundredth of the power, or work, of its actuation.
pub(crate) fn is_pulled(actuation: f64, load: f64, other: f64) -> bool {
    load.max(0.0) + other.max(0.0) > 0.01 * actuation.abs()
}

/// Standard gravity, m/s², for the cost of transport.
pub const GRAVITY: f64 = 9.80665;

/// Indices of the integrals in [`Integrals`]: vectors have two entries, work has nine.
mod index {
    pub(super) const POSITION: usize = 0;
    pub(super) const FLOW: usize = 2;
    pub(super) const AXIS: usize = 4;
    pub(super) const FORCE: usize = 6;
    pub(super) const MOMENT: usize = 8;
    pub(super) const PATH: usize = 9;
    pub(super) const FORCE_MODULUS: usize = 10;
    pub(super) const MOMENT_MODULUS: usize = 11;
    pub(super) const TORQUE_SQUARE: usize = 12;
    pub(super) const HINGE_POWER: usize = 13;
    pub(super) const HINGE_ANGLE: usize = 14;
    pub(super) const HINGE_ERROR_SQUARE: usize = 15;
    pub(super) const DRAG: usize = 16;
    pub(super) const REACTIVE: usize = 18;
    pub(super) const WORK: usize = 20;
    pub(super) const ALL: usize = 29;
}

/// Integrals over time since the start, or their rates.
type Integrals = SVector<f64, { index::ALL }>;

fn vector(of: &Integrals, at: usize) -> Vector2<f64> {
    Vector2::new(of[at], of[at + 1])
}

fn set_vector(of: &mut Integrals, at: usize, vector: Vector2<f64>) {
    (of[at], of[at + 1]) = (vector.x, vector.y);
}

fn set_work(of: &mut Integrals, Power { actuation, material, viscous, wake, spray, load, head, flow, other }: Power) {
    for (i, part) in [actuation, viscous, load, head, flow, wake, other, spray, material].into_iter().enumerate() {
        of[index::WORK + i] = part;
    }
}

/// The periodic drive that defines the cycles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
enum CycleSource {
    /// The actuation, at its current frequency.
    Actuation,
    /// The driven head, the flow or tendons, at this frequency (Hz).
    Head(f64),
    /// A head, a flow or a tendon given by a table, which has no period.
    Table,
    /// Sinusoids of head, flow and tendons whose frequencies are not multiples of the lowest one.
    Mixed,
    /// Nothing.
    Nothing,
}

impl CycleSource {
    fn of(model: &Model) -> Self {
        let torque = || model.hinge.iter().map(|hinge| &hinge.torque);
        let pulls = || model.tendons.iter().map(Tendon::signal).chain(torque());
        let signals = || model.head.iter().flatten().chain(model.flow.iter().flatten()).chain(pulls());
        let frequency = |signal: &Signal| match signal {
            Signal::Sinusoid { amplitude, frequency, .. } if *amplitude != 0.0 && *frequency != 0.0 => {
                Some(frequency.abs())
            }
            _ => None,
        };
        let lowest = signals().filter_map(frequency).fold(f64::INFINITY, f64::min);
        let multiple = |frequency: f64| {
            let ratio = frequency / lowest;
            (ratio - ratio.round()).abs() <= PHASE_ROUNDING * ratio
        };
        // A host may give an amplitude to an actuation without one; if the head moves, the head defines the cycles.
        let acts = |amplitude: f64| amplitude != 0.0 || lowest.is_infinite();
        match &model.actuation {
            Some((_, drive)) if acts(drive.amplitude) => Self::Actuation,
            _ if signals().any(|signal| matches!(signal, Signal::Table(rows) if rows.len() > 1)) => Self::Table,
            _ if lowest.is_infinite() => Self::Nothing,
            _ if signals().filter_map(frequency).all(multiple) => Self::Head(lowest),
            _ => Self::Mixed,
        }
    }

    /// The phase at time `t` (s), in cycles.
    fn phase(self, dynamics: &Dynamics, t: f64) -> Option<f64> {
        match self {
            Self::Actuation => Some(dynamics.inputs.cycle(t) / std::f64::consts::TAU),
            Self::Head(frequency) => steady(dynamics).then_some(frequency * t),
            Self::Table | Self::Mixed | Self::Nothing => None,
        }
    }

    /// The reason why there is no cycle yet.
    fn reason(self, dynamics: &Dynamics) -> String {
        let shorter = |period: f64| format!("shorter than one cycle of {period:.4} s");
        match self {
            Self::Actuation if dynamics.inputs.drive.frequency == 0.0 => "the actuation's frequency is 0".to_string(),
            Self::Actuation => shorter(dynamics.inputs.drive.frequency.recip()),
            Self::Head(_) if !steady(dynamics) => {
                "a host moves or turns the head, changes the flow, or pulls a tendon".to_string()
            }
            Self::Head(frequency) => shorter(frequency.recip()),
            Self::Table => {
                "the head or the flow moves, or a tendon is pulled, by a table, which has no period".to_string()
            }
            Self::Mixed => {
                "no period of the sinusoids of head, flow and tendons is a multiple of all others".to_string()
            }
            Self::Nothing => "nothing drives the tail periodically".to_string(),
        }
    }
}

/// True if no host drives the head or the flow, or pulls a tendon.
fn steady(dynamics: &Dynamics) -> bool {
    let Inputs { head, flow_taken, tension, winch, hinge, .. } = &dynamics.inputs;
    head.is_none() && !flow_taken && [tension, winch] == [&[0.0; MAX_TENDONS]; 2] && *hinge == MotorCommand::default()
}

/// The integrals and their rates at one time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct CycleSample {
    time: f64,
    /// Phase in cycles, if the drive is periodic.
    phase: Option<f64>,
    integrals: Integrals,
    rates: Integrals,
    /// Position (m) and velocity (m/s) of the tip.
    tip: [Vector2<f64>; 2],
    /// Angle (rad) and angular velocity (rad/s) of a head on a hinge.
    hinge: [f64; 2],
}

/// The rates of all integrals in `state`, which has these `measurements`.
#[inline(always)]
fn rates(dynamics: &Dynamics, state: &State, measurements: &Measurements) -> Integrals {
    let mut rates = Integrals::zeros();
    let held = dynamics.model.head.is_some();
    let velocity = if held { node(&state.v, 0) } else { dynamics.model.rod.mean(&state.v) };
    let axis = if held {
        let (sin, cos) = measurements.head_angle().sin_cos();
        -Vector2::new(cos, sin)
    } else {
        (node(&state.q, 0) - node(&state.q, 1)).normalize()
    };
    set_vector(&mut rates, index::POSITION, velocity);
    let place = if held { node(&state.q, 0) } else { measurements.com };
    let flow = dynamics.flow_at(place);
    set_vector(&mut rates, index::FLOW, flow);
    set_vector(&mut rates, index::AXIS, axis);
    set_vector(&mut rates, index::FORCE, measurements.head_force);
    set_vector(&mut rates, index::DRAG, measurements.resultants.drag);
    set_vector(
        &mut rates,
        index::REACTIVE,
        measurements.resultants.inertia + measurements.resultants.wake + measurements.resultants.flow,
    );
    rates[index::MOMENT] = measurements.head_moment;
    rates[index::PATH] = (velocity - flow).norm();
    rates[index::FORCE_MODULUS] = measurements.head_force.norm();
    rates[index::MOMENT_MODULUS] = measurements.head_moment.abs();
    let hinge = &measurements.hinge;
    rates[index::TORQUE_SQUARE] = hinge.torque.powi(2);
    rates[index::HINGE_POWER] = hinge.power();
    rates[index::HINGE_ANGLE] = hinge.angle;
    rates[index::HINGE_ERROR_SQUARE] = hinge.error.powi(2);
    set_work(&mut rates, measurements.power);
    rates
}

impl CycleSample {
    /// The sample of `state`, with the integrals that follow from the state alone; the others are zero.
    #[inline(always)]
    fn of(source: CycleSource, dynamics: &Dynamics, state: &State, metrics: &RunMetrics) -> Self {
        let (mut integrals, tip) = (Integrals::zeros(), dynamics.model.rod.nodes - 1);
        let position = if dynamics.model.head.is_some() { node(&state.q, 0) } else { metrics.now.com };
        set_vector(&mut integrals, index::POSITION, position);
        set_work(&mut integrals, metrics.totals.work);
        Self {
            time: state.t,
            phase: source.phase(dynamics, state.t),
            integrals,
            rates: rates(dynamics, state, &metrics.now),
            tip: [node(&state.q, tip), node(&state.v, tip)],
            hinge: [metrics.now.hinge.angle, metrics.now.hinge.spin],
        }
    }

    /// Integrates the other integrals from `last` on, with the rates at the `middle` of the step or, if these are unknown, with
    /// the rates `before` the last sample.
    #[inline(always)]
    fn sum(&mut self, last: &Self, middle: Option<&Integrals>, before: Option<(f64, &Integrals)>) {
        let h = self.time - last.time;
        let mut by = match middle {
            Some(middle) => (last.rates + middle * 4.0 + self.rates) * (h / 6.0),
            None => (last.rates + self.rates) * (0.5 * h),
        };
        if let (None, Some((time, rates))) = (middle, before)
            && h <= MAX_STEP_RATIO * (last.time - time)
        {
            let (slope, slope_before) = ((self.rates - last.rates) / h, (last.rates - rates) / (last.time - time));
            by -= (slope - slope_before) / (self.time - time) * (h * h * h / 6.0);
        }
        for i in index::FLOW..index::WORK {
            self.integrals[i] = last.integrals[i] + by[i];
        }
    }
}

/// The integrals at the fraction `z` of the step between two samples, and their rates there.
#[inline(always)]
fn interpolate(from: &CycleSample, to: &CycleSample, z: f64) -> [Integrals; 2] {
    let h = to.time - from.time;
    let change = to.integrals - from.integrals;
    let curve = change * 3.0 - (from.rates * 2.0 + to.rates) * h;
    let twist = (from.rates + to.rates) * h - change * 2.0;
    let rates = (twist * (3.0 * z) + curve * 2.0) * (z / h) + from.rates;
    [from.integrals + ((twist * z + curve) * z + from.rates * h) * z, rates]
}

/// The fractions of a step at which a cycle ends, as the phase grows from `before` to `after`.
fn ends_in(before: f64, after: f64) -> impl DoubleEndedIterator<Item = f64> {
    let (first, last) = ((before + PHASE_ROUNDING).floor() as i64 + 1, (after + PHASE_ROUNDING).floor() as i64);
    // Only the last of many cycles are stored, so earlier ends are skipped.
    let phases = first.max(last.saturating_sub(MAX_CYCLES as i64))..=last;
    phases.map(move |phase| ((phase as f64 - before) / (after - before)).min(1.0))
}

/// The minimum and maximum over the fractions `span` of a step of `h` (s) of the cubic with these values and rates at its ends.
fn range(values: [f64; 2], rates: [f64; 2], h: f64, span: [f64; 2]) -> [f64; 2] {
    let change = values[1] - values[0];
    let (a, b, c) =
        (rates[0] * h, 3.0 * change - (2.0 * rates[0] + rates[1]) * h, (rates[0] + rates[1]) * h - 2.0 * change);
    let at = |z: f64| values[0] + z * (a + z * (b + z * c));
    // a + 2bz + 3cz² = 0, without cancellation.
    let root = (b * b - 3.0 * a * c).sqrt();
    let q = -(b + root.copysign(b));
    let turns = [q / (3.0 * c), a / q].into_iter().filter(|z| (span[0]..span[1]).contains(z)); // NaN is excluded
    let ends = span.map(at);
    turns.map(at).fold([ends[0].min(ends[1]), ends[0].max(ends[1])], |[least, most], y| [least.min(y), most.max(y)])
}

/// One whole cycle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cycle {
    /// Time of its start, s.
    pub from: f64,
    /// Time of its end, s.
    pub until: f64,
    /// Peak-to-peak excursion of the tip across the mean path, see [`STROUHAL`], m.
    pub excursion: f64,
    /// Peak-to-peak angle of a head on a hinge, rad.
    swing: f64,
    change: Integrals,
}

impl Cycle {
    /// Its duration T, s.
    pub fn period(&self) -> f64 {
        self.until - self.from
    }

    fn mean(&self, place: usize) -> f64 {
        self.change[place] / self.period()
    }

    fn mean_vector(&self, place: usize) -> Vector2<f64> {
        vector(&self.change, place) / self.period()
    }

    /// Mean force (N) of the tail on a held head, and the mean of its modulus.
    pub fn mean_head_force(&self) -> (Vector2<f64>, f64) {
        (self.mean_vector(index::FORCE), self.mean(index::FORCE_MODULUS))
    }

    /// Mean modulus of the velocity relative to the flow, of the centre of mass or of a held head, m/s.
    pub fn mean_path_speed(&self) -> f64 {
        self.mean(index::PATH)
    }

    /// A root mean square of the motor of a hinge.
    fn root(&self, place: usize) -> f64 {
        self.mean(place).max(0.0).sqrt()
    }

    /// Mean power dissipated in the fluid by drag, wake and spray, W.
    pub fn mean_power_into_fluid(&self) -> f64 {
        [1, 5, 7].map(|i| self.power(i)).iter().sum()
    }

    /// Mean power, W.
    fn power(&self, i: usize) -> f64 {
        self.mean(index::WORK + i)
    }

    /// U, m/s.
    fn velocity(&self) -> Vector2<f64> {
        self.mean_vector(index::POSITION) - self.mean_vector(index::FLOW)
    }

    /// The unit vector e, or `None` if the head made full turns.
    fn axis(&self) -> Option<Vector2<f64>> {
        self.mean_vector(index::AXIS).try_normalize(PHASE_ROUNDING)
    }

    /// The components of a vector along the axis and to its left.
    fn along_and_across(&self, vector: Vector2<f64>) -> [f64; 2] {
        self.axis().map_or([0.0; 2], |axis| [vector.dot(&axis), axis.perp(&vector)])
    }

    /// The smallest |U| (m/s) that is distinguished from rest.
    fn least_speed(&self, dynamics: &Dynamics) -> f64 {
        let least = if dynamics.model.head.is_some() { MIN_HELD_DISTANCE } else { MIN_DISTANCE };
        least * dynamics.model.rod.length / self.period()
    }

    /// |U|, m/s, or None if the swimmer stays in place.
    fn net_speed(&self, dynamics: &Dynamics) -> Option<f64> {
        let speed = self.velocity().norm();
        (speed >= self.least_speed(dynamics)).then_some(speed)
    }

    /// |U| and the mean power of the actuation, if both are positive, the head is free, and nothing else drives the swimmer.
    fn speed_and_power(&self, dynamics: &Dynamics) -> Option<(f64, f64)> {
        let power = self.power(0);
        let alone = dynamics.model.head.is_none() && !self.is_pulled();
        self.net_speed(dynamics).filter(|_| power > 0.0 && alone).map(|speed| (speed, power))
    }

    fn is_pulled(&self) -> bool {
        is_pulled(self.power(0), self.power(2), self.power(6))
    }

    /// Thrust (N) and speed (m/s) along the axis of a held head that moves relative to the flow, and the mean power of actuation
    /// and head, if it is positive.
    fn thrust_speed_and_power(&self, dynamics: &Dynamics) -> Option<([f64; 2], f64)> {
        let axis = held(dynamics, self.axis()?)?;
        let (thrust, speed) = (self.mean_vector(index::FORCE).dot(&axis), self.velocity().dot(&axis));
        let power = self.power(0) + self.power(3);
        self.net_speed(dynamics).filter(|_| power > 0.0).map(|_| ([thrust, speed], power))
    }

    /// The reason why this swimmer has no [`EFFICIENCY`], if it has none.
    fn missing_efficiency(&self, dynamics: &Dynamics) -> Option<&'static str> {
        if (EFFICIENCY.of)(self, dynamics).is_some() {
            return None;
        }
        let held = dynamics.model.head.is_some();
        Some(match self.net_speed(dynamics) {
            _ if held && !dynamics.model.forces.iter().any(Force::is_of_fluid) => "there is no fluid to push against",
            None if held => "a fixed head in still water does no useful work: add a flow with medium.flow_m_s",
            None => "the mean speed of the swimmer is zero",
            Some(_) if held && self.axis().is_none() => "the head turns all the way round, so it has no mean direction",
            Some(_) if held => "neither the actuation nor the head supplies power",
            Some(_) if self.power(0) <= 0.0 => "the actuation supplies no power",
            Some(_) if self.is_pulled() => "loads also supply power, so the power of the swimmer cannot be separated",
            Some(_) if dynamics.model.forces.is_empty() => "the straight rod has no drag: add [drag]",
            Some(_) => "the drag of the straight rod varies with position in this medium",
        })
    }

    /// The quantity that differs most from the next cycle, `other`, for a rod of this `length` (m).
    fn difference(&self, other: &Self, length: f64) -> CycleDifference {
        let of = |cycle: &Self| {
            let [ahead, aside] = cycle.along_and_across(cycle.velocity());
            let [thrust, lift] = cycle.along_and_across(cycle.mean_vector(index::FORCE));
            [ahead, aside, thrust, lift, cycle.mean(index::MOMENT)]
        };
        let (means, others) = (of(self), of(other));
        let scale = |size: f64, floor: f64, place: usize| size.max(floor * other.mean(place));
        let (speed, force) = (others[0].hypot(others[1]), others[2].hypot(others[3]));
        let scales = [
            ("speed", scale(speed, CANCELLATION_FLOOR, index::PATH)),
            ("lateral speed", scale(speed, 1.0, index::PATH)),
            ("thrust", scale(force, CANCELLATION_FLOOR, index::FORCE_MODULUS)),
            ("lateral force", scale(force, 1.0, index::FORCE_MODULUS)),
            ("moment", {
                let least = LEAST_LEVER * length * other.mean(index::FORCE_MODULUS);
                scale(others[4].abs(), 1.0, index::MOMENT_MODULUS).max(least)
            }),
        ];
        let power = (0..POWERS.len()).fold(0.0, |max: f64, i| max.max(other.power(i).abs()));
        let of_means = scales.into_iter().enumerate().map(|(i, (name, scale))| (name, means[i] - others[i], scale));
        let of_powers = POWERS.into_iter().enumerate().map(|(i, name)| (name, self.power(i) - other.power(i), power));
        let none = CycleDifference { quantity: scales[0].0, relative: 0.0 };
        of_means.chain(of_powers).fold(none, |largest, (quantity, change, scale)| {
            let relative = if change == 0.0 { 0.0 } else { change.abs() / scale };
            if relative > largest.relative { CycleDifference { quantity, relative } } else { largest }
        })
    }
}

/// The quantity that differs most between two cycles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CycleDifference {
    /// Name of the quantity, for messages.
    pub quantity: &'static str,
    /// Its relative difference. A lateral force or a moment, which a symmetric beat cancels, is relative to the mean modulus.
    pub relative: f64,
}

impl CycleDifference {
    /// The largest of the differences between each of `cycles` and the next, for a rod of this `length` (m); `None` for fewer
    /// than two cycles.
    pub fn largest(cycles: &[Cycle], length: f64) -> Option<Self> {
        let differences = cycles.windows(2).map(|pair| pair[0].difference(&pair[1], length));
        differences.reduce(|a, b| if b.relative > a.relative { b } else { a })
    }

    /// True if the difference is at most 1 %: the motion is periodic.
    pub fn is_periodic(&self) -> bool {
        self.relative <= PERIODIC_TOLERANCE
    }
}

/// For example "the thrust differs by 3.1 %".
impl std::fmt::Display for CycleDifference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "the {} differs by {}", self.quantity, percent(self.relative))
    }
}

/// A quantity of a cycle, or `None` if it is undefined for the scene or the motion.
#[derive(Debug, Clone, Copy)]
pub struct CycleMeasure {
    /// Its name, the common part of its keys.
    pub name: &'static str,
    /// The key of its mean in summary.json, which ends in its unit.
    pub key: &'static str,
    /// The key of its spread.
    pub spread: &'static str,
    /// SI unit, or `1` if dimensionless.
    pub unit: &'static str,
    /// Description.
    pub description: &'static str,
    of: fn(&Cycle, &Dynamics) -> Option<f64>,
}

impl CycleMeasure {
    /// Its name for messages.
    pub fn label(&self) -> String {
        self.name.replace('_', " ")
    }
}

/// Defines a [`CycleMeasure`] `cycle_<name><unit>` and its spread.
macro_rules! measure {
    ($constant:ident, $name:literal, $suffix:literal, $unit:literal, $description:literal, $of:expr) => {
        #[doc = $description]
        pub const $constant: CycleMeasure = CycleMeasure {
            name: $name,
            key: concat!("cycle_", $name, $suffix),
            spread: concat!("cycle_", $name, "_spread", $suffix),
            unit: $unit,
            description: concat!(
                $description,
                "; 0 before the first, NaN if a table or a host moves head or flow, because cycles are then unknown"
            ),
            of: $of,
        };
    };
}

fn held<T>(dynamics: &Dynamics, value: T) -> Option<T> {
    dynamics.model.head.is_some().then_some(value)
}

fn hinged<T>(dynamics: &Dynamics, value: T) -> Option<T> {
    dynamics.model.hinge.is_some().then_some(value)
}

/// The mean of a force along the head's mean axis, in a fluid with added mass; without added mass, drag is the only force.
fn along_axis_in_water(cycle: &Cycle, dynamics: &Dynamics, place: usize) -> Option<f64> {
    let axis = cycle.axis().filter(|_| dynamics.model.forces.are_inertial())?;
    Some(cycle.mean_vector(place).dot(&axis))
}

measure!(PERIOD, "period", "_s", "s", "mean duration T of the last whole cycles", |c, _| Some(c.period()));
measure!(
    SPEED,
    "speed",
    "_m_s",
    "m/s",
    "magnitude of the mean velocity U relative to the flow over the last whole cycles, of the centre of mass or of a held head",
    |c, _| Some(c.velocity().norm())
);
measure!(
    FORWARD_SPEED,
    "forward_speed",
    "_m_s",
    "m/s",
    "U·e, the part of U along the head's mean axis e: positive head first, negative tail first",
    |c, _| c.axis().map(|axis| c.velocity().dot(&axis))
);
measure!(
    DIRECTION,
    "direction",
    "_rad",
    "rad",
    "angle between U and the head's mean axis e: 0 is head first, pi is tail first",
    |c, d| {
        c.net_speed(d)?;
        c.axis().map(|axis| axis.angle(&c.velocity()))
    }
);
measure!(BODY_LENGTHS, "body_lengths", "", "1", "body lengths per cycle, |U|T/L", |c, d| Some(
    c.velocity().norm() * c.period() / d.model.rod.length
));
measure!(
    TIP_EXCURSION,
    "tip_excursion",
    "_m",
    "m",
    "peak-to-peak excursion A of the tip over a cycle, across the mean path through the fluid or, for a fixed head, across its mean axis",
    |c, _| Some(c.excursion)
);
measure!(
    STROUHAL,
    "strouhal_number",
    "",
    "1",
    "Strouhal number fA/|U|, with the peak-to-peak excursion A of the tip across the mean path through the fluid of the previous cycle, in the frame that moves at its mean velocity",
    |c, d| c.net_speed(d).map(|speed| c.excursion / (c.period() * speed))
);
measure!(
    SLIP,
    "slip",
    "",
    "1",
    "slip (U·e)/(f lambda): forward speed over the speed of the actuation's wave, lambda = actuation.wavelength_m; active moments may bend the body in a longer wave",
    |c, d| {
        let (actuation, _) = d.model.actuation.as_ref()?;
        Some((FORWARD_SPEED.of)(c, d)? * c.period() / actuation.wavelength()?)
    }
);
measure!(
    THRUST,
    "thrust",
    "_n",
    "N",
    "mean force of the tail on the held head along the head's mean axis: positive pushes the head forward",
    |c, d| {
        let axis = held(d, c.axis()?)?;
        Some(c.mean_vector(index::FORCE).dot(&axis))
    }
);
measure!(
    DRAG_THRUST,
    "drag_thrust",
    "_n",
    "N",
    "mean force of drag on the rod along the head's mean axis: negative brakes",
    |c, d| along_axis_in_water(c, d, index::DRAG)
);
measure!(
    REACTIVE_THRUST,
    "reactive_thrust",
    "_n",
    "N",
    "mean force along the head's mean axis of the fluid that the rod accelerates and of the wake that leaves it",
    |c, d| along_axis_in_water(c, d, index::REACTIVE)
);
measure!(HEAD_FORCE_X, "head_force_x", "_n", "N", "mean force of the tail on the held head, x", |c, d| held(
    d,
    c.mean(index::FORCE)
));
measure!(HEAD_FORCE_Y, "head_force_y", "_n", "N", "mean force of the tail on the held head, y", |c, d| held(
    d,
    c.mean(index::FORCE + 1)
));
measure!(HEAD_MOMENT, "head_moment", "_n_m", "N m", "mean moment of the tail on the held head about node 0", |c, d| {
    held(d, c.mean(index::MOMENT))
});
measure!(
    HINGE_TORQUE,
    "rms_hinge_torque",
    "_n_m",
    "N m",
    "root mean square of the torque of the motor of the hinged head over the last whole cycles",
    |c, d| hinged(d, c.root(index::TORQUE_SQUARE))
);
measure!(
    HINGE_POWER,
    "hinge_power",
    "_w",
    "W",
    "mean power supplied by the motor of the hinged head over the last whole cycles",
    |c, d| hinged(d, c.mean(index::HINGE_POWER))
);
measure!(
    HINGE_ANGLE,
    "hinge_angle",
    "_rad",
    "rad",
    "mean angle of the hinged head, from +x, over the last whole cycles",
    |c, d| hinged(d, c.mean(index::HINGE_ANGLE))
);
measure!(
    HINGE_AMPLITUDE,
    "hinge_amplitude",
    "_rad",
    "rad",
    "half of the peak-to-peak angle of the hinged head over a cycle",
    |c, d| hinged(d, 0.5 * c.swing)
);
measure!(
    TRACKING_ERROR,
    "rms_tracking_error",
    "_rad",
    "rad",
    "root mean square over the last whole cycles of the tracking error of the hinged head, its commanded angle less its actual one",
    |c, d| d.model.hinge.as_ref().filter(|hinge| hinge.stiffness > 0.0).map(|_| c.root(index::HINGE_ERROR_SQUARE))
);
measure!(
    ACTUATION_POWER,
    "actuation_power",
    "_w",
    "W",
    "mean power of the actuation over the last whole cycles",
    |c, _| Some(c.power(0))
);
measure!(
    MATERIAL_POWER,
    "material_power",
    "_w",
    "W",
    "mean power dissipated by the damped material over the last whole cycles",
    |c, d| d.model.is_damped().then(|| c.power(8))
);
measure!(
    VISCOUS_POWER,
    "viscous_power",
    "_w",
    "W",
    "mean power dissipated by drag over the last whole cycles",
    |c, _| Some(c.power(1))
);
measure!(WAKE_POWER, "wake_power", "_w", "W", "mean power lost to the wake over the last whole cycles", |c, d| d
    .model
    .forces
    .are_inertial()
    .then(|| c.power(5)));
measure!(LOAD_POWER, "load_power", "_w", "W", "mean power of loads over the last whole cycles", |c, _| Some(
    c.power(2)
));
measure!(HEAD_POWER, "head_power", "_w", "W", "mean power of the held head over the last whole cycles", |c, _| Some(
    c.power(3)
));
measure!(
    FLOW_POWER,
    "flow_power",
    "_w",
    "W",
    "mean power of the background flow over the last whole cycles",
    |c, _| Some(c.power(4))
);
measure!(
    OTHER_POWER,
    "other_power",
    "_w",
    "W",
    "mean power of other forces, those that follow the rod, over the last whole cycles",
    |c, d| d.model.forces.are_others().then(|| c.power(6))
);
measure!(
    COST_OF_TRANSPORT,
    "cost_of_transport",
    "",
    "1",
    "cost of transport P/(m g |U|) of a free swimmer, P the mean power of the actuation, g = 9.80665 m/s^2",
    |c, d| c.speed_and_power(d).map(|(speed, power)| power / (d.model.rod.total_mass() * GRAVITY * speed))
);
measure!(
    EFFICIENCY,
    "efficiency",
    "",
    "1",
    "efficiency D(|U|)|U|/P of a free swimmer, D the drag of the straight rod with its head body along itself at that speed; of a held head in a stream its thrust times its speed against the stream, over the power of actuation and head",
    |c, d| match c.thrust_speed_and_power(d) {
        Some(([thrust, speed], power)) => Some(thrust * speed / power),
        None => c.speed_and_power(d).and_then(|(speed, power)| Some(d.towing_force(speed)? * speed / power)),
    }
);

/// All measures, in the order of display.
pub const MEASURES: [CycleMeasure; 29] = [
    PERIOD,
    SPEED,
    FORWARD_SPEED,
    DIRECTION,
    BODY_LENGTHS,
    TIP_EXCURSION,
    STROUHAL,
    SLIP,
    THRUST,
    DRAG_THRUST,
    REACTIVE_THRUST,
    HEAD_FORCE_X,
    HEAD_FORCE_Y,
    HEAD_MOMENT,
    HINGE_TORQUE,
    HINGE_POWER,
    HINGE_ANGLE,
    HINGE_AMPLITUDE,
    TRACKING_ERROR,
    ACTUATION_POWER,
    MATERIAL_POWER,
    VISCOUS_POWER,
    WAKE_POWER,
    LOAD_POWER,
    HEAD_POWER,
    FLOW_POWER,
    OTHER_POWER,
    COST_OF_TRANSPORT,
    EFFICIENCY,
];

/// The mean of [`EFFICIENCY`] over `cycles` with the drag of `fluid`.
pub(crate) fn efficiency(cycles: &[Cycle], dynamics: &Dynamics, fluid: Fluid) -> Option<f64> {
    let mut sum = 0.0;
    for cycle in cycles {
        let (speed, power) = cycle.speed_and_power(dynamics)?;
        sum += dynamics.towing_force_in(fluid, speed)? * speed / power;
    }
    Some(sum / cycles.len() as f64)
}

impl CycleMeasure {
    /// Its mean over `cycles`, or `None` if it is undefined for one of them.
    pub fn mean(&self, cycles: &[Cycle], dynamics: &Dynamics) -> Option<f64> {
        let mut sum = 0.0;
        for cycle in cycles {
            sum += (self.of)(cycle, dynamics)?;
        }
        Some(sum / cycles.len() as f64).filter(|mean| mean.is_finite())
    }

    /// Its standard deviation over at least two `cycles`.
    pub fn spread(&self, cycles: &[Cycle], dynamics: &Dynamics) -> Option<f64> {
        let mean = self.mean(cycles, dynamics)?;
        let squares = cycles.iter().filter_map(|cycle| (self.of)(cycle, dynamics)).map(|x| (x - mean).powi(2));
        (cycles.len() > 1).then(|| (squares.sum::<f64>() / (cycles.len() - 1) as f64).sqrt())
    }
}

/// The last whole cycles of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cycles {
    source: CycleSource,
    /// Time (s) and integrals at the start.
    start: (f64, Integrals),
    last: CycleSample,
    /// Time (s) and rates of the sample before the last, unless inputs have jumped since.
    before: Option<(f64, Integrals)>,
    /// Time (s) and integrals at the start of the current cycle.
    begin: Option<(f64, Integrals)>,
    /// Of the last cycle: the direction across the path through the fluid, and the velocity (m/s) of the frame in which the tip
    /// is observed.
    across: Vector2<f64>,
    drift: Vector2<f64>,
    /// The minimum and maximum coordinate of the tip in that direction in this cycle, m.
    range: [f64; 2],
    /// The minimum and maximum angle of a head on a hinge in this cycle, rad.
    hinge_range: [f64; 2],
    /// The first `count` entries are whole cycles, in order of time.
    kept: [Cycle; MAX_CYCLES],
    count: usize,
}

impl Cycles {
    /// No cycles yet, for a run that starts at `state`.
    pub fn start(dynamics: &Dynamics, state: &State, metrics: &RunMetrics) -> Self {
        Self::start_with(CycleSource::of(&dynamics.model), dynamics, state, metrics)
    }

    /// As [`start`](Self::start); a table that moves the head or the flow repeats itself after `period` (s), if that is given.
    pub fn start_with_period(dynamics: &Dynamics, state: &State, metrics: &RunMetrics, period: Option<f64>) -> Self {
        let source = match (CycleSource::of(&dynamics.model), period) {
            (CycleSource::Table, Some(period)) => CycleSource::Head(period.recip()),
            (source, _) => source,
        };
        Self::start_with(source, dynamics, state, metrics)
    }

    fn start_with(source: CycleSource, dynamics: &Dynamics, state: &State, metrics: &RunMetrics) -> Self {
        let last = CycleSample::of(source, dynamics, state, metrics);
        let chord = last.tip[0] - node(&state.q, 0);
        let across = Vector2::new(-chord.y, chord.x).try_normalize(0.0).unwrap_or(Vector2::y());
        let none = Cycle { from: 0.0, until: 0.0, excursion: 0.0, swing: 0.0, change: Integrals::zeros() };
        // Before its first cycle, a free rod is observed in the frame of the fluid.
        let drift = if dynamics.model.head.is_some() { Vector2::zeros() } else { vector(&last.rates, index::FLOW) };
        let range = [(last.tip[0] - drift * last.time).dot(&across); 2];
        Self {
            source,
            start: (last.time, last.integrals),
            before: None,
            begin: last.phase.map(|_| (last.time, last.integrals)),
            across,
            drift,
            range,
            hinge_range: [last.hinge[0]; 2],
            kept: [none; MAX_CYCLES],
            count: 0,
            last,
        }
    }

    /// Adds a step to `state`, or a jump, after `metrics` has counted it. `middle` is the midpoint of the step, if the model has dense
    /// output.
    pub fn follow(
        &mut self,
        dynamics: &Dynamics,
        state: &State,
        metrics: &RunMetrics,
        middle: Option<(&State, &Measurements)>,
    ) {
        let mut now = CycleSample::of(self.source, dynamics, state, metrics);
        if now.time > self.last.time {
            let middle = middle.map(|(state, measurements)| rates(dynamics, state, measurements));
            now.sum(&self.last, middle.as_ref(), self.before.as_ref().map(|(time, rates)| (*time, rates)));
            self.finish_cycles(dynamics, &now);
            self.before = Some((self.last.time, self.last.rates));
        } else {
            let known = self.last.integrals.fixed_rows::<{ index::WORK - index::FLOW }>(index::FLOW);
            now.integrals.fixed_rows_mut::<{ index::WORK - index::FLOW }>(index::FLOW).copy_from(&known);
            self.before = None;
        }
        self.last = now;
    }

    /// Completes the cycles that end by `now`.
    fn finish_cycles(&mut self, dynamics: &Dynamics, now: &CycleSample) {
        let mut passed = 0.0;
        match (self.last.phase, now.phase) {
            (Some(before), Some(after)) => {
                for z in ends_in(before, after) {
                    self.extend_range(now, [passed, z]);
                    let from = &self.last;
                    let time = from.time + z * (now.time - from.time);
                    let mut integrals = interpolate(from, now, z)[0];
                    if let Some([place, _]) = dynamics.head_place(time) {
                        set_vector(&mut integrals, index::POSITION, place);
                    }
                    self.push_cycle(dynamics, time, integrals);
                    passed = z;
                    self.clear_ranges();
                }
            }
            (None, Some(_)) => {
                self.begin = Some((now.time, now.integrals));
                self.clear_ranges();
            }
            (_, None) => self.begin = None,
        }
        self.extend_range(now, [passed, 1.0]);
    }

    /// Begins the ranges of a cycle.
    fn clear_ranges(&mut self) {
        self.range = [f64::INFINITY, f64::NEG_INFINITY];
        self.hinge_range = self.range;
    }

    /// Extends the ranges by the motion of the tip and of a hinge over the fractions `span` of the step to `now`.
    fn extend_range(&mut self, now: &CycleSample, span: [f64; 2]) {
        let seen = |&CycleSample { time, tip: [place, velocity], .. }: &CycleSample| {
            [place - self.drift * time, velocity - self.drift].map(|tip| tip.dot(&self.across))
        };
        let [from, to] = [&self.last, now].map(seen);
        let h = now.time - self.last.time;
        let [least, most] = range([from[0], to[0]], [from[1], to[1]], h, span);
        self.range = [self.range[0].min(least), self.range[1].max(most)];
        if self.last.hinge != [0.0; 2] || now.hinge != [0.0; 2] {
            let ([from, rate], [to, rate_then]) = (self.last.hinge, now.hinge);
            let [least, most] = range([from, to], [rate, rate_then], h, span);
            self.hinge_range = [self.hinge_range[0].min(least), self.hinge_range[1].max(most)];
        }
    }

    /// Appends the cycle that ends at time `until` (s) with these integrals.
    fn push_cycle(&mut self, dynamics: &Dynamics, until: f64, integrals: Integrals) {
        let Some((from, first)) = self.begin.replace((until, integrals)) else { return };
        let [excursion, swing] = [self.range, self.hinge_range].map(|[least, most]| most - least);
        let swing = swing.max(0.0); // for a hinge that has not moved
        let cycle = Cycle { from, until, excursion, swing, change: integrals - first };
        if self.count == MAX_CYCLES {
            self.kept.rotate_left(1);
            self.count -= 1;
        }
        self.kept[self.count] = cycle;
        self.count += 1;
        let path = cycle.net_speed(dynamics).map(|speed| cycle.velocity() / speed);
        if let Some(along) = path.or_else(|| cycle.axis()) {
            self.across = Vector2::new(-along.y, along.x);
        }
        self.drift = cycle.mean_vector(index::POSITION);
    }

    /// The last whole cycles at time `t` (s), the current time or a time within the last step.
    pub fn whole(&self, t: f64) -> &[Cycle] {
        let count = self.kept[..self.count].iter().take_while(|cycle| cycle.until <= t).count();
        &self.kept[..count]
    }

    /// The whole run since its start as one cycle, whose excursion is unknown.
    pub fn since_start(&self) -> Option<Cycle> {
        let ((from, first), until) = (self.start, self.last.time);
        let cycle = Cycle { from, until, excursion: 0.0, swing: 0.0, change: self.last.integrals - first };
        (cycle.period() > 0.0).then_some(cycle)
    }

    /// True if no cycles are defined because a table or a host moves the head or the flow.
    pub fn are_unknown(&self, dynamics: &Dynamics) -> bool {
        match self.source {
            CycleSource::Actuation => false,
            CycleSource::Head(_) | CycleSource::Nothing => !steady(dynamics),
            CycleSource::Table | CycleSource::Mixed => true,
        }
    }

    /// The reason why there are no cycles yet.
    pub(crate) fn reason(&self, dynamics: &Dynamics) -> Option<String> {
        (self.count == 0).then(|| self.source.reason(dynamics))
    }

    /// The averages over the last whole cycles.
    pub fn averages(&self, dynamics: &Dynamics) -> CycleAverages {
        let cycles = self.whole(f64::INFINITY);
        CycleAverages {
            used: cycles.len(),
            span: cycles.first().zip(cycles.last()).map(|(first, last)| [first.from, last.until]),
            difference: CycleDifference::largest(cycles, dynamics.model.rod.length),
            reason: self.reason(dynamics),
            efficiency_reason: cycles
                .iter()
                .find_map(|cycle| cycle.missing_efficiency(dynamics))
                .map(String::from)
                .or_else(|| self.reason(dynamics)),
            measures: MEASURES.map(|measure| {
                let of = |value: fn(&CycleMeasure, &[Cycle], &Dynamics) -> Option<f64>| {
                    (!cycles.is_empty()).then(|| value(&measure, cycles, dynamics)).flatten()
                };
                (of(CycleMeasure::mean), of(CycleMeasure::spread))
            }),
            free: dynamics.model.head.is_none(),
            has_body: dynamics.model.rod.body.is_some(),
        }
    }
}

/// Averages over the last whole cycles of a run, with their spread.
#[derive(Debug, Clone, PartialEq)]
pub struct CycleAverages {
    /// Number of cycles.
    pub used: usize,
    /// Times of the start of the first and the end of the last, s.
    pub span: Option<[f64; 2]>,
    /// The quantity that differs most from one cycle to the next; `None` for fewer than two cycles.
    pub difference: Option<CycleDifference>,
    /// The reason why there are no cycles, if there are none.
    pub reason: Option<String>,
    /// The reason why there is no efficiency, if there is none.
    pub efficiency_reason: Option<String>,
    /// Mean and spread of each of [`MEASURES`].
    measures: [(Option<f64>, Option<f64>); MEASURES.len()],
    free: bool,
    /// True if a body is at the head.
    has_body: bool,
}

impl CycleAverages {
    /// The mean of a measure.
    pub fn mean(&self, measure: &CycleMeasure) -> Option<f64> {
        let place = MEASURES.iter().position(|other| other.key == measure.key)?;
        self.measures[place].0
    }

    /// How a free swimmer swims: head first or tail first (within 60°), or sideways.
    pub fn swims(&self) -> Option<&'static str> {
        let degrees = self.mean(&DIRECTION).filter(|_| self.free)?.to_degrees();
        Some(match degrees {
            ..60.0 => "head first",
            120.0.. => "tail first",
            _ => "sideways",
        })
    }
}

/// Formats with four digits.
fn short(x: f64) -> String {
    match x.abs() {
        size @ 1e-3..1e4 => format!("{x:.*}", (3 - size.log10().floor() as i32).max(0) as usize),
        _ => format!("{x:.3e}"),
    }
}

/// One sentence about how it swims, or how the tail propels its head.
impl std::fmt::Display for CycleAverages {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(reason) = &self.reason {
            return write!(f, "no averages over whole cycles: {reason}");
        }
        let cycles = match self.used {
            1 => "over the one whole cycle".to_string(),
            count => format!("over the last {count} whole cycles"),
        };
        write!(f, "{cycles}")?;
        if let Some(period) = self.mean(&PERIOD) {
            write!(f, " of {period:.4} s")?;
        }
        let mut separator = ": ";
        let mut part = |f: &mut std::fmt::Formatter<'_>, text: String| {
            f.write_str(std::mem::replace(&mut separator, ", "))?;
            f.write_str(&text)
        };
        if let Some(swims) = self.swims() {
            part(f, format!("swims {swims}"))?;
        }
        let efficiency = match self.has_body {
            true => "efficiency (power to tow the straight rod with its head body over that to swim)",
            false => "efficiency (power to tow the straight rod over that to swim)",
        };
        let shown: &[(&str, &CycleMeasure)] = if self.free {
            &[
                ("speed", &SPEED),
                ("body lengths per cycle", &BODY_LENGTHS),
                ("slip", &SLIP),
                ("Strouhal number", &STROUHAL),
                ("cost of transport", &COST_OF_TRANSPORT),
                (efficiency, &EFFICIENCY),
            ]
        } else {
            &[
                ("thrust", &THRUST),
                ("moment", &HEAD_MOMENT),
                ("power of the head", &HEAD_POWER),
                ("power of the hinge's motor", &HINGE_POWER),
                ("root mean square of its torque", &HINGE_TORQUE),
                ("amplitude of the hinge", &HINGE_AMPLITUDE),
                ("root mean square of its tracking error", &TRACKING_ERROR),
                ("power of the actuation", &ACTUATION_POWER),
                ("efficiency (thrust times speed against the stream over the power)", &EFFICIENCY),
            ]
        };
        for (name, measure) in shown {
            // A drive that is absent or does not move has no power.
            if let Some(mean) = self.mean(measure).filter(|mean| measure.unit != "W" || *mean != 0.0) {
                let unit = if measure.unit == "1" { String::new() } else { format!(" {}", measure.unit) };
                part(f, format!("{name} {}{unit}", short(mean)))?;
            }
        }
        if let Some(reason) = &self.efficiency_reason {
            part(f, format!("no efficiency ({reason})"))?;
        }
        match &self.difference {
            Some(difference) if difference.is_periodic() => f.write_str("; periodic"),
            Some(difference) => write!(f, "; not periodic yet: {difference} from cycle to cycle"),
            None => Ok(()),
        }
    }
}

/// A flat map of the number of cycles, and of each measure and its spread by key.
impl Serialize for CycleAverages {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("cycles_used", &self.used)?;
        let periodic = self.difference.as_ref().map(CycleDifference::is_periodic);
        let reason = self.difference.as_ref().filter(|_| periodic == Some(false));
        map.serialize_entry("cycles_periodic", &periodic)?;
        map.serialize_entry("cycles_periodic_reason", &reason.map(ToString::to_string))?;
        map.serialize_entry("cycles_from_s", &self.span.map(|span| span[0]))?;
        map.serialize_entry("cycles_until_s", &self.span.map(|span| span[1]))?;
        map.serialize_entry("cycles_reason", &self.reason)?;
        map.serialize_entry("cycle_efficiency_reason", &self.efficiency_reason)?;
        map.serialize_entry("swims", &self.swims())?;
        for (measure, (mean, spread)) in MEASURES.iter().zip(&self.measures) {
            map.serialize_entry(measure.key, mean)?;
            map.serialize_entry(measure.spread, spread)?;
        }
        map.end()
    }
}
