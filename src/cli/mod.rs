//! The command line: arguments, output, and exit codes.

mod check;
mod compare;
#[cfg(feature = "design")]
mod design;
mod export;
mod fmu;
mod new;
mod progress;
mod run;
mod shell;
mod study;
mod sweep;
mod variables;

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use caudal::error::{Error, Result};
use caudal::files::WrittenFiles;
use caudal::fmu::FmuOptions;
use caudal::scene::{Document, Scene};
use caudal::stepper::Stepper;
use clap::{Args, Parser, Subcommand};

/// Exit codes, on which users' scripts rely.
mod exit {
    /// The run failed; what was computed so far is kept.
    pub const FAILED: u8 = 1;
    /// The input is wrong; nothing is written.
    pub const WRONG_INPUT: u8 = 2;
    /// Ctrl-C; the files are valid up to that time.
    pub const INTERRUPTED: u8 = 130;
}

/// Simulates bio-inspired tails and swimmers: a slender rod driven by a wave of natural curvature or of moments in a fluid.
#[derive(Debug, Parser)]
#[command(
    version,
    after_help = "Exit codes: 0 done; 1 the run failed, what was computed so far is kept; \
    2 the input is wrong, nothing is written; 130 interrupted by Ctrl-C, the files are valid to that time."
)]
struct Cli {
    /// Print errors only
    #[arg(long, short, global = true)]
    quiet: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run a scene: numbers, tables, figures and an animated report in one folder
    Run {
        #[command(flatten)]
        scene: SceneArguments,
        /// Folder for the results [default: out/<name of the scene>]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Also run the full model on the same mesh (esdirk3, small steps), and report the difference
        #[arg(long)]
        verify: bool,
        /// Replace other results in the folder
        #[arg(long)]
        force: bool,
        /// Print only the content of summary.json
        #[arg(long)]
        json: bool,
    },
    /// Compare finished runs: keys and results that differ, overlaid figures and films on one page
    Compare(compare::CompareArguments),
    /// Run a scene for all combinations of parameters, on all cores: one table, figures and a report; an interrupted sweep resumes
    Sweep(sweep::SweepArguments),
    /// Find the stiffness or other parameters that the table [design] of a scene asks for: figures, numbers, and the designed scene
    #[cfg(feature = "design")]
    Design {
        #[command(flatten)]
        scene: SceneArguments,
        /// Folder for the results [default: out/<name of the scene>-design]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Replace other results in the folder
        #[arg(long)]
        force: bool,
    },
    /// Check a scene: what it will compute, its dimensionless numbers, and where it leaves the range of validity of the models
    Check {
        #[command(flatten)]
        scene: SceneArguments,
        /// Print it as JSON
        #[arg(long)]
        json: bool,
    },
    /// Study a scene: its natural modes, and how speed, accuracy and stability depend on method, step and mesh
    #[command(subcommand)]
    Study(study::StudyCommand),
    /// Package a scene as an FMU, a component for co-simulation hosts (FMI standard)
    Fmu {
        #[command(flatten)]
        scene: SceneArguments,
        /// The file to write [default: <name of the scene>.fmu]
        #[arg(long, short, value_name = "FILE")]
        out: Option<PathBuf>,
        /// Version of the standard; both writes FILE-fmi2.fmu and FILE-fmi3.fmu
        #[arg(long, value_enum, default_value = "3")]
        fmi: fmu::Version,
        /// A shared library to include, one for each platform [default: the one next to this program, in ../lib, or in the Python package]
        #[arg(long, value_name = "FILE")]
        library: Vec<PathBuf>,
        /// The variables and parameters to expose [default: all]
        #[arg(long, value_name = "NAMES", value_delimiter = ',')]
        variables: Option<Vec<String>>,
        /// The nodes to expose, if every entry of an array is a separate variable [default: all]
        #[arg(long, value_name = "NODES", value_delimiter = ',')]
        nodes: Option<Vec<usize>>,
        /// FMI 3.0 without arrays and structural parameters, for hosts that do not support them
        #[arg(long)]
        plain: bool,
    },
    /// List the variables that a host can get and set: all, or those of a scene with their sizes
    Variables {
        /// The scene [default: list all variables]
        scene: Option<PathBuf>,
    },
    /// Write a commented scene to start from; asks for what is not given
    New(new::NewArguments),
    /// Export a run to other programs: VTK for ParaView, figures as PNG or PDF, films as GIF or MP4
    Export(export::ExportArguments),
    /// Print the JSON Schema of scenes, with which editors complete and check them
    Schema {
        /// The schema of sweeps
        #[arg(long)]
        sweep: bool,
    },
    /// Print completions of this command for a shell
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Write man pages of this command
    Man {
        /// Folder for the pages
        folder: PathBuf,
    },
}

#[derive(Debug, Clone, Args)]
struct SceneArguments {
    /// The scene, a TOML file
    scene: PathBuf,
    /// Override a key of the scene, for example --set rod.nodes=17
    #[arg(long, value_name = "TABLE.KEY=VALUE")]
    set: Vec<String>,
}

impl SceneArguments {
    fn read(&self) -> Result<(Document, Scene)> {
        let mut document = Document::read(&self.scene)?;
        for assignment in &self.set {
            document.set_as("--set ", assignment)?;
        }
        let scene = document.scene()?;
        Ok((document, scene))
    }

    /// The scene, and the stepper at its start.
    fn prepare(&self) -> Result<(Document, Scene, Stepper)> {
        let (document, scene) = self.read()?;
        let stepper = document.stepper(&scene)?;
        Ok((document, scene, stepper))
    }
}

/// The default folder of a run's results.
fn output_folder(scene: &Scene) -> PathBuf {
    PathBuf::from("out").join(&scene.name)
}

/// Prints which files were written and which could not be; returns the exit code.
fn print_kept(kept: &WrittenFiles, folder: &Path) -> ExitCode {
    print_written(kept, folder, "report.html")
}

/// Like [`print_kept`], with the file to `open`.
fn print_written(kept: &WrittenFiles, folder: &Path, open: &str) -> ExitCode {
    if kept.lost.is_empty() {
        let count = kept.files.len();
        let files = if count == 1 { "file" } else { "files" };
        print_unless_quiet(&format!("{count} {files} in {}: open {open}", folder.display()));
        return ExitCode::SUCCESS;
    }
    // The first error gives the reason, which is the same for the others.
    kept.lost.iter().take(1).for_each(|error| print_error(&error.to_string()));
    let names = |paths: &mut dyn Iterator<Item = &PathBuf>| -> String {
        let names = paths.filter_map(|path| path.file_name()).map(|name| name.to_string_lossy());
        names.collect::<Vec<_>>().join(", ")
    };
    let lost = names(&mut kept.lost.iter().filter_map(Error::path));
    print_error(&format!("not written: {lost}; kept in {}: {}", folder.display(), names(&mut kept.files.iter())));
    ExitCode::from(exit::FAILED)
}

pub fn main() -> ExitCode {
    let Cli { quiet, command } = Cli::parse();
    set_quiet(quiet);
    let outcome = match command {
        Command::Run { scene, out, verify, force, json } => run::run(&scene, out, verify, force, json),
        Command::Compare(arguments) => compare::compare(&arguments),
        Command::Sweep(arguments) => sweep::sweep(&arguments),
        #[cfg(feature = "design")]
        Command::Design { scene, out, force } => design::design(&scene, out, force),
        Command::Check { scene, json } => check::check(&scene, json),
        Command::Study(study) => study::study(&study),
        Command::Fmu { scene, out, fmi, library, variables, nodes, plain } => {
            fmu::fmu(&scene, out, fmi, library, FmuOptions { variables, nodes, plain })
        }
        Command::Variables { scene } => variables::variables(scene.as_deref()),
        Command::New(arguments) => new::new(&arguments),
        Command::Export(arguments) => export::export(&arguments),
        Command::Schema { sweep } => shell::schema(sweep),
        Command::Completions { shell } => Ok(shell::completions(shell)),
        Command::Man { folder } => shell::man(&folder),
    };
    let code = outcome.unwrap_or_else(|error| {
        print_error(&error.to_string());
        ExitCode::from(match error {
            Error::Interrupted => exit::INTERRUPTED,
            error if error.is_bad_input() => exit::WRONG_INPUT,
            _ => exit::FAILED,
        })
    });
    match LOST_OUTPUT.get() {
        None => code,
        Some(reason) => {
            print_error(&format!("the standard output: cannot be written: {reason}"));
            if code == ExitCode::SUCCESS { ExitCode::from(exit::FAILED) } else { code }
        }
    }
}

/// True if only errors are printed.
static QUIET: AtomicBool = AtomicBool::new(false);

/// Sets whether only errors are printed from now on.
fn set_quiet(is: bool) {
    QUIET.fetch_or(is, Ordering::Relaxed);
}

fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Prints a line to standard output, unless only errors are printed.
fn print_unless_quiet(line: &str) {
    if !is_quiet() {
        print(line);
    }
}

/// The reason why a line of output was lost, if any.
static LOST_OUTPUT: OnceLock<String> = OnceLock::new();

/// Prints a line of output. A closed pipe is not an error; other errors are reported at the end, so that the work continues.
fn print(line: &str) {
    let mut output = std::io::stdout();
    match progress::suspended(|| writeln!(output, "{line}").and_then(|()| output.flush())) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => drop(LOST_OUTPUT.set(error.to_string())),
        _ => {}
    }
}

/// Prints an error, or several, one per line.
fn print_error(text: &str) {
    progress::suspended(|| {
        for line in text.lines() {
            let _ = writeln!(std::io::stderr(), "error: {line}");
        }
    });
}

/// Prints an error and returns the exit code of wrong input.
fn refuse(error: &Error) -> ExitCode {
    print_error(&error.to_string());
    ExitCode::from(exit::WRONG_INPUT)
}
