//! One run of a study: a scene with a given model, method and step, its cost, and the compared quantities.

use std::fmt;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::cycle::{self, CycleMeasure};
use crate::diagnostics::rounding_energy;
use crate::error::{Error, Result};
use crate::integrator::{METHODS, Method};
use crate::metrics::Power;
use crate::reduced::{FULL, MODELS, ModelKind};
use crate::scene::Scene;
use crate::stepper::Stepper;
use crate::system::State;

/// A run is repeated until all repetitions together took this long, or this many were made; the fastest counts.
const MIN_MEASURED_TIME: Duration = Duration::from_millis(100);
const MAX_REPETITIONS: u32 = 30;

/// A run is aborted if the defect of its energy balance exceeds this multiple of the largest energy or work, since it only grows.
const MAX_ENERGY_DEFECT: f64 = 1e3;

/// Energies below this multiple of the rounding energy are noise; a third of it was measured over 10⁴ steps at rest.
const ENERGY_NOISE: f64 = 1e3;

/// A tip is at rest if it moves by less than this fraction of the length.
const MIN_TRAVEL: f64 = 1e-9;

/// Parameters that are compared in addition to the defaults: the source study's Newmark.
const EXTRA_PARAMETERS: &[(&str, &[f64])] = &[("newmark", &[0.5, 0.5])];

/// A model, and for the full model the integrator with its parameters.
#[derive(Clone, PartialEq)]
pub struct SimulationMethod {
    /// The kind of model.
    pub kind: &'static ModelKind,
    /// The integrator; cheaper models have their own.
    pub method: &'static Method,
    /// Values of its parameters, in order.
    pub values: Vec<f64>,
}

impl PartialEq for Method {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl PartialEq for ModelKind {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl fmt::Display for SimulationMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.is_full() {
            return f.write_str(self.kind.name);
        }
        f.write_str(self.method.name)?;
        let values: Vec<_> = self.values.iter().map(f64::to_string).collect();
        if values.is_empty() { Ok(()) } else { write!(f, "({})", values.join(", ")) }
    }
}

impl fmt::Debug for SimulationMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl SimulationMethod {
    /// The full model with an integrator.
    pub fn whole(method: &'static Method, values: Vec<f64>) -> Self {
        Self { kind: &FULL, method, values }
    }

    /// The full model with the integrator `name` and its default parameters.
    pub fn named(name: &str) -> Option<Self> {
        Method::named(name).map(|method| Self::whole(method, method.defaults()))
    }

    /// The model and integrator of `scene`.
    pub fn own(scene: &Scene) -> Option<Self> {
        let (method, values) = scene.method().ok()?;
        Some(Self { kind: scene.choice().ok()?.kind, method, values })
    }

    /// The full model with each integrator and its default parameters, other parameters to compare, and those of `scene`.
    pub fn all(scene: &Scene) -> Vec<Self> {
        let mut all = Vec::new();
        for method in METHODS {
            all.push(Self::whole(method, method.defaults()));
            let also = EXTRA_PARAMETERS.iter().filter(|(name, _)| *name == method.name);
            all.extend(also.map(|(_, values)| Self::whole(method, values.to_vec())));
        }
        if let Ok((method, values)) = scene.method() {
            let own = Self::whole(method, values);
            if !all.contains(&own) {
                all.push(own);
            }
        }
        all
    }

    /// The cheaper models of `scene`.
    pub fn cheaper(scene: &Scene) -> Vec<Self> {
        let Ok((method, values)) = scene.method() else { return Vec::new() };
        let kinds = MODELS.iter().filter(|kind| kind.method.is_some() && (scene.drag.is_some() || !kind.needs_drag));
        kinds.map(|kind| Self { kind, method, values: values.clone() }).collect()
    }

    /// True if `name` is the name of its integrator or, for a cheaper model, of the model.
    pub fn is(&self, name: &str) -> bool {
        name == if self.is_full() { self.method.name } else { self.kind.name }
    }

    /// True for the full model.
    pub fn is_full(&self) -> bool {
        *self.kind == FULL
    }

    /// `scene` with this model and integrator.
    pub fn of(&self, scene: &Scene) -> Scene {
        scene.with_method(self.method, &self.values).with_model(self.kind)
    }
}

/// Means over cycles in tables of runs.
pub const TABLE_MEASURES: [CycleMeasure; 3] = [cycle::FORWARD_SPEED, cycle::THRUST, cycle::EFFICIENCY];

/// How a run failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Failure {
    /// Newton's method did not converge, or met a non-finite number.
    Newton,
    /// The rod folded over, or an edge collapsed.
    Fold,
    /// The step could not be started, or became too small.
    Step,
}

impl Failure {
    fn of(error: &Error) -> Self {
        match error {
            Error::FoldOver { .. } | Error::EdgeCollapse { .. } => Self::Fold,
            Error::NotConverged { .. } | Error::NotFinite { .. } => Self::Newton,
            _ => Self::Step,
        }
    }
}

/// The result of a run.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StudyRun {
    /// The kind of failure, its time (s), and the error message.
    pub failure: Option<(Failure, f64, String)>,
    /// Number of steps.
    pub steps: u64,
    /// Newton iterations, each with one linear solve.
    pub iterations: u64,
    /// Factorisations.
    pub factorisations: u64,
    /// Number of halved steps.
    pub halvings: u64,
    /// Wall-clock time of the fastest repetition, s.
    pub wall_s: f64,
    /// Processor time of the fastest repetition, s, which other processes hardly affect.
    pub processor_s: f64,
    /// Length of the rod, m.
    pub length: f64,
    /// Displacement of the centre of mass, m.
    pub displacement: [f64; 2],
    /// Mean force (N) on a held head over the run, and the mean of its modulus.
    #[serde(default)]
    pub head_force: Option<([f64; 2], f64)>,
    /// Means of [`TABLE_MEASURES`] over the last whole cycles.
    #[serde(default)]
    pub cycles: [Option<f64>; TABLE_MEASURES.len()],
    /// Energy put in by actuation, loads, head and flow, J.
    pub work_in: f64,
    /// The largest value of this energy during the run; it exceeds the final one if energy is returned.
    pub largest_work_in: f64,
    /// Tip (m) at the start and at equidistant times, until the end or the failure.
    pub tip: Vec<[f64; 2]>,
    /// Defect of the energy balance over the largest energy or work so far: its maximum since the previous sample.
    pub created: Vec<f64>,
}

/// Options of a run.
#[derive(Debug, Clone, Copy)]
pub struct RunOptions {
    /// Number of equidistant times at which tip and energy are sampled.
    pub samples: usize,
    /// Initial displacement of the tip, over the length; zero for a run that takes the same steps without displacement.
    pub push: Option<f64>,
    /// True to halve a failing step, false to end the run.
    pub halving: bool,
    /// True to repeat a short run in order to time it.
    pub timed: bool,
}

impl StudyRun {
    /// The cost columns in tables of studies.
    pub const COSTS: [&'static str; 6] =
        ["steps", "newton_iterations", "linear_solves", "step_halvings", "wall_s", "processor_s"];

    /// The values of [`COSTS`](Self::COSTS).
    pub fn costs(&self) -> [Value; 6] {
        let counts = [self.steps, self.iterations, self.factorisations, self.halvings];
        let [steps, iterations, factorisations, halvings] = counts.map(|count| json!(count));
        [steps, iterations, factorisations, halvings, json!(self.wall_s), json!(self.processor_s)]
    }

    /// Runs `scene`; `None` if it was interrupted.
    pub fn of(scene: &Scene, options: RunOptions, interrupted: &AtomicBool) -> Option<Self> {
        let mut run = Self::once(scene, options, interrupted)?;
        let (mut total, mut repetitions) = (run.processor_s, 1);
        while options.timed && total < MIN_MEASURED_TIME.as_secs_f64() && repetitions < MAX_REPETITIONS {
            let again = Self::once(scene, options, interrupted)?;
            run.wall_s = run.wall_s.min(again.wall_s);
            run.processor_s = run.processor_s.min(again.processor_s);
            (total, repetitions) = (total + again.processor_s, repetitions + 1);
        }
        Some(run)
    }

    fn once(scene: &Scene, options: RunOptions, interrupted: &AtomicBool) -> Option<Self> {
        let mut run = Self {
            failure: None,
            steps: 0,
            iterations: 0,
            factorisations: 0,
            halvings: 0,
            wall_s: 0.0,
            processor_s: 0.0,
            length: scene.rod.length_m.get(),
            displacement: [0.0; 2],
            head_force: None,
            cycles: [None; TABLE_MEASURES.len()],
            work_in: 0.0,
            largest_work_in: 0.0,
            tip: Vec::with_capacity(options.samples + 1),
            created: Vec::with_capacity(options.samples + 1),
        };
        let mut stepper = match Stepper::of(scene) {
            Ok(stepper) => stepper,
            Err(error) => {
                run.failure = Some((Failure::of(&error), 0.0, error.to_string()));
                return Some(run);
            }
        };
        stepper.halve_failing_steps(options.halving);
        let (clock, processor) = (Instant::now(), processor_time());
        let outcome = run.drive(scene, &mut stepper, options, interrupted);
        run.wall_s = clock.elapsed().as_secs_f64();
        run.processor_s = processor_time().zip(processor).map_or(run.wall_s, |(now, then)| now - then);
        match outcome {
            Ok(ControlFlow::Continue(())) => {}
            Ok(ControlFlow::Break(())) => return None,
            Err(error) => run.failure = Some((Failure::of(&error), stepper.time(), error.to_string())),
        }
        let (metrics, work) = (stepper.metrics(), stepper.work());
        run.steps = metrics.totals.steps;
        run.halvings = metrics.totals.halvings;
        run.iterations = work.newton_iterations;
        run.factorisations = work.factorisations;
        run.displacement = (metrics.now.com - metrics.first.1).into();
        run.head_force = stepper.cycles().since_start().filter(|_| stepper.model().head.is_some()).map(|run| {
            let (mean, modulus) = run.mean_head_force();
            (mean.into(), modulus)
        });
        let averages = stepper.cycles().averages(stepper.view().dynamics);
        run.cycles = TABLE_MEASURES.map(|measure| averages.mean(&measure));
        run.work_in = put_in(&metrics.totals.work);
        Some(run)
    }

    fn drive(
        &mut self,
        scene: &Scene,
        stepper: &mut Stepper,
        options: RunOptions,
        interrupted: &AtomicBool,
    ) -> Result<ControlFlow<()>> {
        let duration = scene.solver.duration_s.get();
        let tip = |state: &State| state.q.as_chunks().0.last().copied().unwrap_or_default();
        self.tip.push(tip(stepper.state()));
        self.created.push(0.0);
        // The energies of a rod at rest are rounding errors.
        let (mut scale, mut largest) = (
            stepper
                .metrics()
                .first_energy
                .max(stepper.metrics().now.imbalance(&stepper.model().rod))
                .max(ENERGY_NOISE * rounding_energy(&stepper.model().rod, &stepper.state().q)),
            0.0_f64,
        );
        if let Some(part) = options.push {
            displace_tip(stepper, scene, part)?;
        }
        let mut stopped = false;
        let mut failed = None;
        let spans: Vec<f64> =
            if stepper.time() > 0.0 { vec![duration - stepper.time()] } else { scene.spans().collect() };
        for span in spans {
            let outcome = stepper.advance_until_failure(span, |stepper| {
                stopped = interrupted.load(Ordering::Relaxed);
                let metrics = stepper.metrics();
                let work = metrics.totals.work;
                let parts = [
                    work.actuation,
                    work.material,
                    work.viscous,
                    work.wake,
                    work.spray,
                    work.load,
                    work.head,
                    work.flow,
                    work.other,
                ];
                scale = parts.iter().fold(scale, |max, x| max.max(x.abs()));
                self.largest_work_in = self.largest_work_in.max(put_in(&work).abs());
                let excess = -metrics.numerical_dissipation();
                if excess > 0.0 {
                    largest = largest.max(excess / scale.max(f64::MIN_POSITIVE));
                }
                while self.tip.len() <= options.samples {
                    let t = duration * self.tip.len() as f64 / options.samples as f64;
                    // The last sample is at the end itself, regardless of rounding.
                    let t = if self.tip.len() == options.samples && stepper.time() >= t * (1.0 - 1e-9) {
                        stepper.time()
                    } else {
                        t
                    };
                    if t > stepper.time() {
                        break;
                    }
                    match stepper.at(t, |view| tip(view.state)) {
                        Ok(tip) => self.tip.push(tip),
                        // Dense output does not exist inside the first part of a halved step; the end of the step is used.
                        Err(Error::OutsideStep { .. }) => self.tip.push(tip(stepper.state())),
                        Err(error) => {
                            failed = Some(error);
                            return ControlFlow::Break(());
                        }
                    }
                    self.created.push(largest);
                    largest = 0.0;
                }
                let exploded = largest.max(self.created.last().copied().unwrap_or(0.0)) > MAX_ENERGY_DEFECT;
                if stopped || exploded { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            });
            self.created.push(largest); // the maximum after the last sample
            let whole = outcome?;
            if let Some(error) = failed {
                return Err(error);
            }
            if stopped {
                return Ok(ControlFlow::Break(()));
            }
            if !whole {
                return Ok(ControlFlow::Continue(()));
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    /// The extent of the tip's path, m; at least the rounding error of a tip at rest.
    pub fn travel(&self) -> f64 {
        let first = self.tip.first().copied().unwrap_or_default();
        let distance = |tip: &[f64; 2]| (tip[0] - first[0]).hypot(tip[1] - first[1]);
        self.tip.iter().map(distance).fold(MIN_TRAVEL * self.length, f64::max)
    }

    /// True if the tip moves by more than its rounding error.
    pub fn moves(&self) -> bool {
        self.travel() > MIN_TRAVEL * self.length
    }

    /// True if the run reached its end.
    pub fn is_complete(&self, options: RunOptions) -> bool {
        self.failure.is_none() && self.tip.len() > options.samples
    }
}

/// Processor time of this thread, s, if the system reports it.
fn processor_time() -> Option<f64> {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Some(time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64)
    }
    #[cfg(not(unix))]
    None
}

/// Work of actuation, loads, head and flow.
fn put_in(work: &Power) -> f64 {
    work.actuation + work.load + work.head + work.flow
}

/// Displaces the tip across the rod by about this fraction of the length. It is pushed and stopped within two short steps, so that
/// no momentum remains.
fn displace_tip(stepper: &mut Stepper, scene: &Scene, part: f64) -> Result<()> {
    let rod = &stepper.model().rod;
    let step = 0.01 * scene.typical_step().min(0.01 * scene.solver.duration_s.get());
    let last = rod.nodes - 1;
    let mut force = vec![0.0; rod.nodes];
    let size = part * rod.length * rod.mass[last] / (step * step);
    for size in [size, -size] {
        force[last] = size;
        stepper.set("force_y_n", &force)?;
        stepper.do_step(step)?;
    }
    force.fill(0.0);
    stepper.set("force_y_n", &force)
}
