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

impl Lost {
    const ALL: [Self; 4] = [Self::Unknown, Self::Acquire, Self::Process, Self::Store];

    /// Its code in the archive.
    pub fn code(self) -> u16 {
        self as u16
    }

    /// The stage with that code.
    pub fn from_code(code: u16) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// Its name in tables: the stage that should have passed the tap on.
    pub fn name(self) -> &'static str {
        ["unknown", "acquire", "process", "store"][self as usize]
    }
}
