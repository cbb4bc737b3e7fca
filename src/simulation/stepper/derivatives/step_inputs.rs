//! How an input that a host gives for a step acts on the rod during the step, and the resulting changes of variables at its end.

use super::{Along, Seed, StateTangent, VariableDerivatives, opposing_change};
use crate::error::{Error, Result};
use crate::head::{HeadInput, HostHead, MotorCommand, Sample};
use crate::integrator::Integrator;
use crate::model::{ActiveMoments, DeformedRod, Dynamics, InputExtrapolation, Inputs};
use crate::stepper::{InputChange, LastDerivatives, Stepper};
use crate::system::State;
use crate::variable::Variable;

/// Fractions of the step at which motions of a head are compared.
const SAMPLES: [f64; 3] = [0.3, 0.7, 1.0];

/// Candidate sizes of the finite difference of a head's motion, relative to the length or to a radian. The motion of a host
/// depends linearly on its inputs while the same polynomial extrapolates it, but the degree that predicts best differs between
/// small and large changes. The reference slope is that at the first size, from [`HOST_CHANGE`] on, whose slope agrees with that
/// of the next smaller size: the slope for changes as large as a host makes. The difference is taken over the largest size with
/// this slope, which loses the fewest digits.
const HEAD_DIFFERENCES: [f64; 6] = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8];

/// Index in [`HEAD_DIFFERENCES`] of the typical size of a host's changes.
const HOST_CHANGE: usize = 2;

/// Relative tolerance for slopes to count as equal.
const HEAD_LINEARITY: f64 = 1e-6;

/// The output of a drive with a lag is differenced over this fraction of its input, or of the input that bends the rod strongly,
/// and over half of that.
const DRIVE_DIFFERENCE: f64 = 1e-3;

/// A direction of the inputs at the beginning of a step: one entry of one input.
#[derive(Debug)]
pub(crate) struct InputDirection {
    since: f64,
    change: InputVariation,
}

#[derive(Debug)]
enum InputVariation {
    /// Inputs that stay constant during the step.
    Given(Box<Inputs>),
    /// The motions of the head with a derivative of coordinate `axis` increased and decreased; `apart` is the difference of the
    /// two derivatives.
    Head { axis: usize, heads: Box<[HostHead; 2]>, apart: f64 },
    /// The requests to a drive with a lag, increased and decreased by each of two sizes.
    Drive([(Box<[Asked; 2]>, f64); 2]),
}

/// The inputs of a drive, with their extrapolation.
type Asked = (Inputs, Option<Box<InputExtrapolation>>);

impl InputDirection {
    /// Writes the changes along this direction at the time `t` (s) that `dynamics` was moved to; `dynamics` is at the same time
    /// afterwards.
    pub(crate) fn evaluate(&self, dynamics: &mut Dynamics, t: f64, tangent: &mut StateTangent) {
        tangent.clear();
        match &self.change {
            InputVariation::Given(given) => {
                let tau = t - self.since;
                tangent.inputs.clone_from(given);
                tangent.inputs.phase_offset -= std::f64::consts::TAU * given.drive.frequency * tau;
            }
            InputVariation::Head { axis, heads, apart } => {
                let at = |head: &HostHead| head.axes[*axis].and_then(|axis| axis.at(t)).unwrap_or_default();
                let [more, less] = heads.each_ref().map(at);
                let slope = |of: fn(&Sample) -> f64| (of(&more) - of(&less)) / apart;
                let moved =
                    [slope(|sample| sample.value), slope(|sample| sample.rate), slope(|sample| sample.acceleration)];
                if *axis < 2 {
                    let State { q, v, a, .. } = &mut tangent.state;
                    (q[*axis], v[*axis], a[*axis]) = moved.into();
                } else if dynamics.model.hinge.is_some() {
                    tangent.command = MotorCommand { angle: moved[0], torque: 0.0 };
                } else {
                    tangent.angle = [moved[0], moved[1]];
                }
            }
            InputVariation::Drive(differences) => {
                // Richardson extrapolation of central differences.
                for ((asked, apart), factor) in differences.iter().zip([-1.0 / 3.0, 4.0 / 3.0]) {
                    for ((inputs, extrapolation), sign) in asked.iter().zip([1.0, -1.0]) {
                        let mut swapped = (inputs.clone(), extrapolation.clone());
                        std::mem::swap(&mut dynamics.inputs, &mut swapped.0);
                        std::mem::swap(&mut dynamics.extrapolation, &mut swapped.1);
                        dynamics.evaluate_at(t);
                        (dynamics.inputs, dynamics.extrapolation) = swapped;
                        tangent.add_drive(dynamics, factor * sign / apart);
                    }
                }
                dynamics.evaluate_at(t);
            }
        }
    }

    /// Completes what [`evaluate`](Self::evaluate) has written, for the rod at that time.
    pub(crate) fn follow(&self, bent: &DeformedRod<'_>, tangent: &mut StateTangent) {
        if let InputVariation::Given(_) = self.change {
            tangent.follow_inputs(bent);
        }
    }

    /// True for the motion of a head, which continues without a jump of accelerations.
    pub(crate) fn is_of_head(&self) -> bool {
        matches!(self.change, InputVariation::Head { .. })
    }

    /// The change of the flow, m/s, along both axes.
    pub(crate) fn flow(&self) -> [f64; 2] {
        match &self.change {
            InputVariation::Given(given) => given.fluid.flow.into(),
            _ => [0.0; 2],
        }
    }
}

impl StateTangent {
    /// Adds `factor` times the output of the drive of `dynamics`.
    fn add_drive(&mut self, dynamics: &Dynamics, factor: f64) {
        let add = |to: &mut [f64], from: &[f64]| to.iter_mut().zip(from).for_each(|(to, from)| *to += factor * from);
        add(&mut self.natural, &dynamics.natural);
        add(&mut self.natural_rate, &dynamics.natural_rate);
        if let Some(ActiveMoments { moment, rate, natural, natural_rate }) = &dynamics.active {
            add(&mut self.active.moment, moment);
            add(&mut self.active.rate, rate);
            add(&mut self.active.natural, natural);
            add(&mut self.active.natural_rate, natural_rate);
        }
    }

    /// The change of κ̄ and of its rate, one entry per node.
    pub(crate) fn natural(&self) -> [&[f64]; 2] {
        [&self.natural, &self.natural_rate]
    }

    /// The change of the pose of the head due to inputs: of the position, velocity and acceleration of node 0.
    pub(crate) fn head(&self) -> [[f64; 2]; 3] {
        let State { q, v, a, .. } = &self.state;
        [q, v, a].map(|values| [values[0], values[1]])
    }

    /// The change of the angle (rad) and of the angular velocity (rad/s) of the head due to inputs.
    pub(crate) fn head_turn(&self) -> [f64; 2] {
        self.angle
    }

    /// The change of the torque (N m) of the motor of a hinge at the same angle.
    pub(crate) fn torque(&self, bent: &DeformedRod<'_>) -> f64 {
        let DeformedRod { dynamics, .. } = bent;
        let (Some(hinge), Some([_, _, pitch])) = (&dynamics.model.hinge, &dynamics.held) else { return 0.0 };
        let [_, given] = hinge.torque(dynamics.command, pitch.value);
        given * (self.command.torque + hinge.stiffness * self.command.angle)
    }

    /// Adds the change of the forces that oppose the motion, minus loads, at an unchanged motion of the nodes, to `out`.
    pub(crate) fn add_applied(&self, bent: &DeformedRod<'_>, out: &mut [f64]) {
        let DeformedRod { dynamics, .. } = bent;
        let (moving, fluid) = (bent.kinematics(), (&self.fluid, self.layers.as_ref(), &self.tensions[..]));
        for own in dynamics.model.forces.iter() {
            opposing_change(own, &moving, None, fluid, out);
        }
        out.iter_mut().zip(&self.force).for_each(|(out, force)| *out -= force);
        if let Some(buoyancy) = &dynamics.model.buoyancy {
            out.iter_mut().zip(buoyancy).for_each(|(out, own)| *out -= own * self.fluid.density);
        }
    }
}

impl Stepper {
    /// The direction of entry `k` (counted from the first one) of an input, given for a step of `h` (s) from the current time.
    ///
    /// # Errors
    /// [`Error::Derivative`] if the step does not depend on it smoothly.
    pub(crate) fn input_direction(&mut self, variable: &'static Variable, k: usize, h: f64) -> Result<InputDirection> {
        let since = self.now.state.t;
        if let Some([axis, order]) = variable.of_head() {
            return Ok(InputDirection { since, change: self.head_variation(variable.name, [axis, order], h)? });
        }
        if matches!(variable.name, "flow_x_m_s" | "flow_y_m_s")
            && self.dynamics.model.flow.is_some()
            && !self.dynamics.inputs.flow_taken
        {
            let problem = format!(
                "no derivative by {}, which the scene changes in time; allowed: after it was set, because it then stays constant",
                variable.name
            );
            return Err(Error::Derivative { problem });
        }
        let of_drive = matches!(
            variable.name,
            "actuation_amplitude"
                | "actuation_moment_n_m"
                | "actuation_phase_rad"
                | "actuation_frequency_hz"
                | "natural_curvature_1_m"
                | "active_moment_n_m"
        );
        if of_drive && self.dynamics.model.lag.is_some() {
            return Ok(InputDirection { since, change: self.drive_variation(variable, k) });
        }
        let mut given = Inputs::none(&self.dynamics.model);
        let mut values = vec![0.0; variable.len(&self.dynamics.model)];
        values[k] = 1.0;
        Seed { dynamics: &mut self.dynamics, change: &mut given }.set(variable, &values)?;
        Ok(InputDirection { since, change: InputVariation::Given(Box::new(given)) })
    }

    fn drive_variation(&mut self, variable: &'static Variable, k: usize) -> InputVariation {
        let t = self.now.state.t;
        let mut values = vec![0.0; variable.len(&self.dynamics.model)];
        variable.read(&self.view(), &mut values);
        let size = DRIVE_DIFFERENCE * self.drive_scale(variable, values[k]);
        let kept = (self.dynamics.inputs.clone(), self.dynamics.extrapolation.clone());
        let differences = [size, 0.5 * size].map(|size| {
            let asked = [size, -size].map(|by| {
                let mut values = values.clone();
                values[k] += by;
                let change = InputChange { variable, order: 0, values: &values };
                self.dynamics.change_inputs(t, |dynamics| change.make(dynamics, t, 0));
                let (inputs, extrapolation) = kept.clone();
                let inputs = std::mem::replace(&mut self.dynamics.inputs, inputs);
                (inputs, std::mem::replace(&mut self.dynamics.extrapolation, extrapolation))
            });
            (Box::new(asked), 2.0 * size)
        });
        self.dynamics.evaluate_at(t);
        InputVariation::Drive(differences)
    }

    /// The scale of an input of the drive that bends the rod strongly, within the drive's limit; the input has this `value`.
    fn drive_scale(&self, variable: &Variable, value: f64) -> f64 {
        let model = &self.dynamics.model;
        let (rod, joints) = (&model.rod, model.rod.joints());
        let stiffest = joints.clone().fold(0.0_f64, |most, k| most.max(rod.joint[k]));
        let largest = model.largest_drive.unwrap_or(f64::INFINITY);
        // Bends a joint by about 1/N of a radian.
        let [own, limit] = match (variable.name, variable.unit) {
            ("actuation_phase_rad", _) => return 1.0,
            ("actuation_frequency_hz", _) => return if value == 0.0 { 1.0 } else { value.abs() },
            (_, "N m") => [stiffest / rod.nodes as f64, if model.active_moments { largest } else { f64::INFINITY }],
            (_, "1/m") => [1.0 / rod.length, if model.active_moments { f64::INFINITY } else { largest / rod.spacing }],
            _ => [1.0, largest],
        };
        (if value == 0.0 { own } else { value.abs() }).min(limit)
    }

    fn head_variation(&self, name: &str, [axis, order]: [usize; 2], h: f64) -> Result<InputVariation> {
        let refused = |problem: String| Err(Error::Derivative { problem });
        let (t, model) = (self.now.state.t, &self.dynamics.model);
        let (Some(pose), Some(motion)) = (&self.dynamics.held, &model.head) else {
            return refused(format!("a step has no derivative by {name}: no head is held"));
        };
        let now_input = model.head_input == HeadInput::Now;
        if self.is_at_start() && (now_input || self.dynamics.starts_elsewhere(t, Some(t + h))) {
            return refused(format!(
                "no derivative by {name} before the first step: the run starts with the pose that is given; allowed: after a step"
            ));
        }
        let end = t + h;
        let mut host = self.dynamics.inputs.head.as_deref().copied().unwrap_or_default();
        if host.axes[axis].is_none() {
            for (order, value) in self.dynamics.inputs.redundant_head_inputs.of(t, axis).into_iter().enumerate() {
                value.into_iter().for_each(|value| host.set_derivative(t, axis, pose[axis], order, value, false));
            }
        }
        let span = [t, end];
        let fit = |mut host: HostHead| {
            host.fit(span, pose, model.head_input, motion, true);
            host
        };
        let value = match host.axes[axis].and_then(|own| own.given_at(t, order)) {
            Some(given) => given,
            None if host.axes[axis].is_some_and(|own| own.is_given_at(t)) || order > 0 => {
                return refused(format!(
                    "no derivative by {name}, which was not set for this step; allowed: an input of the head that was set since the last step"
                ));
            }
            // The value without any change.
            None if now_input => pose[axis].value,
            None => fit(host).axes[axis].and_then(|own| own.at(end)).unwrap_or_else(|| motion[axis].at(end)).value,
        };
        let length = if axis < 2 { model.rod.length } else { 1.0 };
        let unit = length / h.powi(order as i32);
        let variation = |part: f64| {
            let heads = [1.0, -1.0].map(|sign| {
                let mut host = host;
                host.set_derivative(t, axis, pose[axis], order, value + sign * part * unit, false);
                fit(host)
            });
            let apart = 2.0 * part * unit;
            let slope = |t: f64| {
                let [more, less] = heads.map(|head| head.axes[axis].and_then(|own| own.at(t)).unwrap_or_default());
                [more.value - less.value, (more.rate - less.rate) * h, (more.acceleration - less.acceleration) * h * h]
                    .map(|change| change / apart)
            };
            let slopes = SAMPLES.map(|part| slope(t + part * h));
            (InputVariation::Head { axis, heads: Box::new(heads), apart }, slopes)
        };
        let mut all = HEAD_DIFFERENCES.map(variation);
        // Differences contain the rounding of the pose itself.
        let size_of = |own: f64| own * h.powi(order as i32) / length;
        let rounding = 8.0 * f64::EPSILON * (size_of(value.abs()) + pose[axis].value.abs() / length + 1.0);
        let near = |i: usize, reference: usize| {
            let [slopes, expected] = [&all[i].1, &all[reference].1].map(|slopes| slopes.as_flattened());
            let size = expected.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            let apart = slopes.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            apart <= HEAD_LINEARITY.max(rounding / HEAD_DIFFERENCES[i.max(reference)]) * size
        };
        let smallest = HEAD_DIFFERENCES.len() - 1;
        let reference = (HOST_CHANGE..smallest).find(|i| near(*i, i + 1)).unwrap_or(smallest);
        let taken = (0..reference).find(|i| near(*i, reference)).unwrap_or(reference);
        all.swap(0, taken);
        let [(taken, _), ..] = all;
        Ok(taken)
    }

    /// The state at the beginning of the last internal step; `None` if the current state is not the result of a step.
    pub(crate) fn previous(&self) -> Option<&State> {
        self.before.map(|_| &self.next)
    }

    /// Model, inputs and quantities that follow from the time, to be moved to another time and [back](Self::return_to_now).
    pub(crate) fn dynamics_mut(&mut self) -> &mut Dynamics {
        &mut self.dynamics
    }

    /// Moves the dynamics back to the current time.
    ///
    /// # Errors
    /// Errors of [`Dynamics::shape`].
    pub(crate) fn return_to_now(&mut self) -> Result<()> {
        self.move_to_now()
    }

    /// The deformed rod at the current time.
    ///
    /// # Errors
    /// Errors of [`Dynamics::shape`].
    pub(crate) fn bent_now(&mut self) -> Result<DeformedRod<'_>> {
        self.dynamics.shape(&self.now.state)
    }

    /// The integrator, if the model is the full one.
    pub(crate) fn integrator(&self) -> Option<&dyn Integrator> {
        self.model_stepper.integrator()
    }

    /// The size (s) of the last communication step, and the inputs of the head that were given for its end; `None` if there was
    /// none, or something was set or restored since. The stepper is then at the beginning of that step.
    pub(crate) fn return_to_last_step(&mut self) -> Option<f64> {
        let (h, kept) = (self.last_step?, self.undo.saved_in_step()?);
        self.restore_saved(&kept);
        self.undo.give_back(kept);
        Some(h)
    }

    /// The stored derivatives with respect to the inputs of the last communication step.
    pub(crate) fn last_derivatives_mut(&mut self) -> &mut Option<Box<LastDerivatives>> {
        &mut self.last_derivatives
    }

    /// The inputs of the head that have been given since the last step.
    pub(crate) fn given_head_inputs(&self) -> Vec<&'static Variable> {
        let t = self.now.state.t;
        let given = |variable: &&'static Variable| {
            let axes = self.dynamics.inputs.head.as_deref().map(|host| &host.axes);
            let Some([axis, order]) = variable.of_head() else { return false };
            match axes.and_then(|axes| axes[axis]) {
                Some(own) => own.given_at(t, order).is_some(),
                None => self.dynamics.inputs.redundant_head_inputs.of(t, axis)[order].is_some(),
            }
        };
        self.variables.iter().copied().filter(given).collect()
    }

    /// The change of all variables if the current state changes by `change`, and an input of the step that led to it changes by
    /// `direction`.
    ///
    /// # Errors
    /// Errors of [`Dynamics::shape`].
    pub(crate) fn along_step(
        &mut self,
        change: &State,
        input: Option<&InputDirection>,
    ) -> Result<VariableDerivatives<'_>> {
        let mut tangent = self.take_tangent();
        if let Some(input) = input {
            input.evaluate(&mut self.dynamics, self.now.state.t, &mut tangent);
        }
        let bent = self.dynamics.shape(&self.now.state)?;
        if let Some(input) = input {
            input.follow(&bent, &mut tangent);
        }
        tangent.metrics.totals = Default::default();
        for (to, from) in
            [(&mut tangent.state.q, &change.q), (&mut tangent.state.v, &change.v), (&mut tangent.state.a, &change.a)]
        {
            to.copy_from_slice(from);
        }
        if bent.dynamics.model.hinge.is_some() {
            let arc = 2 * bent.dynamics.model.rod.nodes;
            tangent.angle = [&change.q, &change.v].map(|values| values[arc] / bent.dynamics.model.rod.length);
        }
        tangent.read(&bent, &self.now.metrics.now, Along::Step);
        Ok(self.put_tangent(tangent))
    }
}
