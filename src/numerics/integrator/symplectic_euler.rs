//! Symplectic Euler: vⁿ⁺¹ = vⁿ + h aⁿ, qⁿ⁺¹ = qⁿ + h vⁿ⁺¹. An explicit method for contrast: a rod's modes are so fast that it fails
//! at any practical step.

use super::{Integrator, Method, StepError, largest_root};
use crate::error::Result;
use crate::linear::Direction;
use crate::newton::Newton;
use crate::system::{State, System};

/// The entry of this method in the list of methods.
pub static METHOD: Method = Method {
    name: "symplectic-euler",
    stability: "stable for steps below 2/ω_max only, ω_max the highest natural frequency; energies stay bounded there",
    source: "R. de Vogelaere 1956; E. Hairer, C. Lubich & G. Wanner, Geometric Numerical Integration (2006), section I.1",
    parameters: &[],
    adaptive: false,
    implicit: false,
    build: |_| Box::new(SymplecticEuler::default()),
};

#[derive(Debug, Default)]
struct SymplecticEuler {
    residual: Vec<f64>,
}

impl Integrator for SymplecticEuler {
    fn order(&self) -> u32 {
        1
    }

    // The force sees only the velocity of the previous step.
    fn spectral_radius(&self, omega: f64, damping: f64) -> f64 {
        let lost = 2.0 * damping * omega;
        largest_root(2.0 - lost - omega * omega, 1.0 - lost)
    }

    fn begin(&mut self, state: &mut State) {
        self.residual.resize(state.q.len(), 0.0);
    }

    fn step(
        &mut self,
        system: &mut dyn System,
        newton: &mut Newton,
        from: &State,
        h: f64,
        to: &mut State,
    ) -> Result<StepError> {
        for i in 0..from.q.len() {
            to.v[i] = from.v[i] + h * from.a[i];
            to.q[i] = from.q[i] + h * to.v[i];
        }
        to.a.copy_from_slice(&from.a);
        system.move_to(to.t, to);
        // The residual is linear in the accelerations.
        if system.lumped_masses().is_none() {
            newton.iterate(system, to, Direction::ACCELERATIONS)?;
        } else {
            system.assemble(to, &mut self.residual, None)?;
            for (k, mass) in system.lumped_masses().into_iter().flatten().enumerate() {
                for i in [2 * k, 2 * k + 1] {
                    to.a[i] -= self.residual[i] / mass;
                }
            }
        }
        system.check_step(from, to)?;
        Ok(StepError::default())
    }
}
