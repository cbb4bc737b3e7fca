//! `caudal study`: runs the studies of modes, scaling, accuracy, stability and fluid models.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

use caudal::error::Error;
use caudal::integrator::METHODS;
use caudal::reduced::MODELS;
use caudal::report::Claim;
use caudal::study::{
    self, AccuracyOptions, FluidOptions, ModesOptions, ScalingOptions, StabilityOptions, StudyOutcome, StudyRunner,
    Vary,
};
use clap::{Args, Subcommand};

use super::progress::{Progress, Unit};
use super::run::watch_for_interrupts;
use super::{SceneArguments, exit, print_error, print_kept, print_unless_quiet, refuse};

/// What may be studied.
#[derive(Debug, Clone, Subcommand)]
pub enum StudyCommand {
    /// Natural frequencies and mode shapes of the rod; its matrices M, C and K for other programs
    Modes {
        #[command(flatten)]
        common: StudyArguments,
        /// Number of modes, lowest first
        #[arg(long, default_value_t = ModesOptions::default().count)]
        count: usize,
    },
    /// Time, memory and error of a step on meshes from coarse to the finest, in both forms
    Scaling {
        #[command(flatten)]
        common: StudyArguments,
        /// Numbers of nodes, separated by commas [default: 17, 33, 65 … 1048577]
        #[arg(long, value_delimiter = ',')]
        nodes: Vec<u64>,
        /// Steps of every run
        #[arg(long, default_value_t = ScalingOptions::default().steps)]
        steps: u64,
    },
    /// Error against cost for every model, method, step and mesh, with a recommendation
    Accuracy {
        #[command(flatten)]
        common: StudyArguments,
        /// Numbers of nodes, separated by commas [default: the scene's, and twice and four times as many edges]
        #[arg(long, value_delimiter = ',')]
        nodes: Vec<u64>,
        /// Steps (s), separated by commas [default: eight times the scene's down to a thirty-second]
        #[arg(long, value_delimiter = ',')]
        steps: Vec<f64>,
        /// Tolerances of adaptive methods and cheaper models, separated by commas [default: 1e-2 … 1e-7]
        #[arg(long, value_delimiter = ',')]
        tolerances: Vec<f64>,
        /// Methods and cheaper models that are left out, separated by commas
        #[arg(long, value_delimiter = ',', value_name = "NAMES", value_parser = method_or_model)]
        without: Vec<String>,
    },
    /// The same motion under every valid fluid law: speed, power, cost, and which law the scene needs
    Fluid {
        #[command(flatten)]
        common: StudyArguments,
    },
    /// Outcome of every method at every step, over a parameter: accurate, wrong, growing, failing. With --vary flow: where a held tail
    /// stays at rest, flutters or diverges, over the speed of the flow and the mass of the tail, compared with theory. With --vary
    /// load: the same under point loads, over the damping of the material
    Stability {
        #[command(flatten)]
        common: StudyArguments,
        /// What varies: modulus, amplitude, nodes, spin, damping, flow, or load
        #[arg(long, default_value = "modulus", value_parser = vary)]
        vary: Vary,
        /// Its smallest and largest value [default: a ten-thousandth of the scene's to the scene's for the modulus, a quarter to four
        /// times the scene's for the amplitude]
        #[arg(long, value_name = "LOW,HIGH", value_parser = low_high)]
        range: Option<[f64; 2]>,
        /// Smallest and largest step, s [default: a hundredth to four times the scene's]
        #[arg(long, value_name = "LOW,HIGH", value_parser = low_high)]
        steps: Option<[f64; 2]>,
        /// Number of values and number of steps
        #[arg(long, default_value_t = StabilityOptions::default().points)]
        points: usize,
        /// Largest error of the tip's path of an accurate run, relative to the range of the tip's motion
        #[arg(long, default_value_t = StabilityOptions::default().accurate)]
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

/// The name of a method, or of a model other than the whole.
fn method_or_model(text: &str) -> Result<String, String> {
    let cheaper = MODELS.iter().filter(|kind| kind.method.is_some()).map(|kind| kind.name);
    let names: Vec<_> = METHODS.iter().map(|method| method.name).chain(cheaper).collect();
    if names.contains(&text) { Ok(text.to_string()) } else { Err(format!("allowed: {}", names.join(", "))) }
}

/// Two numbers.
fn low_high(text: &str) -> Result<[f64; 2], String> {
    let number = |text: &str| text.trim().parse::<f64>();
    text.split_once(',')
        .and_then(|(low, high)| Some([number(low).ok()?, number(high).ok()?]))
        .ok_or_else(|| "allowed: two numbers, the smaller first, as 1e-5,1e-2".to_string())
}

#[derive(Debug, Clone, Args)]
pub struct StudyArguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// Folder for the results [default: out/<name of the scene>-study-<kind>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace other results in the folder
    #[arg(long)]
    force: bool,
}

/// Runs a study, with a progress bar on a terminal, and writes its findings.
pub fn study(study: &StudyCommand) -> Result<ExitCode, Error> {
    let (common, study) = match study.clone() {
        StudyCommand::Modes { common, count } => (common, study::Study::Modes(ModesOptions { count })),
        StudyCommand::Scaling { common, nodes, steps } => {
            (common, study::Study::Scaling(ScalingOptions { nodes, steps }))
        }
        StudyCommand::Accuracy { common, nodes, steps, tolerances, without } => {
            (common, study::Study::Accuracy(AccuracyOptions { nodes, steps, tolerances, without }))
        }
        StudyCommand::Fluid { common } => (common, study::Study::Fluid(FluidOptions::default())),
        StudyCommand::Stability { common, vary, range, steps, points, accurate } => {
            (common, study::Study::Stability(StabilityOptions { vary, range, steps, points, accurate }))
        }
    };
    let (document, scene) = common.scene.read()?;
    let folder = common.out.unwrap_or_else(|| study.folder(&scene));
    let held = match study.claim(&scene, &folder, Claim::forced(common.force)) {
        Ok(held) => Mutex::new(held),
        Err(error) => return Ok(refuse(&error)),
    };
    let interrupted = watch_for_interrupts();
    let progress = Progress::of(Unit::Exactly("simulations"), 0.0);
    let made = {
        let tell = |done: usize, of: usize| progress.set_of(done as f64, of as f64);
        study.run(&scene, StudyRunner::new(&held, &interrupted, &tell))
    };
    drop(progress);
    match made? {
        StudyOutcome::Complete(findings) => {
            let mut held = held.into_inner().unwrap_or_else(PoisonError::into_inner);
            let kept = study::write_findings(&findings, &mut held, &scene.name, &document)?;
            for answer in &findings.answers {
                print_unless_quiet(answer);
            }
            Ok(print_kept(&kept, &folder))
        }
        StudyOutcome::Interrupted(done, of) => {
            print_error(&format!(
                "interrupted: {done} of {of} runs are stored in {}; the same command resumes there",
                folder.display()
            ));
            Ok(ExitCode::from(exit::INTERRUPTED))
        }
    }
}
