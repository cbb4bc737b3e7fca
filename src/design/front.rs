//! Two goals at once: the front of designs on which neither can be better without loss of the other, by ε-constraint (Haimes,
//! Lasdon & Wismer, IEEE Trans. SMC 1, 1971), each search from the end of the one before.

use std::ops::ControlFlow;

use serde::Serialize;

use super::memory::Memory;
use super::search::{Found, Iteration, Objective, Search};
use super::table::Table;
use super::unknowns::Profile;
use crate::error::Result;
use crate::sensitivity::Problem;

/// A value that is worse by less than this part is as good.
const ALIKE: f64 = 1e-6;

/// A design of the front.
#[derive(Debug, Clone, Serialize)]
pub struct Compromise {
    /// The first goal's objective.
    pub first: f64,
    /// The second's.
    pub second: f64,
    /// What it is.
    pub profile: Profile,
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
    table: &Table,
    objective: &Objective,
    found: &Found,
    (problem, memory): (impl Fn() -> Result<Problem>, &mut Memory),
    mut tell: impl FnMut(&Iteration) -> ControlFlow<()>,
) -> Result<(Vec<Compromise>, bool)> {
    let (Some(wanted), Some(other)) = (&table.front, table.second()) else { return Ok((Vec::new(), false)) };
    let second = Objective::new(&other, &problem()?, None)?.like(objective);
    second.check(&mut problem()?)?;
    let mut points = Vec::new();
    let mut add = |found: &Found| -> Result<Option<f64>> {
        let [a, b] = [objective, &second].map(|goal| goal.measure(&mut problem().ok()?, &found.profile));
        if let Some((first, second)) = a.zip(b) {
            let (profile, converged) = (found.profile.clone(), found.converged);
            points.push(Compromise { first, second, profile, converged, best: true });
        }
        Ok(b)
    };
    let from = add(found)?;
    let mut best = |table: &Table, objective: &Objective, from: &[f64]| -> Result<Found> {
        let mut search = Search::new(table, objective, problem()?);
        search.memory = std::mem::take(memory);
        let found = search.run_from(Some(from.to_vec()), &mut tell);
        *memory = search.memory;
        found
    };
    let end = best(&other, &second, &found.at.1)?;
    let to = add(&end)?;
    let mut interrupted = end.interrupted;
    if let Some((from, to)) = from.zip(to).filter(|_| !interrupted) {
        let mut last = found.at.1.clone();
        for i in 1..wanted.points - 1 {
            let floor = from + (to - from) * i as f64 / (wanted.points - 1) as f64;
            let table = Table { floor: Some([floor, from.abs().max(to.abs())]), ..table.clone() };
            let found = best(&table, objective, &last)?;
            add(&found)?;
            interrupted = found.interrupted;
            if interrupted {
                break;
            }
            last = found.at.1.clone();
        }
    }
    points.sort_by(|a, b| a.second.total_cmp(&b.second));
    let gain = |smaller: bool, a: f64, b: f64| if smaller { b - a } else { a - b };
    for i in 0..points.len() {
        let (one, two) = (points[i].first, points[i].second);
        points[i].best = points.iter().all(|other| {
            let first = gain(objective.smaller_is_better(), other.first, one) / one.abs();
            let second = gain(second.smaller_is_better(), other.second, two) / two.abs();
            first.min(second) < -ALIKE || first.max(second) <= ALIKE
        });
    }
    Ok((points, interrupted))
}
