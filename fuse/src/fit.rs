//! What a reference teaches: the scale of every discriminator, the index of them, and how conditions become one.

use std::collections::BTreeMap;

use crate::cells::{Cells, Taps};
use crate::combine::Largest;
use crate::condition::Conditions;
use crate::grid::Grid;
use crate::indices::{Example, Index, Lda, LearnError, LogOdds, Mahalanobis, Mean, Signs, Weighted};
use crate::level::Level;
use crate::repeat::{repeat_sds, score_sds};
use crate::shoulder::{Reading, Shoulder};
use crate::stats::Spread;
use crate::yardstick::Yardstick;
use crate::{Combine, FuseConfig, IndexKind};

/// Whichever places of each shoulder are meant.
pub(crate) type Kept = Vec<Vec<bool>>;

/// A fitted index.
#[derive(Debug)]
pub(crate) struct Fit {
    kind: IndexKind,
    condition_count: usize,
    yardstick: Yardstick,
    index: Box<dyn Index>,
    combination: Box<dyn Index>,
    /// Index of each of the reference's sound places, condition by condition.
    sound: Grid,
    /// Which conditions most of those places have.
    full: Vec<bool>,
    /// Spread of each condition's index at those places.
    by_condition: Vec<Option<Spread>>,
    /// Spread of their combination, whatever conditions each has.
    usual: Option<Spread>,
    /// Whether the index in one condition is a mean of scores that are clipped.
    is_mean: bool,
    /// What was asked for and could not be learned from this reference; the mean stands in its place.
    pub(crate) fallbacks: Vec<String>,
}

/// The index of one location, before the step along the ring.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct LocationIndex {
    /// `None` where nothing could be scored.
    pub(crate) value: Option<f64>,
    /// The same, condition by condition.
    pub(crate) by_condition: Vec<Option<f64>>,
    /// Mean score of each discriminator over the conditions, in the order of the configuration.
    pub(crate) by_discriminator: Vec<Option<f64>>,
    /// Taps that entered.
    pub(crate) tap_count: u32,
    /// Discriminators that were left out of those that came: absent, or without a scale.
    pub(crate) absent_count: u32,
}

impl Fit {
    /// What the `kept` places of `reference` teach, each shoulder measured against its own of the `levels`, and the index of
    /// every location of those shoulders.
    ///
    /// Places that are not kept teach only as what they are labelled.
    pub(crate) fn of(
        config: &FuseConfig,
        conditions: &Conditions,
        reference: &[Shoulder],
        kept: &Kept,
        levels: &[Level],
    ) -> (Self, Vec<Vec<LocationIndex>>) {
        let (fit, learnt) = Self::learnt(config, conditions, reference, kept, levels);
        (fit, learnt.into_iter().map(|Learnt { cells, grid, values }| located(&cells, &grid, values)).collect())
    }

    /// The values of the locations that [`Fit::of`] would have, and nothing else of it.
    pub(crate) fn values_of(
        config: &FuseConfig,
        conditions: &Conditions,
        reference: &[Shoulder],
        kept: &Kept,
        levels: &[Level],
    ) -> Vec<Vec<Option<f64>>> {
        let (_, learnt) = Self::learnt(config, conditions, reference, kept, levels);
        learnt.into_iter().map(|learnt| learnt.values).collect()
    }

    fn learnt(
        config: &FuseConfig,
        conditions: &Conditions,
        reference: &[Shoulder],
        kept: &Kept,
        levels: &[Level],
    ) -> (Self, Vec<Learnt>) {
        let condition_count = conditions.count();
        let averaged: Vec<Vec<Reading>> = match config.index {
            IndexKind::Dissertation => reference.iter().map(|s| s.averaged(condition_count)).collect(),
            _ => Vec::new(),
        };
        let readings = |number: usize| averaged.get(number).map_or(&reference[number].taps[..], |r| &r[..]);
        // Eq. 55's extremes are those of the whole shoulder: damaged places are its other end.
        let is_meant = |number: usize, r: &Reading| config.index == IndexKind::Dissertation || kept[number][r.place];
        let learnt = (0..reference.len()).flat_map(|number| {
            let level = &levels[number];
            readings(number).iter().filter(move |r| is_meant(number, r)).map(move |r| (level, r))
        });
        let repeats = match config.index {
            IndexKind::Percentile | IndexKind::Repeatability => {
                repeat_sds(config, condition_count, reference, kept, levels)
            }
            _ => Vec::new(),
        };
        let yardstick = Yardstick::of(config, condition_count, learnt, &repeats);
        let cells: Vec<Cells> = reference
            .iter()
            .zip(levels)
            .map(|(s, level)| Cells::of(config.index, condition_count, &yardstick, level, s, Taps::All))
            .collect();
        let mut fallbacks = Vec::new();
        // Without repetitions nothing speaks against equal weights.
        let is_plain = matches!(config.index, IndexKind::Robust | IndexKind::Dissertation | IndexKind::Percentile)
            || (config.index == IndexKind::Repeatability && repeats.iter().all(Option::is_none));
        let index: Box<dyn Index> = if is_plain {
            Box::new(Mean::new(yardstick.width()))
        } else {
            let examples = || examples(condition_count, reference, kept, &cells);
            learned(config.index, examples, &score_sds(&yardstick, &repeats)).unwrap_or_else(|why| {
                fallbacks.push(format!("index = {:?} falls back to \"robust\": {why}", config.index.name()));
                Box::new(Mean::new(yardstick.width()))
            })
        };
        let has_fallen_back = !fallbacks.is_empty();
        let grids: Vec<Grid> = cells.iter().map(|cells| Grid::of(index.as_ref(), cells)).collect();
        let teaching = teaching(reference, kept, &grids);
        let combination = combination(config, conditions, &teaching).unwrap_or_else(|why| {
            fallbacks.push(format!("combine = \"fitted\" falls back to \"mean\": {why}"));
            Box::new(Mean::new(condition_count))
        });
        let is_mean = match config.index {
            IndexKind::Lda | IndexKind::Mahalanobis | IndexKind::LogOdds => has_fallen_back,
            _ => true,
        };
        // One combination a place serves the spread of them, and the places themselves.
        let combined: Vec<Vec<Option<f64>>> = grids.iter().map(|grid| grid.combined(combination.as_ref())).collect();
        let mut sound = Grid::new(condition_count);
        let mut values: Vec<f64> = Vec::new();
        let mut counts: BTreeMap<Vec<bool>, usize> = BTreeMap::new();
        let mut present: Vec<bool> = Vec::new();
        for row in teaching.iter().filter(|row| !row.is_cracked) {
            sound.push(row.scores.iter().copied());
            values.extend(combined[row.number][row.place]);
            present.clear();
            present.extend(row.scores.iter().map(Option::is_some));
            match counts.get_mut(&present) {
                Some(count) => *count += 1,
                None => _ = counts.insert(present.clone(), 1),
            }
        }
        let usual = Spread::of(&mut values);
        let full = counts.into_iter().max_by_key(|&(_, count)| count).map(|(mask, _)| mask).unwrap_or_default();
        let of_condition = |c: usize| Spread::of(&mut sound.rows().filter_map(|row| row[c]).collect::<Vec<f64>>());
        let spreads = (0..condition_count).map(of_condition).collect();
        let fit = Self {
            kind: config.index,
            condition_count,
            yardstick,
            index,
            combination,
            sound,
            full,
            by_condition: spreads,
            usual,
            is_mean,
            fallbacks,
        };
        let learnt = cells.into_iter().zip(grids).zip(combined).map(|((cells, grid), combined)| {
            let values = fit.on_one_scale(&grid, combined);
            Learnt { cells, grid, values }
        });
        let learnt = learnt.collect();
        (fit, learnt)
    }

    /// The scales.
    pub(crate) fn yardstick(&self) -> &Yardstick {
        &self.yardstick
    }

    /// Spread of each condition's index at the reference's sound places.
    pub(crate) fn by_condition(&self) -> &[Option<Spread>] {
        &self.by_condition
    }

    /// Spread of a location's index at the reference's sound places, before the step along the ring.
    pub(crate) fn usual(&self) -> Option<Spread> {
        self.usual
    }

    /// The greatest index that a crack can be asked to reach: most of what a location has whose every score is at the clip.
    pub(crate) fn ceiling(&self, config: &FuseConfig) -> f64 {
        /// A limit must be such that most of a crack's taps reach it, and not all of them.
        const PART: f64 = 0.9;
        if !self.is_mean {
            return f64::INFINITY;
        }
        let is_share = matches!(config.index, IndexKind::Percentile | IndexKind::Dissertation);
        let clip = if is_share { 1.0 } else { config.z_clip };
        let highest: Vec<Option<f64>> = self.full.iter().map(|&is_present| is_present.then_some(clip)).collect();
        self.combination.value(&highest).map_or(f64::INFINITY, |value| PART * value)
    }

    /// The index of every location of `shoulder`, whose casing has this `level`.
    pub(crate) fn locations(&self, level: &Level, shoulder: &Shoulder, which: Taps) -> Vec<LocationIndex> {
        let (cells, grid) = self.measured(level, shoulder, which);
        let values = self.on_one_scale(&grid, grid.combined(self.combination.as_ref()));
        located(&cells, &grid, values)
    }

    /// The values of [`Fit::locations`] alone.
    pub(crate) fn values(&self, level: &Level, shoulder: &Shoulder, which: Taps) -> Vec<Option<f64>> {
        let (_, grid) = self.measured(level, shoulder, which);
        self.on_one_scale(&grid, grid.combined(self.combination.as_ref()))
    }

    fn measured(&self, level: &Level, shoulder: &Shoulder, which: Taps) -> (Cells, Grid) {
        let cells = Cells::of(self.kind, self.condition_count, &self.yardstick, level, shoulder, which);
        let grid = Grid::of(self.index.as_ref(), &cells);
        (cells, grid)
    }

    /// The index of locations of which only the `asked` conditions are looked at, on the scale of the usual ones.
    pub(crate) fn only(&self, locations: &[LocationIndex], asked: impl Fn(usize) -> bool) -> Vec<Option<f64>> {
        let mut grid = Grid::new(self.condition_count);
        for location in locations {
            grid.push(location.by_condition.iter().enumerate().map(|(c, v)| v.filter(|_| asked(c))));
        }
        self.on_one_scale(&grid, grid.combined(self.combination.as_ref()))
    }

    /// The `combined` values of the places of `grid`, on the scale of the usual conditions.
    ///
    /// A location that lacks conditions scatters more: what it shows counts by the spread that the reference has where it
    /// lacks the same. `None` where the reference cannot tell that spread.
    fn on_one_scale(&self, grid: &Grid, combined: Vec<Option<f64>>) -> Vec<Option<f64>> {
        let (Some(usual), false) = (self.usual, self.kind == IndexKind::Dissertation) else { return combined };
        let mut nulls: BTreeMap<Vec<bool>, Option<Spread>> = BTreeMap::new();
        let scaled = |(row, value): (&[Option<f64>], Option<f64>)| {
            let value = value?;
            if row.iter().map(Option::is_some).eq(self.full.iter().copied()) {
                return Some(value);
            }
            let present: Vec<bool> = row.iter().map(Option::is_some).collect();
            let null = *nulls.entry(present).or_insert_with_key(|present| self.null_of(present));
            let Spread { centre, sigma } = null?;
            Some(usual.centre + (value - centre) * usual.sigma / sigma).filter(|v| v.is_finite())
        };
        grid.rows().zip(combined).map(scaled).collect()
    }

    /// Spread of the combination at sound places of which only the `present` conditions are looked at.
    fn null_of(&self, present: &[bool]) -> Option<Spread> {
        let only = |row: &[Option<f64>]| -> Option<f64> {
            let has_all = row.iter().zip(present).all(|(value, &asked)| !asked || value.is_some());
            let row: Vec<Option<f64>> = row.iter().zip(present).map(|(v, &asked)| v.filter(|_| asked)).collect();
            has_all.then(|| self.combination.value(&row)).flatten()
        };
        Spread::of(&mut self.sound.rows().filter_map(only).collect::<Vec<f64>>())
    }
}

/// What a fit found of one shoulder of its reference.
struct Learnt {
    cells: Cells,
    grid: Grid,
    /// On the scale of the usual conditions.
    values: Vec<Option<f64>>,
}

/// The locations of a shoulder, of which each has one of the `values`.
fn located(cells: &Cells, grid: &Grid, values: Vec<Option<f64>>) -> Vec<LocationIndex> {
    let location = |(place, value): (usize, Option<f64>)| LocationIndex {
        value,
        by_condition: grid.row(place).to_vec(),
        by_discriminator: cells.by_discriminator(place),
        tap_count: cells.tap_counts[place],
        absent_count: cells.absent_counts[place],
    };
    values.into_iter().enumerate().map(location).collect()
}

/// A place of the reference that teaches how conditions become one value.
struct Teaching<'a> {
    /// Number of its shoulder.
    number: usize,
    place: usize,
    is_cracked: bool,
    /// Its index, condition by condition.
    scores: &'a [Option<f64>],
}

/// The places that are `kept`, or labelled as cracked, and have an index in any condition.
fn teaching<'a>(reference: &[Shoulder], kept: &Kept, grids: &'a [Grid]) -> Vec<Teaching<'a>> {
    let mut teaching = Vec::new();
    for (number, (shoulder, grid)) in reference.iter().zip(grids).enumerate() {
        for (place, scores) in grid.rows().enumerate() {
            let is_cracked = shoulder.is_cracked[place] == Some(true);
            if (kept[number][place] || is_cracked) && scores.iter().any(Option::is_some) {
                teaching.push(Teaching { number, place, is_cracked, scores });
            }
        }
    }
    teaching
}

fn combination(
    config: &FuseConfig,
    conditions: &Conditions,
    teaching: &[Teaching<'_>],
) -> Result<Box<dyn Index>, LearnError> {
    // Eq. 56 is a mean, whatever is asked for.
    let is_faithful = config.index == IndexKind::Dissertation;
    match if is_faithful { Combine::Mean } else { config.combine } {
        Combine::Mean => Ok(Box::new(Mean::new(conditions.count()))),
        Combine::Largest => {
            let sound: Vec<&[Option<f64>]> = teaching.iter().filter(|t| !t.is_cracked).map(|t| t.scores).collect();
            Ok(Box::new(Largest::of(conditions, &sound)))
        }
        Combine::Fitted => {
            let example = |(place, t): (usize, &Teaching<'_>)| Example {
                scores: t.scores.to_vec(),
                is_cracked: t.is_cracked,
                place,
            };
            let examples: Vec<Example> = teaching.iter().enumerate().map(example).collect();
            Ok(Box::new(Lda::learn(&examples, Signs::default())?))
        }
    }
}

/// The index of `kind` as `examples` teach it, where it asks for them; `repeat_sds` are those of a repeated tap's scores.
fn learned(
    kind: IndexKind,
    examples: impl Fn() -> Vec<Example>,
    repeat_sds: &[Option<f64>],
) -> Result<Box<dyn Index>, LearnError> {
    Ok(match kind {
        IndexKind::Repeatability => Box::new(Weighted::by_repeatability(repeat_sds)?),
        IndexKind::Auc => Box::new(Weighted::by_auc(&examples())?),
        IndexKind::Lda => Box::new(Lda::learn(&examples(), Signs::default())?),
        IndexKind::Mahalanobis => Box::new(Mahalanobis::learn(&examples())?),
        IndexKind::LogOdds => Box::new(LogOdds::learn(&examples(), Signs::default())?),
        IndexKind::Robust | IndexKind::Dissertation | IndexKind::Percentile => Box::new(Mean::new(repeat_sds.len())),
    })
}

/// The scores of every place in every condition, of those that are kept or labelled as cracked.
fn examples(condition_count: usize, reference: &[Shoulder], kept: &Kept, cells: &[Cells]) -> Vec<Example> {
    let mut examples = Vec::new();
    let mut first_place = 0;
    for ((shoulder, cells), kept) in reference.iter().zip(cells).zip(kept) {
        for (place, &kept) in kept.iter().enumerate() {
            let is_cracked = shoulder.is_cracked[place] == Some(true);
            if !(kept || is_cracked) {
                continue;
            }
            let rows = (0..condition_count).map(|c| cells.at(place, c)).filter(|row| row.iter().any(Option::is_some));
            examples.extend(rows.map(|row| Example { scores: row.to_vec(), is_cracked, place: first_place + place }));
        }
        first_place += cells.place_count();
    }
    examples
}
