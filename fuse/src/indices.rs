//! Rivals of the damage index: what the scores of one place become, behind one trait.
//!
//! All take the scores of a place in the order of the configuration, signed so that damage raises them and standardised
//! by the reference, so that sound places scatter about 0 with spread 1. A score is absent (`None`) where a tap did not
//! give it; what is no number counts as absent, and what lies beyond a million as a million. No index returns what is
//! not finite.
//!
//! | index | learns from | what it is | scale of its value | where a score is absent |
//! |---|---|---|---|---|
//! | [`Mean`] | nothing | mean of the scores | spread of a score, less by averaging | mean of the rest |
//! | [`Weighted`] | repeated taps, or labelled places | weighted mean, no weight below 0 | as the mean | the rest, their weights filling up to 1 |
//! | [`Lda`] | labelled places, 20 of each class | what best separates the classes if both scatter alike | log-likelihood ratio, 0 at the sound mean | the same of the rest's own model |
//! | [`LogOdds`] | labelled places, 20 of each class | logistic regression | log-odds of a crack | the rest foretell it, less surely |
//! | [`Mahalanobis`] | 20 sound places | distance from the sound ones | root mean square 1 over sound places | the same of the rest's own model |
//!
//! Nothing rises again beyond the healthy end: a weight below 0 would have it that a place sounder than the reference
//! is damaged, so [`Signs::NonNegative`] is the default of the two that learn signs. Free weights gain where two
//! discriminators that move together are damaged unequally *and* labels abound; below some 20 places of each class they
//! are noise more often than knowledge ([`Lda`] has the numbers).
//!
//! Learning takes the examples whose scores are all present, and never fills a gap. A discriminator that no example has
//! is left out. One that does not scatter within the classes has weight 0, be it another constant in each: what never
//! moved before says nothing when it moves.
//!
//! ```
//! use tapline_fuse::{Example, Index as _, Lda, Signs};
//!
//! let examples: Vec<Example> = (0..60_u32)
//!     .map(|place| {
//!         let (is_cracked, scatter) = (place % 2 == 0, f64::from(place * 37 % 11) * 0.3 - 1.5);
//!         let shift = if is_cracked { 2.0 } else { 0.0 };
//!         let other = f64::from(place * 17 % 7) * 0.4 - 1.2;
//!         Example { scores: vec![Some(shift + scatter), Some(other)], is_cracked, place: place as usize }
//!     })
//!     .collect();
//! let lda = Lda::learn(&examples, Signs::NonNegative)?;
//! assert!(lda.value(&[Some(2.0), Some(0.0)]) > lda.value(&[Some(0.5), Some(0.0)]));
//! assert_eq!(lda.value(&[None, None]), None);
//! # Ok::<(), tapline_fuse::LearnError>(())
//! ```

mod classes;
mod lda;
mod log_odds;
mod mahalanobis;
mod mean;
mod quadratic;
mod weighted;

#[cfg(test)]
mod absence;
#[cfg(test)]
mod laws;
#[cfg(test)]
mod sklearn;
#[cfg(test)]
mod testing;

use std::fmt::Debug;

pub use lda::Lda;
pub use log_odds::LogOdds;
pub use mahalanobis::Mahalanobis;
pub use mean::Mean;
pub use weighted::Weighted;

/// Fewest places of a class that an index with a covariance, or a regression, learns from.
pub const PLACES_MIN: usize = 20;

/// A score beyond this says no more than this. Squares of squares of it are still numbers.
const SCORE_MOST: f64 = 1e6;

/// What one location showed in one condition.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Example {
    /// Scores of the discriminators in the order of the configuration, each signed so that damage raises it and
    /// standardised so that sound places scatter about 0 with spread 1; `None` where absent.
    pub scores: Vec<Option<f64>>,
    /// Whether there is a crack.
    pub is_cracked: bool,
    /// Which place it is: rows of one place are not independent, and count as one where places are counted.
    pub place: usize,
}

/// One number out of the scores of a place, larger the more likely a crack is.
pub trait Index: Debug + Send + Sync {
    /// The index of one place; `None` when nothing can be said. Never NaN, never infinite.
    ///
    /// Scores that `scores` is too short for are absent; those beyond the discriminators learnt from are not looked at.
    fn value(&self, scores: &[Option<f64>]) -> Option<f64>;

    /// The index of each of several places.
    fn values(&self, places: &mut dyn Iterator<Item = &[Option<f64>]>) -> Vec<Option<f64>> {
        places.map(|scores| self.value(scores)).collect()
    }

    /// What each discriminator counts, largest magnitude 1, for people to read; `None` where that has no meaning.
    fn weights(&self) -> Option<Vec<f64>>;
}

/// Which signs the weights of an index that learns them may have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Signs {
    /// None below 0: a score that rises never lowers the index. The best such weights, not the free ones cut off at 0.
    #[default]
    NonNegative,
    /// Any, as scikit-learn has them: a negative weight takes away what a correlated discriminator says twice.
    Free,
}

/// Why an index cannot be learnt; the caller then takes another and says so.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LearnError {
    /// A class has too few places.
    #[error(
        "{index} needs {least} sound and {least} cracked places; it has {sound} and {cracked} \
         ({incomplete} of {rows} examples lack a score and are not used)"
    )]
    TooFew {
        /// Which index.
        index: &'static str,
        /// Places needed of each class.
        least: usize,
        /// Sound places that can be used.
        sound: usize,
        /// Cracked places that can be used.
        cracked: usize,
        /// Examples with an absent score.
        incomplete: usize,
        /// Examples given.
        rows: usize,
    },
    /// There are too few sound places.
    #[error(
        "{index} needs {least} sound places; it has {sound} \
         ({incomplete} of {rows} sound examples lack a score and are not used)"
    )]
    TooFewSound {
        /// Which index.
        index: &'static str,
        /// Places needed.
        least: usize,
        /// Sound places that can be used.
        sound: usize,
        /// Sound examples with an absent score.
        incomplete: usize,
        /// Sound examples given.
        rows: usize,
    },
    /// No discriminator has a weight.
    #[error("{index} gives none of the {count} discriminators a weight: {reason}")]
    NoWeight {
        /// Which index.
        index: &'static str,
        /// Discriminators there are.
        count: usize,
        /// What is wrong with them.
        reason: &'static str,
    },
    /// The equations have no solution in numbers.
    #[error("{index} of {count} discriminators was not found in {rounds} rounds")]
    NotFound {
        /// Which index.
        index: &'static str,
        /// Discriminators there are.
        count: usize,
        /// Rounds allowed.
        rounds: usize,
    },
}

/// A score that can be reckoned with.
fn usable(score: Option<f64>) -> Option<f64> {
    score.filter(|x| x.is_finite()).map(|x| x.clamp(-SCORE_MOST, SCORE_MOST))
}

/// The usable score of discriminator `column`.
fn score_of(scores: &[Option<f64>], column: usize) -> Option<f64> {
    usable(scores.get(column).copied().flatten())
}

/// `weights` over the largest of their magnitudes; as they are if all are 0.
fn to_unit(weights: &[f64]) -> Vec<f64> {
    let largest = weights.iter().map(|w| w.abs()).max_by(f64::total_cmp).filter(|&w| w > 0.0).unwrap_or(1.0);
    weights.iter().map(|w| w / largest).collect()
}

/// The sum of products.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
