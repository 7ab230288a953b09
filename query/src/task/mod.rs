//! What is done with each casing file, and the form in which that travels to the hosts of a cluster.

mod local;
pub(crate) mod payload;
mod program;
mod reprocess;
mod rows;

use std::sync::Arc;

use datafusion::arrow::array::RecordBatch;
use datafusion::arrow::datatypes::{DataType, Field, Schema, SchemaRef};
use serde::{Deserialize, Serialize};
use tapline_export::{Export, columns};

pub(crate) use local::Local;
pub use program::Program;
pub(crate) use reprocess::{FILES, given, reference};
pub use reprocess::{Given, Reference, ReprocessTask};

use crate::places::CasingFile;
use crate::task::rows::Columns;

/// The name of `table` in SQL.
pub(crate) fn sql_name(table: Export) -> &'static str {
    if table == Export::Ledger { "taps" } else { table.name() }
}

/// What is done with each file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Task {
    /// The rows of a table are read.
    Read(Export),
    /// The archived taps are judged again.
    Reprocess(ReprocessTask),
}

impl Task {
    /// Columns of the rows: the file's name, its own columns, and what came of it.
    pub fn schema(&self) -> SchemaRef {
        let of_file = match self {
            Self::Read(table) => columns(*table),
            Self::Reprocess(_) => ReprocessTask::fields(),
        };
        let file = Field::new("file", DataType::Utf8, false);
        let ends = [Field::new("status", DataType::Utf8, false), Field::new("error", DataType::Utf8, true)];
        Arc::new(Schema::new([file].into_iter().chain(of_file).chain(ends).collect::<Vec<_>>()))
    }

    /// How many files it does at a time. The rows of files that are read wait in memory, and should not be many; a program that
    /// judges archives takes as many as there are, because it learns the reference first.
    pub(crate) fn files_at_a_time(&self) -> usize {
        match self {
            Self::Read(_) => 1,
            Self::Reprocess(_) => usize::MAX,
        }
    }

    /// Does the task with `files`, and returns their rows; of a file that cannot be done one row, with the error.
    ///
    /// # Errors
    /// Where no file can be done: the folder of the job is gone, the program is another one, or object storage cannot be reached.
    pub(crate) fn run(&self, files: &[CasingFile]) -> anyhow::Result<Vec<RecordBatch>> {
        let of_files = match self {
            Self::Read(table) => files.iter().map(|file| read(file, *table)).collect::<anyhow::Result<Vec<_>>>()?,
            Self::Reprocess(task) => task.run(files)?.into_iter().map(|row| row.map(|row| vec![row])).collect(),
        };
        let batches = files.iter().zip(of_files).map(|(file, rows)| rows::batches(&self.schema(), &file.name, rows));
        Ok(batches.collect::<anyhow::Result<Vec<_>>>()?.concat())
    }
}

/// The rows of one file, or why it cannot be read.
fn read(file: &CasingFile, table: Export) -> anyhow::Result<Result<Vec<Columns>, String>> {
    Ok(Local::of(file)?.and_then(|local| {
        let rows = rows::read(local.path(), table);
        rows.map_err(|error| local.message(file, &error.to_string()))
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a table of another name than its rows.
    #[test]
    fn tables_have_the_columns_of_the_export() {
        for table in Export::ALL {
            let schema = Task::Read(table).schema();
            let names: Vec<_> = schema.fields().iter().map(|field| field.name().as_str()).collect();
            assert_eq!((names[0], &names[names.len() - 2..]), ("file", &["status", "error"][..]));
            assert_eq!(names.len(), columns(table).len() + 3, "{}", table.name());
        }
        let verdicts = Task::Read(Export::Verdicts).schema();
        assert_eq!(verdicts.field_with_name("scan_s").unwrap().metadata()["unit"], "s");
        assert_eq!(
            Task::Read(Export::Ledger).schema().field_with_name("location").unwrap().data_type(),
            &DataType::UInt32
        );
    }
}
