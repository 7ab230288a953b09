//! A sound card, through ALSA.

use std::time::{Duration, Instant};

use alsa::pcm::{Access, Format, HwParams, PCM};
use alsa::{Direction, ValueOr};

use super::{Chunk, Device};
use crate::capture::CaptureConfig;

/// Approximate time of one read: a power of two of samples is chosen, which every card supports.
const PERIOD_S: f64 = 0.01;

/// Periods that the card buffers while nobody reads.
const PERIODS: alsa::pcm::Frames = 64;

/// How long a read waits for samples before it returns without any.
const WAIT_MS: u32 = 200;

/// The card counts as stopped when it has given nothing for this long.
const SILENT_MAX: Duration = Duration::from_secs(5);

/// Counts of a full-scale 32-bit sample.
const FULL_SCALE: f32 = (1_u32 << 31) as f32;

/// Layout of a sample in the card's buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Layout {
    I16,
    /// 24 bits in three bytes.
    Packed24,
    /// 24 bits at the lower end of four bytes.
    Low24,
    I32,
}

impl Layout {
    fn format(self) -> Format {
        match self {
            Self::I16 => Format::S16LE,
            Self::Packed24 => Format::S243LE,
            Self::Low24 => Format::S24LE,
            Self::I32 => Format::S32LE,
        }
    }

    /// The layouts for samples of `bits` bits, the best first.
    fn of_bits(bits: u16) -> &'static [Self] {
        match bits {
            16 => &[Self::I16],
            24 => &[Self::Packed24, Self::Low24, Self::I32],
            _ => &[Self::I32],
        }
    }
}

/// An open sound card.
pub(super) struct SoundCard {
    pcm: PCM,
    layout: Layout,
    channels: usize,
    period_frames: usize,
    buffer_frames: usize,
    rate_hz: f64,
    /// When frames came last.
    heard: Instant,
    /// What was read last, parts of full scale.
    scaled: Vec<f32>,
}

impl SoundCard {
    pub(super) fn open(name: &str, config: &CaptureConfig) -> Result<Self, String> {
        let fault = |what: &str, error: alsa::Error| format!("{what}: {error}");
        // A terminating zero ends a name in C.
        if name.contains('\0') {
            return Err(format!("{name:?} is not a device name"));
        }
        let _messages = quietly();
        let pcm = PCM::new(name, Direction::Capture, false)
            .map_err(|e| fault("it cannot be opened", e) + "; `tapline devices` lists those that can be listened to")?;
        let (layout, period_frames, buffer_frames) = Self::set(&pcm, config)?;
        pcm.prepare().and_then(|()| pcm.start()).map_err(|e| fault("it cannot be started", e))?;
        Ok(Self {
            pcm,
            layout,
            channels: config.channels.into(),
            period_frames,
            buffer_frames,
            rate_hz: config.sample_rate_hz.into(),
            heard: Instant::now(),
            scaled: Vec::new(),
        })
    }

    /// How a sample lies in its buffer, and the frames of a period and of the buffer.
    fn set(pcm: &PCM, config: &CaptureConfig) -> Result<(Layout, usize, usize), String> {
        let fault = |what: String| move |error: alsa::Error| format!("{what}: {error}");
        let params = HwParams::any(pcm).map_err(fault("it has no parameters".to_owned()))?;
        let access = Access::MMapInterleaved;
        params.set_access(access).map_err(fault("its buffer cannot be mapped, frame by frame".to_owned()))?;
        // Resampling would filter the sound.
        params.set_rate_resample(false).map_err(fault("its resampling cannot be switched off".to_owned()))?;
        let layout = Layout::of_bits(config.bits).iter().find(|layout| params.test_format(layout.format()).is_ok());
        let Some(&layout) = layout else { return Err(format!("it offers no samples of {} bits", config.bits)) };
        params.set_format(layout.format()).map_err(fault(format!("it gives no samples of {} bits", config.bits)))?;
        let channels = config.channels;
        let (least, most) = (params.get_channels_min().unwrap_or(0), params.get_channels_max().unwrap_or(0));
        params
            .set_channels(channels.into())
            .map_err(fault(format!("it has {least} to {most} channels, not {channels}")))?;
        let rate = config.sample_rate_hz;
        let (least, most) = (params.get_rate_min().unwrap_or(0), params.get_rate_max().unwrap_or(0));
        params
            .set_rate(rate, ValueOr::Nearest)
            .map_err(fault(format!("it samples at {least} to {most} Hz, not at {rate}")))?;
        let period = ((PERIOD_S * f64::from(rate)) as u32).next_power_of_two();
        let period = params.set_period_size_near(period.into(), ValueOr::Nearest);
        let period = period.map_err(fault("it has no periods".to_owned()))?;
        let buffer = params.set_buffer_size_near(PERIODS * period);
        let buffer = buffer.map_err(fault("it has no buffer".to_owned()))?;
        pcm.hw_params(&params).map_err(fault("it refuses these parameters".to_owned()))?;
        let count = |frames: alsa::pcm::Frames| usize::try_from(frames).unwrap_or(1).max(1);
        Ok((layout, count(period), count(buffer)))
    }

    /// Starts again after samples were lost; returns how many, by the clock.
    fn recover(&mut self, error: alsa::Error) -> Result<u64, String> {
        self.pcm.try_recover(error, true).and_then(|()| self.pcm.start()).map_err(|e| e.to_string())?;
        let lost = self.heard.elapsed().as_secs_f64() * self.rate_hz;
        self.heard = Instant::now();
        Ok((lost as u64).max(1))
    }

    /// Passes on a period of the `left` frames that the card's buffer is known to hold; how many they were.
    fn pass(&mut self, left: usize, take: &mut dyn FnMut(Chunk<'_>, u64)) -> Result<usize, alsa::Error> {
        let (channels, scaled) = (self.channels, &mut self.scaled);
        scaled.clear();
        let mut as_f32 = |samples: &mut dyn Iterator<Item = f32>, count: usize| {
            scaled.extend(samples);
            take(Chunk::F32(scaled), left.saturating_sub(count / channels) as u64);
            count / channels
        };
        match self.layout {
            Layout::I16 => self.pcm.io_i16()?.mmap(self.period_frames, |samples| {
                as_f32(&mut samples.iter().map(|&sample| f32::from(sample) / 32_768.0), samples.len())
            }),
            Layout::Packed24 => self
                .pcm
                .io_bytes()
                .mmap(self.period_frames, |bytes| as_f32(&mut bytes.chunks_exact(3).map(of_packed24), bytes.len() / 3)),
            Layout::Low24 => self.pcm.io_i32_s24()?.mmap(self.period_frames, |samples| {
                as_f32(&mut samples.iter().map(|&sample| of_low24(sample)), samples.len())
            }),
            Layout::I32 => self.pcm.io_i32()?.mmap(self.period_frames, |samples| {
                as_f32(&mut samples.iter().map(|&sample| sample as f32 / FULL_SCALE), samples.len())
            }),
        }
    }
}

impl Device for SoundCard {
    fn read(&mut self, take: &mut dyn FnMut(Chunk<'_>, u64)) -> Result<(), String> {
        let available = match self.pcm.wait(Some(WAIT_MS)).and_then(|_| self.pcm.avail_update()) {
            Ok(frames) => usize::try_from(frames).unwrap_or(0),
            Err(error) => {
                let lost = self.recover(error)?;
                take(Chunk::Lost(lost), 0);
                return Ok(());
            }
        };
        let mut left = available;
        // A card whose buffer is full has lost samples and says so; what is always full, such as a pipe, does not count them.
        let is_counted = available < self.buffer_frames;
        while left >= self.period_frames {
            match self.pass(if is_counted { left } else { 0 }, take) {
                Ok(0) => break,
                Ok(passed) => left = left.saturating_sub(passed),
                Err(error) => {
                    let lost = self.recover(error)?;
                    take(Chunk::Lost(lost), 0);
                    return Ok(());
                }
            }
            self.heard = Instant::now();
        }
        if self.heard.elapsed() > SILENT_MAX {
            return Err(format!("it has given no samples for {} s", SILENT_MAX.as_secs()));
        }
        Ok(())
    }
}

/// The three bytes of a sample, lowest first, as a fraction of full scale.
fn of_packed24(bytes: &[u8]) -> f32 {
    i32::from_le_bytes([0, bytes[0], bytes[1], bytes[2]]) as f32 / FULL_SCALE
}

/// The lower three bytes of `sample` as a fraction of full scale: the upper byte is undefined.
fn of_low24(sample: i32) -> f32 {
    (sample << 8) as f32 / FULL_SCALE
}

/// Suppresses what ALSA would print in this thread: the errors that it returns say the same.
fn quietly() -> Option<std::rc::Rc<std::cell::RefCell<alsa::Output>>> {
    alsa::Output::local_error_handler().ok()
}

/// A device that ALSA knows, and what it can record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SoundCardInfo {
    /// As `device` of a station names it.
    pub name: String,
    /// What ALSA says of it.
    pub description: String,
    /// What it can record, or why it cannot be queried.
    pub abilities: Result<Abilities, String>,
}

/// What a device can record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Abilities {
    /// Fewest and most channels.
    pub channels: (u32, u32),
    /// Lowest and highest rate.
    pub rates_hz: (u32, u32),
    /// Bits of its samples: of 16, 24 and 32.
    pub bits: Vec<u16>,
}

/// The devices that can record: those that ALSA lists, or those of these `names`.
///
/// # Errors
/// Why ALSA cannot list them.
pub fn sound_cards(names: &[String]) -> Result<Vec<SoundCardInfo>, String> {
    let info = |name: String, description: String| {
        let abilities = abilities(&name);
        SoundCardInfo { name, description, abilities }
    };
    if !names.is_empty() {
        return Ok(names.iter().map(|name| info(name.clone(), String::new())).collect());
    }
    let hints = alsa::device_name::HintIter::new_str(None, "pcm").map_err(|error| error.to_string())?;
    // A device without a direction supports both.
    let hints = hints.filter(|hint| hint.direction != Some(Direction::Playback));
    let cards = hints.filter_map(|hint| Some(info(hint.name?, hint.desc.unwrap_or_default().replace('\n', ", "))));
    // ALSA lists plugins too, whether or not there is a card for them; a card that another program uses is one.
    Ok(cards.filter(|card| card.name != "null" && (card.abilities.is_ok() || card.name.contains("hw:"))).collect())
}

fn abilities(name: &str) -> Result<Abilities, String> {
    if name.contains('\0') {
        return Err("it is not a device name".to_owned());
    }
    let _messages = quietly();
    // Do not wait if another program has it open.
    let pcm = PCM::new(name, Direction::Capture, true).map_err(|error| error.to_string())?;
    let params = HwParams::any(&pcm).map_err(|error| error.to_string())?;
    let has = |bits: &u16| Layout::of_bits(*bits).iter().any(|layout| params.test_format(layout.format()).is_ok());
    Ok(Abilities {
        channels: (params.get_channels_min().unwrap_or(0), params.get_channels_max().unwrap_or(0)),
        rates_hz: (params.get_rate_min().unwrap_or(0), params.get_rate_max().unwrap_or(0)),
        bits: [16, 24, 32].into_iter().filter(has).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches bytes in another order, a sign that is lost, and what stands beside a sample taken for a part of it.
    #[test]
    fn samples_of_24_bits_are_read_as_they_lie() {
        for count in [-8_388_608_i32, -8_388_607, -1, 0, 1, 0x12_34_56, 8_388_607] {
            let want = count as f32 / 8_388_608.0;
            assert_eq!(of_packed24(&count.to_le_bytes()[..3]).to_bits(), want.to_bits(), "{count}");
            for beside in [0, 0x5a, 0xff] {
                let [low, middle, high, _] = count.to_le_bytes();
                let lying = i32::from_le_bytes([low, middle, high, beside]);
                assert_eq!(of_low24(lying).to_bits(), want.to_bits(), "{count} beside {beside}");
            }
        }
    }
}
