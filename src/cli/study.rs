//! `caudal study`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use caudal::error::Error;
use caudal::report::Findings;
use caudal::scene::{Document, NODES, Scene};
use caudal::study::{self, Accuracy, Desk, Scaling, Stability, Studied, Vary};
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};

use super::run::watch_for_interrupts;
use super::{SceneArguments, complain, exit, say};

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
    /// Time, memory and error of a step on meshes from coarse to the finest, in both forms
    Scaling {
        #[command(flatten)]
        common: Common,
        /// Numbers of nodes, separated by commas [default: 17, 33, 65 … 1048577]
        #[arg(long, value_delimiter = ',', value_parser = clap::value_parser!(u64).range(NODES[0]..=NODES[1]))]
        nodes: Vec<u64>,
        /// Steps of every run
        #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..))]
        steps: u64,
    },
    /// Error against cost for every model, method, step and mesh, and which of them to take
    Accuracy {
        #[command(flatten)]
        common: Common,
        /// Numbers of nodes, separated by commas [default: the scene's, and twice and four times as many edges]
        #[arg(long, value_delimiter = ',', value_parser = clap::value_parser!(u64).range(NODES[0]..=NODES[1]))]
        nodes: Vec<u64>,
        /// Steps (s), separated by commas [default: eight times the scene's down to a thirty-second]
        #[arg(long, value_delimiter = ',', value_parser = positive)]
        steps: Vec<f64>,
        /// Tolerances of adaptive methods and cheaper models, separated by commas [default: 1e-2 … 1e-7]
        #[arg(long, value_delimiter = ',', value_parser = positive)]
        tolerances: Vec<f64>,
    },
    /// What every method does at every step, over a parameter: accurate, wrong, growing, failing
    Stability {
        #[command(flatten)]
        common: Common,
        /// What varies: modulus, amplitude, nodes or spin
        #[arg(long, default_value = "modulus", value_parser = vary)]
        vary: Vary,
        /// Its smallest and largest value [default: around the scene's]
        #[arg(long, value_name = "LOW,HIGH", value_parser = low_high)]
        range: Option<[f64; 2]>,
        /// Smallest and largest step, s [default: a hundredth to four times the scene's]
        #[arg(long, value_name = "LOW,HIGH", value_parser = low_high)]
        steps: Option<[f64; 2]>,
        /// How many values and how many steps
        #[arg(long, default_value_t = 12, value_parser = clap::value_parser!(u32).range(2..=200))]
        points: u32,
        /// Error of the tip's path up to which a run is accurate, relative to how far the tip goes
        #[arg(long, default_value_t = 0.05, value_parser = positive)]
        accurate: f64,
    },
}

fn vary(text: &str) -> Result<Vary, String> {
    let names = || Vary::ALL.map(|(name, _)| name).join(", ");
    Vary::ALL
        .into_iter()
        .find(|(name, _)| *name == text)
        .map(|(_, vary)| vary)
        .ok_or_else(|| format!("allowed: {}", names()))
}

/// Two rising positive numbers.
fn low_high(text: &str) -> Result<[f64; 2], String> {
    let refused = || "allowed: two positive numbers, the smaller first, as 1e-5,1e-2".to_string();
    let (low, high) = text.split_once(',').ok_or_else(refused)?;
    let (low, high) = (positive(low)?, positive(high)?);
    if low < high { Ok([low, high]) } else { Err(refused()) }
}

/// A positive number.
fn positive(text: &str) -> Result<f64, String> {
    let number: f64 = text.trim().parse().map_err(|e| format!("{e}"))?;
    if number > 0.0 && number.is_finite() { Ok(number) } else { Err("allowed: a positive number".to_string()) }
}

#[derive(Debug, Args)]
pub struct Common {
    #[command(flatten)]
    scene: SceneArguments,
    /// Folder for the results [default: out/<name of the scene>-study-<kind>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub fn study(study: &Study) -> Result<ExitCode, Error> {
    match study {
        Study::Modes { common, count } => {
            common.study("modes", |scene, _| Ok(Studied::Complete(study::modes(scene, *count as usize)?)))
        }
        Study::Scaling { common, nodes, steps } => {
            let nodes = if nodes.is_empty() { Scaling::default().nodes } else { nodes.clone() };
            let asked = Scaling { nodes, steps: *steps };
            common.study("scaling", |scene, desk| study::scaling(scene, &asked, desk))
        }
        Study::Accuracy { common, nodes, steps, tolerances } => {
            let asked = Accuracy { nodes: nodes.clone(), steps: steps.clone(), tolerances: tolerances.clone() };
            common.study("accuracy", |scene, desk| study::accuracy(scene, &asked, desk))
        }
        Study::Stability { common, vary, range, steps, points, accurate } => {
            let (vary, points, accurate) = (*vary, *points as usize, *accurate);
            let asked = Stability { vary, range: *range, steps: *steps, points, accurate };
            common.study("stability", |scene, desk| study::stability(scene, &asked, desk))
        }
    }
}

impl Common {
    /// Makes the study `kind`, with a bar of its runs on a terminal, and writes what it found.
    fn study(
        &self,
        kind: &str,
        make: impl FnOnce(&Scene, Desk<'_>) -> Result<Studied, Error>,
    ) -> Result<ExitCode, Error> {
        let (document, scene) = self.scene.read()?;
        let default = || PathBuf::from("out").join(format!("{}-study-{kind}", scene.name));
        let folder = self.out.clone().unwrap_or_else(default);
        let interrupted = watch_for_interrupts();
        let bar = ProgressBar::new(0);
        if let Ok(style) = ProgressStyle::with_template("{bar:24} {percent:>3} %  run {pos}/{len}  {eta} left") {
            bar.set_style(style);
        }
        let progress = |done: usize, of: usize| {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
        };
        let made = make(&scene, Desk { folder: &folder, interrupted: &interrupted, progress: &progress });
        bar.finish_and_clear();
        match made? {
            Studied::Complete(findings) => finish(&folder, &document, &scene, &findings),
            Studied::Interrupted(done, of) => {
                complain(&format!(
                    "interrupted: {done} of {of} runs are kept in {}; the same command goes on from there",
                    folder.display()
                ));
                Ok(ExitCode::from(exit::INTERRUPTED))
            }
        }
    }
}

fn finish(folder: &Path, document: &Document, scene: &Scene, findings: &Findings) -> Result<ExitCode, Error> {
    let files = findings.write(folder, &scene.name, document)?;
    study::forget(folder);
    for answer in &findings.answers {
        say(answer);
    }
    say(&format!("{} files in {}: open report.html", files.len(), folder.display()));
    Ok(ExitCode::SUCCESS)
}
