//! Inverse design: which stiffness, from what is known or wanted of the motion. What is convex is one quadratic programme,
//! solved by Clarabel; the rest is a sequence of them with exact [sensitivities](crate::sensitivity).

mod cases;
mod checks;
pub mod elsewhere;
mod figures;
mod front;
pub mod identify;
mod limits;
pub mod markers;
mod memory;
pub mod outline;
pub mod qp;
mod refit;
mod report;
pub mod search;
pub mod shape;
pub mod table;
pub mod trust;
mod unknowns;

pub use elsewhere::{Elsewhere, simulate};
pub use front::Compromise;
pub use identify::{Identified, Verdict, identify};
pub use limits::Used;
pub use markers::Markers;
pub use refit::Refit;
pub use report::{Answer, Design};
pub use search::{Found, Iteration, Objective, Search};
pub use shape::{Rest, Resting, rest};
pub use table::{Goal, Robust, Table, Variable};
pub use trust::{Tolerance, Trust};
pub use unknowns::Profile;
