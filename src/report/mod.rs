//! What a run or a study leaves behind: tables, figures, numbers and a page, in one folder.

pub mod cases;
pub mod chart;
mod figures;
mod findings;
pub mod map;
mod output;
mod page;
mod record;
pub(crate) mod tables;
pub mod trajectory;

pub use findings::{Findings, Table};
pub use output::Output;
pub use page::Motion;
pub use record::Frame;
pub use tables::check_writable;
