//! A real NATS server, which can be killed.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use tapline_testing::network::at;

use crate::sandbox::Sandbox;
use crate::sandbox::broker::free_port;
use crate::sandbox::running::{KilledOnDrop, until};

/// A server of NATS with JetStream, whose store is in the folder `nats`.
pub(crate) struct NatsServer {
    child: Option<KilledOnDrop>,
    program: PathBuf,
    config: PathBuf,
    store: PathBuf,
    log: PathBuf,
    /// In which network namespace; the test's own, if `None`.
    host: Option<String>,
    /// Where it listens.
    pub address: String,
}

/// The server beside the Python of the tests, or one of the system; `None`, and a skip, where there is none.
fn program() -> Option<PathBuf> {
    let python = std::env::var_os("TAPLINE_PYTHON").map(PathBuf::from).unwrap_or_default();
    let found = [
        python.with_file_name("nats-server"),
        Path::new(env!("CARGO_MANIFEST_DIR")).join("target/python/bin/nats-server"),
        PathBuf::from("nats-server"),
        PathBuf::from("/usr/sbin/nats-server"),
    ];
    let can = |program: &PathBuf| Command::new(program).arg("--version").output().is_ok();
    let found = found.into_iter().find(can);
    if found.is_none() {
        tapline_testing::skip("no nats-server here (tests/python.txt has it)");
    }
    found
}

impl NatsServer {
    /// Starts it on this machine, with more lines of its configuration.
    pub(crate) fn start(sandbox: &Sandbox, more: &str) -> Option<Self> {
        Self::start_at(sandbox, &format!("127.0.0.1:{}", free_port()), None, more)
    }

    /// Starts it at `address`, of the network namespace `host`.
    pub(crate) fn start_at(sandbox: &Sandbox, address: &str, host: Option<&str>, more: &str) -> Option<Self> {
        let program = program()?;
        let store = sandbox.path("nats");
        let jetstream = format!("jetstream {{ store_dir: \"{}\" }}", store.display());
        sandbox.write("nats.conf", &format!("listen: {address}\n{jetstream}\n{more}\n"));
        let mut server = Self {
            child: None,
            program,
            config: sandbox.path("nats.conf"),
            store,
            log: sandbox.path("nats.log"),
            host: host.map(str::to_owned),
            address: address.to_owned(),
        };
        server.restart();
        Some(server)
    }

    /// Starts it again.
    pub(crate) fn restart(&mut self) {
        let mut command = match &self.host {
            Some(host) => {
                let mut command = at(host);
                command.arg(&self.program);
                command
            }
            None => Command::new(&self.program),
        };
        command.arg("-c").arg(&self.config).arg("-l").arg(&self.log).stdout(Stdio::null()).stderr(Stdio::null());
        let before = self.ready_count();
        self.child = Some(KilledOnDrop(command.spawn().unwrap()));
        until("the server is ready", || self.ready_count() > before);
    }

    fn ready_count(&self) -> usize {
        fs::read_to_string(&self.log).unwrap_or_default().matches("Server is ready").count()
    }

    /// Kills it.
    pub(crate) fn kill(&mut self) {
        self.child = None;
    }

    /// Removes all that it has kept, while it does not run.
    pub(crate) fn lose_all(&self) {
        assert!(self.child.is_none());
        fs::remove_dir_all(&self.store).unwrap();
    }
}
