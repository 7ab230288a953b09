//! The processes of a cluster: one scheduler, and executors, several to a host.
//!
//! The HDF5 library has one lock for a process, so an executor works on one file at a time, and a host runs one for each core.

use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context as _, Result, ensure};
use ballista_core::config::TaskSchedulingPolicy;
use ballista_core::registry::BallistaFunctionRegistry;
use ballista_executor::executor_process::{ExecutorProcessConfig, start_executor_process};
use ballista_scheduler::cluster::BallistaCluster;
use ballista_scheduler::config::SchedulerConfig;
use ballista_scheduler::scheduler_process::start_server;
use datafusion::execution::SessionStateBuilder;
use tapline_host::messages::print_line;

use crate::engine::{Engine, config};
use crate::plan::codec::{LogicalCodec, PhysicalCodec};

/// Seconds between signs of life of an executor: Ballista's own, where executors ask for work.
const HEARTBEAT_S: u64 = 5;

/// Shortest time of silence, in seconds, after which an executor may be taken for lost.
const TIMEOUT_MIN_S: u64 = HEARTBEAT_S + 1;

/// A file is one unit of work, so that an executor has one core.
const CORES: usize = 1;

/// Seconds that an executor waits for a scheduler that is not there yet.
const CONNECT_S: u16 = 30;

/// How others reach a process of a cluster.
#[derive(Debug, Clone, clap::Args)]
pub struct ListenArgs {
    /// Address to listen on. Only this host reaches the default; there is no password.
    #[arg(long, default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    pub bind: IpAddr,
    /// Name or address by which others reach this host, if it is not that of --bind.
    #[arg(long)]
    pub host: Option<String>,
}

/// Run the scheduler of a cluster.
#[derive(Debug, Clone, clap::Args)]
pub struct Scheduler {
    /// How it is reached.
    #[command(flatten)]
    pub listen: ListenArgs,
    /// Port that clients and executors connect to; 0 for any that is free.
    #[arg(long, default_value_t = 50050)]
    pub port: u16,
    /// Seconds of silence after which an executor is taken for lost, and its work is given to others.
    #[arg(long, default_value_t = 20)]
    pub executor_timeout_s: u64,
}

/// Run an executor of a cluster. It works on one file at a time: run one for each core of a host.
#[derive(Debug, Clone, clap::Args)]
pub struct Executor {
    /// The scheduler.
    #[arg(value_name = "cluster://HOST:PORT")]
    pub engine: Engine,
    /// How it is reached.
    #[command(flatten)]
    pub listen: ListenArgs,
    /// Port from which results are fetched; 0 for any that is free.
    #[arg(long, default_value_t = 0)]
    pub port: u16,
    /// Folder for temporary files; the system's when left out.
    #[arg(long)]
    pub work: Option<PathBuf>,
}

impl Scheduler {
    /// Runs until the process is ended.
    ///
    /// # Errors
    /// A port that is in use, and what Ballista returns.
    pub async fn run(self) -> Result<()> {
        let Self { listen: ListenArgs { bind, host }, port, executor_timeout_s } = self;
        ensure!(
            executor_timeout_s >= TIMEOUT_MIN_S,
            "--executor-timeout-s is {executor_timeout_s}; it must be at least {TIMEOUT_MIN_S}: executors report every {HEARTBEAT_S} s"
        );
        warn_of_others(bind);
        let address = free(bind, port)?;
        let config = SchedulerConfig {
            bind_host: in_address(bind),
            bind_port: address.port(),
            external_host: reached_by(bind, host)?,
            scheduling_policy: TaskSchedulingPolicy::PullStaged,
            executor_timeout_seconds: executor_timeout_s,
            expire_dead_executor_interval_seconds: executor_timeout_s.div_ceil(5).min(5),
            no_executors_grace_period_seconds: executor_timeout_s,
            override_config_producer: Some(Arc::new(config)),
            override_logical_codec: Some(Arc::new(LogicalCodec::default())),
            override_physical_codec: Some(Arc::new(PhysicalCodec::default())),
            ..SchedulerConfig::default()
        };
        let cluster = BallistaCluster::new_from_config(&config).await.context("cannot keep the state of a cluster")?;
        print_line(&format!("tapline-query: scheduler at cluster://{address}"));
        start_server(cluster, address, Arc::new(config))
            .await
            .with_context(|| format!("the scheduler at {address} failed"))
    }
}

impl Executor {
    /// Runs until the process is ended.
    ///
    /// # Errors
    /// A scheduler that is not there after half a minute, a port that is in use, and what Ballista returns.
    pub async fn run(self) -> Result<()> {
        let Self { engine, listen: ListenArgs { bind, host }, port, work } = self;
        let Engine::Cluster { host: scheduler_host, port: scheduler_port } = engine.clone() else {
            anyhow::bail!("an executor works for a cluster: give cluster://HOST:PORT");
        };
        warn_of_others(bind);
        crate::plan::limit_workers(CORES);
        let mut folder = tempfile::Builder::new();
        let folder = folder.prefix("tapline-query-");
        let folder = match &work {
            Some(work) => {
                folder.tempdir_in(work).with_context(|| format!("cannot make a folder in {}", work.display()))?
            }
            None => folder.tempdir().context("cannot make a folder for temporary files")?,
        };
        let address = free(bind, port)?;
        let config = ExecutorProcessConfig {
            bind_host: in_address(bind),
            external_host: Some(reached_by(bind, host)?),
            port: address.port(),
            scheduler_host,
            scheduler_port,
            scheduler_connect_timeout_seconds: CONNECT_S,
            vcores: CORES,
            task_scheduling_policy: TaskSchedulingPolicy::PullStaged,
            work_dir: Some(folder.path().display().to_string()),
            executor_heartbeat_interval_seconds: HEARTBEAT_S,
            override_function_registry: Some(Arc::new(functions())),
            override_config_producer: Some(Arc::new(config)),
            override_logical_codec: Some(Arc::new(LogicalCodec::default())),
            override_physical_codec: Some(Arc::new(PhysicalCodec::default())),
            ..ExecutorProcessConfig::default()
        };
        print_line(&format!("tapline-query: executor at {address} for {engine}"));
        start_executor_process(Arc::new(config))
            .await
            .with_context(|| format!("the executor at {address} for {engine} failed"))
    }
}

/// All functions that a question on this host can use: Ballista's own choice lacks those of lists, such as `string_to_array`.
fn functions() -> BallistaFunctionRegistry {
    (&SessionStateBuilder::new().with_default_features().build()).into()
}

/// Ballista has no passwords: whoever reaches a port can run queries, and read and write files as this user.
fn warn_of_others(bind: IpAddr) {
    if !bind.is_loopback() {
        print_line(&format!(
            "tapline-query: listening on {bind}: whoever reaches this port can run queries, and read and write files as this user; keep it inside a network that you trust"
        ));
    }
}

/// The address as it is written before a port.
fn in_address(bind: IpAddr) -> String {
    match bind {
        IpAddr::V4(bind) => bind.to_string(),
        IpAddr::V6(bind) => format!("[{bind}]"),
    }
}

/// The name or address by which others reach this host.
fn reached_by(bind: IpAddr, host: Option<String>) -> Result<String> {
    ensure!(
        host.is_some() || !bind.is_unspecified(),
        "--bind {bind} means every address of this host: give with --host the one that others use"
    );
    Ok(host.unwrap_or_else(|| in_address(bind)))
}

/// That port, or any that is free.
fn free(bind: IpAddr, port: u16) -> Result<SocketAddr> {
    let address = SocketAddr::new(bind, port);
    let listener = TcpListener::bind(address).with_context(|| format!("cannot listen on {address}"))?;
    listener.local_addr().with_context(|| format!("cannot listen on {address}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches an executor whose results others look for on their own host.
    #[test]
    fn a_host_that_listens_everywhere_must_be_named() {
        let reached = |bind: &str, host: Option<&str>| reached_by(bind.parse().unwrap(), host.map(str::to_owned));
        assert_eq!(reached("10.0.0.7", None).unwrap(), "10.0.0.7");
        assert_eq!(reached("::1", None).unwrap(), "[::1]");
        assert_eq!(reached("0.0.0.0", Some("central")).unwrap(), "central");
        let refusal = reached("0.0.0.0", None).unwrap_err().to_string();
        assert!(refusal.starts_with("--bind 0.0.0.0 means every address"), "{refusal}");
    }

    #[test]
    fn a_port_in_use_is_named() {
        let first = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = first.local_addr().unwrap();
        let refusal = free(address.ip(), address.port()).unwrap_err().to_string();
        assert_eq!(refusal, format!("cannot listen on {address}"));
        assert_ne!(free(address.ip(), 0).unwrap().port(), 0);
    }
}
