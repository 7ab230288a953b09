//! Where a missing tap was lost.

/// Where a missing tap was lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Lost {
    /// Unknown: the archive's writer was killed.
    #[default]
    Unknown,
    /// Neither samples nor discriminators came: it was not taken, or was lost on its way from the station.
    Acquire,
    /// Its samples came, its discriminators did not.
    Process,
    /// Its discriminators came, its samples did not.
    Store,
}

tapline_wire::coded!(Lost: u16, Unknown = 0, Acquire = 1, Process = 2, Store = 3);
tapline_wire::named!(Lost, Unknown = "unknown", Acquire = "acquire", Process = "process", Store = "store");
