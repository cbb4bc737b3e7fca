//! Limits of a design that are no bounds: of the body, of the load on its joints, and of a second goal.

use serde::{Deserialize, Serialize};

use super::search::Objective;
use super::table::{Goal, Table};
use super::unknowns::Profile;
use crate::cycle::{FORWARD_SPEED, Measure, THRUST};
use crate::error::{Error, Result};
use crate::model::Model;
use crate::rod::Shape;
use crate::sensitivity::{Output, Parameter, Problem, Quantity, Trajectory};

/// Steps of a search go along the norm of this order of all values instead of the largest of them, which has kinks. It is above that
/// by a few per cent, so that it is over its own value where a step begins that it limits the largest.
const ORDER: i32 = 100;

/// A load with a smaller logarithm over its limit is out of reach of a step, which is not told its derivatives.
const FAR: f64 = -0.5;

/// A share below this in a derivative is none.
const LEAST: f64 = 1e-14;

/// A limit, at a point of the search.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Limited {
    /// In words; what is limited together, one after the other, has the same.
    pub name: String,
    /// The logarithm of the value over the limit; the other way round where the value is to be large. It is to be 0 at most. In
    /// logarithms, as the unknowns are, mass, moments, thrust and power are nearly linear, and steps along a limit stay on it.
    pub excess: f64,
    /// What is between it and the smooth function that `by` is of: for steps from another point that of the point counts.
    pub rounding: f64,
    /// Its derivatives, by the parameters, later by the unknowns.
    pub by: Vec<f64>,
}

impl Limited {
    /// What it is beyond the limit for a step from where it is `from`.
    pub fn after(&self, from: &Self) -> f64 {
        self.excess + self.rounding - from.rounding
    }
}

/// Numbers the limits that `limits` are of.
pub(super) fn groups(limits: &[Limited]) -> Vec<usize> {
    let new = |i: usize| usize::from(i > 0 && limits[i].name != limits[i - 1].name);
    let count = |group: &mut usize, i: usize| {
        *group += new(i);
        Some(*group)
    };
    (0..limits.len()).scan(0, count).collect()
}

/// The sum over `groups` of what the largest of each, by `excess`, is beyond its limit.
pub(super) fn beyond(groups: &[usize], excess: impl Fn(usize) -> f64) -> f64 {
    let mut worst = vec![0.0_f64; groups.last().map_or(0, |last| last + 1)];
    groups.iter().enumerate().for_each(|(i, group)| worst[*group] = worst[*group].max(excess(i)));
    worst.iter().sum()
}

/// A limit in words, and how much of it is used.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Used {
    /// In words.
    pub limit: String,
    /// Value over the limit; of a value that is to be large the limit over the value.
    pub used: f64,
}

/// A limit of the body: in words, and value over the limit.
type OfBody = (String, Box<dyn Fn(&Model) -> f64 + Send>);

/// A limit of the load: in words, what is limited, to what, and whether its sign counts: what is below zero is no load then.
type OfLoad = (String, Vec<Output>, f64, bool);

/// A mean over the cycles, or a second goal: in words, what it has to reach, and its size where it may have any sign.
type OfMean = (String, Objective, f64, Option<f64>);

/// The limits of a search.
pub(super) struct Limits {
    body: Vec<OfBody>,
    load: Vec<OfLoad>,
    means: Vec<OfMean>,
}

impl Limits {
    /// Those of `table`.
    ///
    /// # Errors
    /// [`Error::Design`] where a mean over the cycles is limited that the scene has not.
    pub fn of(table: &Table, problem: &mut Problem, objective: &Objective) -> Result<Self> {
        let mut body: Vec<OfBody> = Vec::new();
        if let Some(most) = table.largest_mass_kg {
            body.push((format!("total mass at most {most} kg"), Box::new(move |model| model.rod.total_mass() / most)));
        }
        if table.neutral_buoyancy {
            // Mass over the mass of the fluid that it displaces, from both sides.
            let weight = |model: &Model| model.rod.total_mass() / (model.fluid.density * model.rod.displaced_volume());
            body.push(("no heavier than the fluid".into(), Box::new(weight)));
            body.push(("no lighter than the fluid".into(), Box::new(move |model| weight(model).recip())));
        }
        if let Some(least) = table.least_wall_m {
            let sections = &problem.model().rod.sections;
            let depths = sections.depth.iter().flat_map(crate::rod::Profile::places);
            let mut places: Vec<f64> = sections.outer.places().chain(sections.inner.places()).chain(depths).collect();
            places.sort_by(f64::total_cmp);
            places.dedup();
            for xi in places {
                // In the plane of motion, and across it where the wall is another there.
                for (axis, says) in ["", " across the plane"].into_iter().enumerate() {
                    if axis == 0 || sections.shape != Shape::Round {
                        let wall = move |model: &Model| least / model.rod.sections.at(xi).walls()[axis];
                        body.push((format!("wall{says} at least {least} m at xi = {xi}"), Box::new(wall)));
                    }
                }
            }
        }
        let joints = || problem.model().rod.joints();
        let mut load: Vec<OfLoad> = Vec::new();
        if let Some(most) = table.largest_moment_n_m {
            let all = joints().map(|k| Quantity::JointMoment(k).into()).collect();
            load.push((format!("moment in a joint at most {most} N m"), all, most, false));
        }
        if let Some(most) = table.largest_strain {
            let all = joints().map(|k| Quantity::JointStrain(k).into()).collect();
            load.push((format!("strain at most {most}"), all, most, false));
        }
        if let Some(most) = table.largest_power_w {
            load.push((
                format!("power of the actuation at most {most} W"),
                vec![Quantity::ActuationPower.into()],
                most,
                true, // what it takes back is none that it puts in
            ));
        }
        let mut means: Vec<OfMean> = Vec::new();
        let leasts: [(&str, Option<f64>, &Measure); 2] = [
            ("least_speed_m_s", table.least_speed_m_s, &FORWARD_SPEED),
            ("least_thrust_n", table.least_thrust_n, &THRUST),
        ];
        for (key, least, measure) in leasts {
            let Some(least) = least else { continue };
            let other = Table { better: None, direction: None, ..table.with_goal(Goal::Cycle(measure.key)) };
            let mean = Objective::new(&other, problem, None)?;
            mean.check(problem).map_err(|error| match error {
                Error::Design { reason } => {
                    Error::Design { reason: format!("design.{key} limits what is not: {reason}") }
                }
                other => other,
            })?;
            let words = format!("mean {} at least {least} {}", measure.words(), measure.unit);
            means.push((words, mean.like(objective), least, None));
        }
        if let (Some(other), Some([floor, size])) = (table.second(), table.floor) {
            let second = Objective::new(&other, problem, None)?.like(objective);
            let side = if second.smaller_is_better() { "at most" } else { "at least" };
            means.push((format!("{} {side} {floor:.6e}", second.name()), second, floor, Some(size)));
        }
        Ok(Self { body, load, means })
    }

    /// All of them at the point that `problem` was set to, a limit of several loads several times; none where a simulation fails.
    pub fn at(&self, problem: &mut Problem, profile: &Profile, parameters: &[Parameter]) -> Option<Vec<Limited>> {
        let mut all = Vec::new();
        for (name, used) in &self.body {
            let own = used(problem.model());
            let by = parameters.iter().map(|parameter| match parameter {
                Parameter::OfScene(i) => problem.moved[*i].by_model(used) / own,
                _ => 0.0,
            });
            let by = by.collect();
            all.push(Limited { name: name.clone(), excess: own.ln(), rounding: 0.0, by });
        }
        if !self.load.is_empty() {
            let mut trajectory = Trajectory::default();
            let outputs: Vec<Output> = self.load.iter().flat_map(|(_, outputs, ..)| outputs.iter().cloned()).collect();
            let found = problem.forward(&[], &outputs, 1, |state| trajectory.push(state)).ok()?;
            let loads = self.load.iter().flat_map(|load| load.1.iter().map(move |output| (load, output)));
            for (o, ((name, _, most, signed), output)) in loads.enumerate() {
                // Each joint and each way by itself: where the largest of all is another one there is a kink.
                for way in [1.0, -1.0].into_iter().take(if *signed { 1 } else { 2 }) {
                    let value = |n: usize| (way * found.value(n, o)).max(0.0);
                    let values: Vec<f64> = (0..found.times.len()).map(value).collect();
                    let largest = values.iter().fold(f64::MIN_POSITIVE, |max, x| max.max(*x));
                    let sum: f64 = values.iter().map(|x| (x / largest).powi(ORDER)).sum();
                    let norm = sum.powf(1.0 / f64::from(ORDER));
                    let excess = (largest / most).ln();
                    // What is far from the largest does not count, and costs nothing.
                    let weight = |x: &f64| {
                        let part = (x / largest / norm).powi(ORDER - 1);
                        if part < LEAST { 0.0 } else { way * part / (largest * norm) }
                    };
                    let by = if excess < FAR || parameters.is_empty() {
                        vec![0.0; parameters.len()]
                    } else {
                        let weights: Vec<f64> = values.iter().map(weight).collect();
                        problem.adjoint(parameters, std::slice::from_ref(output), &weights, &trajectory).ok()?
                    };
                    all.push(Limited { name: name.clone(), excess, rounding: norm.ln(), by });
                }
            }
        }
        for (name, objective, floor, size) in &self.means {
            let (value, by) = objective.derivatives(problem, profile, parameters)?;
            let (excess, slope) = match size {
                Some(size) if objective.smaller_is_better() => ((value - floor) / size, 1.0 / size),
                Some(size) => ((floor - value) / size, -1.0 / size),
                None => below(value / floor, 1.0 / floor),
            };
            let by = by.into_iter().map(|by| slope * by).collect();
            all.push(Limited { name: name.clone(), excess, rounding: 0.0, by });
        }
        all.iter().all(|limit| limit.excess.is_finite() && limit.by.iter().all(|x| x.is_finite())).then_some(all)
    }

    /// Leaves out what the motion is limited by, and keeps what the body is.
    pub fn leave_motion(&mut self) {
        self.load.clear();
        self.means.clear();
    }
}

/// −ln of the `part` of a limit that is reached, and its derivative where that of the part is `by`; linear from the tangent at a half on, as
/// thrust and speed may be backwards.
fn below(part: f64, by: f64) -> (f64, f64) {
    if part > 0.5 { (-part.ln(), -by / part) } else { (2f64.ln() + 1.0 - 2.0 * part, -2.0 * by) }
}
