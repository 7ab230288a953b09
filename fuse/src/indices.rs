//! Placeholder.
use std::fmt::Debug;

/// Rows to learn from.
#[derive(Debug, Clone)]
pub struct Example {
    /// Scores.
    pub scores: Vec<Option<f64>>,
    /// Label.
    pub is_cracked: bool,
    /// Place.
    pub place: usize,
}

/// Index.
pub trait Index: Debug + Send + Sync {
    /// Value.
    fn value(&self, scores: &[Option<f64>]) -> Option<f64>;
    /// Weights.
    fn weights(&self) -> Option<Vec<f64>>;
}

/// Mean.
#[derive(Debug, Clone, Copy)]
pub struct Mean;

impl Index for Mean {
    fn value(&self, scores: &[Option<f64>]) -> Option<f64> {
        let (sum, count) = scores.iter().flatten().fold((0.0, 0.0), |(s, c), v| (s + v, c + 1.0));
        (count > 0.0).then(|| sum / count).filter(|v: &f64| v.is_finite())
    }
    fn weights(&self) -> Option<Vec<f64>> {
        None
    }
}
