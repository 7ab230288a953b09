//! Which locations are neighbours, their running mean, and runs of them.

use tapline_wire::Geometry;

use crate::stats::median;

/// A step this many times the usual one skips a location.
const STEP_SLACK: f64 = 1.5;

/// Angles may be rounded to whole degrees.
const ROUNDING_DEG: f64 = 1.0;

/// The locations of one shoulder in their order, and which of them lie side by side.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Ring {
    /// Whether each place is a neighbour of the next one; the last place's next is the first.
    is_linked: Vec<bool>,
}

impl Ring {
    /// The ring or line of `locations`: indices ascending, each with its angle in degrees where known.
    ///
    /// Two locations are neighbours if neither their indices nor, on a ring, their angles are further apart than usual in it. The
    /// angles, or else the closing tap, decide whether the ends of a ring are neighbours; without both they are.
    pub(crate) fn of(geometry: Geometry, locations: &[(u32, Option<f64>)], closing_location: Option<u32>) -> Self {
        let steps: Vec<f64> = locations.windows(2).map(|w| f64::from(w[1].0) - f64::from(w[0].0)).collect();
        let usual = median(&mut steps.clone()).unwrap_or(1.0);
        let mut is_linked: Vec<bool> = steps.iter().map(|&step| step <= STEP_SLACK * usual).collect();
        let (Some(&(first, _)), Some(&(last, _))) = (locations.first(), locations.last()) else {
            return Self { is_linked };
        };
        let is_closed = match turns(locations).filter(|_| geometry == Geometry::Ring) {
            Some(turns) => {
                let near_deg = STEP_SLACK * median(&mut turns.clone()).unwrap_or(f64::NAN) + ROUNDING_DEG;
                let is_near = turns.iter().map(|&turn| turn <= near_deg);
                is_linked.iter_mut().zip(is_near).for_each(|(is_linked, is_near)| *is_linked &= is_near);
                turns.last().is_some_and(|&seam| seam <= near_deg)
            }
            // The closing tap carries the number of the ring's locations.
            None => closing_location.is_none_or(|count| {
                count <= last || f64::from(count) + f64::from(first) - f64::from(last) <= STEP_SLACK * usual
            }),
        };
        is_linked.push(geometry == Geometry::Ring && locations.len() > 2 && is_closed);
        Self { is_linked }
    }

    /// Whether every location has its neighbours on both sides.
    pub(crate) fn is_whole(&self) -> bool {
        self.is_linked.iter().all(|&is_linked| is_linked)
    }

    /// How many locations there are.
    pub(crate) fn len(&self) -> usize {
        self.is_linked.len()
    }

    /// `start` and the places that follow it, each a neighbour of the one before, once around at most.
    pub(crate) fn from(&self, start: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(start), |&place| self.next(place)).take(self.len())
    }

    /// `place` and its neighbours.
    pub(crate) fn with_neighbours(&self, place: usize) -> impl Iterator<Item = usize> {
        // On a ring of two the neighbours are one.
        let (before, after) = (self.previous(place), self.next(place));
        [before, Some(place), after.filter(|after| before != Some(*after))].into_iter().flatten()
    }

    fn next(&self, place: usize) -> Option<usize> {
        self.is_linked[place].then_some(if place + 1 < self.len() { place + 1 } else { 0 })
    }

    fn previous(&self, place: usize) -> Option<usize> {
        let previous = if place > 0 { place - 1 } else { self.len() - 1 };
        self.is_linked[previous].then_some(previous)
    }

    /// Mean of each value and its two neighbours; a neighbour without a value is left out.
    ///
    /// A place without a value stays without one: its neighbours cannot supply it.
    ///
    /// # Panics
    /// If there are not as many values as locations.
    pub(crate) fn mean_of_3(&self, values: &[Option<f64>]) -> Vec<Option<f64>> {
        assert_eq!(values.len(), self.len(), "one value a location");
        let mean = |place: usize| {
            let own = values[place]?;
            let value = |p: Option<usize>| p.and_then(|p| values[p]);
            // Added in a fixed order, so that the result is the same to the last bit.
            let (sum, count) = [value(self.previous(place)), value(self.next(place))]
                .into_iter()
                .flatten()
                .fold((own, 1.0), |(sum, count), v| (sum + v, count + 1.0));
            Some(sum / count)
        };
        (0..self.len()).map(mean).collect()
    }

    /// Numbers, from 1 in ring order, of the maximal runs of neighbours inside; 0 outside of them.
    pub(crate) fn numbered(&self, is_inside: impl Fn(usize) -> bool) -> Vec<u32> {
        let mut numbers = vec![0; self.len()];
        for (number, run) in (1..).zip(self.runs(is_inside)) {
            for place in run {
                numbers[place] = number;
            }
        }
        numbers
    }

    /// Maximal runs of neighbours inside; one over the seam comes first, as it holds the first place.
    fn runs(&self, is_inside: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
        let mut runs: Vec<Vec<usize>> = Vec::new();
        for place in (0..self.len()).filter(|&p| is_inside(p)) {
            let goes_on = place > 0 && self.is_linked[place - 1] && is_inside(place - 1);
            match runs.last_mut() {
                Some(run) if goes_on => run.push(place),
                _ => runs.push(vec![place]),
            }
        }
        let last = self.len().saturating_sub(1);
        if runs.len() > 1 && self.is_linked[last] && is_inside(last) && is_inside(0) {
            let over_the_seam = runs.pop().unwrap_or_default();
            runs[0].extend(over_the_seam);
        }
        runs
    }
}

/// The angle in degrees from each location of a ring to the next, and from the last to the first, the way that they are numbered; `None`
/// unless all angles are known.
fn turns(locations: &[(u32, Option<f64>)]) -> Option<Vec<f64>> {
    let angles: Vec<f64> =
        locations.iter().map(|&(_, angle)| angle.filter(|a| a.is_finite())).collect::<Option<_>>()?;
    let next = angles.iter().cycle().skip(1);
    let turns: Vec<f64> = angles.iter().zip(next).map(|(from, to)| (to - from).rem_euclid(360.0)).collect();
    // A ring may be numbered against its angles: every turn is then 360 less a step.
    let is_backwards = median(&mut turns.clone()).is_some_and(|turn| turn > 180.0);
    Some(turns.into_iter().map(|turn| if is_backwards { 360.0 - turn } else { turn }).collect())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ring(count: u32) -> Ring {
        let locations: Vec<_> = (0..count).map(|l| (l, Some(f64::from(l) * 360.0 / f64::from(count)))).collect();
        Ring::of(Geometry::Ring, &locations, Some(count))
    }

    fn is_closed(locations: &[(u32, Option<f64>)], closing: Option<u32>) -> bool {
        Ring::of(Geometry::Ring, locations, closing).is_linked[locations.len() - 1]
    }

    #[test]
    fn a_ring_wraps_only_where_its_ends_meet() {
        // Catches half a ring whose ends are averaged with each other, and a line that wraps.
        let at = |angles: &[f64]| (0..).zip(angles.iter().map(|&a| Some(a))).collect::<Vec<_>>();
        assert!(is_closed(&at(&[0.0, 90.0, 180.0, 270.0]), None));
        assert!(is_closed(&at(&[300.0, 30.0, 120.0, 210.0]), None), "starts anywhere");
        assert!(is_closed(&at(&[270.0, 180.0, 90.0, 0.0]), None), "against the angles");
        assert!(!is_closed(&at(&[0.0, 30.0, 60.0, 90.0]), Some(4)), "a quarter");
        assert!(!is_closed(&at(&[90.0, 60.0, 30.0, 0.0]), None), "a quarter, against the angles");
        let unknown: Vec<_> = (0..10).map(|l| (l, None)).collect();
        assert!(is_closed(&unknown, None));
        assert!(is_closed(&unknown, Some(10)));
        assert!(!is_closed(&unknown, Some(20)));
        assert!(!is_closed(&unknown[..2], None), "two are neighbours once");
        let line = Ring::of(Geometry::Line, &unknown, None);
        assert_eq!((line.previous(0), line.next(9), line.next(0)), (None, None, Some(1)));
        assert_eq!(Ring::of(Geometry::Ring, &[], None).len(), 0);
    }

    #[test]
    fn a_skipped_location_parts_its_neighbours() {
        // Catches a mean over locations that do not lie side by side.
        let locations: Vec<_> = [0, 2, 4, 8, 10].map(|l| (l, None)).to_vec();
        let line = Ring::of(Geometry::Line, &locations, None);
        assert_eq!(line.is_linked, [true, true, false, true, false]);
        // Numbers that run on where the angles do not.
        let at = |angles: [f64; 5]| Ring::of(Geometry::Ring, &(0..).zip(angles.map(Some)).collect::<Vec<_>>(), None);
        assert_eq!(at([0.0, 60.0, 180.0, 240.0, 300.0]).is_linked, [true, false, true, true, true]);
        assert_eq!(at([300.0, 240.0, 180.0, 60.0, 0.0]).is_linked, [true, true, false, true, true]);
        assert!(at([350.0, 62.0, 134.0, 206.0, 278.0]).is_whole());
        for count in [36, 100, 241, 250, 300, 360] {
            let rounded = (0..count).map(|l| (l, Some((f64::from(l) * 360.0 / f64::from(count)).round())));
            assert!(Ring::of(Geometry::Ring, &rounded.collect::<Vec<_>>(), None).is_whole(), "{count}");
        }
    }

    /// The obvious way: look at every pair of places.
    fn mean_by_search(is_ring: bool, values: &[Option<f64>]) -> Vec<Option<f64>> {
        let n = values.len() as i64;
        let distance =
            |a: i64, b: i64| if is_ring { ((a - b).rem_euclid(n)).min((b - a).rem_euclid(n)) } else { (a - b).abs() };
        (0..n)
            .map(|place| {
                values[place as usize]?;
                let near: Vec<f64> =
                    (0..n).filter(|&o| distance(o, place) <= 1).filter_map(|o| values[o as usize]).collect();
                Some(near.iter().sum::<f64>() / near.len() as f64)
            })
            .collect()
    }

    proptest! {
        #[test]
        fn the_mean_of_3_is_that_of_a_search(
            values in prop::collection::vec(prop::option::weighted(0.8, -9.0..9.0), 3..40), is_ring: bool
        ) {
            // Catches wrong neighbours at the seam and divisors that count an absent one.
            let count = u32::try_from(values.len()).unwrap();
            let locations: Vec<_> = (0..count).map(|l| (l, None)).collect();
            let geometry = if is_ring { Geometry::Ring } else { Geometry::Line };
            let got = Ring::of(geometry, &locations, None).mean_of_3(&values);
            for (got, expected) in got.iter().zip(mean_by_search(is_ring, &values)) {
                prop_assert_eq!(got.is_some(), expected.is_some());
                prop_assert!((got.unwrap_or(0.0) - expected.unwrap_or(0.0)).abs() < 1e-12);
            }
        }

        #[test]
        fn regions_turn_with_the_ring(is_inside in prop::collection::vec(any::<bool>(), 3..40), turn in 0_usize..40) {
            // Catches a region cut at the seam, or joined where it should not be.
            let n = is_inside.len();
            let ring = ring(u32::try_from(n).unwrap());
            let still = ring.numbered(|place| is_inside[place]);
            let turned = ring.numbered(|place| is_inside[(place + turn) % n]);
            for a in 0..n {
                prop_assert_eq!(turned[a] > 0, still[(a + turn) % n] > 0);
                let b = (a + 1) % n;
                prop_assert_eq!(turned[a] == turned[b], still[(a + turn) % n] == still[(b + turn) % n]);
            }
        }

        #[test]
        fn from_goes_around_once(count in 1_u32..40, start in 0_usize..40) {
            // Catches a way that is endless, or that ends before it is around.
            let start = start % count as usize;
            let way: Vec<usize> = ring(count).from(start).collect();
            let expected: Vec<usize> = (0..count as usize).map(|step| (start + step) % count as usize).collect();
            prop_assert_eq!(way, if count > 2 { expected } else { expected.into_iter().take_while(|&p| p >= start).collect() });
        }
    }

    #[test]
    fn regions_are_numbered() {
        // Catches gaps in the numbers, and one over the seam that has two.
        let numbers = |text: &str| -> String {
            let inside: Vec<bool> = text.bytes().map(|b| b == b'x').collect();
            ring(u32::try_from(inside.len()).unwrap())
                .numbered(|place| inside[place])
                .iter()
                .map(u32::to_string)
                .collect()
        };
        assert_eq!(numbers("xx.x..xxx.x"), "11.2..333.1".replace('.', "0"));
        assert_eq!(numbers("....."), "00000");
        assert_eq!(numbers("xxxx"), "1111");
    }
}
