//! `caudal compare`: puts finished runs side by side on one page.

use std::path::PathBuf;
use std::process::ExitCode;

use caudal::error::{Error, Result};
use caudal::report::Claim;
use caudal::report::comparison::Comparison;
use clap::Args;

use super::{print, print_kept, print_unless_quiet, refuse, set_quiet};

#[derive(Debug, Args)]
pub struct CompareArguments {
    /// The folders of the runs, as `caudal run` writes them; differences are from the first
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Folder for the comparison [default: out/compare-<names of the runs>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace other results in the folder
    #[arg(long)]
    force: bool,
    /// Print only the content of summary.json
    #[arg(long)]
    json: bool,
}

/// Compares the runs, and prints what differs.
pub fn compare(arguments: &CompareArguments) -> Result<ExitCode> {
    set_quiet(arguments.json);
    let comparison = Comparison::read(&arguments.runs)?;
    let folder = arguments.out.clone().unwrap_or_else(|| comparison.folder());
    let mut held = match comparison.claim(&folder, Claim::forced(arguments.force)) {
        Ok(held) => held,
        Err(error) => return Ok(refuse(&error)),
    };
    let kept = comparison.write(&mut held)?;
    print_unless_quiet(&format!("runs: {}", comparison.labels.join(" | ")));
    for answer in &comparison.answers {
        print_unless_quiet(answer);
    }
    for note in &comparison.notes {
        print_unless_quiet(&format!("note: {note}"));
    }
    if arguments.json {
        let content = comparison.content();
        print(&serde_json::to_string_pretty(&content).map_err(|e| Error::Page { reason: e.to_string() })?);
    }
    Ok(print_kept(&kept, &folder))
}
