//! How well the index and each discriminator separate cracked from sound locations whose truth is known.

use tapline_wire::{Discriminator, Discriminators};

use crate::{Error, FuseConfig, Fusion};

/// Areas under the ROC curve over all locations whose truth is known, all shoulders pooled.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// Of the damage index as configured; `None` when one class is empty.
    pub index: Option<f64>,
    /// Of each discriminator alone, in the order of [`Discriminator::ALL`], configured for the index or not: mean score of a
    /// location and its neighbours, signed by the configured direction. Below 0.5 the direction is wrong.
    pub discriminators: [Option<f64>; Discriminator::COUNT],
    /// Cracked locations that have an index.
    pub cracked_count: u32,
    /// Sound locations that have an index.
    pub sound_count: u32,
}

/// Values of the locations of many casings, each with whether it is cracked, to be scored together.
#[derive(Debug, Clone, Default)]
pub struct ScorePool {
    index: (Vec<f64>, Vec<bool>),
    alone: [(Vec<f64>, Vec<bool>); Discriminator::COUNT],
}

impl ScorePool {
    /// Adds the locations of the plan of `fusion` whose truth is known, by `records`.
    ///
    /// # Errors
    /// What [`Fusion::push`] refuses.
    pub fn add(&mut self, mut fusion: Fusion, records: &[Discriminators]) -> Result<(), Error> {
        for record in records {
            fusion.push(record)?;
        }
        let extend = |pool: &mut (Vec<f64>, Vec<bool>), (values, labels): (Vec<f64>, Vec<bool>)| {
            pool.0.extend(values);
            pool.1.extend(labels);
        };
        extend(&mut self.index, pooled(&mut fusion, |fusion, scan| Ok(fusion.index_of(scan)))?);
        let discriminators = Discriminator::ALL.to_vec();
        let mut all = fusion.reconfigured(FuseConfig { discriminators, ..fusion.config.clone() });
        for (which, alone) in Discriminator::ALL.into_iter().zip(&mut self.alone) {
            extend(alone, pooled(&mut all, |fusion, scan| fusion.alone(scan, which))?);
        }
        Ok(())
    }

    /// The score of all that was added.
    pub fn score(&self) -> Score {
        let (index, labels) = &self.index;
        let counted = |class: bool| index.iter().zip(labels).filter(|&(i, &l)| !i.is_nan() && l == class).count();
        let count = |class: bool| u32::try_from(counted(class)).unwrap_or(u32::MAX);
        Score {
            index: auc(index, labels),
            discriminators: self.alone.each_ref().map(|(values, labels)| auc(values, labels)),
            cracked_count: count(true),
            sound_count: count(false),
        }
    }
}

/// Values of all locations whose truth is known, NaN where there is none, and whether each is cracked.
fn pooled(
    fusion: &mut Fusion,
    values_of: impl Fn(&mut Fusion, usize) -> Result<Vec<f64>, Error>,
) -> Result<(Vec<f64>, Vec<bool>), Error> {
    let mut pool = (Vec::new(), Vec::new());
    for number in 0..fusion.plan.scans().len() {
        let values = values_of(fusion, number)?;
        let (plan, scan) = (&fusion.plan, &fusion.plan.scans()[number]);
        for (&(location, _), value) in scan.locations.iter().zip(values) {
            if let Some(&is_cracked) = plan.truth().get(&(scan.tyre, scan.shoulder, location)) {
                pool.0.push(value);
                pool.1.push(is_cracked);
            }
        }
    }
    Ok(pool)
}

/// Area under the ROC curve: the chance that a cracked location scores above a sound one, ties counting half.
///
/// NaN scores are left out with their labels (`true` is cracked). `None` if a class is then empty.
/// O(n log n): the Mann-Whitney statistic from mid-ranks.
///
/// # Panics
/// If there are not as many labels as scores.
pub fn auc(scores: &[f64], labels: &[bool]) -> Option<f64> {
    assert_eq!(scores.len(), labels.len(), "one label a score");
    let pairs = scores.iter().copied().zip(labels.iter().copied());
    // -0 + 0 = 0: the two zeros tie, though they sort apart.
    let mut pairs: Vec<(f64, bool)> = pairs.filter(|(score, _)| !score.is_nan()).map(|(s, l)| (s + 0.0, l)).collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut sound_below, mut wins) = (0.0, 0.0);
    for tied in pairs.chunk_by(|a, b| a.0.total_cmp(&b.0).is_eq()) {
        let cracked = tied.iter().filter(|&&(_, is_cracked)| is_cracked).count() as f64;
        let sound = tied.len() as f64 - cracked;
        wins += cracked * (sound_below + 0.5 * sound);
        sound_below += sound;
    }
    let cracked_count = pairs.len() as f64 - sound_below;
    (cracked_count > 0.0 && sound_below > 0.0).then(|| wins / (cracked_count * sound_below))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Reference;
    use crate::testing::{Casing, records, scored};

    /// The definition: every pair of a cracked and a sound location.
    fn auc_by_pairs(scores: &[f64], labels: &[bool]) -> Option<f64> {
        let class = |c: bool| scores.iter().zip(labels).filter(move |&(s, &l)| l == c && !s.is_nan()).map(|(&s, _)| s);
        let (mut wins, mut pairs) = (0.0, 0.0);
        for cracked in class(true) {
            for sound in class(false) {
                pairs += 1.0;
                wins += if cracked > sound {
                    1.0
                } else if cracked < sound {
                    0.0
                } else {
                    0.5
                };
            }
        }
        (pairs > 0.0).then(|| wins / pairs)
    }

    proptest! {
        #[test]
        fn auc_is_that_of_all_pairs(
            pairs in prop::collection::vec(
                (prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(-0.0), (-4..4).prop_map(f64::from)], any::<bool>()), 0..60)
        ) {
            // Catches ties counted as wins, NaN entering, and the classes swapped.
            let (scores, labels): (Vec<f64>, Vec<bool>) = pairs.into_iter().unzip();
            let (got, expected) = (auc(&scores, &labels), auc_by_pairs(&scores, &labels));
            prop_assert_eq!(got.is_some(), expected.is_some());
            prop_assert!((got.unwrap_or(0.0) - expected.unwrap_or(0.0)).abs() < 1e-12);
        }
    }

    #[test]
    fn each_discriminator_is_scored_alone() {
        // Catches discriminators mixed up, a direction not applied, and the index scored raw.
        let casing =
            Casing { cracks: vec![(1, 20..26)], shift: 3.0, shifted: vec![Discriminator::Pr], ..Casing::default() };
        let plan = casing.plan();
        let records = records(&casing, &plan, 5);
        let score = scored(Fusion::new(&FuseConfig::by(Reference::Own), &plan).unwrap(), &records);
        let pr = score.discriminators[Discriminator::Pr as usize].unwrap();
        assert!(pr > 0.99, "{score:?}");
        for (which, alone) in Discriminator::ALL.into_iter().zip(score.discriminators) {
            assert!(
                which == Discriminator::Pr || alone.is_none_or(|auc| (0.05..0.95).contains(&auc)),
                "{which:?} {alone:?}"
            );
        }
        assert!(score.index.unwrap() > 0.6, "one of six moves: {score:?}");
        assert_eq!((score.cracked_count, score.sound_count), (6, 94));
        let mut reversed = FuseConfig::by(Reference::Own);
        reversed.directions.set(Discriminator::Pr, crate::Direction::Falls);
        let reversed = scored(Fusion::new(&reversed, &plan).unwrap(), &records);
        assert!(reversed.discriminators[Discriminator::Pr as usize].unwrap() < 0.01);
    }

    #[test]
    fn without_truth_there_is_no_score() {
        // Catches a division by zero when a class is empty.
        let casing = Casing::default();
        let sound = casing.plan();
        let score = scored(Fusion::new(&FuseConfig::by(Reference::Own), &sound).unwrap(), &records(&casing, &sound, 1));
        assert_eq!((score.index, score.discriminators, score.cracked_count), (None, [None; Discriminator::COUNT], 0));
    }
}
