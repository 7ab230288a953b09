//! Where an archive lies: whether the file that is being written is still there, and how it is put back when it is not.

use std::collections::BTreeMap;
use std::fs::{self, File, Metadata};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{FileExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

use rustix::fs::statvfs;

use crate::behind::{Behind, Failures};
use crate::chunk::{ChunkRows, read_handle};
use crate::context::Context;
use crate::draft::{Draft, folder_of, remove_dead_drafts};
use crate::{Error, Result};

/// Bytes that are copied at a time when a file is put back: a block of most file systems, so that holes stay holes.
const BLOCK_BYTES: usize = 4096;

/// The place of an archive that is being written.
#[derive(Debug)]
pub(crate) struct Place {
    path: PathBuf,
    /// To read only, and without a lock: it stands in nobody's way, and keeps a file that is removed from being lost.
    file: File,
    /// Bytes that the file had when it was written last.
    least_bytes: u64,
    keystone: Option<Keystone>,
    behind: Behind,
}

/// A byte of samples, not zero, behind which few others lie: a file that is cut and then written on, so that its length tells
/// nothing, has zero there, or something else.
#[derive(Debug)]
struct Keystone {
    row: u32,
    at: u64,
    byte: u8,
}

impl Keystone {
    /// That of `stored`, the samples of plan row `row`; `None` where they are all zeros.
    fn of(row: u32, stored: &[u8], samples: &ChunkRows) -> hdf5::Result<Option<Self>> {
        let Some(last) = stored.iter().rposition(|&byte| byte != 0) else { return Ok(None) };
        let span = samples.place(row)?;
        Ok(span.map(|span| Self { row, at: span.address + last as u64, byte: stored[last] }))
    }
}

impl Place {
    /// The place of `file`, which was opened at `path`.
    ///
    /// What failed behind the writer is told by `failures`, whatever becomes of the file.
    pub(crate) fn of(file: &hdf5::File, path: &Path, failures: &Failures) -> Result<Self> {
        let file = read_handle(file).context("open the archive", path)?;
        let behind = Behind::start(file.try_clone().context("open the archive", path)?, failures);
        let mut place = Self { path: path.to_owned(), file, least_bytes: 0, keystone: None, behind };
        place.least_bytes = place.held()?.len();
        Ok(place)
    }

    /// Notes that the samples of plan row `row` are about to be written again: the room of the old ones may be given to others.
    pub(crate) fn forget(&mut self, row: u32) {
        self.keystone.take_if(|keystone| keystone.row == row);
    }

    /// Notes that what the file holds now must not become less: `stored` are samples that were written to it, by plan row.
    pub(crate) fn note(&mut self, samples: &ChunkRows, stored: &BTreeMap<u32, Vec<u8>>) -> Result<()> {
        let mut keystone = self.keystone.take();
        // That of the last row was very likely written last, behind the others.
        if let Some((&row, stored)) = stored.last_key_value() {
            let other = Keystone::of(row, stored, samples).context("find samples", &self.path)?;
            keystone = keystone.into_iter().chain(other).max_by_key(|keystone| keystone.at);
        }
        self.keystone = keystone;
        let held = self.held()?;
        // The library itself makes the file shorter where the samples at its end give way to smaller ones. Whether it was cut
        // just now the keystone tells.
        self.least_bytes = held.len();
        self.check_whole(&held)
    }

    /// Checks that the file is still where it was opened, and as long.
    pub(crate) fn check(&self) -> Result<()> {
        let held = self.held()?;
        match fs::metadata(&self.path) {
            Ok(there) if is_same(&there, &held) => {}
            Ok(_) => return Err(Error::Replaced { path: self.path.clone(), now: self.now() }),
            Err(error) if error.kind() == ErrorKind::NotFound => return Err(self.gone(&held)),
            Err(error) => return Err(error).context("look for", &self.path),
        }
        self.check_whole(&held)
    }

    /// Checks that the file has what was in it.
    fn check_whole(&self, held: &Metadata) -> Result<()> {
        let must_end = self.keystone.as_ref().map_or(0, |keystone| keystone.at + 1);
        let (was, is) = (self.least_bytes.max(must_end), held.len());
        if is < was {
            return Err(Error::Cut { path: self.path.clone(), was, is });
        }
        let Some(Keystone { at, byte, .. }) = self.keystone else { return Ok(()) };
        let mut there = [0];
        // Nothing is read where it was cut this very moment.
        let count = self.file.read_at(&mut there, at).context("look for", &self.path)?;
        match (count, there) == (1, [byte]) {
            true => Ok(()),
            false => Err(Error::Overwritten { path: self.path.clone(), at }),
        }
    }

    /// Writes the file that was held to its path again, where it was removed and nothing else is there.
    pub(crate) fn put_back(&mut self) -> Result<()> {
        match self.check() {
            Err(Error::Removed { .. }) => {}
            checked => return checked,
        }
        remove_dead_drafts(&self.path);
        let draft = Draft::begin(&self.path).context("write the archive again", &self.path)?;
        copy_sparse(&self.file, draft.path()).context("write the archive again", &self.path)?;
        match draft.publish(&self.path) {
            // Whoever took the place meanwhile keeps it.
            Err(Error::Exists { .. }) => return self.check(),
            published => published?,
        }
        self.file = File::open(&self.path).context("open the archive", &self.path)?;
        Ok(())
    }

    /// Checks that the disk has room for `bytes` more, so that no attempt fills what little there is.
    pub(crate) fn check_room(&self, bytes: u64) -> Result<()> {
        let disk = statvfs(folder_of(&self.path)).map_err(io::Error::from).context("look for", &self.path)?;
        // A file system that does not count its blocks says that it has none.
        match disk.f_blocks > 0 && disk.f_bavail.saturating_mul(disk.f_frsize) < bytes {
            true => {
                Err(io::Error::from_raw_os_error(rustix::io::Errno::NOSPC.raw_os_error())).context("write", &self.path)
            }
            false => Ok(()),
        }
    }

    /// Has `bytes` that were handed to the system go to the disk meanwhile.
    pub(crate) fn note_written(&mut self, bytes: usize) {
        self.behind.note(bytes);
    }

    /// Waits until all that was written is on the disk, where a power cut cannot take it back.
    pub(crate) fn sync(&self) -> Result<()> {
        self.file.sync_all().context("sync", &self.path)
    }

    /// Ends the thread that writes behind: nothing more is written.
    pub(crate) fn rest(&mut self) {
        self.behind.rest();
    }

    fn held(&self) -> Result<Metadata> {
        self.file.metadata().context("look for", &self.path)
    }

    /// The error that nothing is at the path.
    fn gone(&self, held: &Metadata) -> Error {
        let path = self.path.clone();
        if held.nlink() == 0 { Error::Removed { path } } else { Error::Moved { path, now: self.now() } }
    }

    /// Where the file that was opened lies now, as the system says.
    fn now(&self) -> String {
        use std::os::fd::AsRawFd as _;
        let link = format!("/proc/self/fd/{}", self.file.as_raw_fd());
        fs::read_link(link).map_or_else(|_| "an unknown place".to_owned(), |path| path.display().to_string())
    }
}

fn is_same(a: &Metadata, b: &Metadata) -> bool {
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

/// Copies `from` to the file at `to`, leaving out blocks of zeros.
fn copy_sparse(from: &File, to: &Path) -> io::Result<()> {
    let to = File::options().write(true).open(to)?;
    let bytes = from.metadata()?.len();
    to.set_len(bytes)?;
    let mut block = [0; BLOCK_BYTES];
    let mut at = 0;
    while at < bytes {
        let count = from.read_at(&mut block, at)?;
        if count == 0 {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        if block[..count].iter().any(|&byte| byte != 0) {
            to.write_all_at(&block[..count], at)?;
        }
        at += count as u64;
    }
    to.sync_all()
}
