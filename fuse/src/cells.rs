//! The scores of a shoulder by location and condition: what an index is formed of.

use crate::IndexKind;
use crate::level::Level;
use crate::shoulder::{Reading, Shoulder};
use crate::yardstick::{Scorer, Yardstick};

/// Which taps of a location and condition enter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Taps {
    /// Every one.
    All,
    /// Every second, from the first.
    Odd,
    /// Every second, from the second.
    Even,
}

/// Mean scores of the discriminators, `[condition][place][discriminator]`; `None` where nothing could be scored.
///
/// A turn taps place after place in one condition: what it fills lies together.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Cells {
    width: usize,
    condition_count: usize,
    scores: Vec<Option<f64>>,
    /// For each place the taps that entered.
    pub(crate) tap_counts: Vec<u32>,
    /// For each place the discriminators of its taps that were left out: absent, or without a scale.
    pub(crate) absent_counts: Vec<u32>,
    /// For each condition whether a tap of it entered.
    has_taps: Vec<bool>,
}

impl Cells {
    /// The cells of `shoulder`, whose casing has this `level`.
    pub(crate) fn of(
        kind: IndexKind,
        condition_count: usize,
        yardstick: &Yardstick,
        level: &Level,
        shoulder: &Shoulder,
        which: Taps,
    ) -> Self {
        let (width, place_count) = (yardstick.width(), shoulder.ring.len());
        let mut sums = vec![(0.0, 0_u32); place_count * condition_count * width];
        let mut cells = Self {
            width,
            condition_count,
            scores: Vec::new(),
            tap_counts: vec![0; place_count],
            absent_counts: vec![0; place_count],
            has_taps: vec![false; condition_count],
        };
        let mut number_of = vec![0_u32; place_count * condition_count];
        let scorer = Scorer::of(yardstick, level);
        for tap in &shoulder.taps {
            let cell = tap.condition * place_count + tap.place;
            number_of[cell] += 1;
            let is_odd = number_of[cell] % 2 == 1;
            if which == (if is_odd { Taps::Even } else { Taps::Odd }) {
                continue;
            }
            cells.has_taps[tap.condition] = true;
            let (mut scored, mut absent) = (0, 0);
            let sums = &mut sums[cell * width..][..width];
            let mut add = |(score, (sum, count)): (f64, &mut (f64, u32))| {
                let is_there = !score.is_nan();
                // A sum is never -0, which alone would not be left as it is.
                *sum += if is_there { score } else { 0.0 };
                *count += u32::from(is_there);
                *(if is_there { &mut scored } else { &mut absent }) += 1_u32;
            };
            match &scorer {
                Some(scorer) => scorer.scores(tap).into_iter().zip(sums).for_each(add),
                None => {
                    let scores = yardstick.scores(level, tap).map(|score| score.unwrap_or(f64::NAN));
                    scores.zip(sums).for_each(&mut add);
                }
            }
            cells.tap_counts[tap.place] += u32::from(scored > 0);
            cells.absent_counts[tap.place] += absent;
        }
        let mean = |(sum, count): (f64, u32)| (count > 0).then(|| sum / f64::from(count)).filter(|m| m.is_finite());
        cells.scores = sums.into_iter().map(mean).collect();
        if kind == IndexKind::Dissertation && which == Taps::All {
            cells.fill_averaged(yardstick, level, &shoulder.averaged(condition_count));
        }
        cells
    }

    /// The score of the averaged repetitions in place of the mean of their scores: a magnitude is not linear.
    fn fill_averaged(&mut self, yardstick: &Yardstick, level: &Level, averaged: &[Reading]) {
        for reading in averaged {
            let first = self.first(reading.place, reading.condition);
            for (score, cell) in yardstick.scores(level, reading).zip(&mut self.scores[first..]) {
                *cell = score;
            }
        }
    }

    /// How many places there are.
    pub(crate) fn place_count(&self) -> usize {
        self.tap_counts.len()
    }

    /// How many conditions there are.
    pub(crate) fn condition_count(&self) -> usize {
        self.condition_count
    }

    /// Whether any tap entered in `condition`; there are no scores where none did.
    pub(crate) fn has_taps(&self, condition: usize) -> bool {
        self.has_taps[condition]
    }

    /// Mean score of each discriminator at `place` over its conditions.
    pub(crate) fn by_discriminator(&self, place: usize) -> Vec<Option<f64>> {
        let mean = |which: usize| {
            let scores = (0..self.condition_count).filter_map(|condition| self.at(place, condition)[which]);
            let (sum, count) = scores.fold((0.0, 0_u32), |(sum, count), score| (sum + score, count + 1));
            (count > 0).then(|| sum / f64::from(count))
        };
        (0..self.width).map(mean).collect()
    }

    /// Scores of the discriminators at `place` in `condition`.
    pub(crate) fn at(&self, place: usize, condition: usize) -> &[Option<f64>] {
        &self.scores[self.first(place, condition)..][..self.width]
    }

    /// Where the scores of `place` in `condition` begin.
    fn first(&self, place: usize, condition: usize) -> usize {
        (condition * self.place_count() + place) * self.width
    }
}

#[cfg(test)]
mod tests {
    use tapline_wire::{Discriminator, Geometry, Values};

    use super::*;
    use crate::FuseConfig;
    use crate::ring::Ring;

    fn pr(place: usize, condition: usize, value: Option<f64>) -> Reading {
        let mut values = Values::default();
        values.set(Discriminator::Pr, value);
        Reading { place, condition, values }
    }

    fn cells(index: IndexKind, taps: Vec<Reading>, which: Taps) -> (Cells, impl Fn(f64) -> f64) {
        let config = FuseConfig { discriminators: vec![Discriminator::Pr], index, ..FuseConfig::default() };
        let locations: Vec<_> = (0..12).map(|l| (l, None)).collect();
        let ring = Ring::of(Geometry::Line, &locations, None);
        let shoulder = Shoulder { ring, tyre: 0, taps, is_cracked: vec![None; 12] };
        let level = Level::of(&config.directed(), 2, shoulder.taps.iter());
        let averaged = shoulder.averaged(2);
        let readings = if index == IndexKind::Dissertation { &averaged } else { &shoulder.taps };
        let yardstick = Yardstick::of(&config, 2, readings.iter().map(|r| (&level, r)), &[]);
        let cells = Cells::of(index, 2, &yardstick, &level, &shoulder, which);
        (cells, move |x| yardstick.scores(&level, &pr(0, 0, Some(x))).next().unwrap().unwrap())
    }

    #[test]
    fn a_cell_is_the_mean_of_what_is_there() {
        // Catches an absent value entering as zero, wrong counts, and halves that share a tap.
        let mut taps: Vec<Reading> = (0..11_u32).map(|i| pr(i as usize, 0, Some(f64::from(i) + 1.0))).collect();
        taps.push(pr(10, 0, Some(2.0)));
        taps.push(pr(10, 0, None)); // absent
        taps.push(pr(10, 1, Some(1.0))); // no scale: one value in its condition
        taps.push(pr(11, 0, None)); // a place where nothing can be scored
        let (all, z) = cells(IndexKind::Robust, taps.clone(), Taps::All);
        let is = |got: &[Option<f64>], expected: f64| assert!((got[0].unwrap() - expected).abs() < 1e-12, "{got:?}");
        is(all.at(10, 0), (z(11.0) + z(2.0)) / 2.0);
        is(all.at(3, 0), z(4.0));
        assert_eq!((all.at(10, 1), all.at(11, 0)), (&[None][..], &[None][..]));
        assert_eq!((all.tap_counts[10], all.absent_counts[10], all.absent_counts[11]), (2, 2, 1));
        is(cells(IndexKind::Robust, taps.clone(), Taps::Odd).0.at(10, 0), z(11.0));
        is(cells(IndexKind::Robust, taps, Taps::Even).0.at(10, 0), z(2.0));
    }

    #[test]
    fn the_dissertation_averages_repetitions_before_the_extremes() {
        // Catches extremes of single taps: one outlier would set the scale twice as wide.
        let taps = vec![pr(0, 0, Some(0.0)), pr(1, 0, Some(1.0)), pr(1, 0, Some(3.0)), pr(2, 0, Some(1.0))];
        let (cells, _) = cells(IndexKind::Dissertation, taps, Taps::All);
        let index: Vec<_> = (0..4).map(|place| (cells.at(place, 0)[0], cells.tap_counts[place])).collect();
        assert_eq!(index, [(Some(0.0), 1), (Some(1.0), 2), (Some(0.5), 1), (None, 0)]);
    }
}
