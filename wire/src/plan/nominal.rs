//! The velocities that a plan intends, found from those that its taps list.
//!
//! A tap set lists a velocity for each tap. If it lists requested velocities, those are the intended ones; if it
//! lists measured ones, or a few taps are off, the intended one is that around which a turn of the ring scatters.

use std::collections::{BTreeMap, BTreeSet};

use crate::{PlannedTap, Serial};

/// Fraction of a ring's locations that must have a velocity for it to be intended: it then has its own turn.
const TURN: f64 = 0.5;

/// A measured velocity above the next lower one by this factor belongs to another turn.
const GAP: f64 = 1.03;

/// Measured velocities that spread by more than this factor have no common intended value.
const SPREAD: f64 = 1.25;

/// The taps of one shoulder at one offset, by row.
type Ring = (Serial, u16, Option<u64>);

/// The intended velocity of every one of `taps`, in m/s; NaN if it gives none.
pub(crate) fn nominal_velocities(taps: &[PlannedTap]) -> Vec<f64> {
    let mut nominal = vec![f64::NAN; taps.len()];
    let mut rings: BTreeMap<Ring, Vec<(f64, u32, usize)>> = BTreeMap::new();
    for (row, tap) in taps.iter().enumerate() {
        let id = tap.id;
        if let Some(velocity) = id.velocity_m_per_s() {
            let ring = (id.tyre, id.shoulder, id.offset_mm().map(f64::to_bits));
            rings.entry(ring).or_default().push((velocity, id.location, row));
        }
    }
    for mut struck in rings.into_values() {
        struck.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
        let meant = meant(&struck);
        for (velocity, _, row) in struck {
            nominal[row] = nearest(&meant, velocity);
        }
    }
    nominal
}

/// The intended velocities of the taps `struck`, ascending.
fn meant(struck: &[(f64, u32, usize)]) -> Vec<f64> {
    let locations = |taps: &[(f64, u32, usize)]| taps.iter().map(|tap| tap.1).collect::<BTreeSet<_>>().len();
    #[expect(clippy::cast_precision_loss, reason = "counts of locations")]
    let is_turn = |taps: &&[(f64, u32, usize)]| locations(taps) as f64 >= TURN * locations(struck) as f64;
    let asked_for: Vec<f64> =
        struck.chunk_by(|a, b| a.0.total_cmp(&b.0).is_eq()).filter(is_turn).map(|turn| turn[0].0).collect();
    if !asked_for.is_empty() {
        return asked_for;
    }
    let turns = struck.chunk_by(|below, tap| tap.0 <= GAP * below.0).filter(is_turn);
    let lies_together = |turn: &&[(f64, u32, usize)]| turn[turn.len() - 1].0 <= SPREAD * turn[0].0;
    turns.filter(lies_together).map(|turn| turn[turn.len() / 2].0).collect()
}

/// The intended velocity nearest to `velocity`, of those in `meant`; itself if there are none.
fn nearest(meant: &[f64], velocity: f64) -> f64 {
    let distance = |nominal: &f64| (velocity / nominal).ln().abs();
    meant.iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(velocity)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Purpose;
    use crate::TapId;

    /// One ring a shoulder; each turn has the velocity that `turn` gives a location.
    fn taps(turns: &[(u16, &dyn Fn(u32) -> f64)]) -> Vec<PlannedTap> {
        let tap = |shoulder: u16, repetition: usize, location: u32, velocity: f64| {
            let mut id = TapId::default().with_velocity_m_per_s(Some(velocity)).unwrap();
            (id.shoulder, id.location, id.repetition) = (shoulder, location, u16::try_from(repetition).unwrap());
            PlannedTap { id, angle_deg: None, purpose: Purpose::Scan }
        };
        let numbered = turns.iter().enumerate();
        numbered.flat_map(|(k, &(shoulder, turn))| (0..100).map(move |l| tap(shoulder, k, l, turn(l)))).collect()
    }

    /// Rows whose velocity is more than 3 % off the nominal one.
    fn off(taps: &[PlannedTap]) -> Vec<usize> {
        let nominal = nominal_velocities(taps);
        let is_off = |row: &usize| (taps[*row].id.velocity_m_per_s().unwrap() / nominal[*row] - 1.0).abs() > 0.03;
        (0..taps.len()).filter(is_off).collect()
    }

    /// Numbers of mean 0 and standard deviation 1, by location.
    fn normal(location: u32) -> f64 {
        let uniform = |k: u32| f64::from((location * 7919 + k * 104_729) % 1009) / 1009.0 - 0.5;
        (0..12).map(uniform).sum()
    }

    /// Catches a turn of its own taken for a slip, and velocities that lie close and are merged.
    #[test]
    fn what_is_asked_for_is_meant() {
        assert_eq!(off(&taps(&[(1, &|_| 1.8), (1, &|_| 1.85), (1, &|_| 1.2)])), [0; 0]);
        assert_eq!(off(&taps(&[(1, &|_| 1.85), (1, &|_| 1.85), (1, &|_| 1.85), (1, &|_| 1.65)])), [0; 0]);
        assert_eq!(off(&taps(&[(1, &|_| 1.85), (1, &|_| 1.85), (2, &|_| 1.65)])), [0; 0]);
        assert_eq!(off(&taps(&[(1, &|l| 1.0 + 0.01 * f64::from(l))])), [0; 0], "a sweep lies around nothing");
        let none = PlannedTap { id: TapId::default(), angle_deg: None, purpose: Purpose::Scan };
        assert!(nominal_velocities(&[none])[0].is_nan());
    }

    /// Catches a slip that is taken for meant: rare ones, one in three, and a slip of the pen.
    #[test]
    fn what_strikes_out_is_off() {
        for (fast, step) in [(2.03, 10), (1.4, 3), (18.5, 7), (1.95, 3)] {
            let set = taps(&[(1, &|l| if l % step == 0 { fast } else { 1.85 }), (1, &|_| 1.2)]);
            let expected: Vec<usize> = (0..100).filter(|l| l % step as usize == 0).collect();
            assert_eq!(off(&set), expected, "{fast}");
        }
    }

    /// Catches measured velocities of which each, or each that some agree in, is its own nominal.
    #[test]
    fn what_is_measured_lies_around_what_is_meant() {
        let turn = |meant: f64, shift: u32| move |l: u32| meant * (1.0 + 0.005 * normal(l + shift));
        assert_eq!(off(&taps(&[(1, &turn(1.2, 0)), (1, &turn(1.32, 7))])), [0; 0], "two turns, 10 % apart");
        for scatter in [0.005, 0.01] {
            let measured = |l: u32| {
                let meant = if l % 10 == 3 { 1.06 * 1.85 } else { 1.85 };
                (meant * (1.0 + scatter * normal(l)) * 100.0).round() / 100.0
            };
            let off = off(&taps(&[(1, &measured), (1, &|l| 1.2 * (1.0 + scatter * normal(l + 7)))]));
            let planted = off.iter().filter(|row| **row < 100 && **row % 10 == 3).count();
            assert!(planted >= 9 && off.len() - planted <= 2, "{scatter}: {off:?}");
        }
    }
}
