//! Noise that is the same on every machine.

/// A linear congruential generator.
#[derive(Debug, Clone)]
pub struct Noise(pub u32);

impl Noise {
    /// The next 32 bits; the upper ones are the better.
    pub fn bits(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        self.0
    }

    /// From 0 to 1.
    pub fn uniform(&mut self) -> f64 {
        f64::from(self.bits()) / 4_294_967_296.0
    }

    /// Nearly normal, of mean 0 and standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform() - 0.5).sum()
    }
}
