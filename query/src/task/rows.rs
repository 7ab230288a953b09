//! Rows of a casing file as batches of Arrow.

use std::path::Path;
use std::sync::Arc;

use datafusion::arrow::array::{ArrayRef, RecordBatch, StringArray, new_null_array};
use datafusion::arrow::datatypes::SchemaRef;
use tapline_export::{Export, read_batches};
use tapline_host::messages::print_line;
use tapline_store::Reader;

/// The columns of a batch of rows, without those that every table has.
pub(crate) type Columns = Vec<ArrayRef>;

/// Reads a table of the archive at `path`: all of its rows, or none.
///
/// # Errors
/// What [`Reader::open`] returns, and errors of reading the archive.
pub(crate) fn read(path: &Path, table: Export) -> Result<Vec<Columns>, tapline_export::Error> {
    let reader = Reader::open(path)?;
    let mut rows = Vec::new();
    read_batches(&reader, table, |columns| rows.push(columns))?;
    Ok(rows)
}

/// Puts the name of the file and what came of it around its `rows`; turns an error into the one row that names it.
///
/// # Errors
/// Columns that are not those of `schema`.
pub(crate) fn batches(
    schema: &SchemaRef,
    name: &str,
    rows: Result<Vec<Columns>, String>,
) -> anyhow::Result<Vec<RecordBatch>> {
    let (rows, error) = match rows {
        Ok(rows) => (rows, None),
        Err(error) => {
            print_line(&format!("tapline-query: {name}: {error}"));
            let absent = |field: &Arc<_>| new_null_array(datafusion::arrow::datatypes::Field::data_type(field), 1);
            (vec![schema.fields()[1..schema.fields().len() - 2].iter().map(absent).collect()], Some(error))
        }
    };
    let status = if error.is_none() { "ok" } else { "error" };
    let batch = |columns: Columns| {
        let count = columns.first().map_or(0, |column| column.len());
        let text = |text: Option<&str>| Arc::new(StringArray::from(vec![text; count])) as ArrayRef;
        let (before, after) = (text(Some(name)), [text(Some(status)), text(error.as_deref())]);
        let columns = std::iter::once(before).chain(columns).chain(after).collect();
        Ok(RecordBatch::try_new(Arc::clone(schema), columns)?)
    };
    rows.into_iter().map(batch).collect()
}
