//! How well the index and each discriminator separate cracked from sound locations whose truth is known.

use tapline_wire::{Discriminator, Discriminators};

use crate::fusion::count;
use crate::stats::auc;
use crate::{Error, FuseConfig, Fusion};

/// Areas under the ROC curve over all locations whose truth is known, all shoulders pooled.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// AUC of the damage index as configured; `None` when one class is empty.
    pub index: Option<f64>,
    /// AUC of each discriminator alone, in the order of [`Discriminator::ALL`], configured for the index or not: mean score of a
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
        Score {
            index: auc(index, labels),
            discriminators: self.alone.each_ref().map(|(values, labels)| auc(values, labels)),
            cracked_count: count(counted(true)),
            sound_count: count(counted(false)),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Reference;
    use crate::testing::{Casing, records, scored};

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
