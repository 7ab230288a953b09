//! The casing files of folders: every finished archive in them and in their sub-folders.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail, ensure};
use tapline_store::{LEFT_FOLDER, OPEN_FOLDER, Reader};

/// Ending of an archive's name.
const ENDING: &str = "h5";

/// Hexadecimal digits of the lineage in the name of a file of results.
const KEY_DIGITS: usize = 12;

/// Depth of nested folders that are searched.
const DEPTH_MAX: usize = 16;

/// A casing file, named in the same way on every host.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct CasingFile {
    /// Its path within the folder; that folder's own name comes first where several are searched.
    pub name: String,
    /// Where it is, absolute.
    pub path: String,
}

/// Finds the finished archives in `folders`, in the order of their names; or, with `is_results`, of each the newest results.
///
/// # Errors
/// A folder that cannot be read or has no such file, two folders of the same name, and a name that is not UTF-8.
pub fn find(folders: &[PathBuf], is_results: bool) -> Result<Vec<CasingFile>> {
    let mut labels = BTreeSet::new();
    let mut found = Vec::new();
    for folder in folders {
        let context = || format!("cannot read {}", folder.display());
        let absolute = folder.canonicalize().with_context(context)?;
        ensure!(absolute.is_dir(), "{} is no folder", folder.display());
        let label = match folders.len() {
            1 => PathBuf::new(),
            _ => PathBuf::from(absolute.file_name().unwrap_or_default()),
        };
        ensure!(
            labels.insert(label.clone()),
            "two of the folders are called {}: name one folder above them",
            label.display()
        );
        let mut paths = Vec::new();
        look_into(&absolute, DEPTH_MAX, &mut paths)?;
        let (casings, results) = archives_and_results(paths);
        let chosen = if is_results { newest(results) } else { casings };
        let what = if is_results { "results of tapline reprocess" } else { "finished archive (NAME.h5)" };
        ensure!(!chosen.is_empty(), "{} has no {what}", folder.display());
        for path in chosen {
            let name = label.join(path.strip_prefix(&absolute).unwrap_or(&path));
            match (name.to_str(), path.to_str()) {
                (Some(name), Some(path)) => found.push(CasingFile { name: name.to_owned(), path: path.to_owned() }),
                _ => bail!("the name of {} is not UTF-8", path.display()),
            }
        }
    }
    found.sort();
    Ok(found)
}

fn look_into(folder: &Path, depth: usize, found: &mut Vec<PathBuf>) -> Result<()> {
    let context = || format!("cannot read {}", folder.display());
    for entry in std::fs::read_dir(folder).with_context(context)? {
        let entry = entry.with_context(context)?;
        let (name, path) = (entry.file_name(), entry.path());
        let is_hidden = name.as_encoded_bytes().starts_with(b".");
        if is_hidden || name == OPEN_FOLDER || name == LEFT_FOLDER {
            continue;
        }
        let is_folder = entry.file_type().with_context(|| format!("cannot read {}", path.display()))?.is_dir();
        if is_folder && depth > 1 {
            look_into(&path, depth - 1, found)?;
        } else if !is_folder && is_archive(&path) {
            found.push(path);
        }
    }
    Ok(())
}

/// Whether a plain file with an archive's ending is at `path`, or where a link there leads.
fn is_archive(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == ENDING) && path.metadata().is_ok_and(|there| there.is_file())
}

/// The archives, and the files of results, each with the archive that it is of.
fn archives_and_results(files: Vec<PathBuf>) -> (Vec<PathBuf>, Vec<(PathBuf, PathBuf)>) {
    let all: BTreeSet<PathBuf> = files.iter().cloned().collect();
    let (mut casings, mut results) = (Vec::new(), Vec::new());
    for path in files {
        match of_archive(&path).filter(|of| all.contains(of) && has_results(&path)) {
            Some(of) => results.push((of, path)),
            None => casings.push(path),
        }
    }
    (casings, results)
}

/// The archive that a file of results is of, by its name: `NAME.0123456789ab.h5` is of `NAME.h5`.
fn of_archive(path: &Path) -> Option<PathBuf> {
    let (name, key) = path.file_stem()?.to_str()?.rsplit_once('.')?;
    let is_key = key.len() == KEY_DIGITS && key.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b));
    is_key.then(|| path.with_file_name(format!("{name}.{ENDING}")))
}

/// Whether the file with such a name has results; one that cannot be read is taken by its name.
fn has_results(path: &Path) -> bool {
    Reader::open(path).map_or(true, |reader| reader.is_results())
}

/// The results of each archive that were written last.
fn newest(results: Vec<(PathBuf, PathBuf)>) -> Vec<PathBuf> {
    let mut newest = BTreeMap::new();
    for (of, path) in results {
        let at = path.metadata().and_then(|there| there.modified()).ok();
        let entry = newest.entry(of).or_insert_with(|| (at, path.clone()));
        if entry.0 < at {
            *entry = (at, path);
        }
    }
    newest.into_values().map(|(_, path)| path).collect()
}

/// Cuts `files` into runs of at most `count_max`, each of which is one partition of a plan.
pub fn partitions(files: &[CasingFile], count_max: usize) -> Vec<Vec<CasingFile>> {
    files.chunks(count_max.max(1)).map(<[CasingFile]>::to_vec).collect()
}

#[cfg(test)]
mod tests {
    use std::fs;

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

    fn names(folders: &[PathBuf], is_results: bool) -> Vec<String> {
        find(folders, is_results).unwrap().into_iter().map(|file| file.name).collect()
    }

    /// Catches casings that are counted twice, and files that a line still writes.
    #[test]
    fn finished_archives_are_found_and_nothing_else() {
        let results = "1/A.0123456789ab.h5";
        let folder =
            made(&["1/A.h5", results, "1/B.h5", "A.h5", "C.2.h5", "open/D.h5", "left/E.h5", ".F/F.h5", "run.toml"]);
        let one = [folder.path().to_owned()];
        assert_eq!(names(&one, false), ["1/A.h5", "1/B.h5", "A.h5", "C.2.h5"]);
        assert_eq!(names(&one, true), [results]);
    }

    /// Catches two files of one name, whose rows could not be told apart.
    #[test]
    fn of_several_folders_names_begin_with_theirs() {
        let folder = made(&["x/A.h5", "y/A.h5", "y/x/A.h5", "empty/a.txt"]);
        let at = |name| folder.path().join(name);
        assert_eq!(names(&[at("x"), at("y")], false), ["x/A.h5", "y/A.h5", "y/x/A.h5"]);
        let refusal = find(&[at("x"), at("y/x")], false).unwrap_err().to_string();
        assert!(refusal.contains("two of the folders are called x"), "{refusal}");
        let refusal = find(&[at("empty")], false).unwrap_err().to_string();
        assert!(refusal.ends_with("empty has no finished archive (NAME.h5)"), "{refusal}");
    }

    #[test]
    fn partitions_have_every_file_once() {
        let files: Vec<_> = (0..7).map(|k| CasingFile { name: format!("{k}"), path: format!("/{k}") }).collect();
        let cut = partitions(&files, 3);
        assert_eq!(cut.iter().map(Vec::len).collect::<Vec<_>>(), [3, 3, 1]);
        assert_eq!(cut.concat(), files);
    }
}
