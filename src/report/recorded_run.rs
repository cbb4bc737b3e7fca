//! A finished run read back from its folder: summary, scene, curves of trajectory.csv, and the motion of the node table.

use std::collections::VecDeque;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use csv::{Reader, StringRecord};
use serde_json::{Map, Value};

use super::folder::{Folder, MANIFEST};
use super::interpolation::interpolate;
use super::rod_motion::{DrawnRod, MAX_POINTS, drawn_nodes};
use super::run_record::{Envelope, MAX_SAMPLES, Thinned};
use super::sampling::fastest_drive;
use crate::error::{Error, Result};
use crate::model::Model;
use crate::scene::{Document, Scene};
use crate::wording::Phrase;

/// Most rows of a node table that are kept of the window of a film; at least half as many are.
const MAX_ROWS: usize = 4800;

/// Most positions of the centre of mass that are kept; at least half as many are, twelve per period of a run of 8000 periods.
const MAX_POSITIONS: usize = 200_000;

/// Curves of a run over time, thinned out if there are many rows.
#[derive(Debug, Default)]
pub struct Curves {
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
    /// The columns over time.
    over_time: Option<Envelope>,
    /// Middle (s) of the interval between two recorded times, and the mean velocity (m/s) of the centre of mass over it.
    velocity: Option<Envelope>,
    /// Times (s) with the positions of the centre of mass (m), much closer than the rows.
    positions: Vec<[f64; 3]>,
}

/// The recorded positions of nodes.
#[derive(Debug)]
enum NodeTable {
    Csv(PathBuf),
    #[cfg(feature = "parquet")]
    Parquet(PathBuf),
    /// Times (s), and positions.
    Memory(Vec<f64>, NodePositions),
    None,
}

/// The motion of a run within a window of time.
#[derive(Debug)]
pub struct RecordedMotion {
    /// Recorded times (s) with the positions of nodes (m), along with those just outside the window. If there are many, some are left
    /// out.
    rows: Vec<Row>,
    /// Mean time between the rows of its table within the window, s; `None` if there are fewer than two.
    pub spacing: Option<f64>,
}

impl RecordedMotion {
    /// The last time, s; `None` without any row.
    pub fn end(&self) -> Option<f64> {
        self.rows.last().map(|row| row.0)
    }

    /// The positions at a time (s) by interpolation; the first or last ones outside, and none of an empty motion.
    pub fn at(&self, time: f64) -> Vec<[f64; 2]> {
        let (rows, nodes) = (&self.rows, self.rows.first().map_or(0, |row| row.1.len()));
        let flat = interpolate(rows.len(), time, |i| rows[i].0, |i, k| rows[i].1[k / 2][k % 2], 2 * nodes);
        flat.chunks_exact(2).map(|point| [point[0], point[1]]).collect()
    }
}

/// Positions of nodes in memory.
#[derive(Debug)]
pub struct NodePositions {
    /// The nodes.
    pub nodes: Vec<usize>,
    /// Their positions x (m), row by row.
    pub x: Vec<f64>,
    /// Their positions y (m), row by row.
    pub y: Vec<f64>,
}

/// The places of `nodes` in the order from the head to the tip.
fn ascending(nodes: &[usize]) -> Vec<usize> {
    let mut places: Vec<usize> = (0..nodes.len()).collect();
    places.sort_by_key(|place| nodes[*place]);
    places
}

/// A run that was recorded.
#[derive(Debug)]
pub struct RecordedRun {
    /// Its folder; `None` of a run in memory.
    pub path: Option<PathBuf>,
    /// The name of its scene.
    pub name: String,
    /// The content of summary.json.
    pub summary: Map<String, Value>,
    /// Its scene with the overrides, if it is known.
    pub scene: Option<Document>,
    /// The columns of trajectory.csv.
    pub curves: Curves,
    /// Descriptions of what is missing in the folder.
    pub missing: Vec<String>,
    nodes: NodeTable,
    /// Its scene as it was read, if its files are still those of the run, and its model.
    simulated: Option<Scene>,
    model: OnceLock<Option<Model>>,
}

fn unreadable(path: &Path, reason: impl Into<String>) -> Error {
    Error::Read { path: path.to_path_buf(), reason: reason.into() }
}

impl RecordedRun {
    /// Reads the folder of a run.
    ///
    /// # Errors
    /// [`Error::Read`] for a path that is no folder of a run, and for a file of it that is damaged. A missing table, or a scene that
    /// is not known any more, is [`missing`](Self::missing).
    pub fn read(path: &Path) -> Result<Self> {
        check_folder(path)?;
        let summary = read_summary(path)?;
        let entry = |key: &str| summary.get(key).and_then(Value::as_str).unwrap_or_default().to_string();
        let mut missing = Vec::new();
        let table = path.join("trajectory.csv");
        let curves = if table.is_file() {
            Curves::read(&table)?
        } else {
            missing.push("trajectory.csv is missing: it has no curves in the figures".to_string());
            Curves::default()
        };
        let name = entry("name");
        let scene = scene_of(path, &summary);
        let simulated = scene.as_ref().and_then(|document| unchanged(document, &summary, &mut missing));
        if scene.is_none() {
            missing.push(format!(
                "its scene is not known: neither report.html has it, nor is {} the scene of the run any more",
                entry("scene_file")
            ));
        }
        let mut nodes = NodeTable::at(path);
        if matches!(nodes, NodeTable::None) {
            missing.push("it has no table of nodes (record.nodes_table): it is not in the film".to_string());
        } else if nodes.start()?.is_none() {
            missing.push("its table of nodes has no row (record.nodes_from_s): it is not in the film".to_string());
            nodes = NodeTable::None;
        }
        Ok(Self {
            path: Some(path.to_path_buf()),
            name,
            summary,
            scene,
            curves,
            missing,
            nodes,
            simulated,
            model: OnceLock::new(),
        })
    }

    /// A run in memory, with `columns` by name that have one value per recorded time, of which `time_s` is the first.
    ///
    /// # Errors
    /// [`Error::Page`] for columns of different lengths.
    pub fn in_memory(
        summary: Map<String, Value>,
        scene: Document,
        columns: Vec<(String, Vec<f64>)>,
        positions: Option<NodePositions>,
    ) -> Result<Self> {
        let name = summary.get("name").and_then(Value::as_str).unwrap_or_default().to_string();
        let (names, values): (Vec<String>, Vec<Vec<f64>>) = columns.into_iter().unzip();
        let count = values.first().map_or(0, Vec::len);
        let times = names.iter().position(|name| name == "time_s").map(|k| values[k].clone()).unwrap_or_default();
        let whole = values.iter().all(|column| column.len() == count);
        let divided = |of: &NodePositions| [&of.x, &of.y].iter().all(|all| all.len() == times.len() * of.nodes.len());
        if !whole || positions.as_ref().is_some_and(|positions| !divided(positions)) {
            return Err(Error::Page { reason: format!("the columns of `{name}` have different lengths") });
        }
        let mut curves = CurvesBuilder::new(names)?;
        (0..count).try_for_each(|row| curves.take(row + 1 == count, |column| Ok(values[column][row])))?;
        let mut missing = Vec::new();
        let nodes = match positions {
            Some(positions) => NodeTable::Memory(times, positions),
            None => {
                missing.push("it has no positions of nodes: it is not in the film".to_string());
                NodeTable::None
            }
        };
        let simulated = unchanged(&scene, &summary, &mut missing);
        let (scene, curves, model) = (Some(scene), curves.finish(), OnceLock::new());
        Ok(Self { path: None, name, summary, scene, curves, missing, nodes, simulated, model })
    }

    /// A number of the summary.
    pub fn number(&self, key: &str) -> Option<f64> {
        self.summary.get(key).and_then(Value::as_f64)
    }

    /// A text of the summary.
    pub fn text(&self, key: &str) -> Option<&str> {
        self.summary.get(key).and_then(Value::as_str)
    }

    /// True if the run reached its duration.
    pub fn is_complete(&self) -> bool {
        self.summary.get("complete").and_then(Value::as_bool).unwrap_or(false)
    }

    /// True if it has recorded positions of nodes.
    pub fn has_motion(&self) -> bool {
        !matches!(self.nodes, NodeTable::None)
    }

    /// The first time (s) of its table of nodes; `None` without a row.
    ///
    /// # Errors
    /// [`Error::Read`].
    pub fn motion_start(&self) -> Result<Option<f64>> {
        self.nodes.start()
    }

    /// The motion within a window of time (s), of at most [`MAX_POINTS`] nodes.
    ///
    /// # Errors
    /// [`Error::Read`].
    pub fn motion(&self, window: [f64; 2]) -> Result<RecordedMotion> {
        let mut rows = WindowBuilder::new(window);
        self.nodes.visit(&mut rows)?;
        Ok(rows.finish())
    }

    /// Frequency (Hz) of the fastest drive of its scene; `None` without one, and if the scene is not known.
    pub fn fastest_drive(&self) -> Option<f64> {
        fastest_drive(self.simulated.as_ref()?, self.model()?)
    }

    /// The model of its scene; `None` if the scene is not known, or its files have changed.
    pub fn model(&self) -> Option<&Model> {
        self.model.get_or_init(|| self.simulated.as_ref()?.model().ok()).as_ref()
    }

    /// The rod of its [`motion`](Self::motion), without its looks if its scene is not known.
    ///
    /// # Errors
    /// [`Error::Read`] for a damaged table of nodes.
    pub fn rod(&self) -> Result<DrawnRod> {
        let nodes = self.nodes.nodes()?;
        let shown = drawn_nodes(nodes.len(), MAX_POINTS).into_iter().map(|place| nodes[place]).collect();
        Ok(DrawnRod::at(self.model(), shown))
    }
}

/// Refuses a folder that is not that of a run, and describes it.
fn check_folder(path: &Path) -> Result<()> {
    let refuse = |reason: String| Err(unreadable(path, reason));
    if path.is_file() {
        let is_scene = path.extension().is_some_and(|extension| extension == "toml");
        let kind = if is_scene { "a scene" } else { "a file" };
        let remedy = if is_scene { format!("; {}", Phrase::run_first(path)) } else { String::new() };
        return refuse(format!("it is {kind}, not the folder of a run{remedy}"));
    }
    if !path.is_dir() {
        return refuse(format!("there is no such folder; {} the folder of a run", Phrase::MakesFolder));
    }
    match Folder::owner_at(path)? {
        Some(owner) if owner.kind != "run" => refuse(format!("it holds {owner}; allowed: folders of runs")),
        _ if path.join("summary.json").exists() => Ok(()),
        Some(owner) => refuse(format!(
            "it holds {owner} without a summary.json, as the run has not ended or was killed; run it again"
        )),
        None if path.join(MANIFEST).exists() => refuse("it holds exported files only; allowed: folders of runs".into()),
        None => refuse(format!("it holds no run; {} the folder of a run", Phrase::MakesFolder)),
    }
}

fn read_summary(folder: &Path) -> Result<Map<String, Value>> {
    let path = folder.join("summary.json");
    let text = std::fs::read_to_string(&path).map_err(|e| unreadable(&path, e.to_string()))?;
    let summary: Map<String, Value> =
        serde_json::from_str(&text).map_err(|e| unreadable(&path, format!("{e}; run the scene again")))?;
    if summary.get("scene_file").is_none_or(|file| !file.is_string()) {
        return Err(unreadable(&path, "it is not the summary of a run; allowed: folders of runs"));
    }
    Ok(summary)
}

/// The scene of a run with its overrides: as its page shows it or, if the page is not there, from the scene's file, if this has not
/// changed since.
fn scene_of(folder: &Path, summary: &Map<String, Value>) -> Option<Document> {
    let file = Path::new(summary.get("scene_file")?.as_str()?);
    let on_page = std::fs::read_to_string(folder.join("report.html")).ok().and_then(|page| scene_on_page(file, &page));
    on_page.filter(|document| document.read_as::<toml::Table>().is_ok()).or_else(|| {
        let document = Document::read(file).ok()?;
        let fingerprint = document.scene().ok()?.fingerprint_text();
        (summary.get("scene_fingerprint")?.as_str()? == fingerprint).then_some(document)
    })
}

/// The scene of a `document` if its tables are those of the run with this summary; otherwise says that in `missing`.
fn unchanged(document: &Document, summary: &Map<String, Value>, missing: &mut Vec<String>) -> Option<Scene> {
    let text = |key: &str| summary.get(key).and_then(Value::as_str);
    let reason = match document.scene() {
        Ok(scene) => {
            let is_same = |fingerprint| fingerprint == scene.fingerprint_text();
            if scene.tables().is_empty() || text("scene_fingerprint").is_none_or(is_same) {
                return Some(scene);
            }
            match text("caudal_version").filter(|version| *version != env!("CARGO_PKG_VERSION")) {
                None => "a table of its scene has changed since the run".to_string(),
                Some(version) => {
                    format!("version {version} made it, so its tables cannot be compared with those of today")
                }
            }
        }
        Err(error) => {
            let error = error.to_string();
            format!("its scene cannot be read any more: {}", error.lines().next().unwrap_or_default())
        }
    };
    missing.push(format!("{reason}; its film has no medium and no body. Run the scene again"));
    None
}

/// The overrides of the run in a folder, as its page shows them; none without a page.
pub fn recorded_overrides(folder: &Path) -> Vec<String> {
    let page = std::fs::read_to_string(folder.join("report.html")).unwrap_or_default();
    scene_on_page(Path::new(""), &page).map(|document| document.overrides().to_vec()).unwrap_or_default()
}

/// Before each override of a scene on its page.
const OVERRIDDEN: &str = "# overridden: ";

/// The scene that a run's page shows last, see page.html.
fn scene_on_page(file: &Path, page: &str) -> Option<Document> {
    let (count, shown) =
        page.rsplit_once("<h2>Scene</h2>")?.1.split_once("<pre data-overrides=\"")?.1.split_once("\">")?;
    let count: usize = count.parse().ok()?;
    let mut text = unescaped(shown.split_once("</pre>")?.0);
    let mut overrides = Vec::new();
    while overrides.len() < count
        && let Some((before, last)) = text.rsplit_once('\n')
        && let Some(assignment) = last.strip_prefix(OVERRIDDEN)
    {
        overrides.push(assignment.to_string());
        text.truncate(before.len());
    }
    let mut document = Document::new(file, text);
    overrides.iter().rev().try_for_each(|assignment| document.set(assignment)).ok()?;
    Some(document)
}

/// A text without the escapes of HTML.
fn unescaped(text: &str) -> String {
    // The ampersand comes last, because the other escapes begin with it.
    let escapes = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&#x27;", "'"), ("&#x2f;", "/"), ("&amp;", "&")];
    escapes.iter().fold(text.to_string(), |text, (escape, sign)| text.replace(escape, sign))
}

/// The number in a field of a table.
fn field(path: &Path, row: &StringRecord, columns: &[String], k: usize) -> Result<f64> {
    let text = row.get(k).unwrap_or_default();
    text.trim().parse().map_err(|_| {
        let line = row.position().map_or(0, csv::Position::line);
        let column = columns.get(k).map_or("", String::as_str);
        unreadable(
            path,
            format!("line {line}, column {column}: found `{text}`, which is no number; run the scene again"),
        )
    })
}

/// A table and its header.
fn open_table(path: &Path) -> Result<(Reader<File>, Vec<String>)> {
    let mut table = Reader::from_path(path).map_err(|e| table_error(path, &e))?;
    let columns: Vec<String> = table.headers().map_err(|e| table_error(path, &e))?.iter().map(str::to_string).collect();
    if columns.first().is_none_or(|name| name != "time_s") {
        return Err(unreadable(path, "its first column is not time_s; run the scene again"));
    }
    Ok((table, columns))
}

fn table_error(path: &Path, error: &csv::Error) -> Error {
    unreadable(path, format!("{error}; run the scene again"))
}

/// Reads the next row into `row`; false at the end.
fn next_row(path: &Path, table: &mut Reader<File>, row: &mut StringRecord) -> Result<bool> {
    table.read_record(row).map_err(|e| table_error(path, &e))
}

impl Curves {
    fn read(path: &Path) -> Result<Self> {
        let (mut table, columns) = open_table(path)?;
        let mut curves = CurvesBuilder::new(columns.clone())?;
        let (mut row, mut next) = (StringRecord::new(), StringRecord::new());
        let mut there = next_row(path, &mut table, &mut row)?;
        while there {
            there = next_row(path, &mut table, &mut next)?;
            curves.take(!there, |k| field(path, &row, &columns, k))?;
            std::mem::swap(&mut row, &mut next);
        }
        Ok(curves.finish())
    }

    /// The names of its columns.
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// The curve of column `y` against column `x`; empty if one of them is not there. The velocity of the centre of mass over time is
    /// the difference quotient of its position, unless it was recorded.
    pub fn curve(&self, x: &str, y: &str) -> Vec<(f64, f64)> {
        let column = |name: &str| self.columns.iter().position(|column| column == name);
        let derived = |axis: usize| self.velocity.as_ref().map(|rows| rows.curve(axis)).unwrap_or_default();
        match (column(x), column(y), x, y) {
            (Some(0), Some(y), ..) => self.over_time.as_ref().map(|rows| rows.curve(y)).unwrap_or_default(),
            (Some(x), Some(y), ..) => self.rows.iter().map(|row| (row[x], row[y])).collect(),
            (_, None, "time_s", "vx_com_m_s") => derived(1),
            (_, None, "time_s", "vy_com_m_s") => derived(2),
            _ => Vec::new(),
        }
    }

    /// The centre of mass (m) at a time (s) by interpolation between recorded times, its first or last position outside; `None` if it
    /// is not recorded.
    pub fn centre_of_mass(&self, time: f64) -> Option<[f64; 2]> {
        let of = &self.positions;
        interpolate(of.len(), time, |i| of[i][0], |i, axis| of[i][1 + axis], 2).try_into().ok()
    }
}

/// Collects the rows of a table.
struct CurvesBuilder {
    columns: Vec<String>,
    rows: Thinned<Vec<f64>>,
    over_time: Envelope,
    velocity: Envelope,
    positions: Thinned<[f64; 3]>,
    /// The columns of the centre of mass.
    com: Option<[usize; 2]>,
    previous: Option<[f64; 3]>,
    row: u64,
}

impl CurvesBuilder {
    fn new(columns: Vec<String>) -> Result<Self> {
        if columns.first().is_none_or(|name| name != "time_s") {
            return Err(Error::Page { reason: "the first column of a run must be time_s".to_string() });
        }
        let place = |name: &str| columns.iter().position(|column| column == name);
        let com = place("x_com_m").zip(place("y_com_m")).map(|(x, y)| [x, y]);
        let [over_time, velocity] = [(); 2].map(|()| Envelope::new(MAX_SAMPLES));
        let (rows, positions) = (Thinned::new(MAX_SAMPLES), Thinned::new(MAX_POSITIONS));
        Ok(Self { columns, rows, over_time, velocity, positions, com, previous: None, row: 0 })
    }

    /// Takes the next row, with its value in each column; the last one is always kept.
    fn take(&mut self, is_last: bool, value: impl Fn(usize) -> Result<f64>) -> Result<()> {
        let row = (0..self.columns.len()).map(&value).collect::<Result<Vec<f64>>>()?;
        if !self.rows.offer(self.row, || row.clone()) && is_last {
            self.rows.kept.push(row.clone());
        }
        if let Some([x, y]) = self.com {
            let now = [row[0], row[x], row[y]];
            if !self.positions.offer(self.row, || now) && is_last {
                self.positions.kept.push(now);
            }
            if let Some(previous) = self.previous.filter(|previous| now[0] > previous[0]) {
                let step = now[0] - previous[0];
                let slope = |i: usize| (now[i] - previous[i]) / step;
                self.velocity.take(3, |k| if k == 0 { previous[0] + 0.5 * step } else { slope(k) });
            }
            self.previous = Some(now);
        }
        self.over_time.take(row.len(), |k| row[k]);
        self.row += 1;
        Ok(())
    }

    fn finish(self) -> Curves {
        let Self { columns, rows, over_time, velocity, positions, .. } = self;
        let (rows, positions) = (rows.kept, positions.kept);
        Curves { columns, rows, over_time: Some(over_time), velocity: Some(velocity), positions }
    }
}

/// Collects the rows of a table of nodes within a window, and two on both sides of it, between which is interpolated.
struct WindowBuilder {
    window: [f64; 2],
    before: VecDeque<Row>,
    rows: Thinned<Row>,
    last: Option<Row>,
    row: u64,
    /// Rows from the end of the window on.
    after: usize,
}

/// A time (s) with the positions of nodes (m).
type Row = (f64, Vec<[f64; 2]>);

/// Rows on each side of a window.
const BESIDE: usize = 2;

impl WindowBuilder {
    fn new(window: [f64; 2]) -> Self {
        Self { window, before: VecDeque::new(), rows: Thinned::new(MAX_ROWS), last: None, row: 0, after: 0 }
    }

    /// Takes the positions of `count` nodes at the next time; false if no more are needed.
    fn take(&mut self, time: f64, count: usize, at: impl Fn(usize) -> Result<[f64; 2]>) -> Result<bool> {
        let positions = drawn_nodes(count, MAX_POINTS).into_iter().map(at).collect::<Result<Vec<_>>>()?;
        if time < self.window[0] {
            if self.before.len() == BESIDE {
                self.before.pop_front();
            }
            self.before.push_back((time, positions));
            return Ok(true);
        }
        self.rows.offer(self.row, || (time, positions.clone()));
        self.last = Some((time, positions));
        self.row += 1;
        self.after += usize::from(time >= self.window[1]);
        Ok(self.after < BESIDE)
    }

    fn finish(self) -> RecordedMotion {
        let Self { before, rows, last, row: count, .. } = self;
        let span = rows.kept.first().zip(last.as_ref()).map(|(first, last)| last.0 - first.0);
        let spacing = span.filter(|_| count > 1).map(|span| span / (count - 1) as f64);
        let ends = rows.kept.last().map(|(time, _)| *time);
        let last = last.filter(|(time, _)| ends.is_none_or(|end| *time > end));
        RecordedMotion { rows: before.into_iter().chain(rows.kept).chain(last).collect(), spacing }
    }
}

/// The nodes of a table with these columns, in their order.
fn nodes_of_columns(path: &Path, columns: &[String]) -> Result<Vec<usize>> {
    let node = |name: &String| name.strip_prefix('x')?.strip_suffix("_m")?.parse().ok();
    let nodes: Option<Vec<usize>> = columns.iter().skip(1).step_by(2).map(node).collect();
    let nodes = nodes.filter(|nodes| columns.len() == 1 + 2 * nodes.len());
    nodes.ok_or_else(|| unreadable(path, "its columns are not time_s, x0_m, y0_m …; run the scene again"))
}

impl NodeTable {
    /// That of the run in a folder.
    fn at(folder: &Path) -> Self {
        let csv = folder.join("nodes.csv");
        if csv.is_file() {
            return Self::Csv(csv);
        }
        #[cfg(feature = "parquet")]
        {
            let parquet = folder.join("nodes.parquet");
            if parquet.is_file() {
                return Self::Parquet(parquet);
            }
        }
        Self::None
    }

    /// The recorded nodes from the head to the tip.
    fn nodes(&self) -> Result<Vec<usize>> {
        let mut nodes = match self {
            Self::Csv(path) => nodes_of_columns(path, &open_table(path)?.1)?,
            #[cfg(feature = "parquet")]
            Self::Parquet(path) => {
                let mut found = Vec::new();
                super::parquet::visit_nodes(path, &mut |_, nodes| {
                    found = nodes.iter().filter_map(|(node, _)| usize::try_from(*node).ok()).collect();
                    Ok(false)
                })?;
                found
            }
            Self::Memory(_, positions) => positions.nodes.clone(),
            Self::None => Vec::new(),
        };
        nodes.sort_unstable();
        Ok(nodes)
    }

    fn start(&self) -> Result<Option<f64>> {
        match self {
            Self::Csv(path) => {
                let (mut table, columns) = open_table(path)?;
                let mut row = StringRecord::new();
                let there = next_row(path, &mut table, &mut row)?;
                there.then(|| field(path, &row, &columns, 0)).transpose()
            }
            #[cfg(feature = "parquet")]
            Self::Parquet(path) => {
                let mut first = None;
                super::parquet::visit_nodes(path, &mut |time, _| {
                    first = Some(time);
                    Ok(false)
                })?;
                Ok(first)
            }
            Self::Memory(times, _) => Ok(times.first().copied()),
            Self::None => Ok(None),
        }
    }

    fn visit(&self, rows: &mut WindowBuilder) -> Result<()> {
        match self {
            Self::Csv(path) => {
                let (mut table, columns) = open_table(path)?;
                let nodes = ascending(&nodes_of_columns(path, &columns)?);
                let count = nodes.len();
                let mut row = StringRecord::new();
                while next_row(path, &mut table, &mut row)? {
                    let number = |k: usize| field(path, &row, &columns, k);
                    if !rows.take(number(0)?, count, |k| Ok([number(1 + 2 * nodes[k])?, number(2 + 2 * nodes[k])?]))? {
                        break;
                    }
                }
                Ok(())
            }
            #[cfg(feature = "parquet")]
            Self::Parquet(path) => {
                super::parquet::visit_nodes(path, &mut |time, nodes| rows.take(time, nodes.len(), |k| Ok(nodes[k].1)))
            }
            Self::Memory(times, NodePositions { nodes, x, y }) => {
                let (count, order) = (nodes.len(), ascending(nodes));
                for (row, time) in times.iter().enumerate() {
                    let at = |k: usize| row * count + order[k];
                    if !rows.take(*time, count, |k| Ok([x[at(k)], y[at(k)]]))? {
                        break;
                    }
                }
                Ok(())
            }
            Self::None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]
    use super::*;

    #[test]
    fn a_scene_is_read_back_from_a_page_with_its_signs_and_overrides() {
        let text = "name = \"a<b & 'c' > d/e &lt; \\\"f\\\"\"\n[rod]\nnodes = 9\n[solver]\n# overridden: rod.nodes=3";
        let page_of = |overrides: &[&str]| {
            let template =
                include_str!("page.html").split_once("<h2>Scene</h2>").unwrap().1.split_once("</pre>").unwrap().0;
            let content = serde_json::json!({ "scene": text, "overrides": overrides });
            super::super::page::render(&format!("<h2>Scene</h2>{template}</pre>"), &content).unwrap()
        };
        for overrides in [&[][..], &["rod.nodes=17"], &["rod.nodes=17", "solver.integrator=\"newmark\""]] {
            let document = scene_on_page(Path::new("a.toml"), &page_of(overrides)).unwrap();
            assert_eq!(document.text(), text, "a comment of the scene is none of its overrides");
            assert_eq!(document.overrides(), overrides);
        }
    }

    #[test]
    fn thinned_curves_keep_their_ends_and_velocities_are_slopes() {
        let times: Vec<f64> = (0..10_000).map(|i| 1e-3 * f64::from(i)).collect();
        let columns = vec![
            ("time_s".to_string(), times.clone()),
            ("x_com_m".to_string(), times.iter().map(|t| 3.0 * t).collect()),
            ("y_com_m".to_string(), times.iter().map(|t| -t * t).collect()),
        ];
        let document = Document::new("a.toml", "");
        let run = RecordedRun::in_memory(Map::new(), document, columns, None).unwrap();
        let x = run.curves.curve("time_s", "x_com_m");
        assert!(x.len() <= MAX_SAMPLES + 1 && x.len() > MAX_SAMPLES / 2, "{}", x.len());
        assert_eq!([x[0].0, x[x.len() - 1].0], [0.0, times[9999]]);
        for (t, v) in run.curves.curve("time_s", "vy_com_m_s") {
            assert!((v + 2.0 * t).abs() < 1e-9, "{t} {v}");
        }
        let [x, y] = run.curves.centre_of_mass(1.23456).unwrap();
        assert!((x - 3.0 * 1.23456).abs() < 1e-12 && (y + 1.23456 * 1.23456).abs() < 1e-12);
        assert_eq!(run.curves.centre_of_mass(-1.0), Some([0.0; 2]));
    }

    #[test]
    fn the_centre_of_mass_of_a_long_run_is_known_at_all_of_its_times() {
        // 1000 periods of 100 rows each.
        let times: Vec<f64> = (0..=100_000).map(|i| 1e-2 * f64::from(i)).collect();
        let beat = |t: &f64| 0.1 * (std::f64::consts::TAU * t).sin();
        let columns =
            [("time_s", times.clone()), ("x_com_m", times.iter().map(beat).collect()), ("y_com_m", times.clone())];
        let columns = columns.map(|(name, values)| (name.to_string(), values)).to_vec();
        let run = RecordedRun::in_memory(Map::new(), Document::new("a.toml", ""), columns, None).unwrap();
        let error = |t: f64| (run.curves.centre_of_mass(t).unwrap()[0] - beat(&t)).abs();
        let most = (0..1000).map(|k| error(0.01 + 0.99937 * f64::from(k))).fold(0.0, f64::max);
        assert!(most < 1e-5, "{most} m"); // of an amplitude of 0.1 m
    }
}
