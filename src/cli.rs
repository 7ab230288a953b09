//! The command line: what was written, before anything is opened.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

use crate::contact::ContactArgs;

/// Finds hidden cracks in truck-tyre casings by tapping them and listening.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 100, after_help = EXIT_CODES)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) verb: Verb,
}

const EXIT_CODES: &str = "Exit codes: 0 done; 1 failed; 2 wrong usage; 3 ended, but taps are missing or refused, or the archive is not whole.";

#[derive(Debug, Subcommand)]
pub(crate) enum Verb {
    /// Run a whole line: one process, one fuse, one store and an acquire per station, until every shoulder is judged.
    ///
    /// Without --taps a simulated line is scanned. The same command again goes on with what is missing. Ctrl-C ends
    /// the run in good order.
    Run(RunArgs),
    /// Take the taps of one station (one stage of a line, alone).
    Acquire {
        #[command(flatten)]
        line: LineArgs,
        /// Station whose taps to take.
        #[arg(long)]
        station: u16,
    },
    /// Extract the discriminators of the taps of all stations (one stage of a line, alone).
    Process(LineArgs),
    /// Turn discriminators into damage maps and verdicts (one stage of a line, alone).
    Fuse(LineArgs),
    /// Keep taps, discriminators, maps and verdicts in the archive (one stage of a line, alone).
    Store(LineArgs),
    /// Write a table of an archive, or its taps, in a format of other programs.
    Export(ExportArgs),
    /// Make a reference of shoulders of archives: stated to be sound, or labelled by what is known of them.
    Reference(ReferenceArgs),
    /// Check that an archive holds all its plan asks for, that no tap or result in it was altered, and that it does not
    /// contradict itself.
    ///
    /// Every sample is read and every checksum compared. Prints what is amiss, a line each, and ends with code 3 then.
    Verify {
        /// The archive.
        archive: PathBuf,
        /// Print the report as JSON.
        #[arg(long)]
        json: bool,
        /// In this process, not in one of its own.
        #[arg(long, hide = true)]
        here: bool,
    },
    /// Judge archives again: with other options, another reference, or by a newer program.
    ///
    /// The archive is not touched. The results stand beside it in a file named after their lineage, which every other verb
    /// takes as an archive; the same command again goes on where it was ended. Prints the name of each file.
    Reprocess(ReprocessArgs),
    /// Write an archive again, its samples packed otherwise; every sample is checked on the way.
    Repack {
        /// The archive.
        archive: PathBuf,
        /// What packs the samples of the new one.
        #[arg(long, value_enum)]
        codec: PackedBy,
        /// The new archive.
        #[arg(long)]
        out: PathBuf,
    },
    /// Say what an archive's numbers are made of and by: recorded taps, sources of the program, options, reference.
    Explain {
        /// The archive, or a file of results.
        archive: PathBuf,
        /// Of this shoulder the verdict too.
        #[arg(long, value_name = "TYRE/SHOULDER")]
        shoulder: Option<String>,
        /// Of this location of it the index, and what was found in every tap.
        #[arg(long)]
        location: Option<u32>,
    },
    /// Say what changed from one archive's numbers to another's of the same taps: options and sources first, then numbers.
    Diff {
        /// The one, before.
        there: PathBuf,
        /// The other, after.
        here: PathBuf,
    },
    /// Write what an archive holds as pages to read and print: one a tyre, and one of the whole shift.
    ///
    /// Each page is one HTML file that needs nothing else. An archive of which taps are missing is told of as far as
    /// it goes; so is one with torn rows, and then the exit code is 3. What else was altered ends it, where it is read.
    Report {
        /// The archive.
        archive: PathBuf,
        /// Folder to write into, made when it is not there; the archive's name with `-report`, in this folder, when left
        /// out.
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// The contact models.
    #[command(subcommand)]
    Model(ModelVerb),
    /// Do the dissertation's experiment (its chapter 5) again on simulated tyres: each figure as SVG and CSV, what is claimed of
    /// them against what is found as claims.csv, and the same as a page.
    ///
    /// The page stands beside the folder: `--out docs/experiment` writes docs/experiment.md.
    Experiment {
        /// Folder to write into; made when it is not there.
        #[arg(long, default_value = "experiment")]
        out: PathBuf,
        /// Decides all that is left to chance; the same seed gives the same bytes on processors with the same vector
        /// instructions.
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// Judge many simulated tyres, and say what each index, reference and plan is worth: AUC with intervals, false calls,
    /// probability of detection, gauge studies, time on the rig.
    Study(StudyArgs),
}

#[derive(Debug, Args)]
pub(crate) struct StudyArgs {
    /// Tyres of each simulated set, of which a half trains and a half is judged; 16, or 8 with --quick, when left out.
    #[arg(long)]
    pub(crate) tyres: Option<usize>,
    /// Decides all that is left to chance; the same seed gives the same bytes on processors with the same vector
    /// instructions.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Threads; one for every core when left out. They change no result.
    #[arg(long, default_value_t = 0)]
    pub(crate) threads: usize,
    /// Do little of everything, to see that it works.
    #[arg(long)]
    pub(crate) quick: bool,
    /// Print the tables as JSON.
    #[arg(long)]
    pub(crate) json: bool,
    /// Folder to write tables (CSV) and figures (SVG) into, with a page beside it; made when it is not there.
    #[arg(long)]
    pub(crate) out: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct SourceArgs {
    /// Configuration file (TOML); defaults hold for what it leaves out.
    #[arg(long)]
    pub(crate) config: Option<PathBuf>,
    /// Folder of recorded taps (a tap set) to scan instead of simulated tyres.
    #[arg(long)]
    pub(crate) taps: Option<PathBuf>,
    /// The archive; `simulated.h5`, or the name of the tap set with `.h5`, in this folder when left out.
    #[arg(long)]
    pub(crate) out: Option<PathBuf>,
    /// What shoulders are compared with, over what the configuration says: the file of a reference (`tapline reference`
    /// makes one), TYRE/SHOULDER of this run, or `self`: each tyre with itself, where damage all round does not show.
    #[arg(long, value_name = "FILE.json|TYRE/SHOULDER|self")]
    pub(crate) reference: Option<String>,
    /// Stations: how many are simulated, or over how many the shoulders of a tap set are shared out.
    #[arg(long)]
    pub(crate) stations: Option<u16>,
}

#[derive(Debug, Args)]
pub(crate) struct ReferenceArgs {
    /// Archives to take shoulders from.
    #[arg(required = true)]
    pub(crate) archives: Vec<PathBuf>,
    /// A shoulder to take, several times for several; when left out, all that passed, or with --labelled all.
    #[arg(long = "shoulder", value_name = "TYRE/SHOULDER")]
    pub(crate) shoulders: Vec<String>,
    /// Take what the archives know of each location for its label; without it every shoulder is taken to be sound.
    #[arg(long)]
    pub(crate) labelled: bool,
    /// Learn from the labels which way each discriminator moves with damage, where they tell.
    #[arg(long, requires = "labelled")]
    pub(crate) learn_directions: bool,
    /// Configuration file, for directions and rate of false calls; that of the first archive when left out.
    #[arg(long)]
    pub(crate) config: Option<PathBuf>,
    /// File to write, whose name ends in .json.
    #[arg(long)]
    pub(crate) out: PathBuf,
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
    /// LZF: read by h5py alone.
    Lzf,
    /// Deflate: read by every HDF5 program, slow to write.
    Gzip,
}

#[derive(Debug, Args)]
pub(crate) struct ReprocessArgs {
    /// The archives.
    #[arg(required = true)]
    pub(crate) archives: Vec<PathBuf>,
    /// Configuration file whose tables `process` and `fuse` take the place of the archive's, whole: an option that it does not
    /// name has its default, but for the reference. Without this file each archive's own are taken.
    #[arg(long)]
    pub(crate) config: Option<PathBuf>,
    /// What shoulders are compared with, over what the configuration says, as for `tapline run`.
    #[arg(long, value_name = "FILE.json|TYRE/SHOULDER|self")]
    pub(crate) reference: Option<String>,
    /// Threads; one for every core when left out. They change no result.
    #[arg(long, default_value_t = 0)]
    pub(crate) jobs: usize,
    /// Read the samples even where the archive's own discriminators were made by the same options and sources; taps that
    /// results of the same lineage have already are not read again.
    #[arg(long)]
    pub(crate) from_samples: bool,
}

#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    #[command(flatten)]
    pub(crate) source: SourceArgs,
    /// Print the summary as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct LineArgs {
    #[command(flatten)]
    pub(crate) source: SourceArgs,
    /// Name of the line: stages with the same name meet. Letters, digits and '-'.
    #[arg(long, default_value = "line")]
    pub(crate) line: String,
    /// Copy of the reference file that the line was started with.
    #[arg(long, hide = true)]
    pub(crate) reference_copy: Option<PathBuf>,
    /// Number of the process that started this one, with which it ends.
    #[arg(long, hide = true)]
    pub(crate) child: Option<i32>,
}

#[derive(Debug, Args)]
#[command(after_help = EXPORT_FORMATS)]
pub(crate) struct ExportArgs {
    /// The archive.
    pub(crate) archive: PathBuf,
    /// What to write.
    #[arg(value_enum, value_name = "WHAT")]
    pub(crate) what: What,
    /// Format; csv for a table and wav for the taps when left out.
    #[arg(long, value_enum)]
    pub(crate) format: Option<Format>,
    /// File to write a table into, standard output when left out; for the taps a folder, which must be new or empty.
    #[arg(long)]
    pub(crate) out: Option<PathBuf>,
}

const EXPORT_FORMATS: &str = "\
A table as parquet has the columns and rows of the csv, typed, with units; sets of flags also as bits.
Taps as wav are a tap set: `tapline run --taps FOLDER --config FOLDER/config.toml` scans them again.
Taps as uff are one file a shoulder, dataset 58b (uff-ascii: 58), in N and V.
Taps that were refused, are missing or damaged are counted, and listed in taps.csv (column `refused`); then the exit code
is 3. It is 3 too where rows that say how taps and shoulders stand are torn; `tapline run` (of results `tapline reprocess`)
mends those.";

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
    },
    /// Print what one contact does, on a rung of the ladder of models or on the cheapest that is true enough.
    Contact(ContactArgs),
    /// Draw the dissertation's figures of its theory, computed: each as SVG and, in SI units, as CSV.
    Figures {
        /// Folder to write into; made when it is not there.
        #[arg(long, default_value = "figures")]
        out: PathBuf,
        /// This one only: 11-13, 16-20, 22-27, 31, 32 or 36-38.
        #[arg(long)]
        figure: Option<u8>,
    },
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum Length {
    Published,
    Table1,
}
