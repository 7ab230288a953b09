//! The command line, parsed before anything is opened.

pub(crate) mod archives;
pub(crate) mod calibrate;
pub(crate) mod line;
pub(crate) mod model;
#[cfg(feature = "uplink")]
pub(crate) mod uplink;

use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand};
use serde::de::value::Error;
use serde::de::{DeserializeOwned, IntoDeserializer};
use tapline_host::arguments::{ForceArgs, LogArgs};
use tapline_model::EffectiveLength;
use tapline_store::Codec;

use crate::cli::archives::{ExportArgs, ImportArgs, ReferenceArgs, ReportArgs, ReprocessArgs, ResultsArgs};
use crate::cli::line::{LineArgs, RunArgs, StageArgs, StatusArgs};
use crate::cli::model::{ContactArgs, LENGTHS};

/// Finds hidden cracks in truck-tyre casings by tapping them and listening.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 100, after_help = EXIT_CODES)]
pub(crate) struct Cli {
    #[command(flatten)]
    pub log: LogArgs,
    #[command(subcommand)]
    pub verb: Verb,
}

const EXIT_CODES: &str =
    "Exit codes: 0: done. 1: failed. 2: wrong usage. 3: done, but something was missing, refused or left out.";

#[derive(Debug, Subcommand)]
pub(crate) enum Verb {
    /// Scan a list of casings, until each has its verdict: simulated tyres, or with --taps recorded taps.
    ///
    /// The results go into a folder, one file per casing. The same command again continues with what is missing. Ctrl-C ends
    /// the run cleanly.
    Run(RunArgs),
    /// Judge casings as they come to the stations of a configuration, until it is stopped.
    ///
    /// Each casing's verdict is printed, and its file is in its place, within a second of its last tap. Ctrl-C, or SIGTERM,
    /// ends the line cleanly; the same command again continues with the casings that were under way, on a rig only within `rig_patience_s`.
    Line(LineArgs),
    /// Show the state of a running line: its stations, casings, verdicts and alarms. It does not disturb the line.
    Status(StatusArgs),
    /// Simulate a rig for a station of a line: casings that come and go at random, over TCP. See docs/rig-protocol.md.
    Rig {
        /// Address to listen at.
        #[arg(long, default_value = "127.0.0.1:7001")]
        listen: String,
        /// Its configuration (TOML); defaults hold for what is left out.
        #[arg(long)]
        config: Option<PathBuf>,
        /// Print the address, and at the end what it did, as lines of JSON.
        #[arg(long)]
        json: bool,
    },
    /// List the sound cards that a station can listen to, and what they can record.
    Devices {
        /// Names of devices, as ALSA spells them; if left out, all that ALSA lists.
        names: Vec<String>,
        /// Print a line of JSON for each.
        #[arg(long)]
        json: bool,
    },
    /// Show what the sound card of a station gives: levels, the last tap, and what is found in it.
    ///
    /// Arrow keys change the trigger level, r clears, q ends.
    Monitor {
        /// The configuration with the station.
        #[arg(long)]
        config: PathBuf,
        /// Number of the station, where several listen.
        #[arg(long)]
        station: Option<u16>,
    },
    /// Calibrate a station: find the value of a full-scale sample in N, V or Pa, and write it into a file.
    Calibrate {
        #[command(subcommand)]
        verb: calibrate::CalibrateVerb,
    },
    /// Print a complete configuration with comments, or check one.
    Config(ConfigArgs),
    /// Print a script that completes tapline's verbs and options in a shell.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
    /// Write the manual pages, one page for each verb.
    Man {
        /// Folder to write into; created if it does not exist.
        folder: PathBuf,
        #[command(flatten)]
        force: ForceArgs,
    },
    /// One stage of a line, started by it.
    #[command(hide = true)]
    Stage(StageArgs),
    /// Write a table of archives, or their taps, in a format of other programs.
    ///
    /// A folder stands for every finished archive in it. A folder, or several files, gives one table whose first column is
    /// `file`; taps give one tap set.
    Export(ExportArgs),
    /// Make a tap set from recordings of other programs: WAV, CSV, HDF5, MATLAB, Universal Files, TDMS.
    ///
    /// A tap is a file, a part of one, or what a trigger finds in a continuous recording. A small configuration says which, and
    /// adds what the recordings do not state.
    Import(ImportArgs),
    /// Make a reference from archived shoulders that are known to be sound, or labelled location by location.
    Reference(ReferenceArgs),
    /// Check that archives hold every planned tap, that no tap or result in them was altered, and that they do not
    /// contradict themselves.
    ///
    /// Every sample is read and every checksum compared. Prints each problem on a line. Ends with code 1 if something was altered or
    /// cannot be read, with 3 if taps or verdicts are missing, or a folder has unfinished archives.
    Verify {
        /// Archives, or folders of them.
        #[arg(required = true)]
        archives: Vec<PathBuf>,
        /// Print a line of JSON for each archive; for several archives, also one with totals.
        #[arg(long)]
        json: bool,
    },
    /// Judge archives again: with other options, another reference, or a newer program.
    ///
    /// The archive is not changed. The results are in a file beside it, named after their lineage. Every other verb reads this
    /// file like an archive; in folders, only with --results. Prints the name of each file.
    Reprocess(ReprocessArgs),
    /// Write archives again with their samples packed differently; every sample is checked.
    Repack {
        /// Archives, or folders of them.
        #[arg(required = true)]
        archives: Vec<PathBuf>,
        /// What packs the samples of the new ones: none and gzip are read by every HDF5 program, gzip is slow to write; lz4 is
        /// fast and zstd smaller, both within Blosc.
        #[arg(long, value_parser = one_of::<Codec>(&["none", "lz4", "zstd", "gzip"]))]
        codec: Codec,
        /// The new archive; for a folder, or several files, a folder for the new ones. No archive is replaced.
        #[arg(long)]
        out: PathBuf,
        /// Print a line of JSON for each archive.
        #[arg(long)]
        json: bool,
    },
    /// Send the finished archives of a line to a centre, each once, over a NATS server.
    ///
    /// A file is sent until a centre confirms it; the line is not affected. Prints a line for each. See docs/uplink.md.
    #[cfg(feature = "uplink")]
    Uplink(uplink::UplinkArgs),
    /// Collect at a centre the archives that `tapline uplink` sends; several hosts may share the work.
    ///
    /// Each file is checked as by `tapline verify` before the sender gets a receipt. Prints a line for each.
    #[cfg(feature = "uplink")]
    Collect(uplink::CollectArgs),
    /// Show what an archive's numbers were made from: recorded taps, sources of the program, options, reference.
    Explain {
        /// Archives or files of results, or folders of archives.
        #[arg(required = true)]
        archives: Vec<PathBuf>,
        /// Also show this shoulder's verdict; of several archives, only the one that has it.
        #[arg(long, value_name = "TYRE/SHOULDER")]
        shoulder: Option<String>,
        /// Also show the index of this location, and the values of each of its taps.
        #[arg(long, requires = "shoulder", allow_negative_numbers = true)]
        location: Option<u32>,
        #[command(flatten)]
        results: ResultsArgs,
        /// Print a line of JSON for each archive.
        #[arg(long)]
        json: bool,
    },
    /// Show what changed from one archive's numbers to another's of the same taps: options and sources first, then numbers.
    ///
    /// Archives in two folders are paired by their paths in these; exit code 3 means that one has no partner.
    Diff {
        /// The archive before; or a folder of archives.
        before: PathBuf,
        /// The archive after; or a folder of archives.
        after: PathBuf,
        /// In the second folder, use the newest results of `tapline reprocess`: it may be the same folder.
        #[arg(long)]
        results: bool,
        /// Of folders, print only how many casings have the same numbers, and which verdicts differ.
        #[arg(long)]
        summary: bool,
        /// Print a line of JSON for each pair of archives.
        #[arg(long)]
        json: bool,
    },
    /// Write what archives hold as pages to read and print: one page for each casing and one for the shift.
    ///
    /// Each page is one HTML file that needs nothing else. Of an archive with missing taps the pages
    /// show what is there.
    Report(ReportArgs),
    /// The contact models.
    #[command(subcommand)]
    Model(ModelVerb),
}

/// What is done with a configuration.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
pub(crate) struct ConfigArgs {
    /// Print a complete configuration, every key with its default and what it means.
    #[arg(long)]
    pub example: bool,
    /// Check this configuration, as a line or a run does before it begins.
    #[arg(long, value_name = "FILE")]
    pub check: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum ModelVerb {
    /// Print one of the dissertation's tables, computed, as CSV.
    Table {
        /// Number of the table: 4, 5, 6, 8, 9, 10 or 11.
        number: u8,
        /// How the effective length of a crack is computed: as the printed tables used it, or as the text describes it.
        #[arg(long, value_parser = one_of::<EffectiveLength>(&LENGTHS), default_value = "published")]
        effective_length: EffectiveLength,
        /// Print it as JSON, an object a row.
        #[arg(long)]
        json: bool,
    },
    /// Print what one contact does, with a given model or with the cheapest one that is accurate enough.
    Contact(ContactArgs),
}

/// Refuses what this build of the program lacks because it has no `feature`.
pub(crate) fn built_without<T>(what: &str, feature: &str) -> anyhow::Result<T> {
    anyhow::bail!("this program was built without {what}: build it with `--features {feature}`")
}

/// Takes one of `names`, by which configurations name a `T`.
fn one_of<T>(names: &'static [&'static str]) -> impl TypedValueParser<Value = T>
where
    T: DeserializeOwned + Clone + Send + Sync + 'static,
{
    let parse = |name: String| T::deserialize(IntoDeserializer::<Error>::into_deserializer(name));
    PossibleValuesParser::new(names.iter().copied()).try_map(parse)
}
