//! Samples as planes of bits, in the order of Blosc and `bitshuffle`: the lowest bit of every sample, then the next, ...
//!
//! The low planes of a record are noise, which does not pack; each of the high planes is the sign and repeats the plane before.

#[cfg(target_arch = "x86_64")]
mod affine;
#[cfg(target_arch = "x86_64")]
mod wide;

/// Samples whose bits fill one byte of every plane.
const GROUP: usize = 8;

/// Bits of a byte.
const BITS: usize = 8;

/// Writes the bits of `samples`, of `element_bytes` each, to `planes`. If the number of samples is not a multiple of eight they
/// are copied, as in the library.
///
/// # Panics
/// If `planes` is not as long as `samples`.
pub(crate) fn to_planes(element_bytes: usize, samples: &[u8], planes: &mut [u8]) {
    assert_eq!(samples.len(), planes.len(), "planes have as many bits as samples");
    if !samples.len().is_multiple_of(GROUP * element_bytes) {
        return planes.copy_from_slice(samples);
    }
    #[cfg(target_arch = "x86_64")]
    let done = affine::to_planes(element_bytes, samples, planes)
        .unwrap_or_else(|| wide::to_planes(element_bytes, samples, planes));
    #[cfg(not(target_arch = "x86_64"))]
    let done = 0;
    let plane_bytes = samples.len() / (GROUP * element_bytes);
    for (group, samples) in samples.chunks_exact(GROUP * element_bytes).enumerate().skip(done) {
        for (byte, bits) in (0..element_bytes).flat_map(|byte| (0..BITS).map(move |bit| (byte, bit))) {
            let bit = |k: usize| ((samples[k * element_bytes + byte] >> bits) & 1) << k;
            planes[(BITS * byte + bits) * plane_bytes + group] = (0..GROUP).fold(0, |all, k| all | bit(k));
        }
    }
}

/// The inverse of [`to_planes`].
///
/// # Panics
/// If `samples` is not as long as `planes`.
pub(crate) fn from_planes(element_bytes: usize, planes: &[u8], samples: &mut [u8]) {
    assert_eq!(samples.len(), planes.len(), "planes have as many bits as samples");
    if !planes.len().is_multiple_of(GROUP * element_bytes) {
        return samples.copy_from_slice(planes);
    }
    #[cfg(target_arch = "x86_64")]
    let done = affine::from_planes(element_bytes, planes, samples)
        .unwrap_or_else(|| wide::from_planes(element_bytes, planes, samples));
    #[cfg(not(target_arch = "x86_64"))]
    let done = 0;
    let plane_bytes = planes.len() / (GROUP * element_bytes);
    for (group, samples) in samples.chunks_exact_mut(GROUP * element_bytes).enumerate().skip(done) {
        for (at, sample) in samples.iter_mut().enumerate() {
            let (k, byte) = (at / element_bytes, at % element_bytes);
            let bit = |bits: usize| ((planes[(BITS * byte + bits) * plane_bytes + group] >> k) & 1) << bits;
            *sample = (0..BITS).fold(0, |all, bits| all | bit(bits));
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Catches a bit at a wrong offset, for any number of samples: the test places them one by one.
        #[test]
        fn every_bit_is_where_it_belongs(
            bytes in prop::collection::vec(any::<u8>(), 8..6000),
            element_bytes in prop::sample::select(vec![2_usize, 3, 4, 8]),
        ) {
            let count = bytes.len() / element_bytes / GROUP * GROUP;
            let samples = &bytes[..count * element_bytes];
            let (mut planes, mut back) = (vec![9; samples.len()], vec![9; samples.len()]);
            to_planes(element_bytes, samples, &mut planes);
            let bit = |bytes: &[u8], k: usize| (bytes[k / BITS] >> (k % BITS)) & 1;
            for (sample, plane) in (0..count).flat_map(|k| (0..BITS * element_bytes).map(move |plane| (k, plane))) {
                let there = bit(&planes, plane * count + sample);
                prop_assert_eq!(there, bit(samples, BITS * element_bytes * sample + plane), "{} {}", sample, plane);
            }
            from_planes(element_bytes, &planes, &mut back);
            prop_assert_eq!(&back[..], samples);
        }
    }

    /// Catches samples that are moved though the library copies them.
    #[test]
    fn samples_that_do_not_fill_planes_are_copied() {
        let samples: Vec<u8> = (0..18).collect();
        let (mut planes, mut back) = (vec![9; 18], vec![9; 18]);
        to_planes(2, &samples, &mut planes);
        assert_eq!(planes, samples);
        from_planes(2, &planes, &mut back);
        assert_eq!(back, samples);
    }
}
