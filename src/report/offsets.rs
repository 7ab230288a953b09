//! The damage index of each offset alone: where beside the belt edge a crack is heard best.

use std::collections::BTreeMap;
use std::sync::Arc;

use tapline_fuse::{FuseConfig, Fusion, ReferenceSet};
use tapline_wire::{Discriminators, Plan, PlannedTap, Serial, Truth};

/// The index of one shoulder at one offset.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct OffsetMap {
    /// Offset from the belt edge, mm.
    pub(super) offset_mm: f64,
    /// Location by location, as the shoulder's cells.
    pub(super) index: Vec<Option<f64>>,
}

/// Index by shoulder and location.
type Indices = BTreeMap<(Serial, u16, u32), f64>;

/// The maps of every scan of the plan, by number of the scan; none where the plan has fewer than two offsets.
///
/// An offset is judged as the whole is, by a fusion that knows of no other taps: by its part of the reference, so that its
/// limits are its own too, while the index has the same unit everywhere. A configuration that the plan does not fit
/// makes no map.
pub(super) fn maps(
    plan: &Plan,
    config: &FuseConfig,
    set: Option<&Arc<ReferenceSet>>,
    found: &[Option<Discriminators>],
) -> Vec<Vec<OffsetMap>> {
    let mut offsets_mm: Vec<f64> = plan.taps().iter().filter_map(|tap| tap.id.offset_mm()).collect();
    offsets_mm.sort_by(f64::total_cmp);
    offsets_mm.dedup_by(|a, b| a.total_cmp(b).is_eq());
    let mut maps = vec![Vec::new(); plan.scans().len()];
    if offsets_mm.len() < 2 {
        return maps;
    }
    for offset_mm in offsets_mm {
        let Some(indices) = indices(plan, config, set, found, offset_mm) else { continue };
        for (maps, scan) in maps.iter_mut().zip(plan.scans()) {
            let of = |&(location, _): &(u32, Option<f64>)| indices.get(&(scan.tyre, scan.shoulder, location)).copied();
            maps.push(OffsetMap { offset_mm, index: scan.locations.iter().map(of).collect() });
        }
    }
    maps
}

/// What a fusion of the taps at `offset_mm` alone finds.
fn indices(
    plan: &Plan,
    config: &FuseConfig,
    set: Option<&Arc<ReferenceSet>>,
    found: &[Option<Discriminators>],
    offset_mm: f64,
) -> Option<Indices> {
    let is_here = |tap: &PlannedTap| tap.id.offset_mm().is_some_and(|of_tap| of_tap.total_cmp(&offset_mm).is_eq());
    let here = || plan.taps().iter().zip(found).filter(|(tap, _)| is_here(tap));
    let taps = here().map(|(tap, _)| *tap).collect();
    let part = Plan::new(plan.geometry, plan.recording.clone(), taps, Truth::new()).ok()?;
    let mut fusion = match set {
        Some(set) => Fusion::with_reference(config, &part, Arc::clone(set)),
        None => Fusion::new(config, &part),
    }
    .ok()?;
    for (plan_index, (_, found)) in (0..).zip(here()) {
        if let Some(found) = found {
            fusion.push(&Discriminators { plan_index, ..*found }).ok()?;
        }
    }
    let mut indices = Indices::new();
    for (number, scan) in part.scans().iter().enumerate() {
        let (_, cells) = fusion.judge(number).ok()?;
        let known = cells.iter().filter(|cell| cell.damage_index.is_finite());
        indices.extend(known.map(|cell| ((scan.tyre, scan.shoulder, cell.location), cell.damage_index)));
    }
    Some(indices)
}

#[cfg(test)]
mod tests {
    use tapline_fuse::Reference;
    use tapline_wire::{Discriminator, Geometry, Recording, SampleFormat, TapId, Values};

    use super::*;

    /// A shoulder tapped at `offsets_mm`; over locations 20 to 25 PR is raised at 5 mm alone, and at 30 there is none.
    fn scanned(offsets_mm: &[f64]) -> (Plan, Vec<Option<Discriminators>>) {
        let recording = Recording {
            sample_rate_hz: 4e4,
            pre_trigger_samples: 100,
            sample_count_max: 1000,
            sample_format: SampleFormat::I16,
            channels: Vec::new(),
        };
        let tap = |offset_mm, location| {
            let id = TapId::new(1, Serial::new("A").unwrap(), 1, location).with_offset_mm(Some(offset_mm)).unwrap();
            PlannedTap { id, angle_deg: Some(6.0 * f64::from(location)), is_closing: false }
        };
        let taps = offsets_mm.iter().flat_map(|&offset_mm| (0..60).map(move |location| tap(offset_mm, location)));
        let plan = Plan::new(Geometry::Ring, recording, taps.collect(), Truth::new()).unwrap();
        let found = |(plan_index, tap): (u32, &PlannedTap)| {
            let location = tap.id.location;
            let is_cracked = (20..=25).contains(&location) && tap.id.offset_mm() == Some(5.0);
            let scatter = f64::from(location * 37 % 61) * 1e-4;
            let mut values = Values::default();
            values.set(Discriminator::Pr, Some(if is_cracked { 0.5 } else { 0.3 } + scatter));
            let found = Discriminators { id: tap.id, plan_index, values, ..Discriminators::default() };
            (location != 30).then_some(found)
        };
        let found = (0..).zip(plan.taps()).map(found).collect();
        (plan, found)
    }

    /// Catches offsets mixed up, rows of the part taken for rows of the whole, and an index for a tap that is not there.
    #[test]
    fn each_offset_stands_for_itself() {
        let config = FuseConfig { discriminators: vec![Discriminator::Pr], ..FuseConfig::by(Reference::Own) };
        let (plan, found) = scanned(&[10.0, 5.0, 0.0]);
        let maps = maps(&plan, &config, None, &found);
        assert_eq!(maps.len(), 1);
        assert_eq!(maps[0].iter().map(|map| map.offset_mm).collect::<Vec<_>>(), [0.0, 5.0, 10.0]);
        for map in &maps[0] {
            let is_raised = map.index[22].unwrap() > 3.0;
            assert_eq!(is_raised, (map.offset_mm - 5.0).abs() < 1e-9, "{map:?}");
            assert_eq!(map.index.len(), 60);
        }
    }

    /// Catches rings that repeat the whole.
    #[test]
    fn one_offset_is_the_whole() {
        let (plan, found) = scanned(&[5.0]);
        assert_eq!(maps(&plan, &FuseConfig::by(Reference::Own), None, &found), [vec![]]);
    }
}
