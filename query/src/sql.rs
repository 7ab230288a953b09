//! Questions in SQL over the tables of casing files.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, Result, bail, ensure};
use datafusion::arrow::array::RecordBatch;
use datafusion::arrow::csv::WriterBuilder;
use datafusion::arrow::json::LineDelimitedWriter;
use datafusion::arrow::util::pretty::pretty_format_batches;
use datafusion::common::tree_node::{TreeNode as _, TreeNodeRecursion};
use datafusion::datasource::listing::ListingTableUrl;
use datafusion::execution::context::SQLOptions;
use datafusion::logical_expr::LogicalPlan;
use datafusion::prelude::SessionContext;
use futures_util::TryStreamExt as _;
use tapline_export::Export;

use crate::engine::{ArchiveArgs, Engine};
use crate::places::{CasingFile, find, partitions};
use crate::plan::FilesTable;
use crate::task::{Task, sql_name};

/// How rows are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// A table for people.
    Table,
    /// Text with a header line.
    Csv,
    /// A line of JSON for each row.
    Json,
}

/// Answer a question in SQL. Tables: taps, discriminators, damage, regions, verdicts.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = HELP)]
pub struct Question {
    /// The statement.
    pub sql: String,
    /// The archives that it is about.
    #[command(flatten)]
    pub archives: ArchiveArgs,
    /// Take the newest results of `tapline reprocess` of each casing instead of its archive.
    #[arg(long = "results")]
    pub is_results: bool,
    /// How rows are printed.
    #[arg(long, value_enum, default_value = "table")]
    pub format: Format,
}

const HELP: &str = "\
Every table has the columns of `tapline export`, and file, status (ok or error) and error. A file that cannot be read
is one row with its error: SELECT file, error FROM verdicts WHERE status = 'error'.";

/// Registers every table over `files` in `context`, which is connected already.
///
/// # Errors
/// What DataFusion returns.
pub fn register(context: &SessionContext, files: &[CasingFile], files_per_task: usize) -> Result<()> {
    for table in Export::ALL {
        let files = FilesTable::new(Task::Read(table), partitions(files, files_per_task));
        context
            .register_table(sql_name(table), Arc::new(files))
            .with_context(|| format!("cannot register the table {}", sql_name(table)))?;
    }
    Ok(())
}

/// Answers it into `out`.
///
/// # Errors
/// Folders that cannot be read, a statement that is none, an engine that fails, and `out`.
pub async fn answer(question: &Question, out: &mut impl Write) -> Result<()> {
    let ArchiveArgs { places, engine, files_per_task } = &question.archives;
    let files = find(places, question.is_results).await?;
    let context = engine.connect().await?;
    register(&context, &files, usize::from(*files_per_task))?;
    // Nothing that is created or set outlasts the question; COPY counts as DML.
    let options = SQLOptions::new().with_allow_ddl(false).with_allow_statements(false);
    let frame = context.sql_with_options(&question.sql, options).await.with_context(|| {
        let tables: Vec<&str> = Export::ALL.into_iter().map(sql_name).collect();
        format!("cannot plan {:?} over the tables {}", question.sql, tables.join(", "))
    })?;
    check_copies(frame.logical_plan(), engine)?;
    let schema = Arc::clone(frame.schema().inner());
    let mut rows = frame.execute_stream().await.with_context(|| engine.at())?;
    let mut next = async || -> Result<Option<RecordBatch>> { rows.try_next().await.with_context(|| engine.at()) };
    match question.format {
        Format::Table => {
            let mut batches = vec![RecordBatch::new_empty(schema)];
            while let Some(batch) = next().await? {
                batches.push(batch);
            }
            writeln!(out, "{}", pretty_format_batches(&batches).context("cannot print the rows")?)?;
        }
        Format::Csv => {
            let mut writer = WriterBuilder::new().with_header(true).build(&mut *out);
            writer.write(&RecordBatch::new_empty(schema)).context("cannot write rows")?;
            while let Some(batch) = next().await? {
                writer.write(&batch).context("cannot write rows")?;
            }
        }
        Format::Json => {
            let mut writer = LineDelimitedWriter::new(&mut *out);
            while let Some(batch) = next().await? {
                writer.write(&batch).context("cannot write rows")?;
            }
            writer.finish().context("cannot write rows")?;
        }
    }
    out.flush().context("cannot write rows")
}

/// Checks what a `COPY` in `plan` would write to: files that are not there yet, where files can be made.
///
/// DataFusion replaces what is there, and tries without end to open a file that it cannot make.
fn check_copies(plan: &LogicalPlan, engine: &Engine) -> Result<()> {
    let mut targets = Vec::new();
    let walked = plan.apply(|node| match node {
        // It writes nothing.
        LogicalPlan::Explain(_) => Ok(TreeNodeRecursion::Stop),
        LogicalPlan::Copy(copy) => {
            targets.push(copy.output_url.clone());
            Ok(TreeNodeRecursion::Continue)
        }
        _ => Ok(TreeNodeRecursion::Continue),
    });
    walked.context("cannot examine the plan")?;
    targets.iter().try_for_each(|target| check_target(target, engine))
}

fn check_target(target: &str, engine: &Engine) -> Result<()> {
    // As DataFusion reads it, so that what is checked is what is written.
    let read = ListingTableUrl::parse(target).with_context(|| format!("COPY TO {target:?}: no usable path"))?;
    let url = read.get_url();
    let path = url.to_file_path().ok().filter(|_| url.scheme() == "file" && read.get_glob().is_none());
    let Some(path) = path else {
        bail!("COPY writes files, and {target:?} is not the path of one: give a path without *, ? and [")
    };
    let is_relative = !target.starts_with('/') && !target.starts_with("file:");
    ensure!(
        *engine == Engine::Local || !is_relative,
        "COPY TO {target:?}: the cluster writes it, in a folder of its own: give a path that begins with /"
    );
    let path: PathBuf = path.components().collect(); // without a slash at its end
    match path.read_dir().map(|mut entries| entries.next().is_none()) {
        Ok(true) => {}
        Ok(false) => bail!("COPY TO {target:?}: this folder has files already; COPY writes into an empty or a new one"),
        Err(_) if path.symlink_metadata().is_ok() => {
            bail!("COPY TO {target:?}: it already exists, and nothing takes its place")
        }
        Err(_) => {}
    }
    let there = path.ancestors().find(|folder| folder.exists()).unwrap_or(Path::new("/"));
    let probe = tempfile::Builder::new().prefix(".copy-").tempfile_in(there);
    probe.map(drop).with_context(|| format!("COPY TO {target:?}: no file can be made in {}", there.display()))
}
