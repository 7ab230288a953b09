//! What counts as a call on a shoulder.

use tapline_wire::Verdict;

/// Verdicts that are false calls on a sound shoulder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Call {
    NotPassed,
    Rejected,
}

impl Call {
    pub(crate) const ALL: [Self; 2] = [Self::NotPassed, Self::Rejected];

    pub(crate) fn name(self) -> &'static str {
        ["not passed", "rejected"][self as usize]
    }

    pub(crate) fn is(self, verdict: Verdict) -> bool {
        match self {
            Self::NotPassed => verdict != Verdict::Pass,
            Self::Rejected => verdict == Verdict::Reject,
        }
    }
}
