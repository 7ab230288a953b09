//! Options of the verbs that read archives, or recordings of other programs.

use std::path::PathBuf;

use anyhow::{Context as _, Result};
use clap::{Args, ValueEnum};
use jiff::Timestamp;
use jiff::civil::DateTime;
use jiff::tz::TimeZone;
use tapline_host::arguments::ForceArgs;

use crate::archives::Which;

#[derive(Debug, Args)]
pub(crate) struct ReferenceArgs {
    /// Archives to take shoulders from, or folders of them.
    #[arg(required = true)]
    pub archives: Vec<PathBuf>,
    #[command(flatten)]
    pub results: ResultsArgs,
    /// A shoulder to take; repeat the option for several. If left out, all that passed, or with --labelled all.
    #[arg(long = "shoulder", value_name = "TYRE/SHOULDER")]
    pub shoulders: Vec<String>,
    /// Use the truth in the archives as the label of each location; without this option every shoulder counts as sound.
    #[arg(long)]
    pub labelled: bool,
    /// Learn from the labels which way each discriminator moves with damage, where 20 cracked and 20 sound locations show it; the
    /// others keep the direction of the configuration.
    #[arg(long, requires = "labelled")]
    pub learn_directions: bool,
    /// Configuration file whose `[fuse]` has the directions, discriminators and rates; if left out, that of the first archive.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// File to write, whose name ends in .json.
    #[arg(long)]
    pub out: PathBuf,
    #[command(flatten)]
    pub force: ForceArgs,
    /// Describe the reference as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Which files of a folder a verb takes.
#[derive(Debug, Clone, Copy, Args)]
pub(crate) struct ResultsArgs {
    /// In folders, use each casing's newest `tapline reprocess` results instead of its archive.
    #[arg(long)]
    results: bool,
}

impl ResultsArgs {
    pub(crate) fn which(self) -> Which {
        Which::results_if(self.results)
    }
}

#[derive(Debug, Args)]
pub(crate) struct ReprocessArgs {
    /// The archives, or folders of them.
    #[arg(required = true)]
    pub archives: Vec<PathBuf>,
    /// Configuration file. Its tables `process` and `fuse` replace the archive's tables completely: options that it does not
    /// name get their defaults; the reference is kept, unless it names one. Without this file each archive keeps its own.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// What shoulders are compared with, in place of the configuration's reference, as for `tapline run`.
    #[arg(long, value_name = "FILE.json|TYRE/SHOULDER|self")]
    pub reference: Option<String>,
    /// Number of threads; if left out, one per core. It changes no result.
    #[arg(long, default_value_t = 0)]
    pub jobs: usize,
    /// Read the samples even where the archive's own discriminators were made by the same options and sources; taps that
    /// results of the same lineage have already are not read again.
    #[arg(long)]
    pub from_samples: bool,
    /// Print a line of JSON for each archive.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
#[command(
    after_help = "docs/import.md has every key of the configuration. `tapline import --example DIR` writes one that works."
)]
pub(crate) struct ImportArgs {
    /// The recordings.
    #[arg(required_unless_present = "example", conflicts_with = "example")]
    pub files: Vec<PathBuf>,
    /// What they are (TOML): names of files or a table, channels, rate, scales.
    #[arg(long, required_unless_present = "example", conflicts_with = "example")]
    pub config: Option<PathBuf>,
    /// Folder for the tap set, which must be new or empty.
    #[arg(long, required_unless_present = "example", conflicts_with = "example")]
    pub out: Option<PathBuf>,
    /// Write recordings and a configuration to start from into this folder, and print the commands that import and judge them.
    #[arg(long, value_name = "DIR")]
    pub example: Option<PathBuf>,
    /// Print what was imported as JSON.
    #[arg(long, conflicts_with = "example")]
    pub json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct ReportArgs {
    /// Archives or files of results, or folders of archives.
    #[arg(required = true)]
    pub archives: Vec<PathBuf>,
    /// Folder to write into, created if it does not exist; if left out, the first archive's or folder's name with `-report`,
    /// in this folder.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// A configuration whose table `[report]` is printed, in place of the archive's.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Name of the shift, on its page.
    #[arg(long)]
    pub shift: Option<String>,
    /// Only casings whose last tap was made at this time or later, such as 2026-11-30T22:00: local time, unless it has an offset.
    #[arg(long, value_name = "TIME", value_parser = time)]
    pub from: Option<Timestamp>,
    /// Only casings whose last tap was made before this time.
    #[arg(long, value_name = "TIME", value_parser = time)]
    pub to: Option<Timestamp>,
    /// Write only the page of the shift, for many casings.
    #[arg(long)]
    pub shift_only: bool,
    #[command(flatten)]
    pub results: ResultsArgs,
    #[command(flatten)]
    pub force: ForceArgs,
    /// Print a line of JSON for each page.
    #[arg(long)]
    pub json: bool,
}

/// A time as people write it: of this machine's zone, unless it says of which.
fn time(text: &str) -> Result<Timestamp> {
    if let Ok(time) = text.parse::<Timestamp>() {
        return Ok(time);
    }
    let local: DateTime =
        text.parse().context("it must be a time such as 2026-11-30T22:00 or 2026-11-30T22:00+01:00")?;
    Ok(local.to_zoned(TimeZone::system())?.timestamp())
}

#[derive(Debug, Args)]
#[command(after_help = EXPORT_FORMATS)]
pub(crate) struct ExportArgs {
    /// Archives or files of results, or folders of archives.
    #[arg(required = true)]
    pub archives: Vec<PathBuf>,
    /// What to write; it follows the archives, without an option between them.
    #[arg(value_enum, value_name = "WHAT")]
    pub what: What,
    /// Format; if left out, csv for a table and wav for the taps.
    #[arg(long, value_enum)]
    pub format: Option<Format>,
    #[command(flatten)]
    pub results: ResultsArgs,
    /// File to write a table into, standard output when left out; for the taps a folder, which must be new or empty.
    #[arg(long)]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub force: ForceArgs,
    /// Print what was written as JSON.
    #[arg(long, requires = "out")]
    pub json: bool,
}

const EXPORT_FORMATS: &str = "\
A table as parquet has the columns and rows of the csv, typed, with units; sets of flags also as bits.

Taps as wav are a tap set: `tapline run --taps FOLDER --config FOLDER/config.toml` scans them again. Archives whose \
recordings or configurations differ are exported one by one.

Taps as uff are one file for each shoulder, dataset 58b; as mat one file for each shoulder, with the \
matrices force and sound, which have a column for each tap. Both name the units; FS is part of full scale, where the scale \
is not known.

Taps that were refused, are missing or damaged are counted, and listed in taps.csv (column `refused`); then the exit code \
is 3. It is also 3 if one of several archives cannot be read: it is named, and the others are exported.";

/// What of an archive can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum What {
    /// What was found in every tap.
    Discriminators,
    /// The damage index of every location.
    Damage,
    /// The regions of damage.
    Regions,
    /// The verdict on every shoulder.
    Verdicts,
    /// What became of every planned tap.
    Ledger,
    /// Every casing: its verdict, reference, calibration, operator, program and digests.
    Casings,
    /// The samples of every tap.
    Taps,
}

/// In what format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    /// A table as text.
    Csv,
    /// A table with types and units, compressed by snappy.
    Parquet,
    /// Taps as a tap set, one WAV each.
    Wav,
    /// Taps as Universal Files, dataset 58b.
    Uff,
    /// Taps as MATLAB files of version 7.
    Mat,
}
