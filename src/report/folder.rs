//! Result folders: one program at a time holds a folder, and its manifest states the owner of the results and lists their files.
//!
//! Everything that writes results claims its folder first. Whether the folder is free, which files are replaced or removed, and which
//! journals are continued follow from the manifest alone: a file that it does not list is never touched.

use std::collections::BTreeSet;
use std::fmt;
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use tempfile::NamedTempFile;

use super::tables::CsvTable;
use crate::error::{Error, Result};
use crate::files::{CreatedFolders, PARTIAL, WrittenFiles, partial_file, partial_file_with, persist, write_error};
use crate::jobs::{BUILD, Journal};
use crate::scene::Scene;
use crate::wording::Phrase;

/// Name of the manifest.
pub const MANIFEST: &str = "manifest.json";

/// The subfolder of a run's folder for its VTK files, which has its own manifest.
pub const VTK_FOLDER: &str = "vtk";

/// Extension of journals, which store unfinished work.
pub const JOURNAL: &str = ".journal";

/// Timeout for a lock that others hold only briefly.
const LOCK_TIMEOUT: Duration = Duration::from_secs(10);

/// The owner of results.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Owner {
    /// The kind of results: `run`, `sweep`, `design`, `study modes` …
    pub kind: String,
    /// The name of the scene or the sweep.
    pub name: String,
    /// The file of the scene or sweep.
    pub source: PathBuf,
    /// Hash of its content.
    pub fingerprint: String,
}

impl Owner {
    /// The owner of results of `kind` of a scene.
    pub fn of(kind: &str, scene: &Scene) -> Self {
        let (name, source, fingerprint) = (scene.name.clone(), scene.file(), scene.fingerprint_text());
        Self { kind: kind.to_string(), name, source, fingerprint }
    }

    /// True if kind and name are equal, and the file or its content too.
    fn is_same(&self, other: &Self) -> bool {
        let same_file = self.has_file() && self.source == other.source;
        self.is_namesake(other) && (same_file || self.fingerprint == other.fingerprint)
    }

    /// True if kind and name are equal.
    fn is_namesake(&self, other: &Self) -> bool {
        (&self.kind, &self.name) == (&other.kind, &other.name)
    }

    /// False for a scene that was created in memory, which has no file.
    fn has_file(&self) -> bool {
        self.source.is_absolute()
    }

    /// Describes the existing results of `other`, and those that would replace them, for [`Error::Occupied`].
    fn in_place_of(&self, other: &Self) -> [String; 2] {
        match self.is_namesake(other) {
            false => [other.to_string(), self.to_string()],
            true if self.has_file() || other.has_file() => [
                format!("{other} by another file, {}", other.source.display()),
                format!("by {}", self.source.display()),
            ],
            true => [format!("{other} with other values"), "with these".to_string()],
        }
    }
}

impl fmt::Display for Owner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let article = if self.kind.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" };
        write!(f, "{article} {} of `{}`", self.kind, self.name)
    }
}

/// What a claim does with existing results.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Claim {
    /// Replaces those of the same owner file by file; those of others are an error.
    #[default]
    Own,
    /// Removes those of others.
    Force,
}

impl Claim {
    /// [`Force`](Self::Force) if `force` is set.
    pub fn forced(force: bool) -> Self {
        if force { Self::Force } else { Self::Own }
    }
}

/// What a file is in a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    /// Made by the owner of the folder.
    Result,
    /// Made from results for other programs.
    Export,
}

/// Files that were exported from results for other programs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Export {
    of: Owner,
    files: BTreeSet<String>,
}

/// The content of the manifest.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
struct Manifest {
    /// Version and build of the program that wrote it.
    caudal_build: String,
    /// The owner; `None` if there are only exports.
    #[serde(default)]
    owner: Option<Owner>,
    /// Source files that were written here too; they stay as long as the owner.
    #[serde(default)]
    sources: BTreeSet<String>,
    /// The files of the results, some of which may not exist yet.
    #[serde(default)]
    files: BTreeSet<String>,
    /// Journals of unfinished work.
    #[serde(default)]
    journals: BTreeSet<String>,
    #[serde(default)]
    exports: Vec<Export>,
}

impl Manifest {
    /// The manifest of the folder at `path`; `None` if there is none.
    fn read(path: &Path) -> Result<Option<Self>> {
        let file = path.join(MANIFEST);
        match std::fs::read(&file) {
            Ok(bytes) => match serde_json::from_slice::<Self>(&bytes) {
                // Listed files may be removed later, so they must be in this folder.
                Ok(manifest) if manifest.all().all(|name| Path::new(name).file_name() == Some(name.as_ref())) => {
                    Ok(Some(manifest))
                }
                _ => {
                    let reason =
                        format!("it is no manifest of results; {}, or {}", Phrase::OtherFolder, Phrase::Replace);
                    Err(Error::Read { path: file, reason })
                }
            },
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(Error::Read { path: file, reason: e.to_string() }),
        }
    }

    /// The description of a file of the owner; `None` for exports, and for files that it does not list.
    fn result(&self, name: &str) -> Option<String> {
        let lists = [&self.sources, &self.files, &self.journals].iter().any(|files| files.contains(name));
        let of = || self.owner.as_ref().map_or_else(|| "a result".to_string(), |of| format!("a file of {of}"));
        (lists || name == MANIFEST).then(of)
    }

    fn lists(&self, name: &str) -> bool {
        self.all().any(|listed| listed == name)
    }

    /// All files that it lists.
    fn all(&self) -> impl Iterator<Item = &String> {
        let exports = self.exports.iter().flat_map(|export| &export.files);
        self.sources.iter().chain(&self.files).chain(&self.journals).chain(exports)
    }
}

/// A claimed folder of results. If it was created and nothing was written to it, it is removed again, along with its created
/// parents.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    lock: Option<File>,
    owner: Owner,
    claim: Claim,
    manifest: Manifest,
    /// True if this claim created the manifest.
    new: bool,
    made: CreatedFolders,
}

impl Folder {
    /// Claims the folder at `path` for results of `owner`, which will have at least the files `certain`. The claim lasts until it
    /// is dropped.
    ///
    /// # Errors
    /// [`Error::Busy`] if another program has claimed it; [`Error::Occupied`] if it has results of others, or unlisted files of
    /// these names, unless the claim is forced; [`Error::Read`], [`Error::Write`].
    pub fn claim(path: &Path, owner: Owner, claim: Claim, certain: &[&str]) -> Result<Self> {
        Self::claim_within(path, owner, claim, certain, Duration::ZERO)
    }

    /// The same for folders that programs share ([`let_others`](Self::let_others)): waits for brief claims of others.
    ///
    /// # Errors
    /// Those of [`claim`](Self::claim).
    pub fn claim_shared(path: &Path, owner: Owner, claim: Claim, certain: &[&str]) -> Result<Self> {
        Self::claim_within(path, owner, claim, certain, LOCK_TIMEOUT)
    }

    fn claim_within(path: &Path, owner: Owner, claim: Claim, certain: &[&str], patience: Duration) -> Result<Self> {
        let mut folder = Self::hold(path, owner, claim, patience)?;
        folder.check(certain)?;
        folder.clear_leftovers();
        let others = folder.manifest.owner.as_ref().is_some_and(|other| !other.is_same(&folder.owner));
        if folder.new || others || folder.manifest.owner.is_none() {
            folder.manifest.owner = Some(folder.owner.clone());
            folder.save()?; // from now on it is ours, whatever ends this
            if others {
                folder.remove(folder.manifest.all());
                folder.manifest = Manifest { owner: Some(folder.owner.clone()), ..Manifest::default() };
            }
        } else {
            partial_file(&folder.path.join(MANIFEST))?; // so that what cannot be written is known before the work
        }
        Ok(folder)
    }

    /// Claims the folder at `path` to add exports of `owner` to existing results.
    ///
    /// # Errors
    /// [`Error::Busy`], [`Error::Read`], [`Error::Write`].
    pub fn export(path: &Path, owner: Owner, claim: Claim) -> Result<Self> {
        let folder = Self::hold(path, owner, claim, LOCK_TIMEOUT)?;
        folder.clear_leftovers();
        Ok(folder)
    }

    /// Creates and locks it, and reads its manifest.
    fn hold(path: &Path, owner: Owner, claim: Claim, patience: Duration) -> Result<Self> {
        let (made, manifest) = (CreatedFolders::at(path)?, Manifest::default());
        let mut folder = Self { path: path.to_path_buf(), lock: None, owner, claim, manifest, new: false, made };
        folder.lock(patience)?;
        folder.read()?;
        Ok(folder)
    }

    /// Waits for the lock, at most for `patience`.
    fn lock(&mut self, patience: Duration) -> Result<()> {
        let begun = Instant::now();
        loop {
            std::fs::create_dir_all(&self.path).map_err(|e| write_error(&self.path, &e))?;
            // On systems where folders cannot be opened or locked, journals have their own locks.
            let Ok(handle) = File::open(&self.path) else { return Ok(()) };
            match handle.try_lock() {
                Err(TryLockError::WouldBlock) if begun.elapsed() < patience => {
                    std::thread::sleep(Duration::from_millis(5));
                    continue;
                }
                Err(TryLockError::WouldBlock) => {
                    self.made = CreatedFolders::default(); // the other program owns it
                    return Err(Error::Busy { path: self.path.clone() });
                }
                Ok(()) | Err(TryLockError::Error(_)) => {}
            }
            // A folder that was removed meanwhile is created again.
            if is_at(&handle, &self.path) {
                self.lock = Some(handle);
                return Ok(());
            }
        }
    }

    fn read(&mut self) -> Result<()> {
        let found = Manifest::read(&self.path);
        let found = if self.claim == Claim::Force { found.unwrap_or_default() } else { found? };
        self.new = found.is_none();
        self.manifest = found.unwrap_or_default();
        Ok(())
    }

    /// Checks that the claim is allowed.
    fn check(&self, certain: &[&str]) -> Result<()> {
        let Self { manifest, owner, claim, .. } = self;
        let there = |name: &str| self.path.join(name).exists();
        let other = manifest.owner.as_ref().filter(|other| !other.is_same(owner));
        let other = other.filter(|_| manifest.all().any(|name| there(name)));
        if other.is_some() || *claim == Claim::Force {
            let held = |name: &&String| Journal::read(&self.path.join(name)).is_ok_and(|journal| journal.is_held());
            if manifest.journals.iter().any(|name| held(&name)) {
                return Err(Error::Busy { path: self.path.clone() });
            }
        }
        if *claim == Claim::Force {
            return Ok(());
        }
        let occupied = |holds: String, wanted: String| {
            Err(Error::Occupied { path: self.path.clone(), holds, wanted, kept: false })
        };
        if let Some(other) = other {
            let [holds, wanted] = owner.in_place_of(other);
            return occupied(holds, wanted);
        }
        let foreign: Vec<&str> = certain.iter().copied().filter(|name| there(name) && !manifest.lists(name)).collect();
        match foreign.is_empty() {
            true => Ok(()),
            false => {
                let holds = format!("{}, which no {MANIFEST} lists (an older caudal wrote none)", foreign.join(", "));
                occupied(holds, owner.to_string())
            }
        }
    }

    /// The owner of the results in the folder at `path`, which is only read; `None` without a manifest, or of exports alone.
    ///
    /// # Errors
    /// [`Error::Read`] for a manifest that cannot be read.
    pub fn owner_at(path: &Path) -> Result<Option<Owner>> {
        Ok(Manifest::read(path)?.and_then(|manifest| manifest.owner))
    }

    /// The description of the existing file at `path`, if it is a result in its folder.
    pub fn result_at(path: &Path) -> Option<String> {
        let (folder, name) = (path.parent()?, path.file_name()?.to_string_lossy());
        Manifest::read(folder).ok()??.result(&name).filter(|_| path.exists())
    }

    /// Refuses the path of a file that no export of `owner` may replace, without a claim to its folder.
    ///
    /// # Errors
    /// [`Error::Occupied`]; [`Error::Read`] for a list of files that cannot be read.
    pub fn admit_export(path: &Path, owner: Owner, claim: Claim) -> Result<()> {
        let [Some(folder), Some(name)] = [path.parent(), path.file_name().map(Path::new)] else { return Ok(()) };
        let (manifest, made) = (Manifest::default(), CreatedFolders::default());
        let mut folder = Self { path: folder.to_path_buf(), lock: None, owner, claim, manifest, new: false, made };
        folder.read()?;
        folder.admit_in(Role::Export, &name.to_string_lossy())
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The owner of the claim.
    pub fn owner(&self) -> &Owner {
        &self.owner
    }

    /// Unlocks it for other programs of the same owner.
    pub fn let_others(&mut self) {
        if let Some(lock) = self.lock.take() {
            let _ = lock.unlock();
        }
    }

    /// Locks it again and reads its manifest.
    ///
    /// # Errors
    /// [`Error::Busy`], [`Error::Read`], [`Error::Write`].
    pub fn relock(&mut self) -> Result<()> {
        if self.lock.is_none() {
            self.lock(Duration::MAX)?;
            let new = self.new;
            self.read()?;
            self.new = new;
        }
        Ok(())
    }

    /// Writes source files (names and contents) next to the results.
    ///
    /// # Errors
    /// Those of [`admit`](Self::admit), before anything is written; [`Error::Write`].
    pub fn keep_sources(&mut self, files: &[(String, Vec<u8>)]) -> Result<()> {
        files.iter().try_for_each(|(name, _)| self.admit(name))?;
        let names: BTreeSet<String> = files.iter().map(|(name, _)| name.clone()).collect();
        if !names.is_subset(&self.manifest.sources) {
            self.manifest.sources.extend(names);
            self.save()?;
        }
        for (name, content) in files {
            let path = self.path.join(name);
            persist(partial_file_with(&path, content)?, path)?;
        }
        Ok(())
    }

    /// The path of its journal `name`, which is listed from now on.
    ///
    /// # Errors
    /// [`Error::Occupied`] if there is an unlisted file of that name; [`Error::Write`].
    pub fn journal(&mut self, name: &str) -> Result<PathBuf> {
        self.admit(name)?;
        let path = self.path.join(name);
        if !self.manifest.journals.contains(name) {
            if path.exists() {
                Journal::clear(&path)?; // as the claim is forced
            }
            self.manifest.files.remove(name);
            self.manifest.journals.insert(name.to_string());
            self.save()?;
        }
        Ok(path)
    }

    /// Removes its results, and the journal of this name or, without a name, all journals.
    ///
    /// # Errors
    /// Those of [`Journal::clear`], before anything is removed.
    pub fn begin_anew(&mut self, journal: Option<&str>) -> Result<()> {
        let journals: Vec<String> =
            self.manifest.journals.iter().filter(|name| journal.is_none_or(|own| own == *name)).cloned().collect();
        for path in journals.iter().map(|name| self.path.join(name)).filter(|path| path.exists()) {
            Journal::clear(&path)?;
        }
        self.remove(self.manifest.files.iter());
        self.manifest.files.clear();
        self.manifest.owner = Some(self.owner.clone());
        self.save()
    }

    /// Removes journals of completed work.
    pub fn forget_journals(&mut self) {
        let journals = std::mem::take(&mut self.manifest.journals);
        self.remove(journals.iter());
        let _ = self.save(); // that of before lists what is there, and more
    }

    /// Refuses the name of an existing file that is no result of this owner.
    ///
    /// # Errors
    /// [`Error::Occupied`].
    pub fn admit(&self, name: &str) -> Result<()> {
        self.admit_in(Role::Result, name)
    }

    /// Refuses the name of an existing file that does not have this role, or is of another owner. An export never replaces a result.
    fn admit_in(&self, role: Role, name: &str) -> Result<()> {
        let exported = |export: &Export| export.files.contains(name) && !export.of.is_same(&self.owner);
        let path = self.path.join(name);
        let empty = || std::fs::metadata(&path).is_ok_and(|file| file.is_file() && file.len() == 0);
        if !path.exists() || empty() {
            return Ok(());
        }
        if let Some(holds) = self.manifest.result(name).filter(|_| role == Role::Export) {
            return Err(Error::Occupied { path, holds, wanted: self.owner.to_string(), kept: true });
        }
        if self.claim == Claim::Force {
            return Ok(());
        }
        let [holds, wanted] = match self.manifest.exports.iter().find(|export| exported(export)) {
            Some(export) => self.owner.in_place_of(&export.of),
            None if self.manifest.lists(name) => return Ok(()),
            None => [format!("a file that no {MANIFEST} lists"), self.owner.to_string()],
        };
        Err(Error::Occupied { path, holds, wanted, kept: false })
    }

    /// Starts writing results.
    pub fn results(&mut self) -> FolderWriter<'_> {
        FolderWriter { folder: self, kept: WrittenFiles::default(), role: Role::Result, earlier: BTreeSet::new() }
    }

    /// Starts writing exports.
    pub fn exports(&mut self) -> FolderWriter<'_> {
        FolderWriter { folder: self, kept: WrittenFiles::default(), role: Role::Export, earlier: BTreeSet::new() }
    }

    fn remove<'a>(&self, names: impl Iterator<Item = &'a String>) {
        names.for_each(|name| drop(std::fs::remove_file(self.path.join(name))));
    }

    /// Removes partial files of killed programs: those next to listed files that no program has locked.
    fn clear_leftovers(&self) {
        for entry in std::fs::read_dir(&self.path).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let name = name.to_string_lossy();
            let of = name.strip_prefix('.').and_then(|name| name.strip_suffix(PARTIAL)?.rsplit_once('.'));
            let listed = of.is_some_and(|(of, _)| of == MANIFEST || self.manifest.lists(of));
            let held =
                || File::open(entry.path()).is_ok_and(|file| matches!(file.try_lock(), Err(TryLockError::WouldBlock)));
            if !self.new && listed && !held() {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }

    /// Writes the manifest.
    fn save(&mut self) -> Result<()> {
        self.manifest.caudal_build = BUILD.to_string();
        let path = self.path.join(MANIFEST);
        let text = serde_json::to_string_pretty(&self.manifest).map_err(|e| Error::Page { reason: e.to_string() })?;
        persist(partial_file_with(&path, text + "\n")?, path).map(drop)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let empty = !self.manifest.all().any(|name| self.path.join(name).exists());
        if self.new && empty && self.lock.is_some() {
            let _ = std::fs::remove_file(self.path.join(MANIFEST));
        }
        drop(std::mem::take(&mut self.made)); // while nobody else can have it
        self.let_others(); // though a process that was forked meanwhile may have it open still
    }
}

/// Writes files to a [`Folder`], each atomically; an error in one does not affect the others.
#[derive(Debug)]
pub struct FolderWriter<'a> {
    folder: &'a mut Folder,
    kept: WrittenFiles,
    role: Role,
    /// Files of an earlier result with the same content that could not be replaced.
    earlier: BTreeSet<String>,
}

impl FolderWriter<'_> {
    /// The folder.
    pub fn path(&self) -> &Path {
        &self.folder.path
    }

    /// Lists a file that others write.
    ///
    /// # Errors
    /// [`Error::Occupied`] if there is a file of that name that may not be replaced; [`Error::Write`].
    pub fn admit(&mut self, name: &str) -> Result<()> {
        self.folder.admit_in(self.role, name)?;
        self.folder.enter(&[name], self.role)
    }

    /// Lists several files before they are written.
    pub fn list<'n>(&mut self, names: impl IntoIterator<Item = &'n str>) {
        let Self { folder, role, .. } = self;
        let admitted: Vec<&str> = names.into_iter().filter(|name| folder.admit_in(*role, name).is_ok()).collect();
        let _ = folder.enter(&admitted, *role); // what cannot be listed is told where it is written
    }

    /// Puts the file `name` in place, or records the error. An earlier file of that name is then removed, unless it has the same
    /// content, since it would not belong to the others.
    pub fn put(&mut self, name: &str, file: Result<NamedTempFile>) {
        let path = self.folder.path.join(name);
        if let Err(error) = self.admit(name) {
            self.kept.lost.push(match error {
                Error::Write { reason, .. } => Error::Write { path, reason }, // of the manifest
                other => other,                                               // what is there is not ours
            });
            return;
        }
        match file.and_then(|file| persist(file, path.clone())) {
            Ok(path) => self.kept.files.push(path),
            Err(error) => {
                self.kept.lost.push(error);
                let Folder { manifest, owner, .. } = &*self.folder;
                if manifest.owner.as_ref().is_some_and(|before| before.fingerprint == owner.fingerprint)
                    && path.exists()
                {
                    self.earlier.insert(name.to_string());
                } else {
                    let _ = std::fs::remove_file(path);
                }
            }
        }
    }

    /// The same for a table.
    pub fn put_table(&mut self, table: CsvTable) {
        let name = table.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
        match table.complete() {
            Ok((file, _, lost)) => {
                self.put(&name, Ok(file));
                self.kept.lost.extend(lost);
            }
            Err(error) => self.put(&name, Err(error)),
        }
    }

    /// The same for a file with `content`.
    pub fn put_file(&mut self, name: &str, content: Result<impl AsRef<[u8]>>) {
        let file = content.and_then(|content| partial_file_with(&self.folder.path.join(name), content));
        self.put(name, file);
    }

    /// Writes files (names and texts) in order, so that the first ones exist whatever happens to the others.
    pub fn all(mut self, files: &[(String, String)]) -> WrittenFiles {
        self.list(files.iter().map(|(name, _)| name.as_str()));
        for (name, text) in files {
            self.put_file(name, Ok(text));
        }
        self.finish()
    }

    /// Records an error that truncated a file.
    pub fn note(&mut self, error: Option<Error>) {
        self.kept.lost.extend(error);
    }

    /// Removes files of earlier results that were not written again, and updates the manifest.
    pub fn finish(self) -> WrittenFiles {
        let Self { folder, kept, role, earlier } = self;
        if role == Role::Result {
            let name = |path: &PathBuf| path.file_name().map(|name| name.to_string_lossy().into_owned());
            let written: BTreeSet<String> = kept.files.iter().filter_map(name).chain(earlier).collect();
            folder.remove(folder.manifest.files.difference(&written));
            folder.manifest.files = written;
            folder.remove_outdated_exports();
            folder.manifest.owner = Some(folder.owner.clone());
            let _ = folder.save(); // that of before lists what is there, and more
        }
        kept
    }
}

impl Folder {
    /// Removes films, pictures and VTK files of the results that were here before, if these had another content.
    fn remove_outdated_exports(&mut self) {
        let before = self.manifest.owner.as_ref().filter(|before| before.fingerprint != self.owner.fingerprint);
        let Some(Owner { fingerprint, .. }) = before.cloned() else { return };
        let here = self.path.canonicalize().ok();
        let is_outdated =
            |Export { of, .. }: &Export| of.fingerprint == fingerprint || here.as_ref() == Some(&of.source);
        self.remove_exports(is_outdated);
        let within = self.path.join(VTK_FOLDER);
        if within.join(MANIFEST).is_file()
            && let Ok(mut exported) = Self::export(&within, self.owner.clone(), Claim::Own)
            && exported.remove_exports(is_outdated)
        {
            let _ = exported.save(); // that of before lists what is there, and more
            exported.new = true; // so that it goes where nothing is left
            exported.made = CreatedFolders::adopted(&within);
        }
    }

    /// Removes such exports, and says whether there were any; the manifest is not saved.
    fn remove_exports(&mut self, is_meant: impl Fn(&Export) -> bool) -> bool {
        let exports = std::mem::take(&mut self.manifest.exports);
        let (meant, others): (Vec<_>, Vec<_>) = exports.into_iter().partition(is_meant);
        self.remove(meant.iter().flat_map(|export| &export.files));
        self.manifest.exports = others;
        !meant.is_empty()
    }

    /// Lists files as results or exports, unless they are listed.
    fn enter(&mut self, names: &[&str], role: Role) -> Result<()> {
        let Manifest { files, exports: exported, .. } = &self.manifest;
        let own = exported.iter().find(|export| export.of == self.owner).map(|export| &export.files);
        let there = if role == Role::Export { own } else { Some(files) };
        if names.iter().all(|name| there.is_some_and(|files| files.contains(*name))) {
            return Ok(());
        }
        let before = self.manifest.clone();
        let all = || names.iter().map(ToString::to_string);
        if role == Role::Export {
            // Earlier exports under these names are replaced.
            let exported = &mut self.manifest.exports;
            exported.iter_mut().for_each(|export| export.files.retain(|file| !names.contains(&file.as_str())));
            match exported.iter_mut().find(|export| export.of == self.owner) {
                Some(export) => export.files.extend(all()),
                None => exported.push(Export { of: self.owner.clone(), files: all().collect() }),
            }
            exported.retain(|export| !export.files.is_empty());
        } else {
            self.manifest.files.extend(all());
        }
        self.save().inspect_err(|_| self.manifest = before)
    }
}

/// True if `handle` is the file at `path`.
fn is_at(handle: &File, path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let same = |a: std::fs::Metadata, b: std::fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
        handle.metadata().ok().zip(std::fs::metadata(path).ok()).is_some_and(|(a, b)| same(a, b))
    }
    #[cfg(not(unix))]
    {
        let _ = (handle, path);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::Owner;

    fn owner(kind: &str, source: &str, fingerprint: &str) -> Owner {
        Owner { kind: kind.into(), name: "eel".into(), source: source.into(), fingerprint: fingerprint.into() }
    }

    #[test]
    fn scenes_without_a_file_are_told_apart_by_their_content() {
        assert!(owner("run", "/a/eel.toml", "1").is_same(&owner("run", "/a/eel.toml", "2")));
        assert!(owner("run", "scene", "1").is_same(&owner("run", "scene", "1")));
        let [one, other] = [owner("run", "scene", "1"), owner("run", "scene", "2")];
        assert!(!one.is_same(&other));
        assert_eq!(one.in_place_of(&other), ["a run of `eel` with other values", "with these"]);
    }

    #[test]
    fn files_of_one_name_are_told_apart() {
        let [one, other] = [owner("export", "/a/eel.toml", "1"), owner("export", "/b/eel.toml", "2")];
        assert_eq!(one.in_place_of(&other), ["an export of `eel` by another file, /b/eel.toml", "by /a/eel.toml"]);
    }
}
