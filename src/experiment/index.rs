//! The damage index of all six shoulders by one set of extremes (Eqs. 55 and 56).

use std::collections::BTreeMap;

use anyhow::{Context as _, Result};
use tapline_fuse::{Direction, Directions, FuseConfig, Fusion, IndexKind, Reference};
use tapline_wire::{Discriminator, Serial};

use super::taken::Taken;
use super::tyres::REPRESENTATIVE;

/// Damage indices by tyre and shoulder, location by location.
pub(super) type Indices = BTreeMap<(String, u16), Vec<Option<f64>>>;

/// How PR is taken to move over a crack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PowerRatio {
    /// As Table 13 has it, and as it does.
    Rises,
    /// As section 5.4.4 has it.
    Falls,
}

/// The indices of the shoulders in `taken`, from `discriminators`, by the extremes of the representative tyre's shoulder 1.
///
/// It is the index that the program calls `dissertation`: the two repetitions are averaged, closing taps left out.
pub(super) fn indices(taken: &Taken, discriminators: &[Discriminator], pr: PowerRatio) -> Result<Indices> {
    let pr = if pr == PowerRatio::Rises { Direction::Rises } else { Direction::Falls };
    let config = FuseConfig {
        discriminators: discriminators.to_vec(),
        index: IndexKind::Dissertation,
        reference: Reference::Shoulder { tyre: Serial::new(REPRESENTATIVE)?, shoulder: 1 },
        directions: Directions { pr, ..Directions::default() },
        ..FuseConfig::default()
    };
    let mut fusion = Fusion::new(&config, &taken.plan)?;
    for tap in &taken.taps {
        fusion.push(&tap.found)?;
    }
    let mut indices = Indices::new();
    for (number, scan) in taken.plan.scans().iter().enumerate() {
        fusion.end(number)?;
        let (_, cells) = fusion.judge(number).context("a planned shoulder is not judged")?;
        let values = cells.iter().map(|cell| Some(cell.damage_index).filter(|index| index.is_finite()));
        indices.insert((scan.tyre.to_string(), scan.shoulder), values.collect());
    }
    Ok(indices)
}
