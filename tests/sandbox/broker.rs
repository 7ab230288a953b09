//! A real MQTT broker, which can be killed, and one who subscribes to it.

use std::net::{TcpListener, TcpStream};
use std::process::{Command, Stdio};

use crossbeam::channel::Receiver;
use serde_json::Value;

use crate::sandbox::Sandbox;
use crate::sandbox::running::{KilledOnDrop, PATIENCE, lines_of, until};

/// Mosquitto, at a port that nobody else has.
pub(crate) struct Broker {
    child: Option<KilledOnDrop>,
    program: &'static str,
    config: std::path::PathBuf,
    pub port: u16,
}

/// A message, as `mosquitto_sub` prints it.
#[derive(Debug, Clone)]
pub(crate) struct Heard {
    pub topic: String,
    pub is_retained: bool,
    pub payload: Value,
}

/// `mosquitto_sub`, which connects again by itself.
pub(crate) struct Subscriber {
    _child: KilledOnDrop,
    lines: Receiver<String>,
}

/// A port at which nobody listens.
pub(crate) fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

impl Broker {
    /// Starts it, with more lines of its configuration; `None`, and a skip, where there is none.
    pub(crate) fn start(sandbox: &Sandbox, more: &str) -> Option<Self> {
        let can = |program: &&str| Command::new(program).arg("-h").output().is_ok();
        let is_there = can(&"mosquitto_sub");
        let Some(program) = ["mosquitto", "/usr/sbin/mosquitto"].into_iter().find(can).filter(|_| is_there) else {
            tapline_testing::skip("no mosquitto here");
            return None;
        };
        let port = free_port();
        sandbox.write("mosquitto.conf", &format!("listener {port} 127.0.0.1\nuser root\npersistence false\n{more}\n"));
        let mut broker = Self { child: None, program, config: sandbox.path("mosquitto.conf"), port };
        broker.restart();
        Some(broker)
    }

    /// Starts it again.
    pub(crate) fn restart(&mut self) {
        let mut command = Command::new(self.program);
        command.arg("-c").arg(&self.config).stdout(Stdio::null()).stderr(Stdio::null());
        self.child = Some(KilledOnDrop(command.spawn().unwrap()));
        until("the broker listens", || TcpStream::connect(("127.0.0.1", self.port)).is_ok());
    }

    /// Kills it.
    pub(crate) fn kill(&mut self) {
        self.child = None;
    }
}

impl Subscriber {
    /// Subscribes to every topic of the broker at `port`, with more `arguments`.
    pub(crate) fn start(port: u16, arguments: &[&str]) -> Self {
        let mut command = Command::new("mosquitto_sub");
        command
            .args(["-V", "5", "-q", "1", "-t", "#", "-F", "%t|%r|%p", "-h", "127.0.0.1", "-p"])
            .arg(port.to_string());
        let mut child = command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let lines = lines_of(child.stdout.take().unwrap());
        Self { _child: KilledOnDrop(child), lines }
    }

    /// The next message.
    pub(crate) fn next(&self) -> Heard {
        let line = self.lines.recv_timeout(PATIENCE).unwrap();
        let mut parts = line.splitn(3, '|');
        let (topic, retained, payload) = (parts.next().unwrap(), parts.next().unwrap(), parts.next().unwrap());
        Heard { topic: topic.to_owned(), is_retained: retained == "1", payload: serde_json::from_str(payload).unwrap() }
    }

    /// Waits for a message that is `wanted`.
    pub(crate) fn wait_for(&self, wanted: impl Fn(&Heard) -> bool) -> Heard {
        loop {
            let heard = self.next();
            if wanted(&heard) {
                return heard;
            }
        }
    }
}
