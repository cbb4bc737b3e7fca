//! Derivatives of the means over cycles with respect to the motion: the quadrature weights of values and rates at the steps in
//! the integrals of a cycle, and the derivatives of each measure with respect to these integrals.

use nalgebra::Vector2;

use super::{
    Cycle, CycleMeasure, CycleSource, Cycles, DIRECTION, DRAG_THRUST, GRAVITY, HINGE_AMPLITUDE, Integrals, MAX_CYCLES,
    MAX_STEP_RATIO, MEASURES, PERIOD, PHASE_ROUNDING, REACTIVE_THRUST, STROUHAL, TIP_EXCURSION, ends_in, index,
    interpolate, set_vector, vector,
};
use crate::fluid::force::{self, StateDerivatives};
use crate::fluid::{Key, PowerKind};
use crate::model::Dynamics;

/// Relative step of the finite difference with respect to the period.
const PERIOD_STEP: f64 = 1e-3;

/// Quadrature weights of the values and rates at each time in an integral over a cycle.
#[derive(Debug, Clone)]
pub struct IntegralWeights {
    /// Weights of values, for integrals that are known at every time, such as positions and work.
    pub value: Vec<f64>,
    /// Weights of the rates of these integrals.
    pub rate: Vec<f64>,
    /// Weights of rates, for integrals that are summed from their rates.
    pub summed: Vec<f64>,
}

/// The derivatives of a measure with respect to the integrals over a cycle.
#[derive(Debug, Clone)]
pub struct IntegralDerivatives {
    /// With respect to the increment of position, x and y.
    pub position: [f64; 2],
    /// With respect to the integral of the flow velocity.
    pub flow: [f64; 2],
    /// With respect to the integral of the head's axis.
    pub axis: [f64; 2],
    /// With respect to the integral of the force on a held head.
    pub force: [f64; 2],
    /// With respect to the integral of the moment on a held head.
    pub moment: f64,
    /// With respect to the integrals of the square of the torque of the motor of a hinge, of its power, of the angle, and of the
    /// square of the tracking error.
    pub hinge: [f64; 4],
    /// With respect to the work of actuation, drag, loads, held head, flow, wake, other forces, spray and the material.
    pub work: [f64; index::ALL - index::WORK],
    /// With respect to parameters of the forces themselves.
    pub by_key: Vec<(Key, f64)>,
}

/// The cubic Hermite coefficients of values and rates at the ends of a step of `h` (s), at its fraction `z`.
fn cubic(z: f64, h: f64) -> [f64; 4] {
    let (square, cube) = (z * z, z * z * z);
    [1.0 - 3.0 * square + 2.0 * cube, 3.0 * square - 2.0 * cube, h * (z - 2.0 * square + cube), h * (cube - square)]
}

/// The end of a cycle: its time (s), and the rates of all integrals at that time.
#[derive(Debug, Clone, Copy)]
pub struct CycleEnd {
    time: f64,
    rates: Integrals,
}

impl Cycles {
    /// The first end, at the start of the run.
    pub(crate) fn first_end(&self) -> CycleEnd {
        CycleEnd { time: self.last.time, rates: self.last.rates }
    }

    /// The ends within the step of `dynamics` since `before`.
    pub(crate) fn ends_since(&self, dynamics: &Dynamics, before: &Self) -> impl Iterator<Item = CycleEnd> {
        let (from, to) = (before.last, self.last);
        let span = from.phase.zip(to.phase).filter(|_| to.time > from.time);
        let end = move |z: f64| {
            let ([_, mut rates], time) = (interpolate(&from, &to, z), from.time + z * (to.time - from.time));
            if let Some([_, velocity]) = dynamics.head_place(time) {
                set_vector(&mut rates, index::POSITION, velocity);
            }
            CycleEnd { time, rates }
        };
        span.into_iter().flat_map(move |(before, after)| ends_in(before, after).map(end))
    }

    /// The frequency (Hz) of the cycles in `dynamics`, of the same scene or a slightly perturbed one.
    pub(crate) fn frequency(&self, dynamics: &Dynamics) -> Option<f64> {
        match (self.source, CycleSource::of(&dynamics.model)) {
            (CycleSource::Actuation, _) => Some(dynamics.inputs.drive.frequency),
            (CycleSource::Head(_), CycleSource::Head(frequency)) => Some(frequency),
            _ => None,
        }
    }

    /// True if the actuation defines the cycles.
    pub(crate) fn follow_actuation(&self) -> bool {
        self.source == CycleSource::Actuation
    }

    /// The derivative of the mean of `measure` with respect to the logarithm of the frequency f that defines the cycles, as far
    /// as it results from the motion of their ends t = n/f, the last of `ends`, in `dynamics`.
    pub(crate) fn by_log_frequency(
        &self,
        measure: &CycleMeasure,
        dynamics: &Dynamics,
        ends: &[CycleEnd],
    ) -> Option<f64> {
        let cycles = self.whole(f64::INFINITY);
        let ends = &ends[ends.len().checked_sub(1 + cycles.len())?..];
        let of = |(cycle, ends): (&Cycle, &[CycleEnd])| {
            // Through the integrals between ends that move by -t, and through the period alone, which does not affect distances
            // and powers.
            let change = ends[0].rates * ends[0].time - ends[1].rates * ends[1].time;
            let (slopes, _) = slopes(measure, cycle, dynamics)?;
            let lasting =
                |factor: f64| (measure.of)(&Cycle { until: cycle.from + cycle.period() * factor, ..*cycle }, dynamics);
            let central = |part: f64| Some((lasting(1.0 - part)? - lasting(1.0 + part)?) / (2.0 * part));
            let [near, far] = [central(PERIOD_STEP)?, central(2.0 * PERIOD_STEP)?];
            Some(slopes.dot(&change) + (4.0 * near - far) / 3.0)
        };
        let sum = cycles.iter().zip(ends.windows(2)).map(of).sum::<Option<f64>>()?;
        (!cycles.is_empty()).then(|| sum / cycles.len() as f64)
    }

    /// The ends of the last whole cycles of a run with steps between `times`, each as the index of the step's end and a fraction of the
    /// step.
    fn ends(&self, dynamics: &Dynamics, times: &[f64]) -> Vec<[(usize, f64); 2]> {
        let phase = |t: f64| self.source.phase(dynamics, t);
        let mut ends = vec![(0, 1.0)];
        for (n, pair) in times.windows(2).enumerate() {
            let (Some(before), Some(after)) = (phase(pair[0]), phase(pair[1])) else { continue };
            let (first, last) = ((before + PHASE_ROUNDING).floor() as i64 + 1, (after + PHASE_ROUNDING).floor() as i64);
            ends.extend((first..=last).map(|phase| (n + 1, ((phase as f64 - before) / (after - before)).min(1.0))));
        }
        let cycles: Vec<[(usize, f64); 2]> = ends.windows(2).map(|pair| [pair[0], pair[1]]).collect();
        cycles[cycles.len().saturating_sub(MAX_CYCLES)..].to_vec()
    }

    /// The quadrature weights of `times` in each of the last whole cycles.
    pub(crate) fn weights(&self, dynamics: &Dynamics, times: &[f64]) -> Vec<IntegralWeights> {
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
            // The rate at a step contributes to all later values.
            let mut summed = rate.clone();
            let mut after = 0.0;
            for n in (1..count).rev() {
                after += value[n];
                let h = step(n);
                summed[n] += after * 0.5 * h;
                summed[n - 1] += after * 0.5 * h;
                if n > 1 && h <= MAX_STEP_RATIO * step(n - 1) {
                    let before = step(n - 1);
                    let size = after * h * h * h / (6.0 * (h + before));
                    summed[n] -= size / h;
                    summed[n - 1] += size * (1.0 / h + 1.0 / before);
                    summed[n - 2] -= size / before;
                }
            }
            IntegralWeights { value, rate, summed }
        };
        self.ends(dynamics, times).into_iter().map(of).collect()
    }

    /// The derivatives of the mean of `measure` with respect to the integrals of each of the last whole cycles, or `None` if the
    /// mean is undefined.
    pub(crate) fn integral_derivatives(
        &self,
        measure: &CycleMeasure,
        dynamics: &Dynamics,
    ) -> Option<Vec<IntegralDerivatives>> {
        let cycles = self.whole(f64::INFINITY);
        let part = 1.0 / cycles.len() as f64;
        let of = |cycle: &Cycle| {
            let (by, keys) = slopes(measure, cycle, dynamics)?;
            let by = by * part;
            Some(IntegralDerivatives {
                position: vector(&by, index::POSITION).into(),
                flow: vector(&by, index::FLOW).into(),
                axis: vector(&by, index::AXIS).into(),
                force: vector(&by, index::FORCE).into(),
                moment: by[index::MOMENT],
                hinge: std::array::from_fn(|i| by[index::TORQUE_SQUARE + i]),
                work: std::array::from_fn(|i| by[index::WORK + i]),
                by_key: keys.into_iter().map(|(key, by)| (key, by * part)).collect(),
            })
        };
        cycles.iter().map(of).collect()
    }
}

/// True if a measure has derivatives: all measures except durations, directions, extremes, and contributions to the thrust.
pub fn is_differentiable(measure: &CycleMeasure) -> bool {
    let others = [PERIOD, DIRECTION, TIP_EXCURSION, STROUHAL, DRAG_THRUST, REACTIVE_THRUST, HINGE_AMPLITUDE];
    others.iter().all(|other| other.key != measure.key)
}

/// The measures that have derivatives.
pub fn differentiable() -> impl Iterator<Item = CycleMeasure> {
    MEASURES.into_iter().filter(is_differentiable)
}

/// The derivatives of a measure of `cycle` with respect to its integrals, and with respect to parameters of the forces
/// themselves.
fn slopes(measure: &CycleMeasure, cycle: &Cycle, dynamics: &Dynamics) -> Option<(Integrals, Vec<(Key, f64)>)> {
    (measure.of)(cycle, dynamics)?; // only if it is defined
    let mut by = Integrals::zeros();
    let mut keys = Vec::new();
    let period = cycle.period();
    let velocity = cycle.velocity();
    // At rest the direction is undefined.
    let direction = velocity.try_normalize(cycle.least_speed(dynamics)).unwrap_or_default();
    let per = 1.0 / period;
    // The component of a mean vector along the axis.
    let mut along = |at: usize, mean: Vector2<f64>, size: f64| {
        let axis = cycle.axis()?;
        set_vector(&mut by, at, axis * (size * per));
        let length = cycle.mean_vector(index::AXIS).norm();
        set_vector(&mut by, index::AXIS, (mean - axis * mean.dot(&axis)) * (size * per / length));
        Some(())
    };
    match measure.key {
        "cycle_forward_speed_m_s" => along(index::POSITION, velocity, 1.0)?,
        "cycle_slip" => {
            let (actuation, _) = dynamics.model.actuation.as_ref()?;
            along(index::POSITION, velocity, period / actuation.wavelength()?)?;
        }
        "cycle_thrust_n" => along(index::FORCE, cycle.mean_vector(index::FORCE), 1.0)?,
        "cycle_speed_m_s" => set_vector(&mut by, index::POSITION, direction * per),
        "cycle_body_lengths" => set_vector(&mut by, index::POSITION, direction / dynamics.model.rod.length),
        "cycle_head_force_x_n" => by[index::FORCE] = per,
        "cycle_head_force_y_n" => by[index::FORCE + 1] = per,
        "cycle_head_moment_n_m" => by[index::MOMENT] = per,
        "cycle_hinge_power_w" => by[index::HINGE_POWER] = per,
        "cycle_hinge_angle_rad" => by[index::HINGE_ANGLE] = per,
        "cycle_rms_hinge_torque_n_m" => by[index::TORQUE_SQUARE] = by_square(cycle.root(index::TORQUE_SQUARE), per),
        "cycle_rms_tracking_error_rad" => {
            by[index::HINGE_ERROR_SQUARE] = by_square(cycle.root(index::HINGE_ERROR_SQUARE), per);
        }
        "cycle_actuation_power_w" => by[index::WORK] = per,
        "cycle_viscous_power_w" => by[index::WORK + 1] = per,
        "cycle_wake_power_w" => by[index::WORK + 5] = per,
        "cycle_load_power_w" => by[index::WORK + 2] = per,
        "cycle_head_power_w" => by[index::WORK + 3] = per,
        "cycle_flow_power_w" => by[index::WORK + 4] = per,
        "cycle_other_power_w" => by[index::WORK + 6] = per,
        "cycle_material_power_w" => by[index::WORK + 8] = per,
        "cycle_cost_of_transport" => {
            let (speed, power) = cycle.speed_and_power(dynamics)?;
            let weight = dynamics.model.rod.total_mass() * GRAVITY;
            by[index::WORK] = per / (weight * speed);
            set_vector(&mut by, index::POSITION, velocity * (-power * per / (weight * speed * speed * speed)));
        }
        "cycle_efficiency" if dynamics.model.head.is_some() => {
            let (([thrust, speed], power), axis) = (cycle.thrust_speed_and_power(dynamics)?, cycle.axis()?);
            set_vector(&mut by, index::FORCE, axis * (speed / power * per));
            set_vector(&mut by, index::POSITION, axis * (thrust / power * per));
            let across = |mean: Vector2<f64>| mean - axis * mean.dot(&axis);
            let turned = across(cycle.mean_vector(index::FORCE)) * speed + across(velocity) * thrust;
            set_vector(&mut by, index::AXIS, turned * (per / (power * cycle.mean_vector(index::AXIS).norm())));
            for i in [0, 3] {
                by[index::WORK + i] = -thrust * speed / (power * power) * per;
            }
        }
        "cycle_efficiency" => {
            let (speed, power) = cycle.speed_and_power(dynamics)?;
            let (drag, slope, own) = towing(dynamics, speed);
            by[index::WORK] = -drag * speed / (power * power) * per;
            set_vector(&mut by, index::POSITION, velocity * ((slope * speed + drag) * per / (power * speed)));
            keys = own.into_iter().map(|(key, by)| (key, by * speed / power)).collect();
        }
        _ => return None,
    }
    // U is relative to the flow.
    let against = -vector(&by, index::POSITION);
    set_vector(&mut by, index::FLOW, against);
    Some((by, keys))
}

/// The derivative of a root mean square with respect to the integral of the square over a time of 1/`per`; zero if the root is
/// zero.
fn by_square(root: f64, per: f64) -> f64 {
    if root > 0.0 { 0.5 * per / root } else { 0.0 }
}

/// The drag (N) of the straight rod at `speed` (m/s), and its derivatives with respect to the speed and to parameters of the
/// forces.
fn towing(dynamics: &Dynamics, speed: f64) -> (f64, f64, Vec<(Key, f64)>) {
    let model = &dynamics.model;
    force::straight(&model.rod, dynamics.inputs.fluid, [-speed, 0.0], |towed| {
        let drags =
            || model.forces.iter().filter(|force| force.power_kind() == Some(PowerKind::Drag) && force.is_of_fluid());
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
