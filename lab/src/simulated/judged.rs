//! Scans of a set, judged by the fusion, with the truth about them.

use std::ops::Range;
use std::sync::Arc;

use anyhow::{Context as _, Result};
use tapline_fuse::{Built, FuseConfig, Fusion, KnownShoulder, ReferenceSet, build_reference};
use tapline_wire::{Discriminator, Discriminators, Plan, Reasons};

use super::scan_taps::{ScanTaps, Times};
use super::scene::Scene;
use super::set::Set;

/// How casings are scanned and judged.
#[derive(Debug, Clone)]
pub struct Judging {
    /// The rates, the index and other settings of the fusion.
    pub config: FuseConfig,
    /// The sound casings' reference; `None` compares each casing with itself.
    pub reference: Option<Arc<ReferenceSet>>,
    /// The taps of a casing.
    pub taps: ScanTaps,
    /// Times of the rig for them.
    pub times: Times,
}

/// A shoulder that was judged.
#[derive(Debug, Clone)]
pub struct Judged {
    /// Serial number of its casing.
    pub tyre: String,
    /// Side of the casing, 1 or 2.
    pub shoulder: u16,
    /// Time of its casing, s.
    pub scan_s: f64,
    /// Whether a part of it was tapped again.
    pub is_asked: bool,
    /// Code of its [`Verdict`](tapline_wire::Verdict).
    pub verdict: u32,
    /// Reasons for that.
    pub reasons: Reasons,
    /// Evidence of its strongest arc.
    pub strongest_arc: f64,
    /// Damage index of each location; NaN where there is none.
    pub index: Vec<f64>,
    /// Mean of three neighbours of each discriminator by itself, in the direction of damage; empty if places were tapped
    /// again.
    pub alone: Vec<Vec<f64>>,
    /// Whether a crack lies at each location.
    pub is_cracked: Vec<bool>,
}

impl Judged {
    /// Its locations: its casing, named apart from those of other seeds, the index, and whether there is a crack.
    pub(crate) fn places(&self, seed: u64) -> impl Iterator<Item = (String, f64, bool)> + '_ {
        let places = self.index.iter().zip(&self.is_cracked);
        places.map(move |(&index, &is_cracked)| (format!("{seed}-{}", self.tyre), index, is_cracked))
    }
}

/// The reference from the first `casings` of `set`, scanned as by `taps` but at every location.
///
/// # Errors
/// If the set has not all of these taps.
pub fn reference(config: &FuseConfig, set: &Set, casings: usize, taps: &ScanTaps) -> Result<Arc<ReferenceSet>> {
    let shape = taps.shape(&set.shape);
    let turns = shape.repetitions / if taps.is_confirmed { 2 } else { 1 };
    let full = ScanTaps::full(&shape.offsets_mm, &shape.velocities_m_per_s, turns);
    let (plan, records) = set.part(0..casings, &full, Scene::SoundSmooth)?;
    let shoulders = (0..plan.scans().len()).map(|scan| KnownShoulder::of(&plan, &records, scan, None));
    let built = Built { config: config.clone(), ..Built::default() };
    let shoulders: Option<Vec<_>> = shoulders.collect();
    Ok(Arc::new(build_reference(&built, shoulders.context("a shoulder is not planned")?)?))
}

/// The shoulders that count, for some casings of `set` in `scene`.
///
/// # Errors
/// An error of the fusion, or a set without all taps.
pub fn judge(judging: &Judging, set: &Set, casings: Range<usize>, scene: Scene) -> Result<Vec<Judged>> {
    let (mut plan, mut records) = set.part(casings, &judging.taps, scene)?;
    if judging.taps.is_confirmed {
        (plan, records) = judging.again(set, plan, records)?;
    }
    let mut fusion = judging.fusion(&plan, &records)?;
    let both_count = scene.is_sound() && !scene.changes_a_turn();
    let wanted = plan.scans().iter().enumerate().filter(|(_, scan)| both_count || scan.shoulder == 1);
    wanted.map(|(number, _)| judging.judged(&mut fusion, &plan, &records, number)).collect()
}

impl Judging {
    /// `plan` and `records` of a part of `set`, with what stands out tapped again.
    fn again(&self, set: &Set, plan: Plan, mut records: Vec<Discriminators>) -> Result<(Plan, Vec<Discriminators>)> {
        let mut fusion = self.fusion(&plan, &records)?;
        let mut wanted = Vec::new();
        for casing in (0..plan.scans().len()).step_by(2) {
            wanted.extend(fusion.wanted(casing, usize::MAX)?);
        }
        records.extend(set.again(&wanted, &plan)?);
        Ok((plan.grown(&wanted)?, records))
    }

    /// The fusion after all of `records`.
    fn fusion(&self, plan: &Plan, records: &[Discriminators]) -> Result<Fusion> {
        let mut fusion = Fusion::by(&self.config, plan, self.reference.clone())?;
        records.iter().try_for_each(|record| fusion.push(record))?;
        (0..plan.scans().len()).try_for_each(|number| fusion.end(number))?;
        Ok(fusion)
    }

    fn judged(&self, fusion: &mut Fusion, plan: &Plan, records: &[Discriminators], number: usize) -> Result<Judged> {
        let scan = &plan.scans()[number];
        let (judgement, cells) = fusion.judge(number)?;
        let truth = |location| plan.truth().get(&(scan.tyre, scan.shoulder, location)).copied();
        let alone = |which| alone(plan, records, number, which);
        Ok(Judged {
            tyre: scan.tyre.to_string(),
            shoulder: scan.shoulder,
            scan_s: self.times.of(plan, scan.tyre),
            is_asked: scan.taps.iter().any(|&row| plan.taps()[row as usize].is_second_reading()),
            verdict: judgement.verdict,
            reasons: judgement.reasons,
            strongest_arc: judgement.strongest_arc,
            index: cells.iter().map(|cell| cell.damage_index).collect(),
            alone: if self.taps.is_confirmed { Vec::new() } else { Discriminator::ALL.map(alone).to_vec() },
            is_cracked: cells.iter().map(|cell| truth(cell.location).unwrap_or(false)).collect(),
        })
    }
}

/// What `which` alone says of every location of the cracked shoulders of `set`: the casing's serial, the mean over turns and three
/// neighbours, and whether there is a crack.
///
/// # Errors
/// If the set has not all of these taps.
pub(crate) fn alone_of(
    set: &Set,
    taps: &ScanTaps,
    scene: Scene,
    which: Discriminator,
) -> Result<Vec<(String, f64, bool)>> {
    let (plan, records) = set.part(0..set.tyres.len(), taps, scene)?;
    let mut all = Vec::new();
    for (number, scan) in plan.scans().iter().enumerate().filter(|(_, scan)| scan.shoulder == 1) {
        for ((location, _), score) in scan.locations.iter().zip(alone(&plan, &records, number, which)) {
            let is_cracked = plan.truth().get(&(scan.tyre, scan.shoulder, *location)).copied().unwrap_or(false);
            all.push((scan.tyre.to_string(), score, is_cracked));
        }
    }
    Ok(all)
}

/// The mean over turns and three neighbours of one discriminator's logarithm, less each turn's median.
fn alone(plan: &Plan, records: &[Discriminators], scan: usize, which: Discriminator) -> Vec<f64> {
    let scan = &plan.scans()[scan];
    let count = scan.locations.len();
    let place_of = |row: u32| {
        let location = plan.taps()[row as usize].id.location;
        scan.locations.binary_search_by_key(&location, |&(location, _)| location).ok()
    };
    let mut sums = vec![(0.0, 0.0); count];
    let is_same_turn = |a: &u32, b: &u32| {
        let [a, b] = [a, b].map(|&row| plan.taps()[row as usize].id);
        (a.offset_mm(), a.velocity_m_per_s(), a.repetition) == (b.offset_mm(), b.velocity_m_per_s(), b.repetition)
    };
    for turn in scan.taps.chunk_by(is_same_turn) {
        let logs: Vec<f64> = turn
            .iter()
            .map(|&row| records[row as usize].values.get(which).filter(|&x| x > 0.0).map_or(f64::NAN, f64::ln))
            .collect();
        let mut sorted: Vec<f64> = logs.iter().copied().filter(|x| x.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let Some(&median) = sorted.get(sorted.len() / 2) else { continue };
        for (&row, log) in turn.iter().zip(logs).filter(|(_, log)| log.is_finite()) {
            let Some(sum) = place_of(row).map(|place| &mut sums[place]) else { continue };
            *sum = (sum.0 + which.direction().sign() * (log - median), sum.1 + 1.0);
        }
    }
    let at = |place: usize| sums[place % count];
    let mean = |place: usize| {
        let three = [at(place + count - 1), at(place), at(place + 1)];
        three.iter().map(|s| s.0).sum::<f64>() / three.iter().map(|s| s.1).sum::<f64>()
    };
    (0..count).map(mean).collect()
}
