//! Paths of the archives of a line: unfinished ones in one folder, finished ones under their names.

use std::fs;
use std::path::{Path, PathBuf};

use jiff::Timestamp;
use jiff::tz::TimeZone;
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, percent_decode_str, utf8_percent_encode};
use tapline_wire::{NAME_BYTES_MAX, now_ns};

use crate::error::{Context as _, Result};
use crate::file::{ENDING, LEFT_FOLDER, OPEN_FOLDER, UNREPORTED_FOLDER};

/// What a name has in no file name.
const ESCAPED: &AsciiSet = &NON_ALPHANUMERIC.remove(b'-').remove(b'_').remove(b'.');

/// Paths of the archives of a line.
#[derive(Debug, Clone)]
pub struct Places {
    out: PathBuf,
    is_dated: bool,
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
            if path.extension().is_none_or(|ending| ending != ENDING) {
                continue;
            }
            match path.is_file() {
                true => files.push(path),
                false => tracing::warn!("{} is no file, and is passed over", path.display()),
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
        self.finished_here(name).next()
    }

    /// All finished files of the casing `name` in the present folder, the oldest first.
    pub fn finished_here(&self, name: &str) -> impl Iterator<Item = PathBuf> + use<> {
        there_of(self.folder(), escaped(name))
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
            let days = fs::read_dir(&self.out).into_iter().flatten().flatten();
            folders.extend(days.map(|day| day.path()).filter(|day| day.is_dir()));
        }
        folders.into_iter().flat_map(|folder| there_of(folder, stem.clone())).collect()
    }

    /// The path for the finished file of the casing `name`, which no file has.
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

/// The files of a casing that are in `folder`, the oldest first.
fn there_of(folder: PathBuf, stem: String) -> impl Iterator<Item = PathBuf> {
    (1_u32..).map(move |k| file_of(&folder, &stem, k)).take_while(|path| path.exists())
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
    // A hidden file, or an option of a command.
    for (first, code) in [(".", "%2E"), ("-", "%2D")] {
        if text.starts_with(first) {
            text.replace_range(..1, code);
        }
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
        for name in ["A-17", "Ä 5", "..", ".hidden", "-rf", "a/b", "50%41", "x.y.z"] {
            let path = places.begin(name);
            assert_eq!(path.parent(), Some(Path::new("out/open")), "{name}");
            assert_eq!(name_of_open(&stem_of(&path)), name);
            assert!(!stem_of(&path).starts_with(['.', '-']), "{name}");
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
}
