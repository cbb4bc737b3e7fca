//! Exact derivatives of a simulation: of any recorded [`Output`] with respect to stiffness, natural curvature and scalar
//! [`Parameter`]s.
//!
//! A one-stage method solves f(t, q, v, a; p) = 0 with q = q* + A a, v = v* + B a (`StepWeights`). With J = M + A f_q + B f_v and
//! derivatives Q, V, … of q, v, … with respect to p, this gives
//!
//! J (Q − Q*) = −A (f_q Q* + f_v V* + f_p), from which the derivatives of a and v follow.
//!
//! Internal forces do not change when the whole rod moves, so f_q Q* is summed over differences of nodes, (f_q)ᵢⱼ (Q*ⱼ − Q*ᵢ).
//! Otherwise the stretching stiffness, 10⁸ N/m in an aluminium tail, would turn rounding errors of Q* into accelerations.
//!
//! [`Problem::forward`] advances all columns with the simulation: one more matrix per step, and one solve per parameter.
//! [`Problem::adjoint`] goes backwards over a stored simulation with the transposed matrix: one solve per step for any number of
//! parameters. Both are exact to rounding if Newton's method has converged to rounding. They need fixed steps, a one-stage
//! integrator, and positions as unknowns.
//!
//! [`value_and_grad`] and [`Simulation`] identify outputs and parameters by name.
//!
//! Source: J. T. Betts, Practical Methods for Optimal Control (2010), chapter 3; derivation for these methods:
//! docs/src/notes/sensitivity.md.
mod adjoint;
mod checkpoints;
mod controls;
mod cycle_means;
mod equations;
mod finite_difference;
mod forward;
pub mod output;
pub mod parameter;
mod problem;
pub mod scene_parameter;
mod shaped_start;
pub mod simulation;
mod step_derivative;
mod step_ends;
mod time_grid;
mod trajectory;

pub use controls::{Controls, Cotangents, Weights};
pub use finite_difference::FiniteDifference;
pub use forward::Sensitivities;
pub use output::{HingeQuantity, Output, Quantity, WorkKind};
pub use parameter::{JointDirection, Parameter};
pub use problem::Problem;
pub use simulation::{Array, Simulation, value_and_grad};
pub use step_derivative::{LinearisationRequest, StepDerivative};
pub use trajectory::Trajectory;

/// The derivatives of a state with respect to one parameter.
#[derive(Debug, Clone)]
struct TangentState {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    memory: Vec<f64>,
}

#[inline]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
