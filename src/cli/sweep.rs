//! `caudal sweep`: runs, resumes, shards and merges sweeps.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use caudal::error::{Error, Result};
use caudal::jobs::{Journal, Shard, cores};
use caudal::report::{Claim, Folder, JOURNAL};
use caudal::sweep::{RecentResults, Sweep, SweepResults, WrittenSweep, run as run_sweep};
use clap::{Args, Subcommand};

use super::progress::{Progress, Unit};
use super::run::watch_for_interrupts;
use super::{exit, print_error, print_kept, print_unless_quiet, refuse};

#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct SweepArguments {
    #[command(subcommand)]
    merge: Option<SweepAction>,
    #[command(flatten)]
    sweep: Option<SweepSource>,
    /// Threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = thread_count)]
    jobs: Option<NonZeroUsize>,
    /// Run only one of n equal parts of the cases, such as 1/8; `caudal sweep merge` combines the parts
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Discard the earlier results of this sweep in the folder and start again
    #[arg(long)]
    restart: bool,
    /// List and check the cases, run none
    #[arg(long)]
    dry_run: bool,
}

/// A number of threads.
fn thread_count(text: &str) -> std::result::Result<NonZeroUsize, String> {
    text.parse().map_err(|_| "allowed: a whole number, 1 or more".to_string())
}

#[derive(Debug, Subcommand)]
enum SweepAction {
    /// Write one table and report from the journals of all shards
    Merge {
        #[command(flatten)]
        sweep: SweepSource,
        /// Journals, or folders with journals [default: the folder of the results]
        journals: Vec<PathBuf>,
        /// Write them for the cases finished so far, also while the sweep runs
        #[arg(long)]
        partial: bool,
    },
}

#[derive(Debug, Args)]
struct SweepSource {
    /// The sweep, a TOML file with a base scene and axes
    sweep: PathBuf,
    /// Override a key of the base scene, for example --set start.kind=shaped
    #[arg(long, value_name = "TABLE.KEY=VALUE")]
    set: Vec<String>,
    /// Folder for the results [default: out/<name of the sweep>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace other results in the folder
    #[arg(long)]
    force: bool,
}

impl SweepSource {
    fn read(&self) -> Result<(Sweep, PathBuf)> {
        let sweep = Sweep::read(&self.sweep, &self.set)?;
        let folder = self.out.clone().unwrap_or_else(|| sweep.folder());
        Ok((sweep, folder))
    }
}

pub fn sweep(arguments: &SweepArguments) -> Result<ExitCode> {
    match (&arguments.merge, &arguments.sweep) {
        (Some(SweepAction::Merge { sweep, journals, partial }), _) => merge(sweep, journals, *partial),
        (None, Some(common)) if arguments.dry_run => list(common, arguments),
        (None, Some(common)) => run(common, arguments),
        (None, None) => Ok(ExitCode::from(exit::WRONG_INPUT)), // clap asks for the sweep
    }
}

/// The cases that `arguments` select.
fn wanted(sweep: &Sweep, arguments: &SweepArguments) -> Vec<usize> {
    match arguments.shard {
        Some(shard) => shard.indices(sweep.size()),
        None => (0..sweep.size()).collect(),
    }
}

fn list(common: &SweepSource, arguments: &SweepArguments) -> Result<ExitCode> {
    let (sweep, folder) = common.read()?;
    let job = sweep.job(threads(arguments))?;
    let cases = wanted(&sweep, arguments);
    for index in &cases {
        print_unless_quiet(&format!("{index:>6}  {}", sweep.describe(&sweep.case(*index)?)));
    }
    print_unless_quiet(&format!(
        "{}: {} of {} cases, inputs {}, to {}",
        sweep.name,
        cases.len(),
        job.size,
        job.hash,
        folder.display()
    ));
    Ok(ExitCode::SUCCESS)
}

fn threads(arguments: &SweepArguments) -> usize {
    arguments.jobs.map_or_else(cores, usize::from)
}

fn run(common: &SweepSource, arguments: &SweepArguments) -> Result<ExitCode> {
    let (sweep, folder) = common.read()?;
    let job = sweep.job(threads(arguments))?;
    let mut cases = wanted(&sweep, arguments);
    let name =
        arguments.shard.map_or_else(|| "cases".to_string(), |Shard { number, of }| format!("shard-{number}-of-{of}"));
    let name = format!("{name}{JOURNAL}");
    // Only the remaining cases need disk space.
    let path = folder.join(&name);
    let left = || {
        let done = Journal::read(&path).ok();
        let done = done.filter(|journal| !arguments.restart && job.difference(journal.job()).is_none());
        cases.iter().filter(|index| !done.as_ref().is_some_and(|journal| journal.has(**index))).count()
    };
    let fits = sweep.fits(cases.len(), &folder).or_else(|_| sweep.fits(left(), &folder));
    let held = fits.and_then(|()| sweep.claim(&folder, &job, Claim::forced(common.force)));
    let mut held = match held {
        Ok(held) => held,
        Err(error) => return Ok(refuse(&error)),
    };
    if arguments.restart {
        held.begin_anew(arguments.shard.is_some().then_some(&name))?;
    }
    let mut journal = sweep.journal(&mut held, &name, &job)?;
    held.let_others(); // at other shards; no other owner gets the folder while it contains journals
    let all = cases.len();
    cases.retain(|index| !journal.has(*index));
    if cases.len() < all {
        print_unless_quiet(&format!("{} of {all} cases are done already; {} to go", all - cases.len(), cases.len()));
    }

    let interrupted = watch_for_interrupts();
    let progress = Progress::of(Unit::Exactly("cases"), 0.0);
    let before = all - cases.len();
    progress.set_of(before as f64, all as f64);
    let (mut done, mut failures, mut fresh) = (0, 0, RecentResults::default());
    let outcome = run_sweep(&sweep, &mut journal, &cases, threads(arguments), &interrupted, |index, row| {
        if !row.complete() {
            failures += 1;
            progress.note(format!("{failures} failed"));
        }
        done += 1;
        progress.set((before + done) as f64);
        fresh.keep(index, row);
    });
    let elapsed = progress.elapsed();
    drop(progress);
    outcome?;
    if interrupted.load(Ordering::Relaxed) && done < cases.len() {
        print_error(&format!(
            "interrupted: {} of {all} cases are finished and stored in {}; the same command resumes",
            before + done,
            path.display()
        ));
        return Ok(ExitCode::from(exit::INTERRUPTED));
    }
    print_unless_quiet(&format!("{}: {done} cases in {:.2} s", sweep.name, elapsed.as_secs_f64()));
    if arguments.shard.is_some() {
        print_unless_quiet(&format!(
            "{}: when all shards are complete, `caudal sweep merge` writes the table and the report",
            path.display()
        ));
        return Ok(ExitCode::SUCCESS);
    }
    held.relock()?;
    finish(&SweepResults::new(&sweep, &job, vec![journal])?.with(fresh), &mut held)
}

/// Writes table, figures and report, and reports failed cases.
fn finish(results: &SweepResults<'_>, folder: &mut Folder) -> Result<ExitCode> {
    let WrittenSweep { kept, failed, unsettled } = results.write(folder)?;
    for (index, ending) in failed.iter().take(3) {
        print_error(&format!("case {index}: {ending}"));
    }
    if !failed.is_empty() {
        print_error(&format!("{} cases failed; their rows in table.csv give the reasons", failed.len()));
    }
    if unsettled > 0 {
        let (cases, are) = if unsettled == 1 { ("case", "is") } else { ("cases", "are") };
        print_unless_quiet(&format!(
            "note: {unsettled} {cases} {are} not periodic yet (cycles_periodic of table.csv): their means over cycles may change with a longer \
             solver.duration_s"
        ));
    }
    let whole = print_kept(&kept, folder.path());
    Ok(if failed.is_empty() { whole } else { ExitCode::from(exit::FAILED) })
}

fn merge(common: &SweepSource, from: &[PathBuf], partial: bool) -> Result<ExitCode> {
    let (sweep, folder) = common.read()?;
    let job = sweep.job(cores())?;
    let from = if from.is_empty() { std::slice::from_ref(&folder) } else { from };
    let mut paths = Vec::new();
    for place in from {
        if !place.is_dir() {
            paths.push(place.clone());
            continue;
        }
        let failed = |e: std::io::Error| Error::Read { path: place.clone(), reason: e.to_string() };
        for entry in std::fs::read_dir(place).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            if path.to_string_lossy().ends_with(JOURNAL) {
                paths.push(path);
            }
        }
    }
    paths.sort();
    // A journal that was only created has no results yet.
    let journals: Vec<Journal> =
        paths.iter().filter_map(|path| Journal::read_begun(path).transpose()).collect::<Result<_>>()?;
    let claimed = || sweep.claim(&folder, &job, Claim::forced(common.force));
    let results = SweepResults::new(&sweep, &job, journals)?;
    let missing: Vec<usize> = results.missing().collect();
    if let Some(first) = missing.first() {
        let lacking = format!(
            "{} of {} cases are missing from the {} journals, the first is case {first}",
            missing.len(),
            sweep.size(),
            paths.len()
        );
        if partial {
            print_unless_quiet(&lacking);
            return finish(&results, &mut claimed()?);
        }
        print_error(&format!(
            "{lacking}; wait for their shards to finish, or merge the available cases with --partial"
        ));
        return Ok(ExitCode::from(exit::WRONG_INPUT));
    }
    finish(&results, &mut claimed()?)
}
