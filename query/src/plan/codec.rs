//! Our table and our node as bytes between client, scheduler and executors; everything else is Ballista's.

use std::sync::Arc;

use ballista_core::serde::{BallistaLogicalExtensionCodec, BallistaPhysicalExtensionCodec};
use datafusion::arrow::datatypes::SchemaRef;
use datafusion::catalog::TableProvider;
use datafusion::common::{DataFusionError, Result, TableReference, plan_err};
use datafusion::datasource::file_format::FileFormatFactory;
use datafusion::execution::TaskContext;
use datafusion::logical_expr::{Extension, LogicalPlan};
use datafusion::physical_plan::ExecutionPlan;
use datafusion_proto::logical_plan::LogicalExtensionCodec;
use datafusion_proto::physical_plan::{PhysicalExtensionCodec, PhysicalProtoConverterExtension};

use crate::plan::{FilesExec, FilesTable};
use crate::task::payload::Payload;

fn refused(error: anyhow::Error) -> DataFusionError {
    DataFusionError::Plan(format!("{error:#}"))
}

/// Tables over casing files, in plans that a client sends.
#[derive(Debug, Default)]
pub(crate) struct LogicalCodec {
    ballista: BallistaLogicalExtensionCodec,
}

impl LogicalExtensionCodec for LogicalCodec {
    fn try_decode(&self, buf: &[u8], inputs: &[LogicalPlan], ctx: &TaskContext) -> Result<Extension> {
        self.ballista.try_decode(buf, inputs, ctx)
    }

    fn try_encode(&self, node: &Extension, buf: &mut Vec<u8>) -> Result<()> {
        self.ballista.try_encode(node, buf)
    }

    fn try_decode_table_provider(
        &self,
        buf: &[u8],
        table_ref: &TableReference,
        schema: SchemaRef,
        ctx: &TaskContext,
    ) -> Result<Arc<dyn TableProvider>> {
        match Payload::decode(buf).map_err(refused)? {
            Some(payload) => Ok(Arc::new(FilesTable::new(payload.task, payload.partitions))),
            None => self.ballista.try_decode_table_provider(buf, table_ref, schema, ctx),
        }
    }

    fn try_encode_table_provider(
        &self,
        table_ref: &TableReference,
        node: Arc<dyn TableProvider>,
        buf: &mut Vec<u8>,
    ) -> Result<()> {
        let any: &dyn std::any::Any = node.as_ref();
        match any.downcast_ref::<FilesTable>() {
            Some(table) => Payload::of_table(&table.task, &table.partitions).encode(buf).map_err(refused),
            None => self.ballista.try_encode_table_provider(table_ref, node, buf),
        }
    }

    // COPY TO needs both.
    fn try_decode_file_format(&self, buf: &[u8], ctx: &TaskContext) -> Result<Arc<dyn FileFormatFactory>> {
        self.ballista.try_decode_file_format(buf, ctx)
    }

    fn try_encode_file_format(&self, buf: &mut Vec<u8>, node: Arc<dyn FileFormatFactory>) -> Result<()> {
        self.ballista.try_encode_file_format(buf, node)
    }
}

/// Our node, in the plans that executors get.
#[derive(Debug, Default)]
pub(crate) struct PhysicalCodec {
    ballista: BallistaPhysicalExtensionCodec,
}

impl PhysicalExtensionCodec for PhysicalCodec {
    fn try_decode(
        &self,
        buf: &[u8],
        inputs: &[Arc<dyn ExecutionPlan>],
        ctx: &TaskContext,
        proto_converter: &dyn PhysicalProtoConverterExtension,
    ) -> Result<Arc<dyn ExecutionPlan>> {
        let Some(payload) = Payload::decode(buf).map_err(refused)? else {
            return self.ballista.try_decode(buf, inputs, ctx, proto_converter);
        };
        match inputs {
            [input] => Ok(Arc::new(FilesExec::new(payload.task, payload.projection, Arc::clone(input))?)),
            _ => plan_err!("a task over files has {} inputs, not the one that names them", inputs.len()),
        }
    }

    fn try_encode(
        &self,
        node: Arc<dyn ExecutionPlan>,
        buf: &mut Vec<u8>,
        proto_converter: &dyn PhysicalProtoConverterExtension,
    ) -> Result<()> {
        let any: &dyn std::any::Any = node.as_ref();
        match any.downcast_ref::<FilesExec>() {
            Some(exec) => {
                let payload = Payload { projection: exec.projection.clone(), ..Payload::of_table(&exec.task, &[]) };
                payload.encode(buf).map_err(refused)
            }
            None => self.ballista.try_encode(node, buf, proto_converter),
        }
    }
}

#[cfg(test)]
mod tests {
    use datafusion::prelude::SessionContext;
    use tapline_export::Export;

    use super::*;
    use crate::places::CasingFile;
    use crate::task::Task;

    fn table() -> Arc<FilesTable> {
        let file = |k: usize| CasingFile::new(format!("{k}.h5"), format!("/{k}.h5"));
        Arc::new(FilesTable::new(
            Task::Read(Export::Damage),
            vec![vec![file(0), file(1)], vec![file(2)], vec![file(3)]],
        ))
    }

    #[test]
    fn a_table_comes_back_with_its_files_and_partitions() {
        let (codec, mut bytes) = (LogicalCodec::default(), Vec::new());
        let name = TableReference::bare("damage");
        codec.try_encode_table_provider(&name, table(), &mut bytes).unwrap();
        let context = SessionContext::new().task_ctx();
        let back = codec.try_decode_table_provider(&bytes, &name, table().schema(), &context).unwrap();
        let any: &dyn std::any::Any = back.as_ref();
        assert_eq!(any.downcast_ref::<FilesTable>(), Some(table().as_ref()));
        bytes[8] = 9;
        let refusal = codec.try_decode_table_provider(&bytes, &name, table().schema(), &context).unwrap_err();
        assert!(refusal.to_string().contains("has version 9"), "{refusal}");
    }

    /// Catches a leaf of our own, with which every task would do all files, and a node cut or shuffled differently.
    #[tokio::test]
    async fn the_leaf_is_a_standard_one_with_a_partition_for_each_batch_of_files() {
        let state = SessionContext::new().state();
        let plan = table().scan(&state, Some(&vec![0, 3]), &[], None).await.unwrap();
        let leaf = Arc::clone(plan.children()[0]);
        assert_eq!((leaf.name(), leaf.children().len()), ("DataSourceExec", 0));
        assert_eq!(plan.properties().partitioning.partition_count(), 3);
        assert_eq!(plan.schema().fields().len(), 2);
    }
}
