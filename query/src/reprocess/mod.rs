//! New results of many archives, as one job: all of them, or none.
//!
//! `tapline reprocess` judges each casing file in a folder of its own, beside a link to the archive. What it writes is the same on
//! every engine. The results gather in a staging folder, which one rename makes the job's folder, with its commit file in it; in
//! object storage they gather under the job's keys, and count once the commit file is there, which only one client can put.
//! Tasks may be done twice or by a host that was given up, and the job is still there once, or not at all.

mod commit;
mod gathering;
mod staging;

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context as _, Result, bail, ensure};
use datafusion::arrow::array::{Array as _, BooleanArray, RecordBatch, StringArray, UInt64Array};

pub use commit::{Committed, Row};

use crate::engine::Engine;
use crate::places::{CasingFile, Place, find, partitions};
use crate::plan::FilesTable;
use crate::task::{Program, ReprocessTask, Task, given, reference};
use commit::Job;
use gathering::{Gathering, out_place};

/// What a job is asked for.
#[derive(Debug, Clone)]
pub struct Order {
    /// Where casing files are.
    pub places: Vec<Place>,
    /// The place for jobs, which every host can write to.
    pub out: Place,
    /// A configuration whose tables take the place of the archives', as for `tapline reprocess`.
    pub config: Option<PathBuf>,
    /// A reference in place of the configuration's, as for `tapline reprocess`.
    pub reference: Option<String>,
    /// Whether samples are read even where discriminators would do.
    pub is_from_samples: bool,
    /// Files of one task.
    pub files_per_task: usize,
}

/// What became of a job.
#[derive(Debug)]
pub struct Done {
    /// The folder of its results.
    pub folder: Place,
    /// What is committed there.
    pub committed: Committed,
    /// Whether it was there before.
    pub was_there: bool,
}

/// Does the job on `engine`, unless it is committed already.
///
/// # Errors
/// Places that cannot be read or written, a program that is not there, an engine that fails, and archives that all fail alike.
/// Nothing is committed then.
pub async fn reprocess(order: &Order, engine: &Engine) -> Result<Done> {
    let files = find(&order.places, false).await?;
    let out = out_place(&order.out, &order.places)?;
    let program = Program::find()?;
    let task = ReprocessTask {
        staging: String::new(),
        program: program.digest()?,
        config: order.config.as_deref().map(given).transpose()?,
        reference: order.reference.as_deref().map(reference).transpose()?,
        is_from_samples: order.is_from_samples,
    };
    let job = Job::new(&task, &files).await?;
    let folder = out.join(&job.folder());
    if let Some(committed) = Committed::read(&folder).await? {
        return Ok(Done { folder, committed, was_there: true });
    }
    let gathering = Gathering::new(&out, &job.folder(), &files)?;
    let task = ReprocessTask { staging: gathering.text()?, ..task };
    let table = FilesTable::new(Task::Reprocess(task), partitions(&files, order.files_per_task));
    let context = engine.connect().await?;
    let rows = context.read_table(Arc::new(table)).context("cannot plan the job")?.collect().await;
    let rows = rows.with_context(|| format!("{}; nothing is committed", engine.at()))?;
    let committed = Committed { rows: checked(rows_of(&rows)?, &files)?, ..Committed::new(job) };
    // If all archives fail alike, the request is wrong.
    if let [first, others @ ..] = &committed.failed().collect::<Vec<_>>()[..]
        && files.len() > 1
        && others.len() + 1 == files.len()
        && others.iter().all(|other| other.error == first.error)
    {
        let why = first.error.as_deref().unwrap_or("not judged");
        bail!("none of {} archives can be judged, and nothing is committed: {why}", files.len());
    }
    let was_there = !gathering.commit(&committed, &files).await?;
    let committed = match was_there {
        true => Committed::read(&folder).await?.with_context(|| format!("{folder} is not committed"))?,
        false => committed,
    };
    Ok(Done { folder, committed, was_there })
}

/// The rows, in the order of their files.
fn rows_of(batches: &[RecordBatch]) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for batch in batches {
        let column = |name: &str| batch.column_by_name(name).with_context(|| format!("no column {name} came back"));
        let text = |name: &str| -> Result<StringArray> {
            let column = column(name)?.as_any().downcast_ref::<StringArray>();
            column.cloned().with_context(|| format!("the column {name} is no text"))
        };
        let [file, results, lineage, blake3, status, error] =
            ["file", "results", "lineage", "blake3", "status", "error"].map(text);
        let [file, results, lineage, blake3, status, error] = [file?, results?, lineage?, blake3?, status?, error?];
        let is_complete = column("is_complete")?.as_any().downcast_ref::<BooleanArray>();
        let bytes = column("bytes")?.as_any().downcast_ref::<UInt64Array>();
        let (is_complete, bytes) = is_complete.zip(bytes).context("a column that came back has another type")?;
        let maybe = |column: &StringArray, k: usize| column.is_valid(k).then(|| column.value(k).to_owned());
        rows.extend((0..batch.num_rows()).map(|k| Row {
            file: file.value(k).to_owned(),
            status: status.value(k).to_owned(),
            error: maybe(&error, k),
            results: maybe(&results, k),
            lineage: maybe(&lineage, k),
            is_complete: is_complete.is_valid(k).then(|| is_complete.value(k)),
            bytes: bytes.is_valid(k).then(|| bytes.value(k)),
            blake3: maybe(&blake3, k),
        }));
    }
    rows.sort_by(|a, b| a.file.cmp(&b.file));
    Ok(rows)
}

/// The rows, if they are one for every file.
fn checked(rows: Vec<Row>, files: &[CasingFile]) -> Result<Vec<Row>> {
    let is_same = rows.len() == files.len() && rows.iter().zip(files).all(|(row, file)| row.file == file.name);
    ensure!(is_same, "{} rows came back for {} files, or for others; nothing is committed", rows.len(), files.len());
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a cluster that did a file twice or left one out.
    #[test]
    fn a_row_too_many_or_of_another_file_is_refused() {
        let file = |name: &str| CasingFile::new(name, format!("/{name}"));
        let row = |name: &str| Row { file: name.to_owned(), ..Row::default() };
        let files = [file("A.h5"), file("B.h5")];
        assert_eq!(checked(vec![row("A.h5"), row("B.h5")], &files).unwrap().len(), 2);
        for rows in [vec![row("A.h5")], vec![row("A.h5"), row("A.h5")], vec![row("A.h5"), row("B.h5"), row("B.h5")]] {
            let refusal = checked(rows, &files).unwrap_err().to_string();
            assert!(refusal.contains("came back for 2 files"), "{refusal}");
        }
    }
}
