//! Standard error, for messages and the log. A line must go on although nobody reads it: after [`never_wait`] a thread
//! writes it, and what does not fit into its queue is dropped and counted.

use std::cell::Cell;
use std::io::{self, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::thread::{Builder, sleep};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, Sender, bounded};

/// Most messages that wait to be written.
const QUEUED_MAX: usize = 4096;

/// How long the last messages are waited for.
const FLUSHED_WITHIN: Duration = Duration::from_secs(1);

static QUEUE: OnceLock<Sender<Vec<u8>>> = OnceLock::new();

/// Messages that are queued or just written.
static UNWRITTEN: AtomicUsize = AtomicUsize::new(0);

/// Messages that did not fit into the queue.
static DROPPED: AtomicU64 = AtomicU64::new(0);

thread_local! {
    /// Whether this is the thread that writes.
    static WRITES: Cell<bool> = const { Cell::new(false) };
}

/// Standard error. Each `write` is one message.
#[derive(Debug, Clone, Copy)]
pub struct Stderr;

impl Write for Stderr {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Some(queue) = QUEUE.get().filter(|_| !WRITES.get()) else { return io::stderr().write(bytes) };
        UNWRITTEN.fetch_add(1, Ordering::AcqRel);
        if queue.try_send(bytes.to_vec()).is_err() {
            UNWRITTEN.fetch_sub(1, Ordering::AcqRel);
            DROPPED.fetch_add(1, Ordering::AcqRel);
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// From now on nothing in this process waits until standard error is read.
///
/// # Errors
/// What the system returns when it starts no thread.
pub fn never_wait() -> io::Result<()> {
    let (queue, messages) = bounded(QUEUED_MAX);
    Builder::new().name("log".to_owned()).spawn(move || write_all(&messages))?;
    QUEUE.get_or_init(|| queue);
    Ok(())
}

fn write_all(messages: &Receiver<Vec<u8>>) {
    WRITES.set(true);
    for message in messages {
        // If standard error is closed or full, nothing can be done about it.
        drop(io::stderr().write_all(&message));
        // What was dropped came after what is queued.
        let dropped = if messages.is_empty() { DROPPED.swap(0, Ordering::AcqRel) } else { 0 };
        if dropped > 0 {
            tracing::error!("nobody read the log; messages that were dropped: {dropped}");
        }
        UNWRITTEN.fetch_sub(1, Ordering::AcqRel);
    }
}

/// Waits until all messages are written, if somebody reads them.
pub fn flush() {
    let begun_at = Instant::now();
    while UNWRITTEN.load(Ordering::Acquire) > 0 && begun_at.elapsed() < FLUSHED_WITHIN {
        sleep(Duration::from_millis(1));
    }
}
