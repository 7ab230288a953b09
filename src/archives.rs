//! Which archives a verb works on: the named files, and those in the named folders.
//!
//! [`tapline_store::Folder`] decides which files of a folder count.

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{Builder, available_parallelism, scope};

use anyhow::{Context as _, Result, bail};
use crossbeam::channel::bounded;
use tapline_host::messages::{counted, print_line};
use tapline_host::progress::{Progress, Unit};
use tapline_store::{Folder, Reader, archive_of};

/// Files for each thread before all of them are waited for: their results are kept until those of the files before them are taken.
const AHEAD: usize = 8;

/// Which files of a folder a verb takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Which {
    /// The archives of casings.
    Casings,
    /// The newest results of `tapline reprocess` for each.
    Results,
    /// All of them.
    All,
}

impl Which {
    /// The results, or else the archives.
    pub(crate) fn results_if(is_results: bool) -> Self {
        if is_results { Self::Results } else { Self::Casings }
    }
}

/// A file to work on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ArchiveFile {
    /// Where it is.
    pub path: PathBuf,
    /// Its path within the folder that was named; within the folder that has them all, if several paths were named.
    pub name: PathBuf,
}

impl ArchiveFile {
    /// Its size; 0 if it cannot be read.
    fn bytes(&self) -> u64 {
        self.path.metadata().map_or(0, |there| there.len())
    }

    /// The name of the archive that it is, or whose results it has.
    pub(crate) fn archive(&self) -> PathBuf {
        archive_of(&self.name).unwrap_or_else(|| self.name.clone())
    }

    /// Name of the casing whose archive or results it is: the archive's name without its ending.
    pub(crate) fn casing(&self) -> String {
        self.archive().file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }
}

/// The files to work on.
#[derive(Debug, Clone, Default)]
pub(crate) struct Archives {
    pub files: Vec<ArchiveFile>,
    /// Files of the folders that are not finished.
    pub unfinished: Vec<PathBuf>,
    /// Whether a folder or several files were named: then any output is made of many.
    pub is_many: bool,
}

impl Archives {
    /// The files at `paths`, each once, in the order in which they are named; files of a folder in alphabetical order.
    ///
    /// # Errors
    /// The only path does not exist, a folder without such a file, or a system error.
    pub(crate) fn find<P: AsRef<Path>>(paths: &[P], which: Which) -> Result<Self> {
        let mut found = Self { is_many: paths.len() > 1, ..Self::default() };
        let mut known = BTreeSet::new();
        let roots: Vec<PathBuf> = paths.iter().map(|path| root_of(path.as_ref())).collect();
        let shared = shared_by(&roots);
        for (path, root) in paths.iter().map(AsRef::as_ref).zip(&roots) {
            // Of several, one that is not there is left out like one that cannot be read.
            let is_folder = match path.metadata() {
                Ok(there) => there.is_dir(),
                Err(_) if found.is_many => false,
                Err(error) => return Err(error).with_context(|| format!("cannot read {}", path.display())),
            };
            let files = match is_folder {
                true => {
                    found.is_many = true;
                    found.in_folder(path, which)?
                }
                false => {
                    let name = PathBuf::from(path.file_name().unwrap_or_default());
                    vec![ArchiveFile { path: path.to_owned(), name }]
                }
            };
            // Casings of two days may have the same name.
            let below = root.strip_prefix(&shared).unwrap_or(root);
            let named = files.into_iter().map(|file| ArchiveFile { name: below.join(&file.name), ..file });
            // The same file by another path, or named as well as its folder.
            found
                .files
                .extend(named.filter(|file| known.insert(file.path.canonicalize().unwrap_or(file.path.clone()))));
        }
        Ok(found)
    }

    /// Has `work` done for each file, `jobs` files at a time; `take` gets what came of each, in the order of the files.
    ///
    /// # Errors
    /// The first of `take`, or that a thread cannot be started.
    pub(crate) fn work_on<T: Send>(
        &self,
        jobs: usize,
        work: impl Fn(&ArchiveFile) -> T + Sync,
        mut take: impl FnMut(&ArchiveFile, T) -> Result<()>,
    ) -> Result<()> {
        self.files.chunks(AHEAD * jobs).try_for_each(|files| work_on_some(files, jobs, &work, &mut take))
    }

    /// The files of `folder`.
    fn in_folder(&mut self, folder: &Path, which: Which) -> Result<Vec<ArchiveFile>> {
        let here = Folder::list(folder)?;
        let chosen = match which {
            Which::Casings => here.sorted().archives,
            Which::Results => {
                let sorted = here.sorted();
                let remarks = [sorted.without_results(folder), sorted.mixed_results(folder)];
                remarks.iter().flatten().for_each(|remark| tracing::warn!("{remark}"));
                sorted.newest_results()
            }
            Which::All => here.finished,
        };
        if chosen.is_empty() && (which != Which::All || here.unfinished.is_empty()) {
            bail!("{}{}", nothing_in(folder, which), and_unfinished(here.unfinished.len()));
        }
        self.unfinished.extend(here.unfinished);
        let named = |path: PathBuf| {
            let name = path.strip_prefix(folder).unwrap_or(&path).to_owned();
            ArchiveFile { path, name }
        };
        Ok(chosen.into_iter().map(named).collect())
    }
}

/// [`Archives::work_on`] these `files`, whose results may wait for one another.
///
/// Not by rayon, which fits references: a thread of its pool that waits for a fit, and holds the lock of the reference meanwhile, may be
/// given the next file, which needs that lock.
fn work_on_some<T: Send>(
    files: &[ArchiveFile],
    jobs: usize,
    work: &(impl Fn(&ArchiveFile) -> T + Sync),
    take: &mut impl FnMut(&ArchiveFile, T) -> Result<()>,
) -> Result<()> {
    let next = AtomicUsize::new(0);
    let (send, receive) = bounded(jobs);
    scope(|threads| {
        for number in 0..jobs.min(files.len()) {
            let (send, next) = (send.clone(), &next);
            let work = move || {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    let Some(file) = files.get(number) else { return };
                    tracing::info!("reading {}", file.path.display());
                    // After an error of `take` nobody receives.
                    if send.send((number, work(file))).is_err() {
                        return;
                    }
                }
            };
            let thread = Builder::new().name(format!("archive-{number}"));
            thread.spawn_scoped(threads, work).context("cannot start a thread")?;
        }
        drop(send);
        let (mut early, mut due) = (BTreeMap::new(), files.iter().zip(0..).peekable());
        for (number, done) in receive {
            early.insert(number, done);
            while let Some((file, done)) = due.peek().and_then(|&(file, due)| Some((file, early.remove(&due)?))) {
                due.next();
                take(file, done)?;
            }
        }
        Ok(())
    })
}

/// The folder within which the files at `path` are named.
fn root_of(path: &Path) -> PathBuf {
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(path) };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let absolute = folder.canonicalize().or_else(|_| std::path::absolute(folder));
    absolute.unwrap_or_else(|_| folder.to_owned())
}

/// The deepest folder that has all `folders`.
fn shared_by(folders: &[PathBuf]) -> PathBuf {
    let mut ancestors = folders.iter().take(1).flat_map(|first| first.ancestors());
    ancestors.find(|folder| folders.iter().all(|other| other.starts_with(folder))).unwrap_or(Path::new("")).to_owned()
}

fn nothing_in(folder: &Path, which: Which) -> String {
    if which != Which::Results {
        return format!("{} has no finished archive (NAME.h5)", folder.display());
    }
    // If an archive was renamed, its results keep the name that it had.
    let without_archive = |path: &PathBuf| {
        let archive = archive_of(path).filter(|archive| !archive.exists())?;
        tapline_store::has_results(path).then(|| (path.clone(), archive))
    };
    let finished = Folder::list(folder).unwrap_or_default().finished;
    let left: Vec<_> = finished.iter().filter_map(without_archive).collect();
    match left.first() {
        None => format!("{} has no results of tapline reprocess", folder.display()),
        Some((first, archive)) => format!(
            "{} has {} of tapline reprocess without an archive: {} has those of {}, which is not there",
            folder.display(),
            counted(left.len(), "file of results", "files of results"),
            first.display(),
            archive.display()
        ),
    }
}

fn and_unfinished(count: usize) -> String {
    match count {
        0 => String::new(),
        1 => "; 1 is not finished (`tapline verify` names it)".to_owned(),
        count => format!("; {count} are not finished (`tapline verify` names them)"),
    }
}

/// How many files can be worked on at a time: one on each core.
pub(crate) fn cores() -> usize {
    available_parallelism().map_or(1, NonZeroUsize::get)
}

/// Work on archives: how far it has come, by their bytes, and how many have failed. One that fails is named, and
/// the others are still done.
#[derive(Debug)]
pub(crate) struct Work {
    is_many: bool,
    /// Number of archives.
    count: usize,
    failed: usize,
    is_complete: bool,
    progress: Progress,
    /// Bytes of the archives that are done, and of the one that is under way.
    done_bytes: u64,
    bytes: u64,
}

impl Work {
    /// Work on these `archives`.
    pub(crate) fn on(archives: &Archives) -> Self {
        let total = archives.files.iter().map(ArchiveFile::bytes).sum();
        Self {
            is_many: archives.is_many,
            count: archives.files.len(),
            failed: 0,
            is_complete: true,
            progress: Progress::new(Some(total), Unit::Bytes),
            done_bytes: 0,
            bytes: 0,
        }
    }

    /// Notes that `file` comes next.
    pub(crate) fn begin(&mut self, file: &ArchiveFile) {
        tracing::info!("reading {}", file.path.display());
        self.done_bytes += std::mem::replace(&mut self.bytes, file.bytes());
        self.progress.update(self.done_bytes);
    }

    /// Notes that `file` is done: of several at a time, none has begun.
    pub(crate) fn note_done(&mut self, file: &ArchiveFile) {
        self.done_bytes += file.bytes();
        self.progress.update(self.done_bytes);
    }

    /// Notes that this fraction of it, from 0 to 1, is done.
    pub(crate) fn note_part(&mut self, part: f64) {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            clippy::cast_precision_loss,
            reason = "a part of a count, for people to see"
        )]
        let of_file = (self.bytes as f64 * part.clamp(0.0, 1.0)) as u64;
        self.progress.update(self.done_bytes + of_file);
    }

    /// Begins `file` and opens it; as [`Work::take`].
    ///
    /// # Errors
    /// As [`Work::take`].
    pub(crate) fn open(&mut self, file: &ArchiveFile) -> Result<Option<Reader>> {
        self.begin(file);
        self.take(file, Reader::open(&file.path))
    }

    /// The result for `file`; `None` if it failed, after printing why.
    ///
    /// # Errors
    /// The error, if only that file was named, or standard output cannot be written.
    pub(crate) fn take<T, E>(&mut self, file: &ArchiveFile, had: Result<T, E>) -> Result<Option<T>>
    where
        E: Into<anyhow::Error>,
    {
        let error = match had {
            Ok(value) => return Ok(Some(value)),
            Err(error) => error.into(),
        };
        // If nothing can be printed, the file is not at fault.
        if !self.is_many || tapline_host::stdout::fault().is_some() {
            return Err(error);
        }
        self.failed += 1;
        let (path, why) = (file.path.display().to_string(), tapline_host::messages::with_causes(error.as_ref()));
        let text = if why.contains(&path) { format!("tapline: {why}") } else { format!("tapline: {path}: {why}") };
        self.beside(|| print_line(&text));
        Ok(None)
    }

    /// Has `write` write something else to the terminal.
    pub(crate) fn beside<R>(&self, write: impl FnOnce() -> R) -> R {
        self.progress.beside(write)
    }

    /// Whether a file has failed.
    pub(crate) fn has_failed(&self) -> bool {
        self.failed > 0
    }

    /// Notes whether the result for a file was complete.
    pub(crate) fn note(&mut self, is_complete: bool) {
        self.is_complete &= is_complete;
    }

    /// Ends the work; whether all files were done, and each was complete.
    ///
    /// # Errors
    /// That none was done.
    pub(crate) fn end(self) -> Result<bool> {
        let Self { count, failed, is_complete, progress, .. } = self;
        progress.finish();
        if failed > 0 && failed == count {
            bail!("none of {count} archives could be processed");
        }
        if failed > 0 {
            print_line(&format!("tapline: {failed} of {count} archives are left out, for the reasons above"));
        }
        Ok(is_complete && failed == 0)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn make(folder: &Path, names: &[&str]) {
        for name in names {
            let path = folder.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
    }

    fn names(archives: &Archives) -> Vec<String> {
        archives.files.iter().map(|file| file.name.display().to_string()).collect()
    }

    /// Catches a casing that counts twice or not at all.
    #[test]
    fn a_verb_has_each_file_of_a_folder_once() {
        let folder = tempfile::tempdir().unwrap();
        make(folder.path(), &["1/A.h5", "C.h5", "C.0123456789ab.h5", "open/D.17.h5"]);
        let found = |which| Archives::find(&[folder.path()], which).unwrap();
        let casings = found(Which::Casings);
        assert_eq!(names(&casings), ["1/A.h5", "C.h5"]);
        assert_eq!((casings.unfinished.len(), casings.is_many), (1, true));
        assert_eq!(names(&found(Which::Results)), ["C.0123456789ab.h5"]);
        assert_eq!(found(Which::All).files.len(), 3);
        let twice = Archives::find(&[folder.path().join("C.h5"), folder.path().to_owned()], Which::Casings).unwrap();
        assert_eq!(names(&twice), ["C.h5", "1/A.h5"]);
    }

    /// Catches files whose results come in the order in which they are ready, and work that goes on after an error.
    #[test]
    fn several_files_at_a_time_come_in_their_order() {
        let file = |k: usize| ArchiveFile { path: PathBuf::from(k.to_string()), name: PathBuf::new() };
        let archives = Archives { files: (0..100).map(file).collect(), ..Archives::default() };
        for jobs in [1, 3, 200] {
            let mut order = Vec::new();
            let take = |file: &ArchiveFile, done: PathBuf| {
                assert_eq!(file.path, done);
                order.push(done);
                if order.len() < 60 { Ok(()) } else { bail!("enough") }
            };
            let begun = AtomicUsize::new(0);
            // The first of each three takes longest.
            let work = |file: &ArchiveFile| {
                begun.fetch_add(1, Ordering::Relaxed);
                let number: u64 = file.path.to_str().unwrap().parse().unwrap();
                std::thread::sleep(std::time::Duration::from_micros(300 * (2 - number % 3)));
                file.path.clone()
            };
            assert_eq!(archives.work_on(jobs, work, take).unwrap_err().to_string(), "enough");
            assert!(begun.into_inner() <= 60_usize.next_multiple_of(AHEAD * jobs), "{jobs}");
            assert!(order.iter().eq(archives.files[..60].iter().map(|file| &file.path)), "{jobs} {order:?}");
        }
    }

    #[test]
    fn a_folder_of_nothing_is_an_error_that_says_what_is_there() {
        let folder = tempfile::tempdir().unwrap();
        let refusal = |which| Archives::find(&[folder.path()], which).unwrap_err().to_string();
        assert!(refusal(Which::Casings).ends_with("has no finished archive (NAME.h5)"), "{}", refusal(Which::Casings));
        make(folder.path(), &["open/D.17.h5"]);
        assert!(
            refusal(Which::Casings).ends_with("; 1 is not finished (`tapline verify` names it)"),
            "{}",
            refusal(Which::Casings)
        );
        assert!(refusal(Which::Results).contains("no results"), "{}", refusal(Which::Results));
        // A check reports what is not finished.
        assert_eq!(Archives::find(&[folder.path()], Which::All).unwrap().unfinished.len(), 1);
    }
}
