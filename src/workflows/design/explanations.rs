//! The results of a design in sentences: what was identified or found, binding limits, the Pareto front, tolerances.

use super::design_vector::BASELINE;
use super::front::ParetoPoint;
use super::identify::{Identifiability, Identification, JointEstimate, MAX_RELATIVE_DEVIATION, identify};
use super::limits::LimitUse;
use super::markers::Markers;
use super::refit::Refit;
use super::scenarios::ScenarioResult;
use super::search::{EstimatedNumber, FEASIBILITY_TOLERANCE, SAME_OPTIMUM, SearchResult, WORST_SCENARIO};
use super::table::{DesignTable, Goal};
use super::tolerance::{MAX_REPORTED_TOLERANCE, Tolerance};
use crate::cycle::CycleAverages;
use crate::diagnostics::notes;
use crate::fluid::Fluid;
use crate::model::Dynamics;
use crate::number_format::{in_sentence, signed};
use crate::scene::Scene;
use crate::sensitivity::{JointDirection, Output, Parameter, Problem, Quantity};
use crate::stepper::Stepper;

/// Stiffness hardly matters if doubling it moves the tip by less than this fraction of the length.
const MIN_SENSITIVITY: f64 = 1e-2;

/// Maximum number of names in a sentence.
const MAX_LISTED: usize = 6;

/// Factor on the forces of the fluid, to find how the identified stiffness depends on them.
const MORE_FLUID: f64 = 1.05;

/// Stiffness depends on the fluid if its logarithm changes by more than this fraction of the change of the logarithm of the forces.
const FLUID_SHARE: f64 = 0.05;

pub(super) fn explain_identification(found: &Identification) -> Vec<String> {
    let count = |verdict: Identifiability| found.joints.iter().filter(|joint| joint.verdict == verdict).count();
    let all = found.joints.len();
    let unfit = match count(Identifiability::DoesNotFit) {
        0 => String::new(),
        some => format!("{some} that do not fit, "),
    };
    let mut lines = vec![format!(
        "{} of {all} joints identified, {} prior-driven, {} at a bound, {}{} unobservable; noise {} m, {} samples, \
         windows of {}",
        count(Identifiability::Identified),
        count(Identifiability::PriorDriven),
        count(Identifiability::AtABound),
        unfit,
        count(Identifiability::Unobservable),
        in_sentence(found.noise_m, 3),
        found.samples,
        2 * found.window_samples + 1,
    )];
    let kept = count(Identifiability::Unobservable);
    if kept > 0 {
        lines.push(format!(
            "the {kept} unobservable joints keep the stiffness of the scene in all tables and in the designed scene: the data do not determine it"
        ));
    }
    if found.joints.iter().all(|joint| joint.is_below_noise()) {
        lines.push(
            "stiffness cannot be identified from these data: the elastic bending of the rod is smaller than the noise of the positions"
                .to_string(),
        );
    }
    if let Some(gain) = found.actuation_gain {
        let edge = if found.gain_at_edge { ", at the limit of the search range: nothing is identified" } else { "" };
        lines.push(format!("the actuation is {gain:.5} times the scene's{edge}"));
    }
    lines.extend(found.left_out.iter().map(|what| format!("left out: {what}")));
    if let Some([x, y, moment]) = found.balances {
        lines.push(format!(
            "relative residuals of the balances without stiffness: force x {}, y {}, moment {}",
            in_sentence(x, 2),
            in_sentence(y, 2),
            in_sentence(moment, 2)
        ));
        if x.max(y).max(moment) > 0.2 {
            lines.push("warning: mass, drag or loads of the scene do not match the data".to_string());
        }
    }
    if !found.missing.is_empty() {
        let shown = found.missing.iter().take(10).cloned().collect::<Vec<_>>().join(", ");
        let more = found.missing.len().saturating_sub(10);
        lines.push(format!("left out: {shown}{}", if more > 0 { format!(" and {more} more") } else { String::new() }));
    }
    lines.extend(found.active.iter().map(|(name, dual)| format!("binding: {name} (dual {})", in_sentence(*dual, 4))));
    lines
}

/// The number of joints at which the moments do not balance, and the size of the imbalance.
pub(super) fn explain_misfit(found: &Identification) -> Option<String> {
    let unfit: Vec<&JointEstimate> =
        found.joints.iter().filter(|joint| joint.verdict == Identifiability::DoesNotFit).collect();
    let worst = unfit.iter().fold(0.0, |max: f64, joint| max.max(joint.residual_over_noise));
    (!unfit.is_empty()).then(|| {
        format!(
            "the moments at {} of {} joints do not balance: the residual is up to {worst:.1} times what noise explains, so mass, fluid, loads, drive or mesh of the scene do not match the data; the standard deviations include it",
            unfit.len(),
            found.joints.len()
        )
    })
}

/// A whole run of the scene's own or of a design, as `caudal run` makes it.
pub(super) struct WholeRun {
    /// The case of the sweep that it is of, or the point of the front.
    case: Option<String>,
    /// What the run itself notes.
    pub notes: Vec<String>,
    averages: CycleAverages,
}

impl WholeRun {
    /// The run of `scene`; `None` if it fails.
    pub fn of(case: Option<String>, scene: &Scene) -> Option<Self> {
        let mut stepper = Stepper::of(scene).ok()?;
        stepper.do_step(scene.solver.duration_s.get()).ok()?;
        let (metrics, step_control) = (stepper.metrics(), stepper.step_control());
        let notes = notes(scene, stepper.model(), metrics, &stepper.state().q, step_control, &[]);
        Some(Self { case, notes, averages: stepper.cycles().averages(stepper.view().dynamics) })
    }
}

/// The quantity that still differs most between the last whole cycles of `runs`, over which means are taken. `whose` is "its" for
/// runs of the design.
pub(super) fn explain_cycles(whose: &str, remedy: &str, runs: &[WholeRun]) -> Option<String> {
    let of = |WholeRun { case, averages, .. }: &WholeRun| {
        let place = case.as_ref().map_or(String::new(), |case| format!(" in {case}"));
        match averages.difference {
            Some(difference) if difference.is_periodic() => None,
            Some(difference) => Some((
                difference.relative,
                format!(
                    "{whose} motion is not periodic yet{place}: {difference} from cycle to cycle, and the means are taken over these cycles; {remedy}"
                ),
            )),
            None if averages.used == 0 => None,
            None => Some((
                f64::INFINITY,
                format!(
                    "{whose} means are taken over a single cycle{place}, which does not show whether the motion is periodic; {remedy}"
                ),
            )),
        }
    };
    runs.iter().filter_map(of).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, words)| words)
}

/// How much stiffness matters in the scene.
pub(super) fn explain_effect(scene: &Scene) -> Option<String> {
    let mut problem = Problem::of(scene).ok()?;
    let rod = &problem.model().rod;
    let (tip, length) = (rod.nodes - 1, rod.length);
    // The stiffness of all joints by the same factor.
    let along = JointDirection::of(rod, Parameter::Stiffness, rod.joints().start, &problem.stiffness());
    problem.directions = [along].into();
    let outputs = [0, 1].map(|axis| Output::from(Quantity::Position(tip, axis)));
    let found = problem.forward(&[Parameter::Along(0)], &outputs, 1, |_| {}).ok()?;
    let moved = |n: usize| found.row(n, 0)[0].hypot(found.row(n, 1)[0]);
    let moved = (0..found.times.len()).map(moved).fold(0.0, f64::max);
    let verdict = if moved < MIN_SENSITIVITY * length {
        "stiffness hardly affects the motion"
    } else {
        "stiffness affects the motion"
    };
    Some(format!("{verdict}: 1 % more stiffness moves the tip by at most {} m", in_sentence(0.01 * moved, 2)))
}

/// Explains how the identified stiffness depends on the forces of the fluid, if it does: the motion alone cannot distinguish them.
pub(super) fn explain_fluid_share(
    dynamics: &mut Dynamics,
    markers: &Markers,
    table: &DesignTable,
    found: &Identification,
) -> Option<String> {
    let own = dynamics.inputs.fluid;
    if dynamics.inputs.layers.is_some() {
        return None;
    }
    // All forces of a fluid grow with both by the same factor, at the same Reynolds number.
    dynamics.inputs.fluid = Fluid { viscosity: own.viscosity * MORE_FLUID, density: own.density * MORE_FLUID, ..own };
    let moved = identify(dynamics, markers, table);
    dynamics.inputs.fluid = own;
    let moved = moved.ok()?;
    let is_known = |joint: &JointEstimate| joint.verdict == Identifiability::Identified;
    let known = found.joints.iter().zip(&moved.joints).filter(|(own, moved)| is_known(own) && is_known(moved));
    let ratios: Vec<f64> = known.map(|(own, moved)| (moved.stiffness_n_m2 / own.stiffness_n_m2).ln()).collect();
    let exponent = ratios.iter().sum::<f64>() / ratios.len() as f64 / MORE_FLUID.ln();
    (exponent.abs() >= FLUID_SHARE).then(|| {
        format!(
            "stiffness depends on the fluid forces: if drag and added mass were 10 % larger, the identified stiffness would change by {:+.1} %; the standard deviations do not include such an error",
            100.0 * (exponent * 1.1_f64.ln()).exp_m1()
        )
    })
}

pub(super) fn explain_search(found: &SearchResult, table: &DesignTable) -> Vec<String> {
    let starts: Vec<String> = found.starts.iter().map(|value| in_sentence(*value, 7)).collect();
    let mut lines = vec![
        format!("{}: {}", table.goal.label(), in_sentence(found.objective, 7)),
        format!(
            "{} after {} iterations, stationarity {}; {} ended at {}",
            if found.interrupted {
                "interrupted, the best so far,"
            } else if found.converged {
                "converged"
            } else {
                "not converged"
            },
            found.history.len(),
            in_sentence(found.stationarity, 2),
            if starts.len() == 1 { "its only start".to_string() } else { format!("{} starts", starts.len()) },
            starts.join(", ")
        ),
    ];
    if !found.converged && !found.interrupted {
        lines.push(format!("the search ended: {}", found.why));
    }
    if found.starts.len() > 1 {
        let known = found.optima.iter().flatten();
        let (came, count) = (known.clone().count(), known.copied().max().unwrap_or(0));
        let optima = if count == 1 { "optimum" } else { "optima" };
        lines.push(format!(
            "{came} of {} starts converged, to {count} {optima} (two optima count as one if their objectives agree within {} % or their unknowns within {})",
            found.starts.len(),
            100.0 * SAME_OPTIMUM[0],
            SAME_OPTIMUM[1]
        ));
    }
    lines.extend(found.numbers.iter().map(explain_number));
    if let Some(noise) = found.noise_m {
        let whose = if table.noise_m.is_some() { "as given" } else { "estimated from the residuals" };
        let noise = in_sentence(noise, 3);
        lines.push(format!("the standard deviations assume an uncertainty of the positions of {noise} m, {whose}"));
    }
    if let Some(misfit) = found.misfit {
        lines.push(format!(
            "the simulation does not fit the data: the residual is {misfit:.1} times the noise of the markers, so start, drive, fluid, mass, loads, steps or mesh of the scene do not match the data; the standard deviations include it"
        ));
    }
    for names in &found.confused {
        lines.push(match &names[..] {
            [name] => format!("the data do not determine {name}"),
            several => {
                format!("the data cannot distinguish {}: they determine only a combination of them", listed(several))
            }
        });
    }
    lines.extend(found.limits.iter().map(|limit| format!("limit: {}: {}", limit.limit, limit.words())));
    lines.extend(found.active.iter().map(|(name, dual)| {
        if let Some(case) = name.strip_prefix(WORST_SCENARIO) {
            return format!("among the worst cases: {case} (weight {:.0} %)", 100.0 * dual);
        }
        let worth = if table.fits_positions() {
            format!("dual {}", in_sentence(*dual, 4))
        } else {
            // Unknowns are logarithms, and limits are relative; phases are angles.
            let unit = if name.starts_with("phase") { "0.01 rad" } else { "1 %" };
            format!("relaxing it by {unit} improves the objective by {dual:.3} %")
        };
        let own = found.limits.iter().find(|limit| limit.limit == *name);
        let when = own.map_or(String::new(), LimitUse::when);
        if own.is_some_and(|limit| limit.used > 1.0 + FEASIBILITY_TOLERANCE) {
            return format!("violated: {name}{when}");
        }
        if !found.kept {
            return format!("binding: {name}{when}"); // the price of a violated limit has no meaning
        }
        format!("binding: {name}{when} ({worth})")
    }));
    lines
}

/// Names as a list within a sentence; only the first ones of many.
fn listed(names: &[String]) -> String {
    match names {
        [] => String::new(),
        [name] => name.clone(),
        names if names.len() > MAX_LISTED => {
            format!("{} and {} others", names[..MAX_LISTED].join(", "), names.len() - MAX_LISTED)
        }
        [names @ .., last] => format!("{} and {last}", names.join(", ")),
    }
}

/// The objective of the design, `designed`, compared with that of the original scene, `before`: "0.2, 7.6 % better than the scene's own".
pub(super) fn beside_own(table: &DesignTable, designed: Option<f64>, before: Option<f64>) -> String {
    let Some(value) = designed else { return "fails".to_string() };
    let words = in_sentence(value, 7);
    let Some(before) = before else { return words };
    match table.gain_in_words(value, before, &format!(" than {BASELINE}")) {
        Some(gain) => format!("{words}, {gain}"),
        None if table.gain_percent(value, before).is_none() => {
            format!("{words}, {BASELINE} {}", in_sentence(before, 7))
        }
        None => words,
    }
}

/// The objective in each scenario.
pub(super) fn explain_scenarios(cases: &[ScenarioResult], table: &DesignTable) -> Vec<String> {
    let line = |ScenarioResult { case, designed, before, .. }: &ScenarioResult| {
        format!("in {case}: {}", beside_own(table, *designed, *before))
    };
    let aggregate = (!cases.is_empty()).then(|| {
        format!(
            "for {} cases of {}; the objective is their {}",
            cases.len(),
            table.over.as_deref().unwrap_or_default(),
            table.aggregate().words()
        )
    });
    aggregate.into_iter().chain(cases.iter().map(line)).collect()
}

/// A summary of the Pareto front.
pub(super) fn explain_front(front: &[ParetoPoint], table: &DesignTable) -> Option<String> {
    let [first, .., last] = front else { return None };
    let label = |table: &DesignTable| {
        let better = if table.smaller_is_better() { "smaller" } else { "larger" };
        let given = matches!(table.goal, Goal::Cycle(_)).then(|| format!(" ({better} is better)"));
        table.goal.label().to_owned() + &given.unwrap_or_default()
    };
    let [one, two] = [label(table), label(&table.second()?)];
    if first.is_like(last) {
        return Some(format!(
            "{one} and {two} do not conflict: one design is best in both, with {} and {}",
            in_sentence(first.first, 7),
            in_sentence(first.second, 7)
        ));
    }
    let best = front.iter().filter(|point| point.best).count();
    Some(format!(
        "Pareto front of {} designs, {best} of them not dominated by another: {two} from {} to {}, {one} from {} to {}",
        front.len(),
        in_sentence(first.second, 7),
        in_sentence(last.second, 7),
        in_sentence(first.first, 7),
        in_sentence(last.first, 7)
    ))
}

/// The tightest and the loosest tolerance.
pub(super) fn explain_tolerances(tolerances: &[Tolerance]) -> Option<String> {
    let change = |tolerance: &Tolerance| tolerance.change.unwrap_or(f64::INFINITY);
    if tolerances.iter().all(|tolerance| tolerance.change.is_none()) && !tolerances.is_empty() {
        return Some(format!(
            "changing any single unknown by up to a factor of {:.0} costs less than 1 % of the objective, limits ignored",
            MAX_REPORTED_TOLERANCE.exp()
        ));
    }
    let order = |a: &&Tolerance, b: &&Tolerance| change(a).total_cmp(&change(b));
    let [tight, loose] = [tolerances.iter().min_by(order)?, tolerances.iter().max_by(order)?];
    let words = |tolerance: &Tolerance| match tolerance.change {
        Some(change) if tolerance.name.starts_with("phase") => format!("{} {change:.3} rad", tolerance.name),
        Some(change) => format!("{} {:.1} %", tolerance.name, 100.0 * (change.exp() - 1.0)),
        None => format!("{} more than a factor of {:.0}", tolerance.name, MAX_REPORTED_TOLERANCE.exp()),
    };
    let loosest = if tolerances.len() > 1 { format!("; loosest {}", words(loose)) } else { String::new() };
    Some(format!("tolerance for a 1 % loss, one unknown at a time, limits ignored: tightest {}{loosest}", words(tight)))
}

/// How well a fit of positions determines the stiffness of joint `i`, which may be at a `bound`.
pub(super) fn joint_verdict(
    found: &SearchResult,
    table: &DesignTable,
    i: usize,
    bound: bool,
) -> Option<Identifiability> {
    let identifies = table.goal == Goal::Identify;
    let together = identifies && found.confused.iter().any(|group| group.len() > 1);
    Some(match found.deviations.get(i) {
        _ if bound => Identifiability::AtABound,
        Some(deviation) if together && *deviation > MAX_RELATIVE_DEVIATION => Identifiability::NotToldApart,
        Some(_) if identifies && !found.converged => Identifiability::NotConverged,
        Some(_) if found.misfit.is_some() => Identifiability::DoesNotFit,
        Some(deviation) if *deviation <= MAX_RELATIVE_DEVIATION => Identifiability::Identified,
        Some(_) if identifies => Identifiability::Unobservable,
        Some(_) => Identifiability::PriorDriven,
        None => return None,
    })
}

/// The number of joints that an identification by the whole motion determines; bounds are relative to `reference`, N m².
pub(super) fn explain_joints(found: &SearchResult, table: &DesignTable, reference: f64) -> Option<String> {
    let stiffness = &found.profile.stiffness_n_m2;
    if table.goal != Goal::Identify || stiffness.is_empty() {
        return None;
    }
    let at_bound = |ei: f64| table.bounds.iter().any(|bound| (ei / (bound * reference) - 1.0).abs() < 1e-6);
    let verdicts: Vec<Identifiability> =
        stiffness.iter().enumerate().filter_map(|(i, ei)| joint_verdict(found, table, i, at_bound(*ei))).collect();
    let count = |verdict: &Identifiability| verdicts.iter().filter(|other| *other == verdict).count();
    let identified = count(&Identifiability::Identified);
    let mut others: Vec<Identifiability> = Vec::new();
    for verdict in &verdicts {
        if *verdict != Identifiability::Identified && !others.contains(verdict) {
            others.push(*verdict);
        }
    }
    let words = |verdict: &Identifiability| match (verdict, count(verdict)) {
        (Identifiability::DoesNotFit, several) if several > 1 => "do not fit",
        _ => verdict.words(),
    };
    let others = others.iter().map(|verdict| format!(", {} {}", count(verdict), words(verdict)));
    Some(format!("stiffness: {identified} of {} joints identified{}", verdicts.len(), others.collect::<String>()))
}

/// An estimated number.
pub(super) fn explain_number(number: &EstimatedNumber) -> String {
    let EstimatedNumber { key, unit, own, value, deviation, discretisation, verdict } = number;
    let unit = if *unit == "1" { String::new() } else { format!(" {unit}") };
    let deviation = deviation.map_or(String::new(), |deviation| format!(" ± {}", in_sentence(deviation, 2)));
    let verdict = verdict.map_or(String::new(), |verdict| format!(", {}", verdict.words()));
    let moved = discretisation.filter(|moved| moved.abs() > 0.5 * number.deviation.unwrap_or(f64::INFINITY));
    let moved = moved.map_or(String::new(), |moved| {
        if moved.abs() > value.abs() {
            return "; the errors of mesh and time steps are larger than its value: the data hardly determine it".to_string();
        }
        let part = signed(100.0 * moved / value.abs(), 2);
        format!("; without errors of mesh and time steps it would change by {part} %, which the standard deviation includes: use more nodes or smaller steps")
    });
    let ratio = value / own;
    format!("{key}: {}{deviation}{unit}, {ratio:.5} times the scene's{verdict}{moved}", in_sentence(*value, 7))
}

/// A warning if the simulation does not fit the markers.
pub(super) fn explain_refit(refit: &Refit) -> Option<String> {
    (!refit.fits()).then(|| {
        format!(
            "simulated with the identified stiffness, the coordinates are {} m from the markers, {:.1} times what noise and steps of {} s explain: start, drive, fluid, mass, loads or mesh of the scene do not match the data; the standard deviations include it",
            in_sentence(refit.residual_m, 3),
            refit.residual_over_noise,
            in_sentence(refit.step_s, 7)
        )
    })
}
