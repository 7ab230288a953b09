//! Several conditions of a location (offsets, velocities) become one value.

use crate::condition::Conditions;
use crate::indices::Index;
use crate::stats::{Spread, in_reach, upper_quantile, upper_tails};

/// The largest over runs of neighbouring offsets: a crack reaches across some of them, and which is not known.
///
/// Velocities at one offset strike the same spot, so an offset is the mean over them. A run is the mean over its offsets,
/// standardised by its own sound places; a crack that all offsets see gains by the longest run, one that a single offset
/// sees is not thinned out by the rest. The largest of four standard normals has a mean of 1.03, a spread of 0.70 and a
/// tail of its own: it is put back on the scale of a single one by the chance 1 - (1 - p)^n that one of n offsets is as
/// large (Sidak). Runs that overlap are alike, so that n counts offsets and not runs; for what is left of it the null of
/// what comes out makes up.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Largest {
    /// Numbers of the conditions of each offset, from the belt edge on.
    offsets: Vec<Vec<usize>>,
    /// Spread of the index of each condition at sound places; `None` where there is none.
    conditions: Vec<Option<Spread>>,
    /// First offset, offset behind the last, and spread at sound places of each run.
    runs: Vec<(usize, usize, Spread)>,
}

impl Largest {
    /// The largest as `sound` places, condition by condition, scale it, of `conditions`.
    pub(crate) fn of(conditions: &Conditions, sound: &[&[Option<f64>]]) -> Self {
        let spread = |c: usize| {
            let mut of_condition = Vec::with_capacity(sound.len());
            of_condition.extend(sound.iter().filter_map(|row| row[c]));
            Spread::of(&mut of_condition)
        };
        let mut order: Vec<(usize, Option<f64>)> = conditions.offsets_mm().into_iter().enumerate().collect();
        // The unknown offset comes last; it is nobody's neighbour, but there is no other where it is.
        let mm = |of: Option<f64>| of.unwrap_or(f64::INFINITY);
        order.sort_by(|a, b| mm(a.1).total_cmp(&mm(b.1)));
        let of_offset = |&(offset, _): &(usize, Option<f64>)| {
            (0..conditions.count()).filter(|&c| conditions.offset_of(c) == offset).collect()
        };
        let offsets: Vec<Vec<usize>> = order.iter().map(of_offset).collect();
        let mut largest = Self { offsets, conditions: (0..conditions.count()).map(spread).collect(), runs: Vec::new() };
        let means: Vec<Option<f64>> = sound.iter().flat_map(|row| largest.by_offset(row)).collect();
        let width = largest.offsets.len();
        for first in 0..width {
            let rows = || means.chunks_exact(width);
            for end in first + 1..=width {
                let mut of_run = Vec::with_capacity(sound.len());
                of_run.extend(rows().filter_map(|means| mean(&means[first..end])));
                largest.runs.extend(Spread::of(&mut of_run).map(|spread| (first, end, spread)));
            }
        }
        largest
    }

    /// The mean of the standardised conditions at each offset.
    fn by_offset(&self, row: &[Option<f64>]) -> impl Iterator<Item = Option<f64>> {
        let z = |&c: &usize| {
            let spread = self.conditions[c]?;
            Some((row[c]? - spread.centre) / spread.sigma)
        };
        let of = move |conditions: &Vec<usize>| {
            let (sum, count) =
                conditions.iter().filter_map(z).fold((0.0, 0_u32), |(sum, count), z| (sum + z, count + 1));
            (count > 0).then(|| sum / f64::from(count)).filter(|mean| mean.is_finite())
        };
        self.offsets.iter().map(of)
    }

    /// The largest over runs of the `means` of the offsets, standardised.
    fn largest(&self, means: &[Option<f64>]) -> Option<f64> {
        let mut largest: Option<f64> = None;
        let mut last: Option<(usize, usize, Option<f64>)> = None;
        for &(first, end, spread) in &self.runs {
            // A run that begins where the one before it does goes on with its sum.
            let (from, sum) = match last {
                Some((last_first, last_end, sum)) if last_first == first && last_end < end => (last_end, sum),
                _ => (first + 1, means[first]),
            };
            let sum = means[from..end].iter().fold(sum, |sum, &mean| Some(sum? + mean?));
            last = Some((first, end, sum));
            let z = sum.map(|sum| (sum / (end - first) as f64 - spread.centre) / spread.sigma);
            if let Some(z) = z.filter(|&z| z.is_finite() && largest.is_none_or(|largest| z > largest)) {
                largest = Some(z);
            }
        }
        largest
    }
}

/// Mean of `values`, all of which must be there.
fn mean(values: &[Option<f64>]) -> Option<f64> {
    let sum: Option<f64> = values.iter().copied().sum();
    Some(sum? / values.len() as f64)
}

impl Index for Largest {
    fn value(&self, scores: &[Option<f64>]) -> Option<f64> {
        self.values(&mut std::iter::once(scores)).pop().flatten()
    }

    /// The tails of all rows are found side by side: each waits for divisions, one after the other.
    fn values(&self, rows: &mut dyn Iterator<Item = &[Option<f64>]>) -> Vec<Option<f64>> {
        let mut means = Vec::with_capacity(self.offsets.len());
        let row_count_min = rows.size_hint().0;
        let mut values = Vec::with_capacity(row_count_min);
        let (mut of_several, mut largest) = (Vec::with_capacity(row_count_min), Vec::with_capacity(row_count_min));
        for row in rows {
            means.clear();
            means.extend(self.by_offset(row));
            let of_row = self.largest(&means);
            // The largest of one is that one.
            let count = means.iter().flatten().count();
            if let Some(z) = of_row.filter(|_| count > 1) {
                of_several.push((values.len(), count as f64));
                largest.push(z);
            }
            values.push(of_row.map(in_reach));
        }
        upper_tails(&mut largest);
        for ((row, count), tail) in of_several.into_iter().zip(largest) {
            values[row] = Some(upper_quantile(-(count * (-tail).ln_1p()).exp_m1()));
        }
        values
    }

    fn weights(&self) -> Option<Vec<f64>> {
        None
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution as _, StandardNormal};
    use tapline_wire::TapId;

    use super::*;
    use crate::stats::upper_tails;

    type Row = Vec<Option<f64>>;

    /// So many offsets at so many velocities; class 0 of each is that of unknown velocity, where there is no tap.
    fn conditions(offset_count: u32, velocity_count: u32) -> Conditions {
        let tap = |offset: u32, velocity: u32| {
            let id = TapId::default().with_offset_mm(Some(5.0 * f64::from(offset) - 5.0)).unwrap();
            id.with_velocity_m_per_s(Some(1.0 + f64::from(velocity))).unwrap()
        };
        let taps = (0..offset_count).flat_map(|offset| (0..velocity_count).map(move |velocity| tap(offset, velocity)));
        Conditions::of(taps)
    }

    fn sound(of: &Conditions, count: usize, seed: u64) -> Vec<Row> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut draw = |c: usize| {
            let z: f64 = StandardNormal.sample(&mut rng);
            of.name(c).1.map(|_| 2.0 + 3.0 * z)
        };
        (0..count).map(|_| (0..of.count()).map(&mut draw).collect()).collect()
    }

    fn largest(of: &Conditions) -> Largest {
        let rows = sound(of, 4000, 10);
        Largest::of(of, &rows.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }

    /// The slow twin: row by row, run by run.
    fn value_slow(of: &Largest, row: &[Option<f64>]) -> Option<f64> {
        let means: Vec<Option<f64>> = of.by_offset(row).collect();
        let z = |&(first, end, spread): &(usize, usize, Spread)| {
            mean(&means[first..end]).map(|mean| (mean - spread.centre) / spread.sigma).filter(|z| z.is_finite())
        };
        let largest = of.runs.iter().filter_map(z).max_by(f64::total_cmp)?;
        let count = means.iter().flatten().count() as f64;
        let mut tail = [largest];
        upper_tails(&mut tail);
        let by_chance = upper_quantile(-(count * (-tail[0]).ln_1p()).exp_m1());
        if count > 1.0 {
            return Some(by_chance);
        }
        // The same but for rounding, which is coarse where the chance is all but 1.
        assert!(largest < -5.0 || (by_chance - largest.clamp(-9.0, 38.0)).abs() < 1e-6, "{by_chance} of {largest}");
        Some(largest.clamp(-9.0, 38.0))
    }

    #[test]
    fn rows_side_by_side_are_those_one_by_one() {
        // Catches a sum of another run that is gone on with, and a tail that is given to another row.
        for (offset_count, velocity_count) in [(4, 1), (3, 2), (1, 1)] {
            let conditions = conditions(offset_count, velocity_count);
            let mut of = largest(&conditions);
            let mut rows = sound(&conditions, 200, 12);
            for (number, row) in rows.iter_mut().enumerate() {
                let (place, count) = (number % 5, row.len());
                row[place % count] = row[place % count].filter(|_| number % 3 > 0);
                row.iter_mut().flatten().for_each(|z| *z *= (number % 7) as f64);
            }
            for _ in 0..3 {
                let values = of.values(&mut rows.iter().map(Vec::as_slice));
                let slow: Vec<Option<f64>> = rows.iter().map(|row| value_slow(&of, row)).collect();
                let bits = |of: Vec<Option<f64>>| of.into_iter().map(|v| v.map(f64::to_bits)).collect::<Vec<_>>();
                assert_eq!(bits(values), bits(slow));
                // A run that has no spread is left out.
                of.runs.remove(of.runs.len() / 2);
                if of.runs.is_empty() {
                    break;
                }
            }
        }
    }

    #[test]
    fn the_largest_of_several_is_near_the_scale_of_one() {
        // Catches the null mean of 1.03 of four, and a scale that depends much on how many conditions came.
        for (offset_count, velocity_count, absent) in [(4, 1, 0), (4, 1, 2), (2, 2, 0), (1, 3, 0)] {
            let conditions = conditions(offset_count, velocity_count);
            let of = largest(&conditions);
            let values: Vec<f64> = sound(&conditions, 4000, 11)
                .into_iter()
                .map(|mut row| {
                    row[..absent * 2].fill(None);
                    of.value(&row).unwrap()
                })
                .collect();
            let mean = values.iter().sum::<f64>() / 4000.0;
            let sd = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 4000.0).sqrt();
            assert!(
                mean.abs() < 0.35 && (sd - 1.0).abs() < 0.15,
                "{offset_count} {velocity_count} {absent}: {mean} {sd}"
            );
        }
    }

    #[test]
    fn a_crack_gains_by_the_offsets_that_see_it() {
        // Catches runs that skip an offset, an order that is not that of the millimetres, and a mean over all of them.
        let conditions = conditions(4, 1);
        let of = largest(&conditions);
        let at = |shifts: [f64; 4]| {
            let offsets_mm = [-5.0, 0.0, 5.0, 10.0];
            let shift = |c: usize| {
                let mm = conditions.name(c).0.unwrap();
                shifts[offsets_mm.iter().position(|&o| f64::abs(o - mm) < 1e-9).unwrap()]
            };
            let row: Row =
                (0..conditions.count()).map(|c| conditions.name(c).1.map(|_| 2.0 + 3.0 * shift(c))).collect();
            of.value(&row).unwrap()
        };
        let (one, all) = (at([3.0, 0.0, 0.0, 0.0]), at([3.0; 4]));
        let (beside, apart) = (at([3.0, 3.0, 0.0, 0.0]), at([3.0, 0.0, 3.0, 0.0]));
        assert!(one > 2.4 && all > 5.4 && beside > 3.7 && apart < 3.2, "{one} {all} {beside} {apart}");
    }

    #[test]
    fn what_is_not_there_is_not_the_largest() {
        // Catches a condition without a scale that enters, and a value out of nothing.
        let conditions = conditions(2, 1);
        let of = largest(&conditions);
        let row = |a: Option<f64>, b: Option<f64>, c: Option<f64>, d: Option<f64>| of.value(&[a, b, c, d]);
        assert_eq!(row(Some(1e9), None, Some(1e9), None), None, "of unknown velocity there is no reference");
        assert!(row(None, Some(f64::MAX), None, Some(-1.0)).unwrap().is_finite());
    }
}
