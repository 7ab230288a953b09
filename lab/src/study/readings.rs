//! Every set with different readings of the same records: the effect of their length.

use anyhow::Result;
use tapline_fuse::FuseConfig;
use tapline_model::SimulationConfig;

use super::candidates::Split;
use super::judge::judge;
use super::parallel::each;
use super::sets::{Set, sets};
use super::size::Size;
use crate::evaluation::Areas;
use crate::simulated::Reading;

/// A set's name, and its areas by reading, then by seed.
pub(crate) type AreasOfSet = (&'static str, Vec<Vec<Areas>>);

/// The areas of the default index by the healthy reference, of each set, in records of `sample_count` samples. `tyres` is how many a
/// set has.
pub(crate) fn by_readings(
    readings: &[Reading],
    sample_count: u32,
    tyres: usize,
    seeds: impl Iterator<Item = u64>,
) -> Result<Vec<AreasOfSet>> {
    let size = Size::full_study(tyres);
    let sets: Vec<Set> = sets()
        .into_iter()
        .map(|set| Set { simulation: SimulationConfig { sample_count, ..set.simulation }, ..set })
        .collect();
    let mut found: Vec<AreasOfSet> = sets.iter().map(|set| (set.name, vec![Vec::new(); readings.len()])).collect();
    for seed in seeds {
        for ((number, set), (_, by_reading)) in (0..).zip(&sets).zip(&mut found) {
            let splits = Split::scan_read(set, number, &size, seed, readings)?;
            let areas = each(&splits, |split| {
                Ok(Areas::new(&judge(&FuseConfig::default(), &split.judged()?, Some(&split.healthy()?))?))
            })?;
            by_reading.iter_mut().zip(areas).for_each(|(of_reading, areas)| of_reading.push(areas));
        }
    }
    Ok(found)
}
