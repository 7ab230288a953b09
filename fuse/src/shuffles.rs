//! Permutations of a ring in blocks, drawn once and kept: they depend on how many places there are, and on no value.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::resample::Blocks;
use crate::scan::Permutation;

/// Permutations that are gone through side by side.
pub(crate) const LANES: usize = 8;

/// Places that a byte can name.
pub(crate) const BYTE_COUNT: usize = 256;

/// Most counts of places whose permutations are kept; those of a hundred places take 0.25 MB.
const KEPT_MOST: usize = 32;

/// Permutations of a ring's places.
#[derive(Debug)]
pub(crate) struct Shuffles {
    place_count: usize,
    count: usize,
    /// [`LANES`] permutations after [`LANES`] permutations, place by place; lanes behind the last permutation are of no
    /// meaning.
    places: Vec<[u32; LANES]>,
    /// The same in bytes; empty where a byte does not name every place.
    bytes: Vec<[u8; LANES]>,
}

impl Shuffles {
    /// The permutations that `permutation` gives of so many places.
    pub(crate) fn draw(place_count: usize, permutation: Permutation) -> Self {
        let mut blocks = Blocks::new(permutation.block_length, permutation.seed);
        let mut drawn = vec![0; place_count];
        let mut places = vec![[0; LANES]; place_count * permutation.count.div_ceil(LANES)];
        for number in 0..permutation.count {
            blocks.permute(&mut drawn);
            for (to, &place) in places[number / LANES * place_count..].iter_mut().zip(&drawn) {
                // A plan numbers its taps, of which every place has one, by u32.
                to[number % LANES] = u32::try_from(place).unwrap_or(u32::MAX);
            }
        }
        #[expect(clippy::cast_possible_truncation, reason = "a byte names every place")]
        let byte = |row: &[u32; LANES]| row.map(|place| place as u8);
        let bytes = if place_count <= BYTE_COUNT { places.iter().map(byte).collect() } else { Vec::new() };
        Self { place_count, count: permutation.count, places, bytes }
    }

    /// How many permutations there are.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Several permutations at a time: how many of the lanes hold one, and their places.
    pub(crate) fn side_by_side(&self) -> impl Iterator<Item = (usize, &[[u32; LANES]])> {
        self.places.chunks_exact(self.chunk_length()).enumerate().map(|(number, places)| {
            let left = self.count - number * LANES;
            (if left < LANES { left } else { LANES }, places)
        })
    }

    /// The places of several permutations at a time, in bytes; none of more places than a byte can name.
    pub(crate) fn bytes_side_by_side(&self) -> impl Iterator<Item = &[[u8; LANES]]> {
        self.bytes.chunks_exact(self.chunk_length())
    }

    /// Of no places there are no permutations.
    fn chunk_length(&self) -> usize {
        if self.place_count > 0 { self.place_count } else { 1 }
    }

    /// The permutations with these `numbers`, [`LANES`] at most, side by side; lanes behind them are of no meaning.
    pub(crate) fn side_by_side_of(&self, numbers: &[usize]) -> Vec<[u32; LANES]> {
        let mut places = vec![[0; LANES]; self.place_count];
        for (lane, number) in numbers.iter().enumerate() {
            let of_number = &self.places[number / LANES * self.place_count..];
            for (to, from) in places.iter_mut().zip(of_number) {
                to[lane] = from[number % LANES];
            }
        }
        places
    }
}

/// The default permutations of the counts of places that were met last.
#[derive(Debug, Clone, Default)]
pub(crate) struct KnownShuffles {
    by_place_count: BTreeMap<usize, Arc<Shuffles>>,
}

impl KnownShuffles {
    /// The default permutations of so many places.
    pub(crate) fn of(&mut self, place_count: usize) -> Arc<Shuffles> {
        if self.by_place_count.len() >= KEPT_MOST && !self.by_place_count.contains_key(&place_count) {
            self.by_place_count.clear();
        }
        let draw = || Arc::new(Shuffles::draw(place_count, Permutation::default()));
        self.by_place_count.entry(place_count).or_insert_with(draw).clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_what_is_drawn() {
        // Catches permutations of another count of places, and a store that grows without end.
        let mut known = KnownShuffles::default();
        for place_count in (0..50).chain([7, 49]) {
            let drawn = Shuffles::draw(place_count, Permutation::default());
            assert_eq!(known.of(place_count).places, drawn.places, "{place_count}");
            assert!(known.by_place_count.len() <= KEPT_MOST);
        }
    }
}
