//! Rings of white noise: what arcs make of scores that mean nothing.

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

use crate::arcs::statistic::ArcStatistic;
use crate::evidence::has_value;
use crate::index::Scores;
use crate::shoulder::ring::Ring;
use crate::stats::{mean_and_sd, median};

/// How many rings are drawn: the standard deviation of their strongest arcs is known to 5 %.
const RING_COUNT: usize = 200;

/// How the strongest arcs of rings of noise are distributed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct White {
    pub(crate) median: f64,
    pub(crate) sd: f64,
    /// How many discriminators they are the evidence of.
    pub(crate) width: usize,
}

/// The strongest arc of rings of noise that have values where `pattern` has.
///
/// The same for the same pattern: the seed is fixed.
pub(crate) fn strongest_arcs(statistic: &ArcStatistic, ring: &Ring, pattern: &Scores) -> Option<White> {
    let statistic = statistic.of_white();
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    // What the offsets have in common, so that they are as correlated as those of the reference.
    let common = statistic.correlation().clamp(0.0, 1.0);
    let mut drawn = pattern.clone();
    let mut found = Vec::with_capacity(RING_COUNT);
    let place_scatter = statistic.of_place()?;
    for _ in 0..RING_COUNT {
        for place in 0..ring.len() {
            let shared = place_scatter.draw(&mut rng);
            for (drawn, pattern) in drawn.by_offset.iter_mut().zip(&pattern.by_offset) {
                if has_value(&pattern[place]) {
                    let own = place_scatter.draw(&mut rng);
                    let of_both =
                        |d: usize| common.sqrt() * shared[d] + (1.0 - common).sqrt() * own[d] + 0.0 * pattern[place][d];
                    drawn[place] = std::array::from_fn(of_both);
                }
            }
        }
        found.extend(statistic.strongest(ring, &statistic.maps(&drawn.by_offset)).map(|arc| arc.value));
    }
    let width = place_scatter.used().count();
    Some(White { sd: mean_and_sd(&found)?.1, median: median(&mut found)?, width })
}
