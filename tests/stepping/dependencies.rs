//! What the table of variables and the description of an FMU say of every variable is what probing shows, in the scenes of
//! `models`, under every model, form and kind of method: which inputs and tunable parameters it follows at once, by how much,
//! and when it changes.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use caudal::fmu::Catalogue;
use caudal::scene::Document;
use caudal::stepper::Stepper;
use caudal::variable::{Causality, Variable};

/// Few nodes, so that all can be tried.
const NODES: usize = 8;

/// What each scene is tried with, beside what it says itself.
const KINDS: [&[&str]; 7] = [
    &[],
    &["solver.model=shape"],
    &["solver.model=overdamped"],
    &["solver.form=chain"],
    &["solver.integrator=newmark"],
    &["solver.integrator=esdirk3", "solver.tolerance=1e-3"],
    &["head.kind=driven", "head.position_m=[0.0,0.0]", "head.angle_rad={amplitude=0.1,frequency_hz=1.0}"],
];

/// The scenes of `models`, sweeps left out.
fn scenes() -> Vec<PathBuf> {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("models");
    let mut scenes: Vec<PathBuf> = std::fs::read_dir(models).unwrap().map(|entry| entry.unwrap().path()).collect();
    scenes.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    scenes.retain(|path| Document::read(path).unwrap().scene().is_ok());
    scenes.sort();
    scenes
}

fn document(path: &Path, changes: &[&str]) -> Document {
    let mut document = Document::read(path).unwrap();
    for change in changes {
        document.set(change).unwrap();
    }
    document.set(&format!("rod.nodes={NODES}")).unwrap();
    document
}

/// What is read with an input changed by so much up and down, and what rounding may change of it.
type Shown = (f64, Vec<f64>, Vec<f64>, Vec<f64>);

/// Every entry of what a scene computes.
fn entries(stepper: &Stepper) -> Vec<(&'static Variable, usize)> {
    let computed = |variable: &&&Variable| matches!(variable.causality, Causality::Output | Causality::Parameter);
    let computed = stepper.variables().iter().filter(computed).copied();
    computed.flat_map(|variable| variable.entries(stepper.model()).map(move |k| (variable, k))).collect()
}

fn read(stepper: &Stepper, entries: &[(&Variable, usize)]) -> Vec<f64> {
    entries.iter().map(|(variable, k)| variable.at(&stepper.view(), *k).unwrap()).collect()
}

/// What rounding may change of every entry: of energies and forces differences are read too.
fn rounding(entries: &[(&Variable, usize)], values: [&[f64]; 2]) -> Vec<f64> {
    let mut largest: HashMap<&str, f64> = HashMap::new();
    for ((variable, _), (a, b)) in entries.iter().zip(values[0].iter().zip(values[1])) {
        let size = largest.entry(variable.unit).or_default();
        *size = size.max(a.abs()).max(b.abs());
    }
    entries.iter().map(|(variable, _)| 1e-13 * largest[variable.unit]).collect()
}

/// The scene in motion; as it is, after a whole cycle where that is not long.
fn in_motion(document: &Document, kind: &[&str]) -> Option<Stepper> {
    let scene = document.scene().ok()?;
    let mut stepper = Stepper::of(&scene).ok()?;
    let period = stepper.model().actuation.as_ref().map_or(0.0, |(_, drive)| 1.3 / drive.frequency);
    let step = stepper.get_scalar("time_step_s").unwrap();
    let most = if kind.is_empty() { 1000.0 } else { 100.0 };
    let h = period.min(most * step).max(20.0 * step);
    stepper.do_step(h).ok()?;
    Some(stepper)
}

#[test]
fn what_changes_at_once_is_what_is_told_and_by_what_is_told() {
    let (mut tried, mut followed) = (0, 0);
    let mut faults = Vec::new();
    for path in scenes() {
        for kind in KINDS {
            let name = format!("{} {kind:?}", path.file_stem().unwrap().display());
            let Some(mut stepper) = in_motion(&document(&path, kind), kind) else { continue };
            tried += 1;
            let (entries, before) = (entries(&stepper), stepper.save());
            let here = read(&stepper, &entries);
            for input in stepper.variables().to_vec().into_iter().filter(|variable| variable.is_input()) {
                let (now, nodes) = (stepper.get(input.name).unwrap(), input.entries(stepper.model()));
                // Of an array the ends, the node beside the first one, and the middle.
                let some = [0, 1, nodes.len() / 2, nodes.len() - 1];
                for (i, node) in nodes.enumerate().filter(|(i, _)| some.contains(i)) {
                    let told = |(output, k): &(&Variable, usize)| {
                        output.follows(*k, input, stepper.view().dynamics, stepper.form()).contains(&node)
                    };
                    let told: Vec<bool> = entries.iter().map(told).collect();
                    let mut at = |change: f64| {
                        stepper.restore(&before).unwrap();
                        let mut moved = now.clone();
                        moved[i] += change;
                        let set = stepper.set(input.name, &moved);
                        let values = set.is_ok().then(|| read(&stepper, &entries));
                        stepper.restore(&before).unwrap();
                        values
                    };
                    let size = if now[i] == 0.0 { 1e-2 } else { now[i].abs() };
                    // What changes is told.
                    for change in [1e-2 * size, size] {
                        let Some(there) = at(change) else { continue };
                        let rounding = rounding(&entries, [&here, &there]);
                        for (i, (output, k)) in entries.iter().enumerate() {
                            let (a, b, told) = (here[i], there[i], told[i]);
                            let changed = (a - b).abs() > rounding[i];
                            followed += usize::from(changed);
                            if changed && !told {
                                faults.push(format!("{name}: {}[{k}] by {}[{node}]: {a} {b}", output.name, input.name));
                            }
                        }
                    }
                    // And by how much it does: by a larger or a smaller step.
                    let steps = [1e-4 * size, 1e-6 * size];
                    let shown = steps.iter().filter_map(|h| {
                        let (more, less) = (at(*h)?, at(-*h)?);
                        let rounding = rounding(&entries, [&more, &less]);
                        Some((*h, more, less, rounding))
                    });
                    let shown: Vec<Shown> = shown.collect();
                    let mut seed = vec![0.0; now.len()];
                    seed[i] = 1.0;
                    let change = stepper.directional(|inputs| inputs.set(input, &seed)).unwrap();
                    let exact: Vec<f64> = entries.iter().map(|(output, k)| change.of(output, *k).unwrap()).collect();
                    for (i, (output, k)) in entries.iter().enumerate() {
                        let difference = |(h, more, less, _): &Shown| (more[i] - less[i]) / (2.0 * h);
                        let errors: Vec<f64> = shown.iter().map(|one| (difference(one) - exact[i]).abs()).collect();
                        let fits = |(one, error): (&Shown, &f64)| *error <= 1e-4 * exact[i].abs() + one.3[i] / one.0;
                        // Near a kink of a force differences come to it slowly.
                        let approaches = errors.len() == 2 && errors[1] < 0.2 * errors[0];
                        // A mean over cycles that nobody can know reads as no number, where a host moves the flow too.
                        let finite = here[i].is_finite() && shown.iter().all(|(_, more, ..)| more[i].is_finite());
                        let known = finite || !output.name.starts_with("cycle_");
                        if known && !errors.is_empty() && !approaches && !shown.iter().zip(&errors).any(fits) {
                            let differences: Vec<f64> = shown.iter().map(difference).collect();
                            faults.push(format!(
                                "{name}: d{}[{k}]/d{}[{node}]: {:e} against {differences:?}",
                                output.name, input.name, exact[i]
                            ));
                        }
                    }
                }
            }
        }
    }
    assert!(faults.is_empty(), "{} of {tried}: {:#?}", faults.len(), &faults[..faults.len().min(40)]);
    assert!(tried > 100 && followed > 3_000, "{tried} {followed}");
}

#[test]
fn what_follows_a_tunable_parameter_at_once_is_told_and_nothing_fixed_changes() {
    let (mut tried, mut changed) = (0, 0);
    let mut faults = Vec::new();
    for path in scenes() {
        for kind in KINDS {
            let name = format!("{} {kind:?}", path.file_stem().unwrap().display());
            let document = document(&path, kind);
            let Some(mut stepper) = in_motion(&document, kind) else { continue };
            let catalogue = Catalogue::of(&document.scene().unwrap(), &stepper);
            let entries = entries(&stepper);
            let start = read(&stepper, &entries);
            let step = stepper.get_scalar("time_step_s").unwrap();
            if stepper.do_step(10.0 * step).is_err() {
                continue;
            }
            let (here, before) = (read(&stepper, &entries), stepper.save());
            let fixed = |variable: &Variable, stepper: &Stepper| Catalogue::role(variable, stepper)[1];
            for ((output, k), (a, b)) in entries.iter().zip(start.iter().zip(&here)) {
                if a != b && ["fixed", "tunable"].contains(&fixed(output, &stepper)) {
                    faults.push(format!("{name}: {}[{k}] changes with time", output.name));
                }
            }
            let own = document.scene().unwrap();
            for (place, parameter) in catalogue.parameters.iter().enumerate() {
                if !catalogue.is_tunable(place, &stepper) {
                    continue;
                }
                let value = if parameter.value == 0.0 { 0.1 } else { 1.1 * parameter.value };
                let value = if parameter.range.contains(&value) { value } else { 0.9 * parameter.value };
                let mut other = document.clone();
                other.set(&format!("{}={value:e}", parameter.key)).unwrap();
                let tuned = other.scene().and_then(|scene| stepper.change_parameters(&scene));
                if let Err(error) = tuned {
                    faults.push(format!("{name}: {} is told tunable: {error}", parameter.key));
                    continue;
                }
                tried += 1;
                let told: Vec<&str> = stepper
                    .variables()
                    .iter()
                    .filter(|variable| catalogue.followed_parameters(variable, &stepper).any(|own| own == place))
                    .map(|variable| variable.name)
                    .collect();
                let there = read(&stepper, &entries);
                let rounding = rounding(&entries, [&here, &there]);
                for (((output, k), rounding), (a, b)) in entries.iter().zip(rounding).zip(here.iter().zip(&there)) {
                    let differs = (a - b).abs() > rounding;
                    changed += usize::from(differs);
                    if differs && (!told.contains(&output.name) || fixed(output, &stepper) == "fixed") {
                        faults.push(format!("{name}: {}[{k}] by {}: {a} {b}", output.name, parameter.key));
                    }
                }
                stepper.change_parameters(&own).unwrap();
                stepper.restore(&before).unwrap();
            }
        }
    }
    assert!(faults.is_empty(), "{} of {tried}: {:#?}", faults.len(), &faults[..faults.len().min(40)]);
    assert!(tried > 100 && changed > 1000, "{tried} {changed}");
}
