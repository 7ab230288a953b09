//! Random numbers that depend on their purpose, not on the order in which they are drawn.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The FNV-1a hash of a list of fields; implemented here so that it is the same in every build and on every machine.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Identity(u64);

impl Identity {
    const OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
    const PRIME: u64 = 0x0000_0100_0000_01b3;

    /// The hash of `seed` and `purpose`.
    pub(crate) fn new(seed: u64, purpose: &str) -> Self {
        Self(Self::OFFSET).number(seed).text(purpose)
    }

    fn byte(self, byte: u8) -> Self {
        Self((self.0 ^ u64::from(byte)).wrapping_mul(Self::PRIME))
    }

    /// Appends a number.
    pub(crate) fn number(self, number: u64) -> Self {
        number.to_le_bytes().into_iter().fold(self, Self::byte)
    }

    /// Appends a text, after its length, so that "ab", "c" and "a", "bc" differ.
    pub(crate) fn text(self, text: &str) -> Self {
        text.bytes().fold(self.number(text.len() as u64), Self::byte)
    }

    /// Appends a physical quantity, rounded to a millionth of its unit.
    #[expect(clippy::cast_possible_truncation, reason = "saturates, which still names the quantity")]
    pub(crate) fn millionths(self, quantity: f64) -> Self {
        self.number(((quantity * 1e6).round() as i64).cast_unsigned())
    }

    /// The generator seeded with this hash.
    pub(crate) fn generator(self) -> Generator {
        // SplitMix64 spreads the hash over the whole key (Steele, Lea and Flood, OOPSLA 2014).
        let mut state = self.0;
        let mut key = [0; 32];
        for word in key.chunks_exact_mut(8) {
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = state;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            word.copy_from_slice(&(z ^ (z >> 31)).to_le_bytes());
        }
        Generator(ChaCha8Rng::from_seed(key))
    }
}

/// Random numbers of one identity.
#[derive(Debug)]
pub(crate) struct Generator(ChaCha8Rng);

impl Generator {
    /// Uniform in 0 to 1, 1 excluded.
    #[expect(clippy::cast_precision_loss, reason = "53 bits fit")]
    pub(crate) fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (-53.0_f64).exp2()
    }

    /// Uniform integer in 0 to `end`, `end` excluded; 0 if `end` is 0.
    pub(crate) fn below(&mut self, end: u32) -> u32 {
        ((u64::from(self.0.next_u32()) * u64::from(end)) >> 32) as u32
    }

    /// Normally distributed with mean 0 and standard deviation 1.
    pub(crate) fn normal(&mut self) -> f64 {
        rand_distr::Distribution::sample(&rand_distr::StandardNormal, &mut self.0)
    }

    /// Fills `bytes` with uniform ones.
    pub(crate) fn bytes(&mut self, bytes: &mut [u8]) {
        self.0.fill_bytes(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a hash that changed: recorded runs could no longer be repeated.
    #[test]
    fn the_hash_is_the_one_written_down() {
        // FNV-1a of "a" by its authors is af63dc4c8601ec8c.
        assert_eq!(Identity(Identity::OFFSET).byte(b'a').0, 0xaf63_dc4c_8601_ec8c);
        assert_eq!(
            Identity::new(1, "tap").text("SIM-0001").millionths(1.85).generator().0.next_u64(),
            16_986_355_474_766_326_909
        );
    }

    /// Catches fields that run into each other.
    #[test]
    fn fields_do_not_run_into_each_other() {
        assert_ne!(Identity::new(1, "ab").text("c").0, Identity::new(1, "a").text("bc").0);
        assert_ne!(Identity::new(1, "a").number(1).number(2).0, Identity::new(1, "a").number(2).number(1).0);
        assert_ne!(Identity::new(1, "a").millionths(0.0).0, Identity::new(1, "a").millionths(5.0).0);
    }

    /// Catches a uniform number outside its bounds, and a normal one with the wrong moments.
    #[test]
    fn numbers_have_their_distribution() {
        let mut generator = Identity::new(7, "test").generator();
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..20_000 {
            assert!((0.0..1.0).contains(&generator.uniform()));
            assert!(generator.below(10) < 10);
            let x = generator.normal();
            (sum, squares) = (sum + x, squares + x * x);
        }
        assert!((sum / 20_000.0).abs() < 0.03 && (squares / 20_000.0 - 1.0).abs() < 0.05);
        assert_eq!(generator.below(0), 0);
    }
}
