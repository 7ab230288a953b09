//! The folder that a line writes to: held by one line at a time, and what it says of the line that holds it.
//!
//! Beside the results it has the folder `open`, for those under way, and while a line runs the file `.line`: the lock, and
//! in it where the line is found, so that the next line finds and clears what a killed one has left, and `tapline status`
//! finds the one that runs. Only who owns the folder may use it, as its owner could put anything in the place of a result;
//! nor may everyone be able to write in it, unless it is sticky. `.line` is of its user alone; results and `open` are as
//! the user's umask has it.

use std::fs::File;
use std::io::{ErrorKind, Write as _};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use rustix::fs::{AtFlags, CWD, FileType, FlockOperation, Mode, OFlags, Stat};
use rustix::io::Errno;
use serde::{Deserialize, Serialize};
use tapline_wire::LineAddress;

use crate::host::stderr::print_line;

/// The lock of an output folder, and the address of the line that holds it.
const LOCK: &str = ".line";

/// Folder of the results under way.
const OPEN: &str = "open";

/// Longest content of the lock that is read, in bytes: it has a few short lines.
const LOCK_BYTES_MAX: u64 = 4096;

/// After how long of waiting for the stages of a line that was killed it is said what is waited for.
const TELL_AFTER: Duration = Duration::from_millis(500);

/// A process, told from a later one with the same number.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct ProcessName {
    pid: u32,
    /// When it started, in clock ticks since the system did.
    started: u64,
    /// Which life of the system that was in.
    boot: String,
}

impl ProcessName {
    fn own() -> Result<Self> {
        Self::of(std::process::id()).context("cannot read /proc, which a line needs")
    }

    fn of(pid: u32) -> Option<Self> {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        // The name comes second and may hold anything; what follows starts with the third field, and 22 is wanted.
        let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
        // One that has ended and was not waited for yet does nothing any more.
        if matches!(*fields.first()?, "Z" | "X") {
            return None;
        }
        let started = fields.get(19)?.parse().ok()?;
        let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").ok()?.trim().to_owned();
        Some(Self { pid, started, boot })
    }

    fn is_alive(&self) -> bool {
        Self::of(self.pid).as_ref() == Some(self)
    }
}

/// What the lock says of the line that has it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Entry {
    #[serde(flatten)]
    process: ProcessName,
    /// Folder that the line works in; absent while it has none.
    folder: Option<PathBuf>,
    /// Folder of an earlier line that was killed, until it is cleared: should this process be killed before, the next one
    /// knows of it still.
    left: Option<PathBuf>,
}

/// Which folder it is, whatever its path leads to by now.
type FolderId = (u64, u64);

/// An output folder that this process holds, until it is dropped.
#[derive(Debug)]
pub(crate) struct OutFolder {
    path: PathBuf,
    id: FolderId,
    entry: Entry,
    /// Where a line that was killed worked.
    left: Option<LineAddress>,
    /// Nothing of the folder is open while it is let go.
    lock: Option<File>,
}

/// A line that was found by its output folder.
#[derive(Debug, Clone)]
pub(crate) struct FoundLine {
    /// Number of its first process.
    pub(crate) pid: u32,
    /// Where it is found.
    pub(crate) address: LineAddress,
}

impl OutFolder {
    /// Makes the folder and the one for results under way, if they are not there, and holds off every other line.
    ///
    /// # Errors
    /// That another line has it, by its process; that somebody else could change what is in it; what the system says.
    pub(crate) fn take(path: &Path) -> Result<Self> {
        let path = std::path::absolute(path).with_context(|| format!("{} is no usable path", path.display()))?;
        make_all(&path)?;
        let folder = open_checked(&path)?;
        let lock = take_lock(&folder, &path)?;
        make_open(&folder, &path)?;
        let left = read_entry(&lock).and_then(|entry| LineAddress::at(&entry.left.or(entry.folder)?).ok());
        let left_path = left.as_ref().map(|address| address.root().to_owned());
        let entry = Entry { process: ProcessName::own()?, folder: None, left: left_path };
        let id = id_of(&folder, &path)?;
        let folder = Self { path, id, entry, left, lock: Some(lock) };
        folder.write()?;
        Ok(folder)
    }

    /// The folder, absolute.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The folder of results under way, absolute.
    pub(crate) fn open_path(&self) -> PathBuf {
        self.path.join(OPEN)
    }

    /// Clears away what a line that was killed left, waiting up to `patience` for its stages to end.
    ///
    /// # Errors
    /// That they still run.
    pub(crate) fn clear_left(&mut self, patience: Duration) -> Result<()> {
        let Some(address) = &self.left else { return Ok(()) };
        let since = Instant::now();
        let mut is_told = false;
        loop {
            match address.clear() {
                Ok(true) => break,
                Ok(false) => {}
                // Somebody else has taken its name since: nothing of it is left there.
                Err(error) => {
                    tracing::warn!(%error, "what an earlier line left is not touched");
                    break;
                }
            }
            if since.elapsed() > TELL_AFTER && !std::mem::replace(&mut is_told, true) {
                print_line(&format!("waiting for stages of an earlier line on {} to end", self.path.display()));
            }
            if since.elapsed() > patience {
                bail!("stages of an earlier line on {} still run: end them first (ps shows them)", self.path.display());
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        self.left = None;
        Ok(())
    }

    /// Writes down where the line that holds the folder is found. To be called before any stage starts.
    ///
    /// # Errors
    /// What the system says.
    pub(crate) fn enter(&mut self, address: &LineAddress) -> Result<()> {
        self.entry.folder = Some(address.root().to_owned());
        self.entry.left = None;
        self.write()
    }

    /// Lets go of everything in the folder, so that its disk can be taken out, mended and put back.
    ///
    /// No other line can have it meanwhile, as the lock names this process, which lives.
    pub(crate) fn release(&mut self) {
        self.lock = None;
    }

    /// Takes the folder back after [`OutFolder::release`]; whether it is there again.
    ///
    /// # Errors
    /// That another line has taken it meanwhile.
    pub(crate) fn take_back(&mut self) -> Result<bool> {
        if self.lock.is_some() {
            return Ok(true);
        }
        // While its disk is away, an empty folder may be where it was.
        let Ok(folder) = open_folder(&self.path) else { return Ok(false) };
        let Ok(lock) = open_lock(&folder, OFlags::RDONLY) else { return Ok(false) };
        match read_entry(&lock) {
            Some(entry) if entry.process == self.entry.process => {}
            Some(entry) if entry.process.is_alive() => {
                bail!("another line (process {}) has taken {} meanwhile", entry.process.pid, self.path.display());
            }
            _ => return Ok(false),
        }
        if rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err() {
            return Ok(false);
        }
        self.id = id_of(&folder, &self.path)?;
        self.lock = Some(lock);
        Ok(true)
    }

    /// The line that runs and writes to the folder at `path`, if one does. Changes nothing, holds nothing.
    ///
    /// # Errors
    /// That the folder or its lock cannot be read, or is not of this user.
    pub(crate) fn find_line(path: &Path) -> Result<Option<FoundLine>> {
        let folder = open_folder(path).with_context(|| format!("cannot look into {}", path.display()))?;
        let lock = match open_lock(&folder, OFlags::RDONLY) {
            Ok(lock) => lock,
            Err(Errno::NOENT) => return Ok(None),
            Err(error) => bail!(lock_refused(path, error)),
        };
        check_lock(&lock, path)?;
        let Some(entry) = read_entry(&lock).filter(|entry| entry.process.is_alive()) else { return Ok(None) };
        let address = entry.folder.map(|folder| LineAddress::at(&folder)).transpose()?;
        Ok(address.map(|address| FoundLine { pid: entry.process.pid, address }))
    }

    /// Writes the lock anew and has it on the disk.
    fn write(&self) -> Result<()> {
        let lock = self.path.join(LOCK);
        let write = || -> Result<()> {
            let folder = open_folder(&self.path)?;
            ensure!(id_of(&folder, &self.path)? == self.id, "another folder has taken its place");
            let mut file = open_lock(&folder, OFlags::WRONLY)?;
            check_lock(&file, &self.path)?;
            file.set_len(0)?;
            file.write_all(toml::to_string(&self.entry)?.as_bytes())?;
            // After a disk has failed and was mended, it is known by what this says.
            file.sync_all()?;
            Ok(rustix::fs::fsync(&folder)?)
        };
        write().with_context(|| format!("cannot write {}", lock.display()))
    }
}

impl Drop for OutFolder {
    fn drop(&mut self) {
        if self.lock.is_none() && !self.take_back().unwrap_or(false) {
            return; // the next line finds it, and that its process has ended
        }
        if let Some(address) = &self.left {
            tracing::debug!(folder = %address.root().display(), "what an earlier line left is still there");
            return;
        }
        let path = self.path.join(LOCK);
        // With its folder it may have been removed already.
        if let Err(error) = std::fs::remove_file(&path)
            && error.kind() != ErrorKind::NotFound
        {
            tracing::warn!(path = %path.display(), %error, "cannot remove the lock");
        }
    }
}

/// Makes the folder and those above it.
fn make_all(path: &Path) -> Result<()> {
    match std::fs::create_dir_all(path) {
        Ok(()) => Ok(()),
        Err(_) if path.metadata().is_ok_and(|there| !there.is_dir()) => {
            bail!("{} is a file; the output of a line is a folder", path.display())
        }
        Err(error) => Err(error).with_context(|| format!("cannot make the folder {}", path.display())),
    }
}

fn open_folder(path: &Path) -> Result<OwnedFd, Errno> {
    rustix::fs::open(path, OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC, Mode::empty())
}

/// Opens the folder if nobody else could put something of his into it.
fn open_checked(path: &Path) -> Result<OwnedFd> {
    let us = rustix::process::geteuid().as_raw();
    let is_trusted = |stat: &Stat| stat.st_uid == us || stat.st_uid == 0;
    let name = rustix::fs::statat(CWD, path, AtFlags::SYMLINK_NOFOLLOW)
        .with_context(|| format!("cannot look at {}", path.display()))?;
    ensure!(is_trusted(&name), "{}: {}", path.display(), owned_by(&name));
    let folder = open_folder(path).with_context(|| format!("cannot look into {}", path.display()))?;
    let stat = rustix::fs::fstat(&folder).with_context(|| format!("cannot look at {}", path.display()))?;
    ensure!(is_trusted(&stat), "{}: {}", path.display(), owned_by(&stat));
    ensure!(
        stat.st_mode & 0o002 == 0 || stat.st_mode & 0o1000 != 0,
        "everyone may write to {} and could change results there: chmod o-w it, or give another --out",
        path.display()
    );
    Ok(folder)
}

fn owned_by(stat: &Stat) -> String {
    format!(
        "it belongs to user {}, who could change results there: give a folder of your own, or run the line as that user",
        stat.st_uid
    )
}

/// Makes the folder for results under way, or checks the one that is there.
fn make_open(folder: &OwnedFd, path: &Path) -> Result<()> {
    let name = path.join(OPEN);
    match rustix::fs::mkdirat(folder, OPEN, Mode::from_raw_mode(0o777)) {
        Ok(()) | Err(Errno::EXIST) => {}
        Err(error) => return Err(error).with_context(|| format!("cannot make the folder {}", name.display())),
    }
    let stat = rustix::fs::statat(folder, OPEN, AtFlags::SYMLINK_NOFOLLOW)
        .with_context(|| format!("cannot look at {}", name.display()))?;
    let is_folder = FileType::from_raw_mode(stat.st_mode) == FileType::Directory;
    ensure!(is_folder, "{} is not a folder: a line keeps what is under way there", name.display());
    let is_ours = stat.st_uid == rustix::process::geteuid().as_raw();
    ensure!(is_ours, "{}: {}", name.display(), owned_by(&stat));
    ensure!(stat.st_mode & 0o002 == 0, "everyone may write to {}: chmod o-w it", name.display());
    Ok(())
}

/// Opens the lock, whatever it is, without following a link or waiting at a pipe.
fn open_lock(folder: &OwnedFd, flags: OFlags) -> Result<File, Errno> {
    let flags = flags | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    rustix::fs::openat(folder, LOCK, flags, Mode::RUSR | Mode::WUSR).map(File::from)
}

/// Checks that the lock is a file of ours, with one name, that nobody else can read or write.
fn check_lock(lock: &File, path: &Path) -> Result<()> {
    let name = path.join(LOCK);
    let stat = rustix::fs::fstat(lock).with_context(|| format!("cannot look at {}", name.display()))?;
    let is_file = FileType::from_raw_mode(stat.st_mode) == FileType::RegularFile;
    let is_ours = stat.st_uid == rustix::process::geteuid().as_raw();
    ensure!(
        is_file && is_ours && stat.st_nlink <= 1 && stat.st_mode & 0o077 == 0,
        "{} was not made by a line of yours (user {}, mode {:03o}, {} names): look at it, and remove it if no line runs there",
        name.display(),
        stat.st_uid,
        stat.st_mode & 0o777,
        stat.st_nlink
    );
    Ok(())
}

fn lock_refused(path: &Path, error: Errno) -> String {
    let name = path.join(LOCK);
    match error {
        Errno::LOOP => format!("{} is a link, which no line makes: remove it", name.display()),
        Errno::ACCESS => format!("{} is of a line of another user", name.display()),
        Errno::NXIO => format!("{} is no ordinary file: remove it", name.display()),
        error => format!("cannot open {}: {error}", name.display()),
    }
}

/// Makes the lock if it is not there, and takes it. It is held open to read only: so it does not keep the disk from being
/// made read only.
fn take_lock(folder: &OwnedFd, path: &Path) -> Result<File> {
    loop {
        let lock = match open_lock(folder, OFlags::CREATE | OFlags::RDONLY) {
            Ok(lock) => lock,
            Err(error) => bail!(lock_refused(path, error)),
        };
        check_lock(&lock, path)?;
        let lock = match rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => lock,
            Err(Errno::WOULDBLOCK) => {
                let who = read_entry(&lock).map_or(String::new(), |entry| format!(" (process {})", entry.process.pid));
                bail!("another line{who} is writing to {}", path.display());
            }
            // A network's file system has locks only for files that are open to write.
            Err(Errno::BADF) => {
                let lock = open_lock(folder, OFlags::RDWR).map_err(|e| anyhow::anyhow!(lock_refused(path, e)))?;
                if rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err() {
                    bail!("another line is writing to {}", path.display());
                }
                lock
            }
            Err(error) => return Err(error).with_context(|| format!("cannot lock {}", path.join(LOCK).display())),
        };
        // Whoever held it may have removed it since it was opened.
        let (held, named) = (rustix::fs::fstat(&lock), rustix::fs::statat(folder, LOCK, AtFlags::SYMLINK_NOFOLLOW));
        let is_same = matches!((held, named), (Ok(held), Ok(named)) if (held.st_dev, held.st_ino) == (named.st_dev, named.st_ino));
        if !is_same {
            continue;
        }
        // One that has let go of it for a while, as its disk failed, is still there.
        if let Some(entry) = read_entry(&lock).filter(|entry| entry.process.is_alive())
            && entry.process.pid != std::process::id()
        {
            bail!("another line (process {}) is writing to {}", entry.process.pid, path.display());
        }
        return Ok(lock);
    }
}

/// What the lock says, if it is legible.
fn read_entry(lock: &File) -> Option<Entry> {
    use std::os::unix::fs::FileExt as _;
    let mut text = vec![0; usize::try_from(LOCK_BYTES_MAX).ok()?];
    let count = lock.read_at(&mut text, 0).ok()?;
    toml::from_str(std::str::from_utf8(text.get(..count)?).ok()?).ok()
}

fn id_of(folder: &OwnedFd, path: &Path) -> Result<FolderId> {
    let stat = rustix::fs::fstat(folder).with_context(|| format!("cannot look at {}", path.display()))?;
    Ok((stat.st_dev, stat.st_ino))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, symlink};

    use super::*;

    fn refused(path: &Path) -> String {
        OutFolder::take(path).err().map(|error| format!("{error:#}")).expect("it was taken")
    }

    fn set_mode(path: &Path, mode: u32) {
        fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    }

    #[test]
    fn one_line_has_it_at_a_time_and_is_found_by_it() {
        let temp = tempfile::TempDir::new().unwrap();
        let path = temp.path().join("a/out");
        assert!(OutFolder::find_line(temp.path()).unwrap().is_none());
        let mut out = OutFolder::take(&path).unwrap();
        assert_eq!(out.path(), path);
        assert!(out.open_path().is_dir() && path.join(LOCK).metadata().unwrap().mode() & 0o777 == 0o600);
        let second = refused(&path);
        assert!(second.contains("another line") && second.contains(&std::process::id().to_string()), "{second}");
        assert!(OutFolder::find_line(&path).unwrap().is_none(), "it has no address yet");

        let address = LineAddress::fresh().unwrap();
        out.enter(&address).unwrap();
        let found = OutFolder::find_line(&path).unwrap().unwrap();
        assert_eq!((found.pid, &found.address), (std::process::id(), &address));
        drop(out);
        assert!(!path.join(LOCK).exists() && address.clear().unwrap());
    }

    #[test]
    fn what_a_killed_line_left_is_found_and_cleared() {
        let temp = tempfile::TempDir::new().unwrap();
        let mut out = OutFolder::take(temp.path()).unwrap();
        let address = LineAddress::fresh().unwrap();
        out.enter(&address).unwrap();
        // As if it were killed: the lock is let go and stays, and its process is no more.
        out.release();
        let killed = Entry { process: ProcessName { pid: 1, ..out.entry.process.clone() }, ..out.entry.clone() };
        fs::write(temp.path().join(LOCK), toml::to_string(&killed).unwrap()).unwrap();
        std::mem::forget(out);

        assert!(OutFolder::find_line(temp.path()).unwrap().is_none());
        let mut next = OutFolder::take(temp.path()).unwrap();
        assert!(OutFolder::find_line(temp.path()).unwrap().is_none(), "who looks on would keep what is to be cleared");
        assert!(address.root().exists());
        next.clear_left(Duration::ZERO).unwrap();
        assert!(!address.root().exists());
        drop(next);
        assert!(!temp.path().join(LOCK).exists());
    }

    #[test]
    fn let_go_it_is_held_by_nothing_but_kept_for_the_line() {
        let temp = tempfile::TempDir::new().unwrap();
        let mut out = OutFolder::take(temp.path()).unwrap();
        out.release();
        let is_inside = |fd: fs::DirEntry| fs::read_link(fd.path()).is_ok_and(|to| to.starts_with(temp.path()));
        assert!(!fs::read_dir("/proc/self/fd").unwrap().flatten().any(is_inside));
        // Its disk is away: an empty folder is in its place.
        let away = temp.path().with_extension("away");
        fs::rename(temp.path(), &away).unwrap();
        assert!(!out.take_back().unwrap());
        fs::create_dir(temp.path()).unwrap();
        assert!(!out.take_back().unwrap());
        fs::remove_dir(temp.path()).unwrap();
        fs::rename(&away, temp.path()).unwrap();
        assert!(out.take_back().unwrap() && out.take_back().unwrap());
        assert!(refused(temp.path()).contains("another line"));
    }

    #[test]
    fn what_others_have_put_there_is_refused_and_left_as_it_is() {
        let temp = tempfile::TempDir::new().unwrap();
        let dear = temp.path().join("dear");
        fs::write(&dear, "dear").unwrap();
        let out = temp.path().join("out");
        fs::create_dir(&out).unwrap();
        let lock = out.join(LOCK);

        symlink(&dear, &lock).unwrap();
        assert!(refused(&out).contains("is a link"));
        fs::remove_file(&lock).unwrap();
        set_mode(&dear, 0o600);
        fs::hard_link(&dear, &lock).unwrap();
        assert!(refused(&out).contains("2 names"));
        fs::remove_file(&lock).unwrap();
        rustix::fs::mknodat(CWD, &lock, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        assert!(refused(&out).contains("not made by a line"));
        fs::remove_file(&lock).unwrap();
        fs::write(&lock, "").unwrap();
        set_mode(&lock, 0o666);
        assert!(refused(&out).contains("mode 666"));
        fs::remove_file(&lock).unwrap();
        assert_eq!(fs::read_to_string(&dear).unwrap(), "dear");

        symlink(temp.path(), out.join(OPEN)).unwrap();
        assert!(refused(&out).contains("not a folder"));
        fs::remove_file(out.join(OPEN)).unwrap();
        set_mode(&out, 0o777);
        assert!(refused(&out).contains("everyone may write"));
        set_mode(&out, 0o1777);
        drop(OutFolder::take(&out).unwrap());
        assert!(refused(&dear).contains("is a file"));
    }
}
