//! Standard normal values that every process draws alike.

use std::sync::LazyLock;

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};

use crate::evidence::Columns;
use crate::stats::normal_quantile;

/// After so many values the first one comes again: as many as rings of 100 places at four offsets take. A prime number, so that rings of
/// any other length do not repeat with it.
const COUNT: usize = 262_147;

/// Of the first 16 seeds, this one brings the limits of a casing of 100 places by itself nearest to those of 4096 rings, with one offset
/// and with four.
const SEED: u64 = 15;

/// How many places limits are found from.
const STRATIFIED_COUNT: usize = 2000;

/// Drawn once: each casing that is its own reference takes as many anew.
static VALUES: LazyLock<Vec<f32>> =
    LazyLock::new(|| StandardNormal.sample_iter(ChaCha8Rng::seed_from_u64(SEED)).take(COUNT).collect());

/// Places of noise: over them each discriminator takes every quantile of the normal distribution once. So the part of them that is beyond a
/// limit is nearer the true one than of as many drawn places (McKay, Beckman and Conover 1979).
pub(crate) static STRATIFIED: LazyLock<Columns> = LazyLock::new(|| {
    Normals::default().columns(STRATIFIED_COUNT).map(|drawn| {
        let mut places: Vec<usize> = (0..drawn.len()).collect();
        places.sort_by(|&a, &b| drawn[a].total_cmp(&drawn[b]));
        let mut column = vec![0.0; drawn.len()];
        for (rank, place) in places.into_iter().enumerate() {
            column[place] = -normal_quantile((rank as f64 + 0.5) / drawn.len() as f64) as f32;
        }
        column
    })
});

/// Standard normal values, one after the other, from the first on.
#[derive(Debug, Default)]
pub(crate) struct Normals {
    /// Number of the next one.
    next: usize,
}

impl Normals {
    /// The next values of `count` places.
    pub(crate) fn columns(&mut self, count: usize) -> Columns {
        std::array::from_fn(|_| {
            let taken = VALUES.iter().copied().cycle().skip(self.next % COUNT).take(count).collect();
            self.next += count;
            taken
        })
    }
}
