//! New results of many archives, as one job: all of them, or none.
//!
//! `tapline reprocess` judges each casing file in a folder of its own, beside a link to the archive. What it writes is the same on
//! every engine. The results gather in a staging folder, which one rename makes the job's folder, with its commit file in it; in
//! object storage they gather under the job's keys, and count once the commit file is there, which only one client can put.
//! Even if tasks are done twice, or by a host that was taken for lost, the job is there once, or not at all.

mod commit;
mod gathering;
mod staging;

use std::path::PathBuf;
use std::pin::pin;
use std::sync::Arc;

use anyhow::{Context as _, Result, bail, ensure};
use datafusion::arrow::array::RecordBatch;
use datafusion::arrow::json::LineDelimitedWriter;
use tapline_host::progress::{Progress, Unit};
use tokio::time::timeout;

pub use commit::{Committed, Row};

use crate::engine::ArchiveArgs;
use crate::places::{CasingFile, Place, find, partitions};
use crate::plan::FilesTable;
use crate::task::{Program, ReprocessTask, Task, given, reference};
use commit::Job;
use gathering::{Gathering, out_place};

/// Judge archives again, all of them as one job, into a folder with a commit file.
#[derive(Debug, Clone, clap::Args)]
pub struct Order {
    /// The archives.
    #[command(flatten)]
    pub archives: ArchiveArgs,
    /// Folder for the folders of jobs, or s3://BUCKET/FOLDER; on a cluster every host must reach it under this name.
    #[arg(long, value_name = "DIR|s3://BUCKET/DIR")]
    pub out: Place,
    /// Configuration whose tables `process` and `fuse` replace those of the archives, as for `tapline reprocess`.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// What shoulders are compared with, as for `tapline reprocess`.
    #[arg(long, value_name = "FILE.json|TYRE/SHOULDER|self")]
    pub reference: Option<String>,
    /// Read the samples even where the archives' own discriminators would do.
    #[arg(long = "from-samples")]
    pub is_from_samples: bool,
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

/// Does the job, unless it is committed already.
///
/// # Errors
/// Places that cannot be read or written, a program that is not there, an engine that fails, and archives that all fail alike.
/// Nothing is committed then.
pub async fn reprocess(order: &Order) -> Result<Done> {
    let ArchiveArgs { places, engine, .. } = &order.archives;
    let files = find(places, false).await?;
    let out = out_place(&order.out, places)?;
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
    let table =
        FilesTable::new(Task::Reprocess(task), partitions(&files, order.archives.files_per_job_task(files.len())));
    let context = engine.connect().await?;
    let work = context.read_table(Arc::new(table)).context("cannot plan the job")?.collect();
    let rows = watched(work, &gathering, files.len()).await;
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

/// Waits for `work`, and shows how many of `count` archives have results.
async fn watched<T>(work: impl Future<Output = T>, gathering: &Gathering, count: usize) -> T {
    let mut progress = Progress::new(Some(count as u64), Unit::Things("archives"));
    let mut work = pin!(work);
    loop {
        if let Ok(done) = timeout(gathering.count_every(), &mut work).await {
            return done;
        }
        // Without a count now there may be one next time.
        if let Ok(count) = gathering.count().await {
            progress.update(count as u64);
        }
    }
}

/// The rows, in the order of their files.
fn rows_of(batches: &[RecordBatch]) -> Result<Vec<Row>> {
    let mut writer = LineDelimitedWriter::new(Vec::new());
    batches.iter().try_for_each(|batch| writer.write(batch))?;
    writer.finish()?;
    let lines = writer.into_inner();
    let rows = serde_json::Deserializer::from_slice(&lines).into_iter::<Row>().collect::<Result<Vec<_>, _>>();
    let mut rows = rows.context("what came back is not a row")?;
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
