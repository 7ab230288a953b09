//! Scans of a set, judged by the fusion, with the truth about them.

use std::ops::Range;
use std::sync::Arc;

use anyhow::Result;
use tapline_fuse::{FuseConfig, Fusion, ReferenceSet};
use tapline_wire::{Discriminator, Reasons, Scan};

use super::dataset::Dataset;
use super::scan_taps::{ScanTaps, Times};
use super::scene::Scene;
use super::set::Set;
use crate::shoulder_result::ShoulderResult;

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
    /// What the fusion says of it, and the truth.
    pub result: ShoulderResult,
    /// Time of its casing, s.
    pub scan_s: f64,
    /// Whether a part of it was tapped again.
    pub is_asked: bool,
    /// Reasons for its verdict.
    pub reasons: Reasons,
    /// Mean of three neighbours of each discriminator by itself, in the direction of damage; empty if places were tapped
    /// again.
    pub alone: Vec<Vec<f64>>,
}

impl Judged {
    /// Its locations: the seed, the casing, the index, and whether there is a crack.
    pub(crate) fn places(&self, seed: u64) -> impl Iterator<Item = (u64, String, f64, bool)> + '_ {
        let ShoulderResult { tyre, index, is_cracked, .. } = &self.result;
        index.iter().zip(is_cracked).map(move |(&index, &is_cracked)| (seed, tyre.clone(), index, is_cracked))
    }
}

/// The shoulders that count, for some casings of `set` in `scene`.
///
/// # Errors
/// An error of the fusion, or a set without all taps.
pub fn judge(judging: &Judging, set: &Set, casings: Range<usize>, scene: Scene) -> Result<Vec<Judged>> {
    let mut part = set.part(casings, &judging.taps, scene)?;
    if judging.taps.is_confirmed {
        part = judging.again(set, part)?;
    }
    let mut fusion = part.fusion(&judging.config, judging.reference.as_ref())?;
    let both_count = scene.is_sound() && !scene.changes_a_turn();
    let wanted = part.plan.scans().iter().enumerate().filter(|(_, scan)| both_count || scan.shoulder == 1);
    wanted.map(|(number, scan)| judging.judged(&mut fusion, &part, number, scan)).collect()
}

impl Judging {
    /// Judges scans of `taps`. `known` is a set and how many of its first casings make the reference; these are scanned as by `taps`,
    /// but at every location. Without `known` each casing is compared with itself.
    ///
    /// # Errors
    /// If the set has not all of these taps.
    pub fn new(config: FuseConfig, known: Option<(&Set, usize)>, taps: ScanTaps) -> Result<Self> {
        let reference = |(set, casings): (&Set, usize)| {
            let shape = taps.shape(&set.shape);
            let turns = shape.repetitions / if taps.is_confirmed { 2 } else { 1 };
            let full = ScanTaps::full(&shape.offsets_mm, &shape.velocities_m_per_s, turns);
            set.part(0..casings, &full, Scene::SoundSmooth)?.reference(&config, |_| true)
        };
        let reference = known.map(reference).transpose()?;
        Ok(Self { config, reference, taps, times: Times::default() })
    }

    /// `part` of `set`, with what stands out tapped again.
    fn again(&self, set: &Set, part: Dataset) -> Result<Dataset> {
        let mut fusion = part.fusion(&self.config, self.reference.as_ref())?;
        let mut wanted = Vec::new();
        for casing in (0..part.plan.scans().len()).step_by(2) {
            wanted.extend(fusion.wanted(casing, usize::MAX)?);
        }
        set.again(&wanted, part)
    }

    fn judged(&self, fusion: &mut Fusion, part: &Dataset, number: usize, scan: &Scan) -> Result<Judged> {
        let judged = fusion.judge(number)?;
        let alone = |which| alone(part, scan, which);
        Ok(Judged {
            result: ShoulderResult::new(scan, &judged, part.is_cracked(scan))?,
            scan_s: self.times.of(&part.plan, scan.tyre),
            is_asked: scan.taps.iter().any(|&row| part.plan.taps()[row as usize].is_second_reading()),
            reasons: judged.0.reasons,
            alone: if self.taps.is_confirmed { Vec::new() } else { Discriminator::ALL.map(alone).to_vec() },
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
    let part = set.part(0..set.tyres.len(), taps, scene)?;
    let mut all = Vec::new();
    for scan in part.plan.scans().iter().filter(|scan| scan.shoulder == 1) {
        let places = alone(&part, scan, which).into_iter().zip(part.is_cracked(scan));
        all.extend(places.map(|(score, is_cracked)| (scan.tyre.to_string(), score, is_cracked)));
    }
    Ok(all)
}

/// The mean over turns and three neighbours of one discriminator's logarithm, less each turn's median.
fn alone(Dataset { plan, records }: &Dataset, scan: &Scan, which: Discriminator) -> Vec<f64> {
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
