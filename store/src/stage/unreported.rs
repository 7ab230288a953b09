//! Notes of casings whose verdict is still to be reported: each is on the disk before the casing's file gets its name,
//! and is removed once the verdict is reported. A line that is killed in between reports it after its next start.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use tapline_wire::{CasingHeader, now_ns};

use super::places::Places;
use crate::error::{Context as _, Result};
use crate::file::draft::sync_folder_of;

/// End of the name of a note that is being written.
const DRAFT: &str = "new";

/// A finished casing whose verdict is still to be reported.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Unreported {
    /// Number of the casing ([`tapline_wire::casing_number`]); no other casing has it.
    pub number: u64,
    /// Name of the casing.
    pub name: String,
    /// Station that tapped it.
    pub station: u16,
    /// When its file was finished, in ns since the Unix epoch.
    pub at_ns: i64,
    /// Its file, within the output folder.
    pub file: PathBuf,
}

impl Unreported {
    /// The note of the casing `name`, which is finished now; `path` is the final one of its file.
    pub(super) fn new(header: &CasingHeader, name: &str, path: &Path, places: &Places) -> Self {
        Self {
            number: header.stamp.casing,
            name: name.to_owned(),
            station: u16::try_from(header.station).unwrap_or(u16::MAX),
            at_ns: now_ns(),
            file: path.strip_prefix(places.out()).unwrap_or(path).to_owned(),
        }
    }

    /// Name of its file, and of the casing for those who receive it: no other casing has it.
    pub fn id(&self) -> String {
        casing_id(self.number)
    }

    /// Writes it; it survives a power cut.
    pub(super) fn write(&self, places: &Places) -> Result<()> {
        let folder = places.unreported_folder();
        // Somebody may have removed it.
        if !folder.exists() {
            fs::create_dir_all(&folder).context("create", &folder)?;
            sync_folder_of(&folder)?;
        }
        let path = folder.join(self.id());
        let draft = path.with_extension(DRAFT);
        let write = || -> io::Result<()> {
            let mut file = File::create(&draft)?;
            file.write_all(&serde_json::to_vec(self)?)?;
            file.sync_all()?;
            fs::rename(&draft, &path)
        };
        write().context("write", &path)?;
        sync_folder_of(&path)
    }

    /// Reads the note at `path`.
    ///
    /// # Errors
    /// What the system returns, or that it is no note.
    pub fn read(path: &Path) -> Result<Self> {
        let text = fs::read(path).context("read", path)?;
        serde_json::from_slice(&text).map_err(io::Error::from).context("read", path)
    }
}

/// Name of the note of the casing with this number.
pub fn casing_id(number: u64) -> String {
    format!("{number:016x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_was_removed_is_made_again() {
        // Catches stations that wait for ever for the verdict: no casing is finished without its note.
        let out = tempfile::tempdir().unwrap();
        let places = Places::new(out.path(), true);
        let note = Unreported { number: 7, name: "A".to_owned(), station: 1, at_ns: 2, file: "A.h5".into() };
        note.write(&places).unwrap();
        assert_eq!(Unreported::read(&places.unreported_folder().join(note.id())).unwrap(), note);
    }
}
