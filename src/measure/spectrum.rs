//! The spectrum of the drives of a rod: the frequencies of actuation, head, flow and tendons, and the velocity that each gives
//! the rod.
//!
//! A line is a frequency f and the root mean square v of the velocity relative to the fluid that it gives the rod. A line with a
//! small v counts less: a method of third order follows it as accurately as the strongest line with steps that are (v_max/v)^⅓
//! times as long as f alone would require.
//!
//! A table is represented by the lines of its Fourier transform, each with its fraction of ⟨u²⟩ of the velocity u. If it has a
//! single line, the line has the moments of the table, f = √(⟨u̇²⟩/⟨u²⟩)/2π, which is exact for a sinusoid.

use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

use nalgebra::Complex;

use crate::actuation::{Actuation, Wave};
use crate::head::{HeadMotion, Hinge, Row, Signal, hermite};
use crate::model::{Drive, Model};
use crate::rod::{Rod, node};
use crate::start::Start;
use crate::system::State;
use crate::tendons::Tendon;

/// Number of phases of a cycle at which the prescribed shape is evaluated.
const PHASES: u32 = 48;

/// A table counts as periodic if the root mean square of its rate differs between its quarters by at most this fraction.
const STATIONARY_TOLERANCE: f64 = 0.2;

/// A line is considered for the slowest one if its amplitude, speed over frequency, is at least this fraction of the largest.
const LEAST_AMPLITUDE_RATIO: f64 = 1e-3;

/// The velocity of a table counts as changing if it changes by this fraction of its magnitude. Smaller changes are rounding of
/// its rows.
const STEADY: f64 = 1e-6;

/// A line of a table counts if its velocity is at least this fraction of the largest; the side lobes of the window are a fifth of
/// that.
const RESOLVED: f64 = 0.01;

/// For a table of at least this many periods the moments are taken under a window, so that it need not end with a whole period.
const WINDOWED: f64 = 4.0;

/// The largest number of samples of a table for its Fourier transform, a power of two.
const TIMES: usize = 1 << 14;

/// The largest number of samples of a table for the choice of pictures, a power of two.
const TIMES_OF_PICTURES: usize = 1 << 17;

/// What a spectrum is for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SpectrumPurpose {
    /// The choice of steps, and estimates.
    Steps,
    /// The choice of pictures of a motion that ends at time `until` (s). A table counts up to this time, at the spacing of its closest
    /// rows. One that rests or slows down before this time is transient, but not one that rests only before it moves. The lines of a torque are those of the angle.
    Pictures {
        /// The end of the motion, s.
        until: f64,
    },
}

/// How a signal moves the rod.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SignalKind {
    Position,
    Velocity,
    /// A torque, whose angle is proportional to 1/ω².
    Torque,
}

/// A frequency at which something moves the rod.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpectralLine {
    /// Its frequency f, Hz.
    pub frequency: f64,
    /// Root mean square of the velocity that it gives the rod against the fluid, m/s.
    pub speed: f64,
    /// True if it is of a non-stationary table.
    pub is_transient: bool,
}

impl SpectralLine {
    /// Root mean square of the displacement that it gives the rod against the fluid, m.
    fn amplitude(&self) -> f64 {
        self.speed / (TAU * self.frequency)
    }
}

/// The lines of all drives of a rod.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectrum {
    purpose: SpectrumPurpose,
    lines: Vec<SpectralLine>,
    /// True if a non-stationary table drives the rod.
    pub is_transient: bool,
}

impl Spectrum {
    /// The spectrum of an actuation of `rod` by natural curvature with its drive, of the motion of its head, of a flow that
    /// changes in time, of tendons, and of the torque of a hinge, for a `purpose`.
    pub fn of(
        purpose: SpectrumPurpose,
        rod: &Rod,
        actuation: Option<(&dyn Actuation, Drive)>,
        head: Option<&HeadMotion>,
        flow: Option<&[Signal; 2]>,
        tendons: &[Tendon],
        hinge: Option<&Hinge>,
    ) -> Self {
        let mut spectrum = Self { purpose, lines: Vec::new(), is_transient: false };
        if let Some((actuation, drive)) = actuation {
            spectrum.add_actuation(rod, actuation, drive);
        }
        // A turning head moves each point of the rod by its distance from the head, L/√3 in the mean square.
        let arms = [1.0, 1.0, rod.length / 3f64.sqrt()];
        for (signal, arm) in head.into_iter().flatten().zip(arms) {
            spectrum.add_signal(signal, arm, SignalKind::Position);
        }
        for signal in flow.into_iter().flatten() {
            spectrum.add_signal(signal, 1.0, SignalKind::Velocity);
        }
        for tendon in tendons {
            // A tension T bends an unloaded rod by T d/EI, which moves it by half of that times the square of the distance, L²/√5
            // in the mean square.
            let middle = (tendon.joints.start + tendon.joints.end) / 2;
            let length = tendon.edges.len() as f64 * rod.spacing;
            let arm = tendon.offset.abs() * length * length / (2.0 * 5f64.sqrt() * rod.joint_stiffness(middle));
            // A cable of stiffness k that is shortened by a winch moves the tip by at most that amount.
            let arm = tendon.winch().map_or(arm, |winch| (arm * winch.stiffness).min(length / tendon.offset.abs()));
            spectrum.add_signal(tendon.signal(), arm, SignalKind::Position);
        }
        if let Some(Hinge { torque, inertia, .. }) = hinge {
            // A torque T turns the rigid rod by T/(Iω²). For steps, a table of it counts as one of ω = 1 rad/s.
            let whole = inertia + rod.inertia_about_head();
            let omega = match torque {
                Signal::Sinusoid { frequency, .. } if *frequency != 0.0 => TAU * frequency,
                _ => 1.0,
            };
            spectrum.add_signal(torque, arms[2] / (whole * omega * omega), SignalKind::Torque);
        }
        spectrum
    }

    /// The spectrum of a model.
    pub fn of_model(model: &Model) -> Self {
        Self::of_model_for(SpectrumPurpose::Steps, model)
    }

    /// The spectrum of a model for a purpose.
    pub fn of_model_for(purpose: SpectrumPurpose, model: &Model) -> Self {
        let Model { rod, head, flow, tendons, hinge, .. } = model;
        let hinge = hinge.as_ref();
        let driven = model.with_curvature_wave(|actuation, drive| {
            Self::of(purpose, rod, Some((actuation, drive)), head.as_ref(), flow.as_ref(), tendons, hinge)
        });
        driven.unwrap_or_else(|| Self::of(purpose, rod, None, head.as_ref(), flow.as_ref(), tendons, hinge))
    }

    /// The frequencies, each with its speed.
    pub fn lines(&self) -> &[SpectralLine] {
        &self.lines
    }

    /// The lowest frequency (Hz) of the lines with a significant amplitude; `None` if nothing moves periodically.
    pub fn slowest(&self) -> Option<f64> {
        self.of_amplitude(LEAST_AMPLITUDE_RATIO * self.largest_amplitude()).reduce(f64::min)
    }

    /// The highest frequency (Hz) of the lines that move the rod by at least `least` (m, root mean square) or, if there are none, of the
    /// one that moves it most.
    pub fn fastest_of_amplitude(&self, least: f64) -> Option<f64> {
        self.of_amplitude(least.min(self.largest_amplitude())).reduce(f64::max)
    }

    /// The same without transient lines, which are over before the end; `None` if only those move the rod so far.
    pub fn fastest_steady_of_amplitude(&self, least: f64) -> Option<f64> {
        let least = least.min(self.largest_amplitude());
        let steady = self.lines.iter().filter(|line| !line.is_transient && line.amplitude() >= least);
        steady.map(|line| line.frequency).reduce(f64::max)
    }

    /// The frequencies (Hz) of the lines of at least this amplitude (m, root mean square).
    fn of_amplitude(&self, least: f64) -> impl Iterator<Item = f64> {
        self.lines.iter().filter(move |line| line.amplitude() >= least).map(|line| line.frequency)
    }

    /// The largest amplitude of a line, m, root mean square.
    fn largest_amplitude(&self) -> f64 {
        self.lines.iter().map(SpectralLine::amplitude).fold(0.0, f64::max)
    }

    /// The frequency (Hz) that steps must resolve: the largest f (v/v_max)^⅓.
    pub fn fastest(&self) -> Option<f64> {
        let most = self.lines.iter().map(|line| line.speed).fold(0.0, f64::max);
        let counts = |line: &SpectralLine| line.frequency * if most > 0.0 { (line.speed / most).cbrt() } else { 1.0 };
        // At least the frequency of the strongest line.
        self.lines.iter().map(counts).chain(self.strongest()).reduce(f64::max)
    }

    /// The frequency (Hz) of the line that gives the rod the largest velocity; of several, the first.
    pub fn strongest(&self) -> Option<f64> {
        let stronger = |a: SpectralLine, b: SpectralLine| if b.speed > a.speed { b } else { a };
        self.lines.iter().copied().reduce(stronger).map(|line| line.frequency)
    }

    fn add(&mut self, frequency: f64, speed: f64, is_transient: bool) {
        let frequency = frequency.abs();
        if frequency > 0.0 && frequency.is_finite() {
            self.lines.push(SpectralLine { frequency, speed, is_transient });
        }
    }

    /// Adds the lines of an actuation. The harmonics share the speed of the prescribed shape in proportion to their contributions
    /// n h_n to its rate.
    fn add_actuation(&mut self, rod: &Rod, actuation: &dyn Actuation, drive: Drive) {
        let harmonics = actuation.harmonics();
        let rate = |(order, size): &(f64, f64)| order * size.abs();
        let all = harmonics.iter().map(|harmonic| rate(harmonic).powi(2)).sum::<f64>().sqrt();
        let speed = shape_speed(rod, actuation, drive);
        for harmonic in &harmonics {
            let part = if all > 0.0 { rate(harmonic) / all } else { 0.0 };
            self.add(harmonic.0 * drive.frequency, part * speed, false);
        }
    }

    /// Adds a signal of a kind, acting over a distance `arm` (m, or 1).
    fn add_signal(&mut self, signal: &Signal, arm: f64, kind: SignalKind) {
        // The rate of a position or torque moves the rod.
        let is_position = kind != SignalKind::Velocity;
        match signal {
            Signal::Constant(_) => {}
            Signal::Sinusoid { amplitude, frequency, .. } => {
                let rate = if is_position { TAU * frequency.abs() } else { 1.0 };
                if *amplitude != 0.0 {
                    self.add(*frequency, FRAC_1_SQRT_2 * arm * rate * amplitude.abs(), false);
                }
            }
            Signal::Table(rows) => {
                let velocity = |row: f64, rate: f64, acceleration: f64| {
                    if is_position { [rate, acceleration] } else { [row, rate] }
                };
                let [first, last] = [rows.first(), rows.last()].map(|row| row.map_or(0.0, |row| row.time));
                let (until, spacing) = match self.purpose {
                    SpectrumPurpose::Steps => (last, RowSpacing::Mean),
                    SpectrumPurpose::Pictures { until } => (until, RowSpacing::Closest),
                };
                let (end_of_rows, last) = (last, last.min(until));
                let Some(mut moments) = Moments::of(rows, [first, last], |_| 1.0, velocity) else { return };
                let size_of = |span| Moments::of(rows, span, |_| 1.0, velocity).map_or(0.0, |m| m.size());
                let is_steady = |[from, to]: [f64; 2], size: f64| {
                    let quarter = |k: u32| [k, k + 1].map(|k| from + 0.25 * f64::from(k) * (to - from));
                    !(0..4).any(|k| (size_of(quarter(k)) - size).abs() > STATIONARY_TOLERANCE * size)
                };
                let size = moments.size();
                let is_transient = match self.purpose {
                    SpectrumPurpose::Steps => !is_steady([first, last], size),
                    // After its rows a table rests.
                    SpectrumPurpose::Pictures { .. } if moments.frequency() * (until - end_of_rows) > 1.0 => true,
                    SpectrumPurpose::Pictures { .. } => {
                        let end = [last - 0.25 * (last - first), last];
                        let at_end = size_of(end);
                        let is_steady_at_end = at_end >= (1.0 - STATIONARY_TOLERANCE) * size && is_steady(end, at_end);
                        !is_steady_at_end && !is_steady([first, last], size)
                    }
                };
                self.is_transient |= is_transient;
                // An incomplete period at the end gets less weight.
                if !is_transient && moments.frequency() * (last - first) >= WINDOWED {
                    let part = |time: f64| window((time - first) / (last - first));
                    moments = Moments::of(rows, [first, last], part, velocity).unwrap_or(moments);
                }
                // A burst may lie at an end of the table.
                let weight = if is_transient { taper } else { window };
                let lines = lines(rows, [first, last], spacing, weight, velocity);
                let own = match (kind, self.purpose) {
                    (SignalKind::Torque, SpectrumPurpose::Pictures { .. }) => {
                        |frequency: f64| (TAU * frequency).powi(-2)
                    }
                    _ => |_| 1.0,
                };
                if lines.len() > 1 {
                    let all: f64 = lines.iter().map(|line| line.speed * line.speed).sum();
                    let scale = arm * moments.speed() / all.sqrt();
                    for SpectralLine { frequency, speed, .. } in lines {
                        self.add(frequency, scale * speed * own(frequency), is_transient);
                    }
                } else {
                    let frequency = moments.frequency();
                    self.add(frequency, arm * moments.speed() * own(frequency), is_transient);
                }
            }
        }
    }
}

/// Weighted means over a part of a table: of a velocity, of its square, and of the square of its rate.
struct Moments {
    mean: f64,
    square: f64,
    rate: f64,
}

impl Moments {
    /// Moments of the velocity that `velocity` computes from value, rate and second rate, with the `weight` of a time; `None` if
    /// nothing changes.
    fn of(
        rows: &[Row],
        [from, to]: [f64; 2],
        weight: impl Fn(f64) -> f64,
        velocity: impl Fn(f64, f64, f64) -> [f64; 2],
    ) -> Option<Self> {
        // Simpson's rule, because velocities between rows are parabolas or cubics.
        let (mut span, mut mean, mut square, mut rate) = (0.0, 0.0, 0.0, 0.0);
        for pair in rows.windows(2) {
            let [start, end] = [pair[0].time.max(from), pair[1].time.min(to)];
            if end <= start {
                continue;
            }
            let h = end - start;
            for (place, part) in [(start, 1.0), (0.5 * (start + end), 4.0), (end, 1.0)] {
                let at = hermite(&pair[0], &pair[1], place);
                let [u, change] = velocity(at.value, at.rate, at.acceleration);
                let weight = part / 6.0 * h * weight(place);
                span += weight;
                mean += weight * u;
                square += weight * u * u;
                rate += weight * change * change;
            }
        }
        let moments = Self { mean: mean / span, square: square / span, rate: rate / span };
        (span > 0.0 && rate > 0.0 && moments.speed() > STEADY * moments.square.sqrt()).then_some(moments)
    }

    /// Root mean square of the velocity about its mean.
    fn speed(&self) -> f64 {
        (self.square - self.mean * self.mean).max(0.0).sqrt()
    }

    /// Root mean square of its rate.
    fn size(&self) -> f64 {
        self.rate.sqrt()
    }

    fn frequency(&self) -> f64 {
        self.size() / (TAU * self.speed())
    }
}

/// Blackman's window at a fraction `part` of its span: a line is six frequencies wide, and its side lobes are 0.1 % of it.
fn window(part: f64) -> f64 {
    let phase = TAU * part;
    0.42 - 0.5 * phase.cos() + 0.08 * (2.0 * phase).cos()
}

/// A window of one, except over the first and last twentieth of its span, where it rises and falls as a cosine to reduce leakage.
fn taper(part: f64) -> f64 {
    let rise = (20.0 * part.min(1.0 - part)).clamp(0.0, 1.0);
    0.5 - 0.5 * (PI * rise).cos()
}

/// The rows of a table that decide which frequencies it contains.
#[derive(Debug, Clone, Copy)]
enum RowSpacing {
    /// So many rows, evenly spaced.
    Mean,
    /// The two closest rows: rests may have rows that are far apart.
    Closest,
}

impl RowSpacing {
    /// The number of samples of a table within a time, and the highest frequency (Hz) that is resolved.
    fn samples(self, rows: &[Row], [from, to]: [f64; 2]) -> (usize, f64) {
        match self {
            Self::Mean => {
                let count = (2 * rows.len()).next_power_of_two().clamp(64, TIMES);
                (count, 0.5 * (rows.len() - 1) as f64 / (to - from))
            }
            Self::Closest => {
                let within = rows.windows(2).filter(|pair| pair[0].time < to);
                let closest = within.map(|pair| pair[1].time - pair[0].time).fold(to - from, f64::min);
                let gaps = ((to - from) / closest).min(TIMES_OF_PICTURES as f64);
                let count = (2.0 * gaps + 2.0) as usize;
                (count.next_power_of_two().clamp(64, TIMES_OF_PICTURES), 0.5 / closest)
            }
        }
    }
}

/// The lines of the velocity that `velocity` computes from value, rate and second rate of a table, by its Fourier transform with
/// the `weight` of each fraction of its span; only the ratios of their speeds are meaningful.
fn lines(
    rows: &[Row],
    [from, to]: [f64; 2],
    spacing: RowSpacing,
    weight: impl Fn(f64) -> f64,
    velocity: impl Fn(f64, f64, f64) -> [f64; 2],
) -> Vec<SpectralLine> {
    let (count, fastest) = spacing.samples(rows, [from, to]);
    let mut row = 0;
    let sample = |i: usize| {
        let time = from + (to - from) * (i as f64 + 0.5) / count as f64;
        while row + 2 < rows.len() && rows[row + 1].time <= time {
            row += 1;
        }
        let at = hermite(&rows[row], &rows[row + 1], time);
        velocity(at.value, at.rate, at.acceleration)[0]
    };
    let velocities: Vec<f64> = (0..count).map(sample).collect();
    let window = |i: usize| weight((i as f64 + 0.5) / count as f64);
    // The mean under the window, so that incomplete periods do not contribute.
    let [sum, all] = (0..count).fold([0.0; 2], |[sum, all], i| [sum + window(i) * velocities[i], all + window(i)]);
    let mean = sum / all;
    let seen = velocities.iter().enumerate().map(|(i, u)| Complex::from(window(i) * (u - mean)));
    let squares: Vec<f64> = transform(&seen.collect::<Vec<_>>())[..count / 2].iter().map(Complex::norm_sqr).collect();
    // A line extends from one local minimum to the next.
    let ends: Vec<usize> = (2..squares.len() - 1)
        .filter(|k| squares[k - 1] > squares[*k] && squares[*k] <= squares[k + 1])
        .chain([squares.len()])
        .collect();
    let mut start = 1;
    let mut lines = Vec::with_capacity(ends.len());
    for end in ends {
        let [size, moment] = (start..end)
            .fold([0.0; 2], |[size, moment], k| [size + squares[k], moment + squares[k] * (k as f64).powi(2)]);
        start = end;
        if size > 0.0 {
            let frequency = (moment / size).sqrt() / (to - from);
            lines.push(SpectralLine { frequency, speed: size.sqrt(), is_transient: false });
        }
    }
    let most = lines.iter().map(|line: &SpectralLine| line.speed).fold(0.0, f64::max);
    // Frequencies above one per two rows come only from the kinks between rows.
    lines.retain(|line| line.speed >= RESOLVED * most && line.frequency <= fastest);
    lines
}

/// The Fourier transform of `values`, whose number is a power of two.
fn transform(values: &[Complex<f64>]) -> Vec<Complex<f64>> {
    if values.len() < 2 {
        return values.to_vec();
    }
    let half = |first: usize| transform(&values.iter().skip(first).step_by(2).copied().collect::<Vec<_>>());
    let (even, mut odd) = (half(0), half(1));
    for (k, value) in odd.iter_mut().enumerate() {
        *value *= Complex::cis(-TAU * k as f64 / values.len() as f64);
    }
    let with = |sign: f64| even.iter().zip(&odd).map(move |(a, b)| a + b * sign);
    with(1.0).chain(with(-1.0)).collect()
}

/// Root mean square of the velocity (m/s), normal to the rod, of the prescribed shape with the head at rest.
fn shape_speed(rod: &Rod, actuation: &dyn Actuation, drive: Drive) -> f64 {
    let rest = [crate::head::Sample::default(); 3];
    let mut squares = 0.0;
    for i in 0..PHASES {
        let (mut natural, mut rate) = (vec![0.0; rod.nodes], vec![0.0; rod.nodes]);
        let phase = TAU * f64::from(i) / f64::from(PHASES);
        let phase_rate = TAU * drive.frequency;
        let wave = Wave { amplitude: drive.amplitude, gain: 1.0, gain_rate: 0.0, phase, phase_rate };
        actuation.add(wave, &mut natural, &mut rate);
        [&mut natural, &mut rate].into_iter().for_each(|values| rod.at_joints(values));
        let mut state = State::zeros(2 * rod.nodes);
        Start::Shaped.place(rod, [&natural, &rate], None, Some(&rest), &mut state);
        for k in 0..rod.nodes {
            let (before, after) = (k.saturating_sub(1), (k + 1).min(rod.nodes - 1));
            let tangent = (node(&state.q, after) - node(&state.q, before)).normalize();
            squares += tangent.perp(&node(&state.v, k)).powi(2) / rod.nodes as f64;
        }
    }
    (squares / f64::from(PHASES)).sqrt()
}
