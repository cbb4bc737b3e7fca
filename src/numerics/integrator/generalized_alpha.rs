//! The generalized-α method: Newmark's step with an auxiliary acceleration w that lags behind the true one,
//! (1−α_m) wⁿ⁺¹ + α_m wⁿ = (1−α_f) aⁿ⁺¹ + α_f aⁿ, so that the spectral radius at infinite frequency is ρ∞.

use nalgebra::Matrix3;

use super::{MemoryWeights, Method, MethodParameter, OneStage, StepWeights};

/// The entry of this method in the list of methods.
pub static METHOD: Method = Method {
    name: "generalized-alpha",
    stability: "unconditionally stable on linear systems; modes that the step does not resolve are multiplied by rho_inf per step",
    source: "J. Chung & G. M. Hulbert, J. Appl. Mech. 60 (1993) 371–375; M. Arnold & O. Brüls, Multibody Syst. Dyn. 18 (2007) 185–202",
    parameters: &[MethodParameter {
        name: "rho_inf",
        default: 0.8,
        range: [0.0, 1.0],
        allowed: "a number from 0 (unresolved modes vanish at once) to 1 (they are not damped)",
    }],
    adaptive: false,
    implicit: true,
    build: |values| Box::new(GeneralizedAlpha::new(values[0])),
};

#[derive(Debug)]
struct GeneralizedAlpha {
    alpha_m: f64,
    alpha_f: f64,
    beta: f64,
    gamma: f64,
}

impl GeneralizedAlpha {
    fn new(rho: f64) -> Self {
        let (alpha_m, alpha_f) = ((2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0));
        let gamma = 0.5 - alpha_m + alpha_f;
        Self { alpha_m, alpha_f, beta: 0.25 * (0.5 + gamma).powi(2), gamma }
    }
}

impl OneStage for GeneralizedAlpha {
    fn order(&self) -> u32 {
        2
    }

    // The step of (q, hv, h²w) by the equations of Chung and Hulbert, which balance forces at intermediate times.
    fn spectral_radius(&self, omega: f64, damping: f64) -> f64 {
        let Self { alpha_m, alpha_f, beta, gamma } = *self;
        let (square, lost, new) = (omega * omega, 2.0 * damping * omega, 1.0 - alpha_f);
        let left = Matrix3::new(1.0, 0.0, -beta, 0.0, 1.0, -gamma, square * new, lost * new, 1.0 - alpha_m);
        let right =
            Matrix3::new(1.0, 1.0, 0.5 - beta, 0.0, 1.0, 1.0 - gamma, -square * alpha_f, -lost * alpha_f, -alpha_m);
        let step = left.lu().solve(&right).unwrap_or_else(|| Matrix3::from_element(f64::NAN));
        step.complex_eigenvalues().iter().map(|root| root.norm()).fold(0.0, f64::max)
    }

    fn rule(&self, h: f64) -> StepWeights {
        let Self { alpha_m, alpha_f, beta, gamma } = *self;
        let [new, old, kept] = [1.0 - alpha_f, alpha_f, -alpha_m].map(|weight| weight / (1.0 - alpha_m));
        StepWeights {
            q_old: h * h * beta * old,
            v_old: h * gamma * old,
            q_new: h * h * beta * new,
            v_new: h * gamma * new,
            memory: Some(MemoryWeights {
                q: h * h * (0.5 - beta + beta * kept),
                v: h * (1.0 - gamma + gamma * kept),
                new,
                old,
                kept,
            }),
        }
    }
}
