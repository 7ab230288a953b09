//! A centre's folder: files appear in it complete, checked and on the disk, or not at all.

use std::fs::{self, File, TryLockError};
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail, ensure};
use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE;
use rustix::fs::{CWD, RenameFlags};
use rustix::io::Errno;
use sha2::{Digest as _, Sha256};

use crate::file::CasingFile;

/// Folder of incoming files. Verbs that read a folder of archives skip hidden ones.
const INCOMING: &str = ".incoming";

/// In it: the name of this collector, and that a process works here.
const NAME: &str = ".collector";

/// Most bytes of a disk that stay free.
const KEPT_MAX: u64 = 2_000_000_000;

/// A centre's folder, which one process at a time fills.
#[derive(Debug)]
pub(crate) struct Folder {
    path: PathBuf,
    /// Which collector this is; it stays with the folder.
    pub name: String,
    _lock: File,
}

impl Folder {
    /// Opens the folder at `path`, which is made if missing. The collector is named after `host`.
    pub(crate) fn open(path: &Path, host: &str) -> Result<Self> {
        let incoming = path.join(INCOMING);
        fs::create_dir_all(&incoming).with_context(|| format!("cannot make {}", incoming.display()))?;
        let at = incoming.join(NAME);
        let context = || format!("cannot open {}", at.display());
        let mut file =
            File::options().read(true).write(true).create(true).truncate(false).open(&at).with_context(context)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => bail!("another process collects into {}", path.display()),
            Err(TryLockError::Error(error)) => return Err(error).with_context(context),
        }
        let mut name = String::new();
        file.read_to_string(&mut name).with_context(context)?;
        if name.is_empty() {
            let mut random = [0; 4];
            rustix::rand::getrandom(&mut random, rustix::rand::GetRandomFlags::empty())?;
            name = format!("{host}-{:08x}", u32::from_ne_bytes(random));
            file.write_all(name.as_bytes()).and_then(|()| file.sync_all()).with_context(context)?;
        }
        Ok(Self { path: path.to_owned(), name, _lock: file })
    }

    /// Where `file` is when it is taken.
    pub(crate) fn place(&self, file: &CasingFile) -> PathBuf {
        self.path.join(file.path())
    }

    /// Where `file` is written first.
    pub(crate) fn draft(&self, file: &CasingFile) -> PathBuf {
        self.path.join(INCOMING).join(file.path())
    }

    /// Syncs the draft of `file`, and its name, to the disk.
    pub(crate) fn keep_draft(&self, file: &CasingFile) -> Result<()> {
        let draft = self.draft(file);
        File::open(&draft)
            .and_then(|draft| draft.sync_all())
            .with_context(|| format!("cannot write {}", draft.display()))?;
        sync_folders(&draft, &self.path)
    }

    /// Refuses `bytes` for which the disk has no room: a twentieth of it, but at most [`KEPT_MAX`], stays free for what else is written
    /// there.
    pub(crate) fn ensure_room(&self, bytes: u64) -> Result<()> {
        let context = || format!("cannot find out how much room {} has", self.path.display());
        let disk = rustix::fs::statvfs(&self.path).with_context(context)?;
        let (free, kept) = (disk.f_bavail * disk.f_frsize, (disk.f_blocks * disk.f_frsize / 20).min(KEPT_MAX));
        // Without the bytes that are free, which change: a trouble is logged once.
        ensure!(
            bytes.saturating_add(kept) <= free,
            "no room for {bytes} bytes on the disk of {}, of which {kept} stay free",
            self.path.display()
        );
        Ok(())
    }

    /// Starts the draft of `file`.
    pub(crate) fn begin(&self, file: &CasingFile) -> Result<File> {
        let draft = self.draft(file);
        make_folder_of(&draft)?;
        File::create(&draft).with_context(|| format!("cannot write {}", draft.display()))
    }

    /// Makes the folder in which `file` has its place.
    pub(crate) fn make_place(&self, file: &CasingFile) -> Result<()> {
        make_folder_of(&self.place(file))
    }

    /// Puts the draft of `file` in its place, and syncs that to the disk. An existing file stays.
    pub(crate) fn put_in_place(&self, file: &CasingFile) -> Result<()> {
        let (draft, place) = (self.draft(file), self.place(file));
        self.make_place(file)?;
        match rustix::fs::renameat_with(CWD, &draft, CWD, &place, RenameFlags::NOREPLACE) {
            Ok(()) => {}
            // Not every file system can refuse to replace; only this process writes here.
            Err(Errno::INVAL | Errno::NOSYS) if !place.exists() => fs::rename(&draft, &place)?,
            Err(error) => {
                return Err(error).with_context(|| format!("cannot put {} in its place", place.display()));
            }
        }
        sync_folders(&place, &self.path)
    }

    /// Removes the draft of `file`.
    pub(crate) fn discard(&self, file: &CasingFile) {
        let draft = self.draft(file);
        if let Err(error) = fs::remove_file(&draft)
            && error.kind() != std::io::ErrorKind::NotFound
        {
            tracing::warn!("cannot remove {}: {error}", draft.display());
        }
    }

    /// The drafts that an earlier process has left.
    pub(crate) fn drafts(&self) -> Result<Vec<CasingFile>> {
        let incoming = self.path.join(INCOMING);
        let mut folders = vec![incoming.clone()];
        let mut drafts = Vec::new();
        while let Some(folder) = folders.pop() {
            let context = || format!("cannot read {}", folder.display());
            for entry in fs::read_dir(&folder).with_context(context)? {
                let entry = entry.with_context(context)?;
                if entry.file_type().with_context(context)?.is_dir() {
                    folders.push(entry.path());
                } else if let Some(name) = entry.path().strip_prefix(&incoming).ok().and_then(Path::to_str)
                    && let Ok(file) = name.parse()
                {
                    drafts.push(file);
                }
            }
        }
        Ok(drafts)
    }
}

/// The digest of the file at `path`, as NATS writes it, and its size; `None` if there is none.
pub(crate) fn digest_of(path: &Path) -> Result<Option<(String, u64)>> {
    let context = || format!("cannot read {}", path.display());
    let mut file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error).with_context(context),
    };
    let (mut hash, mut buffer, mut size) = (Sha256::new(), vec![0; 1 << 16], 0);
    loop {
        let count = file.read(&mut buffer).with_context(context)?;
        if count == 0 {
            return Ok(Some((format!("SHA-256={}", URL_SAFE.encode(hash.finalize())), size)));
        }
        hash.update(&buffer[..count]);
        size += count as u64;
    }
}

fn make_folder_of(path: &Path) -> Result<()> {
    let Some(folder) = path.parent() else { return Ok(()) };
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))
}

/// Syncs the names of `path`, and of its folders below `top`, to the disk.
fn sync_folders(path: &Path, top: &Path) -> Result<()> {
    for folder in path.ancestors().skip(1).take_while(|folder| folder.starts_with(top)) {
        let context = || format!("cannot write {}", folder.display());
        File::open(folder).and_then(|folder| folder.sync_all()).with_context(context)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches two processes in one folder, a collector that forgets its name, a file that is replaced, and a draft that is not found.
    #[test]
    fn a_folder_is_filled_by_one_process_and_file_by_file() {
        let top = tempfile::tempdir().unwrap();
        let path = top.path().join("centre");
        let folder = Folder::open(&path, "host").unwrap();
        let name = folder.name.clone();
        assert!(Folder::open(&path, "host").unwrap_err().to_string().contains("another process collects"));
        drop(folder);
        let folder = Folder::open(&path, "other").unwrap();
        assert_eq!(folder.name, name);
        let file: CasingFile = "a/2026-11-25/A.h5".parse().unwrap();
        folder.begin(&file).unwrap().write_all(b"abc").unwrap();
        assert_eq!((folder.drafts().unwrap(), folder.place(&file).exists()), (vec![file.clone()], false));
        folder.put_in_place(&file).unwrap();
        // What `sha256sum` says of "abc", in base64.
        let digest = "SHA-256=ungWv48Bz-pBQUDeXa4iI7ADYaOWF3qctBD_YfIAFa0=".to_owned();
        assert_eq!(digest_of(&folder.place(&file)).unwrap(), Some((digest, 3)));
        assert!(folder.drafts().unwrap().is_empty());
        folder.begin(&file).unwrap().write_all(b"other").unwrap();
        assert!(folder.put_in_place(&file).is_err());
        assert_eq!(fs::read(folder.place(&file)).unwrap(), b"abc");
        folder.discard(&file);
        assert_eq!((digest_of(&folder.draft(&file)).unwrap(), folder.drafts().unwrap()), (None, Vec::new()));
    }
}
