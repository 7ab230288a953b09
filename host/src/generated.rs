//! Output generated from the description of a program's arguments: shell completions and manual pages.

use std::fs;
use std::io::{self, Write};
use std::path::Path;

use clap::Command;
use clap_complete::{Shell, generate};
use clap_mangen::Man;

use crate::atomic_file::WriteError;

/// Writes the completions of `command` for `shell` to `out`.
///
/// # Errors
/// If `out` cannot be written.
pub fn completions(mut command: Command, shell: Shell, out: &mut impl Write) -> io::Result<()> {
    let name = command.get_name().to_owned();
    // Writes into memory first, because the generator panics if it cannot write.
    let mut text = Vec::new();
    generate(shell, &mut command, name, &mut text);
    out.write_all(&text)
}

/// Writes the manual pages of `command`, one page per verb, into `folder`, which is made if missing.
///
/// # Errors
/// [`WriteError::Failed`].
pub fn manual(mut command: Command, folder: &Path) -> Result<(), WriteError> {
    // Gives each verb the options that all verbs share.
    command.build();
    fs::create_dir_all(folder).map_err(|error| failed(folder, error))?;
    let name = command.get_name().to_owned();
    write_page(command, [&name, &name], folder)
}

/// Writes the page of `command` and those of its verbs. The names are that of the page and how the command is called.
fn write_page(command: Command, [name, called]: [&str; 2], folder: &Path) -> Result<(), WriteError> {
    let command = command.disable_help_subcommand(true).display_name(name.to_owned()).bin_name(called.to_owned());
    for verb in command.get_subcommands().filter(|verb| !verb.is_hide_set() && verb.get_name() != "help") {
        let [name, called] = [(name, "-"), (called, " ")].map(|(of, mark)| format!("{of}{mark}{}", verb.get_name()));
        write_page(verb.clone(), [&name, &called], folder)?;
    }
    let page = folder.join(format!("{name}.1"));
    let mut text = Vec::new();
    let written = Man::new(command).title(name.to_uppercase()).render(&mut text);
    written.and_then(|()| fs::write(&page, &text)).map_err(|error| failed(&page, error))
}

fn failed(path: &Path, error: io::Error) -> WriteError {
    WriteError::Failed { path: path.to_owned(), source: error.into() }
}
