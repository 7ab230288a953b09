//! A plan that grows while its casing is open: taps are added because of what other taps showed.

use std::collections::BTreeMap;

use tapline_wire::{Plan, PlannedTap, ScanState, TapState};

use crate::error::{Context as _, Error, Result};
use crate::format::layout::{DiscriminatorsRow, HeaderRow, LedgerRow, PlanRow, ReasonRow, ScanRow};
use crate::format::tap_rows::Growth;
use crate::write::Writer;
use crate::write::tap_state::Track;

impl Writer {
    /// Adds `taps` to the end of the plan. All of them are added or none; a crash does not undo it. A scan that had ended is open again.
    ///
    /// Waiting records are flushed first. Records made under the plan as it was before are still accepted.
    ///
    /// # Errors
    /// [`Error::CannotGrow`] if there is no room for so many, one of their scans is judged already, or they do not fit the plan;
    /// else as [`Writer::flush`]: then none is added, and after [`Writer::recover`] the call may be repeated.
    pub fn grow(&mut self, taps: &[PlannedTap]) -> Result<()> {
        if taps.is_empty() {
            return Ok(());
        }
        self.flush()?;
        self.check_file()?;
        let plan = self.grown(taps)?;
        let first = self.plan.taps().len();
        let scan_of_tap = plan.scan_of_tap();
        let is_touched = |scan: &usize| scan_of_tap[first..].contains(&(*scan as u32));
        let Some(archive) = &mut self.archive else { return Err(Error::Abandoned { path: self.path.clone() }) };
        // Taps of an ended scan are added: its row must say open before the new taps are in the plan.
        let mut scans = BTreeMap::new();
        for scan in (0..plan.scans().len()).filter(is_touched) {
            let open = ScanRow::open(&plan.scans()[scan], u32::try_from(archive.first_cell(scan)).unwrap_or(u32::MAX));
            scans.insert(scan as u32, open);
        }
        let rows = || first as u32..plan.taps().len() as u32;
        let growth = Growth { to: plan.taps().len() as u32, plan_digest: plan.digest() };
        let planned = |row: u32| PlanRow::new(&plan.taps()[row as usize], scan_of_tap[row as usize], growth);
        let written = (|| -> hdf5::Result<()> {
            // An earlier attempt that a crash undid may have left rows.
            archive.headers.write(&rows().map(|row| (row, HeaderRow::unwritten())).collect())?;
            archive.discriminators.write(&rows().map(|row| (row, DiscriminatorsRow::unwritten())).collect())?;
            archive.refusals.write(&rows().map(|row| (row, ReasonRow::none())).collect())?;
            archive.ledger.write(&rows().map(|row| (row, LedgerRow::new(TapState::Missing, 0))).collect())?;
            archive.scans.write(&scans)?;
            archive.flush()?;
            archive.plan_rows.write(&rows().map(|row| (row, planned(row))).collect())?;
            archive.flush()
        })();
        if let Err(error) = written.context("plan more taps", &self.path) {
            self.abandon();
            return Err(error);
        }
        archive.grow_to(plan.clone());
        self.tracks.resize(plan.taps().len(), Track::missing(0));
        self.ledger.grow(plan.taps().len(), plan.scans().len());
        for (&scan, row) in &scans {
            self.scans[scan as usize] = *row;
            self.ledger.set_scan(scan as usize, ScanState::Open);
        }
        self.plan = plan;
        Ok(())
    }

    /// How many taps may be added.
    pub fn room(&self) -> usize {
        if self.is_results { 0 } else { self.taps_max - self.plan.taps().len() }
    }

    /// The plan with `taps` added, if that is allowed.
    fn grown(&self, taps: &[PlannedTap]) -> Result<Plan> {
        let cannot = |what: String| Error::CannotGrow { path: self.path.clone(), what };
        let (count, taps_max) = (self.plan.taps().len() + taps.len(), self.taps_max);
        if self.is_results || count > taps_max {
            return Err(cannot(format!("it has room for {taps_max} taps, but would have {count}")));
        }
        let plan = self.plan.grown(taps).map_err(|error| cannot(error.to_string()))?;
        let scan_of_tap = plan.scan_of_tap();
        let judged = scan_of_tap[self.plan.taps().len()..].iter().find(|&&scan| self.is_judged(scan));
        match judged {
            Some(&scan) => {
                let scan = &plan.scans()[scan as usize];
                Err(cannot(format!("shoulder {} of {} is judged", scan.shoulder, scan.tyre)))
            }
            None => Ok(plan),
        }
    }
}
