//! Tests of whole tap sets, each written into a new folder.

use std::fs;

use hound::{SampleFormat as Kind, WavSpec, WavWriter};
use tapline_wire::{Channel, Geometry, Samples, cache_lines_for};
use tempfile::TempDir;

use super::*;

pub(crate) const HEADER: &str = "file,tyre,shoulder,offset_mm,velocity_m_per_s,location,angle_deg,repetition\n";
pub(crate) const SCAN: &str =
    "geometry = \"ring\"\nchannels = [\"force\", \"sound\"]\nsample_rate_hz = 40960\npre_trigger_samples = 2\n";

pub(crate) fn write_wav(dir: &Path, name: &str, channels: u16, rate_hz: u32, bits: u16, samples: &[f32]) {
    let sample_format = if bits == 32 { Kind::Float } else { Kind::Int };
    let spec = WavSpec { channels, sample_rate: rate_hz, bits_per_sample: bits, sample_format };
    let mut writer = WavWriter::create(dir.join(name), spec).unwrap();
    for &sample in samples {
        match bits {
            32 => writer.write_sample(sample).unwrap(),
            _ => writer.write_sample(sample as i32).unwrap(),
        }
    }
    writer.finalize().unwrap();
}

/// A set of three taps of two shoulders, 16-bit, force and sound, four samples each.
fn small_set() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("scan.toml"), SCAN).unwrap();
    let rows = "a.wav,T,2,0,1.5,0,0,0\nb.wav,T,2,0,1.5,1,3.6,0\nc.wav,T,1,,,0,,0\n";
    fs::write(dir.path().join("taps.csv"), format!("{HEADER}{rows}")).unwrap();
    for (name, first) in [("a.wav", 10.0), ("b.wav", 20.0), ("c.wav", 30.0)] {
        let samples: Vec<f32> = (0..8).map(|k| first + k as f32).collect();
        write_wav(dir.path(), name, 2, 40_960, 16, &samples);
    }
    dir
}

fn open(dir: &TempDir) -> TapSet {
    TapSet::open(dir.path(), 1).unwrap()
}

fn error_of(dir: &TempDir) -> String {
    TapSet::open(dir.path(), 1).unwrap_err().to_string()
}

fn render(set: &mut TapSet, row: u32) -> Result<(TapHeader, Vec<CacheLine>), Refusal> {
    let mut header = TapHeader::default();
    header.stamp.sequence = 77;
    header.sent_ns = 78;
    let mut buffer = vec![CacheLine::default(); cache_lines_for(set.plan().recording.payload_bytes_max())];
    set.render(row, 3, &mut header, &mut buffer).map(|()| (header, buffer))
}

fn refusal(set: &mut TapSet, row: u32) -> String {
    render(set, row).unwrap_err().to_string()
}

/// Catches samples of a file without a header that are shifted, swapped or from another channel, and a file that is not
/// a whole number of samples of all channels.
#[test]
fn a_recording_without_a_header_is_the_same_taps() {
    let (of_wav, dir) = (small_set(), small_set());
    let rows = fs::read_to_string(dir.path().join("taps.csv")).unwrap();
    fs::write(dir.path().join("taps.csv"), rows.replace(".wav", ".raw")).unwrap();
    for name in ["a", "b", "c"] {
        let wav = fs::read(dir.path().join(format!("{name}.wav"))).unwrap();
        fs::write(dir.path().join(format!("{name}.raw")), &wav[wav.len() - 16..]).unwrap();
    }
    for row in 0..3 {
        let (header, buffer) = render(&mut open(&of_wav), row).unwrap();
        let (same, same_lanes) = render(&mut open(&dir), row).unwrap();
        assert_eq!(Samples::view(&header, &buffer), Samples::view(&same, &same_lanes));
        assert_eq!((header.sample_count, header.channels), (same.sample_count, same.channels));
    }
    fs::write(dir.path().join("b.raw"), [0; 18]).unwrap();
    assert!(refusal(&mut open(&dir), 1).contains("18 bytes of samples are not a whole number of 4-byte samples"));
}

/// Catches a casing that is measured again, with the same names and record lengths, and passes for the same recordings.
#[test]
fn other_recordings_are_another_source() {
    let (dir, same) = (small_set(), small_set());
    assert_eq!(open(&dir).plan().digest(), open(&same).plan().digest());
    let samples: Vec<f32> = (0..8).map(|k| 11.0 + k as f32).collect();
    write_wav(same.path(), "b.wav", 2, 40_960, 16, &samples);
    assert_ne!(open(&dir).plan().digest(), open(&same).plan().digest());
}

/// Catches a sample, scale or field of the header that is lost or in the wrong place.
#[test]
fn a_16_bit_set_is_rendered() {
    let dir = small_set();
    let more = "force_full_scale_n = 222.0\nsound_full_scale_v = 5.0\nmicrophone_distance_m = 0.05\n";
    fs::write(dir.path().join("scan.toml"), format!("{SCAN}{more}")).unwrap();
    fs::write(dir.path().join("truth.csv"), "tyre,shoulder,location,cracked\nT,2,1,1\n").unwrap();
    let mut set = TapSet::open(dir.path(), 2).unwrap();
    assert_eq!(set.plan().taps().iter().map(|t| t.id.station).collect::<Vec<_>>(), [1, 1, 1], "one casing");
    assert_eq!(set.plan().truth().len(), 1);
    let recording = set.plan().recording.clone();
    assert_eq!(recording.channels, Channel::BOTH);
    assert_eq!((recording.sample_format, recording.sample_count_max), (SampleFormat::I16, 4));

    let (header, buffer) = render(&mut set, 1).unwrap();
    let want: [i16; 8] = [20, 22, 24, 26, 21, 23, 25, 27];
    assert_eq!(Samples::view(&header, &buffer), Some(Samples::I16(&want)));
    assert_eq!((header.stamp.sequence, header.sent_ns, header.tap_time_ns), (77, 78, 0));
    assert_eq!((header.id.attempt, header.id.planned(), header.plan_index), (3, set.plan().taps()[1].id, 1));
    assert_eq!((header.sample_rate_hz, header.microphone_distance_m), (40_960.0, 0.05));
    assert_eq!((header.pre_trigger_samples, header.sample_count, header.velocity_measured_m_per_s), (2, 4, 1.5));
    assert_eq!(SourceKind::from_code(header.source), Some(SourceKind::TapSet));
    let channels: Vec<_> = header.channels().collect();
    assert_eq!(channels, [(Channel::Force, 222.0 / 32_768.0), (Channel::Sound, 5.0 / 32_768.0)]);
    assert!(render(&mut set, 2).unwrap().0.velocity_measured_m_per_s.is_nan(), "unknown is not 0");
}

/// Catches float samples that are scaled, rounded or given another full scale than 1, and recordings that must have
/// equal lengths.
#[test]
fn a_float_set_of_one_channel_is_rendered() {
    let dir = small_set();
    fs::write(dir.path().join("scan.toml"), SCAN.replace("\"force\", ", "").replace("ring", "line")).unwrap();
    write_wav(dir.path(), "a.wav", 1, 40_960, 32, &[0.1, -1e-30, 3.5]);
    write_wav(dir.path(), "b.wav", 1, 40_960, 32, &[1.0, 2.0, 3.0, 4.0, 5.0]);
    write_wav(dir.path(), "c.wav", 1, 40_960, 32, &[9.0, 8.0, 7.0]);
    let mut set = open(&dir);
    assert_eq!((set.plan().geometry, set.plan().recording.sample_count_max), (Geometry::Line, 5));
    for (row, want) in [(0, vec![0.1, -1e-30, 3.5]), (1, vec![1.0, 2.0, 3.0, 4.0, 5.0]), (2, vec![9.0, 8.0, 7.0])] {
        let (header, buffer) = render(&mut set, row).unwrap();
        assert_eq!(Samples::view(&header, &buffer), Some(Samples::F32(&want)));
        assert_eq!(header.channels().collect::<Vec<_>>(), [(Channel::Sound, 1.0)]);
    }
}

/// Catches one bad recording that stops the others, and a refusal without file, line, reason or numbers.
#[test]
fn a_bad_recording_is_refused_alone() {
    let dir = small_set();
    let path = dir.path().to_owned();
    let b = path.join("b.wav");
    let cases: &[(&dyn Fn(), &str)] = &[
        (&|| fs::remove_file(&b).unwrap(), "the file does not exist"),
        (&|| fs::create_dir(&b).unwrap(), "it is not a file"),
        (&|| (fs::remove_dir(&b).unwrap(), fs::write(&b, "no wave").unwrap()).0, "not a WAV file: it ends at byte 7"),
        (&|| write_wav(&path, "b.wav", 1, 40_960, 16, &[1.0; 4]), "it has 1 channels; scan.toml lists 2"),
        (
            &|| write_wav(&path, "b.wav", 2, 44_100, 16, &[1.0; 8]),
            "its sample rate is 44100 Hz; scan.toml says 40960 Hz",
        ),
        (&|| write_wav(&path, "b.wav", 2, 40_960, 24, &[1.0; 8]), "24-bit integer samples are not supported"),
        (
            &|| write_wav(&path, "b.wav", 2, 40_960, 32, &[1.0; 8]),
            "its samples are 32-bit float; most recordings of the set have 16-bit integer",
        ),
        (&|| write_wav(&path, "b.wav", 2, 40_960, 16, &[]), "it has no samples"),
        (
            &|| write_wav(&path, "b.wav", 2, 40_960, 16, &[1.0; 4]),
            "it has 2 samples per channel; scan.toml has the trigger at sample 2",
        ),
    ];
    for (spoil, reason) in cases {
        spoil();
        let mut set = open(&dir);
        let got = refusal(&mut set, 1);
        assert!(got.starts_with(&format!("b.wav (taps.csv line 3): {reason}")), "{got:?} lacks {reason:?}");
        assert_eq!(refusals(&set), [got]);
        render(&mut set, 0).unwrap();
        render(&mut set, 2).unwrap();
    }
}

/// Catches a refusal that only the samples reveal and that is missed, or that changes the tap's identity in the header.
#[test]
fn a_sample_that_is_no_number_is_refused_when_it_is_read() {
    let dir = small_set();
    for name in ["a.wav", "b.wav", "c.wav"] {
        write_wav(
            dir.path(),
            name,
            2,
            40_960,
            32,
            &[1.0, 2.0, 3.0, 4.0, 5.0, if name == "b.wav" { f32::NAN } else { 6.0 }],
        );
    }
    let mut set = open(&dir);
    assert_eq!(refusals(&set).len(), 0);
    assert_eq!(
        refusal(&mut set, 1),
        "b.wav (taps.csv line 3): sample 2 of channel 1 (both from 0) is NaN, not a finite number"
    );
    let mut header = TapHeader::default();
    let mut buffer = [CacheLine::default(); 4];
    set.render(1, 0, &mut header, &mut buffer).unwrap_err();
    assert_eq!((header.id, header.plan_index), (set.plan().taps()[1].id, 1), "a refusal has a name");
}

/// Catches trust in a header that was read when the set was opened.
#[test]
fn a_recording_that_changes_is_refused() {
    let dir = small_set();
    let mut set = open(&dir);
    write_wav(dir.path(), "a.wav", 2, 40_960, 16, &[1.0; 10]);
    assert!(
        refusal(&mut set, 0).contains("it has grown to 5 samples per channel since the set was opened with at most 4")
    );
    fs::remove_file(dir.path().join("a.wav")).unwrap();
    assert!(refusal(&mut set, 0).contains("the file does not exist"));
}

/// Catches a run that starts although no tap can come of it.
#[test]
fn a_set_without_one_good_recording_is_an_error() {
    let dir = small_set();
    for name in ["a.wav", "b.wav", "c.wav"] {
        fs::remove_file(dir.path().join(name)).unwrap();
    }
    let error = error_of(&dir);
    let reasons = "a.wav (taps.csv line 2): the file does not exist; b.wav (taps.csv line 3): the file does not exist; \
                   c.wav (taps.csv line 4): the file does not exist";
    assert_eq!(error, format!("{}: none of the 3 taps can be used: {reasons}", dir.path().display()));
}

/// Catches a fault of the tables that is ignored, or reported without its file.
#[test]
fn faults_of_the_tables_name_their_file() {
    let dir = small_set();
    let put = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
    let path = dir.path().display().to_string();
    put("truth.csv", "tyre,shoulder,location\n");
    assert!(error_of(&dir).starts_with(&format!("{path}/truth.csv line 1: missing column \"cracked\"")));
    put("taps.csv", &format!("{HEADER}a.wav,T,2,0,1.5,0,0,0\nb.wav,T,2,0,1.5,0,0,0\n"));
    assert!(error_of(&dir).starts_with(&format!("{path}/taps.csv line 3: names the tap tyre T shoulder 2")));
    put("taps.csv", "\u{feff}file,tyre\n");
    assert!(error_of(&dir).starts_with(&format!("{path}/taps.csv line 1: missing column \"shoulder\"")));
    fs::remove_file(dir.path().join("taps.csv")).unwrap();
    assert!(error_of(&dir).starts_with(&format!("{path}/taps.csv: cannot be read: ")));
    put("scan.toml", "geometri = \"ring\"");
    assert!(error_of(&dir).starts_with(&format!("{path}/scan.toml line 1: `geometri")));
    let error = TapSet::open(small_set().path(), 0).unwrap_err().to_string();
    assert_eq!(error, "stations is 0; it must be from 1 to 65535");
}

/// Catches a panic for a row or a loan that does not fit.
#[test]
fn a_wrong_request_is_refused() {
    let dir = small_set();
    let mut set = open(&dir);
    assert_eq!(refusal(&mut set, 3), "plan: row 3 does not exist; the plan has 3 rows");
    let refusal = set.render(0, 0, &mut TapHeader::default(), &mut []).unwrap_err();
    assert_eq!(refusal.reason, "the loan has 0 bytes; the samples need 16");
}

/// Catches a format of the set that follows the first recording instead of the majority.
#[test]
fn most_recordings_set_the_format() {
    let dir = small_set();
    write_wav(dir.path(), "a.wav", 2, 40_960, 32, &[1.0; 80]);
    let mut set = open(&dir);
    assert_eq!((set.plan().recording.sample_format, set.plan().recording.sample_count_max), (SampleFormat::I16, 4));
    assert!(refusal(&mut set, 0).contains("its samples are 32-bit float; most"));
}

/// Catches a fault in reading the real recordings: counts, truth and finite samples.
#[test]
fn recorded_sets_are_read() {
    for (name, tap_count, scan_count, cracked_count) in
        [("ntu-slab-06cm", 361, 19, 81), ("ntu-slab-10cm", 361, 19, 81), ("fhwa-slab-bj", 140, 5, 0)]
    {
        let Some(dir) = tapline_testing::shared(name) else { continue };
        let mut set = TapSet::open(&dir, 4).unwrap();
        assert_eq!((set.plan().taps().len(), set.plan().scans().len()), (tap_count, scan_count), "{name}");
        assert_eq!(set.plan().geometry, Geometry::Line);
        assert_eq!(set.plan().stations(), [1], "a slab is one piece");
        let cracked = set.plan().truth().values().filter(|&&c| c).count();
        assert!(cracked == cracked_count || cracked_count == 0 && cracked > 0, "{name}: {cracked} cracked");
        for row in 0..tap_count as u32 {
            let (header, buffer) = render(&mut set, row).unwrap();
            let Some(Samples::F32(samples)) = Samples::view(&header, &buffer) else { panic!("{name}: not f32") };
            assert!(samples.len() > 1000 && samples.iter().any(|&s| s.abs() > 0.0), "{name} row {row} is silent");
        }
    }
}

/// Catches a tap of an archive that comes back with another station, attempt, time or scale, and a refusal whose reason
/// changes.
#[test]
fn what_an_archive_knows_comes_back() {
    let dir = small_set();
    let header = HEADER.replace(
        "repetition",
        "repetition,station,attempt,tap_time_ns,force_full_scale_n,sound_full_scale_v,microphone_distance_m,refused",
    );
    let rows = "a.wav,T,2,0,1.5,0,0,0,3,9,77,32768,65536,0.5,\n\
                b.wav,T,2,0,1.5,1,3.6,0,3,,,,,,\n\
                ,T,1,,,0,,0,3,1,,,,,\"two bounces, no more\"\n";
    fs::write(dir.path().join("taps.csv"), format!("{header}{rows}")).unwrap();
    let error = TapSet::open(dir.path(), 1).unwrap_err().to_string();
    assert!(
        error.contains("line 3: force_full_scale_n is \"\"; it must be a full scale in N, as for the other taps"),
        "{error}"
    );
    let scan = dir.path().join("scan.toml");
    let scaled = fs::read_to_string(&scan).unwrap() + "force_full_scale_n = 3.0\nsound_full_scale_pa = 4.0\n";
    fs::write(&scan, &scaled).unwrap();
    let error = TapSet::open(dir.path(), 1).unwrap_err().to_string();
    assert!(error.contains("line 2: sound_full_scale_v is \"65536\"; it must be a full scale in Pa"), "{error}");
    fs::write(&scan, scaled.replace("_pa", "_v")).unwrap();
    let mut set = open(&dir);
    assert_eq!(set.plan().stations(), [3]);
    let (first, _) = render(&mut set, 0).unwrap();
    let scales: Vec<f64> = first.channels().map(|(_, unit_per_count)| unit_per_count).collect();
    assert_eq!((scales, first.microphone_distance_m), (vec![1.0, 2.0], 0.5));
    assert_eq!((first.id.attempt, first.tap_time_ns, first.id.station), (9, 77, 3));
    let (second, _) = render(&mut set, 1).unwrap();
    let scales: Vec<f64> = second.channels().map(|(_, unit_per_count)| unit_per_count).collect();
    assert_eq!((scales, second.microphone_distance_m), (vec![3.0 / 32768.0, 4.0 / 32768.0], 0.0), "the set's own");
    assert_eq!((second.id.attempt, second.tap_time_ns), (3, 0), "the one that was asked for");
    assert_eq!(refusal(&mut set, 2), "two bounces, no more");
    assert_eq!(refusals(&set).len(), 1);
}

/// The taps that will be refused, as far as the headers of their recordings show, in the order of the plan.
pub(crate) fn refusals(set: &TapSet) -> Vec<String> {
    set.rows.iter().filter_map(|&row| Some(set.refusal(row, set.fault(row)?).to_string())).collect()
}
