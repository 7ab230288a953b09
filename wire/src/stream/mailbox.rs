//! Mailboxes: what wakes a process of a line, and the answers to its handshakes.
//!
//! A process sleeps on a word in memory shared by the whole line (`futex`), and is woken only when it sleeps: notifying one
//! that is busy takes no system call. With the layer's own events, which go through a socket, a record of 8 KiB took
//! 1.2 times as long as over a Unix socket; with these it takes 0.7 times as long.
#![expect(unsafe_code, reason = "words of a file that several processes have mapped")]

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use memmap2::{MmapOptions, MmapRaw};
use rustix::fs::{FallocateFlags, FileType, Mode, OFlags, fallocate};
use rustix::io::{Errno, retry_on_intr};
use rustix::thread::futex;
use rustix::time::Timespec;

use crate::stream::cleanup::SHM;
use crate::stream::folder::check_private;
use crate::{Limits, LineAddress, LineError, Role};

/// Handshakes that are distinguished: a READY to an older one does not count for the newest.
const HANDSHAKES: u64 = 32;

/// The mailbox of one role, a file that every process of the line maps. Zeros are its state before the first notification.
///
/// If a process dies while it notifies, at worst a sleep lasts until the next notification or its end, a second.
#[derive(Debug)]
pub(crate) struct Mailbox {
    map: MmapRaw,
    path: PathBuf,
}

/// The words of a mailbox.
struct Words<'a> {
    /// Number of notifications so far; the process sleeps on it.
    count: &'a AtomicU32,
    /// Whether the process sleeps.
    is_asleep: &'a AtomicU32,
    /// How often the process has looked for work: one that stands still is held up.
    beats: &'a AtomicU32,
    /// For each role the handshakes that it has answered and whose answers were not taken, a bit each.
    answers: &'a [AtomicU32],
}

impl Mailbox {
    /// Opens the mailbox of `role` in the line at `address`, or makes it.
    pub(crate) fn open(address: &LineAddress, role: Role, limits: &Limits) -> Result<Self, LineError> {
        let path = Path::new(SHM).join(format!("{}mailbox-{}", address.prefix(), role.name()));
        let byte_count = (3 + Role::count(limits)) * size_of::<u32>();
        let map = || -> Result<MmapRaw, LineError> {
            let flags = OFlags::CREATE | OFlags::RDWR | OFlags::NOFOLLOW | OFlags::CLOEXEC;
            let io = |error: Errno| LineError::io(&path, error);
            let file = rustix::fs::open(&path, flags, Mode::RUSR | Mode::WUSR).map_err(io)?;
            check_private(&path, &rustix::fs::fstat(&file).map_err(io)?, FileType::RegularFile)?;
            // Touching a page for which there is no room would kill the process.
            retry_on_intr(|| fallocate(&file, FallocateFlags::empty(), 0, byte_count as u64)).map_err(io)?;
            let map = MmapOptions::new().len(byte_count).map_raw(&file);
            map.map_err(|source| LineError::File { path: path.clone(), source })
        };
        Ok(Self { map: map()?, path })
    }

    fn words(&self) -> Words<'_> {
        // SAFETY: the mapping begins at a page, lives as long as `self`, and is touched as atomics alone, of
        // which any bits are a value. The file is closed to other users, and no process of a line makes it shorter.
        let words = unsafe { std::slice::from_raw_parts(self.map.as_ptr().cast::<AtomicU32>(), self.map.len() / 4) };
        Words { count: &words[0], is_asleep: &words[1], beats: &words[2], answers: &words[3..] }
    }

    /// Wakes the process if it sleeps; otherwise its next sleep ends at once.
    pub(crate) fn notify(&self) {
        let Words { count, is_asleep, .. } = self.words();
        count.fetch_add(1, Ordering::SeqCst);
        // Of several that notify at once, one wakes.
        if is_asleep.swap(0, Ordering::SeqCst) != 0
            && let Err(error) = futex::wake(count, futex::Flags::empty(), 1)
        {
            tracing::error!(%error, "cannot wake {}", self.path.display());
        }
    }

    /// Number of notifications so far.
    pub(crate) fn count(&self) -> u32 {
        self.words().count.load(Ordering::SeqCst)
    }

    /// Shows that the process is not held up.
    pub(crate) fn beat(&self) {
        self.words().beats.fetch_add(1, Ordering::Relaxed);
    }

    /// How often it has shown that.
    pub(crate) fn beats(&self) -> u32 {
        self.words().beats.load(Ordering::Relaxed)
    }

    /// Sleeps until there are more notifications than `seen`, until `timeout` passes, or until the process is interrupted.
    pub(crate) fn sleep(&self, seen: u32, timeout: Duration) -> Result<(), LineError> {
        let Words { count, is_asleep, .. } = self.words();
        let timeout = Timespec { tv_sec: timeout.as_secs().cast_signed(), tv_nsec: timeout.subsec_nanos().into() };
        is_asleep.store(1, Ordering::SeqCst);
        // The system compares the number once more: a notification that comes before it sleeps ends this at once.
        let slept = futex::wait(count, futex::Flags::empty(), seen, Some(&timeout));
        is_asleep.store(0, Ordering::SeqCst);
        match slept {
            Ok(()) | Err(Errno::AGAIN | Errno::TIMEDOUT | Errno::INTR) => Ok(()),
            Err(error) => Err(LineError::io(&self.path, error)),
        }
    }

    /// Notes that the subscriber in the role `from` has answered the handshake with this number, and notifies.
    pub(crate) fn answer(&self, from: Role, handshake: u64) {
        if let Some(answers) = self.words().answers.get(from.number()) {
            answers.fetch_or(bit(handshake), Ordering::SeqCst);
            self.notify();
        }
    }

    /// Whether the role `from` has answered that handshake; each answer is returned once.
    pub(crate) fn take_answer(&self, from: Role, handshake: u64) -> bool {
        let bit = bit(handshake);
        self.words()
            .answers
            .get(from.number())
            .is_some_and(|answers| answers.fetch_and(!bit, Ordering::SeqCst) & bit != 0)
    }
}

fn bit(handshake: u64) -> u32 {
    1 << (handshake % HANDSHAKES)
}

/// Wakes the process that made it, from any thread of that process.
#[derive(Debug, Clone)]
pub struct Waker(pub(crate) Arc<Mailbox>);

impl Waker {
    /// Shows that the process is not held up while it waits for another.
    pub(crate) fn beat(&self) {
        self.0.beat();
    }

    /// Wakes the thread that waits on the line.
    pub fn wake(&self) {
        self.0.notify();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches an answer that counts for another role or handshake, that is there twice, or for which there is no room.
    #[test]
    fn an_answer_is_of_one_role_to_one_handshake() {
        let limits = Limits { acquire_count: 3, ..Limits::default() };
        let address = LineAddress::fresh().unwrap();
        let mailbox = Mailbox::open(&address, Role::Store, &limits).unwrap();
        let roles = [Role::Process, Role::Fuse, Role::Store, Role::Supervisor].into_iter();
        let roles: Vec<Role> = roles.chain((0..3).map(Role::Acquire)).collect();
        for &role in &roles {
            for number in 100..100 + HANDSHAKES {
                mailbox.answer(role, number);
                let others = roles.iter().filter(|&&other| other != role);
                assert!(others.into_iter().all(|&other| !mailbox.take_answer(other, number)));
                assert!(!mailbox.take_answer(role, number + 1));
                assert!(mailbox.take_answer(role, number) && !mailbox.take_answer(role, number), "{role:?} {number}");
            }
        }
        assert!(address.clear().unwrap());
    }

    /// Catches a notification that is lost between the look at the number and the sleep, and one that is slept through: each
    /// of many is answered before the next is given, and the sleeps are far longer than all of them take.
    #[test]
    fn no_notification_is_slept_through() {
        const COUNT: u32 = 20_000;
        const LONG: Duration = Duration::from_secs(20);
        let address = LineAddress::fresh().unwrap();
        let open = |role| Mailbox::open(&address, role, &Limits::default()).unwrap();
        let begun = std::time::Instant::now();
        let sleep = |mailbox: &Mailbox, seen: &mut u32| {
            while mailbox.count() == *seen {
                mailbox.sleep(*seen, LONG).unwrap();
                assert!(begun.elapsed() < LONG, "a sleep went on until its end");
            }
            *seen += 1;
        };
        let (here, there) = (open(Role::Process), open(Role::Store));
        here.notify();
        here.sleep(0, LONG).unwrap();
        assert!(begun.elapsed() < LONG, "a notification before the sleep is slept through");
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let (here, there, mut seen) = (open(Role::Process), open(Role::Store), 0);
                for _ in 0..COUNT {
                    sleep(&there, &mut seen);
                    here.notify();
                }
            });
            let mut seen = 1;
            for _ in 0..COUNT {
                there.notify();
                sleep(&here, &mut seen);
            }
        });
        assert!(address.clear().unwrap());
    }

    /// Catches a mailbox in a file that somebody else has made or can read, which might be no mailbox.
    #[test]
    fn what_is_not_ours_is_no_mailbox() {
        let address = LineAddress::fresh().unwrap();
        let path = Path::new(SHM).join(format!("{}mailbox-fuse", address.prefix()));
        std::os::unix::fs::symlink("/dev/null", &path).unwrap();
        let open = || Mailbox::open(&address, Role::Fuse, &Limits::default());
        assert!(open().unwrap_err().to_string().contains("mailbox-fuse"));
        std::fs::remove_file(&path).unwrap();
        std::fs::write(&path, "").unwrap();
        let mode = std::os::unix::fs::PermissionsExt::from_mode(0o644);
        std::fs::set_permissions(&path, mode).unwrap();
        assert!(open().unwrap_err().to_string().contains("open to other users"));
        std::fs::remove_file(&path).unwrap();
        assert!(address.clear().unwrap());
    }
}
