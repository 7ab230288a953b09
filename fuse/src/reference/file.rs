//! Shoulders of earlier runs, kept as a reference: the results of their taps, and their known state.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use tapline_wire::{Discriminator, Geometry, Plan, TapId, Values};

use crate::index::Setup;
use crate::reference::fitted::FittedReference;
use crate::reference::known_shoulder::{KnownShoulder, check_shoulders};
use crate::reference::pattern::Pattern;
use crate::reference::summary::Summary;
use crate::shoulder::Shoulder;
use crate::shoulder::conditions::{Conditions, distinct, name_as_planned};
use crate::shoulder::velocity::Normalisation;
use crate::{Directions, Error};

/// The value of `format`; a different number means a different layout.
const FORMAT: &str = "tapline-reference-1";

/// A reference: shoulders that are sound, or of which every location is known to be sound or cracked.
///
/// It holds the results of every tap, so that any index can be learned from it, and a summary for people and other
/// programs to read. Its digest covers both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferenceSet {
    format: String,
    /// SHA-256 of everything else, hexadecimal.
    digest: String,
    /// Version of the program that made it.
    pub program: String,
    /// Where it comes from, archive by archive.
    pub lineage: Vec<Origin>,
    /// How the discriminators were extracted: the table `[process]` as TOML, every default spelled out.
    pub process: String,
    /// Which way each discriminator moves with damage, stated or learned.
    pub directions: Directions,
    /// AUC of each discriminator alone for a rising value, if there are labels: directions were learned from it.
    pub auc: BTreeMap<String, f64>,
    /// Scales and limits of the default index with this reference.
    pub summary: Summary,
    /// The shoulders.
    pub shoulders: Vec<KnownShoulder>,
    /// Discriminators whose direction was learned when it was built; a file does not say which these were.
    #[serde(skip)]
    pub learned: Vec<Discriminator>,
    #[serde(skip)]
    fits: Fits,
}

/// Fits of the reference for the most recent patterns: casings of one line have the same pattern.
#[derive(Debug, Default)]
struct Fits(Mutex<Vec<Fit>>);

type Fit = (Setup, Pattern, Normalisation, Option<Arc<FittedReference>>);

/// Most patterns that are cached.
const FITS_MAX: usize = 8;

impl Clone for Fits {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl PartialEq for Fits {
    /// Always equal: fits follow from the rest.
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// An archive that shoulders were taken from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// Name of its file.
    pub archive: String,
    /// Digest of its scan plan, hexadecimal.
    pub plan_digest: String,
    /// Its configuration, verbatim.
    pub config: String,
}

impl ReferenceSet {
    /// The reference that `shoulders` make, signed.
    pub(crate) fn signed(mut self) -> Self {
        FORMAT.clone_into(&mut self.format);
        self.digest = self.digest_now();
        self
    }

    /// An unsigned reference with nothing in it but `shoulders`.
    pub(crate) fn of(shoulders: Vec<KnownShoulder>, directions: Directions) -> Self {
        Self {
            format: String::new(),
            digest: String::new(),
            program: env!("CARGO_PKG_VERSION").to_owned(),
            lineage: Vec::new(),
            process: String::new(),
            directions,
            auc: BTreeMap::new(),
            summary: Summary::default(),
            shoulders,
            learned: Vec::new(),
            fits: Fits::default(),
        }
    }

    /// The reference as the text of its file, which [`ReferenceSet::parse`] takes.
    ///
    /// # Errors
    /// [`Error::NotAReference`] for one that cannot be written down.
    pub fn text(&self) -> Result<String, Error> {
        serde_json::to_string(self).map_err(|error| Error::NotAReference { reason: error.to_string() })
    }

    /// The reference that `text` is.
    ///
    /// # Errors
    /// [`Error::NotAReference`] for a text that is none, one of another layout, and one that was changed since.
    pub fn parse(text: &str) -> Result<Self, Error> {
        let refuse = |reason: String| Error::NotAReference { reason };
        let set: Self = serde_json::from_str(text).map_err(|error| refuse(error.to_string()))?;
        if set.format != FORMAT {
            return Err(refuse(format!("its format is {:?}; {FORMAT:?} is understood", set.format)));
        }
        let now = set.digest_now();
        if now != set.digest {
            return Err(refuse(format!(
                "it was changed, or made by another version of the program: its digest is {}, but its content has {now}",
                set.digest
            )));
        }
        check_shoulders(&set.shoulders)?;
        Ok(set)
    }

    /// Proof of its content: the SHA-256 of everything else, hexadecimal.
    pub fn digest(&self) -> &str {
        &self.digest
    }

    fn digest_now(&self) -> String {
        let unsigned = Self { digest: String::new(), ..self.clone() };
        let text = serde_json::to_string(&unsigned).unwrap_or_default();
        Sha256::digest(text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// Serial numbers of the casings that its shoulders are of, ascending.
    pub(crate) fn casings(&self) -> Vec<&str> {
        let mut tyres: Vec<&str> = self.shoulders.iter().map(|shoulder| shoulder.tyre.as_str()).collect();
        tyres.sort_unstable();
        tyres.dedup();
        tyres
    }

    /// The condition of each turn of `shoulder`, one of its own.
    pub(crate) fn conditions_of(&self, shoulder: &KnownShoulder, conditions: &Conditions) -> Vec<usize> {
        shoulder.turns.iter().filter_map(|turn| conditions.number(&shoulder.tap_id(turn)?)).collect()
    }

    /// A name for every turn, with its offset and velocity.
    pub(crate) fn taps(&self) -> impl Iterator<Item = TapId> {
        self.shoulders.iter().flat_map(|s| s.turns.iter().filter_map(|turn| s.tap_id(turn)))
    }

    /// Refuses a plan that has no offset and velocity in common with it.
    pub(crate) fn check_conditions(&self, plan: &Plan) -> Result<(), Error> {
        let (known, planned) = self.conditions_beside(plan);
        if planned.keys().any(|number| known.contains_key(number)) {
            return Ok(());
        }
        let names = |of: BTreeMap<usize, TapId>| of.into_values().map(name_of).collect::<Vec<_>>().join("; ");
        Err(Error::NothingInCommon { known: names(known), planned: names(planned) })
    }

    /// The offsets and velocities of `plan` that it has no tap at, in words.
    pub fn lacks(&self, plan: &Plan) -> Vec<String> {
        let (known, planned) = self.conditions_beside(plan);
        planned.into_iter().filter(|(number, _)| !known.contains_key(number)).map(|(_, tap)| name_of(tap)).collect()
    }

    /// A tap at each of its conditions, and at each of those of `plan`, by number.
    fn conditions_beside(&self, plan: &Plan) -> (BTreeMap<usize, TapId>, BTreeMap<usize, TapId>) {
        let planned = distinct((0..).zip(plan.taps()).map(|(row, _)| name_as_planned(plan, row)));
        let conditions = Conditions::of(planned.iter().copied().chain(self.taps()));
        let numbers = |taps: &mut dyn Iterator<Item = TapId>| -> BTreeMap<usize, TapId> {
            taps.filter_map(|tap| Some((conditions.number(&tap)?, tap))).collect()
        };
        (numbers(&mut self.taps()), numbers(&mut planned.iter().copied()))
    }

    /// Refuses a plan whose rings have other locations than its own: arcs of equal count would differ in length. A plan may omit
    /// some locations.
    pub(crate) fn check_locations(&self, plan: &Plan) -> Result<(), Error> {
        if self.shoulders.iter().all(|shoulder| shoulder.geometry != plan.geometry) {
            return Err(Error::OtherGeometry { planned: plan.geometry });
        }
        let Some(known) = self.largest_ring() else { return Ok(()) };
        for scan in plan.scans().iter().filter(|_| plan.geometry == Geometry::Ring) {
            if !known.has_ring(&scan.locations) {
                return Err(Error::OtherLocations { known: known.locations.len(), planned: scan.locations.len() });
            }
        }
        Ok(())
    }

    /// How many locations its longest ring has, and at how many a ring was tapped at the belt edge at most.
    pub(crate) fn ring_lengths(&self) -> [usize; 2] {
        let edges = self.shoulders.iter().filter(|shoulder| shoulder.geometry == Geometry::Ring);
        [
            self.largest_ring().map_or(0, |known| known.locations.len()),
            edges.map(KnownShoulder::edge_length).max().unwrap_or(0),
        ]
    }

    /// Whether most of its shoulders are those of casings with several: of some, one may not have passed.
    pub(crate) fn has_both_shoulders(&self) -> bool {
        let has_other = |of: &&KnownShoulder| {
            self.shoulders.iter().any(|other| other.tyre == of.tyre && other.shoulder != of.shoulder)
        };
        2 * self.shoulders.iter().filter(has_other).count() > self.shoulders.len()
    }

    /// Refuses own rings that are not parts of one ring.
    pub(crate) fn check_rings(&self) -> Result<(), Error> {
        let Some(known) = self.largest_ring() else { return Ok(()) };
        let name = |of: &KnownShoulder| format!("{}/{} has {} locations", of.tyre, of.shoulder, of.locations.len());
        for other in self.shoulders.iter().filter(|shoulder| shoulder.geometry == Geometry::Ring) {
            let located: Vec<_> = other.locations.iter().copied().zip(other.angles_deg.iter().copied()).collect();
            if !known.has_ring(&located) {
                let (known, other) = (name(known), name(other));
                let reason = format!("{known} of a ring, {other}: arcs of the two cannot be compared");
                return Err(Error::NotAReference { reason });
            }
        }
        Ok(())
    }

    fn largest_ring(&self) -> Option<&KnownShoulder> {
        let rings = self.shoulders.iter().filter(|shoulder| shoulder.geometry == Geometry::Ring);
        rings.max_by_key(|shoulder| shoulder.locations.len())
    }

    /// The fit for scans of `pattern`; `None` if none of their values vary. Computed once per pattern.
    pub(crate) fn fitted(
        &self,
        setup: &Setup,
        offsets: &[usize],
        pattern: &Pattern,
        normalisation: &Normalisation,
    ) -> Option<Arc<FittedReference>> {
        let mut fits = self.fits.0.lock().unwrap_or_else(PoisonError::into_inner);
        let is_it = |(s, p, n, _): &&Fit| s == setup && p == pattern && n == normalisation;
        if let Some((.., fitted)) = fits.iter().find(is_it) {
            return fitted.clone();
        }
        let shoulders = self.shoulders_like(pattern, normalisation);
        let fitted = FittedReference::fit(setup.clone(), offsets, &shoulders).map(Arc::new);
        if fits.len() == FITS_MAX {
            fits.remove(0);
        }
        fits.push((setup.clone(), pattern.clone(), *normalisation, fitted.clone()));
        fitted
    }

    /// Its shoulders, those of a casing one after the other, with the taps that a scan of `pattern` has: it is to teach what
    /// such a scan shows.
    pub(crate) fn shoulders_like(&self, pattern: &Pattern, normalisation: &Normalisation) -> Vec<Shoulder> {
        let mut known: Vec<&KnownShoulder> = self.shoulders.iter().collect();
        known.sort_by(|a, b| (&a.tyre, a.shoulder).cmp(&(&b.tyre, b.shoulder)));
        let mut casing = 0;
        let mut shoulders: Vec<Shoulder> = Vec::new();
        for (number, this) in known.iter().enumerate() {
            casing += usize::from(number > 0 && known[number - 1].tyre != this.tyre);
            shoulders.push(this.like(pattern, normalisation, casing));
        }
        shoulders
    }

    /// Its taps as the laws of the velocity see them.
    pub(crate) fn struck(&self, conditions: &Conditions) -> Vec<(usize, f64, Values)> {
        let turns = self.shoulders.iter().flat_map(|s| s.turns.iter().map(move |turn| (s, turn)));
        turns
            .filter_map(|(s, turn)| Some((conditions.offset_number(&s.tap_id(turn)?)?, turn)))
            .flat_map(|(group, turn)| {
                let measured = turn.velocities_measured_m_per_s.iter().enumerate();
                measured.filter_map(move |(place, v)| Some((group, (*v)?, turn.at(place))))
            })
            .collect()
    }
}

/// The offset and velocity of `tap`, in words.
fn name_of(tap: TapId) -> String {
    let number = |of: Option<f64>| of.map_or_else(|| "an unknown".to_owned(), |v| v.to_string());
    format!("{} mm, {} m/s", number(tap.offset_mm()), number(tap.velocity_m_per_s()))
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
