//! A lagged drive in motion: its output follows from time, inputs, and the output at the last change of the inputs.

use super::input_extrapolation::HIGHEST_ORDER;
use super::{ActiveMoments, DriveState, Dynamics, Inputs, Model};
use crate::actuation::lag::{Jet, LagState, LaggedWave, Piece, product};
use crate::start::Start;

impl Dynamics {
    /// Adds the derivative of `order` 0, 1 or 2 of the output of a drive with lag `tau` (s) at time `t` (s), before its
    /// limit, to `out`: a dimensionless curvature or a moment (N m) per node.
    pub(super) fn add_lagging(&self, tau: f64, t: f64, order: usize, out: &mut [f64]) {
        let Model { actuation, start, active_moments, .. } = &*self.model;
        let Inputs { lagging, drive, .. } = &self.inputs;
        let since = lagging.as_ref().map_or(0.0, |state| state.since);
        // A shaped start begins in the steady wave.
        let begins = lagging.is_some() || !matches!(start, Start::Shaped);
        let age = begins.then_some(t - since);
        if let Some((actuation, _)) = actuation {
            let extrapolation = self.extrapolation.as_deref();
            let size_at = |t: f64, before: bool| {
                let mut amplitude = Jet::default();
                amplitude[0] = drive.amplitude;
                if let Some(extrapolation) = extrapolation {
                    for (order, value) in amplitude.iter_mut().enumerate().take(HIGHEST_ORDER + 1) {
                        *value = extrapolation.derivative(order, t, |inputs| inputs.drive.amplitude);
                    }
                }
                product(&amplitude, &start.gain_jet(t, before))
            };
            let now = |age: Option<f64>| Piece { size: size_at(t, false), age };
            let (now, before) = match *start {
                Start::Ramp { duration } if since < duration && duration <= t => {
                    let ramp = Piece { size: size_at(duration, true), age: Some(duration - since) };
                    (now(Some(t - duration)), Some(ramp))
                }
                _ => (now(age), None),
            };
            let DriveState { phase: [phase, turning, _], .. } = self.inputs.drive_state(start, t, extrapolation);
            LaggedWave { tau, phase, turning, now, before }.add(&**actuation, order, out);
        }
        let highest = if self.extrapolation.is_some() { HIGHEST_ORDER } else { 0 };
        for derivative in 0..=highest {
            let size = std::array::from_fn(|j| if j == derivative { 1.0 } else { 0.0 });
            let own = LaggedWave { tau, phase: 0.0, turning: 0.0, now: Piece { size, age }, before: None };
            self.add_own(derivative, t, *active_moments, own.factor(0.0, order).re, out);
        }
        if let Some(state) = lagging {
            state.add(tau, t, order, out);
        }
    }

    /// Evaluates the output of a drive with lag `tau` (s) at time `t` (s), and its rate.
    pub(super) fn evaluate_lagging(&mut self, tau: f64, t: f64) {
        let moments = self.model.active_moments;
        let mut given = match &mut self.active {
            Some(ActiveMoments { moment, rate, .. }) if moments => [moment, rate].map(std::mem::take),
            _ => [&mut self.natural, &mut self.natural_rate].map(std::mem::take),
        };
        given.iter_mut().enumerate().for_each(|(order, given)| self.add_lagging(tau, t, order, given));
        let [value, speed] = given;
        match &mut self.active {
            Some(ActiveMoments { moment, rate, .. }) if moments => (*moment, *rate) = (value, speed),
            _ => (self.natural, self.natural_rate) = (value, speed),
        }
    }

    /// Changes the inputs by `change` at time `t` (s); the output of a lagged drive continues from its value there.
    pub(crate) fn change_inputs(&mut self, t: f64, change: impl FnOnce(&mut Self)) {
        let Some(tau) = self.model.lag else { return change(self) };
        let given = |dynamics: &Self| {
            let mut given = vec![0.0; dynamics.model.rod.nodes];
            dynamics.add_lagging(tau, t, 0, &mut given);
            given
        };
        let before = given(self);
        change(self);
        self.follow_extrapolation(t);
        if given(self) != before {
            self.inputs.lagging = Some(LagState { since: t, given: before });
        }
    }

    /// The reason why the time derivative of this `order` of the input `name` must not be `value`, if it must not.
    pub(crate) fn refused_derivative(&self, name: &str, order: usize, value: f64) -> Option<&'static str> {
        let bends_phase = name == "actuation_frequency_hz" || name == "actuation_phase_rad" && order > 1;
        (self.model.lag.is_some() && bends_phase && value != 0.0)
            .then_some("0: a drive with a lag needs a frequency that is constant until it is set again")
    }
}
