//! The casings of a report: those that were last tapped between two times.

use anyhow::{Context as _, Result, ensure};
use jiff::Timestamp;
use tapline_store::Reader;

use crate::report::pages::words::moment;

/// From when, and before when, casings were last tapped; without limits, all of them.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Span {
    from_ns: Option<i64>,
    to_ns: Option<i64>,
}

impl Span {
    pub(crate) fn new(from: Option<Timestamp>, to: Option<Timestamp>) -> Result<Self> {
        let ns = |time: Option<Timestamp>, option: &str| -> Result<Option<i64>> {
            let ns = time.map(|time| i64::try_from(time.as_nanosecond()));
            ns.transpose().with_context(|| format!("{option}: too far from today"))
        };
        let (from_ns, to_ns) = (ns(from, "--from")?, ns(to, "--to")?);
        if let (Some(from), Some(to)) = (from_ns, to_ns) {
            ensure!(from < to, "--from {} must be before --to {}", moment(from), moment(to));
        }
        Ok(Self { from_ns, to_ns })
    }

    /// Whether the casing behind `reader` belongs to it; `None` if none of its taps has a time, and it must have one.
    pub(crate) fn has(self, reader: &Reader) -> Result<Option<bool>> {
        if self.words().is_none() {
            return Ok(Some(true));
        }
        let times_ns = reader.headers()?.into_iter().flatten().map(|header| header.tap_time_ns);
        let is_in = |ns: i64| self.from_ns.is_none_or(|from| from <= ns) && self.to_ns.is_none_or(|to| ns < to);
        Ok(times_ns.filter(|&ns| ns != 0).max().map(is_in))
    }

    /// Its limits, for people; `None` if it has none.
    pub(crate) fn words(self) -> Option<String> {
        match (self.from_ns.map(moment), self.to_ns.map(moment)) {
            (Some(from), Some(to)) => Some(format!("from {from} to {to}")),
            (Some(from), None) => Some(format!("from {from} on")),
            (None, Some(to)) => Some(format!("before {to}")),
            (None, None) => None,
        }
    }
}
