//! Limits of a design as inequality constraints: on the body (mass, buoyancy, wall), on the loads (moment, strain, power), on means
//! over cycles, and on a second goal.

use serde::{Deserialize, Deserializer, Serialize};

use super::design_vector::DesignVector;
use super::objective::Objective;
use super::table::{DesignTable, Floor, Goal};
use crate::cycle::{CycleMeasure, FORWARD_SPEED, THRUST};
use crate::error::{Error, Result};
use crate::model::Model;
use crate::number_format::significant;
use crate::rod::Shape;
use crate::sensitivity::{Output, Parameter, Problem, Quantity};

/// The two sides of neutral buoyancy, which is an equality.
pub const NEUTRAL_SIDES: [&str; 2] = ["no heavier than the fluid", "no lighter than the fluid"];

/// A load is constrained at each of its peaks in time, since its maximum would have a kink when another peak becomes the largest.
/// Each window of this many samples has one constraint for the even and one for the odd samples, so that none has a kink when a
/// peak moves to the next sample.
const PEAK_WINDOW: usize = 8;

/// Peaks whose logarithm, over the limit or over the largest value, is smaller than this are beyond the reach of one step.
const FAR_FROM_LIMIT: f64 = -0.5;

/// Index of a load without any such peak.
const NO_PEAK: usize = usize::MAX;

/// The value of a limit at a point of the search.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct LimitValue {
    /// Its name; the constraints of one limit, which follow each other, share it.
    pub name: String,
    /// Index of the load, and of its peak. A peak keeps its index at other points; it is missing there if it is far from the limit.
    pub of: [usize; 2],
    /// Logarithm of the value over the limit, or of the limit over the value for a lower limit: feasible if at most 0. In
    /// logarithms, like the unknowns, mass, moments, thrust and power are nearly linear, and steps along a limit stay on it.
    pub excess: f64,
    /// True for a lower limit, see [`below`].
    pub is_least: bool,
    /// The time (s) of the value of a load.
    #[serde(default)]
    pub at_s: Option<f64>,
    /// Derivatives with respect to the parameters, later to the unknowns.
    pub by: Vec<f64>,
}

impl LimitValue {
    /// The value over the limit, or the limit over the value for a lower limit: infinite if the value is not positive.
    pub fn used(&self) -> f64 {
        if self.is_least && self.excess > 2f64.ln() {
            return (0.5 * (2f64.ln() + 1.0 - self.excess)).max(0.0).recip();
        }
        self.excess.exp()
    }

    /// The same constraint among `others`, at another point.
    pub fn among<'a>(&self, others: &'a [Self]) -> Option<&'a Self> {
        others.iter().find(|other| other.of == self.of && other.name == self.name)
    }
}

/// Which constraints share a penalty: all of one limit, or those of each load.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PenaltyGroups {
    Together,
    Alone,
}

impl PenaltyGroups {
    /// The penalty index of each of `limits`.
    pub fn groups(self, limits: &[LimitValue]) -> Vec<usize> {
        let same = |[a, b]: [&LimitValue; 2]| a.name == b.name && (self == Self::Together || a.of[0] == b.of[0]);
        let new = |i: usize| usize::from(i > 0 && !same([&limits[i], &limits[i - 1]]));
        let count = |group: &mut usize, i: usize| {
            *group += new(i);
            Some(*group)
        };
        (0..limits.len()).scan(0, count).collect()
    }
}

/// The sum over `groups` of each group's largest violation.
pub(super) fn total_violation(groups: &[usize], excess: impl Fn(usize) -> f64) -> f64 {
    let mut worst = vec![0.0_f64; groups.last().map_or(0, |last| last + 1)];
    groups.iter().enumerate().for_each(|(i, group)| worst[*group] = worst[*group].max(excess(i)));
    worst.iter().sum()
}

/// The samples of `values` that are constrained, each with its index: the largest even and odd sample of each window with a peak
/// above `least`, and of the windows next to it, to which the peak may move. Without any peak, the largest sample.
fn peaks(values: &[f64], least: f64) -> Vec<(usize, usize)> {
    let largest = |samples: &mut dyn Iterator<Item = usize>| samples.max_by(|a, b| values[*a].total_cmp(&values[*b]));
    let stretches = values.len().div_ceil(PEAK_WINDOW);
    let inside = |w: usize| w * PEAK_WINDOW..((w + 1) * PEAK_WINDOW).min(values.len());
    let height = |w: usize| largest(&mut inside(w)).map_or(0.0, |n| values[n]);
    let heights: Vec<f64> = (0..stretches).map(height).collect();
    let is_peak = |w: usize| {
        let before = w == 0 || heights[w - 1] < heights[w];
        before && (w + 1 == stretches || heights[w + 1] <= heights[w]) && heights[w] > least
    };
    let near = |w: &usize| (w.saturating_sub(1)..=(w + 1).min(stretches - 1)).any(is_peak);
    let of = |w: usize| [0, 1].map(|odd| Some((2 * w + odd, largest(&mut inside(w).filter(|n| n % 2 == odd))?)));
    let mut found: Vec<(usize, usize)> = (0..stretches).filter(near).flat_map(of).flatten().collect();
    if found.is_empty() {
        found.extend(largest(&mut (0..values.len())).map(|n| (NO_PEAK, n)));
    }
    found
}

/// A limit and how much of it is used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LimitUse {
    /// A description of the limit.
    pub limit: String,
    /// The value over the limit, or the limit over the value for a lower limit: infinite if the value is not positive, `null` in JSON.
    #[serde(deserialize_with = "or_infinite")]
    pub used: f64,
    /// Time of the largest load, s from the beginning of the run; `None` for any other limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_s: Option<f64>,
}

fn or_infinite<'de, D: Deserializer<'de>>(deserializer: D) -> std::result::Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}

impl LimitUse {
    /// The use of each limit among `limits`, in their order.
    pub(super) fn of(limits: &[LimitValue]) -> Vec<Self> {
        limits.iter().fold(Vec::new(), |mut all: Vec<Self>, limit| {
            let own = Self { limit: limit.name.clone(), used: limit.used(), at_s: limit.at_s };
            match all.iter_mut().find(|other| other.limit == own.limit) {
                Some(other) if own.used > other.used => *other = own,
                Some(_) => {}
                None => all.push(own),
            }
            all
        })
    }

    /// The most used limit of `all`.
    pub(super) fn most(all: impl IntoIterator<Item = Self>) -> Option<Self> {
        all.into_iter().max_by(|a, b| a.used.total_cmp(&b.used))
    }

    /// Describes how much of the limit is used.
    pub(super) fn words(&self) -> String {
        match self.used {
            f64::INFINITY => "0 % of it is reached".to_string(),
            used if self.limit.contains(" at least ") => format!("{:.2} % of it is reached", 100.0 / used),
            used => format!("{:.2} % of it{}", 100.0 * used, self.when()),
        }
    }

    /// Describes when a load is largest; empty for any other limit.
    pub(super) fn when(&self) -> String {
        self.at_s.map_or(String::new(), |time| format!(" at t = {} s", significant(time, 4)))
    }

    /// Its description if it is exceeded by more than the relative `tolerance`.
    pub(super) fn broken(&self, tolerance: f64) -> Option<String> {
        (self.used > 1.0 + tolerance).then(|| format!("{}, {}", self.limit, self.words()))
    }
}

/// A limit on the body: description, and value over the limit.
type BodyLimit = (String, Box<dyn Fn(&Model) -> f64 + Send>);

/// A limit on a load: description, outputs, limit, and whether only positive values count.
type LoadLimit = (String, Vec<Output>, f64, bool);

/// A mean over cycles or a second goal: description, objective, limit, and its scale if it may have any sign.
type MeanLimit = (String, Objective, f64, Option<f64>);

/// The limits of a search.
pub(super) struct Limits {
    body: Vec<BodyLimit>,
    load: Vec<LoadLimit>,
    means: Vec<MeanLimit>,
}

impl Limits {
    /// The limits of `table`.
    ///
    /// # Errors
    /// [`Error::Design`] if a mean over cycles is limited that the scene does not have.
    pub fn of(table: &DesignTable, problem: &mut Problem, objective: &Objective) -> Result<Self> {
        let mut body: Vec<BodyLimit> = Vec::new();
        if let Some(most) = table.largest_mass_kg {
            body.push((format!("total mass at most {most} kg"), Box::new(move |model| model.rod.total_mass() / most)));
        }
        if table.neutral_buoyancy {
            // Mass over the mass of the fluid that it displaces, from both sides.
            let weight = |model: &Model| model.rod.total_mass() / (model.fluid.density * model.rod.displaced_volume());
            let [heavier, lighter] = NEUTRAL_SIDES.map(String::from);
            body.push((heavier, Box::new(weight)));
            body.push((lighter, Box::new(move |model| weight(model).recip())));
        }
        if let Some(least) = table.least_wall_m {
            let sections = &problem.model().rod.sections;
            let depths = sections.depth.iter().flat_map(crate::rod::Profile::places);
            let mut places: Vec<f64> = sections.outer.places().chain(sections.inner.places()).chain(depths).collect();
            places.sort_by(f64::total_cmp);
            places.dedup();
            for xi in places {
                // In the plane of motion, and across it if the wall thickness differs there.
                for (axis, says) in ["", " across the plane"].into_iter().enumerate() {
                    if axis == 0 || sections.shape != Shape::Round {
                        let wall = move |model: &Model| least / model.rod.sections.at(xi).walls()[axis];
                        body.push((format!("wall{says} at least {least} m at xi = {xi}"), Box::new(wall)));
                    }
                }
            }
        }
        let joints = || problem.model().rod.joints();
        let mut load: Vec<LoadLimit> = Vec::new();
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
                true, // returned power does not count
            ));
        }
        let mut means: Vec<MeanLimit> = Vec::new();
        let leasts: [(&str, Option<f64>, &CycleMeasure); 2] = [
            ("least_speed_m_s", table.least_speed_m_s, &FORWARD_SPEED),
            ("least_thrust_n", table.least_thrust_n, &THRUST),
        ];
        for (key, least, measure) in leasts {
            let Some(least) = least else { continue };
            let other = DesignTable { better: None, direction: None, ..table.with_goal(Goal::Cycle(measure.key)) };
            let mean = Objective::new(&other, problem, None)?;
            mean.check(problem).map_err(|error| match error {
                Error::Design { reason } => Error::Design {
                    reason: format!("design.{key} limits a quantity that this scene does not have: {reason}"),
                },
                other => other,
            })?;
            let words = format!("mean {} at least {least} {}", measure.label(), measure.unit);
            means.push((words, mean.like(objective), least, None));
        }
        if let Some(Floor { of, value, size }) = &table.floor {
            let other = Objective::new(of, problem, None)?.like(objective);
            let side = if other.smaller_is_better() { "at most" } else { "at least" };
            means.push((format!("{} {side} {}", other.name(), significant(*value, 7)), other, *value, Some(*size)));
        }
        Ok(Self { body, load, means })
    }

    /// True if there are none.
    pub fn are_none(&self) -> bool {
        self.body.is_empty() && !self.are_simulated()
    }

    /// True if any of them needs a simulation.
    pub fn are_simulated(&self) -> bool {
        !self.load.is_empty() || !self.means.is_empty()
    }

    /// The values of all limits at the current point of `problem`; a limit on several loads has several values. `None` if a
    /// simulation fails.
    pub fn at(
        &self,
        problem: &mut Problem,
        profile: &DesignVector,
        parameters: &[Parameter],
    ) -> Option<Vec<LimitValue>> {
        let mut all = Vec::new();
        for (name, used) in &self.body {
            let own = used(problem.model());
            let by = parameters.iter().map(|parameter| match parameter {
                Parameter::OfScene(i) => problem.finite_differences[*i].of_model(used) / own,
                _ => 0.0,
            });
            let by = by.collect();
            all.push(LimitValue { name: name.clone(), of: [0, 0], excess: own.ln(), is_least: false, at_s: None, by });
        }
        self.add_loads(problem, parameters, &mut all)?;
        for (name, objective, floor, size) in &self.means {
            let (value, by) = objective.derivatives(problem, profile, parameters)?;
            let (excess, slope) = match size {
                Some(size) if objective.smaller_is_better() => ((value - floor) / size, 1.0 / size),
                Some(size) => ((floor - value) / size, -1.0 / size),
                None => below(value / floor, 1.0 / floor),
            };
            let by = by.into_iter().map(|by| slope * by).collect();
            all.push(LimitValue { name: name.clone(), of: [0, 0], excess, is_least: size.is_none(), at_s: None, by });
        }
        all.iter().all(|limit| limit.excess.is_finite() && limit.by.iter().all(|x| x.is_finite())).then_some(all)
    }

    /// Adds the peaks of all loads at the current point of `problem`.
    fn add_loads(&self, problem: &mut Problem, parameters: &[Parameter], all: &mut Vec<LimitValue>) -> Option<()> {
        let outputs: Vec<Output> = self.load.iter().flat_map(|(_, outputs, ..)| outputs.iter().cloned()).collect();
        if outputs.is_empty() {
            return Some(());
        }
        let found = problem.forward(&[], &outputs, 1, |_| {}).ok()?;
        // Constrained samples: output, sample, sign, and index in the whole list.
        let mut near: Vec<(usize, usize, f64, usize)> = Vec::new();
        let mut first = 0;
        for (name, of_limit, most, signed) in &self.load {
            let own = first..first + of_limit.len();
            first = own.end;
            let ways: &[f64] = if *signed { &[1.0] } else { &[1.0, -1.0] };
            let loads = own.flat_map(|o| ways.iter().map(move |way| (o, *way)));
            let series = |(o, way): (usize, f64)| {
                let value = |n: usize| (way * found.value(n, o)).max(f64::MIN_POSITIVE) / most;
                (o, way, (0..found.times.len()).map(value).collect::<Vec<f64>>())
            };
            let loads: Vec<(usize, f64, Vec<f64>)> = loads.map(series).collect();
            let largest = loads.iter().flat_map(|load| &load.2).fold(1.0, |max: f64, x| max.max(*x));
            let least = largest * FAR_FROM_LIMIT.exp();
            for (load, (o, way, values)) in loads.iter().enumerate() {
                for (peak, n) in peaks(values, least) {
                    if values[n] > least {
                        near.push((*o, n, way / (most * values[n]), all.len()));
                    }
                    let by = vec![0.0; parameters.len()];
                    let (name, excess, at_s) = (name.clone(), values[n].ln(), Some(found.times[n]));
                    all.push(LimitValue { name, of: [load, peak], excess, is_least: false, at_s, by });
                }
            }
        }
        if !parameters.is_empty() && !near.is_empty() {
            let mut wanted: Vec<usize> = near.iter().map(|(o, ..)| *o).collect();
            wanted.dedup();
            let some: Vec<Output> = wanted.iter().map(|o| outputs[*o].clone()).collect();
            let found = problem.forward(parameters, &some, 1, |_| {}).ok()?;
            for (o, n, slope, at) in near {
                let row = found.row(n, wanted.partition_point(|other| *other < o));
                all[at].by = row.iter().map(|by| slope * by).collect();
            }
        }
        Some(())
    }

    /// Removes the limits on the motion and keeps those on the body.
    pub fn keep_body_only(&mut self) {
        self.load.clear();
        self.means.clear();
    }
}

/// −ln of the fraction `part` of a lower limit that is reached, with its derivative for a derivative `by` of the fraction. Linear
/// below one half, since thrust and speed may be negative.
fn below(part: f64, by: f64) -> (f64, f64) {
    if part > 0.5 { (-part.ln(), -by / part) } else { (2f64.ln() + 1.0 - 2.0 * part, -2.0 * by) }
}
