//! A curve as a picture: error on a logarithmic axis, one colour and one mark a column.

use anyhow::{Result, anyhow};
use plotters::prelude::*;

use super::curves::{Curve, Row};

/// Size of a picture.
const SIZE: (u32, u32) = (820, 460);
/// Errors below this are drawn on the floor: 0 has no logarithm.
const FLOOR: f64 = -9.0;
/// Highest error drawn, as a power of ten.
const TOP: f64 = 2.0;
/// Okabe and Ito's colours, which colour-blind people distinguish, with black as the last.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
];

/// Colour of what is flagged.
const FLAG: RGBColor = RGBColor(120, 120, 120);

/// The picture of `curve` as SVG.
pub(crate) fn svg(curve: &Curve) -> Result<String> {
    let mut text = String::new();
    fill(curve, &mut text).map_err(|e| anyhow!("cannot draw {}: {e}", curve.name))?;
    Ok(text)
}

fn fill(curve: &Curve, text: &mut String) -> Result<(), Box<dyn std::error::Error>> {
    let root = SVGBackend::with_string(text, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let place = |x: f64| if curve.is_x_log { x.log10() } else { x };
    let xs: Vec<f64> = curve.rows.iter().map(|row| place(row.x)).collect();
    let (Some(first), Some(last)) = (xs.first(), xs.last()) else { return Err("no rows".into()) };
    let mut chart = ChartBuilder::on(&root)
        .caption(curve.title, ("sans-serif", 20))
        .margin(12)
        .margin_right(190)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .build_cartesian_2d(*first..*last, FLOOR..TOP)?;
    let power = |k: &f64| format!("1e{k:.0}");
    let plain = |x: &f64| if curve.is_x_log { short(10_f64.powf(*x)) } else { short(*x) };
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(225, 225, 225))
        .y_labels(12)
        .x_desc(curve.x_label)
        .y_desc("Relative error")
        .x_label_formatter(&plain)
        .y_label_formatter(&power)
        .draw()?;
    for (number, name) in curve.columns.iter().enumerate() {
        let colour = COLOURS[number % COLOURS.len()];
        let at = |row: &Row| (place(row.x), row.errors[number]);
        let level = |error: f64| if error > 0.0 { error.log10().clamp(FLOOR, TOP) } else { FLOOR };
        let points: Vec<(f64, f64)> = curve.rows.iter().map(at).collect();
        // An absent value parts the line.
        for run in points.split(|(_, error)| !error.is_finite()).filter(|run| !run.is_empty()) {
            let line: Vec<(f64, f64)> = run.iter().map(|&(x, e)| (x, level(e))).collect();
            chart.draw_series([PathElement::new(line, colour.stroke_width(2))])?;
        }
        let marked = points.iter().enumerate().filter(|(k, (_, e))| e.is_finite() && k % 4 == number % 4);
        chart.draw_series(
            marked.map(|(_, &(x, e))| Circle::new((x, level(e)), 3 + (number as i32 % 2), colour.filled())),
        )?;
        // The names stand beside the picture, in the order of the columns.
        let row = 60 + 24 * number as i32;
        root.draw(&PathElement::new(vec![(646, row), (674, row)], colour.stroke_width(3)))?;
        root.draw(&Text::new((*name).to_owned(), (682, row - 7), ("sans-serif", 14)))?;
    }
    // A row of squares along the floor: where a flag is raised.
    let flagged = curve.rows.iter().filter(|row| !row.flags.is_empty()).map(|row| place(row.x));
    let side = 3;
    chart
        .draw_series(flagged.map(|x| {
            EmptyElement::at((x, FLOOR)) + Rectangle::new([(-side, -3 * side), (side, -side)], FLAG.filled())
        }))?;
    if curve.rows.iter().any(|row| !row.flags.is_empty()) {
        let row = 60 + 24 * curve.columns.len() as i32;
        root.draw(&Rectangle::new([(657, row - side), (663, row + side)], FLAG.filled()))?;
        root.draw(&Text::new("flagged", (682, row - 7), ("sans-serif", 14)))?;
    }
    root.present()?;
    Ok(())
}

/// A number as an axis wants it.
fn short(x: f64) -> String {
    let size = x.abs();
    if !(1e-12..10.0).contains(&size) {
        format!("{x:.0}")
    } else if size >= 0.1 {
        format!("{x:.2}")
    } else {
        format!("{x:.0e}")
    }
}
