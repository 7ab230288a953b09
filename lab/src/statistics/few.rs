//! How many there are against how many are wanted.

/// A count and what it should be at least. Fewer give a number all the same, which then means less than its bounds
/// claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AtLeast {
    /// How many there are.
    pub count: usize,
    /// How many are wanted.
    pub wanted: usize,
}

impl AtLeast {
    /// Whether there are fewer than wanted; a report has to show it.
    pub fn is_few(&self) -> bool {
        self.count < self.wanted
    }
}
