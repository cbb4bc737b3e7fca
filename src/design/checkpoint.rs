//! What a search has simulated, on disk until its design is complete. A search is the same to the bit each time, so one that was
//! ended goes on by going the same way again: what it has simulated before it reads instead.

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

/// Its file in the folder of a design.
pub(super) const JOURNAL: &str = "design.journal";

/// Files that every design has.
pub(super) const RESULT_FILES: [&str; 2] = ["design.json", "report.html"];

/// A result, and what it is of.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct CachedResult<T> {
    of: String,
    /// None where a simulation failed.
    value: Option<T>,
}

/// A result of any kind, and what it is of.
pub(super) type AnyResult = CachedResult<Value>;

/// What was simulated before.
#[derive(Debug, Default)]
pub(super) struct Checkpoint {
    journal: Option<Journal>,
    lines: HashMap<String, usize>,
    next: usize,
    /// What is simulated, for another program.
    recorded: Option<Vec<AnyResult>>,
    /// The folder, which does not stay where nothing was written to it.
    _folder: Option<Folder>,
}

impl Checkpoint {
    /// That of the design of `scene` in `folder`; what another one left there is forgotten. Without room for it there is none.
    ///
    /// # Errors
    /// [`Error::Busy`] where another program is at work on it, [`Error::Occupied`]; [`Error::Read`] for the files that the design names.
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
            let _ = std::fs::remove_file(&path); // else it is refused
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

    /// One for another program.
    pub fn recorded() -> Self {
        Self { recorded: Some(Vec::new()), ..Self::default() }
    }

    /// What was simulated.
    pub fn record(&self) -> &[AnyResult] {
        self.recorded.as_deref().unwrap_or_default()
    }

    /// Names all that the search from a start simulates.
    pub fn start(start: usize) -> String {
        format!("start {start}")
    }

    /// True where the result of what `asked` names is there.
    pub fn has(&self, asked: &str) -> bool {
        self.lines.contains_key(&jobs::hash(asked.as_bytes()))
    }

    /// Keeps all that a part which `asked` names simulated; false where it is there already.
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

    /// Keeps a result; on a full disk no more is kept.
    fn keep<T: Serialize>(&mut self, known: CachedResult<T>) -> Option<T> {
        match self.journal.as_mut().map(|journal| journal.add(self.next, &known)) {
            Some(Ok(())) => drop(self.lines.insert(known.of, self.next)),
            _ => self.journal = None,
        }
        self.next += 1;
        known.value
    }

    /// The result of what `asked` names: the one of before, or what `make` makes, which is kept. On a full disk no more is kept.
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
