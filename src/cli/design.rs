//! `caudal design`: solves the design problem of a scene and writes its results.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use caudal::design::{Answer, Design, SearchIteration};
use caudal::error::Result;
use caudal::report::Claim;

use super::progress::{Progress, Unit};
use super::run::watch_for_interrupts;
use super::{SceneArguments, exit, print_error, print_kept, print_unless_quiet, refuse};

pub fn design(arguments: &SceneArguments, out: Option<PathBuf>, force: bool) -> Result<ExitCode> {
    let (document, scene) = arguments.read()?;
    let folder = out.unwrap_or_else(|| Design::folder(&scene));
    if let Err(error) = Design::claim(&scene, &folder, Claim::forced(force)) {
        return Ok(refuse(&error));
    }
    let interrupted = watch_for_interrupts();
    let most = Design::max_iterations(&scene);
    let progress = match most {
        Some(most) => Progress::of(Unit::AtMost("iterations"), most as f64),
        None => Progress::of(Unit::Parts, 0.0),
    };
    progress.note(if most.is_some() { "" } else { "designing" });
    let mut done = 0;
    let design = Design::resumed(&document, &folder, |iteration| {
        done += usize::from(iteration.is_some());
        progress.set(done as f64);
        if let Some(SearchIteration { start, iteration, objective, stationarity, step, accepted }) = iteration {
            print_unless_quiet(&format!(
                "start {} iteration {iteration:>2}  objective {objective:.6e}  stationarity {stationarity:.1e}  step {step:.1e}{}",
                start + 1,
                if *accepted { "" } else { "  rejected" }
            ));
        }
        if interrupted.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    drop(progress);
    for line in &design.lines {
        print_unless_quiet(line);
    }
    let whole = print_kept(&design.write(&folder)?, &folder);
    Ok(match &design.answer {
        Answer::Search(found) if found.interrupted => {
            print_error("interrupted: the files hold the best design so far");
            ExitCode::from(exit::INTERRUPTED)
        }
        Answer::Search(found) if !found.converged => {
            print_error(&format!("the search did not converge: the files hold its best design; {}", design.advice()));
            ExitCode::from(exit::FAILED)
        }
        _ => whole,
    })
}
