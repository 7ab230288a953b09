//! How far an arc stands out: the evidence of the sum of its scores, over the scatter of such sums on sound shoulders.

use crate::evidence::{ABSENT, Scatter, Sum, Vector, has_value};
use crate::index::Scores;
use crate::shoulder::ring::Ring;
use crate::stats::{mean_and_sd, median};

/// Longest arc, in locations.
pub(crate) const ARC_MAX: usize = 20;

/// Fewest places from which the scatter of a sum over several offsets is estimated.
const PLACES_MIN: usize = 8;

/// The widening of the mean variance of few arcs of one casing, times their count: found on sound casings of two simulators
/// (`docs/rates.md`).
const OWN_WIDENING: f64 = 4.0;

/// How the scores of offsets become those of a place, and those of places the evidence of an arc.
///
/// A crack begins at the belt edge and reaches inwards: its effect shows at the first offset, or the first two, and so on.
/// So the sums are over the first offset, the first two, ..., all offsets.
#[derive(Debug, Clone)]
pub(crate) struct ArcStatistic {
    /// Numbers of the offsets, from the belt edge inwards.
    offsets: Vec<usize>,
    /// By the number of offsets that are summed, from one.
    depths: Vec<Depth>,
}

/// The sum over the first offsets, of each discriminator.
#[derive(Debug, Clone)]
struct Depth {
    /// Mean of the sum over all of them on sound places.
    mean: Vector,
    /// Mean correlation of two of the offsets.
    correlation: Vector,
    /// By length of the arc, from 1: the scatter of its sum over the root of its length.
    by_length: Vec<Scatter>,
}

impl Depth {
    /// The scores of a place from their `sum` over the offsets. Where offsets are missing, the sum of the others scatters as one over that
    /// many.
    fn scores(&self, sum: &Sum) -> Vector {
        let sums = sum.over_root();
        std::array::from_fn(|d| (sums[d] - self.mean[d]) / self.deviation(d, f64::from(sum.count(d))))
    }

    /// Standard deviation of discriminator number `d`, summed over `count` offsets and divided by the root of `count`.
    fn deviation(&self, d: usize, count: f64) -> f64 {
        (1.0 + (count - 1.0) * self.correlation[d]).sqrt()
    }
}

/// An arc and how far it stands out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Arc {
    /// Its first place.
    pub(crate) start: usize,
    /// How many places it has.
    pub(crate) length: usize,
    /// How many offsets it is a sum over, less one.
    depth: usize,
    /// Standard deviations above sound shoulders.
    pub(crate) value: f64,
}

impl Arc {
    /// The one that stands out more; the first of equals.
    pub(crate) fn stronger(self, other: Self) -> Self {
        if other.value > self.value { other } else { self }
    }
}

/// Scores of the places of a shoulder, `[depth][place]`, each of standard deviation 1 on sound ones; NaN where nothing is known.
pub(crate) type Maps = Vec<Vec<Vector>>;

impl ArcStatistic {
    /// Fits the sound places of the reference's shoulders; `is_own` if any of them may be cracked: then the values below
    /// the median determine the scatter.
    pub(crate) fn fit(offsets: Vec<usize>, reference: &[(&Ring, Scores)], is_own: bool) -> Self {
        let mut statistic = Self { offsets, depths: Vec::new() };
        for depth in 1..=statistic.offsets.len() {
            statistic.depths.push(statistic.depth(depth, reference, is_own));
        }
        let maps: Vec<(&Ring, Maps)> =
            reference.iter().map(|(ring, scores)| (*ring, statistic.maps(&scores.by_offset))).collect();
        for (number, depth) in statistic.depths.iter_mut().enumerate() {
            let mut sums = vec![Vec::new(); ARC_MAX];
            for (ring, maps) in &maps {
                let all = (0..ring.len()).flat_map(|start| arcs(ring, &maps[number], start));
                all.for_each(|(length, sum)| sums[length - 1].push(sum));
            }
            depth.by_length = scatter_by_length(&sums, is_own);
        }
        statistic
    }

    /// Mean and correlation of the sums over the first `depth` offsets on sound places, without the scatter of arcs.
    fn depth(&self, depth: usize, reference: &[(&Ring, Scores)], is_own: bool) -> Depth {
        let (mut mean, mut correlation) = ([0.0; ABSENT.len()], [0.0; ABSENT.len()]);
        let mut sums = Vec::new();
        for (ring, scores) in reference {
            for place in 0..ring.len() {
                let mut sum = Sum::default();
                self.offsets[..depth].iter().for_each(|&offset| sum.add(&scores.by_offset[offset][place]));
                sums.push((sum, sum.over_root()));
            }
        }
        for d in 0..ABSENT.len() {
            let full = sums.iter().filter(|(sum, _)| sum.count(d) as usize == depth);
            let full: Vec<f64> = full.map(|(_, over_root)| over_root[d]).collect();
            let scatter = if full.len() < PLACES_MIN { None } else { spread(&full, is_own) };
            let (centre, sd) = scatter.unwrap_or((0.0, 1.0));
            mean[d] = centre;
            if depth > 1 {
                // Each offset has standard deviation 1: a sum cannot scatter less than that of opposite ones.
                let pairs = depth as f64 - 1.0;
                correlation[d] = ((sd * sd - 1.0) / pairs).clamp(-0.9 / pairs, 1.0);
            }
        }
        Depth { mean, correlation, by_length: Vec::new() }
    }

    /// The statistic of `offset` alone.
    pub(crate) fn alone(&self, offset: usize) -> Self {
        Self { offsets: vec![offset], depths: self.depths.first().cloned().into_iter().collect() }
    }

    /// Numbers of the offsets, from the belt edge inwards.
    pub(crate) fn offsets(&self) -> &[usize] {
        &self.offsets
    }

    /// Mean correlation of two offsets.
    pub(crate) fn correlation(&self) -> f64 {
        let Some(depth) = self.depths.last() else { return 0.0 };
        let of: Vec<f64> = depth.by_length[0].used().map(|d| depth.correlation[d]).collect();
        if of.is_empty() { 0.0 } else { of.iter().sum::<f64>() / of.len() as f64 }
    }

    /// The scatter of a place: at one offset, summed over the first two, and so on.
    pub(crate) fn of_places(&self) -> impl Iterator<Item = &Scatter> {
        self.depths.iter().map(|depth| &depth.by_length[0])
    }

    /// Factor from the sum over `count` of the first `depth` + 1 offsets to the scores of a place, where all have the mean 0; 0 for no
    /// offset.
    pub(crate) fn scale(&self, depth: usize, count: usize) -> Vector {
        let count = count as f64;
        let scale = |d: usize| 1.0 / (count.sqrt() * self.depths[depth].deviation(d, count));
        if count > 0.0 { std::array::from_fn(scale) } else { Vector::default() }
    }

    /// The scores of the places of a shoulder, from those `[offset][place]`.
    pub(crate) fn maps(&self, by_offset: &[Vec<Vector>]) -> Maps {
        let mut sums = vec![Sum::default(); by_offset.first().map_or(0, Vec::len)];
        let mut maps = Maps::with_capacity(self.depths.len());
        for (depth, &offset) in self.depths.iter().zip(&self.offsets) {
            sums.iter_mut().zip(&by_offset[offset]).for_each(|(sum, scores)| sum.add(scores));
            maps.push(sums.iter().map(|sum| depth.scores(sum)).collect());
        }
        maps
    }

    /// The evidence of the arc of `place` and its neighbours at each depth that `place` has a value at.
    pub(crate) fn about(&self, ring: &Ring, maps: &Maps, place: usize) -> impl Iterator<Item = f64> {
        let of_depth = self.depths.iter().zip(maps).filter(move |(_, map)| has_value(&map[place]));
        of_depth.map(move |(depth, map)| {
            let mut sum = Sum::default();
            let near = ring.with_neighbours(place).filter(|&near| has_value(&map[near]));
            let count = near.map(|near| sum.add(&map[near])).count();
            depth.by_length[count - 1].evidence(&sum.over_root())
        })
    }

    /// The arc that stands out most; the first and shortest of equals. `None` where no place has a value.
    pub(crate) fn strongest(&self, ring: &Ring, maps: &Maps) -> Option<Arc> {
        let stronger = |strongest: Option<Arc>, start| {
            let least = strongest.map_or(f64::NEG_INFINITY, |arc| arc.value);
            self.strongest_from(start, least, ring, maps).or(strongest)
        };
        (0..ring.len()).fold(None, stronger)
    }

    /// As [`Self::strongest`], among the arcs that begin at `start`, if one stands out more than `least`; much faster if few do.
    pub(crate) fn strongest_from(&self, start: usize, least: f64, ring: &Ring, maps: &Maps) -> Option<Arc> {
        let mut strongest: Option<Arc> = None;
        for (number, (depth, map)) in self.depths.iter().zip(maps).enumerate() {
            for (length, sum) in arcs(ring, map, start) {
                let best = strongest.map_or(least, |arc| arc.value);
                if let Some(value) = depth.by_length[length - 1].evidence_above(best, &sum) {
                    strongest = Some(Arc { start, length, depth: number, value });
                }
            }
        }
        strongest
    }

    /// The weights that show most of `arc` in `maps`.
    pub(crate) fn weights(&self, ring: &Ring, maps: &Maps, arc: Arc) -> Vector {
        let mut sum = Sum::default();
        ring.from(arc.start).take(arc.length).for_each(|place| sum.add(&maps[arc.depth][place]));
        self.depths[arc.depth].by_length[arc.length - 1].weights(&sum.over_root())
    }
}

/// The arcs of at most [`ARC_MAX`] neighbours from `start` on that begin and end with a value: length, and the sum of their scores over
/// the root of their count.
fn arcs<'a>(ring: &'a Ring, map: &'a [Vector], start: usize) -> impl Iterator<Item = (usize, Vector)> + 'a {
    let mut sum = Sum::default();
    let longest = if has_value(&map[start]) { ARC_MAX } else { 0 };
    ring.from(start).take(longest).enumerate().filter_map(move |(number, place)| {
        sum.add(&map[place]);
        has_value(&map[place]).then(|| (number + 1, sum.over_root()))
    })
}

/// How arcs scatter by their length, from their `sums` on sound shoulders.
fn scatter_by_length(sums: &[Vec<Vector>], is_own: bool) -> Vec<Scatter> {
    let of_length = |sums: &Vec<Vector>| match is_own {
        true => Scatter::of_own(sums.iter().copied()),
        false => Scatter::of(sums.iter().copied()),
    };
    let unit = || Scatter::new(&faer::Mat::identity(ABSENT.len(), ABSENT.len()));
    let place = if sums[0].len() < PLACES_MIN { unit() } else { of_length(&sums[0]) };
    let longer = sums.iter().enumerate().map(|(number, sums)| {
        if sums.len() < PLACES_MIN {
            return place.clone();
        }
        // Long arcs share places: few of them are independent.
        let independent = sums.len() as f64 / (number as f64 + 1.0);
        let scatter = match is_own {
            true => widened(&place, &of_length(sums), independent),
            // What so few do not determine is taken from a place.
            false => {
                let width = place.used().count() as f64;
                of_length(sums).mixed(&place, width / (width + independent))
            }
        };
        // The level takes away what the long arcs of a sound shoulder have in common, but not those of a cracked one: no arc counts as
        // scattering less than a place.
        let at_least = |d: usize| {
            if scatter.deviation(d) < place.deviation(d) { place.deviation(d) / scatter.deviation(d) } else { 1.0 }
        };
        scatter.scaled(&std::array::from_fn(at_least))
    });
    longer.collect()
}

/// The scatter of a `place`, widened as far as the `arcs` of one casing scatter more; so few of them determine no correlation.
///
/// Each discriminator is widened by its own ratio of variances, and at least by the mean ratio of all, which is known better. The mean is
/// raised by [`OWN_WIDENING`] over the count of `independent` arcs.
fn widened(place: &Scatter, arcs: &Scatter, independent: f64) -> Scatter {
    let ratio = |d: usize| (arcs.deviation(d) / place.deviation(d)).powi(2);
    let width = place.used().count() as f64;
    let mean = place.used().map(ratio).sum::<f64>() / width * (1.0 + OWN_WIDENING / independent);
    place.scaled(&std::array::from_fn(|d| if ratio(d) > mean { ratio(d) } else { mean }.sqrt()))
}

/// Mean and standard deviation; where the upper half may be damage (`is_own`), the median and the deviation of the lower half from it.
fn spread(values: &[f64], is_own: bool) -> Option<(f64, f64)> {
    if !is_own {
        return mean_and_sd(values);
    }
    let centre = median(&mut values.to_vec())?;
    let below: Vec<f64> =
        values.iter().filter(|&&value| value <= centre).map(|value| (centre - value).powi(2)).collect();
    Some((centre, (below.iter().sum::<f64>() / below.len() as f64).sqrt()))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use tapline_wire::Geometry;

    use super::*;

    fn ring(count: usize, geometry: Geometry) -> Ring {
        let locations: Vec<_> = (0..count as u32).map(|location| (location, None)).collect();
        Ring::of(geometry, &locations, None)
    }

    fn vector(value: f64) -> Vector {
        let mut vector = ABSENT;
        vector[0] = value;
        vector
    }

    fn scores(by_offset: Vec<Vec<f64>>) -> Scores {
        let by_offset = by_offset.into_iter().map(|of_offset| of_offset.into_iter().map(vector).collect()).collect();
        Scores { by_offset, ..Scores::default() }
    }

    /// The obvious way: every depth, start and length anew, offset by offset.
    fn strongest_by_search(is_ring: bool, by_offset: &[Vec<f64>]) -> f64 {
        let count = by_offset[0].len();
        let mut strongest = f64::NEG_INFINITY;
        for depth in 1..=by_offset.len() {
            let value = |place: usize| {
                let there: Vec<f64> = by_offset[..depth].iter().map(|o| o[place]).filter(|x| x.is_finite()).collect();
                there.iter().sum::<f64>() / (there.len() as f64).sqrt()
            };
            for start in 0..count {
                for length in 1..=ARC_MAX.min(count) {
                    let places: Vec<usize> = (start..start + length).map(|place| place % count).collect();
                    if !is_ring && start + length > count {
                        continue;
                    }
                    let values: Vec<f64> = places.iter().map(|&place| value(place)).filter(|x| x.is_finite()).collect();
                    let sum = values.iter().sum::<f64>() / (values.len() as f64).sqrt();
                    strongest = if sum > strongest { sum } else { strongest };
                }
            }
        }
        strongest
    }

    proptest! {
        #[test]
        fn the_strongest_arc_is_that_of_a_search(
            values in prop::collection::vec(prop::collection::vec(prop_oneof![4 => -3.0..3.0_f64, 1 => Just(f64::NAN)], 30), 1..4),
            is_ring: bool
        ) {
            // Catches an arc that is not looked at over the seam, one that is on a line, and a place that is counted without
            // a value.
            let geometry = if is_ring { Geometry::Ring } else { Geometry::Line };
            let ring = ring(30, geometry);
            let statistic = ArcStatistic::fit((0..values.len()).collect(), &[], false);
            let found = statistic.strongest(&ring, &statistic.maps(&scores(values.clone()).by_offset));
            let expected = strongest_by_search(is_ring, &values);
            prop_assert!((found.map_or(f64::NEG_INFINITY, |arc| arc.value) - expected).abs() < 1e-9 || expected == f64::NEG_INFINITY);
        }
    }

    #[test]
    fn arcs_that_scatter_more_than_white_ones_count_less() {
        // Catches a reference whose long waves along the ring are taken for damage.
        let wave = |phase: f64| -> Vec<f64> {
            (0..60).map(|place| 1.4 * (f64::from(place) * std::f64::consts::TAU / 20.0 + phase).sin()).collect()
        };
        let ring = ring(60, Geometry::Ring);
        let reference: Vec<(&Ring, Scores)> = (0..10).map(|k| (&ring, scores(vec![wave(f64::from(k))]))).collect();
        let statistic = ArcStatistic::fit(vec![0], &reference, false);
        let sound = scores(vec![wave(0.5)]);
        let value = |of: &ArcStatistic| of.strongest(&ring, &of.maps(&sound.by_offset)).unwrap().value;
        let (fitted, white) = (value(&statistic), value(&ArcStatistic::fit(vec![0], &[], false)));
        assert!(fitted < 2.0 && white > 2.5, "{fitted} {white}");
    }

    #[test]
    fn of_equal_arcs_the_first_and_shortest_is_the_strongest() {
        // Catches marks that wander with the order of a search: two places alike, and two neighbours as strong as one.
        let mut values = vec![0.0; 60];
        (values[20], values[40]) = (4.0, 4.0);
        values[21] = 4.0 * (2.0_f64.sqrt() - 1.0);
        let statistic = ArcStatistic::fit(vec![0], &[], false);
        let found =
            statistic.strongest(&ring(60, Geometry::Ring), &statistic.maps(&scores(vec![values.clone()]).by_offset));
        assert_eq!(found.map(|arc| (arc.start, arc.length)), Some((20, 1)));
        values[21] = 0.0;
        let found = statistic.strongest(&ring(60, Geometry::Ring), &statistic.maps(&scores(vec![values]).by_offset));
        assert_eq!(found.map(|arc| (arc.start, arc.length)), Some((20, 1)));
    }

    #[test]
    fn a_crack_that_one_offset_sees_is_not_thinned_out() {
        // Catches a mean over all offsets: six places at the belt edge alone.
        let mut by_offset = vec![vec![0.0; 60]; 4];
        by_offset[0][20..26].fill(3.0);
        let statistic = ArcStatistic::fit((0..4).collect(), &[], false);
        let found =
            statistic.strongest(&ring(60, Geometry::Ring), &statistic.maps(&scores(by_offset).by_offset)).unwrap();
        assert_eq!((found.start, found.length), (20, 6));
        assert!((found.value - 3.0 * 6.0_f64.sqrt()).abs() < 1e-12);
    }
}
