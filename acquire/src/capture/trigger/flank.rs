//! The time of a tap: where the rising flank of its pulse reaches half of the peak.

/// Fractions of the peak between which the rising flank is fitted. A tap's time is where that fit is half of the peak, for any
/// peak height.
const FLANK: (f64, f64) = (0.2, 0.8);

/// The fraction of its greatest sample above which a pulse is fitted to find its peak.
const TOP: f64 = 0.8;

/// Where the rising flank of `pulse`, whose peak comes after sample `from`, is half of the peak: by parabolas through the top and
/// through the samples of [`FLANK`], so that noise on one of them does not decide.
pub(super) fn flank_at_half(pulse: &[f32], from: usize, baseline: f32) -> f64 {
    let above = |place: usize| f64::from(pulse[place] - baseline);
    let highest = (from..pulse.len()).max_by(|&a, &b| above(a).total_cmp(&above(b))).unwrap_or(from);
    let is_top = |place: usize| above(place) >= TOP * above(highest);
    let reach = (1..=highest).take_while(|&k| highest + k < pulse.len() && is_top(highest - k) && is_top(highest + k));
    let reach = reach.last().unwrap_or(0);
    let top = Parabola::through((highest - reach..highest + reach + 1).map(above));
    let peak = top.and_then(Parabola::extreme).unwrap_or(above(highest));
    // Down from the peak: the flank begins above its lower end.
    let first = (0..highest).rev().find(|&place| above(place) < FLANK.0 * peak).map_or(0, |below| below + 1);
    let end = (first..highest).find(|&place| above(place) > FLANK.1 * peak).unwrap_or(highest);
    let middle = 0.5 * (first + end) as f64 - 0.5;
    let fitted = Parabola::through((first..end).map(above)).and_then(|flank| flank.root(0.5 * peak));
    // Too steep for a fit: between the two samples around the half.
    fitted.map_or_else(|| between(above, first.saturating_sub(1), highest, 0.5 * peak), |t| middle + t)
}

/// Where a line from sample to sample first reaches `level`, from sample `first` on; `last` where it does not.
fn between(of: impl Fn(usize) -> f64, first: usize, last: usize, level: f64) -> f64 {
    let Some(above) = (first + 1..=last).find(|&place| of(place) >= level) else { return last as f64 };
    let (low, high) = (of(above - 1), of(above));
    if high > low { (above - 1) as f64 + (level - low) / (high - low) } else { above as f64 }
}

/// a + b t + c t^2, where t counts samples from the middle of those it was fitted to.
#[derive(Debug, Clone, Copy)]
struct Parabola {
    a: f64,
    b: f64,
    c: f64,
    /// Greatest magnitude of t.
    reach: f64,
}

impl Parabola {
    /// By least squares; `None` through fewer than four.
    fn through(values: impl ExactSizeIterator<Item = f64>) -> Option<Self> {
        let n = values.len() as f64;
        if n < 4.0 {
            return None;
        }
        let reach = 0.5 * (n - 1.0);
        let (mut y0, mut y1, mut y2, mut t2, mut t4) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (place, y) in values.enumerate() {
            let t = place as f64 - reach;
            (y0, y1, y2) = (y0 + y, y1 + t * y, y2 + t * t * y);
            (t2, t4) = (t2 + t * t, t4 + t * t * t * t);
        }
        // The odd powers of t sum to 0.
        let c = (n * y2 - t2 * y0) / (n * t4 - t2 * t2);
        Some(Self { a: (y0 - c * t2) / n, b: y1 / t2, c, reach })
    }

    /// Its greatest value; `None` where it opens upwards, or has its extreme elsewhere.
    fn extreme(self) -> Option<f64> {
        let Self { a, b, c, reach } = self;
        (c < 0.0 && (0.5 * b / c).abs() <= reach).then(|| a - 0.25 * b * b / c)
    }

    /// Where it rises through `level`; `None` where that is not among the samples.
    fn root(self, level: f64) -> Option<f64> {
        let Self { a, b, c, reach } = self;
        // This form is stable as c goes to 0.
        let t = 2.0 * (level - a) / (b + (b * b + 4.0 * c * (level - a)).sqrt());
        (b > 0.0 && t.abs() <= reach + 1.0).then_some(t)
    }
}
