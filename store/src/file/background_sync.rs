//! What writers have handed to the system goes to the disk while they go on, by one thread for all writers of the process.
//!
//! The system would begin with it much later, and whoever waits for the end would then wait for all of it.

use std::fs::File;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::Builder;

/// Bytes after which the thread is asked: enough for a disk to be busy, and so few that whoever waits for the end waits for
/// little. A disk that is slower is not asked more often than it answers.
const EVERY_BYTES: usize = 2 << 20;

/// Writers that may wait for the thread.
const JOBS_MAX: usize = 1024;

/// What the thread does for one writer.
#[derive(Debug)]
pub(crate) struct BackgroundSync {
    file: Arc<File>,
    sync_errors: SyncErrors,
    /// Whether the thread has been asked and has not begun: it then takes along what is written until it does.
    is_asked: Arc<AtomicBool>,
    unasked_bytes: usize,
}

/// Why a disk did not keep what it was given, where it did not. The system tells it once: whoever asks for all to be written
/// at the end would not hear it.
#[derive(Debug, Clone, Default)]
pub(crate) struct SyncErrors(Arc<Mutex<Option<io::Error>>>);

impl SyncErrors {
    /// The last of them.
    pub(crate) fn last(&self) -> io::Result<()> {
        let last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        last.as_ref().map_or(Ok(()), |error| Err(copy_of(error)))
    }

    fn note(&self, error: &io::Error) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(copy_of(error));
    }
}

/// The same error: by its number, from which it is told what failed.
fn copy_of(error: &io::Error) -> io::Error {
    error.raw_os_error().map_or_else(|| io::Error::new(error.kind(), error.to_string()), io::Error::from_raw_os_error)
}

/// What the thread is asked to do.
struct Job {
    file: Arc<File>,
    sync_errors: SyncErrors,
    is_asked: Arc<AtomicBool>,
}

impl BackgroundSync {
    /// That for `file`.
    pub(crate) fn new(file: Arc<File>, sync_errors: &SyncErrors) -> Self {
        Self { file, sync_errors: sync_errors.clone(), is_asked: Arc::default(), unasked_bytes: 0 }
    }

    /// Notes that `bytes` more were handed to the system.
    pub(crate) fn note(&mut self, bytes: usize) {
        self.unasked_bytes += bytes;
        if self.unasked_bytes < EVERY_BYTES {
            return;
        }
        self.unasked_bytes = 0;
        if !self.is_asked.swap(true, Ordering::AcqRel) {
            let Self { file, sync_errors, is_asked, .. } = self;
            let job = Job { file: file.clone(), sync_errors: sync_errors.clone(), is_asked: is_asked.clone() };
            // Where no thread can be had, or it has more to do than it can, all is written at the end.
            let is_taken = thread().as_ref().is_some_and(|thread| thread.try_send(job).is_ok());
            self.is_asked.fetch_and(is_taken, Ordering::AcqRel);
        }
    }
}

/// The thread; `None` where none can be had.
fn thread() -> &'static Option<SyncSender<Job>> {
    static THREAD: OnceLock<Option<SyncSender<Job>>> = OnceLock::new();
    THREAD.get_or_init(|| {
        let (ask, asked) = sync_channel(JOBS_MAX);
        Builder::new().name("sync".to_owned()).spawn(move || run(&asked)).ok().map(|_| ask)
    })
}

fn run(asked: &Receiver<Job>) {
    while let Ok(Job { file, sync_errors, is_asked }) = asked.recv() {
        is_asked.store(false, Ordering::Release);
        if let Err(error) = file.sync_data() {
            tracing::error!(%error, "the disk has not kept what was written to it: check the archive when the run is over");
            sync_errors.note(&error);
        }
    }
}
