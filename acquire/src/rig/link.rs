//! The connection to a rig: one thread connects, listens, and reconnects when the connection is lost.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use super::RigConfig;
use super::dialogue::Dialogue;
use super::protocol::{LINE_BYTES_MAX, LineReader, ReadLine};
use super::stream::Stream;
use crate::Wake;

/// How long a read lasts before the thread checks its timeouts.
const READ_TIMEOUT: Duration = Duration::from_millis(500);

/// First and longest wait before the next attempt to connect.
const BACK_OFF: (Duration, Duration) = (Duration::from_millis(100), Duration::from_secs(5));

/// The connection of one station to its rig.
pub(crate) struct Link {
    dialogue: Mutex<Dialogue>,
    is_stopped: AtomicBool,
    stopped: Condvar,
    wake: Wake,
}

impl fmt::Debug for Link {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Link").field("dialogue", &self.dialogue).finish_non_exhaustive()
    }
}

impl Link {
    /// Starts the thread; it runs until [`Link::stop`]. `wake` is called when the dialogue has changed for the station.
    pub(crate) fn start(config: RigConfig, tap_count: u64, wake: Wake) -> std::io::Result<Arc<Self>> {
        let name = format!("rig {}", config.station);
        let link = Arc::new(Self {
            dialogue: Mutex::new(Dialogue::new(config, tap_count)),
            is_stopped: AtomicBool::new(false),
            stopped: Condvar::new(),
            wake,
        });
        let of_thread = Arc::clone(&link);
        thread::Builder::new().name(name).spawn(move || of_thread.run())?;
        Ok(link)
    }

    /// Ends the thread; it may take a moment to notice.
    pub(crate) fn stop(&self) {
        let mut dialogue = self.dialogue();
        self.is_stopped.store(true, Ordering::Relaxed);
        dialogue.disconnect();
        self.stopped.notify_all();
    }

    /// The state of the dialogue, locked.
    pub(crate) fn dialogue(&self) -> MutexGuard<'_, Dialogue> {
        self.dialogue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_stopped(&self) -> bool {
        self.is_stopped.load(Ordering::Relaxed)
    }

    fn run(&self) {
        let address = self.dialogue().config().address.clone();
        let mut back_off = BACK_OFF.0;
        while !self.is_stopped() {
            match Stream::open(&address) {
                Ok(stream) => {
                    let reason = self.listen(stream);
                    let mut dialogue = self.dialogue();
                    if dialogue.has_hello() {
                        back_off = BACK_OFF.0;
                    }
                    if !self.is_stopped() {
                        dialogue.log_fault(&reason);
                    }
                    dialogue.disconnected();
                }
                Err(reason) => self.dialogue().log_fault(&reason),
            }
            (self.wake)();
            self.wait_before_retry(back_off);
            back_off = (back_off * 2).min(BACK_OFF.1);
        }
    }

    /// Waits for `time`, while the patience with an absent rig runs out.
    fn wait_before_retry(&self, mut time: Duration) {
        let mut dialogue = self.dialogue();
        while !self.is_stopped() && !time.is_zero() {
            let part = time.min(READ_TIMEOUT);
            dialogue = self.stopped.wait_timeout(dialogue, part).map_or_else(|e| e.into_inner().0, |(state, _)| state);
            time -= part;
            if dialogue.end_patience() {
                (self.wake)();
            }
        }
    }

    /// Listens to the rig until the connection ends; returns why.
    fn listen(&self, mut stream: Stream) -> String {
        match stream.split(READ_TIMEOUT) {
            Ok(writer) => {
                let mut dialogue = self.dialogue();
                if self.is_stopped() {
                    return "the station ends".to_owned();
                }
                dialogue.connected(writer);
            }
            Err(error) => return error.to_string(),
        }
        let (mut lines, mut has_noise) = (LineReader::default(), false);
        loop {
            let line = match lines.read(&mut stream) {
                Ok(line) => line,
                Err(error) => return error.to_string(),
            };
            let mut dialogue = self.dialogue();
            if !dialogue.is_connected() {
                return "the connection has failed".to_owned();
            }
            let outcome = match line {
                ReadLine::Text(line) => dialogue.receive(&line),
                ReadLine::Nothing => Ok(false),
                ReadLine::End => Err("the rig has closed the connection".to_owned()),
                ReadLine::TooLong => Err(format!("the rig has sent a line of more than {LINE_BYTES_MAX} bytes")),
                // A starting board sends arbitrary bytes; reopening its port might restart it.
                ReadLine::NotText if dialogue.is_serial() => {
                    if !std::mem::replace(&mut has_noise, true) {
                        let RigConfig { station, address, .. } = dialogue.config();
                        tracing::warn!("station {station}: {address}: lines that are not UTF-8 text are ignored");
                    }
                    Ok(false)
                }
                ReadLine::NotText => Err("the rig has sent a line that is not UTF-8 text".to_owned()),
            };
            let outcome = outcome.and_then(|has_changed| dialogue.check_timeouts().map(|()| has_changed));
            let has_ended = dialogue.end_patience();
            if outcome.is_err() || self.is_stopped() {
                dialogue.disconnect();
                return outcome.err().unwrap_or_else(|| "the station ends".to_owned());
            }
            drop(dialogue);
            if has_ended || outcome == Ok(true) {
                (self.wake)();
            }
        }
    }
}
