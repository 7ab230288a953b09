//! A task as bytes, with a digest that differs between builds of this program.

use anyhow::{Context as _, Result, ensure};
use serde::{Deserialize, Serialize};

use crate::places::CasingFile;
use crate::task::Task;

/// What bytes of this program begin with; other bytes are Ballista's own.
const MAGIC: &[u8; 8] = b"TAPQUERY";

/// Version of the form below, and of the column that names files to an executor. One that reads another version refuses it.
const VERSION: u32 = 2;

/// Bytes before the task: magic, version, digest.
const HEAD_BYTES: usize = MAGIC.len() + 4 + 32;

/// Most bytes of a task: a message of Ballista has at most 16 MiB.
const BYTES_MAX: usize = 12 << 20;

/// What travels: a task, the columns of its rows that are wanted, and of a table the files of each partition.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Payload {
    pub task: Task,
    pub projection: Option<Vec<usize>>,
    pub partitions: Vec<Vec<CasingFile>>,
}

impl Payload {
    pub(crate) fn of_table(task: &Task, partitions: &[Vec<CasingFile>]) -> Self {
        Self { task: task.clone(), projection: None, partitions: partitions.to_vec() }
    }

    /// Appends it to `bytes`.
    ///
    /// # Errors
    /// More bytes than a message of Ballista can have.
    pub(crate) fn encode(&self, bytes: &mut Vec<u8>) -> Result<()> {
        let body = serde_json::to_vec(self).context("a task cannot be written as JSON")?;
        let count: usize = self.partitions.iter().map(Vec::len).sum();
        ensure!(
            body.len() <= BYTES_MAX,
            "the names of {count} files have {} bytes, more than the {BYTES_MAX} that a cluster takes: name fewer folders, or use --engine local",
            body.len()
        );
        bytes.extend_from_slice(MAGIC);
        bytes.extend_from_slice(&VERSION.to_le_bytes());
        bytes.extend_from_slice(&digest(VERSION, &self.task, &body));
        bytes.extend_from_slice(&body);
        Ok(())
    }

    /// Reads it back; `None` if the bytes are not of this program.
    ///
    /// # Errors
    /// Another version, and a digest that is not that of the task in this build.
    pub(crate) fn decode(bytes: &[u8]) -> Result<Option<Self>> {
        if !bytes.starts_with(MAGIC) {
            return Ok(None);
        }
        let head = bytes.get(MAGIC.len()..HEAD_BYTES).context("a task is cut short")?;
        let (version, was) = head.split_at(4);
        let version = u32::from_le_bytes(version.try_into().unwrap_or_default());
        ensure!(
            version == VERSION,
            "a task has version {version}, and this tapline-query reads {VERSION}: client, scheduler and executors must be the same build"
        );
        let body = &bytes[HEAD_BYTES..];
        let payload: Self = serde_json::from_slice(body).context("a task cannot be read")?;
        ensure!(
            digest(VERSION, &payload.task, body) == was,
            "a task has another digest here: it was altered, or client, scheduler and executors are not the same build"
        );
        Ok(Some(payload))
    }
}

/// Digest of the task, and of the columns that this build gives it.
fn digest(version: u32, task: &Task, body: &[u8]) -> [u8; 32] {
    let mut digest = blake3::Hasher::new();
    let mut part = |bytes: &[u8]| {
        digest.update(&(bytes.len() as u64).to_le_bytes());
        digest.update(bytes);
    };
    part(&version.to_le_bytes());
    part(env!("CARGO_PKG_VERSION").as_bytes());
    for field in task.schema().fields() {
        part(field.name().as_bytes());
        part(field.data_type().to_string().as_bytes());
    }
    part(body);
    *digest.finalize().as_bytes()
}

#[cfg(test)]
mod tests {
    use tapline_export::Export;

    use super::*;

    fn payload() -> Payload {
        let file = CasingFile::new("A.h5", "/A.h5");
        Payload { projection: Some(vec![0, 2]), ..Payload::of_table(&Task::Read(Export::Verdicts), &[vec![file]]) }
    }

    #[test]
    fn a_task_comes_back_as_it_was() {
        let mut bytes = Vec::new();
        payload().encode(&mut bytes).unwrap();
        assert_eq!(Payload::decode(&bytes).unwrap(), Some(payload()));
        assert_eq!(payload().partitions[0][0].path, "/A.h5");
        assert_eq!(Payload::decode(b"of Ballista").unwrap(), None);
    }

    /// Catches a host with another build that computes with what it takes for the task.
    #[test]
    fn another_version_an_altered_task_and_a_cut_one_are_refused() {
        let mut bytes = Vec::new();
        payload().encode(&mut bytes).unwrap();
        let refusal = |bytes: &[u8]| Payload::decode(bytes).unwrap_err().to_string();
        let mut other = bytes.clone();
        other[MAGIC.len()] = 1;
        assert!(refusal(&other).contains("version 1, and this tapline-query reads 2"), "{}", refusal(&other));
        let at = bytes.windows(8).position(|part| part == b"verdicts").unwrap();
        let mut other = bytes.clone();
        other.splice(at..at + 8, *b"damage");
        assert!(refusal(&other).contains("another digest"), "{}", refusal(&other));
        assert!(refusal(&bytes[..20]).contains("cut short"));
    }

    #[test]
    fn more_files_than_a_message_holds_are_refused_by_their_number() {
        let file = CasingFile::new("n".repeat(1000), "p".repeat(1000));
        let many = Payload::of_table(&Task::Read(Export::Ledger), &[vec![file; 7000]]);
        let refusal = many.encode(&mut Vec::new()).unwrap_err().to_string();
        assert!(refusal.starts_with("the names of 7000 files have 14"), "{refusal}");
    }
}
