//! The starts of a design, each a search of its own, wherever they are run: what comes back is what they simulated, and the design
//! goes the same way again without simulating.

use std::ops::ControlFlow;
use std::path::Path;

use super::cases::cases;
use super::memory::{Memory, Simulated};
use super::report::{aim, pinned};
use super::search::Search;
use super::table::Table;
use crate::error::{Error, Result};
use crate::jobs;
use crate::parcel::Parts;
use crate::scene::{Document, Parcel};
use crate::sweep::Sweep;

/// The starts of a design, and what is known of them in its folder.
#[derive(Debug)]
pub struct Starts {
    document: Document,
    table: Table,
    memory: Memory,
}

impl Starts {
    /// Those of the design that `document` asks for, whose files go to `folder`.
    ///
    /// # Errors
    /// Those of [`Design::resumed`](super::Design::resumed) before its search.
    pub fn of(document: &Document, folder: &Path) -> Result<Self> {
        let scene = document.scene()?;
        let table = Table::of(&scene).map_err(|fault| document.refuse(&fault))?;
        let memory = Memory::open(folder, &scene, &table)?;
        Ok(Self { document: document.clone(), table, memory })
    }
}

impl Parts for Starts {
    fn count(&self) -> usize {
        self.table.all_starts()
    }

    /// Those of which nothing is known; none where there is but one, or positions are fitted.
    fn todo(&self) -> Vec<usize> {
        let many = self.table.is_searched() && !self.table.fits_positions() && self.count() > 1;
        (0..self.count()).filter(|start| many && !self.memory.has_start(*start)).collect()
    }

    fn describe(&self, index: usize) -> String {
        format!("the search from start {} of {}", index + 1, self.count())
    }

    fn parcel(&self) -> Result<Vec<u8>> {
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
        Parcel::of_scene(&self.document, files, ())?.bytes()
    }

    fn keep(&mut self, line: &[u8]) -> Result<bool> {
        let damaged = || Error::Parcel { problem: "a start that came back is damaged".to_string() };
        let (start, simulated) = jobs::read_line::<Vec<Simulated>>(line).ok_or_else(damaged)?;
        Ok(self.memory.keep_start(start, simulated))
    }
}

/// Searches from start `index` of the design that came as bytes; what it simulated, as a line for [`Starts::keep`].
///
/// # Errors
/// Those of [`Parcel::read`] and of [`Design::of`](super::Design::of).
pub fn start(parcel: &[u8], index: usize) -> Result<Vec<u8>> {
    let (asked, ()) = Parcel::read(parcel)?.scene()?;
    let scene = asked.scene()?;
    let table = Table::of(&scene).map_err(|fault| asked.refuse(&fault))?;
    let document = pinned(&asked, &scene, &table)?;
    let (objective, problem) = aim(&document, &scene, &table, None)?;
    let mut search = Search::new(&table, &objective, problem);
    search.cases = cases(&asked, &scene, &table)?;
    search.memory = Memory::recorded();
    match search.run_one(index, |_| ControlFlow::Continue(())) {
        // No start of this design can be simulated: that is known now.
        Ok(_) | Err(Error::Design { .. }) => {}
        Err(error) => return Err(error),
    }
    let line = jobs::line(index, search.memory.record());
    line.ok_or_else(|| Error::Parcel { problem: format!("start {index} cannot be told") })
}
