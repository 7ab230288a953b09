//! Finds hidden cracks in truck-tyre casings by tapping them and listening: the one program of the workspace.
//!
//! This package is glue: it reads the command line and the configuration, starts the stages of a line as processes and
//! heals them, and prints. What is computed is computed in the libraries.

mod archives;
mod cli;
mod config;
mod host;
mod line;
mod report;
#[cfg(feature = "serve")]
mod serve;
mod shown;
mod verbs;
mod wires;

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::Context as _;
use clap::Parser as _;
use tracing::level_filters::LevelFilter;

use crate::archives::Which;
use crate::cli::{Cli, ModelVerb, Verb};
use crate::host::log::{self, LogFormat};
use crate::host::stderr::{print_line, with_causes};
use crate::line::stage::{DISK_FAILED, DiskFailed};
use crate::verbs::{explain, export, import, model_contact, model_table, reference, repack, reprocess, rig, verify};

/// Ended, but incomplete: taps are missing, refused or damaged, an archive was left out, or contradicts itself.
const INCOMPLETE: u8 = 3;

fn main() -> ExitCode {
    let cli = Cli::parse();
    log::start(cli.log, if draws(&cli.verb) { LevelFilter::OFF } else { LevelFilter::WARN });
    match begin().and_then(|()| dispatch(&cli.verb)) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(INCOMPLETE),
        Err(error) => {
            tracing::debug!(?error);
            // A disk that has failed is in the log already.
            if error.is::<DiskFailed>() {
                return ExitCode::from(DISK_FAILED);
            }
            match cli.log {
                LogFormat::Text => print_line(&format!("tapline: {}", with_causes(&error))),
                LogFormat::Json => tracing::error!("{}", with_causes(&error)),
            }
            ExitCode::FAILURE
        }
    }
}

/// Whether `verb` draws on the terminal, where a log would stand in the picture.
fn draws(verb: &Verb) -> bool {
    #[cfg(feature = "alsa")]
    if matches!(verb, Verb::Monitor { .. }) {
        return true;
    }
    let _shows_text = verb;
    false
}

/// What comes before every verb.
fn begin() -> anyhow::Result<()> {
    // A write beyond the limit of a file's size then fails with a reason, where it would end the process without one.
    let is_beyond = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(rustix::process::Signal::XFSZ.as_raw(), is_beyond)
        .context("cannot listen to signals")?;
    Ok(())
}

/// Does what was asked; whether the outcome is complete.
fn dispatch(verb: &Verb) -> anyhow::Result<bool> {
    match verb {
        Verb::Run(args) => line::run(args),
        Verb::Line(args) => line::line(args),
        Verb::Status(args) => line::status::status(args),
        Verb::Rig { listen, config } => rig::rig(listen, config.as_deref()),
        #[cfg(feature = "alsa")]
        Verb::Devices { names } => verbs::devices::devices(names),
        #[cfg(feature = "alsa")]
        Verb::Monitor { config, station } => verbs::monitor::monitor(config, *station),
        Verb::Calibrate { verb } => verbs::calibrate::calibrate(verb),
        Verb::Stage(args) => line::stage::stage(args),
        Verb::Export(args) => export::export(args),
        Verb::Import(args) => import::import(args),
        Verb::Reference(args) => reference::reference(args),
        Verb::Verify { archives, json } => verify::verify(archives, *json),
        Verb::Reprocess(args) => reprocess::reprocess(args),
        Verb::Repack { archives, codec, out } => repack::repack(archives, (*codec).into(), out),
        Verb::Explain { archives, shoulder, location, results } => {
            explain::explain(archives, results.which(), shoulder.as_deref(), *location)
        }
        Verb::Diff { before, after, results } => explain::diff(before, after, Which::results_if(*results)),
        Verb::Report { archives, out, config, shift, results } => {
            report::report(archives, results.which(), out.as_deref(), config.as_deref(), shift.clone())
        }
        Verb::Model(ModelVerb::Table { number, effective_length }) => model_table::model(*number, *effective_length),
        Verb::Model(ModelVerb::Contact(args)) => model_contact::contact(args),
    }
}
