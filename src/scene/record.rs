//! `[record]`: the recorded times and nodes.

use serde::Deserialize;

use super::Scene;
use super::key_error::KeyError;
use super::value::{self, BoundedInteger, NotNegative, Positive};

/// `[record]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct RecordTable {
    /// Number of steps between recorded times. By default 1. The first and the last time are always recorded.
    pub every: Option<BoundedInteger<1, 1_000_000_000>>,
    /// Interval between recorded times, s, independent of the steps.
    pub interval_s: Option<Positive>,
    /// Variables in trajectory.csv in addition to those of every run, with a separate column for each entry of an array. `caudal
    /// variables` lists them.
    #[serde(default)]
    pub variables: Vec<String>,
    /// First time of the node table, s. By default 0.
    #[serde(default = "from_start")]
    pub nodes_from_s: NotNegative,
    /// Nodes of the node table; negative numbers count from the tip, −1. By default all.
    pub nodes: Option<Vec<i64>>,
    /// Format of the node table. By default `csv` up to 200 nodes and `none` beyond.
    pub nodes_table: Option<NodesTable>,
}

/// Formats of the table of node positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum NodesTable {
    /// nodes.csv: one row per time, two columns per node.
    Csv,
    /// nodes.parquet: one row per time and node.
    Parquet,
    /// No table.
    None,
}

impl Default for RecordTable {
    fn default() -> Self {
        Self {
            every: None,
            interval_s: None,
            variables: Vec::new(),
            nodes_from_s: from_start(),
            nodes: None,
            nodes_table: None,
        }
    }
}

/// The largest number of rows that `record.interval_s` may result in.
const MAX_ROWS: f64 = 1e9;

/// By default, nodes.csv is written for at most this many nodes.
const MAX_CSV_NODES: usize = 200;

fn from_start() -> NotNegative {
    NotNegative::constant(0.0)
}

/// True if `node` is one of `nodes`, counted from the head or, if negative, from the tip.
pub(super) fn is_node(node: i64, nodes: usize) -> bool {
    (-(nodes as i64)..nodes as i64).contains(&node)
}

/// A description of the nodes that a key may refer to.
pub(super) fn allowed_nodes(nodes: usize) -> String {
    format!("a node from 0 to {}, or from -1 (the tip) to -{nodes}", nodes - 1)
}

impl RecordTable {
    pub(super) fn check_nodes(&self, nodes: usize) -> Result<(), KeyError> {
        // A library that writes no files leaves this check to the program that has read the scene.
        let writes = cfg!(feature = "report") && !cfg!(feature = "parquet");
        if writes && self.nodes_table == Some(NodesTable::Parquet) {
            let problem = "found \"parquet\", which this program was built without (its feature `parquet`); allowed: `csv`, `none`";
            return Err(KeyError { key: "record.nodes_table".into(), problem: problem.into() });
        }
        let refuse = |found: &dyn std::fmt::Display| {
            Err(KeyError { key: "record.nodes".into(), problem: value::refused(found, allowed_nodes(nodes)) })
        };
        if let Some(bad) = self.nodes.iter().flatten().find(|node| !is_node(**node, nodes)) {
            return refuse(bad);
        }
        if self.nodes.as_ref().is_some_and(Vec::is_empty) {
            return refuse(&"no node");
        }
        Ok(())
    }

    /// Checks the number of rows of a run of `duration` (s).
    pub(super) fn check_rows(&self, duration: f64) -> Result<(), KeyError> {
        let fault = |problem: String| Err(KeyError { key: "record.interval_s".into(), problem });
        if self.every.is_some() && self.interval_s.is_some() {
            return fault("found together with every; allowed: one of the two".into());
        }
        if let Some(interval) = self.interval_s.map(Positive::get).filter(|x| duration > MAX_ROWS * x) {
            let allowed = format!("at least {:e}, so that there are at most {MAX_ROWS:e} rows", duration / MAX_ROWS);
            let found = format_args!("{interval:e}, which makes {:.1e} rows", duration / interval);
            return fault(value::refused(found, allowed));
        }
        Ok(())
    }
}

impl Scene {
    /// The nodes of the node table, in the requested order.
    pub fn recorded_nodes(&self) -> Vec<usize> {
        let nodes = self.nodes();
        match &self.record.nodes {
            Some(chosen) => chosen.iter().map(|node| node.rem_euclid(nodes as i64) as usize).collect(),
            None => (0..nodes).collect(),
        }
    }

    /// The format of the node table.
    pub fn nodes_table(&self) -> NodesTable {
        let recorded = self.record.nodes.as_ref().map_or(self.nodes(), Vec::len);
        let default = if recorded <= MAX_CSV_NODES { NodesTable::Csv } else { NodesTable::None };
        self.record.nodes_table.unwrap_or(default)
    }
}
