//! Which archives a given folder means.
//!
//! These are the finished ones in it and in its subfolders, such as the days of a line; not those in progress (`open`),
//! those that a line could not continue (`left`), hidden files, linked folders or the `lost+found` of a disk. Results that
//! `tapline reprocess` put beside an archive are kept apart, so that no casing counts twice.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, DirEntry};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use jiff::civil::Date;

use crate::archive::has_only_results;
use crate::error::{Context as _, Error, Result};
use crate::file::{ENDING, LEFT_FOLDER, OPEN_FOLDER};
use crate::format::lineage::lineage_change;
use crate::read::reader::Reader;

/// Hexadecimal digits of the lineage in the name of a file of results.
const KEY_DIGITS: usize = 12;

/// A folder at the top of each ext4 disk, which only root may read.
const OF_DISK: &str = "lost+found";

/// Depth of nested folders that are searched.
const DEPTH_MAX: usize = 16;

/// The archives in a folder and its subfolders, in the order of their paths.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Folder {
    /// Files that are finished: archives, and results of them.
    pub finished: Vec<PathBuf>,
    /// Files that are under way, or were left.
    pub unfinished: Vec<PathBuf>,
}

/// The finished files of a folder: archives and results.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Sorted {
    /// Files of casings.
    pub archives: Vec<PathBuf>,
    /// Files of results that lie beside their archives.
    pub results: Vec<Results>,
}

/// A file of results.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Results {
    /// Where it is.
    pub path: PathBuf,
    /// The archive that it belongs to.
    pub archive: PathBuf,
    /// Whether nothing says that a judgement was stopped before its end.
    pub is_finished: bool,
    /// The options by which its taps were analysed and judged, and the digest of its reference; empty if it cannot be read.
    made_with: String,
}

/// A finished file of a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finished {
    /// When it was written last, in ns since the Unix epoch.
    pub at_ns: i64,
    /// The file.
    pub path: PathBuf,
}

impl Folder {
    /// Lists `folder`.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn list(folder: &Path) -> Result<Self> {
        let mut here = Self::default();
        here.look_into(folder, DEPTH_MAX)?;
        here.finished.sort();
        here.unfinished.sort();
        Ok(here)
    }

    fn look_into(&mut self, folder: &Path, depth: usize) -> Result<()> {
        for entry in entries(folder)? {
            let (name, path) = (entry.file_name(), entry.path());
            if name.as_encoded_bytes().starts_with(b".") || name == OF_DISK {
                continue;
            }
            match entry.file_type().context("read", &path)?.is_dir() {
                true if name == OPEN_FOLDER || name == LEFT_FOLDER => {
                    // Who only reads finished files may not be allowed in there.
                    let files = entries(&path).unwrap_or_default().into_iter().map(|entry| entry.path());
                    self.unfinished.extend(files.filter(|path| is_archive(path)));
                }
                true if depth > 1 => self.look_into(&path, depth - 1)?,
                true => {}
                false if is_archive(&path) => self.finished.push(path),
                false => {}
            }
        }
        Ok(())
    }

    /// Separates results from archives. A file named like results of an archive beside it is opened to make sure;
    /// one that cannot be read is judged by its name.
    pub fn sorted(&self) -> Sorted {
        let all: BTreeSet<&Path> = self.finished.iter().map(PathBuf::as_path).collect();
        let mut sorted = Sorted::default();
        for path in &self.finished {
            let archive = archive_of(path).filter(|archive| all.contains(archive.as_path()));
            match archive.map(|archive| (archive, Reader::open(path))) {
                Some((archive, opened)) if opened.as_ref().map_or(true, Reader::is_results) => {
                    let is_finished = !matches!(opened, Err(Error::NotFinished { .. }));
                    let made_with = opened.as_ref().map(made_with).unwrap_or_default();
                    sorted.results.push(Results { path: path.clone(), archive, is_finished, made_with });
                }
                _ => sorted.archives.push(path.clone()),
            }
        }
        sorted
    }
}

impl Sorted {
    /// The results of each archive that were written last. Unfinished ones count only where there are no others: a judgement that
    /// was stopped hides none that went before.
    pub fn newest_results(&self) -> Vec<PathBuf> {
        let mut newest: BTreeMap<PathBuf, ((bool, SystemTime), &Path)> = BTreeMap::new();
        for Results { path, archive, is_finished, .. } in &self.results {
            let at = path.metadata().and_then(|there| there.modified()).unwrap_or(SystemTime::UNIX_EPOCH);
            let rank = (*is_finished, at);
            // Each job of `tapline-query reprocess` has a link of its own to an archive.
            let archive = archive.canonicalize().unwrap_or_else(|_| archive.clone());
            if newest.get(&archive).is_none_or(|(before, _)| *before <= rank) {
                newest.insert(archive, (rank, path));
            }
        }
        newest.into_values().map(|(_, path)| path.to_owned()).collect()
    }

    /// The remark if only results in `folder` are taken: how many archives have none; `None` if all or none have some.
    pub fn without_results(&self, folder: &Path) -> Option<String> {
        let with: BTreeSet<&Path> = self.results.iter().map(|results| results.archive.as_path()).collect();
        let (with, all) = (with.len(), self.archives.len());
        let folder = folder.display();
        (0 < with && with < all)
            .then(|| format!("{folder}: {} of {all} archives have no results and are left out", all - with))
    }

    /// The remark if the newest results in `folder` were not all made by the same options and reference, with the first two that
    /// differ.
    pub fn mixed_results(&self, folder: &Path) -> Option<String> {
        let newest: BTreeSet<PathBuf> = self.newest_results().into_iter().collect();
        let is_read = |results: &&Results| newest.contains(&results.path) && !results.made_with.is_empty();
        let mut all = self.results.iter().filter(is_read);
        let first = all.next()?;
        let other = all.find(|other| other.made_with != first.made_with)?;
        let (of_first, of_other) = lineage_change(&first.made_with, &other.made_with);
        let name = |results: &Results| results.path.strip_prefix(folder).unwrap_or(&results.path).display().to_string();
        Some(format!(
            "{}: the newest results were not all made alike: {} with {of_first}, {} with {of_other}",
            folder.display(),
            name(first),
            name(other)
        ))
    }
}

/// The options that decide the results in `reader`, and the digest of its reference, a line each.
fn made_with(reader: &Reader) -> String {
    let is_of = |line: &&str| line.starts_with("fuse.") || line.starts_with("process.");
    let mut lines: Vec<String> = reader.made_by().lines().filter(is_of).map(str::to_owned).collect();
    let reference = reader.reference().map(|text| blake3::hash(text.as_bytes()).to_hex());
    lines.extend(reference.map(|digest| format!("reference file = {}", &digest[..KEY_DIGITS])));
    lines.join("\n")
}

/// The archives in the output folder `out` of a line that were finished last, at most `most`, the newest first. Results of `tapline
/// reprocess`, and what cannot be read, are left out.
pub fn last_finished(out: &Path, most: usize) -> Vec<Finished> {
    let is_day = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().parse::<Date>().is_ok());
    let folders = entries(out).unwrap_or_default().into_iter().map(|entry| entry.path());
    let mut days: Vec<PathBuf> = folders.filter(is_day).collect();
    days.sort();
    let mut found = Vec::new();
    for day in days.iter().rev() {
        let files = Folder::list(day).map(|folder| folder.finished).unwrap_or_default();
        let mut of_day: Vec<Finished> = files.into_iter().filter_map(Finished::at).collect();
        of_day.sort_unstable_by_key(|finished| Reverse(finished.at_ns));
        let archives = of_day.into_iter().filter(|finished| !has_results(&finished.path));
        found.extend(archives.take(most - found.len()));
        if found.len() >= most {
            break;
        }
    }
    found
}

impl Finished {
    /// The file at `path`; `None` if its time cannot be read.
    pub fn at(path: PathBuf) -> Option<Self> {
        let at = path.metadata().and_then(|there| there.modified()).ok()?;
        let at = at.duration_since(SystemTime::UNIX_EPOCH).ok()?;
        Some(Self { at_ns: i64::try_from(at.as_nanos()).ok()?, path })
    }
}

fn entries(folder: &Path) -> Result<Vec<DirEntry>> {
    fs::read_dir(folder).context("read", folder)?.collect::<std::io::Result<_>>().context("read", folder)
}

/// Whether `path` has an archive's ending and is a plain file or a link to one.
fn is_archive(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == ENDING) && path.metadata().is_ok_and(|there| there.is_file())
}

/// The archive that a file of results belongs to: `NAME.h5` for `NAME.0123456789ab.h5`; `None` for another name.
pub fn archive_of(path: &Path) -> Option<PathBuf> {
    let (name, key) = path.file_stem()?.to_str()?.rsplit_once('.')?;
    let is_key = key.len() == KEY_DIGITS && key.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b));
    is_key.then(|| path.with_file_name(format!("{name}.{ENDING}")))
}

/// Where the results of `archive` with the lineage `key` are.
pub fn results_path(archive: &Path, key: &str) -> PathBuf {
    let name = archive.file_stem().unwrap_or_default().to_string_lossy();
    archive.with_file_name(format!("{name}.{}.{ENDING}", &key[..KEY_DIGITS.min(key.len())]))
}

/// Whether the file at `path` has results, and is not the archive of a casing with such a name; judged by name if it
/// cannot be read.
pub fn has_results(path: &Path) -> bool {
    archive_of(path).is_some() && has_only_results(path).unwrap_or(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        folder
    }

    /// Catches a casing that counts twice or not at all, and files of others that are taken for archives.
    #[test]
    fn a_folder_is_its_finished_archives() {
        let files = [
            "2026-11-24/A.h5", "2026-11-23/B.h5", "2026-11-23/A.0123456789ab.h5", "C.h5", "C.0123456789ab.h5",
            "C.2.h5", "open/D.17.h5", "left/E.18.h5", ".hidden/F.h5", "lost+found/F.h5", ".G.h5", "run.toml",
            "H.h5.1-0.new",
        ];
        let folder = made(&files);
        fs::create_dir(folder.path().join("I.h5")).unwrap();
        let here = Folder::list(folder.path()).unwrap();
        let sorted = here.sorted();
        let names = |paths: &[PathBuf]| -> Vec<String> {
            paths.iter().map(|path| path.strip_prefix(folder.path()).unwrap().display().to_string()).collect()
        };
        // Results whose archive is missing count as the archive.
        let casings = ["2026-11-23/A.0123456789ab.h5", "2026-11-23/B.h5", "2026-11-24/A.h5", "C.2.h5", "C.h5"];
        assert_eq!(names(&sorted.archives), casings);
        assert_eq!(names(&sorted.newest_results()), ["C.0123456789ab.h5"]);
        let remark = sorted.without_results(Path::new("all")).unwrap();
        assert_eq!(remark, "all: 4 of 5 archives have no results and are left out");
        assert_eq!(names(&here.unfinished), ["left/E.18.h5", "open/D.17.h5"]);
        let refusal = Folder::list(&folder.path().join("nowhere")).unwrap_err().to_string();
        assert!(refusal.starts_with("cannot read ") && refusal.contains("nowhere"), "{refusal}");
    }

    #[test]
    fn results_are_named_after_their_archive_and_lineage() {
        let archive = Path::new("/a/B.h5");
        let results = results_path(archive, "0123456789abcdef");
        assert_eq!(results, Path::new("/a/B.0123456789ab.h5"));
        assert_eq!(archive_of(&results).as_deref(), Some(archive));
        assert_eq!((archive_of(archive), archive_of(Path::new("/a/B.0123456789AB.h5"))), (None, None));
    }

    /// Catches files of another day before those of the last one, results that are taken for casings, and folders that are no days.
    #[test]
    fn the_last_finished_files_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let write = |path: &str, minute: u64| {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            let file = fs::File::create(&path).unwrap();
            file.set_modified(SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(60 * minute)).unwrap();
        };
        write("2026-11-27/late.h5", 90);
        write("2026-11-28/B.h5", 20);
        write("2026-11-28/A.h5", 30);
        write("2026-11-28/B.0123456789ab.h5", 80);
        write("2026-old/X.h5", 99);
        write("open/Y.h5", 99);
        let found = |most: usize| last_finished(folder.path(), most).into_iter().map(|f| f.path).collect::<Vec<_>>();
        let expected =
            ["2026-11-28/A.h5", "2026-11-28/B.h5", "2026-11-27/late.h5"].map(|path| folder.path().join(path));
        assert_eq!(found(9), expected);
        assert_eq!(found(1), expected[..1]);
        assert_eq!(found(0), expected[..0]);
    }
}
