//! The state of a line as viewers see it: in a file (`tapline status`), on its page, as metrics; its verdicts.

pub(crate) mod casing;
pub(crate) mod latency;
pub(crate) mod refused;
pub(crate) mod rig;
pub(crate) mod status;
pub(crate) mod verdict;
pub(crate) mod whole;
