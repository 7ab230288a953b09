//! Which archives a verb works on: the named files, and those in the named folders.
//!
//! [`tapline_store::Folder`] decides which files of a folder count.

pub(crate) mod several;
pub(crate) mod work;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use tapline_host::messages::counted;
use tapline_store::{Folder, archive_of};

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
            // Named twice: by another path, or itself and its folder.
            found
                .files
                .extend(named.filter(|file| known.insert(file.path.canonicalize().unwrap_or(file.path.clone()))));
        }
        Ok(found)
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
