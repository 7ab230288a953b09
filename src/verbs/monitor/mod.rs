//! `tapline monitor`: a scope in the terminal, to set up a station.

mod scope;

use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::sync_channel;
use std::time::Duration;

use anyhow::{Context as _, Result, anyhow, bail};
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind};
use tapline_acquire::{CaptureConfig, DeviceName, Monitor, StationConfig};
use tapline_process::Extractor;
use tapline_wire::Samples;

use crate::config::Config;
use crate::verbs::monitor::scope::{Scope, Shown};

/// How often the scope is drawn.
const FRAME: Duration = Duration::from_millis(100);

/// What a key changes the trigger level by.
const LEVEL_STEP: f64 = 1.25;

/// Shows what the sound card of station `number` of the configuration gives: of its only such station when left out.
pub(crate) fn monitor(config: &Path, number: Option<u16>) -> Result<bool> {
    let (config, _) = Config::read(config)?;
    let (number, device) = device_of(&config.station, number)?;
    let mut extractor = Extractor::<f64>::new(&config.process)?;
    let mut terminal = ratatui::try_init().context("cannot draw: this is not a terminal")?;
    let outcome = follow(&mut terminal, (number, &device), config.capture, &mut extractor);
    ratatui::try_restore().context("cannot leave the terminal as it was")?;
    outcome.map(|()| true)
}

/// Number and device of station `number` of `stations`, or of the only one that has a device.
pub(crate) fn device_of(stations: &[StationConfig], number: Option<u16>) -> Result<(u16, DeviceName)> {
    let mut listening =
        stations.iter().filter(|station| station.device.is_some() && number.is_none_or(|n| n == station.number));
    match (listening.next(), listening.next(), number) {
        (Some(station), None, _) => {
            let device = station.device_name().ok_or_else(|| anyhow!("the station has no device"))?;
            Ok((station.number, device))
        }
        (None, _, Some(number)) => bail!("station {number} of the configuration has no device"),
        (None, _, None) => bail!("no station of the configuration has a device"),
        (Some(_), Some(_), _) => bail!("several stations of the configuration have a device: name one with --station"),
    }
}

/// Listens, and draws until it is asked to end.
fn follow(
    terminal: &mut DefaultTerminal,
    (number, device): (u16, &DeviceName),
    mut capture: CaptureConfig,
    extractor: &mut Extractor<f64>,
) -> Result<()> {
    let (wake, woken) = sync_channel(1);
    let wake = Arc::new(move || wake.try_send(()).unwrap_or_default());
    let mut monitor = Monitor::listen(device, &capture, number, wake)?;
    let mut scope = Scope::new(&device.to_string());
    loop {
        while let Some(tap) = monitor.take() {
            if let Some(samples) = Samples::view(&tap.header, &tap.samples) {
                let found = extractor.extract(&tap.header, samples);
                scope.heard(Shown::of(&tap.header, samples, &found, &capture));
            }
        }
        scope.look(&monitor, &capture);
        terminal.draw(|frame| scope.draw(frame, &capture)).context("cannot draw")?;
        let since = std::time::Instant::now();
        // A tap is shown at once; keys are looked for between the drawings.
        while since.elapsed() < FRAME && woken.try_recv().is_err() {
            if !event::poll(FRAME / 10).context("cannot read keys")? {
                continue;
            }
            let Event::Key(key) = event::read().context("cannot read keys")? else { continue };
            if key.kind != KeyEventKind::Press {
                continue;
            }
            let mut level = capture.trigger.level;
            match key.code {
                KeyCode::Char('q') | KeyCode::Esc => return Ok(()),
                KeyCode::Char('c') if key.modifiers.contains(event::KeyModifiers::CONTROL) => return Ok(()),
                KeyCode::Up | KeyCode::Char('+') => level *= LEVEL_STEP,
                KeyCode::Down | KeyCode::Char('-') => level /= LEVEL_STEP,
                KeyCode::Char('r') => scope = Scope::new(&device.to_string()),
                _ => continue,
            }
            // A level that is out of bounds is ignored.
            if monitor.set_level(level).is_ok() {
                capture.trigger.level = level;
            }
        }
    }
}
