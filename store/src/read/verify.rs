//! Checks whether an archive is complete and consistent.

use std::fmt;
use std::path::Path;

use tapline_wire::{Ledger, Plan, Quality, Reasons, ScanState, TapId, TapState, Verdict};

use crate::archive::ledger::tap_state;
use crate::archive::{Access, Archive};
use crate::error::{Context, Error, Result};
use crate::format::checksum::ChecksummedRow as _;
use crate::format::layout::{CellRow, DiscriminatorsRow, HeaderRow, LedgerRow, ScanRow};
use crate::format::lineage::digest_of;
use crate::h5::extent::Extent;
use crate::read::samples::{ReadBuffer, SampleFile, checked_header};

/// Something in an archive that is wrong.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Problem {
    /// A tap's rows are corrupt or contradict each other.
    Tap {
        /// Row of the tap in the scan plan.
        plan_index: u32,
        /// Name of the tap.
        id: TapId,
        /// What is wrong.
        what: String,
    },
    /// The stored key is not that of the results.
    Key {
        /// The stored key.
        stored: String,
        /// The key of the results.
        computed: String,
    },
    /// A scan's rows are corrupt or contradict each other or its taps.
    Scan {
        /// Number of the scan.
        scan: u32,
        /// What is wrong.
        what: String,
    },
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tap { plan_index, id, what } => write!(f, "plan row {plan_index} ({id}): {what}"),
            Self::Key { stored, computed } => {
                write!(f, "its lineage key is {stored:?}; that of its results is {computed}")
            }
            Self::Scan { scan, what } => write!(f, "scan {scan}: {what}"),
        }
    }
}

/// What [`verify`] found.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Digest of the scan plan.
    pub plan_digest: u64,
    /// State of every tap and scan; a corrupt one counts as missing or open.
    pub ledger: Ledger,
    /// Problems, those of taps first, in plan order.
    pub problems: Vec<Problem>,
    /// Whether the archive is finished and its seal valid.
    pub is_finished: bool,
}

impl Report {
    /// Whether the archive is finished and without problems, every planned tap settled and every scan judged.
    pub fn is_complete(&self) -> bool {
        let is_settled = self.ledger.count(TapState::Missing) == 0;
        self.is_finished && self.problems.is_empty() && is_settled && self.is_judged()
    }

    /// Whether every scan is judged.
    pub fn is_judged(&self) -> bool {
        self.ledger.is_judged()
    }
}

/// Checks the archive at `path`, finished or not. Missing taps and open scans are no problems, but the archive is not complete.
///
/// # Errors
/// As [`crate::Reader::open_unfinished`]: a file whose seal, plan or structure is damaged is not checked further.
pub fn verify(path: impl AsRef<Path>) -> Result<Report> {
    verify_with(path, |_part| ())
}

/// As [`verify`]; `on_part` is called before each tap with the part of the work that is done, from 0 to 1.
///
/// # Errors
/// As [`verify`].
pub fn verify_with(path: impl AsRef<Path>, on_part: impl FnMut(f64)) -> Result<Report> {
    verify_file(&Archive::open(path.as_ref(), Access::ReadUnfinished)?, on_part)
}

fn verify_file(archive: &Archive, mut on_part: impl FnMut(f64)) -> Result<Report> {
    let plan = &archive.plan;
    let mut report = Report {
        plan_digest: plan.digest(),
        ledger: Ledger::empty(plan.taps().len(), plan.scans().len()),
        problems: Vec::new(),
        is_finished: archive.is_finished,
    };
    let context = "read a table";
    let ledger = archive.ledger.read_all().context(context, &archive.path)?;
    let headers = archive.headers.read_all().context(context, &archive.path)?;
    let discriminators = archive.discriminators.read_all().context(context, &archive.path)?;
    let reasons = archive.refusals.read_all().context(context, &archive.path)?;
    let file = SampleFile::open(archive)?;
    let (mut buffer, locations) = (ReadBuffer::default(), file.locations()?);
    for (plan_index, tap) in (0..).zip(plan.taps()) {
        let k = plan_index as usize;
        on_part(f64::from(plan_index) / plan.taps().len() as f64);
        let mut complain = |what: String| report.problems.push(Problem::Tap { plan_index, id: tap.id, what });
        let rows = [
            ("ledger row", ledger[k].is_valid(k)),
            ("header", headers[k].is_valid(k)),
            ("discriminators row", discriminators[k].is_valid(k)),
            ("reason", reasons[k].is_valid(k)),
        ];
        for (half, _) in rows.into_iter().filter(|(_, is_valid)| !is_valid) {
            complain(format!("its {half} is not what was written: the checksum differs"));
        }
        // A corrupt row is reported above; for the other checks its tap is missing.
        let row = match ledger[k].is_valid(k) {
            true => ledger[k],
            false => tap_state(&archive.path, k, &ledger[k]).map(|(state, attempt)| LedgerRow::new(state, attempt))?,
        };
        match row.state() {
            None => complain(format!("its state is {}, which is unknown", row.state)),
            Some(state) => {
                report.ledger.set_tap(k, state, row.attempt);
                if state == TapState::Archived {
                    check_tap(plan, plan_index, &row, &headers[k], &discriminators[k], &mut complain);
                    if headers[k].is_valid(k)
                        && let Err(error) =
                            check_samples(&file, plan, plan_index, &headers[k], locations[k], &mut buffer)
                    {
                        complain(error);
                    }
                }
            }
        }
    }
    let scans = archive.scans.read_all().context(context, &archive.path)?;
    for (scan, row) in (0..).zip(&scans) {
        let k = scan as usize;
        let cells = archive.damage.read(archive.cells(k)).context(context, &archive.path)?;
        let mut complain = |what: String| report.problems.push(Problem::Scan { scan, what });
        if !row.is_valid(k) {
            complain("its row is not what was written: the checksum differs".to_owned());
        }
        for (number, _) in cells.iter().enumerate().filter(|(n, cell)| !cell.is_valid(archive.first_cell(k) + n)) {
            let location = plan.scans()[k].locations[number].0;
            complain(format!("the cell of location {location} is not what was written: the checksum differs"));
        }
        match row.state().filter(|_| row.is_valid(k)) {
            None if row.is_valid(k) => complain(format!("its state is {}, which is unknown", row.state)),
            None => {}
            Some(state) => {
                report.ledger.set_scan(k, state);
                check_planned(plan, k, row, archive.first_cell(k), &mut complain);
                if state == ScanState::Judged {
                    check_scan(plan, k, &report.ledger, row, &cells, &mut complain);
                }
            }
        }
    }
    let stored = archive.stored_key()?;
    // An archive whose scans were opened again has the key of its earlier results.
    if !stored.is_empty() && report.problems.is_empty() && report.is_judged() {
        let computed = archive.key()?;
        if stored != computed {
            report.problems.push(Problem::Key { stored, computed });
        }
    }
    Ok(report)
}

/// Reads all samples of `header` and checks them.
fn check_samples(
    file: &SampleFile,
    plan: &Plan,
    row: u32,
    header: &HeaderRow,
    location: Option<Extent>,
    buffer: &mut ReadBuffer,
) -> std::result::Result<(), String> {
    let checked = checked_header(Path::new(""), plan, row, *header).and_then(|of_row| {
        let samples = file.read(&of_row, header.stored_checksum, location, false, buffer)?;
        Ok(digest_of(samples.as_bytes()) == header.samples_digest)
    });
    match checked {
        Ok(true) => Ok(()),
        Ok(false) => Err("its samples are not those that were recorded: their digest differs".to_owned()),
        Err(Error::Damaged { what, .. }) => {
            Err(what.strip_prefix(&format!("plan row {row}: ")).map_or_else(|| what.clone(), str::to_owned))
        }
        Err(error) => Err(error.to_string()),
    }
}

fn check_tap(
    plan: &Plan,
    plan_index: u32,
    ledger: &LedgerRow,
    header: &HeaderRow,
    discriminators: &DiscriminatorsRow,
    complain: &mut impl FnMut(String),
) {
    for (half, named, attempt) in [
        ("header", header.plan_index, header.attempt),
        ("discriminators row", discriminators.plan_index, discriminators.attempt),
    ] {
        if named != plan_index {
            complain(format!("it is archived, but its {half} names plan row {named}"));
        } else if attempt != ledger.attempt {
            complain(format!("the ledger has attempt {}, its {half} attempt {attempt}", ledger.attempt));
        }
    }
    let recording = &plan.recording;
    let channel_count = u32::try_from(recording.channels.len()).unwrap_or(u32::MAX);
    for (what, stored, planned) in [
        ("sample rate", header.sample_rate_hz, recording.sample_rate_hz),
        ("pre-trigger", f64::from(header.pre_trigger_samples), f64::from(recording.pre_trigger_samples)),
        ("channel count", f64::from(header.channel_count), f64::from(channel_count)),
    ] {
        if stored.to_bits() != planned.to_bits() {
            complain(format!("its header has {what} {stored}; {planned} is planned"));
        }
    }
    let scales = header.unit_per_count.iter().take(recording.channels.len());
    if let Some(scale) = scales.copied().find(|scale| !scale.is_finite() || *scale == 0.0) {
        complain(format!("its header has a scale of {scale} per count"));
    }
    let quality = Quality::from_bits_retain(discriminators.quality);
    if quality.contains(Quality::REFUSED) {
        complain("it is archived, but its discriminators say that it was refused".to_owned());
    }
    if quality.contains(Quality::RETAKE) {
        complain("it is archived, but its discriminators ask for another attempt".to_owned());
    }
    if quality.is_empty() && discriminators.values.into_iter().any(f64::is_nan) {
        complain("a discriminator is absent, but no flag says why".to_owned());
    }
    let most = recording.sample_count_max;
    if header.sample_count > most {
        complain(format!("its header says {} samples; at most {most} are planned", header.sample_count));
    }
    if let Some(value) = discriminators.values.into_iter().find(|v| v.is_infinite()) {
        complain(format!("a discriminator is {value}, neither a number nor absent"));
    }
}

/// Checks a scan's row against the plan, in any state.
fn check_planned(plan: &Plan, number: usize, row: &ScanRow, first_cell: usize, complain: &mut impl FnMut(String)) {
    let scan = &plan.scans()[number];
    if row.tyre.as_bytes() != scan.tyre.as_str().as_bytes() {
        let named = String::from_utf8_lossy(row.tyre.as_bytes());
        complain(format!("its row is of tyre {named:?}; {:?} is planned", scan.tyre.as_str()));
    }
    for (what, stored, planned) in [
        ("station", row.station.into(), scan.station.into()),
        ("shoulder", row.shoulder.into(), scan.shoulder.into()),
        ("first cell", row.first_cell as usize, first_cell),
    ] {
        if stored != planned {
            complain(format!("its row has {what} {stored}; {planned} is planned"));
        }
    }
}

fn check_scan(
    plan: &Plan,
    number: usize,
    ledger: &Ledger,
    row: &ScanRow,
    cells: &[CellRow],
    complain: &mut impl FnMut(String),
) {
    let scan = &plan.scans()[number];
    if Verdict::from_code(row.verdict).is_none() {
        complain(format!("it is judged, but its verdict is {}, which is unknown", row.verdict));
    }
    let reasons = Reasons::from_bits_retain(row.reasons);
    if row.verdict == Verdict::Pass.code() && !Reasons::REMARKS.contains(reasons) {
        complain(format!("its verdict is PASS in spite of {reasons}"));
    }
    let has_regions = cells.iter().any(|cell| cell.region != 0);
    if has_regions != (reasons.contains(Reasons::DAMAGE) || reasons.contains(Reasons::SUSPECT)) {
        complain(format!(
            "its reasons are {reasons:?}, but its map has {}",
            if has_regions { "regions" } else { "no region" }
        ));
    }
    if row.cell_count as usize != cells.len() {
        complain(format!("it says {} cells; {} locations are planned", row.cell_count, cells.len()));
    }
    for (cell, &(location, _)) in cells.iter().zip(&scan.locations) {
        if cell.scan as usize != number || cell.location != location {
            let (of, at) = (cell.scan, cell.location);
            complain(format!("the cell of location {location} is of scan {of}, location {at}"));
        }
    }
    let count = |state| scan.taps.iter().filter(|&&tap| ledger.taps()[tap as usize] == state).count();
    for (what, stored, counted) in [
        ("planned", row.planned_count, scan.taps.len()),
        ("received", row.received_count, count(TapState::Archived)),
        ("refused", row.refused_count, count(TapState::Refused)),
    ] {
        if stored as usize != counted {
            complain(format!("its judgement counts {stored} taps {what}; there are {counted}"));
        }
    }
}

#[cfg(test)]
#[path = "verify_tests.rs"]
mod tests;
