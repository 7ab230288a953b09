//! The index of many places, condition by condition, in one piece.

use crate::cells::Cells;
use crate::indices::Index;

/// Index values by place and condition; `None` where there is none.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Grid {
    condition_count: usize,
    place_count: usize,
    values: Vec<Option<f64>>,
}

impl Grid {
    /// A grid of no places.
    pub(crate) fn new(condition_count: usize) -> Self {
        Self { condition_count, place_count: 0, values: Vec::new() }
    }

    /// The `index` of all places of `cells`.
    pub(crate) fn of(index: &dyn Index, cells: &Cells) -> Self {
        let mut grid = Self::new(cells.condition_count());
        grid.values.reserve_exact(cells.place_count() * cells.condition_count());
        for place in 0..cells.place_count() {
            // Of nothing an index says nothing.
            let value =
                |condition| cells.has_taps(condition).then(|| index.value(cells.at(place, condition))).flatten();
            grid.push((0..cells.condition_count()).map(value));
        }
        grid
    }

    /// Adds a place; `row` has a value a condition.
    pub(crate) fn push(&mut self, row: impl Iterator<Item = Option<f64>>) {
        self.values.extend(row);
        self.place_count += 1;
        debug_assert_eq!(self.values.len(), self.place_count * self.condition_count, "one value a condition");
    }

    /// The values of `place`.
    pub(crate) fn row(&self, place: usize) -> &[Option<f64>] {
        &self.values[place * self.condition_count..][..self.condition_count]
    }

    /// The values of every place.
    pub(crate) fn rows(&self) -> impl Iterator<Item = &[Option<f64>]> {
        (0..self.place_count).map(|place| self.row(place))
    }

    /// One value a place, by `combination` of its conditions.
    pub(crate) fn combined(&self, combination: &dyn Index) -> Vec<Option<f64>> {
        combination.values(&mut self.rows())
    }
}
