//! How far an arc stands out: the sum of its scores over what such a sum scatters by on sound shoulders.

use crate::index::Scores;
use crate::shoulder::ring::Ring;
use crate::stats::{mean_and_sd, median};

/// Longest arc, in locations.
pub(crate) const ARC_MAX: usize = 20;

/// Fewest places that tell how the sum of several offsets scatters.
const PLACES_MIN: usize = 8;

/// How scores become one value a place, and values the evidence of an arc.
///
/// A crack begins at the belt edge and reaches inwards: what it does shows at the first offset, or the first two, and so on.
/// So the sums are those over the first offset, the first two, ..., all of them.
#[derive(Debug, Clone)]
pub(crate) struct ArcStatistic {
    /// Numbers of the offsets, from the belt edge inwards.
    offsets: Vec<usize>,
    /// By how many of the offsets are summed, from one.
    depths: Vec<Depth>,
}

/// The sum over the first offsets.
#[derive(Debug, Clone)]
struct Depth {
    /// Of the sum over all of them.
    mean: f64,
    /// Mean correlation of two of the offsets.
    correlation: f64,
    /// By length of the arc, from 1: standard deviation of its sum over that of as many independent values, at least 1.
    excess: Vec<f64>,
}

/// An arc and how far it stands out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Arc {
    /// Its first place.
    pub(crate) start: usize,
    /// How many places it has.
    pub(crate) length: usize,
    /// Standard deviations above sound shoulders.
    pub(crate) value: f64,
}

/// One value a place and depth, `[depth][place]`, of standard deviation 1 on sound shoulders; NaN where nothing is known.
pub(crate) type Maps = Vec<Vec<f64>>;

impl ArcStatistic {
    /// What the `sound` places of the reference's shoulders teach; `is_own` where any of them may be cracked: then only what
    /// lies below the median counts.
    pub(crate) fn fit(offsets: Vec<usize>, reference: &[(&Ring, Scores)], is_own: bool) -> Self {
        let mut statistic = Self { offsets, depths: Vec::new() };
        for depth in 1..=statistic.offsets.len() {
            let full: Vec<f64> = (reference.iter())
                .flat_map(|(ring, scores)| (0..ring.len()).map(|place| statistic.sum(depth, scores, place)))
                .filter(|&(_, count)| count == depth)
                .map(|(sum, count)| sum / (count as f64).sqrt())
                .collect();
            let scatter = if full.len() < PLACES_MIN { None } else { spread(&full, is_own) };
            let (mean, sd) = scatter.unwrap_or((0.0, 1.0));
            let correlation = if depth > 1 { (sd * sd - 1.0) / (depth as f64 - 1.0) } else { 0.0 };
            // Each offset has standard deviation 1: a sum cannot scatter less than that of opposite ones.
            let least = if depth > 1 { -0.9 / (depth as f64 - 1.0) } else { 0.0 };
            statistic.depths.push(Depth {
                mean,
                correlation: correlation.clamp(least, 1.0),
                excess: vec![1.0; ARC_MAX],
            });
        }
        let maps: Vec<(&Ring, Maps)> = reference.iter().map(|(ring, scores)| (*ring, statistic.maps(scores))).collect();
        for depth in 0..statistic.depths.len() {
            for length in 1..=ARC_MAX {
                let mut sums = Vec::new();
                for (ring, maps) in &maps {
                    let of_length = |arc: &(Arc, usize)| arc.0.length == length;
                    sums.extend(arcs(ring, &maps[depth], length).filter(of_length).map(|(arc, _)| arc.value));
                }
                let sd = if sums.len() < PLACES_MIN { None } else { spread(&sums, is_own) };
                statistic.depths[depth].excess[length - 1] = sd.map_or(1.0, |(_, sd)| if sd > 1.0 { sd } else { 1.0 });
            }
        }
        statistic
    }

    /// The same without what arcs of the reference scatter more than independent values do.
    pub(crate) fn of_white(&self) -> Self {
        let mut white = self.clone();
        white.depths.iter_mut().for_each(|depth| depth.excess.fill(1.0));
        white
    }

    /// The same of `offset` alone.
    pub(crate) fn alone(&self, offset: usize) -> Self {
        Self { offsets: vec![offset], depths: self.depths.first().cloned().into_iter().collect() }
    }

    /// Numbers of the offsets, from the belt edge inwards.
    pub(crate) fn offsets(&self) -> &[usize] {
        &self.offsets
    }

    /// Mean correlation of two offsets.
    pub(crate) fn correlation(&self) -> f64 {
        self.depths.last().map_or(0.0, |depth| depth.correlation)
    }

    /// The sum of the scores of the first `depth` offsets at `place`, and how many of them there are.
    fn sum(&self, depth: usize, scores: &Scores, place: usize) -> (f64, usize) {
        let values = self.offsets[..depth].iter().map(|&offset| scores.by_offset[offset][place]);
        values.filter(|value| value.is_finite()).fold((0.0, 0), |(sum, count), value| (sum + value, count + 1))
    }

    /// The values of the places of a shoulder.
    pub(crate) fn maps(&self, scores: &Scores) -> Maps {
        let place_count = scores.by_offset.first().map_or(0, Vec::len);
        let of = |(number, depth): (usize, &Depth)| {
            let value = |place: usize| {
                let (sum, count) = self.sum(number + 1, scores, place);
                let n = count as f64;
                // Where offsets are missing, the sum of the others scatters as that of so many.
                (sum / n.sqrt() - depth.mean) / (1.0 + (n - 1.0) * depth.correlation).sqrt()
            };
            (0..place_count).map(value).collect()
        };
        self.depths.iter().enumerate().map(of).collect()
    }

    /// Shows every arc of at most [`ARC_MAX`] places, depth by depth.
    pub(crate) fn for_arcs(&self, ring: &Ring, maps: &Maps, mut see: impl FnMut(Arc)) {
        for (depth, map) in self.depths.iter().zip(maps) {
            for (arc, _) in arcs(ring, map, ARC_MAX) {
                see(Arc { value: arc.value / depth.excess[arc.length - 1], ..arc });
            }
        }
    }

    /// The value of the arc of `place` and its neighbours at each depth that `place` has a value at.
    pub(crate) fn about(&self, ring: &Ring, maps: &Maps, place: usize) -> impl Iterator<Item = f64> {
        self.depths.iter().zip(maps).filter(move |(_, map)| map[place].is_finite()).map(move |(depth, map)| {
            let near = ring.with_neighbours(place).map(|near| map[near]).filter(|value| value.is_finite());
            let (sum, count) = near.fold((0.0, 0_usize), |(sum, count), value| (sum + value, count + 1));
            sum / (count as f64).sqrt() / depth.excess[count - 1]
        })
    }

    /// The arc that stands out most; the first and shortest of equals. `None` where no place has a value.
    pub(crate) fn strongest(&self, ring: &Ring, maps: &Maps) -> Option<Arc> {
        let mut strongest: Option<Arc> = None;
        self.for_arcs(ring, maps, |arc| {
            if strongest.is_none_or(|best| arc.value > best.value) {
                strongest = Some(arc);
            }
        });
        strongest
    }
}

/// The arcs of at most `longest` neighbours that begin and end with a value, each with how many values it has; its own value
/// is their sum over the root of their count.
fn arcs<'a>(ring: &'a Ring, map: &'a [f64], longest: usize) -> impl Iterator<Item = (Arc, usize)> + 'a {
    (0..map.len()).filter(|&start| map[start].is_finite()).flat_map(move |start| {
        let (mut sum, mut count) = (0.0, 0_usize);
        ring.from(start).take(longest).enumerate().filter_map(move |(number, place)| {
            let value = map[place];
            if !value.is_finite() {
                return None;
            }
            (sum, count) = (sum + value, count + 1);
            Some((Arc { start, length: number + 1, value: sum / (count as f64).sqrt() }, count))
        })
    })
}

/// Mean and standard deviation; of the lower half alone where the upper may be damage.
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

    fn scores(by_offset: Vec<Vec<f64>>) -> Scores {
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
            let found = statistic.strongest(&ring, &statistic.maps(&scores(values.clone())));
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
        let value = |of: &ArcStatistic| of.strongest(&ring, &of.maps(&sound)).unwrap().value;
        let (fitted, white) = (value(&statistic), value(&statistic.of_white()));
        assert!(fitted < 2.0 && white > 2.5, "{fitted} {white}");
    }

    #[test]
    fn a_crack_that_one_offset_sees_is_not_thinned_out() {
        // Catches a mean over all offsets: six places at the belt edge alone.
        let mut by_offset = vec![vec![0.0; 60]; 4];
        by_offset[0][20..26].fill(3.0);
        let statistic = ArcStatistic::fit((0..4).collect(), &[], false);
        let found = statistic.strongest(&ring(60, Geometry::Ring), &statistic.maps(&scores(by_offset))).unwrap();
        assert_eq!((found.start, found.length), (20, 6));
        assert!((found.value - 3.0 * 6.0_f64.sqrt()).abs() < 1e-12);
    }
}
