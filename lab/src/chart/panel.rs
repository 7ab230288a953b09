//! A panel of the chart: one question, with a facet for each pair of a cost and an error that answers it.

use super::front::{Optimality, Tolerance, front, optimality};
use super::point::Point;
use crate::evaluation::Table;

/// Quantity of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Quantity {
    /// In words.
    pub label: &'static str,
    /// Its unit; empty for a pure number.
    pub unit: &'static str,
    pub is_log: bool,
}

impl Quantity {
    pub(crate) const fn log(label: &'static str, unit: &'static str) -> Self {
        Self { label, unit, is_log: true }
    }

    pub(crate) const fn linear(label: &'static str, unit: &'static str) -> Self {
        Self { label, unit, is_log: false }
    }

    /// Label and unit, as an axis shows them.
    pub(crate) fn words(&self) -> String {
        if self.unit.is_empty() { self.label.to_owned() } else { format!("{}, {}", self.label, self.unit) }
    }
}

/// A published or required value, drawn across a facet as a band of costs.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Guide {
    pub label: &'static str,
    pub cost: (f64, f64),
}

/// One pair of axes with its points.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Facet {
    /// Name in the table of points, unique within the panel.
    pub name: String,
    /// Title above it.
    pub title: String,
    pub cost: Quantity,
    pub error: Quantity,
    /// Differences that count.
    pub tolerance: Tolerance,
    /// What the errors are relative to.
    pub truth: String,
    pub seeds: Vec<u64>,
    /// Names of the families of points, by their numbers.
    pub families: Vec<&'static str>,
    pub guides: Vec<Guide>,
    pub points: Vec<Point>,
}

impl Facet {
    /// For each point, whether it is on the front.
    pub(crate) fn front(&self) -> Vec<bool> {
        front(&self.points)
    }

    pub(crate) fn defaults(&self) -> Vec<(&Point, Optimality)> {
        let defaults = self.points.iter().filter(|point| point.is_default);
        defaults.map(|default| (default, optimality(default, &self.points, self.tolerance))).collect()
    }
}

/// One question and its answer.
#[derive(Debug, Clone)]
pub(crate) struct Panel {
    /// Name of its files, and in the table of points.
    pub name: &'static str,
    /// In words.
    pub title: &'static str,
    /// What it answers.
    pub question: &'static str,
    /// What was measured and how, and what does not show in the picture.
    pub notes: Vec<String>,
    pub facets: Vec<Facet>,
    /// Tables beside the picture.
    pub tables: Vec<Table>,
}

impl Panel {
    /// Without tables; its name is that of its entry.
    pub(crate) fn new<const N: usize>(
        title: &'static str,
        question: &'static str,
        notes: [&str; N],
        facets: Vec<Facet>,
    ) -> Self {
        Self { name: "", title, question, notes: notes.map(str::to_owned).to_vec(), facets, tables: Vec::new() }
    }
}

/// What could not be measured here, and why.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Skipped {
    pub panel: &'static str,
    pub why: String,
}
