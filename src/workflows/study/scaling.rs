//! `caudal study scaling`: time, memory and error of a step, from coarse to very fine meshes.

use std::time::{Duration, Instant};

use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Value, json};

use super::runner::{StudyOutcome, StudyRunner};
use crate::error::Result;
use crate::integrator::StepControl;
use crate::model::chain;
use crate::model::chain::contracts;
use crate::report::chart::{Chart, Mark, Scale, Series};
use crate::report::{Findings, Table};
use crate::scene::{FormKey, Scene};
use crate::stepper::Stepper;
use crate::system::Form;

/// A run is repeated until it took this long in total.
const MIN_MEASURED_TIME: Duration = Duration::from_millis(300);
/// Exponents are fitted to meshes with at least this many nodes; below, constant costs dominate.
const MIN_FITTED_NODES: u64 = 129;
/// Memory is measured on meshes with at least this many nodes; below, the allocator's reserves dominate.
const MIN_WEIGHED_NODES: u64 = 100_000;
/// Number of equal parts of the rod between which curvatures are compared.
const COMPARED_POINTS: usize = 16;

/// Options of the study.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ScalingOptions {
    /// Numbers of nodes; empty for 2ᵏ + 1 up to a million, so that the meshes are nested.
    pub nodes: Vec<u64>,
    /// Number of steps per run.
    pub steps: u64,
}

impl Default for ScalingOptions {
    fn default() -> Self {
        Self { nodes: Vec::new(), steps: 20 }
    }
}

/// A run on one mesh.
#[derive(Debug)]
struct MeshRun {
    nodes: u64,
    form: Form,
    /// Time step, s: the scene's, or a shorter one if only the memory of nodal positions is measured.
    step: f64,
    steps: u64,
}

/// The result of a run.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct MeshResult {
    /// The error, if it failed.
    failure: Option<String>,
    /// Mean time per step, s: the number of iterations times the time per iteration in the fastest step, which is least disturbed
    /// by other processes.
    #[serde(deserialize_with = "or_nan")]
    step_s: f64,
    iterations: u64,
    halvings: u64,
    fallbacks: u64,
    /// Peak memory in addition to that before the run, bytes.
    memory: Option<u64>,
    #[serde(deserialize_with = "both_or_nan")]
    tip: [f64; 2],
    /// Curvature at equidistant points, 1/m.
    curvature: Vec<f64>,
}

/// A number that is null in JSON if it is NaN.
fn or_nan<'de, D: Deserializer<'de>>(from: D) -> std::result::Result<f64, D::Error> {
    Option::deserialize(from).map(|x| x.unwrap_or(f64::NAN))
}

/// Two such numbers.
fn both_or_nan<'de, D: Deserializer<'de>>(from: D) -> std::result::Result<[f64; 2], D::Error> {
    <[Option<f64>; 2]>::deserialize(from).map(|both| both.map(|x| x.unwrap_or(f64::NAN)))
}

/// Measures steps of `scene` on all meshes.
///
/// # Errors
/// Those of [`Scene::model`], [`Error::Write`](crate::Error::Write), [`Error::Journal`](crate::Error::Journal).
pub(super) fn scaling(scene: &Scene, asked: &ScalingOptions, runner: StudyRunner<'_>) -> Result<StudyOutcome> {
    let mut nodes = asked.nodes.clone();
    if nodes.is_empty() {
        nodes.extend((4..=20).map(|k| (1 << k) + 1));
    }
    nodes.sort_unstable();
    nodes.dedup();
    let step = scene.typical_step();
    let mut cases = Vec::new();
    let mut used = Vec::new();
    for nodes in &nodes {
        let rod = scene.with_nodes(*nodes).model()?.rod;
        used.push(chain::form(&rod, step));
        let (nodes, steps) = (*nodes, asked.steps);
        if contracts(&rod, step) {
            cases.push(MeshRun { nodes, form: Form::Positions, step, steps });
        } else if nodes >= MIN_WEIGHED_NODES {
            // A step needs the same memory for any step size.
            let mut short = step;
            while !contracts(&rod, short) {
                short *= 0.5;
            }
            cases.push(MeshRun { nodes, form: Form::Positions, step: short, steps: 1 });
        }
        cases.push(MeshRun { nodes, form: Form::Chain, step, steps });
    }
    // One after the other, because runs share the memory bandwidth and memory is measured for the whole process.
    let runs = match runner.run_all("scaling", scene, &cases, 1, |case| run(scene, case, runner))? {
        Ok(runs) => runs,
        Err(interrupted) => return Ok(interrupted),
    };
    let made: Vec<_> = cases.iter().zip(&runs).collect();
    Ok(StudyOutcome::Complete(report(scene, &nodes, &used, &made)?))
}

fn run(scene: &Scene, case: &MeshRun, runner: StudyRunner<'_>) -> Option<MeshResult> {
    let before = memory::reset();
    let step = case.step;
    let mut scene = scene.with_step_control(StepControl::Fixed(step)).with_nodes(case.nodes);
    scene.solver.form = match case.form {
        Form::Positions => FormKey::Positions,
        Form::Chain => FormKey::Chain,
    };
    let failed = |reason: String| MeshResult {
        failure: Some(reason),
        step_s: f64::NAN,
        iterations: 0,
        halvings: 0,
        fallbacks: 0,
        memory: None,
        tip: [f64::NAN; 2],
        curvature: Vec::new(),
    };
    let mut stepper = match Stepper::of(&scene) {
        Ok(stepper) => stepper,
        Err(error) => return Some(failed(error.to_string())),
    };
    let start = stepper.save();
    let (mut fastest, mut total, mut peak) = (f64::INFINITY, Duration::ZERO, None);
    while total < MIN_MEASURED_TIME {
        if total > Duration::ZERO {
            stepper.restore(&start).ok()?; // its own state is compatible
        }
        for _ in 0..case.steps {
            if runner.interrupted() {
                return None;
            }
            let (clock, before) = (Instant::now(), stepper.work().newton_iterations);
            if let Err(error) = stepper.do_step(step) {
                return Some(failed(error.to_string()));
            }
            let (time, iterations) = (clock.elapsed(), stepper.work().newton_iterations - before);
            fastest = fastest.min(time.as_secs_f64() / iterations.max(1) as f64);
            total += time;
        }
        peak = peak.or_else(memory::peak); // before a repetition adds a copy of the state
    }
    let iterations = stepper.work().newton_iterations;
    let rod = &stepper.model().rod;
    let (kappa, last) = (&stepper.metrics().now.kappa, rod.nodes - 1);
    let at = |s: f64| {
        let along = rod.front as f64 + s * (last - rod.front) as f64;
        let place = along.clamp(rod.front as f64 + 1.0, last as f64 - 1.0); // the ends have no full joint
        let (k, part) = (place.floor() as usize, place.fract());
        (kappa[k] + part * (kappa[(k + 1).min(last - 1)] - kappa[k])) / rod.spacing
    };
    let q = &stepper.state().q;
    Some(MeshResult {
        failure: None,
        step_s: fastest * iterations as f64 / case.steps as f64,
        iterations,
        halvings: stepper.metrics().totals.halvings,
        fallbacks: stepper.work().linear_fallbacks,
        memory: peak.zip(before).map(|(peak, before)| peak.saturating_sub(before)),
        tip: [q[2 * last], q[2 * last + 1]],
        curvature: (1..COMPARED_POINTS).map(|i| at(i as f64 / COMPARED_POINTS as f64)).collect(),
    })
}

/// The exponent p and factor c of the least-squares fit y ≈ c xᵖ; `None` for fewer than two different x.
fn power_law(points: &[(f64, f64)]) -> Option<[f64; 2]> {
    let logs: Vec<_> = points.iter().filter(|p| p.0 > 0.0 && p.1 > 0.0).map(|p| (p.0.ln(), p.1.ln())).collect();
    let count = logs.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / count;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let across: f64 = logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    let along: f64 = logs.iter().map(|p| (p.0 - x).powi(2)).sum();
    (logs.len() > 1 && along > 0.0).then(|| [across / along, (y - across / along * x).exp()])
}

/// The largest difference of two lists.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn report(scene: &Scene, nodes: &[u64], used: &[Form], made: &[(&MeshRun, &MeshResult)]) -> Result<Findings> {
    let mut findings = Findings { subject: "scaling with the mesh", ..Findings::default() };
    let good = || made.iter().filter(|(_, run)| run.failure.is_none());
    // Runs that only measure memory are neither timed nor compared.
    let timed = |case: &MeshRun| case.step == scene.typical_step();
    let finest = good().filter(|(case, _)| case.form == Form::Chain).max_by_key(|(case, _)| case.nodes);
    let length = scene.rod.length_m.get();
    // Errors of tip (over the length) and curvature (over the largest) against the finest mesh.
    let errors = |case: &MeshRun, run: &MeshResult| {
        if run.failure.is_some() {
            return None;
        }
        let (_, best) = finest.filter(|(best, _)| best.nodes > case.nodes && timed(case))?;
        let tip = (run.tip[0] - best.tip[0]).hypot(run.tip[1] - best.tip[1]) / length;
        let largest = best.curvature.iter().fold(0.0_f64, |max, k| max.max(k.abs()));
        Some([tip, difference(&run.curvature, &best.curvature) / largest])
    };
    let name = |form: Form| if form == Form::Chain { "chain" } else { "positions" };
    let title = |form: Form| if form == Form::Chain { "Chain form" } else { "Positions" };
    let per_node = |case: &MeshRun, x: f64| x / case.nodes as f64;
    let rows = made.iter().map(|(case, run)| {
        let [tip, curvature] = errors(case, run).map_or([None; 2], |e| e.map(Some));
        let auto = nodes.iter().zip(used).any(|(nodes, form)| *nodes == case.nodes && *form == case.form);
        let iterations = run.iterations as f64 / case.steps as f64;
        let time = timed(case).then_some(run.step_s);
        vec![
            json!(case.nodes),
            json!(name(case.form)),
            json!(auto),
            json!(time),
            json!(time.map(|s| 1e9 * per_node(case, s))),
            json!(time.map(|s| 1e9 * per_node(case, s) / iterations)),
            json!(iterations),
            json!(run.halvings),
            json!(run.fallbacks),
            json!(run.memory.filter(|_| case.nodes >= MIN_WEIGHED_NODES).map(|bytes| per_node(case, bytes as f64))),
            json!(tip),
            json!(curvature),
            json!(case.step),
            run.failure.as_ref().map_or(Value::Null, |reason| json!(reason)),
        ]
    });
    findings.tables.push(Table {
        file: "scaling.csv",
        title: "Meshes",
        columns: [
            "nodes",
            "form",
            "auto",
            "step_s",
            "ns_per_node_and_step",
            "ns_per_node_and_iteration",
            "iterations_per_step",
            "step_halvings",
            "linear_fallbacks",
            "memory_bytes_per_node",
            "tip_error_over_length",
            "curvature_error_relative",
            "time_step_s",
            "failure",
        ]
        .map(str::to_string)
        .to_vec(),
        rows: rows.collect(),
    });

    let (mut times, mut iterations, mut accuracy, mut memory) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for form in [Form::Positions, Form::Chain] {
        let of = || good().filter(|(case, _)| case.form == form);
        let curve = |y: &dyn Fn(&MeshRun, &MeshResult) -> Option<f64>| -> Vec<(f64, f64)> {
            of().filter_map(|(case, run)| Some((case.nodes as f64, y(case, run)?))).collect()
        };
        let each = |run: &MeshResult, case: &MeshRun| run.iterations.max(1) as f64 / case.steps as f64;
        let steps = curve(&|case, run| timed(case).then(|| 1e9 * per_node(case, run.step_s)));
        let single = curve(&|case, run| timed(case).then(|| 1e9 * per_node(case, run.step_s) / each(run, case)));
        // On finer meshes than `auto` solves in positions, rounding costs iterations; the chain form avoids this.
        let is_fitted = |n: f64| {
            let takes = |(nodes, used): (&u64, &Form)| *nodes as f64 == n && (*used == form || form == Form::Chain);
            n >= MIN_FITTED_NODES as f64 && nodes.iter().zip(used).any(takes)
        };
        let fitted = |curve: &[(f64, f64)]| {
            let points: Vec<_> = curve.iter().copied().filter(|p| is_fitted(p.0)).collect();
            let last = points.last()?.0;
            power_law(&points).map(|[exponent, _]| (1.0 + exponent, last))
        };
        if let Some(((step, last), (iteration, _))) = fitted(&steps).zip(fitted(&single)) {
            let which = if form == Form::Chain { "" } else { ", the meshes that use this form by default" };
            findings.answers.push(format!(
                "{}: the time per step grows as N^{step:.3}, the time per iteration as N^{iteration:.3} (least squares over {MIN_FITTED_NODES} to {last} nodes{which}).",
                title(form)
            ));
            findings.numbers.insert(format!("growth_exponent_step_{}", name(form)), json!(step));
            findings.numbers.insert(format!("growth_exponent_iteration_{}", name(form)), json!(iteration));
        }
        let weighed = curve(&|case, run| {
            run.memory.filter(|_| case.nodes >= MIN_WEIGHED_NODES).map(|bytes| per_node(case, bytes as f64))
        });
        if let Some((nodes, bytes)) = weighed.last() {
            findings.numbers.insert(format!("memory_bytes_per_node_{}", name(form)), json!(bytes));
            findings.answers.push(format!("{}: {bytes:.0} bytes of memory per node at {nodes} nodes.", title(form)));
        }
        times.push(Series::new(format!("{}, a step", name(form)), steps, Mark::Dotted));
        iterations.push(Series::new(format!("{}, an iteration", name(form)), single, Mark::Dotted));
        memory.push(Series::new(name(form), weighed, Mark::Dotted));
        for (which, what) in ["tip", "curvature"].into_iter().enumerate() {
            let errors = curve(&|case, run| Some(errors(case, run)?[which]));
            accuracy.push(Series::new(format!("{what}, {}", name(form)), errors, Mark::Dotted));
        }
    }
    times.extend(iterations);
    let ratios: Vec<_> = good()
        .filter(|(case, _)| case.form == Form::Chain && case.nodes >= MIN_FITTED_NODES)
        .filter_map(|(case, run)| {
            let mut positions = good().filter(|(other, _)| other.form == Form::Positions && timed(other));
            let (_, other) = positions.find(|(other, _)| other.nodes == case.nodes)?;
            Some((case.nodes, run.step_s / other.step_s))
        })
        .collect();
    if let Some((low, high)) = ratios.iter().map(|r| (r.1, r.1)).reduce(|(low, high), (a, b)| (low.min(a), high.max(b)))
    {
        findings.numbers.insert("cost_ratio_of_forms".into(), json!([low, high]));
        findings.answers.push(format!(
            "A step in the chain form costs {low:.2} to {high:.2} times as much as one in positions, where both can be used (from {MIN_FITTED_NODES} nodes on)."
        ));
    }
    let switch = nodes.iter().zip(used).find(|(_, form)| **form == Form::Chain).map(|(nodes, _)| *nodes);
    findings.answers.push(match switch {
        Some(nodes) => {
            format!(
                "By default a run of this scene uses the chain form from {nodes} nodes on (among the meshes tried)."
            )
        }
        None => "By default a run of this scene uses positions on all of these meshes.".to_string(),
    });
    if let Some((case, _)) = finest {
        findings.answers.push(format!("Errors are measured against the finest mesh, {} nodes.", case.nodes));
    }
    for (case, run) in made {
        if let Some(reason) = &run.failure {
            findings.answers.push(format!("{} nodes, {} form: {reason}.", case.nodes, name(case.form)));
        }
    }

    let chart = |title: &str, y: &str, scale: Scale, series: Vec<Series>| Chart {
        title: format!("{}: {title}", scene.name),
        x: "number of nodes".into(),
        y: y.into(),
        scale,
        series,
    };
    let errors = || accuracy.iter().flat_map(|series| &series.points).map(|(_, error)| *error);
    if errors().next().is_some() && !errors().any(|error| error > 0.0) {
        findings.answers.push("No errors are drawn: the rod ends in the same place on all meshes.".to_string());
    }
    times.extend(memory::caches(good().map(|(case, run)| (case.nodes, run.memory)), &times));
    accuracy.extend(falling_triangle(&accuracy, 2));
    memory.extend(memory.iter().find_map(|series| series.points.first()).map(|p| (p.0, 0.0)).map(|zero| {
        Series::new("zero", vec![zero], Mark::Unseen) // the axis starts there
    }));
    for (file, caption, chart) in [
        (
            "time.svg",
            "Time per node and step on meshes from coarse to fine; a horizontal line is a cost proportional to the number of nodes.",
            chart("time per node", "time per node (ns)", Scale::LogLog, times),
        ),
        (
            "error.svg",
            "Difference from the finest mesh; the triangle shows second order.",
            chart("error against the finest mesh", "relative error", Scale::LogLog, accuracy),
        ),
        ("memory.svg", "Peak memory of a run per node.", chart("peak memory", "bytes per node", Scale::Linear, memory)),
    ] {
        findings.figures.extend(chart.figure(file, caption));
    }
    Ok(findings)
}

/// A triangle of slope −`order` at the lower left of `series`.
fn falling_triangle(series: &[Series], order: i32) -> Option<Series> {
    let points = || series.iter().flat_map(|series| &series.points).filter(|p| p.1 > 0.0);
    let x = points().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let lowest = points().filter(|p| p.0 < 20.0 * x).map(|p| p.1).fold(f64::INFINITY, f64::min);
    let (x0, x1, top) = (1.5 * x, 6.0 * x, 0.3 * lowest);
    let bottom = top * (x1 / x0).powi(-order);
    (x.is_finite() && lowest.is_finite())
        .then(|| Series::new(order.to_string(), vec![(x0, bottom), (x1, bottom), (x0, top)], Mark::Slope))
}

/// Memory of this process and caches of this machine, if the system reports them.
mod memory {
    use super::{Mark, Series};

    fn status(key: &str) -> Option<u64> {
        let status = std::fs::read_to_string("/proc/self/status").ok()?;
        let line = status.lines().find_map(|line| line.strip_prefix(key))?;
        line.split_whitespace().next()?.parse::<u64>().ok().map(|kilobytes| 1024 * kilobytes)
    }

    /// Resets the peak; returns the resident memory, bytes.
    pub fn reset() -> Option<u64> {
        std::fs::write("/proc/self/clear_refs", "5").ok()?;
        status("VmRSS:")
    }

    /// Peak resident memory since the last reset, bytes.
    pub fn peak() -> Option<u64> {
        status("VmHWM:")
    }

    /// Lines at which a run's memory fills the machine's caches, from the bytes per node of the largest mesh.
    pub fn caches(weighed: impl Iterator<Item = (u64, Option<u64>)>, times: &[Series]) -> Vec<Series> {
        let Some((nodes, Some(bytes))) = weighed.filter(|run| run.1.is_some()).max_by_key(|run| run.0) else {
            return Vec::new();
        };
        let points = || times.iter().flat_map(|series| &series.points);
        let [low, high] = [f64::min, f64::max].map(|of| points().map(|p| p.1).reduce(of).unwrap_or(1.0));
        let largest = points().map(|p| p.0).fold(0.0, f64::max);
        (0..8)
            .filter_map(|index| {
                let read = |what: &str| {
                    std::fs::read_to_string(format!("/sys/devices/system/cpu/cpu0/cache/index{index}/{what}")).ok()
                };
                let (level, kind, size) = (read("level")?, read("type")?, read("size")?);
                let size: f64 = size.trim().strip_suffix('K')?.parse().ok()?;
                let fits = 1024.0 * size * nodes as f64 / bytes as f64;
                (kind.trim() != "Instruction" && fits < largest).then(|| {
                    Series::new(format!("L{}", level.trim()), vec![(fits, low), (fits, 1.4 * high)], Mark::Slope)
                })
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::power_law;

    #[test]
    #[allow(clippy::unwrap_used, reason = "a test may panic")]
    fn a_power_law_is_found_and_a_single_mesh_has_none() {
        for (exponent, factor) in [(1.5, 3.0), (1.0, 2e-7), (-0.5, 40.0)] {
            let points: Vec<_> =
                [9.0, 33.0, 257.0, 4097.0].into_iter().map(|x: f64| (x, factor * x.powf(exponent))).collect();
            let [p, c] = power_law(&points).unwrap();
            assert!((p - exponent).abs() < 1e-13 && (c / factor - 1.0).abs() < 1e-12, "{c} x^{p}");
        }
        assert!(power_law(&[(9.0, 1.0)]).is_none() && power_law(&[(9.0, 1.0), (9.0, 2.0), (0.0, 1.0)]).is_none());
        // The least-squares line through these points: slope and height computed by hand.
        let [p, c] = power_law(&[(1.0, 1.0), (std::f64::consts::E, 1.0), (1.0, std::f64::consts::E)]).unwrap();
        assert!((p + 0.5).abs() < 1e-15 && (c - 0.5_f64.exp()).abs() < 1e-15, "{c} x^{p}");
    }
}
