//! What earlier writers of an archive left, as a new one needs to know it.

use std::collections::BTreeMap;

use tapline_wire::{Ledger, ScanState, TapState};

use crate::archive::Archive;
use crate::context::Context;
use crate::layout::{LedgerRow, ReasonRow, ScanRow, table};
use crate::reason::REASON_LOST;
use crate::sealed::SealedRow as _;
use crate::settled::{scan_state, settled, settled_raw};
use crate::track::{Take, Track};
use crate::{Lost, Result};

/// What is settled in an archive.
#[derive(Debug)]
pub(crate) struct Recalled {
    pub(crate) tracks: Vec<Track>,
    pub(crate) scans: Vec<ScanRow>,
    /// For each scan, the fingerprint of its verdict and map if it is judged.
    pub(crate) scan_fingerprints: Vec<Option<u64>>,
    pub(crate) ledger: Ledger,
    /// Rows of the ledger that were torn, as they are to be written again; what they said of retakes is lost.
    pub(crate) mended_taps: BTreeMap<u32, LedgerRow>,
    /// Rows of why taps were refused that were torn, as they are to be written again; what they said is lost.
    pub(crate) mended_reasons: BTreeMap<u32, ReasonRow>,
    /// Rows of scans that were torn, or judged from taps that are lost: of what they hold nothing is believed.
    pub(crate) mended_scans: BTreeMap<u32, ScanRow>,
}

/// Reads what is settled in `archive`; rows whose state says "missing" are as if they were not there.
pub(crate) fn recall(archive: &Archive) -> Result<Recalled> {
    let plan = &archive.plan;
    let mut ledger = Ledger::empty(plan.taps().len(), plan.scans().len(), plan.stations().len());
    let (mut mended_taps, mut mended_scans) = (BTreeMap::new(), BTreeMap::new());
    let tracks = recall_taps(archive, &mut ledger, &mut mended_taps)?;
    let mut scans = archive.scans.read_all().context("read the scans", &archive.path)?;
    let scan_fingerprints = recall_scans(archive, &mut scans, &mut ledger, &mended_taps, &mut mended_scans)?;
    let mut mended_reasons = BTreeMap::new();
    archive
        .refusals
        .for_each(|k, row| {
            if !row.is_whole(k) {
                let is_refused = ledger.taps()[k] == TapState::Refused;
                let mended = if is_refused { ReasonRow::new(REASON_LOST) } else { ReasonRow::none() };
                mended_reasons.insert(k as u32, mended);
            }
        })
        .context("read why taps were refused", &archive.path)?;
    Ok(Recalled { tracks, scans, scan_fingerprints, ledger, mended_taps, mended_reasons, mended_scans })
}

fn recall_taps(archive: &Archive, ledger: &mut Ledger, mended: &mut BTreeMap<u32, LedgerRow>) -> Result<Vec<Track>> {
    let context = "read what is archived";
    let mut samples = vec![Take { attempt: 0, fingerprint: 0 }; archive.plan.taps().len()];
    let mut discriminators = samples.clone();
    let (mut whole_headers, mut whole_found) = (vec![true; samples.len()], vec![true; samples.len()]);
    archive
        .headers
        .for_each(|k, row| {
            whole_headers[k] = row.is_whole(k);
            samples[k] = Take { attempt: row.attempt, fingerprint: row.fingerprint() };
        })
        .context(context, &archive.path)?;
    archive
        .discriminators
        .for_each(|k, row| {
            whole_found[k] = row.is_whole(k);
            discriminators[k] = Take { attempt: row.attempt, fingerprint: row.fingerprint() };
        })
        .context(context, &archive.path)?;
    // Of results alone the samples are there already.
    let are_there = match archive.is_results() {
        true => archive.of_taps().0.read_all().context(context, &archive.path)?,
        false => Vec::new(),
    };
    let mut tracks = Vec::with_capacity(samples.len());
    for (k, mut row) in archive.ledger.read_all().context(context, &archive.path)?.into_iter().enumerate() {
        let (state, attempt) = settled(archive, k, &row)?;
        let is_torn = !row.is_whole(k);
        if is_torn {
            row = LedgerRow::new(state, attempt);
        }
        ledger.set_tap(k, state, attempt);
        // What is vouched for was whole when it was: it was altered since, and nothing may be judged from it.
        if state == TapState::Archived
            && let Some((_, table)) = [(whole_headers[k], table::HEADER), (whole_found[k], table::DISCRIMINATORS)]
                .into_iter()
                .find(|(is, _)| !is)
        {
            let what = format!("row {k} of its table {table:?} is not what was written: its checksum differs");
            return Err(archive.damaged(what));
        }
        let raw = are_there.get(k);
        let (retaken_count, retaken_quality) = match raw {
            Some(raw) if !raw.is_whole(k) => (0, 0),
            raw => raw.map_or((row.retaken_count, row.retaken_quality), |raw| (raw.retaken_count, raw.retaken_quality)),
        };
        if is_torn {
            mended.insert(k as u32, LedgerRow { retaken_count, retaken_quality, ..row });
        }
        let track = match state {
            TapState::Missing => match raw.map(|row| settled_raw(archive, k, row)).transpose()? {
                Some((TapState::Archived, _)) => Track::recorded(samples[k]),
                _ => Track::missing(attempt),
            },
            TapState::Archived => Track::archived(samples[k], discriminators[k]),
            TapState::Refused => Track::refused(attempt),
        };
        let mut track = track.retaken_before(retaken_count, retaken_quality);
        if state == TapState::Missing && Lost::from_code(row.lost_at) == Some(Lost::LaterFile) {
            track.hand_over();
        }
        tracks.push(track);
    }
    Ok(tracks)
}

fn recall_scans(
    archive: &Archive,
    scans: &mut [ScanRow],
    ledger: &mut Ledger,
    mended_taps: &BTreeMap<u32, LedgerRow>,
    mended: &mut BTreeMap<u32, ScanRow>,
) -> Result<Vec<Option<u64>>> {
    let first_cells = archive.first_cells();
    let mut fingerprints = Vec::with_capacity(scans.len());
    for (k, row) in scans.iter_mut().enumerate() {
        let is_missing = |row: usize| ledger.taps()[row] == TapState::Missing;
        let is_lost = |row: usize| is_missing(row) && mended_taps.contains_key(&(row as u32));
        let state = scan_state(archive, k, row, is_missing, is_lost)?;
        ledger.set_scan(k, state);
        if !row.is_whole(k) || row.state() != Some(state) {
            let open = ScanRow::open(&archive.plan.scans()[k], first_cells[k] as u32);
            *row = ScanRow { state: state.code().into(), ..open };
            mended.insert(k as u32, *row);
        }
        let is_judged = state == ScanState::Judged;
        let cells = if is_judged { first_cells[k]..first_cells[k + 1] } else { 0..0 };
        let cells = archive.damage.read(cells).context("read what is archived", &archive.path)?;
        fingerprints.push(is_judged.then(|| row.fingerprint(&cells)));
    }
    Ok(fingerprints)
}
