//! The indices against scikit-learn on the same scores (`tests/indices_reference.py` makes them and its answers).

use std::collections::BTreeMap;

use faer::Mat;

use super::testing::some;
use super::{Example, Index as _, Lda, LogOdds, Mahalanobis, Signs, Weighted};
use crate::covariance::Covariance;

const REFERENCE: &str = include_str!("../../tests/indices_reference.csv");

/// Scores of both classes, and expected numbers by name.
#[derive(Default)]
struct Case {
    examples: Vec<Example>,
    expected: BTreeMap<String, Vec<f64>>,
}

fn cases() -> BTreeMap<String, Case> {
    let mut cases: BTreeMap<String, Case> = BTreeMap::new();
    for line in REFERENCE.lines() {
        let mut cells = line.split(',');
        let (case, name) = (cells.next().unwrap(), cells.next().unwrap());
        let numbers: Vec<f64> = cells.map(|cell| cell.parse().unwrap()).collect();
        let case = cases.entry(case.to_owned()).or_default();
        if name == "sound" || name == "cracked" {
            let place = case.examples.len();
            case.examples.push(Example { scores: some(numbers), is_cracked: name == "cracked", place });
        } else {
            case.expected.insert(name.to_owned(), numbers);
        }
    }
    assert_eq!(cases.len(), 5);
    cases
}

#[track_caller]
fn assert_close(case: &str, got: &[f64], expected: &[f64]) {
    assert_eq!(got.len(), expected.len(), "{case}");
    for (got, expected) in got.iter().zip(expected) {
        assert!((got - expected).abs() <= 1e-8 * (1.0 + expected.abs()), "{case}: {got} {expected}");
    }
}

#[test]
fn the_covariance_is_that_of_ledoit_wolf() {
    // Catches n - 1 in place of n, a shrinkage of another formula, and one column that is shrunk.
    for (name, case) in cases() {
        let sound: Vec<&Example> = case.examples.iter().filter(|example| !example.is_cracked).collect();
        let x = Mat::from_fn(sound.len(), sound[0].scores.len(), |i, j| sound[i].scores[j].unwrap());
        let found = Covariance::ledoit_wolf(x.as_ref());
        let matrix: Vec<f64> =
            found.matrix.row_iter().flat_map(|row| row.iter().copied().collect::<Vec<f64>>()).collect();
        assert_close(&name, &matrix, &case.expected["covariance"]);
        assert_eq!(found.is_constant.iter().filter(|&&constant| constant).count(), usize::from(name == "constant"));
    }
}

#[test]
fn the_plain_distance_is_that_of_scikit_learn() {
    // Catches a root, and a constant that is left out before the shrinkage and not after it.
    for (name, case) in cases() {
        let index = Mahalanobis::learn(&case.examples).unwrap();
        let sound = case.examples.iter().filter(|example| !example.is_cracked);
        let found: Vec<f64> = sound.map(|example| index.squared_both_ways(&example.scores).unwrap()).collect();
        assert_close(&name, &found, &case.expected["mahalanobis"]);
    }
}

#[test]
fn the_discriminant_is_that_of_scikit_learn() {
    // Catches classes that count alike, a covariance of all examples, and shrinkage before standardising.
    for (name, case) in cases() {
        let index = Lda::learn(&case.examples, Signs::Free).unwrap();
        assert_close(&name, index.coefficients(), &case.expected["lda"]);
        let free = index.coefficients().iter().any(|&w| w < 0.0);
        assert_eq!(free, name != "one", "{name} tries no negative weight");
    }
}

#[test]
fn the_regression_is_that_of_scikit_learn() {
    // Catches a penalised intercept, a penalty of another strength, and Newton's method ended too early.
    for (name, case) in cases() {
        let index = LogOdds::learn(&case.examples, Signs::Free).unwrap();
        let mut found = index.coefficients().to_vec();
        found.push(index.intercept());
        assert_close(&name, &found, &case.expected["logistic"]);
        let first = &case.examples[0].scores;
        let by_hand: f64 = first.iter().zip(&found).map(|(x, w)| x.unwrap() * w).sum::<f64>() + index.intercept();
        assert_close(&name, &[index.value(first).unwrap()], &[by_hand]);
    }
}

#[test]
fn the_weights_by_auc_are_from_scikit_learns_auc() {
    // Catches 2 AUC - 1 of the wrong class.
    for (name, case) in cases() {
        let weights: Vec<f64> =
            case.expected["auc"].iter().map(|a| if *a > 0.5 { 2.0 * a - 1.0 } else { 0.0 }).collect();
        let largest = weights.iter().copied().max_by(f64::total_cmp).unwrap();
        let expected: Vec<f64> = weights.iter().map(|w| w / largest).collect();
        assert_close(&name, &Weighted::by_auc(&case.examples).unwrap().weights().unwrap(), &expected);
    }
}
