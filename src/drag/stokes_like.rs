//! Linear anisotropic drag, R = ξ∥ t tᵀ + αξ∥ n nᵀ per unit length with ξ∥ = 6πμR_eq (the source study's law).

use std::f64::consts::PI;

use nalgebra::{Matrix2, Vector2};

use super::{Fluid, InFluid, Law};

/// The law's constants, before the viscosity is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StokesLike {
    /// Ratio α of the coefficient across the rod to the one along it.
    pub ratio: f64,
    /// Radius R_eq = √(A/π), m.
    pub radius: f64,
}

/// The law at one viscosity: R = α ξ∥ I + (1−α) ξ∥ t tᵀ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coefficients {
    across: f64,
    along_less_across: f64,
}

impl InFluid for StokesLike {
    type Law = Coefficients;

    fn in_fluid(&self, fluid: Fluid) -> Coefficients {
        let along = 6.0 * PI * fluid.viscosity * self.radius;
        Coefficients { across: self.ratio * along, along_less_across: (1.0 - self.ratio) * along }
    }

    fn by_viscosity(&self, fluid: Fluid) -> Coefficients {
        self.in_fluid(Fluid { viscosity: 1.0, ..fluid }) // it is linear
    }
}

impl Law for Coefficients {
    #[inline]
    fn traction(&self, t: Vector2<f64>, w: Vector2<f64>) -> Vector2<f64> {
        w * self.across + t * (self.along_less_across * t.dot(&w))
    }

    #[inline]
    fn by_velocity(&self, t: Vector2<f64>, _: Vector2<f64>) -> Matrix2<f64> {
        Matrix2::from_diagonal_element(self.across) + t * t.transpose() * self.along_less_across
    }

    #[inline]
    fn by_direction(&self, t: Vector2<f64>, w: Vector2<f64>) -> Vector2<f64> {
        let n = Vector2::new(-t.y, t.x);
        (n * t.dot(&w) + t * n.dot(&w)) * self.along_less_across
    }
}
