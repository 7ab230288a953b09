//! The damage index: the taps of a place as one score per offset and discriminator, behind one trait.
//!
//! | file | index |
//! |---|---|
//! | `fused` | the default: levels by turn, scatter that knows repeatability and correlation |
//! | `dissertation` | Eqs. 55-56 as printed |

mod dissertation;
mod fused;

use std::fmt::Debug;

use tapline_wire::{Direction, Discriminator};

use crate::evidence::{ABSENT, Vector, has_value};
use crate::shoulder::Shoulder;
use crate::shoulder::conditions::Conditions;
use crate::{FuseConfig, IndexKind};

/// What an index is to be fitted for.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Setup {
    pub kind: IndexKind,
    /// The discriminators that enter, each with its direction.
    pub discriminators: Vec<(Discriminator, Direction)>,
    /// Number of the offset of each condition.
    pub offset_of: Vec<usize>,
    /// How many offsets there are.
    pub offset_count: usize,
    /// Whether the judged shoulders are their own reference: any of their places may be cracked.
    pub is_own: bool,
    /// Whether the shoulders of a casing have one level in common, as lines on one slab have.
    pub has_common_level: bool,
}

impl Setup {
    /// For `config`; `is_line` if the locations of a shoulder are a line.
    pub(crate) fn new(config: &FuseConfig, conditions: &Conditions, is_own: bool, is_line: bool) -> Self {
        Self {
            kind: config.index,
            discriminators: config.discriminators.iter().map(|&which| (which, config.directions.of(which))).collect(),
            offset_of: (0..conditions.count()).map(|condition| conditions.offset_of(condition)).collect(),
            offset_count: conditions.offsets_mm().len(),
            is_own,
            has_common_level: is_own && is_line,
        }
    }
}

/// What an index says of the places of one shoulder.
#[derive(Debug, Clone, Default)]
pub(crate) struct Scores {
    /// `[offset][place]`, greater the more likely there is damage: each of mean 0 and standard deviation 1 over sound places;
    /// NaN where no tap says anything. An index of one number has it in the first place.
    pub by_offset: Vec<Vec<Vector>>,
    /// The same before a tap that stands out alone is cut: what it shows is tapped again rather than believed.
    pub uncut: Vec<Vec<Vector>>,
    /// Mean score of each discriminator by place, in the order of [`Setup::discriminators`]; NaN where it is absent.
    pub by_discriminator: Vec<Vec<f64>>,
    /// Places that enter the level of their turns: those that stand out do not.
    pub is_inlier: Vec<bool>,
    /// How far each discriminator scatters from place to place, as a multiple of how far it does in the reference, in the order of
    /// [`Setup::discriminators`]; NaN where there are too few values. Empty for an index that does not measure it.
    pub scatter: Vec<f64>,
}

impl Scores {
    /// Hides what is not `kept`, by place.
    pub(crate) fn hide(&mut self, kept: &[bool]) {
        for of_offset in &mut self.by_offset {
            of_offset.iter_mut().zip(kept).filter(|(_, kept)| !**kept).for_each(|(score, _)| *score = ABSENT);
        }
    }

    /// How many places have a score at any offset.
    pub(crate) fn places_shown(&self) -> usize {
        let count = self.by_offset.first().map_or(0, Vec::len);
        (0..count).filter(|&place| self.by_offset.iter().any(|of_offset| has_value(&of_offset[place]))).count()
    }

    /// The root mean square of the scatter of the discriminators; NaN where none is known.
    pub(crate) fn mean_scatter(&self) -> f64 {
        let squares: Vec<f64> = self.scatter.iter().filter(|x| x.is_finite()).map(|x| x * x).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }
}

/// An index that was fitted to a reference.
pub(crate) trait Index: Debug + Send + Sync {
    /// What it says of the shoulders of one casing.
    fn scores(&self, casing: &[&Shoulder]) -> Vec<Scores>;

    /// The damage index of each place of `shoulder` as the index's own formula has it, before it is put on the scale of the
    /// limits; `None` of an index that has no such formula.
    fn as_printed(&self, _shoulder: &Shoulder) -> Option<Vec<Option<f64>>> {
        None
    }

    /// Robust standard deviation of the logarithm of discriminator number `d` in `condition` about the level of its turn; of a ratio x, of
    /// ln(x/(1-x)). `None` where the index has no such scale.
    fn sigma(&self, condition: usize, d: usize) -> Option<f64>;
}

/// The index that `shoulders` teach by their places that are `sound`; `None` where nothing of them varies.
pub(crate) fn fit(setup: &Setup, shoulders: &[&Shoulder], sound: &[Vec<bool>]) -> Option<Box<dyn Index>> {
    match setup.kind {
        IndexKind::Fused => Some(Box::new(fused::Fused::fit(setup, shoulders, sound)?)),
        IndexKind::Dissertation => Some(Box::new(dissertation::Extremes::fit(setup, shoulders)?)),
    }
}
