//! A thread that seals, syncs and renames finished files, so that the other casings need not wait.

use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, Sender, bounded};
use tapline_wire::{CasingHeader, Waker};

use super::markers::{Closed, Marker};
use super::open_casing::OpenCasing;
use super::unreported::Unreported;
use super::{RunError, StoreRun};
use crate::error::{Error, Result};
use crate::write::Writer;

/// Maximum number of files that wait to be closed; a station has at most one.
const WAITING_MAX: usize = 64;

/// Time between two attempts to close a file on a full disk.
const TRY_EVERY: Duration = Duration::from_millis(500);

/// Time after which the attempts end and the whole stage waits for its disk; meanwhile other files wait to be closed.
const TRY_FOR: Duration = Duration::from_secs(60);

struct ToClose {
    header: CasingHeader,
    writer: Writer,
    name: String,
}

/// The thread that closes files; it ends when this is dropped.
#[derive(Debug)]
pub(super) struct Closer {
    /// `None` when the thread is to end.
    to_close: Option<Sender<Box<ToClose>>>,
    closed: Receiver<Result<Closed>>,
    thread: Option<JoinHandle<()>>,
    /// Numbers of the casings whose files are being closed.
    closing: Vec<u64>,
}

impl std::fmt::Debug for ToClose {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ToClose").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Closer {
    pub(super) fn start(waker: Waker, run: &StoreRun) -> Result<Self, RunError> {
        let run = run.clone();
        let (to_close, waiting) = bounded::<Box<ToClose>>(WAITING_MAX);
        let (done, closed) = bounded(WAITING_MAX);
        let work = move || {
            for file in waiting {
                if done.send(close(*file, &run)).is_err() {
                    return;
                }
                waker.wake();
            }
        };
        let name = "close".to_owned();
        let thread =
            Builder::new().name(name.clone()).spawn(work).map_err(|source| RunError::Thread { name, source })?;
        Ok(Self { to_close: Some(to_close), closed, thread: Some(thread), closing: Vec::new() })
    }

    pub(super) fn close(&mut self, casing: OpenCasing) {
        let header = casing.header();
        self.closing.push(casing.number);
        if let Some(to_close) = &self.to_close
            && to_close.send(Box::new(ToClose { header, writer: casing.writer, name: casing.name.clone() })).is_err()
        {
            tracing::error!(casing = casing.name, "the thread that closes files has ended");
        }
    }

    pub(super) fn take_closed(&mut self) -> Option<Result<Closed>> {
        let closed = self.closed.try_recv().ok()?;
        if let Ok(Closed { header, .. }) = &closed {
            self.closing.retain(|number| *number != header.stamp.casing);
        }
        Some(closed)
    }

    /// Whether the file of that casing is being closed.
    pub(super) fn is_closing(&self, number: u64) -> bool {
        self.closing.contains(&number)
    }

    /// Waits until every file is closed; returns the outcomes that were not taken yet.
    pub(super) fn finish(&mut self) -> Vec<Result<Closed>> {
        drop(self.to_close.take());
        let outcomes = self.closed.iter().collect();
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
        outcomes
    }
}

impl Drop for Closer {
    fn drop(&mut self) {
        self.finish();
    }
}

fn close(file: ToClose, run: &StoreRun) -> Result<Closed> {
    let ToClose { header, writer, name } = file;
    // Only this thread chooses names: two files never get the same one.
    let path = run.places.finish(&name)?;
    let open = writer.path().to_owned();
    let (finishing, since) = (writer.finish_at(&path)?, Instant::now());
    let unreported = run.notes_unreported.then(|| Unreported::new(&header, &name, &path, &run.places));
    let rename = || {
        let marker = Marker::new(&header, &path).write(&open)?;
        unreported.iter().try_for_each(|note| note.write(&run.places))?;
        finishing.complete().map(|()| marker)
    };
    loop {
        match rename() {
            Ok(marker) => return Ok(Closed { header, acquire: None, path, marker }),
            Err(error) if error.is_file_system_failure() => return Err(error),
            Err(error) if !error.is_recoverable() || since.elapsed() > TRY_FOR => return Err(error),
            Err(error) => {
                log(&error);
                std::thread::sleep(TRY_EVERY);
            }
        }
    }
}

fn log(error: &Error) {
    tracing::error!("{error}; a finished file does not have its name yet, and nothing is lost: {}", error.remedy());
}
