//! Cases 6 to 17 as far as a flag holds them: the record is spoilt, nothing is repaired, and a flag says so.
//!
//! The limit of each is: flagged in all of the taps, and by default the spoilt features absent, or kept where the policy
//! of the flag says so. Twenty taps per disturbance, each with its own noise; an undisturbed tap has no flag.

use tapline_model::{Scene, defect_contact, integral_contact};
use tapline_process::{Policy, ProcessConfig};
use tapline_wire::{Discriminator, Discriminators, Quality};

use crate::stability::scatter::Normal;
use crate::stability::tap::{COUNT, RATE_HZ, Tap, add_hum, add_neighbour, add_noise, clip, peak};

use Discriminator::{A1, A2, Ef, FMax, Pf, Pr, Tau};

/// Taps per disturbance.
const TAPS: u64 = 20;
/// Noise of every tap, over its peak.
const NOISE: f64 = 1e-3;

/// Twenty taps that `change` has disturbed, with noise added before `then` happens to the record.
fn taps(seed: u64, change: impl Fn(&mut Tap), then: impl Fn(&mut Tap)) -> Vec<Tap> {
    let tap = |number| {
        let (mut normal, mut tap) = (Normal::new(100 * seed + number), Tap::sound());
        change(&mut tap);
        add_noise(&mut tap.force_n, NOISE, || normal.next());
        add_noise(&mut tap.sound_v, NOISE, || normal.next());
        then(&mut tap);
        tap
    };
    (0..TAPS).map(tap).collect()
}

fn extracted(taps: &[Tap], config: &ProcessConfig) -> Vec<Discriminators> {
    taps.iter().map(|tap| tap.extract(config)).collect()
}

/// Asserts that all `taps` have `flag`, that by default exactly the `spoilt` features are absent.
fn assert_flagged(taps: &[Tap], flag: Quality, spoilt: &[Discriminator]) {
    for found in extracted(taps, &ProcessConfig::default()) {
        assert!(found.quality.contains(flag), "{flag:?} is not in {found:?}");
        for which in Discriminator::ALL {
            assert_eq!(found.values.get(which).is_none(), spoilt.contains(&which), "{which:?} of {found:?}");
        }
    }
}

fn value(found: &Discriminators, which: Discriminator) -> f64 {
    found.values.get(which).unwrap_or_else(|| panic!("{which:?} is absent: {found:?}"))
}

/// Catches flags without a cause: of 500 taps with a noise of 0.1 % and nothing else, one may have one.
#[test]
fn an_undisturbed_tap_has_no_flag() {
    let all: Vec<Tap> = (0..25).flat_map(|seed| taps(1000 + seed, |_| {}, |_| {})).collect();
    let found = extracted(&all, &ProcessConfig::default());
    let flagged: Vec<_> = found.iter().filter(|f| !f.quality.is_empty()).collect();
    println!("flags: {} of {} undisturbed taps are flagged", flagged.len(), found.len());
    assert!(flagged.len() <= 1, "{flagged:?}");
}

/// Case 6, the areas: hum of 3 and 10 % of the peak. Naive: A_1 scatters by more than 2 % with the phase of 3 %. Limit:
/// flagged `hum` in all taps and kept; absent where the policy is to drop.
#[test]
fn c06_hum_spoils_areas() {
    let hummed = |part: f64| {
        let mut all = taps(6, |_| {}, |_| {});
        for (number, tap) in all.iter_mut().enumerate() {
            add_hum(&mut tap.sound_v, part, 50.0, 0.3 * number as f64);
        }
        all
    };
    let a_1: Vec<f64> = hummed(0.03).iter().map(|tap| value(&tap.extract(&ProcessConfig::default()), A1)).collect();
    let scatter = crate::stability::scatter::sd(&a_1) / crate::stability::scatter::mean(&a_1);
    println!("c06: A_1 scatters by {scatter}");
    assert!(scatter > 0.02, "{scatter}");
    for part in [0.03, 0.1] {
        assert_flagged(&hummed(part), Quality::HUM, &[]);
    }
    let mut dropping = ProcessConfig::default();
    dropping.quality.hum = Policy::Drop;
    assert!(extracted(&hummed(0.03), &dropping).iter().all(|found| found.values.get(A1).is_none()));
}

/// Case 7: white noise of 3 and 10 % of the peak. Naive: by default PR of 3 % is 10 % off (above 5 % is asserted), since
/// nothing is subtracted. Limit: flagged `low_snr` in all taps and kept; at 0.1 % there is no flag.
#[test]
fn c07_white_noise() {
    let noisy = |part: f64| {
        let mut normal = Normal::new(7);
        let mut all = taps(7, |_| {}, |_| {});
        for tap in &mut all {
            add_noise(&mut tap.force_n, part, || normal.next());
            add_noise(&mut tap.sound_v, part, || normal.next());
        }
        all
    };
    let clean = value(&Tap::sound().extract(&ProcessConfig::default()), Pr);
    let found = extracted(&noisy(0.03), &ProcessConfig::default());
    let bias = found.iter().map(|f| value(f, Pr) / clean - 1.0).sum::<f64>() / TAPS as f64;
    println!("c07: PR off by {bias}");
    assert!(bias.abs() > 0.05, "{bias}");
    assert!(found.iter().all(|f| f.quality.contains(Quality::LOW_SNR)), "{found:?}");
    let found = extracted(&noisy(0.1), &ProcessConfig::default());
    assert!(found.iter().all(|f| f.quality.contains(Quality::LOW_SNR)), "{found:?}");
}

/// Case 8: a force clipped at 90 and 60 % of its peak. Naive: the largest sample is 10 and 40 % low, and Eq. 20's
/// tau = pi m V/F 11 and 67 % high. Limit: flagged `clipped` in all taps, and F_max, tau and the areas absent.
#[test]
fn c08_a_clipped_force() {
    for (level, low, tau_high) in [(0.9, 0.1, 0.111), (0.6, 0.4, 0.667)] {
        let clipped = taps(8, |_| {}, |tap| clip(&mut tap.force_n, level));
        for tap in &clipped {
            let naive = peak(&tap.force_n) / 50.0;
            assert!((1.0 - naive - low).abs() < 0.01 && (1.0 / naive - 1.0 - tau_high).abs() < 0.02, "{naive}");
        }
        assert_flagged(&clipped, Quality::CLIPPED, &[FMax, Tau, A1, A2]);
    }
}

/// Case 9: a sound clipped at 80 and 50 % of its peak. Naive: E_f is 7 % and more off and nothing shows it. Limit: flagged
/// `clipped` in all taps; the values are kept by default, and absent where the policy is to drop.
#[test]
fn c09_a_clipped_sound() {
    let clean = value(&Tap::sound().extract(&ProcessConfig::default()), Ef);
    for level in [0.8, 0.5] {
        let clipped = taps(9, |_| {}, |tap| clip(&mut tap.sound_v, level));
        let naive = value(&clipped[0].extract(&ProcessConfig::default()), Ef);
        println!("c09: {level}: E_f x {}", naive / clean);
        assert!((naive / clean - 1.0).abs() > 0.07, "{}", naive / clean);
        assert_flagged(&clipped, Quality::CLIPPED, &[]);
        let mut dropping = ProcessConfig::default();
        dropping.quality.clipped_sound = Policy::Drop;
        assert!(
            extracted(&clipped, &dropping)
                .iter()
                .all(|f| [A1, A2, Pr, Pf, Ef].iter().all(|&w| f.values.get(w).is_none()))
        );
    }
}

/// Case 10: a record that begins 0.1, 0.2 and 0.4 ms within the pulse. Naive: from the first sample to the end of the pulse
/// it is 10, 20 and 40 % short. Limit: flagged `late_trigger` in all taps, and the force's features and the areas absent.
#[test]
fn c10_a_late_trigger() {
    for late_ms in [0.1, 0.2, 0.4] {
        let start = -(512.0 / RATE_HZ) - 1e-3 * late_ms;
        let late = taps(10, |tap| *tap = Tap::clean(1e-3, start), |tap| tap.pre_trigger_samples = 512);
        let until = late[0].force_n.iter().position(|&f| f < 0.5).unwrap() as f64 / RATE_HZ;
        assert!((1.0 - until / 1e-3 - late_ms).abs() < 0.05, "{until}");
        for found in extracted(&late, &ProcessConfig::default()) {
            assert!(found.quality.contains(Quality::LATE_TRIGGER), "{found:?}");
            assert!([FMax, Tau, A1, A2].iter().all(|&which| found.values.get(which).is_none()), "{found:?}");
        }
    }
}

/// Adds `part` of the same tap, `samples` later.
fn hit_again(tap: &mut Tap, part: f64, samples: usize) {
    for channel in [&mut tap.force_n, &mut tap.sound_v] {
        for k in (samples..COUNT).rev() {
            channel[k] += part * channel[k - samples];
        }
    }
}

/// Case 11: a second hit of 40 % after 1, 3 and 8 ms. Naive: the two sounds make a comb, and PR or P_f is more than 10 % off
/// at each. Limit: flagged `double_hit` in all taps and everything absent.
#[test]
fn c11_a_double_hit() {
    let clean = Tap::sound().extract(&ProcessConfig::default());
    for lag_ms in [1.0, 3.0, 8.0] {
        let samples = (1e-3 * lag_ms * RATE_HZ) as usize;
        let again = taps(11, |tap| hit_again(tap, 0.4, samples), |_| {});
        let mut keeping = ProcessConfig::default();
        keeping.quality.double_hit = Policy::Keep;
        let naive = again[0].extract(&keeping);
        let off = [Pr, Pf].map(|which| (value(&naive, which) / value(&clean, which) - 1.0).abs());
        println!("c11: {lag_ms} ms: PR, P_f off by {off:?}");
        assert!(off[0] > 0.1 || off[1] > 0.1, "{off:?}");
        assert_flagged(&again, Quality::DOUBLE_HIT, &Discriminator::ALL);
    }
}

/// Case 13: a force at 1280 Hz, with one or two samples in the pulse. Naive: the largest sample is up to 60 % low, as the
/// phase has it. Limit: F_max and tau absent in all taps and phases, `undersampled` or no pulse at all being said.
#[test]
fn c13_an_undersampled_force() {
    let mut worst = 0.0;
    for phase in 0..32 {
        let sparse = |tap: &mut Tap| {
            for channel in [&mut tap.force_n, &mut tap.sound_v] {
                *channel = channel.iter().copied().skip(phase).step_by(32).collect();
            }
            (tap.rate_hz, tap.pre_trigger_samples) = (RATE_HZ / 32.0, 16);
        };
        let sparse = taps(13, |_| {}, sparse);
        let low = 1.0 - peak(&sparse[0].force_n) / 50.0;
        worst = if low > worst { low } else { worst };
        for found in extracted(&sparse, &ProcessConfig::default()) {
            let is_told = found.quality.contains(Quality::UNDERSAMPLED) || found.quality.contains(Quality::NO_PULSE);
            assert!(
                is_told && found.values.get(FMax).is_none() && found.values.get(Tau).is_none(),
                "{phase} {found:?}"
            );
        }
    }
    println!("c13: worst {worst}");
    assert!(worst > 0.5, "{worst}");
}

/// Case 15: another station's tap 50 ms later, of 25, 50 and 100 % and higher in pitch. Naive: PR is up to a third and more
/// off. Limit: flagged `neighbour` in all taps; the values are kept by default, and A_2 and the powers absent where the policy
/// is to drop.
#[test]
fn c15_a_neighbours_tap() {
    let clean = value(&Tap::sound().extract(&ProcessConfig::default()), Pr);
    let mut worst = 0.0;
    let mut dropping = ProcessConfig::default();
    dropping.quality.neighbour = Policy::Drop;
    for part in [0.25, 0.5, 1.0] {
        let heard = |tap: &mut Tap| {
            let amplitude = part * peak(&tap.sound_v);
            add_neighbour(&mut tap.sound_v, amplitude, 1000.0);
        };
        let heard = taps(15, heard, |_| {});
        let mut keeping = ProcessConfig::default();
        keeping.quality.neighbour = Policy::Keep;
        let off = (value(&heard[0].extract(&keeping), Pr) / clean - 1.0).abs();
        worst = if off > worst { off } else { worst };
        for found in extracted(&heard, &ProcessConfig::default()) {
            assert!(found.quality.contains(Quality::NEIGHBOUR), "{found:?}");
            assert!(Discriminator::ALL.iter().all(|&which| found.values.get(which).is_some()), "{found:?}");
        }
        for found in extracted(&heard, &dropping) {
            assert!([A2, Pr, Pf, Ef].iter().all(|&which| found.values.get(which).is_none()), "{found:?}");
            assert!([FMax, Tau, A1].iter().all(|&which| found.values.get(which).is_some()), "{found:?}");
        }
    }
    println!("c15: PR off by {worst}");
    assert!(worst > 0.33, "{worst}");
}

/// Case 17: 5 % too fast. Naive: the force rises by 6.0 %, and a crack 19 mm deep, which takes 3.4 % of it, is hidden.
/// Limit: flagged `velocity_off` in all taps from 3 % on and kept; absent but for PR where the policy is to drop.
#[test]
fn c17_an_impact_too_fast() {
    let sound = integral_contact(&Scene::default()).unwrap().f_max_n;
    let fast = integral_contact(&Scene { velocity_m_per_s: 1.05 * 1.85, ..Scene::default() }).unwrap().f_max_n;
    let cracked = Scene { h_m: 19.05e-3, velocity_m_per_s: 1.05 * 1.85, ..Scene::default() };
    let hidden = defect_contact(&cracked).unwrap().f_max_n;
    let slow = defect_contact(&Scene { velocity_m_per_s: 1.85, ..cracked }).unwrap().f_max_n;
    assert!(
        (fast / sound - 1.06).abs() < 5e-4 && (1.0 - slow / sound - 0.034).abs() < 2e-3 && hidden > sound,
        "{slow} {hidden}"
    );

    let off = |part: f64| taps(17, |tap| tap.velocity_m_per_s = Some((1.85, 1.85 * (1.0 + part))), |_| {});
    assert_flagged(&off(0.05), Quality::VELOCITY_OFF, &[]);
    assert_flagged(&off(-0.05), Quality::VELOCITY_OFF, &[]);
    // The force of these taps has no unit, so `rate_implausible` may speak of their impulse.
    let nearly = extracted(&off(0.02), &ProcessConfig::default());
    assert!(nearly.iter().all(|f| Quality::RATE_IMPLAUSIBLE.contains(f.quality)));
    let mut dropping = ProcessConfig::default();
    dropping.quality.velocity_off = Policy::Drop;
    for found in extracted(&off(0.05), &dropping) {
        assert!(found.values.get(FMax).is_none() && found.values.get(Pr).is_some(), "{found:?}");
    }
}
