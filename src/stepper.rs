//! The stepper: init, do_step, get, set, save and restore over the table of variables. Every face goes through it.

use std::sync::Arc;

use crate::error::{Error, Result, nearest};
use crate::integrator::Integrator;
use crate::metrics::{Meter, Reading};
use crate::model::{Dynamics, Inputs, Model};
use crate::newton::{Newton, Work};
use crate::scene::Scene;
use crate::system::{Direction, Form, State, System};
use crate::variable::{Causality, VARIABLES, Variable, View};

/// How often a failing step is halved before the failure is reported: down to 1/1024 of it.
const MAX_HALVINGS: u32 = 10;

/// A step length within this of a multiple of Δt, relative, is that multiple.
const STEP_ROUNDING: f64 = 1e-9;

/// A simulation that a host drives.
#[derive(Debug)]
pub struct Stepper {
    dynamics: Dynamics,
    integrator: Box<dyn Integrator>,
    newton: Newton,
    time_step: f64,
    clock: Clock,
    state: State,
    meter: Meter,
    variables: Vec<&'static Variable>,
    // Room to work in; nothing of a step remains here.
    next: State,
    reading: Reading,
}

/// Time as an integer number of steps, so that it never drifts: t = origin + count·Δt.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Clock {
    origin: f64,
    count: u64,
}

/// Everything of a [`Stepper`] that changes: time, state, inputs, totals and counts. Not copied: the model, and the
/// matrices and factors, which every step makes anew.
#[derive(Debug, Clone)]
pub struct Snapshot {
    clock: Clock,
    state: State,
    inputs: Inputs,
    meter: Meter,
    work: Work,
}

impl Stepper {
    /// Prepares a run of `model` at time zero with internal steps of at most `time_step` (s), solved by `newton`.
    ///
    /// # Errors
    /// Whatever is wrong with the first state.
    pub fn init(
        model: impl Into<Arc<Model>>,
        integrator: Box<dyn Integrator>,
        mut newton: Newton,
        time_step: f64,
    ) -> Result<Self> {
        let mut dynamics = Dynamics::new(model.into());
        let mut state = dynamics.first_state_in(newton.form());
        // The accelerations are linear in f, so one iteration solves the equation of motion for them.
        newton.iterate(&mut dynamics, &mut state, Direction { q: 0.0, v: 0.0, a: 1.0 })?;
        newton.work = Work::default();
        let meter = Meter::start(&mut dynamics, &state)?;
        let variables = VARIABLES.iter().filter(|variable| variable.exists_in(&dynamics.model)).collect();
        Ok(Self {
            integrator,
            newton,
            time_step,
            clock: Clock { origin: state.t, count: 0 },
            next: state.clone(),
            reading: Reading::new(dynamics.nodes()),
            meter,
            state,
            variables,
            dynamics,
        })
    }

    /// The start of a scene's run.
    ///
    /// # Errors
    /// Those of [`Scene::model`], [`Newton::with`] and [`init`](Self::init).
    pub fn of(scene: &Scene) -> Result<Self> {
        let solver = &scene.solver;
        let (model, time_step) = (scene.model()?, solver.time_step_s.get());
        let form = solver.form.of(&model.rod, time_step);
        let newton = Newton::with(form, solver.linear, model.rod.nodes, solver.newton_tolerance.get())?;
        Self::init(model, scene.integrator()?, newton, time_step)
    }

    /// Time now, s.
    pub fn time(&self) -> f64 {
        self.state.t
    }

    /// Positions, velocities and accelerations now.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The running totals and the last reading.
    pub fn meter(&self) -> &Meter {
        &self.meter
    }

    /// What Newton's method has done.
    pub fn work(&self) -> Work {
        self.newton.work
    }

    /// The form that Newton's method solves.
    pub fn form(&self) -> Form {
        self.newton.form()
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.dynamics.model
    }

    /// The variables that this scene has.
    pub fn variables(&self) -> &[&'static Variable] {
        &self.variables
    }

    /// What variables are read from.
    pub fn view(&self) -> View<'_> {
        View {
            dynamics: &self.dynamics,
            state: &self.state,
            meter: &self.meter,
            work: self.newton.work,
            time_step: self.time_step,
        }
    }

    /// Moves on by `h` (s) to exactly t + h, in ⌈h/Δt⌉ equal internal steps.
    ///
    /// # Errors
    /// [`Error::Step`] for an `h` that is not positive and finite or too small to move the time; else what went wrong
    /// inside, after which the last good state is the one that [`time`](Self::time) and [`get`](Self::get) show.
    pub fn do_step(&mut self, h: f64) -> Result<()> {
        let start = self.state.t;
        let parts = (h / self.time_step - STEP_ROUNDING).ceil().max(1.0);
        if !(h.is_finite() && start + h > start && parts < 9e15) {
            return Err(Error::Step(h));
        }
        let multiple = (h - parts * self.time_step).abs() <= STEP_ROUNDING * h;
        let part = if multiple { self.time_step } else { h / parts };
        let end_of = |clock: Clock, count: u64| {
            if multiple {
                clock.origin + (clock.count + count) as f64 * part
            } else if count as f64 == parts {
                start + h
            } else {
                start + count as f64 * part
            }
        };
        let (clock, parts) = (self.clock, parts as u64);
        let head = self.dynamics.inputs.head.clone();
        self.dynamics.aim_head(start, end_of(clock, parts));
        for count in 1..=parts {
            let end = end_of(clock, count);
            let outcome = self.advance(end, part, 0);
            self.clock = match outcome {
                Ok(()) if multiple => Clock { origin: clock.origin, count: clock.count + count },
                _ if self.state.t == start => clock,
                _ => Clock { origin: self.state.t, count: 0 },
            };
            if let Err(error) = outcome {
                if self.state.t == start {
                    self.dynamics.inputs.head = head; // it has not set out
                }
                self.dynamics.move_to(self.state.t, &mut self.state);
                return Err(error);
            }
            self.meter.steps += 1;
        }
        Ok(())
    }

    /// One step of `h` to time `end`, in halves where it fails.
    fn advance(&mut self, end: f64, h: f64, depth: u32) -> Result<()> {
        match self.attempt(end, h) {
            Err(error) if error.is_cured_by_smaller_step() && depth < MAX_HALVINGS => {
                self.meter.halvings += 1;
                self.advance(end - 0.5 * h, 0.5 * h, depth + 1)?;
                self.advance(end, 0.5 * h, depth + 1)
            }
            outcome => outcome,
        }
    }

    fn attempt(&mut self, end: f64, h: f64) -> Result<()> {
        self.next.t = end;
        self.integrator.step(&mut self.dynamics, &mut self.newton, &self.state, h, &mut self.next)?;
        self.reading.take(&mut self.dynamics, &self.next)?;
        let load = self.dynamics.load_work(&self.state.q, &self.next.q);
        self.meter.count(&mut self.reading, load, self.dynamics.model.rod.mass[0]);
        std::mem::swap(&mut self.state, &mut self.next);
        Ok(())
    }

    fn find(&self, name: &str) -> Result<&'static Variable> {
        self.variables.iter().copied().find(|variable| variable.name == name).ok_or_else(|| Error::UnknownVariable {
            name: name.to_string(),
            nearest: nearest(name, self.variables.iter().map(|variable| variable.name)),
        })
    }

    /// The values of a variable.
    ///
    /// # Errors
    /// [`Error::UnknownVariable`].
    pub fn get(&self, name: &str) -> Result<Vec<f64>> {
        let variable = self.find(name)?;
        let mut values = vec![0.0; variable.len(self.model())];
        variable.read(&self.view(), &mut values);
        Ok(values)
    }

    /// The value of a scalar variable, or the first of an array.
    ///
    /// # Errors
    /// [`Error::UnknownVariable`].
    pub fn get_scalar(&self, name: &str) -> Result<f64> {
        Ok(self.find(name)?.first(&self.view()))
    }

    /// Sets an input; it holds until it is set again. What it changes at once, such as the energy of a changed natural
    /// curvature, is counted at once.
    ///
    /// # Errors
    /// [`Error::UnknownVariable`], [`Error::NotAnInput`], [`Error::WrongLength`], [`Error::BadValue`], and
    /// [`Error::NotFinite`] for a value so large that energies overflow; nothing is changed then.
    pub fn set(&mut self, name: &str, values: &[f64]) -> Result<()> {
        let variable = self.find(name)?;
        if variable.causality != Causality::Input {
            return Err(Error::NotAnInput(variable.name));
        }
        let expected = variable.len(self.model());
        if values.len() != expected {
            return Err(Error::WrongLength { name: variable.name, expected, found: values.len() });
        }
        if let Some((value, allowed)) = variable.refused(values) {
            return Err(Error::BadValue { name: variable.name, value, allowed });
        }
        let before = self.dynamics.inputs.clone();
        variable.write(&mut self.dynamics, self.state.t, values).ok_or(Error::NotAnInput(variable.name))?;
        self.dynamics.move_to(self.state.t, &mut self.state);
        if let Err(error) = self.reading.take(&mut self.dynamics, &self.state) {
            self.dynamics.restore(&before);
            self.dynamics.move_to(self.state.t, &mut self.state);
            return Err(error);
        }
        self.meter.count(&mut self.reading, 0.0, self.dynamics.model.rod.mass[0]);
        Ok(())
    }

    /// A copy of everything that changes.
    pub fn save(&self) -> Snapshot {
        Snapshot {
            clock: self.clock,
            state: self.state.clone(),
            inputs: self.dynamics.inputs.clone(),
            meter: self.meter.clone(),
            work: self.newton.work,
        }
    }

    /// Goes back to a snapshot of this scene; what follows is equal to the bit to what followed then.
    ///
    /// # Errors
    /// [`Error::WrongLength`] for a snapshot of another number of nodes.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<()> {
        let (expected, found) = (self.state.q.len(), snapshot.state.q.len());
        if expected != found || self.state.links.len() != snapshot.state.links.len() {
            return Err(Error::WrongLength { name: "snapshot", expected, found });
        }
        self.clock = snapshot.clock;
        self.state.copy_from(&snapshot.state);
        self.dynamics.restore(&snapshot.inputs);
        self.dynamics.move_to(self.state.t, &mut self.state);
        self.meter.clone_from(&snapshot.meter);
        self.newton.work = snapshot.work;
        Ok(())
    }
}
