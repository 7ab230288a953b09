//! What a crack does to force, sound and spectrum.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;
use tapline_process::ProcessConfig;
use tapline_store::Reader;
use tapline_wire::Discriminator;

use super::SKY;
use super::tap::Tap;
use tapline_draw::axes::{Axis, Frame, coordinates, draw_mesh};
use tapline_draw::canvas::{Area, PALE_INK, Point, at, font, line, number, units, write};

/// Highest frequency drawn.
const SPECTRUM_TOP_HZ: f64 = 2500.0;
/// Where the axes begin and end.
const LEFT: f64 = 468.0;
const RIGHT: f64 = 972.0;

/// Draws force, sound and spectrum of the two taps.
pub(crate) fn draw(area: &Area<'_>, reader: &Reader, taps: &[Tap; 2]) -> Result<()> {
    legend(area, taps)?;
    let config: toml::Table = reader.config().parse()?;
    let bands: ProcessConfig =
        config.get("process").map_or_else(|| Ok(ProcessConfig::default()), |table| table.clone().try_into())?;
    let (time, frequency) = ("Time in ms", "Frequency in Hz");
    let mut force = Plot::new(104.0, (time, -0.5, 3.0), "Force in N", 22.0);
    let mut sound = Plot::new(314.0, (time, -1.0, 15.0), "Sound in V", 128.0);
    let mut spectrum = Plot::new(524.0, (frequency, 0.0, SPECTRUM_TOP_HZ), "Sound in dB re 1 V²/Hz", 22.0);
    spectrum.band = Some((bands.f_c_hz, bands.f_hi_hz));
    for tap in taps {
        let (f_max_n, tau_ms) = (tap.value(Discriminator::FMax, 1.0), tap.value(Discriminator::Tau, 1e-3));
        force.add(tap, tap.in_time(&tap.force_n), format!("peak {f_max_n:.1} N, contact {tau_ms:.2} ms"));
        let a_1_mv_s = tap.value(Discriminator::A1, 1e-3);
        sound.add(tap, tap.in_time(&tap.sound_v), format!("initial area {a_1_mv_s:.2} mV s"));
        let pr = tap.value(Discriminator::Pr, 1.0);
        spectrum.add(tap, tap.spectrum_db()?, format!("power ratio {pr:.3}"));
    }
    [force, sound, spectrum].iter().try_for_each(|plot| plot.draw(area))
}

fn legend(area: &Area<'_>, taps: &[Tap; 2]) -> Result<()> {
    for (x, tap) in [(LEFT, &taps[0]), (LEFT + 150.0, &taps[1])] {
        area.draw(&PathElement::new(vec![at((x, 88.0)), at((x + 22.0, 88.0))], line(tap.color, 2.5)))?;
        write(area, &tap.name, (x + 28.0, 88.0), 13.0, tap.color, HPos::Left, true)?;
    }
    let id = taps[1].header.id;
    let offset = id.offset_mm().map(|x_mm| format!("x = {} mm", number(x_mm)));
    let velocity = id.velocity_m_per_s().map(|v_m_per_s| format!("{} m/s", number(v_m_per_s)));
    let how = offset.into_iter().chain(velocity).collect::<Vec<_>>().join(", ");
    write(area, &how, (RIGHT, 88.0), 12.0, PALE_INK, HPos::Right, false)
}

/// Curves over one pair of axes.
struct Plot {
    top: f64,
    /// Name and range of the abscissa.
    x: (&'static str, f64, f64),
    y: &'static str,
    /// Range of the abscissa that is shaded.
    band: Option<Point>,
    /// How far below its top the first note stands.
    notes: f64,
    curves: Vec<(RGBColor, Vec<Point>, String)>,
}

impl Plot {
    fn new(top: f64, x: (&'static str, f64, f64), y: &'static str, notes: f64) -> Self {
        Self { top, x, y, band: None, notes, curves: Vec::new() }
    }

    fn add(&mut self, tap: &Tap, mut points: Vec<Point>, note: String) {
        points.retain(|&(x, _)| (self.x.1..=self.x.2).contains(&x));
        self.curves.push((tap.color, points, note));
    }

    /// Range of the ordinate, with some air.
    fn range(&self) -> Point {
        let mut ys: Vec<f64> = self.curves.iter().flat_map(|(_, points, _)| points.iter().map(|p| p.1)).collect();
        ys.sort_by(f64::total_cmp);
        let (low, high) = (ys.first().copied().unwrap_or(0.0), ys.last().copied().unwrap_or(1.0));
        let air = 0.06 * (high - low);
        (low - air, high + air)
    }

    fn write_notes(&self, area: &Area<'_>) -> Result<()> {
        for (k, (color, _, note)) in (0..).zip(&self.curves) {
            let place = (RIGHT - 8.0, self.top + self.notes + 18.0 * f64::from(k));
            write(area, note, place, 12.0, *color, HPos::Right, true)?;
        }
        Ok(())
    }

    fn draw(&self, area: &Area<'_>) -> Result<()> {
        let (x_label, left, right) = self.x;
        let (low, high) = self.range();
        let (top, bottom) = (self.top + 6.0, self.top + 168.0);
        let frame = Frame { left: LEFT, right: RIGHT, top, bottom, left_room: 58.0, bottom_room: 38.0 };
        let x = Axis { label: x_label.to_owned(), range: (left, right), label_count: 8 };
        let y = Axis { label: self.y.to_owned(), range: (low, high), label_count: 6 };
        let mut chart = coordinates(area, &frame, &x, &y)?;
        if let Some((from, to)) = self.band {
            chart.draw_series([Rectangle::new([(from, low), (to, high)], SKY.mix(0.14).filled())])?;
            let corner = chart.plotting_area().map_coordinate(&(from, low));
            let style = font(12.0, PALE_INK, HPos::Left, false);
            area.draw_text("flexural band", &style, (corner.0 + units(8.0), corner.1 - units(12.0)))?;
        }
        draw_mesh(&mut chart, &x, &y)?;
        for (color, points, _) in &self.curves {
            chart.draw_series([PathElement::new(points.clone(), line(*color, 1.5))])?;
        }
        self.write_notes(area)
    }
}
