//! The casing files of places: every finished archive in them and in what lies below.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{ErrorKind, Read as _, Seek as _, SeekFrom};
use std::path::{Component, Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Context as _, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use tapline_host::messages::say;
use tapline_store::{Folder, LEFT_FOLDER, OPEN_FOLDER, archive_of};

use super::objects::{self, Object};
use super::place::{Key, Place};

/// Name of the file that is in the folder of every job that was done.
pub const COMMIT_FILE: &str = "_committed.json";

/// Name of the object that says where the archives of a job in object storage are: names of files, and addresses.
pub(crate) const ARCHIVES_FILE: &str = "_archives.json";

/// Prefix of the names of job folders, and how many hexadecimal digits follow.
pub(crate) const JOB_PREFIX: &str = "run=";
pub(crate) const JOB_DIGITS: usize = 16;

/// Bytes at an archive's end that hold the digest of its seal, and with it that of the archive.
const SEAL_END_BYTES: u64 = 24;

/// A casing file, named in the same way on every host.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct CasingFile {
    /// Its path within the place; that place's own name comes first where several are searched.
    pub name: String,
    /// Where it is: an absolute path, or the address of an object.
    pub path: String,
    /// Identifies the object: another one at the same address has another tag.
    pub e_tag: Option<String>,
    /// Of results in object storage, the address of their archive, without which they cannot be read; files have theirs beside
    /// them.
    pub archive: Option<String>,
}

/// Length and last bytes of a file: archives that agree in both are the same archive.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct End {
    pub bytes: u64,
    pub last: Vec<u8>,
}

impl CasingFile {
    /// An archive.
    pub fn new(name: impl Into<String>, path: impl Into<String>) -> Self {
        Self { name: name.into(), path: path.into(), e_tag: None, archive: None }
    }

    /// Its end; `None` if it is not there.
    pub(crate) async fn end(&self) -> Result<Option<End>> {
        if let Some(key) = Key::of_address(&self.path) {
            return Ok(objects::end_of(&key, SEAL_END_BYTES).await?.map(|(bytes, last)| End { bytes, last }));
        }
        match end_of(Path::new(&self.path)) {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            end => end.map(Some).with_context(|| format!("cannot read {}", self.path)),
        }
    }
}

fn end_of(path: &Path) -> std::io::Result<End> {
    let mut file = File::open(path)?;
    let bytes = file.metadata()?.len();
    file.seek(SeekFrom::Start(bytes.saturating_sub(SEAL_END_BYTES)))?;
    let mut last = Vec::new();
    file.take(SEAL_END_BYTES).read_to_end(&mut last)?;
    Ok(End { bytes, last })
}

/// Finds the finished archives in `places`, in the order of their names; or, with `is_results`, of each the newest results. A file that
/// is found twice, by a link or in places that overlap, has the name that comes first.
///
/// # Errors
/// A place that cannot be read or has no such file, two places of the same name, and a name that is not UTF-8.
pub async fn find(places: &[Place], is_results: bool) -> Result<Vec<CasingFile>> {
    let mut labels = BTreeSet::new();
    let mut found = Vec::new();
    let mut known = BTreeSet::new();
    for place in places {
        let inside = match place {
            Place::Folder(folder) => in_folder(folder, is_results)?,
            Place::Keys(keys) => in_keys(keys, is_results).await?,
        };
        let what = if is_results { "results of tapline reprocess" } else { "finished archive (NAME.h5)" };
        ensure!(!inside.is_empty(), "{place} has no {what}");
        let is_new = |file: &CasingFile| known.insert(real_path(file));
        let inside: Vec<_> = inside.into_iter().filter(is_new).collect();
        if inside.is_empty() {
            continue;
        }
        let label = if places.len() == 1 { String::new() } else { label(place)? };
        ensure!(labels.insert(label.clone()), "two of the folders are called {label}: name one folder above them");
        let named = |file: CasingFile| match label.as_str() {
            "" => file,
            label => CasingFile { name: format!("{label}/{}", file.name), ..file },
        };
        found.extend(inside.into_iter().map(named));
    }
    found.sort();
    Ok(found)
}

/// The path of a file without links; an address as it is.
fn real_path(file: &CasingFile) -> PathBuf {
    let path = Path::new(&file.path);
    path.canonicalize().unwrap_or_else(|_| path.to_owned())
}

/// The name that a place has among others.
fn label(place: &Place) -> Result<String> {
    match place {
        Place::Keys(_) => Ok(place.name()),
        Place::Folder(folder) => {
            let absolute = folder.canonicalize().with_context(|| format!("cannot read {}", folder.display()))?;
            Ok(Place::Folder(absolute).name())
        }
    }
}

fn in_folder(folder: &Path, is_results: bool) -> Result<Vec<CasingFile>> {
    let absolute = folder.canonicalize().with_context(|| format!("cannot read {}", folder.display()))?;
    ensure!(absolute.is_dir(), "{} is not a folder", folder.display());
    let sorted = Folder::list(&absolute)?.sorted();
    if is_results {
        let remarks = [sorted.without_results(folder), sorted.mixed_results(&absolute)];
        remarks.iter().flatten().for_each(|remark| say(&format!("tapline-query: {remark}")));
    }
    let chosen = if is_results { sorted.newest_results() } else { sorted.archives };
    let file = |path: PathBuf| {
        let name = path.strip_prefix(&absolute).unwrap_or(&path);
        match (name.to_str(), path.to_str()) {
            (Some(name), Some(path)) => Ok(CasingFile::new(name, path)),
            _ => bail!("the name of {} is not UTF-8", path.display()),
        }
    };
    chosen.into_iter().map(file).collect()
}

async fn in_keys(keys: &Key, is_results: bool) -> Result<Vec<CasingFile>> {
    let objects = objects::list(keys).await?;
    let mut jobs: BTreeMap<&str, BTreeMap<String, String>> = BTreeMap::new();
    let mut newest: BTreeMap<String, (SystemTime, CasingFile)> = BTreeMap::new();
    for Chosen { name, object, job } in chosen(keys, &objects, is_results) {
        let at = |key: &str| Key { bucket: keys.bucket.clone(), key: key.to_owned() };
        let mut file = CasingFile::new(name, at(&object.key).to_string());
        file.e_tag.clone_from(&object.e_tag);
        let archive = archive_of(Path::new(&object.key)).filter(|_| is_results);
        let archive = archive.map(|archive| archive.to_string_lossy().into_owned());
        file.archive = match (archive, job) {
            (Some(archive), Some(job)) => {
                if !jobs.contains_key(job) {
                    jobs.insert(job, archives_of(&at(job)).await?);
                }
                let name = archive.strip_prefix(job).unwrap_or(&archive).trim_start_matches('/');
                jobs[job].get(name).cloned()
            }
            (archive, _) => archive.map(|archive| at(&archive).to_string()),
        };
        // Several jobs may have judged an archive.
        let of = file.archive.clone().unwrap_or_else(|| file.path.clone());
        match newest.get(&of) {
            Some((before, _)) if *before > object.modified => {}
            _ => _ = newest.insert(of, (object.modified, file)),
        }
    }
    Ok(newest.into_values().map(|(_, file)| file).collect())
}

/// Where the archives of a job are.
async fn archives_of(job: &Key) -> Result<BTreeMap<String, String>> {
    let key = job.join(ARCHIVES_FILE);
    let text = objects::read(&key).await?.with_context(|| format!("{key} is gone"))?;
    serde_json::from_slice(&text).with_context(|| format!("{key} does not say where archives are"))
}

/// A file of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Chosen<'a> {
    /// Within the place.
    name: &'a str,
    object: &'a Object,
    /// The folder of the job whose results it is.
    job: Option<&'a str>,
}

/// The archives or results among `objects`, without opening any: results are those of jobs that were committed, and of archives
/// that lie beside them. What a job that is not committed left does not count.
fn chosen<'a>(keys: &Key, objects: &'a [Object], is_results: bool) -> Vec<Chosen<'a>> {
    let all: BTreeSet<&str> = objects.iter().map(|object| object.key.as_str()).collect();
    let is_chosen = |object: &'a Object| {
        let key = object.key.as_str();
        let name = keys.below(key).filter(|name| is_archive(name))?;
        let job = job_of(key);
        let archive = archive_of(Path::new(key)).map(|archive| archive.to_string_lossy().into_owned());
        let is_of_archive = archive.is_some_and(|archive| job.is_some() || all.contains(archive.as_str()));
        let counts = match job.filter(|_| is_of_archive) {
            Some(job) => all.contains(format!("{job}/{COMMIT_FILE}").as_str()),
            None => true,
        };
        (counts && is_of_archive == is_results).then_some(Chosen { name, object, job })
    };
    objects.iter().filter_map(is_chosen).collect()
}

/// Whether a key is that of a finished file: not hidden, and not in a folder of unfinished ones.
fn is_archive(name: &str) -> bool {
    let mut parts = Path::new(name).components();
    let is_seen = |part: Component<'_>| match part.as_os_str().to_str() {
        Some(part) => !part.starts_with('.') && part != OPEN_FOLDER && part != LEFT_FOLDER,
        None => false,
    };
    Path::new(name).extension().is_some_and(|ending| ending == "h5") && parts.all(is_seen)
}

/// The folder of a job that an object lies in.
fn job_of(key: &str) -> Option<&str> {
    let is_job = |part: &str| {
        part.strip_prefix(JOB_PREFIX)
            .is_some_and(|job| job.len() == JOB_DIGITS && job.bytes().all(|b| b.is_ascii_hexdigit()))
    };
    let mut end = 0;
    key.split('/').find_map(|part| {
        end += part.len() + 1;
        is_job(part).then(|| &key[..end - 1])
    })
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

    fn found(folders: &[PathBuf], is_results: bool) -> Result<Vec<CasingFile>> {
        let places: Vec<_> = folders.iter().map(|folder| Place::from(folder.as_path())).collect();
        tokio::runtime::Builder::new_current_thread().build().unwrap().block_on(find(&places, is_results))
    }

    fn names(folders: &[PathBuf], is_results: bool) -> Vec<String> {
        found(folders, is_results).unwrap().into_iter().map(|file| file.name).collect()
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

    /// Catches two files of one name, whose rows could not be distinguished.
    #[test]
    fn of_several_folders_names_begin_with_theirs() {
        let folder = made(&["x/A.h5", "y/A.h5", "y/x/A.h5", "empty/a.txt"]);
        let at = |name| folder.path().join(name);
        assert_eq!(names(&[at("x"), at("y")], false), ["x/A.h5", "y/A.h5", "y/x/A.h5"]);
        let refusal = found(&[at("x"), at("y/x")], false).unwrap_err().to_string();
        assert!(refusal.contains("two of the folders are called x"), "{refusal}");
        let refusal = found(&[at("empty")], false).unwrap_err().to_string();
        assert!(refusal.ends_with("empty has no finished archive (NAME.h5)"), "{refusal}");
    }

    /// Catches a casing that counts twice because folders overlap, one is named twice, or a link leads to it.
    #[test]
    fn a_file_that_is_found_twice_counts_once() {
        let folder = made(&["plant/1/A.h5", "plant/2/B.h5"]);
        let at = |name| folder.path().join(name);
        std::os::unix::fs::symlink(at("plant/1/A.h5"), at("plant/2/C.h5")).unwrap();
        let once = ["plant/1/A.h5", "plant/2/B.h5"];
        assert_eq!(names(&[at("plant"), at("plant/2"), at("plant")], false), once);
        assert_eq!(names(&[at("plant/2"), at("plant")], false), ["2/B.h5", "2/C.h5"]);
    }

    /// Catches results of a job that was killed before its commit, and a casing that counts twice.
    #[test]
    fn of_keys_the_archives_and_committed_results_are_found() {
        let keys = [
            "2025/1/A.h5",
            "2025/1/A.0123456789ab.h5",
            "2025/1/A.1123456789ab.h5",
            "2025/B.0123456789ab.h5",
            "2025/open/C.h5",
            "2025/.D.h5",
            "2025/run.toml",
            "20251/E.h5",
            "again/run=1111111111111111/1/A.0123456789ab.h5",
            "again/run=1111111111111111/_committed.json",
            "again/run=2222222222222222/1/A.2123456789ab.h5",
            "again/run=2222222222222222/1/A.h5",
            "again/run=2025-01/B.h5",
        ];
        let at = |k: u64| SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(100 - k);
        let objects: Vec<_> = keys
            .iter()
            .zip(0..)
            .map(|(key, k)| Object { key: (*key).to_owned(), modified: at(k), e_tag: None })
            .collect();
        let place = |key: &str| Key { bucket: "plant".to_owned(), key: key.to_owned() };
        let names = |key: &str, is_results: bool| -> Vec<&str> {
            chosen(&place(key), &objects, is_results).into_iter().map(|file| file.name).collect()
        };
        assert_eq!(names("2025", false), ["1/A.h5", "B.0123456789ab.h5"]);
        assert_eq!(names("2025", true), ["1/A.0123456789ab.h5", "1/A.1123456789ab.h5"]);
        assert_eq!(names("again", true), ["run=1111111111111111/1/A.0123456789ab.h5"]);
        assert_eq!(names("again/run=1111111111111111", true), ["1/A.0123456789ab.h5"]);
        // What is no result is an archive, wherever it lies.
        assert_eq!(names("again", false), ["run=2222222222222222/1/A.h5", "run=2025-01/B.h5"]);
    }

    #[test]
    fn partitions_have_every_file_once() {
        let files: Vec<_> = (0..7).map(|k| CasingFile::new(format!("{k}"), format!("/{k}"))).collect();
        let cut = partitions(&files, 3);
        assert_eq!(cut.iter().map(Vec::len).collect::<Vec<_>>(), [3, 3, 1]);
        assert_eq!(cut.concat(), files);
    }
}
