//! The log, on standard error.

use std::sync::OnceLock;

use tracing::level_filters::LevelFilter;
use tracing_subscriber::Layer as _;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

use crate::arguments::{LogArgs, LogFormat};
use crate::colour;
use crate::similar::did_you_mean;
use crate::stderr::Stderr;

/// How this process was asked to log; the stages of a line are started with the same arguments.
static ASKED: OnceLock<LogArgs> = OnceLock::new();

/// Target of events that people read as plain lines: a log for programs contains them at every level.
pub const SAID: &str = "said";

/// Starts the log of this process, with events of the level that `args` ask for, or `level`, and above, unless `TAPLINE_LOG`
/// says otherwise.
///
/// # Errors
/// What is wrong with the value of `TAPLINE_LOG`; the log is started without it.
pub fn start(args: LogArgs, level: Option<LevelFilter>) -> Result<(), String> {
    let args = *ASKED.get_or_init(|| args);
    let level = level.unwrap_or_else(|| args.level());
    let asked = std::env::var("TAPLINE_LOG").ok().filter(|text| !text.is_empty());
    let asked = asked.as_deref().map(targets).transpose();
    let fault = asked.as_ref().err().cloned();
    let filter = asked.ok().flatten();
    let log = tracing_subscriber::fmt::layer()
        .with_writer(|| Stderr)
        .with_target(false)
        // If the log cannot be written, it would panic in the middle of a scan.
        .log_internal_errors(false);
    let log = match args.log {
        LogFormat::Text => log.with_ansi(colour::is_shown(&std::io::stderr())).boxed(),
        LogFormat::Json => log.with_ansi(false).json().flatten_event(true).boxed(),
    };
    let filter = filter.unwrap_or_else(|| Targets::new().with_default(level));
    tracing_subscriber::registry().with(without_strangers(filter)).with(log).init();
    fault.map_or(Ok(()), Err)
}

/// `filter` without what libraries log of strangers, unless it names them: whatever somebody sends to the OPC UA server would be an error of
/// the line, and what the NATS client says is logged with the name of the server already.
fn without_strangers(filter: Targets) -> Targets {
    ["opcua", "async_nats"].into_iter().fold(filter.with_target(SAID, LevelFilter::INFO), |filter, library| {
        let is_named = filter.iter().any(|(target, _)| target.starts_with(library));
        if is_named { filter } else { filter.with_target(library, LevelFilter::OFF) }
    })
}

/// What is logged by `text`: a level, or levels of parts of the program (`info,tapline_store=debug`).
fn targets(text: &str) -> Result<Targets, String> {
    let levels = ["off", "error", "warn", "info", "debug", "trace"];
    for word in text.split(',') {
        let level = word.rsplit('=').next().unwrap_or_default().trim();
        if !levels.iter().any(|known| known.eq_ignore_ascii_case(level)) {
            let meant = did_you_mean(level, levels).map(|meant| format!("; {meant}")).unwrap_or_default();
            return Err(format!("TAPLINE_LOG={text}: {level:?} is not one of {}{meant}", levels.join(", ")));
        }
    }
    text.parse().map_err(|error| format!("TAPLINE_LOG={text}: {error}"))
}

/// The format of the log of this process.
pub fn format() -> LogFormat {
    ASKED.get().map(|args| args.log).unwrap_or_default()
}

/// Whether only errors are to be printed.
pub fn is_quiet() -> bool {
    ASKED.get().is_some_and(|args| args.quiet)
}

/// The arguments that make another process of this program log in the same way.
pub fn arguments() -> Vec<String> {
    let Some(args) = ASKED.get() else { return Vec::new() };
    let log = ["--log", "json"].into_iter().filter(|_| args.log == LogFormat::Json);
    let verbose = std::iter::repeat_n("-v", args.verbose.into());
    log.chain(verbose).chain(args.quiet.then_some("-q")).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use tracing::Level;

    use super::*;

    /// Catches a level of `TAPLINE_LOG` with which strangers fill the log, and a library that cannot be looked at any more.
    #[test]
    fn strangers_are_logged_only_by_name() {
        let logs =
            |text: &str, library: &str| without_strangers(targets(text).unwrap()).would_enable(library, &Level::ERROR);
        for library in ["opcua::server", "async_nats"] {
            assert!(!logs("debug", library) && !logs("warn,tapline_store=debug", library), "{library}");
            assert!(logs("warn,opcua=error,async_nats=info", library), "{library}");
        }
        assert!(logs("warn", "tapline_store"));
    }
}
