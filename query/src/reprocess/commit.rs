//! What a job is, and the file that says that it was done.

use std::fs::{self, File};
use std::io::{ErrorKind, Read as _, Seek as _, SeekFrom};
use std::path::Path;

use anyhow::{Context as _, Result, ensure};
use serde::{Deserialize, Serialize};

use crate::folders::CasingFile;
use crate::task::ReprocessTask;

/// Name of the file that is in the folder of every job that was done.
pub const COMMIT_FILE: &str = "_committed.json";

/// Version of the commit file.
const VERSION: u32 = 1;

/// Hexadecimal digits of a job in the name of its folder.
const JOB_DIGITS: usize = 16;

/// Bytes at an archive's end that hold the digest of its seal, and with it that of the archive.
const SEAL_END_BYTES: u64 = 24;

/// What is asked for: the same files, judged in the same way by the same program, are the same job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Job {
    pub(super) key: String,
    pub(super) task: ReprocessTask,
}

impl Job {
    /// Names the job of judging `files` as `task` says; the staging folder is no part of it.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub(super) fn new(task: &ReprocessTask, files: &[CasingFile]) -> Result<Self> {
        let mut digest = blake3::Hasher::new();
        let mut part = |bytes: &[u8]| {
            digest.update(&(bytes.len() as u64).to_le_bytes());
            digest.update(bytes);
        };
        let task = ReprocessTask { staging: String::new(), ..task.clone() };
        part(&VERSION.to_le_bytes());
        part(&serde_json::to_vec(&task).context("a task does not fit JSON")?);
        for file in files {
            let (bytes, end) = end_of(file).with_context(|| format!("cannot read {}", file.path))?;
            part(file.name.as_bytes());
            part(&bytes.to_le_bytes());
            part(&end);
        }
        Ok(Self { key: digest.finalize().to_hex().to_string(), task })
    }

    /// Name of its folder.
    pub(super) fn folder(&self) -> String {
        format!("run={}", &self.key[..JOB_DIGITS])
    }
}

/// Length of a file, and what is at its end.
fn end_of(file: &CasingFile) -> std::io::Result<(u64, Vec<u8>)> {
    let mut there = File::open(&file.path)?;
    let bytes = there.metadata()?.len();
    there.seek(SeekFrom::Start(bytes.saturating_sub(SEAL_END_BYTES)))?;
    let mut end = Vec::new();
    there.take(SEAL_END_BYTES).read_to_end(&mut end)?;
    Ok((bytes, end))
}

/// What became of a file.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Row {
    /// Its name.
    pub file: String,
    /// `ok`, or `error`.
    pub status: String,
    /// Why it could not be judged.
    pub error: Option<String>,
    /// Name of its results in the job's folder.
    pub results: Option<String>,
    /// Lineage of the results.
    pub lineage: Option<String>,
    /// Whether every tap is settled and every shoulder judged.
    pub is_complete: Option<bool>,
    /// Length of the results.
    pub bytes: Option<u64>,
    /// BLAKE3 of the results.
    pub blake3: Option<String>,
}

/// What the commit file says: the same of the same job, whatever engine did it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Committed {
    /// Version of this file.
    pub version: u32,
    /// The job.
    pub job: String,
    /// BLAKE3 of the program.
    pub program: String,
    /// What became of each file, in the order of their names.
    pub rows: Vec<Row>,
}

impl Committed {
    pub(super) fn new(job: Job) -> Self {
        Self { version: VERSION, job: job.key, program: job.task.program, rows: Vec::new() }
    }

    /// Reads the commit file in `folder`; `None` if there is none.
    ///
    /// # Errors
    /// It cannot be read, or is of another version.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(COMMIT_FILE);
        let text = match fs::read_to_string(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            text => text.with_context(|| format!("cannot read {}", path.display()))?,
        };
        let committed: Self =
            serde_json::from_str(&text).with_context(|| format!("{} is no commit file", path.display()))?;
        ensure!(
            committed.version == VERSION,
            "{} has version {}, and this program reads {VERSION}",
            path.display(),
            committed.version
        );
        Ok(Some(committed))
    }

    /// Files that could not be judged.
    pub fn failed(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|row| row.results.is_none())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn task() -> ReprocessTask {
        ReprocessTask {
            staging: "/a".to_owned(),
            program: "p".to_owned(),
            config: None,
            reference: None,
            is_from_samples: false,
        }
    }

    /// Catches a job that is taken for done although its archives or options are others.
    #[test]
    fn a_job_is_named_after_all_that_decides_its_results() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("A.h5").display().to_string();
        let files = [CasingFile { name: "A.h5".to_owned(), path: path.clone() }];
        fs::write(&path, [1; 100]).unwrap();
        let key = |task: &ReprocessTask| Job::new(task, &files).unwrap().key;
        let first = key(&task());
        assert_eq!(first, key(&ReprocessTask { staging: "/b".to_owned(), ..task() }));
        assert_ne!(first, key(&ReprocessTask { program: "q".to_owned(), ..task() }));
        assert_ne!(first, key(&ReprocessTask { is_from_samples: true, ..task() }));
        let mut bytes = [1; 100];
        bytes[99] = 2;
        fs::write(&path, bytes).unwrap();
        assert_ne!(first, key(&task()));
        fs::remove_file(&path).unwrap();
        assert!(Job::new(&task(), &files).unwrap_err().to_string().contains("A.h5"));
    }

    #[test]
    fn a_commit_file_of_another_version_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(Committed::read(folder.path()).unwrap(), None);
        let other = Committed { version: 2, job: String::new(), program: String::new(), rows: Vec::new() };
        fs::write(folder.path().join(COMMIT_FILE), serde_json::to_string(&other).unwrap()).unwrap();
        let refusal = Committed::read(folder.path()).unwrap_err().to_string();
        assert!(refusal.ends_with("has version 2, and this program reads 1"), "{refusal}");
    }
}
