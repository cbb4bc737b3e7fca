//! `[head]`: how the head is held, and the signals that drive it.

use std::path::PathBuf;

use serde::Deserialize;

use super::key_error::KeyError;
use super::value::{ScalarSignal, SignalValue, VectorSignal};
use super::{Scene, csv_table};
use crate::error::Result;
use crate::head::{HeadInput, HeadMotion, Signal};

/// `[head]`.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct HeadTable {
    /// How the head is held. By default `free`.
    #[serde(default)]
    pub kind: HeadKind,
    /// Position of a driven head, m.
    pub position_m: Option<VectorSignal>,
    /// Angle of a driven head from +x, rad.
    pub angle_rad: Option<ScalarSignal>,
    /// The time that a pose set by a host belongs to. By default `now`.
    pub input: Option<HeadInput>,
}

/// Kinds of head.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum HeadKind {
    /// Free: no force or moment at the head.
    #[default]
    Free,
    /// Clamped at the origin, along +x.
    Clamped,
    /// Held in a pose that the scene or a host prescribes over time.
    Driven,
}

impl HeadTable {
    pub(super) fn check(&self) -> std::result::Result<(), KeyError> {
        if self.input.is_some() && self.kind == HeadKind::Free {
            let problem = "found with a free head; allowed: only with a held one".into();
            return Err(KeyError { key: "head.input".into(), problem });
        }
        let found = [("head.position_m", self.position_m.is_some()), ("head.angle_rad", self.angle_rad.is_some())];
        match found.into_iter().find(|(_, found)| *found && self.kind != HeadKind::Driven) {
            Some((key, _)) => {
                let problem = "found without kind = \"driven\"; allowed: only with it".into();
                Err(KeyError { key: key.into(), problem })
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

    /// The signals x and y. A single table contains both.
    pub(super) fn vector_signal(&self, VectorSignal([x, y]): &VectorSignal) -> Result<[Signal; 2]> {
        let columns = if matches!((x, y), (SignalValue::Table(a), SignalValue::Table(b)) if a == b) { 2 } else { 1 };
        Ok([self.signal(x, 0, columns)?, self.signal(y, columns - 1, columns)?])
    }

    /// A signal, or value `column` of `columns` of a table.
    pub(super) fn signal(&self, wanted: &SignalValue, column: usize, columns: usize) -> Result<Signal> {
        Ok(match wanted {
            SignalValue::Formula(signal) => signal.clone(),
            SignalValue::Table(file) => {
                csv_table::read(&self.read_from, &self.table_path(file), column, columns, self.solver.duration_s.get())?
            }
        })
    }

    /// The names of its tables, without repetition, in the order of their keys.
    pub fn tables(&self) -> Vec<&str> {
        let position = self.head.position_m.iter().flat_map(|VectorSignal(signals)| signals);
        let angle = self.head.angle_rad.iter().map(|ScalarSignal(signal)| signal);
        let flow = self.medium.iter().flat_map(|medium| &medium.flow_m_s.0);
        let mut tables: Vec<&str> = Vec::new();
        for wanted in position.chain(angle).chain(flow).chain(self.tendon_signals()) {
            if let SignalValue::Table(file) = wanted
                && !tables.contains(&file.as_str())
            {
                tables.push(file);
            }
        }
        tables
    }

    /// The path of one of its tables.
    pub fn table_path(&self, file: &str) -> PathBuf {
        self.folder.join(file)
    }

    /// The paths of its tables.
    pub fn files(&self) -> Vec<PathBuf> {
        self.tables().into_iter().map(|table| self.table_path(table)).collect()
    }
}
