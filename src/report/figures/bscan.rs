//! The B-scan of a shoulder: spectra side by side along the ring, as an image within axes.

use anyhow::{Context as _, Result};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use plotters::prelude::*;
use tapline_draw::canvas::{INK, Point, VERMILLION, number, units};

use crate::report::evidence::Shoulder;
use crate::report::evidence::spectra::{ROWS, Spectra};
use crate::report::figures::axis::Axis;
use crate::report::figures::chart::Sheet;
use crate::report::figures::colour::{ABSENT, heat};
use crate::report::figures::rounds::{along, spans};

/// Range of densities with different colours, below the loudest, in dB.
pub(crate) const DEPTH_DB: f64 = 30.0;

/// Number of colours of the image; one more marks a location without a tap.
const COLOURS: u8 = 250;

/// Most columns of an image; finer ones would not be visible.
const COLUMNS_MOST: usize = 800;

/// Placeholder of the image, in a colour that nothing else has.
const PLACE: RGBColor = RGBColor(1, 2, 3);

/// The picture of `spectra`; densities of `loudest_db` have the darkest colour.
pub(crate) fn svg(title: String, shoulder: &Shoulder, spectra: &Spectra, loudest_db: f64) -> Result<String> {
    let band_hz = spectra.band_hz;
    let sheet = Sheet {
        height: 206,
        title,
        keys: Vec::new(),
        ramp: Some([number((loudest_db - DEPTH_DB).round()), format!("{} dB", number(loudest_db.round()))]),
        x: along(std::slice::from_ref(shoulder)),
        y: Axis::from_to("frequency, Hz", band_hz, 6),
    };
    let png = png(&pixels(shoulder, spectra, sheet.x.range, loudest_db))?;
    let svg = sheet.svg(|chart| {
        let (from, to) = sheet.x.range;
        chart.draw_series([Rectangle::new([(from, band_hz.0), (to, band_hz.1)], PLACE.filled())])?;
        for (from, to) in spans(shoulder, sheet.x.range).into_iter().flatten() {
            // Across the upper edge, on a ground that contrasts with any colour.
            for (color, width) in [(WHITE, 9.0), (VERMILLION, 6.0)] {
                let style = color.stroke_width(units(width).unsigned_abs());
                chart.draw_series([PathElement::new(vec![(from, band_hz.1), (to, band_hz.1)], style)])?;
            }
            for x in [from, to] {
                let ends = vec![(x, band_hz.0), (x, band_hz.1)];
                chart.draw_series([PathElement::new(ends, INK.stroke_width(units(0.75).unsigned_abs()))])?;
            }
        }
        Ok(())
    })?;
    placed(&svg, &png)
}

/// Replaces the placeholder [`PLACE`] by the image.
fn placed(svg: &str, png: &[u8]) -> Result<String> {
    let fill = format!("fill=\"#{:02X}{:02X}{:02X}\"", PLACE.0, PLACE.1, PLACE.2);
    let lost = "the picture has lost its place";
    let here = svg.find(&fill).context(lost)?;
    let start = svg[..here].rfind("<rect").context(lost)?;
    let end = here + svg[here..].find("/>").context(lost)? + 2;
    let box_end = svg[start..].find(" opacity").context(lost)? + start;
    let bounds = &svg[start + "<rect".len()..box_end];
    let data = STANDARD.encode(png);
    Ok(format!(
        "{}<image{bounds} preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\" href=\"data:image/png;base64,{data}\"/>{}",
        &svg[..start],
        &svg[end..]
    ))
}

/// Rows from the top, with one colour index per column; the last colour means no tap.
struct Pixels {
    width: usize,
    colours: Vec<u8>,
}

fn pixels(shoulder: &Shoulder, spectra: &Spectra, range: Point, loudest_db: f64) -> Pixels {
    // Two columns per location, because on a ring the halves of the first location are at both ends.
    let width = (2 * shoulder.cells.len()).clamp(1, COLUMNS_MOST);
    let column = |k: usize| {
        let x = range.0 + (range.1 - range.0) * (k as f64 + 0.5) / width as f64;
        let away = |place: f64| match shoulder.is_round {
            true => ((x - place + 180.0).rem_euclid(360.0) - 180.0).abs(),
            false => (x - place).abs(),
        };
        let nearest =
            shoulder.cells.iter().zip(&spectra.columns).min_by(|a, b| away(a.0.place).total_cmp(&away(b.0.place)));
        nearest.and_then(|(_, column)| column.as_deref())
    };
    let columns: Vec<Option<&[f64]>> = (0..width).map(column).collect();
    let shade = |density_db: f64| {
        let fraction = ((density_db - loudest_db) / DEPTH_DB + 1.0).clamp(0.0, 1.0);
        (fraction * f64::from(COLOURS - 1)).round() as u8
    };
    let row =
        |row: usize| columns.iter().map(move |column| column.map_or(COLOURS, |column| shade(column[ROWS - 1 - row])));
    Pixels { width, colours: (0..ROWS).flat_map(row).collect() }
}

fn png(pixels: &Pixels) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    let palette = (0..COLOURS).map(|k| heat(f64::from(k), (0.0, f64::from(COLOURS - 1))));
    let palette: Vec<u8> = palette.chain([ABSENT]).flat_map(|RGBColor(r, g, b)| [r, g, b]).collect();
    let (width, height) = (u32::try_from(pixels.width)?, u32::try_from(ROWS)?);
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    encoder.set_palette(palette);
    encoder.write_header()?.write_image_data(&pixels.colours)?;
    Ok(out)
}
