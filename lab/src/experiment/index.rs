//! The damage index of all six shoulders, with one set of extremes (Eqs. 55 and 56).

use std::collections::BTreeMap;

use anyhow::Result;
use tapline_fuse::{Direction, Directions, FuseConfig, Fusion, IndexKind, Reference};
use tapline_wire::{Discriminator, Serial};

use super::dataset::Dataset;
use super::tyres::REPRESENTATIVE;

/// Damage indices by tyre and shoulder, location by location.
pub(super) type Indices = BTreeMap<(String, u16), Vec<Option<f64>>>;

/// How PR is assumed to move over a crack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PowerRatio {
    /// As in Table 13, and in fact.
    Rises,
    /// As in section 5.4.4.
    Falls,
}

/// The indices of all shoulders of `dataset`, with the extremes of the representative tyre's shoulder 1.
///
/// It is the index that the program calls `dissertation`, before the limits' scale: the two repetitions are averaged, closing taps left out.
pub(super) fn indices(dataset: &Dataset, discriminators: &[Discriminator], pr: PowerRatio) -> Result<Indices> {
    let mut directions = Directions::default();
    directions.set(Discriminator::Pr, if pr == PowerRatio::Rises { Direction::Rises } else { Direction::Falls });
    let config = FuseConfig {
        discriminators: discriminators.to_vec(),
        index: IndexKind::Dissertation,
        reference: Some(Reference::Shoulder { tyre: Serial::new(REPRESENTATIVE)?, shoulder: 1 }),
        directions,
        ..FuseConfig::default()
    };
    let mut fusion = Fusion::new(&config, &dataset.plan)?;
    for tap in &dataset.taps {
        fusion.push(&tap.found)?;
    }
    let mut indices = Indices::new();
    for (number, scan) in dataset.plan.scans().iter().enumerate() {
        fusion.end(number)?;
        indices.insert((scan.tyre.to_string(), scan.shoulder), fusion.dissertation_index(number)?);
    }
    Ok(indices)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::dataset::{Experiment, Turn, averaged};
    use crate::experiment::figures::SIX;
    use crate::experiment::tyres::NEW;

    /// Eqs. 55 and 56, term by term, for one location of the new tyre.
    fn by_hand(experiment: &Experiment, location: usize, has_falling_pr: bool) -> f64 {
        let scores = SIX.map(|which| {
            // The closing tap gives no extremes.
            let reference: Vec<f64> =
                averaged(&experiment.repetitions(1), which)[..100].iter().flatten().copied().collect();
            let highest = reference.iter().copied().fold(f64::NEG_INFINITY, |a, b| if b > a { b } else { a });
            let lowest = reference.iter().copied().fold(f64::INFINITY, |a, b| if b < a { b } else { a });
            let falls = which == Discriminator::FMax || (which == Discriminator::Pr && has_falling_pr);
            let turns =
                [0, 1].map(|repetition| experiment.inspection.turn(Turn { tyre: NEW, repetition, ..Turn::default() }));
            let value = averaged(&turns, which)[location].unwrap();
            (value - if falls { highest } else { lowest }).abs() / (highest - lowest)
        });
        scores.iter().sum::<f64>() / 6.0
    }

    /// Catches extremes of another shoulder than the representative tyre's first, a direction that is not set, A_2 in
    /// the index, and a closing tap among the extremes.
    #[test]
    fn one_shoulder_normalises_all() {
        let experiment = Experiment::take(3).unwrap();
        for (pr, has_falling_pr) in [(PowerRatio::Rises, false), (PowerRatio::Falls, true)] {
            let indices = indices(&experiment.inspection, &SIX, pr).unwrap();
            assert_eq!(indices.len(), 6);
            for location in [0, 37, 99] {
                let index = indices[&(NEW.to_owned(), 1)][location].unwrap();
                let wanted = by_hand(&experiment, location, has_falling_pr);
                assert!((index - wanted).abs() < 1e-12, "{location}: {index} {wanted}");
            }
        }
    }
}
