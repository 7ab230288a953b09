//! Marks of eight shapes, the same on a line and next to its name.

use plotters::prelude::*;

use super::{Area, Drawn};

/// Half of a mark's width.
const R: i32 = 5;

/// Draws the mark of the column with this `number` at a place of the picture.
pub(super) fn mark(root: &Area<'_>, number: usize, (x, y): (i32, i32), colour: RGBColor) -> Drawn {
    let polygon = |corners: &[(i32, i32)]| {
        let corners: Vec<(i32, i32)> = corners.iter().map(|(dx, dy)| (x + dx, y + dy)).collect();
        root.draw(&Polygon::new(corners, colour.filled()))
    };
    match number % 8 {
        0 => root.draw(&Circle::new((x, y), R, colour.filled()))?,
        1 => polygon(&[(-R, -R), (R, -R), (R, R), (-R, R)])?,
        2 => polygon(&[(0, -R - 1), (R + 1, R), (-R - 1, R)])?,
        3 => polygon(&[(0, -R - 2), (R + 2, 0), (0, R + 2), (-R - 2, 0)])?,
        4 => polygon(&[(0, R + 1), (R + 1, -R), (-R - 1, -R)])?,
        5 => {
            root.draw(&Circle::new((x, y), R, WHITE.filled()))?;
            root.draw(&Circle::new((x, y), R, colour.stroke_width(2)))?;
        }
        6 => {
            root.draw(&PathElement::new(vec![(x - R, y - R), (x + R, y + R)], colour.stroke_width(2)))?;
            root.draw(&PathElement::new(vec![(x - R, y + R), (x + R, y - R)], colour.stroke_width(2)))?;
        }
        _ => {
            root.draw(&Rectangle::new([(x - R, y - R), (x + R, y + R)], WHITE.filled()))?;
            root.draw(&Rectangle::new([(x - R, y - R), (x + R, y + R)], colour.stroke_width(2)))?;
        }
    }
    Ok(())
}
