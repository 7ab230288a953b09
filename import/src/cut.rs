//! Continuous records, cut into taps by the trigger of live capture.

use tapline_acquire::Trigger;

use crate::config::Cut;
use crate::error::Fault;
use crate::series::{Series, Stored};

/// Most times that an error lists.
const TIMES_MAX: usize = 6;

/// The taps of a record, each `before` samples before its trigger and as long as `cut` says; a tap at an end of the record may lack
/// some.
///
/// There must be `planned` of them: were one missed, all behind it would be taken for their neighbours.
pub(crate) fn cut(
    series: &[Series],
    channel: usize,
    cut: &Cut,
    sample_rate_hz: f64,
    before: u32,
    planned: usize,
) -> Result<Vec<Result<Vec<Stored>, Fault>>, Fault> {
    let Some(trigger_series) = series.get(channel) else { return Err(Fault::Empty) };
    let mut values = trigger_series.samples.to_floats();
    if matches!(trigger_series.samples, Stored::F32(_)) && trigger_series.full_scale.to_bits() == 1_f64.to_bits() {
        // Floats may have any unit.
        let largest =
            values.iter().fold(0_f32, |largest, value| if value.abs() > largest { value.abs() } else { largest });
        if largest > 0.0 {
            values.iter_mut().for_each(|value| *value /= largest);
        }
    }
    let mut trigger = Trigger::new(&cut.trigger, sample_rate_hz);
    let mut found = Vec::new();
    trigger.push(&values, |crossing| found.push(crossing.sample));
    if found.len() != planned {
        let not = trigger.not_taps();
        #[expect(clippy::cast_precision_loss, reason = "samples of a record, far below 2^53")]
        let times = found.iter().take(TIMES_MAX).map(|&sample| format!("{:.3} s", sample as f64 / sample_rate_hz));
        let times = times.collect::<Vec<_>>().join(", ");
        return Err(Fault::Contradiction {
            what: "the number of its taps",
            value: format!("{} ({times}{})", found.len(), if found.len() > TIMES_MAX { ", ..." } else { "" }),
            bound: format!(
                "{planned} are planned; {} pulses were too short and {} too long to be taps (cut.trigger)",
                not.clicks, not.steps
            ),
        });
    }
    let sample_count = cut.sample_count as usize;
    let piece = |at: u64| {
        let from = usize::try_from(at).ok().and_then(|at| at.checked_sub(before as usize));
        let cut_at = |series: &Series| from.and_then(|from| series.samples.cut(from, sample_count));
        let channels: Option<Vec<Stored>> = series.iter().map(cut_at).collect();
        channels.ok_or_else(|| Fault::Contradiction {
            what: "the sample of a trigger",
            value: at.to_string(),
            bound: format!(
                "{before} samples must come before it, and {} from it on, in a record of {}",
                sample_count.saturating_sub(before as usize),
                trigger_series.samples.len()
            ),
        })
    };
    Ok(found.into_iter().map(piece).collect())
}
