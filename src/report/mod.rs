//! What a run or a study leaves behind: tables, figures, numbers and a page, in one folder.

pub mod cases;
pub mod chart;
mod chart_axis;
mod figures;
#[cfg(feature = "pictures")]
pub mod film;
mod findings;
mod folder;
mod heat_map;
pub mod map;
mod output;
mod page;
#[cfg(feature = "parquet")]
pub mod parquet;
#[cfg(feature = "pictures")]
pub mod picture;
mod record;
mod summary;
mod svg;
pub mod tables;
pub mod trajectory;
pub mod vtk;

pub use chart::Figure;
pub use findings::{Findings, Table};
pub use folder::{Claim, Folder, JOURNAL, MANIFEST, Owner, Writing};
pub use output::Output;
pub use page::Motion;
pub use record::Frame;
pub use summary::{FluidError, Summary};
