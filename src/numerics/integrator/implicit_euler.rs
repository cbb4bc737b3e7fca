//! Implicit Euler: v = (qⁿ⁺¹−qⁿ)/h, a = (v−vⁿ)/h.

use super::{Method, OneStage, StepWeights, largest_root};

/// The entry of this method in the list of methods.
pub static METHOD: Method = Method {
    name: "implicit-euler",
    stability: "L-stable: damps modes that the step does not resolve, and slightly those that it resolves",
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

    fn spectral_radius(&self, omega: f64, damping: f64) -> f64 {
        let lost = 2.0 * damping * omega;
        let divisor = 1.0 + lost + omega * omega;
        largest_root((2.0 + lost) / divisor, 1.0 / divisor)
    }

    fn rule(&self, h: f64) -> StepWeights {
        StepWeights { q_old: 0.0, v_old: 0.0, q_new: h * h, v_new: h, memory: None }
    }
}
