//! `caudal study stability --vary load`: flutter and divergence of a held tail under its point loads, over the factor on the loads
//! and the damping of the material. Small damping may reduce the critical follower load of an undamped tail considerably.
//!
//! Source: H. Ziegler, Ingenieur-Archiv 20 (1952) 49–56.

use std::f64::consts::TAU;

use serde_json::json;

use super::rest_map::{MAX_NODES, RestMap, RestPoint, Scan, Scanned, calm_again_in_words, even, left_out};
use super::runner::{StudyOutcome, StudyRunner};
use super::stability::{StabilityOptions, geometric_sequence};
use crate::error::{Error, Result};
use crate::jobs;
use crate::linear_stability::SteadyState;
use crate::number_format::in_sentence;
use crate::report::Findings;
use crate::scene::{HeadKind, Scene};

/// Default range of the factor on the loads.
const DEFAULT_FACTORS: [f64; 2] = [0.1, 10.0];

/// Range of the damping time, in units of L²√(ρA/EI).
const DAMPING_RANGE: [f64; 2] = [1e-5, 1.0];

/// Factors of the tracked motions per factor of the map.
const TRACKING_REFINEMENT: usize = 4;

/// A scan over factors.
#[derive(Debug)]
struct LoadScan {
    /// True for the scene's own damping; otherwise the damping time of the scan's column is used.
    own: bool,
    scan: Scan,
}

/// Maps flutter and divergence of the tail of `scene` under its loads.
pub(super) fn column(scene: &Scene, asked: &StabilityOptions, runner: StudyRunner<'_>) -> Result<StudyOutcome> {
    let refused = |key: &str, problem: &str| Error::Scene {
        place: scene.name.clone(),
        key: key.to_string(),
        problem: problem.to_string(),
    };
    if scene.head.kind == HeadKind::Free {
        return Err(refused("head.kind", "the head is free, and loads accelerate the rod; allowed: a held head"));
    }
    if scene.loads.as_ref().is_none_or(|loads| loads.point.is_empty()) {
        return Err(refused("loads.point", "missing; there is no load to vary"));
    }
    let nodes = scene.rod.nodes.get();
    let coarse = if nodes > MAX_NODES { scene.with_nodes(MAX_NODES as u64) } else { scene.clone() };
    let model = coarse.model()?;
    let unit = model.rod.bending_time();
    // A damping profile is shown at its mean, since it has no position of its own in the map.
    let damping = model.rod.damping.as_ref();
    let uniform = damping.and_then(|damping| damping.uniform(&model.rod));
    let own_time = damping.map(|damping| uniform.unwrap_or(0.5 * damping.range(&model.rod).iter().sum::<f64>()));
    SteadyState::of(model).map_err(|error| refused(error.key, &error.problem))?;
    let range = asked.range.unwrap_or(DEFAULT_FACTORS);
    let factors = geometric_sequence(range, asked.points);
    let tracked = even(range, TRACKING_REFINEMENT * asked.points).collect();
    let times = geometric_sequence(DAMPING_RANGE.map(|share| share * unit), asked.points);
    let mut scans = vec![LoadScan { own: true, scan: Scan { place: own_time.unwrap_or(0.0), values: tracked } }];
    let with = |time: &f64| LoadScan { own: false, scan: Scan { place: *time, values: factors.clone() } };
    scans.extend(std::iter::once(&0.0).chain(&times).map(with));
    let run = |LoadScan { own, scan }: &LoadScan| {
        let damped = if *own { coarse.clone() } else { coarse.with_damping_time(scan.place) };
        Some(scan.run(|factor, near| RestPoint::of(&damped.with_point_loads(factor), near)))
    };
    let found = match runner.run_all("columns", scene, &scans, jobs::cores(), run)? {
        Ok(found) => found,
        Err(interrupted) => return Ok(interrupted),
    };
    let columns: Vec<(&Scan, &Scanned)> = scans.iter().map(|asked| &asked.scan).zip(&found).collect();
    let [own, undamped, map @ ..] = &columns[..] else { return Ok(StudyOutcome::Complete(Findings::default())) };
    let mut findings = Findings { subject: "stability under loads", ..Findings::default() };
    let [low, high] = range;
    let words = |of: &str, (scan, found): (&Scan, &Scanned)| match found.critical {
        Some(critical) if critical.value == 0.0 => {
            format!("{of} the tail is unstable at rest even without these loads.")
        }
        Some(critical) => format!(
            "{of} the tail is stable at rest under up to {:.4} times its point loads; {}.{}",
            critical.value,
            critical.in_words(),
            calm_again_in_words(&found.calm_again(&scan.values), " times them")
        ),
        None => format!("{of} the tail is stable at rest under {low} to {high} times its point loads."),
    };
    if own_time.is_some_and(|time| time > 0.0) {
        findings.answers.push(words("With the damping of its material", *own));
    }
    findings.answers.push(words("Without damping of its material", *undamped));
    let known = map.iter().filter_map(|(scan, found)| Some((scan.place, found.critical?)));
    let weakest = known.min_by(|a, b| a.1.value.total_cmp(&b.1.value));
    if let Some(((time, least), none)) = weakest.zip(undamped.1.critical)
        && least.value < 0.99 * none.value
    {
        findings.answers.push(format!(
            "With a damping time of {} s it is stable only up to {:.4} times these loads: damping lowers the limit by {:.0} %.",
            in_sentence(time, 4),
            least.value,
            100.0 * (1.0 - least.value / none.value)
        ));
    }
    left_out(scene, coarse.rod.nodes.get(), &mut findings);
    findings.numbers.insert("unit_time_s".into(), json!(unit));
    for (name, found) in [("", own.1), ("undamped_", undamped.1)] {
        let critical = found.critical;
        findings.numbers.insert(format!("{name}critical_factor"), json!(critical.map(|critical| critical.value)));
        let frequency = critical.map(|critical| critical.frequency / TAU);
        findings.numbers.insert(format!("{name}critical_frequency_hz"), json!(frequency));
    }
    let bears = undamped.1.critical.map(|critical| critical.value);
    let relative = |time: f64, _: f64| json!(time / unit);
    RestMap {
        name: &scene.name,
        cause: "load",
        place: ("damping time of the material (s)", "damping_time_s", false),
        value: ("factor on the point loads", "factor"),
        columns: map.to_vec(),
        own: *own,
        here: uniform.map(|time| (time, 1.0)),
        line: (
            "without damping of the material",
            bears.map_or(Vec::new(), |factor| times.iter().map(|time| (*time, factor)).collect()),
        ),
    }
    .add(&mut findings, [&[("damping_number", &relative)]; 2]);
    Ok(StudyOutcome::Complete(findings))
}
