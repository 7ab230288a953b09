//! What is not the archive asked for is refused, with an error that says which file and why.

use std::fs;
use std::path::Path;
use std::time::SystemTime;

use tapline_store::{Error, Folder, Lineage, Reader, Writer, results_path};
use tapline_wire::{RecordKind, Recording, SampleFormat};

use crate::common::{
    CONFIG, begun, discriminators, finished, header, judgement, new_path, plan, plan_of, put, samples,
};

/// Catches an archive that is continued with other options, or refused for a remark, and one that is overwritten.
#[test]
fn another_run_is_refused_with_both_values() {
    let (_here, path) = new_path();
    let given = plan(SampleFormat::I16);
    finished(&path, &given, CONFIG);

    let open = path.with_file_name("open.h5");
    let of = |config: &'static str, made_by| Lineage { made_by, ..config.into() };
    let made_by = "process.f_c_hz = 550.0\nprocess.f_hi_hz = 2000.0";
    drop(Writer::create(&open, &given, 0, of(CONFIG, made_by)).unwrap());
    drop(Writer::resume(&open, of("# a remark, or another pace\n", made_by)).unwrap());
    for (made_by, archived, now) in [
        ("process.f_c_hz = 600.0\nprocess.f_hi_hz = 2000.0", "process.f_c_hz = 550.0", "process.f_c_hz = 600.0"),
        // An option that one program has and another has not.
        ("a.new = 1\nprocess.f_c_hz = 550.0\nprocess.f_hi_hz = 2000.0", "nothing", "a.new = 1"),
        ("process.f_hi_hz = 2000.0", "process.f_c_hz = 550.0", "nothing"),
    ] {
        let error = Writer::resume(&open, of(CONFIG, made_by)).unwrap_err();
        assert!(matches!(error, Error::OtherLineage { .. }), "{error}");
        assert!(error.to_string().contains(archived) && error.to_string().contains(now), "{error}");
    }

    let error = Writer::create(&path, &given, given.taps().len(), CONFIG).unwrap_err();
    assert!(matches!(error, Error::Exists { .. }), "{error}");
}

/// Catches two writers, or a reader beside a writer, within one process.
#[test]
fn a_second_writer_is_refused() {
    let (_here, path, _, writer) = begun(plan(SampleFormat::I16));
    for error in [Writer::resume(&path, CONFIG).unwrap_err(), Reader::open(&path).unwrap_err()] {
        assert!(matches!(error, Error::InUse { .. }), "{error}");
        assert!(error.to_string().contains("run.h5"), "{error}");
    }
    drop(writer);
    let first = Reader::open_unfinished(&path).unwrap();
    Reader::open_unfinished(&path).unwrap();
    assert!(matches!(Writer::resume(&path, CONFIG).unwrap_err(), Error::InUse { .. }));
    drop(first);
    Writer::resume(&path, CONFIG).unwrap();
}

/// Catches an error that does not name its file, or a panic, on files that are no archive.
#[test]
fn files_that_are_no_archive() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    fs::write(place("empty.h5"), "").unwrap();
    fs::write(place("text.h5"), "station,tyre,shoulder\n").unwrap();
    hdf5::File::create(place("other.h5")).unwrap();
    let open = |name: &str| {
        let error = Reader::open_unfinished(place(name)).unwrap_err();
        assert!(error.to_string().contains(name), "{error}");
        error
    };
    assert!(matches!(open("absent.h5"), Error::Io { .. }));
    assert!(matches!(open("empty.h5"), Error::NotHdf5 { .. }));
    assert!(matches!(open("text.h5"), Error::NotHdf5 { .. }));
    assert!(matches!(open("other.h5"), Error::NotAnArchive { .. }));
    let waited_for = Reader::open(place("other.h5")).unwrap_err();
    assert!(matches!(waited_for, Error::NotAnArchive { .. }), "of another program: {waited_for}");
}

/// Catches a panic on, or trust in, a file that was cut anywhere.
#[test]
fn a_cut_file_is_refused() {
    let (_here, path) = new_path();
    finished(&path, &plan(SampleFormat::I16), CONFIG);
    let whole = fs::read(&path).unwrap();
    let cut = path.with_file_name("cut.h5");
    for eighth in 0..8 {
        fs::write(&cut, &whole[..whole.len() * eighth / 8]).unwrap();
        let error = Reader::open(&cut).unwrap_err();
        assert!(error.to_string().contains("cut.h5"), "{error}");
    }
}

/// Catches an archive begun where it cannot be, and rubbish left behind by the attempt.
#[test]
fn places_that_cannot_be_written() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let given = plan(SampleFormat::I16);
    for place in [folder.path().join("absent/run.h5"), Path::new("/proc/run.h5").to_owned()] {
        let error = Writer::create(&place, &given, given.taps().len(), CONFIG).unwrap_err();
        assert!(matches!(error, Error::Io { .. }) && error.to_string().contains("run.h5"), "{error}");
    }
    let place = folder.path().join("run.h5");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "a failed creation leaves nothing");
    let silent = plan_of(Recording { sample_count_max: 0, ..given.recording });
    assert!(matches!(
        Writer::create(&place, &silent, silent.taps().len(), CONFIG).unwrap_err(),
        Error::EmptyRecording { .. }
    ));
    let long = plan_of(Recording { sample_count_max: 1 << 29, ..silent.recording });
    let error = Writer::create(&place, &long, long.taps().len(), CONFIG).unwrap_err();
    assert!(matches!(error, Error::LongRecording { bytes: 0x8000_0000, most: 0x4000_0000 }), "{error}");
    assert!(!place.exists());
}

/// Catches a record that would land in a row that is not its own, or read beyond its samples.
#[test]
fn records_that_do_not_belong_here() {
    let (_here, _, given, mut writer) = begun(plan(SampleFormat::I16));
    let good = header(&given, 2, 32);
    let payload = samples(&good);
    let mut bad = [good; 8];
    bad[0].plan_index = 10;
    bad[1].plan_index = 3;
    bad[2].stamp.kind = RecordKind::End.code();
    bad[3].sample_format = SampleFormat::F32.code();
    bad[4].channel_count = 1;
    bad[5].sample_count = 33;
    bad[6].channel_count = u32::MAX;
    bad[7].sample_rate_hz = f64::NAN;
    for header in bad {
        assert!(writer.put_tap(&header, &payload).is_err(), "{header:?}");
    }
    assert!(matches!(writer.put_tap(&good, &payload[1..]).unwrap_err(), Error::RecordShape { .. }));
    let mut lost = discriminators(&given, 2);
    lost.plan_index = u32::MAX;
    assert!(matches!(writer.put_discriminators(&lost).unwrap_err(), Error::NoSuchRow { tap_count: 10, .. }));
    assert!(matches!(writer.end_scan(2).unwrap_err(), Error::NoSuchScan { scan_count: 2, .. }));
    let (verdict, mut cells) = judgement(&given, 0);
    assert!(matches!(writer.put_judgement(0, &verdict, &cells[1..]).unwrap_err(), Error::OtherCells { .. }));
    cells.swap(0, 1);
    assert!(matches!(writer.put_judgement(0, &verdict, &cells).unwrap_err(), Error::OtherCells { .. }));
    assert_eq!(writer.counts(), tapline_store::PutCounts::default());
}

/// Catches results of a judgement that was stopped and that hide complete ones, and an archive that counts twice by a link to it.
#[test]
fn stopped_results_hide_no_others() {
    let (_here, path) = new_path();
    let given = plan(SampleFormat::I16);
    finished(&path, &given, CONFIG);
    let digest = Reader::open(&path).unwrap().raw_digest().unwrap();
    let begin = |archive: &Path, key: &str| {
        let results = results_path(archive, key);
        (Writer::results(&results, (archive, digest), &given, CONFIG.into()).unwrap(), results)
    };
    let newest = || Folder::list(path.parent().unwrap()).unwrap().sorted().newest_results();
    let (writer, stopped) = begin(&path, "bbbbbbbbbbbb");
    drop(writer);
    assert_eq!(newest(), [stopped]);
    let (writer, done) = begin(&path, "aaaaaaaaaaaa");
    writer.finish().unwrap();
    fs::File::options().write(true).open(&done).unwrap().set_modified(SystemTime::UNIX_EPOCH).unwrap();
    assert_eq!(newest(), [done]);
    // As a job of tapline-query leaves it.
    let job = path.with_file_name("run=0123456789abcdef");
    fs::create_dir(&job).unwrap();
    let link = job.join(path.file_name().unwrap());
    std::os::unix::fs::symlink(&path, &link).unwrap();
    let (writer, of_job) = begin(&link, "cccccccccccc");
    writer.finish().unwrap();
    assert_eq!(newest(), [of_job]);
}

/// Catches results that were given their archive's name, and are opened as the archive of their own taps without end.
#[test]
fn results_are_not_the_archive_of_their_taps() {
    let (_here, path) = new_path();
    let (results, given) = (path.with_file_name("results.h5"), plan(SampleFormat::I16));
    finished(&path, &given, CONFIG);
    let raw = (path.as_path(), Reader::open(&path).unwrap().raw_digest().unwrap());
    Writer::results(&results, raw, &given, CONFIG.into()).unwrap().finish().unwrap();
    fs::rename(&results, &path).unwrap();
    let refusal = Reader::open(&path).unwrap_err().to_string();
    assert!(refusal.contains("it has only results, and is named as the archive of their taps"), "{refusal}");
}

/// Catches a pipe in a folder of archives that is waited for.
#[test]
fn a_pipe_is_no_archive() {
    let (_here, path) = new_path();
    rustix::fs::mknodat(rustix::fs::CWD, &path, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
    assert!(matches!(Reader::open(&path), Err(Error::NotHdf5 { .. })));
}

/// Catches an archive whose texts a terminal obeys.
#[test]
fn texts_of_archives_are_no_commands() {
    let (_here, path) = new_path();
    let config = "# \u{1b}]0;title\u{7}\n";
    let refusal = Writer::create(path, &plan(SampleFormat::I16), 0, config).unwrap_err();
    assert!(refusal.to_string().ends_with(r#""config" holds the control character '\u{1b}'"#), "{refusal}");
}

/// Catches results that a power cut has left without content, and with which their archive cannot be judged again.
#[test]
fn results_without_content_are_computed_again() {
    let (_here, path) = new_path();
    let (results, given) = (path.with_file_name("results.h5"), plan(SampleFormat::I16));
    finished(&path, &given, CONFIG);
    let raw = (path.as_path(), Reader::open(&path).unwrap().raw_digest().unwrap());
    for content in [Vec::new(), vec![0; 4096]] {
        fs::write(&results, content).unwrap();
        Writer::results(&results, raw, &given, CONFIG.into()).unwrap().finish().unwrap();
        Reader::open(&results).unwrap();
    }
}

/// Catches results that are read with other taps than those that they were computed from.
#[test]
fn results_of_other_taps_are_refused() {
    let (_here, path) = new_path();
    let (results, given) = (path.with_file_name("results.h5"), plan(SampleFormat::I16));
    finished(&path, &given, CONFIG);
    let raw = (path.as_path(), Reader::open(&path).unwrap().raw_digest().unwrap());
    Writer::results(&results, raw, &given, CONFIG.into()).unwrap().finish().unwrap();
    Reader::open(&results).unwrap();
    fs::remove_file(&path).unwrap();
    let mut writer = Writer::create(&path, &given, given.taps().len(), CONFIG).unwrap();
    put(&mut writer, 0).unwrap();
    writer.finish().unwrap();
    let error = Reader::open(&results).unwrap_err();
    assert!(matches!(error, Error::OtherTaps { .. }) && error.to_string().contains("run.h5"), "{error}");
    // Nor are they those of an archive of another plan.
    fs::remove_file(&path).unwrap();
    finished(&path, &plan(SampleFormat::F32), CONFIG);
    let error = Reader::open(&results).unwrap_err();
    assert!(matches!(error, Error::OtherTaps { .. }), "{error}");
}
