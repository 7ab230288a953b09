//! Tables of an archive as CSV: absent is an empty cell, numbers are the shortest text that reads back the same.

use std::io;

use tapline_wire::{Discriminator, Judgement, PlannedTap, Reasons, ScanState, TapState, Verdict};

use crate::reader::Reader;
use crate::regions::regions;
use crate::{Error, Result};

/// A table that can be exported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Export {
    /// What was found in every archived tap.
    Discriminators,
    /// The damage index of every location of the judged scans.
    Damage,
    /// The arcs of damage of the judged scans.
    Regions,
    /// The verdict on every scan.
    Verdicts,
    /// The state of every planned tap.
    Ledger,
}

impl Export {
    /// All five.
    pub const ALL: [Self; 5] = [Self::Discriminators, Self::Damage, Self::Regions, Self::Verdicts, Self::Ledger];

    /// The table's name on the command line.
    pub fn name(self) -> &'static str {
        ["discriminators", "damage", "regions", "verdicts", "ledger"][self as usize]
    }

    /// The table of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|table| table.name() == name)
    }
}

/// Writes `table` of the archive to `out` as CSV with a header line.
///
/// # Errors
/// [`Error::Csv`] when `out` fails, or what reading the archive gives.
pub fn export(reader: &Reader, table: Export, out: impl io::Write) -> Result<()> {
    let mut out = csv::Writer::from_writer(out);
    match table {
        Export::Discriminators => discriminators(reader, &mut out),
        Export::Damage => damage(reader, &mut out),
        Export::Regions => arcs(reader, &mut out),
        Export::Verdicts => verdicts(reader, &mut out),
        Export::Ledger => ledger(reader, &mut out),
    }?;
    out.flush().map_err(|error| Error::Csv(error.into()))
}

type Out<W> = csv::Writer<W>;

/// Columns that name a planned tap.
const TAP_COLUMNS: [&str; 8] =
    ["station", "tyre", "shoulder", "offset_mm", "velocity_m_per_s", "location", "angle_deg", "repetition"];

fn tap_cells(tap: &PlannedTap) -> [String; 8] {
    let id = &tap.id;
    [
        id.station.to_string(),
        id.tyre.to_string(),
        id.shoulder.to_string(),
        number(id.offset_mm()),
        number(id.velocity_m_per_s()),
        id.location.to_string(),
        number(tap.angle_deg),
        id.repetition.to_string(),
    ]
}

fn number(value: Option<f64>) -> String {
    let text = |v: f64| if v != 0.0 && v.abs() < 1e-5 { format!("{v:e}") } else { v.to_string() };
    value.filter(|v| v.is_finite()).map_or_else(String::new, text)
}

fn discriminators<W: io::Write>(reader: &Reader, out: &mut Out<W>) -> Result<()> {
    let columns = Discriminator::ALL.map(Discriminator::column);
    out.write_record(TAP_COLUMNS.iter().chain(&["attempt"]).chain(&columns).chain(&["quality"]))?;
    for (tap, found) in reader.plan().taps().iter().zip(reader.discriminators()?) {
        let Some(found) = found else { continue };
        let values = Discriminator::ALL.map(|which| number(found.values.get(which)));
        let ends = [found.id.attempt.to_string(), found.quality.to_string()];
        out.write_record(tap_cells(tap).iter().chain(&ends[..1]).chain(&values).chain(&ends[1..]))?;
    }
    Ok(())
}

fn damage<W: io::Write>(reader: &Reader, out: &mut Out<W>) -> Result<()> {
    out.write_record(["tyre", "shoulder", "location", "angle_deg", "damage_index", "p_value"])?;
    for (scan, judged) in reader.plan().scans().iter().zip(reader.judgements()?) {
        for cell in judged.map_or_else(Vec::new, |(_, cells)| cells) {
            out.write_record([
                scan.tyre.to_string(),
                scan.shoulder.to_string(),
                cell.location.to_string(),
                number(Some(cell.angle_deg)),
                number(Some(cell.damage_index)),
                number(Some(cell.p_value)),
            ])?;
        }
    }
    Ok(())
}

fn arcs<W: io::Write>(reader: &Reader, out: &mut Out<W>) -> Result<()> {
    out.write_record([
        "tyre",
        "shoulder",
        "region",
        "first_location",
        "last_location",
        "start_deg",
        "end_deg",
        "peak_location",
        "peak_angle_deg",
        "peak_damage_index",
        "extent_locations",
        "extent_deg",
        "mean_damage_index",
        "p_value",
        "offset_best_mm",
        "offset_low_mm",
        "offset_high_mm",
    ])?;
    for (scan, judged) in reader.plan().scans().iter().zip(reader.judgements()?) {
        let cells = judged.map_or_else(Vec::new, |(_, cells)| cells);
        for region in regions(reader.plan().geometry, &cells) {
            out.write_record([
                scan.tyre.to_string(),
                scan.shoulder.to_string(),
                region.region.to_string(),
                region.first_location.to_string(),
                region.last_location.to_string(),
                number(region.start_deg),
                number(region.end_deg),
                region.peak_location.to_string(),
                number(region.peak_angle_deg),
                number(region.peak_damage_index),
                region.extent_locations.to_string(),
                number(region.extent_deg),
                number(region.mean_damage_index),
                number(region.p_value),
                number(region.offset_best_mm),
                number(region.offset_low_mm),
                number(region.offset_high_mm),
            ])?;
        }
    }
    Ok(())
}

fn verdicts<W: io::Write>(reader: &Reader, out: &mut Out<W>) -> Result<()> {
    let names = |prefix: &str| Discriminator::ALL.map(|which| format!("{prefix}_{}", which.name()));
    let columns = [
        "tyre",
        "shoulder",
        "station",
        "verdict",
        "reasons",
        "planned_count",
        "archived_count",
        "refused_count",
        "missing_count",
        "absent_count",
        "region_count",
        "limit_re_inspect",
        "limit_reject",
        "false_call_rate",
        "p_value",
    ];
    let columns = columns.map(str::to_owned).into_iter().chain(names("evidence")).chain(names("drift"));
    out.write_record(columns)?;
    let states = reader.ledger().taps();
    for (number_of_scan, (scan, judged)) in reader.plan().scans().iter().zip(reader.judgements()?).enumerate() {
        let count = |state| scan.taps.iter().filter(|&&row| states[row as usize] == state).count();
        let mut cells = vec![scan.tyre.to_string(), scan.shoulder.to_string(), scan.station.to_string()];
        let known = judged.as_ref().and_then(|(j, map)| Verdict::from_code(j.verdict).map(|v| (v, j.reasons, j, map)));
        match &known {
            Some((verdict, reasons, ..)) => cells.extend([verdict.to_string(), reasons.to_string()]),
            // No verdict, no PASS: whoever reads the table alone must look.
            None => {
                let has_ended = reader.ledger().scans()[number_of_scan] != ScanState::Open;
                let reasons = if has_ended { Reasons::NO_INDEX } else { Reasons::NOT_ENDED };
                cells.extend([Verdict::ReInspect.to_string(), reasons.to_string()]);
            }
        }
        cells.push(scan.taps.len().to_string());
        cells.extend([TapState::Archived, TapState::Refused, TapState::Missing].map(|s| count(s).to_string()));
        cells.extend(match known {
            Some((_, _, judgement, map)) => {
                let counts = [judgement.absent_count as usize, regions(reader.plan().geometry, map).len()];
                let Judgement { limit_re_inspect, limit_reject, false_call_rate, p_value, evidence, drift, .. } =
                    *judgement;
                let numbers = [limit_re_inspect, limit_reject, false_call_rate, p_value];
                let numbers = numbers.into_iter().chain(evidence).chain(drift).map(|value| number(Some(value)));
                counts.iter().map(ToString::to_string).chain(numbers).collect()
            }
            None => vec![String::new(); 6 + 2 * Discriminator::ALL.len()],
        });
        out.write_record(&cells)?;
    }
    Ok(())
}

fn ledger<W: io::Write>(reader: &Reader, out: &mut Out<W>) -> Result<()> {
    out.write_record(TAP_COLUMNS.iter().chain(&["state", "attempt", "reason"]))?;
    let mut refusals = reader.refusals()?.into_iter().peekable();
    for (row, (tap, state)) in (0..).zip(reader.plan().taps().iter().zip(reader.ledger().taps())) {
        let attempt = reader.attempt(row).map_or_else(String::new, |attempt| attempt.to_string());
        let reason = refusals.next_if(|r| r.plan_index == row).map_or_else(String::new, |r| r.reason);
        out.write_record(tap_cells(tap).iter().chain(&[state.name().to_owned(), attempt, reason]))?;
    }
    Ok(())
}
