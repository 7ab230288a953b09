//! Which offset sees a region best, how far across the shoulder it reaches, and how rare such an arc is on a sound ring.

use tapline_wire::{DamageCell, Geometry};

use crate::arc_null::ArcNull;
use crate::compare::Compared;
use crate::scan::{background, scan};
use crate::shuffles::KnownShuffles;
use crate::stats::Spread;
use crate::{Error, Fusion, IndexKind};

/// A region reaches across to every offset at which it shows at least this part of what it shows at the best.
const REACH_PART: f64 = 0.5;

/// A location speaks for its region from this part of what the highest one of it shows. The step along the ring takes sound
/// neighbours in, whose scatter is not to decide between offsets.
const CORE_PART: f64 = 0.5;

/// Offsets that show this part of the most show it alike.
const ALIKE_PART: f64 = 0.98;

/// Fills in what `cells` say of their regions; the chance that a sound ring has an arc like the one that stands out most.
///
/// The ring outside of the regions is the background that chances are taken from: an arc that is real would come together
/// again in its own permutations.
pub(crate) fn mark_regions(
    compared: &Compared,
    regions: &[u32],
    cells: &mut [DamageCell],
    shuffles: &mut KnownShuffles,
) -> Option<f64> {
    // Arcs go over the seam only where the ends meet.
    let geometry = if compared.ring.is_closed() { Geometry::Ring } else { Geometry::Line };
    let Spread { centre, sigma } = compared.standard.fit.usual()?;
    let z: Vec<Option<f64>> =
        compared.map().locations.iter().map(|l| l.value.map(|value| (value - centre) / sigma)).collect();
    let outside: Vec<Option<f64>> = z.iter().zip(regions).map(|(z, &region)| z.filter(|_| region == 0)).collect();
    let background = background(&outside);
    let shuffles = shuffles.of(background.len());
    let null = ArcNull::of(&background, geometry, &shuffles);
    let p_value = |value: f64| {
        let count = null.len();
        (count > 0).then(|| (null.at_least(value) + 1) as f64 / (count + 1) as f64)
    };
    for region in 1..=regions.iter().copied().max().unwrap_or(0) {
        let places: Vec<usize> = (0..regions.len()).filter(|&place| regions[place] == region).collect();
        let (sum, count) = places.iter().filter_map(|&p| z[p]).fold((0.0, 0.0), |(s, n), z| (s + z, n + 1.0));
        let chance = if count > 0.0 { p_value(sum / f64::sqrt(count)) } else { None };
        let most = places.iter().filter_map(|&place| z[place]).max_by(f64::total_cmp);
        let is_core = |&place: &usize| matches!((z[place], most), (Some(z), Some(most)) if z >= CORE_PART * most);
        let across = across(compared, &places.iter().copied().filter(is_core).collect::<Vec<usize>>());
        for place in places {
            let cell = &mut cells[place];
            cell.region_p_value = chance.unwrap_or(f64::NAN);
            if let Some((best, low, high)) = across {
                (cell.offset_best_mm, cell.offset_low_mm, cell.offset_high_mm) = (best, low, high);
            }
        }
    }
    p_value(scan(&z, geometry)?.value)
}

/// The offset at which `places` show most, and the least and the greatest at which they show half of that.
///
/// Of offsets that show it alike, as all do where scores are at their clip, the one nearest to the belt edge counts: that
/// is where such cracks begin.
fn across(compared: &Compared, places: &[usize]) -> Option<(f64, f64, f64)> {
    let mut by_offset = compared.by_offset(places);
    by_offset.sort_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
    let most = by_offset.iter().map(|&(_, value)| value).max_by(f64::total_cmp)?;
    let best_mm = by_offset.iter().find(|&&(_, value)| value >= ALIKE_PART * most)?.0;
    let seen = by_offset.iter().filter(|&&(_, value)| value >= REACH_PART * most).map(|&(offset_mm, _)| offset_mm);
    let (low, high) = seen
        .fold((best_mm, best_mm), |(low, high), x| (if x < low { x } else { low }, if x > high { x } else { high }));
    Some((best_mm, low, high))
}

/// The index of every location of a shoulder at one offset alone; `None` where it has none there.
#[derive(Debug, Clone, PartialEq)]
pub struct OffsetMap {
    /// Offset from the belt edge, mm.
    pub offset_mm: f64,
    /// In the order of the locations, on the scale of the damage index.
    pub index: Vec<Option<f64>>,
}

impl Fusion {
    /// The index of every location of scan number `scan` at each offset that is known alone, in the order of the locations
    /// and on the scale of the damage index: what a scan at that offset only would have shown. With whatever has come.
    ///
    /// # Errors
    /// [`Error::NoSuchScan`].
    pub fn by_offset(&mut self, scan: usize) -> Result<Vec<OffsetMap>, Error> {
        self.check(scan)?;
        let compared = self.compared(scan);
        let map = |(number, mm): (usize, Option<f64>)| {
            let asked = |condition| compared.conditions.offset_of(condition) == number;
            let values = compared.standard.fit.only(&compared.map().locations, asked);
            let is_faithful = self.config.index == IndexKind::Dissertation;
            let index = if is_faithful { values } else { compared.ring.mean_of_3(&values) };
            Some(OffsetMap { offset_mm: mm?, index })
        };
        let mut maps: Vec<OffsetMap> =
            compared.conditions.offsets_mm().into_iter().enumerate().filter_map(map).collect();
        maps.retain(|map| map.index.iter().any(Option::is_some));
        maps.sort_by(|a, b| a.offset_mm.total_cmp(&b.offset_mm));
        Ok(maps)
    }
}

impl Compared {
    /// Mean index of `places` at each offset that is known, over its velocities, above that of sound places; offsets in mm.
    pub(crate) fn by_offset(&self, places: &[usize]) -> Vec<(f64, f64)> {
        let locations = &self.map().locations;
        let spreads = self.standard.fit.by_condition();
        let value_at = |offset: usize| {
            let conditions = (0..spreads.len()).filter(|&c| self.conditions.offset_of(c) == offset);
            let z = conditions.flat_map(|c| {
                let spread = spreads[c];
                places.iter().filter_map(move |&place| Some(locations[place].by_condition[c]? - spread?.centre))
            });
            let (sum, count) = z.fold((0.0, 0_u32), |(sum, count), z| (sum + z, count + 1));
            (count > 0).then(|| sum / f64::from(count)).filter(|mean| mean.is_finite())
        };
        let offsets = self.conditions.offsets_mm();
        offsets.into_iter().enumerate().filter_map(|(number, mm)| Some((mm?, value_at(number)?))).collect()
    }
}
