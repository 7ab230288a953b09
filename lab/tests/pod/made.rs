//! Archives as `tapline` writes them, with verdicts and damage maps that a test chooses.

use std::path::Path;

use tapline_store::{Reader, Writer, results_path};
use tapline_wire::{
    Channel, ChannelHeader, DamageCell, Discriminators, Geometry, Judgement, Plan, PlannedTap, Purpose, Reasons,
    RecordKind, Recording, SampleFormat, Serial, SourceKind, Stamp, TapHeader, TapId, Truth, Verdict,
};

/// Limits of every shoulder, and the rates stated for them.
pub(crate) const LIMITS: [f64; 2] = [2.0, 3.0];
const RATES: [f64; 2] = [0.02, 0.001];

/// A shoulder that was judged: regions are the locations whose index reaches the limit.
#[derive(Debug, Clone)]
pub(crate) struct Shoulder {
    pub tyre: String,
    pub shoulder: u16,
    pub index: Vec<f64>,
    pub strongest_arc: f64,
    pub limits: [f64; 2],
    /// Whether it was compared with its own casing, because its scatter was off.
    pub is_scatter_off: bool,
    /// Locations that are cracked, by the archive itself; `None` where it does not know.
    pub known: Option<Vec<u32>>,
}

impl Shoulder {
    /// One whose strongest arc is its greatest index.
    pub(crate) fn new(tyre: &str, shoulder: u16, index: &[f64]) -> Self {
        Self {
            tyre: tyre.to_owned(),
            shoulder,
            index: index.to_vec(),
            strongest_arc: index.iter().copied().max_by(f64::total_cmp).unwrap(),
            limits: LIMITS,
            is_scatter_off: false,
            known: None,
        }
    }
}

/// Scans of several shoulders at one station.
#[derive(Debug, Clone)]
pub(crate) struct Archive {
    pub station: u16,
    /// When it was tapped.
    pub at_ns: i64,
    pub shoulders: Vec<Shoulder>,
}

impl Archive {
    /// At station 1.
    pub(crate) fn new(at_ns: i64, shoulders: &[Shoulder]) -> Self {
        Self { station: 1, at_ns, shoulders: shoulders.to_vec() }
    }

    /// Writes the finished archive.
    pub(crate) fn write(&self, path: &Path) {
        let plan = self.plan();
        let mut writer = Writer::create(path, &plan, plan.taps().len(), "[store]\n").unwrap();
        let mut first_rows = plan.scans().iter().map(|scan| scan.taps[0]).collect::<Vec<_>>();
        first_rows.sort_unstable();
        for (row, tap) in (0..).zip(plan.taps()) {
            match first_rows.contains(&row) {
                true => self.put_tap(&mut writer, &plan, row),
                false => {
                    writer.put_refusal(row, &tap.id, "made for a test").unwrap();
                }
            }
        }
        self.judge(writer);
    }

    /// Writes results for the taps of `archive`, which has the same shoulders; `key` is that of their lineage.
    pub(crate) fn write_results(&self, archive: &Path, key: &str) {
        let reader = Reader::open(archive).unwrap();
        let raw = (archive, reader.raw_digest().unwrap());
        let mut writer = Writer::results(results_path(archive, key), raw, &self.plan(), "[store]\n".into()).unwrap();
        for refusal in reader.refusals().unwrap() {
            writer.put_refusal(refusal.plan_index, &refusal.id, &refusal.reason).unwrap();
        }
        for found in reader.discriminators().unwrap().into_iter().flatten() {
            writer.put_discriminators(&found).unwrap();
        }
        self.judge(writer);
    }

    fn judge(&self, mut writer: Writer) {
        for (scan, shoulder) in (0..).zip(&self.shoulders) {
            let (judgement, cells) = judged(scan, shoulder);
            writer.end_scan(scan).unwrap();
            writer.put_judgement(scan, &judgement, &cells).unwrap();
        }
        writer.finish().unwrap();
    }

    fn plan(&self) -> Plan {
        let (mut taps, mut truth) = (Vec::new(), Truth::new());
        for shoulder in &self.shoulders {
            let tyre = Serial::new(&shoulder.tyre).unwrap();
            for location in (0..).take(shoulder.index.len()) {
                let id = TapId::new(self.station, tyre, shoulder.shoulder, location);
                taps.push(PlannedTap { id, angle_deg: None, purpose: Purpose::Scan });
                if let Some(known) = &shoulder.known {
                    truth.insert((tyre, shoulder.shoulder, location), known.contains(&location));
                }
            }
        }
        let recording = Recording {
            sample_rate_hz: 40960.0,
            pre_trigger_samples: 8,
            sample_count_max: 32,
            sample_format: SampleFormat::I16,
            channels: vec![Channel::Sound],
            calibration: tapline_wire::Calibration::computed(),
        };
        Plan::new(Geometry::Ring, recording, taps, truth).unwrap()
    }

    fn put_tap(&self, writer: &mut Writer, plan: &Plan, row: u32) {
        let id = plan.taps()[row as usize].id;
        let mut channels = [ChannelHeader::default(); 4];
        channels[0] = ChannelHeader { code: Channel::Sound.code(), reserved: 0, unit_per_count: 1.0 };
        let header = TapHeader {
            stamp: Stamp { kind: RecordKind::Data.code(), source: id.station.into(), ..Stamp::default() },
            id,
            plan_index: row,
            tap_time_ns: self.at_ns,
            sample_rate_hz: plan.recording.sample_rate_hz,
            velocity_measured_m_per_s: f64::NAN,
            velocity_nominal_m_per_s: f64::NAN,
            pre_trigger_samples: plan.recording.pre_trigger_samples,
            sample_count: 32,
            sample_format: plan.recording.sample_format.code(),
            channel_count: 1,
            source: SourceKind::Simulated.code(),
            channels,
            ..TapHeader::default()
        };
        let samples: Vec<u8> = (0..32_i64).flat_map(|k| ((self.at_ns + k) as i16).to_ne_bytes()).collect();
        writer.put_tap(&header, &samples).unwrap();
        writer.put_discriminators(&Discriminators { id, plan_index: row, ..Discriminators::default() }).unwrap();
    }
}

fn judged(scan: u32, shoulder: &Shoulder) -> (Judgement, Vec<DamageCell>) {
    let [re_inspect, reject] = shoulder.limits;
    let (verdict, mut reasons) = match shoulder.strongest_arc {
        arc if arc >= reject => (Verdict::Reject, Reasons::DAMAGE),
        arc if arc >= re_inspect => (Verdict::ReInspect, Reasons::SUSPECT),
        _ => (Verdict::Pass, Reasons::default()),
    };
    let verdict = if shoulder.is_scatter_off && verdict == Verdict::Pass { Verdict::ReInspect } else { verdict };
    if shoulder.is_scatter_off {
        reasons.insert(Reasons::SCATTER_OFF | Reasons::SELF_REFERENCE);
    }
    let judgement = Judgement {
        stamp: Stamp { kind: RecordKind::Data.code(), mark: scan.into(), ..Stamp::default() },
        verdict: verdict.code(),
        reasons,
        limit_re_inspect: re_inspect,
        limit_reject: reject,
        strongest_arc: shoulder.strongest_arc,
        re_inspect_rate: RATES[0],
        reject_rate: RATES[1],
        ..Judgement::default()
    };
    let cell = |(location, &damage_index): (u32, &f64)| {
        let is_called = damage_index >= re_inspect;
        DamageCell {
            location,
            damage_index,
            region: u32::from(is_called),
            region_index: if is_called { shoulder.strongest_arc } else { f64::NAN },
            ..DamageCell::default()
        }
    };
    (judgement, (0..).zip(&shoulder.index).map(cell).collect())
}
