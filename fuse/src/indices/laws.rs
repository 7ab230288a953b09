//! What every index must obey, whatever the scores.

use proptest::prelude::*;

use super::testing::{Gaussian, some};
use super::{Example, Index, Lda, LearnError, LogOdds, Mahalanobis, Mean, Signs, Weighted};

/// Every index that can be learnt from `examples`.
fn all(examples: &[Example]) -> Vec<Box<dyn Index>> {
    let mut indices: Vec<Box<dyn Index>> = vec![Box::new(Mean::new(6))];
    let sds: Vec<Option<f64>> = examples.first().map(|example| example.scores.clone()).unwrap_or_default();
    indices.extend(Weighted::by_repeatability(&sds).ok().map(|index| Box::new(index) as Box<dyn Index>));
    indices.extend(Weighted::by_auc(examples).ok().map(|index| Box::new(index) as Box<dyn Index>));
    indices.extend(Mahalanobis::learn(examples).ok().map(|index| Box::new(index) as Box<dyn Index>));
    for signs in [Signs::NonNegative, Signs::Free] {
        indices.extend(Lda::learn(examples, signs).ok().map(|index| Box::new(index) as Box<dyn Index>));
        indices.extend(LogOdds::learn(examples, signs).ok().map(|index| Box::new(index) as Box<dyn Index>));
    }
    indices
}

/// Those whose value must not fall when a score rises.
fn monotone(examples: &[Example]) -> Vec<Box<dyn Index>> {
    vec![
        Box::new(Mean::new(6)),
        Box::new(Weighted::by_auc(examples).unwrap()),
        Box::new(Lda::learn(examples, Signs::NonNegative).unwrap()),
        Box::new(LogOdds::learn(examples, Signs::NonNegative).unwrap()),
    ]
}

/// Cracks move three correlated scores unequally: the best free weights are negative.
fn unequal() -> Gaussian {
    Gaussian { shift: [1.5, 1.0, 1.0, 1.2, 0.5, 0.5], ..Gaussian::default() }
}

fn without(scores: &[Option<f64>], absent: usize) -> Vec<Option<f64>> {
    scores.iter().enumerate().map(|(k, &score)| score.filter(|_| absent >> k & 1 == 0)).collect()
}

/// Any double, and small numbers, of which many are alike.
fn any_score() -> impl Strategy<Value = Option<f64>> {
    prop_oneof![
        6 => (-6..6_i32).prop_map(|x| Some(f64::from(x))),
        6 => (-6.0..6.0).prop_map(Some),
        1 => any::<f64>().prop_map(Some),
        1 => Just(None),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn nothing_but_numbers_comes_out(
        rows in prop::collection::vec(prop::collection::vec(any::<f64>(), 6), 60..70),
        holes in prop::collection::vec(any_score(), 6),
        scores in prop::collection::vec(prop::option::of(any::<f64>()), 0..9),
        coarse in any::<bool>(),
    ) {
        // Catches NaN or an infinity from overflow, from columns that are constant or alike, and a Newton step that
        // leaves the numbers.
        let example = |(place, row): (usize, Vec<f64>)| {
            let scores = row.into_iter().zip(&holes).map(|(x, hole)| match hole {
                Some(hole) if coarse => Some(hole + (x.to_bits() % 3) as f64),
                Some(_) => Some(if x.is_finite() { x } else { 1.0 }),
                None => None,
            });
            Example { scores: scores.collect(), is_cracked: place % 2 == 1, place }
        };
        let examples: Vec<Example> = rows.into_iter().enumerate().map(example).collect();
        for index in all(&examples) {
            for scores in [&scores, &holes] {
                if let Some(value) = index.value(scores) {
                    prop_assert!(value.is_finite(), "{:?} {}", index, value);
                }
            }
            for weight in index.weights().into_iter().flatten() {
                prop_assert!(weight.abs() <= 1.0, "{:?}", index);
            }
        }
    }

    #[test]
    fn a_score_that_rises_never_lowers_the_index(
        seed in 0..40_u64, scores in prop::collection::vec(-6.0..6.0, 6),
        column in 0..6_usize, by in 0.0..6.0, absent in 0..63_usize,
    ) {
        // Catches a weight below zero, in the complete model or in one of those present.
        let gaussian = Gaussian { seed, ..unequal() };
        let mut higher = scores.clone();
        higher[column] += by;
        for index in monotone(&gaussian.examples(30, 25)) {
            let [low, high] = [&scores, &higher].map(|x| index.value(&without(&some(x.iter().copied()), absent)));
            prop_assert_eq!(low.is_some(), high.is_some());
            prop_assert!(high.unwrap_or(0.0) >= low.unwrap_or(0.0) - 1e-12, "{:?} {:?} {:?}", index, low, high);
        }
    }

    #[test]
    fn the_order_of_the_examples_does_not_count(seed in 0..40_u64, shuffle in any::<u64>(), absent in 0..63_usize) {
        // Catches a place or class taken from the row's number.
        let examples = Gaussian { seed, ..unequal() }.examples(30, 25);
        let mut other = examples.clone();
        other.sort_by_key(|example| (example.place as u64 + 1).wrapping_mul(shuffle | 1));
        // A repeatability comes from the first row: here it is the same.
        let mut sorted = vec![examples[0].clone()];
        sorted.extend(other.into_iter().filter(|example| example.place != 0));
        let scores = without(&some([1.0, -0.5, 2.0, 0.3, 0.1, 3.0]), absent);
        for (one, other) in all(&examples).iter().zip(all(&sorted)) {
            let (one, other) = (one.value(&scores), other.value(&scores));
            prop_assert_eq!(one.is_some(), other.is_some());
            let (one, other) = (one.unwrap_or(0.0), other.unwrap_or(0.0));
            prop_assert!((one - other).abs() <= 1e-12 * (1.0 + one.abs()), "{} {}", one, other);
        }
    }

    #[test]
    fn the_discriminant_does_not_ask_for_units(
        seed in 0..40_u64, exponents in prop::collection::vec(-3.0..3.0, 6), absent in 0..63_usize,
    ) {
        // Catches shrinkage of columns as they are: each is standardised, so that its scale falls out.
        let examples = Gaussian { seed, ..unequal() }.examples(30, 25);
        let scaled = |scores: &[Option<f64>]| -> Vec<Option<f64>> {
            scores.iter().zip(&exponents).map(|(x, e)| x.map(|x| x * 10_f64.powf(*e))).collect()
        };
        let other = |e: &Example| Example { scores: scaled(&e.scores), ..e.clone() };
        let others: Vec<Example> = examples.iter().map(other).collect();
        let scores = without(&some([1.0, -0.5, 2.0, 0.3, 0.1, 3.0]), absent);
        for signs in [Signs::NonNegative, Signs::Free] {
            let one = Lda::learn(&examples, signs).unwrap().value(&scores);
            let other = Lda::learn(&others, signs).unwrap().value(&scaled(&scores));
            let (one, other) = (one.unwrap_or(0.0), other.unwrap_or(0.0));
            prop_assert!((one - other).abs() <= 1e-9 * (1.0 + one.abs()), "{} {}", one, other);
        }
    }

    #[test]
    fn distance_has_no_unit_and_no_healthy_side(
        seed in 0..40_u64, factor in 1e-3..1e3, column in 0..6_usize, below in 0.0..9.0,
    ) {
        // Catches a magnitude: beyond the healthy end the index would rise again.
        let examples = Gaussian { seed, ..Gaussian::default() }.examples(40, 0);
        let index = Mahalanobis::learn(&examples).unwrap();
        let mut scores = [1.0, 2.0, 0.5, 0.7, 1.9, 2.5];
        scores[column] = -9.0;
        let at_the_end = index.value(&some(scores)).unwrap();
        scores[column] -= below;
        prop_assert_eq!(index.value(&some(scores)).unwrap().to_bits(), at_the_end.to_bits());
        let times = |scores: &[Option<f64>]| scores.iter().map(|x| x.map(|x| x * factor)).collect();
        let scaled = |e: &Example| Example { scores: times(&e.scores), ..e.clone() };
        let other = Mahalanobis::learn(&examples.iter().map(scaled).collect::<Vec<Example>>()).unwrap();
        let other = other.value(&some(scores.map(|x| x * factor))).unwrap();
        prop_assert!((other - at_the_end).abs() <= 1e-9 * (1.0 + at_the_end), "{} {}", other, at_the_end);
    }
}

#[test]
fn a_constant_discriminator_has_no_weight() {
    // Catches a variance of zero that becomes a huge weight, be the constants the same in both classes or not.
    for cracked_constant in [0.0, 1.0, 6.0] {
        let mut examples = Gaussian::default().examples(40, 40);
        for example in &mut examples {
            example.scores[1] = Some(if example.is_cracked { cracked_constant } else { 0.0 });
        }
        let scores = [2.0, 5e5, 1.0, 2.0, 2.0, 2.0];
        let mut others = scores;
        others[1] = -3.0;
        for signs in [Signs::NonNegative, Signs::Free] {
            let lda = Lda::learn(&examples, signs).unwrap();
            assert_eq!(lda.coefficients()[1].to_bits(), 0.0_f64.to_bits(), "{lda:?}");
            assert_eq!(lda.value(&some(scores)), lda.value(&some(others)));
            assert_eq!(lda.value(&some(scores)), lda.value(&without(&some(scores), 2)), "absent or not");
            let odds = LogOdds::learn(&examples, signs).unwrap();
            assert_eq!(odds.coefficients()[1].to_bits(), 0.0_f64.to_bits(), "{odds:?}");
            assert_eq!(odds.value(&some(scores)), odds.value(&without(&some(others), 2)));
        }
        let distance = Mahalanobis::learn(&examples).unwrap();
        assert_eq!(distance.value(&some(scores)), distance.value(&without(&some(others), 2)));
    }
}

#[test]
fn the_discriminant_is_zero_at_the_sound_mean() {
    // Catches the midpoint, or 0 of the scores, as origin.
    let mut examples = Gaussian::default().examples(50, 30);
    examples.iter_mut().for_each(|e| e.scores.iter_mut().for_each(|x| *x = x.map(|x| x + 2.0)));
    let lda = Lda::learn(&examples, Signs::default()).unwrap();
    let values = |class: bool| -> Vec<f64> {
        let of = examples.iter().filter(|e| e.is_cracked == class);
        of.map(|e| lda.value(&e.scores).unwrap()).collect()
    };
    assert!(values(false).iter().sum::<f64>().abs() < 1e-9);
    assert!(values(true).iter().sum::<f64>() / 30.0 > 1.0);
}

#[test]
fn places_are_counted_and_not_rows() {
    // Catches forty rows of ten places that pass for forty places, and complete rows counted before incomplete ones are
    // left out.
    let mut examples = Gaussian::default().examples(40, 40);
    examples.iter_mut().filter(|e| e.is_cracked).for_each(|e| e.place %= 19);
    examples[7].scores[2] = None;
    let errors = [Lda::learn(&examples, Signs::Free).map(|_| ()), LogOdds::learn(&examples, Signs::Free).map(|_| ())];
    for error in errors.map(Result::unwrap_err) {
        assert!(
            matches!(error, LearnError::TooFew { least: 20, sound: 39, cracked: 19, incomplete: 1, rows: 80, .. }),
            "{error}"
        );
    }
    let few = Mahalanobis::learn(&Gaussian::default().examples(19, 50)).unwrap_err();
    assert!(matches!(few, LearnError::TooFewSound { least: 20, sound: 19, incomplete: 0, rows: 19, .. }), "{few}");
    assert!(
        Lda::learn(&[], Signs::Free).is_err() && Mahalanobis::learn(&[]).is_err() && Weighted::by_auc(&[]).is_err()
    );
}

#[test]
fn a_discriminator_that_no_example_has_is_left_out() {
    // Catches a missing channel that leaves no complete example.
    let mut examples = Gaussian::default().examples(40, 40);
    examples.iter_mut().for_each(|e| e.scores[0] = None);
    let lda = Lda::learn(&examples, Signs::default()).unwrap();
    assert_eq!((lda.coefficients().len(), lda.coefficients()[0].to_bits()), (6, 0));
    assert_eq!(lda.value(&some([9.0; 6])), lda.value(&without(&some([0.0, 9.0, 9.0, 9.0, 9.0, 9.0]), 1)));
}

#[test]
fn classes_that_lie_the_wrong_way_round_give_no_weights() {
    // Catches an index that says the same of every place.
    let wrong = Gaussian { shift: [-1.0, -1.0, -1.0, -1.5, -1.5, -1.5], ..Gaussian::default() }.examples(40, 40);
    assert!(matches!(Lda::learn(&wrong, Signs::NonNegative), Err(LearnError::NoWeight { count: 6, .. })));
    assert!(matches!(LogOdds::learn(&wrong, Signs::NonNegative), Err(LearnError::NoWeight { count: 6, .. })));
    assert!(matches!(Weighted::by_auc(&wrong), Err(LearnError::NoWeight { count: 6, .. })));
    assert!(Lda::learn(&wrong, Signs::Free).is_ok());
}
