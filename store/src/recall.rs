//! What earlier writers of an archive left, as a new one needs to know it.

use tapline_wire::{Ledger, ScanState, TapState};

use crate::Result;
use crate::archive::Archive;
use crate::error::Context;
use crate::layout::ScanRow;
use crate::reader::{scan_state, settled};
use crate::track::{Take, Track};

/// What is settled in an archive.
#[derive(Debug)]
pub(crate) struct Recalled {
    pub(crate) tracks: Vec<Track>,
    pub(crate) scans: Vec<ScanRow>,
    /// For each scan, the fingerprint of its verdict and map if it is judged.
    pub(crate) scan_fingerprints: Vec<Option<u64>>,
    pub(crate) ledger: Ledger,
}

/// Reads what is settled in `archive`; rows whose state says "missing" are as if they were not there.
pub(crate) fn recall(archive: &Archive) -> Result<Recalled> {
    let plan = &archive.plan;
    let mut ledger = Ledger::empty(plan.taps().len(), plan.scans().len(), plan.stations().len());
    let tracks = recall_taps(archive, &mut ledger)?;
    let scans = archive.scans.read_all().context("read the scans", &archive.path)?;
    let scan_fingerprints = recall_scans(archive, &scans, &mut ledger)?;
    Ok(Recalled { tracks, scans, scan_fingerprints, ledger })
}

fn recall_taps(archive: &Archive, ledger: &mut Ledger) -> Result<Vec<Track>> {
    let context = "read what is archived";
    let mut samples = vec![Take { attempt: 0, fingerprint: 0 }; archive.plan.taps().len()];
    let mut discriminators = samples.clone();
    archive
        .headers
        .for_each(|k, row| samples[k] = Take { attempt: row.attempt, fingerprint: row.fingerprint() })
        .context(context, &archive.path)?;
    archive
        .discriminators
        .for_each(|k, row| discriminators[k] = Take { attempt: row.attempt, fingerprint: row.fingerprint() })
        .context(context, &archive.path)?;
    // Of results alone the samples are there already.
    let are_there = match archive.is_results() {
        true => archive.raw_ledger().read_all().context(context, &archive.path)?,
        false => Vec::new(),
    };
    let mut tracks = Vec::with_capacity(samples.len());
    for (k, row) in archive.ledger.read_all().context(context, &archive.path)?.into_iter().enumerate() {
        let (state, attempt) = settled(archive, k, &row)?;
        ledger.set_tap(k, state, attempt);
        let track = match state {
            TapState::Missing => match are_there.get(k).map(|row| settled(archive, k, row)).transpose()? {
                Some((TapState::Archived, _)) => Track::recorded(samples[k]),
                _ => Track::missing(attempt),
            },
            TapState::Archived => Track::archived(samples[k], discriminators[k]),
            TapState::Refused => Track::refused(attempt),
        };
        tracks.push(track.retaken_before(row.retaken_count, row.retaken_quality));
    }
    Ok(tracks)
}

fn recall_scans(archive: &Archive, scans: &[ScanRow], ledger: &mut Ledger) -> Result<Vec<Option<u64>>> {
    let first_cells = archive.first_cells();
    let mut fingerprints = Vec::with_capacity(scans.len());
    for (k, row) in scans.iter().enumerate() {
        let state = scan_state(archive, k, row)?;
        ledger.set_scan(k, state);
        let is_judged = state == ScanState::Judged;
        let cells = if is_judged { first_cells[k]..first_cells[k + 1] } else { 0..0 };
        let cells = archive.damage.read(cells).context("read what is archived", &archive.path)?;
        fingerprints.push(is_judged.then(|| row.fingerprint(&cells)));
    }
    Ok(fingerprints)
}
