//! What a verdict says of a shoulder as a whole, not of any one place.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use tapline_draw::stats::median;
use tapline_wire::{Discriminator, Judgement, Quality, Reasons};

/// The sign of a microphone that hears everything louder or quieter than before. Verdicts ignore it: gain is no damage.
pub(crate) const SOUND_GAIN: &str = "sound_gain";

/// The sign of a sensor that feels every blow as harder or softer than before, where the reference has too few casings for `level_off`.
pub(crate) const FORCE_GAIN: &str = "force_gain";

/// Flags, scatter and level of a shoulder, by name.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Whole {
    /// The flags on more than half of its taps, with their shares; empty unless the verdict has the reason `flagged`.
    pub flags: BTreeMap<String, f64>,
    /// Scatter of each discriminator from place to place, as a multiple of the reference's, where that is
    /// known.
    pub scatter: BTreeMap<String, f64>,
    /// Level of each discriminator, as a multiple of the reference's, where that is known.
    pub level: BTreeMap<String, f64>,
}

impl Whole {
    /// Of the shoulder with this `judgement`, whose taps have these `qualities`.
    pub(crate) fn new<I: IntoIterator<Item = Quality>>(judgement: &Judgement, qualities: impl FnOnce() -> I) -> Self {
        let is_flagged = judgement.reasons.contains(Reasons::FLAGGED);
        let flags = if is_flagged { Quality::on_most(qualities()) } else { Vec::new() };
        let named = |(which, times): (Discriminator, f64)| (which.name().to_owned(), times);
        Self {
            flags: flags.into_iter().map(|(flag, share)| (flag.to_string(), share)).collect(),
            scatter: judgement.known_scatter().map(named).collect(),
            level: judgement.known_level().map(named).collect(),
        }
    }

    /// The median of each number over `all`, to four decimals, as a status may have many stations.
    pub(crate) fn median<'a>(all: impl Iterator<Item = &'a Self> + Clone) -> Self {
        let of = |values: fn(&Self) -> &BTreeMap<String, f64>| {
            let mut by_name: BTreeMap<&String, Vec<f64>> = BTreeMap::new();
            for (name, value) in all.clone().flat_map(values) {
                by_name.entry(name).or_default().push(*value);
            }
            let rounded =
                |(name, values): (&String, Vec<f64>)| Some((name.clone(), (median(&values)? * 1e4).round() / 1e4));
            by_name.into_iter().filter_map(rounded).collect()
        };
        Self { flags: of(|whole| &whole.flags), scatter: of(|whole| &whole.scatter), level: of(|whole| &whole.level) }
    }

    /// What the name of a reason does not say: which flags, which discriminators and how far.
    pub(crate) fn detail(&self, reason: &str) -> Option<String> {
        match reason {
            "flagged" => flags(&self.flags),
            "scatter_off" => scatter(&self.scatter),
            "scatter_low" => mean_scatter(&self.scatter),
            "level_off" => level(&self.level, &[Discriminator::FMax, Discriminator::Tau, Discriminator::Pr]),
            SOUND_GAIN => level(&self.level, &[Discriminator::A1]),
            FORCE_GAIN => level(&self.level, &[Discriminator::FMax]),
            _ => None,
        }
    }
}

/// Flags with the shares of taps that have them: "hum on 80 % of the taps, ...".
fn flags(flags: &BTreeMap<String, f64>) -> Option<String> {
    let shares = flags.iter().map(|(flag, share)| format!("{flag} on {:.0} % of the taps", 100.0 * share));
    (!flags.is_empty()).then(|| shares.collect::<Vec<_>>().join(", "))
}

/// At most three discriminators, those that scatter most: "pr 3.2, a_1 2.9 times the reference's".
fn scatter(scatter: &BTreeMap<String, f64>) -> Option<String> {
    if scatter.is_empty() {
        return None;
    }
    let mut scatter: Vec<_> = scatter.iter().collect();
    scatter.sort_by(|a, b| b.1.total_cmp(a.1));
    let large = scatter.iter().filter(|(_, times)| **times >= 1.5).count().clamp(1, 3);
    let large = scatter.iter().take(large).map(|(which, times)| format!("{which} {times:.1}"));
    Some(format!("{} times the reference's", large.collect::<Vec<_>>().join(", ")))
}

/// The root mean square over the discriminators: "0.4 times the reference's".
fn mean_scatter(scatter: &BTreeMap<String, f64>) -> Option<String> {
    let squares: f64 = scatter.values().map(|times| times * times).sum();
    (!scatter.is_empty()).then(|| format!("{:.2} times the reference's", (squares / scatter.len() as f64).sqrt()))
}

/// Some levels: "f_max -19.0 %, tau +10.2 %, pr +0.4 % relative to the reference's". A few per cent are much.
fn level(level: &BTreeMap<String, f64>, some: &[Discriminator]) -> Option<String> {
    let some = some.iter().map(|which| which.name());
    let known = some.filter_map(|which| Some(format!("{which} {:+.1} %", 100.0 * (level.get(which)? - 1.0))));
    let known: Vec<String> = known.collect();
    (!known.is_empty()).then(|| format!("{} relative to the reference's", known.join(", ")))
}
