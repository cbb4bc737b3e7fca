//! Sweeps: parameter studies of one scene along axes. All cases run on all cores; a sweep can be resumed and split into shards.
//!
//! A [`Sweep`] is a file that names a base scene and axes; it numbers its cases and creates their scenes. [`run`] runs the cases
//! without a result in the journal, and [`SweepResults`] writes the table, figures and report.

mod axis;
mod case_result;
mod case_run;
mod definition;
mod distributed;
mod results;

pub use axis::{AxisKind, Sampling, SweepAxis};
pub use case_result::CaseResult;
pub use case_run::{run, run_together};
pub use definition::{Case, ReportTable, Sweep, SweepRecordTable};
pub use distributed::SweepWorker;
pub use results::{RecentResults, SweepResults, WrittenSweep};
