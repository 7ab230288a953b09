//! What a job is, and the file that says that it was done.

use std::fs;
use std::io::ErrorKind;

use anyhow::{Context as _, Result, ensure};
use futures_util::{StreamExt as _, TryStreamExt as _, stream};
use serde::{Deserialize, Serialize};

use crate::places::{COMMIT_FILE, CasingFile, End, JOB_DIGITS, JOB_PREFIX, Place, objects};
use crate::task::ReprocessTask;

/// Version of the commit file.
const VERSION: u32 = 1;

/// Files whose ends are read at a time.
const AT_A_TIME: usize = 16;

/// What is asked for: the same files, judged in the same way by the same program, are the same job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Job {
    pub key: String,
    pub task: ReprocessTask,
}

impl Job {
    /// Names the job of judging `files` as `task` says; the staging folder is no part of it.
    pub(super) async fn new(task: &ReprocessTask, files: &[CasingFile]) -> Result<Self> {
        let mut digest = blake3::Hasher::new();
        let mut part = |bytes: &[u8]| {
            digest.update(&(bytes.len() as u64).to_le_bytes());
            digest.update(bytes);
        };
        let task = ReprocessTask { staging: String::new(), ..task.clone() };
        part(&VERSION.to_le_bytes());
        part(&serde_json::to_vec(&task).context("a task cannot be written as JSON")?);
        let end = |file: &CasingFile| {
            let file = file.clone();
            async move { file.end().await?.with_context(|| format!("{} is gone", file.path)) }
        };
        let ends: Vec<End> = stream::iter(files.iter().map(end)).buffered(AT_A_TIME).try_collect().await?;
        for (file, end) in files.iter().zip(ends) {
            part(file.name.as_bytes());
            part(&end.bytes.to_le_bytes());
            part(&end.last);
            // Results are read with the archives that they are of, by links to them or by their addresses.
            part(file.path.as_bytes());
        }
        Ok(Self { key: digest.finalize().to_hex().to_string(), task })
    }

    /// Name of its folder.
    pub(super) fn folder(&self) -> String {
        format!("{JOB_PREFIX}{}", &self.key[..JOB_DIGITS])
    }
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

/// What the commit file says: the same for the same job, on any engine.
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
    pub async fn read(folder: &Place) -> Result<Option<Self>> {
        let path = folder.join(COMMIT_FILE);
        let text = match &path {
            Place::Keys(key) => objects::read(key).await?,
            Place::Folder(path) => match fs::read(path) {
                Err(error) if error.kind() == ErrorKind::NotFound => None,
                text => Some(text.with_context(|| format!("cannot read {}", path.display()))?),
            },
        };
        let Some(text) = text else { return Ok(None) };
        let committed: Self = serde_json::from_slice(&text).with_context(|| format!("{path} is not a commit file"))?;
        ensure!(
            committed.version == VERSION,
            "{path} has version {}, and this program reads {VERSION}",
            committed.version
        );
        Ok(Some(committed))
    }

    /// The text of the commit file.
    pub(super) fn text(&self) -> Result<Vec<u8>> {
        serde_json::to_vec_pretty(self).context("the commit file cannot be written as JSON")
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
    #[tokio::test]
    async fn a_job_is_named_after_all_that_decides_its_results() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("A.h5").display().to_string();
        let files = [CasingFile::new("A.h5", path.clone())];
        fs::write(&path, [1; 100]).unwrap();
        let key = async |task: &ReprocessTask| Job::new(task, &files).await.unwrap().key;
        let first = key(&task()).await;
        assert_eq!(first, key(&ReprocessTask { staging: "/b".to_owned(), ..task() }).await);
        assert_ne!(first, key(&ReprocessTask { program: "q".to_owned(), ..task() }).await);
        assert_ne!(first, key(&ReprocessTask { is_from_samples: true, ..task() }).await);
        // The links of a job to its archives do not lead to where these were moved.
        let moved = folder.path().join("moved.h5");
        fs::copy(&path, &moved).unwrap();
        let moved = [CasingFile::new("A.h5", moved.display().to_string())];
        assert_ne!(first, Job::new(&task(), &moved).await.unwrap().key);
        let mut bytes = [1; 100];
        bytes[99] = 2;
        fs::write(&path, bytes).unwrap();
        assert_ne!(first, key(&task()).await);
        fs::remove_file(&path).unwrap();
        assert!(Job::new(&task(), &files).await.unwrap_err().to_string().contains("A.h5"));
    }

    #[tokio::test]
    async fn a_commit_file_of_another_version_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let place = Place::from(folder.path());
        assert_eq!(Committed::read(&place).await.unwrap(), None);
        let other = Committed { version: 2, job: String::new(), program: String::new(), rows: Vec::new() };
        fs::write(folder.path().join(COMMIT_FILE), serde_json::to_string(&other).unwrap()).unwrap();
        let refusal = Committed::read(&place).await.unwrap_err().to_string();
        assert!(refusal.ends_with("has version 2, and this program reads 1"), "{refusal}");
    }
}
