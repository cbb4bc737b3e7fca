//! Comparison of two runs of a scene by their time series: displacement, tip position, and force and moment on a held head.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use crate::head::Signal;
use crate::metrics::Measurements;
use crate::model::Model;
use crate::rod::node;
use crate::system::State;

/// Differences of displacement are relative to at least this fraction of the path of the centre of mass.
pub const MIN_PATH_FRACTION: f64 = 0.01;

/// Differences of mean force and moment are relative to at least this fraction of the mean modulus, because a mean thrust is a
/// small difference of large forces.
pub const MIN_MEAN_FRACTION: f64 = 1e-3;

/// Distances below this fraction of the length, and forces and moments below this fraction of EI/L² and EI/L, are rounding noise.
pub const NOISE: f64 = 1e-9;

/// A quantity by which runs are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ErrorMeasure {
    /// Displacement of the centre of mass relative to the fluid: the largest difference over time, divided by the larger of the net
    /// displacement and 1 % of the path.
    Displacement,
    /// Position of the tip: the largest difference over time, divided by the largest distance of the tip from its start.
    Tip,
    /// Force on a held head: the larger of the root mean square difference, divided by that of the force, and the difference of the mean
    /// along each axis, divided by the larger of the mean and 1/1000 of the mean modulus.
    Force,
    /// Moment on a held head, likewise.
    Moment,
}

impl ErrorMeasure {
    /// All measures.
    pub const ALL: [Self; 4] = [Self::Displacement, Self::Tip, Self::Force, Self::Moment];

    /// Its name, and the quantity to which its differences are relative.
    pub fn meaning(self) -> [&'static str; 2] {
        match self {
            Self::Displacement => {
                ["displacement", "the larger of the net displacement through the fluid and 1 % of the path"]
            }
            Self::Tip => ["tip", "the tip's largest distance from its start"],
            Self::Force => ["force", "the head's force: root mean square, and mean"],
            Self::Moment => ["moment", "the head's moment: root mean square, and mean"],
        }
    }

    /// True if a scene has this measure.
    pub fn exists(self, held: bool) -> bool {
        held || matches!(self, Self::Displacement | Self::Tip)
    }
}

/// The compared quantities at one time.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SeriesPoint {
    /// Time, s.
    pub time: f64,
    /// Centre of mass, m.
    pub com: Vector2<f64>,
    /// Tip, m.
    pub tip: Vector2<f64>,
    /// Force of the tail on a held head, N.
    pub force: Vector2<f64>,
    /// Moment of the tail on a held head, N m.
    pub moment: f64,
}

impl SeriesPoint {
    /// The point of `state` with its measurements.
    pub fn of(state: &State, now: &Measurements) -> Self {
        Self {
            time: state.t,
            com: now.com,
            tip: node(&state.q, state.q.len() / 2 - 1),
            force: now.head_force,
            moment: now.head_moment,
        }
    }
}

/// The time series of a run.
#[derive(Debug, Clone)]
pub struct TimeSeries {
    held: bool,
    /// Length of the rod, m, and EI/L, N m.
    length: f64,
    stiffness: f64,
    /// The flow that carries a free rod, m/s.
    flow: [Signal; 2],
    /// The points, in order of time.
    pub points: Vec<SeriesPoint>,
}

impl TimeSeries {
    /// An empty time series for a run of `model`.
    pub fn of(model: &Model) -> Self {
        let held = model.head.is_some();
        let still = [0.0; 2].map(Signal::Constant);
        let flow = if held || model.forces.is_empty() {
            still
        } else {
            model.flow.clone().unwrap_or_else(|| [model.fluid.flow.x, model.fluid.flow.y].map(Signal::Constant))
        };
        Self { held, length: model.rod.length, stiffness: model.rod.ei / model.rod.length, flow, points: Vec::new() }
    }

    /// An empty time series with the same properties.
    pub fn without_points(&self) -> Self {
        self.first_points(0)
    }

    /// The first `count` points.
    pub fn first_points(&self, count: usize) -> Self {
        let (points, flow) = (self.points[..count.min(self.points.len())].to_vec(), self.flow.clone());
        Self { points, flow, ..*self }
    }

    /// Integral of `of` over time, by its values at the ends of intervals: at the start the rod may not yet carry its loads.
    fn integral(&self, of: impl Fn(usize) -> f64) -> f64 {
        (1..self.points.len()).map(|i| (self.points[i].time - self.points[i - 1].time) * of(i)).sum()
    }

    /// The displacement of the fluid between `start` and `end`, m.
    fn flow_displacement(&self, start: &SeriesPoint, end: &SeriesPoint) -> Vector2<f64> {
        let [x, y] = self.flow.each_ref().map(|flow| flow.integral(end.time) - flow.integral(start.time));
        Vector2::new(x, y)
    }

    /// The displacement of the centre of mass relative to the fluid, at `point`.
    fn displacement(&self, point: &SeriesPoint) -> Vector2<f64> {
        self.points
            .first()
            .map_or(Vector2::zeros(), |start| point.com - start.com - self.flow_displacement(start, point))
    }

    /// The displacement of the tip relative to the fluid, at `point`.
    fn tip_displacement(&self, point: &SeriesPoint) -> f64 {
        self.points.first().map_or(0.0, |start| (point.tip - start.tip - self.flow_displacement(start, point)).norm())
    }

    /// The measures that are only noise in both time series.
    pub fn noise(&self, other: &Self) -> Vec<ErrorMeasure> {
        let quiet = |of: &dyn Fn(&Self, &SeriesPoint) -> f64, noise: f64| {
            [self, other].iter().all(|series| series.points.iter().all(|point| of(series, point) <= noise))
        };
        let [length, moment] = [NOISE * self.length, NOISE * self.stiffness];
        let is_noise = |measure: &ErrorMeasure| match measure {
            ErrorMeasure::Displacement => quiet(&|series, point| series.displacement(point).norm(), length),
            ErrorMeasure::Tip => quiet(&Self::tip_displacement, length),
            ErrorMeasure::Force => self.held && quiet(&|_, point| point.force.norm(), moment / self.length),
            ErrorMeasure::Moment => self.held && quiet(&|_, point| point.moment.abs(), moment),
        };
        ErrorMeasure::ALL.into_iter().filter(is_noise).collect()
    }

    /// The error of each measure per position error of one length, assuming that velocities and loads change in proportion to the
    /// path of the tip. This holds for step errors, which are phase errors.
    pub fn errors_per_length(&self) -> Differences {
        let Some(end) = self.points.last() else { return Differences::default() };
        let noise = NOISE * self.length;
        let path: f64 =
            self.points.windows(2).map(|pair| (self.displacement(&pair[1]) - self.displacement(&pair[0])).norm()).sum();
        let travel = self.points.iter().map(|point| self.tip_displacement(point)).fold(noise, f64::max);
        let tip = self.length / travel;
        // The error of a mean is relative to the loads that it is the small difference of.
        let of_loads = |of: &dyn Fn(&SeriesPoint) -> Vector2<f64>| {
            let size = self.integral(|i| of(&self.points[i]).norm());
            let means =
                [0, 1].map(|axis| self.integral(|i| of(&self.points[i])[axis]).abs().max(MIN_MEAN_FRACTION * size));
            let parts = means.map(|mean| if size > 0.0 { size / mean } else { 1.0 });
            tip * parts[0].max(parts[1])
        };
        Differences {
            displacement: self.length / self.displacement(end).norm().max(MIN_PATH_FRACTION * path).max(noise),
            tip,
            force: self.held.then(|| of_loads(&|point| point.force)),
            moment: self.held.then(|| {
                let size = self.integral(|i| self.points[i].moment.abs());
                let mean = self.integral(|i| self.points[i].moment).abs().max(MIN_MEAN_FRACTION * size);
                if size > 0.0 { tip * size / mean } else { tip }
            }),
        }
    }

    /// The differences of another time series, at the same times, from this one.
    pub fn differences(&self, other: &Self) -> Differences {
        let (ours, theirs) = (&self.points, &other.points);
        let count = ours.len().min(theirs.len());
        let Some((start, end)) = ours.first().zip(ours.last()) else { return Differences::default() };
        let noise = NOISE * self.length;
        let path: f64 =
            ours.windows(2).map(|pair| (self.displacement(&pair[1]) - self.displacement(&pair[0])).norm()).sum();
        let travel = ours.iter().map(|point| self.tip_displacement(point)).fold(noise, f64::max);
        let farthest = |of: fn(&SeriesPoint) -> Vector2<f64>| {
            (0..count).map(|i| (of(&ours[i]) - of(&theirs[i])).norm()).fold(0.0, f64::max)
        };
        let of_loads = |of: &dyn Fn(&SeriesPoint) -> Vector2<f64>, noise: f64| {
            let square = self.integral(|i| of(&ours[i]).norm_squared()).sqrt();
            let size = self.integral(|i| of(&ours[i]).norm());
            let span = (end.time - start.time).max(f64::MIN_POSITIVE);
            let apart = self.integral(|i| (of(&ours[i]) - of(&theirs[i])).norm_squared()).sqrt();
            let means = [0, 1].map(|axis| {
                let mean = self.integral(|i| of(&ours[i])[axis]);
                let apart = self.integral(|i| of(&ours[i])[axis] - of(&theirs[i])[axis]);
                apart.abs() / mean.abs().max(MIN_MEAN_FRACTION * size).max(noise * span)
            });
            (apart / square.max(noise * span.sqrt())).max(means[0]).max(means[1])
        };
        Differences {
            displacement: farthest(|point| point.com)
                / self.displacement(end).norm().max(MIN_PATH_FRACTION * path).max(noise),
            tip: farthest(|point| point.tip) / travel,
            force: self.held.then(|| of_loads(&|point| point.force, NOISE * self.stiffness / self.length)),
            moment: self.held.then(|| of_loads(&|point| Vector2::new(point.moment, 0.0), NOISE * self.stiffness)),
        }
    }
}

/// Relative differences of two time series, or estimates of them. A free head has no force and moment.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
#[expect(missing_docs, reason = "each is a Measure")]
pub struct Differences {
    pub displacement: f64,
    pub tip: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moment: Option<f64>,
}

impl Differences {
    /// The difference of `measure`, if the scene has it.
    pub fn get(&self, measure: ErrorMeasure) -> Option<f64> {
        match measure {
            ErrorMeasure::Displacement => Some(self.displacement),
            ErrorMeasure::Tip => Some(self.tip),
            ErrorMeasure::Force => self.force,
            ErrorMeasure::Moment => self.moment,
        }
    }

    /// The largest difference among the measures `of`, or `None` if the scene has none of them.
    pub fn largest(&self, of: &[ErrorMeasure]) -> Option<(ErrorMeasure, f64)> {
        let known = of.iter().filter_map(|measure| Some((*measure, self.get(*measure)?)));
        known.reduce(|worst, next| if next.1 > worst.1 || next.1.is_nan() { next } else { worst })
    }

    /// True if all differences are finite.
    pub fn are_finite(&self) -> bool {
        (self.displacement + self.tip + self.force.unwrap_or(0.0) + self.moment.unwrap_or(0.0)).is_finite()
    }

    /// Combines each difference with that of `other`.
    pub(super) fn with(self, other: Self, combine: impl Fn(f64, f64) -> f64) -> Self {
        let both = |a: Option<f64>, b: Option<f64>| Some(combine(a?, b?));
        Self {
            displacement: combine(self.displacement, other.displacement),
            tip: combine(self.tip, other.tip),
            force: both(self.force, other.force),
            moment: both(self.moment, other.moment),
        }
    }

    /// Applies `change` to each difference.
    pub(super) fn map(self, change: impl Fn(f64) -> f64) -> Self {
        self.with(self, |x, _| change(x))
    }

    /// Describes each difference with the name of its measure, for messages.
    pub fn in_words(&self) -> String {
        let known = ErrorMeasure::ALL.iter().filter_map(|measure| Some((measure.meaning()[0], self.get(*measure)?)));
        known.map(|(name, value)| format!("{name} {value:.1e}")).collect::<Vec<_>>().join(", ")
    }
}
