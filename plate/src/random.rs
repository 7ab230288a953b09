//! Random numbers that depend on their purpose, not on the order in which they are drawn.

use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt as _, SeedableRng as _};
use rand_distr::{Distribution as _, StandardNormal};

/// A list of fields folded into 64 bits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Key(u64);

impl Key {
    /// The key of `seed` and `purpose`.
    pub(crate) fn new(seed: u64, purpose: &str) -> Self {
        Self(seed).bytes(purpose.as_bytes())
    }

    /// Appends a number, mixed by the finaliser of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014).
    pub(crate) fn number(self, number: u64) -> Self {
        let mut z = self.0.wrapping_mul(3).wrapping_add(number).wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        Self(z ^ (z >> 31))
    }

    /// Appends the bytes of a text, after its length.
    pub(crate) fn bytes(self, bytes: &[u8]) -> Self {
        bytes.iter().fold(self.number(bytes.len() as u64), |key, &byte| key.number(byte.into()))
    }

    /// Appends a physical quantity, rounded to a millionth of its unit.
    pub(crate) fn millionths(self, quantity: f64) -> Self {
        self.number(((quantity * 1e6).round() as i64).cast_unsigned())
    }

    /// The generator seeded with this key.
    pub(crate) fn generator(self) -> Generator {
        Generator(Xoshiro256PlusPlus::seed_from_u64(self.0))
    }
}

/// Random numbers of one key.
#[derive(Debug)]
pub(crate) struct Generator(Xoshiro256PlusPlus);

impl Generator {
    /// Uniform in 0 to 1, 1 excluded.
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0.random()
    }

    /// Uniform in `low` to `high`.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Normally distributed with mean 0 and standard deviation 1.
    pub(crate) fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// A factor around 1 whose logarithm has the standard deviation `sd`.
    pub(crate) fn factor(&mut self, sd: f64) -> f64 {
        (sd * self.normal()).exp()
    }

    /// Adds normal noise of standard deviation `sd` to `signal`.
    pub(crate) fn add_noise(&mut self, sd: f32, signal: &mut [f32]) {
        for x in signal {
            let noise: f32 = StandardNormal.sample(&mut self.0);
            *x += sd * noise;
        }
    }
}
