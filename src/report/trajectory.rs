//! A run's trajectory in memory as arrays (for Python), and a page that plays it.

use std::ops::ControlFlow;

use serde::Serialize;

use super::Summary;
use super::page::{Animation, RawJson, render};
use super::run_record::{RecordingTimes, RunRecord};
use crate::assessment::recorded_variables;
use crate::error::Result;
use crate::scene::{NodesTable, Scene};
use crate::stepper::Stepper;
use crate::variable::{Size, Variable, View};

/// Node positions, which are recorded if the scene tables them.
const POSITIONS: [&str; 2] = ["x_m", "y_m"];

/// The values of one variable over time.
#[derive(Debug, Clone)]
pub struct TrajectoryColumn {
    /// The variable.
    pub variable: &'static Variable,
    /// The nodes of its entries; `[0]` for a scalar.
    pub nodes: Vec<usize>,
    /// One entry per node, row by row.
    pub values: Vec<f64>,
}

/// Variables at the recorded times of a scene.
#[derive(Debug)]
pub struct TrajectoryTable {
    columns: Vec<TrajectoryColumn>,
    times: RecordingTimes,
    last: f64,
    record: RunRecord,
}

impl TrajectoryTable {
    /// Starts with the current state. Along with the time it records the variables `names`, by default those of trajectory.csv,
    /// those of `record.variables` among them, and the node positions of `scene.record` if they are tabled.
    ///
    /// # Errors
    /// [`Error::UnknownVariable`](crate::Error::UnknownVariable); those of [`recorded_variables`].
    pub fn start(scene: &Scene, stepper: &Stepper, names: Option<&[String]>) -> Result<Self> {
        let variables = stepper.variables().iter().copied();
        let tabled = scene.nodes_table() != NodesTable::None;
        let chosen: Vec<_> = match names {
            None => {
                let table = recorded_variables(scene, stepper)?;
                let is_in_table = |v: &Variable| table.iter().any(|(other, _)| other.name == v.name);
                variables.filter(|v| is_in_table(v) || tabled && POSITIONS.contains(&v.name)).collect()
            }
            Some(names) => {
                let named = names.iter().map(|name| stepper.find(name)).collect::<Result<Vec<_>>>()?;
                variables.filter(|v| v.name == "time_s" || named.iter().any(|other| v.name == other.name)).collect()
            }
        };
        let column = |variable: &'static Variable| {
            let nodes = match variable.size {
                Size::Nodes => scene.recorded_nodes(),
                Size::Scalar | Size::Joints => variable.entries(stepper.model()).collect(),
            };
            TrajectoryColumn { variable, nodes, values: Vec::new() }
        };
        let columns = chosen.into_iter().map(column).collect();
        let mut trajectory = Self {
            columns,
            times: RecordingTimes::of(scene, stepper),
            last: 0.0,
            record: RunRecord::start(scene, stepper),
        };
        trajectory.row(&stepper.view());
        Ok(trajectory)
    }

    /// Records the state after a step. `watch` is called at each recorded time, and may stop the run.
    ///
    /// # Errors
    /// Those of [`Stepper::at`].
    pub fn step(
        &mut self,
        stepper: &mut Stepper,
        watch: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>> {
        self.record.pass(stepper)?;
        let mut times = self.times;
        let outcome = times.pass(stepper, |view, recorded| {
            if recorded {
                self.row(view);
            }
            Ok(watch())
        });
        self.times = times;
        outcome
    }

    /// Records the final state, unless it was recorded.
    pub fn finish(&mut self, stepper: &Stepper) {
        let view = stepper.view();
        if self.last != view.state.t {
            self.row(&view);
        }
        self.record.finish(&view);
    }

    fn row(&mut self, view: &View<'_>) {
        self.last = view.state.t;
        for TrajectoryColumn { variable, nodes, values } in &mut self.columns {
            values.extend(nodes.iter().map(|k| variable.at(view, *k).unwrap_or(f64::NAN)));
        }
    }

    /// The columns, in the order of the table of variables.
    pub fn columns(&self) -> &[TrajectoryColumn] {
        &self.columns
    }

    /// The same, to keep.
    pub fn into_columns(self) -> Vec<TrajectoryColumn> {
        self.columns
    }

    /// A self-contained page that plays the run, without figures and tables.
    ///
    /// # Errors
    /// [`Error::Page`](crate::Error::Page).
    pub fn player(&self, summary: &Summary) -> Result<String> {
        #[derive(Serialize)]
        struct Content<'a> {
            summary: &'a Summary,
            motion: RawJson<Animation>,
        }
        let motion = Animation::of(&self.record.motion());
        render(include_str!("inline.html"), &Content { summary, motion: RawJson(motion) })
    }
}
