//! One archive judged again: `tapline reprocess` in a folder of its own.

use std::fs;
use std::path::Path;
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

    /// Judges the archive again, and moves its results into the staging folder: existing results of it are the same.
    /// Returns the row of the file, or why it cannot be judged.
    ///
    /// # Errors
    /// Where no archive can be judged here: the staging folder is gone, or the program, the configuration or the reference is another.
    pub(crate) fn run(&self, file: &CasingFile) -> Result<Result<Columns, String>> {
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
        let work = match &keys {
            Some(_) => temporary_folder()?,
            None => {
                let work = tempfile::Builder::new().prefix(".work-").tempdir_in(staging);
                work.with_context(|| format!("cannot make a folder in {}", staging.display()))?
            }
        };
        let archive = work.path().join(base_name(&file.name));
        // Another archive than the job was named after is none of it.
        put_at(file, &archive)?.map_err(anyhow::Error::msg)?;
        let output = self.command(&program, &archive).output();
        let output = output.with_context(|| format!("cannot run {}", program.path().display()))?;
        match printed(&output, work.path())? {
            Ok(printed) => Ok(Ok(keep(&printed, file, staging, keys.as_ref())?)),
            Err(why) => Ok(Err(why)),
        }
    }

    fn command(&self, program: &Program, archive: &Path) -> Command {
        let mut command = Command::new(program.path());
        command.args(["reprocess", "--json", "--quiet", "--jobs", "1"]).arg(archive).stdin(Stdio::null());
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

/// Moves the results to where the job collects them.
fn keep(printed: &Printed, file: &CasingFile, staging: &Path, keys: Option<&Key>) -> Result<Columns> {
    let from = Path::new(&printed.results);
    let name = Path::new(&file.name).with_file_name(from.file_name().unwrap_or_default());
    let blake3 = file_digest(from)?;
    let bytes = match keys {
        Some(keys) => {
            // Whoever does it twice puts the same again.
            let key = keys.join(&name.to_string_lossy());
            Handle::current().block_on(objects::put(from, &key, false))?;
            from.metadata().with_context(|| format!("cannot read {}", from.display()))?.len()
        }
        None => {
            let to = staging.join(FILES).join(&name);
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
