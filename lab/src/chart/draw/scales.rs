//! The scales of a facet: they span all points, and intervals unless these dwarf the points.

use tapline_draw::scale::Scale;
use tapline_draw::stats::extent;

use crate::chart::panel::Facet;

/// Fraction of the values' range by which intervals may widen an axis.
const WIDENED: f64 = 0.35;
/// Room at either end.
const ROOM: f64 = 0.06;

pub(super) fn scale_of_costs(facet: &Facet) -> Scale {
    let costs = facet.points.iter().map(|point| point.cost.median);
    let guides = facet.guides.iter().flat_map(|guide| [guide.cost.0, guide.cost.1]);
    let values: Vec<f64> = costs.chain(guides).collect();
    scale(&values, &[], facet.cost.is_log)
}

pub(super) fn scale_of_errors(facet: &Facet) -> Scale {
    let values: Vec<f64> = facet.points.iter().map(|point| point.error.value).collect();
    let ends: Vec<f64> = facet.points.iter().flat_map(|point| [point.error.low, point.error.high]).collect();
    scale(&values, &ends, facet.error.is_log)
}

/// The scale of `values`, widened for `ends` of intervals.
fn scale(values: &[f64], ends: &[f64], is_log: bool) -> Scale {
    let along = |value: &f64| if is_log { value.log10() } else { *value };
    let (low, high) = extent(values.iter().map(along)).unwrap_or((0.0, 1.0));
    // A single value has no range of its own.
    let range = if high > low { high - low } else { 0.3 };
    let most = WIDENED * range;
    let reach = extent(ends.iter().map(along).chain([low, high]));
    let (reach_low, reach_high) = reach.unwrap_or((low, high));
    let low = if reach_low < low - most { low - most } else { reach_low };
    let high = if reach_high > high + most { high + most } else { reach_high };
    match is_log {
        true => Scale::log((10.0_f64.powf(low), 10.0_f64.powf(high))).with_room(ROOM),
        // A linear scale of values that cannot be negative begins at 0.
        false if low >= 0.0 && low < 0.5 * high => Scale::linear((-0.02 * high, high)).with_room(0.5 * ROOM),
        false => Scale::linear((low, high)).with_room(ROOM),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a scale that leaves a point out, and one that an infinite interval makes useless.
    #[test]
    fn all_points_are_in() {
        let scale = scale(&[0.01, 0.02, 0.3], &[0.0, f64::INFINITY, 0.009, 0.4], true);
        assert!([0.01, 0.3].iter().all(|&value| (0.001..0.999).contains(&scale.part(value))));
        assert!(scale.end() < 10.0 && scale.begin() > 1e-4);
    }
}
