//! Continuous records, cut into taps by the trigger of live capture.

use tapline_acquire::Trigger;
use tapline_store::OwnedSamples;

use crate::config::Cut;
use crate::error::Fault;
use crate::series::{Series, count_of, cut as part_of, to_floats};

/// The taps of a record, each `before` samples before its trigger and as long as `cut` says; a tap at an end of the record may lack
/// some.
///
/// There must be `planned` of them: if one were missed, all after it would be taken for their neighbours.
pub(crate) fn cut(
    series: &[Series],
    channel: usize,
    cut: &Cut,
    sample_rate_hz: f64,
    before: u32,
    planned: usize,
) -> Result<Vec<Result<Vec<OwnedSamples>, Fault>>, Fault> {
    let Some(trigger_series) = series.get(channel) else { return Err(Fault::Empty) };
    let mut values = to_floats(&trigger_series.samples);
    if matches!(trigger_series.samples, OwnedSamples::F32(_)) && trigger_series.full_scale.to_bits() == 1_f64.to_bits()
    {
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
        return Err(Fault::Contradiction {
            what: "the number of its taps",
            value: format!("{}{}", found.len(), where_to_look(&found, planned, sample_rate_hz)),
            bound: format!(
                "{planned} are planned; {} pulses were too short and {} too long to be taps (cut.trigger)",
                not.clicks, not.steps
            ),
        });
    }
    let sample_count = cut.sample_count as usize;
    let piece = |at: u64| {
        let from = usize::try_from(at).ok().and_then(|at| at.checked_sub(before as usize));
        let cut_at = |series: &Series| from.and_then(|from| part_of(&series.samples, from, sample_count));
        let channels: Option<Vec<OwnedSamples>> = series.iter().map(cut_at).collect();
        channels.ok_or_else(|| Fault::Contradiction {
            what: "the sample of a trigger",
            value: at.to_string(),
            bound: format!(
                "{before} samples must come before it, and {} from it on, in a record of {}",
                sample_count.saturating_sub(before as usize),
                count_of(&trigger_series.samples)
            ),
        })
    };
    Ok(found.into_iter().map(piece).collect())
}

/// Where a tap may be missing, or one too many: the longest pause between two, or the shortest.
fn where_to_look(found: &[u64], planned: usize, sample_rate_hz: f64) -> String {
    let pauses = found.windows(2).map(|pair| (pair[1] - pair[0], pair[0], pair[1]));
    let (which, pause) = match found.len() < planned {
        true => ("longest", pauses.max_by_key(|&(pause, ..)| pause)),
        false => ("shortest", pauses.min_by_key(|&(pause, ..)| pause)),
    };
    #[expect(clippy::cast_precision_loss, reason = "samples of a record, far below 2^53")]
    let at_s = |sample: u64| sample as f64 / sample_rate_hz;
    pause.map_or_else(String::new, |(_, from, to)| {
        format!(" (the {which} pause lies at {:.3} to {:.3} s)", at_s(from), at_s(to))
    })
}
