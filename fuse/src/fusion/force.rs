//! What a scan shows of its force sensor and velocities that no single tap does.

use tapline_wire::{Channel, Discriminator};

use crate::fusion::Fusion;
use crate::fusion::compared::Compared;
use crate::shoulder::{Shoulder, Turn};
use crate::stats::median;

/// Smallest rise of the impulse, as a logarithm, that is off. If the force of a half is 20 % off, one half lies 9 % above the
/// median.
const RISE_OFF: f64 = 0.08;
/// Least fall that is off, likewise: a layer over a crack takes up to 15 % of the impulse.
const FALL_OFF: f64 = 0.17;
/// Largest change of the contact time in such a case; most cracks lengthen it more.
const TAU_SAME: f64 = 0.035;

/// How far F_max tau and tau lie from a level, as logarithms.
///
/// The impulse of an impact is F_max tau up to a factor: a stiffer or softer place changes both, but not their product.
#[derive(Debug, Clone, Copy)]
struct Impulse {
    impulse: f64,
    tau: f64,
}

impl Impulse {
    /// The impulse at one place of `turn`; `None` where F_max or tau is absent.
    fn at(turn: &Turn, place: usize) -> Option<Self> {
        let (force, tau) = (turn.log(Discriminator::FMax)[place], turn.log(Discriminator::Tau)[place]);
        Some(Self { impulse: force + tau, tau }).filter(|found| found.impulse.is_finite())
    }

    /// The medians of F_max tau and of tau.
    fn median(of: impl Iterator<Item = Self>) -> Option<Self> {
        let (mut impulse, mut tau): (Vec<f64>, Vec<f64>) = of.map(|found| (found.impulse, found.tau)).unzip();
        Some(Self { impulse: median(&mut impulse)?, tau: median(&mut tau)? })
    }

    /// Whether only the gain of the sensor explains how far it lies from `level`.
    fn is_off(self, level: Self) -> bool {
        let (change, tau_change) = (self.impulse - level.impulse, self.tau - level.tau);
        !(-FALL_OFF..=RISE_OFF).contains(&change) && tau_change.abs() < TAU_SAME
    }
}

impl Compared {
    /// Whether the force of a part of scan number `scan` is off: of three neighbours in a turn and those beside them, by medians, or of a turn
    /// among those of its velocity.
    pub(super) fn is_force_off(&self, scan: usize) -> bool {
        let shoulder = self.scans.iter().position(|&s| s == scan).map(|number| &self.shoulders[number]);
        shoulder.is_some_and(|shoulder| {
            let levels: Vec<(Option<u64>, Impulse)> = (shoulder.turns.iter())
                .filter(|turn| turn.controls.is_none())
                .filter_map(|turn| {
                    let velocity = self.conditions.name(turn.condition).1.map(f64::to_bits);
                    let all = (0..shoulder.place_count()).filter_map(|place| Impulse::at(turn, place));
                    Some((velocity, Impulse::median(all)?))
                })
                .collect();
            let of_velocity = |velocity| levels.iter().filter(move |(v, _)| *v == velocity).map(|(_, level)| *level);
            let is_turn_off = |(velocity, level): &(Option<u64>, Impulse)| {
                Impulse::median(of_velocity(*velocity)).is_some_and(|usual| level.is_off(usual))
            };
            levels.iter().any(is_turn_off) || shoulder.turns.iter().any(|turn| has_places_off(shoulder, turn))
        })
    }
}

fn has_places_off(shoulder: &Shoulder, turn: &Turn) -> bool {
    let at: Vec<Option<Impulse>> = (0..shoulder.place_count()).map(|place| Impulse::at(turn, place)).collect();
    let Some(level) = Impulse::median(at.iter().flatten().copied()) else { return false };
    let off = |place: &usize| {
        let near: Vec<Impulse> = shoulder.ring.with_neighbours(*place).filter_map(|near| at[near]).collect();
        near.len() == 3 && Impulse::median(near.into_iter()).is_some_and(|found| found.is_off(level))
    };
    let off: Vec<bool> = (0..shoulder.place_count()).map(|place| off(&place)).collect();
    // Two rogue taps side by side move the median of three twice, and a gain that is off moves it for longer.
    (0..off.len()).any(|place| off[place] && shoulder.ring.with_neighbours(place).all(|near| off[near]))
}

impl Fusion {
    /// Whether scan number `scan` has a force and taps, but no tap with a measured velocity.
    pub(super) fn has_no_velocity(&self, scan: usize) -> bool {
        let taps = &self.plan.scans()[scan].taps;
        let mut seen = taps.iter().filter_map(|&row| self.seen[row as usize].as_ref()).filter(|seen| !seen.is_refused);
        let is_measured = |v: f64| v > 0.0 && v.is_finite();
        self.plan.recording.channels.contains(&Channel::Force)
            && seen.clone().next().is_some()
            && !seen.any(|seen| is_measured(seen.velocity_m_per_s))
    }
}
