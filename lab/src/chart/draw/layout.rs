//! The text above a pair of axes: title, key to the marks, and name of the ordinate.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use tapline_draw::canvas::{Area, INK, PALE_INK, Point as Place, at, line, units, write};

use super::{RADIUS, shape};
use crate::chart::panel::Facet;

/// Font size; no text is smaller.
pub(super) const TEXT_PX: f64 = 12.0;
/// Font size of a title.
const TITLE_PX: f64 = 15.0;
/// Height of a line of text.
pub(super) const LINE_PX: f64 = 17.0;
const EDGE: f64 = 10.0;

/// What stands above the axes, from the top.
#[derive(Debug)]
pub(super) struct Head {
    title: Vec<String>,
    /// Rows of the key to marks.
    key: Vec<Vec<Item>>,
    /// Name of the ordinate.
    ordinate: String,
}

/// What a mark means.
#[derive(Debug, Clone)]
pub(super) struct Item {
    sign: Sign,
    words: String,
}

#[derive(Debug, Clone, Copy)]
enum Sign {
    Family(usize),
    Hollow,
    Default,
    Front,
}

/// What stands above the axes of `facet`, within `width`.
pub(super) fn layout(facet: &Facet, width: f64) -> Head {
    let width = width - 2.0 * EDGE;
    let mut items = Vec::new();
    if facet.families.len() > 1 {
        let used = (0..facet.families.len()).filter(|family| facet.points.iter().any(|point| point.family == *family));
        items.extend(used.map(|k| Item { sign: Sign::Family(k), words: facet.families[k].to_owned() }));
    }
    let is_grouped = facet.points.iter().any(|point| point.group != facet.points[0].group);
    if !is_grouped {
        items.push(Item { sign: Sign::Front, words: "front".to_owned() });
    }
    if facet.points.iter().any(|point| point.is_default) {
        items.push(Item { sign: Sign::Default, words: "default".to_owned() });
    }
    if facet.points.iter().any(|point| !point.is_stable()) {
        items.push(Item { sign: Sign::Hollow, words: "hollow: fails a stability limit".to_owned() });
    }
    Head {
        title: wrapped(&facet.title, width, TITLE_PX),
        key: in_rows(items, width),
        ordinate: format!("\u{2191} {}", facet.error.words()),
    }
}

impl Item {
    fn width(&self) -> f64 {
        22.0 + width_of(&self.words, TEXT_PX, false) + 14.0
    }

    fn draw(&self, area: &Area<'_>, (x, y): Place) -> Result<()> {
        let middle = (x + 8.0, y);
        match self.sign {
            Sign::Family(family) => shape(area, middle, family, true)?,
            Sign::Hollow => shape(area, middle, 0, false)?,
            Sign::Default => area.draw(&Circle::new(at(middle), units(RADIUS + 2.5), line(INK, 2.0)))?,
            Sign::Front => {
                let stairs = [(x, y - 5.0), (x + 8.0, y - 5.0), (x + 8.0, y + 4.0), (x + 17.0, y + 4.0)];
                area.draw(&PathElement::new(stairs.map(at).to_vec(), line(INK, 1.5)))?;
            }
        }
        write(area, &self.words, (x + 22.0, y), TEXT_PX, INK, HPos::Left, false)
    }
}

impl Head {
    /// Draws it from `top` on; returns where it ends.
    pub(super) fn draw(&self, area: &Area<'_>, (left, top): Place) -> Result<f64> {
        let (left, mut y) = (left + EDGE, top);
        for text in &self.title {
            write(area, text, (left, y + 10.0), TITLE_PX, INK, HPos::Left, true)?;
            y += 20.0;
        }
        y += 4.0;
        for row in &self.key {
            let mut x = left;
            for item in row {
                item.draw(area, (x, y + 8.0))?;
                x += item.width();
            }
            y += LINE_PX;
        }
        y += 4.0;
        write(area, &self.ordinate, (left, y + 9.0), TEXT_PX, PALE_INK, HPos::Left, false)?;
        Ok(y + LINE_PX + 2.0)
    }
}

/// `items` in rows no wider than `width`.
fn in_rows(items: Vec<Item>, width: f64) -> Vec<Vec<Item>> {
    let mut rows: Vec<Vec<Item>> = Vec::new();
    let mut used = f64::INFINITY;
    for item in items {
        if used + item.width() > width {
            rows.push(Vec::new());
            used = 0.0;
        }
        used += item.width();
        if let Some(row) = rows.last_mut() {
            row.push(item);
        }
    }
    rows
}

/// `text` in lines no wider than `width`, broken between words.
fn wrapped(text: &str, width: f64, size: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if width_of(&format!("{line} {word}"), size, true) <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Width of `text` in pixels, in a font as wide as those of Linux: others are narrower.
pub(super) fn width_of(text: &str, size: f64, is_bold: bool) -> f64 {
    let em = |letter: char| match letter {
        'i' | 'j' | 'l' | '.' | ',' | ':' | ';' | '\'' | '|' | ' ' | '(' | ')' => 0.34,
        'f' | 'r' | 't' | '-' => 0.41,
        'm' | 'w' | 'M' | 'W' | '%' | '\u{2192}' | '\u{2191}' | '\u{2212}' => 0.90,
        'A'..='Z' => 0.70,
        _ => 0.63,
    };
    let ems: f64 = text.chars().map(em).sum();
    ems * size * if is_bold { 1.1 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a line that is too long though it can be broken, and words that are lost.
    #[test]
    fn titles_are_broken_between_words() {
        let text = "Which scan plan, and which method, of all that were tried here?";
        let lines = wrapped(text, 200.0, 15.0);
        assert!(lines.len() > 1 && lines.iter().all(|line| width_of(line, 15.0, true) <= 200.0), "{lines:?}");
        assert_eq!(lines.join(" "), text);
    }
}
