//! Results of a sweep: reads its journals, and writes its table (CSV, Parquet), figures and report.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::de::{DeserializeOwned, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::Value;

use super::axis::{SweepAxis, number};
use super::case_result::CaseResult;
use super::definition::{PAGE, Sweep, TABLE};
use crate::error::{Error, Result};
use crate::files::WrittenFiles;
use crate::jobs::{self, Job, Journal};
use crate::report::cases::{CaseAxis, Cases};
#[cfg(feature = "parquet")]
use crate::report::parquet::parquet_of;
use crate::report::tables::{ColumnType, MixedCsvTable};
use crate::report::{Figure, Folder};

/// From this number of cases on, the table is written as Parquet too.
#[cfg(feature = "parquet")]
const PARQUET_FROM: usize = 1000;

/// Digits that distinguish any two numbers.
const MAX_DIGITS: usize = 17;

/// Results that are still in memory and need not be read from the journal. Their number is limited.
#[derive(Debug, Default)]
pub struct RecentResults(BTreeMap<usize, CaseResult>);

impl RecentResults {
    /// About 15 MB.
    const MAX_LEN: usize = 500;

    /// Stores the result of a case, unless the limit is reached.
    pub fn keep(&mut self, index: usize, row: CaseResult) {
        if self.0.len() < Self::MAX_LEN {
            self.0.insert(index, row);
        }
    }
}

/// The results of a sweep, in one journal or in those of its shards.
#[derive(Debug)]
pub struct SweepResults<'a> {
    sweep: &'a Sweep,
    journals: Vec<Journal>,
    fresh: RecentResults,
    /// Index of the journal of each case.
    holder: Vec<Option<usize>>,
}

impl<'a> SweepResults<'a> {
    /// The results in `journals`, all of which must be of the job `job` of the sweep.
    ///
    /// # Errors
    /// [`Error::Journal`] if one is of another job.
    pub fn new(sweep: &'a Sweep, job: &Job, journals: Vec<Journal>) -> Result<Self> {
        let mut holder = vec![None; sweep.size()];
        for (i, journal) in journals.iter().enumerate() {
            if let Some(difference) = job.difference(journal.job()) {
                let problem = format!("it holds results of another sweep, or of other scenes: {difference}");
                return Err(Error::Journal { path: journal.path().to_path_buf(), problem });
            }
            for index in journal.indices().filter(|index| *index < sweep.size()) {
                holder[index].get_or_insert(i);
            }
        }
        Ok(Self { sweep, journals, fresh: RecentResults::default(), holder })
    }

    /// The same, with some results taken from memory.
    #[must_use]
    pub fn with(self, fresh: RecentResults) -> Self {
        Self { fresh, ..self }
    }

    /// The cases without a result.
    pub fn missing(&self) -> impl Iterator<Item = usize> {
        (0..self.holder.len()).filter(|index| self.holder[*index].is_none())
    }

    /// The results in the order of the cases, without missing ones.
    pub fn rows(&self) -> impl Iterator<Item = Result<(usize, Cow<'_, CaseResult>)>> {
        self.read(Cow::Borrowed, Cow::Owned)
    }

    /// Applies `kept` to the results in memory and `read` to the others, deserialised as `T`.
    fn read<'b, T: DeserializeOwned, R>(
        &'b self,
        kept: impl Fn(&'b CaseResult) -> R,
        read: impl Fn(T) -> R,
    ) -> impl Iterator<Item = Result<(usize, R)>> {
        let row = move |(index, holder): (usize, &Option<usize>)| {
            let journal = &self.journals[(*holder)?];
            let row = match self.fresh.0.get(&index) {
                Some(row) => Ok(kept(row)),
                None => journal.get(index).transpose()?.map(&read),
            };
            Some(row.map(|row| (index, row)))
        };
        self.holder.iter().enumerate().filter_map(row)
    }

    /// Writes table, figures and report to `folder`, in this order, each atomically.
    ///
    /// # Errors
    /// [`Error::Journal`], [`Error::Read`].
    pub fn write(&self, folder: &mut Folder) -> Result<WrittenSweep> {
        let path = folder.path().to_path_buf();
        let sweep = self.sweep;
        // The first pass collects the columns and the data for figures and page.
        let mut names: Vec<(String, Option<ColumnType>)> = Vec::new();
        let mut cases = self.cases();
        let mut own = vec![None; sweep.columns().len()];
        for row in self.rows() {
            let (index, row) = row?;
            for (i, (name, value)) in row.quantities.iter().enumerate() {
                match place(&names, i, name) {
                    Some(at) => names[at].1 = ColumnType::widened(names[at].1, value),
                    None => names.push((name.clone(), ColumnType::widened(None, value))),
                }
            }
            let case = sweep.case(index)?;
            for (kind, value) in own.iter_mut().zip(sweep.values(&case)) {
                *kind = ColumnType::widened(*kind, &json(&value));
            }
            match row {
                Cow::Borrowed(row) => {
                    cases.add(index, &case.levels, &row.quantities, row.motion.clone(), row.path.clone())
                }
                Cow::Owned(row) => cases.add(index, &case.levels, &row.quantities, row.motion, row.path),
            }
        }
        // A quantity that is a list in some cases and null in others is a list.
        let lists: Vec<String> =
            names.iter().filter_map(|(name, _)| Some(name.split_once('.')?.0.to_string())).collect();
        names.retain(|(name, _)| !lists.contains(name));
        let number = |name: &str| (name.to_string(), ColumnType::Number);
        let text = |name: &str| (name.to_string(), ColumnType::Text);
        let kind = |(name, kind): (String, Option<ColumnType>)| (name, kind.unwrap_or(ColumnType::Number));
        let own = sweep.columns().into_iter().zip(own);
        let header: Vec<_> = std::iter::once(number("case"))
            .chain(own.map(kind))
            .chain([text("scene_hash"), text("caudal_version")])
            .chain(names.iter().cloned().map(kind))
            .collect();
        let cells = |row: Result<(usize, ResultView<'_>)>| {
            let (index, row) = row?;
            let mut cells = vec![Value::from(index)];
            cells.extend(sweep.values(&sweep.case(index)?).iter().map(json));
            cells.extend([row.scene_hash().into(), env!("CARGO_PKG_VERSION").into()]);
            let found = |(i, (name, _)): (usize, &(String, _))| row.quantity(i, name).cloned().unwrap_or(Value::Null);
            cells.extend(names.iter().enumerate().map(found));
            Ok(cells)
        };
        let columns: Vec<String> = header.iter().map(|(name, _)| name.clone()).collect();
        // Both tables from one pass over the rows.
        let tables = || {
            let mut files = Vec::new();
            let place = path.join(TABLE);
            let mut table = MixedCsvTable::create(&place, &columns);
            let rows =
                self.read(ResultView::Kept, ResultView::Read).map(cells).inspect(|cells: &Result<Vec<Value>>| {
                    let added = match (&mut table, cells) {
                        (Ok(table), Ok(cells)) => table.row(cells),
                        (_, Err(error)) => Err(Error::Journal { path: place.clone(), problem: error.to_string() }),
                        (Err(_), _) => Ok(()),
                    };
                    if let Err(error) = added {
                        table = Err(error);
                    }
                });
            #[cfg(feature = "parquet")]
            let rows = {
                let mut rows = rows;
                if sweep.size() >= PARQUET_FROM {
                    let table = parquet_of(&path.join("table.parquet"), &header, rows.by_ref());
                    files.push(("table.parquet", table));
                }
                rows
            };
            rows.for_each(drop);
            files.push((TABLE, table.and_then(MixedCsvTable::complete)));
            if sweep.record.traces > 0 {
                files.push(("traces.csv", self.traces(&path.join("traces.csv"))));
            }
            files
        };
        let mut made = None;
        let (figures, page) = std::thread::scope(|scope| {
            // If no thread can be started, the tables are written after the page.
            let _ = jobs::spawn(scope, || made = Some(tables()));
            let (figures, left_out) = cases.figures();
            let page = cases.page(&figures, &left_out);
            (figures, page)
        });
        let made = made.unwrap_or_else(tables);
        let mut results = folder.results();
        let figure_files = figures.iter().map(|figure| figure.file.as_str());
        results.list(made.iter().map(|(file, _)| *file).chain(figure_files).chain([PAGE]));
        for (file, table) in made {
            results.put(file, table);
        }
        for Figure { file, svg, .. } in &figures {
            results.put_file(file, Ok(svg));
        }
        results.put_file(PAGE, page);
        let unsettled = cases.unsettled();
        Ok(WrittenSweep { kept: results.finish(), failed: cases.into_endings(), unsettled })
    }

    /// The paths of the centres of mass: one row per case and time.
    fn traces(&self, path: &Path) -> Result<tempfile::NamedTempFile> {
        let header = ["case", "time_s", "x_com_m", "y_com_m"].map(str::to_string);
        let mut table = MixedCsvTable::create(path, &header)?;
        for row in self.rows() {
            let (index, row) = row?;
            for [t, x, y] in &row.trace {
                table.row(&[index.into(), (*t).into(), (*x).into(), (*y).into()])?;
            }
        }
        table.complete()
    }

    /// The cases for figures and page, empty.
    fn cases(&self) -> Cases {
        let sweep = self.sweep;
        let axis = |axis: &SweepAxis| CaseAxis {
            name: axis.name.clone(),
            labels: if axis.sampled { axis.labels.iter().map(label).collect() } else { shown(&axis.labels) },
            numbers: axis.labels.iter().map(number).collect(),
            sampled: axis.sampled,
            logarithmic: axis.logarithmic,
        };
        Cases::new(&sweep.name, sweep.axes.iter().map(axis).collect(), sweep.split, sweep.size(), sweep.text())
    }
}

/// What was written.
#[derive(Debug)]
pub struct WrittenSweep {
    /// The files.
    pub kept: WrittenFiles,
    /// Endings of the cases that did not reach their end.
    pub failed: BTreeMap<usize, String>,
    /// How many cases are not periodic yet.
    pub unsettled: usize,
}

/// The part of a [`CaseResult`] that a table needs.
enum ResultView<'a> {
    /// In memory.
    Kept(&'a CaseResult),
    /// Read from a journal.
    Read(ResultRead),
}

impl ResultView<'_> {
    fn scene_hash(&self) -> &str {
        match self {
            Self::Kept(row) => &row.scene_hash,
            Self::Read(row) => &row.scene_hash,
        }
    }

    /// The quantity `name`, which is at index `near` in most results.
    fn quantity(&self, near: usize, name: &str) -> Option<&Value> {
        match self {
            Self::Kept(row) => row.quantities.get(name),
            Self::Read(row) => place(&row.quantities, near, name).map(|at| &row.quantities[at].1),
        }
    }
}

#[derive(Deserialize)]
struct ResultRead {
    scene_hash: String,
    #[serde(deserialize_with = "in_order")]
    quantities: Vec<(String, Value)>,
}

/// The entries of a map, in order.
fn in_order<'de, D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Vec<(String, Value)>, D::Error> {
    struct Entries;
    impl<'de> Visitor<'de> for Entries {
        type Value = Vec<(String, Value)>;

        fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            f.write_str("a map")
        }

        fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<Self::Value, A::Error> {
            let mut entries = Vec::new();
            while let Some(entry) = map.next_entry()? {
                entries.push(entry);
            }
            Ok(entries)
        }
    }
    deserializer.deserialize_map(Entries)
}

/// The index of the entry `name`: usually `near`.
fn place<T>(entries: &[(String, T)], near: usize, name: &str) -> Option<usize> {
    let there = entries.get(near).is_some_and(|(other, _)| other == name);
    if there { Some(near) } else { entries.iter().position(|(other, _)| other == name) }
}

/// A level as text for tables and axes.
fn label(value: &toml::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_string)
}

/// Digits of a level on the page, if they are enough to distinguish it from the others.
const LEVEL_DIGITS: usize = 5;

/// The displayed labels of levels: long numbers with as few digits as distinguish them.
fn shown(levels: &[toml::Value]) -> Vec<String> {
    let long = 3 + LEVEL_DIGITS;
    let of = |digits: usize| {
        let one = |level: &toml::Value| match level {
            toml::Value::Float(x) if label(level).len() > long => {
                label(&toml::Value::Float(format!("{x:.*e}", digits - 1).parse().unwrap_or(*x)))
            }
            _ => label(level),
        };
        levels.iter().map(one).collect::<Vec<_>>()
    };
    let apart = |labels: &Vec<String>| labels.iter().collect::<BTreeSet<_>>().len() == labels.len();
    (LEVEL_DIGITS..MAX_DIGITS).map(of).find(apart).unwrap_or_else(|| of(MAX_DIGITS))
}

/// A value of a scene for a table cell: numbers, strings and booleans as they are, others as TOML.
fn json(value: &toml::Value) -> Value {
    match value {
        toml::Value::Integer(x) => (*x).into(),
        toml::Value::Float(x) => (*x).into(),
        toml::Value::Boolean(x) => (*x).into(),
        other => label(other).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_shown_in_as_few_digits_as_tell_them_apart() {
        let floats = |values: &[f64]| shown(&values.iter().map(|x| toml::Value::Float(*x)).collect::<Vec<_>>());
        assert_eq!(floats(&[0.1, 0.1 + 0.2, 0.1 + 0.8 / 3.0]), ["0.1", "0.3", "0.36667"]);
        assert_eq!(floats(&[1.0000001, 1.0000002]), ["1.0000001", "1.0000002"]);
        assert_eq!(shown(&["a long label of a level".into(), 3.into()]), ["a long label of a level", "3"]);
    }
}
