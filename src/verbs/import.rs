//! `tapline import`: a tap set of recordings of other programs.

use std::io::Write as _;
use std::path::Path;

use anyhow::{Result, bail};
use serde_json::json;
use tapline_host::messages::{counted, say};
use tapline_host::progress::{Progress, Unit};
use tapline_host::signals::note_folder;
use tapline_host::stdout::Stdout;
use tapline_import::{Imported, write_example};

use crate::cli::archives::ImportArgs;

/// Most refused taps that are printed; the set lists all.
const REFUSED_MAX: usize = 10;

/// Imports; whether every tap could be read.
pub(crate) fn import(args: &ImportArgs) -> Result<bool> {
    let (config, out) = match (&args.example, &args.config, &args.out) {
        (Some(folder), ..) => return example(folder),
        (None, Some(config), Some(out)) => (config, out),
        _ => bail!("--config and --out are needed"),
    };
    note_folder(out);
    let Imported { written, refused, unread, unscaled } = {
        let mut progress = None;
        tapline_import::import(&args.files, config, out, |done, total| {
            let new = || Progress::new(Some(total as u64), Unit::Things("recordings"));
            progress.get_or_insert_with(new).update(done as u64);
        })?
    };
    let is_whole = refused.is_empty() && unread.is_empty();
    if args.json {
        let unscaled: Vec<_> = unscaled.iter().map(|(channel, _)| channel).collect();
        let text = json!({
            "out": out.display().to_string(), "written": written, "refused": refused, "unread": unread,
            "unscaled": unscaled,
        });
        writeln!(Stdout, "{text}")?;
        return Ok(is_whole);
    }
    for reason in unread.iter().take(REFUSED_MAX) {
        say(&format!("not imported: {reason}"));
    }
    for reason in refused.iter().take(REFUSED_MAX) {
        say(&format!("refused: {reason}"));
    }
    if !unscaled.is_empty() {
        let named = |(channel, unit): &(&str, Option<String>)| match unit {
            Some(unit) => format!("{channel} (in {unit:?})"),
            None => (*channel).to_owned(),
        };
        let channels = unscaled.iter().map(named).collect::<Vec<_>>().join(" and ");
        say(&format!(
            "the scale of {channels} is not known: values are parts of full scale (FS); of floats 1.0 is full scale"
        ));
    }
    let mut why = if refused.is_empty() { String::new() } else { "; taps.csv lists them with the reason".to_owned() };
    if !unread.is_empty() {
        why.push_str(&format!("; {} not imported", counted(unread.len(), "file", "files")));
    }
    let written = counted(written, "tap", "taps");
    writeln!(Stdout, "{}: {written} written, {} refused{why}", out.display(), refused.len())?;
    Ok(is_whole)
}

fn example(folder: &Path) -> Result<bool> {
    let (files, config) = write_example(folder)?;
    let (folder, config) = (folder.display(), config.display());
    let mut out = Stdout;
    writeln!(out, "{} recordings of a simulated shoulder. Import and judge them:", files.len())?;
    writeln!(out, "tapline import {folder}/recordings/*.wav --config {config} --out {folder}/taps")?;
    writeln!(out, "tapline run --taps {folder}/taps --reference self --out {folder}/judged")?;
    Ok(true)
}
