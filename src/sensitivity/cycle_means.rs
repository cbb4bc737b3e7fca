//! Means over the last whole cycles with their derivatives. They are functions of sums of outputs whose quadrature weights depend
//! on the times alone.
//!
//! As the frequency f of the actuation changes, the ends of the cycles move relative to the steps, and a mean carries a ripple of
//! about 10⁻⁵ that repeats with every step by which the n cycles of the run become shorter. The slope of the ripple grows with n,
//! and exceeds that of the mean after some tens of cycles. The derivative with respect to f of a run that has more cycles than
//! are averaged is therefore a difference over δf/f = ±[`TREND_STEP`]/n: a tenth of the change that alters the response of n
//! cycles, and a tenth as many ripples as a cycle has steps. The step shrinks with n, so the ripple dominates again in runs of
//! hundreds of cycles with few steps each.

use std::sync::Arc;

use super::finite_difference::{CENTRAL_STENCIL, PerturbedScene};
use super::output::{HingeQuantity, Output, Quantity, WorkKind};
use super::parameter::Parameter;
use super::problem::Problem;
use crate::cycle::derivatives::{CycleEnd, IntegralDerivatives, IntegralWeights};
use crate::cycle::{CycleMeasure, Cycles, EFFICIENCY, MAX_CYCLES};
use crate::error::Result;
use crate::metrics::{Measurements, RunMetrics};
use crate::model::{Dynamics, Model};
use crate::system::State;
use crate::system::System;

/// Step of the differences with respect to the logarithm of the frequency, times the number of cycles.
const TREND_STEP: f64 = 0.1;

/// One-sided difference of second order towards larger frequencies: positions in steps, with their weights in 1/step. With all
/// signs changed, it points the other way.
const ONE_SIDED: [[f64; 2]; 3] = [[0.0, -0.75], [2.0, 1.0], [4.0, -0.25]];

/// An output, the derivative of the mean with respect to it, and its quadrature weights.
type Part = (Output, Coefficient, fn(&IntegralWeights) -> &[f64]);

type Coefficient = fn(&IntegralDerivatives) -> f64;

/// The outputs that all measures depend on.
fn parts(model: &Model) -> Vec<Part> {
    use Quantity as Q;
    let value: fn(&IntegralWeights) -> &[f64] = |weights| &weights.value;
    let rate: fn(&IntegralWeights) -> &[f64] = |weights| &weights.rate;
    let summed: fn(&IntegralWeights) -> &[f64] = |weights| &weights.summed;
    let mut parts: Vec<Part> = Vec::new();
    if model.hinge.is_some() {
        parts.push((Q::Hinge(HingeQuantity::TorqueSquare).into(), |d| d.hinge[0], summed));
        parts.push((Q::Hinge(HingeQuantity::Power).into(), |d| d.hinge[1], summed));
        parts.push((Q::Hinge(HingeQuantity::Angle).into(), |d| d.hinge[2], summed));
        parts.push((Q::Hinge(HingeQuantity::ErrorSquare).into(), |d| d.hinge[3], summed));
        parts.push((Q::HeadAxis(0).into(), |d| d.axis[0], summed));
        parts.push((Q::HeadAxis(1).into(), |d| d.axis[1], summed));
    }
    if model.head.is_some() {
        // The position of a held head is prescribed, independent of the parameters.
        parts.push((Q::HeadForce(0).into(), |d| d.force[0], summed));
        parts.push((Q::HeadForce(1).into(), |d| d.force[1], summed));
        parts.push((Q::HeadMoment.into(), |d| d.moment, summed));
        parts.push((WorkKind::Head.into(), |d| d.work[3], value));
        parts.push((Q::HeadPower.into(), |d| d.work[3], rate));
    } else {
        parts.push((Q::CentreOfMass(0).into(), |d| d.position[0], value));
        parts.push((Q::CentreOfMass(1).into(), |d| d.position[1], value));
        parts.push((Q::CentreVelocity(0).into(), |d| d.position[0], rate));
        parts.push((Q::CentreVelocity(1).into(), |d| d.position[1], rate));
        parts.push((Q::HeadAxis(0).into(), |d| d.axis[0], summed));
        parts.push((Q::HeadAxis(1).into(), |d| d.axis[1], summed));
    }
    parts.push((Q::Flow(0).into(), |d| d.flow[0], summed));
    parts.push((Q::Flow(1).into(), |d| d.flow[1], summed));
    let works: [(Output, Quantity, Coefficient); 7] = [
        (WorkKind::Actuation.into(), Q::ActuationPower, |d| d.work[0]),
        (WorkKind::Viscous.into(), Q::ViscousPower, |d| d.work[1]),
        (WorkKind::Load.into(), Q::LoadPower, |d| d.work[2]),
        (WorkKind::Flow.into(), Q::FlowPower, |d| d.work[4]),
        (WorkKind::Wake.into(), Q::WakePower, |d| d.work[5]),
        (WorkKind::Other.into(), Q::OtherPower, |d| d.work[6]),
        (WorkKind::Material.into(), Q::MaterialPower, |d| d.work[8]),
    ];
    for (work, power, by) in works {
        parts.push((work, by, value));
        parts.push((power.into(), by, rate));
    }
    parts
}

impl Problem {
    /// Simulates, and tracks the cycles and their ends as a run does. `look` is called with every state.
    ///
    /// # Errors
    /// Errors of [`simulate`](Self::simulate) and of [`Measurements::measure`].
    pub(super) fn simulate_cycles(&mut self, look: impl FnMut(&State)) -> Result<(Cycles, Vec<CycleEnd>)> {
        let (cycles, ends, _) = self.simulate_and_measure(look)?;
        Ok((cycles, ends))
    }

    /// Simulates, and returns the metrics of the run and the final positions.
    #[cfg(feature = "faer")]
    pub(super) fn simulate_metrics(&mut self) -> Result<(RunMetrics, Vec<f64>)> {
        let mut end = Vec::new();
        let (.., metrics) = self.simulate_and_measure(|state| end.clone_from(&state.q))?;
        Ok((metrics, self.dynamics.of_nodes(end)))
    }

    fn simulate_and_measure(&mut self, mut look: impl FnMut(&State)) -> Result<(Cycles, Vec<CycleEnd>, RunMetrics)> {
        let mut before = State::default();
        let mut ends = Vec::new();
        let mut run: Option<(RunMetrics, Cycles, Measurements)> = None;
        let controls = Arc::clone(&self.controls);
        self.advance(|dynamics, n, state, _| {
            match &mut run {
                None => {
                    let metrics = RunMetrics::start(dynamics, state)?;
                    let cycles = Cycles::start(dynamics, state, &metrics);
                    ends.push(cycles.first_end());
                    run = Some((metrics, cycles, Measurements::new(dynamics.nodes())));
                }
                Some((metrics, cycles, measurements)) => {
                    measurements.measure(dynamics, state)?;
                    let times = [before.t, state.t];
                    let mut load = dynamics.load_work(times, &before.q, &state.q);
                    if controls.force.is_some() {
                        // The mean of the forces at both ends, because they are functions of time.
                        controls.apply(dynamics, n - 1);
                        load = 0.5 * (load + dynamics.load_work(times, &before.q, &state.q));
                        controls.apply(dynamics, n);
                    }
                    metrics.count_step(measurements, None, load, dynamics.head_mass())?;
                    let before = *cycles;
                    cycles.follow(dynamics, state, metrics, None);
                    ends.extend(cycles.ends_since(dynamics, &before));
                }
            }
            look(state);
            before.t = state.t;
            before.q.clone_from(&state.q);
            Ok(())
        })?;
        let (cycles, metrics) = match run {
            Some((metrics, cycles, _)) => (cycles, metrics),
            None => {
                // `advance` calls this at the start at least.
                let state = self.dynamics.first_state();
                let metrics = RunMetrics::start(&mut self.dynamics, &state)?;
                (Cycles::start(&self.dynamics, &state, &metrics), metrics)
            }
        };
        Ok((cycles, ends, metrics))
    }

    /// The reason why the simulation has no whole cycle, if it has none.
    ///
    /// # Errors
    /// Errors of [`simulate`](Self::simulate) and of [`Measurements::measure`].
    pub fn no_cycle(&mut self) -> Result<Option<String>> {
        let (cycles, _) = self.simulate_cycles(|_| {})?;
        Ok(cycles.reason(&self.dynamics))
    }

    /// The reason why the simulation has no mean of `measure`.
    ///
    /// # Errors
    /// Errors of [`simulate`](Self::simulate) and of [`Measurements::measure`].
    pub fn no_mean(&mut self, measure: &CycleMeasure) -> Result<String> {
        let (cycles, _) = self.simulate_cycles(|_| {})?;
        let averages = cycles.averages(&self.dynamics);
        let of_efficiency = averages.efficiency_reason.filter(|_| measure.key == EFFICIENCY.key);
        Ok(averages.reason.or(of_efficiency).unwrap_or_else(|| "the scene has no such quantity".to_string()))
    }

    /// The mean of `measure` over the last whole cycles, equal to that in the summary of a run, with its derivatives with respect
    /// to `parameters`. `None` if there is no such mean or if it is not
    /// [differentiable](crate::cycle::derivatives::is_differentiable). A parameter that changes the frequency of the drive also
    /// moves the ends of the cycles. If the run has more cycles than are averaged, the contribution of the frequency of the
    /// actuation is a finite difference.
    ///
    /// # Errors
    /// Errors of [`simulate`](Self::simulate).
    pub fn cycle_mean(&mut self, measure: &CycleMeasure, parameters: &[Parameter]) -> Result<Option<(f64, Vec<f64>)>> {
        let (mut checkpoints, times) = (self.checkpoints(), self.times());
        let (cycles, ends) = self.simulate_cycles(|state| checkpoints.push(state))?;
        let Some(mean) = cycles.averages(&self.dynamics).mean(measure) else { return Ok(None) };
        if parameters.is_empty() {
            return Ok(Some((mean, Vec::new())));
        }
        let Some(integral_derivatives) = cycles.integral_derivatives(measure, &self.dynamics) else { return Ok(None) };
        let weights = cycles.weights(&self.dynamics, &times);
        let mut parts = parts(&self.dynamics.model);
        parts.retain(|(_, by, _)| integral_derivatives.iter().any(|dependence| by(dependence) != 0.0));
        let mut rows = vec![0.0; parts.len() * times.len()];
        for (dependence, weights) in integral_derivatives.iter().zip(&weights) {
            for (o, (_, by, of)) in parts.iter().enumerate() {
                let by = by(dependence);
                let row = rows.iter_mut().skip(o).step_by(parts.len());
                row.zip(of(weights)).for_each(|(row, weight)| *row += by * weight);
            }
        }
        let outputs: Vec<Output> = parts.into_iter().map(|(output, ..)| output).collect();
        let own = cycles.frequency(&self.dynamics);
        // The derivatives of the logarithm of the frequency: exactly zero for a number that does not change it.
        let log = |place: &mut PerturbedScene| {
            Ok(own.zip(cycles.frequency(&place.dynamics)).map_or(0.0, |(own, now)| (now / own).ln()))
        };
        let mut stretch = |parameter: &Parameter| match parameter {
            Parameter::OfScene(i) => self.finite_differences[*i].of_value(log),
            Parameter::Frequency if cycles.follow_actuation() => Ok(own.map_or(0.0, f64::recip)),
            _ => Ok(0.0),
        };
        let stretches: Vec<f64> = parameters.iter().map(&mut stretch).collect::<Result<_>>()?;
        let passed = ends.len() - 1;
        let slides = stretches.iter().any(|by| *by != 0.0) && passed > MAX_CYCLES && cycles.follow_actuation();
        // For a drive with a limit or a lag, the derivative is available only through a number of the scene.
        let exact = slides && !self.dynamics.model.filters_drive();
        let with_frequency: Vec<Parameter> = parameters.iter().cloned().chain([Parameter::Frequency]).collect();
        let asked = if exact { &with_frequency } else { parameters };
        let mut by = self.adjoint_of(asked, &outputs, &rows, &checkpoints)?;
        let of_scene = stretches.iter().position(|by| *by != 0.0).filter(|_| slides && !exact);
        let of_scene = of_scene.zip(own).map(|(i, own)| by[i] / (stretches[i] * own));
        let slid = cycles.by_log_frequency(measure, &self.dynamics, &ends).unwrap_or(f64::NAN);
        // Replaces the exact derivative with respect to the logarithm of the frequency.
        let trend = match by.get(parameters.len()).copied().or(of_scene).zip(own) {
            Some((exact, own)) => self.trend_by_frequency(measure, passed)?.map_or(slid, |trend| own * (trend - exact)),
            None => slid,
        };
        let whole = cycles.whole(f64::INFINITY);
        let averaged = |dynamics: &Dynamics| measure.mean(whole, dynamics).unwrap_or(f64::NAN);
        by.truncate(parameters.len());
        for ((by, parameter), stretch) in by.iter_mut().zip(parameters).zip(stretches) {
            if stretch != 0.0 {
                *by += stretch * trend;
            }
            match parameter {
                Parameter::OfForces(key) => {
                    let own = integral_derivatives.iter().flat_map(|dependence| &dependence.by_key);
                    *by += own.filter(|(own, _)| own == key).map(|(_, by)| by).sum::<f64>();
                }
                // The measure's own formula at unchanged sums, and the motion of the ends of the cycles.
                Parameter::OfScene(i) => {
                    let moved = &mut self.finite_differences[*i];
                    *by += moved.of_value(|place| Ok(averaged(&place.dynamics)))?;
                }
                _ => {}
            }
        }
        Ok(Some((mean, by)))
    }

    /// The derivative of the mean of `measure` with respect to the frequency (Hz) of the actuation, as a finite difference over a
    /// step that suits a run of `passed` cycles: of fourth order, or one-sided of second order if the number of cycles of the run
    /// changes on the other side, where other cycles would be averaged. `None` if neither is possible.
    fn trend_by_frequency(&mut self, measure: &CycleMeasure, passed: usize) -> Result<Option<f64>> {
        let own = self.inputs().drive.frequency;
        let step = TREND_STEP / passed as f64;
        let mut mean = |part: f64| -> Result<Option<f64>> {
            self.inputs().drive.frequency = own * (1.0 + part * step);
            let (cycles, ends) = self.simulate_cycles(|_| {})?;
            Ok(cycles.averages(&self.dynamics).mean(measure).filter(|_| ends.len() == 1 + passed))
        };
        let mut difference = |stencil: &[[f64; 2]]| -> Result<Option<f64>> {
            let mut sum = 0.0;
            for [part, weight] in stencil {
                let Some(mean) = mean(*part)? else { return Ok(None) };
                sum += weight * mean;
            }
            Ok(Some(sum / (step * own)))
        };
        let other_side = ONE_SIDED.map(|entry| entry.map(|x| -x));
        let mut stencils = [&CENTRAL_STENCIL[..], &ONE_SIDED, &other_side].into_iter();
        let found = stencils.find_map(|stencil| difference(stencil).transpose()).transpose();
        self.inputs().drive.frequency = own;
        found
    }
}
