//! Two goals at once: the front of designs on which neither can be better without loss of the other, by ε-constraint (Haimes,
//! Lasdon & Wismer, IEEE Trans. SMC 1, 1971), each search from the end of the one before.

use std::ops::ControlFlow;

use serde::Serialize;

use super::checkpoint::Checkpoint;
use super::design_vector::DesignVector;
use super::objective::Objective;
use super::search::{Search, SearchIteration, SearchResult};
use super::table::DesignTable;
use crate::error::Result;
use crate::sensitivity::Problem;

/// A design that is nearer to an end of a gap than this part of it has closed it.
const CLOSED_GAP: f64 = 1e-3;

/// A value that is worse by less than this part is as good.
const SAME_VALUE: f64 = 1e-6;

/// A design of the front.
#[derive(Debug, Clone, Serialize)]
pub struct ParetoPoint {
    /// The first goal's objective.
    pub first: f64,
    /// The second's.
    pub second: f64,
    /// What it is.
    pub profile: DesignVector,
    /// True where its search converged.
    pub converged: bool,
    /// True where no other design of the front is better in one goal and no worse in the other.
    pub best: bool,
}

/// The front from `found`, which is best for the first goal, to what is best for the second, and whether it was stopped; empty
/// where the table asks for none.
///
/// # Errors
/// Those of [`Search::run`].
pub(super) fn front(
    table: &DesignTable,
    objective: &Objective,
    found: &SearchResult,
    (problem, checkpoint): (impl Fn() -> Result<Problem>, &mut Checkpoint),
    mut tell: impl FnMut(&SearchIteration) -> ControlFlow<()>,
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
    if let Some((from, to)) = from.zip(to).filter(|_| !interrupted) {
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
