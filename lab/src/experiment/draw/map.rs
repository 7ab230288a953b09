//! A map: a colour for every place of a grid.

use anyhow::Result;
use plotters::prelude::*;
use tapline_draw::canvas::{Area, Point};

use tapline_draw::axes::{Axis, Frame, axes};

/// From dark to bright, and so readable without colour: steps of the map "viridis".
const LEVELS: [RGBColor; 10] = [
    RGBColor(68, 1, 84),
    RGBColor(72, 40, 120),
    RGBColor(62, 74, 137),
    RGBColor(49, 104, 142),
    RGBColor(38, 130, 142),
    RGBColor(31, 158, 137),
    RGBColor(53, 183, 121),
    RGBColor(109, 205, 89),
    RGBColor(180, 222, 44),
    RGBColor(253, 231, 37),
];

/// The colours of a map, lowest first.
pub(in crate::experiment) fn level_colors() -> impl Iterator<Item = RGBColor> {
    LEVELS.into_iter()
}

/// Values on a grid.
#[derive(Debug, Clone)]
pub(in crate::experiment) struct Map {
    /// Abscissa of the left edge of each column, and of the right edge of the last.
    pub x_edges: Vec<f64>,
    /// Range of the ordinate, cut into as many steps as a column has values.
    pub y: Point,
    /// Column by column, from below.
    pub columns: Vec<Vec<f64>>,
    /// Values of the lowest and of the highest colour.
    pub levels: Point,
}

impl Map {
    /// Number of the colour of `value`.
    fn level(&self, value: f64) -> usize {
        let (low, high) = self.levels;
        let count = LEVELS.len() as f64;
        ((value - low) / (high - low) * count).floor().clamp(0.0, count - 1.0) as usize
    }

    pub(super) fn draw(&self, area: &Area<'_>, frame: &Frame, (x, y): (&Axis, &Axis)) -> Result<()> {
        let mut chart = axes(area, frame, x, y)?;
        let (low, high) = self.y;
        let (Some(&left), Some(&right)) = (self.x_edges.first(), self.x_edges.last()) else { return Ok(()) };
        // The lowest colour is the ground; runs of one colour are one rectangle, or the picture would be a megabyte.
        chart.draw_series([Rectangle::new([(left, low), (right, high)], LEVELS[0].filled())])?;
        for (column, edges) in self.columns.iter().zip(self.x_edges.windows(2)) {
            let step = (high - low) / column.len() as f64;
            let mut first = 0;
            for run in column.chunk_by(|a, b| self.level(*a) == self.level(*b)) {
                let level = self.level(run[0]);
                let (from, to) = (low + step * first as f64, low + step * (first + run.len()) as f64);
                first += run.len();
                if level > 0 {
                    let corners = [(edges[0], from), (edges[1], to)];
                    chart.draw_series([Rectangle::new(corners, LEVELS[level].filled())])?;
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a level off by one at the ends, and values beyond them without a colour.
    #[test]
    fn every_value_has_a_colour() {
        let map = Map { x_edges: vec![], y: (0.0, 1.0), columns: vec![], levels: (-60.0, -40.0) };
        let levels = [-1e9, -60.0, -57.0, -41.0, -40.0, 0.0, f64::INFINITY].map(|value| map.level(value));
        assert_eq!(levels, [0, 0, 1, 9, 9, 9, 9]);
    }
}
