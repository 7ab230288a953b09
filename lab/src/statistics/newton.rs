//! The greatest value of a smooth concave function of a few parameters.

use super::Refusal;

/// Steps after which a fit is given up; concave likelihoods take five to twenty.
const STEPS: usize = 100;

/// Halvings of a step that went too far.
const HALVINGS: usize = 60;

/// Gain of the next step, in units of the function, below which the greatest value is reached: a likelihood's
/// parameters are then within 1e-10 of their standard deviations, and the last step is still taken.
const GAIN: f64 = 1e-20;

/// Gain below which a step that gains no less than the one before is only rounding.
const GAIN_OF_ROUNDING: f64 = 1e-10;

/// A function at a point: its value, gradient, and the negative of its second derivatives.
pub(super) struct At<const N: usize> {
    pub value: f64,
    pub gradient: [f64; N],
    pub information: [[f64; N]; N],
}

impl<const N: usize> At<N> {
    /// Nothing summed yet.
    pub(super) fn zero() -> Self {
        Self { value: 0.0, gradient: [0.0; N], information: [[0.0; N]; N] }
    }

    /// Adds a function of u alone, with first and second derivative `first` and `second`, where u has the derivatives
    /// `along`.
    pub(super) fn add(&mut self, value: f64, first: f64, second: f64, along: [f64; N]) {
        self.value += value;
        for i in 0..N {
            self.gradient[i] += first * along[i];
            for j in 0..N {
                self.information[i][j] -= second * along[i] * along[j];
            }
        }
    }
}

/// Where a function is greatest.
pub(super) struct Peak<const N: usize> {
    pub point: [f64; N],
    pub value: f64,
    /// Inverse of the information there.
    pub covariance: [[f64; N]; N],
}

/// The peak of a concave function by Newton steps, halved until they do not lead down; `at` is `None` outside its
/// domain.
pub(super) fn peak<const N: usize>(
    start: [f64; N],
    at: impl Fn(&[f64; N]) -> Option<At<N>>,
) -> Result<Peak<N>, Refusal> {
    let mut point = start;
    let mut here = at(&point).ok_or(Refusal::NotSettled(0))?;
    let mut last_gain = f64::INFINITY;
    for steps in 1..=STEPS {
        let covariance = inverse(here.information).ok_or(Refusal::NotSettled(steps))?;
        let step: [f64; N] = covariance.map(|row| dot(&row, &here.gradient));
        let gain = dot(&step, &here.gradient);
        // Sums of many logarithms are good to about this much; a step that changes less cannot be judged by them.
        let rounding = 1e-13 * (1.0 + here.value.abs());
        let mut fraction = 1.0;
        let next = (0..HALVINGS).find_map(|_| {
            let moved: [f64; N] = std::array::from_fn(|i| point[i] + fraction * step[i]);
            fraction *= 0.5;
            at(&moved).filter(|next| next.value >= here.value - rounding).map(|next| (moved, next))
        });
        (point, here) = next.ok_or(Refusal::NotSettled(steps))?;
        let is_rounding = gain < GAIN_OF_ROUNDING && gain > 0.25 * last_gain;
        last_gain = gain;
        if gain < GAIN || is_rounding {
            let covariance = inverse(here.information).ok_or(Refusal::NotSettled(steps))?;
            return Ok(Peak { point, value: here.value, covariance });
        }
    }
    Err(Refusal::NotSettled(STEPS))
}

/// Scalar product.
pub(super) fn dot<const N: usize>(left: &[f64; N], right: &[f64; N]) -> f64 {
    left.iter().zip(right).map(|(left, right)| left * right).sum()
}

/// `gradient` covariance `gradient`: the variance of what has that gradient, by the delta method.
pub(super) fn variance<const N: usize>(covariance: &[[f64; N]; N], gradient: &[f64; N]) -> f64 {
    dot(&covariance.map(|row| dot(&row, gradient)), gradient)
}

/// Inverse of a symmetric positive definite matrix by Gauss-Jordan without pivots; `None` of any other.
fn inverse<const N: usize>(matrix: [[f64; N]; N]) -> Option<[[f64; N]; N]> {
    let mut left = matrix;
    let mut right: [[f64; N]; N] = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    for k in 0..N {
        // Below this part of the diagonal what is left is rounding: the matrix is singular.
        let pivot = left[k][k];
        if !(pivot.is_finite() && pivot > 1e-14 * matrix[k][k]) {
            return None;
        }
        for j in 0..N {
            left[k][j] /= pivot;
            right[k][j] /= pivot;
        }
        for i in (0..N).filter(|&i| i != k) {
            let factor = left[i][k];
            for j in 0..N {
                left[i][j] -= factor * left[k][j];
                right[i][j] -= factor * right[k][j];
            }
        }
    }
    Some(right)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_peak_is_found_from_afar() {
        // Catches a step that overshoots for good, and a wrong inverse: -cosh(x - 3) - (y - 2x)^2, from x = -40, where
        // a whole Newton step of the first term alone is small and that of the second large.
        let at = |&[x, y]: &[f64; 2]| {
            let mut at = At::zero();
            at.add(-(x - 3.0).cosh(), -(x - 3.0).sinh(), -(x - 3.0).cosh(), [1.0, 0.0]);
            at.add(-(y - 2.0 * x).powi(2), -2.0 * (y - 2.0 * x), -2.0, [-2.0, 1.0]);
            Some(at)
        };
        let peak = peak([-40.0, 9.0], at).unwrap();
        assert!((peak.point[0] - 3.0).abs() < 1e-9 && (peak.point[1] - 6.0).abs() < 1e-9, "{:?}", peak.point);
        // Information [[1 + 8, -4], [-4, 2]] has the inverse [[2, 4], [4, 9]] / 2.
        for (got, expected) in peak.covariance.as_flattened().iter().zip([1.0, 2.0, 2.0, 4.5]) {
            assert!((got - expected).abs() < 1e-9, "{:?}", peak.covariance);
        }
    }

    #[test]
    fn what_has_no_peak_says_so() {
        // Catches a fit that walks for ever, one on a plain, and one that starts outside its domain.
        let rising = |&[x]: &[f64; 1]| {
            let mut at = At::zero();
            at.add(x.ln(), 1.0 / x, -1.0 / (x * x), [1.0]);
            (x > 0.0).then_some(at)
        };
        assert!(matches!(peak([1.0], rising), Err(Refusal::NotSettled(STEPS))));
        assert!(matches!(peak([0.0], |_| Some(At::zero())), Err(Refusal::NotSettled(1))));
        assert!(matches!(peak([0.0], |_| None), Err(Refusal::NotSettled(0))));
    }
}
