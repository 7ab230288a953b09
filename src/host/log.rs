//! The log, on standard error.

use std::io::IsTerminal as _;
use std::sync::OnceLock;

use clap::ValueEnum;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::Layer as _;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

/// How events are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum LogFormat {
    /// Lines for people.
    #[default]
    Text,
    /// A line of JSON for each event.
    Json,
}

/// The format of this process, which the stages of a line are started with too.
static FORMAT: OnceLock<LogFormat> = OnceLock::new();

/// Target of events that people read as plain lines: a log for programs has them whatever its level is.
pub(crate) const SAID: &str = "said";

/// Starts the log of this process, with events of `level` and above unless `TAPLINE_LOG` says otherwise.
pub(crate) fn start(format: LogFormat, level: LevelFilter) {
    let format = *FORMAT.get_or_init(|| format);
    let filter = std::env::var("TAPLINE_LOG").ok().and_then(|text| text.parse::<Targets>().ok());
    let log = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_target(false)
        // Where the log cannot be written it would panic, in the middle of a scan.
        .log_internal_errors(false);
    let log = match format {
        LogFormat::Text => log.with_ansi(std::io::stderr().is_terminal()).boxed(),
        LogFormat::Json => log.with_ansi(false).json().flatten_event(true).boxed(),
    };
    // Whatever strangers send to the OPC UA server would be an error of the line's.
    let usual = || Targets::new().with_default(level).with_target("opcua", LevelFilter::OFF);
    let filter = filter.unwrap_or_else(usual).with_target(SAID, LevelFilter::INFO);
    tracing_subscriber::registry().with(filter).with(log).init();
}

/// The format of the log of this process.
pub(crate) fn format() -> LogFormat {
    FORMAT.get().copied().unwrap_or_default()
}
