//! What the scope shows: levels, the last force pulse and its sound, and what was found in them.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize as _};
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::{Axis, Block, Chart, Dataset, Gauge, GraphType, Paragraph, Wrap};
use tapline_acquire::{CaptureConfig, Monitor, NotTaps};
use tapline_host::messages::counted;
use tapline_wire::{Channel, Discriminator, Discriminators, Samples, TapHeader, Unit};

/// Time before and after the trigger that is drawn of the force, and of the sound.
const FORCE_MS: (f64, f64) = (-1.0, 5.0);
const SOUND_MS: (f64, f64) = (-5.0, 60.0);

/// How long the peaks of the levels are looked at.
const LEVEL_S: f64 = 0.2;

/// Most lines for the state of the device, however long its text.
const HEAD_LINES_MAX: u16 = 6;

/// A channel above this part of full scale is as good as clipped.
const NEARLY_FULL: f64 = 0.98;

/// A tap as it is shown.
#[derive(Debug, Clone)]
pub(crate) struct Shown {
    /// Time from the trigger in ms, and force or sound as parts of full scale.
    force: Vec<(f64, f64)>,
    sound: Vec<(f64, f64)>,
    force_peak: f64,
    sound_peak: f64,
    /// Peak of the sound by its noise before the trigger.
    snr: f64,
    f_max: Option<(f64, Unit)>,
    tau_s: Option<f64>,
    flags: String,
}

impl Shown {
    /// The tap of `header` with its `samples`, of which `found` was found.
    pub(crate) fn of(
        header: &TapHeader,
        samples: Samples<'_>,
        found: &Discriminators,
        capture: &CaptureConfig,
    ) -> Self {
        let full_scale = if capture.bits == 16 { 32_768.0 } else { 1.0 };
        let all: Vec<f64> = match samples {
            Samples::I16(samples) => samples.iter().map(|&x| f64::from(x) / full_scale).collect(),
            Samples::F32(samples) => samples.iter().map(|&x| f64::from(x) / full_scale).collect(),
        };
        let unit = capture.calibration.force.as_ref().map(|scale| scale.unit).unwrap_or_default();
        let (force, sound) = all.split_at(all.len() / 2);
        let before = (header.pre_trigger_samples as usize).min(force.len());
        let ms = |sample: usize| (sample as f64 - before as f64) / header.sample_rate_hz * 1e3;
        let within = |values: &[f64], (from, to): (f64, f64)| {
            let all = values.iter().enumerate().map(|(sample, &value)| (ms(sample), value));
            all.filter(|(time, _)| (from..=to).contains(time)).collect()
        };
        let peak = |values: &[f64]| greatest(values.iter().copied());
        let quiet = &sound[..before / 2];
        let noise = (quiet.iter().map(|x| x * x).sum::<f64>() / quiet.len().max(1) as f64).sqrt();
        Self {
            force: within(force, FORCE_MS),
            sound: within(sound, SOUND_MS),
            force_peak: peak(force),
            sound_peak: peak(sound),
            snr: peak(sound) / noise,
            f_max: found.values.get(Discriminator::FMax).map(|f_max| (f_max, unit)),
            tau_s: found.values.get(Discriminator::Tau),
            flags: found.quality.to_string(),
        }
    }
}

/// What is shown.
#[derive(Debug)]
pub(crate) struct Scope {
    device: String,
    levels: [f64; 2],
    fault: Option<String>,
    not_taps: NotTaps,
    /// Pulses that were no taps before the count began.
    not_taps_before: Option<NotTaps>,
    count: u64,
    last: Option<Shown>,
}

impl Scope {
    pub(crate) fn new(device: &str) -> Self {
        let (levels, not_taps) = ([0.0; 2], NotTaps::default());
        Self { device: device.to_owned(), levels, fault: None, not_taps, not_taps_before: None, count: 0, last: None }
    }

    /// Shows `tap` until the next one.
    pub(crate) fn heard(&mut self, tap: Shown) {
        self.count += 1;
        self.last = Some(tap);
    }

    /// Takes the levels of what is heard now.
    pub(crate) fn look(&mut self, monitor: &Monitor, capture: &CaptureConfig) {
        let latest = monitor.latest((LEVEL_S * f64::from(capture.sample_rate_hz)) as usize);
        self.levels = latest.map(|channel| greatest(channel.into_iter().map(f64::from)));
        let all = monitor.not_taps();
        let before = *self.not_taps_before.get_or_insert(all);
        // A device that is opened again begins at 0.
        let since = |all: u64, before: u64| all.checked_sub(before).unwrap_or(all);
        let (clicks, steps) = (since(all.clicks, before.clicks), since(all.steps, before.steps));
        (self.fault, self.not_taps) = (monitor.fault(), NotTaps { clicks, steps });
    }

    pub(crate) fn draw(&self, frame: &mut Frame<'_>, capture: &CaptureConfig) {
        let state = match &self.fault {
            Some(fault) => Line::from(fault.as_str()).fg(Color::Red),
            None => Line::from(format!(
                "{}: {}, {}, {} of the offset",
                self.device,
                counted(self.count as usize, "tap", "taps"),
                counted(self.not_taps.clicks as usize, "click", "clicks"),
                counted(self.not_taps.steps as usize, "step", "steps")
            )),
        };
        // Words that do not fit go to the next line, so that there may be one line more.
        let full = state.width() / usize::from(frame.area().width.max(1));
        let head_lines = if full == 0 { 1 } else { full + 2 };
        let rows = Layout::vertical([
            Constraint::Length(u16::try_from(head_lines).unwrap_or(u16::MAX).min(HEAD_LINES_MAX)),
            Constraint::Length(3),
            Constraint::Length(3),
            Constraint::Min(8),
            Constraint::Length(5),
        ]);
        let [head, force_level, sound_level, charts, numbers] = rows.areas(frame.area());
        frame.render_widget(Paragraph::new(state).wrap(Wrap { trim: true }), head);
        let trigger = format!("force (trigger at {:.2} % of full scale)", 100.0 * capture.trigger.level);
        self.level(frame, force_level, &trigger, self.levels[0]);
        self.level(frame, sound_level, "sound", self.levels[1]);
        let [force, sound] = Layout::horizontal([Constraint::Percentage(40), Constraint::Percentage(60)]).areas(charts);
        let (of_force, of_sound) = self.last.as_ref().map_or((&[][..], &[][..]), |tap| (&tap.force, &tap.sound));
        curve(frame, force, "force, % of full scale", of_force, FORCE_MS);
        curve(frame, sound, "sound, % of full scale", of_sound, SOUND_MS);
        let text = Paragraph::new(self.numbers()).wrap(Wrap { trim: true }).block(Block::bordered());
        frame.render_widget(text, numbers);
    }

    fn level(&self, frame: &mut Frame<'_>, area: Rect, name: &str, level: f64) {
        let is_clipped = level >= NEARLY_FULL;
        let label = if is_clipped { "CLIPPED: lower the gain".to_owned() } else { format!("{:.1} %", 100.0 * level) };
        let colour = if is_clipped { Color::Red } else { Color::Green };
        let gauge =
            Gauge::default().block(Block::bordered().title(name.to_owned())).gauge_style(Style::new().fg(colour));
        frame.render_widget(gauge.ratio(level.clamp(0.0, 1.0)).label(label), area);
    }

    /// What was found in the last tap, and the keys.
    fn numbers(&self) -> Vec<Line<'static>> {
        let keys = Line::from("up, down: trigger level   r: reset counts   q: quit").dim();
        let Some(tap) = &self.last else { return vec![Line::from("no tap heard yet"), keys] };
        let force = match tap.f_max {
            Some((value, unit)) if unit.is_known() => format!("{value:.2} {}", unit.name()),
            Some(_) => format!("{:.1} % of full scale", 100.0 * tap.force_peak),
            None => "absent".to_owned(),
        };
        let tau = tap.tau_s.map_or("absent".to_owned(), |tau_s| format!("{:.3} ms", 1e3 * tau_s));
        let flags = if tap.flags.is_empty() { "none".to_owned() } else { tap.flags.clone() };
        vec![
            Line::from(format!(
                "F_max {force}   tau {tau}   {} {:.1} % of full scale, {:.0} times its noise",
                Channel::Sound.name(),
                100.0 * tap.sound_peak,
                tap.snr
            )),
            Line::from(format!("flags: {flags}")),
            keys,
        ]
    }
}

/// The greatest magnitude of `values`, 0 of none.
fn greatest(values: impl Iterator<Item = f64>) -> f64 {
    values.map(f64::abs).max_by(f64::total_cmp).unwrap_or(0.0)
}

fn curve(frame: &mut Frame<'_>, area: Rect, title: &str, points: &[(f64, f64)], (from, to): (f64, f64)) {
    let points: Vec<(f64, f64)> = points.iter().map(|&(time, value)| (time, 100.0 * value)).collect();
    let most = greatest(points.iter().map(|point| point.1).chain([1e-3]));
    let least = if points.iter().any(|(_, value)| *value < -0.1 * most) { -most } else { -0.1 * most };
    let data = Dataset::default().marker(Marker::Braille).graph_type(GraphType::Line).data(&points);
    let label = |value: f64| Line::from(format!("{value:.1}"));
    let chart = Chart::new(vec![data.style(Style::new().fg(Color::Cyan))])
        .block(Block::bordered().title(title.to_owned()))
        .x_axis(Axis::default().title("ms").bounds([from, to]).labels([
            label(from),
            label(0.5 * (from + to)),
            label(to),
        ]))
        .y_axis(Axis::default().bounds([least, most]).labels([label(least), label(most)]));
    frame.render_widget(chart, area);
}

#[cfg(test)]
mod tests {
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    use super::*;

    #[test]
    fn a_long_fault_is_shown_to_its_end() {
        // Catches an error that is cut at the edge of the terminal, where what can be done about it stands.
        let fault = "the device hw:CARD=Scarlett,DEV=0 is not heard: it cannot be opened: ALSA function 'snd_pcm_open' failed with \
                     error 'No such file or directory (2)'; `tapline devices` lists those that can be listened to";
        let scope = Scope { fault: Some(fault.to_owned()), ..Scope::new("hw:0") };
        let mut terminal = Terminal::new(TestBackend::new(80, 24)).unwrap();
        terminal.draw(|frame| scope.draw(frame, &CaptureConfig::default())).unwrap();
        let shown: String = terminal.backend().buffer().content().iter().map(|cell| cell.symbol()).collect();
        let shown = shown.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(shown.contains(fault), "{shown}");
    }
}
