//! What a study may claim: how likely a crack of a size is found, how often none is called one, how far a rig repeats.
//!
//! - [`hit_miss()`] and [`a_hat()`]: probability of detection over size, after MIL-HDBK-1823A (2009), with a90 and a90/95.
//! - [`clopper_pearson`]: the interval of a rate. **Probability of detection is of finds above the
//!   false-call rate.** The curves fitted here fall to 0 with the size; a rig that calls sound places cracked at a rate
//!   f finds even the least crack at that rate, by chance, and one that calls everything cracked finds everything. So
//!   give f with its interval, from places known to be sound, beside every a90, and believe no curve below f.
//! - [`crossed`] and [`one_way()`]: gauge repeatability and reproducibility by analysis of variance.
//! - [`auc_interval`] and [`auc_left_out`]: how far the area under a curve may lie from what one ring, or one set, shows.
//! - [`nor_rmse`] and [`within_over_healthy`]: repeatability of two turns around a ring.
//!
//! What the data cannot say is a [`Refusal`] that names it, never a number.

mod a_hat;
mod anova;
mod beta;
mod bootstrap;
mod bound;
mod few;
mod gauge;
mod hit_miss;
mod newton;
mod normal;
mod one_way;
mod rate;
mod refusal;
mod repeat;
mod size;
mod split;
mod tail;

pub use a_hat::{A_HAT_TARGETS, AHat, Scale, Signal, a_hat};
pub use anova::AnovaRow;
pub use bootstrap::{Bootstrap, auc_interval};
pub use few::AtLeast;
pub use gauge::{Component, Crossed, Gauge, POOLED_ABOVE, crossed};
pub use hit_miss::{HIT_MISS_TARGETS, HitMiss, hit_miss};
pub use one_way::{OneWay, one_way};
pub use rate::{Rate, clopper_pearson};
pub use refusal::Refusal;
pub use repeat::{nor_rmse, within_over_healthy};
pub use split::{Split, auc_left_out, leave_one_out};
