//! What a connection over a network needs: whether it leaves this machine, a user's name and password, and a bound on their number.

use std::collections::BTreeMap;
use std::fs;
use std::net::{IpAddr, SocketAddr, TcpListener};
use std::os::fd::AsFd;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rustix::net::sockopt;

/// Longest file of credentials, in bytes.
const CREDENTIALS_BYTES_MAX: u64 = 65_536;

/// Why a file of credentials is not used.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the message of a variant says what its fields are")]
pub enum CredentialsError {
    /// It cannot be read.
    #[error("cannot read the credentials in {}", path.display())]
    Unreadable { path: PathBuf, source: std::io::Error },
    /// Other users can read it.
    #[error("every user of this machine can read {path}: give it to the user or group of this program, and chmod 640 {path}", path = path.display())]
    Shared { path: PathBuf },
    /// It is too long to be credentials.
    #[error("{} has {bytes} bytes: credentials have at most {CREDENTIALS_BYTES_MAX}", path.display())]
    TooLong { path: PathBuf, bytes: u64 },
    /// It does not hold a name and a password.
    #[error("{} has {lines} lines; it must have two: user and password", path.display())]
    NotTwoLines { path: PathBuf, lines: usize },
}

/// A user's name and password.
#[derive(Clone)]
pub struct User {
    /// The name.
    pub name: String,
    /// The password.
    pub password: String,
}

impl std::fmt::Debug for User {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("User").field("name", &self.name).finish_non_exhaustive()
    }
}

impl User {
    /// Reads the file at `path`: name and password, one per line.
    ///
    /// # Errors
    /// [`CredentialsError`].
    pub fn read(path: &Path) -> Result<Self, CredentialsError> {
        Self::in_text(&read_credentials(path)?, path)
    }

    /// The same from `text`, the content of the file at `path`.
    ///
    /// # Errors
    /// [`CredentialsError::NotTwoLines`].
    pub fn in_text(text: &str, path: &Path) -> Result<Self, CredentialsError> {
        match text.lines().collect::<Vec<_>>().as_slice() {
            [name, password] if !name.is_empty() && !password.is_empty() => {
                Ok(Self { name: (*name).to_owned(), password: (*password).to_owned() })
            }
            lines => Err(CredentialsError::NotTwoLines { path: path.to_owned(), lines: lines.len() }),
        }
    }
}

/// The text of the file at `path`, which other users of the machine must not be able to read.
///
/// # Errors
/// [`CredentialsError`].
pub fn read_credentials(path: &Path) -> Result<String, CredentialsError> {
    let unreadable = |source| CredentialsError::Unreadable { path: path.to_owned(), source };
    let there = fs::metadata(path).map_err(unreadable)?;
    if there.mode() & 0o007 != 0 {
        return Err(CredentialsError::Shared { path: path.to_owned() });
    }
    if there.len() > CREDENTIALS_BYTES_MAX {
        return Err(CredentialsError::TooLong { path: path.to_owned(), bytes: there.len() });
    }
    fs::read_to_string(path).map_err(unreadable)
}

/// Listens at `address`, for an async runtime that waits for connections itself.
///
/// # Errors
/// What the system returns.
pub fn listen(address: SocketAddr) -> std::io::Result<TcpListener> {
    let listener = TcpListener::bind(address)?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

/// Has the system end the connection `stream` when its other end has not answered for so long: it was switched off, or its network is
/// down.
pub fn end_if_gone(stream: &impl AsFd, after: Duration) {
    let set = || -> std::io::Result<()> {
        sockopt::set_tcp_nodelay(stream, true)?;
        sockopt::set_socket_keepalive(stream, true)?;
        sockopt::set_tcp_keepidle(stream, after / 2)?;
        sockopt::set_tcp_keepintvl(stream, after / 4)?;
        sockopt::set_tcp_keepcnt(stream, 2)?;
        sockopt::set_tcp_user_timeout(stream, u32::try_from(after.as_millis()).unwrap_or(u32::MAX))?;
        Ok(())
    };
    if let Err(error) = set() {
        tracing::debug!(%error, "a connection cannot be set up");
    }
}

/// How many connections a server has, in all and of each machine, with bounds: a machine that takes all it gets keeps no other out.
#[derive(Debug)]
pub struct Slots {
    most: usize,
    most_of_one: usize,
    counts: Mutex<BTreeMap<IpAddr, usize>>,
}

/// The slot of a connection, until this is dropped.
#[derive(Debug)]
pub struct Slot {
    slots: Arc<Slots>,
    of: IpAddr,
}

impl Slots {
    /// Slots for `most` connections at once, `most_of_one` of them of one machine.
    pub fn new(most: usize, most_of_one: usize) -> Arc<Self> {
        Arc::new(Self { most, most_of_one, counts: Mutex::default() })
    }

    fn counts(&self) -> MutexGuard<'_, BTreeMap<IpAddr, usize>> {
        self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A slot for a connection of the machine `of`; `None` if there is none.
    pub fn take(self: &Arc<Self>, of: IpAddr) -> Option<Slot> {
        let mut counts = self.counts();
        let is_full = counts.values().sum::<usize>() >= self.most;
        if is_full || counts.get(&of).is_some_and(|&count| count >= self.most_of_one) {
            return None;
        }
        *counts.entry(of).or_default() += 1;
        Some(Slot { slots: Arc::clone(self), of })
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        let mut counts = self.slots.counts();
        if let Some(count) = counts.get_mut(&self.of) {
            *count -= 1;
        }
        counts.retain(|_, count| *count > 0);
    }
}

/// Whether `host` is this machine: a loopback address, or the one name that always means it.
pub fn is_this_machine(host: &str) -> bool {
    let address = host.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>();
    host.eq_ignore_ascii_case("localhost") || address.is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use std::iter::from_fn;
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    /// Catches a machine that takes all slots and keeps the others out, and slots that are lost when their connections end.
    #[test]
    fn one_machine_does_not_take_all_slots() {
        let slots = Slots::new(8, 6);
        let take_all = |last: u8| from_fn(|| slots.take([10, 0, 0, last].into())).collect::<Vec<Slot>>();
        let of_one = take_all(1);
        assert_eq!(of_one.len(), 6);
        let others: Vec<_> = (2..4).map(take_all).collect();
        assert_eq!(others.iter().map(Vec::len).sum::<usize>(), 2);
        drop(of_one);
        assert_eq!(take_all(1).len(), 6);
    }

    /// Catches a password that others can read, and a file without one.
    #[test]
    fn credentials_are_of_their_user_alone() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("user");
        let read = |text: &str, mode| {
            fs::write(&file, text).unwrap();
            fs::set_permissions(&file, fs::Permissions::from_mode(mode)).unwrap();
            User::read(&file)
        };
        let user = read("line\nsecret\n", 0o600).unwrap();
        assert_eq!((user.name.as_str(), user.password.as_str()), ("line", "secret"));
        assert!(!format!("{user:?}").contains("secret"));
        let long = "x".repeat(65_537);
        for (text, mode, why) in [
            ("line\nsecret\n", 0o604, "every user"),
            ("line\n", 0o600, "1 lines"),
            ("\nx\n", 0o600, "two"),
            (&long, 0o600, "65537 bytes"),
        ] {
            let said = read(text, mode).unwrap_err().to_string();
            assert!(said.contains(why) && said.contains(&file.display().to_string()), "{said}");
        }
    }
}
