//! Statistics of a study: probability of detection, false-call rate, repeatability of a rig.
//!
//! - [`hit_miss()`] and [`a_hat()`]: probability of detection over size, after MIL-HDBK-1823A (2009), with a90 and a90/95.
//! - [`clopper_pearson`]: the interval of a rate. **A probability of detection means something only above the false-call
//!   rate.** The curves fitted here fall to 0 with the size. But a rig that calls sound places cracked at a rate f finds
//!   even the smallest crack at that rate, by chance. So state f with its interval, from places known to be sound, beside
//!   every a90, and do not use a curve below f.
//! - [`mean_interval`]: the interval of a mean of few values.
//! - [`crossed`] and [`one_way()`]: gauge repeatability and reproducibility by analysis of variance.
//! - [`fleiss_kappa`] and [`cohen_kappa`]: agreement on verdicts beyond chance.
//! - [`nor_rmse`] and [`within_over_all`]: repeatability of two turns around a ring.
//!
//! Where the data give no answer, a [`Refusal`] names the reason in place of a number.

mod a_hat;
mod anova;
mod bound;
mod gauge;
mod hit_miss;
mod kappa;
mod mean;
mod newton;
mod rate;
mod refusal;
mod repeat;
mod size;

pub use a_hat::{A_HAT_TARGETS, AHat, a_hat};
pub use anova::{AnovaRow, Crossed};
pub use gauge::{Component, Gauge, POOLED_ABOVE, crossed, one_way};
pub use hit_miss::{HIT_MISS_TARGETS, HitMiss, hit_miss};
pub use kappa::{cohen_kappa, fleiss_kappa};
pub use mean::mean_interval;
pub use rate::{Rate, clopper_pearson, mean_count};
pub use refusal::Refusal;
pub use repeat::{nor_rmse, within_over_all};
