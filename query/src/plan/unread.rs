//! Whether a plan that was run could read every file: each of our nodes counts those that it could not.

use std::sync::Arc;

use ballista_core::execution_plans::DistributedQueryExec;
use datafusion::common::Result;
use datafusion::physical_plan::ExecutionPlan;
use datafusion::prelude::SessionConfig;
use datafusion_proto::protobuf::LogicalPlanNode;

use crate::plan::files_exec::UNREAD;

/// Whether a file could not be read while `plan` was run, here or on the cluster that `config` belongs to.
///
/// # Errors
/// The scheduler of the cluster does not say.
pub(crate) async fn has_unread(plan: &Arc<dyn ExecutionPlan>, config: &SessionConfig) -> Result<bool> {
    let mut to_do = vec![plan];
    while let Some(node) = to_do.pop() {
        if node.metrics().and_then(|all| all.sum_by_name(UNREAD)).is_some_and(|count| count.as_usize() > 0) {
            return Ok(true);
        }
        // The nodes of a cluster's plan are with its scheduler, which returns them as text.
        if let Some(remote) = node.downcast_ref::<DistributedQueryExec<LogicalPlanNode>>()
            && remote.job_id().is_some()
            && says_unread(&remote.explain_executed_plan(config, true).await?)
        {
            return Ok(true);
        }
        to_do.extend(node.children());
    }
    Ok(false)
}

/// Whether one of our nodes in the text of a plan has counted a file.
fn says_unread(plan: &str) -> bool {
    let ours = plan.lines().filter(|line| line.trim_start().starts_with("FilesExec: "));
    let metrics = ours.flat_map(|line| line.split(['[', ']', ',', ' ']));
    metrics.filter_map(|metric| metric.strip_prefix(UNREAD)?.strip_prefix('=')).any(|count| count != "0")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a count of 0 that is taken for one, and a question that has the words in it.
    #[test]
    fn only_counts_of_our_nodes_count() {
        let plan = |count: &str| {
            format!("FilterExec: tyre = unread_files=9\n  FilesExec: read damage, metrics=[unread_files={count}]\n")
        };
        assert!(says_unread(&plan("1")) && says_unread(&plan("1.20 K")) && !says_unread(&plan("0")));
    }
}
