//! The tables of an archive: their columns and rows.

mod casings;

#[cfg(feature = "parquet")]
use arrow_schema::Field;
use tapline_wire::{
    Channel, DamageCell, Discriminator, Discriminators, Judgement, PlannedTap, Quality, Reasons, Scan, TapHeader,
    TapState, Verdict,
};

use crate::Export;
use crate::column::{Column, Sink};
#[cfg(feature = "parquet")]
use crate::parquet_file::fields;
use tapline_store::Lost;
use tapline_store::Reader;
use tapline_store::{Region, regions};

use crate::Result;

/// Writes `table` of the archive to `sink`; if it is one of many, with a first column `file` with its `name`.
pub(crate) fn write(reader: &Reader, name: Option<&str>, table: Export, sink: &mut impl Sink) -> Result<()> {
    match table {
        Export::Discriminators => discriminators(reader, name, sink),
        Export::Damage => damage(reader, name, sink),
        Export::Regions => arcs(reader, name, sink),
        Export::Verdicts => verdicts(reader, name, sink),
        Export::Ledger => ledger(reader, name, sink),
        Export::Casings => casings::write(reader, name, sink),
    }
}

/// Describes the columns of `table`, which are those of every archive.
#[cfg(feature = "parquet")]
pub(crate) fn describe(table: Export) -> Vec<Field> {
    match table {
        Export::Discriminators => fields(&discriminator_columns(None, [None, None])),
        Export::Damage => fields(&damage_columns(None)),
        Export::Regions => fields(&region_columns(None)),
        Export::Verdicts => fields(&verdict_columns(None)),
        Export::Ledger => fields(&ledger_columns(None)),
        Export::Casings => fields(&casings::columns(None)),
    }
}

/// Columns that name a planned tap.
fn tap_columns<R>(name: Option<&str>, tap: impl Fn(&R) -> &PlannedTap + Copy + 'static) -> Vec<Column<R>> {
    let of_tap = [
        Column::u16("station", move |row| tap(row).id.station),
        Column::text("tyre", move |row| tap(row).id.tyre.to_string()),
        Column::u16("shoulder", move |row| tap(row).id.shoulder),
        Column::f64("offset_mm", "mm", move |row| tap(row).id.offset_mm()),
        Column::f64("velocity_m_per_s", "m/s", move |row| tap(row).id.velocity_m_per_s()),
        Column::u32("location", move |row| tap(row).id.location),
        Column::f64("angle_deg", "deg", move |row| tap(row).angle_deg),
        Column::u16("repetition", move |row| tap(row).id.repetition),
    ];
    file_column(name).into_iter().chain(of_tap).collect()
}

/// Columns that name a scan.
fn scan_columns<R>(name: Option<&str>, scan: impl Fn(&R) -> &Scan + Copy + 'static) -> Vec<Column<R>> {
    let of_scan = [
        Column::text("tyre", move |row| scan(row).tyre.to_string()),
        Column::u16("shoulder", move |row| scan(row).shoulder),
    ];
    file_column(name).into_iter().chain(of_scan).collect()
}

/// The column with the name of the archive.
fn file_column<R>(name: Option<&str>) -> Option<Column<R>> {
    let name = name?.to_owned();
    Some(Column::text("file", move |_| name.clone()))
}

struct FoundRow<'a> {
    tap: &'a PlannedTap,
    found: Discriminators,
    /// When the tap was made, ns since the Unix epoch; `None` where that was not recorded.
    time_ns: Option<i64>,
}

/// `units` are those of force and sound.
fn discriminator_columns<'a>(name: Option<&str>, units: [Option<String>; 2]) -> Vec<Column<FoundRow<'a>>> {
    let mut columns = tap_columns(name, |row: &FoundRow<'_>| row.tap);
    columns.extend([
        Column::u16("attempt", |row: &FoundRow<'_>| row.found.id.attempt),
        Column::text("purpose", |row: &FoundRow<'_>| row.tap.purpose.name().to_owned()),
        Column::text("tap_utc", |row: &FoundRow<'_>| utc(row.time_ns?, "%Y-%m-%d %H:%M:%S%.3f")),
        Column::f64("velocity_measured_m_per_s", "m/s", |row: &FoundRow<'_>| row.found.velocity_measured_m_per_s),
    ]);
    columns.extend(Discriminator::ALL.map(|which| {
        // The other units may differ between archives of one table: they have columns of their own.
        let unit = which.fixed_unit().unwrap_or_default();
        Column::f64(which.column(), unit, move |row: &FoundRow<'_>| row.found.values.get(which))
    }));
    columns.push(Column::text("quality", |row: &FoundRow<'_>| row.found.quality.to_string()));
    columns.push(Column::bits("quality_bits", |row: &FoundRow<'_>| row.found.quality.bits()));
    for (name, unit) in ["force_unit", "sound_unit"].into_iter().zip(units) {
        columns.push(Column::text(name, move |_| unit.clone()));
    }
    columns
}

fn discriminators(reader: &Reader, name: Option<&str>, sink: &mut impl Sink) -> Result<()> {
    let recording = &reader.plan().recording;
    let units = Channel::BOTH.map(|channel| {
        let has_it = recording.channels.contains(&channel);
        has_it.then(|| recording.calibration.unit(channel).name().to_owned())
    });
    let columns = discriminator_columns(name, units);
    let found = reader.plan().taps().iter().zip(reader.discriminators()?).zip(reader.headers()?);
    let rows = found.filter_map(|((tap, found), header)| {
        let time_ns = header.map(|header| header.tap_time_ns).filter(|&time_ns| time_ns != 0);
        Some(FoundRow { tap, found: found?, time_ns })
    });
    sink.rows(&columns, rows)
}

struct CellRow<'a> {
    scan: &'a Scan,
    cell: DamageCell,
}

fn damage_columns<'a>(name: Option<&str>) -> Vec<Column<CellRow<'a>>> {
    let mut columns = scan_columns(name, |row: &CellRow<'_>| row.scan);
    columns.extend([
        Column::u32("location", |row: &CellRow<'_>| row.cell.location),
        Column::f64("angle_deg", "deg", |row: &CellRow<'_>| row.cell.angle_deg),
        Column::f64("damage_index", "1", |row: &CellRow<'_>| row.cell.damage_index),
        Column::f64("first_index", "1", |row: &CellRow<'_>| row.cell.first_index),
        Column::f64("p_value", "1", |row: &CellRow<'_>| row.cell.p_value),
    ]);
    columns
}

fn damage(reader: &Reader, name: Option<&str>, sink: &mut impl Sink) -> Result<()> {
    let judged = reader.plan().scans().iter().zip(reader.judgements()?);
    let cells = judged.filter_map(|(scan, judged)| Some((scan, judged?.1)));
    let columns = damage_columns(name);
    sink.rows(&columns, cells.flat_map(|(scan, cells)| cells.into_iter().map(move |cell| CellRow { scan, cell })))
}

struct RegionRow<'a> {
    scan: &'a Scan,
    region: Region,
}

fn region_columns<'a>(name: Option<&str>) -> Vec<Column<RegionRow<'a>>> {
    let mut columns = scan_columns(name, |row: &RegionRow<'_>| row.scan);
    columns.extend([
        Column::u32("region", |row: &RegionRow<'_>| row.region.region),
        Column::u32("first_location", |row: &RegionRow<'_>| row.region.first_location),
        Column::u32("last_location", |row: &RegionRow<'_>| row.region.last_location),
        Column::f64("start_deg", "deg", |row: &RegionRow<'_>| row.region.start_deg),
        Column::f64("end_deg", "deg", |row: &RegionRow<'_>| row.region.end_deg),
        Column::u32("peak_location", |row: &RegionRow<'_>| row.region.peak_location),
        Column::f64("peak_angle_deg", "deg", |row: &RegionRow<'_>| row.region.peak_angle_deg),
        Column::f64("peak_damage_index", "1", |row: &RegionRow<'_>| row.region.peak_damage_index),
        Column::u32("extent_locations", |row: &RegionRow<'_>| row.region.extent_locations),
        Column::f64("extent_deg", "deg", |row: &RegionRow<'_>| row.region.extent_deg),
        Column::f64("mean_damage_index", "1", |row: &RegionRow<'_>| row.region.mean_damage_index),
        Column::f64("region_index", "1", |row: &RegionRow<'_>| row.region.region_index),
        Column::f64("p_value", "1", |row: &RegionRow<'_>| row.region.p_value),
        Column::f64("offset_best_mm", "mm", |row: &RegionRow<'_>| row.region.offset_best_mm),
        Column::f64("offset_low_mm", "mm", |row: &RegionRow<'_>| row.region.offset_low_mm),
        Column::f64("offset_high_mm", "mm", |row: &RegionRow<'_>| row.region.offset_high_mm),
    ]);
    columns
}

fn arcs(reader: &Reader, name: Option<&str>, sink: &mut impl Sink) -> Result<()> {
    let geometry = reader.plan().geometry;
    let judged = reader.plan().scans().iter().zip(reader.judgements()?);
    let arcs = judged.filter_map(|(scan, judged)| Some((scan, regions(geometry, &judged?.1))));
    let columns = region_columns(name);
    sink.rows(&columns, arcs.flat_map(|(scan, arcs)| arcs.into_iter().map(move |region| RegionRow { scan, region })))
}

struct VerdictRow<'a> {
    scan: &'a Scan,
    verdict: Verdict,
    reasons: Reasons,
    /// Taps that are archived, refused and missing.
    counts: [u32; 3],
    /// Taps that were asked for because of what others showed.
    second_reading_count: u32,
    /// When the first and the last tap were made, ns since the Unix epoch; `None` where their times were not recorded.
    times_ns: Option<(i64, i64)>,
    /// The same of its first reading: the second one may wait for the other shoulder.
    first_times_ns: Option<(i64, i64)>,
    /// The judgement and its regions; `None` if the scan is not judged.
    judged: Option<(Judgement, Vec<Region>)>,
}

impl VerdictRow<'_> {
    fn value(&self, value: impl Fn(&Judgement) -> f64) -> Option<f64> {
        self.judged.as_ref().map(|(judgement, _)| value(judgement))
    }

    /// Where its regions lie, from the first to the last location of each; `None` without angles or regions.
    fn regions_deg(&self) -> Option<String> {
        let (_, regions) = self.judged.as_ref()?;
        let places = regions.iter().map(|region| Some(format!("{:.0} to {:.0}", region.start_deg?, region.end_deg?)));
        Some(places.collect::<Option<Vec<_>>>()?.join("; ")).filter(|places| !places.is_empty())
    }
}

fn verdict_columns<'a>(name: Option<&str>) -> Vec<Column<VerdictRow<'a>>> {
    let mut columns = scan_columns(name, |row: &VerdictRow<'_>| row.scan);
    columns.extend([
        Column::u16("station", |row: &VerdictRow<'_>| row.scan.station),
        Column::text("first_tap_utc", |row: &VerdictRow<'_>| utc(row.times_ns?.0, SECONDS)),
        Column::text("last_tap_utc", |row: &VerdictRow<'_>| utc(row.times_ns?.1, SECONDS)),
        Column::text("verdict", |row: &VerdictRow<'_>| row.verdict.to_string()),
        Column::text("regions_deg", VerdictRow::regions_deg),
        Column::text("reasons", |row: &VerdictRow<'_>| row.reasons.to_string()),
        Column::bits("reasons_bits", |row: &VerdictRow<'_>| row.reasons.bits()),
        Column::u32("planned_count", |row: &VerdictRow<'_>| count(row.scan.taps.len())),
        Column::u32("archived_count", |row: &VerdictRow<'_>| row.counts[0]),
        Column::u32("refused_count", |row: &VerdictRow<'_>| row.counts[1]),
        Column::u32("missing_count", |row: &VerdictRow<'_>| row.counts[2]),
        Column::u32("second_reading_count", |row: &VerdictRow<'_>| row.second_reading_count),
        Column::f64("scan_s", "s", |row: &VerdictRow<'_>| {
            row.first_times_ns.map(|(first, last)| (last - first) as f64 * 1e-9)
        }),
        Column::u32("absent_count", |row: &VerdictRow<'_>| {
            row.judged.as_ref().map(|(judgement, _)| judgement.absent_count)
        }),
        Column::u32("region_count", |row: &VerdictRow<'_>| {
            row.judged.as_ref().map(|(_, regions)| count(regions.len()))
        }),
        Column::f64("limit_re_inspect", "1", |row: &VerdictRow<'_>| row.value(|judgement| judgement.limit_re_inspect)),
        Column::f64("limit_reject", "1", |row: &VerdictRow<'_>| row.value(|judgement| judgement.limit_reject)),
        Column::f64("strongest_arc", "1", |row: &VerdictRow<'_>| row.value(|judgement| judgement.strongest_arc)),
        Column::f64("first_strongest_arc", "1", |row: &VerdictRow<'_>| {
            row.value(|judgement| judgement.first_strongest_arc)
        }),
        Column::f64("re_inspect_rate", "1", |row: &VerdictRow<'_>| row.value(|judgement| judgement.re_inspect_rate)),
        Column::f64("reject_rate", "1", |row: &VerdictRow<'_>| row.value(|judgement| judgement.reject_rate)),
        Column::f64("p_value", "1", |row: &VerdictRow<'_>| row.value(|judgement| judgement.p_value)),
    ]);
    type OfAll = fn(&Judgement) -> &[f64; Discriminator::COUNT];
    let of_all: [(&str, OfAll); 4] =
        [("evidence", |j| &j.evidence), ("scatter", |j| &j.scatter), ("level", |j| &j.level), ("drift", |j| &j.drift)];
    for (name, values) in of_all {
        columns.extend(Discriminator::ALL.map(|which| {
            let value = move |row: &VerdictRow<'_>| row.value(|judgement| values(judgement)[which as usize]);
            Column::f64(format!("{name}_{}", which.name()), "1", value)
        }));
    }
    columns
}

fn verdicts(reader: &Reader, name: Option<&str>, sink: &mut impl Sink) -> Result<()> {
    let columns = verdict_columns(name);
    let (geometry, ledger) = (reader.plan().geometry, reader.ledger());
    let scans = reader.plan().scans().iter().zip(reader.judgements()?).enumerate();
    let headers = reader.headers()?;
    let is_second = |&&row: &&u32| reader.plan().taps()[row as usize].is_second_reading();
    let rows = scans.map(|(number, (scan, judged))| {
        let (verdict, reasons) = reader.verdict(number, judged.as_ref());
        let taps = || scan.taps.iter().map(|&row| ledger.taps()[row as usize]);
        let counts = [TapState::Archived, TapState::Refused, TapState::Missing]
            .map(|state| count(taps().filter(|&of_tap| of_tap == state).count()));
        VerdictRow {
            scan,
            verdict,
            reasons,
            counts,
            second_reading_count: count(scan.taps.iter().filter(is_second).count()),
            times_ns: times_ns(&headers, &scan.taps),
            first_times_ns: times_ns(&headers, scan.taps.iter().filter(|row| !is_second(row))),
            judged: judged.map(|(judgement, cells)| (judgement, regions(geometry, &cells))),
        }
    });
    sink.rows(&columns, rows)
}

/// When the first and the last of `taps`, rows of the plan, were made, ns since the Unix epoch; `None` where their times were not recorded.
fn times_ns<'a>(headers: &[Option<TapHeader>], taps: impl IntoIterator<Item = &'a u32>) -> Option<(i64, i64)> {
    let of_row = |&row: &u32| headers[row as usize].as_ref().map(|header| header.tap_time_ns);
    let times_ns: Vec<i64> = taps.into_iter().filter_map(of_row).filter(|&time_ns| time_ns != 0).collect();
    Some((*times_ns.iter().min()?, *times_ns.iter().max()?))
}

/// A time to the second, as spreadsheets read it.
const SECONDS: &str = "%Y-%m-%d %H:%M:%S";

/// The time `at_ns` after the Unix epoch in this `form`.
fn utc(at_ns: i64, form: &str) -> Option<String> {
    Some(jiff::Timestamp::from_nanosecond(at_ns.into()).ok()?.strftime(form).to_string())
}

/// A count of taps or arcs, of which a plan has at most `u32::MAX`.
fn count(number: usize) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}

struct LedgerRow<'a> {
    tap: &'a PlannedTap,
    state: TapState,
    attempt: Option<u16>,
    reason: Option<String>,
    retaken: Option<(u32, Quality)>,
    lost_at: Option<Lost>,
}

fn ledger_columns<'a>(name: Option<&str>) -> Vec<Column<LedgerRow<'a>>> {
    let mut columns = tap_columns(name, |row: &LedgerRow<'_>| row.tap);
    columns.extend([
        Column::text("state", |row: &LedgerRow<'_>| row.state.name().to_owned()),
        Column::u16("attempt", |row: &LedgerRow<'_>| row.attempt),
        Column::text("reason", |row: &LedgerRow<'_>| row.reason.clone()),
        Column::u32("retaken_count", |row: &LedgerRow<'_>| row.retaken.map_or(0, |(count, _)| count)),
        Column::text("retaken_for", |row: &LedgerRow<'_>| row.retaken.map(|(_, quality)| quality.to_string())),
        Column::text("lost_at", |row: &LedgerRow<'_>| row.lost_at.map(|stage| stage.name().to_owned())),
    ]);
    columns
}

fn ledger(reader: &Reader, name: Option<&str>, sink: &mut impl Sink) -> Result<()> {
    let columns = ledger_columns(name);
    let mut refusals = reader.refusals()?.into_iter().peekable();
    let taps = reader.plan().taps().iter().zip(reader.ledger().taps());
    let rows = (0..).zip(taps).map(|(row, (tap, &state))| LedgerRow {
        tap,
        state,
        attempt: reader.attempt(row),
        reason: refusals.next_if(|refusal| refusal.plan_index == row).map(|refusal| refusal.reason),
        retaken: reader.retaken(row),
        lost_at: reader.lost_at(row),
    });
    sink.rows(&columns, rows)
}
