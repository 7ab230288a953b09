//! How fast taps reach the disk, beside plain `write` of the same bytes: `write_rate [TAPS] [FOLDER]`.
//!
//! Both write from memory to a new file, five times each in turn; the best of each counts, since other work on the
//! machine only ever slows down. Peak memory is printed too: it must not grow with the number of taps.
#![expect(clippy::print_stdout, reason = "the figures are what this program is for")]

use std::error::Error;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use tapline_store::Writer;
use tapline_wire::{
    Channel, ChannelHeader, Discriminators, Geometry, Plan, PlannedTap, RecordKind, Recording, SampleFormat, Serial,
    Stamp, TapHeader, TapId,
};

const SAMPLES: u32 = 16384;
const ROUNDS: usize = 5;
const FLUSH_TAPS: u32 = 64;

fn plan(tap_count: u32) -> Result<Plan, Box<dyn Error>> {
    let recording = Recording {
        sample_rate_hz: 40960.0,
        pre_trigger_samples: 1024,
        sample_count_max: SAMPLES,
        sample_format: SampleFormat::I16,
        channels: vec![Channel::Force, Channel::Sound],
    };
    let mut taps = Vec::new();
    for k in 0..tap_count {
        let mut id = TapId::default();
        (id.station, id.tyre, id.shoulder) = (1, Serial::new(&format!("T{}", k / 800))?, 1);
        (id.location, id.repetition) = (k % 100, u16::try_from(k % 800 / 100)?);
        taps.push(PlannedTap { id, angle_deg: Some(3.6 * f64::from(k % 100)), is_closing: false });
    }
    Ok(Plan::new(Geometry::Ring, recording, taps, Default::default())?)
}

fn header(plan: &Plan, row: u32) -> TapHeader {
    let mut header = TapHeader {
        stamp: Stamp { plan_digest: plan.digest(), kind: RecordKind::Data.code(), ..Stamp::default() },
        id: plan.taps()[row as usize].id,
        plan_index: row,
        sample_count: SAMPLES,
        sample_format: SampleFormat::I16.code(),
        channel_count: 2,
        ..TapHeader::default()
    };
    for (channel, kind) in header.channels.iter_mut().zip([Channel::Force, Channel::Sound]) {
        *channel = ChannelHeader { code: kind.code(), reserved: 0, unit_per_count: 1e-3 };
    }
    header
}

/// Seconds to archive every tap of `plan`, without and with the laying out of the tables.
fn archive(path: &Path, plan: &Plan, payloads: &[Vec<u8>]) -> Result<(f64, f64), Box<dyn Error>> {
    let begin = Instant::now();
    let mut writer = Writer::create(path, plan, "")?;
    let created = Instant::now();
    for (row, payload) in (0..).zip(payloads.iter().cycle().take(plan.taps().len())) {
        writer.put_tap(&header(plan, row), payload)?;
        writer.put_discriminators(&Discriminators {
            id: plan.taps()[row as usize].id,
            plan_index: row,
            ..Discriminators::default()
        })?;
        if row % FLUSH_TAPS == FLUSH_TAPS - 1 {
            writer.flush()?;
        }
    }
    writer.flush()?;
    Ok((created.elapsed().as_secs_f64(), begin.elapsed().as_secs_f64()))
}

/// Seconds to write the same bytes to a plain file.
fn plain(path: &Path, tap_count: usize, payloads: &[Vec<u8>]) -> Result<f64, Box<dyn Error>> {
    let begin = Instant::now();
    let mut file = std::fs::File::create(path)?;
    for payload in payloads.iter().cycle().take(tap_count) {
        file.write_all(payload)?;
    }
    Ok(begin.elapsed().as_secs_f64())
}

fn peak_memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or("unknown").trim().to_owned()
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let tap_count: u32 = arguments.next().map_or(Ok(2000), |text| text.parse())?;
    let folder = arguments.next().map_or_else(std::env::temp_dir, PathBuf::from);
    let plan = plan(tap_count)?;
    let payload_bytes = plan.recording.payload_bytes_max();
    let payloads: Vec<Vec<u8>> = (0..32).map(|k| vec![k; payload_bytes]).collect();
    let mut best = [f64::INFINITY; 3];
    for round in 0..ROUNDS {
        let [archived, written] = ["h5", "bin"].map(|kind| folder.join(format!("write_rate-{round}.{kind}")));
        let (taps_s, whole_s) = archive(&archived, &plan, &payloads)?;
        std::fs::remove_file(&archived)?;
        let plain_s = plain(&written, plan.taps().len(), &payloads)?;
        std::fs::remove_file(&written)?;
        for (best, now) in best.iter_mut().zip([taps_s, whole_s, plain_s]) {
            if now < *best {
                *best = now;
            }
        }
    }
    let bytes = f64::from(tap_count) * f64::from(u32::try_from(payload_bytes)?);
    let rate =
        |seconds: f64| format!("{:.0} taps/s, {:.0} MB/s", f64::from(tap_count) / seconds, bytes / seconds / 1e6);
    let [taps_s, whole_s, plain_s] = best;
    println!("{tap_count} taps of 2 x {SAMPLES} i16, a flush every {FLUSH_TAPS}, best of {ROUNDS}");
    println!("archive                {}", rate(taps_s));
    println!("archive and creation   {} (creation {:.1} ms)", rate(whole_s), (whole_s - taps_s) * 1e3);
    println!("plain write            {}", rate(plain_s));
    println!("archive / plain        {:.2}", plain_s / taps_s);
    println!("peak memory            {}", peak_memory());
    Ok(())
}
