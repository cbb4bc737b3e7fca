//! A run: a scene driven over its duration, and the summary of what came out.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use serde::Serialize;

#[cfg(feature = "report")]
use crate::batch::{Batch, WIDTH};
use crate::cycle::{self, Averages, GRAVITY};
use crate::error::{Error, Result};
use crate::integrator::StepControl;
use crate::linear::SolverChoice;
use crate::metrics::{Meter, Power};
use crate::model::{Mechanics, Model};
use crate::reduced::measure::{Course, Point};
use crate::reduced::{Differences, Measure};
use crate::rod::Rod;
use crate::scene::Scene;
use crate::stepper::Stepper;
use crate::system::Form;

/// A displacement below this part of the length counts as none.
const NO_DISPLACEMENT: f64 = 1e-9;

/// A defect of the energy balance from this part of the energies on is worth a word.
const UNBALANCED: f64 = 0.1;

/// Roundings of a position that an energy is measured with.
const ROUNDINGS: f64 = 16.0;

/// Strain from which on the linear law of the rod is out of its range. Measured on the scenes of `models/` and
/// `tests/reference`, 9–129 nodes, steps of 1e-5 … 2e-2 s: at most 0.7 %, in steps whose energy comes from nowhere.
const STRAINED: f64 = 0.05;

/// Rotation (rad) of an edge within one step from which on a step is worth a word. Measured on the same: at most 20° after a
/// smooth start, up to 70° in the one step that takes a jump start to its shape, 51–150° where energy comes from nowhere.
const TURNED: f64 = std::f64::consts::FRAC_PI_4;

/// How a run ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Ending {
    /// It reached its duration.
    Complete,
    /// The observer stopped it.
    Interrupted,
    /// A step failed, and the stepper shows the last good state; or the observer did.
    Failed(Error),
}

/// A run that ended.
#[derive(Debug)]
pub struct Outcome {
    /// How.
    pub ending: Ending,
    /// Wall-clock time it took.
    pub wall: Duration,
}

/// Drives `stepper` through the steps of `scene`; `observe` sees the state after every step, and may stop the run. A step
/// that fails, and an observer that does, is an [`Ending`], so that what came before is kept.
pub fn run(
    scene: &Scene,
    stepper: &mut Stepper,
    mut observe: impl FnMut(&mut Stepper) -> Result<ControlFlow<()>>,
) -> Outcome {
    let start = Instant::now();
    let ending = scene.spans().find_map(|span| go(stepper, span, &mut observe)).unwrap_or(Ending::Complete);
    Outcome { ending, wall: start.elapsed() }
}

/// A run among others.
#[cfg(feature = "report")]
#[derive(Debug)]
pub struct Beside<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// At its start.
    pub stepper: Stepper,
}

/// Drives several runs side by side, each as [`run`] does and with the same results; `observe` also knows which of them it sees.
/// Those that a [`Batch`] can take share their steps.
#[cfg(feature = "report")]
pub fn run_beside(
    runs: &mut [Beside<'_>],
    mut observe: impl FnMut(usize, &mut Stepper) -> Result<ControlFlow<()>>,
) -> Vec<Outcome> {
    let start = Instant::now();
    let steppers: Vec<&Stepper> = runs.iter().map(|run| &run.stepper).collect();
    let Some(mut batch) = Batch::of(&steppers) else {
        let alone = |(i, run): (usize, &mut Beside<'_>)| self::run(run.scene, &mut run.stepper, |s| observe(i, s));
        return runs.iter_mut().enumerate().map(alone).collect();
    };
    // What is left of each: its steps one by one, and a shorter last one.
    let mut left: Vec<_> = runs.iter().map(|run| run.scene.single_steps()).collect();
    let mut endings: Vec<Option<Ending>> = runs.iter().map(|_| None).collect();
    while endings.iter().any(Option::is_none) {
        let mut spans = [None; WIDTH];
        let mut going: [Option<&mut Stepper>; WIDTH] = Default::default();
        let all = runs.iter_mut().zip(&mut left).zip(&mut endings);
        for (((run, left), ending), (span, going)) in all.zip(spans.iter_mut().zip(&mut going)) {
            if ending.is_none() {
                *span = left.next();
                match span {
                    Some(_) => *going = Some(&mut run.stepper),
                    None => *ending = Some(Ending::Complete),
                }
            }
        }
        batch.solve_ahead(&mut going);
        for (i, ((run, span), ending)) in runs.iter_mut().zip(spans).zip(&mut endings).enumerate() {
            if let Some(span) = span {
                *ending = go(&mut run.stepper, span, |stepper| observe(i, stepper));
            }
        }
    }
    let wall = start.elapsed() / u32::try_from(runs.len()).unwrap_or(1).max(1);
    endings.into_iter().flatten().map(|ending| Outcome { ending, wall }).collect()
}

/// Goes on by `span` (s); how the run ended, where it did.
fn go(
    stepper: &mut Stepper,
    span: f64,
    mut observe: impl FnMut(&mut Stepper) -> Result<ControlFlow<()>>,
) -> Option<Ending> {
    let mut seen = Ok(ControlFlow::Continue(()));
    let outcome = stepper.march(span, |stepper| {
        seen = observe(stepper);
        match seen {
            Ok(flow) => flow,
            Err(_) => ControlFlow::Break(()),
        }
    });
    match (outcome, seen) {
        (Err(error), _) | (_, Err(error)) => Some(Ending::Failed(error)),
        (Ok(_), Ok(ControlFlow::Break(()))) => Some(Ending::Interrupted),
        (Ok(_), Ok(ControlFlow::Continue(()))) => None,
    }
}

/// At most this many parts of a run end where it is compared with the whole model.
const COMPARED: f64 = 256.0;

/// Times that differ by less than this part are the same.
const NO_TIME: f64 = 1e-9;

/// A run beside the whole model.
#[derive(Debug, Clone, Serialize)]
#[expect(missing_docs, reason = "the names say what they are, with units")]
pub struct Verification {
    pub net_displacement_m: f64,
    /// What both differ by; see [`Measure`] for what it is relative to.
    pub relative_differences: Differences,
    /// The measures of which both runs have no more than rounding makes of a rod at rest: their differences say nothing.
    pub noise: Vec<Measure>,
    pub steps: u64,
    pub wall_s: f64,
}

impl Verification {
    /// Runs the whole model up to the time of `stepper`, whose scene is `scene`, and the scene once more beside it, and
    /// compares their courses at the ends of the scene's steps, or of as many equal parts of its duration; none where
    /// `observe` stops it.
    ///
    /// # Errors
    /// Those of the run.
    pub fn of(
        scene: &Scene,
        stepper: &Stepper,
        mut observe: impl FnMut(&mut Stepper) -> ControlFlow<()>,
    ) -> Result<Option<Self>> {
        let start = Instant::now();
        let mut whole = Stepper::of(&scene.whole())?;
        let mut again = match stepper.choice() {
            Some(choice) => Stepper::of(&scene.taken(choice))?,
            None => Stepper::of(scene)?,
        };
        let mut courses = [&whole, &again].map(|run| Course::of(run.model()));
        let end = stepper.time();
        let part = match stepper.pace() {
            StepControl::Fixed(step) => step * (end / (step * COMPARED)).ceil(),
            StepControl::Adaptive(_) => end / COMPARED,
        };
        loop {
            for (run, course) in [&whole, &again].into_iter().zip(&mut courses) {
                course.points.push(Point::of(run.state(), &run.meter().now));
            }
            let left = end - whole.time();
            if left <= 0.5 * NO_TIME * end {
                break;
            }
            let span = if left <= part * (1.0 + NO_TIME) { left } else { part };
            if !whole.do_step_with(span, &mut observe)? {
                return Ok(None);
            }
            again.do_step(span)?;
        }
        let [truth, mut found] = courses;
        found.points.pop();
        found.points.push(Point::of(stepper.state(), &stepper.meter().now));
        let meter = whole.meter();
        Ok(Some(Self {
            net_displacement_m: meter.net_displacement(),
            relative_differences: truth.differences(&found),
            noise: truth.noise(&found),
            steps: meter.totals.steps,
            wall_s: start.elapsed().as_secs_f64(),
        }))
    }
}

/// Estimated relative errors of what the water is taken for, against the highest law: of speed or thrust, and of power.
#[derive(Debug, Clone, Copy, Serialize)]
#[expect(missing_docs, reason = "the names say what they are")]
pub struct FluidError {
    pub motion: f64,
    pub power: f64,
}

/// What came out of a run; the content of summary.json, all in SI units.
#[derive(Debug, Clone, Serialize)]
#[expect(missing_docs, reason = "the names say what they are, with units; time_step_s is the mean of adaptive steps")]
pub struct Summary {
    pub name: String,
    pub scene_file: PathBuf,
    pub scene_fingerprint: String,
    pub caudal_version: &'static str,
    pub complete: bool,
    pub ending: String,
    pub end_time_s: f64,
    pub nodes: usize,
    pub model: &'static str,
    pub model_reason: Option<String>,
    pub forces: Vec<&'static str>,
    pub fluid_reason: Option<String>,
    pub fluid_error: Option<FluidError>,
    pub integrator: String,
    pub form: Form,
    pub time_step_s: f64,
    pub tolerance: Option<f64>,
    pub steps: u64,
    pub rejected_steps: u64,
    pub newton_iterations: u64,
    pub factorisations: u64,
    pub linear_solver: &'static str,
    pub linear_fallbacks: u64,
    pub step_halvings: u64,
    pub newton_floor_stops: u64,
    pub max_strain: f64,
    pub max_rotation_per_step_rad: f64,
    pub x_com_m: f64,
    pub y_com_m: f64,
    pub net_displacement_m: f64,
    pub max_lateral_excursion_m: f64,
    pub com_path_m: f64,
    pub initial_energy_j: f64,
    pub stretching_energy_j: f64,
    pub bending_energy_j: f64,
    pub kinetic_energy_j: f64,
    pub fluid_energy_j: f64,
    pub mean_stretching_energy_j: f64,
    pub mean_bending_energy_j: f64,
    pub mean_kinetic_energy_j: f64,
    pub actuation_work_j: f64,
    pub viscous_work_j: f64,
    pub wake_work_j: f64,
    pub spray_work_j: f64,
    pub other_work_j: f64,
    pub load_work_j: f64,
    pub head_work_j: f64,
    pub flow_work_j: f64,
    pub mean_actuation_power_w: f64,
    pub mean_viscous_power_w: f64,
    pub mean_wake_power_w: f64,
    pub mean_spray_power_w: f64,
    pub mean_load_power_w: f64,
    pub mean_head_power_w: f64,
    pub mean_flow_power_w: f64,
    pub numerical_dissipation_j: f64,
    pub rod_momentum_n_s: [f64; 2],
    pub fluid_momentum_n_s: [f64; 2],
    pub drag_impulse_n_s: [f64; 2],
    pub wake_impulse_n_s: [f64; 2],
    pub flow_impulse_n_s: [f64; 2],
    pub load_impulse_n_s: [f64; 2],
    pub head_impulse_n_s: [f64; 2],
    pub momentum_defect_n_s: [f64; 2],
    pub notes: Vec<String>,
    pub cost_of_transport: Option<f64>,
    pub efficiency: Option<f64>,
    pub head_force_n: Option<[f64; 2]>,
    pub head_moment_n_m: Option<f64>,
    pub mean_head_force_n: Option<[f64; 2]>,
    pub mean_thrust_n: Option<f64>,
    pub mean_head_moment_n_m: Option<f64>,
    pub max_head_force_n: Option<f64>,
    pub max_head_moment_n_m: Option<f64>,
    #[serde(flatten)]
    pub cycles: Averages,
    pub wall_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verification: Option<Verification>,
    pub final_positions_m: Vec<[f64; 2]>,
}

/// What makes the steps of a run finer where it is smaller.
fn finer(pace: StepControl) -> &'static str {
    match pace {
        StepControl::Fixed(_) => "step",
        StepControl::Adaptive(_) => "tolerance",
    }
}

/// The energy (J) that rounding gives a rod: that of edges whose ends are rounded where they are.
pub(crate) fn rounding(rod: &Rod, positions: &[f64]) -> f64 {
    let reach = positions.iter().fold(rod.length, |max, x| max.max(x.abs()));
    rod.ea * rod.length * (ROUNDINGS * f64::EPSILON * reach / rod.spacing).powi(2)
}

/// What to say of an energy balance that does not close, beyond `rounding` (J): the mark of steps that are too coarse, or of
/// a wrong root.
fn balance_note(meter: &Meter, rounding: f64, pace: StepControl) -> Option<String> {
    let Power { actuation, viscous, wake, spray, load, head, flow, other } = meter.totals.work;
    let scale =
        [meter.first_energy, meter.now.energy.total(), actuation, viscous, wake, spray, load, head, flow, other]
            .into_iter()
            .fold(0.0, |max: f64, x| max.max(x.abs()));
    let defect = meter.numerical_dissipation();
    (defect.abs() > UNBALANCED * scale && defect.abs() > rounding).then(|| {
        let what = if defect < 0.0 { "came from nowhere" } else { "was taken by the method itself" };
        format!(
            "the energy balance does not close: {:.3e} J {what}, {:.0} % of the largest energy or work; a smaller {} shows whether the result stands",
            defect.abs(),
            100.0 * defect.abs() / scale,
            finer(pace)
        )
    })
}

/// What to say of edges that stretch or turn further than the model or the step can follow.
fn motion_notes(meter: &Meter, pace: StepControl) -> impl Iterator<Item = String> {
    let strained = (meter.totals.max_strain > STRAINED).then(|| {
        format!(
            "an edge is stretched or compressed by {:.1} %: the rod is linearly elastic, for strains of up to {:.0} %",
            100.0 * meter.totals.max_strain,
            100.0 * STRAINED
        )
    });
    let turned = (meter.totals.max_rotation > TURNED).then(|| {
        format!(
            "an edge turns by {:.0}° within one step, more than {:.0}°: the step does not follow the motion, which may have gone another way; a smaller {}, or a smooth start, shows whether the result stands",
            meter.totals.max_rotation.to_degrees(),
            TURNED.to_degrees(),
            finer(pace)
        )
    });
    strained.into_iter().chain(turned)
}

/// What to say of a simulation of `scene` with this `model` and `pace`, which `meter` has measured and which ends at these
/// `positions`, beside the `warnings` that were known before.
pub(crate) fn notes(
    scene: &Scene,
    model: &Model,
    meter: &Meter,
    positions: &[f64],
    pace: StepControl,
    warnings: &[String],
) -> Vec<String> {
    let left = meter.across().map(|across| scene.left_ranges(&model.forces, &model.rod, across));
    (warnings.iter().cloned())
        .chain(balance_note(meter, rounding(&model.rod, positions), pace))
        .chain(motion_notes(meter, pace))
        .chain(left.into_iter().flatten())
        .collect()
}

impl Summary {
    /// The summary of a run of `scene`, of which `warnings` were known before ([`Assessment`](crate::check::Assessment)).
    pub fn of(scene: &Scene, stepper: &Stepper, outcome: &Outcome, warnings: &[String]) -> Self {
        let (meter, work) = (stepper.meter(), stepper.work());
        let (now, model) = (&meter.now, stepper.model());
        let elapsed = meter.elapsed();
        let mean = |integral: f64| if elapsed > 0.0 { integral / elapsed } else { 0.0 };
        let Power { actuation, viscous, wake, spray, load, head, flow, other } = meter.totals.work;
        let displacement = meter.net_displacement();
        let swims = actuation > 0.0 && displacement.abs() >= NO_DISPLACEMENT * model.rod.length;
        let dynamics = stepper.view().dynamics;
        let speed = mean(displacement.abs());
        let whole = stepper.cycles().since_start();
        let held = |measure: &cycle::Measure| measure.mean(whole.as_slice(), dynamics).filter(|_| whole.is_some());
        let cycles = stepper.cycles().averages(dynamics);
        Self {
            name: scene.name.clone(),
            scene_file: scene.file(),
            scene_fingerprint: scene.fingerprint_text(),
            caudal_version: env!("CARGO_PKG_VERSION"),
            complete: outcome.ending == Ending::Complete,
            ending: match &outcome.ending {
                Ending::Complete => "complete".to_string(),
                Ending::Interrupted => "interrupted".to_string(),
                Ending::Failed(error) => error.to_string(),
            },
            end_time_s: stepper.time(),
            nodes: model.rod.nodes,
            model: stepper.choice().map_or("full", |choice| choice.rung.name),
            model_reason: stepper.choice().and_then(|choice| choice.reason.clone()),
            forces: model.forces.iter().map(|force| force.name()).collect(),
            fluid_reason: scene.fluid_choice().map(|choice| choice.reason.clone()),
            fluid_error: scene
                .fluid_choice()
                .and_then(|choice| choice.errors)
                .map(|[motion, power]| FluidError { motion, power }),
            integrator: stepper.method(scene).to_string(),
            form: stepper.form(),
            time_step_s: match stepper.pace() {
                StepControl::Fixed(step) => step,
                StepControl::Adaptive(_) => elapsed / meter.totals.steps.max(1) as f64,
            },
            tolerance: match stepper.pace() {
                StepControl::Fixed(_) => None,
                StepControl::Adaptive(tolerance) => Some(tolerance),
            },
            steps: meter.totals.steps,
            rejected_steps: meter.totals.rejections,
            newton_iterations: work.newton_iterations,
            factorisations: work.factorisations,
            linear_solver: match (stepper.form(), scene.solver.linear) {
                _ if stepper.view().dynamics.mechanics == Mechanics::Shape => "none",
                (Form::Chain, _) => "riccati",
                #[cfg(feature = "faer")]
                (Form::Positions, SolverChoice::FaerLu) => "faer-lu",
                (Form::Positions, SolverChoice::Auto | SolverChoice::BlockBand) => "block-band",
            },
            linear_fallbacks: work.linear_fallbacks,
            step_halvings: meter.totals.halvings,
            newton_floor_stops: work.floor_stops,
            max_strain: meter.totals.max_strain,
            max_rotation_per_step_rad: meter.totals.max_rotation,
            x_com_m: now.com.x,
            y_com_m: now.com.y,
            net_displacement_m: displacement,
            max_lateral_excursion_m: meter.totals.max_lateral,
            com_path_m: meter.totals.path,
            initial_energy_j: meter.first_energy,
            stretching_energy_j: now.energy.stretching,
            bending_energy_j: now.energy.bending,
            kinetic_energy_j: now.energy.kinetic,
            fluid_energy_j: now.energy.fluid,
            mean_stretching_energy_j: mean(meter.totals.energy_time.stretching),
            mean_bending_energy_j: mean(meter.totals.energy_time.bending),
            mean_kinetic_energy_j: mean(meter.totals.energy_time.kinetic),
            actuation_work_j: actuation,
            viscous_work_j: viscous,
            wake_work_j: wake,
            spray_work_j: spray,
            other_work_j: other,
            load_work_j: load,
            head_work_j: head,
            flow_work_j: flow,
            mean_actuation_power_w: mean(actuation),
            mean_viscous_power_w: mean(viscous),
            mean_wake_power_w: mean(wake),
            mean_spray_power_w: mean(spray),
            mean_load_power_w: mean(load),
            mean_head_power_w: mean(head),
            mean_flow_power_w: mean(flow),
            numerical_dissipation_j: meter.numerical_dissipation(),
            rod_momentum_n_s: now.momentum.rod.into(),
            fluid_momentum_n_s: now.momentum.fluid.into(),
            drag_impulse_n_s: meter.totals.impulse.drag.into(),
            wake_impulse_n_s: meter.totals.impulse.wake.into(),
            flow_impulse_n_s: meter.totals.impulse.flow.into(),
            load_impulse_n_s: meter.totals.impulse.load.into(),
            head_impulse_n_s: meter.totals.impulse.head.into(),
            momentum_defect_n_s: meter.momentum_defect().into(),
            notes: notes(scene, model, meter, &stepper.state().q, stepper.pace(), warnings),
            cost_of_transport: swims.then(|| actuation / (model.rod.total_mass() * GRAVITY * displacement.abs())),
            efficiency: match &model.head {
                Some(_) => held(&cycle::EFFICIENCY),
                None => dynamics.towing_force(speed).filter(|_| swims).map(|drag| drag * speed * elapsed / actuation),
            },
            head_force_n: model.head.as_ref().map(|_| now.head_force.into()),
            head_moment_n_m: model.head.as_ref().map(|_| now.head_moment),
            mean_head_force_n: held(&cycle::HEAD_FORCE_X).zip(held(&cycle::HEAD_FORCE_Y)).map(|(x, y)| [x, y]),
            mean_thrust_n: held(&cycle::THRUST),
            mean_head_moment_n_m: held(&cycle::HEAD_MOMENT),
            max_head_force_n: model.head.as_ref().map(|_| meter.totals.max_on_head[0]),
            max_head_moment_n_m: model.head.as_ref().map(|_| meter.totals.max_on_head[1]),
            cycles,
            wall_s: outcome.wall.as_secs_f64(),
            verification: None,
            final_positions_m: stepper.state().q.chunks_exact(2).map(|p| [p[0], p[1]]).collect(),
        }
    }
}
