//! The node that turns paths of files into rows.

use std::fmt;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use datafusion::arrow::array::{Array as _, RecordBatch, StringArray};
use datafusion::arrow::datatypes::SchemaRef;
use datafusion::common::tree_node::TreeNodeRecursion;
use datafusion::common::{DataFusionError, Result, internal_err};
use datafusion::execution::{SendableRecordBatchStream, TaskContext};
use datafusion::physical_expr::{EquivalenceProperties, PhysicalExpr};
use datafusion::physical_plan::execution_plan::{
    ChildrenPropertiesMode, EmissionType, ExecutionPlanProperties as _, ReplaceChildrenOptions,
};
use datafusion::physical_plan::metrics::{ExecutionPlanMetricsSet, MetricBuilder, MetricsSet};
use datafusion::physical_plan::stream::RecordBatchReceiverStream;
use datafusion::physical_plan::{DisplayAs, DisplayFormatType, ExecutionPlan, PlanProperties};
use futures_util::StreamExt as _;
use tokio::sync::Semaphore;

use crate::places::CasingFile;
use crate::task::{Task, sql_name};

/// Batches of rows that may wait for who reads them.
const WAITING_MAX: usize = 2;

/// The metric that counts the files whose row is an error. The scheduler of a cluster passes it on to the client.
pub(super) const UNREAD: &str = "unread_files";

/// How often to look whether work has ended.
const SETTLE_EVERY: Duration = Duration::from_millis(20);

/// How many files this process works on at a time, and a permit for each.
static WORKERS: OnceLock<(usize, Semaphore)> = OnceLock::new();

/// Makes this process work on at most `count` files at a time; the first call counts.
pub(crate) fn limit_workers(count: usize) {
    WORKERS.get_or_init(|| (count.max(1), Semaphore::new(count.max(1))));
}

fn workers() -> &'static (usize, Semaphore) {
    limit_workers(std::thread::available_parallelism().map_or(1, usize::from));
    WORKERS.wait()
}

/// Begins no more files, and waits for those under way: after an error there may be some, and they need the runtime.
pub async fn settle() {
    let (count, leave) = workers();
    leave.close();
    while leave.available_permits() < *count {
        tokio::time::sleep(SETTLE_EVERY).await;
    }
}

/// Does its task with every file that its input names.
#[derive(Debug)]
pub(crate) struct FilesExec {
    pub(crate) task: Task,
    pub(crate) projection: Option<Vec<usize>>,
    input: Arc<dyn ExecutionPlan>,
    properties: Arc<PlanProperties>,
    metrics: ExecutionPlanMetricsSet,
}

impl FilesExec {
    pub(crate) fn new(task: Task, projection: Option<Vec<usize>>, input: Arc<dyn ExecutionPlan>) -> Result<Self> {
        let schema = match &projection {
            Some(columns) => Arc::new(task.schema().project(columns)?),
            None => task.schema(),
        };
        // As many partitions as files come in, in no order: whose rows are in which does not matter.
        let properties = PlanProperties::new(
            EquivalenceProperties::new(schema),
            datafusion::physical_expr::Partitioning::UnknownPartitioning(input.output_partitioning().partition_count()),
            EmissionType::Incremental,
            input.boundedness(),
        );
        Ok(Self { task, projection, input, properties: Arc::new(properties), metrics: ExecutionPlanMetricsSet::new() })
    }
}

impl DisplayAs for FilesExec {
    fn fmt_as(&self, _t: DisplayFormatType, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.task {
            Task::Read(table) => write!(f, "FilesExec: read {}", sql_name(*table)),
            Task::Reprocess(_) => write!(f, "FilesExec: reprocess"),
        }
    }
}

impl ExecutionPlan for FilesExec {
    fn name(&self) -> &'static str {
        "FilesExec"
    }

    fn properties(&self) -> &Arc<PlanProperties> {
        &self.properties
    }

    /// The partitions are cut as they should be; a shuffle of paths would only cost.
    fn benefits_from_input_partitioning(&self) -> Vec<bool> {
        vec![false]
    }

    fn children(&self) -> Vec<&Arc<dyn ExecutionPlan>> {
        vec![&self.input]
    }

    fn apply_expressions(
        &self,
        _f: &mut dyn FnMut(&Arc<dyn PhysicalExpr>) -> Result<TreeNodeRecursion>,
    ) -> Result<TreeNodeRecursion> {
        Ok(TreeNodeRecursion::Continue)
    }

    fn replace_children(
        self: Arc<Self>,
        mut children: Vec<Arc<dyn ExecutionPlan>>,
        _options: ReplaceChildrenOptions,
    ) -> Result<Arc<dyn ExecutionPlan>> {
        match (children.pop(), children.is_empty()) {
            (Some(input), true) => Ok(Arc::new(Self::new(self.task.clone(), self.projection.clone(), input)?)),
            _ => internal_err!("FilesExec has one input"),
        }
    }

    fn with_new_children(self: Arc<Self>, children: Vec<Arc<dyn ExecutionPlan>>) -> Result<Arc<dyn ExecutionPlan>> {
        self.replace_children(children, ReplaceChildrenOptions::new(ChildrenPropertiesMode::Recompute))
    }

    fn execute(&self, partition: usize, context: Arc<TaskContext>) -> Result<SendableRecordBatchStream> {
        let mut input = self.input.execute(partition, context)?;
        let (task, projection) = (self.task.clone(), self.projection.clone());
        let mut builder = RecordBatchReceiverStream::builder(self.schema(), WAITING_MAX);
        let send = builder.tx();
        let unread = MetricBuilder::new(&self.metrics).counter(UNREAD, partition);
        builder.spawn(async move {
            while let Some(batch) = input.next().await {
                let files = files(&batch?)?;
                for files in files.chunks(task.files_at_a_time()) {
                    let all = of_files(&task, files).await?;
                    unread.add(all.iter().filter(|rows| is_error(rows)).count());
                    for rows in all {
                        let rows = match &projection {
                            None => rows,
                            Some(columns) => rows.project(columns)?,
                        };
                        if send.send(Ok(rows)).await.is_err() {
                            // The reader wants no more.
                            return Ok(());
                        }
                    }
                }
            }
            Ok(())
        });
        Ok(builder.build())
    }

    fn schema(&self) -> SchemaRef {
        Arc::clone(self.properties.eq_properties.schema())
    }

    fn metrics(&self) -> Option<MetricsSet> {
        Some(self.metrics.clone_inner())
    }
}

/// Whether all columns of the task are there, and the last one, `error`, says why there is nothing else.
fn is_error(rows: &RecordBatch) -> bool {
    rows.columns().last().is_some_and(|error| error.null_count() < rows.num_rows())
}

/// The files that a batch names.
fn files(batch: &RecordBatch) -> Result<Vec<CasingFile>> {
    let column = batch.columns().first().and_then(|column| column.as_any().downcast_ref::<StringArray>());
    let Some(column) = column else { return internal_err!("the files of a plan do not have the column file") };
    let file =
        |text| serde_json::from_str::<CasingFile>(text).map_err(|error| DataFusionError::External(Box::new(error)));
    column.iter().flatten().map(file).collect()
}

/// The rows of `files`, on a thread that may wait for the disk and for the HDF5 library.
async fn of_files(task: &Task, files: &[CasingFile]) -> Result<Vec<RecordBatch>> {
    let permit = workers().1.acquire().await.map_err(|error| DataFusionError::External(Box::new(error)))?;
    let first = files.first().map(|file| file.path.clone()).unwrap_or_default();
    let (task, files) = (task.clone(), files.to_vec());
    let work = move || {
        let _permit = permit;
        task.run(&files)
    };
    match tokio::task::spawn_blocking(work).await {
        Ok(rows) => rows.map_err(|error| DataFusionError::Execution(format!("{error:#}"))),
        Err(error) => Err(DataFusionError::Execution(format!("work on {first} did not end: {error}"))),
    }
}
