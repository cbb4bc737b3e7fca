//! A differentiable simulation of a scene with fixed steps.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::checkpoints::{Checkpoints, StepSolver};
use super::controls::Controls;
use super::finite_difference::FiniteDifference;
use super::output::Output;
use super::parameter::{JointDirection, Parameter};
use super::time_grid::TimeGrid;
use super::trajectory::Trajectory;
use crate::actuation::Actuation;
use crate::error::{Error, Result};
use crate::integrator::{Integrator, StepControl, StepWeights};
use crate::linear::{Direction, SolverChoice};
use crate::model::{Dynamics, Inputs, Model, chain};
use crate::newton::Newton;
use crate::scene::{Scene, whole_steps};
use crate::system::{Form, State, System};

/// A differentiable simulation of a scene, with the current values of its parameters.
#[derive(Debug)]
pub struct Problem {
    pub(super) dynamics: Dynamics,
    /// The actuation of the scene.
    actuation: Option<Box<dyn Actuation>>,
    /// The finite differences for each [`Parameter::OfScene`].
    pub finite_differences: Vec<FiniteDifference>,
    /// The directions for each [`Parameter::Along`].
    pub directions: Arc<[JointDirection]>,
    pub(super) integrator: Box<dyn Integrator>,
    tolerance: f64,
    linear: SolverChoice,
    pub(super) steps: TimeGrid,
    pub(super) controls: Arc<Controls>,
    /// Initial positions and velocities along both axes, if given instead of those of the scene.
    pub(super) start: GivenStart,
    /// Set by another thread to interrupt the computation.
    interrupted: Arc<AtomicBool>,
}

/// Given initial positions and velocities along x and y. Those that are `None` are computed from the scene and depend on its
/// parameters.
#[derive(Debug, Clone, Default)]
pub(super) struct GivenStart {
    parts: [[Option<Vec<f64>>; 2]; 2],
}

impl GivenStart {
    /// Writes the given values to the positions and velocities of `state`, two entries per node. Returns true if there are any.
    fn write(&self, state: [&mut [f64]; 2]) -> bool {
        self.each(state, |to, value| *to = value);
        self.parts.iter().flatten().any(Option::is_some)
    }

    /// Sets the `derivatives` of the given values to zero.
    pub(super) fn hold(&self, derivatives: [&mut [f64]; 2]) {
        self.each(derivatives, |to, _| *to = 0.0);
    }

    fn each(&self, state: [&mut [f64]; 2], change: impl Fn(&mut f64, f64)) {
        for (to, axes) in state.into_iter().zip(&self.parts) {
            for (axis, given) in axes.iter().enumerate() {
                let to = to.iter_mut().skip(axis).step_by(2);
                to.zip(given.iter().flatten()).for_each(|(to, value)| change(to, *value));
            }
        }
    }
}

impl Problem {
    /// The differentiable simulation of a scene.
    ///
    /// # Errors
    /// Errors of [`Scene::model`]; [`Error::Scene`] for a scene with adaptive steps, an integrator of several stages, the chain
    /// form, a mesh that needs it, or a reduced model.
    pub fn of(scene: &Scene) -> Result<Self> {
        Self::of_model(scene, scene.model()?)
    }

    /// The same for a `model` that differs from the scene's own, with the solver settings of the scene.
    ///
    /// # Errors
    /// Errors of [`of`](Self::of); [`Error::WrongLength`] for a model with another number of nodes.
    pub fn of_model(scene: &Scene, model: Model) -> Result<Self> {
        scene.fits(&model)?;
        let Some(law) = model.forces.global() else { return Self::without_derivatives(scene, model) };
        let problem = format!(
            "{:?} has no exact derivatives, because it is nonlocal; allowed: a local law, such as \"cox\"",
            law.name()
        );
        Err(Error::Scene { place: scene.name.clone(), key: "drag.law".to_string(), problem })
    }

    /// The same for any drag law, for simulations without derivatives.
    ///
    /// # Errors
    /// Errors of [`of`](Self::of), except those about the law.
    pub(crate) fn without_derivatives(scene: &Scene, model: Model) -> Result<Self> {
        let refuse = |key: &str, problem: &str| {
            Err(Error::Scene { place: scene.name.clone(), key: key.to_string(), problem: problem.to_string() })
        };
        let StepControl::Fixed(length) = scene.step_control() else {
            let step = 0.5 * scene.typical_step();
            let problem =
                format!("derivatives need fixed steps; allowed: solver.time_step_s, as {step:e}, in its place");
            return refuse("solver.tolerance", &problem);
        };
        if scene.names_reduced_model() {
            let problem = format!(
                "found {:?}; derivatives and designs need the full model; allowed: \"full\", or \"auto\", which it then replaces",
                scene.solver.model
            );
            return refuse("solver.model", &problem);
        }
        let integrator = scene.integrator()?;
        if integrator.rule(length).is_none() {
            let allowed = "derivatives need a method of one stage; allowed: implicit-euler, newmark, generalized-alpha";
            return refuse("solver.integrator", allowed);
        }
        if scene.form(&model.rod) == Form::Chain {
            let allowed = if chain::contracts(&model.rod, length) {
                "\"positions\", where solves of derivatives are refined"
            } else {
                "fewer nodes, at which positions can be solved for"
            };
            return refuse("solver.form", &format!("derivatives need positions as unknowns; allowed: {allowed}"));
        }
        scene.check_mesh(&model.rod, Form::Positions)?;
        let (whole, last) = whole_steps(scene.solver.duration_s.get(), length);
        Ok(Self {
            dynamics: Dynamics::new(Arc::new(model)),
            actuation: scene.model()?.actuation.map(|(actuation, _)| actuation),
            finite_differences: Vec::new(),
            directions: Arc::default(),
            integrator,
            tolerance: scene.newton_tolerance(),
            linear: scene.solver.linear,
            steps: TimeGrid { whole: whole as usize, length, last },
            controls: Arc::default(),
            start: GivenStart::default(),
            interrupted: Arc::default(),
        })
    }

    /// Sets natural curvature and forces over time.
    ///
    /// # Errors
    /// [`Error::WrongLength`]; [`Error::Derivative`] for a natural curvature together with a drive with a limit or a lag.
    pub fn set_controls(&mut self, controls: Controls) -> Result<()> {
        let (rod, times) = (&self.model().rod, self.steps.count() + 1);
        let lists = [
            ("natural_curvature_1_m", &controls.natural, rod.joints().len()),
            ("force_x_n", &controls.force, 2 * rod.nodes),
        ];
        for (name, values, width) in lists {
            if let Some(values) = values
                && values.len() != times * width
            {
                return Err(Error::WrongLength { name, expected: times * width, found: values.len() });
            }
        }
        if controls.natural.is_some() && self.model().filters_drive() {
            let problem = "a natural curvature over time together with a drive with a limit or a lag has no derivatives; allowed: without \
                 `actuation.lag_s`, `largest_1_m` and `largest_moment_n_m`";
            return Err(Error::Derivative { problem: problem.to_string() });
        }
        self.controls = controls.into();
        Ok(())
    }

    /// Sets initial positions (m) and velocities (m/s), two entries per node. Node 0 of a held head follows the head regardless
    /// of the given values, and its derivatives are zero.
    ///
    /// # Errors
    /// [`Error::WrongLength`].
    pub fn set_start(&mut self, positions: Vec<f64>, velocities: Vec<f64>) -> Result<()> {
        let expected = 2 * self.model().rod.nodes;
        for (name, values) in [("x_m", &positions), ("vx_m_s", &velocities)] {
            if values.len() != expected {
                return Err(Error::WrongLength { name, expected, found: values.len() });
            }
        }
        let along = |values: &[f64], axis: usize| Some(values.iter().skip(axis).step_by(2).copied().collect());
        self.start.parts = [positions, velocities].map(|values| [along(&values, 0), along(&values, 1)]);
        Ok(())
    }

    /// Sets initial positions (m), or `velocities` (m/s), of the nodes along `axis`, 0 or 1. All others are those of the scene.
    ///
    /// # Errors
    /// [`Error::WrongLength`].
    pub(super) fn set_first(&mut self, velocities: bool, axis: usize, values: Vec<f64>) -> Result<()> {
        const NAMES: [[&str; 2]; 2] = [["x_m", "y_m"], ["vx_m_s", "vy_m_s"]];
        let (part, expected) = (usize::from(velocities), self.model().rod.nodes);
        if values.len() != expected {
            return Err(Error::WrongLength { name: NAMES[part][axis], expected, found: values.len() });
        }
        self.start.parts[part][axis] = Some(values);
        Ok(())
    }

    /// True if initial positions, or velocities, along `axis` are given.
    pub(super) fn has_first(&self, velocities: bool, axis: usize) -> bool {
        self.start.parts[usize::from(velocities)][axis].is_some()
    }

    /// Returns an error for parameters and outputs that the model does not have, for which derivatives would be zero.
    pub(super) fn check(&self, parameters: &[Parameter], outputs: &[Output]) -> Result<()> {
        let (model, finite_differences) = (self.model(), self.finite_differences.len());
        parameters.iter().try_for_each(|parameter| parameter.check(model, finite_differences, &self.directions))?;
        outputs.iter().try_for_each(|output| output.check(model))
    }

    /// The initial positions and velocities, two entries per node.
    pub fn first(&mut self) -> [Vec<f64>; 2] {
        self.controls.apply(&mut self.dynamics, 0);
        let State { q, v, .. } = self.dynamics.first_state();
        [q, v].map(|of_nodes| self.dynamics.of_nodes(of_nodes))
    }

    /// The current model.
    pub fn model(&self) -> &Model {
        &self.dynamics.model
    }

    /// The inputs, which are constant over the simulation. [`finite_differences`](Self::finite_differences) use the inputs of the
    /// scene.
    pub fn inputs(&mut self) -> &mut Inputs {
        &mut self.dynamics.inputs
    }

    /// Sets the phase φ₀ (rad) subtracted inside the actuation's sine.
    pub fn set_phase(&mut self, phase: f64) {
        self.everywhere().for_each(|(dynamics, _)| dynamics.inputs.phase_offset = phase);
    }

    /// Bending stiffness EI_k of the joints, N m², in order.
    pub fn stiffness(&self) -> Vec<f64> {
        let rod = &self.model().rod;
        rod.joints().map(|k| rod.joint_stiffness(k)).collect()
    }

    /// Sets the bending stiffness EI_k of the joints, N m², in order.
    ///
    /// # Errors
    /// [`Error::WrongLength`]; [`Error::BadValue`] for a number that is not positive.
    pub fn set_stiffness(&mut self, values: &[f64]) -> Result<()> {
        let (name, expected) = ("joint_stiffness_n_m2", self.model().rod.joints().len());
        if values.len() != expected {
            return Err(Error::WrongLength { name, expected, found: values.len() });
        }
        if let Some(value) = values.iter().copied().find(|value| !(value.is_finite() && *value > 0.0)) {
            return Err(Error::BadValue { name, value, allowed: "positive numbers" });
        }
        for dynamics in self.everywhere().map(|(dynamics, _)| dynamics) {
            let Some(Model { rod, .. }) = Arc::get_mut(&mut dynamics.model) else { continue };
            for (k, ei) in rod.joints().zip(values) {
                rod.joint[k] = ei / (rod.joint_part(k) * rod.spacing);
            }
        }
        Ok(())
    }

    /// Sets factors of the amplitude of the scene's actuation, and phases (rad) subtracted inside its sine, at the joints in
    /// order.
    ///
    /// # Errors
    /// [`Error::WrongLength`]; [`Error::BadValue`] for a number that is not finite.
    pub fn set_actuation(&mut self, factors: &[f64], phases: &[f64]) -> Result<()> {
        let joints = self.model().rod.joints();
        for (name, values) in [("joint_amplitude_factor", factors), ("joint_phase_rad", phases)] {
            if values.len() != joints.len() {
                return Err(Error::WrongLength { name, expected: joints.len(), found: values.len() });
            }
            if let Some(value) = values.iter().copied().find(|value| !value.is_finite()) {
                return Err(Error::BadValue { name, value, allowed: "finite numbers" });
            }
        }
        let nodes = self.model().rod.nodes;
        let along = |values: &[f64], rest: f64| {
            let mut all = vec![rest; nodes];
            all[joints.clone()].copy_from_slice(values);
            all
        };
        let (factors, phases) = (along(factors, 1.0), along(phases, 0.0));
        for (dynamics, own) in self.everywhere() {
            if let (Some(model), Some(own)) = (Arc::get_mut(&mut dynamics.model), own)
                && let Some((actuation, _)) = &mut model.actuation
            {
                *actuation = own.profiled(&factors, &phases);
            }
        }
        Ok(())
    }

    /// The scene and its perturbed copies, each with its own actuation.
    fn everywhere(&mut self) -> impl Iterator<Item = (&mut Dynamics, Option<&dyn Actuation>)> {
        let scenes = self.finite_differences.iter_mut().flat_map(|difference| &mut difference.scenes);
        let perturbed = scenes.map(|scene| (&mut scene.dynamics, scene.actuation.as_deref()));
        std::iter::once((&mut self.dynamics, self.actuation.as_deref())).chain(perturbed)
    }

    /// A flag that another thread sets to interrupt a simulation or an adjoint pass at the next step, with [`Error::Interrupted`].
    pub fn interrupt(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.interrupted)
    }

    /// A function that returns [`Error::Interrupted`] if that flag is set.
    pub(super) fn check_interruption(&self) -> impl Fn() -> Result<()> + use<> {
        let flag = self.interrupt();
        move || if flag.load(Ordering::Relaxed) { Err(Error::Interrupted) } else { Ok(()) }
    }

    /// All times, including the start, s.
    pub fn times(&self) -> Vec<f64> {
        (0..=self.steps.count()).map(|n| self.steps.time(n)).collect()
    }

    /// The weights of the steps: of full ones, and of a shorter last one.
    pub(super) fn rules(&self) -> Result<[StepWeights; 2]> {
        let rule = |h: f64| self.integrator.rule(h).ok_or(Error::Step(h)); // `of` has checked for one stage
        Ok([rule(self.steps.length)?, rule(self.steps.last.unwrap_or(self.steps.length))?])
    }

    /// The solver of the steps.
    pub(super) fn newton(&self) -> Result<Newton> {
        Newton::with(Form::Positions, self.linear, self.dynamics.nodes(), self.tolerance)
    }

    /// Empty checkpoints for an adjoint of the simulation.
    pub(crate) fn checkpoints(&self) -> Checkpoints {
        Checkpoints::of(self.model().unknowns(), self.steps.count() + 1)
    }

    /// Advances the simulation, and calls `look` at each time with its index, the state, and the size (s) of the previous step.
    pub(super) fn advance(
        &mut self,
        mut look: impl FnMut(&mut Dynamics, usize, &State, f64) -> Result<()>,
    ) -> Result<()> {
        let check_interruption = self.check_interruption();
        let newton = self.newton()?;
        let Self { dynamics, integrator, controls, steps: grid, start, .. } = self;
        let mut steps = StepSolver { newton, integrator: integrator.as_mut(), controls, grid: *grid };
        controls.apply(dynamics, 0);
        let mut state = dynamics.first_state();
        if start.write([&mut state.q, &mut state.v]) {
            dynamics.move_to(0.0, &mut state);
        }
        steps.newton.iterate(dynamics, &mut state, Direction::ACCELERATIONS)?;
        steps.integrator.begin(&mut state);
        let mut next = state.clone();
        look(dynamics, 0, &state, 0.0)?;
        for n in 1..=steps.grid.count() {
            check_interruption()?;
            steps.step(dynamics, n, [&mut state, &mut next])?;
            look(dynamics, n, &state, steps.grid.length(n))?;
        }
        Ok(())
    }

    /// Simulates.
    ///
    /// # Errors
    /// The error of a step that fails; failing steps are not halved.
    pub fn simulate(&mut self) -> Result<Trajectory> {
        let mut trajectory = Trajectory::default();
        self.advance(|_, _, state, _| {
            trajectory.push(state);
            Ok(())
        })?;
        Ok(trajectory)
    }
}
