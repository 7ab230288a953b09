//! Places drawn from normal distributions, for the tests of the indices.

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};

use super::Example;

/// Scores of which the last three of six move together, as PR, P_f and E_f do.
#[derive(Debug, Clone)]
pub(super) struct Gaussian {
    pub(super) seed: u64,
    /// How far a crack moves each score.
    pub(super) shift: [f64; 6],
    /// Correlation of the last three.
    pub(super) correlation: f64,
}

impl Default for Gaussian {
    fn default() -> Self {
        Self { seed: 3, shift: [1.5, 1.0, 0.0, 1.0, 1.0, 1.0], correlation: 0.95 }
    }
}

impl Gaussian {
    /// `sound` sound places, then `cracked` cracked ones.
    pub(super) fn examples(&self, sound: usize, cracked: usize) -> Vec<Example> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        (0..sound + cracked)
            .map(|place| {
                let (is_cracked, common) = (place >= sound, normal());
                let score = |(k, shift): (usize, f64)| {
                    let own = normal();
                    let (shared, alone) = (self.correlation.sqrt(), (1.0 - self.correlation).sqrt());
                    let scatter = if k < 3 { own } else { shared * common + alone * own };
                    Some(scatter + if is_cracked { shift } else { 0.0 })
                };
                Example { scores: self.shift.into_iter().enumerate().map(score).collect(), is_cracked, place }
            })
            .collect()
    }
}

/// All present.
pub(super) fn some(scores: impl IntoIterator<Item = f64>) -> Vec<Option<f64>> {
    scores.into_iter().map(Some).collect()
}
