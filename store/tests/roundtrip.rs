//! What is put in comes out, once, in any order.

use std::path::{Path, PathBuf};

use tapline_store::{Codec, Lineage, OwnedSamples, PutOutcome, Reader, Writer};
use tapline_wire::{Ledger, Plan, Quality, SampleFormat, ScanState, TapState};

use crate::common::{
    CONFIG, begun, bytes, discriminators, finished, header, judgement, new_path, open_or_create, plan, put, put_all,
    samples,
};
use crate::places::{chunk_bytes, table_bytes};

/// Whether `reader` has what [`put_all`] puts.
pub(crate) fn everything_is_there(reader: &Reader, plan: &Plan) {
    let found = reader.discriminators().unwrap();
    let headers = reader.headers().unwrap();
    for row in 0..plan.taps().len() as u32 {
        let expected = header(plan, row, plan.recording.sample_count_max);
        let (got, got_samples) = reader.tap(row).unwrap().expect("the tap is archived");
        assert_eq!(got, expected);
        assert_eq!(headers[row as usize], Some(expected));
        assert_eq!(bytes(got_samples.as_samples()), samples(&expected));
        assert_eq!(format!("{:?}", found[row as usize].unwrap()), format!("{:?}", discriminators(plan, row)));
    }
    for (scan, judged) in (0..).zip(reader.judgements().unwrap()) {
        assert_eq!(format!("{:?}", judged.unwrap()), format!("{:?}", judgement(plan, scan)));
    }
}

/// Catches any bit that changes on its way, of either sample format.
#[test]
fn everything_comes_back_bit_for_bit() {
    for format in [SampleFormat::I16, SampleFormat::F32] {
        let (_here, path) = new_path();
        let plan = plan(format);
        finished(&path, &plan, CONFIG);
        let reader = Reader::open(&path).unwrap();
        assert_eq!(reader.plan(), &plan);
        assert_eq!(reader.truth(), plan.truth());
        assert_eq!(reader.config(), CONFIG);
        assert_eq!(reader.written_by().as_deref(), Some(env!("CARGO_PKG_VERSION")));
        assert!(reader.ledger().is_judged());
        everything_is_there(&reader, &plan);
    }
}

/// Catches short records whose channels run into each other, stale samples of a longer take, and an empty record.
#[test]
fn short_records_keep_their_channels_apart() {
    let (_here, path, plan, mut writer) = begun(plan(SampleFormat::I16));
    for (row, sample_count) in [(0, 32), (1, 5), (2, 0)] {
        let mut tap = header(&plan, row, sample_count);
        let mut payload = samples(&tap);
        payload.extend([0xee; 64]); // the rest of the last cache line is not the record's
        if row == 1 {
            let full = header(&plan, row, 32);
            assert_eq!(writer.put_tap(&full, &samples(&full)).unwrap(), PutOutcome::Stored);
            tap.id.attempt = 1;
        }
        writer.put_tap(&tap, &payload).unwrap();
        let mut found = discriminators(&plan, row);
        found.id.attempt = tap.id.attempt;
        writer.put_discriminators(&found).unwrap();
    }
    writer.finish().unwrap();

    let reader = Reader::open(&path).unwrap();
    let (tap, got) = reader.tap(1).unwrap().unwrap();
    assert_eq!((tap.id.attempt, tap.sample_count), (1, 5));
    assert_eq!(bytes(got.as_samples()), samples(&header(&plan, 1, 5)));
    assert_eq!(reader.tap(2).unwrap().unwrap().1, OwnedSamples::I16(vec![]));
    drop(reader);
    let file = hdf5::File::open(&path).unwrap();
    let row = file.dataset("taps/samples").unwrap().read_slice_2d::<i16, _>(ndarray::s![1, .., 5..]).unwrap();
    assert!(row.iter().all(|&sample| sample == 0), "padding is zero, not the longer take: {row}");
}

/// Catches content that depends on the order of arrival, on flushes, on resuming, or on when it was written.
#[test]
fn the_file_does_not_depend_on_the_order_of_arrival() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let [forward, backward] = forward_and_backward(&file("a.h5"), &file("b.h5"), Codec::None);
    assert!(std::fs::read(forward).unwrap() == std::fs::read(backward).unwrap(), "the files differ");

    // Packed chunks lie in the order in which they came; what lies in them, and the tables, are the same.
    let [forward, backward] = forward_and_backward(&file("c.h5"), &file("d.h5"), Codec::Lz4);
    let parts = |path: &Path| {
        let bytes = std::fs::read(path).unwrap();
        let file = hdf5::File::open(path).unwrap();
        let tables = ["plan", "taps/header", "discriminators", "ledger", "refusals", "scans", "damage", "truth"];
        let ranges = tables.map(|name| table_bytes(&file, name)).into_iter().chain(chunk_bytes(&file));
        ranges.map(|range| bytes[range].to_vec()).collect::<Vec<_>>()
    };
    assert!(parts(&forward) == parts(&backward), "the contents differ");
}

/// Two archives of the same run, packed with `codec`, whose records came in opposite orders.
fn forward_and_backward(forward: &Path, backward: &Path, codec: Codec) -> [PathBuf; 2] {
    let plan = plan(SampleFormat::I16);
    finished(forward, &plan, Lineage { codec, ..CONFIG.into() });

    let mut writer = Writer::create(backward, &plan, plan.taps().len(), Lineage { codec, ..CONFIG.into() }).unwrap();
    for row in (0..plan.taps().len() as u32).rev() {
        writer.put_discriminators(&discriminators(&plan, row)).unwrap();
        writer.flush().unwrap();
        if row == 6 {
            drop(writer);
            writer = Writer::resume(backward, CONFIG).unwrap();
            writer.put_discriminators(&discriminators(&plan, row)).unwrap();
        }
        let tap = header(&plan, row, 32);
        writer.put_tap(&tap, &samples(&tap)).unwrap();
    }
    drop(writer);
    let mut writer = open_or_create(backward, &plan, CONFIG).unwrap();
    put_all(&mut writer).unwrap();
    writer.finish().unwrap();
    [forward.to_owned(), backward.to_owned()]
}

/// Catches a duplicate that is taken for new, a different record that replaces a settled one, before and after resuming.
#[test]
fn what_is_settled_stays() {
    let (_here, path, plan, mut writer) = begun(plan(SampleFormat::I16));
    put_all(&mut writer).unwrap();
    assert_eq!(writer.counts().already_there, 0);
    for life in 0..2 {
        let before = writer.counts();
        put_all(&mut writer).unwrap();
        assert_eq!(writer.counts().already_there - before.already_there, 2 * 10 + 2 * 2, "life {life}");
        let mut retake = header(&plan, 3, 32);
        retake.tap_time_ns += 1;
        assert_eq!(writer.put_tap(&retake, &samples(&retake)).unwrap(), PutOutcome::Conflict);
        let mut found = discriminators(&plan, 3);
        found.id.attempt = 1;
        assert_eq!(writer.put_discriminators(&found).unwrap(), PutOutcome::Conflict);
        assert_eq!(writer.put_refusal(3, &retake.id, "late").unwrap(), PutOutcome::Conflict);
        let (verdict, mut cells) = judgement(&plan, 0);
        cells[2].damage_index += 1.0;
        assert_eq!(writer.put_judgement(0, &verdict, &cells).unwrap(), PutOutcome::Conflict);
        assert_eq!(writer.counts().conflicts - before.conflicts, 4);
        writer.suspend().unwrap();
        everything_is_there(&Reader::open_unfinished(&path).unwrap(), &plan);
        writer = Writer::resume(&path, CONFIG).unwrap();
        assert_eq!(writer.ledger().count(TapState::Archived), 10);
    }
}

/// Catches a tap counted before it is flushed, with one half, or with halves of two attempts.
#[test]
fn the_ledger_vouches_for_whole_flushed_taps_only() {
    let (_here, path, plan, mut writer) = begun(plan(SampleFormat::I16));
    let tap = header(&plan, 0, 32);
    writer.put_tap(&tap, &samples(&tap)).unwrap();
    writer.flush().unwrap();
    let mut late = discriminators(&plan, 0);
    late.id.attempt = 1;
    writer.put_discriminators(&late).unwrap();
    writer.flush().unwrap();
    assert_eq!(writer.ledger(), &Ledger::empty(10, 2));
    writer.put_discriminators(&discriminators(&plan, 0)).unwrap();
    assert_eq!(writer.ledger().taps()[0], TapState::Missing);
    writer.flush().unwrap();
    assert_eq!(writer.ledger().taps()[0], TapState::Archived);

    writer.end_scan(1).unwrap();
    put(&mut writer, 1).unwrap();
    drop(writer); // as a crash would: neither is flushed
    let reader = Reader::open_unfinished(&path).unwrap();
    assert_eq!(reader.ledger().taps()[..2], [TapState::Archived, TapState::Missing]);
    assert_eq!(reader.ledger().scans(), [ScanState::Open; 2]);
    assert!(reader.tap(1).unwrap().is_none());
    assert!(reader.tap(99).unwrap().is_none());
    assert!(reader.discriminators().unwrap()[1].is_none());
}

/// Catches a record of no use that is archived, an attempt that a new writer forgets, word of an old attempt that
/// undoes a newer one, and a settled tap that is opened again.
#[test]
fn a_tap_that_is_taken_again_is_archived_as_its_last_attempt() {
    let (_here, path, plan, mut writer) = begun(plan(SampleFormat::I16));
    let at = |attempt| {
        let (mut tap, mut found) = (header(&plan, 0, 32), discriminators(&plan, 0));
        (tap.id.attempt, found.id.attempt) = (attempt, attempt);
        (tap, found)
    };
    let (tap, found) = at(0);
    writer.put_tap(&tap, &samples(&tap)).unwrap();
    assert_eq!(writer.put_retake(0, &found.id, Quality::CLIPPED).unwrap(), PutOutcome::Stored);
    assert_eq!(writer.put_retake(0, &found.id, Quality::CLIPPED).unwrap(), PutOutcome::AlreadyThere);
    assert_eq!(writer.ledger().attempt(0), 0, "before the flush nobody may count on it");
    writer.flush().unwrap();
    drop(writer);

    let mut writer = Writer::resume(&path, CONFIG).unwrap();
    assert_eq!((writer.ledger().taps()[0], writer.ledger().attempt(0)), (TapState::Missing, 1));
    assert_eq!(writer.put_retake(0, &found.id, Quality::CLIPPED).unwrap(), PutOutcome::AlreadyThere);
    let (tap, found) = at(1);
    writer.put_tap(&tap, &samples(&tap)).unwrap();
    writer.put_discriminators(&found).unwrap();
    assert_eq!(writer.put_retake(0, &at(1).1.id, Quality::CLIPPED).unwrap(), PutOutcome::AlreadyThere);
    writer.finish().unwrap();
    let reader = Reader::open(&path).unwrap();
    assert_eq!((reader.ledger().taps()[0], reader.attempt(0)), (TapState::Archived, Some(1)));
    assert_eq!(reader.tap(0).unwrap().unwrap().0.id.attempt, 1);
    assert_eq!(reader.discriminators().unwrap()[0].unwrap().id.attempt, 1);
}

/// Catches a reason that is lost, misattributed, or cut without a mark.
#[test]
fn refusals_say_why() {
    let (_here, path, plan, mut writer) = begun(plan(SampleFormat::F32));
    let mut id = plan.taps()[4].id;
    id.attempt = 2;
    let long = "\u{e9}".repeat(300);
    assert_eq!(writer.put_refusal(4, &id, "double bounce").unwrap(), PutOutcome::Stored);
    assert_eq!(writer.put_refusal(4, &id, "double bounce").unwrap(), PutOutcome::AlreadyThere);
    writer.put_refusal(7, &plan.taps()[7].id, &long).unwrap();
    let tap = header(&plan, 4, 32);
    assert_eq!(writer.put_tap(&tap, &samples(&tap)).unwrap(), PutOutcome::Conflict);
    writer.finish().unwrap();
    let refusals = Reader::open(&path).unwrap().refusals().unwrap();
    assert_eq!(refusals.iter().map(|r| r.plan_index).collect::<Vec<_>>(), [4, 7]);
    assert_eq!((refusals[0].id, refusals[0].reason.as_str()), (id, "double bounce"));
    assert!(refusals[1].reason.ends_with("\u{e9}\u{2026}") && refusals[1].reason.len() <= tapline_store::REASON_BYTES);
    assert_eq!(Reader::open(&path).unwrap().attempt(4), Some(2));
}

/// Catches a replay that leaves out what waits, what is refused or what an earlier writer archived, invents a row, or
/// does not come to its end.
#[test]
fn a_replay_has_all_that_is_known() {
    let (_here, path, plan, mut writer) = begun(plan(SampleFormat::I16));
    put(&mut writer, 1).unwrap();
    writer.put_refusal(2, &plan.taps()[2].id, "double bounce").unwrap();
    writer.suspend().unwrap();
    let mut writer = Writer::resume(&path, CONFIG).unwrap();
    put(&mut writer, 4).unwrap();
    writer.put_discriminators(&discriminators(&plan, 8)).unwrap(); // its samples are still under way
    for most in [1, 3, 100] {
        let (mut rows, mut next, mut calls) = (Vec::new(), Some(0), 0);
        while let Some(from) = next {
            let (records, then) = writer.settled_from(from, most).unwrap();
            assert!(records.len() <= most && calls < 20);
            rows.extend(records);
            (next, calls) = (then, calls + 1);
        }
        assert_eq!(rows.iter().map(|r| r.plan_index).collect::<Vec<_>>(), [1, 2, 4, 8]);
        assert_eq!(rows.iter().map(|r| r.quality.contains(Quality::REFUSED)).filter(|&r| r).count(), 1);
        for (k, row) in [(0, 1), (2, 4), (3, 8)] {
            assert_eq!(format!("{:?}", rows[k]), format!("{:?}", discriminators(&plan, row)));
        }
    }
    assert_eq!(writer.settled_from(99, 5).unwrap().1, None);
}
