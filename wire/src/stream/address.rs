//! Where a line lives: a private folder and names that nobody can foresee, and clearing away what the dead have left.
//!
//! A line keeps to itself what it works with. Its folder is fresh, belongs to its user and is closed to all others; the
//! names of its shared memory begin with the token of the folder, and every file behind them is its user's alone. What
//! somebody else has made, linked or opened up is never used, and never removed.

use std::ffi::OsStr;
use std::io::ErrorKind;
use std::os::fd::OwnedFd;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::node::NodeView as _;
use iceoryx2::prelude::*;
use rustix::fs::{AtFlags, CWD, FileType, FlockOperation, Mode, OFlags, Stat};
use rustix::io::Errno;

use crate::LineError;

/// How processes of a line share memory.
pub(crate) type Svc = ipc_threadsafe::Service;

/// Where shared memory lives.
pub(crate) const SHM: &str = "/dev/shm";

/// Beginning of the name of every line's folder; its token follows.
const FOLDER: &str = "tapline-";

/// Digits of a token: 64 random bits in hexadecimal.
const TOKEN_DIGITS: usize = 16;

/// Longest path of a line's folder, in bytes. The layer's sockets below it must fit the 107 bytes of a socket's address, and
/// have up to 66 more: the prefix, a number of up to 33 digits in a process that makes thousands of ports, their kind.
const ROOT_BYTES_MAX: usize = 41;

/// Where one line is found: two lines with different addresses never meet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineAddress {
    /// Beginning of the names of its files in `/dev/shm`.
    prefix: String,
    /// Folder of its other files; short, since socket paths are.
    root: PathBuf,
}

/// Keeps the folder of a line from being taken for forgotten by what tidies temporary files, until it is dropped.
#[derive(Debug)]
pub struct Kept {
    _folder: OwnedFd,
}

impl LineAddress {
    /// The address of a new line: makes its folder, below `XDG_RUNTIME_DIR` if that is private, or else among the
    /// system's temporary files.
    ///
    /// # Errors
    /// [`LineError::NoFolder`] when none can be made; [`LineError::Shared`] when the shared-memory layer refuses.
    pub fn fresh() -> Result<Self, LineError> {
        let mut why = "there is none".to_owned();
        for base in bases() {
            match make_folder(&base) {
                Ok(root) => {
                    let address = Self::at(&root)?;
                    address.verify()?;
                    if let Err(error) = address.seal() {
                        address.remove_all();
                        return Err(error);
                    }
                    return Ok(address);
                }
                Err(reason) => why = format!("{}: {reason}", base.display()),
            }
        }
        Err(LineError::NoFolder { why })
    }

    /// The address of the line whose folder is `root`, which [`LineAddress::fresh`] has made. Looks at the name alone:
    /// the folder is looked at when the line is joined.
    ///
    /// # Errors
    /// [`LineError::NotOurs`] when no line has such a folder.
    pub fn at(root: &Path) -> Result<Self, LineError> {
        let token = root.file_name().and_then(OsStr::to_str).and_then(|name| name.strip_prefix(FOLDER));
        let is_token = |token: &&str| {
            token.len() == TOKEN_DIGITS && token.bytes().all(|c| c.is_ascii_digit() || (b'a'..=b'f').contains(&c))
        };
        match token.filter(is_token) {
            Some(token) if root.is_absolute() && root.as_os_str().len() <= ROOT_BYTES_MAX => {
                Ok(Self { prefix: format!("tapline_{token}_"), root: root.to_owned() })
            }
            _ => Err(LineError::not_ours(root, "is not named as the folder of a line is")),
        }
    }

    /// The line's folder, closed to other users.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Beginning of the names of the line's files in `/dev/shm`.
    pub fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Checks that all of the line is its user's alone: the folder, and every file in shared memory.
    ///
    /// # Errors
    /// [`LineError::NotOurs`] with the file that somebody else has made, or can read or write.
    pub fn verify(&self) -> Result<(), LineError> {
        self.verify_folder()?;
        for path in named(&self.prefix) {
            match rustix::fs::statat(CWD, &path, AtFlags::SYMLINK_NOFOLLOW) {
                Ok(stat) => check_private(&path, &stat, FileType::RegularFile)?,
                Err(Errno::NOENT) => {} // its owner has gone meanwhile
                Err(error) => return Err(LineError::io(&path, error)),
            }
        }
        Ok(())
    }

    /// Holds the folder against being tidied away while the line runs.
    ///
    /// # Errors
    /// [`LineError::NotOurs`] when the folder is not as [`LineAddress::fresh`] made it.
    pub fn keep(&self) -> Result<Kept, LineError> {
        let folder = open_folder(&self.root)?;
        if let Err(error) = rustix::fs::flock(&folder, FlockOperation::NonBlockingLockShared) {
            tracing::debug!(%error, "the line's folder cannot be held");
        }
        Ok(Kept { _folder: folder })
    }

    fn verify_folder(&self) -> Result<(), LineError> {
        open_folder(&self.root).map(drop)
    }

    pub(crate) fn config(&self) -> Result<Config, LineError> {
        self.verify_folder()?;
        let name = |e| LineError::shared(format!("using the line address {self:?}"), e);
        let mut config = Config::default();
        config.global.prefix = FileName::new(self.prefix.as_bytes()).map_err(name)?;
        config.global.set_root_path(&iceoryx2::prelude::Path::new(path_bytes(&self.root)).map_err(name)?);
        Ok(config)
    }

    /// Has the layer make its management file, which everyone could write, and puts one in its place that only we can.
    ///
    /// Whoever opened the first one meanwhile holds a file that nobody reads any more.
    fn seal(&self) -> Result<(), LineError> {
        set_log_level(LogLevel::Fatal); // what it reports is reported by the errors it returns
        let node = NodeBuilder::new()
            .config(&self.config()?)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Svc>()
            .map_err(|e| LineError::shared(format!("preparing the line {}", self.prefix), e))?;
        drop(node);
        let management = named(&self.prefix).find(|path| path.extension() == Some(OsStr::new(MANAGEMENT)));
        let management = management.ok_or_else(|| LineError::shared("sealing the line", "no management file"))?;
        let length = management.metadata().map_err(|e| LineError::io(&management, e))?.len();
        if length != SEALED.len() as u64 {
            return Err(LineError::shared("sealing the line", format!("a management file of {length} bytes")));
        }
        let seal = Path::new(SHM).join(format!("{}seal", self.prefix));
        let flags = OFlags::CREATE | OFlags::EXCL | OFlags::WRONLY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let file = rustix::fs::open(&seal, flags, Mode::RUSR | Mode::WUSR).map_err(|e| LineError::io(&seal, e))?;
        let written = rustix::fs::fchmod(&file, Mode::RUSR | Mode::WUSR)
            .and_then(|()| rustix::io::write(&file, &SEALED))
            .and_then(|count| if count == SEALED.len() { Ok(()) } else { Err(Errno::NOSPC) })
            .and_then(|()| rustix::fs::rename(&seal, &management));
        written.map_err(|e| LineError::io(&management, e))?;
        self.verify()
    }

    /// Clears away what dead participants left, and everything when no one is alive; whether it is clear now.
    ///
    /// Only what is ours is removed, and no link is followed.
    ///
    /// # Errors
    /// [`LineError::NotOurs`] when the folder is there but is not ours; [`LineError`] when the address is not usable.
    pub fn clear(&self) -> Result<bool, LineError> {
        if self.root.symlink_metadata().is_err_and(|e| e.kind() == ErrorKind::NotFound) {
            // Nobody can be found without it: who tidied it away left the segments.
            self.remove_all();
            return Ok(true);
        }
        if reap(&self.config()?) {
            return Ok(false);
        }
        // The layer leaves one management file a prefix by design; nobody is left to need it.
        self.remove_all();
        Ok(true)
    }

    /// The folder goes last: while it is there, the next line knows that something was left.
    fn remove_all(&self) {
        for path in segments(&self.prefix) {
            remove(&path, |path| std::fs::remove_file(path));
        }
        if self.verify_folder().is_ok() {
            remove(&self.root, |path| std::fs::remove_dir_all(path));
        }
    }
}

/// Extension of the layer's management file.
const MANAGEMENT: &str = "global_mgmt";

/// A management file as the layer 0.10.0 makes it: its version, a counter of nodes, padding.
const SEALED: [u8; 16] = [0, 0, 10, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];

/// Checks that a file is of this kind, ours, closed to everyone else and, but for a folder, has no second name.
fn check_private(path: &Path, stat: &Stat, kind: FileType) -> Result<(), LineError> {
    if FileType::from_raw_mode(stat.st_mode) != kind {
        return Err(LineError::not_ours(path, "is not the kind of file that a line makes"));
    }
    if stat.st_uid != rustix::process::geteuid().as_raw() {
        return Err(LineError::not_ours(path, format!("belongs to user {}", stat.st_uid)));
    }
    if stat.st_mode & 0o077 != 0 {
        return Err(LineError::not_ours(path, format!("is open to other users (mode {:03o})", stat.st_mode & 0o777)));
    }
    if kind != FileType::Directory && stat.st_nlink > 1 {
        return Err(LineError::not_ours(path, "has another name besides"));
    }
    Ok(())
}

/// Opens a line's folder, if it is a folder, ours and private.
fn open_folder(root: &Path) -> Result<OwnedFd, LineError> {
    let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    let folder = match rustix::fs::open(root, flags, Mode::empty()) {
        Ok(folder) => folder,
        Err(Errno::LOOP | Errno::NOTDIR) => return Err(LineError::not_ours(root, "is a link or a file")),
        Err(Errno::ACCESS) => return Err(LineError::not_ours(root, "belongs to another user")),
        Err(error) => return Err(LineError::io(root, error)),
    };
    let stat = rustix::fs::fstat(&folder).map_err(|e| LineError::io(root, e))?;
    check_private(root, &stat, FileType::Directory)?;
    Ok(folder)
}

/// Folders in which a line may make its own, the best first.
fn bases() -> Vec<PathBuf> {
    let runtime = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
    let runtime = runtime.filter(|folder| folder.is_absolute() && open_folder(folder).is_ok());
    runtime.into_iter().chain([std::env::temp_dir(), PathBuf::from("/tmp")]).collect()
}

/// Makes a fresh folder of a line in `base`.
fn make_folder(base: &Path) -> Result<PathBuf, String> {
    let said = |error: &dyn std::fmt::Display| error.to_string();
    let base = base.canonicalize().map_err(|e| said(&e))?;
    let there = base.metadata().map_err(|e| said(&e))?;
    if ![0, rustix::process::geteuid().as_raw()].contains(&there.uid()) {
        return Err(format!("it belongs to user {}", there.uid()));
    }
    if there.mode() & 0o022 != 0 && there.mode() & 0o1000 == 0 {
        return Err("others may remove what is in it (it is not sticky)".to_owned());
    }
    if base.as_os_str().len() + 1 + FOLDER.len() + TOKEN_DIGITS > ROOT_BYTES_MAX {
        return Err("its path is too long for sockets".to_owned());
    }
    for _ in 0..16 {
        let mut token = [0_u8; TOKEN_DIGITS / 2];
        let filled = rustix::rand::getrandom(&mut token, rustix::rand::GetRandomFlags::empty());
        if filled.map_err(|e| said(&e))? != token.len() {
            return Err("the system gives no random numbers".to_owned());
        }
        let root = base.join(format!("{FOLDER}{:016x}", u64::from_le_bytes(token)));
        match rustix::fs::mkdir(&root, Mode::RWXU) {
            Ok(()) => return Ok(root),
            Err(Errno::EXIST) => {}
            Err(error) => return Err(said(&error)),
        }
    }
    Err("every name is taken".to_owned())
}

fn path_bytes(path: &Path) -> &[u8] {
    std::os::unix::ffi::OsStrExt::as_bytes(path.as_os_str())
}

fn remove(path: &Path, by: impl Fn(&Path) -> std::io::Result<()>) {
    if let Err(error) = by(path)
        && error.kind() != ErrorKind::NotFound
    {
        tracing::warn!(path = %path.display(), %error, "cannot remove what a line left behind");
    }
}

/// What in shared memory has a name that begins with `prefix`, whosever it is.
fn named(prefix: &str) -> impl Iterator<Item = PathBuf> {
    let files = std::fs::read_dir(SHM).into_iter().flatten().flatten();
    files.filter(move |file| file.file_name().to_string_lossy().starts_with(prefix)).map(|file| file.path())
}

/// Our segments of shared memory whose names begin with `prefix`.
pub(crate) fn segments(prefix: &str) -> impl Iterator<Item = PathBuf> {
    let us = rustix::process::geteuid().as_raw();
    named(prefix).filter(move |path| path.symlink_metadata().is_ok_and(|file| file.is_file() && file.uid() == us))
}

/// Longest time that a living participant takes between making a segment and giving it a size.
const SIZING_MOST: Duration = Duration::from_secs(1);

/// Removes segments that have no size: who made them died before giving them one, for which the layer would wait for ever.
fn remove_unsized(prefix: &str) {
    let unsized_now = || -> Vec<PathBuf> {
        segments(prefix).filter(|path| path.symlink_metadata().is_ok_and(|segment| segment.len() == 0)).collect()
    };
    let suspects = unsized_now();
    if suspects.is_empty() {
        return;
    }
    std::thread::sleep(SIZING_MOST);
    for path in unsized_now().into_iter().filter(|path| suspects.contains(path)) {
        remove(&path, |path| std::fs::remove_file(path));
    }
}

/// Clears the resources of dead participants; whether anyone is alive.
pub(crate) fn reap(config: &Config) -> bool {
    let mut is_alive = false;
    let listed = Node::<Svc>::list(config, |state| {
        match state {
            NodeState::Dead(view) => {
                remove_unsized(&config.global.prefix.to_string());
                let name = view.details().as_ref().map(|d| d.name().as_str().to_owned());
                match view.try_remove_stale_resources() {
                    Ok(()) => tracing::debug!(?name, "cleared away a dead participant"),
                    Err(error) => tracing::trace!(?name, ?error, "a dead participant is being cleared by another"),
                }
            }
            NodeState::Alive(_) | NodeState::Inaccessible(_) | NodeState::Undefined(_) => is_alive = true,
        }
        CallbackProgression::Continue
    });
    if let Err(error) = listed {
        // Files vanish while others come and go; the next look sees a settled state.
        tracing::trace!(?error, "cannot list the participants just now");
        return true;
    }
    is_alive
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt as _, symlink};

    use super::*;

    #[test]
    fn two_lines_have_nothing_in_common_and_nothing_that_others_can_open() {
        let (one, other) = (LineAddress::fresh().unwrap(), LineAddress::fresh().unwrap());
        assert_ne!(one, other);
        assert_eq!(LineAddress::at(one.root()).unwrap(), one);
        for address in [&one, &other] {
            address.verify().unwrap();
            assert_eq!(address.root.metadata().unwrap().mode() & 0o777, 0o700);
            let files: Vec<PathBuf> = named(&address.prefix).collect();
            assert_eq!(files.len(), 1, "{files:?}");
            assert_eq!(std::fs::read(&files[0]).unwrap(), SEALED);
            assert!(address.clear().unwrap());
            assert!(!address.root.exists() && named(&address.prefix).next().is_none());
        }
    }

    /// Catches a layer that has its management file otherwise: the sealed one would be refused or misread.
    #[test]
    fn the_layer_makes_its_management_file_as_it_is_sealed() {
        let folder = tempfile::TempDir::new().unwrap();
        std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o700)).unwrap();
        let address =
            LineAddress { prefix: format!("tapline_t{}_", std::process::id()), root: folder.path().to_owned() };
        drop(NodeBuilder::new().config(&address.config().unwrap()).create::<Svc>().unwrap());
        let file = named(&address.prefix).next().unwrap();
        let (made, mode) = (std::fs::read(&file).unwrap(), file.metadata().unwrap().mode());
        address.remove_all();
        assert_eq!((made[..8].to_vec(), made.len()), (SEALED[..8].to_vec(), SEALED.len()));
        assert_eq!(mode & 0o777, 0o666, "the layer closes it itself: no seal is needed any more");
    }

    #[test]
    fn what_was_opened_up_or_put_there_is_not_used_and_not_followed() {
        let address = LineAddress::fresh().unwrap();
        let file = named(&address.prefix).next().unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o666)).unwrap();
        let error = address.verify().unwrap_err().to_string();
        assert!(error.contains("open to other users") && error.contains("666"), "{error}");
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o600)).unwrap();

        let elsewhere = tempfile::TempDir::new().unwrap();
        std::fs::write(elsewhere.path().join("dear"), "").unwrap();
        let link = Path::new(SHM).join(format!("{}link", address.prefix));
        symlink(elsewhere.path().join("dear"), &link).unwrap();
        assert!(matches!(address.verify(), Err(LineError::NotOurs { .. })));
        symlink(elsewhere.path(), address.root.join("link")).unwrap();
        assert!(address.clear().unwrap());
        assert!(link.symlink_metadata().is_ok(), "what no line has made is left alone");
        std::fs::remove_file(link).unwrap();

        // A link in the place of the folder, and a folder that others can enter.
        symlink(elsewhere.path(), &address.root).unwrap();
        assert!(matches!(address.clear(), Err(LineError::NotOurs { .. })));
        assert!(matches!(address.config(), Err(LineError::NotOurs { .. })));
        std::fs::remove_file(&address.root).unwrap();
        std::fs::create_dir(&address.root).unwrap();
        std::fs::set_permissions(&address.root, std::fs::Permissions::from_mode(0o755)).unwrap();
        assert!(matches!(address.clear(), Err(LineError::NotOurs { .. })));
        std::fs::remove_dir(&address.root).unwrap();
        assert!(elsewhere.path().join("dear").exists());
    }

    #[test]
    fn no_other_name_is_the_folder_of_a_line() {
        for name in
            ["/tmp", "/tmp/tapline-", "/tmp/tapline-0123456789abcdeF", "tapline-0123456789abcdef", "/tmp/tapline-0/.."]
        {
            assert!(LineAddress::at(Path::new(name)).is_err(), "{name}");
        }
        LineAddress::at(Path::new("/tmp/tapline-0123456789abcdef")).unwrap();
    }
}
