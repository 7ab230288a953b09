//! Makes a reference from shoulders: learns directions, summarises scales and limits, and signs all of it.

use std::collections::BTreeMap;

use tapline_wire::Discriminator;

use crate::arcs::limits::Limits;
use crate::index::Setup;
use crate::reference::file::{Origin, ReferenceSet};
use crate::reference::fitted::FittedReference;
use crate::reference::known_shoulder::{KnownShoulder, check_shoulders};
use crate::reference::pattern::Pattern;
use crate::reference::standing_out::standing_out;
use crate::reference::summary::{ScaleLine, Summary};
use crate::shoulder::velocity::Normalisation;
use crate::shoulder::{Shoulder, Turn};
use crate::stats::{auc, mean, mean_and_sd, median};
use crate::{Direction, Directions, Error, FuseConfig, IndexKind, index};

/// Fewest locations of each class from which a direction is learned.
const CLASS_MIN: usize = 20;

/// Standard errors by which an AUC must differ from a half for its direction to be learned.
const SURE_AT: f64 = 3.0;

/// What a reference is made of.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Built {
    /// The discriminators in the summary, their directions, and the rates of false calls.
    pub config: FuseConfig,
    /// Archives the shoulders come from.
    pub lineage: Vec<Origin>,
    /// How the discriminators were extracted: the table `[process]` as TOML, every default spelled out.
    pub process: String,
    /// Whether directions are learned from labels, if these suffice; else they are those of `config`.
    pub learns_directions: bool,
}

/// The reference that `shoulders` make.
///
/// # Errors
/// [`Error::NotAReference`] of no shoulders, of ones whose columns do not fit each other or that come twice, and of ones that the default
/// index has no limits by.
pub fn build_reference(of: &Built, shoulders: Vec<KnownShoulder>) -> Result<ReferenceSet, Error> {
    let refuse = |reason: &str| Error::NotAReference { reason: reason.to_owned() };
    check_shoulders(&shoulders)?;
    let mut set = ReferenceSet::of(shoulders, of.config.directions);
    set.lineage.clone_from(&of.lineage);
    set.process.clone_from(&of.process);
    set.check_rings()?;
    let pattern = Pattern::of_all(&set);
    let known = set.shoulders_like(&pattern, &Normalisation::default());
    let learned = learned(&pattern, &known, of.config.directions);
    set.auc = learned.iter().map(|(which, found)| (which.name().to_owned(), found.auc)).collect();
    if of.learns_directions {
        for (&which, found) in learned.iter().filter(|(_, found)| found.is_sure) {
            let rises = found.auc >= 0.5;
            set.directions.set(which, if rises { Direction::Rises } else { Direction::Falls });
            set.learned.push(which);
        }
    }
    let config = FuseConfig { index: IndexKind::default(), directions: set.directions, ..of.config.clone() };
    config.validate()?;
    let setup = Setup::new(&config, &pattern.conditions, false, false);
    // The result is cached: a scan like the reference's own needs the same.
    let offsets = pattern.conditions.offsets_inwards();
    let fitted = set.fitted(&setup, &offsets, &pattern, &Normalisation::default());
    let fitted = fitted.ok_or_else(|| refuse("its sound locations are too few, or their values do not vary"))?;
    set.summary = summed_up(&config, &pattern, &known, &fitted);
    let casings = set.casings();
    set.summary.standing_out =
        standing_out(&fitted, &known).into_iter().map(|number| casings[number].to_owned()).collect();
    Ok(set.signed())
}

/// What labels show of one discriminator.
struct LabelAuc {
    /// Probability that it is greater at a cracked location than at a sound one.
    auc: f64,
    /// Whether that differs from a half by more than chance.
    is_sure: bool,
}

fn learned(pattern: &Pattern, shoulders: &[Shoulder], directions: Directions) -> BTreeMap<Discriminator, LabelAuc> {
    let config = FuseConfig { discriminators: Discriminator::ALL.to_vec(), directions, ..FuseConfig::default() };
    let setup = Setup::new(&config, &pattern.conditions, false, false);
    let all: Vec<&Shoulder> = shoulders.iter().collect();
    let sound: Vec<Vec<bool>> = all.iter().map(|shoulder| shoulder.sound()).collect();
    let Some(index) = index::fit(&setup, &all, &sound) else { return BTreeMap::new() };
    let mut all_seen: Vec<LabelledScores> = vec![LabelledScores::default(); Discriminator::COUNT];
    for casing in all.chunk_by(|a, b| a.casing == b.casing) {
        for (shoulder, found) in casing.iter().zip(index.scores(casing)) {
            for (d, seen) in all_seen.iter_mut().enumerate() {
                seen.add(shoulder, &|place| found.by_discriminator[place][d]);
            }
        }
    }
    let learn = |(which, seen): (Discriminator, LabelledScores)| {
        let LabelledScores { scores, labels, crack_count } = seen;
        let cracked = labels.iter().filter(|&&label| label).count();
        let sound = labels.len() - cracked;
        let signed = auc(&scores, &labels)?;
        let rising = if directions.of(which) == Direction::Rises { signed } else { 1.0 - signed };
        // For scores that say nothing, the AUC has the variance (m + n + 1)/(12 m n) (Mann and Whitney 1947). Neighbours are alike, damaged
        // or not: the locations of a crack count as one.
        let (m, n) = (f64::from(crack_count), sound as f64);
        let error = ((m + n + 1.0) / (12.0 * m * n)).sqrt();
        let is_sure = cracked >= CLASS_MIN && sound >= CLASS_MIN && (rising - 0.5).abs() > SURE_AT * error;
        Some((which, LabelAuc { auc: rising, is_sure }))
    };
    Discriminator::ALL.into_iter().zip(all_seen).filter_map(learn).collect()
}

/// What labelled locations have of one discriminator.
#[derive(Debug, Clone, Default)]
struct LabelledScores {
    scores: Vec<f64>,
    /// Whether each is cracked.
    labels: Vec<bool>,
    crack_count: u32,
}

impl LabelledScores {
    /// Adds the locations of `shoulder` that have a label and a score.
    fn add(&mut self, shoulder: &Shoulder, score: &impl Fn(usize) -> f64) {
        let label = |place: usize| shoulder.is_cracked[place].filter(|_| score(place).is_finite());
        for (place, label) in (0..shoulder.place_count()).filter_map(|place| Some((place, label(place)?))) {
            self.scores.push(score(place));
            self.labels.push(label);
        }
        let numbers = shoulder.ring.numbered(|place| label(place) == Some(true));
        self.crack_count += numbers.into_iter().max().unwrap_or(0);
    }
}

fn summed_up(config: &FuseConfig, pattern: &Pattern, shoulders: &[Shoulder], fitted: &FittedReference) -> Summary {
    let mut scales = Vec::new();
    for condition in 0..pattern.conditions.count() {
        let (offset_mm, velocity_m_per_s) = pattern.conditions.name(condition);
        let turns = || shoulders.iter().flat_map(|shoulder| &shoulder.turns).filter(|turn| turn.condition == condition);
        for (d, &discriminator) in config.discriminators.iter().enumerate() {
            let median_of =
                |values: Vec<f64>| median(&mut values.into_iter().filter(|x| x.is_finite()).collect::<Vec<_>>());
            let values = |turn: &Turn| turn.values.iter().filter_map(|v| v.get(discriminator)).collect();
            let level = median_of(turns().filter_map(|turn| median_of(values(turn))).collect());
            // The turns of a casing are alike.
            let of_casing = |casing: &[Shoulder]| {
                let turns =
                    casing.iter().flat_map(|shoulder| &shoulder.turns).filter(|turn| turn.condition == condition);
                mean(turns.filter_map(|turn| median_of(turn.log(discriminator).to_vec())))
            };
            let logs: Vec<f64> = shoulders.chunk_by(|a, b| a.casing == b.casing).filter_map(of_casing).collect();
            let level_spread = mean_and_sd(&logs).filter(|_| logs.len() > 2).map(|(_, sd)| sd);
            let Some((level, spread)) = level.zip(fitted.index.sigma(condition, d)) else { continue };
            // The logarithm of a ratio is that of x/(1-x), which changes by dx/(x (1-x)).
            let of_value = if discriminator == Discriminator::Pr { 1.0 - level } else { 1.0 };
            let (spread, level_spread) = (spread * of_value, level_spread.map(|sd| sd * of_value));
            scales.push(ScaleLine { offset_mm, velocity_m_per_s, discriminator, level, spread, level_spread });
        }
    }
    let places = || shoulders.iter().flat_map(|shoulder| &shoulder.is_cracked);
    let cracked_count = places().filter(|&&label| label == Some(true)).count();
    Summary {
        scales,
        discriminators: config.discriminators.iter().map(|which| which.name().to_owned()).collect(),
        sound_count: places().count() - cracked_count,
        cracked_count,
        casing_count: fitted.casing_count,
        supported_rate: fitted.supported_rate(),
        strongest: fitted.strongest.iter().map(|(_, value)| *value).collect(),
        standing_out: Vec::new(),
        re_inspect_rate: config.re_inspect_rate,
        reject_rate: config.reject_rate,
        limit_re_inspect: fitted.limits.at(config.re_inspect_rate),
        limit_reject: fitted.limits.at(config.reject_rate),
        limit_of_noise: (fitted.casing_count > 1)
            .then(|| Limits::of_noise(fitted.casing_count, fitted.white).at(config.re_inspect_rate)),
    }
}
