//! Circular blocks: permutations that keep what neighbours have in common.

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Draws permutations of the places of a ring, block by block, the same ones for the same seed.
#[derive(Debug, Clone)]
pub(crate) struct Blocks {
    rng: ChaCha8Rng,
    length: usize,
    /// First places of the blocks of one permutation.
    starts: Vec<usize>,
}

impl Blocks {
    /// Blocks of `length` places, at least one.
    pub(crate) fn new(length: usize, seed: u64) -> Self {
        Self { rng: ChaCha8Rng::seed_from_u64(seed), length: length.clamp(1, usize::MAX), starts: Vec::new() }
    }

    /// Fills `places` with a permutation of 0 to their count: the ring, turned at random, cut into blocks, shuffled.
    pub(crate) fn permute(&mut self, places: &mut [usize]) {
        let count = places.len();
        if count == 0 {
            return;
        }
        let turn = self.rng.random_range(0..count);
        self.starts.clear();
        self.starts.extend((0..count).step_by(self.length));
        for last in (1..self.starts.len()).rev() {
            self.starts.swap(last, self.rng.random_range(0..=last));
        }
        let mut to = places.iter_mut();
        for &start in &self.starts {
            // The last block cut off the ring is shorter where the length does not divide the count.
            let end = start.saturating_add(self.length);
            let end = if end < count { end } else { count };
            for (place, to) in (start..end).zip(&mut to) {
                // Neither is more than the count: a comparison does for a division.
                let turned = place + turn;
                *to = if turned < count { turned } else { turned - count };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_permutation_has_every_place_once(count in 0_usize..60, length in 0_usize..70, seed in any::<u64>()) {
            // Catches a place lost or doubled where the length does not divide the count.
            let mut places = vec![usize::MAX; count];
            Blocks::new(length, seed).permute(&mut places);
            let breaks = places.windows(2).filter(|w| w[1] != (w[0] + 1) % count).count();
            places.sort_unstable();
            prop_assert_eq!(places, (0..count).collect::<Vec<_>>());
            prop_assert!(breaks <= count.div_ceil(length.clamp(1, 70)), "blocks are kept whole");
        }
    }

    #[test]
    fn a_seed_is_a_result() {
        // Catches a generator that takes its seed from anywhere else.
        let draw = |seed| {
            let (mut blocks, mut places) = (Blocks::new(3, seed), [0; 20]);
            blocks.permute(&mut places);
            places
        };
        assert_eq!(draw(5), draw(5));
        assert_ne!(draw(5), draw(6));
    }
}
