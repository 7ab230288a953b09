//! The rates of false calls that a reference supports.

use crate::verdict::whole_shoulder::CASINGS_MIN;
use crate::{FuseConfig, Reference, ReferenceSet};

/// The least rate of false calls that `casing_count` casings support; `None` for fewer than two.
///
/// Each of n + 1 sound casings is as likely as any other to have the strongest arc, so n casings show which arc is reached at a rate of
/// 1/(n + 1). A limit for a lower rate rests on the assumed distribution alone. The shoulders of a casing may be alike, so they do not count
/// twice.
pub(crate) fn supported_rate(casing_count: usize) -> Option<f64> {
    (casing_count > 1).then(|| 1.0 / (casing_count as f64 + 1.0))
}

/// What the reference cannot support in verdicts by `config`, in words; `set` is the reference if it is a file.
pub fn unsupported(config: &FuseConfig, set: Option<&ReferenceSet>) -> Vec<String> {
    let casing_count = match (set, &config.reference) {
        (Some(set), _) => set.summary.casing_count,
        (None, Some(Reference::Shoulder { .. })) => 1,
        (None, _) => 0,
    };
    let stated = [("re_inspect_rate", config.re_inspect_rate), ("reject_rate", config.reject_rate)];
    let rates = stated.into_iter().filter_map(|(name, rate)| remark(casing_count, name, rate));
    let level = (1..CASINGS_MIN).contains(&casing_count).then(|| {
        format!("level: {CASINGS_MIN} casings are needed to tell how sound shoulders differ in level; without them damage all round does not show")
    });
    let standing_out = set.filter(|set| !set.summary.standing_out.is_empty()).map(|set| {
        let names = set.summary.standing_out.join(", ");
        format!("reference: {names} may be cracked: casings that stand out from the others make the limits too wide for cracks")
    });
    rates.chain(level).chain(standing_out).collect()
}

fn remark(casing_count: usize, name: &str, rate: f64) -> Option<String> {
    let percent = |rate: f64| {
        let digits = format!("{:.3}", 100.0 * rate);
        format!("{} %", digits.trim_end_matches('0').trim_end_matches('.'))
    };
    let noise = format!("{} is that of white noise", percent(rate));
    match supported_rate(casing_count) {
        Some(supported) if rate < supported => Some(format!(
            "{name}: {casing_count} casings support {}; {} is extrapolated",
            percent(supported),
            percent(rate)
        )),
        Some(_) => None,
        None if casing_count == 0 => {
            Some(format!("{name}: a casing that is its own reference supports no rate; {noise}"))
        }
        None => Some(format!("{name}: one casing supports no rate; {noise}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_remark_says_what_casings_support() {
        // Catches a rate that nobody vouches for, one that is supported and remarked, and digits that say nothing.
        assert_eq!(remark(12, "r", 0.08), None);
        let text = "r: 12 casings support 7.692 %; 0.1 % is extrapolated";
        assert_eq!(remark(12, "r", 0.001).as_deref(), Some(text));
        assert!(remark(1, "r", 0.3).is_some_and(|text| text.contains("one casing supports no rate")));
        assert!(remark(0, "r", 0.3).is_some_and(|text| text.contains("its own reference")));
    }
}
