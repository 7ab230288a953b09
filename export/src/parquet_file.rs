//! A table as typed columns of Arrow, with null for absent values, and as Parquet, written one row group at a time.

use std::collections::HashMap;
use std::io;
use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, RecordBatch, StringArray, UInt16Array, UInt32Array};
use arrow_schema::{DataType, Field, Schema};
use parquet::arrow::ArrowWriter;
use parquet::basic::Compression;
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;

use crate::Export;
use crate::Result;
use crate::column::{Cells, Column, Sink};
use tapline_store::Reader;

/// Rows that are converted to columns together.
const BATCH_ROWS: usize = 8192;

/// Rows of a group, which is in memory until it is written: tens of megabytes of the widest table.
const GROUP_ROWS: usize = 8 * BATCH_ROWS;

/// Metadata key of a column's unit.
const UNIT: &str = "unit";

/// Parquet with metadata about the origin of the table.
pub(crate) struct ParquetFile<W: io::Write + Send> {
    /// Until the columns are known.
    out: Option<W>,
    writer: Option<(Box<ArrowWriter<W>>, Arc<Schema>)>,
    metadata: Vec<KeyValue>,
}

impl<W: io::Write + Send> ParquetFile<W> {
    /// A file of `table` into `out`.
    pub(crate) fn new(table: Export, out: W) -> Self {
        let metadata = vec![
            entry("tapline.table", table.name().to_owned()),
            entry("tapline.exported_by", env!("CARGO_PKG_VERSION").to_owned()),
        ];
        Self { out: Some(out), writer: None, metadata }
    }

    /// Adds the one archive of the table to the metadata; before any row.
    pub(crate) fn describe(&mut self, reader: &Reader) {
        self.metadata.push(entry("tapline.plan_digest", format!("{:016x}", reader.plan().digest())));
        self.metadata.extend(reader.written_by().map(|version| entry("tapline.written_by", version)));
    }

    /// The writer of a table with `columns`.
    fn writer<R>(&mut self, columns: &[Column<R>]) -> Result<&mut (Box<ArrowWriter<W>>, Arc<Schema>)> {
        if let Some(out) = self.out.take() {
            let schema = Arc::new(Schema::new(fields(columns)));
            let properties = WriterProperties::builder()
                .set_compression(Compression::SNAPPY)
                .set_max_row_group_row_count(Some(GROUP_ROWS))
                .set_key_value_metadata(Some(std::mem::take(&mut self.metadata)))
                .build();
            let writer = ArrowWriter::try_new(out, Arc::clone(&schema), Some(properties))?;
            self.writer = Some((Box::new(writer), schema));
        }
        Ok(self.writer.as_mut().ok_or_else(|| ParquetError::General("the table could not be begun".to_owned()))?)
    }

    /// Ends the table.
    pub(crate) fn finish(self) -> Result<()> {
        let Some((out, _)) = self.writer else { return Ok(()) };
        // Flushes buffers below, so that their errors are reported.
        Ok(out.into_inner()?.flush().map_err(ParquetError::from)?)
    }
}

fn entry(key: &str, value: String) -> KeyValue {
    KeyValue::new(key.to_owned(), value)
}

impl<W: io::Write + Send> Sink for ParquetFile<W> {
    fn rows<R>(&mut self, columns: &[Column<R>], rows: impl Iterator<Item = R>) -> Result<()> {
        let (out, schema) = self.writer(columns)?;
        for arrays in batches(columns, rows) {
            out.write(&RecordBatch::try_new(Arc::clone(schema), arrays).map_err(ParquetError::from)?)?;
        }
        Ok(())
    }
}

/// Hands batches of rows to a function, each as an array for every column.
pub(crate) struct Batches<F>(pub F);

impl<F: FnMut(Vec<ArrayRef>)> Sink for Batches<F> {
    fn rows<R>(&mut self, columns: &[Column<R>], rows: impl Iterator<Item = R>) -> Result<()> {
        batches(columns, rows).for_each(&mut self.0);
        Ok(())
    }
}

/// Names, types and units of columns.
pub(crate) fn fields<R>(columns: &[Column<R>]) -> Vec<Field> {
    columns.iter().map(field).collect()
}

/// Name, type and unit of a column. Every column may have null, so that the schema never changes.
fn field<R>(column: &Column<R>) -> Field {
    let kind = match column.cells {
        Cells::U16(_) => DataType::UInt16,
        Cells::U32(_) => DataType::UInt32,
        Cells::F64(_) => DataType::Float64,
        Cells::Text(_) => DataType::Utf8,
    };
    let field = Field::new(&column.name, kind, true);
    match column.unit {
        "" => field,
        unit => field.with_metadata(HashMap::from([(UNIT.to_owned(), unit.to_owned())])),
    }
}

/// `rows`, a batch at a time, as an array for each of `columns`.
fn batches<R>(columns: &[Column<R>], mut rows: impl Iterator<Item = R>) -> impl Iterator<Item = Vec<ArrayRef>> {
    std::iter::from_fn(move || {
        let batch: Vec<R> = rows.by_ref().take(BATCH_ROWS).collect();
        (!batch.is_empty()).then(|| columns.iter().map(|column| array(&column.cells, &batch)).collect())
    })
}

fn array<R>(cells: &Cells<R>, rows: &[R]) -> ArrayRef {
    match cells {
        Cells::U16(cell) => Arc::new(rows.iter().map(cell).collect::<UInt16Array>()),
        Cells::U32(cell) => Arc::new(rows.iter().map(cell).collect::<UInt32Array>()),
        Cells::F64(cell) => Arc::new(rows.iter().map(cell).collect::<Float64Array>()),
        Cells::Text(cell) => Arc::new(rows.iter().map(cell).collect::<StringArray>()),
    }
}

#[cfg(test)]
mod tests {
    use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

    use super::*;

    /// Catches rows lost or doubled between batches, and a long file with one group.
    #[test]
    fn long_tables_are_written_in_groups() {
        let row_count = GROUP_ROWS + BATCH_ROWS / 2;
        let mut file = tempfile::tempfile().unwrap();
        let columns = [Column::u32("row", |row: &u32| *row)];
        let mut sink = ParquetFile::new(Export::Ledger, &mut file);
        sink.rows(&columns, 0..u32::try_from(BATCH_ROWS / 3).unwrap()).unwrap();
        sink.rows(&columns, u32::try_from(BATCH_ROWS / 3).unwrap()..u32::try_from(row_count).unwrap()).unwrap();
        sink.finish().unwrap();
        let builder = ParquetRecordBatchReaderBuilder::try_new(file).unwrap();
        assert_eq!(builder.metadata().num_row_groups(), 2);
        let mut next = 0;
        for batch in builder.build().unwrap() {
            let rows: UInt32Array = batch.unwrap().column(0).to_data().into();
            for row in rows.values() {
                assert_eq!(*row, next);
                next += 1;
            }
        }
        assert_eq!(next as usize, row_count);
    }
}
