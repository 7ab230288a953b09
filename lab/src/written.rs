//! Files that a verb writes, and how it prints their paths.

use std::io::Write as _;
use std::path::PathBuf;

use anyhow::{Context as _, Result};
use clap::Args;
use serde_json::json;
use tapline_host::arguments::ForceArgs;
use tapline_host::atomic_file::{check_writable, write_texts};
use tapline_host::stdout::Stdout;

/// How a verb writes its files.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct WrittenArgs {
    #[command(flatten)]
    force: ForceArgs,
    /// Print a line of JSON for each file.
    #[arg(long)]
    json: bool,
}

impl WrittenArgs {
    /// Checks, before the work starts, that a file that is always written may be written.
    ///
    /// # Errors
    /// The file exists and must not be replaced.
    pub(crate) fn check(self, path: &std::path::Path) -> Result<()> {
        Ok(check_writable(path, self.force.existing())?)
    }

    /// Writes texts to their paths and prints the paths. If one of the files may not be written, none is.
    ///
    /// # Errors
    /// An error of the file system, or a file that must not be replaced.
    pub(crate) fn write(self, files: &[(PathBuf, String)]) -> Result<()> {
        write_texts(files, self.force.existing())?;
        let mut out = Stdout;
        files.iter().try_for_each(|(path, _)| {
            let path = path.display().to_string();
            writeln!(out, "{}", if self.json { json!({ "file": path }).to_string() } else { path })
                .context("cannot write to standard output")
        })
    }
}
