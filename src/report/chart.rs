//! Axes, curves and keys: the one style of the report's pictures, small enough to be read on a telephone.

use anyhow::Result;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::colour::heat;
use super::inline;
use super::ticked::Ticked;
use tapline_draw::canvas::{self, Area, GRID, INK, PALE_INK, Point, at, font, line, units, write};

/// Width of a picture: that of a telephone, of half a page and of a third of a screen.
pub(super) const WIDTH: u32 = 370;

/// Room for the numbers and the name of each axis.
const LEFT: f64 = 52.0;
const BOTTOM: f64 = 32.0;
/// Room beside the axes, for the half of a number.
const RIGHT: f64 = 14.0;
/// Height of a line of writing above the axes.
const ROW: f64 = 16.0;
/// Width of a letter of the size that keys are written in.
const LETTER: f64 = 5.3;
const SIZE: f64 = 11.0;

pub(super) type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<Ticked, Ticked>>;

/// How a curve is drawn. Each has a width of its own, by which the dashes are put in once the curves are written: the
/// library would write every dash as an element.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stroke {
    /// Unbroken.
    Plain,
    /// Long dashes.
    Dashed,
    /// Short dashes, for limits.
    Limit,
}

impl Stroke {
    /// Width in units of the sheet, and dashes in the same.
    fn shape(self) -> (u32, Option<&'static str>) {
        match self {
            Self::Plain => (6, None),
            Self::Dashed => (5, Some("20 10")),
            Self::Limit => (7, Some("8 8")),
        }
    }

    pub(super) fn style(self, color: RGBColor) -> ShapeStyle {
        color.stroke_width(self.shape().0)
    }
}

/// One entry of the key above the axes.
pub(super) struct Key {
    pub(super) words: String,
    pub(super) color: RGBColor,
    pub(super) stroke: Stroke,
}

/// What one axis shows.
pub(super) struct Axis {
    /// Name and unit.
    pub(super) label: String,
    pub(super) range: Point,
    pub(super) ticks: Vec<f64>,
}

impl Axis {
    /// From the least to the greatest of `range`, with room around it and, above, for a word, with `count` or fewer numbers.
    pub(super) fn around(label: impl Into<String>, (low, high): Point, count: usize) -> Self {
        let room = if high > low { 0.06 * (high - low) } else { 0.5 * high.abs() + f64::MIN_POSITIVE };
        Self::from_to(label, (low - room, high + 3.0 * room), count)
    }

    /// Exactly over `range`, with `count` or fewer numbers.
    pub(super) fn from_to(label: impl Into<String>, range: Point, count: usize) -> Self {
        Self { label: label.into(), range, ticks: ticks(range, count) }
    }
}

/// Round numbers within `range`, `count` or fewer.
pub(super) fn ticks((low, high): Point, count: usize) -> Vec<f64> {
    let span = high - low;
    if !(span.is_finite() && span > 0.0) || count == 0 {
        return Vec::new();
    }
    let least = span / count as f64;
    let decade = 10f64.powf(least.log10().floor());
    let step = [1.0, 2.0, 2.5, 5.0, 10.0].iter().map(|&m| m * decade).find(|step| span / step <= count as f64);
    let step = step.unwrap_or(10.0 * decade);
    let first = (low / step).ceil() as i64;
    // A count that rounding could not take beyond what fits.
    (0..=count as i64).map(|k| (first + k) as f64 * step).filter(|tick| *tick <= high + 1e-9 * span).collect()
}

/// A picture with axes, titles and a key above them.
pub(super) struct Sheet {
    pub(super) height: u32,
    pub(super) title: String,
    pub(super) keys: Vec<Key>,
    /// Words at the pale and at the dark end of a bar of colours beside the title.
    pub(super) ramp: Option<[String; 2]>,
    pub(super) x: Axis,
    pub(super) y: Axis,
}

impl Sheet {
    /// The picture as an element of a page, named `title`; `draw` draws within the axes.
    pub(super) fn svg(&self, draw: impl FnOnce(&mut Chart<'_, '_>) -> Result<()>) -> Result<String> {
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

    /// Writes the key; how many lines it takes.
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
            .build_cartesian_2d(Ticked::of(&self.x), Ticked::of(&self.y))?;
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

/// Puts dashes into the strokes that have them.
fn dashed(mut svg: String) -> String {
    for stroke in [Stroke::Dashed, Stroke::Limit] {
        if let (width, Some(dashes)) = stroke.shape() {
            let width = format!("stroke-width=\"{width}\"");
            svg = svg.replace(&width, &format!("{width} stroke-dasharray=\"{dashes}\""));
        }
    }
    svg
}

/// Draws `points` as a curve that is broken where one is absent; a point without neighbours is a dot.
pub(super) fn curve(chart: &mut Chart<'_, '_>, points: &[Option<Point>], style: ShapeStyle) -> Result<()> {
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

/// Draws a level line over the whole width.
pub(super) fn level(chart: &mut Chart<'_, '_>, y: f64, style: ShapeStyle) -> Result<()> {
    let range = chart.x_range();
    chart.draw_series([PathElement::new(vec![(range.start, y), (range.end, y)], style)])?;
    Ok(())
}

/// Shades the x from `low` to `high`.
pub(super) fn band(chart: &mut Chart<'_, '_>, (low, high): Point, color: RGBAColor) -> Result<()> {
    let range = chart.y_range();
    chart.draw_series([Rectangle::new([(low, range.start), (high, range.end)], color.filled())])?;
    Ok(())
}

/// A power of ten, its exponent a multiple of three, by which values in `unit` between `low` and `high` have few digits;
/// a number without unit is left as it is.
pub(super) fn exponent_of(unit: &str, (low, high): Point) -> i32 {
    let greatest = if high.abs() > low.abs() { high.abs() } else { low.abs() };
    if unit.is_empty() || !(greatest.is_finite() && greatest > 0.0) {
        return 0;
    }
    let exponent = (greatest.log10() / 3.0).floor() as i32 * 3;
    if (0..=3).contains(&exponent) { 0 } else { exponent }
}

/// `unit` multiplied by a power of ten, in print: "10⁻⁶ V²/Hz".
pub(super) fn scaled_unit(exponent: i32, unit: &str) -> String {
    if exponent == 0 {
        return unit.to_owned();
    }
    let digit = |c: char| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => char::from_u32(0x2070 + digit.to_digit(10).unwrap_or(0)).unwrap_or(digit),
    };
    let digits: String = exponent.to_string().chars().map(digit).collect();
    format!("10{digits} {unit}").trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use tapline_draw::canvas::BLUE;

    /// Catches ticks that are not round, crowd, or lie outside of their axis.
    #[test]
    fn ticks_are_few_round_and_inside() {
        assert_eq!(ticks((0.0, 6.2), 5), [0.0, 2.0, 4.0, 6.0]);
        assert_eq!(ticks((-0.3, 1.1), 5).len(), 3);
        assert_eq!(ticks((0.0, 360.0), 4), [0.0, 100.0, 200.0, 300.0]);
        for range in [(1e-9, 3e-9), (-5.0, 1e6), (0.1, 0.100_01), (7.0, 1e3)] {
            let ticks = ticks(range, 5);
            assert!((1..=5).contains(&ticks.len()), "{range:?} {ticks:?}");
            let room = 1e-9 * (range.1 - range.0);
            let is_inside = |tick: &f64| (range.0 - room..=range.1 + room).contains(tick);
            assert!(ticks.iter().all(is_inside), "{range:?} {ticks:?}");
        }
        assert_eq!(ticks((1.0, 1.0), 5), Vec::<f64>::new());
    }

    /// Catches an exponent that does not belong to the numbers, and one written for none.
    #[test]
    fn units_carry_their_power_of_ten() {
        let of = |greatest| exponent_of("N", (-0.5 * greatest, greatest));
        assert_eq!((of(0.31), of(2.4e-8), of(45.0), of(0.0)), (-3, -9, 0, 0));
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
