//! `caudal study`.

use std::path::PathBuf;
use std::process::ExitCode;

use caudal::error::Result;
use caudal::report::Findings;
use caudal::scene::{Document, Scene};
use caudal::study;
use clap::{Args, Subcommand};

use super::{SceneArguments, say};

/// What may be studied.
#[derive(Debug, Subcommand)]
pub enum Study {
    /// Natural frequencies and mode shapes of the rod; its matrices M, C and K for other programs
    Modes {
        #[command(flatten)]
        common: Common,
        /// How many of the lowest modes
        #[arg(long, default_value_t = 12, value_parser = clap::value_parser!(u32).range(1..=500))]
        count: u32,
    },
}

#[derive(Debug, Args)]
pub struct Common {
    #[command(flatten)]
    scene: SceneArguments,
    /// Folder for the results [default: out/<name of the scene>-study-<kind>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub fn study(study: &Study) -> Result<ExitCode> {
    match study {
        Study::Modes { common, count } => {
            let (document, scene) = common.scene.read()?;
            finish(common, "modes", &document, &scene, &study::modes(&scene, *count as usize)?)
        }
    }
}

fn finish(common: &Common, kind: &str, document: &Document, scene: &Scene, findings: &Findings) -> Result<ExitCode> {
    let default = || PathBuf::from("out").join(format!("{}-study-{kind}", scene.name));
    let folder = common.out.clone().unwrap_or_else(default);
    let files = findings.write(&folder, &scene.name, document)?;
    for answer in &findings.answers {
        say(answer);
    }
    say(&format!("{} files in {}: open report.html", files.len(), folder.display()));
    Ok(ExitCode::SUCCESS)
}
