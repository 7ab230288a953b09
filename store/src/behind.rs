//! What a writer has handed to the system goes to the disk while the writer goes on, by a thread of its own.
//!
//! The system would begin with it much later, and whoever waits for the end would then wait for all of it.

use std::fs::File;
use std::io;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle};

/// Bytes after which the thread is asked: enough for a disk to be busy, and little beside what memory holds.
const EVERY_BYTES: usize = 8 << 20;

/// The thread that waits for the disk; it ends when this is dropped.
#[derive(Debug)]
pub(crate) struct Behind {
    /// `None` once it is to end.
    ask: Option<SyncSender<()>>,
    thread: Option<JoinHandle<()>>,
    /// Why the disk did not keep what it was given, where it did not.
    failed: Arc<Mutex<Option<io::Error>>>,
    unasked_bytes: usize,
}

impl Behind {
    /// Begins it for `file`; where no thread can be had, all is written at the end.
    pub(crate) fn start(file: File) -> Self {
        // One may wait: it covers all that was written until it is taken up.
        let (ask, asked) = sync_channel(1);
        let failed = Arc::default();
        let told = Arc::clone(&failed);
        let thread = Builder::new().name("sync".to_owned()).spawn(move || run(&file, &asked, &told)).ok();
        Self { ask: Some(ask), thread, failed, unasked_bytes: 0 }
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

    /// What went wrong until now. The system tells it once: whoever asks for all to be written at the end would not hear it.
    pub(crate) fn failure(&self) -> io::Result<()> {
        self.failed.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }
}

impl Drop for Behind {
    fn drop(&mut self) {
        drop(self.ask.take());
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

fn run(file: &File, asked: &Receiver<()>, failed: &Mutex<Option<io::Error>>) {
    while asked.recv().is_ok() {
        if let Err(error) = file.sync_data() {
            tracing::error!(%error, "the disk has not kept what was written to it: check the archive when the run is over");
            *failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
        }
    }
}
