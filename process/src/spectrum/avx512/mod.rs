//! The transform of a power of two of complex numbers, for processors with vectors of sixteen (AVX-512).
//!
//! With n = 16 m, W_n = exp(-2 pi i/n), and 16 j + l the index of a number:
//!
//! X_{q + m p} = sum_l W_16^{l p} W_n^{l q} sum_j W_m^{j q} z_{16 j + l}
//!
//! The inner sums are sixteen transforms of length m side by side, each in its own lane. They come first, in passes of
//! eight or four rows, which decimate in frequency and leave the rows in digit-reversed order. The outer sum goes
//! across the lanes, for sixteen q at a time, and only for those p whose bins are needed.
#![expect(unsafe_code, reason = "a function for processors that have an instruction may be called on them alone")]

mod row;

use std::arch::is_x86_feature_detected;
use std::array::from_fn;
use std::f64::consts::TAU;

use num_complex::Complex;
use row::{Row, eight, every_lane, four, lanes_across, load, product, quarters_across, store};

use super::transform::Transform;

/// Numbers per row.
const LANES: usize = 16;
/// Rows that the first pass takes at a time, and all others but perhaps the last two.
const EIGHT: usize = 8;
/// Rows that the last one or two passes take, where m is no power of eight.
const FOUR: usize = 4;
/// Fewest rows: two passes of eight. Shorter transforms take too little of a tap's time to be worth their own code.
const ROWS_MIN: usize = 64;

/// A pass over blocks of rows.
struct Pass {
    /// Rows per block.
    row_count: usize,
    twiddles: Twiddles,
}

/// W^{ij} for the outputs i of the j-th rows, where W belongs to the rows of a block; for eight rows at a time, or
/// four.
enum Twiddles {
    Eight(Vec<[Complex<f32>; EIGHT]>),
    Four(Vec<[Complex<f32>; FOUR]>),
}

/// The transform of one length.
pub(super) struct Lanes {
    /// Twiddles of the first pass.
    first: Vec<[Complex<f32>; EIGHT]>,
    others: Vec<Pass>,
    /// The row that holds the q-th outputs after the passes, sixteen q at a time.
    order: Vec<[usize; LANES]>,
    /// W_n^{lq} in lane l, in the same order.
    across: Vec<[Row; LANES]>,
    /// W_16^{bp} for p from 1 to 3, the outputs across lanes, where b is the lane's number in its quarter.
    inner: [Row; 3],
    work: Vec<Row>,
}

impl Lanes {
    /// The transform of `length` numbers; `None` unless that is a power of two, large enough, and the processor has
    /// AVX-512.
    pub(super) fn try_new(length: usize) -> Option<Self> {
        let rows = length / LANES;
        let is_apt = length.is_power_of_two() && rows >= ROWS_MIN && is_x86_feature_detected!("avx512f");
        if !is_apt {
            return None;
        }
        let mut others = Vec::new();
        // For each pass, how many outputs it has and how many rows apart they are.
        let mut digits = vec![(EIGHT, rows / EIGHT)];
        let mut row_count = rows / EIGHT;
        while row_count > 1 {
            // Radix eight, except for a rest of four or sixteen.
            let is_four = row_count == FOUR || row_count == FOUR * FOUR;
            let (radix, twiddles) = match is_four {
                true => (FOUR, Twiddles::Four(twiddles(row_count))),
                false => (EIGHT, Twiddles::Eight(twiddles(row_count))),
            };
            others.push(Pass { row_count, twiddles });
            row_count /= radix;
            digits.push((radix, row_count));
        }
        let row_of = |q: usize| {
            let place = |(row, q), &(radix, apart): &(usize, usize)| (row + q % radix * apart, q / radix);
            digits.iter().fold((0, q), place).0
        };
        let blocks = || (0..rows / LANES).map(|block| from_fn(|i| block * LANES + i));
        Some(Self {
            first: twiddles(rows),
            others,
            order: blocks().map(|qs: [usize; LANES]| qs.map(row_of)).collect(),
            across: blocks().map(|qs| qs.map(|q| Row::new(from_fn(|lane| unit(lane * q, length))))).collect(),
            inner: [1, 2, 3].map(|p| Row::new(from_fn(|lane| unit(lane % 4 * p, LANES)))),
            work: vec![Row::zero(); rows],
        })
    }

    #[target_feature(enable = "avx512f")]
    fn run(&mut self, given: &[Complex<f32>], transformed: &mut [Complex<f32>], bin_count: usize) {
        into_eights(given, &mut self.work, &self.first);
        for block in self.work.chunks_exact_mut(self.first.len()) {
            in_depth(block, &self.others);
        }
        self.across_lanes(transformed, bin_count);
    }

    /// The outer sum, as four by four: across the quarters of the lanes first, then within them.
    #[target_feature(enable = "avx512f")]
    fn across_lanes(&self, transformed: &mut [Complex<f32>], bin_count: usize) {
        let rows = self.work.len();
        let is_asked_for: [bool; LANES] = from_fn(|p| p * rows < bin_count || (LANES - p - 1) * rows < bin_count);
        for (number, (order, twiddles)) in self.order.iter().zip(&self.across).enumerate() {
            let row = |i: usize| product(self.work[order[i]], twiddles[i]);
            let quarters = |i: usize| {
                let [a, b, c, d] = four(quarters_across([row(i), row(4 + i), row(8 + i), row(12 + i)]));
                let [w1, w2, w3] = self.inner;
                [a, product(b, w1), product(c, w2), product(d, w3)]
            };
            let [a, b, c, d] = [quarters(0), quarters(1), quarters(2), quarters(3)];
            for p in 0..4 {
                for (k, output) in four(lanes_across([a[p], b[p], c[p], d[p]])).iter().enumerate() {
                    let p = p + 4 * k;
                    if is_asked_for[p] {
                        store(*output, &mut transformed[p * rows + LANES * number..][..LANES]);
                    }
                }
            }
        }
    }
}

impl Transform<f32> for Lanes {
    fn forward(&mut self, given: &mut [Complex<f32>], transformed: &mut [Complex<f32>], bin_count: usize) {
        // SAFETY: `try_new` makes a transform only if the processor has AVX-512.
        unsafe { self.run(given, transformed, bin_count) }
    }
}

/// W^{ij} for the outputs i of a pass of `RADIX` rows, and all j.
fn twiddles<const RADIX: usize>(row_count: usize) -> Vec<[Complex<f32>; RADIX]> {
    (0..row_count / RADIX).map(|j| from_fn(|i| unit(i * j, row_count))).collect()
}

/// W_n^k.
fn unit(k: usize, n: usize) -> Complex<f32> {
    let angle = -TAU / n as f64 * (k % n) as f64;
    Complex::new(angle.cos() as f32, angle.sin() as f32)
}

/// The first pass, which reads the given numbers.
#[target_feature(enable = "avx512f")]
fn into_eights(given: &[Complex<f32>], work: &mut [Row], twiddles: &[[Complex<f32>; EIGHT]]) {
    let apart = work.len() / EIGHT;
    for (j, twiddles) in twiddles.iter().enumerate() {
        let mut rows = [Row::zero(); EIGHT];
        for (i, row) in rows.iter_mut().enumerate() {
            *row = load(&given[LANES * (j + i * apart)..][..LANES]);
        }
        for (i, row) in turned(eight(rows), twiddles).iter().enumerate() {
            work[j + i * apart] = *row;
        }
    }
}

/// The other passes over a block. Each part is finished before the next begins, so that it stays in the nearest cache.
#[target_feature(enable = "avx512f")]
fn in_depth(block: &mut [Row], passes: &[Pass]) {
    match passes {
        [] => {}
        // All twiddles of the last pass are 1.
        [Pass { twiddles: Twiddles::Eight(_), .. }] => {
            for rows in block.as_chunks_mut().0 {
                *rows = eight(*rows);
            }
        }
        [Pass { twiddles: Twiddles::Four(_), .. }] => {
            for rows in block.as_chunks_mut().0 {
                *rows = four(*rows);
            }
        }
        [Pass { row_count, twiddles }, rest @ ..] => {
            for block in block.chunks_exact_mut(*row_count) {
                match twiddles {
                    Twiddles::Eight(twiddles) => in_place(block, twiddles, |rows| eight(rows)),
                    Twiddles::Four(twiddles) => in_place(block, twiddles, |rows| four(rows)),
                }
                in_depth(block, rest);
            }
        }
    }
}

#[inline]
#[target_feature(enable = "avx512f")]
fn in_place<const RADIX: usize>(
    block: &mut [Row],
    twiddles: &[[Complex<f32>; RADIX]],
    butterfly: impl Fn([Row; RADIX]) -> [Row; RADIX],
) {
    let apart = block.len() / RADIX;
    for (j, twiddles) in twiddles.iter().enumerate() {
        let mut rows = [Row::zero(); RADIX];
        for (i, row) in rows.iter_mut().enumerate() {
            *row = block[j + i * apart];
        }
        for (i, row) in turned(butterfly(rows), twiddles).iter().enumerate() {
            block[j + i * apart] = *row;
        }
    }
}

/// Multiplies the outputs by their twiddles, of which the first is 1.
#[inline]
#[target_feature(enable = "avx512f")]
fn turned<const RADIX: usize>(mut rows: [Row; RADIX], twiddles: &[Complex<f32>; RADIX]) -> [Row; RADIX] {
    for (row, twiddle) in rows[1..].iter_mut().zip(&twiddles[1..]) {
        *row = product(*row, every_lane(*twiddle));
    }
    rows
}

#[cfg(test)]
mod tests {
    use rustfft::FftPlanner;
    use tapline_testing::noise::Noise;

    use super::*;

    fn numbers(length: usize) -> Vec<Complex<f32>> {
        // Noise, whose bins are all of similar size.
        let mut noise = Noise(12_345);
        let mut random = || (noise.uniform() - 0.5) as f32;
        (0..length).map(|_| Complex::new(random(), random())).collect()
    }

    fn transformed(length: usize, bin_count: usize) -> Option<Vec<Complex<f32>>> {
        if !is_x86_feature_detected!("avx512f") {
            tapline_testing::skip("this processor has no AVX-512");
            return None;
        }
        let mut lanes = Lanes::try_new(length).expect("a transform of this length");
        let mut bins = vec![Complex::new(f32::NAN, f32::NAN); length];
        lanes.forward(&mut numbers(length), &mut bins, bin_count);
        Some(bins)
    }

    /// Catches a wrong sign, twiddle, order or radix of any pass, and a rounding error that grows. Covers two to five
    /// passes with every rest (8, 4 and 4 times 4), against double precision, from which `rustfft` in single precision
    /// is about as far.
    #[test]
    fn bins_like_double_precision() {
        for length in (10..18).map(|bits| 1 << bits) {
            let Some(ours) = transformed(length, length) else { return };
            // The largest error below would ignore a NaN.
            assert!(ours.iter().all(|z| z.is_finite()), "of {length}: an output is left out");
            let widened = |z: &Complex<f32>| Complex::new(f64::from(z.re), f64::from(z.im));
            let mut exact: Vec<Complex<f64>> = numbers(length).iter().map(widened).collect();
            FftPlanner::new().plan_fft_forward(length).process(&mut exact);
            let mut theirs = numbers(length);
            FftPlanner::new().plan_fft_forward(length).process(&mut theirs);
            let worst = |bins: &[Complex<f32>]| {
                let errors = bins.iter().zip(&exact).map(|(found, exact)| (widened(found) - exact).norm());
                errors.fold(0.0, |most, error| if error > most { error } else { most })
            };
            let (ours, theirs) = (worst(&ours), worst(&theirs));
            assert!(ours < 2.0 * theirs, "of {length}: {ours:e}, rustfft {theirs:e}");
        }
    }

    /// Catches an output that is left out although it is needed: the first and the last bins have the same bits as in a
    /// full transform.
    #[test]
    fn bins_asked_for_are_there() {
        for length in [1024, 8192] {
            let Some(all) = transformed(length, length) else { return };
            for bin_count in [1, 2, 63, 64, 65, length / 16, length / 7, length / 2] {
                let Some(bins) = transformed(length, bin_count) else { return };
                assert_eq!(bins[..bin_count], all[..bin_count], "the first {bin_count} of {length}");
                assert_eq!(bins[length - bin_count..], all[length - bin_count..], "the last {bin_count} of {length}");
            }
        }
    }

    /// Catches a length that the passes cannot divide.
    #[test]
    fn other_lengths_are_left_to_others() {
        for length in [0, 1, 16, 512, 1023, 1025, 1536, 8200] {
            assert!(Lanes::try_new(length).is_none(), "{length}");
        }
    }
}
