//! Studies of a scene: what a user asks before trusting a run. Each makes [`Findings`](crate::report::Findings).

mod modes;

pub use modes::modes;
