//! Cases 1 to 21 as far as the default kernels hold them: a channel that is missing or disturbed, and the spectrum of a
//! transient. What a flag holds is in `flags`, what another estimator holds in `estimators`; `docs/stability` shows how far noise
//! takes the numbers.

use std::f64::consts::TAU;

use realfft::RealFftPlanner;
use tapline_acquire::{Source as _, TapSet};
use tapline_process::ProcessConfig;
use tapline_wire::{CacheLine, Discriminator, Discriminators, Quality, TapHeader, cache_lines_for};

use crate::stability::tap::{PRE_TRIGGER, RATE_HZ, Tap, add_hum, add_offset, peak};

const ALL: [Discriminator; Discriminator::COUNT] = Discriminator::ALL;

fn value(found: &Discriminators, which: Discriminator) -> f64 {
    found.values.get(which).unwrap_or_else(|| panic!("{which:?} is absent: {found:?}"))
}

fn found(tap: &Tap) -> Discriminators {
    tap.extract(&ProcessConfig::default())
}

/// How far `which` of `tap` is from that of the clean one, relative.
fn off(tap: &Tap, which: Discriminator) -> f64 {
    (value(&found(tap), which) / value(&found(&Tap::sound()), which) - 1.0).abs()
}

/// PR, P_f and E_f read naively: the spectrum of the record as it is, times `window`, over all from 0 to 20 kHz.
fn naive_powers(sound_v: &[f64], window: impl Fn(f64) -> f64) -> [f64; 3] {
    let count = sound_v.len();
    let mut signal: Vec<f64> = sound_v.iter().enumerate().map(|(k, x)| x * window(k as f64 / count as f64)).collect();
    let plan = RealFftPlanner::<f64>::new().plan_fft_forward(count);
    let mut bins = plan.make_output_vec();
    plan.process(&mut signal, &mut bins).unwrap();
    let df = RATE_HZ / count as f64;
    let scale = 2.0 / (RATE_HZ * count as f64);
    let psd: Vec<(f64, f64)> = bins.iter().enumerate().map(|(k, b)| (k as f64 * df, scale * b.norm_sqr())).collect();
    let between = |low: f64, high: f64| psd.iter().filter(move |&&(f, _)| f >= low && f <= high).map(|&(_, p)| p);
    let flexural: f64 = between(550.0, 2000.0).sum();
    let largest = between(550.0, 2000.0).fold(f64::NEG_INFINITY, |m, p| if p > m { p } else { m });
    [flexural / between(0.0, 20e3).sum::<f64>(), largest, flexural * df]
}

fn boxcar(_: f64) -> f64 {
    1.0
}

/// Case 1: a sound of zeros.
///
/// Naive: PR is 0/0 and P_f is 0, which looks perfectly sound. Hold: the five discriminators of the sound are absent and a
/// flag says why; the two of the force are there, bit for bit.
#[test]
fn c01_a_sound_of_zeros() {
    let [pr, p_f, _] = naive_powers(&[0.0; 16_384], boxcar);
    assert!(pr.is_nan() && p_f == 0.0);
    let mut tap = Tap::sound();
    tap.sound_v.fill(0.0);
    let (silent, clean) = (found(&tap), found(&Tap::sound()));
    assert!(ALL[2..].iter().all(|&which| silent.values.get(which).is_none()), "{silent:?}");
    assert!(silent.quality.contains(Quality::NO_ONSET) && clean.quality.is_empty(), "{silent:?} {clean:?}");
    for which in [Discriminator::FMax, Discriminator::Tau] {
        assert_eq!(value(&silent, which).to_bits(), value(&clean, which).to_bits());
    }
}

/// Case 2: a force of zeros.
///
/// Naive: tau is 0 and f_c = 1/(2 tau) infinite. Hold: what needs the force is absent and flagged `no_pulse`; the powers,
/// even where f_c is to follow tau, are those of the fixed band, bit for bit.
#[test]
fn c02_a_force_of_zeros() {
    assert!((1.0 / (2.0 * 0.0_f64)).is_infinite());
    let mut tap = Tap::sound();
    tap.force_n.fill(0.0);
    let without = tap.extract(&ProcessConfig { f_c_follows_tau: true, ..ProcessConfig::default() });
    assert!(ALL[..3].iter().all(|&which| without.values.get(which).is_none()), "{without:?}");
    assert!(without.quality.contains(Quality::NO_PULSE), "{without:?}");
    for &which in &ALL[4..] {
        assert_eq!(value(&without, which).to_bits(), value(&found(&Tap::sound()), which).to_bits());
    }
}

/// Case 3: an offset of 1, 3 and 10 % of the sound's peak.
///
/// Naive: PR loses 6 % of itself at 1 %, a third at 3 % and 83 % at 10 %. Hold: no discriminator moves by more than 1e-5.
/// Measured: 1e-7, the rounding of samples.
#[test]
fn c03_dc_offset_on_sound() {
    let naive = |part| {
        let mut tap = Tap::sound();
        add_offset(&mut tap.sound_v, part);
        naive_powers(&tap.sound_v, boxcar)[0] / naive_powers(&Tap::sound().sound_v, boxcar)[0]
    };
    println!("c03: naive PR x {} {} {}", naive(0.01), naive(0.03), naive(0.1));
    assert!(naive(0.01) < 0.95 && naive(0.1) < 0.2, "{} {}", naive(0.01), naive(0.1));
    for part in [0.01, 0.03, 0.1] {
        let mut tap = Tap::sound();
        add_offset(&mut tap.sound_v, part);
        assert!(ALL.iter().all(|&which| off(&tap, which) < 1e-5), "{:?}", ALL.map(|which| off(&tap, which)));
    }
}

/// Case 4: A_2 as a signed area.
///
/// Naive: an offset of 0.1 % of the peak changes it by more than twice the whole (2.9): it is an offset detector. Hold: the
/// area of the magnitude, less the baseline, changes by less than 1e-5.
#[test]
fn c04_a_signed_ringing_area() {
    let signed = |tap: &Tap| tap.sound_v[PRE_TRIGGER + 45..].iter().sum::<f64>();
    let mut tap = Tap::sound();
    add_offset(&mut tap.sound_v, 1e-3);
    let naive = (signed(&tap) / signed(&Tap::sound()) - 1.0).abs();
    println!("c04: naive {naive}, held {}", off(&tap, Discriminator::A2));
    assert!(naive > 2.0, "{naive}");
    assert!(off(&tap, Discriminator::A2) < 1e-5);
}

/// Case 6, the powers: hum of 50, 52 and 60 Hz at 1, 3 and 10 % of the peak.
///
/// Naive: over all frequencies PR loses more than half at 10 % (0.47). Hold: PR and E_f within 1e-6 at either frequency; measured 1e-8.
/// A hum that does not fit the record in whole periods leaks into the bands: at 52 Hz 1 and 3 % are held within 2e-3, 10 % within
/// 2e-2 and under its flag.
/// Open: A_1 scatters with the phase of the hum by as much as read naively; removing the hum is not the default.
#[test]
fn c06_hum_on_sound() {
    for f_hz in [50.0, 52.0, 60.0] {
        for part in [0.01, 0.03, 0.1] {
            let mut tap = Tap::sound();
            add_hum(&mut tap.sound_v, part, f_hz, 0.4);
            let naive = naive_powers(&tap.sound_v, boxcar)[0] / naive_powers(&Tap::sound().sound_v, boxcar)[0];
            let held = [Discriminator::Pr, Discriminator::Ef].map(|which| off(&tap, which));
            println!("c06: {f_hz} Hz {part}: naive PR x {naive}, held {held:?}");
            assert!(part < 0.1 || naive < 0.5, "{naive}");
            let fits = !(51.0..59.0).contains(&f_hz);
            let limit = if fits { 1e-6 } else { [2e-3, 2e-2][usize::from(part > 0.05)] };
            assert!(held.iter().all(|&off| off < limit), "{held:?}");
        }
    }
}

/// Case 14: a sample rate that is written down wrongly, 44.1 for 40.96 kHz.
///
/// Naive: taken as written, PR moves by more than a tenth and tau by 7 %. Hold: a recording whose own rate is not that of
/// its set is refused, with both rates.
#[test]
fn c14_a_sample_rate_written_wrongly() {
    let wrong = Tap { rate_hz: 44_100.0, ..Tap::sound() };
    println!("c14: PR {} tau {}", off(&wrong, Discriminator::Pr), off(&wrong, Discriminator::Tau));
    assert!(off(&wrong, Discriminator::Pr) > 0.1 && (off(&wrong, Discriminator::Tau) - 0.071).abs() < 0.002);

    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write(
        "scan.toml",
        "geometry = \"ring\"\nchannels = [\"sound\"]\nsample_rate_hz = 44100\npre_trigger_samples = 8\n",
    );
    let header = "file,tyre,shoulder,offset_mm,velocity_m_per_s,location,angle_deg,repetition";
    write("taps.csv", &format!("{header}\na.wav,T,1,,,0,,0\nb.wav,T,1,,,1,,0\n"));
    for (name, sample_rate) in [("a.wav", 40_960), ("b.wav", 44_100)] {
        let spec =
            hound::WavSpec { channels: 1, sample_rate, bits_per_sample: 16, sample_format: hound::SampleFormat::Int };
        let mut writer = hound::WavWriter::create(folder.path().join(name), spec).unwrap();
        (0..64_i16).for_each(|k| writer.write_sample(k).unwrap());
        writer.finalize().unwrap();
    }
    let mut set = TapSet::open(folder.path(), 1).unwrap();
    let mut buffer = vec![CacheLine::default(); cache_lines_for(set.plan().recording.payload_bytes_max())];
    let refusal = set.render(0, 0, &mut TapHeader::default(), &mut buffer).unwrap_err();
    assert!(refusal.reason.contains("40960") && refusal.reason.contains("44100"), "{refusal:?}");
    set.render(1, 0, &mut TapHeader::default(), &mut buffer).unwrap();
}

/// Case 16: the microphone a tenth farther off.
///
/// Naive: every absolute number of the sound falls, areas by 9 % and powers by 17 %. Hold: PR, the ratio, within 1e-6.
/// Open: the others follow the distance; a gain from the healthy median belongs to the fusion.
#[test]
fn c16_the_microphone_farther_off() {
    let mut tap = Tap::sound();
    tap.sound_v.iter_mut().for_each(|x| *x /= 1.1);
    for (which, falls) in [
        (Discriminator::A1, 0.0909),
        (Discriminator::A2, 0.0909),
        (Discriminator::Pf, 0.1736),
        (Discriminator::Ef, 0.1736),
    ] {
        assert!((off(&tap, which) - falls).abs() < 1e-3, "{which:?} {}", off(&tap, which));
    }
    assert!(off(&tap, Discriminator::Pr) < 1e-6, "{}", off(&tap, Discriminator::Pr));
}

/// Case 18: a casing ten degrees warmer, whose contact is 4.3 % longer.
///
/// Naive: where f_c follows tau, PR of one and the same sound moves by a quarter (0.140 to 0.177). Hold: with the fixed band, which is the
/// default, it does not move by a bit. Open: force and tau themselves move; no temperature is stored.
#[test]
fn c18_a_warmer_casing() {
    // 480 Hz rings just below f_c = 500 Hz of 1 ms and just above that of 1.043 ms.
    let pr = |tau_s: f64, f_c_follows_tau| {
        let tap = Tap { force_n: Tap::clean(tau_s, 0.0).force_n, ..Tap::sound() };
        value(&tap.extract(&ProcessConfig { f_c_follows_tau, ..ProcessConfig::default() }), Discriminator::Pr)
    };
    println!("c18: naive {} -> {}", pr(1e-3, true), pr(1.043e-3, true));
    assert!((pr(1.043e-3, true) / pr(1e-3, true) - 1.0).abs() > 0.2);
    assert_eq!(pr(1.043e-3, false).to_bits(), pr(1e-3, false).to_bits());
}

/// Case 19: f_c above the band.
///
/// Naive: at tau = 0.24 ms f_c is 2083 Hz, the band to 2000 Hz is empty, PR is 0 and P_f the largest of nothing. Hold: the
/// three powers are absent and flagged `no_band`, all else is there. Below 70 Hz (tau above 7 ms) f_c stays at the reference's
/// lower edge, so that PR is below 1, and the tap is flagged `rate_implausible`.
#[test]
fn c19_a_contact_too_short_for_the_band() {
    let empty: Vec<f64> = Vec::new();
    assert!(empty.iter().copied().fold(f64::NEG_INFINITY, |m, p| if p > m { p } else { m }).is_infinite());
    let following = ProcessConfig { f_c_follows_tau: true, ..ProcessConfig::default() };
    let short = Tap::clean(0.24e-3, 0.0).extract(&following);
    assert!(ALL[4..].iter().all(|&which| short.values.get(which).is_none()), "{short:?}");
    assert!(
        short.quality.contains(Quality::NO_BAND) && ALL[..4].iter().all(|&which| short.values.get(which).is_some())
    );
    let long = Tap { force_n: Tap::clean(8e-3, 0.0).force_n, ..Tap::sound() }.extract(&following);
    let pr = value(&long, Discriminator::Pr);
    println!("c19: PR at 8 ms {pr}");
    assert!(pr > 0.5 && pr < 1.0 && long.quality.contains(Quality::RATE_IMPLAUSIBLE), "{long:?}");
}

/// Case 21: where in its record the tap lies, and windows for noise.
///
/// Naive: a Hann window over the record takes E_f to less than 1e-3 of itself where the tap lies at its start, and moves it
/// by more than tenfold with the tap. Hold: shifted by up to 200 ms, PR, P_f and E_f move by less than 1e-3, and so does
/// whatever else is there; only of a tap before its trigger is A_2 absent, and flagged. Measured: 5e-4.
#[test]
fn c21_windows_and_the_place_of_the_tap() {
    let hann = |x: f64| 0.5 - 0.5 * (TAU * x).cos();
    let shifted = |shift_s| Tap::clean(1e-3, shift_s);
    let e_f = |shift_s: f64, window: &dyn Fn(f64) -> f64| naive_powers(&shifted(shift_s).sound_v, window)[2];
    println!("c21: Hann {} of boxcar, x {}", e_f(0.0, &hann) / e_f(0.0, &boxcar), e_f(0.1, &hann) / e_f(0.0, &hann));
    assert!(e_f(0.0, &hann) / e_f(0.0, &boxcar) < 1e-3 && e_f(0.1, &hann) / e_f(0.0, &hann) > 10.0);
    let mut worst = 0.0;
    for shift_s in [-3e-3, -1.234e-3, 0.5 / RATE_HZ, 1e-3, 7.77e-3, 0.05, 0.2] {
        let there = found(&shifted(shift_s));
        let is_late = there.quality.contains(Quality::LATE_TRIGGER);
        assert!(shift_s >= 0.0 || is_late, "{there:?}");
        for which in ALL.into_iter().filter(|&which| !is_late || which != Discriminator::A2) {
            let off = off(&shifted(shift_s), which);
            worst = if off > worst { off } else { worst };
        }
    }
    println!("c21: worst {worst}");
    assert!(worst < 1e-3, "{worst}");
    assert!(peak(&shifted(0.2).sound_v) > 0.5, "the tap is in the record");
}
