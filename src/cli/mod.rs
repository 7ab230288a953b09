//! The command line, parsed before anything is opened.

pub(crate) mod calibrate;
pub(crate) mod model;

#[cfg(feature = "serve")]
use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

use crate::archives::Which;
use crate::cli::model::{ContactArgs, Length};
use tapline_host::arguments::{ForceArgs, LogArgs};

/// Finds hidden cracks in truck-tyre casings by tapping them and listening.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 100, after_help = EXIT_CODES)]
pub(crate) struct Cli {
    #[command(flatten)]
    pub log: LogArgs,
    #[command(subcommand)]
    pub verb: Verb,
}

const EXIT_CODES: &str = "Exit codes: 0 done; 1 failed; 2 wrong usage; 3 ended, but taps are missing or refused, or an archive is incomplete or was left out.";

#[derive(Debug, Subcommand)]
pub(crate) enum Verb {
    /// Scan a list of casings, until each has its verdict: simulated tyres, or with --taps recorded taps.
    ///
    /// The results go into a folder, one file a casing. The same command again goes on with what is missing. Ctrl-C ends
    /// the run in good order.
    Run(RunArgs),
    /// Judge casings as they come to the stations of a configuration, for as long as it is left on.
    ///
    /// Each casing's verdict is printed, and its file is in its place, within a second of its last tap. Ctrl-C, or SIGTERM,
    /// ends the line in good order; the same command again goes on with the casings that were under way.
    Line(LineArgs),
    /// Show how a running line is: its stations, casings, verdicts and alarms. The line does not notice.
    Status(StatusArgs),
    /// Play a rig for a station of a line: casings that come and go at random, over TCP. See docs/rig-protocol.md.
    Rig {
        /// Address to listen at.
        #[arg(long, default_value = "127.0.0.1:7001")]
        listen: String,
        /// What it does (TOML); defaults hold for what is left out.
        #[arg(long)]
        config: Option<PathBuf>,
        /// Print the address, and at the end what it did, as lines of JSON.
        #[arg(long)]
        json: bool,
    },
    /// List the sound cards that a station can listen to, and what they can record.
    #[cfg(feature = "alsa")]
    Devices {
        /// Names of devices, as ALSA spells them; all that it lists when left out.
        names: Vec<String>,
        /// Print a line of JSON for each.
        #[arg(long)]
        json: bool,
    },
    /// Show what the sound card of a station gives: levels, the last tap, and what is found in it.
    #[cfg(feature = "alsa")]
    Monitor {
        /// The configuration with the station.
        #[arg(long)]
        config: PathBuf,
        /// Number of the station, where several listen.
        #[arg(long)]
        station: Option<u16>,
    },
    /// Find what full-scale samples of a station are worth, in N, V or Pa, and keep it in a file.
    Calibrate {
        #[command(subcommand)]
        verb: calibrate::CalibrateVerb,
    },
    /// Print a complete configuration with comments, or check one.
    Config(ConfigArgs),
    /// Print what completes tapline's verbs and options at the prompt of a shell.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
    /// Write the manual pages, one a verb.
    Man {
        /// Folder to write into; made when it is not there.
        folder: PathBuf,
        #[command(flatten)]
        force: ForceArgs,
    },
    /// One stage of a line, started by it.
    #[command(hide = true)]
    Stage(StageArgs),
    /// Write a table of archives, or their taps, in a format of other programs.
    ///
    /// A folder stands for every finished archive in it. Of a folder, and of several files, it is one table, with a first
    /// column `file`; taps are one tap set.
    Export(ExportArgs),
    /// Make a tap set of recordings of other programs: WAV, CSV, HDF5, MATLAB, Universal Files, TDMS.
    ///
    /// A file, a part of one, or what a trigger finds in a continuous record is a tap. A small configuration says which, and what
    /// the recordings do not say of themselves.
    Import(ImportArgs),
    /// Make a reference of shoulders of archives: stated to be sound, or labelled by what is known of them.
    Reference(ReferenceArgs),
    /// Check that archives hold all their plans ask for, that no tap or result in them was altered, and that they do not
    /// contradict themselves.
    ///
    /// Every sample is read and every checksum compared. Prints what is amiss, a line each, and ends with code 3 then, or
    /// where a folder has archives that are not finished.
    Verify {
        /// Archives, or folders of them.
        #[arg(required = true)]
        archives: Vec<PathBuf>,
        /// Print the report as JSON; of several archives a line each, and one that sums up.
        #[arg(long)]
        json: bool,
    },
    /// Judge archives again: with other options, another reference, or by a newer program.
    ///
    /// The archive is not touched. The results stand beside it in a file named after their lineage, which every other verb
    /// takes as an archive, and of folders with --results. Prints the name of each file.
    Reprocess(ReprocessArgs),
    /// Write archives again, their samples packed otherwise; every sample is checked on the way.
    Repack {
        /// Archives, or folders of them.
        #[arg(required = true)]
        archives: Vec<PathBuf>,
        /// What packs the samples of the new ones.
        #[arg(long, value_enum)]
        codec: PackedBy,
        /// The new archive; of a folder, or of several files, a folder for them. No archive is replaced.
        #[arg(long)]
        out: PathBuf,
        /// Print a line of JSON for each archive.
        #[arg(long)]
        json: bool,
    },
    /// Show what an archive's numbers are made of and by: recorded taps, sources of the program, options, reference.
    Explain {
        /// Archives or files of results, or folders of archives.
        #[arg(required = true)]
        archives: Vec<PathBuf>,
        /// Of this shoulder the verdict too; of folders and several files only the archive that has it.
        #[arg(long, value_name = "TYRE/SHOULDER")]
        shoulder: Option<String>,
        /// Of this location of it the index, and what was found in every tap.
        #[arg(long, requires = "shoulder")]
        location: Option<u32>,
        #[command(flatten)]
        results: ResultsArgs,
        /// Print a line of JSON for each archive.
        #[arg(long)]
        json: bool,
    },
    /// Show what changed from one archive's numbers to another's of the same taps: options and sources first, then numbers.
    ///
    /// Archives in folders are paired by the casing's name; exit code 3 means that one has no partner.
    Diff {
        /// The archive before; or a folder of archives.
        before: PathBuf,
        /// The archive after; or a folder of archives.
        after: PathBuf,
        /// Of the second folder take the newest results of `tapline reprocess`: it may be the same folder.
        #[arg(long)]
        results: bool,
        /// Print a line of JSON for each pair of archives.
        #[arg(long)]
        json: bool,
    },
    /// Write what archives hold as pages to read and print: one a tyre, and one of the whole shift.
    ///
    /// Each page is one HTML file that needs nothing else. Of an archive with missing taps the pages
    /// show what is there.
    Report {
        /// Archives or files of results, or folders of archives.
        #[arg(required = true)]
        archives: Vec<PathBuf>,
        /// Folder to write into, made when it is not there; the first archive's or folder's name with `-report`, in this
        /// folder, when left out.
        #[arg(long)]
        out: Option<PathBuf>,
        /// A configuration whose table `[report]` is printed, in place of the archive's.
        #[arg(long)]
        config: Option<PathBuf>,
        /// Name of the shift, on its page.
        #[arg(long)]
        shift: Option<String>,
        #[command(flatten)]
        results: ResultsArgs,
        #[command(flatten)]
        force: ForceArgs,
        /// Print a line of JSON for each page.
        #[arg(long)]
        json: bool,
    },
    /// The contact models.
    #[command(subcommand)]
    Model(ModelVerb),
}

#[derive(Debug, Args)]
pub(crate) struct SourceArgs {
    /// Configuration file (TOML); defaults hold for what it leaves out.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Folder of recorded taps (a tap set) to scan instead of simulated tyres.
    #[arg(long)]
    pub taps: Option<PathBuf>,
    /// Folder for the results, one file a casing; `simulated`, or the name of the tap set, in this folder when left out.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// What shoulders are compared with, in place of the configuration's reference: the file of a reference (`tapline reference`
    /// makes one), TYRE/SHOULDER of the casing itself, or `self`: each tyre with itself, where damage all round does not show.
    #[arg(long, value_name = "FILE.json|TYRE/SHOULDER|self")]
    pub reference: Option<String>,
    /// Stations: how many are simulated, or over how many the shoulders of a tap set are shared out.
    #[arg(long)]
    pub stations: Option<u16>,
}

#[derive(Debug, Args)]
pub(crate) struct ReferenceArgs {
    /// Archives to take shoulders from, or folders of them.
    #[arg(required = true)]
    pub archives: Vec<PathBuf>,
    #[command(flatten)]
    pub results: ResultsArgs,
    /// A shoulder to take, several times for several; when left out, all that passed, or with --labelled all.
    #[arg(long = "shoulder", value_name = "TYRE/SHOULDER")]
    pub shoulders: Vec<String>,
    /// Take what the archives know of each location for its label; without it every shoulder is taken to be sound.
    #[arg(long)]
    pub labelled: bool,
    /// Learn from the labels which way each discriminator moves with damage, where they show it.
    #[arg(long, requires = "labelled")]
    pub learn_directions: bool,
    /// Configuration file, for directions and rate of false calls; that of the first archive when left out.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// File to write, whose name ends in .json.
    #[arg(long)]
    pub out: PathBuf,
    #[command(flatten)]
    pub force: ForceArgs,
    /// Print what the reference is as JSON.
    #[arg(long)]
    pub json: bool,
}

/// What packs samples.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum PackedBy {
    /// Nothing: read by every HDF5 program.
    None,
    /// Blosc with LZ4: fast.
    Lz4,
    /// Blosc with Zstandard: smaller.
    Zstd,
    /// Deflate: read by every HDF5 program, slow to write.
    Gzip,
}

/// Which files of a folder a verb takes.
#[derive(Debug, Clone, Copy, Args)]
pub(crate) struct ResultsArgs {
    /// Of folders take, of each casing, the newest results of `tapline reprocess` instead of its archive.
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
    /// Configuration file whose tables `process` and `fuse` take the place of the archive's, whole: an option that it does not
    /// name has its default, but for the reference. Without this file each archive's own are taken.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// What shoulders are compared with, in place of the configuration's reference, as for `tapline run`.
    #[arg(long, value_name = "FILE.json|TYRE/SHOULDER|self")]
    pub reference: Option<String>,
    /// Threads; one for every core when left out. They change no result.
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

/// What is done with a configuration.
#[derive(Debug, Args)]
#[group(required = true)]
pub(crate) struct ConfigArgs {
    /// Print a complete configuration, every key with its default and what it means.
    #[arg(long)]
    pub example: bool,
    /// Check this configuration: every key, value and bound.
    #[arg(long, value_name = "FILE")]
    pub check: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    #[command(flatten)]
    pub source: SourceArgs,
    /// Print verdicts, and the summary at the end, as lines of JSON.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct LineArgs {
    /// Configuration file (TOML) with the stations.
    #[arg(long)]
    pub config: PathBuf,
    /// Folder for the results: a folder a day, a file a casing; made when it is not there.
    #[arg(long)]
    pub out: PathBuf,
    /// What shoulders are compared with, in place of the configuration's reference: the file of a reference (`tapline reference`
    /// makes one), or `self`: each tyre with itself, where damage all round does not show.
    #[arg(long, value_name = "FILE.json|self")]
    pub reference: Option<String>,
    /// Print verdicts as lines of JSON.
    #[arg(long)]
    pub json: bool,
    /// End after so many casings.
    #[arg(long)]
    pub casings: Option<usize>,
    /// Serve a page of the running line, /metrics and /healthz over HTTP at this address.
    #[cfg(feature = "serve")]
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub serve: Option<SocketAddr>,
    /// File with the token that viewers of the page must have; needed for an address that other machines can reach.
    #[cfg(feature = "serve")]
    #[arg(long, value_name = "FILE", requires = "serve")]
    pub serve_token_file: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct StatusArgs {
    /// Folder that the line writes its results to.
    #[arg(long)]
    pub out: PathBuf,
    /// Go on showing it until the line ends.
    #[arg(long)]
    pub follow: bool,
    /// Print it as a line of JSON.
    #[arg(long)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct StageArgs {
    /// Which: store, fuse, process, or acquire-NUMBER.
    pub stage: String,
    /// Private folder of the line.
    #[arg(long)]
    pub line: PathBuf,
    /// Number of the process that started this one, with which it ends.
    #[arg(long)]
    pub child: i32,
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
    /// Write recordings and a configuration to start from into this folder, and print the command that imports them.
    #[arg(long, value_name = "DIR")]
    pub example: Option<PathBuf>,
    /// Print what was imported as JSON.
    #[arg(long, conflicts_with = "example")]
    pub json: bool,
}

#[derive(Debug, Args)]
#[command(after_help = EXPORT_FORMATS)]
pub(crate) struct ExportArgs {
    /// Archives or files of results, or folders of archives.
    #[arg(required = true)]
    pub archives: Vec<PathBuf>,
    /// What to write.
    #[arg(value_enum, value_name = "WHAT")]
    pub what: What,
    /// Format; csv for a table and wav for the taps when left out.
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
Taps as wav are a tap set: `tapline run --taps FOLDER --config FOLDER/config.toml` scans them again. Archives whose
recordings or configurations differ are exported one by one.
Taps as uff are one file a shoulder, dataset 58b (uff-ascii: 58); as mat one file a shoulder, with matrices force and
sound, a column a tap. Both name the units; FS is part of full scale, where the scale is not known.
Taps that were refused, are missing or damaged are counted, and listed in taps.csv (column `refused`); then the exit code
is 3. It is 3 too where one of several archives cannot be read: it is named, and the others are exported.";

/// What of an archive can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum What {
    /// What was found in every tap.
    Discriminators,
    /// The damage index of every location.
    Damage,
    /// The arcs of damage.
    Regions,
    /// The verdict on every shoulder.
    Verdicts,
    /// What became of every planned tap.
    Ledger,
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
    /// Taps as Universal Files, dataset 58.
    UffAscii,
    /// Taps as MATLAB files of version 7.
    Mat,
}

#[derive(Debug, Subcommand)]
pub(crate) enum ModelVerb {
    /// Print one of the dissertation's tables, computed, as CSV.
    Table {
        /// Number of the table: 4, 5, 6, 8, 9, 10 or 11.
        number: u8,
        /// How the effective length of a crack is had: as the printed tables used it, or as the text describes it.
        #[arg(long, value_enum, default_value_t = Length::Published)]
        effective_length: Length,
        /// Print it as JSON, an object a row.
        #[arg(long)]
        json: bool,
    },
    /// Print what one contact does, on a rung of the ladder of models or on the cheapest that is true enough.
    Contact(ContactArgs),
}
