//! The taps of an archive as Universal Files: dataset 58b, functions of time in single precision, in SI units.
//!
//! A file begins with datasets 151 (header) and 164 (SI units); then every
//! channel of every tap is a dataset, in its unit, with time 0 at the trigger. This format has six digits for the
//! time step: the exact rate is in ID line 5.
//!
//! Source: the records of datasets 58, 58b, 151 and 164 as the Structural Dynamics Research Laboratory of the University of
//! Cincinnati publishes them.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use tapline_wire::{Channel, Scan, TapHeader, Unit};

use crate::Result;
use crate::error::Context as _;
use crate::fortran::{exponent, plain};
use crate::taps::scan_files::{List, ScanFormat};
use crate::taps::{ListedTap, Taps, known, physical};
use tapline_store::Reader;

/// Single precision, as dataset 58 numbers it.
const SINGLE: u32 = 2;

/// Universal Files; the part of a tap is the number of its first dataset 58.
#[derive(Debug)]
pub(crate) struct Uff;

impl ScanFormat for Uff {
    const ENDING: &'static str = "uff";

    fn write(&self, taps: &Taps<'_>, scan: &Scan, name: &str, path: &Path, list: &mut List<'_>) -> Result<()> {
        let mut out = BufWriter::new(File::create(path).context("create", path)?);
        let mut function_count = 0_u32;
        let mut is_begun = false;
        for &row in &scan.taps {
            let tap = taps.tap(row)?;
            let mut part = String::new();
            if let Ok((header, samples)) = &tap.record {
                if !is_begun {
                    let written = write_header(&mut out, scan, name, header.tap_time_ns);
                    written.and_then(|()| write_units(&mut out)).context("write", path)?;
                    is_begun = true;
                }
                part = (function_count + 1).to_string();
                for (k, (channel, unit_per_count)) in header.channels().enumerate() {
                    function_count += 1;
                    let values = physical(samples, k, header.sample_count as usize, unit_per_count);
                    let reader = taps.reader();
                    let function = Function { reader, tap: &tap, header, channel, number: function_count };
                    function.write(&mut out, &values).context("write", path)?;
                }
            }
            list(&tap, &part)?;
        }
        if !is_begun {
            write_header(&mut out, scan, name, 0).and_then(|()| write_units(&mut out)).context("write", path)?;
        }
        out.flush().context("write", path)
    }
}

fn write_header(out: &mut impl Write, scan: &Scan, name: &str, tap_time_ns: i64) -> io::Result<()> {
    let line = date_line(tap_time_ns);
    let (date, time) = line.split_once(' ').unwrap_or(("", ""));
    let program = format!("tapline {}", env!("CARGO_PKG_VERSION"));
    let what = plain(&format!("taps of tyre {} shoulder {}", scan.tyre, scan.shoulder), 80);
    writeln!(out, "{:6}\n{:6}{:74}", -1, 151, "")?;
    writeln!(out, "{:<80}\n{what:<80}\n{program:<80}", plain(name, 80))?;
    writeln!(out, "{date:<10}{time:<10}{:10}{:10}{:10}\n{date:<10}{time:<10}", 0, 0, 0)?;
    writeln!(out, "{program:<80}\n{date:<10}{time:<10}\n{:6}", -1)
}

/// Dataset 164: SI units, with the factor 1 for lengths, forces and temperatures.
fn write_units(out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "{:6}\n{:6}{:74}", -1, 164, "")?;
    writeln!(out, "{:10}{:<20}{:10}", 1, "SI: metre, newton", 2)?;
    let one = exponent(1.0, 25, 16, 'D');
    writeln!(out, "{one}{one}{one}\n{}", exponent(273.15, 25, 16, 'D'))?;
    writeln!(out, "{:6}", -1)
}

/// One channel of one tap.
struct Function<'a> {
    reader: &'a Reader,
    tap: &'a ListedTap<'a>,
    header: &'a TapHeader,
    channel: Channel,
    /// Number of the function in its file, from 1.
    number: u32,
}

impl Function<'_> {
    fn write(&self, out: &mut impl Write, values: &[f64]) -> io::Result<()> {
        // Little-endian, IEEE 754, 11 lines of text before the values.
        writeln!(
            out,
            "{:6}\n{:6}b{:6}{:6}{:12}{:12}{:6}{:6}{:12}{:12}",
            -1,
            58,
            1,
            2,
            11,
            4 * values.len(),
            0,
            0,
            0,
            0
        )?;
        for line in self.id_lines() {
            writeln!(out, "{:<80}", plain(&line, 80))?;
        }
        self.write_form(out, values.len())?;
        for &value in values {
            #[expect(clippy::cast_possible_truncation, reason = "24 bits hold a 16-bit count's value finely enough")]
            out.write_all(&(value as f32).to_le_bytes())?;
        }
        writeln!(out, "{:6}", -1)
    }

    /// The five ID lines: name and value of what identifies the function.
    fn id_lines(&self) -> [String; 5] {
        let (id, header) = (&self.header.id, self.header);
        let words = |pairs: &[(&str, String)]| {
            let known = pairs.iter().filter(|(_, value)| !value.is_empty());
            known.map(|(name, value)| format!("{name} {value}")).collect::<Vec<_>>().join(" ")
        };
        let line_2 = words(&[
            ("offset_mm", known(id.offset_mm())),
            ("velocity_m_per_s", known(id.velocity_m_per_s())),
            ("angle_deg", known(self.tap.planned.angle_deg)),
            ("repetition", id.repetition.to_string()),
        ]);
        let line_4 = words(&[
            ("station", id.station.to_string()),
            ("attempt", id.attempt.to_string()),
            ("velocity_measured_m_per_s", known(Some(header.velocity_measured_m_per_s))),
        ]);
        let line_5 = words(&[
            ("sample_rate_hz", known(Some(header.sample_rate_hz))),
            ("microphone_distance_m", known(Some(header.microphone_distance_m))),
            ("plan", format!("{:016x}", self.reader.plan().digest())),
        ]);
        [
            format!("{} tyre {} shoulder {} location {}", self.channel.name(), id.tyre, id.shoulder, id.location),
            line_2,
            date_line(header.tap_time_ns),
            line_4,
            line_5,
        ]
    }

    /// Records 6 to 11: degree of freedom, number and spacing of values, and the axes.
    fn write_form(&self, out: &mut impl Write, value_count: usize) -> io::Result<()> {
        let (id, header) = (&self.header.id, self.header);
        // A time response; the node is the location, counted from 0; direction 0 is a scalar.
        let (version, location) = (id.repetition, id.location);
        writeln!(
            out,
            "{:5}{:10}{:5}{:10} {:10}{location:10}{:4} {:10}{location:10}{:4}",
            1, self.number, version, 0, "NONE", 0, "NONE", 0
        )?;
        let step_s = 1.0 / header.sample_rate_hz;
        let first_s = -f64::from(header.pre_trigger_samples) * step_s;
        let numbers: String = [first_s, step_s, 0.0].map(|value| exponent(value, 13, 5, 'E')).concat();
        writeln!(out, "{:10}{value_count:10}{:10}{numbers}", SINGLE, 1)?;
        // Types: 17 time, 13 excitation force, 15 pressure, 0 a type that the list lacks.
        let unit = self.reader.plan().recording.calibration.unit(self.channel);
        let (kind, label) = match (self.channel, unit) {
            (Channel::Force, Unit::Newton) => (13, "Force"),
            (Channel::Force, _) => (0, "Force"),
            (Channel::Sound, Unit::Pascal) => (15, "Sound"),
            (Channel::Sound, _) => (0, "Sound"),
        };
        let unit = unit.name();
        for (kind, label, unit) in [(17, "Time", "s"), (kind, label, unit), (0, "NONE", "NONE"), (0, "NONE", "NONE")] {
            writeln!(out, "{kind:10}{:5}{:5}{:5} {label:<20} {unit:<20}", 0, 0, 0)?;
        }
        Ok(())
    }
}

/// Time of the tap in the form of dataset 58 (DD-MMM-YY HH:MM:SS, UTC); NONE if it is unknown.
fn date_line(tap_time_ns: i64) -> String {
    let known = Some(tap_time_ns).filter(|&ns| ns != 0);
    let time = known.and_then(|ns| jiff::Timestamp::from_nanosecond(ns.into()).ok());
    time.map_or_else(|| "NONE".to_owned(), |time| time.strftime("%d-%b-%y %H:%M:%S").to_string().to_uppercase())
}
