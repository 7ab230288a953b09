//! What the indices say where scores are absent, against models that were learnt without them.

use super::testing::Gaussian;
use super::{Example, Index, Lda, LogOdds, Mahalanobis, Signs};
use crate::score::auc;

/// Which scores are taken away, bit by bit: a correlated one; all correlated ones; the force's.
const ABSENT: [usize; 4] = [0b01_0000, 0b11_1000, 0b00_0011, 0b11_1110];

fn unequal(seed: u64) -> Gaussian {
    Gaussian { seed, shift: [1.5, 1.0, 0.5, 1.2, 0.8, 0.9], correlation: 0.8 }
}

/// The examples as they are where the sensors behind `absent` gave nothing.
fn without(examples: &[Example], absent: usize) -> Vec<Example> {
    let less = |e: &Example| Example {
        scores: e.scores.iter().enumerate().map(|(k, &score)| score.filter(|_| absent >> k & 1 == 0)).collect(),
        ..e.clone()
    };
    examples.iter().map(less).collect()
}

fn values(index: &dyn Index, examples: &[Example]) -> Vec<f64> {
    examples.iter().map(|example| index.value(&example.scores).unwrap()).collect()
}

/// Mean of -log of the chance that each example's class had by these log-odds.
fn surprise(log_odds: &[f64], examples: &[Example]) -> f64 {
    let of = |(z, e): (&f64, &Example)| (if e.is_cracked { -z } else { *z }).exp().ln_1p();
    log_odds.iter().zip(examples).map(of).sum::<f64>() / examples.len() as f64
}

#[test]
fn the_discriminant_of_those_present_is_that_learnt_from_them() {
    // Catches weights of the complete model cut short, and an inverse cut in place of the covariance.
    let (learnt, judged) = (unequal(1).examples(3000, 3000), unequal(2).examples(500, 500));
    for signs in [Signs::NonNegative, Signs::Free] {
        let index = Lda::learn(&learnt, signs).unwrap();
        for absent in ABSENT {
            let judged = without(&judged, absent);
            let own = Lda::learn(&without(&learnt, absent), signs).unwrap();
            for (one, other) in values(&index, &judged).iter().zip(values(&own, &judged)) {
                // The fewer columns are shrunk otherwise: those that are not correlated lose what sampling correlates
                // them.
                assert!((one - other).abs() < 0.05 * (1.0 + other.abs()), "{absent:b} {one} {other}");
            }
        }
    }
}

#[test]
fn log_odds_of_those_present_stay_odds() {
    // Catches absent scores taken for 0, and log-odds as sure as if all were there.
    let (learnt, judged) = (unequal(3).examples(2000, 1000), unequal(4).examples(2000, 1000));
    let labels: Vec<bool> = judged.iter().map(|e| e.is_cracked).collect();
    for signs in [Signs::NonNegative, Signs::Free] {
        let index = LogOdds::learn(&learnt, signs).unwrap();
        for absent in ABSENT {
            let judged = without(&judged, absent);
            let own = LogOdds::learn(&without(&learnt, absent), signs).unwrap();
            let (one, other) = (values(&index, &judged), values(&own, &judged));
            let (lost, least) = (surprise(&one, &judged), surprise(&other, &judged));
            assert!(lost < least + 0.01, "{absent:b}: {lost} against {least}");
            assert!(auc(&one, &labels).unwrap() > auc(&other, &labels).unwrap() - 0.005, "{absent:b}");
        }
    }
}

#[test]
fn sound_places_have_a_mean_square_of_one() {
    // Catches a distance that shrinks with each absent score, and a scale for both directions.
    let index = Mahalanobis::learn(&unequal(5).examples(4000, 0)).unwrap();
    let judged = unequal(6).examples(4000, 0);
    for absent in [0].into_iter().chain(ABSENT) {
        let judged = without(&judged, absent);
        let square = values(&index, &judged).iter().map(|d| d * d).sum::<f64>() / 4000.0;
        assert!((square - 1.0).abs() < 0.07, "{absent:b} {square}");
    }
}

#[test]
fn nothing_is_said_of_nothing() {
    // Catches the prior, or the distance of no score, as a value.
    let examples = unequal(7).examples(40, 40);
    let nothing: [&[Option<f64>]; 3] = [&[], &[None; 6], &[Some(f64::NAN), Some(f64::INFINITY)]];
    for scores in nothing {
        for signs in [Signs::NonNegative, Signs::Free] {
            assert_eq!(Lda::learn(&examples, signs).unwrap().value(scores), None);
            assert_eq!(LogOdds::learn(&examples, signs).unwrap().value(scores), None);
        }
        assert_eq!(Mahalanobis::learn(&examples).unwrap().value(scores), None);
    }
}
