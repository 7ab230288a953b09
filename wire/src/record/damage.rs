//! The damage map of one shoulder and the verdict on it.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

use crate::record::discriminators::Discriminator;
use crate::{Reasons, Stamp, Stamped};

/// What to do with a casing's shoulder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Verdict {
    /// No damage was found, and every planned tap was there to find it.
    #[serde(rename = "PASS")]
    Pass,
    /// Something is doubtful or missing: a person must inspect it, or the scan must be repeated.
    #[serde(rename = "RE-INSPECT")]
    ReInspect,
    /// Damage was found.
    #[serde(rename = "REJECT")]
    Reject,
}

// 0 is none.
coded!(Verdict: u32, Pass = 1, ReInspect = 2, Reject = 3);

impl Verdict {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Pass, Self::ReInspect, Self::Reject];
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(["PASS", "RE-INSPECT", "REJECT"][*self as usize])
    }
}

/// Damage at one location of one shoulder, all its taps taken together.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("tapline.DamageCell.v2")]
pub struct DamageCell {
    /// Index along the ring or line.
    pub location: u32,
    /// Number of the region the location lies in, from 1; 0 outside every region.
    pub region: u32,
    /// Angle in degrees, NaN when unknown.
    pub angle_deg: f64,
    /// Damage index: how far the location and its neighbours stand out, on the scale of the limits; NaN if no value could be
    /// formed.
    pub damage_index: f64,
    /// The same from the first reading only; NaN if nothing on the shoulder was tapped again.
    pub first_index: f64,
    /// Probability that the strongest arc of a sound shoulder stands out as far; NaN when not computed.
    pub p_value: f64,
    /// How far the strongest arc of the location's region stands out, on the scale of the limits; NaN outside of regions.
    pub region_index: f64,
    /// Probability that the strongest arc of a sound shoulder stands out as far; NaN outside of regions.
    pub region_p_value: f64,
    /// Offset from the belt edge, in mm, at which the location's region shows most; NaN outside of regions and where no
    /// offset is known.
    pub offset_best_mm: f64,
    /// Least offset, in mm, at which the region shows.
    pub offset_low_mm: f64,
    /// Greatest offset, in mm, at which the region shows.
    pub offset_high_mm: f64,
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
            first_index: f64::NAN,
            p_value: f64::NAN,
            region_index: f64::NAN,
            region_p_value: f64::NAN,
            offset_best_mm: f64::NAN,
            offset_low_mm: f64::NAN,
            offset_high_mm: f64::NAN,
            tap_count: 0,
            absent_count: 0,
        }
    }
}

/// The verdict on one shoulder; the cells of its damage map follow it.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("tapline.Judgement.v4")]
pub struct Judgement {
    /// Which record this is; `stamp.mark` is the number of the scan.
    pub stamp: Stamp,
    /// [`Verdict::code`].
    pub verdict: u32,
    /// Why.
    pub reasons: Reasons,
    /// How far the strongest arc must stand out for the shoulder to be inspected again.
    pub limit_re_inspect: f64,
    /// The same for the shoulder to be rejected.
    pub limit_reject: f64,
    /// How far it stands out.
    pub strongest_arc: f64,
    /// The same from the first reading only; NaN if nothing was tapped again.
    pub first_strongest_arc: f64,
    /// Probability that a sound shoulder is not passed, from which the first limit was set.
    pub re_inspect_rate: f64,
    /// Probability that a sound shoulder is rejected, from which the second limit was set.
    pub reject_rate: f64,
    /// Probability that the strongest arc of a sound shoulder stands out as far.
    pub p_value: f64,
    /// Mean score of each discriminator, in the order of [`Discriminator::ALL`](crate::Discriminator::ALL), where the index
    /// is highest: the evidence of damage there; NaN where it has none.
    pub evidence: [f64; Discriminator::COUNT],
    /// Scatter of each discriminator from place to place, as a multiple of its scatter in the reference; NaN where it is
    /// not known.
    pub scatter: [f64; Discriminator::COUNT],
    /// Level of each discriminator, its median over the places of a turn, as a multiple of the reference's; the geometric mean of
    /// all turns, NaN where it is not known.
    pub level: [f64; Discriminator::COUNT],
    /// Change of each discriminator from the first to the closing tap of a turn, as a share of its level, the median of
    /// all turns; NaN where there is no closing tap.
    pub drift: [f64; Discriminator::COUNT],
    /// Taps planned for the shoulder, the closing tap among them.
    pub planned_count: u32,
    /// Taps that came.
    pub received_count: u32,
    /// Taps that were refused with a reason.
    pub refused_count: u32,
    /// Discriminators that were absent and left out.
    pub absent_count: u32,
}

impl Default for Judgement {
    fn default() -> Self {
        Self {
            stamp: Stamp::default(),
            verdict: 0,
            reasons: Reasons::default(),
            limit_re_inspect: f64::NAN,
            limit_reject: f64::NAN,
            strongest_arc: f64::NAN,
            first_strongest_arc: f64::NAN,
            re_inspect_rate: f64::NAN,
            reject_rate: f64::NAN,
            p_value: f64::NAN,
            evidence: [f64::NAN; Discriminator::COUNT],
            scatter: [f64::NAN; Discriminator::COUNT],
            level: [f64::NAN; Discriminator::COUNT],
            drift: [f64::NAN; Discriminator::COUNT],
            planned_count: 0,
            received_count: 0,
            refused_count: 0,
            absent_count: 0,
        }
    }
}

impl Judgement {
    /// The discriminators whose [`scatter`](Self::scatter) is known.
    pub fn known_scatter(&self) -> impl Iterator<Item = (Discriminator, f64)> {
        known(self.scatter)
    }

    /// Those whose [`level`](Self::level) is known.
    pub fn known_level(&self) -> impl Iterator<Item = (Discriminator, f64)> {
        known(self.level)
    }
}

fn known(times: [f64; Discriminator::COUNT]) -> impl Iterator<Item = (Discriminator, f64)> {
    Discriminator::ALL.into_iter().zip(times).filter(|(_, times)| times.is_finite())
}

impl Stamped for Judgement {
    fn stamp(&self) -> &Stamp {
        &self.stamp
    }
    fn stamp_mut(&mut self) -> &mut Stamp {
        &mut self.stamp
    }
}
