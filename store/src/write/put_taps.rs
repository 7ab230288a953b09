//! Puts taps of one writer or of several at once, packed in parallel.

use std::collections::BTreeSet;

use tapline_wire::TapHeader;

use crate::error::{Context as _, Error, Result};
use crate::format::layout::HeaderRow;
use crate::write::Writer;
use crate::write::check::{check_id, check_shape};
use crate::write::packer::{Shape, pack};
use crate::write::tap_state::{Half, PutOutcome, Version};

/// Number of the writer, header and samples of a tap.
type Tap<'a> = (usize, &'a TapHeader, &'a [u8]);

/// Puts taps of several archives as [`Writer::put_taps`] does, each by the writer whose number is given with it; returns the
/// outcome of each in their order.
///
/// An archive that cannot be written is abandoned: none of its taps is put, the outcome of each is an error, and after
/// [`Writer::recover`] they may be put again. The taps of the other archives are not affected.
///
/// # Panics
/// If there is no writer with a given number.
pub fn put_taps_of(writers: &mut [&mut Writer], taps: &[Tap<'_>]) -> Vec<Result<PutOutcome>> {
    let mut outcomes = Vec::with_capacity(taps.len());
    let mut remaining = taps;
    while !remaining.is_empty() {
        // The outcome of a tap that comes twice depends on its first time.
        let key = |tap: &Tap<'_>| (tap.0, tap.1.plan_index);
        let mut seen = BTreeSet::new();
        let first_again = remaining.iter().position(|tap| !seen.insert(key(tap)));
        let (now, later) = remaining.split_at(first_again.unwrap_or(remaining.len()));
        put_different(writers, now, &mut outcomes);
        remaining = later;
    }
    outcomes
}

/// A tap that is new to its archive.
struct New<'a> {
    writer: usize,
    row: HeaderRow,
    samples: &'a [u8],
}

/// Puts taps of different plan rows.
fn put_different(writers: &mut [&mut Writer], taps: &[Tap<'_>], outcomes: &mut Vec<Result<PutOutcome>>) {
    let (mut new, mut known) = (Vec::with_capacity(taps.len()), Vec::with_capacity(taps.len()));
    let mut failed: Vec<Option<Error>> = writers.iter().map(|_| None).collect();
    let mut is_failed = vec![false; writers.len()];
    for writer in taps.iter().map(|tap| tap.0).collect::<BTreeSet<_>>() {
        if let Err(error) = writers[writer].check_file() {
            (failed[writer], is_failed[writer]) = (Some(error), true);
        }
    }
    for &(writer, header, samples) in taps {
        known.push(writers[writer].outcome_of(header, samples));
        if let Some(Ok((row, PutOutcome::Stored))) = known.last().filter(|_| !is_failed[writer]) {
            new.push(New { writer, row: *row, samples: &samples[..header.payload_bytes()] });
        }
    }
    let records: Vec<(Shape, &[u8])> = new.iter().map(|tap| (writers[tap.writer].shape, tap.samples)).collect();
    let mut headers = Vec::with_capacity(new.len());
    let mut packed = pack(&records, |number, packed| {
        let tap = &new[number];
        let (samples_digest, stored_checksum) = (packed.samples_digest, packed.stored_checksum);
        headers.push(HeaderRow { samples_digest, stored_checksum, ..tap.row });
        if !is_failed[tap.writer]
            && let Err(error) = writers[tap.writer].write_samples(tap.row.plan_index, packed.stored(tap.samples))
        {
            (failed[tap.writer], is_failed[tap.writer]) = (Some(error), true);
        }
        Ok::<(), std::convert::Infallible>(())
    })
    .unwrap_or_else(|never| match never {});
    (0..writers.len()).filter(|&writer| is_failed[writer]).for_each(|writer| writers[writer].abandon());
    // All are written: only now they replace earlier attempts.
    for ((tap, header), packed) in new.iter().zip(headers).zip(&mut packed.0) {
        let writer = &mut writers[tap.writer];
        if !is_failed[tap.writer] {
            let stored = packed.take_bytes(tap.samples);
            writer.guard.note_written(stored.len());
            writer.pending.keep(header.plan_index, stored);
            writer.last_tap_ns = writer.last_tap_ns.max(header.tap_time_ns);
            writer.pending.headers.insert(header.plan_index, header);
            writer.accept(header.plan_index, Half::Samples, version_of(&header));
        }
    }
    drop(packed);
    for (&(writer, ..), known) in taps.iter().zip(known) {
        outcomes.push(match known {
            Err(error) => Err(error),
            Ok(_) if is_failed[writer] => {
                // The first outcome has the cause.
                Err(failed[writer].take().unwrap_or_else(|| Error::Abandoned { path: writers[writer].path.clone() }))
            }
            Ok((_, outcome)) => writers[writer].count(outcome),
        });
    }
}

fn version_of(row: &HeaderRow) -> Version {
    Version { attempt: row.attempt, fingerprint: row.fingerprint() }
}

impl Writer {
    /// Puts a tap, as [`Writer::put_taps`] does.
    ///
    /// # Errors
    /// As [`Writer::put_taps`].
    pub fn put_tap(&mut self, header: &TapHeader, samples: &[u8]) -> Result<PutOutcome> {
        Ok(self.put_taps(&[(header, samples)])?[0])
    }

    /// Puts taps: their samples are packed by as many threads as there are cores and written at once; their headers wait for the
    /// next flush.
    ///
    /// The samples of a tap are the `[channel][sample]` bytes that its header describes, in the machine's byte order; bytes
    /// behind them are ignored. A record that is shorter than the plan allows is padded with zeros. Samples are not compared
    /// with archived ones: the headers of two attempts differ.
    ///
    /// # Errors
    /// [`Error::NoSuchRow`], [`Error::OtherTap`], [`Error::RecordShape`], or what the system returns: the file is then abandoned,
    /// none of the taps is put, and after [`Writer::recover`] the call may be repeated.
    pub fn put_taps(&mut self, taps: &[(&TapHeader, &[u8])]) -> Result<Vec<PutOutcome>> {
        for (header, samples) in taps {
            self.outcome_of(header, samples)?;
        }
        let taps: Vec<Tap<'_>> = taps.iter().map(|&(header, samples)| (0, header, samples)).collect();
        put_taps_of(&mut [self], &taps).into_iter().collect()
    }

    /// The outcome that putting a tap will have, and its row.
    fn outcome_of(&self, header: &TapHeader, samples: &[u8]) -> Result<(HeaderRow, PutOutcome)> {
        if self.is_results {
            return Err(Error::ResultsAlone { path: self.path.clone() });
        }
        check_id(&self.plan, header.plan_index, &header.id)?;
        check_shape(&self.plan, header, samples)?;
        let row = HeaderRow::from(header);
        Ok((row, self.tracks[row.plan_index as usize].outcome(Half::Samples, version_of(&row))))
    }

    fn write_samples(&self, row: u32, stored: &[u8]) -> Result<()> {
        self.open()?.samples.write(row, stored).context("write samples", &self.path)
    }
}
