//! Reference solutions by two independent methods (ESDIRK3; generalized-α with Richardson extrapolation), and errors against them.

use crate::number_format::significant;
use crate::study::study_run::{RunOptions, StudyRun};

/// Samples of the tip's path.
pub const SAMPLES: usize = 500;

/// Options of the study's runs.
pub const RUN_OPTIONS: RunOptions = RunOptions { samples: SAMPLES, push: None, halving: true, timed: true };

/// Errors of a mean force are relative to at least this fraction of the mean modulus.
const MIN_MEAN_FORCE: f64 = 1e-3;

/// Errors below this multiple of the reference's own error are unknown.
pub const MIN_ERROR_OVER_REFERENCE: f64 = 2.0;

/// Errors of a displacement are relative to at least this fraction of the tip's path.
const MIN_DISPLACEMENT: f64 = 1e-5;

/// The results by which runs are compared, see [`quantities`](super::quantities::quantities).
#[derive(Debug, Clone)]
pub struct RunResults {
    /// Net displacement (m) along x, and zero; or mean force (N) on a held head along x and y.
    pub first: [f64; 2],
    /// Least reference value for its relative errors.
    least: f64,
    pub tip: Vec<[f64; 2]>,
    /// Extent of the tip's path, m.
    travel: f64,
    pub work: f64,
    /// Largest |work| of the run, to which errors of the work are relative.
    pub largest_work: f64,
}

/// Digits to print of a number with this relative error: the significant ones and one more.
pub fn digits_of(error: f64) -> usize {
    (1.0 - error.log10()).ceil().clamp(1.0, 10.0) as usize
}

impl RunResults {
    pub fn of(run: &StudyRun) -> Self {
        Self {
            first: run.head_force.map_or([run.displacement[0], 0.0], |(mean, _)| mean),
            least: run.head_force.map_or(MIN_DISPLACEMENT * run.travel(), |(_, modulus)| MIN_MEAN_FORCE * modulus),
            travel: run.travel(),
            tip: run.tip.iter().copied().take(SAMPLES + 1).collect(),
            work: run.work_in,
            largest_work: run.largest_work_in,
        }
    }

    /// Richardson extrapolation: fine + (fine − coarse)/(ratio − 1).
    pub fn extrapolated(coarse: &Self, fine: &Self, ratio: f64) -> Self {
        let to = |c: f64, f: f64| f + (f - c) / (ratio - 1.0);
        let tips = coarse.tip.iter().zip(&fine.tip);
        Self {
            first: [0, 1].map(|i| to(coarse.first[i], fine.first[i])),
            least: fine.least,
            travel: fine.travel,
            tip: tips.map(|(c, f)| [to(c[0], f[0]), to(c[1], f[1])]).collect(),
            work: to(coarse.work, fine.work),
            largest_work: fine.largest_work,
        }
    }

    /// Distance of the first quantity between two results.
    pub fn first_distance(&self, other: &Self) -> f64 {
        (self.first[0] - other.first[0]).hypot(self.first[1] - other.first[1])
    }

    /// The first quantity as text, with the digits that its relative `error` leaves significant.
    pub fn first_in_words(&self, held: bool, error: f64) -> String {
        let [x, y] = self.first.map(|value| significant(value, digits_of(error)));
        if held { format!("mean head force ({x}, {y}) N") } else { format!("displacement {x} m") }
    }

    /// Relative differences of the three quantities from `reference`.
    pub fn errors(&self, reference: &Self) -> [f64; 3] {
        let size = |a: [f64; 2]| a[0].hypot(a[1]);
        let distance = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let apart = self.tip.iter().zip(&reference.tip).map(|(a, b)| distance(a, b)).fold(0.0, f64::max);
        let relative = |x: f64, y: f64, scale: f64| if x == y { 0.0 } else { (x - y).abs() / scale.abs() };
        [
            relative(self.first_distance(reference), 0.0, size(reference.first).max(reference.least)),
            apart / reference.travel,
            relative(self.work, reference.work, reference.largest_work),
        ]
    }
}

/// A reference and its own relative errors.
pub struct Reference {
    pub result: RunResults,
    pub errors: [f64; 3],
}

impl Reference {
    /// The smallest errors that this reference can measure.
    pub fn floors(&self) -> [f64; 3] {
        self.errors.map(|error| MIN_ERROR_OVER_REFERENCE * error)
    }

    /// The reference from runs of both methods with two steps each; `None` if one of them failed.
    pub fn of(runs: &[StudyRun]) -> Option<Self> {
        let [first, second, coarse, fine] = runs else { return None };
        if !runs.iter().all(|run| run.is_complete(RUN_OPTIONS)) {
            return None;
        }
        let [first, second, coarse, fine] = [first, second, coarse, fine].map(RunResults::of);
        let other = RunResults::extrapolated(&coarse, &fine, 4.0);
        let [own, others] = [first.errors(&second), other.errors(&second)];
        let errors = std::array::from_fn(|i| f64::max(own[i], others[i]));
        Some(Self { result: second, errors })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_has_the_digits_that_are_known_and_one_more() {
        assert_eq!([0.3, 1.2e-2, 1e-9, 0.0, 2.0].map(digits_of), [2, 3, 10, 10, 1]);
    }
}
