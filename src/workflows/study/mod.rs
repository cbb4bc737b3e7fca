//! Studies of a scene: accuracy, stability, scaling, natural modes, and a comparison of fluid models. Each produces [`Findings`](crate::report::Findings).
//!
//! A study is a list of independent runs and an evaluation of their results. Finished runs are stored in a journal in its folder, so
//! that an interrupted study resumes. [`DistributedStudy`] lets workers run them.

mod accuracy;
mod beam;
mod column;
mod definition;
mod distributed;
mod fluid;
mod flutter;
mod modes;
mod rest_map;
mod root_search;
mod runner;
mod scaling;
mod stability;
mod study_run;

pub use accuracy::AccuracyOptions;
pub use definition::{Study, write_findings};
pub use distributed::{DistributedStudy, make_runs};
pub use fluid::FluidOptions;
pub use modes::ModesOptions;
pub use runner::{StudyOutcome, StudyRunner};
pub use scaling::ScalingOptions;
pub use stability::{StabilityOptions, Vary};
