//! The damage map of one shoulder and the verdict on it.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

use crate::Stamp;

/// What is to be done with a casing's shoulder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Verdict {
    /// No damage was found, and every planned tap was there to find it.
    #[serde(rename = "PASS")]
    Pass,
    /// Something is doubtful or missing: a person must look, or the scan must be repeated.
    #[serde(rename = "RE-INSPECT")]
    ReInspect,
    /// Damage was found.
    #[serde(rename = "REJECT")]
    Reject,
}

impl Verdict {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Pass, Self::ReInspect, Self::Reject];

    /// Number that stands for the verdict on the wire and in archives; 0 is none.
    pub fn code(self) -> u32 {
        self as u32 + 1
    }

    /// The verdict that `code` stands for.
    pub fn from_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|v| v.code() == code)
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(["PASS", "RE-INSPECT", "REJECT"][*self as usize])
    }
}

/// Why a verdict is not PASS, or how it was reached: a set of flags.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, ZeroCopySend)]
pub struct Reasons(u32);

impl Reasons {
    /// A region's index exceeds the reject limit.
    pub const DAMAGE: Self = Self(1);
    /// A region's index exceeds the re-inspect limit only.
    pub const SUSPECT: Self = Self(1 << 1);
    /// The scan did not end.
    pub const NOT_ENDED: Self = Self(1 << 2);
    /// A planned tap was refused.
    pub const TAPS_REFUSED: Self = Self(1 << 3);
    /// A planned tap is missing without a reason.
    pub const TAPS_MISSING: Self = Self(1 << 4);
    /// A location has no usable value.
    pub const LOCATION_BLIND: Self = Self(1 << 5);
    /// The index could not be formed: no usable discriminator or no usable reference.
    pub const NO_INDEX: Self = Self(1 << 6);
    /// The shoulder was compared with itself, not with a known sound one.
    pub const SELF_REFERENCE: Self = Self(1 << 7);

    const NAMES: [(Self, &'static str); 8] = [
        (Self::DAMAGE, "damage"),
        (Self::SUSPECT, "suspect"),
        (Self::NOT_ENDED, "not_ended"),
        (Self::TAPS_REFUSED, "taps_refused"),
        (Self::TAPS_MISSING, "taps_missing"),
        (Self::LOCATION_BLIND, "location_blind"),
        (Self::NO_INDEX, "no_index"),
        (Self::SELF_REFERENCE, "self_reference"),
    ];

    /// Whether every flag of `other` is set.
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Adds the flags of `other`.
    pub fn insert(&mut self, other: Self) {
        self.0 |= other.0;
    }

    /// The flags as a number, as the archive stores them.
    pub fn bits(self) -> u32 {
        self.0
    }

    /// The flags that `bits` stands for.
    pub fn from_bits(bits: u32) -> Self {
        Self(bits)
    }
}

impl fmt::Display for Reasons {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        for (flag, name) in Self::NAMES {
            if self.contains(flag) {
                write!(f, "{separator}{name}")?;
                separator = "|";
            }
        }
        Ok(())
    }
}

impl fmt::Debug for Reasons {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Reasons({self})")
    }
}

/// Damage at one location of one shoulder, all its taps taken together.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("tapline.DamageCell.v1")]
pub struct DamageCell {
    /// Index along the ring or line.
    pub location: u32,
    /// Number of the region the location lies in, from 1; 0 outside every region.
    pub region: u32,
    /// Angle in degrees, NaN when unknown.
    pub angle_deg: f64,
    /// Damage index, NaN when no value could be formed.
    pub damage_index: f64,
    /// Chance of such an index on a sound location, NaN when not computed.
    pub p_value: f64,
    /// Taps that entered the index.
    pub tap_count: u32,
    /// Discriminators of the location's taps that were absent and left out.
    pub absent_count: u32,
}

impl Default for DamageCell {
    fn default() -> Self {
        Self {
            location: 0,
            region: 0,
            angle_deg: f64::NAN,
            damage_index: f64::NAN,
            p_value: f64::NAN,
            tap_count: 0,
            absent_count: 0,
        }
    }
}

/// The verdict on one shoulder; the cells of its damage map follow it.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
#[type_name("tapline.Judgement.v1")]
pub struct Judgement {
    /// Which record this is; `stamp.mark` is the number of the scan.
    pub stamp: Stamp,
    /// [`Verdict::code`].
    pub verdict: u32,
    /// Why.
    pub reasons: Reasons,
    /// Index at and above which a location is suspect.
    pub limit_re_inspect: f64,
    /// Index at and above which a region is damage.
    pub limit_reject: f64,
    /// Taps planned for the shoulder, the closing tap among them.
    pub planned_count: u32,
    /// Taps that came.
    pub received_count: u32,
    /// Taps that were refused with a reason.
    pub refused_count: u32,
    /// Discriminators that were absent and left out.
    pub absent_count: u32,
}
