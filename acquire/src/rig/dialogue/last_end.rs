//! How the last casing of a station ended: the answer to a rig that announces it again because it is still there.

use std::fs;
use std::path::Path;

/// The last casing that was done, until it is known to be off the rig.
#[derive(Debug, Default)]
pub(super) struct LastEnd(Option<EndReport>);

#[derive(Debug)]
struct EndReport {
    serial: String,
    line: String,
    /// Whether it was sent on this connection.
    is_sent: bool,
    /// Whether the rig has received it on this connection: it has said something since. From then on the same serial is a new casing.
    is_received: bool,
}

impl LastEnd {
    /// The casing whose serial the file at `path` has, if it is there: a line before this one has finished it.
    pub(super) fn read(path: Option<&Path>) -> Self {
        let serial = path.and_then(|path| fs::read_to_string(path).ok());
        let mut last = Self::default();
        if let Some(serial) = serial.filter(|serial| !serial.is_empty() && !serial.contains(char::is_control)) {
            last.set(serial.clone(), format!("closed {serial}"), false);
        }
        last
    }

    /// Keeps that the casing `serial` ended, which `line` says.
    pub(super) fn set(&mut self, serial: String, line: String, is_sent: bool) {
        self.0 = Some(EndReport { serial, line, is_sent, is_received: false });
    }

    /// Forgets it: the casing is not on the rig any more.
    pub(super) fn clear(&mut self) {
        self.0 = None;
    }

    /// The rig has begun anew, and will say again which casing is on it.
    pub(super) fn begin_connection(&mut self) {
        if let Some(report) = &mut self.0 {
            (report.is_sent, report.is_received) = (false, false);
        }
    }

    /// The rig has said something: it has received what was sent before on this connection.
    pub(super) fn heard(&mut self) {
        if let Some(report) = &mut self.0 {
            report.is_received = report.is_sent;
        }
    }

    /// The answer to a rig that announces `serial`; `None` if that is another casing than the one that ended.
    pub(super) fn answer(&mut self, serial: &str) -> Option<String> {
        let report = self.0.as_mut().filter(|report| report.serial == serial && !report.is_received)?;
        report.is_sent = true;
        Some(report.line.clone())
    }

    /// How the casing ended that is still on the rig, as far as that has said, for people.
    pub(super) fn on_rig(&self) -> Option<String> {
        let report = self.0.as_ref().filter(|report| report.is_sent)?;
        let how = if report.line.starts_with("refused ") { "was refused" } else { "is done" };
        Some(format!("{} {how}", report.serial))
    }
}
