//! How often sound shoulders are called, compared with their archives' stated rates, and how often cracked ones are.

use crate::evaluation::{Call, Table, cell, ends, yes_or_no};
use crate::statistics::{Rate, Refusal, clopper_pearson};
use tapline_wire::Reasons;

use super::inspected::InspectedShoulder;

/// Reasons from a shoulder's evidence; the others say that something is missing, or does not fit the reference.
const EVIDENCE: Reasons =
    Reasons::DAMAGE.union(Reasons::SUSPECT).union(Reasons::LEVEL_OFF).union(Reasons::NO_SOUND_MAJORITY);

/// How many shoulders of a kind are called.
#[derive(Debug)]
pub(super) struct CallRate {
    pub is_sound: bool,
    pub call: Call,
    /// Rate that the archives state for sound shoulders.
    pub stated: Option<f64>,
    pub calls: usize,
    pub judged: usize,
    /// Called without evidence of damage.
    pub incomplete: usize,
    pub rate: Result<Rate, Refusal>,
}

/// Calls of sound shoulders for each stated rate, and of cracked ones.
pub(super) fn calls(inspected: &[InspectedShoulder]) -> Vec<CallRate> {
    let mut rates = Vec::new();
    for call in Call::ALL {
        let stated = |shoulder: &InspectedShoulder| match call {
            Call::NotPassed => shoulder.scan.judgement.re_inspect_rate,
            Call::Rejected => shoulder.scan.judgement.reject_rate,
        };
        let sound: Vec<&InspectedShoulder> = inspected.iter().filter(|shoulder| shoulder.is_sound()).collect();
        let mut stated_rates: Vec<f64> = sound.iter().map(|shoulder| stated(shoulder)).collect();
        stated_rates.sort_by(f64::total_cmp);
        stated_rates.dedup_by(|a, b| a.total_cmp(b).is_eq());
        for rate in &stated_rates {
            let of_rate: Vec<_> = sound.iter().copied().filter(|s| stated(s).total_cmp(rate).is_eq()).collect();
            rates.push(CallRate::new(true, call, Some(*rate).filter(|rate| rate.is_finite()), &of_rate));
        }
        if sound.is_empty() {
            rates.push(CallRate::new(true, call, None, &[]));
        }
    }
    for call in Call::ALL {
        let cracked: Vec<_> = inspected.iter().filter(|shoulder| !shoulder.is_sound()).collect();
        rates.push(CallRate::new(false, call, None, &cracked));
    }
    rates
}

impl CallRate {
    fn new(is_sound: bool, call: Call, stated: Option<f64>, shoulders: &[&InspectedShoulder]) -> Self {
        let called: Vec<_> = shoulders.iter().filter(|shoulder| call.is(shoulder.scan.result.verdict)).collect();
        let (calls, judged) = (called.len(), shoulders.len());
        let incomplete = called.iter().filter(|s| !s.scan.judgement.reasons.intersects(EVIDENCE)).count();
        Self { is_sound, call, stated, calls, judged, incomplete, rate: clopper_pearson(calls, judged, 0.95) }
    }

    pub(super) fn kind(&self) -> &'static str {
        if self.is_sound { "sound" } else { "cracked" }
    }
}

pub(super) fn table(calls: &[CallRate]) -> Table {
    let mut table = Table::new(
        "calls",
        "False calls: sound shoulders that are not passed, and that are rejected, against the stated rate; and the same \
         for cracked shoulders. Intervals are exact (Clopper and Pearson) for independent shoulders",
        ["shoulders", "call", "stated", "rate", "rate_low", "rate_high", "calls", "judged", "consistent", "remark"],
    );
    for c in calls {
        let rate = c.rate.as_ref().ok();
        let mut row = vec![c.kind().into(), c.call.name().into(), cell(c.stated), cell(rate.map(|rate| rate.rate))];
        row.extend(ends(rate.map(|rate| (rate.low, rate.high))));
        row.extend([c.calls.into(), c.judged.into()]);
        row.push(rate.zip(c.stated).map_or("".into(), |(rate, stated)| yes_or_no(rate.low <= stated)));
        row.push(match rate {
            None => format!("no {} shoulder was inspected", c.kind()).into(),
            Some(_) if c.incomplete > 0 => format!("{} without evidence of damage", c.incomplete).into(),
            Some(_) => "".into(),
        });
        table.push(row);
    }
    table
}
