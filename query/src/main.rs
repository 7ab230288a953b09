//! `tapline-query`: questions over years of archives, and new results of them, on this host or a cluster.

use std::io;
use std::net::{IpAddr, Ipv4Addr};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, Result};
use clap::{Args, Parser, Subcommand};
use tapline_host::messages::{print_failure, print_line};
use tapline_query::cluster::{Executor, Scheduler};
use tapline_query::copy::Copied;
use tapline_query::reprocess::{self, Order};
use tapline_query::sql::{self, Format, Question};
use tapline_query::{Engine, Place};

/// Exit code where something was left out.
const INCOMPLETE: u8 = 3;

/// Files that could not be judged or copied and are named; of more the number is given.
const NAMED_MAX: usize = 20;

/// Ask about years of archives, or judge them again: on this host, or on a cluster.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Answer a question in SQL. Tables: taps, discriminators, damage, regions, verdicts.
    #[command(after_help = SQL_HELP)]
    Sql {
        /// The statement.
        sql: String,
        #[command(flatten)]
        archives: ArchiveArgs,
        /// Of each casing take the newest results of `tapline reprocess` instead of its archive.
        #[arg(long)]
        results: bool,
        /// How rows are printed.
        #[arg(long, value_enum, default_value = "table")]
        format: Format,
    },
    /// Judge archives again, all of them as one job, into a folder with a commit file.
    Reprocess {
        #[command(flatten)]
        archives: ArchiveArgs,
        /// Folder for the folders of jobs, or s3://BUCKET/FOLDER; on a cluster every host must reach it under this name.
        #[arg(long, value_name = "DIR|s3://BUCKET/DIR")]
        out: Place,
        /// Configuration whose tables `process` and `fuse` take the place of the archives', as for `tapline reprocess`.
        #[arg(long)]
        config: Option<PathBuf>,
        /// What shoulders are compared with, as for `tapline reprocess`.
        #[arg(long, value_name = "FILE.json|TYRE/SHOULDER|self")]
        reference: Option<String>,
        /// Read the samples even where the archives' own discriminators would do.
        #[arg(long)]
        from_samples: bool,
    },
    /// Copy finished archives to another place, such as a bucket. Each is checked first; what is there is not overwritten.
    Copy {
        /// Folders of casing files; every finished archive in them and in their subfolders is copied.
        #[arg(required = true, value_name = "DIR|s3://BUCKET/DIR")]
        places: Vec<Place>,
        /// Where they go.
        #[arg(long, value_name = "DIR|s3://BUCKET/DIR")]
        to: Place,
    },
    /// Be the scheduler of a cluster.
    Scheduler {
        #[command(flatten)]
        listen: ListenArgs,
        /// Port that clients and executors connect to; 0 for any that is free.
        #[arg(long, default_value_t = 50050)]
        port: u16,
        /// Seconds of silence after which an executor is taken for lost, and its work is given to others.
        #[arg(long, default_value_t = 20)]
        executor_timeout_s: u64,
    },
    /// Be an executor of a cluster. It works on one file at a time: run one for each core of a host.
    Executor {
        /// The scheduler.
        #[arg(value_name = "cluster://HOST:PORT")]
        engine: Engine,
        #[command(flatten)]
        listen: ListenArgs,
        /// Port from which results are fetched; 0 for any that is free.
        #[arg(long, default_value_t = 0)]
        port: u16,
        /// Folder for what is under way; one of the system's when left out.
        #[arg(long)]
        work: Option<PathBuf>,
    },
}

const SQL_HELP: &str = "\
Every table has the columns of `tapline export`, and besides file, status (ok or error) and error. A file that cannot be read
is one row with its error: SELECT file, error FROM verdicts WHERE status = 'error'.";

#[derive(Debug, Args)]
struct ArchiveArgs {
    /// Folders of casing files; every finished archive in them and in their subfolders is taken.
    #[arg(required = true, value_name = "DIR|s3://BUCKET/DIR")]
    places: Vec<Place>,
    /// Where it is done: local, or cluster://HOST:PORT.
    #[arg(long, default_value = "local")]
    engine: Engine,
    /// Files of one task; a cluster needs some 50 ms more for each task.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..))]
    files_per_task: u16,
}

#[derive(Debug, Args)]
struct ListenArgs {
    /// Address to listen on. Only this host reaches the default; there is no password.
    #[arg(long, default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    bind: IpAddr,
    /// Name or address by which others reach this host, where it is not that of --bind.
    #[arg(long)]
    host: Option<String>,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
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
        Verb::Sql { sql, archives, results, format } => {
            let ArchiveArgs { places, engine, files_per_task } = archives;
            let question = Question { sql, places, is_results: results, files_per_task: files_per_task.into(), format };
            sql::answer(&question, &engine, &mut io::stdout().lock()).await?;
            Ok(true)
        }
        Verb::Reprocess { archives, out, config, reference, from_samples } => {
            let ArchiveArgs { places, engine, files_per_task } = archives;
            let files_per_task = files_per_task.into();
            let order = Order { places, out, config, reference, is_from_samples: from_samples, files_per_task };
            reprocess(&order, &engine).await
        }
        Verb::Copy { places, to } => copy(&places, &to).await,
        Verb::Scheduler { listen: ListenArgs { bind, host }, port, executor_timeout_s } => {
            Scheduler { bind, port, host, executor_timeout_s }.run().await.map(|()| true)
        }
        Verb::Executor { engine, listen: ListenArgs { bind, host }, port, work } => {
            Executor { engine, bind, port, host, work }.run().await.map(|()| true)
        }
    }
}

async fn copy(places: &[Place], to: &Place) -> Result<bool> {
    let Copied { copied, there, failed } = tapline_query::copy::copy(places, to).await?;
    for (file, why) in failed.iter().take(NAMED_MAX) {
        print_line(&format!("tapline-query: {file}: {why}"));
    }
    let (count, failed) = (copied + there + failed.len(), failed.len());
    print_line(&format!(
        "tapline-query: {copied} of {count} archives copied to {to}, {there} were there, {failed} failed"
    ));
    Ok(failed == 0)
}

async fn reprocess(order: &Order, engine: &Engine) -> Result<bool> {
    use io::Write as _;
    let done = reprocess::reprocess(order, engine).await?;
    let rows = &done.committed.rows;
    let failed: Vec<_> = done.committed.failed().collect();
    for row in failed.iter().take(NAMED_MAX) {
        print_line(&format!("tapline-query: {}: {}", row.file, row.error.as_deref().unwrap_or("not judged")));
    }
    let incomplete = rows.iter().filter(|row| row.is_complete == Some(false)).count();
    let how = if done.was_there { "was committed before" } else { "is committed" };
    print_line(&format!(
        "tapline-query: the job {how}: {} of {} archives judged again, {incomplete} of them with taps or shoulders left out",
        rows.len() - failed.len(),
        rows.len()
    ));
    writeln!(io::stdout(), "{}", done.folder).context("cannot print where the results are")?;
    Ok(failed.is_empty() && incomplete == 0)
}
