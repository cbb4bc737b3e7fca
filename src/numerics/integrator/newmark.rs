//! Newmark's method: q = qⁿ + h vⁿ + h²((½−β)aⁿ + βa), v = vⁿ + h((1−γ)aⁿ + γa).

use super::{Method, MethodParameter, OneStage, StepWeights, largest_root};

/// The entry of this method in the list of methods.
pub static METHOD: Method = Method {
    name: "newmark",
    stability: "unconditionally stable on linear systems for 2β ≥ γ ≥ ½; no damping at γ = ½",
    source: "N. M. Newmark, J. Eng. Mech. Div. ASCE 85 (1959) 67–94; the source study, section 2.5.2, with (½, ½)",
    parameters: &[
        MethodParameter { name: "beta", default: 0.25, range: [1e-6, 1.0], allowed: "a number from 1e-6 to 1" },
        MethodParameter { name: "gamma", default: 0.5, range: [0.0, 1.0], allowed: "a number from 0 to 1" },
    ],
    adaptive: false,
    implicit: true,
    build: |values| Box::new(Newmark { beta: values[0], gamma: values[1] }),
};

#[derive(Debug)]
struct Newmark {
    beta: f64,
    gamma: f64,
}

impl OneStage for Newmark {
    fn order(&self) -> u32 {
        if self.gamma == 0.5 { 2 } else { 1 }
    }

    // T. J. R. Hughes, The Finite Element Method (1987), section 9.1.2.
    fn spectral_radius(&self, omega: f64, damping: f64) -> f64 {
        let Self { beta, gamma } = *self;
        let (square, lost) = (omega * omega, 2.0 * damping * omega);
        let divisor = 1.0 + gamma * lost + beta * square;
        let [trace, determinant] = [0.5, -0.5].map(|half| (lost + (gamma + half) * square) / divisor);
        largest_root(2.0 - trace, 1.0 - determinant)
    }

    fn rule(&self, h: f64) -> StepWeights {
        StepWeights {
            q_old: (0.5 - self.beta) * h * h,
            v_old: (1.0 - self.gamma) * h,
            q_new: self.beta * h * h,
            v_new: self.gamma * h,
            memory: None,
        }
    }
}
