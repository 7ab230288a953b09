//! A cluster of real processes, which end with the test.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use tapline_testing::waiting::until;

use crate::sandbox::Sandbox;

/// A process that is killed when the test ends.
pub(crate) struct Process(pub(crate) Child);

impl Process {
    pub(crate) fn start(command: &mut Command) -> Self {
        Self(command.spawn().unwrap())
    }

    pub(crate) fn id(&self) -> u32 {
        self.0.id()
    }

    /// Sends a signal, by its name.
    pub(crate) fn signal(&self, name: &str) {
        signal(self.id(), name);
    }

    /// Waits for its end, and returns its exit code.
    pub(crate) fn end(&mut self) -> Option<i32> {
        let mut code = None;
        until("a process ends", || {
            code = self.0.try_wait().unwrap();
            code.is_some()
        });
        code.unwrap().code()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // One that has ended already is no failure.
        drop(self.0.kill());
        drop(self.0.wait());
    }
}

pub(crate) fn signal(process: u32, name: &str) {
    assert!(Command::new("kill").args(["-s", name, &process.to_string()]).status().unwrap().success());
}

/// A scheduler and two executors.
pub(crate) struct Cluster {
    pub(crate) engine: String,
    pub(crate) scheduler: Process,
    bind: String,
    pub(crate) executors: Vec<Process>,
}

impl Cluster {
    /// Starts one, whose executors run the program `tapline`.
    pub(crate) fn start(sandbox: &Sandbox, tapline: &Path) -> Self {
        Self::start_at(sandbox, tapline, "127.0.0.1", 2)
    }

    /// Starts one with so many executors, all of which listen on that address.
    pub(crate) fn start_at(sandbox: &Sandbox, tapline: &Path, bind: &str, count: usize) -> Self {
        let (scheduler, engine) = scheduler(sandbox, bind, "0");
        let mut cluster = Self { engine, scheduler, bind: bind.to_owned(), executors: Vec::new() };
        for _ in 0..count {
            cluster.add_executor(sandbox, tapline);
        }
        cluster
    }

    pub(crate) fn add_executor(&mut self, sandbox: &Sandbox, tapline: &Path) {
        let mut command = sandbox.command(&["executor", &self.engine, "--bind", &self.bind]);
        command.env("TAPLINE", tapline).stderr(Stdio::null());
        self.executors.push(Process::start(&mut command));
    }

    /// Kills the scheduler and starts another one in its place.
    pub(crate) fn restart_scheduler(&mut self, sandbox: &Sandbox) {
        self.scheduler.signal("KILL");
        self.scheduler.end();
        let port = self.engine.rsplit(':').next().unwrap();
        (self.scheduler, self.engine) = scheduler(sandbox, &self.bind, port);
    }
}

/// A scheduler that listens, and its address.
fn scheduler(sandbox: &Sandbox, bind: &str, port: &str) -> (Process, String) {
    let mut command = sandbox.command(&["scheduler", "--bind", bind, "--port", port, "--executor-timeout-s", "6"]);
    let mut process = Process::start(command.stderr(Stdio::piped()));
    let mut lines = BufReader::new(process.0.stderr.take().unwrap()).lines();
    let engine = loop {
        let line = lines.next().expect("the scheduler says where it listens").unwrap();
        if let Some((_, engine)) = line.split_once("scheduler at ") {
            break engine.to_owned();
        }
    };
    // What else it says is read, so that it never waits.
    std::thread::Builder::new().spawn(move || lines.for_each(drop)).unwrap();
    (process, engine)
}
