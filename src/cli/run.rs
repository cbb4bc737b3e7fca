//! `caudal run`: runs a scene with a progress bar; Ctrl-C stops it with valid files.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use caudal::assessment::Assessment;
use caudal::error::{Error, Result};
use caudal::metrics::TendonExtremes;
use caudal::number_format::significant;
use caudal::reduced::{ErrorMeasure, ModelKind};
use caudal::report::Summary;
use caudal::report::{Claim, RunOutput};
use caudal::run::{Ending, Outcome, run as run_scene};
use caudal::scene::Scene;
use caudal::scene::value::Positive;
use caudal::stepper::Stepper;
use caudal::verification::Verification;

use super::progress::{self, Progress, Unit};
use super::{
    SceneArguments, exit, output_folder, print, print_error, print_kept, print_unless_quiet, refuse, set_quiet,
};

/// Cycles, after the ramp, of which `check` says the largest loads, and the most joints times steps that it finds them for.
const FIRST_CYCLES: f64 = 2.0;
const MOST_JOINT_STEPS: f64 = 1e5;

pub fn run(
    arguments: &SceneArguments,
    out: Option<PathBuf>,
    verify: bool,
    force: bool,
    json: bool,
) -> Result<ExitCode> {
    set_quiet(json);
    let (document, scene, mut stepper) = arguments.prepare()?;
    let warnings = Assessment::of_run(&scene, &stepper)?.warnings;
    let folder = out.unwrap_or_else(|| output_folder(&scene));
    let mut output = match RunOutput::create(&folder, &scene, &stepper, Claim::forced(force)) {
        Ok(output) => output,
        Err(error) => return Ok(refuse(&document.located(error))),
    };
    for warning in &warnings {
        print_unless_quiet(&format!("note: {warning}"));
    }
    let interrupted = watch_for_interrupts();
    let raised =
        || if interrupted.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    let progress = Progress::of(Unit::SimulatedSeconds, scene.solver.duration_s.get());
    let outcome = run_scene(&scene, &mut stepper, |stepper| {
        progress.set(stepper.time());
        match output.step(stepper, &mut || raised())? {
            ControlFlow::Continue(()) => Ok(raised()),
            stop => Ok(stop),
        }
    });
    drop(progress);
    let mut summary = Summary::of(&scene, &stepper, &outcome, &warnings);
    let mut compared = true;
    if verify && outcome.ending == Ending::Complete {
        // A failed or interrupted comparison does not affect the run.
        let progress = Progress::of(Unit::SimulatedSeconds, stepper.time());
        progress.note("for comparison");
        let compare = |stepper: &mut Stepper| {
            progress.set(stepper.time());
            raised()
        };
        match Verification::of(&scene, &stepper, compare) {
            Ok(Some(verification)) => summary.verification = Some(verification),
            Ok(None) => compared = false,
            Err(error) => summary.notes.push(format!("the full model could not be run for comparison: {error}")),
        }
    }
    let kept = output.finish(&stepper, &summary, &document, &summary.notes);
    print_unless_quiet(&format!(
        "{}: t = {} s in {} steps, {} Newton iterations, {:.3} s",
        summary.name, summary.end_time_s, summary.steps, summary.newton_iterations, summary.wall_s
    ));
    print_unless_quiet(&format!("centre of mass ({:.9}, {:.9}) m", summary.x_com_m, summary.y_com_m));
    print_unless_quiet(&format!(
        "net displacement {} m, largest |y| {} m",
        significant(summary.net_displacement_m, 7),
        significant(summary.max_lateral_excursion_m, 7)
    ));
    if let Some(largest) = largest(&summary) {
        print_unless_quiet(&largest);
    }
    print_unless_quiet(&summary.cycles.to_string());
    if let Some(reason) = &summary.model_reason {
        print_unless_quiet(&format!("model {}: {reason}", summary.model));
    }
    if let Some(choice) = scene.fluid_choice() {
        print_unless_quiet(&format!("fluid {}: {}", choice.name(), choice.reason));
    }
    if let Some(Verification { net_displacement_m, relative_differences, noise, wall_s, .. }) = &summary.verification {
        print_unless_quiet(&format!(
            "the full model on the same {} nodes: net displacement {} m, {wall_s:.3} s",
            summary.nodes,
            significant(*net_displacement_m, 7)
        ));
        if ModelKind::named(summary.model).is_some_and(|kind| kind.estimate.is_none()) {
            print_unless_quiet("  the run also used the full model: the differences are errors of the time steps");
        }
        for measure in ErrorMeasure::ALL {
            let Some(difference) = relative_differences.get(measure) else { continue };
            let [name, relative] = measure.meaning();
            print_unless_quiet(&if noise.contains(&measure) {
                format!("  {name}: both are at rest and differ only by rounding")
            } else {
                format!("  {name} differs by {difference:.1e} of {relative}")
            });
        }
    }
    for note in summary.notes.iter().skip(warnings.len()) {
        print_unless_quiet(&format!("note: {note}"));
    }
    if summary.step_halvings > 0 {
        print_unless_quiet(&format!("{} steps did not converge at first and were halved", summary.step_halvings));
    }
    let whole = print_kept(&kept, &folder);
    if json {
        let text = serde_json::to_string_pretty(&summary).map_err(|e| Error::Page { reason: e.to_string() })?;
        print(&text);
    }
    Ok(match outcome.ending {
        Ending::Complete if compared => whole,
        Ending::Complete => {
            print_error("interrupted: the run is complete, and was not compared with the full model");
            ExitCode::from(exit::INTERRUPTED)
        }
        Ending::Interrupted => {
            print_error(&format!("interrupted: the files are complete and valid up to t = {} s", summary.end_time_s));
            ExitCode::from(exit::INTERRUPTED)
        }
        Ending::Failed(error) => {
            print_error(&error.to_string());
            print_error(&format!("what was computed up to t = {} s is kept", summary.end_time_s));
            ExitCode::from(exit::FAILED)
        }
    })
}

/// The largest loads of joints, actuation, tendons, the motor of a hinge and a held head; parts without a load are left out.
fn largest(summary: &Summary) -> Option<String> {
    let list = |name: &str, values: &[(Option<f64>, &str)]| {
        let there = values.iter().filter_map(|(value, unit)| Some((value.filter(|value| *value != 0.0)?, unit)));
        let values: Vec<String> = there.map(|(value, unit)| format!("{value:.4e} {unit}")).collect();
        (!values.is_empty()).then(|| format!("{name} {}", values.join(", ")))
    };
    let parts = [
        list("joint", &[(Some(summary.max_joint_moment_n_m), "N m")]),
        list("actuation", &[(summary.max_actuation_power_w, "W")]),
        list(
            "motor of the hinge",
            &[
                (summary.max_hinge_torque_n_m, "N m"),
                (summary.max_hinge_power_w, "W"),
                (summary.max_hinge_speed_rad_s, "rad/s"),
            ],
        ),
        list(
            "held head",
            &[(summary.max_head_force_n, "N"), (summary.max_head_moment_n_m, "N m"), (summary.max_head_power_w, "W")],
        ),
    ];
    let tendon = |(i, tendon): (usize, &TendonExtremes)| {
        let values =
            [(tendon.tension, "N"), (tendon.power, "W"), (tendon.speed, "m/s"), (tendon.travel(), "m of travel")];
        list(&format!("tendon {i}"), &values.map(|(value, unit)| (Some(value), unit)))
    };
    let tendons = (1..).zip(&summary.tendons.0).map(tendon);
    let parts: Vec<String> = parts.into_iter().chain(tendons).flatten().collect();
    (!parts.is_empty()).then(|| format!("largest loads, including the start: {}", parts.join("; ")))
}

/// The largest loads of the first cycles of `scene`, at whose start `stepper` is; `None` if nothing is driven, or if they take long
/// to compute.
pub(super) fn first_loads(scene: &Scene, mut stepper: Stepper) -> Option<String> {
    let period = scene.spectrum().slowest()?.recip();
    let ramp = scene.start.ramp_s.map_or(0.0, Positive::get);
    let time = (ramp + FIRST_CYCLES * period).min(scene.solver.duration_s.get());
    let model = stepper.model();
    let joints = model.rod.nodes as f64;
    // With nonlocal forces a step takes longer by the number of joints.
    let coupled = if model.forces.global().is_some() { joints } else { 1.0 };
    if coupled * joints * time > MOST_JOINT_STEPS * scene.typical_step() {
        return None;
    }
    stepper.do_step(time).ok()?;
    let outcome = Outcome { ending: Ending::Complete, wall: Duration::ZERO };
    largest(&Summary::of(scene, &stepper, &outcome, &[]))
        .map(|most| format!("{most}, in the first {} s", significant(time, 3)))
}

/// Makes Ctrl-C end the program and remove the progress from the terminal, for commands without files to complete.
pub(super) fn end_at_interrupt() {
    let _ = ctrlc::set_handler(|| {
        progress::clear();
        std::process::exit(i32::from(exit::INTERRUPTED));
    });
}

/// A flag that Ctrl-C (or a termination request) sets; a second one ends the program at once.
pub(super) fn watch_for_interrupts() -> Arc<AtomicBool> {
    let flag = Arc::new(AtomicBool::new(false));
    let raised = Arc::clone(&flag);
    // Without a handler the run can still be terminated, only less gently.
    let _ = ctrlc::set_handler(move || {
        if raised.swap(true, Ordering::Relaxed) {
            progress::clear();
            std::process::exit(i32::from(exit::INTERRUPTED));
        }
    });
    flag
}
