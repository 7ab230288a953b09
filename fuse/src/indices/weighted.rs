//! A weighted mean of the scores, its weights from repeated taps or from labelled places.

use std::collections::BTreeSet;

use super::{Example, Index, LearnError, score_of, to_unit};
use crate::score::auc;
use crate::stats::median;

/// Scatter of repeated taps counts as at least this part of the middle discriminator's.
///
/// So no discriminator counts more than four times the middle one. Repeats say how well a tap is measured, not how much
/// sound casings differ, which is in the spread of 1 as well and which no repeatability takes away; and a ratio of four
/// between two variances is what seven pairs of taps each can show by chance (F(7, 7) exceeds 3.8 in one of twenty).
const SD_FLOOR: f64 = 0.5;

/// A scatter at or below this part of the middle one is none: the discriminator does not move.
const ROUNDING: f64 = 1e-9;

/// Fewest places of each class for a weight by AUC: below it its standard error, some 0.2, is as large as what a
/// middling discriminator has to say.
const AUC_PLACES_MIN: usize = 10;

/// Weighted mean of the scores that are present, weights at least 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Weighted {
    weights: Vec<f64>,
}

impl Weighted {
    /// Weights that balance discriminators by the scatter of a repeated tap, 1/sd^2 (the dissertation's 6.4 asks for
    /// weights balanced by statistical characteristics).
    ///
    /// `repeat_sds` are standard deviations of a repeated tap on the scale of the scores, in their order. One that is
    /// `None`, or no number, is not known: the discriminator counts as little as the least repeatable one. One of 0 is
    /// of a discriminator that does not move, and has no weight. Half the middle one is the least that counts.
    ///
    /// A tap that repeats well need not see cracks, and discriminators that repeat well because they measure the same
    /// count more than once: on the scores of [`Lda`](super::Lda)'s table, scatter 0.3, 0.3, 0.6, 0.3, 0.2, 0.2, the
    /// AUC fell from the mean's 0.866 to 0.842.
    ///
    /// # Errors
    /// [`LearnError::NoWeight`] if no scatter above 0 is known.
    pub fn by_repeatability(repeat_sds: &[Option<f64>]) -> Result<Self, LearnError> {
        let known: Vec<Option<f64>> = repeat_sds.iter().map(|sd| sd.filter(|s| s.is_finite() && *s >= 0.0)).collect();
        let largest = known.iter().copied().flatten().max_by(f64::total_cmp).unwrap_or(0.0);
        let mut moving: Vec<f64> = known.iter().copied().flatten().filter(|&sd| sd > ROUNDING * largest).collect();
        let middle = median(&mut moving).ok_or(LearnError::NoWeight {
            index: "the mean weighted by repeatability",
            count: repeat_sds.len(),
            reason: "no scatter of repeated taps is known, or all are 0",
        })?;
        let floor = SD_FLOOR * middle;
        let weight = |sd: Option<f64>| match sd.unwrap_or(largest) {
            sd if sd <= ROUNDING * largest => 0.0,
            // In units of the floor no square overflows that matters: it becomes 0.
            sd if sd > floor => (floor / sd).powi(2),
            _ => 1.0,
        };
        Ok(Self { weights: to_unit(&known.into_iter().map(weight).collect::<Vec<f64>>()) })
    }

    /// Weights max(0, 2 AUC - 1) of how well each discriminator alone tells the `examples`' classes apart.
    ///
    /// The correlation of discriminators is not looked at: on the scores of [`Lda`](super::Lda)'s table the AUC was
    /// 0.881 with 10 places a class and 0.887 with 100, where the mean has 0.866 and LDA reaches 0.908. One that has no
    /// score in 10 places of a class has no weight.
    ///
    /// # Errors
    /// [`LearnError::TooFew`] if a class has less than 10 places with any score, [`LearnError::NoWeight`] if no
    /// discriminator is better than chance.
    pub fn by_auc(examples: &[Example]) -> Result<Self, LearnError> {
        let index = "the mean weighted by AUC";
        let count = examples.iter().map(|example| example.scores.len()).max().unwrap_or(0);
        let seen_by = |has: &dyn Fn(&Example) -> bool| {
            let of = |class| {
                let places = examples.iter().filter(|e| e.is_cracked == class && has(e)).map(|e| e.place);
                places.collect::<BTreeSet<usize>>().len()
            };
            (of(false), of(true))
        };
        let has_any = |example: &Example| (0..count).any(|column| score_of(&example.scores, column).is_some());
        let (sound, cracked) = seen_by(&has_any);
        if sound < AUC_PLACES_MIN || cracked < AUC_PLACES_MIN {
            let incomplete = examples.iter().filter(|example| !has_any(example)).count();
            let (least, rows) = (AUC_PLACES_MIN, examples.len());
            return Err(LearnError::TooFew { index, least, sound, cracked, incomplete, rows });
        }
        let labels: Vec<bool> = examples.iter().map(|example| example.is_cracked).collect();
        let weight = |column: usize| {
            let (sound, cracked) = seen_by(&|example| score_of(&example.scores, column).is_some());
            if sound < AUC_PLACES_MIN || cracked < AUC_PLACES_MIN {
                return 0.0;
            }
            let scores: Vec<f64> = examples.iter().map(|e| score_of(&e.scores, column).unwrap_or(f64::NAN)).collect();
            auc(&scores, &labels).map(|area| 2.0 * area - 1.0).filter(|&w| w > 0.0).unwrap_or(0.0)
        };
        let weights: Vec<f64> = (0..count).map(weight).collect();
        if !weights.iter().any(|&w| w > 0.0) {
            return Err(LearnError::NoWeight {
                index,
                count,
                reason: "none tells cracked from sound better than chance",
            });
        }
        Ok(Self { weights: to_unit(&weights) })
    }
}

impl Index for Weighted {
    fn value(&self, scores: &[Option<f64>]) -> Option<f64> {
        let present = self.weights.iter().enumerate().filter(|&(_, &weight)| weight > 0.0);
        let (sum, total) = present
            .filter_map(|(column, &weight)| Some((weight, score_of(scores, column)?)))
            .fold((0.0, 0.0), |(sum, total), (weight, score)| (sum + weight * score, total + weight));
        (total > 0.0).then(|| sum / total).filter(|value| value.is_finite())
    }

    fn weights(&self) -> Option<Vec<f64>> {
        Some(self.weights.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::indices::testing::{Gaussian, some};

    #[test]
    fn repeatability_balances_within_its_floor() {
        // Catches 1/sd in place of 1/sd^2, a floor that is missing or too high, and unknown scatter that counts in
        // full.
        let sds = [Some(0.2), Some(0.4), Some(0.8), Some(0.001), Some(0.0), None];
        let weighted = Weighted::by_repeatability(&sds).unwrap();
        // Of 0.001, 0.2, 0.4, 0.8 the middle is 0.3 and the floor 0.15.
        let expected = [0.5625, 0.140_625, 0.035_156_25, 1.0, 0.0, 0.035_156_25];
        for (got, expected) in weighted.weights().unwrap().into_iter().zip(expected) {
            assert!((got - expected).abs() < 1e-12, "{weighted:?}");
        }
        assert_eq!(weighted.value(&[None, None, None, None, Some(7.0)]), None, "only what has no weight");
        let value = weighted.value(&[Some(1.0), None, None, Some(3.0)]).unwrap();
        assert!((value - (0.5625 + 3.0) / 1.5625).abs() < 1e-12, "{value}");
    }

    #[test]
    fn the_scale_of_the_scatter_does_not_count() {
        // Catches an absolute floor: the index of the dissertation has another scale than the robust one.
        let sds = [Some(0.3), Some(0.02), Some(1.2), None, Some(0.0)];
        let scaled = sds.map(|sd: Option<f64>| sd.map(|sd| 1e-3 * sd));
        let (one, other) = (Weighted::by_repeatability(&sds).unwrap(), Weighted::by_repeatability(&scaled).unwrap());
        for (a, b) in one.weights.iter().zip(&other.weights) {
            assert!((a - b).abs() < 1e-12, "{one:?} {other:?}");
        }
    }

    #[test]
    fn scatter_that_is_none_gives_no_weights() {
        // Catches 1/0, and weights from nothing: a simulated rig without noise repeats to the bit.
        for sds in [&[][..], &[None, None], &[Some(0.0), None], &[Some(f64::NAN), Some(-1.0), Some(f64::INFINITY)]] {
            let error = Weighted::by_repeatability(sds).unwrap_err();
            assert!(matches!(error, LearnError::NoWeight { count, .. } if count == sds.len()), "{error}");
        }
    }

    #[test]
    fn auc_weights_are_those_of_each_alone() {
        // Catches a sign, a discriminator worse than chance that counts, and absent scores that count as 0.
        let example = |place: usize, cracked: bool, scores| Example { scores, is_cracked: cracked, place };
        let mut examples: Vec<Example> = Vec::new();
        for k in 0..20 {
            let x = k as f64;
            examples.push(example(k, false, some([x, x, x + 1.0, 5.0])));
            examples.push(example(k + 20, true, some([x + 100.0, x + 5.0, x, 5.0])));
        }
        examples.push(example(50, true, vec![None, Some(f64::NAN)]));
        let weights = Weighted::by_auc(&examples).unwrap().weights().unwrap();
        // 400 pairs; 15 shifted places tie: the second wins (400 + 190 + 10 ...) as counted pair by pair.
        let wins = (0..20).flat_map(|c| (0..20).map(move |s| (c + 5, s)));
        let area = wins
            .map(|(c, s)| {
                if c > s {
                    1.0
                } else if c == s {
                    0.5
                } else {
                    0.0
                }
            })
            .sum::<f64>()
            / 400.0;
        assert!((weights[1] - (2.0 * area - 1.0)).abs() < 1e-12 && area > 0.6, "{weights:?}");
        assert_eq!((weights[0].to_bits(), weights[2].to_bits(), weights[3].to_bits()), (1.0_f64.to_bits(), 0, 0));
    }

    #[test]
    fn few_places_are_refused_with_their_count() {
        // Catches rows counted in place of places, and classes swapped.
        let mut examples = Gaussian::default().examples(11, 9);
        for row in 0..examples.len() {
            examples.push(examples[row].clone());
        }
        let error = Weighted::by_auc(&examples).unwrap_err();
        assert!(matches!(error, LearnError::TooFew { sound: 11, cracked: 9, least: 10, .. }), "{error}");
    }
}
