//! A shoulder of a reference: the results of its taps, and what is known of its locations.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use tapline_wire::{
    Discriminator, Discriminators, Geometry, Plan, Purpose, Quality, Scan, Serial, TapId, Truth, Values,
};

use crate::Error;
use crate::reference::pattern::Pattern;
use crate::shoulder::conditions::edge_distance_mm;
use crate::shoulder::ring::Ring;
use crate::shoulder::velocity::Normalisation;
use crate::shoulder::{Shoulder, Turn};

/// A location of a scan matches one of the reference if their angles differ by less.
const ANGLE_SLACK_DEG: f64 = 0.5;

/// The results of one shoulder.
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
    pub turns: Vec<KnownTurn>,
}

/// The taps of one shoulder at one offset, velocity and repetition; by location, `None` where nothing came.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnownTurn {
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
    /// Whether a ring of the locations `located`, with their angles, has as many as its own or is part of it.
    pub(crate) fn has_ring(&self, located: &[(u32, Option<f64>)]) -> bool {
        let is_known = |&(location, angle_deg): &(u32, Option<f64>)| {
            self.locations.binary_search(&location).is_ok_and(|place| {
                let apart = angle_deg.zip(self.angles_deg[place]).map(|(a, b)| (a - b).abs());
                apart.is_none_or(|apart| apart < ANGLE_SLACK_DEG)
            })
        };
        self.locations.len() == located.len() || located.iter().all(is_known)
    }

    /// At how many locations something came of a tap at the belt edge.
    pub(crate) fn edge_length(&self) -> usize {
        let distance = |turn: &&KnownTurn| edge_distance_mm(turn.offset_mm);
        let Some(edge) = self.turns.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))) else { return 0 };
        let turns = || self.turns.iter().filter(|turn| distance(turn).total_cmp(&distance(&edge)).is_eq());
        let came = |place: &usize| turns().any(|turn| turn.values.values().any(|column| column[*place].is_some()));
        (0..self.locations.len()).filter(came).count()
    }

    /// The results of scan number `scan` of `plan`, with its locations labelled by `truth` if that is given.
    ///
    /// Refused taps, closing ones and second readings are left out. `None` for a scan that is not planned.
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

    pub(super) fn serial(&self) -> Option<Serial> {
        Serial::new(&self.tyre).ok()
    }

    pub(super) fn tap_id(&self, turn: &KnownTurn) -> Option<TapId> {
        let mut id = TapId::new(0, self.serial()?, self.shoulder, 0);
        id.repetition = turn.repetition;
        id.with_offset_mm(turn.offset_mm).ok()?.with_velocity_m_per_s(turn.velocity_m_per_s).ok()
    }

    /// With the taps that a scan of `pattern` has.
    pub(super) fn like(&self, pattern: &Pattern, normalisation: &Normalisation, casing: usize) -> Shoulder {
        // A ring is cut to the locations of the scan; a line may have others than its reference.
        let all = pattern.all_locations();
        let is_kept = |place: &usize| self.geometry == Geometry::Line || all.contains(&self.locations[*place]);
        let kept: Vec<usize> = (0..self.locations.len()).filter(is_kept).collect();
        let located: Vec<(u32, Option<f64>)> = kept.iter().map(|&k| (self.locations[k], self.angles_deg[k])).collect();
        let number = |turn| Some((pattern.conditions.number(&self.tap_id(turn)?)?, turn));
        let mut turns: Vec<(usize, &KnownTurn)> = self.turns.iter().filter_map(number).collect();
        turns.sort_by_key(|(condition, turn)| (*condition, turn.repetition));
        let mut shoulder = Shoulder {
            ring: Ring::of(self.geometry, &located, self.closing_location),
            casing,
            turns: Vec::new(),
            is_cracked: match &self.is_cracked {
                Some(labels) => kept.iter().map(|&k| Some(labels[k])).collect(),
                None => vec![None; located.len()],
            },
        };
        // The values of `turn` at the `locations` that the scan has.
        let values = |condition: usize, turn: &KnownTurn, locations: &[u32]| {
            let value = |&place: &usize| {
                let location = &self.locations[place];
                let measured = turn.velocities_measured_m_per_s[place].unwrap_or(f64::NAN);
                match self.geometry == Geometry::Line || locations.binary_search(location).is_ok() {
                    true => normalisation.applied(turn.at(place), turn.velocity_m_per_s, measured),
                    false => Values::default(),
                }
            };
            Turn::new(condition, kept.iter().map(value).collect())
        };
        for same in turns.chunk_by(|a, b| a.0 == b.0) {
            for (rank, &(condition, turn)) in same.iter().enumerate() {
                // Repetitions beyond those of the scan do not count.
                if let Some(locations) = pattern.locations(condition, rank) {
                    shoulder.turns.push(values(condition, turn, locations));
                }
            }
        }
        shoulder
    }

    /// What is wrong with it, if anything is.
    fn fault(&self) -> Option<String> {
        let name = || format!("shoulder {}/{}", self.tyre, self.shoulder);
        let count = self.locations.len();
        if self.serial().is_none() {
            return Some(format!("{:?} is not a serial number", self.tyre));
        }
        if !self.locations.is_sorted_by(|a, b| a < b) {
            return Some(format!("the locations of {} are not ascending", name()));
        }
        let lengths = [self.angles_deg.len(), self.is_cracked.as_ref().map_or(count, Vec::len)];
        let columns = |turn: &KnownTurn| {
            turn.values.values().map(Vec::len).chain([turn.velocities_measured_m_per_s.len()]).collect()
        };
        let in_turns: Vec<usize> = self.turns.iter().flat_map(|turn| -> Vec<usize> { columns(turn) }).collect();
        if let Some(other) = lengths.into_iter().chain(in_turns).find(|&length| length != count) {
            return Some(format!("{} has {count} locations, and a column of {other}", name()));
        }
        let is_known = |column: &String| Discriminator::ALL.iter().any(|d| d.column() == column);
        if let Some(column) = self.turns.iter().flat_map(|t| t.values.keys()).find(|c| !is_known(c)) {
            return Some(format!("{} has a column {column:?}, which is not a discriminator", name()));
        }
        let unnamed = self.turns.iter().find(|turn| self.tap_id(turn).is_none())?;
        let shown = |value: Option<f64>| value.map_or_else(|| "unknown".to_owned(), |value| value.to_string());
        let (offset, velocity) = (shown(unnamed.offset_mm), shown(unnamed.velocity_m_per_s));
        Some(format!("{} has a turn at {offset} mm and {velocity} m/s, which no tap can have", name()))
    }
}

/// Checks that `shoulders` can be a reference: that there are any, each only once, and that the columns of each fit each other.
pub(super) fn check_shoulders(shoulders: &[KnownShoulder]) -> Result<(), Error> {
    let refuse = |reason: String| Err(Error::NotAReference { reason });
    if shoulders.is_empty() {
        return refuse("it has no shoulder".to_owned());
    }
    if let Some(fault) = shoulders.iter().find_map(KnownShoulder::fault) {
        return refuse(fault);
    }
    let mut names: Vec<(&str, u16)> = shoulders.iter().map(|s| (s.tyre.as_str(), s.shoulder)).collect();
    names.sort_unstable();
    match names.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(twice) => refuse(format!("it has the shoulder {}/{} twice", twice[0].0, twice[0].1)),
        None => Ok(()),
    }
}

/// What came of the taps, turn by turn, but for those that closed a ring or were made again.
fn turns_of(plan: &Plan, planned: &Scan, records: &[Discriminators]) -> Vec<KnownTurn> {
    let is_of_use = |record: &&Discriminators| {
        !record.quality.contains(Quality::REFUSED) && !record.quality.contains(Quality::RETAKE)
    };
    let by_row: BTreeMap<u32, &Discriminators> =
        records.iter().filter(is_of_use).map(|record| (record.plan_index, record)).collect();
    let empty = || vec![None; planned.locations.len()];
    let mut turns: BTreeMap<(Option<u64>, Option<u64>, u16), KnownTurn> = BTreeMap::new();
    for &row in &planned.taps {
        let tap = &plan.taps()[row as usize];
        let place = planned.locations.binary_search_by_key(&tap.id.location, |&(location, _)| location);
        let (Some(record), Ok(place), true) = (by_row.get(&row), place, tap.purpose == Purpose::Scan) else { continue };
        let velocity_m_per_s = plan.velocity_nominal_m_per_s(row);
        let bits = |of: Option<f64>| of.map(f64::to_bits);
        let key = (bits(tap.id.offset_mm()), bits(velocity_m_per_s), tap.id.repetition);
        let turn = turns.entry(key).or_insert_with(|| KnownTurn {
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

impl KnownTurn {
    /// The discriminators at `place`.
    pub(super) fn at(&self, place: usize) -> Values {
        let mut values = Values::default();
        for which in Discriminator::ALL {
            values.set(which, self.values.get(which.column()).and_then(|column| column[place]));
        }
        values
    }
}
