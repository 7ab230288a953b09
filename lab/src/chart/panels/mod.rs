//! The panels, one file each, and their registration.

mod codecs;
mod contact;
mod force;
mod index;
mod plans;
mod recording;
mod references;
mod settings;
mod slabs;
mod spectrum;
mod transport;

use anyhow::Result;

use super::Bench;
use super::panel::Panel;
use super::size::Size;

/// A panel as it is registered.
pub(crate) struct Entry {
    /// Name of its files, by which `--panel` asks for it.
    pub name: &'static str,
    /// Seconds that it is expected to take on two cores: all of it, and a little.
    expected_s: (f64, f64),
    /// Whether it judges the casings that several panels share.
    pub uses_casings: bool,
    pub measure: fn(&Bench) -> Result<Panel>,
}

impl Entry {
    /// Seconds that it is expected to take at `size`.
    pub(crate) fn expected_s(&self, size: &Size) -> f64 {
        if size.is_full { self.expected_s.0 } else { self.expected_s.1 }
    }
}

/// All panels, in the order of the page: what a scan costs and finds comes first, then what each part of it does.
pub(crate) const PANELS: [Entry; 11] = [
    Entry { name: "plans", expected_s: (150.0, 8.0), uses_casings: true, measure: plans::measure },
    Entry { name: "recording", expected_s: (280.0, 10.0), uses_casings: false, measure: recording::measure },
    Entry { name: "references", expected_s: (50.0, 3.0), uses_casings: true, measure: references::measure },
    Entry { name: "index", expected_s: (130.0, 8.0), uses_casings: true, measure: index::measure },
    Entry { name: "slabs", expected_s: (10.0, 3.0), uses_casings: false, measure: slabs::measure },
    Entry { name: "settings", expected_s: (110.0, 5.0), uses_casings: false, measure: settings::measure },
    Entry { name: "spectrum", expected_s: (15.0, 2.0), uses_casings: false, measure: spectrum::measure },
    Entry { name: "force", expected_s: (40.0, 3.0), uses_casings: false, measure: force::measure },
    Entry { name: "contact", expected_s: (22.0, 3.6), uses_casings: false, measure: contact::measure },
    Entry { name: "codecs", expected_s: (25.0, 3.0), uses_casings: false, measure: codecs::measure },
    Entry { name: "transport", expected_s: (110.0, 8.0), uses_casings: false, measure: transport::measure },
];
