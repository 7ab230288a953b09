//! The area below straight lines from sample to sample.

/// Value of a record at `at` samples from its beginning, on the line between the samples beside it.
pub(crate) fn interpolated(value: impl Fn(usize) -> f64, at: f64) -> f64 {
    let left = at.floor();
    let part = at - left;
    let x = value(left as usize);
    if part > 0.0 { x + (value(left as usize + 1) - x) * part } else { x }
}

/// Integral of `value` over [`from`, `to`], by trapezoids with interpolated ends, in counts times samples.
///
/// `0 <= from < to <=` the index of the last sample.
pub(crate) fn area(value: impl Fn(usize) -> f64, from: f64, to: f64) -> f64 {
    let first = from.floor() as usize + 1;
    let last = to.ceil() as usize - 1;
    let (x_from, x_to) = (interpolated(&value, from), interpolated(&value, to));
    if first > last {
        return (to - from) * (x_from + x_to) / 2.0;
    }
    let inner: f64 = (first..last).map(|i| (value(i) + value(i + 1)) / 2.0).sum();
    let head = (first as f64 - from) * (x_from + value(first)) / 2.0;
    let tail = (to - last as f64) * (value(last) + x_to) / 2.0;
    head + inner + tail
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Catches an end rounded to a sample: the integral of a straight line is known for any ends.
    #[test]
    fn area_of_a_line() {
        for (from, to) in [(0.0, 9.0), (0.25, 8.5), (3.1, 3.9), (2.0, 3.0), (2.0, 3.5), (2.5, 3.0), (0.0, 0.5)] {
            let exact = (to * to - from * from) * 1.5 - 4.0 * (to - from);
            assert!((area(|i| 3.0 * i as f64 - 4.0, from, to) - exact).abs() < 1e-12, "[{from}, {to}]");
        }
    }

    proptest! {
        /// Catches a trapezoid counted twice or left out: areas of adjoining intervals add up.
        #[test]
        fn areas_add_up(samples in prop::collection::vec(-1e3..1e3_f64, 20), cuts in prop::array::uniform3(0.0..19.0_f64)) {
            let mut cuts = cuts;
            cuts.sort_by(f64::total_cmp);
            let [a, b, c] = cuts;
            prop_assume!(a < b && b < c);
            // Cutting at b adds a point on the line, which changes nothing.
            let area_between = |from, to| area(|i| samples[i], from, to);
            prop_assert!((area_between(a, b) + area_between(b, c) - area_between(a, c)).abs() < 1e-9);
        }
    }
}
