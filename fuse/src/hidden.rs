//! Sound or cracked as a hidden state that lasts along the ring: the chance of a crack at every place.
//!
//! A two-state Markov chain runs around the places; a sound place's index is standard normal, a cracked one's is
//! shifted. The ring has no first place: it is read once for each state that place 0 may have and must come back to,
//! and both readings are weighted by their evidence, which is exact. Each reading is that of a chain with given ends
//! (Rabiner, Proceedings of the IEEE 77 (1989) 257). Values are taken to be independent given the states: give the
//! index before it is averaged over neighbours.

use crate::Error;

/// Beyond this a value says no more.
const CLIP: f64 = 1e3;

/// Greatest arc length and shift that can be set.
const MOST: f64 = 1e3;

/// Range of the width of cracked places' values.
const SD: (f64, f64) = (0.1, 100.0);

/// Range of a shift that is learned: below it sound and cracked are not two kinds, above it no value is needed.
const SHIFT: (f64, f64) = (1.0, 20.0);

/// Rounds of learning the shift; more of them move it by less than 0.02.
const ROUNDS: usize = 8;

/// What sound and cracked places are taken to be like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hidden {
    /// Places in a row that a crack is expected to hold, 1 to 1000.
    pub arc_length: f64,
    /// Part of all places that is expected to be cracked; above 0 and below `arc_length/(1 + arc_length)`.
    pub share: f64,
    /// Mean of a cracked place's value, in standard deviations of a sound one; above 0 to 1000.
    pub shift: f64,
    /// Standard deviation of a cracked place's value, in those of a sound one; 0.1 to 100.
    pub sd: f64,
}

impl Default for Hidden {
    /// A crack of five places in one ring of four, that stands out by two standard deviations: a crack that stands out
    /// by more is found all the same, one that stands out by less than is expected is lost.
    fn default() -> Self {
        Self { arc_length: 5.0, share: 0.0125, shift: 2.0, sd: 1.0 }
    }
}

/// What the values say of every place.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct HiddenStates {
    /// Chance that a place is cracked, given all values.
    pub cracked: Vec<f64>,
    /// The most likely states as a whole: true where cracked. Ties go to sound.
    pub is_cracked: Vec<bool>,
    /// Chance that no place is cracked. 1 of no places.
    pub all_sound: f64,
}

/// The states behind `z`, standardised values that rise with damage; `is_ring` if the last place is next to the first.
///
/// A place without a value, or whose value is not a number, is judged by its neighbours; values beyond +-1000 count as
/// that. The odds of a crack never fall as a value rises: where two normal curves of different widths would cross a
/// second time, the odds are held. O(places).
///
/// # Errors
/// [`Error::OutOfRange`] for a setting outside its bounds.
pub fn hidden_states(z: &[Option<f64>], is_ring: bool, hidden: Hidden) -> Result<HiddenStates, Error> {
    let chain = Chain::of(hidden)?;
    let odds: Vec<f64> = z.iter().map(|&z| hidden.log_odds(z)).collect();
    let readings = chain.readings(is_ring);
    let passes: Vec<(Pass, Pass)> =
        readings.iter().map(|reading| (chain.forward(&odds, reading), chain.backward(&odds, reading))).collect();
    let weight = |place: usize, state: usize| {
        passes.iter().fold(f64::NEG_INFINITY, |sum, (to, from)| log_add(sum, to[place][state] + from[place][state]))
    };
    let cracked: Vec<f64> = (0..z.len())
        .map(|place| {
            let (sound, cracked) = (weight(place, 0), weight(place, 1));
            (cracked - log_add(sound, cracked)).exp()
        })
        .collect();
    let evidence = if z.is_empty() { 0.0 } else { log_add(weight(0, 0), weight(0, 1)) };
    let all_sound = match z.len() {
        0 => 1.0,
        places => (chain.all_sound(places, is_ring) - evidence).exp().clamp(0.0, 1.0),
    };
    Ok(HiddenStates { cracked, is_cracked: chain.best_path(&odds, &readings), all_sound })
}

/// The shift that the cracked places of `z` suggest, to be set as [`Hidden::shift`]: between 1 and 20.
///
/// Rounds of expectation and maximisation, in which the shift given counts as one crack of the expected length: a ring
/// without a crack keeps about what was given. Give a low one. Log loss of the chances a ring, over 400 simulated rings
/// of 100 places, three in four with a crack of 3 to 8:
///
/// | crack stands out by | shift 2 | learned from 2 | shift 3 | learned from 3 | shift known |
/// |---|---|---|---|---|---|
/// | 1.5 | 9.4 | 9.3 | 18.1 | 16.7 | 7.8 |
/// | 2 | 4.0 | 4.0 | 7.7 | 6.7 | 4.0 |
/// | 3 | 1.5 | 1.2 | 1.0 | 1.0 | 1.0 |
/// | 4.5 | 1.3 | 0.5 | 0.4 | 0.2 | 0.1 |
/// | 6 | 1.3 | 0.3 | 0.4 | 0.1 | 0.0 |
///
/// # Errors
/// As [`hidden_states`].
pub fn fitted_shift(z: &[Option<f64>], is_ring: bool, hidden: Hidden) -> Result<f64, Error> {
    Ok(learned(z, is_ring, hidden, ROUNDS)?.shift)
}

/// `hidden` with the shift that so many rounds learn.
fn learned(z: &[Option<f64>], is_ring: bool, hidden: Hidden, rounds: usize) -> Result<Hidden, Error> {
    let mut learned = hidden;
    for _ in 0..rounds {
        let states = hidden_states(z, is_ring, learned)?;
        let (mut sum, mut weight) = (hidden.arc_length * hidden.shift, hidden.arc_length);
        for (&z, &cracked) in z.iter().zip(&states.cracked) {
            if let Some(z) = number(z) {
                sum += cracked * z;
                weight += cracked;
            }
        }
        learned.shift = (sum / weight).clamp(SHIFT.0, SHIFT.1);
    }
    Ok(learned)
}

/// A value that is a number, clipped.
fn number(z: Option<f64>) -> Option<f64> {
    z.filter(|z| !z.is_nan()).map(|z| z.clamp(-CLIP, CLIP))
}

impl Hidden {
    /// Logarithm of the odds of cracked against sound that one value gives; never falling with it.
    fn log_odds(&self, z: Option<f64>) -> f64 {
        let Some(z) = number(z) else { return 0.0 };
        // The derivative z - (z - shift)/sd^2 is 0 here; for sd = 1 nowhere.
        let turn = self.shift / (1.0 - self.sd * self.sd);
        let held = if self.sd > 1.0 && z < turn || self.sd < 1.0 && z > turn { turn } else { z };
        let from_shift = (held - self.shift) / self.sd;
        0.5 * held * held - 0.5 * from_shift * from_shift - self.sd.ln()
    }
}

/// One log weight for each state at each place.
type Pass = Vec<[f64; 2]>;

/// One way to read the places: log weights of the state of the first before its value, and of the last after it.
struct Reading {
    start: [f64; 2],
    end: [f64; 2],
}

/// Logarithms of the chances of a state after a state, and of the first on a line.
struct Chain {
    step: [[f64; 2]; 2],
    first: [f64; 2],
}

impl Chain {
    fn of(hidden: Hidden) -> Result<Self, Error> {
        let within = |name, value: f64, low, high| {
            if value >= low && value <= high { Ok(()) } else { Err(Error::OutOfRange { name, value, low, high }) }
        };
        let Hidden { arc_length, share, shift, sd } = hidden;
        within("arc_length", arc_length, 1.0, MOST)?;
        let high = arc_length / (1.0 + arc_length);
        within("share", share, f64::MIN_POSITIVE, high)?;
        within("shift", shift, f64::MIN_POSITIVE, MOST)?;
        within("sd", sd, SD.0, SD.1)?;
        // In balance as many arcs begin as end: share/arc_length = (1 - share) x begins.
        let (begins, ends) = (share / (arc_length * (1.0 - share)), 1.0 / arc_length);
        if begins >= 1.0 {
            // No two sound places would ever meet.
            return Err(Error::OutOfRange { name: "share", value: share, low: f64::MIN_POSITIVE, high });
        }
        let step = [[(-begins).ln_1p(), begins.ln()], [ends.ln(), (-ends).ln_1p()]];
        Ok(Self { step, first: [(-share).ln_1p(), share.ln()] })
    }

    /// A line is read once; a ring once for each state of the first place, which is also the one after the last.
    fn readings(&self, is_ring: bool) -> Vec<Reading> {
        if !is_ring {
            return vec![Reading { start: self.first, end: [0.0; 2] }];
        }
        let back_to = |state: usize| {
            let mut start = [f64::NEG_INFINITY; 2];
            start[state] = 0.0;
            Reading { start, end: [self.step[0][state], self.step[1][state]] }
        };
        vec![back_to(0), back_to(1)]
    }

    /// Log weight of all paths up to and with each place.
    fn forward(&self, odds: &[f64], reading: &Reading) -> Pass {
        let mut pass = Pass::with_capacity(odds.len());
        let mut before = reading.start;
        for &odds in odds {
            before[1] += odds;
            pass.push(before);
            let into = |to: usize| log_add(before[0] + self.step[0][to], before[1] + self.step[1][to]);
            before = [into(0), into(1)];
        }
        pass
    }

    /// Log weight of all paths after each place.
    fn backward(&self, odds: &[f64], reading: &Reading) -> Pass {
        let mut pass = vec![[0.0; 2]; odds.len()];
        let mut after = reading.end;
        for (place, &odds) in odds.iter().enumerate().rev() {
            pass[place] = after;
            let out_of = |from: usize| log_add(self.step[from][0] + after[0], self.step[from][1] + odds + after[1]);
            after = [out_of(0), out_of(1)];
        }
        pass
    }

    /// Log weight of the path without a crack.
    fn all_sound(&self, places: usize, is_ring: bool) -> f64 {
        let steps = (places - 1) as f64 * self.step[0][0];
        steps + if is_ring { self.step[0][0] } else { self.first[0] }
    }

    /// The path of the greatest weight over all readings.
    fn best_path(&self, odds: &[f64], readings: &[Reading]) -> Vec<bool> {
        let mut best = (f64::NEG_INFINITY, vec![false; odds.len()]);
        for reading in readings {
            let path = self.best_of(odds, reading);
            if path.0 > best.0 {
                best = path;
            }
        }
        best.1
    }

    /// The path of the greatest weight of one reading (Viterbi), with its log weight.
    fn best_of(&self, odds: &[f64], reading: &Reading) -> (f64, Vec<bool>) {
        // For each place but the first and each state of it: whether the best way to there is by a crack before.
        let mut by_crack: Vec<[bool; 2]> = Vec::with_capacity(odds.len());
        let mut weights = reading.start;
        for (place, &odds) in odds.iter().enumerate() {
            if place > 0 {
                let ways = [0, 1].map(|to| (weights[0] + self.step[0][to], weights[1] + self.step[1][to]));
                by_crack.push(ways.map(|(sound, cracked)| cracked > sound));
                weights = ways.map(|(sound, cracked)| if cracked > sound { cracked } else { sound });
            }
            weights[1] += odds;
        }
        let (sound, cracked) = (weights[0] + reading.end[0], weights[1] + reading.end[1]);
        let mut path = vec![cracked > sound; odds.len()];
        for place in (1..odds.len()).rev() {
            path[place - 1] = by_crack[place - 1][usize::from(path[place])];
        }
        (if cracked > sound { cracked } else { sound }, path)
    }
}

/// ln(exp(left) + exp(right)); minus infinity is a weight of 0.
fn log_add(left: f64, right: f64) -> f64 {
    let (less, more) = if left < right { (left, right) } else { (right, left) };
    if more == f64::NEG_INFINITY { more } else { more + (less - more).exp().ln_1p() }
}

#[cfg(test)]
mod tests;
