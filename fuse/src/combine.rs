//! Several conditions of a location (offsets, velocities) become one value.

use crate::indices::Index;
use crate::stats::{Spread, upper_quantile, upper_tail};

/// The largest of a location's conditions, each standardised by its own sound places.
///
/// The largest of four standard normals has a mean of 1.03, a spread of 0.70 and a tail of its own: it is put back on
/// the scale of a single one by the chance 1 - (1 - p)^n that one of n is as large (Sidak). That is for independent
/// conditions; for others the null of what comes out makes up.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Largest {
    /// Of each condition the spread of its index at sound places; `None` where there is none.
    pub(crate) spreads: Vec<Option<Spread>>,
}

impl Index for Largest {
    fn value(&self, scores: &[Option<f64>]) -> Option<f64> {
        let standard = |(score, spread): (&Option<f64>, &Option<Spread>)| {
            let spread = (*spread)?;
            Some(((*score)? - spread.centre) / spread.sigma).filter(|z| z.is_finite())
        };
        let present = || scores.iter().zip(&self.spreads).filter_map(standard);
        let largest = present().max_by(f64::total_cmp)?;
        let chance = -(present().count() as f64 * (-upper_tail(largest)).ln_1p()).exp_m1();
        Some(upper_quantile(chance))
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

    use super::*;

    fn of(count: usize) -> Largest {
        Largest { spreads: vec![Some(Spread { centre: 2.0, sigma: 3.0 }); count] }
    }

    #[test]
    fn the_largest_of_several_is_on_the_scale_of_one() {
        // Catches the null mean of 1.03 of four, and a scale that depends on how many conditions came.
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        for absent in [0, 2] {
            let mut draw = || {
                let z: f64 = StandardNormal.sample(&mut rng);
                2.0 + 3.0 * z
            };
            let values: Vec<f64> = (0..4000)
                .map(|_| {
                    let mut row: Vec<Option<f64>> = (0..4).map(|_| Some(draw())).collect();
                    row[..absent].fill(None);
                    of(4).value(&row).unwrap()
                })
                .collect();
            let mean = values.iter().sum::<f64>() / 4000.0;
            let sd = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 4000.0).sqrt();
            assert!(mean.abs() < 0.05 && (sd - 1.0).abs() < 0.05, "{absent}: {mean} {sd}");
        }
    }

    #[test]
    fn what_is_not_there_is_not_the_largest() {
        // Catches a condition without a scale that enters, and a value out of nothing.
        let mut largest = of(3);
        largest.spreads[2] = None;
        assert_eq!(largest.value(&[None, None, Some(1e9)]), None);
        assert!((of(1).value(&[Some(5.0)]).unwrap() - 1.0).abs() < 1e-9, "one is itself");
        assert!(of(2).value(&[Some(f64::MAX), Some(-1.0)]).unwrap().is_finite());
    }
}
