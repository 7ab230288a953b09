//! Arguments that many verbs share.

use clap::{ArgAction, Args, ValueEnum};
use tracing::level_filters::LevelFilter;

use crate::atomic_file::Existing;

/// How events are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum LogFormat {
    /// Lines for people.
    #[default]
    Text,
    /// A line of JSON for each event.
    Json,
}

/// Heading of these options in the help of each verb: it keeps them apart from the options of the verb.
const MESSAGES: &str = "Messages";

/// How much a program logs as it works, and its format.
#[derive(Debug, Clone, Copy, Args)]
pub struct LogArgs {
    /// Format of the log on standard error; TAPLINE_LOG sets its level (error, warn, info, debug).
    #[arg(long, global = true, value_enum, value_name = "FORMAT", default_value_t, help_heading = MESSAGES)]
    pub log: LogFormat,
    /// Print more on standard error: -v what is done, -vv everything.
    #[arg(short, long, global = true, action = ArgAction::Count, conflicts_with = "quiet", help_heading = MESSAGES)]
    pub verbose: u8,
    /// Print only errors on standard error: no progress, no remarks, no warnings.
    #[arg(short, long, global = true, help_heading = MESSAGES)]
    pub quiet: bool,
}

impl LogArgs {
    /// The lowest level of event that is logged.
    pub fn level(&self) -> LevelFilter {
        match (self.quiet, self.verbose) {
            (true, _) => LevelFilter::ERROR,
            (false, 0) => LevelFilter::WARN,
            (false, 1) => LevelFilter::INFO,
            (false, _) => LevelFilter::DEBUG,
        }
    }
}

/// What to do with files that exist where a verb writes.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct ForceArgs {
    /// Replace existing files. Archives are never replaced.
    #[arg(long)]
    pub force: bool,
}

impl ForceArgs {
    /// What to do with a file that exists.
    pub fn existing(self) -> Existing {
        if self.force { Existing::Replace } else { Existing::Keep }
    }
}
