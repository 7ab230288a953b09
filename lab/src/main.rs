//! `tapline-lab`: studies, figures and curves for researchers.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, Result};
use clap::{Parser, Subcommand};
use tapline_host::arguments::LogArgs;
use tapline_host::log;
use tapline_host::messages::print_failure;
use tapline_host::signals::end_on_signals;
use tapline_lab::chart::ChartArgs;
use tapline_lab::headroom::HeadroomArgs;
use tapline_lab::pod::PodArgs;
use tapline_lab::study::StudyArgs;
use tapline_lab::written::WrittenArgs;
use tapline_lab::{chart, estimators, experiment, figures, headroom, hop, pod, stability, study};

/// Tools of tapline for researchers: studies, figures and curves.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 100)]
struct Cli {
    #[command(flatten)]
    log: LogArgs,
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Judge many simulated tyres, and compare indices and references: AUC with intervals, false calls,
    /// probability of detection, gauge studies.
    Study(StudyArgs),
    /// Chart speed against accuracy of every choice, from contact model to scan plan, with every default marked.
    Chart(ChartArgs),
    /// Compare the archives of casings that a plant has scanned with what other means found in them: probability of
    /// detection, ROC, false calls, gauge studies.
    Pod(PodArgs),
    /// Measure how many stations this host supports, and what limits them: lines of simulated stations run for a short time. Run it
    /// on an idle host, because other programs slow the lines down.
    Headroom(HeadroomArgs),
    /// Repeat chapter 5 of the dissertation on three simulated tyres, and compare its claims with the results.
    Experiment {
        /// Folder to write figures (SVG), tables (CSV) and claims into, with a page beside it.
        #[arg(long, default_value = "experiment")]
        out: PathBuf,
        /// Seed of all random numbers.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        #[command(flatten)]
        written: WrittenArgs,
    },
    /// Draw the dissertation's figures of the contact theory, as SVG and CSV.
    Figures {
        /// Folder to write into; created if it does not exist.
        #[arg(long, default_value = "figures")]
        out: PathBuf,
        /// Number of the figure to draw; all if left out.
        #[arg(long)]
        figure: Option<u8>,
        #[command(flatten)]
        written: WrittenArgs,
    },
    /// Measure bias and spread of every estimator, and write `estimators.csv` and `estimators.md`.
    Estimators {
        /// Folder to write into.
        #[arg(long, default_value = "docs")]
        out: PathBuf,
        #[command(flatten)]
        written: WrittenArgs,
    },
    /// Draw the breakdown curves: how wrong each discriminator and each contact model gets as a disturbance grows.
    Stability {
        /// Folder to write into; created if it does not exist.
        #[arg(long, default_value = "docs/stability")]
        out: PathBuf,
        #[command(flatten)]
        written: WrittenArgs,
    },
}

/// Nothing was done: the arguments are wrong, or a variable of the environment.
const WRONG_USAGE: u8 = 2;

/// Done, but some archives were left out.
const INCOMPLETE: u8 = 3;

fn main() -> ExitCode {
    match hop::is_consumer() {
        Ok(false) => {}
        Ok(true) => return ExitCode::SUCCESS,
        Err(error) => {
            print_failure("tapline-lab", error.as_ref());
            return ExitCode::FAILURE;
        }
    }
    let cli = Cli::parse();
    if let Err(fault) = log::start(cli.log, None) {
        print_failure("tapline-lab", anyhow::Error::msg(fault).as_ref());
        return ExitCode::from(WRONG_USAGE);
    }
    tapline_host::stdout::drop_unread();
    match end_on_signals().context("cannot listen for signals").and_then(|()| dispatch(&cli.verb)) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(INCOMPLETE),
        Err(error) => {
            print_failure("tapline-lab", error.as_ref());
            ExitCode::FAILURE
        }
    }
}

/// Runs the verb; returns whether nothing was left out.
fn dispatch(verb: &Verb) -> Result<bool> {
    let done = match verb {
        Verb::Pod(args) => return pod::pod(args),
        Verb::Study(args) => study::study(args),
        Verb::Chart(args) => chart::chart(args),
        Verb::Headroom(args) => headroom::headroom(args),
        Verb::Experiment { out, seed, written } => experiment::experiment(out, *seed, *written),
        Verb::Figures { out, figure, written } => figures::figures(out, *figure, *written),
        Verb::Estimators { out, written } => estimators::write(out, *written),
        Verb::Stability { out, written } => stability::write(out, *written),
    };
    done.map(|()| true)
}
