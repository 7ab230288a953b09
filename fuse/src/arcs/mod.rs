//! Evidence of whole arcs: ten neighbours at three sigma are stronger evidence than one.
//!
//! `statistic` sums the scores of an arc over its offsets, `regions` finds the arcs that exceed a limit, `limits` sets that
//! limit for a stated rate of false calls, and `white` draws rings of noise.

pub(crate) mod limits;
pub(crate) mod regions;
pub(crate) mod statistic;
pub(crate) mod white;
