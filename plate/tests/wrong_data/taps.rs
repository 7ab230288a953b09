//! Faults of single taps: the flags of their discriminators.

use std::f64::consts::TAU;
use std::sync::LazyLock;

use tapline_acquire::{Source as _, TapSet};
use tapline_model::SimulationConfig;
use tapline_plate::{Casing, Crack, Population, Rig, Tap as PlateTap};
use tapline_process::{ProcessConfig, ProcessExtractor};
use tapline_testing::noise::Noise;
use tapline_wire::{CacheLine, Discriminator, Quality, SampleFormat, Samples, Serial, TapHeader, cache_lines_for};

use crate::tap::{Tap, peak, rig_with_tyres, tap_on};
use crate::{RATE_HZ, header};

/// Taps of each simulator.
const COUNT: u32 = 400;
const VELOCITIES: [f64; 3] = [1.2, 1.5, 1.85];

/// The sample at the peak of the pulse.
fn pulse_at(tap: &Tap) -> usize {
    (0..tap.force.len()).max_by(|&i, &j| tap.force[i].total_cmp(&tap.force[j])).unwrap()
}

static OF_MODEL: LazyLock<Vec<Tap>> = LazyLock::new(|| of_model(RATE_HZ, COUNT));
static OF_PLATE: LazyLock<Vec<Tap>> = LazyLock::new(|| of_plate(RATE_HZ));

/// Samples of 50 ms.
fn short(rate_hz: f64) -> u32 {
    (0.05 * rate_hz) as u32
}

/// Taps of the model's sound and cracked tyres, in 16-bit counts, 50 ms and 400 ms each.
fn of_model(rate_hz: f64, count: u32) -> Vec<Tap> {
    let (sample_count, pre_trigger_samples) = (short(rate_hz), (rate_hz / 80.0) as u32);
    let short =
        SimulationConfig { sample_rate_hz: rate_hz, sample_count, pre_trigger_samples, ..SimulationConfig::default() };
    let long = SimulationConfig { sample_count: 8 * short.sample_count, ..short.clone() };
    let mut rigs = [long, short].map(|config| rig_with_tyres(&config, 21));
    let tap = |k: u32| {
        let mut tap = tap_on(&mut rigs[k as usize / 32 % 2], k);
        tap.header.planned_sample_count = tap.header.sample_count;
        tap
    };
    (0..count).map(tap).collect()
}

/// Taps of the plate's sound and cracked casings of a rough population, as floats, 50 ms and 200 ms each.
fn of_plate(rate_hz: f64) -> Vec<Tap> {
    let population = Population { rogue: 0.0, ..Population::rough() };
    let (short, pre_trigger_samples) = (short(rate_hz), (rate_hz / 160.0) as u32);
    let mut rig = Rig::new(&population, rate_hz, pre_trigger_samples).unwrap();
    let tap = |k: u32| {
        let number = k % 16;
        let size = f64::from(number / 4);
        let crack =
            Crack { depth_mm: 4.0 + 2.0 * size, length_mm: 14.0 + 4.0 * size, arc_deg: 360.0, ..Crack::default() };
        let cracks = if number.is_multiple_of(2) { vec![crack] } else { vec![] };
        let casing = Casing::new(&population, 4, Serial::new(&format!("P-{number}")).unwrap(), cracks);
        let velocity_m_per_s = VELOCITIES[k as usize % 3];
        let tap = PlateTap {
            shoulder: 1,
            offset_mm: 5.0 * f64::from(k / 16 % 4),
            velocity_m_per_s,
            location: k * 37 % 100,
            location_count: 100,
            repetition: (k / 100) as u16,
            attempt: 0,
        };
        let sample_count = [short, 4 * short][k as usize / 5 % 2];
        let (mut force, mut sound) = (vec![0.0; sample_count as usize], vec![0.0; sample_count as usize]);
        let measured = rig.record(&casing, &tap, &mut force, &mut sound);
        Tap {
            header: TapHeader {
                microphone_distance_m: rig.microphone_distance_m(),
                sample_rate_hz: rate_hz,
                ..header(SampleFormat::F32, sample_count, pre_trigger_samples, (velocity_m_per_s, measured), [1.0; 2])
            },
            force: force.into_iter().map(f64::from).collect(),
            sound: sound.into_iter().map(f64::from).collect(),
        }
    };
    (0..COUNT).map(tap).collect()
}

/// Plants a fault in tap number k of either simulator, false where that tap cannot have it, and checks that one of the flags
/// of `flag` is raised.
#[track_caller]
fn assert_flagged(flag: Quality, what: &str, plant: impl Fn(usize, &mut Tap) -> bool) {
    for (name, taps) in [("model", &*OF_MODEL), ("plate", &*OF_PLATE)] {
        let planted = taps.iter().enumerate().filter_map(|(k, tap)| {
            let mut tap = tap.clone();
            plant(k, &mut tap).then(|| tap.flags())
        });
        let flags: Vec<Quality> = planted.collect();
        assert!(flags.len() >= 100, "{what}, {name}: only {} taps can have it", flags.len());
        let told = flags.iter().filter(|flags| flags.intersects(flag)).count() as f64 / flags.len() as f64;
        eprintln!("{what}, {name}: {flag} in {told:.4} of {} taps", flags.len());
        for (k, flags) in flags.iter().enumerate().filter(|(_, flags)| !flags.intersects(flag)) {
            eprintln!("{what}, {name}: tap {k}: {flags}");
        }
        assert!(told >= 0.99, "{what}, {name}: {flag} in {told} of taps");
    }
}

/// Catches a flag that cries wolf: at most 1 of 100 clean taps has one, over cracks too, of either simulator.
#[test]
fn clean_taps_are_clean() {
    assert_clean("model", &OF_MODEL);
    assert_clean("plate", &OF_PLATE);
}

/// Catches a flag that takes the coarse steps of a low sample rate for a fault, down to where `undersampled` is raised.
#[test]
fn clean_taps_are_clean_at_low_rates() {
    for rate_hz in [20_000.0, 16_000.0, 12_800.0] {
        assert_clean(&format!("model at {rate_hz} Hz"), &of_model(rate_hz, COUNT));
        assert_clean(&format!("plate at {rate_hz} Hz"), &of_plate(rate_hz));
    }
}

/// Catches a flag that takes the noise on a finely sampled flank for a second hit.
#[test]
fn clean_taps_are_clean_at_high_rates() {
    for rate_hz in [192_000.0, 500_000.0] {
        let mut random = Noise(7);
        let noisy = |mut tap: Tap| {
            let n_per_count = tap.header.channels[0].unit_per_count;
            tap.force.iter_mut().for_each(|count| *count += (0.2 / n_per_count * random.normal()).round());
            tap
        };
        let taps: Vec<Tap> = of_model(rate_hz, 100).into_iter().map(noisy).collect();
        assert_clean(&format!("model at {rate_hz} Hz, 0.2 N of noise"), &taps);
    }
}

#[track_caller]
fn assert_clean(name: &str, taps: &[Tap]) {
    let flagged: Vec<Quality> = taps.iter().map(Tap::flags).filter(|quality| !quality.is_empty()).collect();
    assert!(
        100 * flagged.len() <= taps.len(),
        "{name}: of {} clean taps {} have a flag: {flagged:?}",
        taps.len(),
        flagged.len()
    );
}

/// Catches a short record that is compared with whole ones: its powers are averages over another time.
#[test]
fn a_record_that_is_cut() {
    for part in [0.9, 0.5, 0.25, 0.0625] {
        assert_flagged(Quality::CUT, &format!("{part} of the record"), |_, tap| {
            let count = (part * tap.force.len() as f64) as usize;
            tap.force.truncate(count);
            tap.sound.truncate(count);
            tap.header.sample_count = count as u32;
            count > tap.header.pre_trigger_samples as usize
        });
    }
}

/// Catches a stretch of zeros, or of the last value, that counts as signal, in either channel and at any time.
#[test]
fn dropouts() {
    for (duration_s, holds) in [(1e-3, false), (3e-3, false), (20e-3, false), (1e-3, true), (10e-3, true)] {
        for of_force in [false, true] {
            let what = format!(
                "{duration_s} s of {} in the {}",
                ["zeros", "one value"][usize::from(holds)],
                ["sound", "force",][usize::from(of_force)]
            );
            // Holding the value of the peak looks like clipping; holding another one leaves no pulse.
            let flag = match (holds, of_force) {
                (true, true) => Quality::DROPOUT | Quality::CLIPPED | Quality::NO_PULSE,
                (true, false) => Quality::DROPOUT | Quality::CLIPPED,
                (false, _) => Quality::DROPOUT,
            };
            assert_flagged(flag, &what, |k, tap| {
                let channel = if of_force { &mut tap.force } else { &mut tap.sound };
                let last = channel.len().min((0.1 * RATE_HZ) as usize) as f64;
                let from = ((k as f64 * 0.618).fract() * last) as usize;
                let until = channel.len().min(from + (duration_s * RATE_HZ) as usize);
                let value = if holds { channel[from] } else { 0.0 };
                channel[from..until].fill(value);
                until - from >= 20
            });
        }
    }
}

/// Catches cables that are swapped.
#[test]
fn swapped_channels() {
    assert_flagged(Quality::SWAPPED, "swapped channels", |_, tap| {
        std::mem::swap(&mut tap.force, &mut tap.sound);
        true
    });
    assert_flagged(Quality::SWAPPED, "swapped channels, one of them turned", |_, tap| {
        std::mem::swap(&mut tap.force, &mut tap.sound);
        tap.sound.iter_mut().for_each(|x| *x = -*x);
        true
    });
}

/// Catches a sound whose clock is not the force's.
#[test]
fn a_sound_that_is_late() {
    for late_s in [0.5e-3, 0.7e-3, 1e-3, 3e-3] {
        assert_flagged(Quality::SOUND_LATE, &format!("{late_s} s late"), |_, tap| {
            let late = (late_s * RATE_HZ).ceil() as usize;
            let first = tap.sound[..late].to_vec();
            tap.sound.truncate(tap.force.len() - late);
            tap.sound.splice(0..0, first);
            true
        });
    }
}

/// Catches a single sample that decides on F_max or tau.
#[test]
fn spikes_on_the_pulse() {
    for part in [0.1, -0.1, 0.2, -0.3, 0.5, 1.0, 4.0] {
        // One as high as the pulse, and next to it, looks like a pulse of its own.
        let own = if part < 1.0 { Quality::empty() } else { Quality::UNDERSAMPLED | Quality::DOUBLE_HIT };
        assert_flagged(Quality::SPIKE | own, &format!("a spike of {part}"), |k, tap| {
            let place = pulse_at(tap) + k % 25 - 12;
            tap.force[place] += part * peak(&tap.force);
            true
        });
    }
}

/// Catches hum that shifts F_max and is not looked for in the force.
#[test]
fn hum_in_the_force() {
    for f_hz in [50.0, 60.0, 49.8] {
        for part in [0.03, 0.1] {
            assert_flagged(Quality::HUM, &format!("{part} of hum at {f_hz} Hz in the force"), |k, tap| {
                let amplitude = part * peak(&tap.force);
                let hum = |i: usize| amplitude * (TAU * f_hz * i as f64 / RATE_HZ + 0.7 * k as f64).sin();
                tap.force.iter_mut().enumerate().for_each(|(i, x)| *x += hum(i));
                true
            });
        }
    }
}

/// Catches a faint second hit.
#[test]
fn double_hits_from_3_percent() {
    for part in [0.03, 0.05, 0.2] {
        for lag_s in [1.5e-3, 3e-3, 8e-3, 20e-3] {
            assert_flagged(Quality::DOUBLE_HIT, &format!("{part} again after {lag_s} s"), |_, tap| {
                let lag = (lag_s * RATE_HZ) as usize;
                let is_apart = tap.pulse_samples() + 8 < lag;
                for channel in [&mut tap.force, &mut tap.sound] {
                    let once = channel.clone();
                    channel[lag..].iter_mut().zip(once).for_each(|(x, before)| *x += part * before);
                }
                is_apart
            });
        }
    }
}

/// Catches a short hit before the pulse that is lost in means of samples where these are few.
#[test]
fn hits_before_the_pulse_at_low_rates() {
    for rate_hz in [12_800.0, 20_000.0, RATE_HZ] {
        for (part, lasts_s, before_s) in [(0.1, 0.3e-3, 2e-3), (0.4, 0.6e-3, 1e-3), (0.1, 1e-3, 4e-3)] {
            let flagged = of_model(rate_hz, 100).into_iter().map(|mut tap| {
                let (peak_at, samples) = (pulse_at(&tap), (lasts_s * rate_hz).round());
                let (peak, end) = (tap.force[peak_at], peak_at - tap.pulse_samples() - (before_s * rate_hz) as usize);
                for k in 0..=samples as usize {
                    let x = (std::f64::consts::PI * k as f64 / samples).sin();
                    tap.force[end - samples as usize + k] += part * peak * x;
                }
                usize::from(tap.flags().contains(Quality::DOUBLE_HIT))
            });
            let count: usize = flagged.sum();
            assert!(count >= 99, "{part} for {lasts_s} s at {rate_hz} Hz: {count} of 100");
        }
    }
}

/// Catches a sample rate that was written down wrong by a factor of 2.
#[test]
fn a_wrong_sample_rate() {
    for factor in [0.5, 2.0] {
        assert_flagged(Quality::RATE_IMPLAUSIBLE, &format!("the rate times {factor}"), |_, tap| {
            tap.header.sample_rate_hz *= factor;
            true
        });
    }
}

/// Catches a flag whose values enter a verdict as if they were good.
#[test]
fn what_is_spoilt_is_absent() {
    let absent = |flag: Quality, plant: &dyn Fn(&mut Tap), which: &[Discriminator]| {
        let mut tap = OF_MODEL[0].clone();
        plant(&mut tap);
        let found = tap.found(&ProcessConfig::default());
        assert!(found.quality.contains(flag), "{found:?}");
        for d in Discriminator::ALL {
            assert_eq!(found.values.get(d).is_none(), which.contains(&d), "{flag} {d:?}: {found:?}");
        }
    };
    use Discriminator::{A1, A2, Centroid, Ef, FMax, Pf, Pr, Tau};
    absent(
        Quality::CUT,
        &|tap| {
            tap.force.truncate(8192);
            tap.sound.truncate(8192);
            tap.header.sample_count = 8192;
        },
        &[A2, Pr, Pf, Ef, Centroid],
    );
    absent(Quality::DROPOUT, &|tap| tap.sound[900..960].fill(0.0), &[A1, A2, Pr, Pf, Ef, Centroid]);
    absent(Quality::DROPOUT, &|tap| tap.force[900..960].fill(0.0), &[FMax, Tau, A1, A2]);
    absent(Quality::SWAPPED, &|tap| std::mem::swap(&mut tap.force, &mut tap.sound), &Discriminator::ALL);
    absent(Quality::SOUND_LATE, &|tap| tap.sound.rotate_right(30), &[A1, A2]);
    absent(Quality::SPIKE, &|tap| tap.force[530] += 0.3 * peak(&tap.force), &[FMax, Tau, A1, A2]);
}

/// Catches a new flag that real records raise: three slabs hit by hand, which have no force. Only dropouts can be seen in a
/// sound alone.
#[test]
fn recorded_slabs() {
    for slab in ["fhwa-slab-bj", "ntu-slab-06cm", "ntu-slab-10cm"] {
        let Some(folder) = tapline_testing::shared(slab) else { return };
        let mut set = TapSet::open(&folder, 1).unwrap();
        let mut buffer = vec![CacheLine::default(); cache_lines_for(set.plan().recording.payload_bytes_max())];
        let mut extractor = ProcessExtractor::new(&ProcessConfig::default()).unwrap();
        let rows = set.plan().taps().len();
        let mut flags = Vec::new();
        for row in 0..rows as u32 {
            let mut header = TapHeader::default();
            set.render(row, 0, &mut header, &mut buffer).unwrap();
            flags.push(extractor.extract(&header, Samples::view(&header, &buffer).unwrap()).quality);
        }
        let count = |flag| flags.iter().filter(|quality| quality.contains(flag)).count();
        for &(flag, name) in Quality::ALL.iter().filter(|(flag, _)| count(*flag) > 0) {
            eprintln!("{slab}: {name} in {} of {rows}", count(flag));
        }
        let new = [Quality::CUT, Quality::DROPOUT, Quality::SWAPPED, Quality::SOUND_LATE, Quality::SPIKE];
        assert!(new.into_iter().all(|flag| 100 * count(flag) <= rows), "{slab}");
    }
}
