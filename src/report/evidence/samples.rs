//! One channel of one archived tap, in its unit and without its baseline.

use anyhow::Result;
use tapline_draw::canvas::Point;
use tapline_draw::record::channel;
use tapline_store::Reader;
use tapline_wire::Channel;

/// The recording of one channel.
pub(crate) struct Signal {
    /// In its unit.
    pub values: Vec<f64>,
    pub sample_rate_hz: f64,
    pub pre_trigger_samples: u32,
}

/// The channel `kind` of the tap in plan row `row`; `None` if the tap or the channel is absent, or has a sample that is
/// not a number.
pub(crate) fn signal(reader: &Reader, row: u32, kind: Channel) -> Result<Option<Signal>> {
    let Some((header, samples)) = reader.tap(row)? else { return Ok(None) };
    let (sample_rate_hz, pre_trigger_samples) = (header.sample_rate_hz, header.pre_trigger_samples);
    let values = channel(&header, samples.as_samples(), kind).filter(|_| sample_rate_hz > 0.0);
    Ok(values.map(|values| Signal { values, sample_rate_hz, pre_trigger_samples }))
}

impl Signal {
    /// The signal between `from_ms` and `to_ms` after the trigger, in at most `count` points: if there are more
    /// samples, the smallest and largest of each group.
    pub(crate) fn between(&self, from_ms: f64, to_ms: f64, count: usize) -> Vec<Point> {
        let time_ms = |k: usize| (k as f64 - f64::from(self.pre_trigger_samples)) / self.sample_rate_hz * 1e3;
        let points: Vec<Point> = self.values.iter().enumerate().map(|(k, &y)| (time_ms(k), y)).collect();
        let points: Vec<Point> = points.into_iter().filter(|(t, _)| (from_ms..=to_ms).contains(t)).collect();
        if points.len() <= count {
            return points;
        }
        let part = points.len().div_ceil((count / 2).max(1));
        let ends = |part: &[Point]| {
            let least = part.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1));
            let greatest = part.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1));
            let mut ends: Vec<Point> = least.into_iter().chain(greatest).collect();
            ends.sort_by(|a, b| a.0.total_cmp(&b.0));
            ends
        };
        points.chunks(part).flat_map(ends).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a peak that is lost when many samples become few points, and a time that does not begin at the trigger.
    #[test]
    fn peaks_survive() {
        let mut values = vec![0.0; 1000];
        values[333] = 7.0;
        let signal = Signal { values, sample_rate_hz: 1e3, pre_trigger_samples: 100 };
        let points = signal.between(-50.0, 800.0, 60);
        assert!(points.len() <= 60 && points.contains(&(233.0, 7.0)), "{points:?}");
        assert!(points.iter().all(|(t, _)| (-50.0..=800.0).contains(t)));
    }
}
