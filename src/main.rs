//! Finds hidden cracks in truck-tyre casings by tapping them and listening: the everyday program.
//!
//! This package is glue: it reads the command line and the configuration, starts the stages of a line as processes and
//! heals them, and prints. What is computed is computed in the libraries.

mod archives;
mod cli;
mod config;
mod line;
mod report;
#[cfg(feature = "serve")]
mod serve;
mod shown;
mod verbs;
mod wires;

use std::io::ErrorKind;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::Context as _;
use clap::{CommandFactory as _, Parser as _};
use tapline_host::atomic_file::check_folder;
use tapline_host::messages::print_failure;
use tapline_host::signals::end_on_signals;
use tapline_host::stdout::Stdout;
use tapline_host::{generated, log, stderr};
use tapline_store::RunError;
use tracing::level_filters::LevelFilter;

use crate::archives::Which;
use crate::cli::{Cli, ModelVerb, Verb};
use crate::line::stage::DISK_FAILED;
use crate::verbs::{
    diff, explain, export, import, model_contact, model_table, reference, repack, reprocess, rig, verify,
};

/// Nothing was done: the arguments are wrong, or a variable of the environment.
const WRONG_USAGE: u8 = 2;

/// Ended, but incomplete: taps are missing, refused or damaged, an archive was left out, or contradicts itself.
const INCOMPLETE: u8 = 3;

fn main() -> ExitCode {
    let cli = Cli::parse();
    if let Err(fault) = log::start(cli.log, draws(&cli.verb).then_some(LevelFilter::OFF)) {
        print_failure("tapline", anyhow::Error::msg(fault).as_ref());
        return ExitCode::from(WRONG_USAGE);
    }
    if unread(&cli.verb) == Unread::Dropped {
        tapline_host::stdout::drop_unread();
    }
    let code = exit_code(&cli.verb);
    stderr::flush();
    code
}

/// Runs `verb`, prints why it has failed if it has, and returns the exit code.
fn exit_code(verb: &Verb) -> ExitCode {
    match begin(verb).and_then(|()| dispatch(verb)) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(INCOMPLETE),
        Err(_) if tapline_host::stdout::fault() == Some(ErrorKind::BrokenPipe) && unread(verb) == Unread::Done => {
            ExitCode::SUCCESS
        }
        Err(error) => {
            tracing::debug!(?error);
            // A disk that has failed is in the log already.
            if let Some(RunError::FileSystem { .. }) = error.downcast_ref() {
                return ExitCode::from(DISK_FAILED);
            }
            print_failure("tapline", error.as_ref());
            ExitCode::FAILURE
        }
    }
}

/// Whether `verb` draws on the terminal, where a log would spoil the picture.
fn draws(verb: &Verb) -> bool {
    cfg!(feature = "alsa") && matches!(verb, Verb::Monitor { .. })
}

/// What a verb does when nobody reads its output any more: the reader was `head`, for example.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Unread {
    /// It goes on, because it makes files: what it prints is dropped.
    Dropped,
    /// It ends with success, because it only prints. A stage prints for its line, which has ended then.
    Done,
    /// It fails: the exit code of `verify`, for example, is about archives that it did not reach.
    Failed,
}

fn unread(verb: &Verb) -> Unread {
    match verb {
        Verb::Export(args) if args.out.is_none() => Unread::Done,
        Verb::Export(_) | Verb::Import(_) | Verb::Reference(_) | Verb::Report(_) | Verb::Run(_) => Unread::Dropped,
        Verb::Reprocess { .. } | Verb::Repack { .. } => Unread::Dropped,
        Verb::Devices { .. } | Verb::Status(_) | Verb::Config(_) | Verb::Completions { .. } | Verb::Stage(_) => {
            Unread::Done
        }
        Verb::Explain { .. } | Verb::Diff { .. } | Verb::Model(_) => Unread::Done,
        _ => Unread::Failed,
    }
}

/// Whether `verb` ends in good order, and listens to signals itself.
fn ends_in_order(verb: &Verb) -> bool {
    #[cfg(feature = "uplink")]
    if matches!(verb, Verb::Uplink(_) | Verb::Collect(_)) {
        return true;
    }
    draws(verb) || matches!(verb, Verb::Run(_) | Verb::Line(_) | Verb::Status(_) | Verb::Rig { .. } | Verb::Stage(_))
}

/// What comes before every verb.
fn begin(verb: &Verb) -> anyhow::Result<()> {
    // A write beyond the file size limit then fails with a reason, instead of ending the process without one.
    let is_beyond = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(rustix::process::Signal::XFSZ.as_raw(), is_beyond)
        .context("cannot listen for signals")?;
    if !ends_in_order(verb) {
        end_on_signals().context("cannot listen for signals")?;
    }
    if matches!(verb, Verb::Line(_) | Verb::Stage(_)) {
        stderr::never_wait().context("cannot start the thread log")?;
    }
    Ok(())
}

/// Runs the verb; returns whether the outcome is complete.
fn dispatch(verb: &Verb) -> anyhow::Result<bool> {
    match verb {
        Verb::Run(args) => line::run(args),
        Verb::Line(args) => line::line(args),
        Verb::Status(args) => line::status::status(args),
        Verb::Rig { listen, config, json } => rig::rig(listen, config.as_deref(), *json),
        #[cfg(feature = "alsa")]
        Verb::Devices { names, json } => verbs::devices::devices(names, *json),
        #[cfg(feature = "alsa")]
        Verb::Monitor { config, station } => verbs::monitor::monitor(config, *station),
        #[cfg(not(feature = "alsa"))]
        Verb::Devices { .. } | Verb::Monitor { .. } => cli::built_without("ALSA", "alsa"),
        Verb::Calibrate { verb } => verbs::calibrate::calibrate(verb),
        Verb::Config(args) => match &args.check {
            Some(path) => line::check_config(path),
            None => verbs::config::example(),
        },
        Verb::Completions { shell } => {
            generated::completions(Cli::command(), *shell, &mut Stdout)?;
            Ok(true)
        }
        Verb::Man { folder, force } => {
            check_folder(folder, force.existing())?;
            generated::manual(Cli::command(), folder)?;
            Ok(true)
        }
        Verb::Stage(args) => line::stage::stage(args),
        Verb::Export(args) => export::export(args),
        Verb::Import(args) => import::import(args),
        Verb::Reference(args) => reference::reference(args),
        Verb::Verify { archives, json } => verify::verify(archives, *json),
        Verb::Reprocess(args) => reprocess::reprocess(args),
        Verb::Repack { archives, codec, out, json } => repack::repack(archives, *codec, out, *json),
        #[cfg(feature = "uplink")]
        Verb::Uplink(args) => verbs::uplink::uplink(args),
        #[cfg(feature = "uplink")]
        Verb::Collect(args) => verbs::uplink::collect(args),
        Verb::Explain { archives, shoulder, location, results, json } => {
            explain::explain(archives, results.which(), shoulder.as_deref(), *location, *json)
        }
        Verb::Diff { before, after, results, summary, json } => {
            diff::diff(before, after, Which::results_if(*results), *summary, *json)
        }
        Verb::Report(args) => report::report(args),
        Verb::Model(ModelVerb::Table { number, effective_length, json }) => {
            model_table::model(*number, *effective_length, *json)
        }
        Verb::Model(ModelVerb::Contact(args)) => model_contact::contact(args),
    }
}
