//! ESDIRK3(2): three implicit stages with one matrix, the last at the end of the step; an embedded method of order 2 estimates the
//! error.
//!
//! For q' = v, v' = a a stage is v_i = v* + hγ a_i and q_i = q* + (hγ)² a_i with v* = vⁿ + h Σ_{j<i} a_ij a_j and
//! q* = qⁿ + h Σ_{j<i} a_ij v_j + hγ v*.

use nalgebra::Complex;

use super::{ExplicitPart, Integrator, Method, Stage, Stages, StepError};
use crate::error::Result;
use crate::linear::Direction;
use crate::newton::{ConvergenceRate, Newton};
use crate::system::{State, System};

/// The entry of this method in the list of methods.
pub static METHOD: Method = Method {
    name: "esdirk3",
    stability: "L-stable, like its embedded method: damps modes that the step does not resolve, and hardly those that it resolves",
    source: "A. Kværnø, BIT 44 (2004) 489–502, method 3/2a",
    parameters: &[],
    adaptive: true,
    implicit: true,
    build: |_| Box::new(Esdirk3::default()),
};

/// γ, the root of γ³ − 3γ² + 3γ/2 − 1/6 that makes the method L-stable.
pub(crate) const G: f64 = 0.435_866_521_508_459;

/// Times of the stages, in units of the step.
pub(crate) const TIMES: [f64; STAGES] = [0.0, 2.0 * G, 1.0, 1.0];

/// Weights a_ij, j < i, of the implicit stages; every a_ii is γ. The last stage is the result of the step, the one before it that
/// of the embedded method.
pub(crate) const WEIGHTS: [[f64; STAGES - 1]; STAGES] = {
    let embedded = [(-4.0 * G * G + 6.0 * G - 1.0) / (4.0 * G), (1.0 - 2.0 * G) / (4.0 * G), 0.0];
    let last = [
        (6.0 * G - 1.0) / (12.0 * G),
        -1.0 / ((24.0 * G - 12.0) * G),
        (-6.0 * G * G + 6.0 * G - 1.0) / (6.0 * G - 3.0),
    ];
    [[0.0; 3], [G, 0.0, 0.0], embedded, last]
};

pub(crate) const STAGES: usize = 4;

/// The method, and the velocities and accelerations of its first three stages.
#[derive(Debug, Default)]
struct Esdirk3 {
    v: [Vec<f64>; STAGES - 1],
    a: [Vec<f64>; STAGES - 1],
}

impl Integrator for Esdirk3 {
    fn order(&self) -> u32 {
        3
    }

    // |R(z)| at the two eigenvalues z of the oscillator: the only function of order 3 with a triple pole at 1/γ that vanishes at
    // infinity, in powers of 1/(1 − γz), because z may be large.
    fn spectral_radius(&self, omega: f64, damping: f64) -> f64 {
        let part = Complex::new(damping * damping - 1.0, 0.0).sqrt();
        let amplification = |sign: f64| {
            let z = (part * sign - damping) * omega;
            let inverse = (Complex::from(1.0) - z * G).inv();
            let ratio = z * inverse;
            let numerator =
                inverse * inverse + ratio * inverse * (1.0 - 3.0 * G) + ratio * ratio * (0.5 - 3.0 * G + 3.0 * G * G);
            (inverse * numerator).norm()
        };
        amplification(1.0).max(amplification(-1.0))
    }

    fn begin(&mut self, state: &mut State) {
        for stage in self.v.iter_mut().chain(&mut self.a) {
            stage.resize(state.q.len(), 0.0);
        }
    }

    fn step(
        &mut self,
        system: &mut dyn System,
        newton: &mut Newton,
        from: &State,
        h: f64,
        to: &mut State,
    ) -> Result<StepError> {
        let (end, mut known) = (to.t, ConvergenceRate::default());
        self.v[0].copy_from_slice(&from.v);
        self.a[0].copy_from_slice(&from.a);
        for (i, part) in TIMES.iter().enumerate().skip(1) {
            to.t = if i == 1 { from.t + part * h } else { end };
            let Self { v, a } = &*self;
            let stage = Stage { new: direction(h), h };
            stage.solve(system, newton, &mut known, from, to, |k| explicit_part(i, h, |j| [v[j][k], a[j][k]]))?;
            if i < STAGES - 1 {
                self.v[i].copy_from_slice(&to.v);
                self.a[i].copy_from_slice(&to.a);
            }
        }
        Ok(StepError { position: error(h, &self.v, &to.v), velocity: error(h, &self.a, &to.a) })
    }

    fn stages(&self, h: f64) -> Option<Stages> {
        Some(Stages { count: STAGES - 1, direction: direction(h) })
    }

    fn write_stages(&self, from: &State, h: f64, to: &State, states: &mut [State]) {
        for (i, state) in states.iter_mut().enumerate().map(|(i, state)| (i + 1, state)) {
            state.copy_from(to);
            if i < STAGES - 1 {
                state.t = if i == 1 { from.t + TIMES[i] * h } else { to.t };
                state.links.clear();
                state.v.copy_from_slice(&self.v[i]);
                state.a.copy_from_slice(&self.a[i]);
                for (k, q) in state.q.iter_mut().enumerate() {
                    let part = explicit_part(i, h, |j| [self.v[j][k], self.a[j][k]]);
                    *q = from.q[k] + part.dq + direction(h).q * self.a[i][k];
                }
            }
        }
    }

    fn step_linear(&self, from: &State, h: f64, states: &mut [State], solve: &mut dyn FnMut(usize, &mut State)) {
        for i in 1..STAGES {
            let Some((before, [stage, ..])) = states.split_at_mut_checked(i - 1) else { return };
            for (k, (q, v)) in stage.q.iter_mut().zip(&mut stage.v).enumerate() {
                let part = explicit_part(i, h, |j| match j.checked_sub(1) {
                    None => [from.v[k], from.a[k]],
                    Some(j) => [before[j].v[k], before[j].a[k]],
                });
                (*q, *v) = (from.q[k] + part.dq, part.v);
            }
            solve(i - 1, stage);
        }
    }
}

/// The direction in which every implicit stage of a step of `h` (s) moves the state.
fn direction(h: f64) -> Direction {
    Direction { q: (h * G).powi(2), v: h * G, a: 1.0 }
}

/// The explicit part of stage `i` of a step of `h` (s) for one unknown, from its velocity and acceleration at the beginning and in
/// the previous stages.
#[inline(always)]
fn explicit_part(i: usize, h: f64, before: impl Fn(usize) -> [f64; 2]) -> ExplicitPart {
    let sum = |of: usize| -> f64 { (0..i).map(|j| h * WEIGHTS[i][j] * before(j)[of]).sum() };
    let v_star = before(0)[0] + sum(1);
    ExplicitPart { dq: sum(0) + h * G * v_star, v: v_star, guess: before(i - 1)[1] }
}

/// The largest difference between the method and its embedded method after a step of `h` (s), from the rates at the first stages
/// and at the last.
pub(crate) fn error(h: f64, of: &[Vec<f64>; STAGES - 1], last: &[f64]) -> f64 {
    let weights: [f64; STAGES - 1] = std::array::from_fn(|j| WEIGHTS[3][j] - if j == 2 { G } else { WEIGHTS[2][j] });
    let [first, second, third] = of.each_ref().map(|rates| &rates[..last.len()]);
    let mut most = 0.0;
    for (k, last) in last.iter().enumerate() {
        let earlier = weights[0] * first[k] + weights[1] * second[k] + weights[2] * third[k];
        let error = (h * (earlier + G * last)).abs();
        if error > most {
            most = error;
        }
    }
    most
}
