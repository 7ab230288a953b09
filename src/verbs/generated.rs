//! `tapline completions` and `tapline man`: what is made of the description of the command line.

use std::path::Path;

use anyhow::Result;
use clap::Command;
use clap_complete::Shell;
use tapline_host::atomic_file::{Existing, check_folder};

use tapline_host::stdout::Stdout;

/// Prints the completions for `shell`.
pub(crate) fn completions(command: Command, shell: Shell) -> Result<bool> {
    tapline_host::generated::completions(command, shell, &mut Stdout)?;
    Ok(true)
}

/// Writes the manual pages into `folder`.
pub(crate) fn man(command: Command, folder: &Path, existing: Existing) -> Result<bool> {
    check_folder(folder, existing)?;
    tapline_host::generated::manual(command, folder)
        .map_err(|(path, error)| anyhow::Error::from(error).context(format!("cannot write {}", path.display())))?;
    Ok(true)
}
