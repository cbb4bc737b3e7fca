//! The files of a run: each is written beside its place and put there whole.

use std::path::{Path, PathBuf};

use super::figures;
use super::page::Page;
use super::record::{Record, Times};
use super::tables::{Csv, Parquet, put_in_place, text_file, write_error};
use crate::error::{Error, Result};
use crate::run::Summary;
use crate::scene::{Document, NodesTable, Scene};
use crate::stepper::Stepper;
use crate::system::State;
use crate::variable::{Variable, View};

/// The output folder of a run in progress.
#[derive(Debug)]
pub struct Output {
    folder: PathBuf,
    trajectory: Csv,
    nodes: Nodes,
    record: Record,
    columns: Vec<&'static Variable>,
    times: Times,
    period: Option<f64>,
}

impl Output {
    /// Opens `folder` for a run of `scene` and records its first state.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn create(folder: &Path, scene: &Scene, stepper: &Stepper) -> Result<Self> {
        std::fs::create_dir_all(folder).map_err(|e| write_error(folder, &e))?;
        let columns: Vec<_> = stepper.variables().iter().copied().filter(|v| v.recorded).collect();
        let header = columns.iter().map(|v| v.name.to_string());
        let trajectory = Csv::create(folder.join("trajectory.csv"), header)?;
        let nodes = Nodes::create(folder, scene)?;
        let period = scene.actuation.as_ref().map(|a| a.frequency_hz.get()).filter(|f| *f > 0.0).map(|f| 1.0 / f);
        let mut output = Self {
            folder: folder.to_path_buf(),
            trajectory,
            nodes,
            record: Record::start(stepper),
            columns,
            times: Times::of(scene),
            period,
        };
        output.row(&stepper.view())?;
        Ok(output)
    }

    /// Sees the state after a step.
    ///
    /// # Errors
    /// [`Error::Write`]; those of [`Stepper::at`].
    pub fn step(&mut self, stepper: &mut Stepper) -> Result<()> {
        let mut times = self.times;
        let outcome = times.pass(stepper, |view, recorded| {
            self.record.step(view);
            if recorded { self.row(view) } else { Ok(()) }
        });
        self.times = times;
        outcome
    }

    fn row(&mut self, view: &View<'_>) -> Result<()> {
        let values = self.columns.iter().map(|v| v.first(view));
        self.trajectory.row(view.state.t, values)?;
        self.nodes.row(view.state)
    }

    /// Completes every file with the state at the end and puts them in place; returns their paths.
    ///
    /// # Errors
    /// [`Error::Write`], [`Error::Chart`], [`Error::Page`]; files already in the folder are then as they were.
    pub fn finish(
        mut self,
        stepper: &Stepper,
        summary: &Summary,
        document: &Document,
        notes: &[String],
    ) -> Result<Vec<PathBuf>> {
        if self.trajectory.last != Some(stepper.time()) {
            self.row(&stepper.view())?;
        }
        self.record.finish(&stepper.view());
        let figures = figures::all(&summary.name, &self.record, self.period)
            .into_iter()
            .map(|(file, chart)| Ok((file, chart.svg()?)))
            .collect::<Result<Vec<_>>>()?;
        let page = Page {
            summary,
            scene: (document.text(), document.overrides()),
            notes,
            frames: self.record.frames(),
            figures: &figures,
        };
        let json = serde_json::to_string_pretty(summary).map_err(|e| Error::Page { reason: e.to_string() })?;
        let html = page.html()?;
        let texts = [("summary.json", json + "\n"), ("report.html", html)].into_iter().chain(figures);
        let mut files = vec![self.trajectory.complete()?];
        files.extend(self.nodes.complete()?);
        for (name, text) in texts {
            let path = self.folder.join(name);
            files.push(text_file(path, &text)?);
        }
        for stale in NODES_FILES.map(|name| self.folder.join(name)) {
            // One left by an earlier run would not belong to this one.
            if !files.iter().any(|(_, path)| *path == stale) {
                let _ = std::fs::remove_file(stale);
            }
        }
        files.into_iter().map(|(file, path)| put_in_place(file, path)).collect()
    }
}

/// The names that the table of node positions may have.
const NODES_FILES: [&str; 2] = ["nodes.csv", "nodes.parquet"];

/// The table of node positions.
#[derive(Debug)]
struct Nodes {
    table: Form,
    chosen: Vec<usize>,
    from: f64,
}

#[derive(Debug)]
enum Form {
    Csv(Csv),
    Parquet(Parquet),
    None,
}

impl Nodes {
    fn create(folder: &Path, scene: &Scene) -> Result<Self> {
        let (chosen, from) = (scene.recorded_nodes(), scene.record.nodes_from_s.get());
        let table = match scene.nodes_table() {
            NodesTable::Csv => {
                let columns = chosen.iter().flat_map(|k| [format!("x{k}_m"), format!("y{k}_m")]);
                let header = ["time_s".to_string()].into_iter().chain(columns);
                Form::Csv(Csv::create(folder.join(NODES_FILES[0]), header)?)
            }
            NodesTable::Parquet => Form::Parquet(Parquet::create(folder.join(NODES_FILES[1]))?),
            NodesTable::None => Form::None,
        };
        Ok(Self { table, chosen, from })
    }

    fn row(&mut self, state: &State) -> Result<()> {
        let (time, q) = (state.t, &state.q);
        if time < self.from {
            return Ok(());
        }
        match &mut self.table {
            Form::Csv(table) => {
                let positions = self.chosen.iter().flat_map(|k| [q[2 * k], q[2 * k + 1]]);
                table.row(time, [time].into_iter().chain(positions))
            }
            Form::Parquet(table) => table.rows(time, &self.chosen, q),
            Form::None => Ok(()),
        }
    }

    fn complete(self) -> Result<Option<(tempfile::NamedTempFile, PathBuf)>> {
        match self.table {
            Form::Csv(table) => table.complete().map(Some),
            Form::Parquet(table) => table.complete().map(Some),
            Form::None => Ok(None),
        }
    }
}
