//! A head that a host moves: the extrapolation of its pose between communication points. The host says where the head is, and how it
//! moves where it knows. From these samples follows the motion over the step: the [extrapolation](CoordinateExtrapolation) of each
//! coordinate, and what is left of the last one.
//!
//! Each coordinate is on its own, and is the scene's until the host sets it. Its extrapolation is the polynomial through the last
//! sample, with the derivatives that it gave, and through the samples before it, up to degree 5. Of these degrees it takes the one that
//! would have predicted the last two samples best. So a smooth motion is continued at a high order, and one that jumps, or is known
//! with noise, is not carried away: it stays, or continues as fast as it was predicted to. Where the new extrapolation does not start
//! as the head moves now, the difference decays in a quintic: value, rate and acceleration are continuous. The decay takes as long as
//! the host's longest recent step, however short the present one is.

use serde::{Deserialize, Serialize};

use super::{Sample, Signal};

/// What the pose is that a host gives before a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum HeadInput {
    /// The pose at that time.
    #[default]
    Now,
    /// The pose to reach at the end of the step.
    AtEnd,
}

/// The highest derivative of a coordinate that a host gives.
const HIGHEST: usize = 3;

/// Coefficients of a polynomial of degree 5.
const TERMS: usize = 6;

/// As many words without derivatives as make that degree.
const SAMPLES: usize = TERMS;

/// A word takes the place of the last one unless that one is this part as far from the one before as that from its own: the
/// distances of words shrink no faster, so that differences of those kept are not rounding errors.
const LEAST_SPACING_RATIO: f64 = 0.25;

/// A host that has said nothing for this many times as long as it was between its last two words leaves its input as it is.
const SILENT_INTERVALS: f64 = 1.5;

/// A step at whose end a host gives no pose is one in which the head stays, unless it is shorter than this part of the one before.
const REMAINDER: f64 = 1e-3;

/// The fewest steps in which the difference to a new course dies away …
const STEPS_OF_REST: f64 = 4.0;

/// … where it accelerates the head by more than this many times what the course does, …
const SUDDEN: f64 = 2.0;

/// … and moves it by more than this part of the length, or this angle (rad).
const SMALL: f64 = 1e-6;

/// What a host has said of a coordinate: value and derivatives at a time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
struct PoseSample {
    time: f64,
    derivatives: [f64; HIGHEST + 1],
    /// The highest derivative that it gave.
    order: usize,
}

impl PoseSample {
    fn new(time: f64, value: f64) -> Self {
        Self { time, derivatives: [value, 0.0, 0.0, 0.0], order: 0 }
    }

    /// What it says of time `t` (s) as a polynomial of the derivatives that it gave.
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

/// Σ c_k (t − t₀)^k.
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

    /// The quintic from `first` at time `t` to rest at zero after `span` (s).
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

/// Newton's form of the polynomials through words, the newest first: Σ_k d_k Π_{i<k} (t − t_i).
#[derive(Debug, Clone, Copy)]
struct Differences {
    times: [f64; TERMS],
    differences: [f64; TERMS],
    len: usize,
}

impl Differences {
    /// Divided differences, confluent where a word has derivatives.
    fn of<'a>(words: impl Iterator<Item = &'a PoseSample>) -> Self {
        let mut all = Self { times: [0.0; TERMS], differences: [0.0; TERMS], len: 0 };
        let mut given = [(0, PoseSample::default()); TERMS];
        for (place, word) in words.enumerate() {
            for _ in 0..=word.order {
                if all.len < TERMS {
                    all.times[all.len] = word.time;
                    all.differences[all.len] = word.derivatives[0];
                    given[all.len] = (place, *word);
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

    /// By how much the polynomial of every degree misses `value` at time `t` (s); infinite where there are too few words.
    fn misses(&self, t: f64, value: f64) -> [f64; TERMS] {
        let (mut foretold, mut product) = (0.0, 1.0);
        std::array::from_fn(|k| {
            if k >= self.len {
                return f64::INFINITY;
            }
            foretold += self.differences[k] * product;
            product *= t - self.times[k];
            (foretold - value).abs()
        })
    }

    /// The polynomial of this `degree`.
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

/// One coordinate of a head as a host moves it: x (m), y (m) or angle (rad).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CoordinateExtrapolation {
    /// The host's last word, as it was given.
    said: PoseSample,
    /// It was given since the last step set out.
    fresh: bool,
    /// Which of its derivatives were given.
    given: [bool; HIGHEST + 1],
    /// It is of the time at which it was given, even where poses are those at the end of the step.
    of_now: bool,
    /// The run starts with it: before, the head rested there.
    first: bool,
    /// The last words, newest first.
    words: [PoseSample; SAMPLES],
    len: usize,
    /// By how much the polynomials of every degree missed the last word but one of these.
    missed: [f64; TERMS],
    /// The same for the last.
    misses: [f64; TERMS],
    /// The rate that was foretold for the last word, which a motion from there at …
    pace: f64,
    /// … the one that was foretold before would have missed by this, and the word before by that.
    pace_misses: [f64; 2],
    /// What the words foretell.
    course: Polynomial,
    /// What is left of the motion before, until …
    rest: Polynomial,
    /// … this time, s.
    until: f64,
}

impl CoordinateExtrapolation {
    /// A coordinate of which the host has given the derivative of `order` at time `t` (s), where it moved by `now`.
    fn new(t: f64, now: Sample) -> Self {
        Self {
            said: PoseSample { time: t, derivatives: [now.value, now.rate, now.acceleration, 0.0], order: 0 },
            fresh: false,
            given: [false; HIGHEST + 1],
            of_now: false,
            first: false,
            words: [PoseSample::default(); SAMPLES],
            len: 0,
            missed: [f64::INFINITY; TERMS],
            misses: [f64::INFINITY; TERMS],
            pace: 0.0,
            pace_misses: [f64::INFINITY; 2],
            course: Polynomial::default(),
            rest: Polynomial::default(),
            until: t,
        }
    }

    /// Takes over the derivative of `order` (its value is of order 0) that the host gives at time `t` (s), where it moves by
    /// `now`; one that is given beside the value as a `derivative` of it is of this time, whatever poses are.
    fn say(&mut self, t: f64, now: Sample, order: usize, value: f64, derivative: bool) {
        if !self.fresh || self.said.time != t {
            // What is not said goes on.
            let before = self.said.at(t).derivatives[0];
            self.said = PoseSample { time: t, derivatives: [before, now.rate, now.acceleration, 0.0], order: 0 };
            (self.fresh, self.of_now, self.given) = (true, false, [false; HIGHEST + 1]);
        }
        self.said.derivatives[order] = value;
        self.given[order] = true;
        self.said.order = self.said.order.max(order);
        self.of_now |= derivative;
    }

    /// Starts the run at time `t` (s) with the pose that the host gave: at rest, but for the derivatives that it gave too.
    fn start(&mut self, t: f64) {
        for (derivative, given) in self.said.derivatives.iter_mut().zip(self.given).skip(1) {
            *derivative = if given { *derivative } else { 0.0 };
        }
        (self.said.time, self.first, self.until) = (t, true, t);
        let mut factorial = 1.0;
        self.course = Polynomial { since: t, terms: [0.0; TERMS] };
        for (k, (term, derivative)) in self.course.terms.iter_mut().zip(self.said.derivatives).enumerate() {
            factorial *= k.max(1) as f64;
            *term = if k <= self.said.order { derivative / factorial } else { 0.0 };
        }
    }

    /// The last word as one of time `end` (s), to which the head goes from time `t`, where it moves by `now`: value and rate
    /// that were not given follow from the derivatives that were, by the trapezoidal rule.
    fn target(&self, [t, end]: [f64; 2], now: Sample) -> PoseSample {
        let (mut word, h) = (PoseSample { time: end, ..self.said }, end - t);
        let [_, rate, acceleration, _] = self.said.derivatives;
        if word.order > 1 && !self.given[1] {
            word.derivatives[1] = now.rate + 0.5 * h * (now.acceleration + acceleration);
        }
        if word.order > 0 && !self.given[0] {
            let rate = if self.given[1] { rate } else { word.derivatives[1] };
            word.derivatives[0] = now.value + 0.5 * h * (now.rate + rate);
        }
        word
    }

    /// Keeps a word.
    fn push(&mut self, word: PoseSample) {
        let far = |a: &PoseSample, b: &PoseSample| a.time - b.time;
        let misses = Differences::of(self.words[..self.len].iter()).misses(word.time, word.derivatives[0]);
        let [last, before, third] = [0, 1, 2].map(|k| &self.words[k]);
        let again = self.len > 0 && far(&word, last) <= 0.0;
        let evenly = last.derivatives[0] + self.pace * far(&word, last);
        let pace_miss = if self.len > 0 { (evenly - word.derivatives[0]).abs() } else { f64::INFINITY };
        if again || self.len > 2 && far(last, before) < LEAST_SPACING_RATIO * far(before, third) {
            self.words[0] = word;
        } else {
            self.words.rotate_right(1);
            self.words[0] = word;
            self.len = (self.len + 1).min(SAMPLES);
            self.missed = self.misses;
            self.pace_misses[1] = self.pace_misses[0];
        }
        if !again {
            self.misses = misses;
            self.pace_misses[0] = pace_miss;
        }
    }

    /// Finds the motion from time `t` (s), where it moves by `now`, to `end`, or goes on with the one it has; it was `before`
    /// until the host spoke. A step `begins` at `t`, or goes on there. Returns how far a new word is from where the head would
    /// have gone without it, and its velocity, where that is given, from that one.
    fn aim(&mut self, [t, end]: [f64; 2], now: Sample, input: HeadInput, before: &Signal, begins: bool) -> [f64; 2] {
        let at_end = input == HeadInput::AtEnd && !self.of_now;
        let due = if at_end { end } else { t };
        let foretold = self.at(due).unwrap_or_else(|| before.at(due));
        let spoken = self.len > 0;
        if !spoken {
            // Before the host's first word the head moved as the scene says, in steps like this one; or as its start does.
            let back = if at_end { 0 } else { 1 };
            for k in (back..back + SAMPLES + 2).rev() {
                let time = t - k as f64 * (end - t);
                let [value, rate] = if self.first {
                    let [value, rate, ..] = self.said.at(time).derivatives;
                    [value, rate]
                } else {
                    let Sample { value, rate, .. } = before.at(time);
                    [value, rate]
                };
                self.push(PoseSample::new(time, value));
                self.pace = rate;
            }
        }
        let silence = t - self.words[0].time;
        let between = self.words[0].time - self.words[1].time;
        let word = if at_end && self.fresh {
            self.said = self.target([t, end], now);
            self.said
        } else if at_end && begins && end - self.words[0].time > REMAINDER * between {
            self.said.at(end)
        } else if self.fresh || !at_end && begins && silence > SILENT_INTERVALS * between {
            self.said.at(t)
        } else {
            return [0.0; 2];
        };
        let off = [word.derivatives[0] - foretold.value, word.derivatives[1] - foretold.rate];
        let jump = match (self.fresh, self.given[1]) {
            (false, _) => [0.0; 2],
            (true, false) => [off[0].abs(), 0.0],
            // A velocity that has changed evenly since the last word has moved the pose by half of that.
            (true, true) => {
                let evenly = 2.0 * off[0] / if at_end { end - t } else { t - self.words[0].time };
                [off[0].abs(), off[1].abs().min((off[1] - evenly).abs())]
            }
        };
        let pace = if spoken { self.course.at(t).rate } else { self.pace };
        self.push(word);
        self.pace = pace;
        self.fresh = false;
        let found = Differences::of(self.words[..self.len].iter());
        let mut degree = self.words[0].order;
        // A polynomial doubles, for every degree, what its words are off by.
        let miss = |k: usize| self.misses[k].max(self.missed[k]) * f64::from(1_u32 << k);
        // A degree that is better by rounding errors alone is none the better.
        let rounding = 4.0 * f64::EPSILON * self.words[0].derivatives[0].abs();
        let pace_miss = self.pace_misses[0].max(self.pace_misses[1]);
        let (mut least, mut evenly) = (miss(degree), false);
        if degree == 0 && pace_miss + rounding < least {
            (least, evenly) = (pace_miss, true);
        }
        for k in degree + 1..found.len {
            if miss(k) + rounding < least {
                (degree, least, evenly) = (k, miss(k), false);
            }
        }
        self.course = found.polynomial(degree);
        if evenly {
            self.course.terms[1] = self.pace;
        }
        let start = self.course.at(t);
        let apart = Sample {
            value: now.value - start.value,
            rate: now.rate - start.rate,
            acceleration: now.acceleration - start.acceleration,
        };
        let span =
            if at_end { end - t } else { (end - t).max(self.words[0].time - self.words[1].time).max(self.until - t) };
        self.rest = Polynomial::decaying(apart, t, span);
        self.until = t + span;
        jump
    }

    /// True from the host's first step on, or where the run starts with its pose.
    pub fn moves(&self) -> bool {
        self.len > 0 || self.first
    }

    /// How it moves at time `t` (s); `None` before it [`moves`](Self::moves).
    pub fn at(&self, t: f64) -> Option<Sample> {
        self.moves().then(|| {
            let course = self.course.at(t);
            if t >= self.until {
                return course;
            }
            let rest = self.rest.at(t);
            Sample {
                value: course.value + rest.value,
                rate: course.rate + rest.rate,
                acceleration: course.acceleration + rest.acceleration,
            }
        })
    }

    /// The longest step (s) from time `t` (s) that resolves how it comes to where the host wants it; `unit` is the length (m) of the
    /// rod, or 1 rad.
    pub fn longest_step(&self, t: f64, unit: f64) -> f64 {
        let span = self.until - self.rest.since;
        if t >= self.until || span <= 0.0 {
            return f64::INFINITY;
        }
        let [x, v, half, ..] = self.rest.terms;
        let way = x.abs().max((v * span).abs()).max((2.0 * half * span * span).abs());
        let sudden = way > SUDDEN * self.course.at(t).acceleration.abs() * span * span && way > SMALL * unit;
        if sudden { span / STEPS_OF_REST } else { f64::INFINITY }
    }

    /// The derivative of `order` as the host gave it last; `None` where it gave none of that order.
    pub fn said(&self, order: usize) -> Option<f64> {
        (order <= self.said.order).then(|| self.said.derivatives[order])
    }
}

/// The motion of a head that a host moves: x, y and angle, each as soon as the host has spoken of it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct HostHead {
    /// The coordinates of which it has spoken.
    pub axes: [Option<CoordinateExtrapolation>; 3],
}

impl HostHead {
    /// Takes over the derivative of `order` of coordinate `i`; see `Axis::say`.
    pub fn say(&mut self, t: f64, i: usize, now: Sample, order: usize, value: f64, derivative: bool) {
        self.axes[i].get_or_insert_with(|| CoordinateExtrapolation::new(t, now)).say(
            t,
            now,
            order.min(HIGHEST),
            value,
            derivative,
        );
    }

    /// Finds the motion of every coordinate over a step; see `Axis::aim`. Returns how far (m, m, rad) new words are from where
    /// the head would have gone without them, and new velocities from its own (per s).
    pub fn aim(
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
                *jump = axis.aim(span, *now, input, before, begins);
            }
        }
        jumps
    }

    /// Starts the run at time `t` (s) with the pose that the host has given, at rest but for the derivatives that it gave too.
    pub fn start(&mut self, t: f64) {
        self.axes.iter_mut().flatten().for_each(|axis| axis.start(t));
    }

    /// True where the run started with a pose that the host gave, and no step has been made since.
    pub fn has_started(&self) -> bool {
        self.axes.iter().flatten().any(|axis| axis.first && axis.len == 0)
    }

    /// True where a host gives, before the first step, another velocity or acceleration than the `scene` has at `time` (s).
    pub fn moves_unlike(&self, scene: &[Signal; 3], time: f64) -> bool {
        let mut axes = self.axes.iter().zip(scene).filter_map(|(axis, scene)| Some((axis.as_ref()?, scene.at(time))));
        axes.any(|(axis, scene)| {
            let unlike = |k: usize, own: f64| axis.given[k] && axis.said.derivatives[k] != own;
            axis.len == 0 && (unlike(1, scene.rate) || unlike(2, scene.acceleration))
        })
    }

    /// The largest part of `reaches` (m, m, rad) that a pose given at `time` (s) is from the one of the `scene`; zero where no
    /// pose is given, or a run has started with one.
    pub fn apart(&self, scene: &[Signal; 3], time: f64, reaches: [f64; 3]) -> f64 {
        let axes = self.axes.iter().zip(scene).zip(reaches);
        let parts = axes.filter_map(|((axis, scene), reach)| {
            let axis = axis.as_ref().filter(|axis| axis.given[0] && axis.len == 0)?;
            Some((axis.said.derivatives[0] - scene.at(time).value).abs() / reach)
        });
        parts.fold(0.0, f64::max)
    }
}
