//! `fuse` on a line: judges each shoulder of an open casing as soon as it can be judged.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tapline_wire::{
    AskTopic, CasingTopic, DamageCell, DamageTopic, Discriminators, Judgement, Ledger, Line, LineError, Plan,
    PlannedTap, Publisher, Quality, Reasons, Received, RecordKind, ScanState, SettledTopic, Stamp, Subscriber, Verdict,
    encode_taps,
};

use crate::fusion::{count, empty_cells};
use crate::{Error, Fusion};

/// Why `fuse` cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// A record does not fit the plan.
    #[error(transparent)]
    Fusion(#[from] Error),
    /// Shared memory fails.
    #[error(transparent)]
    Line(#[from] LineError),
}

/// What `fuse` did.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Discriminator records received, including repeats.
    pub record_count: u64,
    /// Verdicts reached.
    pub verdict_count: u64,
    /// Taps requested in addition to the planned ones.
    pub asked_count: u64,
    /// Records lost on the way here.
    pub lost_count: u64,
}

/// Turns the discriminators of casings on `line` into verdicts until asked to stop; `begin` makes the fusion of a casing's
/// plan.
///
/// # Errors
/// [`RunError`] when shared memory fails. Being asked to stop is no error. A casing that `begin` cannot judge is judged
/// RE-INSPECT.
pub fn run(line: &Line, begin: &dyn Fn(&Plan) -> Result<Fusion, Error>) -> Result<Outcome, RunError> {
    let mut stage = StageLoop {
        line,
        casings: Subscriber::open(line)?,
        settled: Subscriber::open(line)?,
        verdicts: Publisher::open(line)?,
        asks: Publisher::open(line)?,
        begin,
        open: Vec::new(),
        outcome: Outcome::default(),
    };
    match stage.serve() {
        Ok(()) | Err(RunError::Line(LineError::Stopped { .. })) => Ok(stage.into_outcome()),
        Err(error) => Err(error),
    }
}

struct StageLoop<'a> {
    line: &'a Line,
    casings: Subscriber<'a, CasingTopic>,
    settled: Subscriber<'a, SettledTopic>,
    verdicts: Publisher<'a, DamageTopic>,
    asks: Publisher<'a, AskTopic>,
    begin: &'a dyn Fn(&Plan) -> Result<Fusion, Error>,
    open: Vec<OpenCasing>,
    outcome: Outcome,
}

/// An open casing, as far as it is known here.
struct OpenCasing {
    number: u64,
    plan: Plan,
    /// How many taps may be added to the plan.
    room: usize,
    /// Whether taps were requested: the plan then comes again with them.
    has_asked: bool,
    /// `None` where it cannot be judged.
    fusion: Option<Fusion>,
    /// For a casing that cannot be judged: the rows that have come, and their flags.
    seen: BTreeMap<u32, Quality>,
    states: Vec<ScanState>,
    /// For each scan, whether its verdict was sent to the present `store`.
    is_judged: Vec<bool>,
}

impl OpenCasing {
    /// The additional taps that it needs, once all planned ones have come and before any of it is judged.
    fn wanted(&mut self) -> Result<Vec<PlannedTap>, Error> {
        let Some(fusion) = self.fusion.as_mut().filter(|_| self.room > 0) else { return Ok(Vec::new()) };
        let is_complete =
            (0..self.states.len()).all(|scan| self.states[scan] == ScanState::Ended && fusion.can_be_judged(scan));
        if !is_complete || self.is_judged.contains(&true) {
            return Ok(Vec::new());
        }
        fusion.wanted(0, self.room)
    }

    /// Whether the scan number `scan` of a casing that cannot be judged has ended, and every tap of it has come or was refused.
    fn has_come(&self, scan: usize) -> bool {
        let has_come = |row: &u32| self.seen.contains_key(row);
        self.states[scan] >= ScanState::Ended && self.plan.scans()[scan].taps.iter().all(has_come)
    }
}

impl StageLoop<'_> {
    fn serve(&mut self) -> Result<(), RunError> {
        loop {
            let mut is_idle = true;
            while let Some(record) = self.casings.receive()? {
                is_idle = false;
                self.note_casing(&record)?;
            }
            while let Some(record) = self.settled.receive()? {
                is_idle = false;
                self.push(&record)?;
            }
            self.judge()?;
            if is_idle && self.line.is_stopped() {
                return Ok(());
            }
            if is_idle {
                self.line.wait(Duration::MAX)?;
            }
        }
    }

    fn note_casing(&mut self, record: &Received<CasingTopic>) -> Result<(), RunError> {
        let number = record.header().stamp.casing;
        let place = self.open.iter().position(|casing| casing.number == number);
        match record.kind() {
            // It comes again when `store` was restarted or the plan has grown: the content of the archive then follows, and a
            // verdict rests only on that. A failed disk may have lost what was seen before.
            Some(RecordKind::Plan) => match Plan::decode(record) {
                Ok(plan) => {
                    drop(place.map(|place| self.open.swap_remove(place)));
                    let casing =
                        self.begin(number, plan, (record.header().room as usize).min(self.line.limits().casing.room));
                    self.open.push(casing);
                }
                Err(error) => tracing::error!(%error, number, "a casing's plan cannot be read; it is not judged"),
            },
            Some(RecordKind::Ledger) => {
                let Some((casing, ledger)) = place.zip(Ledger::decode(record.header(), record)) else { return Ok(()) };
                let casing = &mut self.open[casing];
                for (scan, &state) in ledger.scans().iter().enumerate().take(casing.states.len()) {
                    casing.states[scan] = state;
                    if let Some(fusion) = &mut casing.fusion
                        && state >= ScanState::Ended
                    {
                        fusion.end(scan)?;
                    }
                }
            }
            Some(RecordKind::Closed) => drop(place.map(|place| self.open.swap_remove(place))),
            _ => {}
        }
        Ok(())
    }

    fn begin(&self, number: u64, plan: Plan, room: usize) -> OpenCasing {
        let fusion = (self.begin)(&plan);
        let fusion = fusion.inspect_err(|error| {
            let tyre = plan.scans().first().map(|scan| scan.tyre.to_string()).unwrap_or_default();
            tracing::error!(%error, tyre, "a casing cannot be judged; its verdict is RE-INSPECT");
        });
        let scan_count = plan.scans().len();
        OpenCasing {
            number,
            plan,
            room,
            has_asked: false,
            fusion: fusion.ok(),
            seen: BTreeMap::new(),
            states: vec![ScanState::Open; scan_count],
            is_judged: vec![false; scan_count],
        }
    }

    /// Takes in discriminators that are safe in the archive.
    fn push(&mut self, record: &Received<SettledTopic>) -> Result<(), RunError> {
        let stamp = *record.header();
        let is_known =
            |casing: &OpenCasing| casing.number == stamp.casing && casing.plan.taps().len() as u64 == stamp.mark;
        // The plan was sent earlier, so it has arrived, even one that comes again and restarts the casing.
        while let Some(record) = self.casings.receive()? {
            self.note_casing(&record)?;
        }
        let Some(casing) = self.open.iter_mut().find(|casing| is_known(casing)) else { return Ok(()) };
        let records: &[Discriminators] = record;
        for record in records {
            match &mut casing.fusion {
                Some(fusion) => fusion.push(record)?,
                None => drop(casing.seen.insert(record.plan_index, record.quality)),
            }
            self.outcome.record_count += 1;
        }
        Ok(())
    }

    /// Sends the verdicts that can be reached and are not in the archive, or first requests the taps that they need.
    fn judge(&mut self) -> Result<(), RunError> {
        for casing in &mut self.open {
            if casing.has_asked {
                continue;
            }
            let wanted = casing.wanted()?;
            if !wanted.is_empty() {
                let stamp = Stamp { casing: casing.number, mark: casing.plan.taps().len() as u64, ..Stamp::default() };
                self.asks.send(RecordKind::Data, stamp, &encode_taps(&wanted))?;
                casing.has_asked = true;
                self.outcome.asked_count += wanted.len() as u64;
                continue;
            }
            let ready: Vec<usize> = match &casing.fusion {
                Some(fusion) => (0..casing.states.len()).filter(|&scan| fusion.can_be_judged(scan)).collect(),
                None => (0..casing.states.len()).filter(|&scan| casing.has_come(scan)).collect(),
            };
            for scan in ready {
                if casing.is_judged[scan] || casing.states[scan] == ScanState::Judged {
                    continue;
                }
                let (mut judgement, cells) = match &mut casing.fusion {
                    Some(fusion) => fusion.judge(scan)?,
                    None => unjudged(&casing.plan, &casing.seen, scan),
                };
                judgement.stamp = Stamp { casing: casing.number, mark: scan as u64, ..Stamp::default() };
                self.verdicts.send(RecordKind::Data, judgement, &cells)?;
                casing.is_judged[scan] = true;
                self.outcome.verdict_count += 1;
            }
        }
        Ok(())
    }

    fn into_outcome(self) -> Outcome {
        let lost_count = self.casings.lost() + self.settled.lost();
        Outcome { lost_count, ..self.outcome }
    }
}

/// The verdict on a scan that cannot be judged, for example because the reference has nothing in common with it.
fn unjudged(plan: &Plan, seen: &BTreeMap<u32, Quality>, scan: usize) -> (Judgement, Vec<DamageCell>) {
    let planned = &plan.scans()[scan];
    let qualities = || planned.taps.iter().filter_map(|row| seen.get(row).copied());
    let count_of = |is_refused: bool| {
        count(qualities().filter(|quality| quality.contains(Quality::REFUSED) == is_refused).count())
    };
    let mut reasons = Reasons::NOT_COMPARABLE;
    // What may explain it, for example channels that are swapped.
    if !Quality::on_most(qualities()).is_empty() {
        reasons.insert(Reasons::FLAGGED);
    }
    let judgement = Judgement {
        verdict: Verdict::ReInspect.code(),
        reasons,
        planned_count: count(planned.taps.len()),
        received_count: count_of(false),
        refused_count: count_of(true),
        ..Judgement::default()
    };
    (judgement, empty_cells(planned))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Casing;

    /// Catches a verdict that does not say what most taps of a shoulder have, which may be why it cannot be compared.
    #[test]
    fn flags_on_most_taps_are_a_reason_too() {
        let plan = Casing::default().plan();
        let reasons_of = |flagged: u32| {
            let quality = |row| if row < flagged { Quality::SWAPPED } else { Quality::default() };
            let seen = (0..10).map(|row| (row, quality(row))).collect();
            unjudged(&plan, &seen, 0).0.reasons
        };
        assert_eq!(reasons_of(6), Reasons::NOT_COMPARABLE | Reasons::FLAGGED);
        assert_eq!(reasons_of(5), Reasons::NOT_COMPARABLE);
    }
}
