//! How many permutations of a ring have an arc at least as high as a given one, without finding how high each of them is.
//!
//! A chance asks no more of a permutation than whether it reaches a height. Whole numbers of 16 bits that stand for the
//! values tell that at a quarter of the cost, with a known error; the few permutations that lie within it are summed in full.
//! And where not even the highest values side by side would reach the height, no permutation is looked at.

use std::cell::OnceCell;

use tapline_wire::Geometry;

use crate::scan::{ARC_LENGTHS, arc_null_by, highest_of_lanes, lengths, sum_up};
use crate::shuffles::{BYTE_COUNT, LANES, Shuffles};

/// Largest magnitude of the sum of whole numbers over an arc: none leaves 16 bits, rounding of its values included.
const WHOLE_MOST: f64 = 32_000.0;

/// No value of an arc, nor the sum of all magnitudes, comes near this: all sums are numbers.
const SUM_MOST: f64 = 1e300;

/// Beyond what any sum of whole numbers comes to.
const OUT_OF_RANGE: f64 = 1e9;

/// Numbers of 16 bits in 64.
const HALF: usize = LANES / 2;

/// By lane and place.
type SpreadOut = [[u64; BYTE_COUNT]; HALF];

/// The arcs of all permutations of a background.
pub(crate) struct ArcNull<'a> {
    values: &'a [f64],
    geometry: Geometry,
    shuffles: &'a Shuffles,
    coarse: Option<Coarse>,
    /// Highest arcs, where the coarse way is none.
    highest: OnceCell<Vec<f64>>,
}

impl<'a> ArcNull<'a> {
    /// The arcs of `values`, all finite, exchanged by `shuffles` of as many places.
    pub(crate) fn of(values: &'a [f64], geometry: Geometry, shuffles: &'a Shuffles) -> Self {
        Self { values, geometry, shuffles, coarse: Coarse::of(values), highest: OnceCell::new() }
    }

    /// How many permutations have an arc.
    pub(crate) fn len(&self) -> usize {
        match &self.coarse {
            // Every sum is a number.
            Some(_) => self.shuffles.count(),
            None => self.highest().len(),
        }
    }

    /// How many permutations have an arc whose value is not below `value`.
    pub(crate) fn at_least(&self, value: f64) -> usize {
        match &self.coarse {
            Some(coarse) if value.abs() < SUM_MOST => self.counted(coarse, value),
            Some(_) if value > 0.0 => 0,
            Some(_) => self.shuffles.count(),
            None => self.highest().len() - self.highest().partition_point(|&of_null| of_null < value),
        }
    }

    fn highest(&self) -> &[f64] {
        self.highest.get_or_init(|| arc_null_by(self.values, self.geometry, self.shuffles))
    }

    fn counted(&self, coarse: &Coarse, value: f64) -> usize {
        let bounds: Vec<Bounds> =
            lengths(self.values.len(), self.geometry).map(|(length, _)| coarse.bounds(value, length)).collect();
        if bounds.iter().all(|bounds| bounds.is_out_of_reach) {
            return 0;
        }
        let sums = coarse.sums.get_or_init(|| coarse.highest_sums(self.geometry, self.shuffles));
        let (mut count, mut doubtful) = (0, Vec::new());
        let mut is_doubtful_length = [false; ARC_LENGTHS.len()];
        for (number, highest) in sums.chunks_exact(bounds.len()).enumerate() {
            let (mut is_reached, mut may_be) = ([false; LANES], [false; LANES]);
            for (bounds, sums) in bounds.iter().zip(highest) {
                for ((is_reached, may_be), &sum) in is_reached.iter_mut().zip(&mut may_be).zip(sums) {
                    *is_reached |= sum >= bounds.sure;
                    *may_be |= sum >= bounds.possible;
                }
            }
            let first = number * LANES;
            for lane in (0..LANES).take_while(|lane| first + lane < self.shuffles.count()) {
                count += usize::from(is_reached[lane]);
                if may_be[lane] && !is_reached[lane] {
                    doubtful.push(first + lane);
                    for ((is_doubtful, bounds), sums) in is_doubtful_length.iter_mut().zip(&bounds).zip(highest) {
                        *is_doubtful |= sums[lane] >= bounds.possible;
                    }
                }
            }
        }
        count + self.summed_in_full(&doubtful, value, is_doubtful_length)
    }

    /// How many of the permutations `numbers` have an arc of an asked length that is not below `value`.
    fn summed_in_full(&self, numbers: &[usize], value: f64, is_asked: [bool; ARC_LENGTHS.len()]) -> usize {
        let mut sums = Vec::new();
        let reach = |numbers: &[usize]| {
            let places = self.shuffles.side_by_side_of(numbers);
            sum_up(&mut sums, self.values, self.geometry, &places);
            let highest = highest_of_lanes(&sums, self.values.len(), self.geometry, is_asked);
            highest[..numbers.len()].iter().filter(|&&highest| highest >= value).count()
        };
        numbers.chunks(LANES).map(reach).sum()
    }
}

/// What a sum of whole numbers over an arc of one length says.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    /// From here on the arc reaches the height.
    sure: i16,
    /// Below it does not.
    possible: i16,
    /// No arc of this length can reach it.
    is_out_of_reach: bool,
}

/// Values as whole numbers.
struct Coarse {
    /// In the order of the places.
    whole: Vec<i16>,
    /// The same, to be put side by side.
    spread_out: Box<SpreadOut>,
    /// Whole numbers per unit of value.
    per_unit: f64,
    /// By how much sums of values, one after the other, may be off.
    rounding: f64,
    /// Sum of the largest whole numbers, by how many they are.
    largest: Vec<f64>,
    /// Highest sum of each length, [`LANES`] permutations after [`LANES`] permutations; found when it is asked for.
    sums: OnceCell<Vec<[i16; LANES]>>,
}

impl Coarse {
    /// `None` of less than two values, which have no arcs, of more than a byte can name, and of those that no scale brings
    /// into range.
    fn of(values: &[f64]) -> Option<Self> {
        let longest = ARC_LENGTHS[ARC_LENGTHS.len() - 1];
        let mut magnitudes: Vec<f64> = values.iter().map(|value| value.abs()).collect();
        magnitudes.sort_unstable_by(|a, b| b.total_cmp(a));
        let most: f64 = magnitudes.iter().take(longest).sum();
        let all: f64 = magnitudes.iter().sum();
        let per_unit = if most > 0.0 { WHOLE_MOST / most } else { 1.0 };
        let is_in_range = values.len() > 1 && all < 0.5 * SUM_MOST && per_unit.is_finite();
        if !is_in_range || values.len() > BYTE_COUNT {
            return None;
        }
        #[expect(clippy::cast_possible_truncation, reason = "no magnitude exceeds WHOLE_MOST")]
        let whole: Vec<i16> = values.iter().map(|value| (value * per_unit).round() as i16).collect();
        let mut sorted = whole.clone();
        sorted.sort_unstable_by(|a, b| b.cmp(a));
        let mut sum = 0.0;
        let largest = sorted.iter().take(longest).map(|&whole| {
            sum += f64::from(whole);
            sum
        });
        let largest = std::iter::once(0.0).chain(largest).collect();
        // Each of 2 n sums of values that run through the ring twice is rounded, by half of EPSILON at most.
        let rounding = 8.0 * f64::EPSILON * values.len() as f64 * all;
        Some(Self { spread_out: spread_out(&whole), whole, per_unit, rounding, largest, sums: OnceCell::new() })
    }

    /// What sums over arcs of `length` say of `value`.
    fn bounds(&self, value: f64, length: usize) -> Bounds {
        let count = length as f64;
        let sum = (value * count.sqrt() * self.per_unit).clamp(-OUT_OF_RANGE, OUT_OF_RANGE);
        // A whole number is off by a half, and a little for the product that was rounded to it; a root, a product and a
        // quotient are off by much less than 1e-12 of them.
        let slack = 0.500_001 * count + self.rounding * self.per_unit + 1e-12 * sum.abs();
        let [possible, sure] = [sum - slack, sum + slack];
        #[expect(clippy::cast_possible_truncation, reason = "it saturates where no sum comes")]
        let whole = |bound: f64| bound.ceil() as i16;
        Bounds { sure: whole(sure), possible: whole(possible), is_out_of_reach: self.largest[length] < possible }
    }

    /// The highest sum of each length.
    fn highest_sums(&self, geometry: Geometry, shuffles: &Shuffles) -> Vec<[i16; LANES]> {
        let place_count = self.whole.len();
        // A single place is the highest where it is, whatever its neighbours.
        let highest_alone = self.whole.iter().copied().max().unwrap_or(i16::MIN);
        let (mut sums, mut words) = (Vec::new(), Vec::new());
        let mut highest = Vec::new();
        for places in shuffles.bytes_side_by_side() {
            self.sum_up(&mut sums, &mut words, places);
            for (length, first_count) in lengths(place_count, geometry) {
                let most = if length == 1 { [highest_alone; LANES] } else { highest_sum(&sums, length, first_count) };
                highest.push(most);
            }
        }
        highest
    }

    /// Fills in the sums of the first n places of permutations side by side, run through as far as arcs reach over the end.
    /// Sums that leave 16 bits come back to them with their differences.
    fn sum_up(&self, sums: &mut Vec<[i16; LANES]>, words: &mut Vec<[u64; 2]>, places: &[[u8; LANES]]) {
        let half = |places: &[u8; LANES], first: usize| {
            let of_lane = |lane: usize| self.spread_out[lane][usize::from(places[first + lane])];
            of_lane(0) | of_lane(1) | of_lane(2) | of_lane(3)
        };
        words.clear();
        words.extend(places.iter().map(|places| [half(places, 0), half(places, HALF)]));
        // In a pass of its own the words are read as the vectors that they are.
        let whole: &[[i16; LANES]] = bytemuck::cast_slice(words);
        let longest = ARC_LENGTHS[ARC_LENGTHS.len() - 1];
        let again = if whole.len() < longest { whole } else { &whole[..longest] };
        sums.resize(1 + whole.len() + again.len(), [0; LANES]);
        let mut sum = [0_i16; LANES];
        for (sums, whole) in sums[1..].iter_mut().zip(whole.iter().chain(again)) {
            for (sum, whole) in sum.iter_mut().zip(whole) {
                *sum = sum.wrapping_add(*whole);
            }
            *sums = sum;
        }
    }
}

/// The highest sum over the first arcs of `length`, lane by lane.
fn highest_sum(sums: &[[i16; LANES]], length: usize, first_count: usize) -> [i16; LANES] {
    let mut most = [i16::MIN; LANES];
    for (starts, ends) in sums[..first_count].iter().zip(&sums[length..]) {
        for ((most, start), end) in most.iter_mut().zip(starts).zip(ends) {
            *most = end.wrapping_sub(*start).max(*most);
        }
    }
    most
}

/// For each lane of a half each number at the place of that lane in 64 bits, the rest of which are 0: four of them are put
/// side by side by `or`, which costs half of what putting them one by one into a vector does.
fn spread_out(whole: &[i16]) -> Box<SpreadOut> {
    let mut spread_out = Box::new([[0; BYTE_COUNT]; HALF]);
    for (lane, of_lane) in spread_out.iter_mut().enumerate() {
        for (to, &whole) in of_lane.iter_mut().zip(whole) {
            let mut lanes = [0; HALF];
            lanes[lane] = whole;
            *to = bytemuck::cast(lanes);
        }
    }
    spread_out
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::scan::{Permutation, background, scan};

    /// The slow twin: every permutation's highest arc.
    fn at_least_slow(values: &[f64], geometry: Geometry, shuffles: &Shuffles, value: f64) -> (usize, usize) {
        let null = arc_null_by(values, geometry, shuffles);
        (null.len() - null.partition_point(|&of_null| of_null < value), null.len())
    }

    /// Heights that are asked for: the arc of the ring itself, which permutations meet but for rounding; the highest arcs
    /// of some of them; others; and what is no height.
    fn heights(values: &[f64], geometry: Geometry, shuffles: &Shuffles, any: f64) -> Vec<f64> {
        let z: Vec<Option<f64>> = values.iter().copied().map(Some).collect();
        let null = arc_null_by(values, geometry, shuffles);
        let met = null.iter().step_by(3).flat_map(|&height| [height, height.next_up(), height.next_down()]);
        let odd = [any, 0.0, 1e30, -1e30, f64::MAX, f64::MIN, f64::INFINITY, f64::NEG_INFINITY, f64::NAN];
        met.chain(scan(&z, geometry).map(|arc| arc.value)).chain(odd).collect()
    }

    proptest! {
        #[test]
        fn a_count_is_that_of_every_highest_arc(
            z in prop_oneof![
                prop::collection::vec(-9.0..9.0, 0..110),
                prop::collection::vec(-9.0..9.0, 250..260),
                prop::collection::vec((-9_i8..9).prop_map(f64::from), 0..60),
                prop::collection::vec(prop_oneof![9 => -1.0..1.0, 1 => 1e3..1e6], 0..60),
                prop::collection::vec(prop_oneof![Just(0.0), Just(-0.0), Just(1e-310), Just(1e307), Just(-1e-300)], 0..9),
            ],
            (is_ring, count, block_length, seed) in (any::<bool>(), 0_usize..40, 1_usize..6, any::<u64>()),
            (any_height, scale) in (-9.0..9.0, prop_oneof![Just(1.0), Just(1e-250), Just(1e250)]),
        ) {
            // Catches a bound on the wrong side of what rounding does, permutations behind the last, lengths that are not
            // looked at again, and values whose sums are no numbers.
            let geometry = if is_ring { Geometry::Ring } else { Geometry::Line };
            let values = background(&z.iter().map(|z: &f64| Some(z * scale)).collect::<Vec<_>>());
            let shuffles = Shuffles::draw(values.len(), Permutation { block_length, count, seed });
            let null = ArcNull::of(&values, geometry, &shuffles);
            for height in heights(&values, geometry, &shuffles, any_height * scale) {
                let slow = at_least_slow(&values, geometry, &shuffles, height);
                prop_assert_eq!((null.at_least(height), null.len()), slow, "{:e}", height);
            }
        }
    }
}
