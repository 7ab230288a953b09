//! One value a location of several conditions (offsets, velocities), on the scale of a single one again.

use std::collections::BTreeMap;

use crate::stats::{Spread, upper_quantile, upper_tail};

/// How the conditions of a location become one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Combination {
    /// Their mean: a crack that all of them see gains the most.
    #[default]
    Mean,
    /// Their largest: a crack that one of them sees is not thinned out. Its null rises with their number.
    Largest,
}

/// One value a location of its conditions' standard values in `rows`, standardised by the middle and spread of the
/// locations that have as many conditions.
///
/// The largest of four standard normals has a mean of 1.03, a spread of 0.70 and a tail of its own: what is compared with
/// the limits of a single one must be put back on its scale, by the chance 1 - (1 - p)^n that one of n is as large
/// (Sidak). That is for independent conditions; for others, and where one is missing, the middle and spread make up. Absent values, and what is no number, are left out. `None` for a location without values, and
/// for one of which there are too few with as many.
pub fn combined(rows: &[Vec<Option<f64>>], how: Combination) -> Vec<Option<f64>> {
    let raw: Vec<Option<(usize, f64)>> = rows.iter().map(|row| one_of(row, how)).collect();
    let mut alike: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for &(count, value) in raw.iter().flatten() {
        alike.entry(count).or_default().push(value);
    }
    let spreads: BTreeMap<usize, Spread> =
        alike.into_iter().filter_map(|(count, mut values)| Some((count, Spread::of(&mut values)?))).collect();
    let standard = |(count, value): (usize, f64)| spreads.get(&count).map(|s| (value - s.centre) / s.sigma);
    raw.into_iter().map(|of| of.and_then(standard).filter(|z| z.is_finite())).collect()
}

/// Count of the conditions that have a value, and the one they become.
fn one_of(row: &[Option<f64>], how: Combination) -> Option<(usize, f64)> {
    let present = || row.iter().copied().flatten().filter(|x| x.is_finite());
    let count = present().count();
    let value = match how {
        Combination::Mean => (count > 0).then(|| present().sum::<f64>() / count as f64),
        Combination::Largest => present().max_by(f64::total_cmp).map(|largest| {
            let chance = -(count as f64 * (-upper_tail(largest)).ln_1p()).exp_m1();
            upper_quantile(chance)
        }),
    };
    Some((count, value?))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution as _, StandardNormal};

    use super::*;

    fn sound(count: usize, conditions: usize) -> Vec<Vec<Option<f64>>> {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        (0..count).map(|_| (0..conditions).map(|_| Some(StandardNormal.sample(&mut rng))).collect()).collect()
    }

    #[test]
    fn a_missing_condition_does_not_make_a_location_sounder() {
        // Catches one scale for all: the largest of two lies 0.47 below that of four.
        let mut rows = sound(4000, 4);
        for row in rows.iter_mut().step_by(2) {
            (row[1], row[3]) = (None, Some(f64::NAN));
        }
        let z = combined(&rows, Combination::Largest);
        let mean = |from: usize| z.iter().skip(from).step_by(2).map(|z| z.unwrap()).sum::<f64>() / 2000.0;
        // The largest of normals is skewed: its mean lies some 0.05 above its median.
        assert!(mean(0).abs() < 0.12 && mean(1).abs() < 0.12, "{} {}", mean(0), mean(1));
    }

    #[test]
    fn what_is_not_there_stays_absent() {
        // Catches absent values counted as 0, and scales taken from too few.
        let mut rows = sound(50, 3);
        rows[7] = vec![None; 3];
        rows[8][0] = None; // the only one with two conditions
        for how in [Combination::Mean, Combination::Largest] {
            let z = combined(&rows, how);
            assert_eq!((z[7], z[8]), (None, None));
            assert_eq!(z.iter().flatten().count(), 48);
        }
        assert_eq!(combined(&[], Combination::Mean), []);
    }

    #[test]
    fn the_mean_gains_where_all_conditions_see() {
        // Catches the two swapped: a shift of 1.5 in all four of them is 3 in the mean, and less in the largest.
        let mut rows = sound(4000, 4);
        for row in &mut rows[..200] {
            row.iter_mut().for_each(|x| *x = x.map(|x| x + 1.5));
        }
        let gain = |how| combined(&rows, how)[..200].iter().map(|z| z.unwrap()).sum::<f64>() / 200.0;
        let (mean, largest) = (gain(Combination::Mean), gain(Combination::Largest));
        assert!((2.6..3.2).contains(&mean) && (1.7..2.5).contains(&largest), "{mean} {largest}");
    }
}
