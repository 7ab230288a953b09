//! Shoulders of earlier runs, kept as a reference: what came of their taps, and what they are known to be.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use tapline_wire::{
    Discriminator, Discriminators, Geometry, Plan, Purpose, Quality, Scan, Serial, TapId, Truth, Values,
};

use crate::index::Setup;
use crate::reference::fitted::FittedReference;
use crate::reference::pattern::Pattern;
use crate::reference::summary::Summary;
use crate::shoulder::conditions::{Conditions, distinct};
use crate::shoulder::ring::Ring;
use crate::shoulder::velocity::Normalisation;
use crate::shoulder::{self, Shoulder};
use crate::{Directions, Error};

/// What stands in `format`; another number is another layout.
const FORMAT: &str = "tapline-reference-1";

/// A reference: shoulders that are sound, or of which every location is known to be sound or cracked.
///
/// It holds what came of every tap, so that any index can be learned from it, and a summary of it for people and other
/// programs to read. Its digest vouches for both.
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
    /// AUC of each discriminator alone, risen with its value, where there are labels: what directions were learned from.
    pub auc: BTreeMap<String, f64>,
    /// Scales, covariance and limits that the default index has by it.
    pub summary: Summary,
    /// The shoulders.
    pub shoulders: Vec<KnownShoulder>,
    #[serde(skip)]
    fits: Fits,
}

/// What the reference teaches, for the patterns that were last asked for: casings of one line have the same.
#[derive(Debug, Default)]
struct Fits(Mutex<Vec<Fit>>);

type Fit = (Setup, Pattern, Normalisation, Option<Arc<FittedReference>>);

/// A location of a scan is that of the reference if their angles differ by less.
const ANGLE_SLACK_DEG: f64 = 0.5;

/// Most patterns that are remembered.
const FITS_MAX: usize = 8;

impl Clone for Fits {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl PartialEq for Fits {
    /// They follow from the rest.
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

/// What came of one shoulder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnownShoulder {
    /// Serial number of its casing.
    pub tyre: String,
    /// Its side.
    pub shoulder: u16,
    /// Whether its locations are a ring or a line.
    pub geometry: Geometry,
    /// Numbers of its locations, ascending.
    pub locations: Vec<u32>,
    /// Their angles in degrees.
    pub angles_deg: Vec<Option<f64>>,
    /// Number of the location of the closing tap, where there was one.
    pub closing_location: Option<u32>,
    /// Whether each location is cracked; left out where the shoulder is stated to be sound.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub is_cracked: Option<Vec<bool>>,
    /// Its taps, turn by turn.
    pub turns: Vec<Turn>,
}

/// The taps of one shoulder at one offset, velocity and repetition; by location, `None` where nothing came.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turn {
    /// Offset from the belt edge.
    pub offset_mm: Option<f64>,
    /// Velocity that was meant.
    pub velocity_m_per_s: Option<f64>,
    /// Which repetition, of this offset and velocity.
    pub repetition: u16,
    /// Velocity that was measured.
    pub velocities_measured_m_per_s: Vec<Option<f64>>,
    /// The discriminators, by the names of their columns.
    pub values: BTreeMap<String, Vec<Option<f64>>>,
}

impl KnownShoulder {
    /// What came of scan number `scan` of `plan`; its locations labelled by `truth`, where that is given.
    ///
    /// Refused taps, and closing ones, are left out. `None` for a scan that is not planned.
    pub fn of(plan: &Plan, records: &[Discriminators], scan: usize, truth: Option<&Truth>) -> Option<Self> {
        let planned = plan.scans().get(scan)?;
        let mut closing = planned.taps.iter().map(|&row| &plan.taps()[row as usize]).filter(|tap| tap.is_closing());
        let label = |&(location, _): &(u32, Option<f64>)| {
            truth.and_then(|truth| truth.get(&(planned.tyre, planned.shoulder, location)).copied())
        };
        let labels: Option<Vec<bool>> = planned.locations.iter().map(label).collect();
        Some(Self {
            tyre: planned.tyre.to_string(),
            shoulder: planned.shoulder,
            geometry: plan.geometry,
            locations: planned.locations.iter().map(|&(location, _)| location).collect(),
            angles_deg: planned.locations.iter().map(|&(_, angle)| angle.filter(|a| a.is_finite())).collect(),
            closing_location: closing.next().map(|tap| tap.id.location),
            is_cracked: labels,
            turns: turns_of(plan, planned, records),
        })
    }

    fn serial(&self) -> Option<Serial> {
        Serial::new(&self.tyre).ok()
    }

    fn tap_id(&self, turn: &Turn) -> Option<TapId> {
        let mut id = TapId::new(0, self.serial()?, self.shoulder, 0);
        id.repetition = turn.repetition;
        id.with_offset_mm(turn.offset_mm).ok()?.with_velocity_m_per_s(turn.velocity_m_per_s).ok()
    }

    /// With the taps that a scan of `pattern` has.
    fn like(&self, pattern: &Pattern, normalisation: &Normalisation, casing: usize) -> Shoulder {
        // A ring is cut to the locations of the scan; a line may have others than its reference.
        let all = pattern.all_locations();
        let is_kept = |place: &usize| self.geometry == Geometry::Line || all.contains(&self.locations[*place]);
        let kept: Vec<usize> = (0..self.locations.len()).filter(is_kept).collect();
        let located: Vec<(u32, Option<f64>)> = kept.iter().map(|&k| (self.locations[k], self.angles_deg[k])).collect();
        let mut turns: Vec<(usize, &Turn)> = self
            .turns
            .iter()
            .filter_map(|turn| Some((pattern.conditions.number(&self.tap_id(turn)?)?, turn)))
            .collect();
        turns.sort_by_key(|(condition, turn)| (*condition, turn.repetition));
        let mut shoulder = Shoulder {
            ring: Ring::of(self.geometry, &located, self.closing_location),
            casing,
            turns: Vec::new(),
            is_cracked: match &self.is_cracked {
                Some(labels) => kept.iter().map(|&k| Some(labels[k])).collect(),
                None => vec![None; located.len()],
            },
            repeats: Vec::new(),
        };
        for same in turns.chunk_by(|a, b| a.0 == b.0) {
            for (rank, &(condition, turn)) in same.iter().enumerate() {
                // More repetitions than the scan has are cut to the places of its first.
                let of_rank = pattern.locations(condition, rank);
                let Some(locations) = of_rank.or_else(|| pattern.locations(condition, 0)) else { continue };
                let value = |&place: &usize| {
                    let location = &self.locations[place];
                    let measured = turn.velocities_measured_m_per_s[place].unwrap_or(f64::NAN);
                    match self.geometry == Geometry::Line || locations.binary_search(location).is_ok() {
                        true => normalisation.applied(turn.at(place), turn.velocity_m_per_s, measured),
                        false => Values::default(),
                    }
                };
                let values = kept.iter().map(value).collect();
                let turns = if of_rank.is_some() { &mut shoulder.turns } else { &mut shoulder.repeats };
                turns.push(shoulder::Turn::new(condition, values));
            }
        }
        shoulder
    }

    /// What is wrong with it, if anything is.
    fn fault(&self) -> Option<String> {
        let name = || format!("shoulder {}/{}", self.tyre, self.shoulder);
        let count = self.locations.len();
        if self.serial().is_none() {
            return Some(format!("{:?} is no serial number", self.tyre));
        }
        if !self.locations.is_sorted_by(|a, b| a < b) {
            return Some(format!("the locations of {} are not ascending", name()));
        }
        let lengths = [self.angles_deg.len(), self.is_cracked.as_ref().map_or(count, Vec::len)];
        let columns =
            |turn: &Turn| turn.values.values().map(Vec::len).chain([turn.velocities_measured_m_per_s.len()]).collect();
        let in_turns: Vec<usize> = self.turns.iter().flat_map(|turn| -> Vec<usize> { columns(turn) }).collect();
        if let Some(other) = lengths.into_iter().chain(in_turns).find(|&length| length != count) {
            return Some(format!("{} has {count} locations, and a column of {other}", name()));
        }
        let is_known = |column: &String| Discriminator::ALL.iter().any(|d| d.column() == column);
        if let Some(column) = self.turns.iter().flat_map(|t| t.values.keys()).find(|c| !is_known(c)) {
            return Some(format!("{} has a column {column:?}, which is no discriminator", name()));
        }
        let unnamed = self.turns.iter().find(|turn| self.tap_id(turn).is_none())?;
        Some(format!("{} has a turn at {:?} mm and {:?} m/s", name(), unnamed.offset_mm, unnamed.velocity_m_per_s))
    }
}

fn turns_of(plan: &Plan, planned: &Scan, records: &[Discriminators]) -> Vec<Turn> {
    let is_of_use = |record: &&Discriminators| {
        !record.quality.contains(Quality::REFUSED) && !record.quality.contains(Quality::RETAKE)
    };
    let by_row: BTreeMap<u32, &Discriminators> =
        records.iter().filter(is_of_use).map(|record| (record.plan_index, record)).collect();
    let empty = || vec![None; planned.locations.len()];
    let mut turns: BTreeMap<(Option<u64>, Option<u64>, u16), Turn> = BTreeMap::new();
    for &row in &planned.taps {
        let tap = &plan.taps()[row as usize];
        let place = planned.locations.binary_search_by_key(&tap.id.location, |&(location, _)| location);
        let (Some(record), Ok(place), Purpose::Scan) = (by_row.get(&row), place, tap.purpose) else { continue };
        let velocity_m_per_s = plan.velocity_nominal_m_per_s(row);
        let bits = |of: Option<f64>| of.map(f64::to_bits);
        let key = (bits(tap.id.offset_mm()), bits(velocity_m_per_s), tap.id.repetition);
        let turn = turns.entry(key).or_insert_with(|| Turn {
            offset_mm: tap.id.offset_mm(),
            velocity_m_per_s,
            repetition: tap.id.repetition,
            velocities_measured_m_per_s: empty(),
            values: Discriminator::ALL.into_iter().map(|d| (d.column().to_owned(), empty())).collect(),
        });
        turn.velocities_measured_m_per_s[place] = Some(record.velocity_measured_m_per_s).filter(|v| v.is_finite());
        for which in Discriminator::ALL {
            if let Some(column) = turn.values.get_mut(which.column()) {
                column[place] = record.values.get(which);
            }
        }
    }
    turns.into_values().collect()
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
            return Err(refuse(format!("it was changed: its digest is {}, that of its content {now}", set.digest)));
        }
        if let Some(fault) = set.shoulders.iter().find_map(KnownShoulder::fault) {
            return Err(refuse(fault));
        }
        let mut names: Vec<(&str, u16)> = set.shoulders.iter().map(|s| (s.tyre.as_str(), s.shoulder)).collect();
        names.sort_unstable();
        if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(refuse(format!("it has the shoulder {}/{} twice", twice[0].0, twice[0].1)));
        }
        match set.shoulders.is_empty() {
            true => Err(refuse("it has no shoulder".to_owned())),
            false => Ok(set),
        }
    }

    /// What vouches for its content: the SHA-256 of everything else, hexadecimal.
    pub fn digest(&self) -> &str {
        &self.digest
    }

    fn digest_now(&self) -> String {
        let unsigned = Self { digest: String::new(), ..self.clone() };
        let text = serde_json::to_string(&unsigned).unwrap_or_default();
        Sha256::digest(text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// How many casings its shoulders are of.
    pub(crate) fn casing_count(&self) -> usize {
        let mut tyres: Vec<&str> = self.shoulders.iter().map(|shoulder| shoulder.tyre.as_str()).collect();
        tyres.sort_unstable();
        tyres.dedup();
        tyres.len()
    }

    /// Whether any of its locations is labelled as cracked.
    pub fn is_labelled(&self) -> bool {
        self.shoulders.iter().any(|s| s.is_cracked.as_ref().is_some_and(|labels| labels.contains(&true)))
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
        let meant = |row: u32, id: TapId| id.with_velocity_m_per_s(plan.velocity_nominal_m_per_s(row)).unwrap_or(id);
        let planned: Vec<TapId> = (0..).zip(plan.taps()).map(|(row, tap)| meant(row, tap.id)).collect();
        let names = distinct(planned.iter().copied());
        let conditions = Conditions::of(names.iter().copied().chain(self.taps()));
        let numbers = |taps: &mut dyn Iterator<Item = TapId>| -> BTreeMap<usize, TapId> {
            taps.filter_map(|tap| Some((conditions.number(&tap)?, tap))).collect()
        };
        let known = numbers(&mut self.taps());
        if names.iter().any(|tap| conditions.number(tap).is_some_and(|number| known.contains_key(&number))) {
            return Ok(());
        }
        let planned = numbers(&mut planned.into_iter());
        let name = |of: Option<f64>| of.map_or_else(|| "an unknown".to_owned(), |v| v.to_string());
        let names = |of: BTreeMap<usize, TapId>| {
            let each =
                of.into_values().map(|t| format!("{} mm, {} m/s", name(t.offset_mm()), name(t.velocity_m_per_s())));
            each.collect::<Vec<_>>().join("; ")
        };
        Err(Error::NothingInCommon { known: names(known), planned: names(planned) })
    }

    /// Refuses a plan whose rings have other locations than its own: an arc of so many would be another length. A plan may leave
    /// some of them out.
    pub(crate) fn check_locations(&self, plan: &Plan) -> Result<(), Error> {
        let of_ring = self.shoulders.iter().filter(|shoulder| shoulder.geometry == Geometry::Ring);
        let Some(known) = of_ring.max_by_key(|shoulder| shoulder.locations.len()) else { return Ok(()) };
        for scan in plan.scans().iter().filter(|_| plan.geometry == Geometry::Ring) {
            let is_known = |&(location, angle_deg): &(u32, Option<f64>)| {
                let place = known.locations.binary_search(&location).ok()?;
                let apart = angle_deg.zip(known.angles_deg[place]).map(|(a, b)| (a - b).abs());
                Some(apart.is_none_or(|apart| apart < ANGLE_SLACK_DEG))
            };
            let is_part = scan.locations.iter().all(|located| is_known(located) == Some(true));
            let (known, planned) = (known.locations.len(), scan.locations.len());
            if known != planned && !is_part {
                return Err(Error::OtherLocations { known, planned });
            }
        }
        Ok(())
    }

    /// What it teaches of scans of `pattern`; `None` where nothing of them varies. Computed once for a pattern.
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

impl Turn {
    /// The discriminators at `place`.
    fn at(&self, place: usize) -> Values {
        let mut values = Values::default();
        for which in Discriminator::ALL {
            values.set(which, self.values.get(which.column()).and_then(|column| column[place]));
        }
        values
    }
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
