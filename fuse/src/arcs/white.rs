//! Rings of white noise: the arcs of scores without any information.

use std::borrow::Cow;
use std::collections::BinaryHeap;

use crate::arcs::statistic::{ARC_MAX, ArcStatistic};
use crate::evidence::{Columns, Normals, Scatter, Vector, WIDTH, has_value};
use crate::index::Scores;
use crate::shoulder::ring::Ring;
use crate::stats::{mean_and_sd, median};

/// How many rings are drawn. The opposite of each counts as another ring. Against 4096 rings, the limits of a casing of 100 places by itself
/// are off by 0.5 % with one offset and with four. With another seed or number of places, 1 % and 2 % are usual.
const RING_COUNT: usize = 64;

/// What the rounding of sums in single precision may take from a bound, as a part of its square.
const ROUNDING_F32: f64 = 1e-4;

/// How the strongest arcs of rings of noise are distributed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct White {
    pub median: f64,
    pub sd: f64,
    /// How many discriminators they are the evidence of.
    pub width: usize,
    /// How many values of each the scatter was estimated from.
    pub value_count: usize,
}

/// The strongest arc of rings of noise that have values where `pattern` has; their scatter was estimated from `value_count` values. A
/// discriminator that only some of those places lack is drawn at all of them.
///
/// The noise is always the same, so the result depends on the arguments alone.
pub(crate) fn strongest_arcs(
    statistic: &ArcStatistic,
    ring: &Ring,
    pattern: &Scores,
    value_count: usize,
) -> Option<White> {
    let of_places = statistic.of_places().next()?;
    // What no place of the pattern has, and what is not drawn, counts nowhere.
    let has = |d: usize| pattern.by_offset.iter().flatten().any(|scores| scores[d].is_finite());
    let drawn: Vector = std::array::from_fn(|d| if of_places.deviation(d) > 0.0 && has(d) { 0.0 } else { f64::NAN });
    let scatters: Vec<Cow<'_, Scatter>> = statistic.of_places().map(|scatter| scatter.restricted_to(&drawn)).collect();
    let shown = statistic.offsets().iter().map(|&offset| pattern.by_offset[offset].iter().map(has_value).collect());
    let shown: Vec<Vec<bool>> = shown.collect();
    let arcs: Vec<Arcs> = (0..shown.len()).map(|depth| Arcs::of(ring, &shown[..=depth])).collect();
    let noise = Noise::of(statistic, &shown);
    let mut normals = Normals::default();
    let mut found: Vec<f64> = Vec::with_capacity(2 * RING_COUNT);
    for _ in 0..RING_COUNT {
        let mut most = [f64::NEG_INFINITY; 2];
        for ((scatter, arcs), map) in scatters.iter().zip(&arcs).zip(noise.draw(of_places, &mut normals)) {
            arcs.strongest(scatter, &map, &mut most);
        }
        found.extend(most.into_iter().filter(|most| most.is_finite()));
    }
    let width = scatters.first()?.used().count();
    Some(White { sd: mean_and_sd(&found)?.1, median: median(&mut found)?, width, value_count })
}

/// How noise becomes the maps of a ring.
struct Noise {
    /// Weights of what the offsets have in common, and of what is each one's own: they are as correlated as those of the reference.
    common: f32,
    own: f32,
    /// By the number of offsets that are summed.
    depths: Vec<Depth>,
}

/// A number of offsets that are summed, by the last of them.
struct Depth {
    /// Whether it has a value, by place: 1 or 0.
    shown: Vec<f32>,
    /// Factor from the sums over the offsets to the scores of a place; 0 for a place without a value.
    scale: Columns,
}

impl Noise {
    /// Noise for a ring with values at the places that are `shown`, `[offset][place]`.
    fn of(statistic: &ArcStatistic, shown: &[Vec<bool>]) -> Self {
        let common = if shown.len() > 1 { statistic.correlation().clamp(0.0, 1.0) } else { 0.0 };
        let scale_of = |depth: usize, place: usize| {
            let count = shown[..=depth].iter().filter(|shown| shown[place]).count();
            statistic.scale(depth, count).map(|scale| scale as f32)
        };
        let depth = |depth: usize| {
            let scales: Vec<[f32; WIDTH]> = (0..shown[depth].len()).map(|place| scale_of(depth, place)).collect();
            Depth {
                shown: shown[depth].iter().map(|is_shown| f32::from(u8::from(*is_shown))).collect(),
                scale: std::array::from_fn(|d| scales.iter().map(|scale| scale[d]).collect()),
            }
        };
        Self {
            common: common.sqrt() as f32,
            own: (1.0 - common).sqrt() as f32,
            depths: (0..shown.len()).map(depth).collect(),
        }
    }

    /// The maps of a ring of noise, by the number of offsets that are summed; scores of a place at one offset scatter as `scatter` says.
    fn draw(&self, scatter: &Scatter, normals: &mut Normals) -> Vec<Columns> {
        let place_count = self.depths.first().map_or(0, |depth| depth.shown.len());
        let none = || std::array::from_fn(|_| vec![0.0; place_count]);
        let shared: Columns = if self.common > 0.0 { normals.columns(place_count) } else { none() };
        let mut sums: Columns = none();
        let of_depth = |depth: &Depth| {
            let own = normals.columns(place_count);
            for ((sums, shared), own) in sums.iter_mut().zip(&shared).zip(own) {
                for (((sum, shared), own), shown) in sums.iter_mut().zip(shared).zip(own).zip(&depth.shown) {
                    *sum += shown * (self.common * shared + self.own * own);
                }
            }
            let mut map = scatter.coloured(&sums);
            for (scores, scale) in map.iter_mut().zip(&depth.scale) {
                scores.iter_mut().zip(scale).for_each(|(score, scale)| *score *= scale);
            }
            map
        };
        self.depths.iter().map(of_depth).collect()
    }
}

/// The arcs of a ring, by length and then by their first place.
struct Arcs {
    place_count: usize,
    /// 1 over the number of values of each arc; 0 of one that has none, or that a gap or the end of the ring cuts off: a shorter one has
    /// the same places.
    inverse_counts: Vec<f32>,
}

impl Arcs {
    /// The arcs of a ring with a value at the places that are `shown` at any offset, `[offset][place]`.
    fn of(ring: &Ring, shown: &[Vec<bool>]) -> Self {
        let place_count = ring.len();
        let mut inverse_counts = vec![0.0; ARC_MAX * place_count];
        for start in 0..place_count {
            let mut count = 0.0;
            for (number, place) in ring.from(start).take(ARC_MAX).enumerate() {
                count += f32::from(u8::from(shown.iter().any(|shown| shown[place])));
                inverse_counts[number * place_count + start] = if count > 0.0 { 1.0 / count } else { 0.0 };
            }
        }
        Self { place_count, inverse_counts }
    }

    /// Raises `most` to the evidence of the strongest arc of `map`, and to that of the opposite of `map`. The scores of a place scatter as
    /// `scatter` says, and are 0 where it has no value.
    ///
    /// As arcs of every length scatter alike, the length of a sum of whitened scores is the most that the arc, or the opposite one, can
    /// show: only the longest few are looked at.
    fn strongest(&self, scatter: &Scatter, map: &Columns, most: &mut [f64; 2]) {
        let squares = self.squares(scatter, map);
        let limit_of = |[of_map, of_opposite]: [f64; 2]| {
            let lesser = if of_map < of_opposite { of_map } else { of_opposite };
            if lesser > 0.0 { (lesser * lesser * (1.0 - ROUNDING_F32)) as f32 } else { 0.0 }
        };
        let mut limit = limit_of(*most);
        let mut look_at = |arc: usize| {
            let (start, length) = (arc % self.place_count, arc / self.place_count + 1);
            let places = || (start..start + length).map(|place| place % self.place_count);
            let root = f64::from(self.inverse_counts[arc]).sqrt();
            let scores: Vector =
                std::array::from_fn(|d| f64::from(places().map(|place| map[d][place]).sum::<f32>()) * root);
            for (most, scores) in most.iter_mut().zip([scores, scores.map(|x| -x)]) {
                *most = scatter.evidence_above(*most, &scores).unwrap_or(*most);
            }
            limit_of(*most)
        };
        // The longest first, until none is left that can show more. Bits of numbers that are not below 0 are ordered as they are.
        let longer = squares.iter().zip(0_usize..).filter(|(square, _)| **square > limit);
        let mut left: BinaryHeap<(u32, usize)> = longer.map(|(square, arc)| (square.to_bits(), arc)).collect();
        while let Some((square, arc)) = left.pop()
            && f32::from_bits(square) > limit
        {
            limit = look_at(arc);
        }
    }

    /// The squared length of the sum of the whitened scores of each arc, over its count.
    fn squares(&self, scatter: &Scatter, map: &Columns) -> Vec<f32> {
        let white = scatter.whitened(map);
        // Around the ring and on as far as the longest arc reaches, and all starts together, so that the compiler can use vectors.
        let around = |of: &Vec<f32>| of.repeat(1 + ARC_MAX.div_ceil(of.len()));
        let mut series: Vec<_> = scatter.used().map(|d| (around(&white[d]), vec![0.0_f32; self.place_count])).collect();
        let mut squares = vec![0.0; ARC_MAX * self.place_count];
        let of_length =
            squares.chunks_exact_mut(self.place_count).zip(self.inverse_counts.chunks_exact(self.place_count));
        for (number, (squares, inverse_counts)) in of_length.enumerate() {
            for (around, sums) in &mut series {
                for ((sum, square), place) in sums.iter_mut().zip(&mut *squares).zip(&around[number..]) {
                    *sum += place;
                    *square += *sum * *sum;
                }
            }
            squares.iter_mut().zip(inverse_counts).for_each(|(square, inverse)| *square *= inverse);
        }
        squares
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use tapline_wire::Geometry;

    use super::*;
    use crate::evidence::ABSENT;

    /// A scatter of three discriminators.
    fn scatter(root: &[f64]) -> Scatter {
        let a = faer::Mat::from_fn(3, 3, |i, j| root[3 * i + j]);
        let mut matrix = a.transpose() * &a;
        (0..3).for_each(|i| matrix[(i, i)] += 0.1);
        Scatter::new(&matrix)
    }

    /// The obvious way: the evidence of the arcs from every place, of every length.
    fn strongest_by_search(scatter: &Scatter, ring: &Ring, places: &[Option<Vector>]) -> f64 {
        let mut most = f64::NEG_INFINITY;
        for start in 0..ring.len() {
            for length in 1..=ARC_MAX {
                let arc: Vec<Vector> = ring.from(start).take(length).filter_map(|place| places[place]).collect();
                let root = (arc.len() as f64).sqrt();
                let evidence =
                    scatter.evidence(&std::array::from_fn(|d| arc.iter().map(|of| of[d]).sum::<f64>() / root));
                most = if !arc.is_empty() && evidence > most { evidence } else { most };
            }
        }
        most
    }

    proptest! {
        /// Catches an arc, or an opposite one, that is passed over although it is the strongest: over the seam, behind a place without
        /// a value, beyond a gap or the end of a line.
        #[test]
        fn the_strongest_arc_is_that_of_a_search(
            values in prop::collection::vec(prop::option::weighted(0.9, prop::array::uniform3(-3.0..3.0_f32)), 30),
            root in prop::collection::vec(-1.0..1.0_f64, 9),
            is_ring: bool, count in 1_usize..31, is_gapped: bool
        ) {
            let geometry = if is_ring { Geometry::Ring } else { Geometry::Line };
            // A location that was skipped parts its neighbours.
            let skipped = |place: usize| u32::from(is_gapped && 2 * place >= count) * 3;
            let locations: Vec<_> = (0..count).map(|place| (place as u32 + skipped(place), None)).collect();
            let ring = Ring::of(geometry, &locations, None);
            let (scatter, values) = (scatter(&root), &values[..count]);
            let score = |of: &[f32; 3], d: usize| of.get(d).copied().unwrap_or(0.0);
            let expected = [1.0, -1.0].map(|sign| {
                let scores = |of: &[f32; 3]| std::array::from_fn(|d| sign * f64::from(score(of, d)));
                let places: Vec<Option<Vector>> = values.iter().map(|of| of.as_ref().map(scores)).collect();
                strongest_by_search(&scatter, &ring, &places)
            });
            let map = std::array::from_fn(|d| values.iter().map(|of| of.as_ref().map_or(0.0, |of| score(of, d))).collect());
            let mut found = [f64::NEG_INFINITY; 2];
            Arcs::of(&ring, &[values.iter().map(Option::is_some).collect()]).strongest(&scatter, &map, &mut found);
            for (found, expected) in found.into_iter().zip(expected) {
                prop_assert!(found.total_cmp(&expected).is_eq() || (found - expected).abs() < 1e-4, "{found} {expected}");
            }
        }
    }

    #[test]
    fn offsets_of_noise_are_as_correlated_as_those_of_the_reference() {
        // Catches offsets that are drawn apart from each other, and sums that scatter more than one offset: of four offsets with 0.5 in
        // common, the sum and the first one have the root of (1 + 3 x 0.5)/4.
        let (ring, mut normals) = (ring(2000), Normals::default());
        let (shared, own) = (normals.columns(2000), [(); 4].map(|()| normals.columns(2000)));
        let score = |offset: usize, d: usize, place: usize| {
            0.5_f64.sqrt() * f64::from(shared[d][place]) + 0.5_f64.sqrt() * f64::from(own[offset][d][place])
        };
        let of_offset = |offset| (0..2000).map(|place| std::array::from_fn(|d| score(offset, d, place))).collect();
        let reference = Scores { by_offset: (0..4).map(of_offset).collect(), ..Scores::default() };
        let statistic = ArcStatistic::fit((0..4).collect(), &[(&ring, reference)], false);
        let mean_product =
            |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>() / a.len() as f64;
        let mut shown = vec![vec![true; 5000]; 4];
        let drawn = |shown: &[Vec<bool>]| {
            Noise::of(&statistic, shown).draw(statistic.of_places().next().unwrap(), &mut Normals::default())
        };
        let all = drawn(&shown);
        for (depth, map) in all.iter().enumerate() {
            let with_first = ((1.0 + 0.5 * depth as f64) / (depth as f64 + 1.0)).sqrt();
            for d in 0..WIDTH {
                let found = [mean_product(&map[d], &map[d]), mean_product(&all[0][d], &map[d])];
                assert!((found[0] - 1.0).abs() < 0.15 && (found[1] - with_first).abs() < 0.15, "{depth} {d} {found:?}");
            }
        }
        // Catches a place without a value at the first offset that counts as half of two.
        shown[0].fill(false);
        let partly = drawn(&shown[..2]);
        let found = [0, 1].map(|depth| mean_product(&partly[depth][0], &partly[depth][0]));
        assert!(found[0] < 1e-9 && (found[1] - 1.0).abs() < 0.15, "{found:?}");
    }

    fn ring(count: u32) -> Ring {
        Ring::of(Geometry::Ring, &(0..count).map(|location| (location, None)).collect::<Vec<_>>(), None)
    }

    #[test]
    fn what_a_ring_lacks_is_no_noise() {
        // Catches a discriminator that is drawn as noise although the ring lacks it, and one that counts as 0 in sums over two offsets
        // although it is not drawn at the first one.
        let ring = ring(60);
        let drawn = Normals::default().columns(120);
        let scores = |offset: usize, width: usize| -> Vec<Vector> {
            let value = |d: usize, place: usize| f64::from(drawn[d][60 * offset + place]);
            let score = |d: usize, place: usize| match d {
                0 => value(0, place),
                _ if d < width => (value(0, place) + value(d, place)) / 2.0_f64.sqrt(),
                _ => f64::NAN,
            };
            (0..60).map(|place| std::array::from_fn(|d| score(d, place))).collect()
        };
        let of = |widths: &[usize]| Scores {
            by_offset: widths.iter().enumerate().map(|(offset, &width)| scores(offset, width)).collect(),
            ..Scores::default()
        };
        let limit = |reference: &Scores, pattern: &Scores| {
            let offsets = (0..pattern.by_offset.len()).collect();
            let statistic = ArcStatistic::fit(offsets, &[(&ring, reference.clone())], false);
            let white = strongest_arcs(&statistic, &ring, pattern, 60).unwrap();
            (white.width, white.median)
        };
        let (three, two) = (of(&[3]), of(&[2]));
        let [of_three, of_two] = [&three, &two].map(|pattern| limit(&three, pattern));
        assert!(of_three.0 == 3 && of_two.0 == 2 && of_two.1 < of_three.1, "{of_three:?} {of_two:?}");
        let (deep, shallow) = (of(&[1, 2]), of(&[1, 1]));
        let found = [&deep, &shallow].map(|scores| limit(scores, scores));
        assert!(found[0].0 == 1 && (found[0].1 - found[1].1).abs() < 0.2, "{found:?}");
    }

    #[test]
    fn rings_without_a_value_show_nothing() {
        // Catches a median of nothing.
        let ring = ring(3);
        let pattern = Scores { by_offset: vec![vec![ABSENT; 3]], ..Scores::default() };
        let statistic = ArcStatistic::fit(vec![0], &[(&ring, pattern.clone())], false);
        assert_eq!(strongest_arcs(&statistic, &ring, &pattern, 0), None);
    }
}
