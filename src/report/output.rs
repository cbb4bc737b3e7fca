//! Output folder of a run: trajectory and node tables, written step by step, then summary, figures and page.

use std::ops::ControlFlow;
use std::path::Path;

use tempfile::NamedTempFile;

use super::Summary;
use super::chart::Figure;
use super::page::Page;
#[cfg(feature = "parquet")]
use super::parquet::Parquet;
use super::run_figures;
use super::run_record::{RecordingTimes, RunRecord};
use super::tables::CsvTable;
use super::{Claim, Folder, FolderWriter, Owner};
use crate::assessment::{recorded_size, recorded_variables};
use crate::cycle::PERIOD;
use crate::error::{Error, Result};
use crate::files::{WrittenFiles, free_space, partial_file_with, partial_json_file};
use crate::scene::{Document, NodesTable, Scene};
use crate::stepper::Stepper;
use crate::system::State;
use crate::variable::{Size, Variable, View};

/// The output folder of a run in progress.
#[derive(Debug)]
pub struct RunOutput {
    trajectory: CsvTable,
    nodes: NodesWriter,
    record: RunRecord,
    /// Variables, each with the index of its entry.
    columns: Vec<(&'static Variable, usize)>,
    times: RecordingTimes,
    period: Option<f64>,
    /// Reserved disk space for the summary, so that tables cannot fill the disk before it is written.
    reserve: NamedTempFile,
    folder: Folder, // the last one to be dropped: it goes where it is empty
}

/// Size of the summary, bytes: of its numbers, per final position, and the most that is reserved.
const SUMMARY_BYTES: [usize; 3] = [8192, 90, 1 << 20];

impl RunOutput {
    /// Checks that the tables of a run of `scene` fit into `folder`.
    ///
    /// # Errors
    /// [`Error::Room`] if they do not; those of [`recorded_variables`].
    pub fn fits(folder: &Path, scene: &Scene, stepper: &Stepper) -> Result<()> {
        recorded_variables(scene, stepper)?;
        match (recorded_size(scene, stepper), free_space(folder)) {
            (Some((rows, needed)), Some(free)) if needed > free as f64 => {
                let what = format!(
                    "{rows:.3e} rows of trajectory.csv and the table of nodes (record.every, record.interval_s)"
                );
                Err(Error::Room { path: folder.to_path_buf(), what, needed, free: free as f64 })
            }
            _ => Ok(()),
        }
    }

    /// Claims `folder` for a run of `scene` and records its first state.
    ///
    /// # Errors
    /// [`Error::Room`]; those of [`Folder::claim`]. A folder that did not exist is then not created.
    pub fn create(folder: &Path, scene: &Scene, stepper: &Stepper, claim: Claim) -> Result<Self> {
        Self::fits(folder, scene, stepper)?;
        let nodes_file = match scene.nodes_table() {
            NodesTable::Csv => Some(NODES_FILES[0]),
            NodesTable::Parquet => Some(NODES_FILES[1]),
            NodesTable::None => None,
        };
        let certain: Vec<&str> = RUN_FILES.into_iter().chain(nodes_file).collect();
        let mut opened = Folder::claim(folder, Owner::of("run", scene), claim, &certain)?;
        // This reserves space for a disk that is full at the end.
        opened.results().list(certain.iter().copied().chain(run_figures::FILES));
        let nodes = stepper.model().rod.nodes;
        let [numbers, position, most] = SUMMARY_BYTES;
        let reserve =
            partial_file_with(&folder.join("summary.json"), " ".repeat((numbers + position * nodes).min(most)))?;
        let columns = recorded_variables(scene, stepper)?;
        let header = columns.iter().map(|(variable, entry)| match variable.size {
            Size::Scalar => variable.name.to_string(),
            Size::Nodes | Size::Joints => format!("{}[{entry}]", variable.name),
        });
        let trajectory = CsvTable::create(folder.join("trajectory.csv"), header)?;
        let nodes = NodesWriter::create(folder, scene)?;
        let period = scene.actuation.as_ref().map(|a| a.frequency_hz.get()).filter(|f| *f > 0.0).map(|f| 1.0 / f);
        let mut output = Self {
            trajectory,
            nodes,
            record: RunRecord::start(scene, stepper),
            columns,
            times: RecordingTimes::of(scene, stepper),
            period,
            reserve,
            folder: opened,
        };
        output.row(&stepper.view())?;
        Ok(output)
    }

    /// Records the state after a step. `watch` is called at each recorded time, and may stop the run.
    ///
    /// # Errors
    /// [`Error::Write`]; those of [`Stepper::at`].
    pub fn step(
        &mut self,
        stepper: &mut Stepper,
        watch: &mut dyn FnMut() -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>> {
        self.record.pass(stepper)?;
        let mut times = self.times;
        let outcome = times.pass(stepper, |view, recorded| {
            if recorded {
                self.row(view)?;
            }
            Ok(watch())
        });
        self.times = times;
        outcome
    }

    fn row(&mut self, view: &View<'_>) -> Result<()> {
        let values = self.columns.iter().map(|(variable, entry)| variable.at(view, *entry).unwrap_or(f64::NAN));
        self.trajectory.row(view.state.t, values)?;
        self.nodes.row(view.state)
    }

    /// Completes all files with the final state and puts them in place: first the summary, then tables, figures, and the page. An
    /// error in one does not affect the others.
    pub fn finish(
        mut self,
        stepper: &Stepper,
        summary: &Summary,
        document: &Document,
        notes: &[String],
    ) -> WrittenFiles {
        let last = match self.trajectory.last == Some(stepper.time()) {
            true => Ok(()),
            false => self.row(&stepper.view()),
        };
        self.record.finish(&stepper.view());
        let Self { trajectory, nodes, record, period, reserve, mut folder, .. } = self;
        let mut results = folder.results();
        results.note(last.err());
        drop(reserve);
        let path = results.path().join("summary.json");
        results.put("summary.json", partial_json_file(&path, summary));
        results.put_table(trajectory);
        nodes.keep(&mut results);
        // That of the drive, also of a driven head, once it has passed.
        let period = summary.cycles.mean(&PERIOD).or(period);
        let figures = run_figures::all(&summary.name, &record, period);
        for Figure { file, svg, .. } in &figures {
            results.put_file(file, Ok(svg));
        }
        let scene = (document.text(), document.overrides());
        let page = Page { summary, scene, notes, motion: &record.motion(), figures: &figures };
        let page = page.html();
        results.put_file("report.html", page);
        results.finish()
    }
}

/// The files that every run writes.
const RUN_FILES: [&str; 6] =
    ["summary.json", "trajectory.csv", "report.html", "shape.svg", "com_path.svg", "energy.svg"];

/// Possible names of the table of node positions.
const NODES_FILES: [&str; 2] = ["nodes.csv", "nodes.parquet"];

/// The table of node positions.
#[derive(Debug)]
struct NodesWriter {
    table: NodesFormat,
    chosen: Vec<usize>,
    from: f64,
}

#[derive(Debug)]
enum NodesFormat {
    Csv(Box<CsvTable>),
    #[cfg(feature = "parquet")]
    Parquet(Box<Parquet>),
    None,
}

impl NodesWriter {
    fn create(folder: &Path, scene: &Scene) -> Result<Self> {
        let (chosen, from) = (scene.recorded_nodes(), scene.record.nodes_from_s.get());
        let table = match scene.nodes_table() {
            NodesTable::Csv => {
                let columns = chosen.iter().flat_map(|k| [format!("x{k}_m"), format!("y{k}_m")]);
                let header = ["time_s".to_string()].into_iter().chain(columns);
                NodesFormat::Csv(Box::new(CsvTable::create(folder.join(NODES_FILES[0]), header)?))
            }
            #[cfg(feature = "parquet")]
            NodesTable::Parquet => NodesFormat::Parquet(Box::new(Parquet::create(folder.join(NODES_FILES[1]))?)),
            _ => NodesFormat::None,
        };
        Ok(Self { table, chosen, from })
    }

    fn row(&mut self, state: &State) -> Result<()> {
        let (time, q) = (state.t, &state.q);
        if time < self.from {
            return Ok(());
        }
        match &mut self.table {
            NodesFormat::Csv(table) => {
                let positions = self.chosen.iter().flat_map(|k| [q[2 * k], q[2 * k + 1]]);
                table.row(time, [time].into_iter().chain(positions))
            }
            #[cfg(feature = "parquet")]
            NodesFormat::Parquet(table) => table.rows(time, &self.chosen, q),
            NodesFormat::None => Ok(()),
        }
    }

    /// Puts the table in place.
    fn keep(self, results: &mut FolderWriter<'_>) {
        match self.table {
            NodesFormat::Csv(table) => results.put_table(*table),
            #[cfg(feature = "parquet")]
            NodesFormat::Parquet(table) => results.put(NODES_FILES[1], table.complete()),
            NodesFormat::None => {}
        }
    }
}
