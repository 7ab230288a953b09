//! The scale of the damage maps: the colours of indices, and the limits.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use tapline_draw::canvas::{Area, INK, PALE_INK, at, line, write};
use tapline_draw::stats::extent;

use crate::report::evidence::{Evidence, Limits};
use crate::report::figures::chart::WIDTH;
use crate::report::figures::colour::heat;

/// Left and right end of the bar.
const LEFT: f64 = 62.0;
const RIGHT: f64 = 330.0;
const STEPS: u32 = 64;
/// Width of a letter in the names of limits.
const LETTER: f64 = 5.4;

/// The index at the dark end of the scale. All maps of an archive share the scale, so that equal colours are equal
/// indices. It is the highest index of the archive, or higher than all reject limits.
pub(crate) fn greatest(evidence: &Evidence) -> f64 {
    let cells = evidence.shoulders().flat_map(|s| s.cells.iter().filter_map(|cell| cell.index));
    let offsets = evidence.shoulders().flat_map(|s| s.offsets.iter().flat_map(|map| map.index.iter().flatten()));
    let limits = evidence.shoulders().filter_map(|s| s.limits.map(|limits| 1.25 * limits.reject));
    let greatest = extent(cells.chain(offsets.copied()).chain(limits)).map_or(1.0, |(_, greatest)| greatest);
    if greatest > 0.0 { greatest } else { 1.0 }
}

/// The lowest and the highest index on the axes of all shoulders' curves.
pub(crate) fn range(evidence: &Evidence) -> (f64, f64) {
    let cells = evidence.shoulders().flat_map(|s| s.cells.iter().filter_map(|cell| cell.index));
    (extent(cells.chain([0.0])).map_or(0.0, |(lowest, _)| lowest), greatest(evidence))
}

/// Draws the bar from 0 to `greatest` with its top at `top`. The re-inspect limit is above, the reject limit below, so
/// that their names never overlap.
pub(crate) fn bar(area: &Area<'_>, greatest: f64, limits: Option<Limits>, top: f64) -> Result<()> {
    let bottom = top + 14.0;
    let x_of = |index: f64| LEFT + (RIGHT - LEFT) * (index / greatest).clamp(0.0, 1.0);
    for step in 0..STEPS {
        let at_step = |step: u32| greatest * f64::from(step) / f64::from(STEPS);
        let (from, to) = (at_step(step), at_step(step + 1));
        let color = heat(0.5 * (from + to), (0.0, greatest));
        area.draw(&Rectangle::new([at((x_of(from), top)), at((x_of(to), bottom))], color.filled()))?;
    }
    write(area, "index 0", (LEFT - 5.0, 0.5 * (top + bottom)), 11.0, PALE_INK, HPos::Right, false)?;
    let highest = format!("{greatest:.1}");
    write(area, &highest, (RIGHT + 5.0, 0.5 * (top + bottom)), 11.0, PALE_INK, HPos::Left, false)?;
    let Some(limits) = limits else { return Ok(()) };
    for (limit, name, tip, far, words) in [
        (limits.re_inspect, "re-inspect at", top, top - 5.0, top - 11.0),
        (limits.reject, "reject at", bottom, bottom + 5.0, bottom + 12.0),
    ] {
        let x = x_of(limit);
        area.draw(&PathElement::new(vec![at((x, top)), at((x, bottom))], line(WHITE, 1.5)))?;
        let mark = [(x, tip), (x - 4.0, far), (x + 4.0, far)].map(at).to_vec();
        area.draw(&Polygon::new(mark, INK.filled()))?;
        let text = format!("{name} {limit:.2}");
        let half = 0.5 * LETTER * text.chars().count() as f64;
        let x = (x + 8.0 + half).clamp(half + 8.0, f64::from(WIDTH) - half - 8.0);
        write(area, &text, (x, words), 11.0, INK, HPos::Center, false)?;
    }
    Ok(())
}
