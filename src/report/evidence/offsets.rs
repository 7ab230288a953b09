//! The damage index of each offset by itself: at what distance from the belt edge a crack shows best.

use tapline_fuse::{Fusion, OffsetMap};

/// The maps of each of `scan_count` scans, by number of the scan; none for a scan with fewer than two offsets.
pub(crate) fn maps(fusion: &mut Fusion, scan_count: usize) -> Vec<Vec<OffsetMap>> {
    // A scan that is not in the plan has no map.
    let maps_of = |scan| fusion.by_offset(scan).unwrap_or_default();
    (0..scan_count).map(maps_of).map(|maps| if maps.len() < 2 { Vec::new() } else { maps }).collect()
}

#[cfg(test)]
mod tests {
    use tapline_fuse::{FuseConfig, Reference};
    use tapline_wire::{
        Discriminator, Discriminators, Geometry, Plan, PlannedTap, Purpose, Recording, SampleFormat, Serial, TapId,
        Truth, Values,
    };

    use super::*;

    /// A shoulder tapped at `offsets_mm`. At locations 20 to 25 PR is raised only at 5 mm, and location 30 has no
    /// tap there.
    fn scanned(offsets_mm: &[f64]) -> Fusion {
        let recording = Recording {
            sample_rate_hz: 4e4,
            pre_trigger_samples: 100,
            sample_count_max: 1000,
            sample_format: SampleFormat::I16,
            channels: Vec::new(),
            calibration: tapline_wire::Calibration::stated(),
        };
        let tap = |offset_mm, location| {
            let id = TapId::new(1, Serial::new("A").unwrap(), 1, location).with_offset_mm(Some(offset_mm)).unwrap();
            PlannedTap { id, angle_deg: Some(6.0 * f64::from(location)), purpose: Purpose::Scan }
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
        let config = FuseConfig { discriminators: vec![Discriminator::Pr], ..FuseConfig::by(Reference::Own) };
        let mut fusion = Fusion::new(&config, &plan).unwrap();
        for record in (0..).zip(plan.taps()).filter_map(found) {
            fusion.push(&record).unwrap();
        }
        fusion
    }

    /// Catches mixed-up offsets, rows of an offset mistaken for rows of the plan, and an index without a tap.
    #[test]
    fn each_offset_stands_for_itself() {
        let maps = maps(&mut scanned(&[10.0, 5.0, 0.0]), 1);
        assert_eq!(maps.len(), 1);
        assert_eq!(maps[0].iter().map(|map| map.offset_mm).collect::<Vec<_>>(), [0.0, 5.0, 10.0]);
        for map in &maps[0] {
            let is_raised = map.index[22].unwrap() > 3.0;
            assert_eq!(is_raised, (map.offset_mm - 5.0).abs() < 1e-9, "{map:?}");
            assert_eq!(map.index.len(), 60);
        }
    }

    /// Catches maps of single offsets that repeat the whole.
    #[test]
    fn one_offset_is_the_whole() {
        assert_eq!(maps(&mut scanned(&[5.0]), 1), [vec![]]);
    }
}
