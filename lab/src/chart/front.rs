//! The Pareto front: the points that none beats in cost and error, and whether a default has left it by more than the noise.

use super::point::{Error, LEVEL, Point};
use crate::statistics::mean_interval;

/// Differences that count in a facet.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Tolerance {
    /// Fraction of a cost: medians that differ by less are equal.
    pub cost: f64,
    /// Of an error, in its unit: errors that differ by less are equal.
    pub error: f64,
}

/// For each of `points`, whether no other one is at most as costly and as wrong, and better in one. Points that fail a
/// stability limit beat nothing and are not on the front. A point only beats points of its own group.
pub(crate) fn front(points: &[Point]) -> Vec<bool> {
    let beats = |a: &Point, b: &Point| {
        let (cost, error) = (a.cost.median.total_cmp(&b.cost.median), a.error.value.total_cmp(&b.error.value));
        cost.is_le() && error.is_le() && (cost.is_lt() || error.is_lt())
    };
    let is_on = |point: &Point| {
        point.is_stable()
            && point.error.value.is_finite()
            && !points.iter().any(|other| other.group == point.group && other.is_stable() && beats(other, point))
    };
    points.iter().map(is_on).collect()
}

/// Whether a default is on its front.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Optimality {
    /// No point is better by more than the noise.
    OnFront,
    /// The point of this name costs less and is as good, or is better and costs no more, by more than the noise.
    Beaten {
        by: String,
        /// Its median cost over that of the default.
        cost_ratio: f64,
        /// How much greater its error is than the default's, below 0 if less, with its 95 % interval over seeds.
        error_more: (f64, f64, f64),
    },
    /// It fails this stability limit.
    Unstable { case: &'static str },
}

/// Whether `default` is on the front of `points`; if several beat it, the cheapest is named.
pub(crate) fn optimality(default: &Point, points: &[Point], tolerance: Tolerance) -> Optimality {
    if let Some(failure) = default.failures.first() {
        return Optimality::Unstable { case: failure.case };
    }
    let rivals =
        points.iter().filter(|point| point.group == default.group && point.is_stable() && point.name != default.name);
    let beating = rivals.filter_map(|rival| {
        let more = more(&rival.error, &default.error)?;
        let (_, low, high) = more;
        let cost_ratio = rival.cost.median / default.cost.median;
        let is_cheaper = cost_ratio < 1.0 - tolerance.cost && rival.cost.high < default.cost.low;
        let is_as_cheap = cost_ratio <= 1.0 + tolerance.cost;
        let is_as_good = high <= tolerance.error;
        let is_better = high < 0.0 && low.midpoint(high) < -tolerance.error;
        let beats = (is_cheaper && is_as_good) || (is_as_cheap && is_better);
        beats.then(|| (rival, Optimality::Beaten { by: rival.name.clone(), cost_ratio, error_more: more }))
    });
    let least = beating.min_by(|(a, _), (b, _)| a.cost.median.total_cmp(&b.cost.median));
    least.map_or(Optimality::OnFront, |(_, beaten)| beaten)
}

/// By how much the error `a` exceeds `b`, with its interval: over paired seeds, or, without common seeds, the
/// widest that their intervals allow.
fn more(a: &Error, b: &Error) -> Option<(f64, f64, f64)> {
    let difference = a.value - b.value;
    if a.by_seed.len() == b.by_seed.len() && a.by_seed.len() > 1 {
        let pairs: Vec<f64> = a.by_seed.iter().zip(&b.by_seed).map(|(a, b)| a - b).collect();
        let of_seeds = mean_interval(&pairs, LEVEL)?;
        return Some((difference, of_seeds.low, of_seeds.high));
    }
    Some((difference, a.low - b.high, a.high - b.low)).filter(|(difference, ..)| difference.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::point::{Cost, Failure};

    const TOLERANCE: Tolerance = Tolerance { cost: 0.1, error: 0.01 };

    fn point(name: &str, cost: f64, by_seed: &[f64]) -> Point {
        let cost = Cost { median: cost, low: 0.97 * cost, high: 1.03 * cost };
        Point::new(name, name, cost, Error::mean_of(by_seed.to_vec()), 1)
    }

    fn failing(point: Point) -> Point {
        point.failing(vec![Failure { case: "C29", measured: 2.0, limit: 1.0 }])
    }

    /// Catches a front that keeps a beaten point, drops a tie, or keeps a failing point.
    #[test]
    fn the_front_is_what_none_beats() {
        let points = [
            point("cheap", 1.0, &[0.5, 0.5]),
            point("middle", 2.0, &[0.2, 0.2]),
            point("beaten", 3.0, &[0.3, 0.3]),
            point("tie", 2.0, &[0.2, 0.2]),
            failing(point("fast and wrong", 0.1, &[0.0, 0.0])),
            point("exact", 9.0, &[0.0, 0.0]),
        ];
        assert_eq!(front(&points), [true, true, false, true, false, true]);
    }

    /// Catches a default beaten by noise, one that a cheaper and equal rival does not beat, and a rival that wins although
    /// it fails.
    #[test]
    fn a_default_leaves_the_front_by_more_than_the_noise_alone() {
        let default = point("default", 10.0, &[0.10, 0.12, 0.11]);
        let stands = |rival: Point| optimality(&default, &[default.clone(), rival], TOLERANCE);
        let beaten = |of: Optimality| matches!(of, Optimality::Beaten { .. });
        // Half the cost, as good within the tolerance in every pair.
        assert!(beaten(stands(point("half", 5.0, &[0.10, 0.121, 0.111]))));
        // Half the cost, but 0.05 worse; or no worse in the mean, with noise that hides it.
        assert!(!beaten(stands(point("worse", 5.0, &[0.15, 0.17, 0.16]))));
        assert!(!beaten(stands(point("unsure", 5.0, &[0.02, 0.22, 0.09]))));
        // As good and a little cheaper: no more than noise.
        assert!(!beaten(stands(point("alike", 9.5, &[0.10, 0.12, 0.11]))));
        // Better by more than the tolerance at the same cost.
        assert!(beaten(stands(point("better", 10.5, &[0.05, 0.07, 0.06]))));
        assert!(!beaten(stands(failing(point("wrong", 1.0, &[0.0, 0.0, 0.0])))));
        let unstable = failing(default.clone());
        assert_eq!(optimality(&unstable, &[], TOLERANCE), Optimality::Unstable { case: "C29" });
    }
}
