//! What a writer has handed to the system goes to the disk while the writer goes on, by a thread of its own.
//!
//! The system would begin with it much later, and whoever waits for the end would then wait for all of it.

use std::fs::File;
use std::io::{self, ErrorKind};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle};

/// Bytes after which the thread is asked: enough for a disk to be busy, and so few that whoever waits for the end waits for
/// little. A disk that is slower is not asked more often than it answers.
const EVERY_BYTES: usize = 2 << 20;

/// The thread that waits for the disk; it ends when this is dropped.
#[derive(Debug)]
pub(crate) struct Behind {
    /// `None` once it is to end.
    ask: Option<SyncSender<()>>,
    thread: Option<JoinHandle<()>>,
    unasked_bytes: usize,
}

/// Why a disk did not keep what it was given, where it did not. The system tells it once: whoever asks for all to be written
/// at the end would not hear it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Failures(Arc<Mutex<Option<(ErrorKind, String)>>>);

impl Failures {
    /// The last of them.
    pub(crate) fn last(&self) -> io::Result<()> {
        let last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        last.as_ref().map_or(Ok(()), |(kind, text)| Err(io::Error::new(*kind, text.clone())))
    }

    fn note(&self, error: &io::Error) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((error.kind(), error.to_string()));
    }
}

impl Behind {
    /// Begins it for `file`; where no thread can be had, all is written at the end.
    pub(crate) fn start(file: File, failures: &Failures) -> Self {
        // One may wait: it covers all that was written until it is taken up.
        let (ask, asked) = sync_channel(1);
        let failures = failures.clone();
        let thread = Builder::new().name("sync".to_owned()).spawn(move || run(&file, &asked, &failures)).ok();
        Self { ask: Some(ask), thread, unasked_bytes: 0 }
    }

    /// Notes that `bytes` more were handed to the system.
    pub(crate) fn note(&mut self, bytes: usize) {
        self.unasked_bytes += bytes;
        if self.unasked_bytes >= EVERY_BYTES
            && let Some(ask) = &self.ask
        {
            // Where one waits already this is in it too, and a thread that is not there is asked in vain.
            match ask.try_send(()) {
                Ok(()) | Err(TrySendError::Full(()) | TrySendError::Disconnected(())) => self.unasked_bytes = 0,
            }
        }
    }

    /// Ends the thread.
    pub(crate) fn rest(&mut self) {
        drop(self.ask.take());
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

impl Drop for Behind {
    fn drop(&mut self) {
        self.rest();
    }
}

fn run(file: &File, asked: &Receiver<()>, failures: &Failures) {
    while asked.recv().is_ok() {
        if let Err(error) = file.sync_data() {
            tracing::error!(%error, "the disk has not kept what was written to it: check the archive when the run is over");
            failures.note(&error);
        }
    }
}
