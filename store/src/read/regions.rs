//! Regions of damage: runs of neighbouring locations that carry one region number.

use tapline_wire::{DamageCell, Geometry};

/// An arc of damage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Region {
    /// Its number, from 1.
    pub region: u32,
    /// Its first location, in ascending direction; on a ring it may be greater than the last.
    pub first_location: u32,
    /// Its last location.
    pub last_location: u32,
    /// Angle of the first location in degrees.
    pub start_deg: Option<f64>,
    /// Angle of the last location in degrees.
    pub end_deg: Option<f64>,
    /// Location of its [`peak`]; the first if no location has a damage index.
    pub peak_location: u32,
    /// Angle of that location in degrees.
    pub peak_angle_deg: Option<f64>,
    /// Its greatest damage index; `None` if no cell has one.
    pub peak_damage_index: Option<f64>,
    /// Mean damage index of its locations, a measure of severity; `None` if no cell has one.
    pub mean_damage_index: Option<f64>,
    /// How far its strongest arc stands out, on the scale of the limits.
    pub region_index: Option<f64>,
    /// Probability that a sound shoulder has such an arc.
    pub p_value: Option<f64>,
    /// Offset from the belt edge, in mm, at which it shows most.
    pub offset_best_mm: Option<f64>,
    /// Least offset, in mm, at which it shows.
    pub offset_low_mm: Option<f64>,
    /// Greatest offset, in mm, at which it shows.
    pub offset_high_mm: Option<f64>,
    /// Number of its locations.
    pub extent_locations: u32,
    /// Its extent on the ring in degrees, in which each location counts as one step; `None` on a line.
    pub extent_deg: Option<f64>,
}

/// The regions of a damage map, in order of their first location.
///
/// `cells` are all locations of one scan, ascending. A region is a run of neighbours with the same region number other
/// than 0; on a ring the last cell is a neighbour of the first.
pub fn regions(geometry: Geometry, cells: &[DamageCell]) -> Vec<Region> {
    let mut runs: Vec<Vec<&DamageCell>> = cells
        .chunk_by(|a, b| a.region == b.region)
        .filter(|run| run[0].region != 0)
        .map(|run| run.iter().collect())
        .collect();
    if geometry == Geometry::Ring && runs.len() > 1 && runs_join(cells) {
        // The last run continues at the beginning.
        let head = runs.remove(0);
        if let Some(tail) = runs.last_mut() {
            tail.extend(head);
        }
    }
    let mut regions: Vec<Region> = runs.iter().map(|run| region_of(part_deg(geometry, cells), run)).collect();
    regions.sort_by_key(|region| region.first_location);
    regions
}

/// The cell with the greatest damage index, the middle one if several have it: scores are bounded, so a strong crack has many.
/// `None` if no cell has an index.
pub fn peak<'a>(cells: impl IntoIterator<Item = &'a DamageCell>) -> Option<&'a DamageCell> {
    let mut cells: Vec<&DamageCell> = cells.into_iter().filter(|cell| !cell.damage_index.is_nan()).collect();
    let greatest = cells.iter().map(|cell| cell.damage_index).max_by(f64::total_cmp)?;
    cells.retain(|cell| cell.damage_index.total_cmp(&greatest).is_eq());
    cells.get((cells.len() - 1) / 2).copied()
}

fn runs_join(cells: &[DamageCell]) -> bool {
    matches!((cells.first(), cells.last()), (Some(first), Some(last)) if first.region != 0 && first.region == last.region)
}

/// Degrees of the ring that one location counts as: the median step of the angles, or an equal part if there are no angles.
fn part_deg(geometry: Geometry, cells: &[DamageCell]) -> Option<f64> {
    if geometry == Geometry::Line {
        return None;
    }
    let mut steps_deg: Vec<f64> = cells.windows(2).map(|pair| pair[1].angle_deg - pair[0].angle_deg).collect();
    steps_deg.retain(|step_deg| *step_deg > 0.0);
    steps_deg.sort_by(f64::total_cmp);
    let share_deg = 360.0 / f64::from(u32::try_from(cells.len()).unwrap_or(u32::MAX));
    Some(steps_deg.get(steps_deg.len() / 2).copied().unwrap_or(share_deg))
}

fn region_of(part_deg: Option<f64>, run: &[&DamageCell]) -> Region {
    let (first, last) = (run[0], run[run.len() - 1]);
    let peak = peak(run.iter().copied());
    let known = |value: f64| Some(value).filter(|v| v.is_finite());
    let indices = run.iter().map(|cell| cell.damage_index).filter(|index| !index.is_nan());
    let (sum, count) = indices.fold((0.0, 0_u32), |(sum, count), index| (sum + index, count + 1));
    let extent_locations = u32::try_from(run.len()).unwrap_or(u32::MAX);
    Region {
        region: first.region,
        first_location: first.location,
        last_location: last.location,
        start_deg: known(first.angle_deg),
        end_deg: known(last.angle_deg),
        peak_location: peak.unwrap_or(first).location,
        peak_angle_deg: known(peak.unwrap_or(first).angle_deg),
        peak_damage_index: peak.and_then(|cell| known(cell.damage_index)),
        mean_damage_index: known(sum / f64::from(count)),
        region_index: known(first.region_index),
        p_value: known(first.region_p_value),
        offset_best_mm: known(first.offset_best_mm),
        offset_low_mm: known(first.offset_low_mm),
        offset_high_mm: known(first.offset_high_mm),
        extent_locations,
        // A step is a difference of two angles: to a millionth of a degree.
        extent_deg: part_deg.map(|part_deg| (f64::from(extent_locations) * part_deg * 1e6).round() / 1e6),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn cells(labels: &[u32]) -> Vec<DamageCell> {
        let cell = |(location, &region): (u32, &u32)| DamageCell {
            location,
            region,
            angle_deg: 36.0 * f64::from(location),
            damage_index: f64::from(region * 10 + location),
            ..DamageCell::default()
        };
        (0..).zip(labels).map(cell).collect()
    }

    /// Catches a region cut at the seam of a ring, and one joined across the ends of a line.
    #[test]
    fn a_ring_has_no_ends() {
        let map = cells(&[1, 1, 0, 2, 2, 2, 0, 0, 1, 1]);
        let ring = regions(Geometry::Ring, &map);
        assert_eq!(
            ring.iter().map(|r| (r.region, r.first_location, r.last_location)).collect::<Vec<_>>(),
            [(2, 3, 5), (1, 8, 1)]
        );
        assert_eq!((ring[1].start_deg, ring[1].end_deg), (Some(288.0), Some(36.0)));
        assert_eq!((ring[1].extent_locations, ring[1].extent_deg), (4, Some(144.0)));
        assert_eq!((ring[1].peak_location, ring[1].peak_damage_index), (9, Some(19.0)));
        let line = regions(Geometry::Line, &map);
        assert_eq!(line.len(), 3);
        assert_eq!(line[0].extent_deg, None);
    }

    /// Catches an absent index taken for a peak, or hiding one.
    #[test]
    fn an_absent_index_is_no_peak() {
        let mut map = cells(&[1, 1, 1, 0]);
        map[0].damage_index = f64::NAN;
        map[2].damage_index = f64::NAN;
        let found = regions(Geometry::Ring, &map)[0];
        assert_eq!((found.peak_location, found.peak_damage_index), (1, Some(11.0)));
        map[1].damage_index = f64::NAN;
        assert_eq!(regions(Geometry::Ring, &map)[0].peak_damage_index, None);
    }

    /// Catches a strong crack that is worst at its end: the scores of all its locations are at their bound.
    #[test]
    fn of_equal_locations_the_middle_one_is_the_peak() {
        let mut map = cells(&[1, 1, 0, 0, 0, 0, 0, 1, 1, 1]);
        for location in [0, 1, 8, 9] {
            map[location].damage_index = 20.0;
        }
        assert_eq!(regions(Geometry::Ring, &map)[0].peak_location, 9, "of 8, 9, 0 and 1");
    }

    /// Catches a whole ring counted twice or as no region.
    #[test]
    fn a_whole_ring_is_one_region() {
        let found = regions(Geometry::Ring, &cells(&[1; 10]));
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].first_location, found[0].last_location, found[0].extent_deg), (0, 9, Some(360.0)));
        assert!(regions(Geometry::Ring, &[]).is_empty());
    }

    proptest! {
        /// Catches cells that are lost or counted twice: turning a ring moves its regions and changes nothing else.
        #[test]
        fn turning_a_ring_keeps_its_regions(labels in prop::collection::vec(0..3u32, 1..12), turn in 0..12usize) {
            let extents = |labels: &[u32]| {
                let found = regions(Geometry::Ring, &cells(labels));
                let mut extents: Vec<_> = found.iter().map(|r| (r.region, r.extent_locations)).collect();
                extents.sort_unstable();
                extents
            };
            let mut turned = labels.clone();
            turned.rotate_left(turn % labels.len());
            let before = extents(&labels);
            prop_assert_eq!(&before, &extents(&turned));
            let damaged = labels.iter().filter(|&&label| label != 0).count();
            prop_assert_eq!(before.iter().map(|e| e.1 as usize).sum::<usize>(), damaged);
        }
    }

    /// Half a ring is scanned: a location still counts as its step, not as twice as much.
    #[test]
    fn the_extent_follows_the_angles() {
        let mut cells = cells(&[0, 0, 1, 1, 1, 0, 0, 0]);
        for (k, cell) in (0..).zip(&mut cells) {
            cell.angle_deg = 3.6 * f64::from(k);
        }
        let found = regions(Geometry::Ring, &cells);
        assert!((found[0].extent_deg.unwrap() - 10.8).abs() < 1e-9, "{found:?}");
        assert_eq!(regions(Geometry::Line, &cells)[0].extent_deg, None);
    }
}
