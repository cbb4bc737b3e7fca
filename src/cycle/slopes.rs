//! How what a swimmer is measured by depends on the motion: the weights of values and rates at the steps in the integrals of a
//! cycle, and the derivatives of a measure by these integrals.

use nalgebra::Vector2;

use super::{
    Cycle, Cycles, DIRECTION, DRAG_THRUST, GRAVITY, Integrals, KEPT, LONGER, MEASURES, Measure, PERIOD,
    REACTIVE_THRUST, STROUHAL, Source, WHOLE, between, ends_in, place, put, vector,
};
use crate::fluid::force::{self, StateDerivatives};
use crate::fluid::{Key, PowerKind};
use crate::model::Dynamics;

/// The ends of cycles are moved by this part of their time.
const MOVED: f64 = 1e-3;

/// How much the values and rates at each time count in the change of an integral over a cycle.
#[derive(Debug, Clone)]
pub struct Weights {
    /// Of what is known at every time, as positions and work: the value's.
    pub value: Vec<f64>,
    /// The rate's.
    pub rate: Vec<f64>,
    /// Of what is summed from its rates: the rate's.
    pub summed: Vec<f64>,
}

/// What a measure depends on.
#[derive(Debug, Clone)]
pub struct Dependence {
    /// By the change over the cycle of: position, x and y.
    pub position: [f64; 2],
    /// Of the integral of the flow's velocity.
    pub flow: [f64; 2],
    /// Of the integral of the head's axis.
    pub axis: [f64; 2],
    /// Of the force on a held head.
    pub force: [f64; 2],
    /// Of the moment on a held head.
    pub moment: f64,
    /// Of the work of actuation, viscosity, loads, held head, flow, wake, and other forces.
    pub work: [f64; 7],
    /// By parameters of the forces themselves.
    pub by_key: Vec<(Key, f64)>,
}

/// The coefficients of a cubic's values and rates at the ends of a step of `h` (s), at its part `z`.
fn cubic(z: f64, h: f64) -> [f64; 4] {
    let (square, cube) = (z * z, z * z * z);
    [1.0 - 3.0 * square + 2.0 * cube, 3.0 * square - 2.0 * cube, h * (z - 2.0 * square + cube), h * (cube - square)]
}

/// Where a cycle ends: its time (s), and the rates of all integrals there.
#[derive(Debug, Clone, Copy)]
pub struct End {
    time: f64,
    rates: Integrals,
}

impl Cycles {
    /// The first end, where a run starts.
    pub(crate) fn first_end(&self) -> End {
        End { time: self.last.time, rates: self.last.rates }
    }

    /// The ends in the step that came after `before`.
    pub(crate) fn ends_since(&self, before: &Self) -> impl Iterator<Item = End> {
        let (from, to) = (before.last, self.last);
        let span = from.phase.zip(to.phase).filter(|_| to.time > from.time);
        let end = move |z: f64| {
            let [_, rates] = between(&from, &to, z);
            End { time: from.time + z * (to.time - from.time), rates }
        };
        span.into_iter().flat_map(move |(before, after)| ends_in(before, after).map(end))
    }

    /// The frequency (Hz) that the ends of its cycles follow, as `dynamics` has it, of the same scene or one that hardly differs.
    pub(crate) fn frequency(&self, dynamics: &Dynamics) -> Option<f64> {
        match (self.source, Source::of(&dynamics.model)) {
            (Source::Actuation, _) => Some(dynamics.inputs.drive.frequency),
            (Source::Head(_), Source::Head(frequency)) => Some(frequency),
            _ => None,
        }
    }

    /// The mean of `measure` over the last whole cycles, which are between the last of `ends`, by the formula that it has in
    /// `dynamics`, a scene that hardly differs. Where what drives the cycles has the frequency f/(1 + `stretch`) there instead of f, an
    /// end at t = n/f moves, and the integrals between the ends follow it to first order.
    pub(crate) fn mean_as(&self, measure: &Measure, dynamics: &Dynamics, ends: &[End], stretch: f64) -> Option<f64> {
        let cycles = self.whole(f64::INFINITY);
        let ends = &ends[ends.len().checked_sub(1 + cycles.len())?..];
        let moved = |(cycle, ends): (&Cycle, &[End])| {
            let [from, until] = [ends[0], ends[1]].map(|end| end.time * stretch);
            let change = cycle.change + ends[1].rates * until - ends[0].rates * from;
            (measure.of)(&Cycle { from: cycle.from + from, until: cycle.until + until, change, ..*cycle }, dynamics)
        };
        let means: Vec<f64> = cycles.iter().zip(ends.windows(2)).map(moved).collect::<Option<_>>()?;
        (!means.is_empty()).then(|| means.iter().sum::<f64>() / means.len() as f64)
    }

    /// The derivative of the mean of `measure` over the last whole cycles by the actuation's frequency (Hz) as far as it moves
    /// the ends t = n/f of these cycles, which are the last of `ends`; zero where others drive the cycles.
    pub(crate) fn by_frequency(&self, measure: &Measure, dynamics: &Dynamics, ends: &[End]) -> f64 {
        if self.source != Source::Actuation {
            return 0.0;
        }
        // A smooth function of the logarithm of the frequency, by differences of fourth order.
        let mean = |change: f64| self.mean_as(measure, dynamics, ends, (-change).exp_m1());
        let central = |change: f64| Some((mean(change)? - mean(-change)?) / (2.0 * change));
        let by = central(MOVED).zip(central(2.0 * MOVED));
        by.map_or(f64::NAN, |(near, far)| (4.0 * near - far) / (3.0 * dynamics.inputs.drive.frequency))
    }

    /// The last whole cycles of a run of single steps between `times` from the start: the ends of each, as number of the
    /// step's end and part of the step.
    fn ends(&self, dynamics: &Dynamics, times: &[f64]) -> Vec<[(usize, f64); 2]> {
        let phase = |t: f64| self.source.phase(dynamics, t);
        let mut ends = vec![(0, 1.0)];
        for (n, pair) in times.windows(2).enumerate() {
            let (Some(before), Some(after)) = (phase(pair[0]), phase(pair[1])) else { continue };
            let (first, last) = ((before + WHOLE).floor() as i64 + 1, (after + WHOLE).floor() as i64);
            ends.extend((first..=last).map(|phase| (n + 1, ((phase as f64 - before) / (after - before)).min(1.0))));
        }
        let cycles: Vec<[(usize, f64); 2]> = ends.windows(2).map(|pair| [pair[0], pair[1]]).collect();
        cycles[cycles.len().saturating_sub(KEPT)..].to_vec()
    }

    /// The weights of the steps between `times` in each of the last whole cycles.
    pub(crate) fn weights(&self, dynamics: &Dynamics, times: &[f64]) -> Vec<Weights> {
        let count = times.len();
        let step = |n: usize| times[n] - times[n - 1];
        let of = |ends: [(usize, f64); 2]| {
            let [mut value, mut rate] = [vec![0.0; count], vec![0.0; count]];
            for ((n, z), sign) in ends.into_iter().zip([-1.0, 1.0]) {
                if n == 0 {
                    value[0] += sign;
                    continue;
                }
                let [first, last, rate_first, rate_last] = cubic(z, step(n)).map(|c| sign * c);
                value[n - 1] += first;
                value[n] += last;
                rate[n - 1] += rate_first;
                rate[n] += rate_last;
            }
            // A step counts in all values after it.
            let mut summed = rate.clone();
            let mut after = 0.0;
            for n in (1..count).rev() {
                after += value[n];
                let h = step(n);
                summed[n] += after * 0.5 * h;
                summed[n - 1] += after * 0.5 * h;
                if n > 1 && h <= LONGER * step(n - 1) {
                    let before = step(n - 1);
                    let size = after * h * h * h / (6.0 * (h + before));
                    summed[n] -= size / h;
                    summed[n - 1] += size * (1.0 / h + 1.0 / before);
                    summed[n - 2] -= size / before;
                }
            }
            Weights { value, rate, summed }
        };
        self.ends(dynamics, times).into_iter().map(of).collect()
    }

    /// What the mean of `measure` over the last whole cycles depends on, cycle by cycle; none where there is no such mean.
    pub(crate) fn dependences(&self, measure: &Measure, dynamics: &Dynamics) -> Option<Vec<Dependence>> {
        let cycles = self.whole(f64::INFINITY);
        let part = 1.0 / cycles.len() as f64;
        let of = |cycle: &Cycle| {
            let (by, keys) = slopes(measure, cycle, dynamics)?;
            let by = by * part;
            Some(Dependence {
                position: vector(&by, place::POSITION).into(),
                flow: vector(&by, place::FLOW).into(),
                axis: vector(&by, place::AXIS).into(),
                force: vector(&by, place::FORCE).into(),
                moment: by[place::MOMENT],
                work: std::array::from_fn(|i| by[place::WORK + i]),
                by_key: keys.into_iter().map(|(key, by)| (key, by * part)).collect(),
            })
        };
        cycles.iter().map(of).collect()
    }
}

/// True where a measure has derivatives: all but those of durations, angles and extremes, and of parts of the thrust.
pub fn is_smooth(measure: &Measure) -> bool {
    let others = [PERIOD, DIRECTION, STROUHAL, DRAG_THRUST, REACTIVE_THRUST];
    others.iter().all(|other| other.key != measure.key)
}

/// The measures that have derivatives.
pub fn smooth() -> impl Iterator<Item = Measure> {
    MEASURES.into_iter().filter(is_smooth)
}

/// The derivatives of a measure of `cycle` by its integrals, and by parameters of the forces themselves.
fn slopes(measure: &Measure, cycle: &Cycle, dynamics: &Dynamics) -> Option<(Integrals, Vec<(Key, f64)>)> {
    (measure.of)(cycle, dynamics)?; // where it is
    let mut by = Integrals::zeros();
    let mut keys = Vec::new();
    let period = cycle.period();
    let velocity = cycle.velocity();
    // At rest no direction is ahead.
    let direction = velocity.try_normalize(0.0).unwrap_or_default();
    let per = 1.0 / period;
    // The part of a mean vector along the axis.
    let mut along = |at: usize, mean: Vector2<f64>, size: f64| {
        let axis = cycle.axis()?;
        put(&mut by, at, axis * (size * per));
        let length = cycle.mean_vector(place::AXIS).norm();
        put(&mut by, place::AXIS, (mean - axis * mean.dot(&axis)) * (size * per / length));
        Some(())
    };
    match measure.key {
        "cycle_forward_speed_m_s" => along(place::POSITION, velocity, 1.0)?,
        "cycle_slip" => {
            let (actuation, _) = dynamics.model.actuation.as_ref()?;
            along(place::POSITION, velocity, period / actuation.wavelength()?)?;
        }
        "cycle_thrust_n" => along(place::FORCE, cycle.mean_vector(place::FORCE), 1.0)?,
        "cycle_speed_m_s" => put(&mut by, place::POSITION, direction * per),
        "cycle_body_lengths" => put(&mut by, place::POSITION, direction / dynamics.model.rod.length),
        "cycle_head_force_x_n" => by[place::FORCE] = per,
        "cycle_head_force_y_n" => by[place::FORCE + 1] = per,
        "cycle_head_moment_n_m" => by[place::MOMENT] = per,
        "cycle_actuation_power_w" => by[place::WORK] = per,
        "cycle_viscous_power_w" => by[place::WORK + 1] = per,
        "cycle_wake_power_w" => by[place::WORK + 5] = per,
        "cycle_load_power_w" => by[place::WORK + 2] = per,
        "cycle_head_power_w" => by[place::WORK + 3] = per,
        "cycle_flow_power_w" => by[place::WORK + 4] = per,
        "cycle_cost_of_transport" => {
            let (speed, power) = cycle.swimming(dynamics)?;
            let weight = dynamics.model.rod.total_mass() * GRAVITY;
            by[place::WORK] = per / (weight * speed);
            put(&mut by, place::POSITION, velocity * (-power * per / (weight * speed * speed * speed)));
        }
        "cycle_efficiency" if dynamics.model.head.is_some() => {
            let (([thrust, speed], power), axis) = (cycle.propelling(dynamics)?, cycle.axis()?);
            put(&mut by, place::FORCE, axis * (speed / power * per));
            put(&mut by, place::POSITION, axis * (thrust / power * per));
            for i in [0, 3] {
                by[place::WORK + i] = -thrust * speed / (power * power) * per;
            }
        }
        "cycle_efficiency" => {
            let (speed, power) = cycle.swimming(dynamics)?;
            let (drag, slope, own) = towing(dynamics, speed);
            by[place::WORK] = -drag * speed / (power * power) * per;
            put(&mut by, place::POSITION, velocity * ((slope * speed + drag) * per / (power * speed)));
            keys = own.into_iter().map(|(key, by)| (key, by * speed / power)).collect();
        }
        _ => return None,
    }
    // U is that against the flow.
    let against = -vector(&by, place::POSITION);
    put(&mut by, place::FLOW, against);
    Some((by, keys))
}

/// The drag (N) of the straight rod at `speed` (m/s), and its derivatives by the speed and by parameters of the forces.
fn towing(dynamics: &Dynamics, speed: f64) -> (f64, f64, Vec<(Key, f64)>) {
    let model = &dynamics.model;
    force::straight(&model.rod, dynamics.inputs.fluid, [-speed, 0.0], |towed| {
        let drags = || model.forces.iter().filter(|force| force.sink() == Some(PowerKind::Drag) && force.is_of_fluid());
        let along = |values: &[f64]| values.iter().step_by(2).sum::<f64>();
        let entries = towed.v.len();
        let [mut q, mut v, mut a] = [0, 1, 2].map(|_| vec![0.0; entries]);
        let mut drag = 0.0;
        let mut keys: Vec<(Key, f64)> = Vec::new();
        for own in drags() {
            drag -= force::resultant(own, towed).x;
            let mut by = StateDerivatives { q: &mut q, v: &mut v, a: &mut a };
            force::add_slopes(own, towed, 0..towed.edges.len(), |_| Vector2::x(), &mut by);
            for key in own.parameters() {
                let mut opposing = vec![0.0; entries];
                own.add_by_parameter(key, towed, &mut opposing);
                keys.push((key, -along(&opposing)));
            }
        }
        (drag, along(&v), keys)
    })
}
