//! The verb `export`: what an archive holds, for other programs.

use std::io::{self, BufWriter, IsTerminal as _, Write};

use anyhow::{Result, bail};
use clap::ValueEnum as _;
use tapline_store::{Export, Reader, TapCounts, UffEncoding, export_parquet, export_tap_set, export_uff};

use crate::cli::{ExportArgs, Format, What};
use crate::whole::whole_file;

/// Formats of a table.
const OF_TABLES: [Format; 2] = [Format::Csv, Format::Parquet];

/// Formats of the taps.
const OF_TAPS: [Format; 3] = [Format::Wav, Format::Uff, Format::UffAscii];

/// Does the verb; whether all that was asked for was there.
pub(crate) fn export(args: &ExportArgs) -> Result<bool> {
    let table = match args.what {
        What::Discriminators => Export::Discriminators,
        What::Damage => Export::Damage,
        What::Regions => Export::Regions,
        What::Verdicts => Export::Verdicts,
        What::Ledger => Export::Ledger,
        What::Taps => return taps(args),
    };
    let format = allowed(args, &OF_TABLES)?;
    let reader = Reader::open(&args.archive)?;
    match &args.out {
        None if format == Format::Parquet && io::stdout().is_terminal() => {
            bail!("Parquet is no text for a terminal; name a file with --out, or redirect the output");
        }
        None => quiet_pipe(write(&reader, table, format, BufWriter::new(io::stdout())))?,
        Some(path) => whole_file(path, |file| write(&reader, table, format, BufWriter::new(file)))?,
    }
    // Of what was torn a table alone says nothing.
    Ok(!reader.is_torn())
}

fn write(reader: &Reader, table: Export, format: Format, out: impl Write + Send) -> tapline_store::Result<()> {
    if format == Format::Parquet {
        export_parquet(reader, table, out)
    } else {
        tapline_store::export(reader, table, out)
    }
}

fn taps(args: &ExportArgs) -> Result<bool> {
    let format = allowed(args, &OF_TAPS)?;
    let Some(folder) = &args.out else {
        bail!("taps are many files; name a new or empty folder for them with --out");
    };
    let reader = Reader::open(&args.archive)?;
    let counts = match format {
        Format::Uff => export_uff(&reader, folder, UffEncoding::Binary),
        Format::UffAscii => export_uff(&reader, folder, UffEncoding::Ascii),
        _ => export_tap_set(&reader, folder),
    };
    let TapCounts { written, refused, missing, damaged } = counts?;
    let is_whole = refused == 0 && missing == 0 && damaged == 0 && !reader.is_torn();
    let hurt = if damaged == 0 { String::new() } else { format!(", {damaged} damaged") };
    let is_listed = refused + missing + damaged > 0;
    let why = if is_listed { "; taps.csv says which and why" } else { "" };
    let folder = folder.display();
    writeln!(io::stdout().lock(), "{folder}: {written} taps written, {refused} refused, {missing} missing{hurt}{why}")?;
    Ok(is_whole)
}

/// The format that is asked for, or the first of `formats`, which are those that there are.
fn allowed(args: &ExportArgs, formats: &[Format]) -> Result<Format> {
    let format = args.format.unwrap_or(formats[0]);
    if formats.contains(&format) {
        return Ok(format);
    }
    let name = |format: &Format| format.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned());
    let what = args.what.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned());
    let known = formats.iter().map(name).collect::<Vec<_>>().join(" or ");
    bail!("--format {} does not go with {what}; it must be {known}", name(&format))
}

/// A reader that has seen enough, as `head` has, is no failure.
fn quiet_pipe(written: tapline_store::Result<()>) -> Result<()> {
    match written {
        Err(tapline_store::Error::Csv(error)) if matches!(error.kind(), csv::ErrorKind::Io(e) if e.kind() == io::ErrorKind::BrokenPipe) => {
            Ok(())
        }
        other => Ok(other?),
    }
}
