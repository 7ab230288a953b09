//! The unweighted mean of the scores: what all rivals must beat.

use super::{Index, usable};

/// Mean of the scores that are present.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mean {
    count: usize,
}

impl Mean {
    /// The mean of `count` discriminators.
    pub fn new(count: usize) -> Self {
        Self { count }
    }
}

impl Index for Mean {
    fn value(&self, scores: &[Option<f64>]) -> Option<f64> {
        let present = || scores.iter().take(self.count).filter_map(|&score| usable(score));
        let count = present().count();
        (count > 0).then(|| present().sum::<f64>() / count as f64)
    }

    fn weights(&self) -> Option<Vec<f64>> {
        Some(vec![1.0; self.count])
    }
}
