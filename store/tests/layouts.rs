//! Archives of earlier layouts: what was released stays readable, number for number.
//!
//! `fixtures/layout-3.h5` was written by `tapline_store::Writer` of layout 3, and so on, by [`write_anew`]. What each must
//! give is written down here as numbers, apart from what the other tests share: what is recorded and judged is the same in
//! all of them.

use std::path::{Path, PathBuf};

use tapline_store::{Codec, Error, FORMAT_VERSION, Lineage, Lost, Reader, Room, RunWriter, Writer, repack, verify};
use tapline_wire::{
    Channel, ChannelHeader, DamageCell, Discriminator, Discriminators, Geometry, Judgement, Plan, PlannedTap, Quality,
    Reasons, RecordKind, Recording, SampleFormat, Serial, SourceKind, Stamp, TapHeader, TapId, TapState, Truth,
    Verdict,
};

const CONFIG: &str = "[process]\nf_c_hz = 550.0\n";
const REFERENCE: &str = "{\"sound\": []}";
const MADE_BY: &str = "process 00\nfuse.index = \"robust\"\n";
const REASON: &str = "the impactor did not return";
const SAMPLE_COUNT: u32 = 12;

/// The taps that the fixture has; of the others, row 2 was refused and row 3 never came.
const ARCHIVED: [u32; 3] = [0, 1, 4];

/// The layouts that were released, the newest last.
const RELEASED: [u32; 3] = [3, 4, 5];
const _: () = assert!(RELEASED[RELEASED.len() - 1] == FORMAT_VERSION, "a layout has no fixture: see `write_anew`");

pub(crate) fn fixture(version: u32) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/fixtures/layout-{version}.h5"))
}

/// One shoulder of four locations and a closing tap.
pub(crate) fn plan() -> Plan {
    let recording = Recording {
        sample_rate_hz: 40_960.0,
        pre_trigger_samples: 4,
        sample_count_max: SAMPLE_COUNT,
        sample_format: SampleFormat::I16,
        channels: vec![Channel::Force, Channel::Sound],
    };
    let serial = Serial::new("K-7").unwrap();
    let tap = |location: u32| {
        let id = TapId::new(3, serial, 2, location).with_offset_mm(Some(7.5)).unwrap();
        let id = id.with_velocity_m_per_s(Some(1.85)).unwrap();
        PlannedTap { id, angle_deg: Some(90.0 * f64::from(location % 4)), is_closing: location == 4 }
    };
    let truth: Truth = [((serial, 2, 1), true), ((serial, 2, 3), false)].into_iter().collect();
    Plan::new(Geometry::Ring, recording, (0..=4).map(tap).collect(), truth).unwrap().with_source(0x5eed)
}

/// Attempt at which the tap of plan row `row` was of use.
fn attempt(row: u32) -> u16 {
    u16::from(row == 1)
}

/// Samples a channel of plan row `row`: the closing tap's record is short.
fn sample_count(row: u32) -> u32 {
    if row == 4 { 9 } else { SAMPLE_COUNT }
}

/// The counts of plan row `row`, `[channel][sample]`.
fn counts(row: u32) -> Vec<i16> {
    let (row, length) = (i16::try_from(row).unwrap(), i16::try_from(sample_count(row)).unwrap());
    (0..2).flat_map(|channel| (0..length).map(move |k| 1000 * row - 100 * channel + k * k - 7)).collect()
}

pub(crate) fn header(plan: &Plan, row: u32) -> TapHeader {
    let mut id = plan.taps()[row as usize].id;
    id.attempt = attempt(row);
    let mut channels = [ChannelHeader::default(); 4];
    channels[0] = ChannelHeader { code: Channel::Force.code(), reserved: 0, unit_per_count: 0.25 };
    channels[1] = ChannelHeader { code: Channel::Sound.code(), reserved: 0, unit_per_count: 0.125 };
    TapHeader {
        stamp: Stamp {
            sequence: u64::from(row) + 40,
            epoch_ns: 1_700_000_000_000_000_001,
            plan_digest: plan.digest(),
            kind: RecordKind::Data.code(),
            source: 3,
            mark: 0,
        },
        id,
        plan_index: row,
        tap_time_ns: 1_700_000_001_000_000_000 + i64::from(row),
        sent_ns: 900 + i64::from(row),
        sample_rate_hz: 40_960.0,
        velocity_measured_m_per_s: 1.75 + 0.0625 * f64::from(row),
        velocity_nominal_m_per_s: 1.85,
        microphone_distance_m: 0.05,
        pre_trigger_samples: 4,
        sample_count: sample_count(row),
        sample_format: SampleFormat::I16.code(),
        channel_count: 2,
        source: SourceKind::TapSet.code(),
        channels,
        ..TapHeader::default()
    }
}

/// The seven values of plan row `row`; the closing tap has no force.
fn values(row: u32) -> [Option<f64>; 7] {
    let force = |value: f64| Some(value).filter(|_| row != 4);
    let row = f64::from(row);
    [force(30.0 + row), force(0.00075), force(0.5 + row), Some(2.5), Some(0.375 + row / 16.0), Some(1e-9), Some(3e-7)]
}

pub(crate) fn lineage() -> Lineage<'static> {
    Lineage {
        config_toml: CONFIG,
        reference: Some(REFERENCE),
        codec: Codec::Lz4,
        made_by: MADE_BY,
        raw: None,
        part: None,
    }
}

/// Writes the newest fixture: `cargo test -p tapline-store -- --ignored write_anew`, once for a layout, before it is released.
#[test]
#[ignore = "it makes the fixture, which is committed"]
fn write_anew() {
    let _guard = crate::common::beside_others();
    let (path, plan) = (fixture(FORMAT_VERSION), plan());
    drop(std::fs::remove_file(&path));
    let mut writer = Writer::create(&path, &plan, lineage()).unwrap();
    let id = plan.taps()[1].id;
    writer.put_retake(1, &id, Quality::DOUBLE_HIT).unwrap();
    for row in ARCHIVED {
        let header = header(&plan, row);
        let samples: Vec<u8> = counts(row).into_iter().flat_map(i16::to_ne_bytes).collect();
        writer.put_tap(&header, &samples).unwrap();
        let mut found = Discriminators {
            id: header.id,
            plan_index: row,
            quality: if row == 4 { Quality::NO_FORCE } else { Quality::default() },
            velocity_measured_m_per_s: header.velocity_measured_m_per_s,
            ..Discriminators::default()
        };
        for (which, value) in Discriminator::ALL.into_iter().zip(values(row)) {
            found.values.set(which, value);
        }
        writer.put_discriminators(&found).unwrap();
    }
    writer.put_refusal(2, &plan.taps()[2].id, REASON).unwrap();
    writer.end_scan(0).unwrap();
    let mut reasons = Reasons::DAMAGE;
    reasons.insert(Reasons::TAPS_REFUSED);
    let judgement = Judgement {
        verdict: Verdict::Reject.code(),
        reasons,
        limit_re_inspect: 2.5,
        limit_reject: 4.0,
        false_call_rate: 0.001,
        p_value: 0.002,
        evidence: [1.0, 2.0, 3.0, f64::NAN, 5.0, 6.0, 7.0],
        drift: [0.01, f64::NAN, 0.03, 0.04, 0.05, 0.06, 0.07],
        planned_count: 5,
        received_count: 3,
        refused_count: 1,
        absent_count: 3,
        ..Judgement::default()
    };
    let cell = |location: u32| DamageCell {
        location,
        region: u32::from(location == 1),
        angle_deg: 90.0 * f64::from(location),
        damage_index: if location == 2 { f64::NAN } else { 1.5 * f64::from(location) },
        p_value: 0.25,
        guard: 0.5,
        region_p_value: if location == 1 { 0.002 } else { f64::NAN },
        offset_best_mm: if location == 1 { 7.5 } else { f64::NAN },
        offset_low_mm: if location == 1 { 7.5 } else { f64::NAN },
        offset_high_mm: if location == 1 { 7.5 } else { f64::NAN },
        tap_count: 1,
        absent_count: 3 * u32::from(location == 0),
    };
    writer.put_judgement(0, &judgement, &(0..4).map(cell).collect::<Vec<_>>()).unwrap();
    writer.finish().unwrap();
}

/// Catches a program that no longer reads what a released layout wrote, or reads other taps, plans or texts out of it.
#[test]
fn every_layout_gives_its_taps() {
    let _guard = crate::common::beside_others();
    RELEASED.into_iter().for_each(gives_its_taps);
}

fn gives_its_taps(version: u32) {
    let reader = Reader::open(fixture(version)).unwrap();
    assert_eq!(reader.plan(), &plan());
    assert_eq!(reader.truth(), plan().truth());
    assert_eq!((reader.config(), reader.reference(), reader.made_by()), (CONFIG, Some(REFERENCE), MADE_BY));
    assert_eq!((reader.codec(), reader.is_results()), (Codec::Lz4, false));
    assert_eq!(reader.written_by().as_deref(), Some("0.1.0"));
    let (there, gone, never) = (TapState::Archived, TapState::Refused, TapState::Missing);
    assert_eq!(reader.ledger().taps(), [there, there, gone, never, there]);
    assert_eq!(reader.lost_at(3), Some(Lost::Acquire));
    assert_eq!(reader.retaken(1), Some((1, Quality::DOUBLE_HIT)));
    let refusals = reader.refusals().unwrap();
    assert_eq!((refusals.len(), refusals[0].plan_index, refusals[0].reason.as_str()), (1, 2, REASON));
    let taps = reader.taps().unwrap();
    let mut room = Room::default();
    for row in 0..5 {
        let Some((found, samples)) = reader.tap(row).unwrap() else {
            assert!(!ARCHIVED.contains(&row), "row {row} is gone");
            continue;
        };
        assert!(ARCHIVED.contains(&row), "row {row} never came");
        assert_eq!(found, header(&plan(), row));
        let bytes: Vec<u8> = counts(row).into_iter().flat_map(i16::to_le_bytes).collect();
        assert_eq!(crate::common::bytes(samples.as_samples()), bytes);
        let (_, apart) = taps.read(row, &mut room).unwrap().unwrap();
        assert_eq!(apart.as_bytes(), bytes);
    }
}

/// Catches a program that reads other results out of a released layout, or finds fault with an archive that has none.
#[test]
fn every_layout_gives_its_results() {
    let _guard = crate::common::beside_others();
    RELEASED.into_iter().for_each(gives_its_results);
}

fn gives_its_results(version: u32) {
    let reader = Reader::open(fixture(version)).unwrap();
    for (row, found) in (0..).zip(reader.discriminators().unwrap()) {
        assert_eq!(found.is_some(), ARCHIVED.contains(&row), "row {row}");
        let Some(found) = found else { continue };
        assert_eq!(Discriminator::ALL.map(|which| found.values.get(which)), values(row));
        assert_eq!((found.id.attempt, found.quality.bits()), (attempt(row), if row == 4 { 4 } else { 0 }));
    }
    let (judged, cells) = reader.judgements().unwrap().remove(0).unwrap();
    assert_eq!((judged.verdict, judged.reasons.to_string().as_str()), (3, "damage|taps_refused"));
    let limits = [judged.limit_re_inspect, judged.limit_reject, judged.false_call_rate, judged.p_value];
    assert_eq!(limits.map(f64::to_bits), [2.5, 4.0, 0.001, 0.002].map(f64::to_bits));
    assert_eq!(format!("{:?}", judged.evidence), "[1.0, 2.0, 3.0, NaN, 5.0, 6.0, 7.0]");
    assert_eq!(format!("{:?}", judged.drift), "[0.01, NaN, 0.03, 0.04, 0.05, 0.06, 0.07]");
    let counted = (judged.planned_count, judged.received_count, judged.refused_count, judged.absent_count);
    assert_eq!(counted, (5, 3, 1, 3));
    let column = |of: fn(&DamageCell) -> f64| cells.iter().map(|cell| format!("{} ", of(cell))).collect::<String>();
    assert_eq!(column(|cell| cell.location.into()), "0 1 2 3 ");
    assert_eq!(column(|cell| cell.angle_deg), "0 90 180 270 ");
    assert_eq!(column(|cell| cell.damage_index), "0 1.5 NaN 4.5 ");
    assert_eq!(column(|cell| cell.region.into()), "0 1 0 0 ");
    assert_eq!(column(|cell| cell.region_p_value), "NaN 0.002 NaN NaN ");
    assert_eq!(column(|cell| cell.offset_high_mm), "NaN 7.5 NaN NaN ");
    assert_eq!(column(|cell| cell.p_value + cell.guard), "0.75 0.75 0.75 0.75 ");
    assert_eq!(column(|cell| (10 * cell.tap_count + cell.absent_count).into()), "13 10 10 10 ");
    assert_eq!(reader.lineage_key().unwrap(), KEY);
    let report = verify(fixture(version)).unwrap();
    assert_eq!((report.problems, report.ledger.count(TapState::Missing)), (vec![], 1));
}

/// The key of the fixtures' results, when they were made: it is over what was recorded, not over how it lies in the file.
const KEY: &str = "e1d8b2bb5747b5dbf4b4ec643f2cfc5059aabea4d82bb1d8426cd994498b847f";

/// Catches an archive from before the first release that is taken for a whole one, or refused without a way out.
#[test]
fn layouts_before_the_first_release_are_refused() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("old.h5");
    for (version, words) in
        [(1_u32, "never released"), (2, "tapline run --taps"), (FORMAT_VERSION + 1, "newer tapline")]
    {
        std::fs::copy(fixture(3), &path).unwrap();
        let file = hdf5::File::open_rw(&path).unwrap();
        file.attr("format_version").unwrap().write_scalar(&version).unwrap();
        file.close().unwrap();
        let error = Reader::open(&path).unwrap_err();
        assert!(matches!(error, Error::FormatVersion { got, known: FORMAT_VERSION, .. } if got == version), "{error}");
        let said = error.to_string();
        assert!(said.contains("old.h5") && said.contains(words), "{said}");
    }
}

/// Catches a tap that is put into an archive of an earlier layout as today's layout has it, and one that is packed again and
/// keeps what sealed it before.
#[test]
fn an_older_archive_is_gone_on_with_as_it_is() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let version =
        |path: &Path| hdf5::File::open(path).unwrap().attr("format_version").unwrap().read_scalar::<u32>().unwrap();
    for layout in RELEASED {
        let (path, packed) =
            (folder.path().join(format!("{layout}.h5")), folder.path().join(format!("{layout}-again.h5")));
        std::fs::copy(fixture(layout), &path).unwrap();
        let mut writer = Writer::resume(&path, &plan(), lineage()).unwrap();
        let bytes: Vec<u8> = counts(3).into_iter().flat_map(i16::to_ne_bytes).collect();
        writer.put_tap(&header(&plan(), 3), &bytes).unwrap();
        let id = header(&plan(), 3).id;
        writer.put_discriminators(&Discriminators { id, plan_index: 3, ..Discriminators::default() }).unwrap();
        writer.finish().unwrap();
        let read = |path: &Path| {
            let (found, samples) = Reader::open(path).unwrap().tap(3).unwrap().unwrap();
            assert_eq!(found, header(&plan(), 3));
            crate::common::bytes(samples.as_samples())
        };
        assert_eq!((read(&path), version(&path)), (bytes.clone(), layout));
        let of_samples = |path: &Path| {
            let problems = verify(path).unwrap().problems;
            problems.iter().map(ToString::to_string).filter(|said| said.contains("samples")).collect::<Vec<_>>()
        };
        assert_eq!(of_samples(&path), Vec::<String>::new());
        repack(fixture(layout), &packed, Codec::Zstd).unwrap();
        assert_eq!((of_samples(&packed), version(&packed)), (vec![], FORMAT_VERSION));
    }
}

/// Catches samples that are checked as the layout of the results has it, not as that of the file which has them.
#[test]
fn results_may_have_another_layout_than_their_taps() {
    let _guard = crate::common::beside_others();
    let folder = tempfile::tempdir().unwrap();
    let [path, packed, results] = ["run.h5", "packed.h5", "results.h5"].map(|name| folder.path().join(name));
    std::fs::copy(fixture(3), &path).unwrap();
    let reader = Reader::open(&path).unwrap();
    let mut writer = RunWriter::of_results(&results, &reader, Lineage { made_by: "other", ..lineage() }).unwrap();
    for row in ARCHIVED {
        let id = header(&plan(), row).id;
        writer.put_discriminators(&Discriminators { id, plan_index: row, ..Discriminators::default() }).unwrap();
    }
    writer.finish().unwrap();
    let again = Reader::open(&results).unwrap();
    let (taps, mut room) = (again.taps().unwrap(), Room::default());
    for row in ARCHIVED {
        let (_, samples) = taps.read(row, &mut room).unwrap().unwrap();
        let bytes: Vec<u8> = counts(row).into_iter().flat_map(i16::to_le_bytes).collect();
        assert_eq!(samples.as_bytes(), bytes);
    }
    let problems = verify(&results).unwrap().problems;
    assert!(!problems.iter().any(|problem| problem.to_string().contains("samples")), "{problems:?}");
    // And when the taps are packed again, by another codec too.
    drop((reader, again));
    repack(&path, &packed, Codec::Zstd).unwrap();
    std::fs::rename(&packed, &path).unwrap();
    assert!(Reader::open(&results).unwrap().tap(0).unwrap().is_some());
}
