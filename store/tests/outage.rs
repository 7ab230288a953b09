//! A writer whose disk fails keeps what it was given and continues afterwards.

use std::fs;
use std::path::Path;

use tapline_store::{Codec, Lineage, Reader, Writer, verify};
use tapline_testing::disk::Disk;
use tapline_wire::Plan;

use crate::common::{CONFIG, begun, big_plan, bytes, header, put, put_all, samples};

/// The archive at `path` is complete and every sample in it is the one that was put.
fn assert_complete(path: &Path, plan: &Plan) {
    let report = verify(path).unwrap();
    assert!(report.is_complete() && report.problems.is_empty(), "{report:?}");
    let reader = Reader::open(path).unwrap();
    for row in 0..plan.taps().len() as u32 {
        let (tap, got) = reader.tap(row).unwrap().unwrap();
        assert_eq!(tap, header(plan, row, plan.recording.sample_count_max));
        assert!(bytes(got.as_samples()) == samples(&tap), "row {row}");
    }
}

/// Catches a tap that is lost or doubled, or a file that is damaged, when the disk fills at any place of a run: between flushes
/// of every length, and again and again.
#[test]
fn a_disk_that_fills_again_and_again() {
    let _guard = crate::common::alone();
    let plan = big_plan();
    for (codec, flush_every) in [(Codec::Lz4, 1), (Codec::Lz4, 7), (Codec::Zstd, 30), (Codec::None, 5)] {
        let folder = tempfile::tempdir().unwrap();
        let Some(disk) = Disk::at(&folder.path().join("disk"), "8m") else { return };
        let path = folder.path().join("disk/run.h5");
        let mut writer = Writer::create(&path, &plan, plan.taps().len(), Lineage { codec, ..CONFIG.into() }).unwrap();
        let mut ballast = disk.fill(60_000);
        let mut failure_count = 0;
        for row in 0..plan.taps().len() as u32 {
            let act = |writer: &mut Writer| {
                put(writer, row)?;
                if row % flush_every == 0 { writer.flush() } else { Ok(()) }
            };
            while let Err(error) = act(&mut writer) {
                assert!(error.is_disk_full() && error.to_string().contains("run.h5"), "{error}");
                failure_count += 1;
                assert!(writer.recover().is_err(), "the disk is full still");
                // Let go of, it opens for whoever looks at it, and has no problem but what is missing.
                assert_eq!(verify(&path).unwrap().problems, []);
                fs::remove_file(&ballast).unwrap();
                writer.recover().unwrap();
                ballast = disk.fill(60_000);
            }
        }
        fs::remove_file(&ballast).unwrap();
        put_all(&mut writer).unwrap();
        writer.finish().unwrap();
        assert!(failure_count > 3, "{codec}: {failure_count} failures prove little");
        assert_complete(&path, &plan);
    }
}

/// Catches what is lost with a file that is removed, moved or replaced, and a writer that does not notice it.
#[test]
fn a_file_that_is_not_where_it_was() {
    let _guard = crate::common::beside_others();
    let plan = big_plan();
    let folder = tempfile::tempdir().unwrap();
    let (place, path) = (folder.path().join("disk"), folder.path().join("disk/run.h5"));
    fs::create_dir(&place).unwrap();
    let mut writer = Writer::create(&path, &plan, plan.taps().len(), CONFIG).unwrap();
    let mut rows = 0..plan.taps().len() as u32;
    let mut put_some = |writer: &mut Writer| rows.by_ref().take(20).for_each(|row| put(writer, row).unwrap());

    put_some(&mut writer);
    writer.flush().unwrap();
    put_some(&mut writer);
    fs::remove_dir_all(&place).unwrap();
    for error in [writer.check_file().unwrap_err(), writer.recover().unwrap_err(), writer.flush().unwrap_err()] {
        assert!(error.is_recoverable() && error.to_string().contains("run.h5"), "{error}");
    }
    fs::create_dir(&place).unwrap();
    writer.recover().unwrap();

    put_some(&mut writer);
    let elsewhere = folder.path().join("elsewhere.h5");
    fs::rename(&path, &elsewhere).unwrap();
    let error = writer.flush().unwrap_err();
    assert!(error.to_string().contains("elsewhere.h5"), "{error}");
    fs::write(&path, "another").unwrap();
    let error = writer.recover().unwrap_err();
    assert!(error.to_string().contains("another file"), "{error}");
    fs::rename(&elsewhere, &path).unwrap();
    writer.recover().unwrap();

    put_all(&mut writer).unwrap();
    writer.finish().unwrap();
    assert_complete(&path, &plan);
    assert_eq!(fs::read_dir(&place).unwrap().count(), 1);
}

/// Catches an archive that is continued though it is not the one that was left: an older copy under the same number.
#[test]
fn an_older_copy_is_not_gone_on_with() {
    let (_here, path, _, mut writer) = begun(big_plan());
    let older = fs::read(&path).unwrap();
    (0..5).for_each(|row| put(&mut writer, row).unwrap());
    writer.flush().unwrap();
    fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(10).unwrap();
    let error = writer.check_file().unwrap_err();
    assert!(error.to_string().contains("was cut from") && !writer.is_in_place(), "{error}");
    fs::write(&path, older).unwrap();
    assert!(writer.recover().is_err());
}

/// Catches the writer that takes its own file for cut when the samples at its end give way to smaller ones.
#[test]
fn a_tap_at_the_end_may_become_smaller() {
    let (_here, _, plan, mut writer) = begun(big_plan());
    for (attempt, is_quiet) in [(0, false), (1, true), (2, false), (3, true)] {
        let mut header = header(&plan, 3, 4096);
        header.id.attempt = attempt;
        let samples = if is_quiet { vec![0; header.payload_bytes()] } else { samples(&header) };
        writer.put_tap(&header, &samples).unwrap();
        writer.flush().unwrap();
        writer.check_file().unwrap();
    }
}
