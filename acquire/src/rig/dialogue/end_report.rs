//! How the last casing of a station ended: the answer to a rig that announces it again because it is still there.
//!
//! A file keeps it, so that a line that starts anew does not scan that casing a second time.

use std::fs;
use std::io::ErrorKind;
use std::path::PathBuf;

/// The last casing that was done, until it is known to be off the rig.
#[derive(Debug, Default)]
pub(super) struct LastEnd {
    path: Option<PathBuf>,
    report: Option<EndReport>,
}

#[derive(Debug)]
struct EndReport {
    serial: String,
    line: String,
    /// Whether it was sent on this connection.
    is_sent: bool,
    /// Whether the rig has received it on this connection: it has said something since. The same serial is another casing then.
    is_received: bool,
}

impl LastEnd {
    /// The end that the file at `path` has, if it is there.
    pub(super) fn read(path: Option<PathBuf>) -> Self {
        let text = path.as_ref().and_then(|path| fs::read_to_string(path).ok());
        let report = text.as_deref().and_then(|text| text.trim_end().split_once('\n'));
        let report = report.map(|(serial, line)| EndReport {
            serial: serial.to_owned(),
            line: line.to_owned(),
            is_sent: false,
            is_received: false,
        });
        Self { path, report }
    }

    /// Keeps that the casing `serial` ended, which `line` says.
    pub(super) fn set(&mut self, serial: String, line: String, is_sent: bool) {
        self.write(|path| fs::write(path, format!("{serial}\n{line}\n")));
        self.report = Some(EndReport { serial, line, is_sent, is_received: false });
    }

    /// Forgets it: the casing is not on the rig any more.
    pub(super) fn clear(&mut self) {
        if self.report.take().is_some() {
            self.write(|path| match fs::remove_file(path) {
                Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
                _ => Ok(()),
            });
        }
    }

    /// The rig has begun anew, and will say again which casing is on it.
    pub(super) fn begin_connection(&mut self) {
        if let Some(report) = &mut self.report {
            (report.is_sent, report.is_received) = (false, false);
        }
    }

    /// The rig has said something: it has received what was sent before on this connection.
    pub(super) fn heard(&mut self) {
        if let Some(report) = &mut self.report {
            report.is_received = report.is_sent;
        }
    }

    /// The answer to a rig that announces `serial`; `None` if that is another casing than the one that ended.
    pub(super) fn answer(&mut self, serial: &str) -> Option<String> {
        let report = self.report.as_mut().filter(|report| report.serial == serial && !report.is_received)?;
        report.is_sent = true;
        Some(report.line.clone())
    }

    fn write(&self, act: impl FnOnce(&PathBuf) -> std::io::Result<()>) {
        if let Some(path) = &self.path
            && let Err(error) = act(path)
        {
            tracing::warn!(
                "{} cannot be written: {error}; a line that starts anew may scan a casing again",
                path.display()
            );
        }
    }
}
