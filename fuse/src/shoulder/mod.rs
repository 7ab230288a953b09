//! The results of one shoulder, turn by turn: the input of every index.

pub(crate) mod conditions;
pub(crate) mod ring;
pub(crate) mod velocity;

use tapline_wire::{Discriminator, Values};

use crate::shoulder::ring::Ring;

/// The results of one shoulder.
#[derive(Debug, Clone)]
pub(crate) struct Shoulder {
    /// Its locations, and which of them are neighbours.
    pub ring: Ring,
    /// Number of its casing among those it is compared with.
    pub casing: usize,
    /// Its turns, ordered by condition and repetition.
    pub turns: Vec<Turn>,
    /// For each place whether it is cracked, where that is known.
    pub is_cracked: Vec<Option<bool>>,
}

/// Once around a shoulder at one offset and velocity.
#[derive(Debug, Clone)]
pub(crate) struct Turn {
    /// Number of its offset and velocity.
    pub(crate) condition: usize,
    /// The discriminators by place; all absent where no tap came.
    pub(crate) values: Vec<Values>,
    /// Their logarithms, `[discriminator][place]`, NaN where absent.
    logs: Vec<Vec<f64>>,
    /// For a second reading: by place, whether it is a control. Its level is found from these alone. `None` for a first reading, whose
    /// level is found from all places.
    pub(crate) controls: Option<Vec<bool>>,
}

impl Turn {
    /// A turn of `values`.
    pub(crate) fn new(condition: usize, values: Vec<Values>) -> Self {
        let log = |which: Discriminator| values.iter().map(|of_tap| log_of(which, of_tap)).collect();
        let logs = Discriminator::ALL.into_iter().map(log).collect();
        Self { condition, values, logs, controls: None }
    }

    /// A second reading, whose level is found from its controls.
    pub(crate) fn second_reading(condition: usize, values: Vec<Values>, controls: Vec<bool>) -> Self {
        Self { controls: Some(controls), ..Self::new(condition, values) }
    }

    /// Whether its level is looked for at `place`.
    pub(crate) fn counts_for_level(&self, place: usize) -> bool {
        self.controls.as_ref().is_none_or(|controls| controls[place])
    }

    /// The logarithm of `which` by place, NaN where it is absent or has none.
    pub(crate) fn log(&self, which: Discriminator) -> &[f64] {
        &self.logs[which as usize]
    }
}

/// A gain multiplies all values of a turn: it shifts their logarithms, and subtracting the level removes it.
///
/// PR is a part of a whole, 0 to 1: ln(x / (1 - x)) keeps a rise near 1 as visible as one near 0.
fn log_of(which: Discriminator, values: &Values) -> f64 {
    let Some(x) = values.get(which) else { return f64::NAN };
    let log = if which == Discriminator::Pr { (x / (1.0 - x)).ln() } else { x.ln() };
    if log.is_finite() { log } else { f64::NAN }
}

/// The value of `which` that has this logarithm: the reverse of [`Turn::log`].
pub(crate) fn value_of(which: Discriminator, log: f64) -> f64 {
    if which == Discriminator::Pr { 1.0 / (1.0 + (-log).exp()) } else { log.exp() }
}

impl Shoulder {
    /// How many places it has.
    pub(crate) fn place_count(&self) -> usize {
        self.ring.len()
    }

    /// Only its first reading: without what was tapped again.
    pub(crate) fn first_reading(&self) -> Self {
        self.with_turns(|turn| turn.controls.is_none())
    }

    /// Only what was tapped again.
    pub(crate) fn second_reading(&self) -> Self {
        self.with_turns(|turn| turn.controls.is_some())
    }

    fn with_turns(&self, is_kept: impl Fn(&Turn) -> bool) -> Self {
        let turns = self.turns.iter().filter(|turn| is_kept(turn)).cloned().collect();
        Self { ring: self.ring.clone(), casing: self.casing, turns, is_cracked: self.is_cracked.clone() }
    }

    /// Places that are not known to be cracked.
    pub(crate) fn sound(&self) -> Vec<bool> {
        self.is_cracked.iter().map(|&label| label != Some(true)).collect()
    }
}
