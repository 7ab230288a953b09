//! What says of a file that it is finished and that not everyone knows: it is written before the file gets its place, and
//! removed when everyone has been told, so that a `store` that is killed in between leaves no one waiting.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use tapline_wire::{CasingHeader, Stamp, casing_number};

use super::closer::Closed;
use super::open_casing::OpenCasing;
use super::places::{name_of_open, stem_of};
use super::{Result, RunError, StageLoop};
use crate::error::{Context as _, Error};
use crate::file::draft::rename_new;
use crate::read::reader::Reader;

/// Ending of a marker's name, which is else that of the file when it was under way.
const ENDING: &str = "closed";

/// What a marker says.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Marker {
    casing: u64,
    plan_digest: u64,
    station: u32,
    tap_count: u32,
    /// Where the file goes.
    path: PathBuf,
}

impl Marker {
    pub(super) fn new(header: &CasingHeader, path: &Path) -> Self {
        let &CasingHeader { stamp, plan_digest, station, tap_count, .. } = header;
        Self { casing: stamp.casing, plan_digest, station, tap_count, path: path.to_owned() }
    }

    /// Writes it beside the file under way, at `open`; where it lies then.
    pub(super) fn write(&self, open: &Path) -> Result<PathBuf> {
        let path = open.with_extension(ENDING);
        let text = serde_json::to_string(self).map_err(|error| Error::Io {
            action: "write",
            path: path.clone(),
            source: error.into(),
        })?;
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

/// Removes a marker of which everyone knows.
pub(super) fn remove(marker: &Path) {
    if let Err(error) = fs::remove_file(marker) {
        tracing::warn!(%error, "cannot remove {}; it is told again", marker.display());
    }
}

impl StageLoop<'_> {
    /// Has everyone be told of files that an earlier life of `store` has finished, and gives them their places.
    pub(super) fn take_up_finished(&mut self) -> Result<(), RunError> {
        let folder = self.run.places.open_folder();
        for entry in fs::read_dir(&folder).context("read", &folder)? {
            let marker = entry.context("read", &folder)?.path();
            if marker.extension().is_none_or(|ending| ending != ENDING) {
                continue;
            }
            let text = fs::read_to_string(&marker).context("read", &marker)?;
            let Ok(said) = serde_json::from_str::<Marker>(&text) else {
                // It was being written: the file has no place yet, and gets one with a new marker.
                remove(&marker);
                continue;
            };
            let open = marker.with_extension("h5");
            if open.exists() {
                self.name_finished(&open, said.path.clone())?;
            }
            self.note_closed(said.closed(marker));
        }
        Ok(())
    }

    /// Gives a file that is sealed, and has no marker, its place.
    pub(super) fn take_up_sealed(&mut self, open: &Path) -> Result<(), RunError> {
        let stem = stem_of(open);
        let path = self.run.places.finish(&name_of_open(&stem))?;
        let header = OpenCasing::header_of(casing_number(&stem), Reader::open(open)?.plan());
        let said = Marker::new(&header, &path);
        let marker = said.write(open)?;
        self.name_finished(open, path)?;
        self.note_closed(said.closed(marker));
        Ok(())
    }

    fn name_finished(&self, open: &Path, path: PathBuf) -> Result<(), RunError> {
        match rename_new(open, &path) {
            // A file system that names it twice may have been stopped in between.
            Err(Error::Exists { .. }) => {
                tracing::error!("{} is there already; {} stays where it is", path.display(), open.display());
                Ok(())
            }
            named => Ok(named?),
        }
    }

    pub(super) fn note_closed(&mut self, mut closed: Closed) {
        let station = u16::try_from(closed.header.station).unwrap_or(u16::MAX);
        closed.acquire = self.line.limits().acquire_of(station);
        self.outcome.closed_count += 1;
        self.notices.closed(closed);
    }
}
