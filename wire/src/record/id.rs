//! The name of a tap: which impact, where, how, and which try.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

/// Longest serial number of a tyre, in bytes.
pub const SERIAL_BYTES: usize = 32;

/// A value that was not recorded, in the fields that hold scaled integers.
const UNKNOWN: i32 = i32::MIN;

/// Serial number of a tyre: up to [`SERIAL_BYTES`] bytes of UTF-8, padded with zeros.
#[repr(C)]
#[derive(
    Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, ZeroCopySend, bytemuck::Pod, bytemuck::Zeroable,
)]
pub struct Serial([u8; SERIAL_BYTES]);

impl Serial {
    /// The serial number that `text` spells.
    ///
    /// # Errors
    /// [`IdError::Serial`] when `text` is empty, longer than [`SERIAL_BYTES`] bytes, begins or ends with white space, or
    /// holds a slash (a serial is part of file names and of `TYRE/SHOULDER`), a control character, or one that is
    /// invisible or reverses the text direction: serials that look alike must be the same.
    pub fn new(text: &str) -> Result<Self, IdError> {
        let fault = match text {
            _ if text.is_empty() || text.len() > SERIAL_BYTES => Some(format!("has {} bytes", text.len())),
            _ if text.contains('/') => Some("holds '/'".to_owned()),
            _ if text.trim() != text => Some("has white space at an end".to_owned()),
            _ => text.chars().find(|&c| c.is_control() || is_unseen(c)).map(|c| format!("holds {:?}", c)),
        };
        if let Some(fault) = fault {
            return Err(IdError::Serial { text: text.to_owned(), fault });
        }
        let mut bytes = [0; SERIAL_BYTES];
        bytes[..text.len()].copy_from_slice(text.as_bytes());
        Ok(Self(bytes))
    }

    /// The serial number as text.
    pub fn as_str(&self) -> &str {
        let end = self.0.iter().position(|&b| b == 0).unwrap_or(SERIAL_BYTES);
        std::str::from_utf8(&self.0[..end]).unwrap_or("")
    }
}

impl fmt::Display for Serial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl fmt::Debug for Serial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.as_str())
    }
}

/// Whether `c` is a format character: invisible, and some change the text around them.
pub fn is_unseen(c: char) -> bool {
    matches!(c,
        '\u{ad}' | '\u{34f}' | '\u{61c}' | '\u{180b}'..='\u{180f}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}'
        | '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
}

/// Permanent name of a tap: no two taps of a run share it, and every record derived from a tap carries it.
///
/// Offset and velocity are the *planned* ones, held as integers so that they compare and hash
/// exactly; the measured velocity is in the tap's header.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, ZeroCopySend, bytemuck::Pod, bytemuck::Zeroable)]
pub struct TapId {
    /// Serial number of the casing.
    pub tyre: Serial,
    /// Rig that made the tap.
    pub station: u16,
    /// Side of the casing, 1 or 2 (a line of a slab in other geometries).
    pub shoulder: u16,
    /// Offset x from the belt edge in micrometres, or [`i32::MIN`] when unknown.
    offset_um: i32,
    /// Planned impact velocity in micrometres per second, or [`i32::MIN`] when unknown.
    velocity_um_per_s: i32,
    /// Index along the ring or line; the closing tap of a ring carries the number of its locations.
    pub location: u32,
    /// Which of the planned repetitions.
    pub repetition: u16,
    /// How many times this tap was refused and taken again before this record.
    pub attempt: u16,
}

impl Default for TapId {
    fn default() -> Self {
        Self {
            tyre: Serial::default(),
            station: 0,
            shoulder: 0,
            offset_um: UNKNOWN,
            velocity_um_per_s: UNKNOWN,
            location: 0,
            repetition: 0,
            attempt: 0,
        }
    }
}

impl TapId {
    /// The first repetition of the tap at `location` of a shoulder, offset and velocity unknown.
    pub fn new(station: u16, tyre: Serial, shoulder: u16, location: u32) -> Self {
        Self { station, tyre, shoulder, location, ..Self::default() }
    }

    /// Offset x from the belt edge in mm, `None` when unknown.
    pub fn offset_mm(&self) -> Option<f64> {
        (self.offset_um != UNKNOWN).then(|| f64::from(self.offset_um) / 1e3)
    }

    /// Planned impact velocity in m/s, `None` when unknown.
    pub fn velocity_m_per_s(&self) -> Option<f64> {
        (self.velocity_um_per_s != UNKNOWN).then(|| f64::from(self.velocity_um_per_s) / 1e6)
    }

    /// The same tap at `offset_mm` from the belt edge, to the micrometre.
    ///
    /// # Errors
    /// [`IdError::OutOfRange`] beyond +-2000 mm or when not finite.
    pub fn with_offset_mm(mut self, offset_mm: Option<f64>) -> Result<Self, IdError> {
        self.offset_um = scaled("offset_mm", offset_mm, 1e3, -2000.0, 2000.0)?;
        Ok(self)
    }

    /// The same tap at the planned `velocity_m_per_s`, to the micrometre per second.
    ///
    /// # Errors
    /// [`IdError::OutOfRange`] outside 0 to 1000 m/s or when not finite.
    pub fn with_velocity_m_per_s(mut self, velocity_m_per_s: Option<f64>) -> Result<Self, IdError> {
        self.velocity_um_per_s = scaled("velocity_m_per_s", velocity_m_per_s, 1e6, 0.0, 1000.0)?;
        Ok(self)
    }

    /// This tap as the plan lists it: the first attempt.
    pub fn planned(mut self) -> Self {
        self.attempt = 0;
        self
    }
}

#[expect(clippy::cast_possible_truncation, reason = "the bounds checked just before fit an i32")]
fn scaled(name: &'static str, value: Option<f64>, scale: f64, low: f64, high: f64) -> Result<i32, IdError> {
    match value {
        None => Ok(UNKNOWN),
        Some(v) if (low..=high).contains(&v) => Ok((v * scale).round() as i32),
        Some(value) => Err(IdError::OutOfRange { name, value, low, high }),
    }
}

impl fmt::Display for TapId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "station {} tyre {} shoulder {} location {}", self.station, self.tyre, self.shoulder, self.location)?;
        if let Some(x) = self.offset_mm() {
            write!(f, " x {x} mm")?;
        }
        if let Some(v) = self.velocity_m_per_s() {
            write!(f, " {v} m/s")?;
        }
        write!(f, " repetition {} attempt {}", self.repetition, self.attempt)
    }
}

impl fmt::Debug for TapId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "TapId({self})")
    }
}

/// Why a [`TapId`] or a part of it cannot be formed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the message of a variant says what its fields are")]
#[non_exhaustive]
pub enum IdError {
    /// The serial number does not fit.
    #[error("tyre serial {text:?} {fault}; it must be {}", self.bound())]
    Serial { text: String, fault: String },
    /// A number lies outside its bounds.
    #[error("{name} is {value}; it must lie in {low} to {high}")]
    OutOfRange { name: &'static str, value: f64, low: f64, high: f64 },
}

impl IdError {
    /// What is required, for use after "it must be".
    pub fn bound(&self) -> String {
        match self {
            Self::Serial { .. } => format!(
                "of 1 to {SERIAL_BYTES} bytes, without '/', white space at its ends, control or invisible characters"
            ),
            Self::OutOfRange { low, high, .. } => format!("from {low} to {high}"),
        }
    }
}

/// Shape of what is scanned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Geometry {
    /// Locations on a circle: the last is a neighbour of the first.
    #[default]
    Ring,
    /// Locations on a line: the ends have one neighbour.
    Line,
}

named!(Geometry, Ring = "ring", Line = "line");

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_serial_is_what_was_given_or_refused() {
        for text in ["3900_06cm", "T 1", "Ä-17", "轮胎", "=1"] {
            assert_eq!(Serial::new(text).unwrap().as_str(), text);
        }
        assert_eq!(Serial::new(&"x".repeat(32)).unwrap().as_str().len(), 32);
        for text in [
            "",
            &"x".repeat(33),
            "a/b",
            "a\nb",
            " a",
            "a ",
            "\u{a0}a",
            "a\u{202e}b",
            "\u{200f}a",
            "a\u{2066}b",
            "a\u{200b}",
            "\u{feff}a",
            "\u{61c}",
        ] {
            let error = Serial::new(text).unwrap_err().to_string();
            let has_length = (1..=SERIAL_BYTES).contains(&text.len()) || error.contains(&text.len().to_string());
            assert!(has_length && error.contains("1 to 32"), "{error}");
            assert!(!error.chars().any(|c| c.is_control() || is_unseen(c)), "what is refused is shown: {error}");
        }
    }

    #[test]
    fn what_is_out_of_range_is_refused_with_its_bounds() {
        let id = TapId::default();
        let error = id.with_offset_mm(Some(2000.1)).unwrap_err().to_string();
        assert!(error.contains("offset_mm") && error.contains("2000.1") && error.contains("-2000"), "{error}");
        assert!(id.with_velocity_m_per_s(Some(f64::NAN)).is_err());
        assert!(id.with_velocity_m_per_s(Some(-0.1)).is_err());
        assert_eq!(id.with_offset_mm(None).unwrap().offset_mm(), None);
    }

    proptest! {
        /// What a table gives with up to three (mm) or six (m/s) decimals comes back as the same number.
        #[test]
        fn decimals_come_back_exactly(offset_um in -2_000_000..=2_000_000_i32, velocity_um_per_s in 0..=1_000_000_000_i32) {
            let offset_mm: f64 = format!("{}e-3", offset_um).parse().unwrap();
            let velocity_m_per_s: f64 = format!("{}e-6", velocity_um_per_s).parse().unwrap();
            let id = TapId::default().with_offset_mm(Some(offset_mm)).unwrap();
            let id = id.with_velocity_m_per_s(Some(velocity_m_per_s)).unwrap();
            prop_assert_eq!((id.offset_mm(), id.velocity_m_per_s()), (Some(offset_mm), Some(velocity_m_per_s)));
        }

        #[test]
        fn any_text_is_a_serial_or_refused(text in ".*") {
            if let Ok(serial) = Serial::new(&text) {
                prop_assert_eq!(serial.as_str(), text);
            }
        }
    }
}
