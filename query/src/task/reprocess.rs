//! Archives judged again: `tapline reprocess` in folders of their own.
//!
//! One process judges all archives of a task, because it learns the reference before the first one. What it cannot judge is judged once
//! more, each by a process of its own: what that says is about this archive, and the same however archives are shared out.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Arc;

use anyhow::{Context as _, Result, bail, ensure};
use datafusion::arrow::array::{BooleanArray, StringArray, UInt64Array};
use datafusion::arrow::datatypes::{DataType, Field};
use serde::{Deserialize, Serialize};
use tokio::runtime::Handle;

use crate::places::{CasingFile, Key, objects};
use crate::task::local::{base_name, put_at, temporary_folder};
use crate::task::program::{Program, file_digest};
use crate::task::rows::Columns;

/// The folder in a staging folder that is committed.
pub(crate) const FILES: &str = "files";

/// Exit codes of `tapline reprocess`: all was judged; not all could be.
const CODES: [i32; 2] = [0, 3];

/// Archives that are fetched from object storage at a time: each needs room on the disk until it is judged.
const FETCHED_MAX: usize = 4;

/// What the system says of a host that lacks room, memory or files, or whose disk fails.
const OF_HOST: [&str; 5] = [
    "No space left on device", "Disk quota exceeded", "Input/output error", "Cannot allocate memory",
    "Too many open files",
];

/// A file that says how to judge, and what it held when the job began.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Given {
    /// Where it is, absolute: every host reads it there.
    pub path: String,
    /// BLAKE3 of what it holds.
    pub digest: String,
}

/// How every archive of a job is judged, as executors get it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReprocessTask {
    /// The staging folder of the job, absolute, or the address of its folder in object storage: every host writes there.
    pub staging: String,
    /// BLAKE3 of the program `tapline`, which must be the same on every host.
    pub program: String,
    /// The configuration.
    pub config: Option<Given>,
    /// The reference: a file, or a name such as `self`.
    pub reference: Option<Reference>,
    /// Whether samples are read even where discriminators would do.
    pub is_from_samples: bool,
}

/// What shoulders are compared with.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Reference {
    /// A file that `tapline reference` made.
    File(Given),
    /// A shoulder, or `self`.
    Name(String),
}

/// What `tapline reprocess --json` prints for an archive.
#[derive(Debug, Deserialize)]
struct Printed {
    archive: String,
    results: String,
    lineage: String,
    is_complete: bool,
}

/// Notes what the file at `path` holds.
pub(crate) fn given(path: &Path) -> Result<Given> {
    let absolute = path.canonicalize().with_context(|| format!("cannot read {}", path.display()))?;
    let text = absolute.to_str().with_context(|| format!("the name of {} is not UTF-8", path.display()))?.to_owned();
    Ok(Given { digest: file_digest(&absolute)?, path: text })
}

/// Notes what a reference is, as `tapline reprocess --reference` takes it.
pub(crate) fn reference(text: &str) -> Result<Reference> {
    match text.ends_with(".json") {
        true => Ok(Reference::File(given(Path::new(text))?)),
        false => Ok(Reference::Name(text.to_owned())),
    }
}

impl Given {
    fn check(&self) -> Result<()> {
        let here = file_digest(Path::new(&self.path))?;
        ensure!(here == self.digest, "{} is not what it was when the job began", self.path);
        Ok(())
    }
}

impl ReprocessTask {
    /// Columns of the row of a file.
    pub(crate) fn fields() -> Vec<Field> {
        vec![
            Field::new("results", DataType::Utf8, true),
            Field::new("lineage", DataType::Utf8, true),
            Field::new("is_complete", DataType::Boolean, true),
            Field::new("bytes", DataType::UInt64, true),
            Field::new("blake3", DataType::Utf8, true),
        ]
    }

    /// Judges the archives again, and moves their results into the staging folder: existing results of them are the same.
    /// Returns the row of each file, or why it cannot be judged.
    ///
    /// # Errors
    /// Where no archive can be judged here: the staging folder is gone, or the program, the configuration or the reference is another.
    pub(crate) fn run(&self, files: &[CasingFile]) -> Result<Vec<Result<Columns, String>>> {
        let keys = Key::of_address(&self.staging);
        let staging = Path::new(&self.staging);
        ensure!(
            keys.is_some() || staging.join(FILES).is_dir(),
            "the staging folder {} is not here: its job ended, or this host does not share that folder",
            staging.display()
        );
        let program = Program::find()?;
        ensure!(
            program.digest()? == self.program,
            "{} is not the program of the job: every host needs the same build of tapline",
            program.path().display()
        );
        self.config.as_ref().map_or(Ok(()), Given::check)?;
        if let Some(Reference::File(file)) = &self.reference {
            file.check()?;
        }
        let count_max = if keys.is_some() { FETCHED_MAX } else { files.len().max(1) };
        let mut rows = Vec::with_capacity(files.len());
        for files in files.chunks(count_max) {
            let work = match &keys {
                Some(_) => temporary_folder()?,
                None => {
                    let work = tempfile::Builder::new().prefix(".work-").tempdir_in(staging);
                    work.with_context(|| format!("cannot make a folder in {}", staging.display()))?
                }
            };
            rows.extend(self.judge(&program, files, work.path())?);
        }
        Ok(rows)
    }

    /// Judges the archives in the folder `work`.
    fn judge(&self, program: &Program, files: &[CasingFile], work: &Path) -> Result<Vec<Result<Columns, String>>> {
        let mut archives = Vec::with_capacity(files.len());
        for (number, file) in files.iter().enumerate() {
            // Archives of two days may have the same name.
            let folder = work.join(number.to_string());
            fs::create_dir(&folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
            let archive = folder.join(base_name(&file.name));
            // Another archive than the job was named after is none of it.
            put_at(file, &archive)?.map_err(anyhow::Error::msg)?;
            archives.push(archive);
        }
        let mut rows: Vec<Option<Columns>> = vec![None; files.len()];
        if files.len() > 1 {
            self.judge_together(program, &archives, |printed| {
                let number = archives.iter().position(|archive| *archive == Path::new(&printed.archive));
                let number = number.with_context(|| format!("{} was not to be judged", printed.archive))?;
                rows[number] = Some(self.keep(&printed, &files[number])?);
                Ok(())
            })?;
        }
        let row = |((file, archive), row): ((&CasingFile, &PathBuf), Option<Columns>)| match row {
            Some(row) => Ok(Ok(row)),
            None => {
                // After an error elsewhere the client has removed it, and with it the archives.
                ensure!(work.is_dir(), "{} is gone: its job ended", work.display());
                let output = self.command(program, std::slice::from_ref(archive)).output();
                let output = output.with_context(|| format!("cannot run {}", program.path().display()))?;
                let printed = printed(&output, archive.parent().unwrap_or(work))?;
                printed.map_or_else(|why| Ok(Err(why)), |printed| Ok(Ok(self.keep(&printed, file)?)))
            }
        };
        files.iter().zip(&archives).zip(rows).map(row).collect()
    }

    /// Has one process judge `archives`; `take` gets what it prints of each as it comes.
    ///
    /// # Errors
    /// The first of `take`, which ends the process, or that it was killed.
    fn judge_together(
        &self,
        program: &Program,
        archives: &[PathBuf],
        mut take: impl FnMut(Printed) -> Result<()>,
    ) -> Result<()> {
        let context = || format!("cannot run {}", program.path().display());
        let mut command = self.command(program, archives);
        let mut process = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().with_context(context)?;
        let taken = process.stdout.take().map_or(Ok(()), |out| {
            BufReader::new(out).lines().try_for_each(|line| {
                let line = line.with_context(context)?;
                serde_json::from_str(&line).map_or(Ok(()), &mut take)
            })
        });
        if taken.is_err() {
            // It may have ended already.
            drop(process.kill());
        }
        let status = process.wait().with_context(context)?;
        taken?;
        ensure!(status.code().is_some(), "tapline reprocess ended with {status}");
        Ok(())
    }

    fn command(&self, program: &Program, archives: &[PathBuf]) -> Command {
        let mut command = Command::new(program.path());
        command.args(["reprocess", "--json", "--quiet", "--jobs", "1"]).args(archives).stdin(Stdio::null());
        if let Some(config) = &self.config {
            command.arg("--config").arg(&config.path);
        }
        match &self.reference {
            Some(Reference::File(file)) => _ = command.arg("--reference").arg(&file.path),
            Some(Reference::Name(name)) => _ = command.arg("--reference").arg(name),
            None => {}
        }
        if self.is_from_samples {
            command.arg("--from-samples");
        }
        command
    }

    /// Moves the results to where the job collects them.
    fn keep(&self, printed: &Printed, file: &CasingFile) -> Result<Columns> {
        let from = Path::new(&printed.results);
        let name = Path::new(&file.name).with_file_name(from.file_name().unwrap_or_default());
        let blake3 = file_digest(from)?;
        let bytes = match Key::of_address(&self.staging) {
            Some(keys) => {
                // Whoever does it twice puts the same again.
                let key = keys.join(&name.to_string_lossy());
                Handle::current().block_on(objects::put(from, &key, false))?;
                from.metadata().with_context(|| format!("cannot read {}", from.display()))?.len()
            }
            None => {
                let to = Path::new(&self.staging).join(FILES).join(&name);
                let kept = fs::File::open(from).and_then(|results| {
                    results.sync_all()?;
                    let bytes = results.metadata()?.len();
                    fs::rename(from, &to)?;
                    Ok(bytes)
                });
                kept.with_context(|| format!("cannot move {} to {}", from.display(), to.display()))?
            }
        };
        let text = |text: String| Arc::new(StringArray::from(vec![text]));
        Ok(vec![
            text(name.to_string_lossy().into_owned()),
            text(printed.lineage.clone()),
            Arc::new(BooleanArray::from(vec![printed.is_complete])),
            Arc::new(UInt64Array::from(vec![bytes])),
            text(blake3),
        ])
    }
}

/// What the program printed, or its error without the names of its folder.
///
/// # Errors
/// The program was killed, or this host lacks what it needs: the archive is not to blame.
fn printed(output: &Output, work: &Path) -> Result<Result<Printed, String>> {
    let Some(code) = output.status.code() else { bail!("tapline reprocess ended with {}", output.status) };
    let out = String::from_utf8_lossy(&output.stdout);
    let line = out.lines().find_map(|line| serde_json::from_str(line).ok());
    if let Some(printed) = line.filter(|_| CODES.contains(&code)) {
        return Ok(Ok(printed));
    }
    let err = String::from_utf8_lossy(&output.stderr).replace(&format!("{}/", work.display()), "");
    // A message of several lines shows the place in a configuration.
    let of_program = err.lines().position(|line| line.starts_with("tapline: ")).unwrap_or(0);
    let why = err.lines().skip(of_program).collect::<Vec<_>>().join("\n");
    let why = match why.trim().trim_start_matches("tapline: ") {
        "" => format!("tapline reprocess ended with {}", output.status),
        why => why.to_owned(),
    };
    ensure!(!OF_HOST.iter().any(|fault| why.contains(fault)), "{why}");
    Ok(Err(why))
}
