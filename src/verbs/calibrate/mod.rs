//! `tapline calibrate`: what full-scale samples of a station are worth, kept in a file that its configuration names.

#[cfg(feature = "alsa")]
mod heard;

use std::io::Write as _;
use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use jiff::civil::Date;
use jiff::{Timestamp, ToSpan as _, tz::TimeZone};
use serde_json::json;
use tapline_acquire::{CalibrationFile, ChannelScale};
use tapline_host::atomic_file::{Existing, write_atomically};
use tapline_host::messages::{print_line, say};
use tapline_host::stdout::Stdout;
use tapline_wire::{Certificate, Channel, Unit};

use crate::cli::calibrate::{CalibrateVerb, CalibrationFileArgs};

/// Longest note, so that there is room for how the scale was found.
const NOTE_BYTES_MAX: usize = 200;

/// Calibrates a channel, and writes it into the file of its station.
pub(crate) fn calibrate(verb: &CalibrateVerb) -> Result<bool> {
    match verb {
        #[cfg(feature = "alsa")]
        CalibrateVerb::Blows { known_n, count, heard, written } => {
            keep(written, Channel::Force, None, || heard::blows(known_n, *count, heard))
        }
        #[cfg(feature = "alsa")]
        CalibrateVerb::Tone { known_pa, frequency_hz, listen_s, heard, written } => {
            keep(written, Channel::Sound, None, || heard::tone(*known_pa, *frequency_hz, *listen_s, heard))
        }
        #[cfg(not(feature = "alsa"))]
        CalibrateVerb::Blows { .. } | CalibrateVerb::Tone { .. } => crate::cli::built_without("ALSA", "alsa"),
        CalibrateVerb::State { channel, full_scale_v, sensitivity_mv, gain, date, written } => {
            let found = stated(*channel, *full_scale_v, *sensitivity_mv, *gain)?;
            keep(written, *channel, *date, || Ok(found))
        }
    }
}

/// What was found of a channel.
struct Found {
    unit: Unit,
    full_scale: f64,
    /// Volts of a full-scale sample, where they are known.
    full_scale_v: Option<f64>,
    /// How it was found; the scale comes before it.
    method: String,
    sensitivity_mv_per_unit: Option<f64>,
    gain: Option<f64>,
}

fn stated(channel: Channel, full_scale_v: f64, sensitivity_mv: Option<f64>, gain: f64) -> Result<Found> {
    for (name, value) in
        [("--full-scale-v", Some(full_scale_v)), ("--sensitivity-mv", sensitivity_mv), ("--gain", Some(gain))]
    {
        ensure!(
            value.is_none_or(|value| value > 0.0 && value <= 1e9),
            "{name} is {}; it must be above 0 and at most 1e9",
            value.unwrap_or_default()
        );
    }
    let (unit, full_scale) = match (channel, sensitivity_mv) {
        (Channel::Force, Some(mv_per_n)) => (Unit::Newton, full_scale_v / gain / (1e-3 * mv_per_n)),
        (Channel::Sound, Some(mv_per_pa)) => (Unit::Pascal, full_scale_v / gain / (1e-3 * mv_per_pa)),
        (Channel::Sound, None) => (Unit::Volt, full_scale_v / gain),
        (Channel::Force, None) => bail!("--sensitivity-mv is missing: without it a force has no newtons"),
    };
    let of = sensitivity_mv.map_or_else(String::new, |mv| format!(" at {mv} mV/{}", unit.name()));
    let method = format!("as stated: {full_scale_v} V{of} and a gain of {gain}");
    let full_scale_v = Some(full_scale_v);
    Ok(Found { unit, full_scale, full_scale_v, method, sensitivity_mv_per_unit: sensitivity_mv, gain: Some(gain) })
}

/// The calibrations at `out` as they are.
///
/// # Errors
/// A file that cannot be read, or that has one of `channel` which may not be replaced.
fn present(written: &CalibrationFileArgs, channel: Channel) -> Result<CalibrationFile> {
    let CalibrationFileArgs { out, force, .. } = written;
    let file = if out.exists() { CalibrationFile::read(out)? } else { CalibrationFile::default() };
    let of_channel = match channel {
        Channel::Force => &file.force,
        Channel::Sound => &file.sound,
    };
    if of_channel.is_some() && !force {
        bail!(
            "{} has a calibration of the {} already: replace it with --force, which keeps the other channel, or give another file",
            out.display(),
            channel.name()
        );
    }
    Ok(file)
}

/// Writes what is found of `channel`, of `date` or today.
fn keep(
    written: &CalibrationFileArgs,
    channel: Channel,
    date: Option<Date>,
    find: impl FnOnce() -> Result<Found>,
) -> Result<bool> {
    let today = Timestamp::now().to_zoned(TimeZone::UTC).date();
    let date = date.unwrap_or(today);
    ensure!(date <= today, "--date is {date}; it must not be after today, {today} (UTC)");
    // Nobody should strike a sensor for a result that cannot be kept.
    present(written, channel)?;
    let note = written.note.as_deref().unwrap_or_default();
    ensure!(
        note.len() <= NOTE_BYTES_MAX && !note.chars().any(char::is_control),
        "--note has {} bytes; it must have at most {NOTE_BYTES_MAX}, on one line",
        note.len()
    );
    let found = find()?;
    // Another may have calibrated the other channel meanwhile.
    let mut file = present(written, channel)?;
    let CalibrationFileArgs { out, valid_days, json: as_json, .. } = written;
    let until =
        date.checked_add(i64::from(*valid_days).days()).context("--valid-days ends after the last possible date")?;
    let Found { unit, full_scale, full_scale_v, method, sensitivity_mv_per_unit, gain } = found;
    let (date, valid_until) = (date.to_string(), Some(until.to_string()));
    if until < today {
        say(&format!(
            "it was valid until {until}: casings that are tapped now have no valid calibration; --valid-days says how long it is"
        ));
    }
    let note = if note.is_empty() { String::new() } else { format!("; {note}") };
    let method = format!("{full_scale:.6} {} at full scale, {method}{note}", unit.name());
    let certificate = Certificate { method, date, valid_until, sensitivity_mv_per_unit, gain };
    let said = format!("{}: {}", channel.name(), certificate.method);
    let printed = json!({
        "file": out.display().to_string(), "channel": channel.name(), "unit": unit.name(), "full_scale": full_scale,
        "method": certificate.method, "date": certificate.date, "valid_until": certificate.valid_until,
    });
    let place = match channel {
        Channel::Force => &mut file.force,
        Channel::Sound => &mut file.sound,
    };
    let before = place.replace(ChannelScale { unit, full_scale, full_scale_v, certificate });
    write(out, &file)?;
    if let Some(before) = before.filter(|before| before.unit == unit) {
        let (was, of) = (before.full_scale, before.certificate.date);
        print_line(&format!("it was {was:.6} {} of {of}: {:+.2} %", unit.name(), 100.0 * (full_scale / was - 1.0)));
    }
    let said = if *as_json { printed.to_string() } else { format!("{said}\n{}: valid until {until}", out.display()) };
    writeln!(Stdout, "{said}")?;
    Ok(true)
}

fn write(out: &Path, file: &CalibrationFile) -> Result<()> {
    file.validate(&out.display().to_string())?;
    let text = toml::to_string(file).context("the calibration does not fit TOML")?;
    // Its other channel is in the text too.
    Ok(write_atomically(out, Existing::Replace, |mut file| file.write_all(text.as_bytes()))?)
}
