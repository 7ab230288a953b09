//! The signals that wake a process of a line.
//!
//! A process sleeps on a word in memory that all of the line share (`futex`), and is woken only when it sleeps: to notify one
//! that is at work takes no call of the system. The layer's own events go through a socket: with them a record of 8 KiB
//! arrived after 1.2 times as long as over a Unix socket, with these after 0.7 times as long.
#![expect(unsafe_code, reason = "words of a file that several processes have mapped")]

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use memmap2::{MmapOptions, MmapRaw};
use rustix::fs::{FallocateFlags, FileType, Mode, OFlags};
use rustix::io::Errno;
use rustix::thread::futex;
use rustix::time::Timespec;

use crate::stream::cleanup::{SHM, remove};
use crate::stream::folder::check_private;
use crate::{Limits, LineAddress, LineError, Role};

/// A reason to wake up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signal {
    /// There is something to do: a record, a finished piece of work, a request to end.
    Data,
    /// A subscriber has joined that has received nothing yet.
    Joined,
    /// The subscriber in this role has answered the handshake with this number.
    Ready(Role, u64),
}

/// Handshakes that are distinguished: a READY to an older one does not count for the newest.
const HANDSHAKES: u64 = 32;

impl Signal {
    /// The signal's word among [`Words::signals`], and its bit.
    fn place(self) -> (usize, u32) {
        match self {
            Self::Data => (0, 1),
            Self::Joined => (0, 2),
            Self::Ready(role, handshake) => (1 + role.number(), 1 << (handshake % HANDSHAKES)),
        }
    }
}

/// The signals of one role, in a file that every process of the line maps. Zeros are the state before the first signal.
///
/// Whoever dies leaves at worst a signal that its successor takes for its own, and wakes up for nothing.
#[derive(Debug)]
pub(crate) struct Mailbox {
    map: MmapRaw,
    path: PathBuf,
}

/// The words of a mailbox.
struct Words<'a> {
    /// Number of signals so far; a process sleeps on it.
    turn: &'a AtomicU32,
    /// Whether the process sleeps.
    is_asleep: &'a AtomicU32,
    /// The signals that were not taken.
    signals: &'a [AtomicU32],
}

impl Mailbox {
    /// Opens the mailbox of `role` in the line at `address`, or makes it.
    pub(crate) fn open(address: &LineAddress, role: Role, limits: &Limits) -> Result<Self, LineError> {
        let path = Path::new(SHM).join(format!("{}signals-{}", address.prefix(), role.name()));
        let word_count = 3 + Role::count(limits);
        let map = || -> Result<MmapRaw, LineError> {
            let flags = OFlags::CREATE | OFlags::RDWR | OFlags::NOFOLLOW | OFlags::CLOEXEC;
            let io = |error: Errno| LineError::io(&path, error);
            let file = rustix::fs::open(&path, flags, Mode::RUSR | Mode::WUSR).map_err(io)?;
            check_private(&path, &rustix::fs::fstat(&file).map_err(io)?, FileType::RegularFile)?;
            // Touching a page for which there is no room would kill the process.
            rustix::fs::fallocate(&file, FallocateFlags::empty(), 0, (word_count * size_of::<u32>()) as u64)
                .map_err(io)?;
            let map = MmapOptions::new().len(word_count * size_of::<u32>()).map_raw(&file);
            map.map_err(|source| LineError::File { path: path.clone(), source })
        };
        let map = map()?;
        if matches!(role, Role::Viewer(_)) {
            remove(&path, |path| std::fs::remove_file(path)); // nobody notifies a viewer, and there may come many
        }
        Ok(Self { map, path })
    }

    fn words(&self) -> Words<'_> {
        // SAFETY: the mapping is a page's beginning or more, lives as long as `self`, and is touched as atomics alone, of
        // which any bits are a value. The file is closed to other users, and no process of a line makes it shorter.
        let words = unsafe { std::slice::from_raw_parts(self.map.as_ptr().cast::<AtomicU32>(), self.map.len() / 4) };
        Words { turn: &words[0], is_asleep: &words[1], signals: &words[2..] }
    }

    /// Notes `signal`, and wakes the process if it sleeps.
    pub(crate) fn notify(&self, signal: Signal) {
        let Words { turn, is_asleep, signals } = self.words();
        let (word, bit) = signal.place();
        let Some(word) = signals.get(word) else { return };
        // A signal that is still there will be seen: see `wait`.
        if word.fetch_or(bit, Ordering::SeqCst) & bit != 0 {
            return;
        }
        turn.fetch_add(1, Ordering::SeqCst);
        if is_asleep.load(Ordering::SeqCst) != 0
            && let Err(error) = futex::wake(turn, futex::Flags::empty(), 1)
        {
            tracing::error!(%error, "cannot wake {}", self.path.display());
        }
    }

    /// Whether `signal` has come since it was last taken.
    pub(crate) fn take(&self, signal: Signal) -> bool {
        let (word, bit) = signal.place();
        self.words().signals.get(word).is_some_and(|word| word.fetch_and(!bit, Ordering::SeqCst) & bit != 0)
    }

    /// Number of signals so far.
    pub(crate) fn count(&self) -> u32 {
        self.words().turn.load(Ordering::SeqCst)
    }

    /// Sleeps until there are more signals than `seen`, until `timeout` passes, or until the process is interrupted.
    pub(crate) fn sleep(&self, seen: u32, timeout: Duration) -> Result<(), LineError> {
        let Words { turn, is_asleep, .. } = self.words();
        let timeout = Timespec { tv_sec: timeout.as_secs().cast_signed(), tv_nsec: timeout.subsec_nanos().into() };
        is_asleep.store(1, Ordering::SeqCst);
        // The system compares the number once more: a signal that comes before it sleeps ends this at once.
        let slept = futex::wait(turn, futex::Flags::empty(), seen, Some(&timeout));
        is_asleep.store(0, Ordering::SeqCst);
        match slept {
            Ok(()) | Err(Errno::AGAIN | Errno::TIMEDOUT | Errno::INTR) => Ok(()),
            Err(error) => Err(LineError::io(&self.path, error)),
        }
    }
}

/// Wakes the process it was made in, from any of its threads.
#[derive(Debug, Clone)]
pub struct Waker(pub(crate) Arc<Mailbox>);

impl Waker {
    /// Wakes the thread that waits on the line.
    pub fn wake(&self) {
        self.0.notify(Signal::Data);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(limits: &Limits) -> Vec<(usize, u32)> {
        let roles = [Role::Process, Role::Fuse, Role::Store, Role::Supervisor]
            .into_iter()
            .chain((0..limits.acquire_count).map(Role::Acquire));
        let answers = roles.flat_map(|role| (0..HANDSHAKES).map(move |number| Signal::Ready(role, number)));
        [Signal::Data, Signal::Joined].into_iter().chain(answers).map(Signal::place).collect()
    }

    /// Catches two signals in one place, such as the READY of two participants, and one beyond the file.
    #[test]
    fn every_signal_has_a_place_of_its_own() {
        let limits = Limits { acquire_count: 3, ..Limits::default() };
        let mut places = places(&limits);
        let count = places.len();
        places.sort_unstable();
        places.dedup();
        assert_eq!(places.len(), count);
        let address = LineAddress::fresh().unwrap();
        let mailbox = Mailbox::open(&address, Role::Store, &limits).unwrap();
        assert!(places.iter().all(|&(word, _)| word < mailbox.words().signals.len()));
        mailbox.notify(Signal::Ready(Role::Acquire(2), 5));
        assert!(!mailbox.take(Signal::Ready(Role::Acquire(1), 5)));
        assert!(mailbox.take(Signal::Ready(Role::Acquire(2), 5 + HANDSHAKES)));
        assert!(!mailbox.take(Signal::Ready(Role::Acquire(2), 5)), "it was taken");
        assert!(address.clear().unwrap());
    }

    /// Catches a signal that is lost between the look at the signals and the sleep, and one that is slept through: each of
    /// many is answered before the next is given, and the sleeps are far longer than all of them take.
    #[test]
    fn no_signal_is_slept_through() {
        const COUNT: u32 = 20_000;
        const LONG: Duration = Duration::from_secs(20);
        let address = LineAddress::fresh().unwrap();
        let open = |role| Mailbox::open(&address, role, &Limits::default()).unwrap();
        let (here, there) = (open(Role::Process), open(Role::Store));
        let begun = std::time::Instant::now();
        let sleep = |mailbox: &Mailbox, seen| {
            mailbox.sleep(seen, LONG).unwrap();
            assert!(begun.elapsed() < LONG, "a sleep went on until its end");
        };
        let seen = here.count();
        here.notify(Signal::Data);
        sleep(&here, seen);
        assert!(here.take(Signal::Data));
        let take_one = |mailbox: &Mailbox| {
            let mut seen = mailbox.count();
            while !mailbox.take(Signal::Data) {
                sleep(mailbox, seen);
                seen = mailbox.count();
            }
        };
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let (here, there) = (open(Role::Process), open(Role::Store));
                for _ in 0..COUNT {
                    take_one(&there);
                    here.notify(Signal::Data);
                }
            });
            for _ in 0..COUNT {
                there.notify(Signal::Data);
                take_one(&here);
            }
        });
        assert!(address.clear().unwrap());
    }

    /// Catches a mailbox in a file that somebody else has made or can read, which might be no mailbox.
    #[test]
    fn what_is_not_ours_is_no_mailbox() {
        let address = LineAddress::fresh().unwrap();
        let path = Path::new(SHM).join(format!("{}signals-fuse", address.prefix()));
        std::os::unix::fs::symlink("/dev/null", &path).unwrap();
        let open = || Mailbox::open(&address, Role::Fuse, &Limits::default());
        assert!(open().unwrap_err().to_string().contains("signals-fuse"));
        std::fs::remove_file(&path).unwrap();
        std::fs::write(&path, "").unwrap();
        let mode = std::os::unix::fs::PermissionsExt::from_mode(0o644);
        std::fs::set_permissions(&path, mode).unwrap();
        assert!(open().unwrap_err().to_string().contains("open to other users"));
        std::fs::remove_file(&path).unwrap();
        assert!(address.clear().unwrap());
    }
}
