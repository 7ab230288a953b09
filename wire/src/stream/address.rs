//! Where a line is found: a private folder, and names that nobody can guess.
//!
//! The folder is new, belongs to the line's user and is closed to others. The names of its shared memory begin with the random
//! token of the folder, and every file so named is private too. A file that somebody else has made, linked or opened to
//! others is never used and never removed.

use std::ffi::OsStr;
use std::io::ErrorKind;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use iceoryx2::prelude::*;
use rustix::fs::{AtFlags, CWD, FileType, FlockOperation, Mode, OFlags};
use rustix::io::Errno;

use crate::LineError;
use crate::stream::cleanup::{SHM, Svc, named, reap, remove, segments};
use crate::stream::folder;

/// Where one line is found: two lines with different addresses never meet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineAddress {
    /// Beginning of the names of its files in `/dev/shm`.
    prefix: String,
    /// Folder of its other files.
    root: PathBuf,
}

impl LineAddress {
    /// The address of a new line: makes its folder, below `XDG_RUNTIME_DIR` if that is private, or else among the
    /// system's temporary files.
    ///
    /// # Errors
    /// [`LineError::NoFolder`] when none can be made; [`LineError::Shared`] when the shared-memory layer refuses.
    pub fn fresh() -> Result<Self, LineError> {
        let mut why = "there is none".to_owned();
        for base in folder::bases() {
            match folder::create(&base) {
                Ok(root) => {
                    let address = Self::at(&root)?;
                    address.verify()?;
                    if let Err(error) = address.seal() {
                        address.remove();
                        return Err(error);
                    }
                    return Ok(address);
                }
                Err(reason) => why = format!("{}: {reason}", base.display()),
            }
        }
        Err(LineError::NoFolder { why })
    }

    /// The address of the line whose folder is `root`, which [`LineAddress::fresh`] has made. Checks only the name:
    /// the folder is checked when the line is joined.
    ///
    /// # Errors
    /// [`LineError::NotOurs`] when no line has such a folder.
    pub fn at(root: &Path) -> Result<Self, LineError> {
        let token = root.file_name().and_then(OsStr::to_str).and_then(|name| name.strip_prefix(folder::PREFIX));
        let is_token = |token: &&str| {
            token.len() == folder::TOKEN_DIGITS
                && token.bytes().all(|c| c.is_ascii_digit() || (b'a'..=b'f').contains(&c))
        };
        match token.filter(is_token) {
            Some(token) if root.is_absolute() && root.as_os_str().len() <= folder::ROOT_BYTES_MAX => {
                Ok(Self { prefix: format!("tapline_{token}_"), root: root.to_owned() })
            }
            _ => Err(LineError::not_ours(root, "is not named like the folder of a line")),
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

    /// Checks that the folder and every file in shared memory are private to the line's user.
    ///
    /// # Errors
    /// [`LineError::NotOurs`] with the file that somebody else has made, or can read or write.
    pub fn verify(&self) -> Result<(), LineError> {
        self.verify_folder()?;
        for path in named(&self.prefix) {
            match rustix::fs::statat(CWD, &path, AtFlags::SYMLINK_NOFOLLOW) {
                Ok(stat) => folder::check_private(&path, &stat, FileType::RegularFile)?,
                Err(Errno::NOENT) => {} // its owner has gone meanwhile
                Err(error) => return Err(LineError::io(&path, error)),
            }
        }
        Ok(())
    }

    /// Locks the folder: while the returned handle is held, programs that tidy temporary files leave the folder alone.
    ///
    /// # Errors
    /// [`LineError::NotOurs`] when the folder is not as [`LineAddress::fresh`] made it.
    pub fn lock_folder(&self) -> Result<OwnedFd, LineError> {
        let folder = folder::open_private(&self.root)?;
        if let Err(error) = rustix::fs::flock(&folder, FlockOperation::NonBlockingLockShared) {
            tracing::debug!(%error, "the line's folder cannot be locked");
        }
        Ok(folder)
    }

    fn verify_folder(&self) -> Result<(), LineError> {
        folder::open_private(&self.root).map(drop)
    }

    pub(crate) fn config(&self) -> Result<Config, LineError> {
        self.verify_folder()?;
        let name = |e| LineError::shared(format!("using the line address {self:?}"), e);
        let mut config = Config::default();
        config.global.prefix = FileName::new(self.prefix.as_bytes()).map_err(name)?;
        config.global.set_root_path(&iceoryx2::prelude::Path::new(folder::path_bytes(&self.root)).map_err(name)?);
        Ok(config)
    }

    /// Lets the layer make its management file, which everyone can write, and replaces it by one that only this user can.
    ///
    /// A program that has opened the first file meanwhile holds one that nobody reads any more.
    fn seal(&self) -> Result<(), LineError> {
        set_log_level(LogLevel::Fatal); // its returned errors report the same
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

    /// Removes what dead participants left, or everything if none is alive; returns whether the address is empty now.
    ///
    /// Only files of this user are removed, and no link is followed.
    ///
    /// # Errors
    /// [`LineError::NotOurs`] when the folder is there but is not ours; [`LineError`] when the address is not usable.
    pub fn clear(&self) -> Result<bool, LineError> {
        if self.root.symlink_metadata().is_err_and(|e| e.kind() == ErrorKind::NotFound) {
            // Participants find each other by the folder, so nobody is left. Whoever removed it left the segments.
            self.remove();
            return Ok(true);
        }
        if reap(&self.config()?) {
            return Ok(false);
        }
        // The layer leaves its management file by design; nobody is left to need it.
        self.remove();
        Ok(true)
    }

    /// Removes everything, even if somebody is alive: for a line whose stages have ended.
    pub fn remove(&self) {
        // The folder is removed last: while it exists, the next line knows that something was left.
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

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, symlink};
    use std::sync::Arc;

    use super::*;
    use crate::{DiscriminatorTopic, Limits, Line, Publisher, Role, Subscriber};

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
        address.remove();
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

        let second = Path::new(SHM).join(format!("second_name_{}", &address.prefix));
        std::fs::hard_link(&file, &second).unwrap();
        let error = address.verify().unwrap_err().to_string();
        std::fs::remove_file(second).unwrap();
        assert!(error.contains("a second name"), "{error}");
        address.verify().unwrap();

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

    /// Catches a folder with a path that is too long for the layer, which puts it before the names of shared memory too: those of
    /// connections have two numbers, of up to 39 digits.
    #[test]
    fn the_longest_path_of_a_folder_is_short_enough_for_the_layer() {
        let above = tempfile::TempDir::new().unwrap();
        let above = above.path().canonicalize().unwrap();
        let root = (1..150).rev().find_map(|count| {
            let base = above.join("x".repeat(count));
            std::fs::create_dir(&base).unwrap();
            folder::create(&base).ok()
        });
        let address = LineAddress::at(&root.unwrap()).unwrap();
        assert_eq!(address.root.as_os_str().len(), folder::ROOT_BYTES_MAX);
        let join = |role| Line::join(&address, role, &Limits::default(), Arc::default()).unwrap();
        {
            let (store, process) = (join(Role::Store), join(Role::Process));
            let _found = Subscriber::<DiscriminatorTopic>::open(&store).unwrap();
            let sender = Publisher::<DiscriminatorTopic>::open(&process).unwrap();
            assert!(!sender.poll_ready().unwrap(), "the handshake is sent over a connection");
            let lengths = named(&address.prefix).map(|path| {
                let name = path.file_name().unwrap().to_str().unwrap().to_owned();
                let numbers = name.split(|c: char| !c.is_ascii_digit()).filter(|part| (25..40).contains(&part.len()));
                name.len() + numbers.map(|number| 39 - number.len()).sum::<usize>()
            });
            let longest = lengths.max().unwrap();
            assert!(longest > 150, "{longest}: there is no connection");
            assert!(folder::ROOT_BYTES_MAX + 1 + longest <= 255, "{longest}");
        }
        address.remove();
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
