//! Plans that grow while their casing is open, and several archives written at once.

use proptest::prelude::*;
use tapline_store::{Codec, Error, Lineage, PutOutcome, Reader, Writer, put_taps_of, repack, verify};
use tapline_wire::{Plan, PlannedTap, Purpose, SampleFormat, ScanState, TapState};

use crate::common::{CONFIG, bytes, discriminators, header, judgement, new_path, plan, put, put_all, samples};

/// A tap at location `location` of scan `scan` of `plan`, which has none there.
fn tap(plan: &Plan, scan: u32, location: u32, repetition: u16) -> PlannedTap {
    let mut tap = plan.taps()[plan.scans()[scan as usize].taps[0] as usize];
    (tap.id.location, tap.id.repetition, tap.purpose) = (location, repetition, Purpose::Suspect);
    tap
}

/// Catches an added tap that is not archived as others are, one that is lost with its writer, a map that lacks its location,
/// a record of before the growth that is refused, and room for taps that is taken for taps.
#[test]
fn what_is_added_is_as_what_was_planned() {
    for codec in [Codec::Lz4, Codec::None] {
        let ((_here, path), begun) = (new_path(), plan(SampleFormat::I16));
        let mut writer = Writer::create(&path, &begun, 16, Lineage { codec, ..CONFIG.into() }).unwrap();
        put(&mut writer, 0).unwrap();
        writer.end_scan(0).unwrap();
        let added = [tap(&begun, 0, 7, 0), tap(&begun, 0, 2, 1), tap(&begun, 1, 7, 0)];
        writer.grow(&added).unwrap();
        assert_eq!(writer.plan().taps()[10..], added);
        assert_eq!((writer.ledger().taps()[0], writer.ledger().scans()[0]), (TapState::Archived, ScanState::Open));
        drop(writer); // as a crash would
        let mut writer = Writer::resume(&path, CONFIG).unwrap();
        assert_eq!(writer.plan(), &begun.grown(&added).unwrap());
        let old = header(&begun, 1, 32);
        assert_eq!(writer.put_tap(&old, &samples(&old)).unwrap(), PutOutcome::Stored);
        writer.grow(&[tap(&begun, 1, 9, 0)]).unwrap();
        put_all(&mut writer).unwrap();
        let too_many = [tap(&begun, 0, 20, 0), tap(&begun, 0, 21, 0), tap(&begun, 0, 22, 0)];
        assert!(matches!(writer.grow(&too_many), Err(Error::CannotGrow { .. })), "no room");
        assert!(matches!(writer.grow(&too_many[..1]), Err(Error::CannotGrow { .. })), "it is judged");
        writer.finish().unwrap();
        assert!(verify(&path).unwrap().is_complete(), "{:?}", verify(&path).unwrap());
        let again = path.with_file_name("again.h5");
        repack(&path, &again, Codec::Gzip, |_part| ()).unwrap();
        let results = path.with_file_name("results.h5");
        let reader = Reader::open(&path).unwrap();
        let raw = (path.as_path(), reader.raw_digest().unwrap());
        let lineage = Lineage { made_by: "other", ..CONFIG.into() };
        Writer::results(&results, raw, reader.plan(), lineage).unwrap().finish().unwrap();
        assert_eq!(Reader::open(&results).unwrap().plan().taps(), reader.plan().taps());
        for path in [&path, &again] {
            assert!(verify(path).unwrap().is_complete());
            let reader = Reader::open(path).unwrap();
            let grown = reader.plan().clone();
            assert_eq!(grown.taps().len(), 14);
            assert_eq!((grown.begun_digest(), grown.added().len()), (begun.digest(), 4));
            assert!(grown.added().iter().all(PlannedTap::is_second_reading));
            for row in 0..14 {
                let (of_row, got) = reader.tap(row).unwrap().unwrap();
                assert_eq!(bytes(got.as_samples()), samples(&of_row));
                let found = reader.discriminators().unwrap()[row as usize].unwrap();
                assert_eq!(format!("{found:?}"), format!("{:?}", discriminators(&grown, row)));
            }
            for scan in 0..2 {
                let judged = reader.judgements().unwrap()[scan as usize].clone().unwrap();
                assert_eq!(format!("{judged:?}"), format!("{:?}", judgement(&grown, scan)));
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Catches a growth that survives a crash in part, or that destroys what was there: whichever of the pages that it
    /// changed have reached the file, all of it is planned or nothing.
    #[test]
    fn a_growth_is_complete_or_not_there(pages in prop::collection::vec(any::<bool>(), 64), page_bytes in prop::sample::select(vec![64_usize, 512, 4096])) {
        let ((_here, path), begun) = (new_path(), plan(SampleFormat::I16));
        let mut writer = Writer::create(&path, &begun, 16, CONFIG).unwrap();
        put(&mut writer, 3).unwrap();
        writer.flush().unwrap();
        let before = std::fs::read(&path).unwrap();
        writer.grow(&[tap(&begun, 0, 7, 0), tap(&begun, 1, 7, 0), tap(&begun, 1, 8, 0)]).unwrap();
        let after = std::fs::read(&path).unwrap();
        drop(writer);
        let mut mixed = before.clone();
        for (number, (to, from)) in mixed.chunks_mut(page_bytes).zip(after.chunks(page_bytes)).enumerate() {
            if pages[number % pages.len()] {
                let count = from.len().min(to.len());
                to[..count].copy_from_slice(&from[..count]);
            }
        }
        std::fs::write(&path, &mixed).unwrap();
        let mut writer = Writer::resume(&path, CONFIG).unwrap();
        prop_assert!([10, 13].contains(&writer.plan().taps().len()));
        prop_assert_eq!(writer.ledger().taps()[3], TapState::Archived);
        if writer.plan().taps().len() == 10 {
            writer.grow(&[tap(&begun, 1, 6, 0)]).unwrap();
        }
        put_all(&mut writer).unwrap();
        writer.finish().unwrap();
        let report = verify(&path).unwrap();
        prop_assert!(report.is_complete(), "{:?}", report);
    }
}

/// Catches taps that land in another archive than their own, and one archive that holds up the others.
#[test]
fn several_archives_take_their_own_taps() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let plans = [plan(SampleFormat::I16), plan(SampleFormat::F32)];
    let path = |k: usize| folder.path().join(format!("{k}/run.h5"));
    let mut writers: Vec<Writer> = (0..2)
        .map(|k| {
            std::fs::create_dir(folder.path().join(k.to_string())).unwrap();
            Writer::create(path(k), &plans[k], 0, CONFIG).unwrap()
        })
        .collect();
    let headers: Vec<_> = (0..20).map(|k| (k % 2, header(&plans[k % 2], k as u32 / 2, 32))).collect();
    let records: Vec<_> = headers.iter().map(|(_, header)| samples(header)).collect();
    let mut taps: Vec<_> =
        headers.iter().zip(&records).map(|((writer, header), samples)| (*writer, header, &samples[..])).collect();
    taps.push(taps[0]);
    let elsewhere = folder.path().join("elsewhere.h5");
    std::fs::rename(path(1), &elsewhere).unwrap();
    let mut all: Vec<&mut Writer> = writers.iter_mut().collect();
    let outcomes = put_taps_of(&mut all, &taps);
    for (k, outcome) in outcomes.iter().enumerate() {
        match k {
            20 => assert!(matches!(outcome, Ok(PutOutcome::AlreadyThere))),
            k if k % 2 == 0 => assert!(matches!(outcome, Ok(PutOutcome::Stored)), "{outcome:?}"),
            _ => assert!(outcome.as_ref().is_err_and(Error::is_recoverable), "{outcome:?}"),
        }
    }
    std::fs::rename(&elsewhere, path(1)).unwrap();
    writers[1].recover().unwrap();
    let mut all: Vec<&mut Writer> = writers.iter_mut().collect();
    assert!(put_taps_of(&mut all, &taps).into_iter().all(|outcome| outcome.is_ok()));
    for (k, mut writer) in writers.into_iter().enumerate() {
        put_all(&mut writer).unwrap();
        assert_eq!(writer.counts().conflicts, 0);
        writer.finish().unwrap();
        assert!(verify(path(k)).unwrap().is_complete());
    }
}
