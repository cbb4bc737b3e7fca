//! Pareto front of two goals by the ε-constraint method (Haimes, Lasdon & Wismer, IEEE Trans. SMC 1, 1971). Each search starts from
//! the end of the previous one.

use std::ops::ControlFlow;

use serde::Serialize;

use super::checkpoint::Checkpoint;
use super::design_vector::DesignVector;
use super::objective::Objective;
use super::search::{Search, SearchIteration, SearchResult};
use super::table::DesignTable;
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
    /// True if it has the same objectives as `other`: where both ends of a front do, the goals do not conflict.
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
        // Each search splits the widest gap, measured in both goals over what they span, so that steep ends have designs too.
        let spans = [0, 1].map(|i| (to[i] - from[i]).abs().max(f64::MIN_POSITIVE));
        let size = from[1].abs().max(to[1].abs());
        let mut along = vec![(from, found.at.1.clone(), true), (to, end.at.1.clone(), false)];
        for _ in 1..wanted.points - 1 {
            let gap = |i: &usize| {
                let [a, b] = [along[*i].0, along[*i + 1].0];
                ((b[0] - a[0]) / spans[0]).hypot((b[1] - a[1]) / spans[1])
            };
            let open = (0..along.len() - 1).filter(|i| along[*i].2);
            let Some(i) = open.max_by(|a, b| gap(a).total_cmp(&gap(b))) else { break };
            let width = gap(&i);
            let floor = 0.5 * (along[i].0[1] + along[i + 1].0[1]);
            let table = DesignTable { floor: Some([floor, size]), ..table.clone() };
            let found = best(&table, objective, &along[i].1.clone())?;
            interrupted = found.interrupted;
            match add(&found)? {
                Some(value) => {
                    let near = |other: [f64; 2]| {
                        ((value[0] - other[0]) / spans[0]).hypot((value[1] - other[1]) / spans[1]) < CLOSED_GAP * width
                    };
                    // Where it comes to one of the ends there is nothing in between.
                    let open = !near(along[i].0) && !near(along[i + 1].0);
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
