//! `caudal study stability`: for each method, a map of outcomes over the time step and a parameter of the scene. For stability over
//! the speed of a flow, see [`flutter`](super::flutter).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::runner::{StudyOutcome, StudyRunner};
use super::study_run::{Failure, RunOptions, SimulationMethod, StudyRun};
use crate::error::{Error, Result};
use crate::integrator::StepControl;
use crate::jobs;
use crate::modes::{Modes, StableSteps};
use crate::number_format::in_sentence;
use crate::report::Figure;
use crate::report::outcome_map::{Category, OutcomeMap, Panel};
use crate::report::{Findings, Table};
use crate::scene::{HeadKind, NODES, Scene};

/// Samples of tip and energy per run.
const SAMPLES: usize = 200;
/// The theoretical stability limit is computed up to this many nodes.
const MAX_NODES_FOR_MODES: u64 = 401;
/// The references use this fraction of the smallest step of the map.
const REFERENCE_STEP: f64 = 0.5;
/// A method creates energy if the defect of the energy balance exceeds this fraction of the largest energy or work at the end of
/// the run, and grew by this factor in its second half.
const MAX_BALANCE_DEFECT: f64 = 0.2;
const MIN_ENERGY_GROWTH: f64 = 2.0;

/// The parameter that varies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Vary {
    /// Young's modulus.
    Modulus,
    /// The amplitude of the actuation.
    Amplitude,
    /// The number of nodes.
    Nodes,
    /// The initial spin of a free rod.
    Spin,
    /// The damping time of the material.
    Damping,
    /// The speed of the flow and the mass ratio of the rod: stability of the rod itself, for any method.
    Flow,
    /// The size of the point loads and the damping time of the material: stability of the rod itself, for any method.
    Load,
}

impl Vary {
    /// All parameters, with their names.
    pub const ALL: [(&str, Self); 7] = [
        ("modulus", Self::Modulus),
        ("amplitude", Self::Amplitude),
        ("nodes", Self::Nodes),
        ("spin", Self::Spin),
        ("damping", Self::Damping),
        ("flow", Self::Flow),
        ("load", Self::Load),
    ];

    /// True if the study analyses small motions of the rod itself, without runs.
    pub fn is_of_rest(self) -> bool {
        matches!(self, Self::Flow | Self::Load)
    }

    fn label(self, scene: &Scene) -> &'static str {
        match self {
            Self::Modulus => "Young's modulus (Pa)",
            Self::Amplitude if scene.has_active_moments() => "amplitude of the actuation (N m)",
            Self::Amplitude => "amplitude of the actuation (1/m)",
            Self::Nodes => "number of nodes",
            Self::Spin => "spin at the start (rad/s)",
            Self::Damping => "damping time of the material (s)",
            Self::Flow => "flow speed (m/s)",
            Self::Load => "factor on the point loads",
        }
    }

    /// The default range.
    fn range(self, scene: &Scene) -> [f64; 2] {
        let nodes = scene.rod.nodes.get() as f64;
        let modulus = scene.rod.youngs_modulus();
        match self {
            Self::Modulus => [1e-4 * modulus, modulus],
            Self::Amplitude => {
                let amplitude = scene.actuation.as_ref().map_or(1.0, |actuation| actuation.amplitude().abs());
                [0.25 * amplitude, 4.0 * amplitude]
            }
            Self::Nodes => [nodes, 8.0 * (nodes - 1.0) + 1.0],
            Self::Damping => {
                let rod = scene.rod_on(scene.rod.nodes.get());
                [1e-4, 1.0].map(|share| share * rod.bending_time())
            }
            Self::Load => [0.1, 10.0],
            Self::Spin | Self::Flow => [1.0, 100.0],
        }
    }

    /// The reason why it cannot vary in `scene`, if any.
    fn refused(self, scene: &Scene) -> Option<(&'static str, &'static str)> {
        let actuation = scene.actuation.as_ref();
        match self {
            Self::Amplitude if scene.actuation.is_none() => {
                Some(("actuation", "missing; there is no amplitude to vary"))
            }
            Self::Amplitude => actuation
                .filter(|actuation| actuation.amplitude() == 0.0)
                .map(|actuation| (actuation.amplitude_key(), "0; an amplitude of zero has no multiples to vary over")),
            Self::Spin if scene.head.kind != HeadKind::Free => {
                Some(("head.kind", "the head is held; only a free rod can spin"))
            }
            _ => None,
        }
    }

    fn set(self, scene: &Scene, value: f64) -> Scene {
        match self {
            Self::Modulus => {
                let factor = value / scene.rod.youngs_modulus();
                // The moments are scaled to bend the rod as far as before.
                let scene = scene.with_modulus(factor);
                if scene.has_active_moments() { scene.with_amplitude(factor) } else { scene }
            }
            Self::Amplitude => scene.with_amplitude(value / scene.actuation.as_ref().map_or(1.0, |a| a.amplitude())),
            Self::Nodes => scene.with_nodes(value as u64),
            Self::Spin => scene.with_spin(value),
            Self::Damping => scene.with_damping_time(value),
            Self::Flow => scene.with_flow([value, 0.0]),
            Self::Load => scene.with_point_loads(value),
        }
    }
}

/// Options of the study.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StabilityOptions {
    /// The parameter that varies.
    pub vary: Vary,
    /// Range of the parameter; `None` to derive it from the scene's value.
    pub range: Option<[f64; 2]>,
    /// Range of steps, s; `None` for a hundredth to four times the scene's.
    pub steps: Option<[f64; 2]>,
    /// Number of values and of steps.
    pub points: usize,
    /// Largest error of the tip's path, relative to its extent, at which a run counts as accurate.
    pub accurate: f64,
}

impl Default for StabilityOptions {
    /// Varies Young's modulus, with twelve values up to the scene's own and twelve steps around its step.
    fn default() -> Self {
        Self { vary: Vary::Modulus, range: None, steps: None, points: 12, accurate: 0.05 }
    }
}

/// The outcome of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum StabilityOutcome {
    Accurate,
    Wrong,
    Unjudged,
    /// Nothing moves, so that nothing is tested.
    Still,
    Growing,
    Newton,
    Fold,
}

impl StabilityOutcome {
    const ALL: [Self; 7] =
        [Self::Accurate, Self::Wrong, Self::Unjudged, Self::Still, Self::Growing, Self::Newton, Self::Fold];

    fn category(self) -> Category {
        // With different lightness, so that they can be distinguished in greyscale prints, too, and none as dark as a dark page.
        let (label, colour) = match self {
            Self::Accurate => ("accurate", [20, 172, 125]),
            Self::Wrong => ("stable but wrong", [252, 236, 110]),
            Self::Unjudged => ("stable, no reference", [192, 192, 192]),
            Self::Still => ("does not move", [120, 150, 205]),
            Self::Growing => ("growing energy", [185, 45, 10]),
            Self::Newton => ("Newton failed", [60, 60, 60]),
            Self::Fold => ("fold-over", [212, 126, 168]),
        };
        Category { label, colour, hatched: matches!(self, Self::Newton | Self::Still) }
    }

    fn of(run: &StudyRun, reference: Option<&StudyRun>, accurate: f64) -> Self {
        if grows(run) {
            return Self::Growing;
        }
        match &run.failure {
            Some((Failure::Fold, ..)) => return Self::Fold,
            Some(_) => return Self::Newton,
            None => {}
        }
        match reference {
            Some(reference) if !(reference.moves() || run.moves()) => Self::Still,
            None => Self::Unjudged,
            Some(reference) if relative_tip_distance(run, reference) <= accurate => Self::Accurate,
            Some(_) => Self::Wrong,
        }
    }
}

/// True if the method creates energy: the run was aborted or failed because of it, or the energy still grows at the end.
fn grows(run: &StudyRun) -> bool {
    let largest = |part: &[f64]| part.iter().copied().fold(0.0, f64::max);
    let (middle, last) = (run.created.len() / 2, run.created.len() * 3 / 4);
    if run.failure.is_some() || run.tip.len() <= SAMPLES {
        return largest(&run.created) > 1.0;
    }
    let (early, end) = (largest(&run.created[..middle]), largest(&run.created[last..]));
    end > MAX_BALANCE_DEFECT && end > MIN_ENERGY_GROWTH * early
}

/// Largest distance between two tip paths over the extent of the second.
fn relative_tip_distance(run: &StudyRun, reference: &StudyRun) -> f64 {
    let distance = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    run.tip.iter().zip(&reference.tip).map(|(a, b)| distance(a, b)).fold(0.0, f64::max) / reference.travel()
}

#[derive(Debug)]
struct MapRun {
    simulation: SimulationMethod,
    value: f64,
    step: f64,
    halving: bool,
}

/// A geometric sequence of `count` values from `low` to `high`.
pub(super) fn geometric_sequence([low, high]: [f64; 2], count: usize) -> Vec<f64> {
    let last = count.max(2) - 1;
    (0..=last).map(|i| low * (high / low).powf(i as f64 / last as f64)).collect()
}

/// Maps the stability of each method on `scene`.
///
/// # Errors
/// [`Error::Scene`] if the scene lacks the parameter that varies; those of [`Scene::model`], [`Error::Write`], [`Error::Journal`].
pub(super) fn stability(scene: &Scene, asked: &StabilityOptions, runner: StudyRunner<'_>) -> Result<StudyOutcome> {
    if let Some((key, problem)) = asked.vary.refused(scene) {
        return Err(Error::Scene { place: scene.name.clone(), key: key.into(), problem: problem.into() });
    }
    let mut values = geometric_sequence(asked.range.unwrap_or_else(|| asked.vary.range(scene)), asked.points);
    if asked.vary == Vary::Nodes {
        values.iter_mut().for_each(|value| *value = value.round().clamp(NODES[0] as f64, NODES[1] as f64));
        values.dedup();
    }
    let typical = scene.typical_step();
    let steps = geometric_sequence(asked.steps.unwrap_or([0.01 * typical, 4.0 * typical]), asked.points);
    let simulations = SimulationMethod::all(scene);
    let references: Vec<_> = ["esdirk3", "generalized-alpha"].into_iter().filter_map(SimulationMethod::named).collect();
    let finest = REFERENCE_STEP * steps.first().copied().unwrap_or(typical);
    let mut cases = Vec::new();
    for value in &values {
        let reference = |simulation: &SimulationMethod| MapRun {
            simulation: simulation.clone(),
            value: *value,
            step: finest,
            halving: true,
        };
        cases.extend(references.iter().map(reference));
    }
    for simulation in &simulations {
        for value in &values {
            let case =
                |step: &f64| MapRun { simulation: simulation.clone(), value: *value, step: *step, halving: false };
            cases.extend(steps.iter().map(case));
        }
    }
    let run = |case: &MapRun| {
        let scene =
            case.simulation.of(&asked.vary.set(scene, case.value)).with_step_control(StepControl::Fixed(case.step));
        let options = RunOptions { samples: SAMPLES, push: None, halving: case.halving, timed: false };
        StudyRun::of(&scene, options, runner.interrupted)
    };
    let runs = match runner.run_all("runs", scene, &cases, jobs::cores(), run)? {
        Ok(runs) => runs,
        Err(interrupted) => return Ok(interrupted),
    };
    let (pairs, runs) = runs.split_at(references.len() * values.len());
    let references: Vec<_> = pairs
        .chunks(references.len())
        .map(|pair| match pair {
            [a, b]
                if a.tip.len() > SAMPLES
                    && b.tip.len() > SAMPLES
                    && relative_tip_distance(a, b) <= 0.5 * asked.accurate =>
            {
                Some(a)
            }
            _ => None,
        })
        .collect();
    let outcomes: Vec<_> = runs
        .iter()
        .enumerate()
        .map(|(i, run)| StabilityOutcome::of(run, references[i / steps.len() % values.len()], asked.accurate))
        .collect();
    let cases = &cases[pairs.len()..];
    let report = StabilityReport {
        scene,
        asked,
        values: &values,
        steps: &steps,
        simulations: &simulations,
        cases,
        runs,
        outcomes: &outcomes,
    };
    Ok(StudyOutcome::Complete(report.findings()?))
}

struct StabilityReport<'a> {
    scene: &'a Scene,
    asked: &'a StabilityOptions,
    values: &'a [f64],
    steps: &'a [f64],
    simulations: &'a [SimulationMethod],
    cases: &'a [MapRun],
    runs: &'a [StudyRun],
    outcomes: &'a [StabilityOutcome],
}

impl StabilityReport<'_> {
    /// The outcomes of a method: for each value, one per step.
    fn of(&self, simulation: usize) -> impl Iterator<Item = &[StabilityOutcome]> {
        let cells = self.values.len() * self.steps.len();
        self.outcomes[simulation * cells..(simulation + 1) * cells].chunks(self.steps.len())
    }

    /// The theoretical stability limit of a method at each value, if it has one and the modes are computed.
    fn boundary(&self, simulation: &SimulationMethod) -> Result<Vec<(f64, f64)>> {
        let method = (simulation.method.build)(&simulation.values);
        let mut points = Vec::new();
        for value in self.values {
            let model = self.asked.vary.set(self.scene, *value).model()?;
            if model.rod.nodes as u64 <= MAX_NODES_FOR_MODES {
                let damping = model.rod.damping.clone();
                let steps = Modes::of_model(model)?.stable_steps(&*method, damping.as_ref());
                let Some(StableSteps { largest, .. }) = steps else { return Ok(Vec::new()) };
                if largest > 0.0 {
                    points.push((*value, largest));
                }
            }
        }
        Ok(points)
    }

    fn findings(&self) -> Result<Findings> {
        let mut findings = Findings { subject: "stability", ..Findings::default() };
        let mut panels = Vec::new();
        let mut limits = BTreeMap::new();
        for (i, simulation) in self.simulations.iter().enumerate() {
            let boundary = self.boundary(simulation)?;
            findings.answers.push(self.in_words(i, simulation, &boundary));
            if let Some(last) = boundary.last() {
                limits.insert(simulation.to_string(), json!({ "value": last.0, "step_s": last.1 }));
            }
            let index = |outcome: &StabilityOutcome| {
                StabilityOutcome::ALL.iter().position(|other| other == outcome).unwrap_or(0)
            };
            let cells = self.of(i).map(|column| column.iter().map(index).collect()).collect();
            panels.push(Panel { title: simulation.to_string(), cells, boundary });
        }
        if self.outcomes.contains(&StabilityOutcome::Unjudged) {
            findings.answers.push(
                "Where two references (ESDIRK3 and generalized-α with half the smallest step) disagree, runs that finish are classified as stable only."
                    .to_string(),
            );
        }
        let still = self.outcomes.iter().filter(|outcome| **outcome == StabilityOutcome::Still).count();
        if still > 0 {
            findings.answers.push(format!(
                "The rod does not move in {still} of {} runs, which therefore do not test the step: add an actuation, a load or a start that is not at rest.",
                self.outcomes.len()
            ));
        }
        findings.numbers.insert("limits_by_theory".into(), json!(limits));
        let map = OutcomeMap {
            title: format!("{}: outcome of each step", self.scene.name),
            x: (self.asked.vary.label(self.scene).into(), self.values.to_vec()),
            linear: false,
            y: ("time step (s)".into(), self.steps.to_vec()),
            boundary: "limit by linear theory".into(),
            categories: StabilityOutcome::ALL.map(StabilityOutcome::category).to_vec(),
            panels,
        };
        let caption = "Outcome of each method at each step: accurate, wrong, growing or failing.";
        findings.figures.push(Figure::new("stability.svg", caption, map.svg()));
        findings.tables.push(self.table());
        Ok(findings)
    }

    /// A sentence on the outcomes of a method from small to large steps, over all values.
    fn in_words(&self, simulation: usize, name: &SimulationMethod, boundary: &[(f64, f64)]) -> String {
        let columns: Vec<_> = self.of(simulation).collect();
        // The largest step up to which the predicate holds at every value.
        let up_to = |holds: &dyn Fn(StabilityOutcome) -> bool| {
            let counts = columns.iter().map(|column| column.iter().take_while(|outcome| holds(**outcome)).count());
            let counts: Vec<_> = counts.collect();
            counts.iter().min().copied().zip(counts.iter().max().copied())
        };
        let range = |(low, high): (usize, usize)| {
            let step = |count: usize| count.checked_sub(1).map(|i| format!("{} s", in_sentence(self.steps[i], 3)));
            match (step(low), step(high)) {
                (_, None) => "at none of these steps".to_string(),
                (None, Some(high)) => format!("up to {high} at best, and at none of these steps at worst"),
                (Some(low), Some(high)) if low == high => format!("up to {high}"),
                (Some(low), Some(high)) => format!("up to {low} … {high}, depending on the value"),
            }
        };
        let accurate = up_to(&|outcome| outcome == StabilityOutcome::Accurate).map_or(String::new(), range);
        let stable = up_to(&|outcome| outcome <= StabilityOutcome::Still).map_or(String::new(), range);
        let mut ways: Vec<&str> = Vec::new();
        for outcome in
            columns.iter().flat_map(|column| column.iter()).filter(|outcome| **outcome > StabilityOutcome::Still)
        {
            if !ways.contains(&outcome.category().label) {
                ways.push(outcome.category().label);
            }
        }
        let beyond = if ways.is_empty() { String::new() } else { format!("; beyond: {}", ways.join(", ")) };
        let theory = match (boundary.first(), boundary.last()) {
            (Some(first), Some(last)) if first.1 == last.1 => {
                format!(" Linear theory's limit is {} s.", in_sentence(last.1, 4))
            }
            (Some(first), Some(last)) => {
                format!(" Linear theory's limit goes from {} to {} s.", in_sentence(first.1, 4), in_sentence(last.1, 4))
            }
            _ => String::new(),
        };
        if columns.iter().flat_map(|column| column.iter()).all(|outcome| *outcome == StabilityOutcome::Still) {
            return format!("{name}: not tested, because nothing moves.{theory}");
        }
        format!("{name}: accurate {accurate}; stable {stable}{beyond}.{theory}")
    }

    fn table(&self) -> Table {
        let rows = self.cases.iter().zip(self.runs).zip(self.outcomes).map(|((case, run), outcome)| {
            let failed = run.failure.as_ref();
            vec![
                json!(case.simulation.to_string()),
                json!(case.value),
                json!(case.step),
                json!(outcome.category().label),
                json!(run.steps),
                json!(run.iterations),
                json!(run.created.iter().copied().fold(0.0, f64::max)),
                failed.map_or(Value::Null, |(_, t, _)| json!(t)),
                failed.map_or(Value::Null, |(_, _, reason)| json!(reason)),
            ]
        });
        Table {
            file: "stability.csv",
            title: "All runs",
            columns: [
                "integrator",
                "value",
                "time_step_s",
                "outcome",
                "steps",
                "newton_iterations",
                "energy_from_nowhere_relative",
                "failed_at_s",
                "failure",
            ]
            .map(str::to_string)
            .to_vec(),
            rows: rows.collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outcomes_differ_in_grey_print_and_are_seen_on_dark_pages() {
        let grey = |[r, g, b]: [u8; 3]| 0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b);
        let plain =
            StabilityOutcome::ALL.map(StabilityOutcome::category).into_iter().filter(|category| !category.hatched);
        let mut greys: Vec<f64> = plain.map(|category| grey(category.colour)).collect();
        greys.sort_by(f64::total_cmp);
        // Measured greys differ by 34 … 38, starting from 83. A dark page has 26.
        assert!(greys[0] > 80.0 && greys.windows(2).all(|pair| pair[1] - pair[0] > 30.0), "{greys:?}");
    }
}
