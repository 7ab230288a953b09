//! How a writer continues an archive: the state in which earlier writers left it.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

use tapline_codec::is_chunk_valid;
use tapline_wire::{Ledger, ScanState, TapState};

use crate::archive::ledger::tap_state;
use crate::archive::states::States;
use crate::archive::{Access, Archive};
use crate::error::{Context, Result};
use crate::format::checksum::ChecksummedRow as _;
use crate::format::layout::{LedgerRow, ScanRow};
use crate::format::lineage::Lineage;
use crate::format::scan_rows::fingerprint;
use crate::h5::extent::Extent;
use crate::write::Writer;
use crate::write::tap_state::{Track, Version};

impl Writer {
    /// Continues the archive at `path`, whose results must be computed by the same program and options and with the same
    /// reference as when it was begun. Its plan and its configuration are the archived ones.
    ///
    /// # Errors
    /// [`crate::Error::Finished`], [`crate::Error::NotHdf5`], [`crate::Error::NotAnArchive`], [`crate::Error::FormatVersion`],
    /// [`crate::Error::OtherReference`], [`crate::Error::OtherLineage`], [`crate::Error::OfflineCodec`],
    /// [`crate::Error::InUse`], [`crate::Error::Damaged`], or what the system returns.
    pub fn resume<'a>(path: impl AsRef<Path>, lineage: impl Into<Lineage<'a>>) -> Result<Self> {
        let archive = Archive::open(path.as_ref(), Access::Write)?;
        archive.check_lineage(lineage.into())?;
        Self::new(archive)
    }
}

/// The state of an archive that is resumed.
#[derive(Debug)]
pub(crate) struct ResumeState {
    pub tracks: Vec<Track>,
    pub scans: Vec<ScanRow>,
    /// For each judged scan, the fingerprint of its verdict and map.
    pub scan_fingerprints: Vec<Option<u64>>,
    pub ledger: Ledger,
    /// When its last tap was made, nanoseconds since the Unix epoch; 0 if there is none.
    pub last_tap_ns: i64,
    /// Rows that replace corrupt ones and are to be written.
    pub changed_taps: BTreeMap<u32, LedgerRow>,
    pub changed_scans: BTreeMap<u32, ScanRow>,
}

/// Loads the state of `archive`; the rows of a missing tap are ignored.
pub(crate) fn load_resume_state(archive: &Archive) -> Result<ResumeState> {
    let context = "read what is archived";
    let tap_count = archive.plan.taps().len();
    let mut samples = vec![Version { attempt: 0, fingerprint: 0 }; tap_count];
    let mut discriminators = samples.clone();
    let mut is_valid = vec![true; tap_count];
    let (mut checksums, mut last_tap_ns) = (vec![0; tap_count], 0);
    let headers = archive.headers.for_each(|k, row| {
        is_valid[k] &= row.is_valid(k);
        checksums[k] = row.stored_checksum;
        last_tap_ns = if row.is_valid(k) { last_tap_ns.max(row.tap_time_ns) } else { last_tap_ns };
        samples[k] = Version { attempt: row.attempt, fingerprint: row.fingerprint() };
    });
    headers.context(context, &archive.path)?;
    let found = archive.discriminators.for_each(|k, row| {
        is_valid[k] &= row.is_valid(k);
        discriminators[k] = Version { attempt: row.attempt, fingerprint: row.checksum };
    });
    found.context(context, &archive.path)?;
    // After a power cut, samples may be missing although their row is there.
    if !archive.is_results() {
        let file = File::open(&archive.path).context("open the samples", &archive.path)?;
        let locations = archive.samples.locations(&file).context("find samples", &archive.path)?;
        let ledger = archive.ledger.read_all().context(context, &archive.path)?;
        let mut chunk = Vec::new();
        for (k, location) in locations.into_iter().enumerate().take(tap_count) {
            let is_archived = ledger.get(k).is_some_and(|row| row.state() == Some(TapState::Archived));
            let mut is_intact = |location: Extent| {
                let is_read = location.read(&file, &mut chunk).is_ok();
                is_read && is_chunk_valid(archive.samples.codec(), &chunk, checksums[k])
            };
            is_valid[k] &= !is_archived || location.is_some_and(&mut is_intact);
        }
    }
    let states = States::load(archive, |k| !is_valid[k])?;
    // For only results, the samples are in another archive.
    let ledger_of_taps = match archive.is_results() {
        true => archive.ledger_of_taps().read_all().context(context, &archive.path)?,
        false => Vec::new(),
    };
    let mut tracks = Vec::with_capacity(tap_count);
    for (k, row) in states.taps.iter().enumerate() {
        let raw = ledger_of_taps.get(k);
        let of_raw = raw.map(|row| tap_state(&archive.path, k, row)).transpose()?;
        let track = match row.state().unwrap_or(TapState::Missing) {
            TapState::Missing if of_raw.is_some_and(|(state, _)| state == TapState::Archived) => {
                Track::recorded(samples[k])
            }
            TapState::Missing => Track::missing(row.attempt),
            TapState::Archived => Track::archived(samples[k], discriminators[k]),
            TapState::Refused => Track::refused(row.attempt),
        };
        let retaken = raw.filter(|raw| raw.is_valid(k)).unwrap_or(row);
        tracks.push(track.retaken_before(retaken.retaken_count, retaken.retaken_quality));
    }
    let mut scan_fingerprints = Vec::with_capacity(states.scans.len());
    for (k, row) in states.scans.iter().enumerate() {
        let is_judged = row.state() == Some(ScanState::Judged);
        let of_scan = if is_judged { archive.cells(k) } else { 0..0 };
        let cells = archive.damage.read(of_scan.clone()).context(context, &archive.path)?;
        scan_fingerprints.push(is_judged.then(|| fingerprint(k, *row, of_scan.start, &cells)));
    }
    let number = |k: &usize| u32::try_from(*k).unwrap_or(u32::MAX);
    Ok(ResumeState {
        tracks,
        scan_fingerprints,
        ledger: states.ledger(archive),
        last_tap_ns,
        changed_taps: states.changed_taps.iter().map(|k| (number(k), states.taps[*k])).collect(),
        changed_scans: states.changed_scans.iter().map(|k| (number(k), states.scans[*k])).collect(),
        scans: states.scans,
    })
}
