//! What the last casings of a station have in common points to its rig.

use std::collections::{BTreeMap, VecDeque};
use std::fmt;

use serde::{Deserialize, Serialize};
use tapline_wire::{Discriminator, Reasons};

use crate::shown::whole::{FORCE_GAIN, SOUND_GAIN, Whole};

/// How many of a station's last casings are examined.
const LAST: usize = 8;

/// A sign needs at least so many casings, and also half of the last ones.
const MANY: usize = 4;

/// A sign is over after so many casings in a row without it.
const OVER_AFTER: usize = 3;

/// Reasons that casings get when the rig has changed, but also for damage all round or another kind of casing.
const REASONS: [Reasons; 5] = [
    Reasons::LEVEL_OFF,
    Reasons::SCATTER_OFF,
    Reasons::SCATTER_LOW,
    Reasons::FORCE_OFF,
    Reasons::DISCRIMINATORS_ABSENT,
];

/// Shoulders that lack taps say nothing of the rig.
const INCOMPLETE: Reasons = Reasons::NOT_ENDED.union(Reasons::TAPS_REFUSED).union(Reasons::TAPS_MISSING);

/// Nor do casings with damage: if part of the ring is cracked, that alone changes its level and its scatter.
const CRACKED: Reasons = Reasons::DAMAGE;

/// How far a level must be from the reference's to be a sign. That of the sound: 2 dB. Sound casings differ less in the force.
const GAINS: [(&str, Discriminator, f64); 2] =
    [(SOUND_GAIN, Discriminator::A1, 1.25), (FORCE_GAIN, Discriminator::FMax, 1.1)];

/// What the signs ask people to do.
pub(crate) const ASKS: &str =
    "check the rig, unless these casings are cracked all round or of another kind than those of the reference";

/// Something that the casings of a station have in common.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Sign {
    /// A reason of verdicts, or one of [`GAINS`].
    pub name: String,
    /// How many casings have it.
    pub count: usize,
    /// The first of them.
    pub first: String,
    /// The last of them.
    pub last: String,
    /// What the name does not say: the median over the last of these casings.
    pub detail: Option<String>,
}

impl fmt::Display for Sign {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, count, first, last, detail } = self;
        write!(f, "{name} on {count} casings, {first} to {last}")?;
        detail.iter().try_for_each(|detail| write!(f, ": {detail}"))
    }
}

/// A sign of a station; the station still has it unless it is over.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct StationSign {
    pub station: u16,
    #[serde(flatten)]
    pub sign: Sign,
    pub is_over: bool,
}

impl fmt::Display for StationSign {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "station {}: {}", self.station, self.sign)
    }
}

/// What was seen of a casing.
#[derive(Debug)]
struct Seen {
    casing: String,
    signs: Vec<&'static str>,
    whole: Whole,
}

/// Watches the rig of one station.
#[derive(Debug, Default)]
struct RigWatch {
    last: VecDeque<Seen>,
    /// The signs that it has now.
    signs: Vec<Sign>,
}

/// Watches the rigs of all stations.
#[derive(Debug, Default)]
pub(crate) struct Rigs {
    stations: BTreeMap<u16, RigWatch>,
}

impl Rigs {
    /// Adds a casing: for each shoulder the reasons of its verdict, and its properties as a whole. Returns the
    /// signs that have begun with it, and those that are over.
    ///
    /// A station has a sign when 4 and half of its last 8 casings without damage have it, until 3 in a row do not.
    pub(crate) fn add<'a>(
        &mut self,
        station: u16,
        casing: &str,
        shoulders: impl IntoIterator<Item = (Reasons, &'a Whole)>,
    ) -> Vec<StationSign> {
        let shoulders = shoulders.into_iter().filter(|(reasons, _)| !reasons.intersects(INCOMPLETE));
        let (reasons, wholes): (Vec<Reasons>, Vec<&Whole>) = shoulders.unzip();
        if reasons.is_empty() || reasons.iter().any(|reasons| reasons.intersects(CRACKED)) {
            return Vec::new();
        }
        let whole = Whole::median(wholes.into_iter());
        let watch = self.stations.entry(station).or_default();
        let changed = watch.add(Seen { casing: casing.to_owned(), signs: signs(&reasons, &whole), whole });
        changed.into_iter().map(|(sign, is_over)| StationSign { station, sign, is_over }).collect()
    }

    /// The signs that `station` has.
    pub(crate) fn of(&self, station: u16) -> &[Sign] {
        self.stations.get(&station).map_or(&[], |watch| &watch.signs)
    }

    /// The signs that stations have.
    pub(crate) fn all(&self) -> impl Iterator<Item = StationSign> {
        let of = |(&station, watch): (&u16, &'_ RigWatch)| {
            let signs = watch.signs.clone().into_iter();
            signs.map(move |sign| StationSign { station, sign, is_over: false }).collect::<Vec<_>>()
        };
        self.stations.iter().flat_map(of)
    }
}

/// The signs in a casing with these shoulders: reasons that half of them have, and the gains.
fn signs(shoulders: &[Reasons], whole: &Whole) -> Vec<&'static str> {
    let is_of_casing =
        |reason: Reasons| 2 * shoulders.iter().filter(|of| of.contains(reason)).count() >= shoulders.len();
    let named = Reasons::ALL.iter().filter(|(reason, _)| REASONS.contains(reason) && is_of_casing(*reason));
    let is_off = |&&(_, which, most): &&(&str, Discriminator, f64)| {
        whole.level.get(which.name()).is_some_and(|times| !(1.0 / most..=most).contains(times))
    };
    // With more casings the reference itself says whether the force is off.
    let is_unknown = is_of_casing(Reasons::LEVEL_UNKNOWN);
    let gains = GAINS.iter().filter(is_off).map(|&(name, ..)| name).filter(|name| *name != FORCE_GAIN || is_unknown);
    named.map(|&(_, name)| name).chain(gains).collect()
}

impl RigWatch {
    /// Adds a casing; returns the signs that have begun, and with `true` those that are over.
    fn add(&mut self, seen: Seen) -> Vec<(Sign, bool)> {
        let mut changed = Vec::new();
        self.last.push_back(seen);
        if self.last.len() > LAST {
            self.last.pop_front();
        }
        let Some(newest) = self.last.back() else { return changed };
        let has = |seen: &Seen, name: &str| seen.signs.contains(&name);
        for mut sign in std::mem::take(&mut self.signs) {
            let is_over = self.last.iter().rev().take(OVER_AFTER).all(|seen| !has(seen, &sign.name));
            if has(newest, &sign.name) {
                (sign.count, sign.last) = (sign.count + 1, newest.casing.clone());
                sign.detail = detail(&self.last, &sign.name);
            }
            match is_over {
                true => changed.push((sign, true)),
                false => self.signs.push(sign),
            }
        }
        // Casings from before a repair start no new sign.
        for (sign, _) in &changed {
            self.last.iter_mut().for_each(|seen| seen.signs.retain(|name| *name != sign.name));
        }
        let Some(newest) = self.last.back() else { return changed };
        for &name in &newest.signs {
            if self.signs.iter().any(|sign| sign.name == name) {
                continue;
            }
            let having: Vec<usize> = (0..self.last.len()).filter(|&place| has(&self.last[place], name)).collect();
            if having.len() < MANY || 2 * having.len() < self.last.len() {
                continue;
            }
            // From its first casing on, three in four have it: a stray one before them does not count.
            let is_first =
                |&(order, place): &(usize, &usize)| 4 * (having.len() - order) >= 3 * (self.last.len() - place);
            let (order, &place) = having.iter().enumerate().find(is_first).unwrap_or((0, &having[0]));
            let sign = Sign {
                name: name.to_owned(),
                count: having.len() - order,
                first: self.last[place].casing.clone(),
                last: newest.casing.clone(),
                detail: detail(&self.last, name),
            };
            changed.push((sign.clone(), false));
            self.signs.push(sign);
        }
        changed
    }
}

/// What the name of a sign does not say, for the casings that have it.
fn detail(last: &VecDeque<Seen>, name: &str) -> Option<String> {
    let having = last.iter().filter(|seen| seen.signs.contains(&name)).map(|seen| &seen.whole);
    Whole::median(having).detail(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whole(f_max: f64, a_1: f64) -> Whole {
        Whole { level: [("f_max".to_owned(), f_max), ("a_1".to_owned(), a_1)].into(), ..Whole::default() }
    }

    /// What a station says of casings, ..., two shoulders each with the same reasons.
    fn said(casings: &[(Reasons, Whole)]) -> Vec<String> {
        let mut rigs = Rigs::default();
        let mut said = Vec::new();
        for (k, (reasons, whole)) in casings.iter().enumerate() {
            let changed = rigs.add(1, &format!("A-{k}"), [(*reasons, whole), (Reasons::default(), whole)]);
            said.extend(changed.iter().map(|of_station| {
                format!("A-{k} {} {of_station}", if of_station.is_over { "ends" } else { "begins" })
            }));
        }
        said.extend(rigs.all().map(|of_station| format!("has {of_station}")));
        said
    }

    /// Catches a sign of a stray casing, one that never begins, ends or comes again, and a wrong first, last or count.
    #[test]
    fn a_sign_is_what_half_of_the_last_casings_have() {
        let of = |k: usize| if (10..20).contains(&k) || k == 6 { Reasons::LEVEL_OFF } else { Reasons::SUSPECT };
        let casings: Vec<_> =
            (0..30).map(|k| (of(k), whole(if of(k) == Reasons::LEVEL_OFF { 0.8 } else { 1.0 }, 1.0))).collect();
        let words = "station 1: level_off on";
        assert_eq!(
            said(&casings),
            [
                format!("A-12 begins {words} 3 casings, A-10 to A-12: f_max -20.0 % relative to the reference's"),
                format!("A-22 ends {words} 10 casings, A-10 to A-19: f_max -20.0 % relative to the reference's"),
            ]
        );
        assert_eq!(said(&casings[..12]), [""; 0]);
        assert!(
            said(&casings[..20])[1].starts_with(&format!("has {words} 10 casings, A-10 to A-19")),
            "{:?}",
            said(&casings[..20])
        );
    }

    /// Catches casings with damage or missing taps that give a sign, a change of gain that gives none, and two
    /// stations that are mistaken for one.
    #[test]
    fn a_sign_is_of_whole_casings_and_of_one_station() {
        let absent = Reasons::DISCRIMINATORS_ABSENT;
        for more in [Reasons::TAPS_REFUSED, Reasons::DAMAGE] {
            assert_eq!(said(&vec![(absent | more, whole(1.0, 1.0)); 9]), [""; 0]);
        }
        // By few casings alone the level of the force is a sign of its own.
        let softer = |reasons| vec![(reasons, whole(0.8, 1.0)); 5];
        assert_eq!(said(&softer(Reasons::default())), [""; 0]);
        let of_force = "station 1: force_gain on 5 casings, A-0 to A-4: f_max -20.0 % relative to the reference's";
        assert_eq!(said(&softer(Reasons::LEVEL_UNKNOWN))[1], format!("has {of_force}"));
        let quiet = vec![(Reasons::default(), whole(1.0, 0.5)); 5];
        let gain = "station 1: sound_gain on 5 casings, A-0 to A-4: a_1 -50.0 % relative to the reference's";
        assert_eq!(said(&quiet)[1], format!("has {gain}"));
        let mut rigs = Rigs::default();
        for k in 0..6 {
            assert_eq!(rigs.add(k % 2, "A", [(absent, &whole(1.0, 1.0))]), [], "{k}");
        }
    }
}
