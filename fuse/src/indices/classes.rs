//! The examples an index learns from: the complete ones, class by class, as matrices.

use std::collections::BTreeSet;

use faer::Mat;

use super::{Example, LearnError, PLACES_MIN, score_of};

/// Complete examples, and which discriminators they are about.
#[derive(Debug)]
pub(super) struct Classes {
    /// Discriminators there are, learnt from or not.
    pub(super) count: usize,
    /// Those that some example has.
    pub(super) columns: Vec<usize>,
    /// Scores of sound examples, one a row, a column for each of `columns`.
    pub(super) sound: Mat<f64>,
    /// Scores of cracked ones.
    pub(super) cracked: Mat<f64>,
}

impl Classes {
    /// Both classes, at least [`PLACES_MIN`] places of each.
    pub(super) fn both(index: &'static str, examples: &[Example]) -> Result<Self, LearnError> {
        let (classes, places) = Self::complete(examples);
        let (sound, cracked) = places;
        if sound < PLACES_MIN || cracked < PLACES_MIN {
            let incomplete = examples.len() - classes.sound.nrows() - classes.cracked.nrows();
            let (least, rows) = (PLACES_MIN, examples.len());
            return Err(LearnError::TooFew { index, least, sound, cracked, incomplete, rows });
        }
        Ok(classes)
    }

    /// The sound examples, at least [`PLACES_MIN`] places; cracked ones are not looked at.
    pub(super) fn only_sound(index: &'static str, examples: &[Example]) -> Result<Self, LearnError> {
        let examples: Vec<Example> = examples.iter().filter(|example| !example.is_cracked).cloned().collect();
        let (classes, (sound, _)) = Self::complete(&examples);
        if sound < PLACES_MIN {
            let incomplete = examples.len() - classes.sound.nrows();
            return Err(LearnError::TooFewSound { index, least: PLACES_MIN, sound, incomplete, rows: examples.len() });
        }
        Ok(classes)
    }

    /// The complete examples, and the count of distinct sound and cracked places among them.
    fn complete(examples: &[Example]) -> (Self, (usize, usize)) {
        let count = examples.iter().map(|example| example.scores.len()).max().unwrap_or(0);
        let columns: Vec<usize> =
            (0..count).filter(|&j| examples.iter().any(|e| score_of(&e.scores, j).is_some())).collect();
        let of = |is_cracked: bool| {
            let mut places = BTreeSet::new();
            let mut rows: Vec<Vec<f64>> = Vec::new();
            for example in examples.iter().filter(|example| example.is_cracked == is_cracked) {
                let row: Option<Vec<f64>> = columns.iter().map(|&j| score_of(&example.scores, j)).collect();
                if let Some(row) = row.filter(|row| !row.is_empty()) {
                    places.insert(example.place);
                    rows.push(row);
                }
            }
            (Mat::from_fn(rows.len(), columns.len(), |i, j| rows[i][j]), places.len())
        };
        let ((sound, sound_places), (cracked, cracked_places)) = (of(false), of(true));
        (Self { count, columns, sound, cracked }, (sound_places, cracked_places))
    }
}
