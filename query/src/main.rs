//! `tapline-query`: questions over years of archives, and new results of them, on this host or a cluster.

use std::io;
use std::process::ExitCode;

use anyhow::{Context as _, Result};
use clap::{Parser, Subcommand};
use tapline_host::arguments::{LogArgs, LogFormat};
use tapline_host::log;
use tapline_host::messages::{print_failure, print_line, say};
use tapline_host::stdout::{self, Stdout};
use tapline_query::Place;
use tapline_query::cluster::{Executor, Scheduler};
use tapline_query::copy::Copied;
use tapline_query::reprocess::{self, Order};
use tapline_query::sql::{self, Question};

/// Exit code for arguments and variables that cannot be understood.
const WRONG_USAGE: u8 = 2;

/// Exit code where something was left out.
const INCOMPLETE: u8 = 3;

/// Maximum number of failed files that are named; of the rest only the number is given.
const NAMED_MAX: usize = 20;

/// Ask about years of archives, or judge them again: on this host, or on a cluster.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
    /// Print only errors on standard error: no progress, no remarks.
    #[arg(short, long, global = true)]
    quiet: bool,
}

#[derive(Debug, Subcommand)]
enum Verb {
    Sql(Question),
    Reprocess(Order),
    /// Copy finished archives to another place, such as a bucket. Each is checked first; nothing is overwritten.
    Copy {
        /// Folders of archives; every finished one in them and in their subfolders is copied.
        #[arg(required = true, value_name = "DIR|s3://BUCKET/DIR")]
        places: Vec<Place>,
        /// Where they go.
        #[arg(long, value_name = "DIR|s3://BUCKET/DIR")]
        to: Place,
    },
    Scheduler(Scheduler),
    Executor(Executor),
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    if let Err(fault) = log::start(LogArgs { log: LogFormat::Text, verbose: 0, quiet: cli.quiet }, None) {
        print_failure("tapline-query", anyhow::Error::msg(fault).as_ref());
        return ExitCode::from(WRONG_USAGE);
    }
    let runtime = match tokio::runtime::Builder::new_multi_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(error) => {
            print_failure("tapline-query", &error);
            return ExitCode::FAILURE;
        }
    };
    match runtime.block_on(dispatch(cli.verb)) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(INCOMPLETE),
        // Who read it has had enough, as `head` has.
        Err(_) if stdout::fault() == Some(io::ErrorKind::BrokenPipe) => ExitCode::SUCCESS,
        Err(error) => {
            print_failure("tapline-query", error.as_ref());
            runtime.block_on(tapline_query::plan::settle());
            ExitCode::FAILURE
        }
    }
}

/// Whether all was done.
async fn dispatch(verb: Verb) -> Result<bool> {
    match verb {
        Verb::Sql(question) => sql::answer(&question, &mut Stdout).await,
        Verb::Reprocess(order) => reprocess(&order).await,
        Verb::Copy { places, to } => copy(&places, &to).await,
        Verb::Scheduler(scheduler) => scheduler.run().await.map(|()| true),
        Verb::Executor(executor) => executor.run().await.map(|()| true),
    }
}

async fn copy(places: &[Place], to: &Place) -> Result<bool> {
    let Copied { copied, there, failed } = tapline_query::copy::copy(places, to).await?;
    for (file, why) in failed.iter().take(NAMED_MAX) {
        print_line(&format!("tapline-query: {file}: {why}"));
    }
    let (count, failed) = (copied + there + failed.len(), failed.len());
    say(&format!("tapline-query: {copied} of {count} archives copied to {to}, {there} were there, {failed} failed"));
    Ok(failed == 0)
}

async fn reprocess(order: &Order) -> Result<bool> {
    use io::Write as _;
    let done = reprocess::reprocess(order).await?;
    let rows = &done.committed.rows;
    let failed: Vec<_> = done.committed.failed().collect();
    for row in failed.iter().take(NAMED_MAX) {
        print_line(&format!("tapline-query: {}: {}", row.file, row.error.as_deref().unwrap_or("not judged")));
    }
    let incomplete = rows.iter().filter(|row| row.is_complete == Some(false)).count();
    let how = if done.was_there { "was committed before" } else { "is committed" };
    say(&format!(
        "tapline-query: the job {how}: {} of {} archives judged again, {incomplete} of them with taps or shoulders left out",
        rows.len() - failed.len(),
        rows.len()
    ));
    writeln!(io::stdout(), "{}", done.folder).context("cannot print where the results are")?;
    Ok(failed.is_empty() && incomplete == 0)
}
