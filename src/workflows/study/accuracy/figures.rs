//! Tables and figures of errors against cost.

use serde_json::{Value, json};

use super::explanations::{AccuracyReport, AccuracyRow};
use super::reference::RunResults;
use crate::error::Result;
use crate::integrator::StepControl;
use crate::report::chart::{Chart, Mark, Scale, Series};
use crate::report::{Findings, Table};
use crate::study::study_run::{StudyRun, TABLE_MEASURES};

/// Runs with larger errors compute another motion, and are not shown.
const MAX_ERROR: f64 = 10.0;

impl AccuracyReport<'_> {
    pub(super) fn charts(
        &self,
        rows: &[AccuracyRow<'_>],
        limit: Option<&(RunResults, [f64; 3], f64)>,
        findings: &mut Findings,
    ) -> Result<()> {
        let nodes = self.nodes();
        type Cost = fn(&StudyRun) -> f64;
        let costs: [(&str, &str, Cost); 2] = [
            ("time", "processor time (s)", |run| run.processor_s),
            ("work", "linear solves", |run| run.factorisations as f64),
        ];
        for (i, (quantity, key)) in self.quantities().iter().map(|quantity| (quantity.name, quantity.key)).enumerate() {
            let floor = self.floors()[i];
            for (file, label, cost) in &costs {
                // A model without equations to solve has no cost in linear solves.
                let point = |row: &AccuracyRow<'_>| Some((cost(row.run), row.time?[i])).filter(|point| point.0 > 0.0);
                let mut series = self.curves(rows, floor, point);
                let lines = self.settled(rows).into_iter().filter(|(_, e)| e[i] > floor && e[i] < MAX_ERROR);
                let lines = lines.map(|(row, e)| (format!("model error of {}", row.case.simulation), e[i]));
                let lines = lines.chain(self.law_level(i)).chain(self.floor_level(i));
                let lines = level_lines(lines, &series);
                let hollow = self.hollow_in_words(&series, floor);
                let caption = format!(
                    "Error of the {quantity} against {label}, one line per method; the triangles show the slopes of whole orders.{hollow}"
                );
                series.extend(order_lines(&series));
                series.extend(lines);
                let chart = Chart {
                    title: format!("{}: error of the {quantity}, {nodes} nodes", self.scene.name),
                    x: (*label).into(),
                    y: format!("relative error of the {quantity}"),
                    scale: Scale::LogLog,
                    series,
                };
                findings.figures.extend(chart.figure(format!("{key}-{file}.svg"), caption));
            }
        }
        if let Some((limit, ..)) = limit {
            let caption = format!(
                "Error of the {} due to the time steps, one line per method; horizontal lines: error of each mesh.",
                self.quantities()[0].name
            );
            let chart = self.decomposition(rows, limit);
            findings.figures.extend(chart.figure("decomposition.svg", caption));
        }
        Ok(())
    }

    /// The uncertainty of the fluid's law in quantity `i`, as a level line.
    fn law_level(&self, i: usize) -> Option<(String, f64)> {
        let (name, errors) = self.law()?;
        Some((format!("fluid law {name}"), errors[i]?))
    }

    /// The smallest error in quantity `i` that the reference can measure, as a level line.
    fn floor_level(&self, i: usize) -> Option<(String, f64)> {
        Some(("twice the reference's own error".to_string(), self.floors()[i])).filter(|(_, floor)| *floor > 0.0)
    }

    /// One line per method through `point`s of cost or step and error on the compared mesh. Each method has the same colour in all
    /// figures. Errors that the reference cannot measure are hollow dots at the `floor`, their upper bound.
    fn curves(
        &self,
        rows: &[AccuracyRow<'_>],
        floor: f64,
        point: impl Fn(&AccuracyRow<'_>) -> Option<(f64, f64)>,
    ) -> Vec<Series> {
        let points = |method: &String| {
            let of = self.on(rows, self.nodes()).filter(|row| row.curve() == *method);
            let of = of.filter_map(|row| Some((point(row)?, row.case.keys())));
            of.filter(|((_, error), _)| *error < MAX_ERROR)
                .map(|((x, error), keys)| ((x, error.max(floor)), keys))
                .unzip()
        };
        let methods = self.methods(rows).into_iter().enumerate();
        let curves = methods.map(|(k, method)| {
            let (points, keys): (Vec<_>, Vec<_>) = points(&method);
            Series::new(method, points, Mark::Dotted).coloured(k).hollow_to(floor).with_notes(keys)
        });
        curves.filter(|curve| !curve.points.is_empty()).collect()
    }

    /// The names of the curves on the compared mesh, in order.
    fn methods(&self, rows: &[AccuracyRow<'_>]) -> Vec<String> {
        let mut methods: Vec<String> = Vec::new();
        for row in self.on(rows, self.nodes()) {
            if !methods.contains(&row.curve()) {
                methods.push(row.curve());
            }
        }
        methods
    }

    /// Explains hollow dots, if there are any.
    fn hollow_in_words(&self, series: &[Series], floor: f64) -> &'static str {
        match series.iter().flat_map(|series| &series.points).any(|(_, error)| *error <= floor) {
            true => " Hollow dots: smaller than twice the error of the reference, which is only an upper bound.",
            false => "",
        }
    }

    /// Error of the first quantity due to the steps, one line per method, and due to each mesh, as level lines.
    fn decomposition(&self, rows: &[AccuracyRow<'_>], limit: &RunResults) -> Chart {
        let floor = self.floors()[0];
        let point = |row: &AccuracyRow<'_>| match row.case.step_control {
            StepControl::Fixed(step) if row.case.simulation.method.implicit => Some((step, row.time?[0])),
            _ => None,
        };
        let mut series = self.curves(rows, floor, point);
        let meshes = self.meshes.iter().zip(self.references);
        let levels = meshes.map(|(nodes, reference)| (format!("mesh, {nodes}"), reference.result.errors(limit)[0]));
        let levels = level_lines(levels.chain(self.law_level(0)).chain(self.floor_level(0)), &series);
        series.extend(levels);
        Chart {
            title: format!("{}: error of the steps against error of the mesh", self.scene.name),
            x: "time step (s)".into(),
            y: format!("relative error of the {}", self.quantities()[0].name),
            scale: Scale::LogLog,
            series,
        }
    }

    /// For each method the cheapest step for each target error.
    pub(super) fn recommended(&self, rows: &[AccuracyRow<'_>]) -> Table {
        let nodes = self.nodes();
        let targets = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6];
        let mut out = Vec::new();
        for curve in self.methods(rows) {
            for (i, quantity) in self.quantities().iter().map(|quantity| quantity.name).enumerate() {
                let of = self.on(rows, nodes).filter(|row| row.curve() == curve);
                let mut line = vec![json!(curve), json!(quantity)];
                let of: Vec<_> = of.collect();
                for target in targets {
                    let found = self.cheapest(of.iter().copied(), |row| row.time.map(|e| e[i]), target);
                    let found = found.filter(|_| target >= self.floors()[i]);
                    line.push(found.map_or(Value::Null, |row| json!(row.run.factorisations)));
                }
                out.push(line);
            }
        }
        let columns = targets.iter().map(|target| format!("solves_for_{target:e}"));
        Table {
            file: "targets.csv",
            title: if self.is_on_own_mesh() {
                "Linear solves to reach an error of the steps on the scene's own mesh (empty: not reached, or below what the reference can tell)"
            } else {
                "Linear solves to reach an error of the steps on the first of the meshes (empty: not reached, or below what the reference can tell)"
            },
            columns: ["method".to_string(), "quantity".to_string()].into_iter().chain(columns).collect(),
            rows: out,
        }
    }

    /// The errors of the reference on the mesh of a row.
    fn reference_errors(&self, row: &AccuracyRow<'_>) -> Option<[f64; 3]> {
        let mesh = self.meshes.iter().position(|nodes| *nodes == row.case.nodes)?;
        Some(self.references.get(mesh)?.errors)
    }

    pub(super) fn table(&self, rows: &[AccuracyRow<'_>]) -> Table {
        let [first, _, energy] = self.quantities();
        let errors = |kind: &str| self.quantities().map(|quantity| format!("{kind}_error_{}", quantity.key));
        let columns: Vec<String> = ["model", "integrator", "time_step_s", "tolerance", "nodes"]
            .into_iter()
            .chain(StudyRun::COSTS)
            .chain(first.columns.iter().chain(energy.columns).copied())
            .chain(TABLE_MEASURES.map(|measure| measure.key))
            .map(str::to_string)
            .chain(["time", "total", "reference"].into_iter().flat_map(errors))
            .chain(["failure".to_string()])
            .collect();
        let line = |row: &AccuracyRow<'_>| {
            let (run, simulation) = (row.run, &row.case.simulation);
            let (step, tolerance) = match row.case.step_control {
                StepControl::Fixed(step) => (json!(step), Value::Null),
                StepControl::Adaptive(tolerance) => (Value::Null, json!(tolerance)),
            };
            let done = row.time.is_some();
            let found = RunResults::of(run).first.into_iter().take(first.columns.len()).chain([run.work_in]);
            let found = found.map(Some).chain(run.cycles).map(|value| json!(value.filter(|_| done)));
            let errors = [row.time, row.total, self.reference_errors(row)]
                .into_iter()
                .flat_map(|errors| [0, 1, 2].map(|i| json!(errors.map(|e| e[i]))));
            let failure = match &run.failure {
                Some((_, _, reason)) => json!(reason),
                None if done => Value::Null,
                None => json!("its energy grew without bound"),
            };
            let mut line = vec![
                json!(simulation.kind.name),
                json!(simulation.kind.method.map_or_else(|| simulation.to_string(), str::to_string)),
                step,
                tolerance,
                json!(row.case.nodes),
            ];
            line.extend(run.costs().into_iter().chain(found).chain(errors).chain([failure]));
            line
        };
        Table { file: "accuracy.csv", title: "All runs", rows: rows.iter().map(line).collect(), columns }
    }
}

/// Level lines across a chart of `series`, labelled alternately at its left and near its middle so that close ones stay legible.
fn level_lines(levels: impl Iterator<Item = (String, f64)>, series: &[Series]) -> Vec<Series> {
    let x = || series.iter().flat_map(|series| &series.points).map(|p| p.0).filter(|x| *x > 0.0);
    let (low, high) = (x().fold(f64::INFINITY, f64::min), x().fold(0.0, f64::max));
    let label_at = |k: usize| {
        let part = if k.is_multiple_of(2) { 0.02 } else { 0.4 };
        low.powf(1.0 - part) * high.powf(part)
    };
    let line = |(k, (name, y))| Series::new(name, vec![(low, y), (high, y), (label_at(k), y)], Mark::Level);
    levels.enumerate().map(line).collect()
}

/// Lines of slopes −1, −2 and −3 at the lower left of a chart of errors against work.
fn order_lines(series: &[Series]) -> Vec<Series> {
    let points = || series.iter().flat_map(|series| &series.points).filter(|p| p.0 > 0.0 && p.1 > 0.0);
    let x = points().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let [low, high] = [f64::min, f64::max].map(|of| points().map(|p| p.1).reduce(of).unwrap_or(1.0));
    if !x.is_finite() {
        return Vec::new();
    }
    let top = low.powf(0.75) * high.powf(0.25); // three quarters down
    let triangle = |order: i32| {
        let corners = vec![(x, top), (2.0 * x, top * 0.5_f64.powi(order))];
        Series::new(order.to_string(), corners, Mark::Slope)
    };
    (1..=3).map(triangle).collect()
}
