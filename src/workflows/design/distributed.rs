//! Distributed designs: workers run the searches from several starts, then the robustness checks. They return the results of their
//! simulations, with which the design is evaluated without further simulations.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::checkpoint::{AnyResult, Checkpoint, JOURNAL};
use super::design_vector::DesignVector;
use super::designed_scene::with_fixed_fluid;
use super::objective::objective_of;
use super::robustness::RobustnessChecks;
use super::scenarios::scenarios;
use super::search::{Search, SearchIteration};
use super::table::DesignTable;
use crate::distributed::{Bundle, DistributableJob};
use crate::error::{Error, Result};
use crate::jobs;
use crate::scene::Document;
use crate::sweep::Sweep;

/// The next parts of a design, and their results so far.
#[derive(Debug)]
pub struct DistributedDesign {
    document: Document,
    table: DesignTable,
    checkpoint: Checkpoint,
    /// Path of the journal.
    journal: PathBuf,
    task: Task,
    /// Description and key of each part.
    parts: Vec<(String, String)>,
}

/// The kind of the next parts.
#[derive(Debug, Clone, Serialize, Deserialize)]
enum Task {
    /// Searches from the starts.
    Starts,
    /// Checks of this design.
    RobustnessChecks(DesignVector),
}

impl DistributedDesign {
    /// The next parts of the design of `document`, with results in `folder`: first the searches from several starts, then the
    /// checks of the best result. `tell` is called after each iteration. `None` if no part is left, or if the search was stopped.
    ///
    /// # Errors
    /// Those of [`Design::resumed`](super::Design::resumed).
    pub fn next(
        document: &Document,
        folder: &Path,
        tell: impl FnMut(Option<&SearchIteration>) -> ControlFlow<()>,
    ) -> Result<Option<Self>> {
        let scene = document.scene()?;
        let table = DesignTable::of(&scene).map_err(|fault| document.error_at(&fault))?;
        if !table.is_searched() || table.fits_positions() {
            return Ok(None);
        }
        let (checkpoint, journal) = (Checkpoint::open(folder, &scene, &table)?, folder.join(JOURNAL));
        let count = table.start_count();
        if count > 1 && !(0..count).all(|start| checkpoint.has(&Checkpoint::start(start))) {
            let parts = (0..count).map(|start| (format!("of {count}"), Checkpoint::start(start))).collect();
            return Ok(Some(Self {
                document: document.clone(),
                table,
                checkpoint,
                journal,
                task: Task::Starts,
                parts,
            }));
        }
        let fixed = with_fixed_fluid(document, &scene);
        let (objective, problem) = objective_of(&fixed, &scene, &table, None)?;
        let mut search = Search::new(&table, &objective, problem);
        search.scenarios = scenarios(document, &scene, &table)?;
        search.checkpoint = checkpoint;
        let found = search.run(tell)?;
        if found.interrupted {
            return Ok(None);
        }
        let checks = RobustnessChecks::of((&fixed, &search.scenarios), &scene, &table, None, &found.profile);
        let parts: Vec<_> = (0..checks.count()).map(|check| (checks.describe(check), checks.asked(check))).collect();
        let checkpoint = std::mem::take(&mut search.checkpoint);
        if parts.iter().all(|(_, asked)| checkpoint.has(asked)) {
            return Ok(None);
        }
        let task = Task::RobustnessChecks(found.profile);
        Ok(Some(Self { document: document.clone(), table: table.clone(), checkpoint, journal, task, parts }))
    }

    /// The noun for a part.
    pub fn noun(&self) -> &'static str {
        match self.task {
            Task::Starts => "start",
            Task::RobustnessChecks(_) => "check",
        }
    }
}

impl DistributableJob for DistributedDesign {
    fn count(&self) -> usize {
        self.parts.len()
    }

    fn pending(&self) -> Vec<usize> {
        (0..self.count()).filter(|index| !self.checkpoint.has(&self.parts[*index].1)).collect()
    }

    fn describe(&self, index: usize) -> String {
        self.parts.get(index).map(|(words, _)| words.clone()).unwrap_or_default()
    }

    fn bundle(&self) -> Result<Vec<u8>> {
        let scene = self.document.scene()?;
        let mut files = Vec::new();
        if let Some(file) = &self.table.over {
            let file = scene.folder.join(file);
            let sweep = Sweep::over(&scene.read_from, &file, &[], Some(self.document.clone()))?;
            for index in 0..sweep.size() {
                files.extend(sweep.scene(&sweep.case(index)?)?.0.files());
            }
            files.push(file);
        }
        Bundle::of_scene(&self.document, files, &self.task)?.bytes()
    }

    fn store(&mut self, line: &[u8]) -> Result<bool> {
        let damaged = || Error::Bundle { problem: format!("a {} that a worker returned is damaged", self.noun()) };
        let (index, simulated) = jobs::read_line::<Vec<AnyResult>>(line).ok_or_else(damaged)?;
        let (_, asked) = self.parts.get(index).ok_or_else(damaged)?;
        let new = self.checkpoint.store_part(asked, simulated);
        if !self.checkpoint.has(asked) {
            let reason = "results cannot be stored; free some disk space".to_string();
            return Err(Error::Write { path: self.journal.clone(), reason });
        }
        Ok(new)
    }
}

/// Runs part `index` of the design in a [`Bundle`]; returns the results of its simulations as a line for
/// [`DistributableJob::store`].
///
/// # Errors
/// Those of [`Bundle::read`] and of [`Design::of`](super::Design::of).
pub fn simulate(bundle: &[u8], index: usize) -> Result<Vec<u8>> {
    let (asked, task) = Bundle::read(bundle)?.scene()?;
    let scene = asked.scene()?;
    let table = DesignTable::of(&scene).map_err(|fault| asked.error_at(&fault))?;
    let document = with_fixed_fluid(&asked, &scene);
    let refused = |what: &str| Error::Bundle { problem: format!("{what} {index}") };
    let mut checkpoint = Checkpoint::recorded();
    match task {
        Task::Starts => {
            let (objective, problem) = objective_of(&document, &scene, &table, None)?;
            let mut search = Search::new(&table, &objective, problem);
            search.scenarios = scenarios(&asked, &scene, &table)?;
            search.checkpoint = checkpoint;
            match search.run_start(index, |_| ControlFlow::Continue(())) {
                // The result is stored, even if no start of this design can be simulated.
                Ok(_) | Err(Error::Design { .. }) => {}
                Err(error) => return Err(error),
            }
            checkpoint = search.checkpoint;
        }
        Task::RobustnessChecks(profile) => {
            let scenarios = scenarios(&asked, &scene, &table)?;
            let checks = RobustnessChecks::of((&document, &scenarios), &scene, &table, None, &profile);
            if index >= checks.count() {
                return Err(refused("it has no check"));
            }
            checkpoint.get_or_compute(|| checks.asked(index), || checks.measure(index));
        }
    }
    jobs::line(index, checkpoint.record()).ok_or_else(|| refused("it cannot tell the result of part"))
}
