//! Markers of finished files: a marker is written before the file is renamed, and removed when every other stage has been
//! notified. After a `store` that was killed in between, the next one notifies them, so that no stage waits for ever.

use std::path::{Path, PathBuf};
use std::{fs, io};

use serde::{Deserialize, Serialize};
use tapline_wire::{CasingHeader, Plan, Stamp, casing_number};

use super::open_casing::OpenCasing;
use super::places::{name_of_open, stem_of};
use super::unreported::Unreported;
use super::{Result, RunError, StageLoop};
use crate::error::{Context as _, Error};
use crate::file::draft::rename_new;

/// Extension of a marker, which otherwise has the name of the unfinished file.
const ENDING: &str = "closed";

/// A file that has its final name.
#[derive(Debug)]
pub(super) struct Closed {
    pub header: CasingHeader,
    /// Number of the `acquire` process whose casing it was.
    pub acquire: Option<u16>,
    pub path: PathBuf,
    /// Its marker.
    pub marker: PathBuf,
}

/// The contents of a marker.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Marker {
    casing: u64,
    plan_digest: u64,
    station: u32,
    tap_count: u32,
    /// Final path of the file.
    path: PathBuf,
}

impl Marker {
    pub(super) fn new(header: &CasingHeader, path: &Path) -> Self {
        let &CasingHeader { stamp, plan_digest, station, tap_count, .. } = header;
        Self { casing: stamp.casing, plan_digest, station, tap_count, path: path.to_owned() }
    }

    /// Writes it beside the unfinished file `open`; returns its path.
    pub(super) fn write(&self, open: &Path) -> Result<PathBuf> {
        let path = open.with_extension(ENDING);
        let text = serde_json::to_string(self).map_err(io::Error::from).context("write", &path)?;
        fs::write(&path, text).context("write", &path)?;
        Ok(path)
    }

    fn closed(self, marker: PathBuf) -> Closed {
        let header = CasingHeader {
            stamp: Stamp { casing: self.casing, ..Stamp::default() },
            plan_digest: self.plan_digest,
            station: self.station,
            tap_count: self.tap_count,
            ..CasingHeader::default()
        };
        Closed { header, acquire: None, path: self.path, marker }
    }
}

/// Removes a marker after every stage was notified.
pub(super) fn remove(marker: &Path) {
    if let Err(error) = fs::remove_file(marker) {
        tracing::warn!(%error, "cannot remove {}; its file will be reported again", marker.display());
    }
}

impl StageLoop<'_> {
    /// Renames the files that an earlier `store` finished, and notifies the other stages of them.
    pub(super) fn take_up_finished(&mut self) -> Result<(), RunError> {
        let folder = self.run.places.open_folder();
        for entry in fs::read_dir(&folder).context("read", &folder)? {
            let marker = entry.context("read", &folder)?.path();
            if marker.extension().is_none_or(|ending| ending != ENDING) {
                continue;
            }
            let text = fs::read(&marker).context("read", &marker)?;
            let Ok(contents) = serde_json::from_slice::<Marker>(&text) else {
                // Its writing was interrupted, so the file is not renamed yet; it gets a new marker.
                remove(&marker);
                continue;
            };
            let open = marker.with_extension("h5");
            let path = contents.path.clone();
            let closed = contents.closed(marker);
            if open.exists() {
                self.rename_finished(&open, &closed.header, path)?;
            }
            self.note_closed(closed);
        }
        Ok(())
    }

    /// Renames a sealed file without a marker.
    pub(super) fn take_up_sealed(&mut self, open: &Path, plan: &Plan) -> Result<(), RunError> {
        let stem = stem_of(open);
        let path = self.run.places.finish(&name_of_open(&stem))?;
        let header = OpenCasing::header_of(casing_number(&stem), plan);
        let contents = Marker::new(&header, &path);
        let marker = contents.write(open)?;
        self.rename_finished(open, &header, path)?;
        self.note_closed(contents.closed(marker));
        Ok(())
    }

    fn rename_finished(&self, open: &Path, header: &CasingHeader, path: PathBuf) -> Result<(), RunError> {
        if self.run.notes_unreported {
            // Its name shows that the file was not reported yet: a note that is there already is replaced.
            Unreported::new(header, &name_of_open(&stem_of(open)), &path, &self.run.places).write(&self.run.places)?;
        }
        match rename_new(open, &path) {
            // Without an atomic rename, a crash may have left both names.
            Err(Error::Exists { .. }) => {
                tracing::error!("{} already exists; {} stays where it is", path.display(), open.display());
                Ok(())
            }
            renamed => Ok(renamed?),
        }
    }

    pub(super) fn note_closed(&mut self, mut closed: Closed) {
        let station = u16::try_from(closed.header.station).unwrap_or(u16::MAX);
        closed.acquire = self.line.limits().acquire_of(station);
        self.notices.closed(closed);
    }
}
