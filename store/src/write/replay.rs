//! The discriminators of an archive, sent again to a stage that missed them.

use tapline_wire::{Discriminators, TapState};

use crate::error::{Context, Result};
use crate::format::fields::at_attempt;
use crate::write::Writer;

/// Rows that one call of [`Writer::settled_from`] looks at.
pub(crate) const REPLAY_ROWS_MAX: usize = 4096;

impl Writer {
    /// The discriminators of taps from plan row `from` on, for a stage that missed them: at most `most` records, and the row to
    /// continue from, `None` at the end of the plan.
    ///
    /// Records that wait for a flush or for their samples are included, and [`Discriminators::refused`] for each refused tap.
    /// A call covers a bounded number of rows, so it may return no record before the end.
    ///
    /// # Errors
    /// What the library returns.
    pub fn settled_from(&self, from: u32, most: usize) -> Result<(Vec<Discriminators>, Option<u32>)> {
        let taps = self.plan.taps();
        let first = (from as usize).min(taps.len());
        let last = (first + most.min(REPLAY_ROWS_MAX)).min(taps.len());
        let rows = self.open()?.discriminators.read(first..last).context("read discriminators", &self.path)?;
        let mut records = Vec::new();
        for (plan_index, row) in (from..).zip(rows) {
            let (track, planned) = (&self.tracks[plan_index as usize], &taps[plan_index as usize].id);
            let (state, attempt) = track.state();
            if state == TapState::Refused {
                records.push(Discriminators::refused(at_attempt(*planned, attempt), plan_index));
            } else if track.has_discriminators() {
                let row = self.pending.discriminators.get(&plan_index).copied().unwrap_or(row);
                records.push(row.to_discriminators(planned));
            }
        }
        Ok((records, u32::try_from(last).ok().filter(|_| last < taps.len())))
    }
}
