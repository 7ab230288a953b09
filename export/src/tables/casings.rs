//! The table of casings: what each was judged from and with.

use std::collections::BTreeSet;

use serde::Deserialize;
use tapline_store::{Reader, hex_of};
use tapline_wire::{Channel, Reasons, TapState, Verdict};

use crate::Result;
use crate::column::{Column, Sink};
use crate::tables::{SECONDS, count, file_column, times_ns, utc};

/// A casing of the archive; what the archive has in common for all its casings is in [`Origin`].
pub(super) struct CasingRow<'a> {
    tyre: &'a str,
    station: u16,
    shoulder_count: u16,
    /// The worst of its shoulders.
    verdict: Verdict,
    /// Of all its shoulders.
    reasons: Reasons,
    /// Taps that are planned, archived, refused and missing.
    counts: [u32; 4],
    times_ns: Option<(i64, i64)>,
    origin: &'a Origin<'a>,
}

/// Where the results of an archive come from.
struct Origin<'a> {
    reader: &'a Reader,
    run: Run,
    reference_digest: Option<String>,
    raw_digest: String,
    lineage: String,
}

/// What is read of the configuration of a run; each is absent where the configuration has no such text.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Run {
    report: Printed,
    fuse: ComparedWith,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Printed {
    plant: Option<String>,
    line: Option<String>,
    operator: Option<String>,
    procedure: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct ComparedWith {
    reference: Option<String>,
}

/// What is read of a reference file.
#[derive(Debug, Deserialize)]
struct ReferenceFile {
    digest: String,
}

impl<'a> Origin<'a> {
    fn of(reader: &'a Reader) -> Result<Self> {
        let file = reader.reference().and_then(|text| serde_json::from_str::<ReferenceFile>(text).ok());
        Ok(Self {
            reader,
            // Another program's version may have written what this one cannot read.
            run: toml::from_str(reader.config()).unwrap_or_default(),
            reference_digest: file.map(|file| file.digest),
            raw_digest: hex_of(&reader.raw_digest()?),
            lineage: reader.lineage_key()?,
        })
    }
}

pub(super) fn columns<'a>(name: Option<&str>) -> Vec<Column<CasingRow<'a>>> {
    type Row<'a> = CasingRow<'a>;
    let mut columns: Vec<Column<Row<'_>>> = file_column(name).into_iter().collect();
    columns.extend([
        Column::text("tyre", |row: &Row<'_>| row.tyre.to_owned()),
        Column::u16("station", |row: &Row<'_>| row.station),
        Column::text("first_tap_utc", |row: &Row<'_>| utc(row.times_ns?.0, SECONDS)),
        Column::text("last_tap_utc", |row: &Row<'_>| utc(row.times_ns?.1, SECONDS)),
        Column::text("verdict", |row: &Row<'_>| row.verdict.to_string()),
        Column::text("reasons", |row: &Row<'_>| row.reasons.to_string()),
        Column::u16("shoulder_count", |row: &Row<'_>| row.shoulder_count),
        Column::u32("planned_count", |row: &Row<'_>| row.counts[0]),
        Column::u32("archived_count", |row: &Row<'_>| row.counts[1]),
        Column::u32("refused_count", |row: &Row<'_>| row.counts[2]),
        Column::u32("missing_count", |row: &Row<'_>| row.counts[3]),
        Column::text("plant", |row: &Row<'_>| row.origin.run.report.plant.clone()),
        Column::text("line", |row: &Row<'_>| row.origin.run.report.line.clone()),
        Column::text("operator", |row: &Row<'_>| row.origin.run.report.operator.clone()),
        Column::text("procedure", |row: &Row<'_>| row.origin.run.report.procedure.clone()),
        Column::text("reference", |row: &Row<'_>| row.origin.run.fuse.reference.clone()),
        Column::text("reference_digest", |row: &Row<'_>| row.origin.reference_digest.clone()),
    ]);
    for channel in Channel::BOTH {
        let recording = |row: &Row<'_>| row.origin.reader.plan().recording.clone();
        let unit = move |row: &Row<'_>| {
            let has_it = recording(row).channels.contains(&channel);
            has_it.then(|| recording(row).calibration.unit(channel).name().to_owned())
        };
        let method = move |row: &Row<'_>| Some(recording(row).calibration.of(channel).certificate.clone()?.method);
        let certificate = move |row: &Row<'_>| recording(row).calibration.certificate(channel).cloned();
        let name = |what: &str| format!("{}_{what}", channel.name());
        columns.extend([
            Column::text(&name("unit"), unit),
            Column::text(&name("calibration"), method),
            Column::text(&name("calibrated_on"), move |row| Some(certificate(row)?.date)),
            Column::text(&name("valid_until"), move |row| certificate(row)?.valid_until),
        ]);
    }
    columns.extend([
        Column::f64("sample_rate_hz", "Hz", |row: &Row<'_>| row.origin.reader.plan().recording.sample_rate_hz),
        Column::text("written_by", |row: &Row<'_>| row.origin.reader.written_by()),
        Column::text("raw_digest", |row: &Row<'_>| row.origin.raw_digest.clone()),
        Column::text("lineage", |row: &Row<'_>| row.origin.lineage.clone()),
    ]);
    columns
}

pub(super) fn write(reader: &Reader, name: Option<&str>, sink: &mut impl Sink) -> Result<()> {
    let (origin, judged, headers) = (Origin::of(reader)?, reader.judgements()?, reader.headers()?);
    let scans = reader.plan().scans();
    let tyres: BTreeSet<&str> = scans.iter().map(|scan| scan.tyre.as_str()).collect();
    let rows = tyres.into_iter().filter_map(|tyre| {
        let of_it = || (0..scans.len()).filter(|&number| scans[number].tyre.as_str() == tyre);
        let verdicts = || of_it().map(|number| reader.verdict(number, judged[number].as_ref()));
        let taps = || of_it().flat_map(|number| &scans[number].taps);
        let in_state = |state| count(taps().filter(|&&row| reader.ledger().taps()[row as usize] == state).count());
        let [archived, refused, missing] = [TapState::Archived, TapState::Refused, TapState::Missing].map(in_state);
        Some(CasingRow {
            tyre,
            station: scans[of_it().next()?].station,
            shoulder_count: u16::try_from(of_it().count()).unwrap_or(u16::MAX),
            verdict: verdicts().map(|(verdict, _)| verdict).max()?,
            reasons: verdicts().fold(Reasons::empty(), |all, (_, reasons)| all | reasons),
            counts: [count(taps().count()), archived, refused, missing],
            times_ns: times_ns(&headers, taps()),
            origin: &origin,
        })
    });
    sink.rows(&columns(name), rows)
}
