//! The answers of the study in sentences and numbers: references, recommended settings, cheaper models, mesh convergence.

use serde_json::json;

use super::plan::PlannedRun;
use super::quantities::{ComparedQuantity, describe_errors, quantities};
use super::reference::{MIN_ERROR_OVER_REFERENCE, RUN_OPTIONS, Reference, RunResults, digits_of};
use crate::error::Result;
use crate::integrator::StepControl;
use crate::number_format::{in_sentence, percent, significant, two_digits};
use crate::report::Findings;
use crate::scene::{HeadKind, Scene};
use crate::study::study_run::{SimulationMethod, StudyRun};
use crate::wording::Phrase;

/// A cheaper model with a larger relative error computes another motion.
const MEANINGLESS_ERROR: f64 = 1.0;

/// A cheaper model has converged if its error is at most this multiple of its own modelling error.
const CONVERGED: f64 = 1.1;

/// Target errors for which settings are recommended.
const TARGETS: [f64; 2] = [1e-2, 1e-4];

/// The results of all runs.
pub struct AccuracyReport<'a> {
    pub scene: &'a Scene,
    pub meshes: &'a [u64],
    pub references: &'a [Reference],
    pub cases: &'a [PlannedRun],
    pub runs: &'a [StudyRun],
    /// Methods that are left out, with the reason.
    pub left_out: &'a [String],
}

/// A run with its errors.
pub struct AccuracyRow<'a> {
    pub case: &'a PlannedRun,
    pub run: &'a StudyRun,
    /// Error against the reference on the same mesh, due to the time steps. `None` if the run failed.
    pub time: Option<[f64; 3]>,
    /// Error against the limit of fine meshes.
    pub total: Option<[f64; 3]>,
}

impl AccuracyRow<'_> {
    fn setting(&self) -> String {
        let simulation = &self.case.simulation;
        let by = if simulation.is_full() { simulation.to_string() } else { format!("model = \"{simulation}\"") };
        match self.case.step_control {
            StepControl::Fixed(step) => format!("{by} with steps of {} s", short(step)),
            StepControl::Adaptive(tolerance) => format!("{by} with tolerance {}", short(tolerance)),
        }
    }

    /// Its step or tolerance.
    fn fineness(&self) -> f64 {
        match self.case.step_control {
            StepControl::Fixed(x) | StepControl::Adaptive(x) => x,
        }
    }

    /// Name of the curve it belongs to.
    pub fn curve(&self) -> String {
        let adaptive = self.case.simulation.is_full() && matches!(self.case.step_control, StepControl::Adaptive(_));
        format!("{}{}", self.case.simulation, if adaptive { ", adaptive" } else { "" })
    }
}

/// A number with few digits.
fn short(x: f64) -> String {
    let digits: f64 = format!("{x:.2e}").parse().unwrap_or(x);
    format!("{digits:e}")
}

fn milliseconds(seconds: f64) -> String {
    let ms = 1e3 * seconds;
    if ms < 10.0 { format!("{ms:.2} ms") } else { format!("{ms:.0} ms") }
}

impl AccuracyReport<'_> {
    /// The quantities that are compared.
    pub fn quantities(&self) -> [&'static ComparedQuantity; 3] {
        quantities(self.scene)
    }

    fn is_held(&self) -> bool {
        self.scene.head.kind != HeadKind::Free
    }

    /// The mesh on which steps are compared: the scene's own if it is studied, otherwise the first one.
    fn mesh(&self) -> usize {
        self.meshes.iter().position(|nodes| *nodes == self.own_nodes()).unwrap_or(0)
    }

    fn own_nodes(&self) -> u64 {
        self.scene.rod.nodes.get() as u64
    }

    /// Nodes of this mesh.
    pub fn nodes(&self) -> u64 {
        self.meshes.get(self.mesh()).copied().unwrap_or_default()
    }

    /// True if this mesh is the scene's own.
    pub fn is_on_own_mesh(&self) -> bool {
        self.nodes() == self.own_nodes()
    }

    /// The smallest errors that the reference on this mesh can measure.
    pub fn floors(&self) -> [f64; 3] {
        self.references.get(self.mesh()).map_or([0.0; 3], Reference::floors)
    }

    /// Errors on this mesh as text; an error that the reference cannot measure is given as an upper bound.
    fn measured(&self, errors: [f64; 3]) -> [String; 3] {
        let floors = self.floors();
        std::array::from_fn(|i| match errors[i] < floors[i] {
            true => format!("less than {}", percent(floors[i])),
            false => percent(errors[i]),
        })
    }

    pub fn findings(&self) -> Result<Findings> {
        let limit = self.mesh_limit();
        let rows: Vec<AccuracyRow<'_>> =
            self.cases.iter().zip(self.runs).map(|(case, run)| self.row(case, run, limit.as_ref())).collect();
        let mut findings = Findings { subject: "speed against accuracy", ..Findings::default() };
        self.references_in_words(&mut findings);
        self.own_setting(&rows, &mut findings);
        self.law_in_words(&rows, &mut findings);
        self.cheaper_models(&rows, &mut findings);
        self.recommend(&rows, limit.as_ref(), &mut findings);
        self.meshes_in_words(limit.as_ref(), &mut findings);
        findings.answers.extend(self.left_out.iter().map(|what| format!("Left out: {what}.")));
        findings.tables.push(self.recommended(&rows));
        findings.tables.push(self.table(&rows));
        self.charts(&rows, limit.as_ref(), &mut findings)?;
        Ok(findings)
    }

    /// The limit of fine meshes by Richardson extrapolation with the observed order of three meshes, and its uncertainty: half of
    /// the extrapolated change.
    fn mesh_limit(&self) -> Option<(RunResults, [f64; 3], f64)> {
        let [.., a, b, c] = self.references else { return None };
        let [.., na, nb, nc] = self.meshes else { return None };
        let ratio = (nc - 1) as f64 / (nb - 1) as f64;
        if ((nb - 1) as f64 / (na - 1) as f64 - ratio).abs() > 1e-9 || ratio <= 1.0 {
            return None;
        }
        let change = b.result.first_distance(&a.result) / c.result.first_distance(&b.result);
        let order = change.log(ratio).clamp(0.5, 4.0);
        let limit = RunResults::extrapolated(&b.result, &c.result, ratio.powf(order));
        let added = c.result.errors(&limit);
        Some((limit, added.map(|e| 0.5 * e), order))
    }

    fn row<'r>(
        &self,
        case: &'r PlannedRun,
        run: &'r StudyRun,
        limit: Option<&(RunResults, [f64; 3], f64)>,
    ) -> AccuracyRow<'r> {
        let result = run.is_complete(RUN_OPTIONS).then(|| RunResults::of(run));
        let mesh = self.meshes.iter().position(|nodes| *nodes == case.nodes);
        let reference = mesh.and_then(|mesh| self.references.get(mesh));
        AccuracyRow {
            case,
            run,
            time: result.as_ref().zip(reference).map(|(result, reference)| result.errors(&reference.result)),
            total: result.as_ref().zip(limit).map(|(result, limit)| result.errors(&limit.0)),
        }
    }

    fn references_in_words(&self, findings: &mut Findings) {
        for (nodes, reference) in self.meshes.iter().zip(self.references) {
            let errors = reference.errors;
            findings.answers.push(format!(
                "Reference on {nodes} nodes: {}, energy supplied {} J; two independent references agree to {}.",
                reference.result.first_in_words(self.is_held(), errors[0]),
                significant(reference.result.work, digits_of(errors[2])),
                describe_errors(self.quantities(), errors.map(|e| in_sentence(e, 2)))
            ));
            let mut numbers = json!({ "energy_put_in_j": reference.result.work });
            for (column, value) in self.quantities()[0].columns.iter().zip(reference.result.first) {
                numbers[*column] = json!(value);
            }
            for (quantity, error) in self.quantities().iter().zip(errors) {
                numbers[format!("{}_error", quantity.key)] = json!(error);
            }
            findings.numbers.insert(format!("reference_{nodes}_nodes"), numbers);
        }
    }

    /// The rows of a mesh.
    pub fn on<'r, 's>(&self, rows: &'r [AccuracyRow<'s>], nodes: u64) -> impl Iterator<Item = &'r AccuracyRow<'s>> {
        rows.iter().filter(move |row| row.case.nodes == nodes)
    }

    fn own_setting(&self, rows: &[AccuracyRow<'_>], findings: &mut Findings) {
        let Some(own) = SimulationMethod::own(self.scene) else { return };
        let (step_control, nodes) = (self.scene.step_control(), self.nodes());
        let row = self.on(rows, nodes).find(|row| row.case.simulation == own && row.case.step_control == step_control);
        if let Some((row, errors)) = row.and_then(|row| Some((row, row.time?))) {
            let setting = row.setting();
            let what = if self.is_on_own_mesh() {
                format!("The scene as it stands, {setting} on {nodes} nodes")
            } else {
                format!("The scene's method and step on {nodes} nodes instead of its {}, {setting}", self.own_nodes())
            };
            findings.answers.push(format!(
                "{what}: error of the time steps {}; processor time {}.",
                describe_errors(self.quantities(), self.measured(errors)),
                milliseconds(row.run.processor_s)
            ));
        }
    }

    /// Published relative uncertainty of the fluid's law in each quantity; `None` if unknown.
    pub fn law(&self) -> Option<(String, [Option<f64>; 3])> {
        let rod = self.scene.model().ok()?.rod;
        let [motion, power] = self.scene.uncertainty(&rod)?.measured(self.is_held());
        let (law, reactive) = self.scene.fluid_model(&rod);
        Some((law?.with_reactive(reactive), [Some(motion), None, Some(power)]))
    }

    /// Compares the uncertainty of the fluid's law with the errors of steps and mesh.
    fn law_in_words(&self, rows: &[AccuracyRow<'_>], findings: &mut Findings) {
        let Some((name, of_law)) = self.law() else { return };
        for (quantity, error) in self.quantities().iter().zip(of_law) {
            findings.numbers.insert(format!("law_error_{}", quantity.key), json!(error));
        }
        let [Some(law), _, Some(energy)] = of_law else { return };
        let good = format!(
            "the fluid law {name} has a published uncertainty of {} in {} and {} in energy",
            percent(law),
            self.quantities()[0].within,
            percent(energy)
        );
        let own = SimulationMethod::own(self.scene).and_then(|own| {
            let (step_control, nodes) = (self.scene.step_control(), self.nodes());
            self.on(rows, nodes).find(|row| row.case.simulation == own && row.case.step_control == step_control)?.time
        });
        // An error below the floor of the reference says nothing about whether a better law is needed.
        let [floor, ..] = self.floors();
        let own = own.filter(|[step, ..]| step.max(floor) < law || *step >= floor);
        findings.answers.push(match own.map(|errors| (errors[0], self.measured(errors))) {
            Some((step, [words, ..])) if step < law => {
                format!("A smaller step would not improve the result: {good}, and the error of the scene's own steps is {words}.")
            }
            Some((_, [words, ..])) => {
                format!("A smaller step would improve the result: the error of the scene's own steps is {words}; {good}.")
            }
            None => format!("The fluid law limits the accuracy of any step: {good}."),
        });
    }

    /// For each cheaper model, the run with the finest tolerance on the compared mesh, and its errors: the modelling errors.
    pub fn settled<'r, 's>(&self, rows: &'r [AccuracyRow<'s>]) -> Vec<(&'r AccuracyRow<'s>, [f64; 3])> {
        let mut settled: Vec<(&AccuracyRow<'_>, [f64; 3])> = Vec::new();
        for row in self.on(rows, self.nodes()).filter(|row| !row.case.simulation.is_full()) {
            let Some(errors) = row.time else { continue };
            match settled.iter_mut().find(|(other, _)| other.case.simulation == row.case.simulation) {
                Some(best) if row.fineness() < best.0.fineness() => *best = (row, errors),
                Some(_) => {}
                None => settled.push((row, errors)),
            }
        }
        settled
    }

    /// The modelling errors of the cheaper models, and the cost of the full model at the same error.
    fn cheaper_models(&self, rows: &[AccuracyRow<'_>], findings: &mut Findings) {
        let on_mesh = || self.on(rows, self.nodes());
        let first = |row: &AccuracyRow<'_>| row.time.map(|e| e[0]);
        let what = self.quantities()[0];
        let own_method = self.scene.method().ok().map(|(method, values)| SimulationMethod::whole(method, values));
        for (finest, errors) in self.settled(rows) {
            let model = on_mesh().filter(|row| row.case.simulation == finest.case.simulation);
            let Some(row) = self.cheapest(model, first, CONVERGED * errors[0]) else { continue };
            let (name, seconds) = (row.case.simulation.kind.name, row.run.processor_s);
            let mut numbers = json!({ "processor_s": seconds });
            for (quantity, error) in self.quantities().iter().zip(errors) {
                numbers[format!("{}_error", quantity.key)] = json!(error);
            }
            let mut text = format!("The model \"{name}\" ({})", row.case.simulation.kind.meaning);
            if errors[0] >= MEANINGLESS_ERROR {
                text += &format!(" does not describe this motion: the error of its {} is 100 % or more.", what.name);
                findings.answers.push(text);
                findings.numbers.insert(format!("model_{name}"), numbers);
                continue;
            }
            text += &format!(
                " has an error of {}, whatever the step, and takes {}.",
                describe_errors(self.quantities(), self.measured(errors)),
                milliseconds(seconds)
            );
            // The scene's own method with steps of larger error, so that its cost is not overstated.
            let own = on_mesh().filter(|row| Some(&row.case.simulation) == own_method.as_ref());
            let own = own.filter(|row| first(row).is_some_and(|e| e >= errors[0]));
            let own = own.max_by(|a, b| a.run.processor_s.total_cmp(&b.run.processor_s));
            let whole = on_mesh().filter(|row| row.case.simulation.is_full());
            let best = self.cheapest(whole, first, errors[0]);
            for (key, errs, other) in
                [("own_method", "with no smaller an error", own), ("best_method", "with no larger an error", best)]
            {
                let Some((other, error)) = other.and_then(|other| Some((other, first(other)?))) else {
                    continue;
                };
                let ratio = other.run.processor_s / seconds;
                text += &format!(
                    " The full model by {}, {errs} in {} ({}), takes {} times as long.",
                    other.setting(),
                    what.within,
                    percent(error),
                    two_digits(ratio)
                );
                numbers[key] = json!({ "setting": other.setting(), "times_as_long": ratio });
                numbers[key][format!("{}_error", what.key)] = json!(error);
            }
            findings.answers.push(text);
            findings.numbers.insert(format!("model_{name}"), numbers);
        }
    }

    /// The cheapest run whose error of the quantity is at most `target` with its own and with all finer steps of the same method.
    pub fn cheapest<'r, 's>(
        &self,
        rows: impl Iterator<Item = &'r AccuracyRow<'s>>,
        error: impl Fn(&AccuracyRow<'s>) -> Option<f64>,
        target: f64,
    ) -> Option<&'r AccuracyRow<'s>>
    where
        's: 'r,
    {
        let rows: Vec<_> = rows.collect();
        let holds = |row: &&&AccuracyRow<'s>| {
            error(row).is_some_and(|e| e <= target)
                && rows
                    .iter()
                    .filter(|other| {
                        other.case.nodes == row.case.nodes
                            && other.curve() == row.curve()
                            && other.fineness() < row.fineness()
                    })
                    .all(|other| error(other).is_some_and(|e| e <= target))
        };
        rows.iter().filter(holds).min_by(|a, b| a.run.processor_s.total_cmp(&b.run.processor_s)).copied()
    }

    /// The cheapest settings for each target error that the references can resolve.
    fn recommend(
        &self,
        rows: &[AccuracyRow<'_>],
        limit: Option<&(RunResults, [f64; 3], f64)>,
        findings: &mut Findings,
    ) {
        let (nodes, floors) = (self.nodes(), self.floors());
        for (i, quantity) in self.quantities().iter().map(|quantity| quantity.name).enumerate().take(2) {
            for target in TARGETS {
                let percent = 100.0 * target;
                let time = self.cheapest(self.on(rows, nodes), |row| row.time.map(|e| e[i]), target);
                let time = time.filter(|_| target >= floors[i]);
                findings.answers.push(match time {
                    _ if target < floors[i] => format!(
                        "For an error of {percent} % in the {quantity} of this rod of {nodes} nodes: unknown, because the references do not resolve errors below {}; finer {} improve them.",
                        self::percent(floors[i]), Phrase::Steps
                    ),
                    Some(row) => format!(
                        "For an error of {percent} % in the {quantity} of this rod of {nodes} nodes: {}: {} and {} linear solves.",
                        row.setting(), milliseconds(row.run.processor_s), row.run.factorisations
                    ),
                    None => format!("For an error of {percent} % in the {quantity} of this rod of {nodes} nodes: none of these steps is accurate enough; try finer {}.", Phrase::Steps),
                });
                let known = limit.is_some_and(|(_, uncertain, _)| target >= MIN_ERROR_OVER_REFERENCE * uncertain[i]);
                let total = self.cheapest(rows.iter(), |row| row.total.map(|e| e[i]), target).filter(|_| known);
                if let Some(row) = total {
                    findings.answers.push(format!(
                        "For an error of {percent} % in the {quantity} including the error of the mesh: {} on {} nodes: {}.",
                        row.setting(),
                        row.case.nodes,
                        milliseconds(row.run.processor_s)
                    ));
                }
                findings.numbers.insert(
                    format!("recommended_{}_{target:e}", quantity.replace(' ', "_")),
                    json!({ "on_this_mesh": time.map(|row| row.setting()), "with_the_mesh": total.map(|row| format!("{} on {} nodes", row.setting(), row.case.nodes)) }),
                );
            }
        }
    }

    fn meshes_in_words(&self, limit: Option<&(RunResults, [f64; 3], f64)>, findings: &mut Findings) {
        let Some((limit, uncertain, order)) = limit else { return };
        findings.answers.push(format!(
            "In the limit of fine meshes: {} (±{}, extrapolated; the error falls as N^-{order:.2}).",
            limit.first_in_words(self.is_held(), uncertain[0]),
            percent(uncertain[0])
        ));
        for (nodes, reference) in self.meshes.iter().zip(self.references) {
            let errors = reference.result.errors(limit);
            let needed = |target: f64| 1.0 + (nodes - 1) as f64 * (errors[0] / target).powf(1.0 / order);
            findings.answers.push(format!(
                "The mesh of {nodes} nodes has an error of {}; 1 % needs about {} nodes, 0.01 % about {}.",
                describe_errors(self.quantities(), errors.map(percent)),
                two_digits(needed(1e-2)),
                two_digits(needed(1e-4))
            ));
        }
    }
}
