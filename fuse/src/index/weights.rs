//! What each discriminator counts: most for what repeats and says what no other does.

use faer::Mat;

use crate::index::covariance::Covariance;

/// Fewest places that a covariance is taken from.
const PLACES_MIN: usize = 20;

/// Most rounds of the descent; a dozen is usual.
const ROUNDS_MAX: usize = 500;

/// Weights of the columns of `places`, none below 0, that sum to 1.
///
/// They are those of w'Sw - 2 sum(w) at its least, S the covariance of sound places (Ledoit and Wolf 2004): of all sums that
/// a damage which moves every column alike moves by 1, the one that scatters least. Places that lack a column that most have
/// are left out; a column that most lack, or that does not vary, has weight 0. Alike where the places are too few.
pub(crate) fn weights(places: &[Vec<f64>], width: usize) -> Vec<f64> {
    let has_most = |column: &usize| 2 * places.iter().filter(|row| row[*column].is_finite()).count() > places.len();
    let columns: Vec<usize> = (0..width).filter(has_most).collect();
    let rows: Vec<&Vec<f64>> = places.iter().filter(|row| columns.iter().all(|&c| row[c].is_finite())).collect();
    let mut weights = vec![0.0; width];
    if rows.len() < PLACES_MIN {
        columns.iter().for_each(|&c| weights[c] = 1.0 / columns.len() as f64);
        return weights;
    }
    let table = Mat::from_fn(rows.len(), columns.len(), |i, j| rows[i][columns[j]]);
    let covariance = Covariance::ledoit_wolf(table.as_ref());
    let found = descend(&covariance.matrix, &covariance.is_constant);
    let sum: f64 = found.iter().sum();
    for (&column, weight) in columns.iter().zip(found) {
        weights[column] = if sum > 0.0 { weight / sum } else { 1.0 / columns.len() as f64 };
    }
    weights
}

/// The least of w'Sw - 2 sum(w) over w >= 0, one weight at a time until none moves.
fn descend(s: &Mat<f64>, is_constant: &[bool]) -> Vec<f64> {
    let count = s.ncols();
    let mut w = vec![0.0; count];
    for _ in 0..ROUNDS_MAX {
        let mut moved = 0.0_f64;
        for i in (0..count).filter(|&i| !is_constant[i]) {
            let others: f64 = (0..count).filter(|&j| j != i).map(|j| s[(i, j)] * w[j]).sum();
            let best = (1.0 - others) / s[(i, i)];
            let best = if best > 0.0 { best } else { 0.0 };
            moved += (best - w[i]).abs();
            w[i] = best;
        }
        if moved < 1e-10 {
            break;
        }
    }
    w
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution as _, StandardNormal};

    use super::*;

    /// w'Sw - 2 sum(w).
    fn cost(s: &Mat<f64>, w: &[f64]) -> f64 {
        let quadratic: f64 =
            (0..w.len()).flat_map(|i| (0..w.len()).map(move |j| (i, j))).map(|(i, j)| w[i] * s[(i, j)] * w[j]).sum();
        quadratic - 2.0 * w.iter().sum::<f64>()
    }

    proptest! {
        #[test]
        fn no_other_weights_cost_less(
            root in prop::collection::vec(-1.0..1.0_f64, 16), other in prop::collection::vec(0.0..3.0_f64, 4)
        ) {
            // Catches a descent that stops early, a weight below 0, and a column that is left out: any other weights.
            let a = Mat::from_fn(4, 4, |i, j| root[4 * i + j]);
            let mut s = a.transpose() * &a;
            (0..4).for_each(|i| s[(i, i)] += 0.05);
            let found = descend(&s, &[false; 4]);
            prop_assert!(found.iter().all(|&w| w >= 0.0));
            prop_assert!(cost(&s, &found) <= cost(&s, &other) + 1e-6, "{found:?} {other:?}");
        }
    }

    #[test]
    fn what_repeats_counts_more_and_what_says_the_same_twice_counts_once() {
        // Catches weights that are alike whatever the columns do: the first is quiet, the last two are one and the same.
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut row = |_| {
            let [a, b, c]: [f64; 3] = std::array::from_fn(|_| StandardNormal.sample(&mut rng));
            vec![0.6 * a, b, c, c, f64::NAN]
        };
        let places: Vec<Vec<f64>> = (0..4000).map(&mut row).collect();
        let found = weights(&places, 5);
        assert!((found.iter().sum::<f64>() - 1.0).abs() < 1e-12 && found[4].abs() < 1e-12, "{found:?}");
        assert!(found[0] > 2.0 * found[1], "{found:?}");
        assert!((found[2] + found[3] - found[1]).abs() < 0.25 * found[1], "{found:?}");
        let few = weights(&places[..PLACES_MIN - 1], 5);
        assert_eq!(few, [0.25, 0.25, 0.25, 0.25, 0.0], "too few to tell");
    }
}
