//! What a run leaves behind: tables, figures, summary and an animated page, in one folder.

pub mod cases;
pub mod chart;
mod figures;
mod output;
mod page;
mod record;
pub(crate) mod tables;
pub mod trajectory;

pub use output::Output;
pub use record::Frame;
