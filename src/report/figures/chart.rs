//! Axes, curves and keys: the one style of the report's pictures, small enough for a telephone.

use anyhow::Result;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use tapline_draw::canvas::{self, Area, GRID, INK, PALE_INK, Point, at, font, line, superscript, units, write};

use crate::report::figures::axis::{Axis, Ticked};
use crate::report::figures::colour::heat;
use crate::report::figures::inline;

/// Width of a picture: fits a telephone, half a page and a third of a screen.
pub(crate) const WIDTH: u32 = 370;

/// Room for the numbers and the label of each axis.
const LEFT: f64 = 52.0;
const BOTTOM: f64 = 32.0;
/// Room beside the axes for half of a number.
const RIGHT: f64 = 14.0;
/// Height of a line of text above the axes.
const ROW: f64 = 16.0;
/// Width of a letter in a key.
const LETTER: f64 = 5.3;
const SIZE: f64 = 11.0;

pub(crate) type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<Ticked, Ticked>>;

/// The style of a curve. Each has its own width, which identifies it when dashes are added afterwards; the library
/// would write every dash as an element.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stroke {
    /// Unbroken.
    Plain,
    /// Long dashes.
    Dashed,
    /// Short dashes, for limits.
    Limit,
}

impl Stroke {
    /// Width and dashes, in units of the canvas.
    fn shape(self) -> (u32, &'static str) {
        match self {
            Self::Plain => (6, ""),
            Self::Dashed => (5, "20 10"),
            Self::Limit => (7, "8 8"),
        }
    }

    pub(crate) fn style(self, color: RGBColor) -> ShapeStyle {
        color.stroke_width(self.shape().0)
    }
}

/// One entry of the key above the axes.
pub(crate) struct Key {
    pub words: String,
    pub color: RGBColor,
    pub stroke: Stroke,
}

/// A picture with axes, titles and a key above them.
pub(crate) struct Sheet {
    pub height: u32,
    pub title: String,
    pub keys: Vec<Key>,
    /// Labels of the pale and the dark end of a bar of colours beside the title.
    pub ramp: Option<[String; 2]>,
    pub x: Axis,
    pub y: Axis,
}

impl Sheet {
    /// The picture as an element of a page, named `title`; `draw` draws within the axes.
    pub(crate) fn svg(&self, draw: impl FnOnce(&mut Chart<'_, '_>) -> Result<()>) -> Result<String> {
        let svg = canvas::svg((WIDTH, self.height), |area| {
            write(area, &self.title, (8.0, 10.0), 12.0, INK, HPos::Left, true)?;
            self.ramp(area)?;
            let rows = self.key(area)?;
            let mut chart = self.axes(area, 24.0 + ROW * rows)?;
            draw(&mut chart)
        })?;
        Ok(inline::svg(&dashed(svg), &self.title))
    }

    fn ramp(&self, area: &Area<'_>) -> Result<()> {
        const STEPS: u32 = 32;
        let Some([pale, dark]) = &self.ramp else { return Ok(()) };
        let right = f64::from(WIDTH) - RIGHT - 12.0 - LETTER * dark.chars().count() as f64;
        let (left, width) = (right - 64.0, 64.0 / f64::from(STEPS));
        for step in 0..STEPS {
            let x = left + width * f64::from(step);
            let color = heat(f64::from(step), (0.0, f64::from(STEPS - 1)));
            area.draw(&Rectangle::new([at((x, 5.0)), at((x + width, 15.0))], color.filled()))?;
        }
        write(area, pale, (left - 4.0, 10.0), SIZE, INK, HPos::Right, false)?;
        write(area, dark, (right + 4.0, 10.0), SIZE, INK, HPos::Left, false)
    }

    /// Writes the key; returns its number of lines.
    fn key(&self, area: &Area<'_>) -> Result<f64> {
        let (mut x, mut y) = (8.0, 26.0);
        for key in &self.keys {
            let width = 26.0 + LETTER * key.words.chars().count() as f64;
            if x > 8.0 && x + width > f64::from(WIDTH) - 4.0 {
                (x, y) = (8.0, y + ROW);
            }
            let ends = [(x, y), (x + 18.0, y)].map(at).to_vec();
            area.draw(&PathElement::new(ends, key.stroke.style(key.color)))?;
            write(area, &key.words, (x + 22.0, y), SIZE, INK, HPos::Left, false)?;
            x += width + 8.0;
        }
        Ok(if self.keys.is_empty() { 0.0 } else { (y - 26.0) / ROW + 1.0 })
    }

    fn axes<'b>(&self, area: &Area<'b>, top: f64) -> Result<Chart<'_, 'b>> {
        let place: DrawingArea<SVGBackend<'b>, Shift> = area.clone();
        let mut chart = ChartBuilder::on(&place)
            .margin_top(units(top))
            .margin_right(units(RIGHT))
            .set_label_area_size(LabelAreaPosition::Left, units(LEFT))
            .set_label_area_size(LabelAreaPosition::Bottom, units(BOTTOM))
            .build_cartesian_2d(Ticked::new(&self.x), Ticked::new(&self.y))?;
        chart
            .configure_mesh()
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .light_line_style(TRANSPARENT)
            .bold_line_style(line(GRID, 1.0))
            .axis_style(line(PALE_INK, 1.0))
            .label_style(font(SIZE - 0.5, PALE_INK, HPos::Center, false))
            .axis_desc_style(font(SIZE, INK, HPos::Center, false))
            .draw()?;
        Ok(chart)
    }
}

/// Adds dashes to the strokes that have them.
fn dashed(mut svg: String) -> String {
    for (width, dashes) in [Stroke::Dashed, Stroke::Limit].map(Stroke::shape) {
        svg = canvas::dashed(&svg, width, dashes);
    }
    svg
}

/// Draws `points` as a curve with gaps where points are absent; a single point is a dot.
pub(crate) fn curve(chart: &mut Chart<'_, '_>, points: &[Option<Point>], style: ShapeStyle) -> Result<()> {
    for run in points.split(Option::is_none) {
        let run: Vec<Point> = run.iter().copied().flatten().collect();
        match run.as_slice() {
            [] => {}
            [alone] => {
                chart.draw_series([Circle::new(*alone, units(1.5), style.color.filled())])?;
            }
            _ => {
                chart.draw_series([PathElement::new(run, style)])?;
            }
        }
    }
    Ok(())
}

/// Draws a horizontal line over the whole width.
pub(crate) fn level(chart: &mut Chart<'_, '_>, y: f64, style: ShapeStyle) -> Result<()> {
    let range = chart.x_range();
    chart.draw_series([PathElement::new(vec![(range.start, y), (range.end, y)], style)])?;
    Ok(())
}

/// Shades the range from `low` to `high` of x.
pub(crate) fn band(chart: &mut Chart<'_, '_>, (low, high): Point, color: RGBAColor) -> Result<()> {
    let range = chart.y_range();
    chart.draw_series([Rectangle::new([(low, range.start), (high, range.end)], color.filled())])?;
    Ok(())
}

/// An exponent of ten, a multiple of three, that leaves values in `unit` between `low` and `high` with few digits; 0
/// for numbers without a unit.
fn exponent_of(unit: &str, (low, high): Point) -> i32 {
    let greatest = if high.abs() > low.abs() { high.abs() } else { low.abs() };
    if unit.is_empty() || !(greatest.is_finite() && greatest > 0.0) {
        return 0;
    }
    let exponent = (greatest.log10() / 3.0).floor() as i32 * 3;
    if (0..=3).contains(&exponent) { 0 } else { exponent }
}

/// What values of `name` in `unit` between `extremes` are multiplied by to have few digits, and the label of their axis.
pub(crate) fn scaled(name: &str, unit: &str, extremes: Point) -> (f64, String) {
    let exponent = exponent_of(unit, extremes);
    let unit = scaled_unit(exponent, unit);
    (10f64.powi(-exponent), if unit.is_empty() { name.to_owned() } else { format!("{name}, {unit}") })
}

/// `unit` multiplied by a power of ten, as text: "10⁻⁶ V²/Hz".
fn scaled_unit(exponent: i32, unit: &str) -> String {
    if exponent == 0 {
        return unit.to_owned();
    }
    format!("10{} {unit}", superscript(exponent)).trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use tapline_draw::canvas::BLUE;

    use super::*;

    /// Catches an exponent that does not fit the numbers, and one for numbers without a unit.
    #[test]
    fn units_carry_their_power_of_ten() {
        let exponent = |greatest| exponent_of("N", (-0.5 * greatest, greatest));
        assert_eq!((exponent(0.31), exponent(2.4e-8), exponent(45.0), exponent(0.0)), (-3, -9, 0, 0));
        assert_eq!((exponent_of("", (0.0, 0.1)), exponent_of("N", (-0.1, 0.0))), (0, -3));
        assert_eq!((scaled_unit(-6, "V²/Hz").as_str(), scaled_unit(0, "N").as_str()), ("10⁻⁶ V²/Hz", "N"));
    }

    /// Catches an absent value drawn as 0, or bridged.
    #[test]
    fn an_absent_value_is_a_gap() {
        let sheet = Sheet {
            height: 150,
            title: "t".to_owned(),
            keys: Vec::new(),
            ramp: None,
            x: Axis::from_to("x", (0.0, 5.0), 5),
            y: Axis::from_to("y", (0.0, 5.0), 5),
        };
        let points =
            [Some((0.0, 1.0)), Some((1.0, 1.0)), None, Some((3.0, 2.0)), None, Some((4.0, 1.0)), Some((5.0, 1.0))];
        let svg = sheet.svg(|chart| curve(chart, &points, Stroke::Dashed.style(BLUE))).unwrap();
        assert_eq!(svg.matches("<polyline fill=\"none\" opacity=\"1\" stroke=\"#0072B2\"").count(), 2, "{svg}");
        assert_eq!((svg.matches("<circle").count(), svg.matches("stroke-dasharray").count()), (1, 2), "{svg}");
    }
}
