//! Extrapolation of the pose of a head that a host drives, between communication points.
//!
//! The host sets the pose and, optionally, its derivatives. Each coordinate is extrapolated separately, and follows the
//! scene until the host sets it. Its motion over a step is an extrapolation polynomial plus a decaying difference from
//! the previous motion, see [`CoordinateExtrapolation`].
//!
//! The polynomial passes through the last sample, with the derivatives that were set, and through the samples before
//! it. Its degree, at most 5, is the one that would have predicted the last two samples best. A smooth motion is
//! therefore extrapolated at high order. If the motion jumps or is noisy, the coordinate is held, or continues at its
//! previously extrapolated rate.
//!
//! If the value, rate and acceleration of the new polynomial differ from the present motion, the difference decays as a
//! quintic, so that all three are continuous. With [`HeadInput::AtEnd`] the decay ends with the step. Otherwise it
//! takes as long as the host's longest recent step, however short the present one is.

use serde::{Deserialize, Serialize};

use super::{Sample, Signal};

/// The time to which a pose that a host sets before a step refers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum HeadInput {
    /// The pose at the time when it is set.
    #[default]
    Now,
    /// The pose to reach at the end of the step.
    AtEnd,
}

/// Highest derivative of a coordinate that a host can set.
const HIGHEST: usize = 3;

/// Number of coefficients of a polynomial of degree 5.
const TERMS: usize = 6;

/// Number of samples without derivatives that determine a polynomial of that degree.
const SAMPLES: usize = TERMS;

/// A sample replaces the last one if the interval before the last one is shorter than this fraction of the interval
/// before that. Intervals therefore do not shrink faster, and differences of the stored samples stay above rounding
/// errors.
const LEAST_SPACING_RATIO: f64 = 0.25;

/// An input is held constant once the host has not set it for this many times the interval between its last two
/// samples.
const SILENT_INTERVALS: f64 = 1.5;

/// If the host sets no pose for the end of a step, the head stays, unless the step is shorter than this fraction of the
/// previous one.
const REMAINDER: f64 = 1e-3;

/// Minimum number of steps for the decay of an abrupt difference to a new extrapolation.
const STEPS_PER_DECAY: f64 = 4.0;

/// A difference is abrupt if its decay accelerates the head by more than this many times the acceleration of the
/// extrapolation, and if it is not negligible.
const ABRUPT_ACCELERATION_RATIO: f64 = 2.0;

/// A difference is negligible up to this fraction of the rod length, or this angle (rad).
const NEGLIGIBLE_OFFSET: f64 = 1e-6;

/// A sample of a coordinate set by a host: value and derivatives at one time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct PoseSample {
    time: f64,
    derivatives: [f64; HIGHEST + 1],
    /// Order of the highest derivative that was set.
    order: usize,
}

impl PoseSample {
    fn new(time: f64, value: f64) -> Self {
        Self { time, derivatives: [value, 0.0, 0.0, 0.0], order: 0 }
    }

    /// The sample extrapolated to time `t` (s) by the Taylor polynomial of the derivatives that were set.
    fn at(&self, t: f64) -> Self {
        let tau = t - self.time;
        let mut derivatives = [0.0; HIGHEST + 1];
        for (k, derivative) in derivatives.iter_mut().enumerate().take(self.order + 1) {
            let mut factor = 1.0;
            for (j, given) in self.derivatives[k..=self.order].iter().enumerate() {
                *derivative += given * factor;
                factor *= tau / (j + 1) as f64;
            }
        }
        Self { time: t, derivatives, order: self.order }
    }
}

/// The polynomial Σ c_k (t − t₀)^k.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct Polynomial {
    since: f64,
    terms: [f64; TERMS],
}

impl Polynomial {
    fn at(&self, t: f64) -> Sample {
        let tau = t - self.since;
        let mut sample = Sample::default();
        for term in self.terms.iter().rev() {
            sample.acceleration = sample.acceleration * tau + 2.0 * sample.rate;
            sample.rate = sample.rate * tau + sample.value;
            sample.value = sample.value * tau + term;
        }
        sample
    }

    /// The quintic that decays from `first` at time `t` to zero, with zero rate and acceleration, after `span` (s).
    fn decaying(first: Sample, t: f64, span: f64) -> Self {
        let (x, v, a) = (first.value, first.rate * span, first.acceleration * span * span);
        let by_part =
            [x, v, 0.5 * a, -10.0 * x - 6.0 * v - 1.5 * a, 15.0 * x + 8.0 * v + 1.5 * a, -6.0 * x - 3.0 * v - 0.5 * a];
        let mut factor = 1.0;
        let terms = by_part.map(|term| {
            let term = term * factor;
            factor /= span;
            term
        });
        Self { since: t, terms }
    }
}

/// Newton's form of the polynomials through samples, the newest first: Σ_k d_k Π_{i<k} (t − t_i).
#[derive(Debug, Clone, Copy)]
struct DividedDifferences {
    times: [f64; TERMS],
    differences: [f64; TERMS],
    len: usize,
}

impl DividedDifferences {
    /// Divided differences, confluent if a sample has derivatives.
    fn of<'a>(samples: impl Iterator<Item = &'a PoseSample>) -> Self {
        let mut all = Self { times: [0.0; TERMS], differences: [0.0; TERMS], len: 0 };
        let mut given = [(0, PoseSample::default()); TERMS];
        for (place, sample) in samples.enumerate() {
            for _ in 0..=sample.order {
                if all.len < TERMS {
                    all.times[all.len] = sample.time;
                    all.differences[all.len] = sample.derivatives[0];
                    given[all.len] = (place, *sample);
                    all.len += 1;
                }
            }
        }
        let mut factorial = 1.0;
        for k in 1..all.len {
            factorial *= k as f64;
            for i in (k..all.len).rev() {
                all.differences[i] = if given[i].0 == given[i - k].0 {
                    given[i].1.derivatives[k] / factorial
                } else {
                    (all.differences[i] - all.differences[i - 1]) / (all.times[i] - all.times[i - k])
                };
            }
        }
        all
    }

    /// The error of the polynomial of each degree for a later `sample`: the maximum of the errors of its value and, if
    /// they were set, its rate and acceleration, each converted to the error of the value that it implies in a smooth
    /// motion. Infinite if there are too few samples.
    fn prediction_errors(&self, sample: &PoseSample) -> [f64; TERMS] {
        let ahead = sample.time - self.times[0];
        // The product of the factors t − t_i with two derivatives, and the predicted value with two derivatives.
        let (mut product, mut predicted) = ([1.0, 0.0, 0.0], [0.0; 3]);
        std::array::from_fn(|k| {
            if k >= self.len {
                return f64::INFINITY;
            }
            for (sum, product) in predicted.iter_mut().zip(product) {
                *sum += self.differences[k] * product;
            }
            let factor = sample.time - self.times[k];
            product = [product[0] * factor, product[1] * factor + product[0], product[2] * factor + 2.0 * product[1]];
            // An error C τ^(k+1) of the value implies an error C (k+1) τ^k of the rate.
            let (mut unit, mut largest) = (1.0, 0.0_f64);
            for (order, (predicted, given)) in
                predicted.iter().zip(sample.derivatives).take(sample.order + 1).enumerate()
            {
                largest = largest.max((predicted - given).abs() * unit);
                unit *= ahead / (k + 1 - order.min(k)) as f64;
            }
            largest
        })
    }

    /// The interpolation polynomial of this `degree`.
    fn polynomial(&self, degree: usize) -> Polynomial {
        let since = self.times[0];
        let mut terms = [0.0; TERMS];
        for k in (0..=degree).rev() {
            // p(s)·(s − s_k) + d_k
            let root = self.times[k] - since;
            for i in (0..TERMS).rev() {
                terms[i] = if i == 0 { 0.0 } else { terms[i - 1] } - root * terms[i];
            }
            terms[0] += self.differences[k];
        }
        Polynomial { since, terms }
    }
}

/// One coordinate of a head driven by a host: x (m), y (m) or angle (rad).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CoordinateExtrapolation {
    /// The last sample, as the host set it.
    latest: PoseSample,
    /// True if it was set after the last step began.
    fresh: bool,
    /// The derivatives of it that were set.
    given: [bool; HIGHEST + 1],
    /// It refers to the time at which it was set, even if poses are those at the end of the step.
    of_now: bool,
    /// The run started with it.
    first: bool,
    /// The last samples, newest first.
    samples: [PoseSample; SAMPLES],
    len: usize,
    /// Errors of the polynomials of each degree for the sample before the last.
    previous_errors: [f64; TERMS],
    /// Errors of the polynomials of each degree for the last sample.
    errors: [f64; TERMS],
    /// Rate that was extrapolated at the last sample.
    extrapolated_rate: f64,
    /// Errors of the last two samples, newest first, if the coordinate had moved at that rate since the sample before.
    rate_errors: [f64; 2],
    /// The polynomial that extrapolates the samples.
    extrapolation: Polynomial,
    /// The decaying difference from the previous motion.
    decay: Polynomial,
    /// End of the decay, s.
    decay_end: f64,
}

impl CoordinateExtrapolation {
    /// A coordinate that a host sets for the first time, at time `t` (s), where its motion is `now`.
    fn new(t: f64, now: Sample) -> Self {
        Self {
            latest: PoseSample { time: t, derivatives: [now.value, now.rate, now.acceleration, 0.0], order: 0 },
            fresh: false,
            given: [false; HIGHEST + 1],
            of_now: false,
            first: false,
            samples: [PoseSample::default(); SAMPLES],
            len: 0,
            previous_errors: [f64::INFINITY; TERMS],
            errors: [f64::INFINITY; TERMS],
            extrapolated_rate: 0.0,
            rate_errors: [f64::INFINITY; 2],
            extrapolation: Polynomial::default(),
            decay: Polynomial::default(),
            decay_end: t,
        }
    }

    /// Stores the derivative of `order` (0 is the value) that the host sets at time `t` (s), where the motion is `now`.
    /// If it is a `derivative` set in addition to a value, the sample refers to time `t`, even if poses are those at
    /// the end of the step.
    fn set_derivative(&mut self, t: f64, now: Sample, order: usize, value: f64, derivative: bool) {
        if !self.fresh || self.latest.time != t {
            // Derivatives that are not set continue.
            let before = self.latest.at(t).derivatives[0];
            self.latest = PoseSample { time: t, derivatives: [before, now.rate, now.acceleration, 0.0], order: 0 };
            (self.fresh, self.of_now, self.given) = (true, false, [false; HIGHEST + 1]);
        }
        self.latest.derivatives[order] = value;
        self.given[order] = true;
        self.latest.order = self.latest.order.max(order);
        self.of_now |= derivative;
    }

    /// Starts the run at time `t` (s) with the pose that the host has set, at rest except for the derivatives that it
    /// has set.
    fn start(&mut self, t: f64) {
        for (derivative, given) in self.latest.derivatives.iter_mut().zip(self.given).skip(1) {
            *derivative = if given { *derivative } else { 0.0 };
        }
        (self.latest.time, self.first, self.decay_end) = (t, true, t);
        let mut factorial = 1.0;
        self.extrapolation = Polynomial { since: t, terms: [0.0; TERMS] };
        for (k, (term, derivative)) in self.extrapolation.terms.iter_mut().zip(self.latest.derivatives).enumerate() {
            factorial *= k.max(1) as f64;
            *term = if k <= self.latest.order { derivative / factorial } else { 0.0 };
        }
    }

    /// The last sample as a target at time `end` (s), for a motion from time `t`, where it is `now`. If value or rate
    /// were not set, they follow from the derivatives that were, by the trapezoidal rule.
    fn target(&self, [t, end]: [f64; 2], now: Sample) -> PoseSample {
        let (mut sample, h) = (PoseSample { time: end, ..self.latest }, end - t);
        let [_, rate, acceleration, _] = self.latest.derivatives;
        if sample.order > 1 && !self.given[1] {
            sample.derivatives[1] = now.rate + 0.5 * h * (now.acceleration + acceleration);
        }
        if sample.order > 0 && !self.given[0] {
            let rate = if self.given[1] { rate } else { sample.derivatives[1] };
            sample.derivatives[0] = now.value + 0.5 * h * (now.rate + rate);
        }
        sample
    }

    /// Stores a sample and its prediction errors.
    fn push_sample(&mut self, sample: PoseSample) {
        let far = |a: &PoseSample, b: &PoseSample| a.time - b.time;
        let errors = DividedDifferences::of(self.samples[..self.len].iter()).prediction_errors(&sample);
        let [last, before, third] = [0, 1, 2].map(|k| &self.samples[k]);
        let again = self.len > 0 && far(&sample, last) <= 0.0;
        let evenly = last.derivatives[0] + self.extrapolated_rate * far(&sample, last);
        let rate_error = if self.len > 0 { (evenly - sample.derivatives[0]).abs() } else { f64::INFINITY };
        if again || self.len > 2 && far(last, before) < LEAST_SPACING_RATIO * far(before, third) {
            self.samples[0] = sample;
        } else {
            self.samples.rotate_right(1);
            self.samples[0] = sample;
            self.len = (self.len + 1).min(SAMPLES);
            self.previous_errors = self.errors;
            self.rate_errors[1] = self.rate_errors[0];
        }
        if !again {
            self.errors = errors;
            self.rate_errors[0] = rate_error;
        }
    }

    /// Computes the motion from time `t` (s), where it is `now`, to `end`, or keeps the present one. Until the first
    /// sample of the host the motion is `before`. `begins` is true if a step begins at `t`, false if one continues
    /// there. Returns the differences of a new sample, and of its velocity if that was set, from the motion without it.
    fn fit(&mut self, [t, end]: [f64; 2], now: Sample, input: HeadInput, before: &Signal, begins: bool) -> [f64; 2] {
        let at_end = input == HeadInput::AtEnd && !self.of_now;
        let due = if at_end { end } else { t };
        let predicted = self.at(due).unwrap_or_else(|| before.at(due));
        let spoken = self.len > 0;
        if !spoken {
            // Samples before the host's first one, at intervals of the present step: from the scene, or from the start
            // if the run started with the host's pose.
            let back = if at_end { 0 } else { 1 };
            for k in (back..back + SAMPLES + 2).rev() {
                let time = t - k as f64 * (end - t);
                let [value, rate] = if self.first {
                    let [value, rate, ..] = self.latest.at(time).derivatives;
                    [value, rate]
                } else {
                    let Sample { value, rate, .. } = before.at(time);
                    [value, rate]
                };
                self.push_sample(PoseSample::new(time, value));
                self.extrapolated_rate = rate;
            }
        }
        let silence = t - self.samples[0].time;
        let between = self.samples[0].time - self.samples[1].time;
        let sample = if at_end && self.fresh {
            self.latest = self.target([t, end], now);
            self.latest
        } else if at_end && begins && end - self.samples[0].time > REMAINDER * between {
            self.latest.at(end)
        } else if self.fresh || !at_end && begins && silence > SILENT_INTERVALS * between {
            self.latest.at(t)
        } else {
            return [0.0; 2];
        };
        let off = [sample.derivatives[0] - predicted.value, sample.derivatives[1] - predicted.rate];
        let jump = match (self.fresh, self.given[1]) {
            (false, _) => [0.0; 2],
            (true, false) => [off[0].abs(), 0.0],
            // If the velocity changed linearly since the last sample, the value changed by half of that change times
            // the interval.
            (true, true) => {
                let evenly = 2.0 * off[0] / if at_end { end - t } else { t - self.samples[0].time };
                [off[0].abs(), off[1].abs().min((off[1] - evenly).abs())]
            }
        };
        let extrapolated_rate = if spoken { self.extrapolation.at(t).rate } else { self.extrapolated_rate };
        self.push_sample(sample);
        self.extrapolated_rate = extrapolated_rate;
        self.fresh = false;
        let found = DividedDifferences::of(self.samples[..self.len].iter());
        let mut degree = self.samples[0].order;
        // Extrapolation amplifies errors of the samples by a factor of two per degree.
        let miss = |k: usize| self.errors[k].max(self.previous_errors[k]) * f64::from(1_u32 << k);
        // A higher degree must improve the prediction by more than rounding errors.
        let rounding = 4.0 * f64::EPSILON * self.samples[0].derivatives[0].abs();
        let rate_error = self.rate_errors[0].max(self.rate_errors[1]);
        let (mut least, mut evenly) = (miss(degree), false);
        if degree == 0 && rate_error + rounding < least {
            (least, evenly) = (rate_error, true);
        }
        for k in degree + 1..found.len {
            if miss(k) + rounding < least {
                (degree, least, evenly) = (k, miss(k), false);
            }
        }
        self.extrapolation = found.polynomial(degree);
        if evenly {
            self.extrapolation.terms[1] = self.extrapolated_rate;
        }
        let start = self.extrapolation.at(t);
        let difference = Sample {
            value: now.value - start.value,
            rate: now.rate - start.rate,
            acceleration: now.acceleration - start.acceleration,
        };
        let span = if at_end {
            end - t
        } else {
            (end - t).max(self.samples[0].time - self.samples[1].time).max(self.decay_end - t)
        };
        self.decay = Polynomial::decaying(difference, t, span);
        self.decay_end = t + span;
        jump
    }

    /// True once the host's samples determine the motion, or if the run started with the host's pose.
    pub fn moves(&self) -> bool {
        self.len > 0 || self.first
    }

    /// The motion at time `t` (s), or `None` before it [`moves`](Self::moves).
    pub fn at(&self, t: f64) -> Option<Sample> {
        self.moves().then(|| {
            let extrapolation = self.extrapolation.at(t);
            if t >= self.decay_end {
                return extrapolation;
            }
            let decay = self.decay.at(t);
            Sample {
                value: extrapolation.value + decay.value,
                rate: extrapolation.rate + decay.rate,
                acceleration: extrapolation.acceleration + decay.acceleration,
            }
        })
    }

    /// The longest step (s) from time `t` (s) that resolves the decay of the difference to the host's pose; `unit` is
    /// the rod length (m) or 1 rad.
    pub fn longest_step(&self, t: f64, unit: f64) -> f64 {
        let span = self.decay_end - self.decay.since;
        if t >= self.decay_end || span <= 0.0 {
            return f64::INFINITY;
        }
        let [x, v, half, ..] = self.decay.terms;
        let way = x.abs().max((v * span).abs()).max((2.0 * half * span * span).abs());
        let sudden = way > ABRUPT_ACCELERATION_RATIO * self.extrapolation.at(t).acceleration.abs() * span * span
            && way > NEGLIGIBLE_OFFSET * unit;
        if sudden { span / STEPS_PER_DECAY } else { f64::INFINITY }
    }

    /// True if the host has set the coordinate at time `t` (s) and no step has followed yet.
    pub(crate) fn is_given_at(&self, t: f64) -> bool {
        self.fresh && self.latest.time == t
    }

    /// The derivative of `order` if the host has set it at time `t` (s) and no step has followed yet.
    pub(crate) fn given_at(&self, t: f64, order: usize) -> Option<f64> {
        (self.is_given_at(t) && *self.given.get(order)?).then(|| self.latest.derivatives[order])
    }

    /// The derivative of `order` in the last sample, or `None` if `order` is above the highest that the host has set.
    pub fn given_derivative(&self, order: usize) -> Option<f64> {
        (order <= self.latest.order).then(|| self.latest.derivatives[order])
    }
}

/// Inputs of a host for coordinates that it does not drive yet, which repeat their present derivatives and so change
/// nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct RedundantHeadInputs {
    time: f64,
    derivatives: [[Option<f64>; HIGHEST + 1]; 3],
}

impl RedundantHeadInputs {
    /// Stores the derivative of `order` of coordinate `i`, set at time `t` (s).
    pub(crate) fn keep(&mut self, t: f64, [i, order]: [usize; 2], value: f64) {
        if t != self.time {
            *self = Self { time: t, ..Self::default() };
        }
        self.derivatives[i][order.min(HIGHEST)] = Some(value);
    }

    /// True if any was set at time `t` (s).
    pub(crate) fn are_of(&self, t: f64) -> bool {
        t == self.time && self.derivatives.as_flattened().iter().any(Option::is_some)
    }

    /// The derivatives of coordinate `i` that were set at time `t` (s).
    pub(crate) fn of(&self, t: f64, i: usize) -> [Option<f64>; HIGHEST + 1] {
        if t == self.time { self.derivatives[i] } else { Default::default() }
    }
}

/// The motion of a head driven by a host: x, y and angle, each as soon as the host has set it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct HostHead {
    /// The coordinates that the host has set.
    pub axes: [Option<CoordinateExtrapolation>; 3],
}

impl HostHead {
    /// Stores the derivative of `order` of coordinate `i`; see `CoordinateExtrapolation::set_derivative`.
    pub fn set_derivative(&mut self, t: f64, i: usize, now: Sample, order: usize, value: f64, derivative: bool) {
        self.axes[i].get_or_insert_with(|| CoordinateExtrapolation::new(t, now)).set_derivative(
            t,
            now,
            order.min(HIGHEST),
            value,
            derivative,
        );
    }

    /// Computes the motion of every coordinate over a step; see `CoordinateExtrapolation::fit`. Returns the differences
    /// (m, m, rad) of new samples, and of new velocities (per s), from the motion without them.
    pub fn fit(
        &mut self,
        span: [f64; 2],
        now: &[Sample; 3],
        input: HeadInput,
        before: &[Signal; 3],
        begins: bool,
    ) -> [[f64; 2]; 3] {
        let mut jumps = [[0.0; 2]; 3];
        for (((axis, now), before), jump) in self.axes.iter_mut().zip(now).zip(before).zip(&mut jumps) {
            if let Some(axis) = axis {
                *jump = axis.fit(span, *now, input, before, begins);
            }
        }
        jumps
    }

    /// Starts the run at time `t` (s) with the pose that the host has set, at rest except for the derivatives that it
    /// has set.
    pub fn start(&mut self, t: f64) {
        self.axes.iter_mut().flatten().for_each(|axis| axis.start(t));
    }

    /// True if the run started with a pose of the host, and no step has been taken since.
    pub fn has_started(&self) -> bool {
        self.axes.iter().flatten().any(|axis| axis.first && axis.len == 0)
    }

    /// True if the host has set, before the first step, a velocity or acceleration other than that of the `scene` at
    /// `time` (s).
    pub fn moves_unlike(&self, scene: &[Signal; 3], time: f64) -> bool {
        let mut axes = self.axes.iter().zip(scene).filter_map(|(axis, scene)| Some((axis.as_ref()?, scene.at(time))));
        axes.any(|(axis, scene)| {
            let unlike = |k: usize, own: f64| axis.given[k] && axis.latest.derivatives[k] != own;
            axis.len == 0 && (unlike(1, scene.rate) || unlike(2, scene.acceleration))
        })
    }

    /// The largest difference of the host's pose from the `scene` at `time` (s), relative to `reaches` (m, m, rad).
    /// Coordinates count if their value was set and no step has used it yet.
    pub fn largest_relative_offset(&self, scene: &[Signal; 3], time: f64, reaches: [f64; 3]) -> f64 {
        let axes = self.axes.iter().zip(scene).zip(reaches);
        let parts = axes.filter_map(|((axis, scene), reach)| {
            let axis = axis.as_ref().filter(|axis| axis.given[0] && axis.len == 0)?;
            Some((axis.latest.derivatives[0] - scene.at(time).value).abs() / reach)
        });
        parts.fold(0.0, f64::max)
    }
}
