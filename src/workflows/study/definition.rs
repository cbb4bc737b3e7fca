//! The list of studies: dispatches each to its implementation, and checks its options.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::accuracy::{self, AccuracyOptions};
use super::column;
use super::fluid::{self, FluidOptions};
use super::flutter;
use super::modes::{self, ModesOptions};
use super::runner::{StudyOutcome, StudyRunner};
use super::scaling::{self, ScalingOptions};
use super::stability::{self, StabilityOptions, Vary};
use crate::error::{Error, Result};
use crate::files::WrittenFiles;
use crate::report::{Claim, Findings, Folder, Owner};
use crate::scene::value::Tolerance;
use crate::scene::{Document, NODES, Scene, rephrase};

/// A study with its options.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Study {
    /// Natural frequencies and mode shapes.
    Modes(ModesOptions),
    /// Time, memory and error of a step as functions of the mesh.
    Scaling(ScalingOptions),
    /// Error against cost of methods, steps and meshes.
    Accuracy(AccuracyOptions),
    /// Stability of the methods over the step and a parameter, or of the rod in a flow.
    Stability(StabilityOptions),
    /// The same motion with each fluid model.
    Fluid(FluidOptions),
}

/// Options for which an empty list stands for the default: an explicitly empty list is refused, because it would not give what was
/// asked for.
const MEANS_DEFAULT: [&str; 3] = ["nodes", "steps", "tolerances"];

impl Study {
    /// The study of this [`name`](Self::name) with `options`, each by its name; the others have their defaults.
    ///
    /// # Errors
    /// [`Error::Study`] names the option that is unknown or wrong, and what is allowed.
    pub fn named(name: &str, options: &Map<String, Value>) -> Result<Self> {
        let is_empty = |(option, value): &(&String, &Value)| {
            MEANS_DEFAULT.contains(&option.as_str()) && value.as_array().is_some_and(Vec::is_empty)
        };
        if let Some((option, _)) = options.iter().find(is_empty) {
            let problem = format!(
                "{option}: found an empty list; allowed: one number or more, or none of this option for its default"
            );
            return Err(Error::Study { problem });
        }
        let read = |options: Map<String, Value>| {
            serde_json::from_value(Value::Object([(name.into(), options.into())].into_iter().collect()))
        };
        read(options.clone()).map_err(|error: serde_json::Error| {
            // Parses each option alone to find the wrong one.
            let wrong = options.iter().find_map(|(option, value)| {
                let alone: serde_json::Error = read([(option.clone(), value.clone())].into_iter().collect()).err()?;
                (!alone.to_string().starts_with("missing field"))
                    .then(|| (option.clone(), alone, Some(value.to_string())))
            });
            let unknown: Option<serde_json::Error> =
                read(Map::new()).err().filter(|e| e.to_string().starts_with("unknown variant"));
            let (key, error, found) = match unknown {
                Some(unknown) => ("kind".to_string(), unknown, None),
                None => wrong.unwrap_or((name.to_string(), error, None)),
            };
            let (key, problem) = rephrase(key, &error.to_string(), found.as_deref());
            Error::Study { problem: format!("{key}: {problem}") }
        })
    }

    /// Its name in commands and folders.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Modes(_) => "modes",
            Self::Scaling(_) => "scaling",
            Self::Accuracy(_) => "accuracy",
            Self::Stability(_) => "stability",
            Self::Fluid(_) => "fluid",
        }
    }

    /// The default folder of its results.
    pub fn folder(&self, scene: &Scene) -> PathBuf {
        PathBuf::from("out").join(format!("{}-study-{}", scene.name, self.name()))
    }

    /// Claims `folder` for its results on `scene`.
    ///
    /// # Errors
    /// Those of [`Folder::claim`].
    pub fn claim(&self, scene: &Scene, folder: &Path, claim: Claim) -> Result<Folder> {
        let kind = format!("study of {}", self.name());
        Folder::claim(folder, Owner::of(&kind, scene), claim, &["summary.json", "report.html"])
    }

    /// Runs the study on `scene`.
    ///
    /// # Errors
    /// [`Error::Study`] for invalid options, [`Error::Scene`] if the scene lacks what is studied; those of [`Scene::model`],
    /// [`Error::Write`], [`Error::Journal`].
    pub fn run(&self, scene: &Scene, runner: StudyRunner<'_>) -> Result<StudyOutcome> {
        if let Some(problem) = self.refused() {
            return Err(Error::Study { problem });
        }
        match self {
            Self::Modes(asked) => modes::modes(scene, asked.count).map(StudyOutcome::Complete),
            Self::Scaling(asked) => scaling::scaling(scene, asked, runner),
            Self::Accuracy(asked) => accuracy::accuracy(scene, asked, runner),
            Self::Stability(asked) if asked.vary == Vary::Flow => flutter::flutter(scene, asked, runner),
            Self::Stability(asked) if asked.vary == Vary::Load => column::column(scene, asked, runner),
            Self::Stability(asked) => stability::stability(scene, asked, runner),
            Self::Fluid(asked) => fluid::fluid(scene, asked, runner),
        }
    }

    /// The error in its options, if any.
    fn refused(&self) -> Option<String> {
        match self {
            Self::Fluid(_) => None,
            Self::Modes(asked) => outside("count", &[asked.count as u64], [1, 500]),
            Self::Scaling(asked) => {
                outside("nodes", &asked.nodes, NODES).or_else(|| outside("steps", &[asked.steps], [1, u64::MAX]))
            }
            Self::Accuracy(asked) => outside("nodes", &asked.nodes, NODES)
                .or_else(|| not_positive("steps", &asked.steps))
                .or_else(|| not_tolerances("tolerances", &asked.tolerances)),
            Self::Stability(asked) => outside("points", &[asked.points as u64], [2, 200])
                .or_else(|| not_positive("accurate", &[asked.accurate]))
                .or_else(|| not_rising("range", asked.range))
                .or_else(|| not_rising("steps", asked.steps))
                .or_else(|| {
                    let found = Vary::ALL.iter().find(|(_, vary)| *vary == asked.vary && vary.is_of_rest());
                    let (name, _) = found.filter(|_| asked.steps.is_some())?;
                    Some(format!("steps: found with vary = {name}; allowed: only with other values of vary, because no run is made"))
                }),
        }
    }
}

/// The error of integers outside a range.
fn outside(name: &str, numbers: &[u64], [low, high]: [u64; 2]) -> Option<String> {
    let wrong = numbers.iter().find(|number| !(low..=high).contains(number))?;
    let most = if high == u64::MAX { "on".to_string() } else { format!("to {high}") };
    Some(format!("{name}: found {wrong}; allowed: whole numbers from {low} {most}"))
}

/// The error of numbers that must be positive.
fn not_positive(name: &str, numbers: &[f64]) -> Option<String> {
    let wrong = numbers.iter().find(|number| !(number.is_finite() && **number > 0.0))?;
    Some(format!("{name}: found {wrong}; allowed: positive numbers"))
}

/// The error of numbers that must be relative tolerances.
fn not_tolerances(name: &str, numbers: &[f64]) -> Option<String> {
    let Error::BadValue { value, allowed, .. } =
        numbers.iter().find_map(|number| Tolerance::try_from(*number).err())?
    else {
        return None;
    };
    Some(format!("{name}: found {value}; allowed: {allowed}"))
}

/// The error of two numbers that must be positive and increasing.
fn not_rising(name: &str, numbers: Option<[f64; 2]>) -> Option<String> {
    let [low, high] = numbers?;
    not_positive(name, &[low, high])
        .or_else(|| (low >= high).then(|| format!("{name}: found {low},{high}; allowed: the smaller number first")))
}

/// Writes the findings of the study of scene `name` to its `folder`, and deletes the stored runs once everything is written.
///
/// # Errors
/// Those of [`Findings::write`].
pub fn write_findings(
    findings: &Findings,
    folder: &mut Folder,
    name: &str,
    document: &Document,
) -> Result<WrittenFiles> {
    let kept = findings.write(folder, name, document)?;
    if kept.lost.is_empty() {
        folder.forget_journals();
    }
    Ok(kept)
}
