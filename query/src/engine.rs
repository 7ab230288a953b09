//! Where plans run: in this process, or on a cluster of Ballista. The plans and the kernels are the same.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use anyhow::{Context as _, Result, bail, ensure};
use ballista::prelude::{SessionConfigExt as _, SessionContextExt as _};
use datafusion::execution::SessionStateBuilder;
use datafusion::prelude::{SessionConfig, SessionContext};

use crate::places::Place;
use crate::plan::codec::{LogicalCodec, PhysicalCodec};

/// Most partitions between the stages of a plan.
const SHUFFLE_PARTITIONS: usize = 4;

/// Files per task, unless another number is given.
const FILES_PER_TASK: usize = 8;

/// Tasks of a job per core of this host: few, because each learns the reference, and more than one, because they differ in length.
const TASKS_PER_CORE: usize = 2;

/// Most archives of a task of a job, so that its command line is not too long.
const ARCHIVES_MAX: usize = 256;

/// Where plans run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Engine {
    /// In this process, on all its cores.
    Local,
    /// On the cluster whose scheduler is there.
    Cluster {
        /// Name or address of the scheduler's host.
        host: String,
        /// The scheduler's port.
        port: u16,
    },
}

/// Which archives are worked on, and where.
#[derive(Debug, Clone, clap::Args)]
pub struct ArchiveArgs {
    /// Folders of archives; every finished one in them and in their subfolders is taken.
    #[arg(required = true, value_name = "DIR|s3://BUCKET/DIR")]
    pub places: Vec<Place>,
    /// Where the work is done: local, or cluster://HOST:PORT.
    #[arg(long, default_value = "local")]
    pub engine: Engine,
    /// Files per task; if left out, 8, but more for `reprocess` on this host. A cluster needs about 50 ms more for each task.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    pub files_per_task: Option<u16>,
}

impl ArchiveArgs {
    /// Files per task of a question.
    pub(crate) fn files_per_task(&self) -> usize {
        self.files_per_task.map_or(FILES_PER_TASK, usize::from)
    }

    /// Files per task of a job over `count` archives.
    pub(crate) fn files_per_job_task(&self, count: usize) -> usize {
        match (self.files_per_task, &self.engine) {
            (None, Engine::Local) => {
                let cores = std::thread::available_parallelism().map_or(1, usize::from);
                count.div_ceil(TASKS_PER_CORE * cores).clamp(1, ARCHIVES_MAX)
            }
            _ => self.files_per_task(),
        }
    }
}

impl FromStr for Engine {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        if text == "local" {
            return Ok(Self::Local);
        }
        let Some(address) = text.strip_prefix("cluster://") else {
            bail!("{text:?} is not an engine: give local or cluster://HOST:PORT");
        };
        let (host, port) =
            address.rsplit_once(':').with_context(|| format!("{text:?} has no port: cluster://HOST:PORT"))?;
        let port = port.parse().with_context(|| format!("the port of {text:?} is not a number from 1 to 65535"))?;
        ensure!(!host.is_empty() && port > 0, "{text:?} has no host or port 0: cluster://HOST:PORT");
        Ok(Self::Cluster { host: host.to_owned(), port })
    }
}

impl fmt::Display for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Local => write!(f, "local"),
            Self::Cluster { host, port } => write!(f, "cluster://{host}:{port}"),
        }
    }
}

impl Engine {
    /// A context whose plans run there, in which the path of a file between quotes is a table. Register tables and functions after this: connecting replaces earlier ones.
    ///
    /// # Errors
    /// An address that cannot be one.
    pub async fn connect(&self) -> Result<SessionContext> {
        let state = SessionStateBuilder::new().with_default_features().with_config(config()).build();
        match self {
            Self::Local => Ok(SessionContext::new_with_state(state).enable_url_table()),
            Self::Cluster { host, port } => SessionContext::remote_with_state(&format!("df://{host}:{port}"), state)
                .await
                .map(SessionContext::enable_url_table)
                .with_context(|| format!("cannot use {self}")),
        }
    }

    /// Says at which engine something failed.
    pub(crate) fn at(&self) -> String {
        match self {
            Self::Local => "the query failed".to_owned(),
            Self::Cluster { .. } => format!("the query failed on {self}"),
        }
    }
}

/// The same options on every engine, with the codecs of our table and node.
pub(crate) fn config() -> SessionConfig {
    SessionConfig::new_with_ballista()
        .with_target_partitions(SHUFFLE_PARTITIONS)
        .with_ballista_logical_extension_codec(Arc::new(LogicalCodec::default()))
        .with_ballista_physical_extension_codec(Arc::new(PhysicalCodec::default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn engines_are_read_and_others_refused() {
        let parsed = |text: &str| text.parse::<Engine>();
        assert_eq!(parsed("local").unwrap(), Engine::Local);
        let cluster = Engine::Cluster { host: "central".to_owned(), port: 50050 };
        assert_eq!(parsed("cluster://central:50050").unwrap(), cluster);
        assert_eq!(cluster.to_string(), "cluster://central:50050");
        for (text, why) in [
            ("ray", "\"ray\" is not an engine: give local or cluster://HOST:PORT"),
            ("cluster://central", "\"cluster://central\" has no port: cluster://HOST:PORT"),
            ("cluster://central:70000", "the port of \"cluster://central:70000\" is not a number from 1 to 65535"),
            ("cluster://:1", "\"cluster://:1\" has no host or port 0: cluster://HOST:PORT"),
        ] {
            assert_eq!(parsed(text).unwrap_err().to_string(), why);
        }
    }
}
