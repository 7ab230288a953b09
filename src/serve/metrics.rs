//! What a line has done, and its free space, as numbers for Prometheus. Labels are stations, states, stages, verdicts,
//! receivers and discriminators, so that a line of given stations has the same series for ever.

use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use jiff::Timestamp;
use jiff::civil::Date;
use jiff::tz::TimeZone;
use prometheus_client::encoding::{EncodeMetric, MetricEncoder, NoLabelSet, text::encode};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::{Registry, Unit};
use tapline_host::memory;
use tapline_wire::{Verdict, now_ns, shm};

use crate::serve::beside;
use crate::shown::latency::Latency;
use crate::shown::status::{StationStatus, Status, VerdictCounts};
use crate::shown::whole::Whole;

/// The format of the text.
pub(super) const CONTENT: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// How long a disk may take to report its free space.
const DISK_WITHIN: Duration = Duration::from_millis(500);

/// A day, in seconds.
const DAY_S: f64 = 86_400.0;

/// Names of labels with their values.
type Labels = Vec<(&'static str, String)>;

/// Gauges with fractions.
type Level = Gauge<f64, AtomicU64>;

/// Bytes that may still be written into `folder`; `None` if its disk does not answer. `is_asked` is set until it
/// answers: a disk that hangs is not asked again.
pub(super) async fn free_bytes(is_asked: Arc<AtomicBool>, folder: PathBuf) -> Option<u64> {
    if is_asked.swap(true, Ordering::AcqRel) {
        return None;
    }
    let ask = move || {
        let room = rustix::fs::statvfs(&folder).ok();
        is_asked.store(false, Ordering::Release);
        room.map(|room| room.f_bavail.saturating_mul(room.f_frsize))
    };
    beside(DISK_WITHIN, ask).await.ok().flatten()
}

/// The metrics of a line with this `status` and this much free disk space.
pub(super) fn text(status: &Status, disk_free_bytes: Option<u64>) -> Result<String, fmt::Error> {
    let mut registry = Registry::with_prefix("tapline");
    of_casings(&mut registry, status);
    of_stations(&mut registry, status);
    of_stages(&mut registry, status);
    of_machine(&mut registry, status, disk_free_bytes);
    let mut text = String::new();
    encode(&mut text, &registry)?;
    Ok(text)
}

fn counted(registry: &mut Registry, name: &str, help: &str, values: impl Iterator<Item = (Labels, u64)>) {
    let family = Family::<Labels, Counter>::default();
    for (labels, value) in values {
        family.get_or_create(&labels).inc_by(value);
    }
    registry.register(name, help, family);
}

fn measured(
    registry: &mut Registry,
    (name, unit): (&str, Option<Unit>),
    help: &str,
    values: impl Iterator<Item = (Labels, f64)>,
) {
    let family = Family::<Labels, Level>::default();
    for (labels, value) in values {
        family.get_or_create(&labels).set(value);
    }
    match unit {
        Some(unit) => registry.register_with_unit(name, help, unit, family),
        None => registry.register(name, help, family),
    }
}

fn station(station: &StationStatus) -> (&'static str, String) {
    ("station", station.number.to_string())
}

fn of_casings(registry: &mut Registry, status: &Status) {
    let verdicts = status.stations.iter().flat_map(|of| {
        let VerdictCounts { pass, re_inspect, reject } = of.tally.verdicts;
        let counts = Verdict::ALL.into_iter().zip([pass, re_inspect, reject]);
        counts.map(move |(kind, count)| (vec![station(of), ("verdict", kind.to_string())], count))
    });
    counted(registry, "verdicts", "Casings judged since the line was started", verdicts);
    let waiting =
        status.receivers.iter().map(|receiver| (vec![("receiver", receiver.name.clone())], receiver.waiting as f64));
    measured(registry, ("verdicts_waiting", None), "Verdicts that a receiver has not acknowledged", waiting);
    registry.register_with_unit(
        "verdict_latency",
        "Time from the last tap of a casing to its verdict",
        Unit::Seconds,
        Histogram(status.latency.clone()),
    );
    let refused = std::iter::once((Vec::new(), status.refused_count));
    counted(registry, "casings_refused", "Casings that were refused", refused);
    let lost = std::iter::once((Vec::new(), status.lost_count));
    counted(registry, "records_lost", "Records lost in transit, whose taps were taken again", lost);
    let rate = std::iter::once((Vec::new(), status.taps_per_s));
    measured(registry, ("taps_rate", None), "Taps settled per second, over the last ten seconds", rate);
}

fn of_stations(registry: &mut Registry, status: &Status) {
    let open = |of: &StationStatus, count: &dyn Fn(&crate::shown::casing::CasingStatus) -> u64| {
        of.casing.as_ref().map_or(0, count)
    };
    let taps = status.stations.iter().flat_map(|of| {
        let archived = of.tally.archived + open(of, &|casing| casing.archived as u64);
        let refused = of.tally.refused + open(of, &|casing| casing.refused as u64);
        let states = [("archived", archived), ("refused", refused), ("missing", of.tally.missing)];
        states.map(|(state, count)| (vec![station(of), ("state", state.to_owned())], count))
    });
    counted(registry, "taps", "Planned taps that are archived, refused, or missing from closed casings", taps);
    let retaken =
        status.stations.iter().map(|of| (vec![station(of)], of.tally.retaken + open(of, &|casing| casing.retaken)));
    counted(registry, "retakes", "Taps that were taken again", retaken);
    let waits = status.stations.iter().map(|of| (vec![station(of)], f64::from(u8::from(!of.waits_for.is_empty()))));
    measured(registry, ("station_waits", None), "1 while a station waits, for a casing or for its rig", waits);
    let faults = status.stations.iter().map(|of| (vec![station(of)], f64::from(u8::from(of.fault.is_some()))));
    measured(registry, ("station_fault", None), "1 while the rig, device or folder of a station is away", faults);
    let busy = status.stations.iter().map(|of| (vec![station(of)], f64::from(u8::from(of.casing.is_some()))));
    measured(registry, ("station_busy", None), "1 while a station has a casing", busy);
    let whole = |times: fn(&Whole) -> &BTreeMap<String, f64>| {
        let each = status.stations.iter().flat_map(move |of| times(&of.whole).iter().map(move |known| (of, known)));
        each.map(|(of, (which, times))| (vec![station(of), ("discriminator", which.clone())], *times))
    };
    let help = "Level of the last casing, as a multiple of the reference's";
    measured(registry, ("level", Some(Unit::Ratios)), help, whole(|whole| &whole.level));
    let help = "How far the locations of the last casing differ, as a multiple of the reference's";
    measured(registry, ("scatter", Some(Unit::Ratios)), help, whole(|whole| &whole.scatter));
    let signs = status.stations.iter().map(|of| (vec![station(of)], of.signs.len() as f64));
    measured(
        registry,
        ("rig_signs", None),
        "Signs that the rig of a station has changed; tapline status names them",
        signs,
    );
    let ages = status.stations.iter().filter_map(|of| Some((vec![station(of)], age_s(of.calibrated_on.as_deref()?)?)));
    let name = ("calibration_age", Some(Unit::Seconds));
    measured(registry, name, "Age of the oldest calibration that the last casing was judged with", ages);
    // The last day counts whole.
    let ends = status
        .stations
        .iter()
        .filter_map(|of| Some((vec![station(of)], DAY_S - age_s(of.calibration_ends.as_deref()?)?)));
    let name = ("calibration_left", Some(Unit::Seconds));
    measured(
        registry,
        name,
        "Time until the calibration that ends first is no longer valid; negative afterwards",
        ends,
    );
}

fn of_stages(registry: &mut Registry, status: &Status) {
    let restarts = status.stages.iter().map(|stage| (vec![("stage", stage.name.clone())], stage.restarts.into()));
    counted(registry, "stage_restarts", "How often a stage was started again", restarts);
    let supervisor = ("line".to_owned(), Some(status.pid));
    let stages = status.stages.iter().map(|stage| (stage.name.clone(), stage.pid)).chain([supervisor]);
    let memory = stages.filter_map(|(name, pid)| Some((vec![("stage", name)], resident_bytes(pid?)?)));
    let name = ("resident_memory", Some(Unit::Bytes));
    measured(registry, name, "Memory of a stage's process, including shared memory that it touched", memory);
}

fn of_machine(registry: &mut Registry, status: &Status, disk_free_bytes: Option<u64>) {
    let one = |bytes: Option<u64>| bytes.map(|bytes| (Vec::new(), bytes as f64)).into_iter();
    let bytes = Some(Unit::Bytes);
    measured(registry, ("disk_free", bytes.clone()), "Free space on the archive's disk", one(disk_free_bytes));
    measured(registry, ("shm_free", bytes), "Free space in /dev/shm", one(shm::free_bytes().ok()));
    let troubles = std::iter::once((Vec::new(), status.troubles.len() as f64));
    measured(registry, ("troubles", None), "Troubles of the line at this moment; /healthz names them", troubles);
    let shown = std::iter::once((Vec::new(), now_ns().saturating_sub(status.at_ns) as f64 / 1e9));
    measured(registry, ("status_age", Some(Unit::Seconds)), "Time since the line last sent its status", shown);
}

/// Memory of the process `pid`, in bytes.
fn resident_bytes(pid: u32) -> Option<f64> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    Some(memory::bytes(&text, "VmRSS")? as f64)
}

/// Time since the start of the `day`, such as `2026-11-24`, in UTC.
fn age_s(day: &str) -> Option<f64> {
    let begin = day.parse::<Date>().ok()?.to_zoned(TimeZone::UTC).ok()?.timestamp();
    Some(Timestamp::from_nanosecond(now_ns().into()).ok()?.duration_since(begin).as_secs_f64())
}

/// A histogram that was counted elsewhere.
#[derive(Debug)]
struct Histogram(Latency);

impl EncodeMetric for Histogram {
    fn encode(&self, mut encoder: MetricEncoder<'_>) -> Result<(), fmt::Error> {
        let Latency { bounds_s, counts, sum_s } = &self.0;
        let bounds = bounds_s.iter().copied().chain([f64::INFINITY]);
        let bins: Vec<(f64, u64)> = bounds.zip(counts.iter().copied()).collect();
        encoder.encode_histogram::<NoLabelSet>(*sum_s, counts.iter().sum(), &bins, None::<&HashMap<_, _>>)
    }

    fn metric_type(&self) -> MetricType {
        MetricType::Histogram
    }
}
