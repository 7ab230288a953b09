//! Calibrations by listening: the station's sound card records something known.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::{Duration, Instant};

use anyhow::{Result, bail, ensure};
use tapline_acquire::{CaptureConfig, DeviceName, Monitor};
use tapline_host::messages::{counted, print_line};
use tapline_process::calibration::{of_blows, of_tone};
use tapline_process::{Extractor, PeakEstimator, ProcessConfig};
use tapline_wire::{Channel, Discriminator, Quality, Samples, Unit};

use crate::cli::calibrate::HeardArgs;
use crate::config::Config;
use crate::verbs::calibrate::Found;
use crate::verbs::monitor::device_of;

/// Largest standard error of the mean of blows that still gives a calibration, as a fraction of the scale: levels that differ from a
/// reference by 1 % change verdicts.
const ERROR_MAX: f64 = 0.005;

/// Fewest blows whose scatter says anything of the error.
const BLOWS_MIN: usize = 3;

/// Largest part of the sound that may not be the tone, and largest change of the tone's level.
const REST_MAX: f64 = 0.1;
const DRIFT_MAX: f64 = 0.02;

/// Peak from which a channel counts as clipped, and below which it has too few bits, as parts of full scale.
const CLIPPED: f64 = 0.98;
const PEAK_MIN: f64 = 0.01;

/// Flags with which a blow does not measure the force.
const SPOILT: Quality = Quality::DOUBLE_HIT
    .union(Quality::SPIKE)
    .union(Quality::DROPOUT)
    .union(Quality::UNDERSAMPLED)
    .union(Quality::LATE_TRIGGER)
    .union(Quality::LOW_SNR)
    .union(Quality::HUM);

/// A device that is listened to.
struct Listening {
    monitor: Monitor,
    woken: Receiver<()>,
    until: Instant,
    patience_s: f64,
    device: DeviceName,
    config: Config,
}

impl Listening {
    fn to(heard: &HeardArgs) -> Result<Self> {
        ensure!(
            (0.1..=86_400.0).contains(&heard.patience_s),
            "--patience-s is {}; it must be from 0.1 to 86400",
            heard.patience_s
        );
        let (config, _) = Config::read(&heard.config)?;
        let (number, device) = device_of(&config.station, heard.station)?;
        // Samples must be parts of full scale, despite any earlier calibration.
        let capture = CaptureConfig { calibration: Default::default(), ..config.capture.clone() };
        let (wake, woken) = sync_channel(1);
        let monitor =
            Monitor::listen(&device, &capture, number, Arc::new(move || wake.try_send(()).unwrap_or_default()))?;
        let until = Instant::now() + Duration::from_millis((1e3 * heard.patience_s) as u64);
        Ok(Self { monitor, woken, until, patience_s: heard.patience_s, device, config })
    }

    /// What was found of a channel, at the range that was listened at.
    fn found(&self, unit: Unit, full_scale: f64, method: String) -> Found {
        let is_module = matches!(self.device, DeviceName::Uldaq(_));
        let full_scale_v = is_module.then_some(self.config.capture.uldaq.range_v);
        Found { unit, full_scale, full_scale_v, method, sensitivity_mv_per_unit: None, gain: None }
    }

    /// What came from the device, for people who wonder why it was not enough.
    fn heard(&self) -> String {
        let capture = &self.config.capture;
        let [force, sound] = self.monitor.latest((capture.buffer_s * f64::from(capture.sample_rate_hz)) as usize);
        let extremes = |samples: &[f32]| {
            let [least, greatest] = [false, true].map(|is_greatest| {
                let extreme = samples.iter().copied().reduce(|a, b| if (b > a) == is_greatest { b } else { a });
                100.0 * extreme.unwrap_or(0.0)
            });
            format!("from {least:.1} to {greatest:.1} %")
        };
        let not_taps = self.monitor.not_taps();
        format!(
            "{} was heard, the force {} and the sound {} of full scale; the trigger level is {:.1} % above the rest, and {} pulses were too \
             short and {} too long for a tap",
            self.device,
            extremes(&force),
            extremes(&sound),
            100.0 * capture.trigger.level,
            not_taps.clicks,
            not_taps.steps
        )
    }

    /// Waits a moment; an error if patience is at an end.
    fn wait(&self, for_what: &str) -> Result<()> {
        if Instant::now() >= self.until {
            let fault = self.monitor.fault().unwrap_or_else(|| self.heard());
            bail!("{for_what} within {} s: {fault}", self.patience_s);
        }
        // Whether it was woken or waited long enough, it looks again.
        let _woken = self.woken.recv_timeout(Duration::from_millis(100));
        Ok(())
    }
}

/// The scale of the force by blows whose peaks another sensor reported.
pub(super) fn blows(known_n: &[f64], count: usize, heard: &HeardArgs) -> Result<Found> {
    let bad = known_n.iter().find(|n| !(**n > 0.0 && **n <= 1e6));
    ensure!(bad.is_none(), "--known-n is {}; it must be above 0 and at most 1000000", bad.copied().unwrap_or_default());
    let known_n = if let [one] = known_n { vec![*one; count] } else { known_n.to_vec() };
    ensure!(
        (BLOWS_MIN..=1000).contains(&known_n.len()),
        "{} asked for; there must be from {BLOWS_MIN} to 1000",
        counted(known_n.len(), "blow is", "blows are")
    );
    let mut listening = Listening::to(heard)?;
    // Of the estimators of a peak it has the least bias by noise, which the mean of many blows would keep.
    let process = ProcessConfig { f_max: PeakEstimator::Polynomial, ..listening.config.process };
    let mut extractor = Extractor::<f64>::new(&process)?;
    let mut peaks = Vec::new();
    print_line(&format!("strike the sensor: {} blows are wanted", known_n.len()));
    while peaks.len() < known_n.len() {
        let Some(tap) = listening.monitor.take() else {
            listening.wait(&format!("{} of {} blows were counted", peaks.len(), known_n.len()))?;
            continue;
        };
        let Some(samples) = Samples::view(&tap.header, &tap.samples) else { continue };
        // A sensor that is struck is hardly heard: noise and hum of the microphone say nothing of the blow.
        let mut header = tap.header;
        let sound = header.channels.iter_mut().filter(|channel| channel.code == Channel::Sound.code());
        sound.for_each(|channel| channel.code = 0);
        let found = extractor.extract(&header, samples);
        let spoilt = found.quality & SPOILT;
        match found.values.get(Discriminator::FMax) {
            Some(peak) if spoilt.is_empty() && (PEAK_MIN..CLIPPED).contains(&peak) => {
                peaks.push(peak);
                let next = match known_n.len() - peaks.len() {
                    0 => String::new(),
                    left => format!("; strike again, {left} left"),
                };
                print_line(&format!("blow {}: {:.2} % of full scale{next}", peaks.len(), 100.0 * peak));
            }
            Some(peak) => print_line(&format!(
                "not counted, strike again: {:.2} % of full scale, flags {spoilt}; it must have none, and be from {:.0} to {:.0} %",
                100.0 * peak,
                100.0 * PEAK_MIN,
                100.0 * CLIPPED
            )),
            None if found.quality.contains(Quality::CLIPPED) => {
                print_line("not counted, strike again: the force is clipped; lower the gain, or strike more softly");
            }
            None => print_line(&format!("not counted, strike again: the force has no peak, flags {}", found.quality)),
        }
    }
    let Some(found) = of_blows(&peaks, &known_n) else { bail!("the blows give no scale") };
    let error = found.spread / (peaks.len() as f64).sqrt();
    ensure!(
        error <= ERROR_MAX,
        "the scale differs from blow to blow by {:.2} % (standard deviation), so that the mean of {} blows is known to {:.2} % (standard \
         error); at most {:.1} % is allowed: make more blows, or more even ones",
        100.0 * found.spread,
        peaks.len(),
        100.0 * error,
        100.0 * ERROR_MAX
    );
    let method = format!(
        "by {} blows, standard deviation {:.2} %, standard error {:.2} %",
        peaks.len(),
        100.0 * found.spread,
        100.0 * error
    );
    Ok(listening.found(Unit::Newton, found.full_scale_n, method))
}

/// The scale of the sound by a tone of `known_pa`.
pub(super) fn tone(known_pa: f64, frequency_hz: f64, listen_s: f64, heard: &HeardArgs) -> Result<Found> {
    let listening = Listening::to(heard)?;
    let rate_hz = f64::from(listening.config.capture.sample_rate_hz);
    let samples = {
        let capture = &listening.config.capture;
        ensure!(
            known_pa > 0.0 && known_pa <= 200.0,
            "--known-pa is {known_pa}; it must be above 0 and at most 200, which is 140 dB: 94 dB is 1.0024 Pa"
        );
        let most = 0.45 * rate_hz;
        ensure!(
            (20.0..=most).contains(&frequency_hz),
            "--frequency-hz is {frequency_hz}; it must be from 20 to {most}, as the rate is {rate_hz} Hz"
        );
        let (least, most) = (100.0 / frequency_hz, 0.9 * capture.buffer_s);
        ensure!(
            (least..=most).contains(&listen_s),
            "--listen-s is {listen_s}; it must be from {least} (100 periods) to {most} (capture.buffer_s is {})",
            capture.buffer_s
        );
        let count = (listen_s * rate_hz) as usize;
        loop {
            let [_, sound] = listening.monitor.latest(count);
            if sound.len() >= count {
                break sound;
            }
            listening.wait(&format!("{} of {count} samples were heard", sound.len()))?;
        }
    };
    let peak = samples.iter().map(|x| f64::from(x.abs())).max_by(f64::total_cmp).unwrap_or(0.0);
    ensure!(
        (PEAK_MIN..CLIPPED).contains(&peak),
        "the sound reaches {:.2} % of full scale; it must be from {:.0} to {:.0} %: change the gain",
        100.0 * peak,
        100.0 * PEAK_MIN,
        100.0 * CLIPPED
    );
    let Some(tone) = of_tone(&samples, rate_hz, frequency_hz) else { bail!("there is no tone near {frequency_hz} Hz") };
    ensure!(
        tone.rest <= REST_MAX,
        "{:.0} % of the sound is not the tone at {:.1} Hz; at most {:.0} % is allowed: is the calibrator on and tight?",
        100.0 * tone.rest,
        tone.frequency_hz,
        100.0 * REST_MAX
    );
    ensure!(
        tone.drift <= DRIFT_MAX,
        "the level of the tone changes by {:.1} %; at most {:.0} % is allowed",
        100.0 * tone.drift,
        100.0 * DRIFT_MAX
    );
    let method = format!(
        "by a tone of {known_pa} Pa at {:.1} Hz, rest {:.2} %, drift {:.2} %",
        tone.frequency_hz,
        100.0 * tone.rest,
        100.0 * tone.drift
    );
    Ok(listening.found(Unit::Pascal, known_pa / tone.rms, method))
}
