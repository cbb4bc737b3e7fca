//! The journal of a job: its results on disk, one line each, written as soon as each is finished.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::de::{DeserializeOwned, IgnoredAny};
use serde::{Deserialize, Serialize};
use twox_hash::{XxHash3_64, XxHash3_128};

use crate::error::{Error, Result};
use crate::files::write_error;
use crate::wording::Phrase;

/// Interval between flushes to disk: a power failure loses at most the results of about this time.
const SYNC_INTERVAL: Duration = Duration::from_secs(1);

/// Version and build of this program: results of different builds are not mixed.
pub const BUILD: &str = env!("CAUDAL_BUILD");

/// XXH3 hash, 128 bits in hexadecimal.
pub fn hash(text: &[u8]) -> String {
    format!("{:032x}", XxHash3_128::oneshot(text))
}

/// The identity of a job: journals of the same job have equal values.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Job {
    /// Kind and name of the work.
    pub name: String,
    /// Hash of all inputs of the results, see [`hash`].
    pub hash: String,
    /// Version and build of the program, see [`BUILD`].
    pub caudal_version: String,
    /// Number of results of the whole job.
    pub size: usize,
    /// Description of what is stored per result.
    #[serde(default)]
    pub kept: String,
}

impl Job {
    /// The job `name` of this build with `size` results, which depend on `inputs` only.
    pub fn new(name: &str, inputs: &[u8], size: usize) -> Self {
        let caudal_version = BUILD.to_string();
        Self { name: name.to_string(), hash: hash(inputs), caudal_version, size, kept: String::new() }
    }

    /// A description of the difference from `other`; `None` if both are the same.
    pub fn difference(&self, other: &Self) -> Option<String> {
        let differs = |what: &str, mine: &str, its: &str| (mine != its).then(|| format!("{what} {its}, now {mine}"));
        differs("of", &self.name, &other.name)
            .or_else(|| differs("made by caudal", &self.caudal_version, &other.caudal_version))
            .or_else(|| differs("with", &self.kept, &other.kept))
            .or_else(|| differs("with", &format!("{} cases", self.size), &format!("{} cases", other.size)))
            .or_else(|| differs("of inputs with the hash", &self.hash, &other.hash))
    }
}

/// A result in one line.
#[derive(Serialize, Deserialize)]
struct JournalEntry<T> {
    index: usize,
    result: T,
}

/// The first line of a file.
#[derive(Debug, PartialEq)]
enum FirstLine {
    Job(Job),
    /// Missing or incomplete.
    Torn,
    /// Not the first line of a journal.
    Other,
}

/// File descriptors of the journals that this process has locked.
#[cfg(unix)]
static HELD: std::sync::Mutex<Vec<i32>> = std::sync::Mutex::new(Vec::new());

/// File descriptors of the journals that this process has locked. A forked process shares the locks, which last until all copies
/// are closed, so it must replace these descriptors.
#[cfg(unix)]
pub fn held_descriptors() -> Vec<i32> {
    // The list may have been locked by another thread when the process was forked, and is then never unlocked.
    HELD.try_lock().map(|held| held.clone()).unwrap_or_default()
}

/// Records whether `file` is locked.
fn note_held(file: &File, held: bool) {
    #[cfg(unix)]
    {
        use std::os::fd::AsRawFd;
        let descriptor = file.as_raw_fd();
        let mut all = HELD.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        all.retain(|own| *own != descriptor);
        all.extend(held.then_some(descriptor));
    }
    #[cfg(not(unix))]
    let _ = (file, held);
}

/// The error for a journal at `path` of another job, with the `difference` between the two.
pub(crate) fn of_another_job(path: &Path, difference: &str) -> Error {
    let remedy = format!("finish that one, {}, or {}", Phrase::OtherFolder, Phrase::Restart);
    journal_error(path, format!("it holds the results of another job: {difference}; {remedy}"))
}

/// The error for a journal at `path` that another program has locked, with its process IDs if the system reports them.
fn held_by_others(path: &Path) -> Error {
    let own = std::process::id();
    let path_of = |pid: u32| PathBuf::from(format!("/proc/{pid}"));
    let journal = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
    let opens = |pid: u32| {
        let descriptors = std::fs::read_dir(path_of(pid).join("fd")).into_iter().flatten().flatten();
        descriptors.filter(|entry| std::fs::read_link(entry.path()).is_ok_and(|file| file == journal)).count()
    };
    let all = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let others = all.filter_map(|entry| entry.file_name().to_str()?.parse().ok()).filter(|pid| *pid != own);
    let named = |pid: u32| {
        let name = std::fs::read_to_string(path_of(pid).join("comm")).unwrap_or_default();
        format!("{pid} ({})", name.trim())
    };
    let holders: Vec<String> = others.filter(|pid| opens(*pid) > 0).map(named).collect();
    let who = match (holders.len(), opens(own)) {
        (0, 2..) => "this process is already using it".to_string(),
        (0, _) => "another program is using it".to_string(),
        (1, _) => format!("process {} is using it", holders[0]),
        _ => format!("the processes {} are using it", holders.join(", ")),
    };
    journal_error(path, format!("{who}; wait until it has finished, or stop a process that was left behind"))
}

/// Results on disk. At most one program at a time has the journal open for writing.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    job: Job,
    /// Offset of the line of each result.
    lines: BTreeMap<usize, u64>,
    end: u64,
    synced: Instant,
}

impl Journal {
    /// Opens or creates the journal of `job` at `path`. An incomplete last line is removed.
    ///
    /// # Errors
    /// [`Error::Journal`] if it belongs to another job or is locked by another program; [`Error::Write`].
    pub fn open(path: &Path, job: &Job) -> Result<Self> {
        let failed = |e: std::io::Error| write_error(path, &e);
        let file = OpenOptions::new().read(true).append(true).create(true).open(path).map_err(failed)?;
        match file.try_lock() {
            Ok(()) => note_held(&file, true),
            Err(TryLockError::WouldBlock) => return Err(held_by_others(path)),
            // Not all file systems support locks.
            Err(TryLockError::Error(_)) => {}
        }
        let mut journal = Self {
            path: path.to_path_buf(),
            file,
            job: job.clone(),
            lines: BTreeMap::new(),
            end: 0,
            synced: Instant::now(),
        };
        let found = journal.scan()?;
        if found == FirstLine::Torn {
            journal.file.set_len(0).map_err(failed)?; // no result is lost by starting again
        }
        match found {
            FirstLine::Job(found) => {
                if let Some(difference) = job.difference(&found) {
                    return Err(of_another_job(path, &difference));
                }
            }
            FirstLine::Torn => {
                if let Err(error) = journal.line(&job.clone()) {
                    let _ = std::fs::remove_file(path); // it is empty
                    return Err(error);
                }
            }
            FirstLine::Other => {
                let problem = format!("it is not a journal of results, or its header is damaged; {}", Phrase::Restart);
                return Err(journal_error(path, problem));
            }
        }
        let end = journal.end;
        journal.file.set_len(end).map_err(failed)?;
        Ok(journal)
    }

    /// Removes the journal at `path`, damaged or not.
    ///
    /// # Errors
    /// [`Error::Journal`] if it is another kind of file or is locked by another program; [`Error::Read`], [`Error::Write`].
    pub fn clear(path: &Path) -> Result<()> {
        let failed = |e: std::io::Error| Error::Read { path: path.to_path_buf(), reason: e.to_string() };
        let file = File::open(path).map_err(failed)?;
        if let Err(TryLockError::WouldBlock) = file.try_lock() {
            return Err(held_by_others(path));
        }
        let mut lines = BufReader::new(&file).split(b'\n').peekable();
        let empty = lines.peek().is_none();
        // A damaged journal has some complete line, or its only line begins like one.
        let known = |line: std::io::Result<Vec<u8>>| {
            line.is_ok_and(|line| checked_json(&line).is_some() || line.get(16..18) == Some(b" {"))
        };
        if !empty && !lines.any(known) {
            return Err(journal_error(path, "it is not a journal of results, and is not removed".to_string()));
        }
        std::fs::remove_file(path).map_err(|e| write_error(path, &e))
    }

    /// Opens a journal for reading.
    ///
    /// # Errors
    /// [`Error::Read`]; [`Error::Journal`] if it is not a journal.
    pub fn read(path: &Path) -> Result<Self> {
        Self::read_begun(path)?.ok_or_else(|| journal_error(path, "it has no results yet".to_string()))
    }

    /// The same as [`read`](Self::read); `None` if the file is empty or its first line is incomplete.
    ///
    /// # Errors
    /// Errors of [`read`](Self::read).
    pub fn read_begun(path: &Path) -> Result<Option<Self>> {
        let file = File::open(path).map_err(|e| Error::Read { path: path.to_path_buf(), reason: e.to_string() })?;
        let job = Job::new("", b"", 0);
        let mut journal =
            Self { path: path.to_path_buf(), file, job, lines: BTreeMap::new(), end: 0, synced: Instant::now() };
        journal.job = match journal.scan()? {
            FirstLine::Job(job) => job,
            FirstLine::Torn => return Ok(None),
            FirstLine::Other => return Err(journal_error(path, "it is not a journal of results".to_string())),
        };
        Ok(Some(journal))
    }

    /// Finds all complete lines; returns the first one. Incomplete lines are ignored.
    fn scan(&mut self) -> Result<FirstLine> {
        let failed = |e: std::io::Error| Error::Read { path: self.path.clone(), reason: e.to_string() };
        let mut reader = BufReader::new(&self.file);
        reader.rewind().map_err(failed)?;
        let (mut line, mut at, mut job) = (Vec::new(), 0, FirstLine::Torn);
        while reader.read_until(b'\n', &mut line).map_err(failed)? > 0 {
            let json = line_json(&line);
            if at == 0 {
                let Some(first) = json.and_then(|json| serde_json::from_slice::<Job>(json).ok()) else {
                    let torn = !line.ends_with(b"\n") && line.iter().take(16).all(u8::is_ascii_hexdigit);
                    return Ok(if torn { FirstLine::Torn } else { FirstLine::Other });
                };
                job = FirstLine::Job(first);
            } else if let Some(entry) =
                json.and_then(|json| serde_json::from_slice::<JournalEntry<IgnoredAny>>(json).ok())
            {
                self.lines.entry(entry.index).or_insert(at);
            }
            if line.ends_with(b"\n") {
                self.end = at + line.len() as u64;
            }
            at += line.len() as u64;
            line.clear();
        }
        Ok(job)
    }

    /// True if a program has it open for writing.
    pub fn is_held(&self) -> bool {
        matches!(self.file.try_lock(), Err(TryLockError::WouldBlock))
    }

    /// The job that it belongs to.
    pub fn job(&self) -> &Job {
        &self.job
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// True if it has the result of `index`.
    pub fn has(&self, index: usize) -> bool {
        self.lines.contains_key(&index)
    }

    /// The indices of its results, in increasing order.
    pub fn indices(&self) -> impl Iterator<Item = usize> {
        self.lines.keys().copied()
    }

    /// The result of `index`, if any.
    ///
    /// # Errors
    /// [`Error::Read`]; [`Error::Journal`] if its line is damaged or of another type.
    pub fn get<T: DeserializeOwned>(&self, index: usize) -> Result<Option<T>> {
        let Some(at) = self.lines.get(&index) else { return Ok(None) };
        let failed = |e: std::io::Error| Error::Read { path: self.path.clone(), reason: e.to_string() };
        let mut reader = BufReader::new(&self.file);
        reader.seek(SeekFrom::Start(*at)).map_err(failed)?;
        let mut line = Vec::new();
        reader.by_ref().read_until(b'\n', &mut line).map_err(failed)?;
        let entry = line_json(&line).and_then(|json| serde_json::from_slice::<JournalEntry<T>>(json).ok());
        let entry =
            entry.ok_or_else(|| journal_error(&self.path, format!("the result of {index} cannot be read back")))?;
        Ok(Some(entry.result))
    }

    /// Appends a result. It is in the file when this returns.
    ///
    /// # Errors
    /// [`Error::Write`]; earlier results remain.
    pub fn add<T: Serialize>(&mut self, index: usize, result: T) -> Result<()> {
        let at = self.end;
        self.line(&JournalEntry { index, result })?;
        self.lines.insert(index, at);
        Ok(())
    }

    /// Appends the result in a `line` that another program created with [`line()`]. Returns its index, and false if a result with
    /// that index existed already, which is kept.
    ///
    /// # Errors
    /// [`Error::Journal`] for a damaged line or one that does not belong to this job; [`Error::Write`].
    pub fn add_line(&mut self, line: &[u8]) -> Result<(usize, bool)> {
        let entry = line_json(line).and_then(|json| serde_json::from_slice::<JournalEntry<IgnoredAny>>(json).ok());
        let index = entry.map(|entry| entry.index).filter(|index| *index < self.job.size);
        let index =
            index.ok_or_else(|| journal_error(&self.path, "a line that was sent to it is damaged".to_string()))?;
        if self.has(index) {
            return Ok((index, false));
        }
        let at = self.end;
        self.write(line)?;
        self.lines.insert(index, at);
        Ok((index, true))
    }

    fn line(&mut self, content: &impl Serialize) -> Result<()> {
        let line = line_of(content).map_err(|reason| Error::Write { path: self.path.clone(), reason })?;
        self.write(&line)
    }

    fn write(&mut self, line: &[u8]) -> Result<()> {
        let failed = |e: &std::io::Error| write_error(&self.path, e);
        if let Err(error) = self.file.write_all(line) {
            let _ = self.file.set_len(self.end); // removes an incomplete line
            return Err(failed(&error));
        }
        self.end += line.len() as u64;
        if self.synced.elapsed() > SYNC_INTERVAL {
            self.sync()?;
        }
        Ok(())
    }

    /// Flushes the file to disk.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn sync(&mut self) -> Result<()> {
        self.file.sync_data().map_err(|e| write_error(&self.path, &e))?;
        self.synced = Instant::now();
        Ok(())
    }
}

impl Drop for Journal {
    /// Unlocks the file, even if a process that was forked meanwhile still has it open.
    fn drop(&mut self) {
        note_held(&self.file, false);
        let _ = self.file.unlock();
    }
}

/// Serialises a result as a line for [`Journal::add_line`] of another program; `None` if it cannot be serialised as JSON.
pub fn line<T: Serialize>(index: usize, result: T) -> Option<Vec<u8>> {
    line_of(&JournalEntry { index, result }).ok()
}

/// The index and the result in a [`line()`]; `None` if it is damaged.
pub fn read_line<T: DeserializeOwned>(line: &[u8]) -> Option<(usize, T)> {
    let entry: JournalEntry<T> = serde_json::from_slice(line_json(line)?).ok()?;
    Some((entry.index, entry.result))
}

/// Serialises a line with checksum and newline.
fn line_of(content: &impl Serialize) -> std::result::Result<Vec<u8>, String> {
    let json = serde_json::to_vec(content).map_err(|e| e.to_string())?;
    let mut line = format!("{:016x} ", XxHash3_64::oneshot(&json)).into_bytes();
    line.extend(json);
    line.push(b'\n');
    Ok(line)
}

/// The JSON of a complete line.
fn line_json(line: &[u8]) -> Option<&[u8]> {
    checked_json(line.strip_suffix(b"\n")?)
}

/// The JSON of a line without newline, if its checksum is correct.
fn checked_json(line: &[u8]) -> Option<&[u8]> {
    let (checksum, json) = line.split_at_checked(16)?;
    let json = json.strip_prefix(b" ")?;
    let checksum = u64::from_str_radix(std::str::from_utf8(checksum).ok()?, 16).ok()?;
    (checksum == XxHash3_64::oneshot(json)).then_some(json)
}

fn journal_error(path: &Path, problem: String) -> Error {
    Error::Journal { path: path.to_path_buf(), problem }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]
    use super::*;

    #[test]
    fn a_journal_cut_at_any_byte_goes_on_with_the_results_that_were_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("results.journal");
        let job = Job::new("test", b"inputs", 3);
        let mut ends = Vec::new();
        {
            let mut journal = Journal::open(&path, &job).unwrap();
            ends.push(journal.end);
            for (index, x) in [(2, 0.1 + 0.2), (0, f64::MIN_POSITIVE), (1, -1e300)] {
                journal.add(index, x).unwrap();
                ends.push(journal.end);
            }
        }
        let whole = std::fs::read(&path).unwrap();
        for length in 0..=whole.len() {
            std::fs::write(&path, &whole[..length]).unwrap();
            let mut journal = Journal::open(&path, &job).unwrap();
            let expected = ends[1..].iter().filter(|end| **end <= length as u64).count();
            assert_eq!(journal.indices().count(), expected, "cut at {length}");
            for (index, x) in [(2, 0.1 + 0.2), (0, f64::MIN_POSITIVE), (1, -1e300)] {
                match journal.get::<f64>(index).unwrap() {
                    Some(found) => assert_eq!(found, x),
                    None => journal.add(index, x).unwrap(),
                }
            }
            drop(journal);
            assert_eq!(std::fs::read(&path).unwrap(), whole, "cut at {length}");
        }
    }

    #[test]
    fn a_journal_of_another_job_or_with_a_program_at_work_is_refused_and_one_with_a_damaged_line_loses_only_that() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("results.journal");
        let job = Job::new("test", b"inputs", 3);
        let mut journal = Journal::open(&path, &job).unwrap();
        (0..3).for_each(|index| journal.add(index, index).unwrap());
        let refused = Journal::open(&path, &job).unwrap_err().to_string();
        assert!(refused.contains("using it"), "{refused}");
        drop(journal);
        for other in [Job::new("test", b"others", 3), Job::new("best", b"inputs", 3), Job::new("test", b"inputs", 4)] {
            assert!(Journal::open(&path, &other).unwrap_err().to_string().contains("another job"));
        }
        let mut bytes = std::fs::read(&path).unwrap();
        let damaged = bytes.windows(9).position(|text| text == b"\"index\":1").unwrap();
        bytes[damaged + 8] = b'7';
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(Journal::open(&path, &job).unwrap().indices().collect::<Vec<_>>(), [0, 2]);
        std::fs::write(&path, "precious notes\n").unwrap();
        assert!(Journal::open(&path, &job).is_err());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "precious notes\n");
    }

    #[test]
    fn a_file_that_does_not_begin_as_a_journal_stays_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("results.journal");
        let job = Job::new("test", b"inputs", 3);
        let texts =
            ["notes", "precious notes", "deadbeef and more", "0123456789abcde:", "12 eggs", "x", "{}", "é", " "];
        for text in texts.iter().flat_map(|text| [text.to_string(), format!("{text}\n"), format!("{text}\n{text}")]) {
            std::fs::write(&path, &text).unwrap();
            let opened = Journal::open(&path, &job).map(|_| ());
            assert!(
                opened.is_err_and(|error| error.to_string().contains("it is not a journal of results")),
                "{text:?}"
            );
            let cleared = Journal::clear(&path);
            assert!(cleared.is_err(), "{text:?}");
            assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
        }
    }
}
