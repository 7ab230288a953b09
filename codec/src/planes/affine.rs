//! Planes of bits of 16-bit samples on processors that multiply matrices of bits (GFNI): eight bytes are transposed at once.
#![expect(unsafe_code, reason = "functions that need GFNI may be called only on processors with GFNI")]

use std::arch::is_x86_feature_detected;
use std::arch::x86_64::{
    __m256i, _mm256_gf2p8affine_epi64_epi8, _mm256_set1_epi64x, _mm256_shuffle_epi8, _mm256_unpackhi_epi8,
    _mm256_unpacklo_epi8,
};

use pulp::cast;
use pulp::x86::V3;

use super::BITS;
use super::wide::{GROUPS, HALF, dealt};

/// Bytes of a group: eight samples of two bytes.
const N: usize = 16;

/// The identity matrix: a product with it transposes a matrix whose rows are in reverse order.
const IDENTITY: i64 = 0x8040_2010_0804_0201_u64.cast_signed();

/// Converts as many groups as fill whole vectors, and returns their number; `None` for samples
/// of other than two bytes, and on a processor without GFNI.
pub(super) fn to_planes(element_bytes: usize, samples: &[u8], planes: &mut [u8]) -> Option<usize> {
    let simd = V3::try_new().filter(|_| element_bytes == 2 && is_x86_feature_detected!("gfni"))?;
    // SAFETY: the processor has AVX2, or there would be no `simd`, and GFNI.
    Some(unsafe { lay_out(simd, samples, planes) })
}

/// The inverse of [`to_planes`].
pub(super) fn from_planes(element_bytes: usize, planes: &[u8], samples: &mut [u8]) -> Option<usize> {
    let simd = V3::try_new().filter(|_| element_bytes == 2 && is_x86_feature_detected!("gfni"))?;
    // SAFETY: as above.
    Some(unsafe { take_back(simd, planes, samples) })
}

#[target_feature(enable = "avx2,gfni")]
fn lay_out(simd: V3, samples: &[u8], planes: &mut [u8]) -> usize {
    let plane_bytes = samples.len() / N;
    let blocks = samples.chunks_exact(GROUPS * N);
    let done = GROUPS * blocks.len();
    let apart = cast([[14_u8, 12, 10, 8, 6, 4, 2, 0, 15, 13, 11, 9, 7, 5, 3, 1]; 2]);
    for (number, groups) in blocks.enumerate() {
        let (halves, _) = groups.as_chunks::<HALF>();
        let mut rows: [__m256i; N] = [cast([0_u8; GROUPS]); N];
        for (k, row) in rows.iter_mut().enumerate() {
            // Low bytes of the samples, then high bytes, the last sample first; each eight of them are transposed.
            *row = transposed(_mm256_shuffle_epi8(cast([halves[k], halves[k + N]]), apart));
        }
        for _ in 0..N.ilog2() {
            rows = dealt(simd, rows);
        }
        for (k, row) in rows.into_iter().enumerate() {
            let bytes: [u8; GROUPS] = cast(row);
            planes[k * plane_bytes + GROUPS * number..][..GROUPS].copy_from_slice(&bytes);
        }
    }
    done
}

#[target_feature(enable = "avx2,gfni")]
fn take_back(simd: V3, planes: &[u8], samples: &mut [u8]) -> usize {
    let plane_bytes = planes.len() / N;
    let done = samples.len() / (GROUPS * N) * GROUPS;
    for (number, groups) in samples.chunks_exact_mut(GROUPS * N).enumerate() {
        // Low bytes, and high bytes, of the samples of two groups in each half of a row.
        let mut bytes = [[cast([0_u8; GROUPS]); BITS]; 2];
        for (byte, rows) in bytes.iter_mut().enumerate() {
            for (k, row) in rows.iter_mut().enumerate() {
                let plane = planes.get((BITS * byte + BITS - 1 - k) * plane_bytes + GROUPS * number..);
                *row = plane.and_then(|plane| plane.first_chunk::<GROUPS>()).map_or(*row, |bytes| cast(*bytes));
            }
            for _ in 0..BITS.ilog2() {
                *rows = dealt(simd, *rows);
            }
            for row in rows {
                *row = transposed(*row);
            }
        }
        let [low, high] = bytes;
        let (halves, _) = groups.as_chunks_mut::<HALF>();
        for (k, (low, high)) in low.into_iter().zip(high).enumerate() {
            [halves[2 * k], halves[2 * k + N]] = cast(_mm256_unpacklo_epi8(low, high));
            [halves[2 * k + 1], halves[2 * k + 1 + N]] = cast(_mm256_unpackhi_epi8(low, high));
        }
    }
    done
}

/// Transposes each eight bytes as a matrix of bits. The rows of the argument are in reverse order, those of the result are not.
#[target_feature(enable = "avx2,gfni")]
fn transposed(matrices: __m256i) -> __m256i {
    _mm256_gf2p8affine_epi64_epi8::<0>(_mm256_set1_epi64x(IDENTITY), matrices)
}
