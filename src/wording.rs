//! Phrases that depend on the front end of the program: an option of the command is an argument in Python.
//!
//! Messages are composed from `Phrase`s, which are written for the front end in use. Finished texts are not searched and replaced,
//! so names of a user's files stay as they are.

use std::fmt;
#[cfg(feature = "report")]
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// The interface that a user works with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frontend {
    /// The command, and hosts without phrases of their own.
    Command,
    /// The Python package.
    Python,
}

/// True where this program is the Python package.
static IS_PYTHON: AtomicBool = AtomicBool::new(false);

/// Selects the front end for all further messages of this program; the default is the command.
pub fn set_frontend(frontend: Frontend) {
    IS_PYTHON.store(frontend == Frontend::Python, Ordering::Relaxed);
}

/// Phrases that differ between front ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(not(feature = "cli"), allow(dead_code, reason = "the parts that say some of them are left out"))]
pub(crate) enum Phrase {
    /// Choose another folder.
    OtherFolder,
    /// Replace existing results.
    Replace,
    /// Start from scratch.
    Restart,
    /// Use this many threads; a number follows.
    Jobs,
    /// Before an override of a key.
    Override,
    /// Before an override of a key that was given to a sweep.
    Set,
    /// What runs a sweep.
    RunsSweep,
    /// What runs a scene.
    RunsScene,
    /// What creates the folder of a run.
    MakesFolder,
    /// What produces figures.
    LeavesFigures,
    /// What lists the variables of a scene.
    ListsVariables,
    /// How the shared library of an FMU is given.
    Library,
    /// The steps of a study.
    Steps,
    /// What provides derivatives of sums over times and nodes.
    PullsBack,
    /// What reports the natural modes of a scene.
    TellsModes,
    /// What chooses the part of a run that a film shows.
    FilmWindow,
    /// What makes a film of fewer pictures.
    FewerPictures,
}

impl Phrase {
    /// The advice to run the scene in this file before its results are used.
    #[cfg(feature = "report")]
    pub(crate) fn run_first(scene: &Path) -> String {
        match frontend() {
            Frontend::Command => format!("`caudal run {}` first", scene.display()),
            Frontend::Python => format!("`caudal.run({:?}, out=…)` first", scene.display().to_string()),
        }
    }

    /// The phrase for a front end.
    fn said_by(self, frontend: Frontend) -> &'static str {
        let [command, python] = match self {
            Self::OtherFolder => ["choose another folder with --out", "choose another folder"],
            Self::Replace => ["replace it with --force", "replace it with `force=True`"],
            Self::Restart => ["start again with --restart", "start again with `restart=True`"],
            Self::Jobs => ["--jobs ", "jobs="],
            Self::Override => ["override ", ""],
            Self::Set => ["--set ", ""],
            Self::RunsSweep => ["`caudal sweep` runs it", "`caudal.sweep` runs it"],
            Self::RunsScene => ["`caudal run` runs it", "`caudal.run` runs it"],
            Self::MakesFolder => ["`caudal run SCENE` makes", "`caudal.run` with `out=` makes"],
            Self::LeavesFigures => ["`caudal run` leaves", "`caudal.run` with `out=` leaves"],
            Self::ListsVariables => ["`caudal variables SCENE` lists", "`Stepper.variables` lists"],
            Self::Library => ["--library", "`library=`"],
            Self::Steps => ["--steps", "`steps=`"],
            Self::PullsBack => ["Simulation::pull_back", "`Simulation.pull_back`"],
            Self::TellsModes => ["`caudal study modes` shows", "`caudal.study(\"modes\", scene)` shows"],
            Self::FilmWindow => {
                ["choose a part of the run with --from and --until", "choose a part of the run with `window=`"]
            }
            Self::FewerPictures => {
                ["give a smaller --fps or a larger --speed", "give a smaller `fps=` or a larger `speed=`"]
            }
        };
        match frontend {
            Frontend::Command => command,
            Frontend::Python => python,
        }
    }
}

/// The front end of this program.
fn frontend() -> Frontend {
    if IS_PYTHON.load(Ordering::Relaxed) { Frontend::Python } else { Frontend::Command }
}

impl fmt::Display for Phrase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.said_by(frontend()))
    }
}

#[cfg(test)]
mod tests {
    use super::{Frontend, Phrase};

    #[test]
    fn an_option_of_the_command_is_an_argument_in_python() {
        assert_eq!(Phrase::Replace.said_by(Frontend::Command), "replace it with --force");
        assert_eq!(Phrase::Replace.said_by(Frontend::Python), "replace it with `force=True`");
        assert_eq!(Phrase::Replace.to_string(), "replace it with --force");
    }
}
