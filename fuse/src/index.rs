//! A shoulder's readings, and the damage index of each of its locations.

use tapline_wire::{Discriminator, Values};

use crate::IndexKind;
use crate::reference::{Reading, Yardstick};
use crate::ring::Ring;

/// All that came of one shoulder and enters an index.
#[derive(Debug, Clone)]
pub(crate) struct Shoulder {
    /// Its locations and which are neighbours.
    pub(crate) ring: Ring,
    /// One a tap, in plan order.
    taps: Vec<Reading>,
    /// What the index is formed of: the taps, or for the dissertation their means.
    readings: Vec<Reading>,
}

/// The index of one location, before the step along the ring.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct LocationIndex {
    /// `None` where nothing could be scored.
    pub(crate) value: Option<f64>,
    /// Taps that entered.
    pub(crate) tap_count: u32,
    /// Discriminators that were left out of those that came: absent, or without a scale.
    pub(crate) absent_count: u32,
}

impl Shoulder {
    /// The shoulder with `taps` in plan order.
    pub(crate) fn new(index: IndexKind, condition_count: usize, ring: Ring, taps: Vec<Reading>) -> Self {
        let readings = match index {
            IndexKind::Robust => taps.clone(),
            // "the averaged results of two repeated test data", section 5.4.3
            IndexKind::Dissertation => averaged(&taps, ring.len(), condition_count),
        };
        Self { ring, taps, readings }
    }

    /// What a reference is made of.
    pub(crate) fn readings(&self) -> &[Reading] {
        &self.readings
    }

    /// The index of every location: the mean of its scores (Eq. 56, unweighted).
    pub(crate) fn index(&self, yardstick: &Yardstick) -> Vec<LocationIndex> {
        let mut sums = vec![(0.0, 0_u32); self.ring.len()];
        for reading in &self.readings {
            for score in yardstick.scores(reading).flatten() {
                let (sum, count) = &mut sums[reading.place];
                *sum += score;
                *count += 1;
            }
        }
        let mean = |(sum, count): (f64, u32)| (count > 0).then(|| sum / f64::from(count)).filter(|m| m.is_finite());
        let index = |sum| LocationIndex { value: mean(sum), ..LocationIndex::default() };
        let mut indices: Vec<LocationIndex> = sums.into_iter().map(index).collect();
        for tap in &self.taps {
            let (mut scored, mut absent) = (0, 0);
            for score in yardstick.scores(tap) {
                *(if score.is_some() { &mut scored } else { &mut absent }) += 1_u32;
            }
            indices[tap.place].tap_count += u32::from(scored > 0);
            indices[tap.place].absent_count += absent;
        }
        indices
    }
}

/// The mean of each discriminator over the taps of one place in one condition, by place and condition.
fn averaged(taps: &[Reading], place_count: usize, condition_count: usize) -> Vec<Reading> {
    let mut sums = vec![[(0.0, 0_u32); Discriminator::ALL.len()]; place_count * condition_count];
    for tap in taps {
        for (which, sum) in Discriminator::ALL.into_iter().zip(&mut sums[tap.place * condition_count + tap.condition]) {
            if let Some(value) = tap.values.get(which) {
                *sum = (sum.0 + value, sum.1 + 1);
            }
        }
    }
    let reading = |(number, sums): (usize, [(f64, u32); 7])| {
        let mut values = Values::default();
        for (which, (sum, count)) in Discriminator::ALL.into_iter().zip(sums) {
            values.set(which, (count > 0).then(|| sum / f64::from(count)));
        }
        Reading { place: number / condition_count, condition: number % condition_count, values }
    };
    let is_filled = |sums: &[(f64, u32); 7]| sums.iter().any(|&(_, count)| count > 0);
    sums.into_iter().enumerate().filter(|(_, sums)| is_filled(sums)).map(reading).collect()
}

#[cfg(test)]
mod tests {
    use tapline_wire::Geometry;

    use super::*;
    use crate::FuseConfig;

    fn pr(place: usize, condition: usize, value: Option<f64>) -> Reading {
        let mut values = Values::default();
        values.set(Discriminator::Pr, value);
        Reading { place, condition, values }
    }

    fn shoulder(index: IndexKind, taps: Vec<Reading>) -> (Shoulder, Yardstick) {
        let config = FuseConfig { discriminators: vec![Discriminator::Pr], index, ..FuseConfig::default() };
        let locations: Vec<_> = (0..12).map(|l| (l, None)).collect();
        let shoulder = Shoulder::new(index, 2, Ring::of(Geometry::Line, &locations, None), taps);
        let yardstick = Yardstick::of(&config, 2, shoulder.readings().iter());
        (shoulder, yardstick)
    }

    #[test]
    fn an_index_is_the_mean_of_what_is_there() {
        // Catches an absent value entering as zero, and wrong counts.
        let mut taps: Vec<Reading> = (0..11_u32).map(|i| pr(i as usize, 0, Some(f64::from(i)))).collect();
        taps.push(pr(10, 0, Some(2.0)));
        taps.push(pr(10, 0, None)); // absent
        taps.push(pr(10, 1, Some(1.0))); // no scale: one value in its condition
        taps.push(pr(11, 0, None)); // a place where nothing can be scored
        let (shoulder, yardstick) = shoulder(IndexKind::Robust, taps);
        let index = shoulder.index(&yardstick);
        // median of 0..=10 and 2 is 4.5, MAD 2.5 or 3: half the sum of the deviations over sigma.
        let z = |x: f64| yardstick.scores(&pr(0, 0, Some(x))).next().unwrap().unwrap();
        assert!(z(10.0) > 0.5 && z(2.0) < -0.5);
        let expected = LocationIndex { value: Some((z(10.0) + z(2.0)) / 2.0), tap_count: 2, absent_count: 2 };
        assert_eq!(index[10], expected);
        assert_eq!(index[11], LocationIndex { value: None, tap_count: 0, absent_count: 1 });
        assert_eq!(index[3], LocationIndex { value: Some(z(3.0)), tap_count: 1, absent_count: 0 });
    }

    #[test]
    fn the_dissertation_averages_repetitions_before_the_extremes() {
        // Catches extremes of single taps: one outlier would set the scale twice as wide.
        let taps = vec![pr(0, 0, Some(0.0)), pr(1, 0, Some(1.0)), pr(1, 0, Some(3.0)), pr(2, 0, Some(1.0))];
        let (shoulder, yardstick) = shoulder(IndexKind::Dissertation, taps);
        let index: Vec<_> = shoulder.index(&yardstick).iter().map(|i| (i.value, i.tap_count)).collect();
        assert_eq!(index[..4], [(Some(0.0), 1), (Some(1.0), 2), (Some(0.5), 1), (None, 0)]);
    }
}
