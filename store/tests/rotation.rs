//! A run that takes several files reads as one, whatever it went through.

use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use tapline_store::{
    Codec, Error, Lineage, Lost, Part, Reader, Result, RunWriter, StoreConfig, Writer, repack, verify,
};
use tapline_wire::{
    Channel, Geometry, Plan, PlannedTap, Recording, SampleFormat, ScanState, Serial, TapId, TapState, Truth,
};

use crate::common::{CONFIG, beside_others, discriminators, header, judgement, samples};
use crate::outage::Disk;
use crate::roundtrip::everything_is_there;

/// Some four scans fill a file.
const CONFIG_OF_STORE: StoreConfig = StoreConfig { codec: Codec::None, rotate_after_mb: 1, rotate_after_s: 0 };

const LINEAGE: Lineage<'_> =
    Lineage { config_toml: CONFIG, reference: None, codec: Codec::None, made_by: "", raw: None, part: None };

/// Two stations with six tyres of one shoulder each, 330 kB a scan where nothing packs it.
fn plan() -> Plan {
    let mut taps = Vec::new();
    for tyre in 0..12_u16 {
        for location in 0..5 {
            let serial = Serial::new(&format!("T{tyre}")).unwrap();
            let id = TapId::new(1 + tyre % 2, serial, 1, location).with_velocity_m_per_s(Some(1.85)).unwrap();
            taps.push(PlannedTap { id, angle_deg: Some(72.0 * f64::from(location)), is_closing: false });
        }
    }
    let recording = Recording {
        sample_rate_hz: 40960.0,
        pre_trigger_samples: 8,
        sample_count_max: 16384,
        sample_format: SampleFormat::I16,
        channels: vec![Channel::Force, Channel::Sound],
    };
    let truth: Truth = [((Serial::new("T7").unwrap(), 1, 2), true)].into_iter().collect();
    Plan::new(Geometry::Ring, recording, taps, truth).unwrap()
}

/// What a run consists of, in the order in which two stations give it.
#[derive(Debug, Clone, Copy)]
enum Step {
    Samples(u32),
    Found(u32),
    End(u32),
    Verdict(u32),
    Flush,
}

fn steps(plan: &Plan) -> Vec<Step> {
    let mut steps = Vec::new();
    let scans: Vec<u32> = (0..).zip(plan.scans()).map(|(scan, _)| scan).collect();
    for pair in scans.chunks(2) {
        for tap in 0..5 {
            for &scan in pair {
                let row = plan.scans()[scan as usize].taps[tap];
                steps.extend([Step::Samples(row), Step::Found(row)]);
            }
        }
        steps.push(Step::Flush);
        steps.extend(pair.iter().map(|&scan| Step::End(scan)));
        // The second station's verdict comes late, when others are begun.
        steps.push(Step::Verdict(pair[0]));
    }
    steps.extend(scans.chunks(2).map(|pair| Step::Verdict(pair[1])));
    steps
}

fn take(writer: &mut RunWriter, plan: &Plan, step: Step) -> Result<()> {
    match step {
        Step::Samples(row) => {
            let header = header(plan, row, plan.recording.sample_count_max);
            writer.put_taps(&[(&header, &samples(&header))])?;
        }
        Step::Found(row) => {
            writer.put_discriminators(&discriminators(plan, row))?;
        }
        Step::End(scan) => {
            writer.end_scan(scan)?;
        }
        Step::Verdict(scan) => {
            let (verdict, cells) = judgement(plan, scan);
            writer.put_judgement(scan, &verdict, &cells)?;
        }
        Step::Flush => writer.flush()?,
    }
    Ok(())
}

fn open(path: &Path, plan: &Plan) -> RunWriter {
    RunWriter::open_or_create(path, plan, LINEAGE, &CONFIG_OF_STORE).unwrap()
}

fn written(folder: &Path, plan: &Plan) -> PathBuf {
    let path = folder.join("run");
    let mut writer = open(&path, plan);
    steps(plan).into_iter().for_each(|step| take(&mut writer, plan, step).unwrap());
    writer.finish().unwrap();
    path
}

fn parts(path: &Path) -> Vec<PathBuf> {
    let mut parts: Vec<PathBuf> = fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()).collect();
    parts.sort();
    parts
}

/// Catches rows that land in another file's places, a file that is not whole by itself, and one that goes on growing.
#[test]
fn several_files_read_as_one() {
    let _guard = beside_others();
    let (folder, plan) = (tempfile::tempdir().unwrap(), plan());
    let path = written(folder.path(), &plan);
    let parts = parts(&path);
    let names: Vec<_> = parts.iter().map(|part| part.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, ["run.0001.h5", "run.0002.h5", "run.0003.h5"]);
    let reader = Reader::open(&path).unwrap();
    assert_eq!(reader.plan(), &plan);
    everything_is_there(&reader, &plan);
    assert!(verify(&path).unwrap().is_complete());
    let mut archived = 0;
    for part in &parts {
        let (report, reader) = (verify(part).unwrap(), Reader::open(part).unwrap());
        assert!(report.is_complete() && fs::metadata(part).unwrap().blocks() * 512 < 2_000_000, "{report:?}");
        archived += reader.ledger().count(TapState::Archived);
        assert_eq!(reader.ledger().count(TapState::Archived) % 5, 0, "scans are whole");
        assert!(
            reader.plan().truth().is_empty() == reader.plan().scans().iter().all(|scan| scan.tyre.as_str() != "T7")
        );
        let missing = (0..).zip(reader.ledger().taps()).filter(|(_, state)| **state == TapState::Missing);
        assert!(missing.map(|(row, _)| row).all(|row| reader.lost_at(row) == Some(Lost::LaterFile)));
    }
    assert_eq!(archived, plan.taps().len(), "each tap is in one file");
}

/// Catches a writer that dies anywhere and begins a scan twice, loses one, or leaves a file that none can go on with.
#[test]
fn a_run_is_gone_on_with_wherever_it_was_cut_off() {
    let _guard = beside_others();
    let plan = plan();
    let steps = steps(&plan);
    for every in [7, 13, 29, 50] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run");
        for end in (every..steps.len()).step_by(every).chain([steps.len()]) {
            let mut writer = open(&path, &plan);
            // What is settled already comes again, as from a source that was told late.
            for &step in &steps[..end] {
                take(&mut writer, &plan, step).unwrap();
            }
            assert_eq!(writer.counts().conflicts, 0);
            match end == steps.len() {
                true => writer.finish().unwrap(),
                false => drop(writer),
            }
        }
        let reader = Reader::open(&path).unwrap();
        everything_is_there(&reader, &plan);
        let report = verify(&path).unwrap();
        assert!(report.is_complete(), "{report:?}");
        assert!(parts(&path).iter().all(|part| verify(part).unwrap().is_complete()));
    }
}

/// Catches a file that stays open when its scans are done, and what is told again of scans in closed files.
#[test]
fn a_file_that_is_done_is_closed_and_still_tells() {
    let _guard = beside_others();
    let (folder, plan) = (tempfile::tempdir().unwrap(), plan());
    let path = folder.path().join("run");
    let mut writer = open(&path, &plan);
    steps(&plan).into_iter().for_each(|step| take(&mut writer, &plan, step).unwrap());
    writer.flush().unwrap();
    // Nobody has it open for writing: another program can.
    let first = &parts(&path)[0];
    assert!(fs::File::open(first).unwrap().try_lock().is_ok());
    assert!(verify(first).unwrap().is_complete());
    let mut again = Vec::new();
    let mut from = Some(0);
    while let Some(row) = from {
        let (records, next) = writer.settled_from(row, 7).unwrap();
        again.extend(records);
        from = next;
    }
    let expected: Vec<_> = (0..plan.taps().len() as u32).map(|row| discriminators(&plan, row)).collect();
    assert_eq!(format!("{again:?}"), format!("{expected:?}"));
    // A verdict that contradicts one in a closed file is told from one that comes again.
    let (verdict, mut cells) = judgement(&plan, 0);
    writer.put_judgement(0, &verdict, &cells).unwrap();
    assert_eq!(writer.counts().conflicts, 0);
    cells[0].guard = 9.0;
    writer.put_judgement(0, &verdict, &cells).unwrap();
    assert_eq!(writer.counts().conflicts, 1);
    writer.finish().unwrap();
}

/// Catches a file that is away, twice there, of another run or under another's number, and is passed over in silence.
#[test]
fn what_is_no_whole_run_is_told_by_name() {
    let _guard = beside_others();
    let (folder, plan) = (tempfile::tempdir().unwrap(), plan());
    let path = written(folder.path(), &plan);
    let [_, second, last] = &parts(&path)[..] else { panic!("three files") };
    let aside = folder.path().join("aside.h5");
    let refused = |words: &[&str]| {
        let error = Reader::open(&path).unwrap_err().to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
        assert!(verify(&path).is_err());
    };

    // Of a run there is no more than its folder has.
    let only = folder.path().join("only");
    fs::create_dir(&only).unwrap();
    fs::copy(&parts(&path)[0], only.join("only.0001.h5")).unwrap();
    assert!(!verify(&only).unwrap().is_complete() && verify(only.join("only.0001.h5")).unwrap().is_complete());

    fs::rename(last, &aside).unwrap();
    let report = verify(&path).unwrap();
    let there = report.ledger.count(TapState::Archived);
    assert!(!report.is_complete() && report.missing_count + there == plan.taps().len(), "{report:?}");
    assert!(report.missing_count > 0 && report.ledger.scans().contains(&ScanState::Open));
    fs::rename(&aside, last).unwrap();

    fs::rename(second, &aside).unwrap();
    refused(&["no file 2", "run.0003.h5"]);
    fs::rename(last, second).unwrap();
    refused(&["run.0002.h5", "says that it is file 3"]);
    fs::rename(second, last).unwrap();
    let other = written(&folder.path().join("other"), &plan.clone().with_source(5));
    fs::copy(&parts(&other)[1], second).unwrap();
    refused(&["run.0002.h5", "another run"]);
    fs::rename(&aside, second).unwrap();
    fs::copy(second, path.join("copy.0002.h5")).unwrap();
    refused(&["file 2 twice"]);
    fs::remove_file(path.join("copy.0002.h5")).unwrap();
    everything_is_there(&Reader::open(&path).unwrap(), &plan);

    let empty = folder.path().join("empty");
    fs::create_dir(&empty).unwrap();
    assert!(matches!(Reader::open(&empty), Err(Error::NotARun { .. })));
    let one_file = StoreConfig::default();
    let error = RunWriter::open_or_create(&path, &plan, CONFIG.into(), &one_file).unwrap_err();
    assert!(error.to_string().contains("rotate_after_mb"), "{error}");
    let error = RunWriter::open_or_create(second, &plan, CONFIG.into(), &CONFIG_OF_STORE).unwrap_err();
    assert!(error.to_string().contains("it is a file"), "{error}");
}

/// Catches a full disk on which the next file is not begun, and is forgotten or begun twice when there is room again.
#[test]
fn a_file_that_cannot_be_begun_is_begun_later() {
    let _guard = beside_others();
    let (Some(disk), plan) = (Disk::new(), plan()) else { return };
    let path = disk.path().join("run");
    let mut writer = open(&path, &plan);
    let steps = steps(&plan);
    let fourth = steps.iter().position(|step| matches!(step, Step::Samples(20))).unwrap();
    steps[..fourth].iter().for_each(|&step| take(&mut writer, &plan, step).unwrap());
    assert_eq!(parts(&path).len(), 1);
    let ballast = disk.fill(4096);
    for _ in 0..2 {
        let error = take(&mut writer, &plan, steps[fourth]).unwrap_err();
        assert!(error.is_of_the_disk() && error.is_no_room(), "{error}");
        assert!(writer.recover().unwrap_err().is_no_room());
    }
    fs::remove_file(ballast).unwrap();
    writer.recover().unwrap();
    steps[fourth..].iter().for_each(|&step| take(&mut writer, &plan, step).unwrap());
    writer.finish().unwrap();
    everything_is_there(&Reader::open(&path).unwrap(), &plan);
    assert!(verify(&path).unwrap().is_complete());
    assert_eq!(parts(&path).len(), 3);
}

/// Catches a file whose scans are all judged, and that is lost when it is removed before the run ends.
#[test]
fn a_file_that_is_used_up_is_put_back() {
    let _guard = beside_others();
    let (folder, plan) = (tempfile::tempdir().unwrap(), plan());
    let path = folder.path().join("run");
    let mut writer = open(&path, &plan);
    steps(&plan).into_iter().for_each(|step| take(&mut writer, &plan, step).unwrap());
    writer.flush().unwrap();
    let current = parts(&path).pop().unwrap();
    fs::remove_file(&current).unwrap();
    assert!(matches!(writer.check_place(), Err(Error::Removed { .. })));
    writer.recover().unwrap();
    assert!(current.is_file() && writer.is_in_place());
    writer.finish().unwrap();
    everything_is_there(&Reader::open(&path).unwrap(), &plan);
    assert!(verify(&path).unwrap().is_complete());
}

/// Catches a store that is started again and cannot open a closed file because someone reads it.
#[test]
fn a_closed_file_may_be_read_while_the_run_goes_on() {
    let _guard = beside_others();
    let (folder, plan) = (tempfile::tempdir().unwrap(), plan());
    let (path, steps) = (folder.path().join("run"), steps(&plan));
    let mut writer = open(&path, &plan);
    let (now, later) = steps.split_at(steps.len() - 9);
    now.iter().for_each(|&step| take(&mut writer, &plan, step).unwrap());
    [1, 3].into_iter().for_each(|scan| take(&mut writer, &plan, Step::Verdict(scan)).unwrap());
    writer.flush().unwrap();
    drop(writer);
    let reading = Reader::open(&parts(&path)[0]).unwrap();
    let mut writer = open(&path, &plan);
    now.iter().chain(later).for_each(|&step| take(&mut writer, &plan, step).unwrap());
    writer.finish().unwrap();
    drop(reading);
    everything_is_there(&Reader::open(&path).unwrap(), &plan);
}

/// Catches a number of a file that could be changed unseen.
#[test]
fn the_number_of_a_file_is_sealed() {
    let _guard = beside_others();
    let (folder, plan) = (tempfile::tempdir().unwrap(), plan());
    let path = folder.path().join("run.0001.h5");
    let part = Some(Part { number: 1, run_digest: plan.digest() });
    Writer::create(&path, &plan, Lineage { part, ..CONFIG.into() }).unwrap().finish().unwrap();
    for (name, bytes) in [("part", 2_u64), ("run_digest", 3)] {
        let copy = folder.path().join("copy.h5");
        fs::copy(&path, &copy).unwrap();
        let file = hdf5::File::open_rw(&copy).unwrap();
        let attribute = file.attr(name).unwrap();
        match name {
            "part" => attribute.write_scalar(&(bytes as u32)).unwrap(),
            _ => attribute.write_scalar(&bytes).unwrap(),
        }
        drop((attribute, file));
        assert!(matches!(Reader::open(&copy), Err(Error::Damaged { .. })), "{name}");
    }
}

/// Catches files of a run that no longer fit each other when they are packed anew, and results that do not fit their taps.
#[test]
fn a_run_of_several_files_is_packed_and_judged_again() {
    let _guard = beside_others();
    let (folder, plan) = (tempfile::tempdir().unwrap(), plan());
    let path = written(folder.path(), &plan);
    let packed = folder.path().join("packed");
    repack(&path, &packed, Codec::Zstd).unwrap();
    let (reader, repacked) = (Reader::open(&path).unwrap(), Reader::open(&packed).unwrap());
    everything_is_there(&repacked, &plan);
    assert!(verify(&packed).unwrap().is_complete());
    assert_eq!(reader.lineage_key().unwrap(), repacked.lineage_key().unwrap());

    let results = path.join("0123456789ab");
    for end in [20, plan.taps().len() as u32] {
        let lineage = Lineage { made_by: "other", ..CONFIG.into() };
        let mut writer = RunWriter::of_results(&results, &reader, lineage).unwrap();
        for row in 0..end {
            writer.put_discriminators(&discriminators(&plan, row)).unwrap();
        }
        if end > 20 {
            for scan in 0..plan.scans().len() as u32 {
                take(&mut writer, &plan, Step::End(scan)).unwrap();
                take(&mut writer, &plan, Step::Verdict(scan)).unwrap();
            }
        }
        writer.finish().unwrap();
    }
    let again = Reader::open(&results).unwrap();
    assert!(again.is_results() && again.raw_digest().unwrap() == reader.raw_digest().unwrap());
    everything_is_there(&again, &plan);
    let report = verify(&results).unwrap();
    assert!(report.is_complete(), "{report:?}");
    assert_ne!(again.lineage_key().unwrap(), reader.lineage_key().unwrap());

    // One of the files alone: its own scans are judged, and what it leaves to others is left to them.
    let first = Reader::open(&parts(&path)[1]).unwrap();
    let alone = path.join("alone.h5");
    let mut writer = RunWriter::of_results(&alone, &first, Lineage { made_by: "other", ..CONFIG.into() }).unwrap();
    let ours = first.plan();
    for (row, _) in (0..).zip(first.ledger().taps()).filter(|(_, state)| state.is_settled()) {
        writer.put_discriminators(&discriminators(ours, row)).unwrap();
    }
    for (scan, _) in (0..).zip(first.ledger().scans()).filter(|(_, state)| **state == ScanState::Judged) {
        take(&mut writer, ours, Step::End(scan)).unwrap();
        assert!(!writer.is_whole());
        take(&mut writer, ours, Step::Verdict(scan)).unwrap();
        writer.flush().unwrap();
    }
    assert!(writer.is_whole());
    writer.finish().unwrap();
    let report = verify(&alone).unwrap();
    assert!(report.is_complete() && report.missing_count < report.ledger.count(TapState::Missing), "{report:?}");
}
