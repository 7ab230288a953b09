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
    /// Seconds that it is expected to take on two cores.
    pub expected_s: fn(&Size) -> f64,
    /// Whether it judges the casings that several panels share.
    pub uses_casings: bool,
    pub measure: fn(&Bench) -> Result<Panel>,
}

/// All panels, in the order of the page: what a scan costs and finds comes first, then what each part of it does.
pub(crate) const PANELS: [Entry; 11] = [
    plans::ENTRY,
    recording::ENTRY,
    references::ENTRY,
    index::ENTRY,
    slabs::ENTRY,
    settings::ENTRY,
    spectrum::ENTRY,
    force::ENTRY,
    contact::ENTRY,
    codecs::ENTRY,
    transport::ENTRY,
];
