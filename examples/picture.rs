//! Draws what an archive says of a damaged and of a sound shoulder: the two damage maps, and what one tap of a crack
//! and one of sound rubber look like.
//!
//! `cargo run --release --example picture -- demo/demo.h5 docs/picture.svg`

use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use realfft::RealFftPlanner;
use tapline_process::ProcessConfig;
use tapline_store::{OwnedSamples, Reader, regions};
use tapline_wire::{Channel, DamageCell, Geometry, Judgement, Scan, SourceKind, Verdict};

/// Size of the picture.
const SIZE: (u32, u32) = (1000, 730);
/// The library draws at whole units only: with this many a pixel, curves are smooth.
const UNITS_PER_PIXEL: f64 = 4.0;
/// Radii of the damage map: index 0, greatest index, regions, truth, writing.
const RADII: [f64; 5] = [58.0, 109.0, 115.0, 120.5, 133.0];
/// Width of a bar of the drawn spectra; finer ones hide each other.
const SPECTRUM_STEP_HZ: f64 = 10.0;
/// Highest frequency drawn.
const SPECTRUM_TOP_HZ: f64 = 2500.0;

// Okabe and Ito's colours, which colour-blind people tell apart.
const BLUE: RGBColor = RGBColor(0, 114, 178);
const SKY: RGBColor = RGBColor(86, 180, 233);
const ORANGE: RGBColor = RGBColor(230, 159, 0);
const VERMILLION: RGBColor = RGBColor(213, 94, 0);
const INK: RGBColor = RGBColor(34, 34, 34);
const PALE_INK: RGBColor = RGBColor(95, 95, 95);
const GRID: RGBColor = RGBColor(222, 222, 222);

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Point = (f64, f64);

/// A shoulder and what was found on it.
struct Shoulder<'a> {
    scan: &'a Scan,
    judgement: Judgement,
    cells: Vec<DamageCell>,
    peak: DamageCell,
}

impl Shoulder<'_> {
    fn verdict(&self) -> String {
        Verdict::from_code(self.judgement.verdict).map_or_else(String::new, |verdict| verdict.to_string())
    }

    fn name(&self) -> String {
        format!("{}, shoulder {}", self.scan.tyre, self.scan.shoulder)
    }
}

/// One tap, scaled and free of its baseline.
struct Tap {
    name: String,
    color: RGBColor,
    source: &'static str,
    force_n: Vec<f64>,
    sound_v: Vec<f64>,
    sample_rate_hz: f64,
    pre_trigger_samples: f64,
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let archive = arguments.next().unwrap_or_else(|| "demo.h5".to_owned());
    let out = arguments.next().unwrap_or_else(|| "docs/picture.svg".to_owned());
    let reader = Reader::open(&archive)?;
    ensure!(reader.plan().geometry == Geometry::Ring, "{archive} holds no ring, and this draws rings");
    let svg = draw(&reader)?;
    if let Some(folder) = Path::new(&out).parent() {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    std::fs::write(&out, svg).with_context(|| format!("cannot write {out}"))
}

fn draw(reader: &Reader) -> Result<String> {
    let mut shoulders = shoulders(reader)?;
    shoulders.sort_by(|a, b| b.peak.damage_index.total_cmp(&a.peak.damage_index));
    let [damaged, .., sound] = shoulders.as_slice() else { bail!("fewer than two shoulders are judged") };
    let taps = [
        tap_at(reader, damaged.scan, &sound_cell(reader, damaged)?, "sound", BLUE)?,
        tap_at(reader, damaged.scan, &damaged.peak, "cracked", VERMILLION)?,
    ];
    let mut svg = String::new();
    {
        let size = (units(f64::from(SIZE.0)), units(f64::from(SIZE.1)));
        let area =
            SVGBackend::with_string(&mut svg, (size.0.unsigned_abs(), size.1.unsigned_abs())).into_drawing_area();
        area.fill(&WHITE)?;
        title(&area, reader, damaged, taps[0].source)?;
        let greatest = damaged.peak.damage_index.ceil();
        ring(&area, reader, damaged, (196.0, 230.0), greatest)?;
        ring(&area, reader, sound, (196.0, 533.0), greatest)?;
        ring_legend(&area, 706.0)?;
        panels(&area, reader, &taps)?;
        area.present()?;
    }
    let (fine, plain) = (units(1.0), format!("<svg width=\"{}\" height=\"{}\"", SIZE.0, SIZE.1));
    let drawn = format!("<svg width=\"{}\" height=\"{}\"", SIZE.0 as i32 * fine, SIZE.1 as i32 * fine);
    ensure!(svg.contains(&drawn), "the picture does not begin as it was asked to");
    Ok(svg.replacen(&drawn, &plain, 1))
}

fn shoulders(reader: &Reader) -> Result<Vec<Shoulder<'_>>> {
    let mut shoulders = Vec::new();
    for (scan, judged) in reader.plan().scans().iter().zip(reader.judgements()?) {
        let Some((judgement, cells)) = judged else { continue };
        let known = cells.iter().filter(|cell| cell.damage_index.is_finite());
        let Some(highest) = known.clone().max_by(|a, b| a.damage_index.total_cmp(&b.damage_index)) else { continue };
        // The index has a ceiling that a whole crack reaches: its middle is the place to show.
        let ceiling: Vec<&DamageCell> = known
            .filter(|c| c.damage_index.total_cmp(&highest.damage_index).is_eq() && c.region == highest.region)
            .collect();
        let peak = *ceiling[ceiling.len() / 2];
        shoulders.push(Shoulder { scan, judgement, cells, peak });
    }
    Ok(shoulders)
}

/// Whether the location is cracked, where that is known.
fn is_cracked(reader: &Reader, scan: &Scan, location: u32) -> Option<bool> {
    reader.truth().get(&(scan.tyre, scan.shoulder, location)).copied()
}

/// The most ordinary location of the shoulder: its index is the median of those outside of every region.
fn sound_cell(reader: &Reader, shoulder: &Shoulder<'_>) -> Result<DamageCell> {
    let is_sound = |cell: &&DamageCell| {
        cell.region == 0
            && cell.damage_index.is_finite()
            && is_cracked(reader, shoulder.scan, cell.location) != Some(true)
    };
    let mut cells: Vec<DamageCell> = shoulder.cells.iter().filter(is_sound).copied().collect();
    cells.sort_by(|a, b| a.damage_index.total_cmp(&b.damage_index));
    cells.get(cells.len() / 2).copied().with_context(|| format!("{} has no sound location", shoulder.name()))
}

/// The tap of middling peak force among those nearest to the belt edge at the highest velocity.
fn tap_at(reader: &Reader, scan: &Scan, cell: &DamageCell, word: &str, color: RGBColor) -> Result<Tap> {
    let found = reader.discriminators()?;
    let mut taps = Vec::new();
    for &row in &scan.taps {
        let planned = &reader.plan().taps()[row as usize];
        if let Some(d) = found[row as usize].filter(|d| d.quality.is_clean())
            && planned.id.location == cell.location
        {
            let offset_mm = planned.id.offset_mm().unwrap_or(0.0).abs();
            let velocity_m_per_s = planned.id.velocity_m_per_s().unwrap_or(0.0);
            taps.push((offset_mm, -velocity_m_per_s, d.values.get(tapline_wire::Discriminator::FMax), row));
        }
    }
    taps.sort_by(|a, b| {
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.partial_cmp(&b.2).unwrap_or(a.3.cmp(&b.3)))
    });
    let alike =
        |t: &&(f64, f64, Option<f64>, u32)| t.0.total_cmp(&taps[0].0).is_eq() && t.1.total_cmp(&taps[0].1).is_eq();
    let count = taps.iter().take_while(alike).count();
    ensure!(count > 0, "location {} has no tap to show", cell.location);
    let row = taps[(count - 1) / 2].3;
    let (header, samples) = reader.tap(row)?.with_context(|| format!("the tap in row {row} is not archived"))?;
    let channel = |kind: Channel| -> Result<Vec<f64>> {
        let (at, (_, scale)) = header
            .channels()
            .enumerate()
            .find(|(_, (channel, _))| *channel == kind)
            .with_context(|| format!("the tap in row {row} has no {} channel", kind.name()))?;
        let count = header.sample_count as usize;
        let range = at * count..(at + 1) * count;
        let values: Vec<f64> = match &samples {
            OwnedSamples::I16(all) => all[range].iter().map(|&x| f64::from(x) * scale).collect(),
            OwnedSamples::F32(all) => all[range].iter().map(|&x| f64::from(x) * scale).collect(),
        };
        Ok(without_baseline(values, header.pre_trigger_samples))
    };
    Ok(Tap {
        name: format!("{word}: location {} ({:.0}°)", cell.location, angle_deg(cell)),
        color,
        source: SourceKind::from_code(header.source).map_or("", SourceKind::name),
        force_n: channel(Channel::Force)?,
        sound_v: channel(Channel::Sound)?,
        sample_rate_hz: header.sample_rate_hz,
        pre_trigger_samples: f64::from(header.pre_trigger_samples),
    })
}

/// The signal less the median of its first 0.75 p samples (section 2 of the method).
fn without_baseline(mut signal: Vec<f64>, pre_trigger_samples: u32) -> Vec<f64> {
    let mut quiet = signal[..(pre_trigger_samples as usize * 3 / 4).min(signal.len())].to_vec();
    quiet.sort_by(f64::total_cmp);
    let median = quiet.get(quiet.len() / 2).copied().unwrap_or(0.0);
    signal.iter_mut().for_each(|x| *x -= median);
    signal
}

/// One-sided boxcar power spectral density in dB re 1 V^2/Hz (Eq. 50), the mean of every `SPECTRUM_STEP_HZ`.
fn spectrum_db(tap: &Tap) -> Result<Vec<Point>> {
    let mut signal = tap.sound_v.clone();
    let fft = RealFftPlanner::new().plan_fft_forward(signal.len());
    let mut bins = fft.make_output_vec();
    fft.process(&mut signal, &mut bins)?;
    let bin_width_hz = tap.sample_rate_hz / tap.sound_v.len() as f64;
    let density = 2.0 / (tap.sample_rate_hz * tap.sound_v.len() as f64);
    let step = ((SPECTRUM_STEP_HZ / bin_width_hz).round() as usize).clamp(1, bins.len());
    let points = bins[1..].chunks_exact(step).enumerate().map(|(k, chunk)| {
        let mean = chunk.iter().map(|x| x.norm_sqr() * density).sum::<f64>() / step as f64;
        let first = (1 + k * step) as f64;
        ((first + (step - 1) as f64 / 2.0) * bin_width_hz, 10.0 * mean.log10())
    });
    Ok(points.take_while(|&(f_hz, _)| f_hz <= SPECTRUM_TOP_HZ).filter(|(_, db)| db.is_finite()).collect())
}

fn title(area: &Area<'_>, reader: &Reader, shoulder: &Shoulder<'_>, source: &str) -> Result<()> {
    let color = if shoulder.judgement.verdict == Verdict::Reject.code() { VERMILLION } else { INK };
    let Judgement { planned_count, received_count, limit_reject, .. } = shoulder.judgement;
    let region_count = regions(reader.plan().geometry, &shoulder.cells).len();
    let peak = shoulder.peak;
    write(area, &format!("Tyre {}: ", shoulder.name()), (28.0, 30.0), 21.0, INK, HPos::Left, true)?;
    write(area, &shoulder.verdict(), (SIZE.0 as f64 - 28.0, 30.0), 21.0, color, HPos::Right, true)?;
    let found = format!(
        "{received_count} of {planned_count} taps ({source}), {region_count} regions of damage; index {:.2} at {:.0}°, \
         rejected from {limit_reject:.2}",
        peak.damage_index,
        angle_deg(&peak)
    );
    write(area, &found, (28.0, 55.0), 13.0, PALE_INK, HPos::Left, false)
}

/// The damage map of a shoulder: how far a bar reaches is the index, where it stands is the place on the tyre.
fn ring(area: &Area<'_>, reader: &Reader, shoulder: &Shoulder<'_>, center: Point, greatest: f64) -> Result<()> {
    let [zero, top, found, truth, writing] = RADII;
    let radius = |index: f64| zero + (top - zero) * index / greatest;
    let half_deg = 180.0 / shoulder.cells.len() as f64;
    let arc = |radius: f64, from_deg: f64, to_deg: f64, color: RGBColor, width: f64| -> Result<()> {
        Ok(area.draw(&PathElement::new(sweep(center, radius, from_deg, to_deg), line(color, width)))?)
    };
    for index in [0.0, greatest / 3.0, greatest * 2.0 / 3.0, greatest] {
        arc(radius(index), 0.0, 360.0, GRID, 1.0)?;
    }
    let Judgement { limit_re_inspect, limit_reject, .. } = shoulder.judgement;
    for cell in shoulder.cells.iter().filter(|cell| cell.damage_index.is_finite()) {
        let color = match cell.damage_index {
            index if index >= limit_reject => VERMILLION,
            index if index >= limit_re_inspect => ORANGE,
            _ => SKY,
        };
        let (from, to) = (angle_deg(cell) - 0.84 * half_deg, angle_deg(cell) + 0.84 * half_deg);
        let mut outline = sweep(center, zero, from, to);
        outline.extend(sweep(center, radius(cell.damage_index), from, to).into_iter().rev());
        area.draw(&Polygon::new(outline, color.filled()))?;
    }
    for (k, _) in (0..120).step_by(2).enumerate() {
        arc(radius(limit_reject), 6.0 * k as f64, 6.0 * k as f64 + 3.0, INK, 0.75)?;
    }
    for cell in &shoulder.cells {
        let (from, to) = (angle_deg(cell) - half_deg, angle_deg(cell) + half_deg);
        if cell.region != 0 {
            arc(found, from, to, VERMILLION, 4.0)?;
        }
        if is_cracked(reader, shoulder.scan, cell.location) == Some(true) {
            arc(truth, from, to, INK, 2.0)?;
        }
    }
    for deg in [0.0, 90.0, 180.0, 270.0] {
        let align = [HPos::Center, HPos::Left, HPos::Center, HPos::Right][(deg / 90.0) as usize];
        let at = polar(center, writing - if align == HPos::Center { 0.0 } else { 7.0 }, deg);
        write(area, &format!("{deg:.0}°"), at, 12.0, PALE_INK, align, false)?;
    }
    let line_at = |dy: f64| (center.0, center.1 + dy);
    let is_reject = shoulder.judgement.verdict == Verdict::Reject.code();
    let color = if is_reject { VERMILLION } else { BLUE };
    write(area, shoulder.scan.tyre.as_str(), line_at(-24.0), 12.0, INK, HPos::Center, false)?;
    write(area, &format!("shoulder {}", shoulder.scan.shoulder), line_at(-9.0), 12.0, INK, HPos::Center, false)?;
    write(area, &shoulder.verdict(), line_at(9.0), 15.0, color, HPos::Center, true)?;
    write(area, &format!("max. {:.2}", shoulder.peak.damage_index), line_at(27.0), 12.0, INK, HPos::Center, false)
}

fn ring_legend(area: &Area<'_>, y: f64) -> Result<()> {
    let items = [("sound", SKY), ("suspect", ORANGE), ("damage", VERMILLION)];
    for (k, (word, color)) in items.into_iter().enumerate() {
        let x = 30.0 + [0.0, 62.0, 135.0][k];
        area.draw(&Rectangle::new([at((x, y - 5.0)), at((x + 10.0, y + 5.0))], color.filled()))?;
        write(area, word, (x + 15.0, y), 12.0, INK, HPos::Left, false)?;
    }
    for (x, word, color, width) in [(242.0, "region", VERMILLION, 4.0), (316.0, "true crack", INK, 2.0)] {
        area.draw(&PathElement::new(vec![at((x, y)), at((x + 16.0, y))], line(color, width)))?;
        write(area, word, (x + 21.0, y), 12.0, INK, HPos::Left, false)?;
    }
    Ok(())
}

/// Force, sound and spectrum of the two taps.
fn panels(area: &Area<'_>, reader: &Reader, taps: &[Tap; 2]) -> Result<()> {
    for (x, tap) in [(470.0, &taps[0]), (715.0, &taps[1])] {
        area.draw(&PathElement::new(vec![at((x, 86.0)), at((x + 22.0, 86.0))], line(tap.color, 2.5)))?;
        write(area, &tap.name, (x + 28.0, 86.0), 13.0, tap.color, HPos::Left, true)?;
    }
    let in_time = |signal: &dyn Fn(&Tap) -> &[f64], span_ms: (f64, f64)| {
        taps.each_ref().map(|tap| -> Vec<Point> {
            let ms = |k: usize| (k as f64 - tap.pre_trigger_samples) / tap.sample_rate_hz * 1e3;
            let points = signal(tap).iter().enumerate().map(|(k, &y)| (ms(k), y));
            points.filter(|(t, _)| (span_ms.0..=span_ms.1).contains(t)).collect()
        })
    };
    let config: toml::Table = reader.config().parse()?;
    let bands: ProcessConfig =
        config.get("process").map_or_else(|| Ok(ProcessConfig::default()), |table| table.clone().try_into())?;
    let spectra = [spectrum_db(&taps[0])?, spectrum_db(&taps[1])?];
    let force = in_time(&|tap| &tap.force_n, (-0.5, 3.0));
    let sound = in_time(&|tap| &tap.sound_v, (-1.0, 15.0));
    panel(area, (100.0, 200.0), taps, &force, ["Time in ms", "Force in N"], None)?;
    panel(area, (305.0, 200.0), taps, &sound, ["Time in ms", "Sound in V"], None)?;
    let band = Some((bands.f_c_hz, bands.f_hi_hz));
    panel(area, (510.0, 210.0), taps, &spectra, ["Frequency in Hz", "Sound in dB re 1 V²/Hz"], band)
}

fn panel(
    area: &Area<'_>,
    (top, height): Point,
    taps: &[Tap; 2],
    curves: &[Vec<Point>; 2],
    [x_label, y_label]: [&str; 2],
    band: Option<Point>,
) -> Result<()> {
    let (xs, ys) = (span(curves, |p| p.0), span(curves, |p| p.1));
    let margin = 0.06 * (ys.1 - ys.0);
    let ys = (ys.0 - margin, ys.1 + margin);
    let (from, to) = (at((410.0, top)), at((f64::from(SIZE.0) - 24.0, top + height)));
    let place = area.clone().shrink(from, (to.0 - from.0, to.1 - from.1));
    let mut chart = ChartBuilder::on(&place)
        .set_label_area_size(LabelAreaPosition::Left, units(58.0))
        .set_label_area_size(LabelAreaPosition::Bottom, units(38.0))
        .margin_top(units(6.0))
        .build_cartesian_2d(xs.0..xs.1, ys.0..ys.1)?;
    if let Some((low, high)) = band {
        chart.draw_series([Rectangle::new([(low, ys.0), (high, ys.1)], SKY.mix(0.14).filled())])?;
    }
    chart
        .configure_mesh()
        .x_desc(x_label)
        .y_desc(y_label)
        .x_labels(8)
        .y_labels(6)
        .x_label_formatter(&|x| format!("{}", (x * 1e3).round() / 1e3 + 0.0))
        .y_label_formatter(&|y| format!("{}", (y * 1e6).round() / 1e6 + 0.0))
        .light_line_style(TRANSPARENT)
        .bold_line_style(line(GRID, 1.0))
        .axis_style(line(PALE_INK, 1.0))
        .label_style(font(12.0, PALE_INK, HPos::Center, false))
        .axis_desc_style(font(13.0, INK, HPos::Center, false))
        .draw()?;
    for (tap, curve) in taps.iter().zip(curves) {
        chart.draw_series([PathElement::new(curve.clone(), line(tap.color, 1.5))])?;
    }
    Ok(())
}

/// Least and greatest of one coordinate of all points.
fn span(curves: &[Vec<Point>; 2], of: impl Fn(&Point) -> f64) -> Point {
    let all = curves.iter().flatten().map(of);
    all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
        (if x < low { x } else { low }, if x > high { x } else { high })
    })
}

fn angle_deg(cell: &DamageCell) -> f64 {
    cell.angle_deg
}

fn units(pixels: f64) -> i32 {
    (pixels * UNITS_PER_PIXEL).round() as i32
}

fn at((x, y): Point) -> (i32, i32) {
    (units(x), units(y))
}

/// The point at `radius` and `deg`, clockwise from the top.
fn polar(center: Point, radius: f64, deg: f64) -> Point {
    let (sin, cos) = deg.to_radians().sin_cos();
    (center.0 + radius * sin, center.1 - radius * cos)
}

fn sweep(center: Point, radius: f64, from_deg: f64, to_deg: f64) -> Vec<(i32, i32)> {
    let steps = ((to_deg - from_deg) / 1.5).ceil() as usize;
    (0..=steps).map(|k| at(polar(center, radius, from_deg + (to_deg - from_deg) * k as f64 / steps as f64))).collect()
}

fn line(color: RGBColor, width: f64) -> ShapeStyle {
    color.stroke_width(units(width).unsigned_abs())
}

fn font(size: f64, color: RGBColor, align: HPos, is_bold: bool) -> TextStyle<'static> {
    // The library writes sizes divided by 1.24 into the file.
    let style = if is_bold { FontStyle::Bold } else { FontStyle::Normal };
    let font = FontDesc::new(FontFamily::SansSerif, size * UNITS_PER_PIXEL * 1.24, style);
    font.color(&color).pos(Pos::new(align, VPos::Center))
}

fn write(
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
