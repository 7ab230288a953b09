//! A task as a plan of DataFusion: paths of files in memory, and above them the node that turns paths into rows.
//!
//! - `files_exec`: the node
//! - `codec`: both as bytes, for a cluster
//! - `unread`: whether a plan that was run could read every file

pub(crate) mod codec;
mod files_exec;
mod unread;

use std::sync::Arc;

use async_trait::async_trait;
use datafusion::arrow::array::{RecordBatch, StringArray};
use datafusion::arrow::datatypes::{DataType, Field, Schema, SchemaRef};
use datafusion::catalog::{Session, TableProvider};
use datafusion::common::{DataFusionError, Result};
use datafusion::datasource::memory::MemorySourceConfig;
use datafusion::logical_expr::{Expr, TableType};
use datafusion::physical_plan::ExecutionPlan;

pub use files_exec::settle;
pub(crate) use files_exec::{FilesExec, limit_workers};
pub(crate) use unread::has_unread;

use crate::places::CasingFile;
use crate::task::Task;

/// The files of partitions, and the task for each file: a table of the rows that the task returns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FilesTable {
    /// What is done with each file.
    pub task: Task,
    /// The files, by partition.
    pub partitions: Vec<Vec<CasingFile>>,
}

impl FilesTable {
    /// A table of `task` over the files of `partitions`.
    pub fn new(task: Task, partitions: Vec<Vec<CasingFile>>) -> Self {
        Self { task, partitions }
    }
}

#[async_trait]
impl TableProvider for FilesTable {
    fn schema(&self) -> SchemaRef {
        self.task.schema()
    }

    fn table_type(&self) -> TableType {
        TableType::Base
    }

    async fn scan(
        &self,
        _state: &dyn Session,
        projection: Option<&Vec<usize>>,
        _filters: &[Expr],
        _limit: Option<usize>,
    ) -> Result<Arc<dyn ExecutionPlan>> {
        let schema = file_schema();
        let of_files = |files: &Vec<CasingFile>| Ok(vec![file_batch(&schema, files)?]);
        let partitions = self.partitions.iter().map(of_files).collect::<Result<Vec<_>>>()?;
        // Ballista cuts this leaf by its partitions. A leaf of our own it would give whole to every task.
        let files = MemorySourceConfig::try_new_exec(&partitions, Arc::clone(&schema), None)?;
        Ok(Arc::new(FilesExec::new(self.task.clone(), projection.cloned(), files)?))
    }
}

/// The column of the files that a plan works on, each as JSON.
fn file_schema() -> SchemaRef {
    Arc::new(Schema::new(vec![Field::new("file", DataType::Utf8, false)]))
}

fn file_batch(schema: &SchemaRef, files: &[CasingFile]) -> Result<RecordBatch> {
    let text =
        |file: &CasingFile| serde_json::to_string(file).map_err(|error| DataFusionError::External(Box::new(error)));
    let texts = files.iter().map(text).collect::<Result<Vec<String>>>()?;
    Ok(RecordBatch::try_new(Arc::clone(schema), vec![Arc::new(StringArray::from(texts))])?)
}
