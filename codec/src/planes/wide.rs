//! Planes of bits in the 32-byte vectors of AVX2, if the processor has them.

use std::arch::x86_64::__m256i;

use pulp::x86::V3;
use pulp::{NullaryFnOnce, cast};

use super::{BITS, GROUP};

/// Bytes of half a vector; AVX2 moves bytes within halves.
pub(super) const HALF: usize = 16;

/// Groups processed together: their bits fill one vector of each plane.
pub(super) const GROUPS: usize = 2 * HALF;

/// Converts as many groups as fill whole vectors, and returns their number.
pub(super) fn to_planes(element_bytes: usize, samples: &[u8], planes: &mut [u8]) -> usize {
    match (V3::try_new(), element_bytes) {
        (Some(simd), 2) => simd.vectorize(ToPlanes::<16> { simd, samples, planes }),
        (Some(simd), 4) => simd.vectorize(ToPlanes::<32> { simd, samples, planes }),
        _ => 0,
    }
}

/// The inverse of [`to_planes`].
pub(super) fn from_planes(element_bytes: usize, planes: &[u8], samples: &mut [u8]) -> usize {
    match (V3::try_new(), element_bytes) {
        (Some(simd), 2) => simd.vectorize(FromPlanes::<16> { simd, planes, samples }),
        (Some(simd), 4) => simd.vectorize(FromPlanes::<32> { simd, planes, samples }),
        _ => 0,
    }
}

/// For groups of `N` bytes.
struct ToPlanes<'a, const N: usize> {
    simd: V3,
    samples: &'a [u8],
    planes: &'a mut [u8],
}

impl<const N: usize> NullaryFnOnce for ToPlanes<'_, N> {
    type Output = usize;

    #[inline(always)]
    fn call(self) -> usize {
        let Self { simd, samples, planes } = self;
        let plane_bytes = samples.len() / N;
        let blocks = samples.chunks_exact(GROUPS * N);
        let done = GROUPS * blocks.len();
        for (number, groups) in blocks.enumerate() {
            let (halves, _) = groups.as_chunks::<HALF>();
            let mut rows: [__m256i; N] = [cast([0_u8; GROUPS]); N];
            for (k, row) in rows.iter_mut().enumerate() {
                *row = cast([halves[k], halves[k + N]]);
            }
            // Turns rows of groups into rows of the same byte of every group.
            for _ in 0..HALF.ilog2() {
                rows = dealt(simd, rows);
            }
            for byte in 0..N / GROUP {
                let bits = exchanged(simd, std::array::from_fn(|k| rows[k * (N / GROUP) + byte]));
                for (bit, vector) in bits.into_iter().enumerate() {
                    let bytes: [u8; GROUPS] = cast(vector);
                    planes[(BITS * byte + bit) * plane_bytes + GROUPS * number..][..GROUPS].copy_from_slice(&bytes);
                }
            }
        }
        done
    }
}

/// For groups of `N` bytes.
struct FromPlanes<'a, const N: usize> {
    simd: V3,
    planes: &'a [u8],
    samples: &'a mut [u8],
}

impl<const N: usize> NullaryFnOnce for FromPlanes<'_, N> {
    type Output = usize;

    #[inline(always)]
    fn call(self) -> usize {
        let Self { simd, planes, samples } = self;
        let plane_bytes = planes.len() / N;
        let done = samples.len() / (GROUPS * N) * GROUPS;
        for (number, groups) in samples.chunks_exact_mut(GROUPS * N).enumerate() {
            let mut rows: [__m256i; N] = [cast([0_u8; GROUPS]); N];
            for byte in 0..N / GROUP {
                let plane = |bit: usize| {
                    let plane = planes.get((BITS * byte + bit) * plane_bytes + GROUPS * number..);
                    plane
                        .and_then(|plane| plane.first_chunk::<GROUPS>())
                        .map_or(cast([0_u8; GROUPS]), |bytes| cast(*bytes))
                };
                let samples = exchanged(simd, std::array::from_fn(plane));
                for (k, row) in samples.into_iter().enumerate() {
                    rows[k * (N / GROUP) + byte] = row;
                }
            }
            for _ in 0..N.ilog2() {
                rows = dealt(simd, rows);
            }
            let (halves, _) = groups.as_chunks_mut::<HALF>();
            for (k, row) in rows.into_iter().enumerate() {
                [halves[k], halves[k + N]] = cast(row);
            }
        }
        done
    }
}

/// Interleaves the bytes of the rows of the lower and of the upper half of `rows`. Written as its row's number followed by its
/// offset in the half vector, the number of each byte is rotated left by one bit.
#[inline(always)]
pub(super) fn dealt<const N: usize>(simd: V3, rows: [__m256i; N]) -> [__m256i; N] {
    let mut all = rows;
    for k in 0..N / 2 {
        all[2 * k] = simd.avx2._mm256_unpacklo_epi8(rows[k], rows[k + N / 2]);
        all[2 * k + 1] = simd.avx2._mm256_unpackhi_epi8(rows[k], rows[k + N / 2]);
    }
    all
}

/// Exchanges bit k of row i with bit i of row k, in every byte: samples become planes, and planes samples.
#[inline(always)]
fn exchanged(simd: V3, mut rows: [__m256i; BITS]) -> [__m256i; BITS] {
    let V3 { avx, avx2, .. } = simd;
    // Fours, then pairs, then bits.
    for k in [0, 1, 2, 3] {
        let mask = avx._mm256_set1_epi8(0x0F);
        let swapped =
            avx2._mm256_and_si256(avx2._mm256_xor_si256(avx2._mm256_srli_epi16::<4>(rows[k]), rows[k + 4]), mask);
        rows[k + 4] = avx2._mm256_xor_si256(rows[k + 4], swapped);
        rows[k] = avx2._mm256_xor_si256(rows[k], avx2._mm256_slli_epi16::<4>(swapped));
    }
    for k in [0, 1, 4, 5] {
        let mask = avx._mm256_set1_epi8(0x33);
        let swapped =
            avx2._mm256_and_si256(avx2._mm256_xor_si256(avx2._mm256_srli_epi16::<2>(rows[k]), rows[k + 2]), mask);
        rows[k + 2] = avx2._mm256_xor_si256(rows[k + 2], swapped);
        rows[k] = avx2._mm256_xor_si256(rows[k], avx2._mm256_slli_epi16::<2>(swapped));
    }
    for k in [0, 2, 4, 6] {
        let mask = avx._mm256_set1_epi8(0x55);
        let swapped =
            avx2._mm256_and_si256(avx2._mm256_xor_si256(avx2._mm256_srli_epi16::<1>(rows[k]), rows[k + 1]), mask);
        rows[k + 1] = avx2._mm256_xor_si256(rows[k + 1], swapped);
        rows[k] = avx2._mm256_xor_si256(rows[k], avx2._mm256_slli_epi16::<1>(swapped));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches an error in the code for machines without GFNI, where this machine has it: what is computed here equals the planes of
    /// [`to_planes`](super::super::to_planes), which another test checks bit by bit.
    #[test]
    fn planes_do_not_depend_on_the_machine() {
        for count in [0, GROUPS, 3 * GROUPS + 5] {
            let samples: Vec<u8> = (0..16 * count as u32).map(|k| (k.wrapping_mul(k) >> 3) as u8).collect();
            let (mut planes, mut wide) = (vec![9; samples.len()], vec![7; samples.len()]);
            super::super::to_planes(2, &samples, &mut planes);
            let done = to_planes(2, &samples, &mut wide);
            for plane in 0..16 {
                assert_eq!(wide[plane * count..][..done], planes[plane * count..][..done], "{count}: plane {plane}");
            }
            let mut back = vec![7; samples.len()];
            assert_eq!(from_planes(2, &planes, &mut back), done);
            assert_eq!(back[..16 * done], samples[..16 * done], "{count}");
        }
    }
}
