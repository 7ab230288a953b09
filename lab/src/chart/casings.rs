//! The simulated casings that several panels judge: both simulators, smooth and rough populations, sound ones and cracked ones.

use anyhow::{Context as _, Result};
use rayon::prelude::*;
use tapline_plate::ScanShape;
use tapline_wire::Verdict;

use super::Bench;
use super::point::{Error, Failure, LEVEL, exceeds};
use super::size::Size;
use crate::evaluation::Areas;
use crate::simulated::{Judged, Judging, Reading, Scene, Set, Simulator, Tyre, judge, simulate};
use crate::statistics::clopper_pearson;

/// Offsets of the full plan, from the belt edge.
pub(crate) const OFFSETS_MM: [f64; 4] = [0.0, 5.0, 10.0, 15.0];
/// Velocities of the full plan.
pub(crate) const VELOCITIES_M_PER_S: [f64; 3] = [1.2, 1.5, 1.85];
/// The velocity wherever it is not varied.
pub(crate) const VELOCITY_M_PER_S: f64 = 1.85;

/// Populations: the sound scene, and the cracked ones of the same population.
const POPULATIONS: [(Scene, [Scene; 2]); 2] = [
    (Scene::SoundSmooth, [Scene::FaintSmooth, Scene::StrongSmooth]),
    (Scene::SoundRough, [Scene::FaintRough, Scene::StrongRough]),
];

/// The casings of one simulator, population and seed.
#[derive(Debug)]
pub(crate) struct Group {
    pub simulator: Simulator,
    pub seed: u64,
    /// Sound casings that references are made of.
    pub reference: Set,
    /// What is judged: a scene with its casings. The first is sound.
    pub judged: Vec<(Scene, Set)>,
}

/// Seconds that they are expected to take on two cores.
pub(crate) fn expected_s(size: &Size) -> f64 {
    let casings = size.casings.reference + size.casings.sound + 2 * size.casings.cracked;
    let taps = casings as f64 * if size.is_full { 4800.0 } else { 1600.0 };
    2.5e-5 * taps * (Simulator::ALL.len() * populations(size).len()) as f64 * size.seed_count as f64
}

/// The populations; a short chart has only the smooth one.
fn populations(size: &Size) -> &'static [(Scene, [Scene; 2])] {
    if size.is_full { &POPULATIONS } else { &POPULATIONS[..1] }
}

/// All groups. Their taps are those of the full plan, recorded for 0.05 s.
pub(crate) fn groups(bench: &Bench) -> Result<Vec<Group>> {
    let casings = bench.size.casings;
    let shape = ScanShape {
        offsets_mm: OFFSETS_MM.to_vec(),
        velocities_m_per_s: if bench.size.is_full { VELOCITIES_M_PER_S.to_vec() } else { vec![VELOCITY_M_PER_S] },
        repetitions: 2,
        ..ScanShape::default()
    };
    let mut groups = Vec::new();
    let populations = populations(&bench.size);
    for simulator in Simulator::ALL {
        for &(sound, cracked) in populations {
            for seed in bench.seeds() {
                let set = |scene: Scene, tyres: Vec<Tyre>| {
                    let sets = simulate(simulator, scene, &shape, &tyres, seed, &[Reading::default()])?;
                    sets.into_iter().next().context("there is one reading")
                };
                let tyres = |scene: Scene, count| scene.tyres(shape.location_count, count, seed);
                let reference = (0..casings.reference).map(|k| Tyre::sound(format!("reference-{k:03}"))).collect();
                let mut judged = vec![(sound, set(sound, tyres(sound, casings.sound))?)];
                for scene in cracked {
                    judged.push((scene, set(scene, tyres(scene, casings.cracked))?));
                }
                groups.push(Group { simulator, seed, reference: set(sound, reference)?, judged });
            }
        }
    }
    Ok(groups)
}

/// The judged shoulders of a seed: sound and cracked ones.
#[derive(Debug, Clone)]
pub(crate) struct Inspected {
    pub seed: u64,
    pub sound: Vec<Judged>,
    pub cracked: Vec<Judged>,
}

/// How a configuration judges one group.
pub(crate) type Configure<'a> = dyn Fn(&Group) -> Result<Judging> + Sync + 'a;

/// The shoulders of every group of `simulator`, judged as `configure` says.
pub(crate) fn inspect(groups: &[Group], simulator: Simulator, configure: &Configure<'_>) -> Result<Vec<Inspected>> {
    let of_group = |group: &Group| {
        let judging = configure(group)?;
        let mut inspected = Inspected { seed: group.seed, sound: Vec::new(), cracked: Vec::new() };
        for (scene, set) in &group.judged {
            let judged = judge(&judging, set, 0..set.tyres.len(), *scene)?;
            if scene.is_sound() { &mut inspected.sound } else { &mut inspected.cracked }.extend(judged);
        }
        Ok(inspected)
    };
    let of_simulator: Vec<&Group> = groups.iter().filter(|group| group.simulator == simulator).collect();
    of_simulator.into_par_iter().map(of_group).collect()
}

/// The rate, in per cent, at which `is_it` holds for shoulders that `of` selects: over all, with an exact interval, and by seed. A
/// shoulder without an answer does not count.
pub(crate) fn rate_percent(
    inspected: &[Inspected],
    of: impl Fn(&Inspected) -> &[Judged],
    is_it: impl Fn(&Judged) -> Option<bool>,
) -> Result<Error> {
    let mut seeds: Vec<u64> = inspected.iter().map(|i| i.seed).collect();
    seeds.sort_unstable();
    seeds.dedup();
    let counts = |seed: Option<u64>| {
        let shoulders = inspected.iter().filter(|i| seed.is_none_or(|seed| seed == i.seed)).flat_map(&of);
        let answers = shoulders.filter_map(&is_it);
        answers.fold((0_usize, 0_usize), |(count, all), is_it| (count + usize::from(is_it), all + 1))
    };
    let (count, all) = counts(None);
    let rate = clopper_pearson(count, all, LEVEL)?;
    let percent = |(count, all): (usize, usize)| 100.0 * count as f64 / all as f64;
    let by_seed = seeds.into_iter().map(|seed| percent(counts(Some(seed)))).collect();
    Ok(Error { value: 100.0 * rate.rate, low: 100.0 * rate.low, high: 100.0 * rate.high, by_seed })
}

/// A place that is ranked: its seed, its casing, a score, and whether there is a crack.
pub(crate) type Place = (u64, String, f64, bool);

/// The areas of those of `places` that are of `seed`, or of all.
pub(crate) fn areas_of(places: &[Place], seed: Option<u64>) -> Areas {
    let of_seed = places.iter().filter(|(of, ..)| seed.is_none_or(|seed| seed == *of));
    Areas::of(of_seed.map(|(seed, tyre, score, is_cracked)| (format!("{seed}-{tyre}"), *score, *is_cracked)))
}

/// Loss of detection, 1 - AUC: of `places` of all seeds, with an interval by whole tyres, and of those of each seed; and the number of
/// places.
pub(crate) fn loss(bench: &Bench, places: &[Place]) -> Result<(Error, usize)> {
    let loss = |areas: &Areas| Ok(1.0 - areas.auc().context("locations of both kinds have a score")?);
    let all = areas_of(places, None);
    let by_seed = bench.seeds().map(|seed| loss(&areas_of(places, Some(seed)))).collect::<Result<_>>()?;
    let interval = all.by_tyres(bench.seed).map(|(low, high)| (1.0 - high, 1.0 - low));
    let error = Error { value: loss(&all)?, ..Error::mean_of(by_seed) }.with_interval(interval);
    Ok((error, all.count(true) + all.count(false)))
}

/// Cracked shoulders that pass.
pub(crate) fn missed_percent(inspected: &[Inspected]) -> Result<Error> {
    rate_percent(inspected, |i| &i.cracked, |judged| Some(judged.result.verdict == Verdict::Pass))
}

/// Sound shoulders that do not pass.
pub(crate) fn called_percent(inspected: &[Inspected]) -> Result<Error> {
    rate_percent(inspected, |i| &i.sound, |judged| Some(judged.result.verdict != Verdict::Pass))
}

/// The failure if `called`, in per cent, significantly exceeds the stated rate of false calls.
pub(crate) fn false_call_failure(called: &Error, stated: f64) -> Option<Failure> {
    exceeds("stated rate of false calls, %: lower end of what was measured", called.low, 100.0 * stated)
}
