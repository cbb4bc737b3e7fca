//! Pareto front of two goals by the ε-constraint method (Haimes, Lasdon & Wismer, IEEE Trans. SMC 1, 1971). Each search halves the
//! widest gap so far, in the goal in which it is wider, and starts from one of its ends.

use std::ops::ControlFlow;

use serde::Serialize;

use super::checkpoint::Checkpoint;
use super::design_vector::DesignVector;
use super::objective::Objective;
use super::search::{Search, SearchIteration, SearchResult};
use super::table::{DesignTable, Floor};
use crate::error::Result;
use crate::sensitivity::Problem;

/// A gap is closed if the new design is closer to one of its ends than this fraction of it.
const CLOSED_GAP: f64 = 1e-3;

/// Objectives that differ by less than this fraction are equal.
const SAME_VALUE: f64 = 1e-6;

/// A design on the Pareto front.
#[derive(Debug, Clone, Serialize)]
pub struct ParetoPoint {
    /// Objective of the first goal.
    pub first: f64,
    /// Objective of the second goal.
    pub second: f64,
    /// The design.
    pub profile: DesignVector,
    /// True if its search converged.
    pub converged: bool,
    /// True if no other design of the front dominates it.
    pub best: bool,
}

impl ParetoPoint {
    /// True if it has the same objectives as `other`. If both ends of a front do, the goals do not conflict.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        are_same([self.first, self.second], [other.first, other.second])
    }
}

/// True if the objectives of two designs are the same.
fn are_same(one: [f64; 2], other: [f64; 2]) -> bool {
    one.iter().zip(other).all(|(a, b)| (a - b).abs() <= SAME_VALUE * a.abs().max(b.abs()))
}

/// The Pareto front from `found`, the optimum of the first goal, to the optimum of the second, and whether it was interrupted.
/// Empty if the table asks for none.
///
/// # Errors
/// Those of [`Search::run`].
pub(super) fn front(
    table: &DesignTable,
    objective: &Objective,
    found: &SearchResult,
    (problem, checkpoint): (impl Fn() -> Result<Problem>, &mut Checkpoint),
    mut tell: impl FnMut(Option<&SearchIteration>) -> ControlFlow<()>,
) -> Result<(Vec<ParetoPoint>, bool)> {
    let (Some(wanted), Some(other)) = (&table.front, table.second()) else { return Ok((Vec::new(), false)) };
    let second = Objective::new(&other, &problem()?, None)?.like(objective);
    second.check(&mut problem()?)?;
    let mut points = Vec::new();
    let mut add = |found: &SearchResult| -> Result<Option<[f64; 2]>> {
        let [a, b] = [objective, &second].map(|goal| goal.measure(&mut problem().ok()?, &found.profile));
        let both = a.zip(b).map(|(first, second)| [first, second]);
        if let Some([first, second]) = both {
            let (profile, converged) = (found.profile.clone(), found.converged);
            points.push(ParetoPoint { first, second, profile, converged, best: true });
        }
        Ok(both)
    };
    let from = add(found)?;
    let mut best = |table: &DesignTable, objective: &Objective, from: &[f64]| -> Result<SearchResult> {
        let mut search = Search::new(table, objective, problem()?);
        search.checkpoint = std::mem::take(checkpoint);
        let found = search.run_from(Some(from.to_vec()), &mut tell);
        *checkpoint = search.checkpoint;
        found
    };
    let end = best(&other, &second, &found.at.1)?;
    let to = add(&end)?;
    let mut interrupted = end.interrupted;
    let goals_conflict = |(from, to): &([f64; 2], [f64; 2])| !are_same(*from, *to);
    if let Some((from, to)) = from.zip(to).filter(|ends| !interrupted && goals_conflict(ends)) {
        // Gaps are measured relative to the range of the front in each goal. Halving a gap in the goal in which it is wider leaves
        // no wide part, however steep the front is.
        let spans = [0, 1].map(|i| (to[i] - from[i]).abs().max(f64::MIN_POSITIVE));
        let parts = |a: [f64; 2], b: [f64; 2]| [0, 1].map(|i| (b[i] - a[i]).abs() / spans[i]);
        let distance = |a: [f64; 2], b: [f64; 2]| {
            let [first, second] = parts(a, b);
            first.hypot(second)
        };
        let goals = [(table, objective), (&other, &second)];
        let mut along = vec![(from, found.at.1.clone(), true), (to, end.at.1.clone(), false)];
        for _ in 1..wanted.points - 1 {
            let gap = |i: &usize| distance(along[*i].0, along[*i + 1].0);
            let open = (0..along.len() - 1).filter(|i| along[*i].2);
            let Some(i) = open.max_by(|a, b| gap(a).total_cmp(&gap(b))) else { break };
            let width = gap(&i);
            // One goal is held half way between the ends while the other is optimised, from the end where the other is larger:
            // gradients are scaled by its size, which may be almost zero at the other end.
            let [a, b] = [along[i].0, along[i + 1].0];
            let [first, second] = parts(a, b);
            let held = usize::from(first <= second);
            let ((of, _), (searched, objective)) = (goals[held], goals[1 - held]);
            let (value, size) = (0.5 * (a[held] + b[held]), from[held].abs().max(to[held].abs()));
            let floor = Some(Floor { of: Box::new(of.clone()), value, size });
            let size_at = |end: [f64; 2]| end[1 - held].abs();
            let start = along[if size_at(a) < size_at(b) { i + 1 } else { i }].1.clone();
            let found = best(&DesignTable { floor, ..searched.clone() }, objective, &start)?;
            interrupted = found.interrupted;
            match add(&found)? {
                Some(value) => {
                    // A new design close to one of the ends closes the gap.
                    let open = [a, b].iter().all(|end| distance(value, *end) >= CLOSED_GAP * width);
                    along[i].2 = open;
                    along.insert(i + 1, (value, found.at.1.clone(), open));
                }
                None => along[i].2 = false,
            }
            if interrupted {
                break;
            }
        }
    }
    points.sort_by(|a, b| a.second.total_cmp(&b.second));
    let gain = |smaller: bool, a: f64, b: f64| if smaller { b - a } else { a - b };
    for i in 0..points.len() {
        let (one, two) = (points[i].first, points[i].second);
        points[i].best = points.iter().all(|other| {
            let first = gain(objective.smaller_is_better(), other.first, one) / one.abs();
            let second = gain(second.smaller_is_better(), other.second, two) / two.abs();
            first.min(second) < -SAME_VALUE || first.max(second) <= SAME_VALUE
        });
    }
    Ok((points, interrupted))
}
