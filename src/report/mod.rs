//! Reports: what a run, sweep, study or design writes to its folder: tables, figures (SVG), numbers (JSON) and a self-contained
//! page (HTML).

#[cfg(feature = "pictures")]
mod body_outline;
pub mod cases;
pub mod chart;
mod chart_axis;
pub mod comparison;
#[cfg(feature = "pictures")]
pub mod film;
#[cfg(feature = "pictures")]
mod film_scene;
mod findings;
mod folder;
mod frame;
mod heat_map;
mod interpolation;
mod number_groups;
pub mod outcome_map;
mod output;
mod packed_numbers;
mod page;
#[cfg(feature = "parquet")]
pub mod parquet;
#[cfg(feature = "pictures")]
pub mod picture;
pub mod recorded_run;
mod rod_motion;
mod run_figures;
mod run_record;
pub mod sampling;
mod summary;
mod svg;
pub mod tables;
pub mod trajectory;
pub mod vtk;

pub use chart::Figure;
pub use findings::{Findings, Table};
pub use folder::{Claim, Folder, FolderWriter, JOURNAL, MANIFEST, Owner, VTK_FOLDER};
pub use frame::{Frame, Medium};
pub use output::RunOutput;
pub use page::Animation;
pub use recorded_run::recorded_overrides;
pub use rod_motion::{DrawnRod, MAX_POINTS, RodMotion, drawn_nodes};
#[cfg(test)]
pub(crate) use run_figures::energy_balance;
pub use run_record::RecordingTimes;
#[cfg(test)]
pub(crate) use run_record::RunRecord;
pub use summary::{FluidError, Summary, TendonMaxima};
