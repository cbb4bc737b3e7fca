//! What a run leaves behind: tables, figures, summary and an animated page, in one folder.

pub mod chart;
mod figures;
mod output;
mod page;
mod record;
mod tables;

pub(crate) use tables::{beside, put_in_place, write_error};

pub use output::Output;
