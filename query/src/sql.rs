//! Questions in SQL over the tables of casing files.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, Result, bail, ensure};
use datafusion::arrow::array::{ArrayRef, AsArray as _, RecordBatch, StringArray};
use datafusion::arrow::compute::cast;
use datafusion::arrow::csv;
use datafusion::arrow::datatypes::{DataType, Field, Schema};
use datafusion::arrow::json;
use datafusion::arrow::json::writer::LineDelimited;
use datafusion::arrow::util::pretty::pretty_format_batches;
use datafusion::common::tree_node::{TreeNode as _, TreeNodeRecursion};
use datafusion::datasource::listing::ListingTableUrl;
use datafusion::execution::context::SQLOptions;
use datafusion::logical_expr::LogicalPlan;
use datafusion::physical_plan::execute_stream;
use datafusion::prelude::SessionContext;
use futures_util::TryStreamExt as _;
use tapline_export::Export;
use tapline_host::messages::print_line;
use tapline_wire::csv_cell;

use crate::engine::{ArchiveArgs, Engine};
use crate::places::{CasingFile, find, partitions};
use crate::plan::{FilesTable, has_unread};
use crate::task::{Task, sql_name};

/// How rows are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// A table for people.
    Table,
    /// Text with a header line; a text that a spreadsheet would take for a formula has a ' before it.
    Csv,
    /// A line of JSON for each row, with null for an absent value.
    Json,
}

/// Answer a question in SQL. Tables: taps, discriminators, damage, regions, verdicts, casings.
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
is one row with its error: SELECT file, error FROM verdicts WHERE status = 'error'. The exit code is then 3.

The path of a Parquet, CSV or JSON file, or of a folder of them, between single quotes is a table too.";

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

/// Answers it into `out`; whether all files could be read.
///
/// # Errors
/// Folders that cannot be read, a statement that is none, an engine that fails, and `out`.
pub async fn answer(question: &Question, out: &mut impl Write) -> Result<bool> {
    let ArchiveArgs { places, engine, .. } = &question.archives;
    let files = find(places, question.is_results).await?;
    let context = engine.connect().await?;
    register(&context, &files, question.archives.files_per_task())?;
    // Nothing that is created or set outlasts the question; COPY counts as DML.
    let options = SQLOptions::new().with_allow_ddl(false).with_allow_statements(false);
    let frame = context.sql_with_options(&question.sql, options).await.with_context(|| {
        let tables: Vec<&str> = Export::ALL.into_iter().map(sql_name).collect();
        format!("cannot plan {:?} over the tables {}", question.sql, tables.join(", "))
    })?;
    check_writes(frame.logical_plan(), engine)?;
    let schema = Arc::clone(frame.schema().inner());
    let tasks = Arc::new(frame.task_ctx());
    let plan = frame.create_physical_plan().await.with_context(|| engine.at())?;
    let mut rows = execute_stream(Arc::clone(&plan), Arc::clone(&tasks)).with_context(|| engine.at())?;
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
            let mut writer = csv::WriterBuilder::new().with_header(true).build(&mut *out);
            writer.write(&RecordBatch::new_empty(schema)).context("cannot write rows")?;
            while let Some(batch) = next().await? {
                writer.write(&without_formulas(&batch)?).context("cannot write rows")?;
            }
        }
        Format::Json => {
            // A program that reads the rows finds every column in each.
            let builder = json::WriterBuilder::new().with_explicit_nulls(true);
            let mut writer = builder.build::<_, LineDelimited>(&mut *out);
            while let Some(batch) = next().await? {
                writer.write(&batch).context("cannot write rows")?;
            }
            writer.finish().context("cannot write rows")?;
        }
    }
    drop(rows);
    out.flush().context("cannot write rows")?;
    match has_unread(&plan, tasks.session_config()).await {
        Ok(false) => return Ok(true),
        // They are named on standard error of the process that could not read them.
        Ok(true) if *engine == Engine::Local => {}
        Ok(true) => print_line(
            "tapline-query: some files could not be read: SELECT file, error FROM verdicts WHERE status = 'error' lists them",
        ),
        Err(error) => print_line(&format!("tapline-query: it is not known whether all files could be read: {error}")),
    }
    Ok(false)
}

/// `rows` with an apostrophe before each text that a spreadsheet would evaluate, as in the CSV of `tapline export`.
fn without_formulas(rows: &RecordBatch) -> Result<RecordBatch> {
    let column = |column: &ArrayRef| -> Result<ArrayRef> {
        let texts = match column.data_type() {
            DataType::Utf8 | DataType::LargeUtf8 | DataType::Utf8View | DataType::Dictionary(..) => {
                cast(column, &DataType::Utf8).context("cannot write rows")?
            }
            _ => return Ok(Arc::clone(column)),
        };
        let texts = texts.as_string::<i32>().iter();
        Ok(Arc::new(texts.map(|text| text.map(csv_cell)).collect::<StringArray>()))
    };
    let columns = rows.columns().iter().map(column).collect::<Result<Vec<_>>>()?;
    let fields = rows.schema_ref().fields().iter().zip(&columns);
    let fields: Vec<_> = fields.map(|(was, column)| Field::new(was.name(), column.data_type().clone(), true)).collect();
    RecordBatch::try_new(Arc::new(Schema::new(fields)), columns).context("cannot write rows")
}

/// Checks what `plan` would write to: only `COPY` writes, and only to files that are not there yet, where files can be made.
///
/// DataFusion replaces what is there, and tries without end to open a file that it cannot make.
fn check_writes(plan: &LogicalPlan, engine: &Engine) -> Result<()> {
    let mut targets = Vec::new();
    let mut has_insert = false;
    let walked = plan.apply(|node| match node {
        // It writes nothing.
        LogicalPlan::Explain(_) => Ok(TreeNodeRecursion::Stop),
        LogicalPlan::Copy(copy) => {
            targets.push(copy.output_url.clone());
            Ok(TreeNodeRecursion::Continue)
        }
        // It would add to a folder of files.
        LogicalPlan::Dml(_) => {
            has_insert = true;
            Ok(TreeNodeRecursion::Stop)
        }
        _ => Ok(TreeNodeRecursion::Continue),
    });
    walked.context("cannot examine the plan")?;
    ensure!(!has_insert, "tables are only read; COPY (SELECT ...) TO writes new files");
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

#[cfg(test)]
mod tests {
    use datafusion::arrow::array::Float64Array;

    use super::*;

    /// Catches a text that a spreadsheet would evaluate, of whatever type, and a number or an absent text that becomes one.
    #[test]
    fn texts_are_no_formulas() {
        let texts = ["=1+1", "+49", "-5", "@SUM(A1)", "\tx", "\r=x", "'=1", "''-", "A-17", "'A", ""];
        let texts: ArrayRef = Arc::new(texts.into_iter().map(Some).chain([None]).collect::<StringArray>());
        let dictionary = DataType::Dictionary(Box::new(DataType::Int32), Box::new(DataType::Utf8));
        let types = [DataType::Utf8, DataType::LargeUtf8, DataType::Utf8View, dictionary];
        let mut columns: Vec<_> = types.iter().map(|of| cast(&texts, of).unwrap()).collect();
        columns.push(Arc::new(Float64Array::from(vec![-1.5; texts.len()])));
        let fields: Vec<_> = columns.iter().map(|column| Field::new("x", column.data_type().clone(), true)).collect();
        let rows = RecordBatch::try_new(Arc::new(Schema::new(fields)), columns).unwrap();
        let safe = without_formulas(&rows).unwrap();
        for column in &safe.columns()[..4] {
            for (is, was) in column.as_string::<i32>().iter().zip(texts.as_string::<i32>()).take(8) {
                assert_eq!(is.unwrap(), format!("'{}", was.unwrap()));
            }
            assert_eq!(column.slice(8, 4).as_ref(), texts.slice(8, 4).as_ref());
        }
        assert_eq!(safe.column(4), rows.column(4));
    }
}
