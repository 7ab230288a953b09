//! `tapline-lab`: studies, figures and curves for researchers.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use tapline_lab::chart::ChartArgs;
use tapline_lab::pod::PodArgs;
use tapline_lab::study::StudyArgs;
use tapline_lab::{chart, estimators, experiment, figures, picture, pod, stability, study};

/// What a researcher runs beside tapline: studies, figures and curves.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Judge many simulated tyres, and compare indices, references and plans: AUC with intervals, false calls,
    /// probability of detection, gauge studies, time on the rig.
    Study(StudyArgs),
    /// Chart speed against accuracy of all that can be chosen, from contact model to scan plan, with every default marked.
    Chart(ChartArgs),
    /// Compare the archives of casings that a plant has scanned with what other means found in them: probability of
    /// detection, ROC, false calls, gauge studies.
    Pod(PodArgs),
    /// Repeat chapter 5 of the dissertation on three simulated tyres, and compare its claims with the results.
    Experiment {
        /// Folder to write figures (SVG), tables (CSV) and claims into, with a page beside it.
        #[arg(long, default_value = "experiment")]
        out: PathBuf,
        /// Seed of all random numbers.
        #[arg(long, default_value_t = 1)]
        seed: u64,
    },
    /// Draw the dissertation's figures of the contact theory, as SVG and CSV.
    Figures {
        /// Folder to write into; made when it is not there.
        #[arg(long, default_value = "figures")]
        out: PathBuf,
        /// The one figure to draw; all when left out.
        #[arg(long)]
        figure: Option<u8>,
    },
    /// Measure bias and spread of every estimator, and write `estimators.csv` and `estimators.md`.
    Estimators {
        /// Folder to write into.
        #[arg(long, default_value = "docs")]
        out: PathBuf,
    },
    /// Draw the breakdown curves: how wrong each discriminator and each contact model gets as a disturbance grows.
    Stability {
        /// Folder to write into; made when it is not there.
        #[arg(long, default_value = "docs/stability")]
        out: PathBuf,
    },
    /// Draw a damaged and a sound shoulder of an archive, and a tap of each.
    Picture {
        /// The archive.
        archive: PathBuf,
        /// File to write (SVG).
        #[arg(long, default_value = "picture.svg")]
        out: PathBuf,
    },
}

fn main() -> ExitCode {
    match chart::is_consumer() {
        Ok(false) => {}
        Ok(true) => return ExitCode::SUCCESS,
        Err(error) => return failed(&error),
    }
    let done = match &Cli::parse().verb {
        Verb::Study(args) => study::study(args),
        Verb::Chart(args) => chart::chart(args),
        Verb::Pod(args) => pod::pod(args),
        Verb::Experiment { out, seed } => experiment::experiment(out, *seed),
        Verb::Figures { out, figure } => figures::figures(out, *figure),
        Verb::Estimators { out } => estimators::write(out),
        Verb::Stability { out } => stability::write(out),
        Verb::Picture { archive, out } => picture::write(archive, out),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => failed(&error),
    }
}

fn failed(error: &anyhow::Error) -> ExitCode {
    use std::io::Write as _;
    // If standard error is closed, ignore it.
    drop(writeln!(std::io::stderr(), "tapline-lab: {error:#}"));
    ExitCode::FAILURE
}
