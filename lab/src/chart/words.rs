//! What pages say about points and defaults.

use super::front::Optimality;
use super::off;
use super::panel::{Facet, Panel};
use super::point::Point;

/// How to read a panel, a paragraph each.
pub(crate) const HOW_TO_READ: [&str; 5] = [
    "Each point is one option: further right it costs more, further up it is more wrong. Down and to the left is better.",
    "The staircase is the front: no point lies below or left of it. A point off the front is beaten by one that costs no more and is no \
     worse. Take the point on the front that you can afford.",
    "A ring marks the default, what the program does when nothing else is asked for. Hollow points fail a stability limit: they are fast and \
     wrong, and take no part in the front.",
    "An upright bar is the 95 % interval of the error, over seeds, shoulders or casings. A level bar is the quartiles of the cost over \
     repetitions. All points were measured in alternation. Costs are processor time of one thread unless the axis says otherwise. On \
     another machine they differ; their ratios differ less.",
    "A default has left the front when another point is cheaper and as good, or better at the same cost, by more than the noise: the tolerances are \
     in the table of points.",
];

/// A default and whether it is on its front, in words.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct DefaultRow {
    pub panel: &'static str,
    pub facet: String,
    pub default: String,
    pub is_on_front: bool,
    pub words: String,
    /// Why it is the default although it is off.
    pub why: Option<&'static str>,
}

pub(crate) fn defaults(panels: &[Panel]) -> Vec<DefaultRow> {
    let of_facet = |panel: &Panel, facet: &Facet| -> Vec<DefaultRow> {
        let row = |(default, optimality): (&Point, Optimality)| DefaultRow {
            panel: panel.name,
            facet: facet.title.clone(),
            default: default.name.clone(),
            is_on_front: optimality == Optimality::OnFront,
            words: words(facet, &optimality),
            why: off::why(panel.name, &facet.name).filter(|_| optimality != Optimality::OnFront),
        };
        facet.defaults().into_iter().map(row).collect()
    };
    panels.iter().flat_map(|panel| panel.facets.iter().flat_map(move |facet| of_facet(panel, facet))).collect()
}

fn words(facet: &Facet, optimality: &Optimality) -> String {
    match optimality {
        Optimality::OnFront => "on the front, within the noise".to_owned(),
        Optimality::Unstable { case } => format!("fails a stability limit: {case}"),
        Optimality::Beaten { by, cost_ratio, error_more: (more, low, high) } => {
            let unit = if facet.error.unit.is_empty() { String::new() } else { format!(" {}", facet.error.unit) };
            format!(
                "off the front: {by} costs {} times as much, and its error differs by {}{unit} ({} to {})",
                few_digits(*cost_ratio),
                few_digits(*more),
                few_digits(*low),
                few_digits(*high)
            )
        }
    }
}

/// A number as people read it: three digits, and powers of ten where it is very small.
pub(crate) fn few_digits(value: f64) -> String {
    if !value.is_finite() {
        return "\u{2013}".to_owned();
    }
    let text = format!("{value:.2e}");
    let rounded: f64 = text.parse().unwrap_or(value);
    let text = if rounded != 0.0 && rounded.abs() < 1e-3 { format!("{rounded:e}") } else { rounded.to_string() };
    text.replace('-', "\u{2212}")
}

impl Facet {
    /// Its seeds: one, or the first and the last.
    pub(crate) fn seeds_in_words(&self) -> String {
        match self.seeds.as_slice() {
            [] => String::new(),
            [one] => one.to_string(),
            [first, .., last] => format!("{first} to {last}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches invented digits, and a minus after which a line may break.
    #[test]
    fn numbers_are_short() {
        let texts = [0.123_456, 12_345.0, -0.000_012_34, 0.0, f64::NAN, 1.0].map(few_digits);
        assert_eq!(texts, ["0.123", "12300", "\u{2212}1.23e\u{2212}5", "0", "\u{2013}", "1"]);
    }
}
