//! A small run: its plan, and records that depend on nothing but their plan row.

use std::array::from_fn;
use std::path::{Path, PathBuf};
use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use tapline_store::{Lineage, Result, Writer};
use tapline_wire::{
    Channel, ChannelHeader, DamageCell, Discriminator, Discriminators, Geometry, Judgement, Plan, PlannedTap, Purpose,
    Quality, Reasons, RecordKind, Recording, SampleFormat, Samples, Serial, SourceKind, Stamp, TapHeader, TapId, Truth,
    Verdict,
};
use tempfile::TempDir;

pub(crate) const CONFIG: &str = "[process]\nf_c_hz = 550.0 # \u{b5}\n";

/// Locations of one ring.
pub(crate) const LOCATIONS: u32 = 4;

/// A plan of two stations with one shoulder each: four locations and a closing tap.
pub(crate) fn plan(sample_format: SampleFormat) -> Plan {
    let channels = Channel::BOTH.to_vec();
    plan_of(Recording {
        sample_rate_hz: 40960.0,
        pre_trigger_samples: 8,
        sample_count_max: 32,
        sample_format,
        channels,
        calibration: tapline_wire::Calibration::stated(),
    })
}

pub(crate) fn plan_of(recording: Recording) -> Plan {
    plan_with(recording, LOCATIONS)
}

/// The same with `location_count` locations per ring.
pub(crate) fn plan_with(recording: Recording, location_count: u32) -> Plan {
    let mut taps = Vec::new();
    for station in [1, 2] {
        for location in 0..=location_count {
            let mut id = TapId::default();
            (id.station, id.tyre, id.shoulder) = (station, Serial::new("A\u{e9}-1").unwrap(), station);
            id.location = location;
            let offset_mm = (station == 1).then_some(5.0);
            let id = id.with_offset_mm(offset_mm).unwrap().with_velocity_m_per_s(Some(1.85)).unwrap();
            let angle_deg =
                (station == 1).then(|| 360.0 / f64::from(location_count) * f64::from(location % location_count));
            taps.push(PlannedTap { id, angle_deg, purpose: Purpose::closing_if(location == location_count) });
        }
    }
    let truth: Truth = [((Serial::new("A\u{e9}-1").unwrap(), 1, 2), true)].into_iter().collect();
    Plan::new(Geometry::Ring, recording, taps, truth).unwrap()
}

/// Two rings of 60 locations with long records: enough to kill a writer amid them, and to fill a small disk.
pub(crate) fn big_plan() -> Plan {
    let recording = plan(SampleFormat::I16).recording;
    plan_with(Recording { sample_count_max: 4096, ..recording }, 60)
}

/// Header of the tap in plan row `row`, with a record of `sample_count` samples per channel.
pub(crate) fn header(plan: &Plan, row: u32, sample_count: u32) -> TapHeader {
    let id = plan.taps()[row as usize].id;
    let mut channels = [ChannelHeader::default(); 4];
    for (header, channel) in channels.iter_mut().zip(&plan.recording.channels) {
        *header = ChannelHeader { code: channel.code(), reserved: 0, unit_per_count: 1.0 / f64::from(row + 3) };
    }
    TapHeader {
        stamp: Stamp {
            casing: 0,
            sequence: u64::from(row) + (1 << 40),
            epoch_ns: 1_700_000_000_000_000_001,
            kind: RecordKind::Data.code(),
            source: id.station.into(),
            mark: 3,
        },
        id,
        plan_index: row,
        tap_time_ns: i64::from(row) - 5,
        sent_ns: i64::from(row) + 7,
        sample_rate_hz: plan.recording.sample_rate_hz,
        velocity_measured_m_per_s: 1.8 + 0.1 / f64::from(row + 3),
        velocity_nominal_m_per_s: plan.velocity_nominal_m_per_s(row).unwrap_or(f64::NAN),
        microphone_distance_m: 0.05,
        pre_trigger_samples: plan.recording.pre_trigger_samples,
        sample_count,
        text_bytes: 0,
        sample_format: plan.recording.sample_format.code(),
        channel_count: u32::try_from(plan.recording.channels.len()).unwrap(),
        source: SourceKind::Simulated.code(),
        retakes_left: 0,
        planned_sample_count: plan.recording.sample_count_max,
        channels,
    }
}

/// Sample bytes of `header`, all different bit patterns, for f32 NaNs with payloads among them.
pub(crate) fn samples(header: &TapHeader) -> Vec<u8> {
    let words = 0..header.payload_bytes().div_ceil(4);
    let seed = header.plan_index.wrapping_mul(0x9e37_79b9) ^ u32::from(header.id.attempt).wrapping_mul(77);
    let mut bytes: Vec<u8> =
        words.flat_map(|k| (seed ^ u32::try_from(k).unwrap().wrapping_mul(0x85eb_ca6b)).to_ne_bytes()).collect();
    if header.sample_format == SampleFormat::F32.code() && bytes.len() >= 4 {
        bytes[..4].copy_from_slice(&0x7fc0_1234_u32.to_ne_bytes());
    }
    bytes.truncate(header.payload_bytes());
    bytes
}

/// What is "found" in the tap in plan row `row`; every third has no force.
pub(crate) fn discriminators(plan: &Plan, row: u32) -> Discriminators {
    let mut found = Discriminators {
        id: plan.taps()[row as usize].id,
        plan_index: row,
        velocity_measured_m_per_s: 1.8 + 0.1 / f64::from(row + 3),
        ..Discriminators::default()
    };
    for (k, which) in (0..).zip(Discriminator::ALL) {
        found.values.set(which, Some(f64::from(row) + f64::from(k) / 8.0));
    }
    if row % 3 == 2 {
        found.quality.insert(Quality::NO_FORCE);
        for which in [Discriminator::FMax, Discriminator::Tau, Discriminator::A1] {
            found.values.set(which, None);
        }
    }
    found
}

/// A verdict on scan `scan` whose damage lies over the seam.
pub(crate) fn judgement(plan: &Plan, scan: u32) -> (Judgement, Vec<DamageCell>) {
    let planned = &plan.scans()[scan as usize];
    let mut reasons = Reasons::DAMAGE;
    reasons.insert(Reasons::SELF_REFERENCE);
    let judgement = Judgement {
        stamp: Stamp { kind: RecordKind::Data.code(), mark: scan.into(), ..Stamp::default() },
        verdict: Verdict::Reject.code(),
        reasons,
        limit_re_inspect: 2.5,
        limit_reject: 4.0,
        strongest_arc: 8.5,
        first_strongest_arc: f64::NAN,
        re_inspect_rate: 0.02,
        reject_rate: 0.001,
        p_value: 0.004,
        evidence: from_fn(|k| if k == 3 { f64::NAN } else { k as f64 + 1.0 }),
        scatter: from_fn(|k| if k == 0 { f64::NAN } else { 1.0 + 0.25 * k as f64 }),
        level: from_fn(|k| if k == 5 { f64::NAN } else { 0.5 + 0.25 * k as f64 }),
        drift: from_fn(|k| if k == 2 { f64::NAN } else { 0.01 * (k as f64 + 1.0) }),
        planned_count: u32::try_from(planned.taps.len()).unwrap(),
        received_count: u32::try_from(planned.taps.len()).unwrap(),
        refused_count: 0,
        absent_count: 5,
    };
    let cell = |&(location, angle_deg): &(u32, Option<f64>)| DamageCell {
        location,
        region: u32::from(location == 0 || location == LOCATIONS - 1),
        angle_deg: angle_deg.unwrap_or(f64::NAN),
        damage_index: if location == 1 { f64::NAN } else { 4.5 + f64::from(location) },
        first_index: f64::NAN,
        p_value: if location == 2 { 0.25 } else { f64::NAN },
        region_index: if location == 0 { 8.5 } else { f64::NAN },
        region_p_value: if location == 0 { 0.002 } else { f64::NAN },
        offset_best_mm: 5.0,
        offset_low_mm: 0.0,
        offset_high_mm: f64::from(location),
        tap_count: 2,
        absent_count: location,
    };
    (judgement, planned.locations.iter().map(cell).collect())
}

/// Continues the archive at `path` or, if there is none, begins it.
pub(crate) fn open_or_create(path: impl AsRef<Path>, plan: &Plan, config: &str) -> Result<Writer> {
    let path = path.as_ref();
    if path.exists() { Writer::resume(path, config) } else { Writer::create(path, plan, plan.taps().len(), config) }
}

/// Puts both halves of the tap in plan row `row`.
pub(crate) fn put(writer: &mut Writer, row: u32) -> Result<()> {
    let plan = writer.plan().clone();
    let header = header(&plan, row, plan.recording.sample_count_max);
    writer.put_tap(&header, &samples(&header))?;
    writer.put_discriminators(&discriminators(&plan, row))?;
    Ok(())
}

/// Puts everything there is.
pub(crate) fn put_all(writer: &mut Writer) -> Result<()> {
    let plan = writer.plan().clone();
    for row in 0..u32::try_from(plan.taps().len()).unwrap() {
        put(writer, row)?;
    }
    for scan in 0..u32::try_from(plan.scans().len()).unwrap() {
        writer.end_scan(scan)?;
        let (verdict, cells) = judgement(&plan, scan);
        writer.put_judgement(scan, &verdict, &cells)?;
    }
    Ok(())
}

/// A finished archive at `path` with everything that there is.
pub(crate) fn finished<'a>(path: &Path, plan: &Plan, lineage: impl Into<Lineage<'a>>) {
    let mut writer = Writer::create(path, plan, plan.taps().len(), lineage).unwrap();
    put_all(&mut writer).unwrap();
    writer.finish().unwrap();
}

/// The bytes of `samples`.
pub(crate) fn bytes(samples: Samples<'_>) -> Vec<u8> {
    samples.as_bytes().to_vec()
}

/// Tests that start a child run alone: a child started while another test has an archive open would inherit the
/// descriptor, and with it the lock on that archive.
static CHILDREN: RwLock<()> = RwLock::new(());

/// Held by a test that starts no child.
pub(crate) fn beside_others() -> RwLockReadGuard<'static, ()> {
    CHILDREN.read().unwrap_or_else(PoisonError::into_inner)
}

/// A test that starts no child, and a folder of its own.
pub(crate) type Here = (RwLockReadGuard<'static, ()>, TempDir);

/// The path of an archive to be made, in a folder that is there as long as [`Here`].
pub(crate) fn new_path() -> (Here, PathBuf) {
    let here = (beside_others(), tempfile::tempdir().unwrap());
    let path = here.1.path().join("run.h5");
    (here, path)
}

/// An archive of `plan` that was begun there.
pub(crate) fn begun(plan: Plan) -> (Here, PathBuf, Plan, Writer) {
    let (here, path) = new_path();
    let writer = Writer::create(&path, &plan, plan.taps().len(), CONFIG).unwrap();
    (here, path, plan, writer)
}

/// Held by a test that starts a child.
pub(crate) fn alone() -> RwLockWriteGuard<'static, ()> {
    CHILDREN.write().unwrap_or_else(PoisonError::into_inner)
}
