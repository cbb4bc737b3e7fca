//! `[head]`: who holds the head, and where.

use std::path::PathBuf;

use serde::Deserialize;

use super::document::Fault;
use super::value::{ScalarSignal, VectorSignal, Wanted};
use super::{Scene, table};
use crate::error::Result;
use crate::head::{HeadInput, HeadMotion, Signal};

/// `[head]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct HeadTable {
    /// Kind of head.
    #[serde(default)]
    pub kind: HeadKind,
    /// Position of a driven head, m.
    pub position_m: Option<VectorSignal>,
    /// Angle of a driven head from +x, rad.
    pub angle_rad: Option<ScalarSignal>,
    /// What a host's pose of a held head is the pose of; absent: the time at which it is given.
    pub input: Option<HeadInput>,
}

/// Kinds of head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum HeadKind {
    /// Nothing holds it.
    #[default]
    Free,
    /// Held at the origin, along +x.
    Clamped,
    /// Held where the scene or a host says.
    Driven,
}

impl HeadTable {
    pub(super) fn check(&self) -> std::result::Result<(), Fault> {
        if self.input.is_some() && self.kind == HeadKind::Free {
            let problem = "found with a free head; allowed: only with a held one".into();
            return Err(Fault { key: "head.input".into(), problem });
        }
        let found = [("head.position_m", self.position_m.is_some()), ("head.angle_rad", self.angle_rad.is_some())];
        match found.into_iter().find(|(_, found)| *found && self.kind != HeadKind::Driven) {
            Some((key, _)) => {
                let problem = "found without kind = \"driven\"; allowed: only with it".into();
                Err(Fault { key: key.into(), problem })
            }
            None => Ok(()),
        }
    }
}

impl Scene {
    pub(super) fn head_motion(&self) -> Result<Option<HeadMotion>> {
        let still = Signal::Constant(0.0);
        match self.head.kind {
            HeadKind::Free => Ok(None),
            HeadKind::Clamped => Ok(Some([still.clone(), still.clone(), still])),
            HeadKind::Driven => {
                let [x, y] = match &self.head.position_m {
                    Some(position) => self.vector_signal(position)?,
                    None => [still.clone(), still.clone()],
                };
                let angle = match &self.head.angle_rad {
                    Some(ScalarSignal(angle)) => self.signal(angle, 0, 1)?,
                    None => still,
                };
                Ok(Some([x, y, angle]))
            }
        }
    }

    /// The signals x and y; from one table that is named for both it takes both.
    pub(super) fn vector_signal(&self, VectorSignal([x, y]): &VectorSignal) -> Result<[Signal; 2]> {
        let columns = if matches!((x, y), (Wanted::Table(a), Wanted::Table(b)) if a == b) { 2 } else { 1 };
        Ok([self.signal(x, 0, columns)?, self.signal(y, columns - 1, columns)?])
    }

    /// A signal; from a table it takes value `column` of `columns`.
    fn signal(&self, wanted: &Wanted, column: usize, columns: usize) -> Result<Signal> {
        Ok(match wanted {
            Wanted::Formula(signal) => signal.clone(),
            Wanted::Table(file) => {
                table::read(&self.read_from, &self.table_path(file), column, columns, self.solver.duration_s.get())?
            }
        })
    }

    /// The tables that it names, each once, in the order of their keys.
    pub fn tables(&self) -> Vec<&str> {
        let position = self.head.position_m.iter().flat_map(|VectorSignal(signals)| signals);
        let angle = self.head.angle_rad.iter().map(|ScalarSignal(signal)| signal);
        let flow = self.medium.iter().flat_map(|medium| &medium.flow_m_s.0);
        let mut tables: Vec<&str> = Vec::new();
        for wanted in position.chain(angle).chain(flow) {
            if let Wanted::Table(file) = wanted
                && !tables.contains(&file.as_str())
            {
                tables.push(file);
            }
        }
        tables
    }

    /// Where a table that it names is.
    pub fn table_path(&self, file: &str) -> PathBuf {
        self.folder.join(file)
    }

    /// The files beside it that it reads.
    pub fn files(&self) -> Vec<PathBuf> {
        self.tables().into_iter().map(|table| self.table_path(table)).collect()
    }
}
