//! What the stations of a process send: proposals, taps, refusals and marks.

use std::borrow::Cow;

use tapline_wire::{
    Line, LineError, Loan, ProposalTopic, Publisher, REASON_BYTES_MAX, RecordKind, Stamp, TapHeader, TapTopic,
    WaitTopic, bytes_of_mut, cache_lines_for, encode_proposal, monotonic_ns,
};

use crate::stage::outcome::Outcome;
use crate::{Refusal, Source};

/// Longest report of what a station waits for, in bytes: the status of a line holds one for each station.
const WAIT_BYTES_MAX: usize = 256;

/// The topics on which the stations of the process send.
pub(crate) struct Outlet<'a> {
    pub(crate) line: &'a Line,
    taps: Publisher<'a, TapTopic>,
    proposals: Publisher<'a, ProposalTopic>,
    waits: Publisher<'a, WaitTopic>,
    retakes: u16,
    pub(crate) outcome: &'a mut Outcome,
}

impl<'a> Outlet<'a> {
    pub(crate) fn open(line: &'a Line, retakes: u16, outcome: &'a mut Outcome) -> Result<Self, LineError> {
        let (taps, proposals) = (Publisher::open(line)?, Publisher::open(line)?);
        Ok(Self { line, taps, proposals, waits: Publisher::open(line)?, retakes, outcome })
    }

    /// Sends the supervisor what `station` waits for ([`RecordKind::Data`]), or its fault, an alarm or a refusal, for people,
    /// without blocking; whether it was sent.
    pub(crate) fn report(&self, station: u16, kind: RecordKind, what: &str) -> Result<bool, LineError> {
        let bytes_max = if kind == RecordKind::Data { WAIT_BYTES_MAX } else { REASON_BYTES_MAX };
        let stamp = Stamp { mark: station.into(), ..Stamp::default() };
        self.waits.try_send(kind, stamp, cut(what, bytes_max).as_bytes())
    }

    /// Which limit of the line `source` exceeds, in words; `None` if it fits.
    pub(crate) fn exceeded_by(&self, source: &dyn Source) -> Option<String> {
        self.line.limits().casing.exceeded_by(source.plan(), source.about().room as usize)
    }

    /// Proposes the casing `name` at `station`.
    pub(crate) fn propose(&self, station: u16, name: &str, source: &dyn Source) -> Result<(), LineError> {
        let stamp = Stamp { mark: station.into(), ..Stamp::default() };
        let proposal = encode_proposal(name, &source.plan().begun(), source.about().room);
        self.proposals.send(RecordKind::Plan, stamp, &proposal)
    }

    /// Gives up the casing numbered `casing`: its missing taps will not come.
    pub(crate) fn give_up(&self, casing: u64, reason: &str) -> Result<(), LineError> {
        let stamp = Stamp { casing, ..Stamp::default() };
        self.proposals.send(RecordKind::Refusal, stamp, cut(reason, REASON_BYTES_MAX).as_bytes())
    }

    /// How often a tap of `source` may be taken again after this attempt.
    pub(crate) fn retakes_left(&self, source: &dyn Source, attempt: u16) -> u16 {
        if source.about().can_retake { self.retakes.saturating_sub(attempt) } else { 0 }
    }

    /// Sends attempt `attempt` at the tap in plan row `row`, rendered by `source`.
    pub(crate) fn take(
        &mut self,
        casing: u64,
        source: &mut dyn Source,
        row: u32,
        attempt: u16,
    ) -> Result<(), LineError> {
        let retakes_left = self.retakes_left(source, attempt);
        let mut loan = self.taps.loan(cache_lines_for(source.plan().recording.payload_bytes_max()))?;
        let rendered = loan.fill(|header, buffer| {
            let rendered = source.render(row, attempt, header, buffer);
            header.stamp.casing = casing;
            header.retakes_left = retakes_left.into();
            header.sent_ns = monotonic_ns();
            (rendered, *header)
        });
        match rendered {
            (Ok(()), header) => {
                loan.send(RecordKind::Data)?;
                self.outcome.sent_count += 1;
                self.outcome.sample_bytes += header.payload_bytes() as u64;
                Ok(())
            }
            (Err(refusal), header) => {
                drop(loan);
                self.refuse(&refusal, header)
            }
        }
    }

    /// Sends the refusal of the tap in plan row `row`.
    pub(crate) fn refuse_row(
        &self,
        casing: u64,
        source: &dyn Source,
        row: u32,
        attempt: u16,
        refusal: &Refusal,
    ) -> Result<(), LineError> {
        let Some(planned) = source.plan().taps().get(row as usize) else { return Ok(()) };
        let mut header = TapHeader { id: planned.id, plan_index: row, ..TapHeader::default() };
        header.stamp.casing = casing;
        header.id.attempt = attempt;
        header.source = source.about().kind.code();
        self.refuse(refusal, header)
    }

    fn refuse(&self, refusal: &Refusal, header: TapHeader) -> Result<(), LineError> {
        let text = refusal.to_string();
        let text = cut(&text, REASON_BYTES_MAX);
        let mut loan: Loan<'_, '_, TapTopic> = self.taps.loan(cache_lines_for(text.len()))?;
        loan.fill(|to, buffer| {
            *to = header;
            to.text_bytes = u32::try_from(text.len()).unwrap_or(0);
            bytes_of_mut(buffer)[..text.len()].copy_from_slice(text.as_bytes());
        });
        loan.send(RecordKind::Refusal)
    }

    /// Sends a mark of the casing numbered `casing` after its taps.
    pub(crate) fn mark(&self, casing: u64, kind: RecordKind, mark: u64) -> Result<(), LineError> {
        self.taps.send(kind, mark_header(casing, mark), &[])
    }

    /// As [`Outlet::mark`], without waiting; whether it was sent.
    pub(crate) fn try_mark(&self, casing: u64, kind: RecordKind, mark: u64) -> Result<bool, LineError> {
        self.taps.try_send(kind, mark_header(casing, mark), &[])
    }
}

fn mark_header(casing: u64, mark: u64) -> TapHeader {
    TapHeader { stamp: Stamp { casing, mark, ..Stamp::default() }, ..TapHeader::default() }
}

/// As much of `text` as fits; a cut text ends with an ellipsis.
fn cut(text: &str, bytes: usize) -> Cow<'_, str> {
    const MORE: &str = "…";
    match text.len() <= bytes {
        true => text.into(),
        false => format!("{}{MORE}", &text[..text.floor_char_boundary(bytes - MORE.len())]).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a text that does not fit, is cut within a character, or is cut without a sign of it.
    #[test]
    fn a_long_text_ends_with_an_ellipsis() {
        assert_eq!(cut("123456", 6), "123456");
        assert_eq!(cut("1234567", 6), "123…");
        assert_eq!(cut("12µ4567", 6), "12…");
    }
}
