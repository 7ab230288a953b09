//! What came of one shoulder: its taps by place and condition.

use tapline_wire::{Discriminator, Values};

use crate::ring::Ring;

/// What one tap, or the mean of several at one place in one condition, gave.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reading {
    /// Which of the shoulder's locations, counted in their order.
    pub(crate) place: usize,
    /// Number of its condition.
    pub(crate) condition: usize,
    /// Its discriminators.
    pub(crate) values: Values,
}

/// All that came of one shoulder and enters an index.
#[derive(Debug, Clone)]
pub(crate) struct Shoulder {
    /// Its locations and which are neighbours.
    pub(crate) ring: Ring,
    /// Number of its casing among those it is compared with.
    pub(crate) tyre: usize,
    /// One a tap, in plan order.
    pub(crate) taps: Vec<Reading>,
    /// For each place whether it is cracked, where that is known.
    pub(crate) is_cracked: Vec<Option<bool>>,
}

impl Shoulder {
    /// Places that are not known to be cracked.
    pub(crate) fn sound(&self) -> Vec<bool> {
        self.is_cracked.iter().map(|&label| label != Some(true)).collect()
    }

    /// The mean of each discriminator over the taps of one place in one condition, by place and condition: "the averaged
    /// results of two repeated test data" (section 5.4.3).
    pub(crate) fn averaged(&self, condition_count: usize) -> Vec<Reading> {
        let mut sums = vec![[(0.0, 0_u32); Discriminator::COUNT]; self.ring.len() * condition_count];
        for tap in &self.taps {
            let sums = &mut sums[tap.place * condition_count + tap.condition];
            for (which, sum) in Discriminator::ALL.into_iter().zip(sums) {
                if let Some(value) = tap.values.get(which) {
                    *sum = (sum.0 + value, sum.1 + 1);
                }
            }
        }
        let reading = |(number, sums): (usize, [(f64, u32); Discriminator::COUNT])| {
            let mut values = Values::default();
            for (which, (sum, count)) in Discriminator::ALL.into_iter().zip(sums) {
                values.set(which, (count > 0).then(|| sum / f64::from(count)));
            }
            Reading { place: number / condition_count, condition: number % condition_count, values }
        };
        let is_filled = |sums: &[(f64, u32); Discriminator::COUNT]| sums.iter().any(|&(_, count)| count > 0);
        sums.into_iter().enumerate().filter(|(_, sums)| is_filled(sums)).map(reading).collect()
    }
}

#[cfg(test)]
mod tests {
    use tapline_wire::Geometry;

    use super::*;

    #[test]
    fn repetitions_are_averaged_by_place_and_condition() {
        // Catches a mean over conditions or places, and an absent value that counts as zero.
        let tap = |place, condition, value: Option<f64>| {
            let mut values = Values::default();
            values.set(Discriminator::Pr, value);
            Reading { place, condition, values }
        };
        let locations: Vec<_> = (0..3).map(|l| (l, None)).collect();
        let shoulder = Shoulder {
            ring: Ring::of(Geometry::Line, &locations, None),
            tyre: 0,
            taps: vec![
                tap(0, 0, Some(1.0)),
                tap(0, 0, Some(3.0)),
                tap(0, 1, Some(8.0)),
                tap(2, 0, None),
                tap(2, 0, Some(5.0)),
                tap(1, 0, None),
            ],
            is_cracked: vec![None, Some(true), Some(false)],
        };
        let means: Vec<_> =
            shoulder.averaged(2).iter().map(|r| (r.place, r.condition, r.values.get(Discriminator::Pr))).collect();
        assert_eq!(means, [(0, 0, Some(2.0)), (0, 1, Some(8.0)), (2, 0, Some(5.0))]);
        assert_eq!(shoulder.sound(), [true, false, true]);
    }
}
