//! Boxplots and bars: groups side by side.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use tapline_draw::canvas::{Area, INK, PALE_INK, line, write};

use super::dot;
use tapline_draw::axes::{Axis, Chart, Frame, axes};
use tapline_draw::boxplot::BoxStats;

/// Half the width of a box, as a fraction of a group's.
const HALF: f64 = 0.28;

/// A group of values.
#[derive(Debug, Clone)]
pub(in crate::experiment) struct Category {
    pub label: String,
    pub color: RGBColor,
    pub stats: BoxStats,
}

impl Category {
    pub(super) fn extremes(&self) -> impl Iterator<Item = f64> {
        let (low, high) = self.stats.whiskers;
        [low, high].into_iter().chain(self.stats.outliers.iter().copied())
    }
}

/// A bar.
#[derive(Debug, Clone)]
pub(in crate::experiment) struct Bar {
    pub label: String,
    pub color: RGBColor,
    pub value: f64,
}

/// Axes with a place for each of `labels`, which stand below them.
fn grouped<'b>(area: &Area<'b>, frame: &Frame, (x_label, y): (&str, &Axis), labels: &[&str]) -> Result<Chart<'b, 'b>> {
    let x = Axis { label: x_label.to_owned(), range: (0.0, labels.len() as f64), label_count: 0 };
    let chart = axes(area, frame, &x, y)?;
    let width = (frame.right - frame.left) / labels.len() as f64;
    for (k, label) in labels.iter().enumerate() {
        let place = (frame.left + (k as f64 + 0.5) * width, frame.bottom + 12.0);
        write(area, label, place, 12.0, PALE_INK, HPos::Center, false)?;
    }
    Ok(chart)
}

pub(super) fn draw(
    area: &Area<'_>,
    frame: &Frame,
    axes: (&str, &Axis),
    categories: &[Category],
    joins_means: bool,
) -> Result<()> {
    let labels: Vec<&str> = categories.iter().map(|c| c.label.as_str()).collect();
    let mut chart = grouped(area, frame, axes, &labels)?;
    for (k, Category { color, stats, .. }) in categories.iter().enumerate() {
        stats.draw(&mut chart, (k as f64 + 0.5, HALF), *color)?;
    }
    if joins_means {
        let means: Vec<_> = categories.iter().enumerate().map(|(k, c)| (k as f64 + 0.5, c.stats.mean)).collect();
        chart.draw_series([PathElement::new(means.clone(), line(INK, 1.5))])?;
        chart.draw_series(means.into_iter().map(|p| dot(p, 3.0, INK)))?;
    }
    Ok(())
}

pub(super) fn draw_bars(area: &Area<'_>, frame: &Frame, axes: (&str, &Axis), bars: &[Bar]) -> Result<()> {
    let labels: Vec<&str> = bars.iter().map(|bar| bar.label.as_str()).collect();
    let mut chart = grouped(area, frame, axes, &labels)?;
    let bar = |(k, bar): (usize, &Bar)| {
        let x = k as f64 + 0.5;
        Rectangle::new([(x - HALF, 0.0), (x + HALF, bar.value)], bar.color.filled())
    };
    chart.draw_series(bars.iter().enumerate().map(bar))?;
    Ok(())
}
