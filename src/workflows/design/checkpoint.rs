//! Checkpoint of a design: the results of its simulations, on disk until the design is complete. A search is deterministic, so an
//! interrupted one repeats its path with stored results in place of simulations.

use std::collections::HashMap;
use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::table::DesignTable;
use crate::error::{Error, Result};
use crate::jobs::{self, Job, Journal};
use crate::report::{Claim, Folder, Owner};
use crate::scene::Scene;

/// Name of the journal in a design's folder.
pub(super) const JOURNAL: &str = "design.journal";

/// Files that every design writes.
pub(super) const RESULT_FILES: [&str; 2] = ["design.json", "report.html"];

/// A stored result and the hash of its key.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct CachedResult<T> {
    of: String,
    /// `None` if a simulation failed.
    value: Option<T>,
}

/// A stored result of any type.
pub(super) type AnyResult = CachedResult<Value>;

/// The stored results of a design.
#[derive(Debug, Default)]
pub(super) struct Checkpoint {
    journal: Option<Journal>,
    lines: HashMap<String, usize>,
    next: usize,
    /// On a worker: the results that it will return.
    recorded: Option<Vec<AnyResult>>,
    /// The claimed folder; it is removed when it is dropped empty.
    _folder: Option<Folder>,
}

impl Checkpoint {
    /// Opens the checkpoint of the design of `scene` in `folder`. Results of another design are deleted. Without disk space nothing
    /// is stored.
    ///
    /// # Errors
    /// [`Error::Busy`] if another program uses it, [`Error::Occupied`]; [`Error::Read`] for the files that the design names.
    pub fn open(folder: &Path, scene: &Scene, table: &DesignTable) -> Result<Self> {
        let mut inputs = scene.fingerprint_text().into_bytes();
        for file in [&table.data, &table.over].into_iter().flatten() {
            inputs.extend(scene.read_from.read(&scene.folder.join(file))?);
        }
        let job = Job::new(&format!("design {}", scene.name), &inputs, 0);
        let claimed = Folder::claim(folder, Owner::of("design", scene), Claim::Own, &RESULT_FILES);
        let (claimed, path) = match claimed.and_then(|mut claimed| claimed.journal(JOURNAL).map(|path| (claimed, path)))
        {
            Ok(held) => held,
            Err(Error::Write { .. }) => return Ok(Self::default()),
            Err(error) => return Err(error),
        };
        if Journal::read(&path).is_ok_and(|journal| !journal.is_held() && job.difference(journal.job()).is_some()) {
            let _ = std::fs::remove_file(&path); // otherwise opening it would fail
        }
        let journal = match Journal::open(&path, &job) {
            Ok(journal) => journal,
            Err(error @ Error::Journal { .. }) => return Err(error),
            Err(_) => return Ok(Self::default()),
        };
        let mut lines = HashMap::new();
        for index in journal.indices() {
            if let Ok(Some(known)) = journal.get::<CachedResult<serde::de::IgnoredAny>>(index) {
                lines.insert(known.of, index);
            }
        }
        let next = journal.indices().last().map_or(0, |last| last + 1);
        Ok(Self { journal: Some(journal), lines, next, recorded: None, _folder: Some(claimed) })
    }

    /// A checkpoint that records all results, for a worker.
    pub fn recorded() -> Self {
        Self { recorded: Some(Vec::new()), ..Self::default() }
    }

    /// The recorded results.
    pub fn record(&self) -> &[AnyResult] {
        self.recorded.as_deref().unwrap_or_default()
    }

    /// The key of all simulations of a start.
    pub fn start(start: usize) -> String {
        format!("start {start}")
    }

    /// True if the result for the key `asked` is stored.
    pub fn has(&self, asked: &str) -> bool {
        self.lines.contains_key(&jobs::hash(asked.as_bytes()))
    }

    /// Stores the results of the part with the key `asked`; false if they were stored before.
    pub fn store_part(&mut self, asked: &str, simulated: Vec<AnyResult>) -> bool {
        let new = !self.has(asked);
        let end = CachedResult { of: jobs::hash(asked.as_bytes()), value: Some(Value::Bool(true)) };
        for known in simulated.into_iter().chain([end]) {
            if !self.lines.contains_key(&known.of) {
                self.keep(known);
            }
        }
        new
    }

    /// Stores a result. Once the disk is full, nothing more is stored.
    fn keep<T: Serialize>(&mut self, known: CachedResult<T>) -> Option<T> {
        match self.journal.as_mut().map(|journal| journal.add(self.next, &known)) {
            Some(Ok(())) => drop(self.lines.insert(known.of, self.next)),
            _ => self.journal = None,
        }
        self.next += 1;
        known.value
    }

    /// The stored result for the key `asked`; if there is none, the result of `make`, which is then stored.
    pub fn get_or_compute<T: Serialize + DeserializeOwned>(
        &mut self,
        asked: impl FnOnce() -> String,
        make: impl FnOnce() -> Option<T>,
    ) -> Option<T> {
        if let Some(recorded) = &mut self.recorded {
            let value = make();
            let told = value.as_ref().map(serde_json::to_value).transpose().ok()?;
            recorded.push(CachedResult { of: jobs::hash(asked().as_bytes()), value: told });
            return value;
        }
        let Some(journal) = &mut self.journal else { return make() };
        let of = jobs::hash(asked().as_bytes());
        let known = self.lines.get(&of).and_then(|index| journal.get::<CachedResult<T>>(*index).ok().flatten());
        if let Some(known) = known {
            return known.value;
        }
        self.keep(CachedResult { of, value: make() })
    }
}
