//! Optional columns of `taps.csv`: what an archive knows of a tap and a recorder does not.
//!
//! Each column may be missing and each cell empty; then the set or its reader decides.

use tapline_wire::{Channel, Geometry, Purpose, RETAKES_MAX, Unit, csv_text};

use crate::Error;
use crate::config::calibration::FULL_SCALE_MAX;
use crate::tap_set::scan_toml::{FullScale, MICROPHONE_DISTANCE_M_MAX};
use crate::tap_set::table::Row;

/// The measured velocity; `velocity_m_per_s` is then the planned one.
pub(crate) const MEASURED: &str = "velocity_measured_m_per_s";

/// The columns.
pub(crate) const COLUMNS: &[&str] = &[
    MEASURED, "station", "attempt", "purpose", "tap_time_ns", "force_full_scale_n", "sound_full_scale_v",
    "sound_full_scale_pa", "microphone_distance_m", "refused",
];

/// The values of the optional columns for one tap.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Extras {
    /// Station that made the tap; without it the reader distributes casings over its stations.
    pub station: Option<u16>,
    /// How often the tap was taken before this record.
    pub attempt: u16,
    /// Purpose of the tap; without it, angle and location decide whether it closes its ring.
    pub purpose: Option<Purpose>,
    /// Time of the impact, ns since the Unix epoch; 0 if the list has none.
    pub tap_time_ns: i64,
    /// Newtons of a full-scale sample of this tap, if it differs from the set's.
    pub force_full_scale_n: Option<f64>,
    /// Volts of a full-scale sample of this tap, if it differs from the set's.
    pub sound_full_scale_v: Option<f64>,
    /// Pascals of a full-scale sample, if it is not in volts.
    pub sound_full_scale_pa: Option<f64>,
    /// Distance from impact to microphone in m, if it differs from the set's.
    pub microphone_distance_m: Option<f64>,
    /// Why the tap has no recording.
    pub refused: Option<String>,
}

impl Extras {
    /// What a full-scale sample of `channel` is worth, where the list says it of this tap.
    pub(crate) fn full_scale(&self, channel: Channel) -> Option<FullScale> {
        match channel {
            Channel::Force => self.force_full_scale_n.map(|n| (n, Unit::Newton)),
            Channel::Sound => {
                let pascals = self.sound_full_scale_pa.map(|pa| (pa, Unit::Pascal));
                self.sound_full_scale_v.map(|v| (v, Unit::Volt)).or(pascals)
            }
        }
    }

    /// Reads the optional columns of `row`.
    pub(crate) fn from_row(row: &Row<'_>, geometry: Geometry) -> Result<Self, Error> {
        let full_scale = |column| row.number(column, (0.0, false), FULL_SCALE_MAX);
        let purpose = match row.text("purpose") {
            "" => None,
            name => {
                let purpose = Purpose::from_name(name);
                Some(purpose.ok_or_else(|| row.refuse("purpose", "scan, closing, suspect, control or empty"))?)
            }
        };
        if geometry == Geometry::Line && purpose == Some(Purpose::Closing) {
            return Err(row.refuse("purpose", "not closing: a line has no end to close"));
        }
        Ok(Self {
            station: row.whole("station", 1, u16::MAX)?,
            attempt: row.whole("attempt", 0, RETAKES_MAX)?.unwrap_or(0),
            purpose,
            tap_time_ns: time_ns(row)?,
            force_full_scale_n: full_scale("force_full_scale_n")?,
            sound_full_scale_v: full_scale("sound_full_scale_v")?,
            sound_full_scale_pa: full_scale("sound_full_scale_pa")?,
            microphone_distance_m: row.number("microphone_distance_m", (0.0, true), MICROPHONE_DISTANCE_M_MAX)?,
            refused: Some(csv_text(row.text("refused"))).filter(|reason| !reason.is_empty()).map(str::to_owned),
        })
    }
}

fn time_ns(row: &Row<'_>) -> Result<i64, Error> {
    let text = row.text("tap_time_ns");
    if text.is_empty() {
        return Ok(0);
    }
    let bound = "a whole number of ns since the Unix epoch, not below 0, or empty when unknown";
    text.parse().ok().filter(|time_ns| *time_ns >= 0).ok_or_else(|| row.refuse("tap_time_ns", bound))
}
