//! A force pulse, resampled at the samples of a record.

/// A force with its own time steps, resampled.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pulse<'a> {
    pub history_n: &'a [f64],
    /// Steps of the history per sample.
    pub per_sample: f64,
}

impl Pulse<'_> {
    /// Samples at which a pulse that begins at sample `onset` may differ from 0.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "places in a record, clamped to it"
    )]
    pub(crate) fn span(&self, onset: f64, sample_count: usize) -> (usize, usize) {
        let end = onset + self.history_n.len() as f64 / self.per_sample + 1.0;
        let place = |x: f64| (x.ceil().clamp(0.0, sample_count as f64)) as usize;
        (place(onset), place(end))
    }

    /// Force at sample `n` of a pulse that begins at `onset`, linear between the steps of its history.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "a place within the history, checked by get"
    )]
    pub(crate) fn force_n(&self, n: usize, onset: f64) -> f32 {
        let at = (n as f64 - onset) * self.per_sample;
        let i = at.floor();
        let fraction = at - i;
        let pair = if at >= 0.0 { self.history_n.get(i as usize..(i as usize).saturating_add(2)) } else { None };
        match pair {
            Some(&[a, b]) => to_f32(a + fraction * (b - a)),
            _ => 0.0,
        }
    }
}

/// `value` with the precision of a sample.
#[expect(clippy::cast_possible_truncation, reason = "samples carry 16 bits")]
pub(crate) fn to_f32(value: f64) -> f32 {
    value as f32
}
