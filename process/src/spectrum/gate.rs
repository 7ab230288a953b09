//! The part of a record that the tap's sound fills.

use std::f64::consts::PI;

use crate::Real;

/// Fraction at the end of the gate over which it closes as a cosine. It opens sharply, in the quiet before the sound.
const TAIL: f64 = 0.1;

/// Fills `cut` with `samples`, faded out at their end, and zeros up to a length with a fast transform. Returns the sum
/// of the gate's squared weights, which is the gain of noise.
pub(super) fn cut<T: Real>(samples: &[T], cut: &mut Vec<T>) -> f64 {
    let tail_count = (TAIL * samples.len() as f64) as usize;
    let (open, tail) = samples.split_at(samples.len() - tail_count);
    cut.clear();
    cut.extend_from_slice(open);
    let mut noise_samples = open.len() as f64;
    for (i, &x) in tail.iter().enumerate() {
        let height = 0.5 * (1.0 + (PI * (i as f64 + 0.5) / tail_count as f64).cos());
        noise_samples += height * height;
        cut.push(x * T::rounded(height));
    }
    cut.resize(transform_length(samples.len()), T::zero());
    noise_samples
}

/// Smallest even number of at least `count` without a prime factor above 5.
fn transform_length(count: usize) -> usize {
    let is_smooth = |n: &usize| {
        let mut rest = *n;
        for prime in [2, 3, 5] {
            while rest.is_multiple_of(prime) {
                rest /= prime;
            }
        }
        rest == 1
    };
    // Ends, because there is a power of two below twice the count.
    (count.max(2).next_multiple_of(2)..).step_by(2).find(is_smooth).unwrap_or(count)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a length that is too short, odd, slow to transform, or far too long.
    #[test]
    fn lengths_are_smooth() {
        let lengths = [0, 1, 3, 2048, 2049, 2050, 4097].map(transform_length);
        assert_eq!(lengths, [2, 2, 4, 2048, 2160, 2160, 4320]);
        for count in 2..5000 {
            let length = transform_length(count);
            assert!(
                length >= count && length.is_multiple_of(2) && length <= count + count / 7 + 2,
                "{count}: {length}"
            );
        }
    }

    /// Catches a gate that closes at the wrong end or not fully, and a wrong gain of noise.
    #[test]
    fn the_gate_closes_at_its_end() {
        let mut gated = vec![7.0; 3];
        let noise_samples = cut(&[1.0_f64; 100], &mut gated);
        assert_eq!(gated.len(), 100);
        assert!(gated[..90].iter().all(|x| (x - 1.0).abs() < 1e-15));
        assert!(gated[90..].windows(2).all(|pair| pair[1] < pair[0]) && gated[99] < 0.01);
        let through: f64 = gated.iter().map(|x| x * x).sum();
        assert!((noise_samples - through).abs() < 1e-12);
        assert!((cut::<f64>(&[], &mut gated)).abs() < 1e-15);
    }
}
