//! A canvas: colours, lengths in pixels, lines and letters.

use anyhow::{Result, ensure};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Units per pixel. The library draws at whole units only; with so many, curves are smooth.
const UNITS_PER_PIXEL: f64 = 4.0;

// Okabe and Ito's colours, which colour-blind people distinguish.
/// Blue.
pub const BLUE: RGBColor = RGBColor(0, 114, 178);
/// Orange.
pub const ORANGE: RGBColor = RGBColor(230, 159, 0);
/// Vermillion.
pub const VERMILLION: RGBColor = RGBColor(213, 94, 0);
/// Dark grey, for letters and curves.
pub const INK: RGBColor = RGBColor(34, 34, 34);
/// Grey, for what matters less.
pub const PALE_INK: RGBColor = RGBColor(95, 95, 95);
/// Pale grey, for grids.
pub const GRID: RGBColor = RGBColor(222, 222, 222);

/// A part of a picture.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// A place on a picture, in pixels.
pub type Point = (f64, f64);

/// The SVG of what `draw` draws on a canvas of `size` pixels.
///
/// # Errors
/// Those of `draw`, and of the library.
pub fn svg(size: (u32, u32), draw: impl FnOnce(&Area<'_>) -> Result<()>) -> Result<String> {
    let (width, height) = (units(f64::from(size.0)), units(f64::from(size.1)));
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, (width.unsigned_abs(), height.unsigned_abs())).into_drawing_area();
    area.fill(&WHITE)?;
    draw(&area)?;
    area.present()?;
    drop(area);
    // The view box keeps the fine units; the size is in pixels.
    let size_of = |width: String, height: String| format!("<svg width=\"{width}\" height=\"{height}\"");
    let fine = size_of(width.to_string(), height.to_string());
    ensure!(svg.starts_with(&fine), "the picture does not begin with {fine}");
    Ok(svg.replacen(&fine, &size_of(size.0.to_string(), size.1.to_string()), 1))
}

/// Adds `dashes`, in units of the canvas, to the lines of `svg` that are `width` units wide: the library would write every dash as
/// an element, at ten times the size.
pub fn dashed(svg: &str, width: u32, dashes: &str) -> String {
    let width = format!("stroke-width=\"{width}\"");
    svg.replace(&width, &format!("{width} stroke-dasharray=\"{dashes}\""))
}

/// `svg` without the default values that the library writes out.
pub fn slim(svg: &str) -> String {
    svg.replace(" opacity=\"1\"", "").replace(" stroke=\"none\"", "")
}

/// `value` as text, without rounding noise and with a real minus sign.
pub fn number(value: f64) -> String {
    format!("{}", (value * 1e6).round() / 1e6 + 0.0).replace('-', "\u{2212}")
}

/// `exponent` as a superscript.
pub fn superscript(exponent: i32) -> String {
    let raised = |digit: char| match digit {
        '-' => '\u{207b}',
        '1' => '\u{b9}',
        '2' => '\u{b2}',
        '3' => '\u{b3}',
        digit => digit.to_digit(10).and_then(|k| char::from_u32(0x2070 + k)).unwrap_or(digit),
    };
    exponent.to_string().chars().map(raised).collect()
}

/// Pixels in units of the canvas.
pub fn units(pixels: f64) -> i32 {
    (pixels * UNITS_PER_PIXEL).round() as i32
}

/// The point `(x, y)` in units of the canvas.
pub fn at((x, y): Point) -> (i32, i32) {
    (units(x), units(y))
}

/// A line `width` pixels wide.
pub fn line(color: RGBColor, width: f64) -> ShapeStyle {
    color.stroke_width(units(width).unsigned_abs())
}

/// Letters of `size` pixels, vertically centred.
pub fn font(size: f64, color: RGBColor, align: HPos, is_bold: bool) -> TextStyle<'static> {
    let style = if is_bold { FontStyle::Bold } else { FontStyle::Normal };
    // The library divides sizes by 1.24 when it writes them.
    let font = FontDesc::new(FontFamily::SansSerif, size * UNITS_PER_PIXEL * 1.24, style);
    font.color(&color).pos(Pos::new(align, VPos::Center))
}

/// Writes `text` at `place`.
///
/// # Errors
/// Those of the library.
pub fn write(
    area: &Area<'_>,
    text: &str,
    place: Point,
    size: f64,
    color: RGBColor,
    align: HPos,
    is_bold: bool,
) -> Result<()> {
    Ok(area.draw_text(text, &font(size, color, align, is_bold), at(place))?)
}
