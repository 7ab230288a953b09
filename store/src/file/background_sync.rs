//! Syncs written data to the disk while the writers continue, in one thread for all writers of the process.
//!
//! The system itself would begin much later, and the sync at the end of a casing would then take long.

use std::fs::File;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::Builder;

/// Bytes after which the thread is asked to sync: enough to keep a disk busy, and few enough that the last sync is short. A
/// slow disk is not asked again before it has answered.
const EVERY_BYTES: usize = 2 << 20;

/// Requests that may wait for the thread.
const JOBS_MAX: usize = 1024;

/// Requests to the thread, for the file of one writer.
#[derive(Debug)]
pub(crate) struct BackgroundSync {
    file: Arc<File>,
    sync_errors: SyncErrors,
    /// Whether a request waits: it covers what is written before the thread begins with it.
    is_asked: Arc<AtomicBool>,
    unasked_bytes: usize,
}

/// The last error of a background sync. The system reports such an error once, so the sync at the end would succeed in spite
/// of it.
#[derive(Debug, Clone, Default)]
pub(crate) struct SyncErrors(Arc<Mutex<Option<io::Error>>>);

impl SyncErrors {
    /// The last error, if there was one.
    pub(crate) fn last(&self) -> io::Result<()> {
        let last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        last.as_ref().map_or(Ok(()), |error| Err(copy_of(error)))
    }

    /// Keeps `error` as the last.
    pub(crate) fn note(&self, error: &io::Error) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(copy_of(error));
    }
}

/// A copy of an error that keeps its number, by which callers classify it.
fn copy_of(error: &io::Error) -> io::Error {
    error.raw_os_error().map_or_else(|| io::Error::new(error.kind(), error.to_string()), io::Error::from_raw_os_error)
}

/// A request.
struct Job {
    file: Arc<File>,
    sync_errors: SyncErrors,
    is_asked: Arc<AtomicBool>,
}

impl BackgroundSync {
    /// For `file`; errors go to `sync_errors`.
    pub(crate) fn new(file: Arc<File>, sync_errors: &SyncErrors) -> Self {
        Self { file, sync_errors: sync_errors.clone(), is_asked: Arc::default(), unasked_bytes: 0 }
    }

    /// Counts `bytes` that were written, and requests a sync when there are enough.
    pub(crate) fn note(&mut self, bytes: usize) {
        self.unasked_bytes += bytes;
        if self.unasked_bytes < EVERY_BYTES {
            return;
        }
        self.unasked_bytes = 0;
        if !self.is_asked.swap(true, Ordering::AcqRel) {
            let Self { file, sync_errors, is_asked, .. } = self;
            let job = Job { file: file.clone(), sync_errors: sync_errors.clone(), is_asked: is_asked.clone() };
            // Without a thread, or when its queue is full, everything is synced at the end.
            let is_taken = thread().as_ref().is_some_and(|thread| thread.try_send(job).is_ok());
            self.is_asked.fetch_and(is_taken, Ordering::AcqRel);
        }
    }
}

/// The thread; `None` if it cannot be started.
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
            tracing::error!(%error, "the disk failed to store written data: check the archive when the run is over");
            sync_errors.note(&error);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// Catches a sync that is not requested when enough is written, and an error of the thread that is lost.
    #[test]
    fn an_error_of_the_thread_is_kept() {
        // A device that cannot be synced.
        let (file, sync_errors) = (Arc::new(File::open("/dev/full").unwrap()), SyncErrors::default());
        let mut background = BackgroundSync::new(file, &sync_errors);
        background.note(EVERY_BYTES - 1);
        assert!(!background.is_asked.load(Ordering::Acquire));
        background.note(1);
        let is_noted = (0..1000).any(|_| {
            std::thread::sleep(Duration::from_millis(5));
            sync_errors.last().is_err()
        });
        assert!(is_noted);
    }
}
