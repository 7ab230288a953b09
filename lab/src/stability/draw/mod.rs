//! A curve as a picture: error on a logarithmic axis, a colour and a mark per column, and grey where a flag is raised.

mod marks;

use anyhow::{Result, anyhow};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use tapline_draw::stats::extent;
use tapline_wire::Discriminator;

use self::marks::mark;
use super::curves::{Curve, Row};

/// Size of a picture.
const SIZE: (u32, u32) = (1070, 560);
/// Right edge of the axes; the names are right of it.
const RIGHT: i32 = 700;
/// Height of the first name, and from one to the next.
const NAMES: (i32, i32) = (76, 28);
/// Most powers of ten of an axis: smaller errors are drawn on its lowest line.
const DECADES_MAX: f64 = 7.0;
/// Room above the greatest error, as a power of ten.
const ABOVE: f64 = 0.15;
/// Most points of a column that have a mark.
const MARKED: usize = 16;
/// Okabe and Ito's colours, which colour-blind people distinguish, with black and grey as the last.
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
    RGBColor(110, 110, 110),
];
/// Background where a flag is raised.
const FLAGGED: RGBColor = RGBColor(228, 228, 228);

type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type Chart<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type Drawn = Result<(), Box<dyn std::error::Error>>;

pub(crate) fn svg(curve: &Curve) -> Result<String> {
    let mut text = String::new();
    fill(curve, &mut text).map_err(|e| anyhow!("cannot draw {}: {e}", curve.name))?;
    Ok(text)
}

fn fill(curve: &Curve, text: &mut String) -> Drawn {
    let root = SVGBackend::with_string(text, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let scale = Scale::of(curve).ok_or("no errors")?;
    let mut chart = ChartBuilder::on(&root)
        .caption(curve.title, ("sans-serif", 22))
        .margin(14)
        .margin_right(SIZE.0 as i32 - RIGHT)
        .x_label_area_size(52)
        .y_label_area_size(84)
        .build_cartesian_2d(scale.x.0..scale.x.1, scale.powers.0..scale.powers.1)?;
    let flags = draw_flags(curve, &scale, &mut chart)?;
    draw_axes(curve, &mut chart)?;
    for number in 0..curve.columns.len() {
        draw_column(curve, number, &scale, &mut chart, &root)?;
    }
    draw_names(curve, &scale, &flags, &root)?;
    root.present()?;
    Ok(())
}

/// What the axes span: the data, and no more.
struct Scale {
    is_x_log: bool,
    x: (f64, f64),
    /// Powers of ten of the errors, from a whole one to a little above the greatest.
    powers: (f64, f64),
}

impl Scale {
    fn of(curve: &Curve) -> Option<Self> {
        let errors = curve.rows.iter().flat_map(|row| &row.errors).copied().filter(|e| e.is_finite() && *e > 0.0);
        let (least, greatest) = extent(errors)?;
        let place = |x: f64| if curve.is_x_log { x.log10() } else { x };
        let (first, last) = (curve.rows.first()?, curve.rows.last()?);
        let high = greatest.log10() + ABOVE;
        let low = least.log10().floor().clamp((high - DECADES_MAX).ceil(), (high - 1.0).floor());
        Some(Self { is_x_log: curve.is_x_log, x: (place(first.x), place(last.x)), powers: (low, high) })
    }

    /// Where a value is on the axis.
    fn place(&self, x: f64) -> f64 {
        if self.is_x_log { x.log10() } else { x }
    }

    /// Where an error is; one that is too small for the axis is on its lowest line.
    fn level(&self, error: f64) -> f64 {
        let (low, high) = self.powers;
        if error > 0.0 { error.log10().clamp(low, high) } else { low }
    }
}

fn draw_axes(curve: &Curve, chart: &mut Chart<'_>) -> Drawn {
    let percent = |power: &f64| match power + 2.0 {
        digits if digits >= 0.0 => format!("{:.0} %", 10_f64.powf(digits)),
        digits if digits > -5.0 => format!("{:.*} %", -digits as usize, 10_f64.powf(digits)),
        digits => format!("1e{digits:.0} %"),
    };
    let plain = |x: &f64| number(if curve.is_x_log { 10_f64.powf(*x) } else { *x });
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(205, 205, 205))
        .label_style(("sans-serif", 16))
        .axis_desc_style(("sans-serif", 17))
        .x_labels(8)
        .y_labels(DECADES_MAX as usize + 1)
        .x_desc(curve.x_label)
        .y_desc("Relative error")
        .x_label_formatter(&plain)
        .y_label_formatter(&percent)
        .draw()?;
    Ok(())
}

/// Draws the background of places at which a flag is raised; returns the flags in order of appearance.
fn draw_flags(curve: &Curve, scale: &Scale, chart: &mut Chart<'_>) -> Result<Vec<String>, Box<dyn std::error::Error>> {
    let mut flags: Vec<String> = Vec::new();
    let (low, high) = scale.powers;
    let places: Vec<f64> = curve.rows.iter().map(|row| scale.place(row.x)).collect();
    // Each place reaches half-way to its neighbours.
    let halfway = |a: usize, b: usize| match (places.get(a), places.get(b)) {
        (Some(a), Some(b)) => f64::midpoint(*a, *b),
        (Some(a), None) | (None, Some(a)) => *a,
        (None, None) => 0.0,
    };
    for (number, row) in curve.rows.iter().enumerate().filter(|(_, row)| !row.flags.is_empty()) {
        let (from, to) = (halfway(number.wrapping_sub(1), number), halfway(number, number + 1));
        chart.draw_series([Rectangle::new([(from, low), (to, high)], FLAGGED.filled())])?;
        for flag in row.flags.split('|').map(|flag| flag.replace('_', " ")) {
            if !flags.contains(&flag) {
                flags.push(flag);
            }
        }
    }
    Ok(flags)
}

fn draw_column(curve: &Curve, number: usize, scale: &Scale, chart: &mut Chart<'_>, root: &Area<'_>) -> Drawn {
    let colour = COLOURS[number % COLOURS.len()];
    let at = |row: &Row| (scale.place(row.x), row.errors[number]);
    let points: Vec<(f64, f64)> = curve.rows.iter().map(at).collect();
    // An absent value interrupts the line.
    for run in points.split(|(_, error)| !error.is_finite()).filter(|run| !run.is_empty()) {
        let line: Vec<(f64, f64)> = run.iter().map(|&(x, e)| (x, scale.level(e))).collect();
        chart.draw_series([PathElement::new(line, colour.stroke_width(2))])?;
    }
    // Of many points few have a mark, different ones in each column, so that lines on each other both show.
    let step = points.len().div_ceil(MARKED);
    let is_marked = |k: usize| step == 1 || k % step == number % step;
    for &(x, error) in points.iter().enumerate().filter(|(k, _)| is_marked(*k)).map(|(_, point)| point) {
        if error.is_finite() {
            mark(root, number, chart.backend_coord(&(x, scale.level(error))), colour)?;
        }
    }
    Ok(())
}

/// The names of the columns, each after its line and mark, and what the grey background means.
fn draw_names(curve: &Curve, scale: &Scale, flags: &[String], root: &Area<'_>) -> Drawn {
    let style = ("sans-serif", 16).into_font().color(&BLACK).pos(Pos::new(HPos::Left, VPos::Center));
    let (left, step) = (RIGHT + 16, NAMES.1);
    let mut row = NAMES.0;
    for (number, name) in curve.columns.iter().enumerate() {
        let colour = COLOURS[number % COLOURS.len()];
        root.draw(&PathElement::new(vec![(left, row), (left + 36, row)], colour.stroke_width(2)))?;
        mark(root, number, (left + 18, row), colour)?;
        let is_below =
            curve.rows.iter().all(|row| row.errors[number].is_nan() || row.errors[number].log10() < scale.powers.0);
        let name = if is_below { format!("{}, below", in_words(name)) } else { in_words(name) };
        root.draw(&Text::new(name, (left + 46, row), style.clone()))?;
        row += step;
    }
    if flags.is_empty() {
        return Ok(());
    }
    row += step / 2;
    root.draw(&Rectangle::new([(left, row - 9), (left + 36, row + 9)], FLAGGED.filled()))?;
    root.draw(&Text::new("a flag is raised:", (left + 46, row), style.clone()))?;
    for flag in flags {
        row += step - 6;
        root.draw(&Text::new(flag.clone(), (left + 46, row), style.clone()))?;
    }
    Ok(())
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

/// A number for an axis, to two digits.
fn number(x: f64) -> String {
    let text = |digits: usize| format!("{x:.digits$}").trim_end_matches('0').trim_end_matches('.').to_owned();
    match x.abs() {
        size if size >= 10.0 => format!("{x:.0}"),
        size if size >= 1.0 => text(1),
        size if size >= 0.1 => text(2),
        size if size >= 1e-3 => text(3),
        size if size < 1e-12 => "0".to_owned(),
        _ => format!("{x:.0e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::curves::{clipping, offset};
    use super::*;

    /// Catches an axis that is not fitted to its data, a column without its name in words, and a flag that is not shown.
    #[test]
    fn a_picture_shows_what_its_table_has() {
        let clipped = clipping();
        let text = svg(&clipped).unwrap();
        for name in ["F_max: peak force", "spectral centroid", "a flag is raised:", "clipped"] {
            assert!(text.contains(name), "{name}");
        }
        let scale = Scale::of(&clipped).unwrap();
        assert!(scale.powers.1 < 0.0 && scale.x.0 < 0.401 && scale.x.1 > 0.999, "{:?}", (scale.powers, scale.x));
        assert!(Scale::of(&offset()).unwrap().powers.1 < -6.0, "an error that is rounding fills the picture");
        assert!(!svg(&offset()).unwrap().contains("a flag is raised"));
        let sizes = text.split("font-size=\"").skip(1).filter_map(|rest| rest.split('"').next()?.parse::<f64>().ok());
        assert!(sizes.clone().count() > 10 && sizes.into_iter().all(|size| size >= 12.0), "{text}");
    }
}
