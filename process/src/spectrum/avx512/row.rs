//! Sixteen complex numbers in two vectors, and the operations of the transform on them.

use std::arch::x86_64::{
    __m512, __m512i, _mm512_add_ps, _mm512_fmadd_ps, _mm512_fmsub_ps, _mm512_fnmadd_ps, _mm512_mul_ps,
    _mm512_permutex2var_ps, _mm512_set1_ps, _mm512_shuffle_f32x4, _mm512_shuffle_ps, _mm512_sub_ps, _mm512_unpackhi_ps,
    _mm512_unpacklo_ps,
};
use std::array::from_fn;
use std::f32::consts::FRAC_1_SQRT_2;

use bytemuck::{cast, cast_slice, pod_read_unaligned};
use num_complex::Complex;

use super::{EIGHT, FOUR, LANES};

/// Sixteen complex numbers.
#[derive(Clone, Copy)]
pub(super) struct Row {
    re: __m512,
    im: __m512,
}

impl Row {
    pub(super) fn new(numbers: [Complex<f32>; LANES]) -> Self {
        Self { re: cast(numbers.map(|z| z.re)), im: cast(numbers.map(|z| z.im)) }
    }

    pub(super) fn zero() -> Self {
        Self { re: cast([0.0_f32; LANES]), im: cast([0.0_f32; LANES]) }
    }
}

/// The same number in every lane.
#[inline]
#[target_feature(enable = "avx512f")]
pub(super) fn every_lane(number: Complex<f32>) -> Row {
    Row { re: _mm512_set1_ps(number.re), im: _mm512_set1_ps(number.im) }
}

/// The transform of four.
#[inline]
#[target_feature(enable = "avx512f")]
pub(super) fn four([a, b, c, d]: [Row; FOUR]) -> [Row; FOUR] {
    let (s, t, u, v) = (sum(a, c), difference(a, c), sum(b, d), difference(b, d));
    [sum(s, u), sum_with_turned(t, v), difference(s, u), difference_with_turned(t, v)]
}

/// The transform of eight. The products with W_8 = (1 - i)/sqrt(2) and W_8^3 = -(1 + i)/sqrt(2) become a sum, a
/// difference and fused products.
#[inline]
#[target_feature(enable = "avx512f")]
pub(super) fn eight([x0, x1, x2, x3, x4, x5, x6, x7]: [Row; EIGHT]) -> [Row; EIGHT] {
    let [a0, a1, a2, a3] = four([x0, x2, x4, x6]);
    let [b0, b1, b2, b3] = four([x1, x3, x5, x7]);
    let root = _mm512_set1_ps(FRAC_1_SQRT_2);
    let (re_1, im_1) = (_mm512_add_ps(b1.re, b1.im), _mm512_sub_ps(b1.im, b1.re));
    let (re_3, im_3) = (_mm512_sub_ps(b3.im, b3.re), _mm512_add_ps(b3.re, b3.im));
    let [y1, y5] = [
        Row { re: _mm512_fmadd_ps(root, re_1, a1.re), im: _mm512_fmadd_ps(root, im_1, a1.im) },
        Row { re: _mm512_fnmadd_ps(root, re_1, a1.re), im: _mm512_fnmadd_ps(root, im_1, a1.im) },
    ];
    let [y3, y7] = [
        Row { re: _mm512_fmadd_ps(root, re_3, a3.re), im: _mm512_fnmadd_ps(root, im_3, a3.im) },
        Row { re: _mm512_fnmadd_ps(root, re_3, a3.re), im: _mm512_fmadd_ps(root, im_3, a3.im) },
    ];
    [sum(a0, b0), y1, sum_with_turned(a2, b2), y3, difference(a0, b0), y5, difference_with_turned(a2, b2), y7]
}

#[inline]
#[target_feature(enable = "avx512f")]
fn sum(a: Row, b: Row) -> Row {
    Row { re: _mm512_add_ps(a.re, b.re), im: _mm512_add_ps(a.im, b.im) }
}

#[inline]
#[target_feature(enable = "avx512f")]
fn difference(a: Row, b: Row) -> Row {
    Row { re: _mm512_sub_ps(a.re, b.re), im: _mm512_sub_ps(a.im, b.im) }
}

/// a - i b.
#[inline]
#[target_feature(enable = "avx512f")]
fn sum_with_turned(a: Row, b: Row) -> Row {
    Row { re: _mm512_add_ps(a.re, b.im), im: _mm512_sub_ps(a.im, b.re) }
}

/// a + i b.
#[inline]
#[target_feature(enable = "avx512f")]
fn difference_with_turned(a: Row, b: Row) -> Row {
    Row { re: _mm512_sub_ps(a.re, b.im), im: _mm512_add_ps(a.im, b.re) }
}

#[inline]
#[target_feature(enable = "avx512f")]
pub(super) fn product(a: Row, b: Row) -> Row {
    Row {
        re: _mm512_fmsub_ps(a.re, b.re, _mm512_mul_ps(a.im, b.im)),
        im: _mm512_fmadd_ps(a.re, b.im, _mm512_mul_ps(a.im, b.re)),
    }
}

/// Transposes four rows, as a matrix of their quarters.
#[inline]
#[target_feature(enable = "avx512f")]
pub(super) fn quarters_across([a, b, c, d]: [Row; 4]) -> [Row; 4] {
    #[inline]
    #[target_feature(enable = "avx512f")]
    fn transposed([a, b, c, d]: [__m512; 4]) -> [__m512; 4] {
        // The first two quarters of each pair of rows, and the last two; of those the even ones, and the odd ones.
        let (low, high) = (_mm512_shuffle_f32x4::<0x44>(a, b), _mm512_shuffle_f32x4::<0xEE>(a, b));
        let (low_2, high_2) = (_mm512_shuffle_f32x4::<0x44>(c, d), _mm512_shuffle_f32x4::<0xEE>(c, d));
        [
            _mm512_shuffle_f32x4::<0x88>(low, low_2),
            _mm512_shuffle_f32x4::<0xDD>(low, low_2),
            _mm512_shuffle_f32x4::<0x88>(high, high_2),
            _mm512_shuffle_f32x4::<0xDD>(high, high_2),
        ]
    }
    zipped(transposed([a.re, b.re, c.re, d.re]), transposed([a.im, b.im, c.im, d.im]))
}

/// Transposes each quarter of four rows, as a matrix of four by four.
#[inline]
#[target_feature(enable = "avx512f")]
pub(super) fn lanes_across([a, b, c, d]: [Row; 4]) -> [Row; 4] {
    #[inline]
    #[target_feature(enable = "avx512f")]
    fn transposed([a, b, c, d]: [__m512; 4]) -> [__m512; 4] {
        let (low, high) = (_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
        let (low_2, high_2) = (_mm512_unpacklo_ps(c, d), _mm512_unpackhi_ps(c, d));
        [
            _mm512_shuffle_ps::<0x44>(low, low_2),
            _mm512_shuffle_ps::<0xEE>(low, low_2),
            _mm512_shuffle_ps::<0x44>(high, high_2),
            _mm512_shuffle_ps::<0xEE>(high, high_2),
        ]
    }
    zipped(transposed([a.re, b.re, c.re, d.re]), transposed([a.im, b.im, c.im, d.im]))
}

#[inline]
fn zipped([a, b, c, d]: [__m512; 4], [e, f, g, h]: [__m512; 4]) -> [Row; 4] {
    [Row { re: a, im: e }, Row { re: b, im: f }, Row { re: c, im: g }, Row { re: d, im: h }]
}

/// Loads sixteen numbers, with real and imaginary parts in separate vectors.
#[inline]
#[target_feature(enable = "avx512f")]
pub(super) fn load(numbers: &[Complex<f32>]) -> Row {
    let (low, high) = cast_slice::<_, u8>(numbers).split_at(size_of::<__m512>());
    let (low, high) = (pod_read_unaligned(low), pod_read_unaligned(high));
    let part_of = |first: i32| -> __m512i { cast::<[i32; LANES], _>(from_fn(|i| first + 2 * i as i32)) };
    Row { re: _mm512_permutex2var_ps(low, part_of(0), high), im: _mm512_permutex2var_ps(low, part_of(1), high) }
}

/// The opposite of [`load`].
#[inline]
#[target_feature(enable = "avx512f")]
pub(super) fn store(row: Row, numbers: &mut [Complex<f32>]) {
    let half_of = |first: i32| -> __m512i {
        cast::<[i32; LANES], _>(from_fn(|i| first + i as i32 / 2 + if i % 2 == 0 { 0 } else { LANES as i32 }))
    };
    let low: [Complex<f32>; LANES / 2] = cast(_mm512_permutex2var_ps(row.re, half_of(0), row.im));
    let high: [Complex<f32>; LANES / 2] = cast(_mm512_permutex2var_ps(row.re, half_of(LANES as i32 / 2), row.im));
    let (first, last) = numbers.split_at_mut(LANES / 2);
    first.copy_from_slice(&low);
    last.copy_from_slice(&high);
}
