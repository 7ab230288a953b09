//! The damage index of each offset alone: where beside the belt edge a crack is heard best.

use std::collections::BTreeMap;

use tapline_fuse::{FuseConfig, Fusion};
use tapline_store::Reader;
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
/// An offset is judged as the whole is, by a fusion that knows of no other taps: by its own reference, so that its
/// limits are its own too, while the index has the same unit everywhere. A configuration that the plan does not fit
/// makes no map.
pub(super) fn maps(reader: &Reader, config: &FuseConfig, found: &[Option<Discriminators>]) -> Vec<Vec<OffsetMap>> {
    let plan = reader.plan();
    let mut offsets_mm: Vec<f64> = plan.taps().iter().filter_map(|tap| tap.id.offset_mm()).collect();
    offsets_mm.sort_by(f64::total_cmp);
    offsets_mm.dedup_by(|a, b| a.total_cmp(b).is_eq());
    let mut maps = vec![Vec::new(); plan.scans().len()];
    if offsets_mm.len() < 2 {
        return maps;
    }
    for offset_mm in offsets_mm {
        let Some(indices) = indices(plan, config, found, offset_mm) else { continue };
        for (maps, scan) in maps.iter_mut().zip(plan.scans()) {
            let of = |&(location, _): &(u32, Option<f64>)| indices.get(&(scan.tyre, scan.shoulder, location)).copied();
            maps.push(OffsetMap { offset_mm, index: scan.locations.iter().map(of).collect() });
        }
    }
    maps
}

/// What a fusion of the taps at `offset_mm` alone finds.
fn indices(plan: &Plan, config: &FuseConfig, found: &[Option<Discriminators>], offset_mm: f64) -> Option<Indices> {
    let is_here = |tap: &PlannedTap| tap.id.offset_mm().is_some_and(|of_tap| of_tap.total_cmp(&offset_mm).is_eq());
    let here = || plan.taps().iter().zip(found).filter(|(tap, _)| is_here(tap));
    let taps = here().map(|(tap, _)| *tap).collect();
    let part = Plan::new(plan.geometry, plan.recording.clone(), taps, Truth::new()).ok()?;
    let mut fusion = Fusion::new(config, &part).ok()?;
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
