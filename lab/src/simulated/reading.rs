//! How a record is heard and read: one simulated tap can be read in many ways.

use anyhow::Result;
use tapline_model::SimulationConfig;
use tapline_process::{ProcessConfig, ProcessExtractor};
use tapline_wire::{Channel, Discriminators, Quality, Samples, TapHeader};

/// One way of reading.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Reading {
    /// The discriminators.
    pub process: ProcessConfig,
    /// Bits of the converter, 2 to 16, over the full scales of the simulated rig; `None` leaves the samples as they are.
    pub bits: Option<u32>,
}

/// Reads a tap in every way, until each way has a record that it can use.
pub(crate) struct Reader {
    ways: Vec<(Option<u32>, ProcessExtractor)>,
    found: Vec<Option<Discriminators>>,
    counts: Vec<i16>,
    units: Vec<f32>,
}

impl Reader {
    pub(crate) fn new(readings: &[Reading]) -> Result<Self> {
        let way = |reading: &Reading| Ok((reading.bits, ProcessExtractor::new(&reading.process)?));
        let ways: Vec<_> = readings.iter().map(way).collect::<Result<_>>()?;
        let found = vec![None; ways.len()];
        Ok(Self { ways, found, counts: Vec::new(), units: Vec::new() })
    }

    /// What each way finds; `None` while one of them wants the tap again. Another attempt only counts for those that
    /// want it.
    pub(crate) fn read(&mut self, header: &TapHeader, samples: Samples<'_>) -> Option<Vec<Discriminators>> {
        for ((bits, extractor), found) in self.ways.iter_mut().zip(&mut self.found) {
            if found.is_some() {
                continue;
            }
            let heard = match bits {
                None => samples,
                Some(bits) => quantised(*bits, header, samples, &mut self.counts, &mut self.units),
            };
            *found = Some(extractor.extract(header, heard)).filter(|found| !found.quality.contains(Quality::RETAKE));
        }
        let all = self.found.iter().copied().collect::<Option<Vec<_>>>()?;
        self.found.fill(None);
        Some(all)
    }
}

/// `samples` as a converter of so many bits gives them.
fn quantised<'a>(
    bits: u32,
    header: &TapHeader,
    samples: Samples<'_>,
    counts: &'a mut Vec<i16>,
    units: &'a mut Vec<f32>,
) -> Samples<'a> {
    match samples {
        Samples::I16(all) => {
            counts.clear();
            counts.extend_from_slice(all);
            quantise(bits, counts);
            Samples::I16(counts)
        }
        Samples::F32(all) => {
            units.clear();
            let count = header.sample_count as usize;
            for (channel, (kind, _)) in all.chunks(count).zip(header.channels()) {
                units.extend(channel.iter().map(|&x| rounded(x, full_scale(kind), bits)));
            }
            Samples::F32(units)
        }
    }
}

/// Rounds `counts` of 16 bits to those of a converter of `bits`.
pub(crate) fn quantise(bits: u32, counts: &mut [i16]) {
    // To the nearest step; the highest is one step short of full scale.
    let step = 1_i32 << (16 - bits);
    for x in counts {
        let rounded = (i32::from(*x) + step / 2).div_euclid(step) * step;
        *x = i16::try_from(rounded.min(32_768 - step)).unwrap_or(i16::MIN);
    }
}

fn full_scale(kind: Channel) -> f64 {
    let rig = SimulationConfig::default();
    if kind == Channel::Force { rig.force_full_scale_n } else { rig.sound_full_scale_v }
}

#[expect(clippy::cast_possible_truncation, reason = "samples are in single precision")]
fn rounded(x: f32, full_scale: f64, bits: u32) -> f32 {
    let step = full_scale / f64::from(1_u32 << (bits - 1));
    ((f64::from(x) / step).round() * step).clamp(-full_scale, full_scale - step) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a step of the wrong size, rounding to one side, and a full scale that overflows.
    #[test]
    fn samples_are_rounded_to_steps() {
        let header = TapHeader { sample_count: 4, channel_count: 1, ..TapHeader::default() };
        let (mut counts, mut units) = (Vec::new(), Vec::new());
        let all = [-32_768, -129, 127, 32_767_i16];
        let Samples::I16(heard) = quantised(8, &header, Samples::I16(&all), &mut counts, &mut units) else { panic!() };
        assert_eq!(heard, [-32_768, -256, 0, 32_512]);
        let units = [1.3, -9.0, 9.0].map(|x| rounded(x, 5.0, 3).to_bits());
        assert_eq!(units, [1.25_f32, -5.0, 3.75].map(f32::to_bits));
    }
}
