//! The rigs of a shift: what the casings of a station have in common points to its rig.

use std::collections::BTreeMap;

use anyhow::Result;
use maud::{Markup, html};
use tapline_wire::Reasons;

use crate::report::evidence::{Evidence, Tyre};
use crate::report::figures::rig::{self, OfCasing};
use crate::report::pages::page::figure;
use crate::report::pages::words;
use crate::shown::rig::{ASKS, Rigs, StationSign};
use crate::shown::whole::Whole;

/// Most stations that are drawn.
const STATIONS_MOST: usize = 8;

/// The rigs of a shift.
pub(crate) struct RigsOfShift<'a> {
    /// The casings of each station, in the order of tapping, with the properties of each as a whole.
    stations: BTreeMap<u16, Vec<(&'a Tyre, Whole)>>,
    signs_of_stations: Vec<StationSign>,
}

impl<'a> RigsOfShift<'a> {
    pub(crate) fn new(evidence: &'a Evidence) -> Self {
        let mut stations: BTreeMap<u16, Vec<(&Tyre, Whole)>> = BTreeMap::new();
        for tyre in &evidence.tyres {
            let whole = Whole::median(tyre.shoulders.iter().map(|shoulder| &shoulder.whole));
            let station = tyre.stations().first().copied().unwrap_or_default();
            stations.entry(station).or_default().push((tyre, whole));
        }
        let (mut rigs, mut signs_of_stations) = (Rigs::default(), Vec::new());
        for (&station, tyres) in &mut stations {
            // Where a time is not known, which is 0, the order of the archives stays.
            let first_ns = |tyre: &Tyre| tyre.taps().filter_map(|tap| tap.time_ns).filter(|&ns| ns != 0).min();
            if tyres.iter().all(|(tyre, _)| first_ns(tyre).is_some()) {
                tyres.sort_by_cached_key(|(tyre, _)| first_ns(tyre));
            }
            for (tyre, _) in tyres {
                let shoulders = tyre.shoulders.iter().map(|shoulder| (shoulder.reasons, &shoulder.whole));
                signs_of_stations
                    .extend(rigs.add(station, tyre.serial.as_str(), shoulders).into_iter().filter(|sign| sign.is_over));
            }
        }
        signs_of_stations.extend(rigs.all());
        Self { stations, signs_of_stations }
    }

    /// What should be checked, for the top of the page; empty if there is nothing to check.
    pub(crate) fn notice(&self) -> Markup {
        html! {
            @if !self.signs_of_stations.is_empty() {
                div class="notice" role="note" {
                    p { strong { "Several casings show signs that the rig has changed." } " Before you use their verdicts, " (ASKS) "." }
                    @for sign in &self.signs_of_stations { p { "At " (sign) "." } }
                }
            }
        }
    }

    /// Level and scatter of each station over the shift; empty if there are too few casings.
    pub(crate) fn section(&self, evidence: &Evidence) -> Result<Markup> {
        let has_sign = |station: u16| self.signs_of_stations.iter().any(|sign| sign.station == station);
        let mut order: Vec<(&u16, &Vec<(&Tyre, Whole)>)> = self.stations.iter().collect();
        order.sort_by_key(|(station, _)| !has_sign(**station));
        let mut pictures = Vec::new();
        let mut drawn = 0;
        for (station, tyres) in order.iter().take(STATIONS_MOST) {
            let of = |reason: Reasons, times: fn(&Whole) -> &BTreeMap<String, f64>| -> Vec<OfCasing<'_>> {
                let is_off = |tyre: &Tyre| tyre.shoulders.iter().any(|shoulder| shoulder.reasons.intersects(reason));
                tyres.iter().map(|(tyre, whole)| (times(whole), is_off(tyre))).collect()
            };
            let level = of(Reasons::LEVEL_OFF, |whole| &whole.level);
            let scatter = of(Reasons::SCATTER_OFF | Reasons::SCATTER_LOW, |whole| &whole.scatter);
            let ends = [tyres.first(), tyres.last()].map(|tyre| tyre.map_or("", |(tyre, _)| tyre.serial.as_str()));
            let level = rig::svg(format!("Station {station}: level"), ends, &level, (0.9, 1.1))?;
            let scatter = rig::svg(format!("Station {station}: scatter"), ends, &scatter, (0.0, 1.5))?;
            drawn += usize::from(level.is_some() || scatter.is_some());
            pictures.extend(level.into_iter().chain(scatter));
        }
        if pictures.is_empty() {
            return Ok(html! {});
        }
        let what = html! {
            strong { "What each rig measured relative to the reference, casing by casing." }
            " Level is the median around a " (words::side(evidence.geometry)) ", scatter how far its locations differ. A rig that has not changed stays near 1. F_max and τ depend on the force sensor and the impactor, A₁ and PR on the microphone. Shaded casings have the reason level_off, scatter_off or scatter_low."
            @if self.stations.len() > drawn { " Shown: " (drawn) " of " (self.stations.len()) " stations." }
        };
        Ok(html! { section { h2 { "Rigs" } (figure(pictures, &what)) } })
    }
}
