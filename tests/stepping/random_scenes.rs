//! What random scenes tell is what they told: their assessment, every variable between steps and at the end, their rates and derivatives
//! by inputs, the summary of the run, and derivatives of the run by all that it is offered by. Whether it is right is for other
//! tests; this one notices a changed sign, number or term in a scene that nobody thought of. A change that is meant is recorded anew:
//!
//!     CAUDAL_WRITE_RECORDED=1 cargo test --test stepping random_scenes

use std::fmt::Write;
use std::ops::ControlFlow;

use caudal::assessment::Assessment;
use caudal::linear_stability::SteadyState;
use caudal::modes::Modes;
use caudal::report::Summary;
use caudal::run;
use caudal::scene::Document;
use caudal::sensitivity::simulation::{parameters, value_and_grad};
use caudal::stepper::Stepper;
use caudal::variable::{Causality, Variable};

use crate::common::random_scene::{ROD, random, random_of};
use crate::common::recorded::is_as_recorded;

/// What is solved otherwise than as chance has it, where the scene allows it.
const SOLVERS: [&[&str]; 8] = [
    &[],
    &["solver.form=positions"],
    &["solver.integrator=generalized-alpha", "solver.rho_inf=0.6"],
    &["solver.integrator=esdirk3"],
    &["solver.model=shape"],
    &[],
    &["solver.model=overdamped"],
    &["solver.integrator=symplectic-euler", "solver.time_step_s=5e-5", "solver.duration_s=0.08"],
];

/// A number, or of several their sum and that with their places.
fn told(values: &[f64]) -> String {
    match values {
        [one] => format!("{one:e}"),
        _ => {
            let placed: f64 = values.iter().enumerate().map(|(i, x)| (i as f64 + 1.0) * x).sum();
            format!("{:e} {placed:e}", values.iter().sum::<f64>())
        }
    }
}

/// All variables, and how they change with time and with inputs.
fn variables(text: &mut String, tail: &mut Stepper) {
    writeln!(text, "\n== at {:e} s", tail.time()).unwrap();
    let all = tail.variables().to_vec();
    let values: Vec<_> = all.iter().map(|variable| told(&tail.get(variable.name).unwrap())).collect();
    let entries: Vec<_> = all.iter().map(|variable| variable.entries(tail.model())).collect();
    let of = |by: &dyn Fn(&Variable, usize) -> Option<f64>| -> Vec<String> {
        let of_all = all.iter().zip(&entries);
        of_all
            .map(|(variable, there)| told(&there.clone().filter_map(|k| by(variable, k)).collect::<Vec<_>>()))
            .collect()
    };
    let rates = tail.rates().map(|by| of(&|variable, k| by.of(variable, k)));
    let explicit = tail.explicit_rates().map(|by| of(&|variable, k| by.of(variable, k)));
    let directional = tail.directional(|seed| {
        for (i, input) in all.iter().enumerate().filter(|(_, variable)| variable.is_input()) {
            let values: Vec<f64> = (0..entries[i].len()).map(|k| 1.0 + 0.1 * i as f64 + 0.3 * k as f64).collect();
            seed.set(input, &values)?;
        }
        Ok(())
    });
    let directional = directional.map(|by| of(&|variable, k| by.of(variable, k)));
    for (i, variable) in all.iter().enumerate() {
        write!(text, "{} [{}]: {}", variable.name, variable.unit, values[i]).unwrap();
        if variable.causality != Causality::Parameter {
            for (name, by) in [("d/dt", &rates), ("∂/∂t", &explicit), ("by inputs", &directional)] {
                if let Ok(by) = by {
                    write!(text, "; {name} {}", by[i]).unwrap();
                }
            }
        }
        text.push('\n');
    }
    for (name, by) in [("rates", rates), ("explicit rates", explicit), ("directional", directional)] {
        if let Err(error) = by {
            writeln!(text, "no {name}: {error}").unwrap();
        }
    }
}

/// The scene of `seed`, of a rod that is longer by this part.
fn document(seed: u64, longer: f64) -> Document {
    let by_tolerance = ROD.replace("time_step_s = 0.004", "tolerance = 1e-3");
    let set = |document: Document, changes: &[&str]| {
        changes.iter().fold(document, |mut document, change| {
            document.set(change).unwrap();
            document
        })
    };
    let own = random(seed);
    let changes = SOLVERS[(seed % 8) as usize];
    let adaptive = random_of(seed, if changes.iter().any(|c| c.contains("esdirk3")) { &by_tolerance } else { ROD });
    let changed = set(adaptive, changes);
    let runs = changed.scene().is_ok_and(|scene| Stepper::of(&scene).is_ok());
    let document = if runs { changed } else { own };
    set(document, &[&format!("rod.length_m={:e}", 0.3 * (1.0 + longer))])
}

fn made(seed: u64, longer: f64) -> String {
    let document = document(seed, longer);
    let mut text = document.override_lines().join("\n") + "\n";
    let scene = match document.scene() {
        Ok(scene) => scene,
        Err(error) => return text + &format!("{error}\n"),
    };
    let mut tail = match Stepper::of(&scene) {
        Ok(tail) => tail,
        Err(error) => return text + &format!("{error}\n"),
    };
    writeln!(text, "\n== assessment").unwrap();
    let assessment = Assessment::of(&scene, &tail).unwrap();
    for line in &assessment.facts {
        writeln!(text, "{}: {}", line.name, line.text).unwrap();
    }
    for (kind, lines) in [("warning", &assessment.warnings), ("range", &assessment.ranges)] {
        lines.iter().for_each(|line| writeln!(text, "{kind}: {line}").unwrap());
    }
    let modes = Modes::of_model(scene.model().unwrap()).unwrap();
    writeln!(text, "modes {:e} {:e}", modes.lowest(), modes.highest()).unwrap();
    if let Ok(mut linear) = SteadyState::of(scene.model().unwrap())
        && let Ok(values) = linear.eigenvalues()
    {
        let (re, im): (Vec<f64>, Vec<f64>) = values.iter().map(|(value, _)| (value.re, value.im.abs())).unzip();
        writeln!(text, "eigenvalues {:e} {:e}", re.iter().sum::<f64>(), im.iter().sum::<f64>()).unwrap();
    }
    // A host, whose steps are none of the integrator's.
    let mut host = Stepper::of(&scene).unwrap();
    for (i, step) in [0.0113, 0.0071, 0.0304].into_iter().enumerate() {
        if let Err(error) = host.do_step(step) {
            writeln!(text, "a step fails: {error}").unwrap();
            break;
        }
        if i == 1 {
            let names = ["natural_curvature_1_m", "flow_x_m_s", "viscosity_pa_s", "actuation_phase_rad"];
            for name in names {
                let Ok(own) = host.get(name) else { continue };
                let changed: Vec<f64> = own.iter().map(|x| 1.1 * x + 0.01).collect();
                if let Err(error) = host.set(name, &changed) {
                    writeln!(text, "{name}: {error}").unwrap();
                }
            }
        }
    }
    variables(&mut text, &mut host);
    let outcome = run::run(&scene, &mut tail, |_| Ok(ControlFlow::Continue(())));
    let summary = Summary::of(&scene, &tail, &outcome, &[]);
    let summary = serde_json::to_value(&summary).unwrap();
    writeln!(text, "\n== summary").unwrap();
    for (key, value) in summary.as_object().unwrap() {
        if !value.is_null() && !key.contains("wall") && key != "caudal_version" && key != "scene_fingerprint" {
            writeln!(text, "{key}: {value}").unwrap();
        }
    }
    variables(&mut text, &mut tail);
    writeln!(text, "\n== derivatives").unwrap();
    let names: Vec<String> = match parameters(&scene) {
        Ok(known) => known.into_iter().map(|parameter| parameter.name).collect(),
        Err(error) => return text + &format!("none: {error}\n"),
    };
    let names: Vec<&str> = names.iter().map(|name| &**name).collect();
    let of_run =
        ["tip_dy_m", "actuation_work_j", "viscous_work_j", "wake_work_j", "energy_kinetic_j", "drag_force_x_n"];
    let of_cycles = ["cycle_forward_speed_m_s", "cycle_actuation_power_w", "cycle_head_force_x_n"];
    for output in of_run.into_iter().chain(of_cycles) {
        match value_and_grad(&document, output, &names) {
            Ok((value, by)) => {
                let by: Vec<String> = by.iter().map(|array| told(&array.values)).collect();
                let by: Vec<String> = names.iter().zip(by).map(|(name, by)| format!("{name} {by}")).collect();
                writeln!(text, "{output} {value:e}: {}", by.join("; ")).unwrap();
            }
            Err(error) => writeln!(text, "{output}: {error}").unwrap(),
        }
    }
    text
}

macro_rules! scenes {
    ($($name:ident $seed:literal)*) => {$(
        #[test]
        fn $name() {
            is_as_recorded(concat!("random/", $seed), |longer| made($seed, longer));
        }
    )*};
}

scenes! {
    scene_1 1 scene_2 2 scene_3 3 scene_4 4 scene_6 6 scene_8 8 scene_9 9 scene_10 10 scene_11 11 scene_12 12
    scene_13 13 scene_14 14 scene_15 15 scene_16 16 scene_17 17 scene_18 18 scene_19 19 scene_20 20 scene_21 21 scene_22 22
    scene_23 23 scene_24 24 scene_25 25 scene_26 26 scene_27 27 scene_28 28 scene_29 29 scene_30 30 scene_31 31 scene_32 32
    scene_33 33 scene_34 34 scene_35 35 scene_36 36 scene_37 37 scene_38 38 scene_39 39 scene_40 40 scene_41 41 scene_42 42
}
