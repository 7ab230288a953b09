//! A reference is made of shoulders: directions learned, scales and limits summed up, all of it signed.

use std::collections::BTreeMap;

use tapline_wire::Discriminator;

use crate::condition::Conditions;
use crate::reference_set::{KnownShoulder, Origin, ReferenceSet};
use crate::reference_summary::{ScaleLine, Summary};
use crate::shoulder::Shoulder;
use crate::standard::Standard;
use crate::velocity::Normalisation;
use crate::{Combine, Direction, Directions, Error, FuseConfig, IndexKind, auc};

/// Fewest locations of each class that a direction is learned from.
const CLASS_MIN: usize = 20;

/// Standard errors by which an AUC must differ from a half for its direction to be learned.
const SURE_AT: f64 = 3.0;

/// What a reference is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Built {
    /// Which discriminators the summary is of, which way they move, the rate of false calls.
    pub config: FuseConfig,
    /// Archives the shoulders come from.
    pub lineage: Vec<Origin>,
    /// How the discriminators were extracted: the table `[process]` as TOML, every default spelled out.
    pub process: String,
    /// Whether directions are learned from labels, where those tell; else they are those of `config`.
    pub learns_directions: bool,
}

/// The reference that `shoulders` make.
///
/// # Errors
/// [`Error::NotAReference`] of no shoulders, and of ones that the default index has no limits by.
pub fn build_reference(of: &Built, shoulders: Vec<KnownShoulder>) -> Result<ReferenceSet, Error> {
    let refuse = |reason: &str| Error::NotAReference { reason: reason.to_owned() };
    if shoulders.is_empty() {
        return Err(refuse("it has no shoulder"));
    }
    let mut set = ReferenceSet::of(shoulders, of.config.directions);
    set.lineage.clone_from(&of.lineage);
    set.process.clone_from(&of.process);
    let conditions = Conditions::of(set.taps());
    let known = set.shoulders_by(&conditions, &Normalisation::default());
    let learned = learned(&conditions, &known, of.config.directions);
    set.auc = learned.iter().map(|(which, found)| (which.name().to_owned(), found.auc)).collect();
    if of.learns_directions {
        for (&which, found) in learned.iter().filter(|(_, found)| found.is_sure) {
            let rises = found.auc >= 0.5;
            set.directions.set(which, if rises { Direction::Rises } else { Direction::Falls });
        }
    }
    let config = FuseConfig {
        index: IndexKind::default(),
        combine: Combine::default(),
        directions: set.directions,
        ..of.config.clone()
    };
    config.validate()?;
    let standard = Standard::stated(&config, &conditions, &known, 0);
    set.summary = summed_up(&config, &conditions, &known, &standard);
    if set.summary.limit_reject.is_none() {
        return Err(refuse("its sound locations are too few, or their index does not vary: it sets no limits"));
    }
    Ok(set.signed())
}

/// What labels tell of one discriminator.
struct Learned {
    /// Chance that it is greater at a cracked location than at a sound one.
    auc: f64,
    /// Whether that differs from a half by more than chance.
    is_sure: bool,
}

fn learned(
    conditions: &Conditions,
    shoulders: &[Shoulder],
    directions: Directions,
) -> BTreeMap<Discriminator, Learned> {
    let config =
        FuseConfig { discriminators: Discriminator::ALL.to_vec(), z_clip: 1e3, directions, ..FuseConfig::default() };
    let standard = Standard::stated(&config, conditions, shoulders, 0);
    let mut scores: Vec<(Vec<f64>, Vec<bool>)> = vec![Default::default(); Discriminator::ALL.len()];
    for (number, shoulder) in shoulders.iter().enumerate() {
        let map = &standard.locations[number];
        for (location, label) in map.iter().zip(&shoulder.is_cracked) {
            for ((scores, labels), score) in scores.iter_mut().zip(&location.by_discriminator) {
                if let (Some(score), Some(label)) = (score, label) {
                    scores.push(*score);
                    labels.push(*label);
                }
            }
        }
    }
    let learn = |(which, (scores, labels)): (Discriminator, (Vec<f64>, Vec<bool>))| {
        let cracked = labels.iter().filter(|&&label| label).count();
        let sound = labels.len() - cracked;
        let signed = auc(&scores, &labels)?;
        let rising = if directions.of(which) == Direction::Rises { signed } else { 1.0 - signed };
        // Of scores that tell nothing the AUC has the variance (m + n + 1)/(12 m n) (Mann and Whitney 1947).
        let (m, n) = (cracked as f64, sound as f64);
        let error = ((m + n + 1.0) / (12.0 * m * n)).sqrt();
        let is_sure = cracked >= CLASS_MIN && sound >= CLASS_MIN && (rising - 0.5).abs() > SURE_AT * error;
        Some((which, Learned { auc: rising, is_sure }))
    };
    Discriminator::ALL.into_iter().zip(scores).filter_map(learn).collect()
}

fn summed_up(config: &FuseConfig, conditions: &Conditions, shoulders: &[Shoulder], standard: &Standard) -> Summary {
    let yardstick = standard.fit.yardstick();
    let named = config.directed();
    let mut scales = Vec::new();
    for condition in 0..conditions.count() {
        let (offset_mm, velocity_m_per_s) = conditions.name(condition);
        for (slot, &(discriminator, _)) in (condition * named.len()..).zip(&named) {
            let Some((spread, level)) = yardstick.sigma(slot).zip(standard.pooled_level(slot)) else { continue };
            let level_spread = standard.level_spread(slot);
            scales.push(ScaleLine { offset_mm, velocity_m_per_s, discriminator, level, spread, level_spread });
        }
    }
    let sound: Vec<Vec<Option<f64>>> = shoulders
        .iter()
        .enumerate()
        .flat_map(|(number, shoulder)| {
            let locations = &standard.locations[number];
            let is_sound = shoulder.sound();
            locations.iter().zip(is_sound).filter(|(_, sound)| *sound).map(|(l, _)| l.by_discriminator.clone())
        })
        .collect();
    let limits = standard.limits;
    Summary {
        scales,
        discriminators: named.iter().map(|(which, _)| which.name().to_owned()).collect(),
        covariance: covariance(&sound, named.len()),
        sound_count: sound.len(),
        cracked_count: shoulders.iter().flat_map(|s| &s.is_cracked).filter(|&&label| label == Some(true)).count(),
        index_centre: limits.map(|l| l.spread.centre),
        index_spread: limits.map(|l| l.spread.sigma),
        index_repeat_sd: standard.repeat_sd,
        limit_re_inspect: limits.map(|l| l.re_inspect),
        limit_reject: limits.map(|l| l.reject()),
        false_call_rate: config.false_call_rate,
    }
}

/// Covariance of each pair of columns over the rows that have both.
fn covariance(rows: &[Vec<Option<f64>>], width: usize) -> Vec<Vec<Option<f64>>> {
    let of = |a: usize, b: usize| {
        let pairs: Vec<(f64, f64)> = rows.iter().filter_map(|row| Some((row[a]?, row[b]?))).collect();
        let n = pairs.len() as f64;
        let (a_mean, b_mean) = (pairs.iter().map(|p| p.0).sum::<f64>() / n, pairs.iter().map(|p| p.1).sum::<f64>() / n);
        let sum: f64 = pairs.iter().map(|p| (p.0 - a_mean) * (p.1 - b_mean)).sum();
        (pairs.len() > 1).then(|| sum / (n - 1.0))
    };
    (0..width).map(|a| (0..width).map(|b| of(a, b)).collect()).collect()
}
