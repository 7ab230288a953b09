//! A curve as a picture: error on a logarithmic axis, a colour per column, and grey where a flag is raised.

use std::collections::BTreeSet;

use anyhow::{Context as _, Result};
use plotters::style::{BLACK, RGBAColor, RGBColor};
use tapline_draw::axes::Axis;
use tapline_draw::canvas::{BLUE, ORANGE, PALE_INK, Point, VERMILLION, number, superscript};
use tapline_draw::palette::{GREEN, PURPLE, SKY};
use tapline_draw::stats::extent;
use tapline_wire::Discriminator;

use super::curves::Curve;
use crate::evaluation::{Key, Mark, Picture, Plot};

/// Most powers of ten of an axis: smaller errors are drawn on its lowest line.
const DECADES_MAX: f64 = 7.0;
/// Room above the greatest error and below the lowest power of ten, as a power of ten.
const ROOM: f64 = 0.15;
/// Most points of a column that have a mark, and the least steps from one to the next.
const MARKED: (usize, usize) = (16, 4);
/// Background where a flag is raised; the grid shows through.
const GREY: RGBAColor = RGBAColor(0, 0, 0, 0.11);
const COLORS: [RGBColor; 8] = [BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, BLACK, PALE_INK];

pub(crate) fn picture(curve: &Curve) -> Result<Picture> {
    let place: fn(f64) -> f64 = if curve.is_x_log { f64::log10 } else { |x| x };
    let xs: Vec<f64> = curve.rows.iter().map(|row| place(row.x)).collect();
    let x = Axis {
        label: curve.x_label.to_owned(),
        range: extent(xs.iter().copied()).context("no place to draw")?,
        label_count: 8,
        text: if curve.is_x_log { |power| two_digits(10_f64.powf(power)) } else { number },
    };
    // The logarithm of no error is not finite.
    let powers = curve.rows.iter().flat_map(|row| &row.errors).map(|error| error.log10());
    let (least, greatest) = extent(powers).context("no error to draw")?;
    let high = greatest + ROOM;
    let low = least.floor().clamp((high - DECADES_MAX).ceil(), (high - 1.0).floor()) - ROOM;
    let label_count = (high - low).ceil() as usize + 1;
    let y = Axis { label: "Relative error".to_owned(), range: (low, high), label_count, text: percent };
    let (mut marks, mut keys) = (flagged(curve, &xs, (low, high)), Vec::new());
    for (column, (name, color)) in curve.columns.iter().zip(COLORS).enumerate() {
        let powers = curve.rows.iter().map(|row| row.errors[column].log10());
        let is_below = powers.clone().all(|power| power.is_nan() || power < low);
        let name = if is_below { format!("{}, below", in_words(name)) } else { in_words(name) };
        let points: Vec<Point> = xs.iter().copied().zip(powers.map(|power| power.clamp(low, high))).collect();
        // Few points have a mark, different ones in each column, so that lines on each other both show.
        let step = points.len().div_ceil(MARKED.0).max(MARKED.1);
        let marked = points.iter().copied().skip(column % step).step_by(step).collect();
        marks.push(Mark::Line(points, color, 2.0));
        if column < 4 {
            marks.push(Mark::Dots(marked, color, 4.0));
            keys.push(Key::Line(name, color));
        } else {
            marks.push(Mark::Rings(marked, color, 5.0));
            keys.push(Key::Rings(name, color));
        }
    }
    let flags: BTreeSet<&str> =
        curve.rows.iter().flat_map(|row| row.flags.split('|')).filter(|f| !f.is_empty()).collect();
    if !flags.is_empty() {
        let words = Vec::from_iter(flags).join(", ").replace('_', " ");
        keys.push(Key::Patches(String::new(), vec![GREY], format!("a flag is raised: {words}")));
    }
    Ok(Picture {
        title: curve.title.to_owned(),
        note: "An error too small for its axis is drawn on the lowest line; a line ends where the value is absent."
            .to_owned(),
        keys,
        columns: 1,
        height: 430.0,
        plots: vec![Plot::new(String::new(), x, y, marks)],
        ..Picture::default()
    })
}

/// The background of each row with a flag, half-way to its neighbours.
fn flagged(curve: &Curve, xs: &[f64], (low, high): Point) -> Vec<Mark> {
    let halfway = |a: usize, b: usize| f64::midpoint(xs[a], xs[b.min(xs.len() - 1)]);
    let flagged = curve.rows.iter().enumerate().filter(|(_, row)| !row.flags.is_empty());
    let background = |k: usize| [(halfway(k, k.saturating_sub(1)), low), (halfway(k, k + 1), high)];
    flagged.map(|(k, _)| Mark::Filled(background(k), GREY)).collect()
}

/// A power of ten as a percentage.
fn percent(power: f64) -> String {
    let digits = power + 2.0;
    if digits > -2.5 {
        format!("{} %", two_digits(10_f64.powf(digits)))
    } else {
        format!("10{} %", superscript(digits.round() as i32))
    }
}

/// A number of at least 1e-6, to two digits after its first zeros.
fn two_digits(x: f64) -> String {
    let unit = 10_f64.powf(x.log10().floor() - 1.0);
    number(if unit < 1.0 { (x / unit).round() * unit } else { x.round() })
}

/// What a column of the table is, for people.
fn in_words(column: &str) -> String {
    if let Some(which) = Discriminator::ALL.into_iter().find(|which| which.name() == column) {
        return format!("{}: {}", which.symbol(), which.meaning());
    }
    match column {
        "closed" => "closed form",
        "integral" => "integral, no crack",
        "plate" => "plate in time",
        "f_max_closed" => "peak force, closed form",
        "tau_closed" => "contact time, closed form",
        "d_max_closed" => "deflection, closed form",
        "f_max_full" => "peak force, full rung",
        "contact_time_full" => "contact time, full rung",
        "d_max_full" => "deflection, full rung",
        "exact" => "exact law",
        "gonthier" => "Gonthier",
        "flores" => "Flores",
        "lankarani_nikravesh" => "Lankarani-Nikravesh",
        other => other,
    }
    .to_owned()
}

#[cfg(test)]
mod tests {
    use super::super::curves::{clipping, offset};
    use super::*;
    use tapline_draw::canvas::units;

    /// Catches an axis that is not fitted to its data, a column without its name in words, and a flag that is not shown.
    #[test]
    fn a_picture_shows_what_its_table_has() {
        let [clipped, shifted] = [clipping(), offset()].map(|curve| picture(&curve).unwrap());
        let (text, plot) = (clipped.svg().unwrap(), &clipped.plots[0]);
        for name in ["F_max: peak force", "spectral centroid", "a flag is raised: clipped"] {
            assert!(text.contains(name), "{name}");
        }
        assert!(plot.y.range.1 < 0.0 && plot.x.range.0 < 0.401 && plot.x.range.1 > 0.999, "{plot:?}");
        assert!(shifted.plots[0].y.range.1 < -6.0, "an error that is rounding fills the picture");
        assert!(!shifted.svg().unwrap().contains("a flag is raised"));
        let sizes = text.split("font-size=\"").skip(1).filter_map(|rest| rest.split('"').next()?.parse::<f64>().ok());
        let sizes: Vec<f64> = sizes.collect();
        assert!(sizes.len() > 10 && sizes.iter().all(|&size| size >= f64::from(units(12.0))), "{text}");
    }
}
