//! Progress and outcome of a verb that works on archives.

use anyhow::{Result, bail};
use tapline_host::messages::print_line;
use tapline_host::progress::{Progress, Unit};
use tapline_store::Reader;

use super::{ArchiveFile, Archives};

/// Work on archives: how far it has come, by their bytes, and how many have failed. One that fails is named, and
/// the others are still done.
#[derive(Debug)]
pub(crate) struct Work {
    is_many: bool,
    /// Number of archives.
    count: usize,
    failed: usize,
    is_complete: bool,
    progress: Progress,
    /// Bytes of the archives that are done, and of the one that is under way.
    done_bytes: u64,
    bytes: u64,
}

impl Work {
    /// Work on these `archives`.
    pub(crate) fn on(archives: &Archives) -> Self {
        let total = archives.files.iter().map(ArchiveFile::bytes).sum();
        Self {
            is_many: archives.is_many,
            count: archives.files.len(),
            failed: 0,
            is_complete: true,
            progress: Progress::new(Some(total), Unit::Bytes),
            done_bytes: 0,
            bytes: 0,
        }
    }

    /// Notes that `file` comes next.
    pub(crate) fn begin(&mut self, file: &ArchiveFile) {
        tracing::info!("reading {}", file.path.display());
        self.done_bytes += std::mem::replace(&mut self.bytes, file.bytes());
        self.progress.update(self.done_bytes);
    }

    /// Notes that `file` is done: of several at a time, none has begun.
    pub(crate) fn note_done(&mut self, file: &ArchiveFile) {
        self.done_bytes += file.bytes();
        self.progress.update(self.done_bytes);
    }

    /// Notes that this fraction of it, from 0 to 1, is done.
    pub(crate) fn note_part(&mut self, part: f64) {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            clippy::cast_precision_loss,
            reason = "a part of a count, for people to see"
        )]
        let of_file = (self.bytes as f64 * part.clamp(0.0, 1.0)) as u64;
        self.progress.update(self.done_bytes + of_file);
    }

    /// Begins `file` and opens it; as [`Work::take`].
    ///
    /// # Errors
    /// As [`Work::take`].
    pub(crate) fn open(&mut self, file: &ArchiveFile) -> Result<Option<Reader>> {
        self.begin(file);
        self.take(file, Reader::open(&file.path))
    }

    /// The result for `file`; `None` if it failed, after printing why.
    ///
    /// # Errors
    /// The error, if only that file was named, or standard output cannot be written.
    pub(crate) fn take<T, E>(&mut self, file: &ArchiveFile, had: Result<T, E>) -> Result<Option<T>>
    where
        E: Into<anyhow::Error>,
    {
        let error = match had {
            Ok(value) => return Ok(Some(value)),
            Err(error) => error.into(),
        };
        // If nothing can be printed, the file is not at fault.
        if !self.is_many || tapline_host::stdout::fault().is_some() {
            return Err(error);
        }
        self.failed += 1;
        let (path, why) = (file.path.display().to_string(), tapline_host::messages::with_causes(error.as_ref()));
        let text = if why.contains(&path) { format!("tapline: {why}") } else { format!("tapline: {path}: {why}") };
        self.beside(|| print_line(&text));
        Ok(None)
    }

    /// Has `write` write something else to the terminal.
    pub(crate) fn beside<R>(&self, write: impl FnOnce() -> R) -> R {
        self.progress.beside(write)
    }

    /// Whether a file has failed.
    pub(crate) fn has_failed(&self) -> bool {
        self.failed > 0
    }

    /// Notes whether the result for a file was complete.
    pub(crate) fn note(&mut self, is_complete: bool) {
        self.is_complete &= is_complete;
    }

    /// Ends the work; whether all files were done, and each was complete.
    ///
    /// # Errors
    /// That none was done.
    pub(crate) fn end(self) -> Result<bool> {
        let Self { count, failed, is_complete, progress, .. } = self;
        progress.finish();
        if failed > 0 && failed == count {
            bail!("none of {count} archives could be processed");
        }
        if failed > 0 {
            print_line(&format!("tapline: {failed} of {count} archives are left out, for the reasons above"));
        }
        Ok(is_complete && failed == 0)
    }
}
