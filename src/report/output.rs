//! The files of a run: each is written beside its place and put there whole.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile};

use super::figures;
use super::page::Page;
use super::record::Record;
use crate::error::{Error, Result};
use crate::run::Summary;
use crate::scene::{Document, Scene};
use crate::stepper::Stepper;

/// The output folder of a run in progress.
#[derive(Debug)]
pub struct Output {
    folder: PathBuf,
    trajectory: Table,
    nodes: Option<Table>,
    record: Record,
    every: u64,
    step: u64,
    period: Option<f64>,
}

impl Output {
    /// Opens `folder` for a run of `scene` and records its first state.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn create(folder: &Path, scene: &Scene, stepper: &Stepper) -> Result<Self> {
        std::fs::create_dir_all(folder).map_err(|e| write_error(folder, &e))?;
        let columns = stepper.variables().iter().filter(|v| v.recorded).map(|v| v.name.to_string());
        let trajectory = Table::create(folder.join("trajectory.csv"), columns)?;
        let nodes = if scene.writes_nodes_csv() {
            let columns = (0..stepper.model().rod.nodes).flat_map(|k| [format!("x{k}_m"), format!("y{k}_m")]);
            Some(Table::create(folder.join("nodes.csv"), ["time_s".to_string()].into_iter().chain(columns))?)
        } else {
            None
        };
        let period = scene.actuation.as_ref().map(|a| a.frequency_hz.get()).filter(|f| *f > 0.0).map(|f| 1.0 / f);
        let mut output = Self {
            folder: folder.to_path_buf(),
            trajectory,
            nodes,
            record: Record::start(stepper),
            every: scene.record.every.get() as u64,
            step: 0,
            period,
        };
        output.row(stepper)?;
        Ok(output)
    }

    /// Sees the state after a step.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn step(&mut self, stepper: &Stepper) -> Result<()> {
        self.step += 1;
        self.record.step(stepper);
        if self.step.is_multiple_of(self.every) { self.row(stepper) } else { Ok(()) }
    }

    fn row(&mut self, stepper: &Stepper) -> Result<()> {
        let view = stepper.view();
        let values = stepper.variables().iter().filter(|v| v.recorded).map(|v| v.first(&view));
        self.trajectory.row(stepper.time(), values)?;
        match &mut self.nodes {
            Some(nodes) => {
                nodes.row(stepper.time(), [stepper.time()].into_iter().chain(stepper.state().q.iter().copied()))
            }
            None => Ok(()),
        }
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
            self.row(stepper)?;
        }
        self.record.finish(stepper);
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
        let without_nodes = self.nodes.is_none();
        files.extend(self.nodes.map(Table::complete).transpose()?);
        for (name, text) in texts {
            let path = self.folder.join(name);
            let mut file = beside(&path)?;
            file.write_all(text.as_bytes()).and_then(|()| file.flush()).map_err(|e| write_error(&path, &e))?;
            files.push((file, path));
        }
        if without_nodes {
            // One left by an earlier run would not belong to this one.
            let _ = std::fs::remove_file(self.folder.join("nodes.csv"));
        }
        files.into_iter().map(|(file, path)| put_in_place(file, path)).collect()
    }
}

fn write_error(path: &Path, error: &std::io::Error) -> Error {
    Error::Write { path: path.to_path_buf(), reason: error.to_string() }
}

/// A file beside `path`, which disappears unless it is put in place.
fn beside(path: &Path) -> Result<NamedTempFile> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let prefix = format!(".{name}.");
    let mut builder = Builder::new();
    builder.prefix(&prefix).suffix(".partial");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666)); // less the user's mask, as any file
    builder.tempfile_in(folder).map_err(|e| write_error(folder, &e))
}

fn put_in_place(file: NamedTempFile, path: PathBuf) -> Result<PathBuf> {
    file.persist(&path).map_err(|e| write_error(&path, &e.error))?;
    Ok(path)
}

/// A CSV file in the making.
#[derive(Debug)]
struct Table {
    path: PathBuf,
    writer: csv::Writer<BufWriter<NamedTempFile>>,
    /// Time of the last row, s.
    last: Option<f64>,
    values: Vec<f64>,
}

impl Table {
    fn create(path: PathBuf, columns: impl Iterator<Item = String>) -> Result<Self> {
        let writer = csv::Writer::from_writer(BufWriter::new(beside(&path)?));
        let mut table = Self { path, writer, last: None, values: Vec::new() };
        let header: Vec<String> = columns.collect();
        table.writer.write_record(&header).map_err(|e| table.failed(e))?;
        Ok(table)
    }

    fn row(&mut self, time: f64, values: impl Iterator<Item = f64>) -> Result<()> {
        self.last = Some(time);
        self.values.clear();
        self.values.extend(values);
        self.writer.serialize(&self.values).map_err(|e| self.failed(e))
    }

    fn failed(&self, error: csv::Error) -> Error {
        match error.into_kind() {
            csv::ErrorKind::Io(error) => write_error(&self.path, &error),
            other => Error::Write { path: self.path.clone(), reason: format!("{other:?}") },
        }
    }

    fn complete(self) -> Result<(NamedTempFile, PathBuf)> {
        let path = self.path;
        let buffer = self.writer.into_inner().map_err(|e| write_error(&path, e.error()))?;
        let file = buffer.into_inner().map_err(|e| write_error(&path, e.error()))?;
        Ok((file, path))
    }
}
