//! Paths of the archives of a line: unfinished ones in one folder, finished ones under their names.

use std::cmp::Reverse;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use jiff::Timestamp;
use jiff::civil::Date;
use jiff::tz::TimeZone;
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, percent_decode_str, utf8_percent_encode};
use tapline_wire::{NAME_BYTES_MAX, now_ns};

use crate::error::{Context as _, Result};
use crate::file::{ENDING, LEFT_FOLDER, OPEN_FOLDER, UNREPORTED_FOLDER};
use crate::folder::{Folder, has_results};

/// What a name has in no file name.
const ESCAPED: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'_').remove(b'.');

/// A finished file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finished {
    /// When it was written last, in ns since the Unix epoch.
    pub at_ns: i64,
    /// Name of its casing as its file has it: `A17.2` of the second file of `A17`.
    pub name: String,
    /// The file.
    pub path: PathBuf,
}

/// Paths of the archives of a line.
#[derive(Debug, Clone)]
pub struct Places {
    out: PathBuf,
    is_dated: bool,
}

impl Finished {
    fn at(path: PathBuf) -> Option<Self> {
        let at = path.metadata().and_then(|there| there.modified()).ok()?;
        let at = at.duration_since(SystemTime::UNIX_EPOCH).ok()?;
        Some(Self { at_ns: i64::try_from(at.as_nanos()).ok()?, name: unescaped(&stem_of(&path)), path })
    }
}

impl Places {
    /// Archives in `out`; if `is_dated`, finished ones are in a folder for each day.
    pub fn new(out: impl Into<PathBuf>, is_dated: bool) -> Self {
        Self { out: out.into(), is_dated }
    }

    /// The output folder.
    pub fn out(&self) -> &Path {
        &self.out
    }

    /// Creates the folders.
    ///
    /// # Errors
    /// What the system returns.
    pub fn create(&self) -> Result<()> {
        let open = self.out.join(OPEN_FOLDER);
        fs::create_dir_all(&open).context("create", &open)?;
        let unreported = self.unreported_folder();
        if self.is_dated { fs::create_dir_all(&unreported).context("create", &unreported) } else { Ok(()) }
    }

    /// The folder of the notes of verdicts that are still to be reported.
    pub fn unreported_folder(&self) -> PathBuf {
        self.out.join(UNREPORTED_FOLDER)
    }

    /// The folder of the unfinished files.
    pub(crate) fn open_folder(&self) -> PathBuf {
        self.out.join(OPEN_FOLDER)
    }

    /// The unfinished files, in the order of their names.
    ///
    /// # Errors
    /// What the system returns.
    pub fn open_files(&self) -> Result<Vec<PathBuf>> {
        let folder = self.out.join(OPEN_FOLDER);
        let mut files = Vec::new();
        for entry in fs::read_dir(&folder).context("read", &folder)? {
            let path = entry.context("read", &folder)?.path();
            if path.extension().is_some_and(|ending| ending == ENDING) {
                files.push(path);
            }
        }
        files.sort();
        Ok(files)
    }

    /// A new path for the unfinished file of the casing `name`.
    pub(crate) fn begin(&self, name: &str) -> PathBuf {
        self.out.join(OPEN_FOLDER).join(format!("{}.{:x}.{ENDING}", escaped(name), now_ns()))
    }

    /// The finished file of the casing `name` in the present folder; `None` if there is none.
    pub fn finished(&self, name: &str) -> Option<PathBuf> {
        let path = self.folder().join(format!("{}.{ENDING}", escaped(name)));
        path.exists().then_some(path)
    }

    /// The unfinished file of the casing `name`; `None` if there is none.
    pub fn under_way(&self, name: &str) -> Option<PathBuf> {
        let is_of = |path: &PathBuf| path.file_stem().is_some_and(|stem| name_of_open(&stem.to_string_lossy()) == name);
        self.open_files().ok()?.into_iter().find(is_of)
    }

    /// All finished files of the casing `name`.
    pub(crate) fn all_finished(&self, name: &str) -> Vec<PathBuf> {
        let stem = escaped(name);
        let mut folders = vec![self.out.clone()];
        if self.is_dated {
            folders.extend(self.folders());
        }
        let mut files = Vec::new();
        for folder in folders {
            files.extend((1_u32..).map(|k| file_of(&folder, &stem, k)).take_while(|path| path.exists()));
        }
        files
    }

    /// The files that were finished last, at most `most`, the newest first; what cannot be read is left out, and so are results of
    /// `tapline reprocess`.
    pub fn last_finished(&self, most: usize) -> Vec<Finished> {
        let is_day =
            |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().parse::<Date>().is_ok());
        let mut days: Vec<PathBuf> = self.folders().into_iter().filter(is_day).collect();
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

    /// The folders in the output folder, those of days among them.
    fn folders(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(&self.out).into_iter().flatten().flatten();
        entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect()
    }

    /// The path for the finished file of the casing `name`, which no file has.
    ///
    /// # Errors
    /// What the system returns.
    pub(crate) fn finish(&self, name: &str) -> Result<PathBuf> {
        let (folder, stem) = (self.folder(), escaped(name));
        fs::create_dir_all(&folder).context("create", &folder)?;
        let mut free = (1_u32..).map(|k| file_of(&folder, &stem, k)).filter(|path| !path.exists());
        Ok(free.next().unwrap_or(folder))
    }

    /// Moves an unfinished file that cannot be resumed to [`LEFT_FOLDER`]; returns its path there.
    pub(crate) fn leave(&self, path: &Path) -> Result<PathBuf> {
        let folder = self.out.join(LEFT_FOLDER);
        fs::create_dir_all(&folder).context("create", &folder)?;
        let left = folder.join(path.file_name().unwrap_or_default());
        fs::rename(path, &left).context("put aside", path)?;
        Ok(left)
    }

    /// The folder of the files that are finished today.
    fn folder(&self) -> PathBuf {
        if !self.is_dated {
            return self.out.clone();
        }
        let now = Timestamp::from_nanosecond(now_ns().into()).unwrap_or_default();
        self.out.join(now.to_zoned(TimeZone::system()).date().to_string())
    }
}

fn file_of(folder: &Path, stem: &str, k: u32) -> PathBuf {
    match k {
        1 => folder.join(format!("{stem}.{ENDING}")),
        _ => folder.join(format!("{stem}.{k}.{ENDING}")),
    }
}

/// Stem of the file at `path`: the escaped name of its casing, and of an unfinished file when it was begun.
pub(crate) fn stem_of(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// `name` for file names: bytes other than letters, digits, `-`, `_` and dots within it become `%` and two digits.
pub(crate) fn escaped(name: &str) -> String {
    let mut text = utf8_percent_encode(name, ESCAPED).to_string();
    if text.starts_with('.') {
        text.replace_range(..1, "%2E");
    }
    text.truncate(NAME_BYTES_MAX);
    text
}

/// The inverse of [`escaped`].
pub(crate) fn unescaped(text: &str) -> String {
    percent_decode_str(text).decode_utf8_lossy().into_owned()
}

/// Name of the casing whose unfinished file has the stem `stem`.
pub(crate) fn name_of_open(stem: &str) -> String {
    unescaped(stem.rsplit_once('.').map_or(stem, |(name, _)| name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_comes_back_from_its_file() {
        let places = Places::new("out", false);
        for name in ["A-17", "Ä 5", "..", ".hidden", "a/b", "50%41", "x.y.z"] {
            let path = places.begin(name);
            assert_eq!(path.parent(), Some(Path::new("out/open")), "{name}");
            assert_eq!(name_of_open(&stem_of(&path)), name);
        }
    }

    #[test]
    fn a_repeated_name_gets_a_number() {
        let folder = tempfile::tempdir().unwrap();
        let places = Places::new(folder.path(), true);
        let names: Vec<String> = (0..3)
            .map(|_| {
                let path = places.finish("A.1").unwrap();
                fs::write(&path, "").unwrap();
                path.file_name().unwrap().to_string_lossy().into_owned()
            })
            .collect();
        assert_eq!(names, ["A.1.h5", "A.1.2.h5", "A.1.3.h5"]);
        assert_eq!(places.all_finished("A.1").len(), 3);
        assert!(places.finished("A.1").is_some() && places.finished("A.2").is_none());
    }

    /// Catches files of another day before those of the last one, results that are taken for casings, and folders that are no days.
    #[test]
    fn the_last_finished_files_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let places = Places::new(folder.path(), true);
        let write = |path: &str, minute: u64| {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            let file = fs::File::create(&path).unwrap();
            file.set_modified(SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(60 * minute)).unwrap();
        };
        write("2026-11-27/late.h5", 90);
        write("2026-11-28/B.h5", 20);
        write("2026-11-28/A%2F1.h5", 30);
        write("2026-11-28/B.0123456789ab.h5", 80);
        write("2026-old/X.h5", 99);
        write("open/Y.h5", 99);
        let found = |most: usize| places.last_finished(most).into_iter().map(|f| f.name).collect::<Vec<_>>();
        assert_eq!(found(9), ["A/1", "B", "late"]);
        assert_eq!(found(1), ["A/1"]);
        assert_eq!(found(0), [""; 0]);
    }
}
