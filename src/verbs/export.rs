//! `tapline export`: tables and taps for other programs.

use std::cell::RefCell;
use std::io::{self, BufWriter, IsTerminal as _, Write};
use std::path::Path;

use anyhow::{Result, bail};
use clap::ValueEnum;
use serde_json::json;
use tapline_export::{Error, Export, TableFile, TapCounts, TapFormat};
use tapline_host::atomic_file::{check_writable, write_atomically};
use tapline_host::messages::counted;
use tapline_host::signals::note_folder;
use tapline_host::stdout::Stdout;
use tapline_store::Reader;

use crate::archives::Archives;
use crate::archives::work::Work;
use crate::cli::archives::{ExportArgs, Format, What};
#[cfg(not(feature = "parquet"))]
use crate::cli::built_without;

/// Formats of a table.
const OF_TABLES: [Format; 2] = [Format::Csv, Format::Parquet];

/// Formats of the taps.
const OF_TAPS: [Format; 3] = [Format::Wav, Format::Uff, Format::Mat];

/// Exports; whether nothing was missing.
pub(crate) fn export(args: &ExportArgs) -> Result<bool> {
    let table = match args.what {
        What::Discriminators => Export::Discriminators,
        What::Damage => Export::Damage,
        What::Regions => Export::Regions,
        What::Verdicts => Export::Verdicts,
        What::Ledger => Export::Ledger,
        What::Casings => Export::Casings,
        What::Taps => return taps(args),
    };
    let format = allowed(args, &OF_TABLES)?;
    let archives = Archives::find(&args.archives, args.results.which())?;
    match &args.out {
        None if format == Format::Parquet && io::stdout().is_terminal() => {
            bail!("Parquet is not text for a terminal; name a file with --out, or redirect the output");
        }
        None => write(&archives, table, format, BufWriter::new(Stdout)),
        Some(path) => {
            check_writable(path, args.force.existing())?;
            let mut is_complete = false;
            write_atomically(path, args.force.existing(), |file| {
                is_complete = write(&archives, table, format, BufWriter::new(file))?;
                anyhow::Ok(())
            })?;
            if args.json {
                print_json(args, path, format, is_complete, TapCounts::default())?;
            }
            Ok(is_complete)
        }
    }
}

/// Writes the table of all archives, one at a time; whether none was left out.
fn write(archives: &Archives, table: Export, format: Format, out: impl Write + Send) -> Result<bool> {
    let mut file = match format {
        #[cfg(feature = "parquet")]
        Format::Parquet => TableFile::parquet(table, out),
        #[cfg(not(feature = "parquet"))]
        Format::Parquet => return built_without("Parquet", "parquet"),
        _ => TableFile::csv(table, out),
    };
    let mut work = Work::on(archives);
    for archive in &archives.files {
        work.begin(archive);
        let name = archive.name.to_string_lossy();
        let reader = Reader::open(&archive.path).map_err(Error::from);
        let added = reader.and_then(|reader| file.add(&reader, archives.is_many.then_some(&*name)));
        match added {
            Ok(()) => Some(()),
            Err(Error::Archive(error)) => work.take(archive, Err(error))?,
            // If the table cannot be written, the others need not be tried.
            Err(error) => return Err(error.into()),
        };
    }
    let is_complete = work.end()?;
    file.finish()?;
    Ok(is_complete)
}

fn taps(args: &ExportArgs) -> Result<bool> {
    let format = allowed(args, &OF_TAPS)?;
    let Some(folder) = &args.out else {
        bail!("taps are many files; name a new or empty folder for them with --out");
    };
    if args.force.force {
        bail!("--force does not go with taps: {} must be a new or empty folder", folder.display());
    }
    let archives = Archives::find(&args.archives, args.results.which())?;
    // One that cannot be read is named below.
    tap_format(format).check(archives.files.iter().filter_map(|file| Reader::open(&file.path).ok()))?;
    let mut work = Work::on(&archives);
    note_folder(folder);
    // If nothing can be read, no folder is left.
    let mut out = None;
    for archive in &archives.files {
        let Some(reader) = work.open(archive)? else { continue };
        let out = match &mut out {
            Some(out) => out,
            none => none.insert(tap_format(format).begin(folder)?),
        };
        // Some taps of the archive may be in the folder already: they are removed.
        let shown = RefCell::new(&mut work);
        out.add(&reader, &|part| shown.borrow_mut().note_part(part))?;
    }
    let is_complete = work.end()?;
    let counts = out.map(|out| out.finish()).transpose()?.unwrap_or_default();
    let TapCounts { written, refused, missing, damaged } = counts;
    if args.json {
        let is_complete = is_complete && refused + missing + damaged == 0;
        print_json(args, folder, format, is_complete, counts)?;
        return Ok(is_complete);
    }
    let hurt = if damaged == 0 { String::new() } else { format!(", {damaged} damaged") };
    let is_listed = refused + missing + damaged > 0;
    let why = if is_listed { "; taps.csv lists them with the reason" } else { "" };
    let (folder, written) = (folder.display(), counted(written, "tap", "taps"));
    writeln!(Stdout, "{folder}: {written} written, {refused} refused, {missing} missing{hurt}{why}")?;
    Ok(is_complete && !is_listed)
}

fn tap_format(format: Format) -> TapFormat {
    match format {
        Format::Uff => TapFormat::Uff,
        Format::Mat => TapFormat::Mat,
        _ => TapFormat::Wav,
    }
}

/// The format that is asked for, or the first of the possible `formats`.
fn allowed(args: &ExportArgs, formats: &[Format]) -> Result<Format> {
    let format = args.format.unwrap_or(formats[0]);
    if formats.contains(&format) {
        return Ok(format);
    }
    let known = formats.iter().map(name).collect::<Vec<_>>().join(" or ");
    bail!("--format {} does not go with {}; it must be {known}", name(&format), name(&args.what))
}

/// What was written, as JSON.
fn print_json(args: &ExportArgs, out: &Path, format: Format, is_complete: bool, counts: TapCounts) -> Result<()> {
    let mut text = json!({
        "out": out.display().to_string(), "what": name(&args.what), "format": name(&format), "is_complete": is_complete,
    });
    if args.what == What::Taps {
        let TapCounts { written, refused, missing, damaged } = counts;
        for (key, count) in [("written", written), ("refused", refused), ("missing", missing), ("damaged", damaged)] {
            text[key] = count.into();
        }
    }
    Ok(writeln!(Stdout, "{text}")?)
}

/// How the command line spells a value.
fn name(value: &impl ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}
