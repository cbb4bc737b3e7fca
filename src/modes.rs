//! Natural frequencies of the discrete rod: K φ = ω² M φ at the straight, unstressed rest state.
//!
//! K is the model's own Jacobian there, without actuation, drag and loads; M is the lumped mass. Along a straight rod the
//! two axes decouple: motion across it bends, motion along it stretches. A held head leaves node 0 out; the rigid modes of
//! a free rod are dropped. Source: R. W. Clough & J. Penzien, Dynamics of Structures (1975), chapter 12.

use std::sync::Arc;

use faer::{Mat, Side};

use crate::error::{Error, Result};
use crate::head::Signal;
use crate::linear::BandMatrix;
use crate::model::{Dynamics, Model};
use crate::rod::Rod;
use crate::start::Start;
use crate::system::{Direction, Linearisation, System};

/// The natural angular frequencies of a rod (rad/s), each list rising, without the rigid modes.
#[derive(Debug, Clone, PartialEq)]
pub struct Modes {
    /// Of bending: motion across the rod; N − 2 of a free rod, N − 1 of one with a held head.
    pub bending: Vec<f64>,
    /// Of stretching: motion along the rod; N − 1 of either.
    pub stretching: Vec<f64>,
}

impl Modes {
    /// The modes of `rod`, whose head is held where it has a joint at node 0. The matrices are dense: the cost grows as
    /// N³, and rounding reaches the first bending frequency as N⁴ (3·10⁻⁶ of its square at N = 1000).
    ///
    /// # Errors
    /// [`Error::Linear`] where the eigenvalue iteration does not converge.
    pub fn of(rod: &Rod) -> Result<Self> {
        let held = rod.first_joint == 0;
        let mut dynamics = Dynamics::new(Arc::new(Model {
            rod: rod.clone(),
            actuation: None,
            start: Start::Jump,
            drag: None,
            load: None,
            head: held.then(|| [0.0; 3].map(Signal::Constant)),
        }));
        let straight = dynamics.first_state();
        let mut matrix = BandMatrix::new(rod.nodes);
        let direction = Direction { q: 1.0, v: 0.0, a: 0.0 };
        let stiffness = Linearisation { matrix: &mut matrix, direction };
        dynamics.assemble(&straight, &mut vec![0.0; 2 * rod.nodes], Some(stiffness))?;
        let first = usize::from(held);
        // A free rod moves rigidly along itself, across itself and around its centre.
        let [along, across] = if held { [0, 0] } else { [1, 2] };
        Ok(Self {
            bending: axis(&matrix, &rod.mass, first, 1, across)?,
            stretching: axis(&matrix, &rod.mass, first, 0, along)?,
        })
    }

    /// The lowest of all.
    pub fn lowest(&self) -> f64 {
        self.bending.iter().chain(&self.stretching).copied().fold(f64::INFINITY, f64::min)
    }

    /// The highest of all: the one that bounds the step of an explicit method.
    pub fn highest(&self) -> f64 {
        self.bending.iter().chain(&self.stretching).copied().fold(0.0, f64::max)
    }
}

/// The frequencies (rad/s) of motion along `axis` of the nodes from `first` on, without the `rigid` lowest, from the
/// symmetric M^(−½) K M^(−½).
fn axis(stiffness: &BandMatrix, mass: &[f64], first: usize, axis: usize, rigid: usize) -> Result<Vec<f64>> {
    let free = mass.len() - first;
    let scaled = Mat::from_fn(free, free, |i, j| {
        let (i, j) = (i + first, j + first);
        stiffness.entry(2 * i + axis, 2 * j + axis) / (mass[i] * mass[j]).sqrt()
    });
    let squares = scaled
        .self_adjoint_eigenvalues(Side::Lower)
        .map_err(|e| Error::Linear { unknowns: free, reason: format!("its eigenvalues: {e:?}") })?;
    Ok(squares.into_iter().skip(rigid).map(|square| square.max(0.0).sqrt()).collect())
}
