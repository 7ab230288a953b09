//! The damage index of each offset alone: where beside the belt edge a crack is heard best.

use tapline_store::Reader;
use tapline_wire::Discriminators;

use crate::config::Config;

/// The index of one shoulder at one offset.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct OffsetMap {
    /// Offset from the belt edge, mm.
    pub(super) offset_mm: f64,
    /// Location by location, as the shoulder's cells.
    pub(super) index: Vec<Option<f64>>,
}

/// The maps of every scan of the plan, by number of the scan; empty where there is nothing to tell apart.
pub(super) fn maps(_reader: &Reader, _config: &Config, _found: &[Option<Discriminators>]) -> Vec<Vec<OffsetMap>> {
    Vec::new()
}
