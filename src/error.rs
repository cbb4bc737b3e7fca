//! The one error type of the library. Every variant carries the numbers; its message says where the problem is and what to do.

use std::path::PathBuf;

use serde::Serialize;

use crate::wording::Phrase;

/// How a run gets smaller steps, whether they are fixed or adaptive.
const SMALLER: &str = "smaller steps (solver.time_step_s, or solver.tolerance if that is not given)";

/// Everything that can go wrong, with the numbers. A serialised error is the variant's name with its fields.
#[derive(Debug, Clone, PartialEq, thiserror::Error, Serialize)]
#[non_exhaustive]
pub enum Error {
    /// A scene (or an override of one of its keys) says something that is not allowed.
    #[error("{place}: {key}{}{problem}", if key.is_empty() { "" } else { ": " })]
    Scene {
        /// File and line, or the override on the command line.
        place: String,
        /// Dotted key, for example `rod.nodes`; empty if no single key is at fault.
        key: String,
        /// What was found and what is allowed.
        problem: String,
    },
    /// A scene says several things that are not allowed.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Several(Vec<Error>),
    /// A file cannot be read.
    #[error("{}: cannot be read: {reason}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        reason: String,
    },
    /// A file or folder cannot be written.
    #[error("{}: cannot be written: {reason}", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's reason.
        reason: String,
    },
    /// A folder holds other results than those that would be written.
    #[error("{}: holds {holds}, not {wanted}; {}{}", path.display(), Phrase::OtherFolder, or_replace(*kept))]
    Occupied {
        /// The folder.
        path: PathBuf,
        /// What the folder contains.
        holds: String,
        /// What would be written.
        wanted: String,
        /// True if it is kept even where results are replaced, as an export never takes the place of a result.
        kept: bool,
    },
    /// Another program is using a folder of results.
    #[error("{}: another program is using it; wait until it has finished, or {}", path.display(), Phrase::OtherFolder)]
    Busy {
        /// The folder.
        path: PathBuf,
    },
    /// The results do not fit on the disk.
    #[error("{}: not enough disk space: {what} need about {}, and {} are free", path.display(), bytes(*needed), bytes(*free))]
    Room {
        /// The folder.
        path: PathBuf,
        /// What would be written, and the keys that determine its size.
        what: String,
        /// Its size, bytes.
        needed: f64,
        /// Free space on the disk, bytes.
        free: f64,
    },
    /// A journal of results cannot be used.
    #[error("{}: {problem}", path.display())]
    Journal {
        /// The file.
        path: PathBuf,
        /// What is wrong with it and what to do.
        problem: String,
    },
    /// A worker cannot do the work that it was sent, or a result that it returned is damaged.
    #[error("the request cannot be carried out: {problem}")]
    Bundle {
        /// What is wrong with it.
        problem: String,
    },
    /// The system allows fewer threads than were requested.
    #[error("{started} of {wanted} threads could be started: {reason}; use fewer, with {}{}", Phrase::Jobs, (*started / 2).max(1))]
    Threads {
        /// The number of requested threads.
        wanted: usize,
        /// The number of threads started.
        started: usize,
        /// The operating system's reason.
        reason: String,
    },
    /// Newton's method did not converge, even after the step was halved.
    #[error(
        "no convergence at t = {time_s} s after {iterations} Newton iterations with a step of {step_s:e} s: last \
         increment {increment_m:e} m, residual {residual_n:e} N, worst at node {node}; try {smaller}, a \
         start that is not `jump`, or fewer nodes", smaller = SMALLER)]
    NotConverged {
        /// Target time of the step, s.
        time_s: f64,
        /// The (halved) step, s.
        step_s: f64,
        /// Newton iterations made.
        iterations: u32,
        /// Largest displacement increment of the last iteration, m.
        increment_m: f64,
        /// Largest residual force, N.
        residual_n: f64,
        /// Node with the largest residual.
        node: usize,
    },
    /// A value is not finite.
    #[error(
        "{what} is not finite at node {node}, t = {time_s} s; try {smaller}, or check the inputs", smaller = SMALLER)]
    NotFinite {
        /// Time, s.
        time_s: f64,
        /// Node.
        node: usize,
        /// Which quantity.
        what: &'static str,
    },
    /// The rod folded over at a joint: its turning angle reached π, where the curvature is singular.
    #[error(
        "the rod folds over at node {node}, t = {time_s} s: the angle of the joint reaches ±180°, where the curvature is singular; \
         try {smaller}, more nodes, or a weaker actuation", smaller = SMALLER)]
    FoldOver {
        /// Time, s.
        time_s: f64,
        /// The joint's node.
        node: usize,
    },
    /// An edge shrank to zero length, or reversed its direction within one step, which implies zero length.
    #[error(
        "the edge between nodes {node} and {} collapses, or flips within one step, at t = {time_s} s: its length is \
         {length_m:e} m; try {smaller}, or weaker loads", node + 1, smaller = SMALLER)]
    EdgeCollapse {
        /// Time, s.
        time_s: f64,
        /// First node of the edge.
        node: usize,
        /// Its length, m.
        length_m: f64,
    },
    /// A linear solver could not be set up.
    #[error("the linear solver could not be set up for {unknowns} unknowns: {reason}")]
    Linear {
        /// Size of the system.
        unknowns: usize,
        /// The solver's reason.
        reason: String,
    },
    /// The report cannot be made.
    #[error("the report cannot be created: {reason}")]
    Page {
        /// The reason.
        reason: String,
    },
    /// The estimated error of a step stays above the tolerance, however small the step is.
    #[error(
        "at t = {time_s} s the error of a step stays above solver.tolerance = {tolerance:e} even with a step of \
         {step_s:e} s; try a larger tolerance, or a fixed solver.time_step_s"
    )]
    Tolerance {
        /// Time, s.
        time_s: f64,
        /// The last step, s.
        step_s: f64,
        /// The tolerance.
        tolerance: f64,
    },
    /// A time outside the last internal step, where the state is unknown.
    #[error("there is no output at t = {time_s} s: the last internal step went from {} s to {} s", within[0], within[1])]
    OutsideStep {
        /// The requested time, s.
        time_s: f64,
        /// Begin and end of the last internal step, s.
        within: [f64; 2],
    },
    /// Another thread ended the computation.
    #[error("interrupted")]
    Interrupted,
    /// Invalid options of a study.
    #[error("the study cannot be run: {problem}")]
    Study {
        /// What was found, and what is allowed.
        problem: String,
    },
    /// Runs cannot be compared.
    #[error("the runs cannot be compared: {problem}")]
    Comparison {
        /// What was found, and what is allowed.
        problem: String,
    },
    /// A simulation does not have the requested derivative.
    #[error("{problem}")]
    Derivative {
        /// What was asked for, and what is allowed.
        problem: String,
    },
    /// No design meets the requirements.
    #[error("no design: {reason}")]
    Design {
        /// The reason, and which requirements conflict.
        reason: String,
    },
    /// An FMU cannot be made.
    #[error("the FMU cannot be created: {0}")]
    Fmu(String),
    /// The communication step is not a positive, finite time.
    #[error("a step of {0} s is not possible: it must be positive and finite")]
    Step(f64),
    /// No variable has this name in this scene.
    #[error("there is no variable `{name}` in this scene{}", remedy(*needs, *nearest))]
    UnknownVariable {
        /// The requested name.
        name: String,
        /// The most similar existing name.
        nearest: Option<&'static str>,
        /// What the scene lacks for it.
        needs: Option<&'static str>,
    },
    /// No derivative of this order can be set.
    #[error("a derivative of order {order} cannot be set; allowed: 1 to {highest}")]
    Order {
        /// The requested order.
        order: usize,
        /// The highest supported order.
        highest: usize,
    },
    /// A saved state that cannot be restored.
    #[error("the saved state cannot be read: {0}")]
    Snapshot(String),
    /// Only inputs can be set.
    #[error("variable `{0}` is not an input: it cannot be set")]
    NotAnInput(&'static str),
    /// An array of the wrong length was given for a variable.
    #[error("variable `{name}` has {expected} values, not {found}")]
    WrongLength {
        /// The variable.
        name: &'static str,
        /// Its number of values.
        expected: usize,
        /// The number given.
        found: usize,
    },
    /// A value outside the variable's range.
    #[error("variable `{name}`: found {value}; allowed: {allowed}")]
    BadValue {
        /// The variable.
        name: &'static str,
        /// The value given.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
}

/// The library's result.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// True for failures of a step that a smaller step may cure.
    pub(crate) fn is_cured_by_smaller_step(&self) -> bool {
        matches!(
            self,
            Self::NotConverged { .. }
                | Self::NotFinite { .. }
                | Self::FoldOver { .. }
                | Self::EdgeCollapse { .. }
                | Self::Tolerance { .. }
        )
    }

    /// The file that the error concerns.
    pub fn path(&self) -> Option<&PathBuf> {
        match self {
            Self::Read { path, .. }
            | Self::Write { path, .. }
            | Self::Journal { path, .. }
            | Self::Occupied { path, .. }
            | Self::Busy { path }
            | Self::Room { path, .. } => Some(path),
            _ => None,
        }
    }

    /// True if the input, a file or an argument, is at fault, so that nothing was run or written.
    pub fn is_bad_input(&self) -> bool {
        matches!(
            self,
            Self::Scene { .. }
                | Self::Several(_)
                | Self::Occupied { .. }
                | Self::Busy { .. }
                | Self::Read { .. }
                | Self::Study { .. }
                | Self::Comparison { .. }
                | Self::Fmu(_)
                | Self::Derivative { .. }
                | Self::Journal { .. }
                | Self::Room { .. }
                | Self::Threads { .. }
                | Self::Step(_)
                | Self::OutsideStep { .. }
                | Self::UnknownVariable { .. }
                | Self::Order { .. }
                | Self::Snapshot(_)
                | Self::NotAnInput(_)
                | Self::WrongLength { .. }
                | Self::BadValue { .. }
        )
    }
}

/// A number of bytes in readable units.
pub fn bytes(count: f64) -> String {
    let units = [(1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB")];
    match units.into_iter().find(|(size, _)| count >= *size) {
        Some((size, unit)) if count < 1000.0 * size => format!("{:.1} {unit}", count / size),
        Some((size, unit)) => format!("{:.1e} {unit}", count / size),
        None => format!("{count:.0} bytes"),
    }
}

/// What a scene lacks for a missing variable, or the variable with the nearest name.
/// The second remedy of [`Error::Occupied`], unless what is there is kept.
fn or_replace(kept: bool) -> String {
    if kept { String::new() } else { format!(", or {}", Phrase::Replace) }
}

fn remedy(needs: Option<&str>, nearest: Option<&str>) -> String {
    if let Some(needs) = needs {
        return format!(": it needs {needs}");
    }
    match nearest {
        Some(_) => did_you_mean(nearest),
        None => format!("; {} them", Phrase::ListsVariables),
    }
}

/// The question whether `near` was meant.
pub(crate) fn did_you_mean(near: Option<&str>) -> String {
    near.map_or(String::new(), |near| format!("; did you mean `{near}`?"))
}

/// The most similar of `names` to a misspelt one, if any is similar at all.
pub(crate) fn nearest<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    names
        .map(|other| (strsim::jaro_winkler(&name.to_lowercase(), &other.to_lowercase()), other))
        .filter(|(similarity, _)| *similarity > 0.8)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, other)| other)
}
