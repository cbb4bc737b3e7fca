//! Results of runs, their errors, and the references that errors are measured against.

use super::{MANNER, SAMPLES};
use crate::study::trial::Trial;

/// The quantities of a run: displacement, tip, energy put in.
#[derive(Debug, Clone)]
pub struct Result3 {
    pub displacement: f64,
    pub tip: Vec<[f64; 2]>,
    pub work: f64,
    /// Largest |work| of the run: what errors of the work are compared with.
    pub largest_work: f64,
}

impl Result3 {
    pub fn of(trial: &Trial) -> Self {
        Self {
            displacement: trial.displacement[0],
            tip: trial.tip[..=SAMPLES].to_vec(),
            work: trial.work_in,
            largest_work: trial.largest_work_in,
        }
    }

    /// fine + (fine − coarse)/(ratio − 1).
    pub fn extrapolated(coarse: &Self, fine: &Self, ratio: f64) -> Self {
        let to = |c: f64, f: f64| f + (f - c) / (ratio - 1.0);
        let tips = coarse.tip.iter().zip(&fine.tip);
        Self {
            displacement: to(coarse.displacement, fine.displacement),
            tip: tips.map(|(c, f)| [to(c[0], f[0]), to(c[1], f[1])]).collect(),
            work: to(coarse.work, fine.work),
            largest_work: fine.largest_work,
        }
    }

    /// Relative differences of the three quantities from `reference`.
    pub fn errors(&self, reference: &Self) -> [f64; 3] {
        let first = reference.tip.first().copied().unwrap_or_default();
        let distance = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let travel = reference.tip.iter().map(|tip| distance(tip, &first)).fold(f64::MIN_POSITIVE, f64::max);
        let apart = self.tip.iter().zip(&reference.tip).map(|(a, b)| distance(a, b)).fold(0.0, f64::max);
        let relative = |x: f64, y: f64, scale: f64| if x == y { 0.0 } else { (x - y).abs() / scale.abs() };
        [
            relative(self.displacement, reference.displacement, reference.displacement),
            apart / travel,
            relative(self.work, reference.work, reference.largest_work),
        ]
    }
}

/// A reference and its own relative errors.
pub struct Reference {
    pub result: Result3,
    pub errors: [f64; 3],
}

impl Reference {
    /// From runs of both methods with two steps each; `None` where one of them failed.
    pub fn of(trials: &[Trial]) -> Option<Self> {
        let [first, second, coarse, fine] = trials else { return None };
        if !trials.iter().all(|trial| trial.is_complete(MANNER)) {
            return None;
        }
        let [first, second, coarse, fine] = [first, second, coarse, fine].map(Result3::of);
        let other = Result3::extrapolated(&coarse, &fine, 4.0);
        let [own, others] = [first.errors(&second), other.errors(&second)];
        let errors = std::array::from_fn(|i| f64::max(own[i], others[i]));
        Some(Self { result: second, errors })
    }
}
