//! Inverse design: the stiffness, actuation or numbers of a scene that explain a measured motion or reach a goal. Convex problems are one
//! quadratic program, solved by Clarabel; all others a sequence of them with exact [sensitivities](crate::sensitivity).

mod basis;
mod checkpoint;
mod design_vector;
mod designed_scene;
mod discretisation;
pub mod distributed;
mod explanations;
mod figures;
mod front;
pub mod identify;
mod limits;
pub mod markers;
mod objective;
pub mod qp;
mod refit;
pub mod robustness;
mod scenarios;
pub mod search;
mod solve;
pub mod static_shape;
pub mod stl;
pub mod table;
pub mod tolerance;
mod unknowns;

pub use design_vector::DesignVector;
pub use distributed::{DistributedDesign, simulate};
pub use front::ParetoPoint;
pub use identify::{Identifiability, Identification, identify};
pub use limits::LimitUse;
pub use markers::{MarkedNodes, Markers};
pub use objective::Objective;
pub use refit::Refit;
pub use robustness::Robustness;
pub use search::{Search, SearchIteration, SearchResult};
pub use solve::{Answer, Design};
pub use static_shape::{Equilibrium, StaticShape, rest};
pub use table::{Aggregate, DesignTable, DesignVariable, Goal};
pub use tolerance::Tolerance;
