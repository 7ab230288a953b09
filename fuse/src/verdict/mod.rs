//! From the findings on a shoulder to reasons and a verdict.

pub(crate) mod whole_shoulder;

use tapline_wire::{Reasons, Verdict};

/// The verdict that `reasons` demand: PASS only if there are none but remarks.
pub(crate) fn verdict_of(reasons: Reasons) -> Verdict {
    if reasons.contains(Reasons::DAMAGE) {
        Verdict::Reject
    } else if Reasons::REMARKS.contains(reasons) {
        Verdict::Pass
    } else {
        Verdict::ReInspect
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_no_reason_passes() {
        // Catches a verdict that forgets a reason: all sets of flags.
        let known = Reasons::ALL.iter().fold(0, |bits, (flag, _)| bits | flag.bits());
        let remarks = [7, 12, 14, 15, 16, 18, 20, 22].iter().fold(0, |bits, bit| bits | 1 << bit);
        for bits in 0..=known {
            let reasons = Reasons::from_bits_retain(bits);
            let expected = if reasons.contains(Reasons::DAMAGE) {
                Verdict::Reject
            } else if bits & !remarks == 0 {
                Verdict::Pass
            } else {
                Verdict::ReInspect
            };
            assert_eq!(verdict_of(reasons), expected, "{reasons}");
        }
        assert_eq!(verdict_of(Reasons::from_bits_retain(1 << 30)), Verdict::ReInspect, "a reason nobody knows yet");
    }
}
