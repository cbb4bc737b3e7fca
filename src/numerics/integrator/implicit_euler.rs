//! Implicit Euler: v = (qⁿ⁺¹−qⁿ)/h, a = (v−vⁿ)/h.

use super::{Method, OneStage, StepWeights};

/// What is known of it.
pub static METHOD: Method = Method {
    name: "implicit-euler",
    stability: "L-stable: damps every mode that the step does not resolve, and a little those it does",
    source: "Euler 1768; the source study, section 2.5.1",
    parameters: &[],
    adaptive: false,
    implicit: true,
    build: |_| Box::new(ImplicitEuler),
};

#[derive(Debug)]
struct ImplicitEuler;

impl OneStage for ImplicitEuler {
    fn order(&self) -> u32 {
        1
    }

    fn spectral_radius(&self, omega: f64) -> f64 {
        1.0 / (1.0 + omega * omega).sqrt()
    }

    fn rule(&self, h: f64) -> StepWeights {
        StepWeights { q_old: 0.0, v_old: 0.0, q_new: h * h, v_new: h, memory: None }
    }
}
