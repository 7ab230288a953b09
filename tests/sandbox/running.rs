//! A running program, with its output and its log.

use std::io::{BufRead as _, BufReader, Read};
use std::process::Child;
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, RecvTimeoutError, bounded};
use rustix::process::Signal;
use serde_json::Value;
use tapline_testing::program::Done;
pub(crate) use tapline_testing::waiting::{PATIENCE, until};

use crate::sandbox::Sandbox;
use crate::sandbox::stages::signal;

/// A running line or rig.
pub(crate) struct Running {
    /// `None` once its end has been waited for.
    child: Option<Child>,
    printed: Receiver<String>,
    log: Receiver<String>,
    /// The log so far.
    log_text: String,
}

impl Drop for Running {
    /// A failed test leaves no line running, and prints its log.
    fn drop(&mut self) {
        if let Some(mut child) = self.child.take() {
            child.kill().unwrap();
            child.wait().unwrap();
            eprintln!("{}", self.log_so_far());
        }
    }
}

/// A process that is killed when it is dropped.
pub(crate) struct KilledOnDrop(pub Child);

impl Drop for KilledOnDrop {
    fn drop(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

impl Running {
    pub(crate) fn start(sandbox: &Sandbox, arguments: &str) -> Self {
        Self::of(sandbox.start(arguments))
    }

    /// Follows `child`, whose output and log are pipes.
    pub(crate) fn of(mut child: Child) -> Self {
        let printed = lines_of(child.stdout.take().unwrap());
        let log = lines_of(child.stderr.take().unwrap());
        Self { child: Some(child), printed, log, log_text: String::new() }
    }

    pub(crate) fn child(&self) -> &Child {
        self.child.as_ref().unwrap()
    }

    pub(crate) fn assert_runs(&mut self) {
        let ended = self.child.as_mut().unwrap().try_wait().unwrap();
        assert_eq!(ended, None, "it has ended: {}", self.log_so_far());
    }

    fn log_so_far(&mut self) -> &str {
        for line in self.log.try_iter() {
            self.log_text.push_str(&line);
            self.log_text.push('\n');
        }
        &self.log_text
    }

    /// Waits for the next line of output.
    pub(crate) fn line(&mut self) -> String {
        match self.printed.recv_timeout(PATIENCE) {
            Ok(line) => line,
            Err(error) => panic!("it prints nothing ({error}), but logs: {}", self.log_so_far()),
        }
    }

    /// Waits for the next line of output, at most for `patience`.
    pub(crate) fn line_within(&self, patience: Duration) -> Option<String> {
        self.printed.recv_timeout(patience).ok()
    }

    /// The lines of output that were not read yet.
    pub(crate) fn lines_so_far(&self) -> Vec<String> {
        self.printed.try_iter().collect()
    }

    /// Waits for the verdict on a casing.
    pub(crate) fn verdict(&mut self) -> Value {
        let verdict: Value = serde_json::from_str(&self.line()).unwrap();
        assert_eq!(verdict["kind"], "verdict", "{verdict}");
        verdict
    }

    /// Waits for `count` verdicts.
    pub(crate) fn verdicts(&mut self, count: usize) -> Vec<Value> {
        (0..count).map(|_| self.verdict()).collect()
    }

    /// Waits until a line of the log has all of `words`.
    pub(crate) fn wait_for_log(&mut self, words: &[&str]) {
        drop(self.log_line(words));
    }

    /// Waits for the line of the log that has all of `words`.
    pub(crate) fn log_line(&mut self, words: &[&str]) -> String {
        let since = Instant::now();
        loop {
            let Ok(line) = self.log.recv_timeout(PATIENCE.saturating_sub(since.elapsed())) else {
                panic!("{words:?} was never logged, but:\n{}", self.log_text)
            };
            self.log_text.push_str(&line);
            self.log_text.push('\n');
            if words.iter().all(|word| line.contains(word)) {
                eprintln!("{words:?} was logged after {:.2} s", since.elapsed().as_secs_f64());
                return line;
            }
        }
    }

    pub(crate) fn signal(&self, which: Signal) {
        signal(i32::try_from(self.child().id()).unwrap(), which);
    }

    /// Kills it; returns the output that was not read yet.
    pub(crate) fn kill(self) -> Vec<String> {
        self.signal(Signal::KILL);
        self.printed.iter().collect()
    }

    /// Waits for the end; returns the whole log, and the output that was not read yet.
    pub(crate) fn finish(mut self) -> Done {
        let (mut out, since) = (String::new(), Instant::now());
        loop {
            match self.printed.recv_timeout(PATIENCE.saturating_sub(since.elapsed())) {
                Ok(line) => out = format!("{out}{line}\n"),
                Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => panic!("it does not end; it logs:\n{}", self.log_so_far()),
            }
        }
        let status = self.child.take().unwrap().wait().unwrap();
        let log = self.log.iter().fold(std::mem::take(&mut self.log_text), |log, line| format!("{log}{line}\n"));
        assert!(!log.contains("panicked"), "{log}");
        Done { code: status.code(), out, err: log }
    }

    /// Ends it by Ctrl-C.
    pub(crate) fn interrupt(self) -> Done {
        self.signal(Signal::INT);
        self.finish()
    }
}

/// The lines of a pipe.
pub(crate) fn lines_of(pipe: impl Read + Send + 'static) -> Receiver<String> {
    let (send, lines) = bounded(10_000);
    let read = move || BufReader::new(pipe).lines().map_while(Result::ok).try_for_each(|line| send.send(line));
    std::thread::Builder::new().name("pipe".to_owned()).spawn(read).unwrap();
    lines
}
