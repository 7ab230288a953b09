//! The breakdown curves: how wrong each number gets as a disturbance grows.

use anyhow::Result;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use tapline_model::{DampedContact, DampingLaw, Rung, Scene};
use tapline_process::{ProcessConfig, QualityConfig};
use tapline_wire::{Discriminator, Quality};

use super::tap::{Tap, add_hum, add_noise, add_offset, clip};
use crate::evaluation::Table;

/// One picture: relative errors against the size of what causes them.
#[derive(Debug, Clone)]
pub(crate) struct Curve {
    /// Name of its files.
    pub name: &'static str,
    pub title: &'static str,
    pub x_label: &'static str,
    pub is_x_log: bool,
    /// What it shows, in a few sentences.
    pub sentence: &'static str,
    pub columns: Vec<&'static str>,
    pub rows: Vec<Row>,
}

#[derive(Debug, Clone)]
pub(crate) struct Row {
    pub x: f64,
    /// The error of each column; NaN where the number is absent.
    pub errors: Vec<f64>,
    /// Names of the flags raised, joined by `|`.
    pub flags: String,
}

/// Records that a point of the noise curve averages.
const NOISE_RECORDS: u64 = 8;

/// All of them, in the order of the index.
pub(crate) fn curves() -> Vec<Curve> {
    vec![noise(), clipping(), offset(), hum(), trigger_shift(), velocity_drift(), restitution(), depth(), length()]
}

/// `count` numbers from `low` to `high`, with equal ratios.
fn decades(low: f64, high: f64, count: u32) -> Vec<f64> {
    (0..count).map(|k| low * (high / low).powf(f64::from(k) / f64::from(count - 1))).collect()
}

/// `count` numbers from `low` to `high`, in equal steps.
fn steps(low: f64, high: f64, count: u32) -> Vec<f64> {
    (0..count).map(|k| low + (high - low) * f64::from(k) / f64::from(count - 1)).collect()
}

fn names() -> Vec<&'static str> {
    Discriminator::ALL.iter().map(|which| which.name()).collect()
}

/// The default configuration, except that no flag removes a value: the question is how wrong it is.
fn keeping() -> ProcessConfig {
    ProcessConfig { quality: QualityConfig::keeping(), ..ProcessConfig::default() }
}

/// Errors of the discriminators of `tap`, and its flags.
fn errors(tap: &Tap) -> (Vec<f64>, Quality) {
    let found = tap.extract(&keeping());
    let clean = Tap::sound().extract(&keeping()).values;
    let error = |which| match (found.values.get(which), clean.get(which)) {
        (Some(x), Some(truth)) => (x / truth - 1.0).abs(),
        _ => f64::NAN,
    };
    (Discriminator::ALL.into_iter().map(error).collect(), found.quality)
}

fn disturbed(xs: Vec<f64>, tap_at: impl Fn(f64) -> Tap) -> Vec<Row> {
    let row = |x| {
        let (errors, quality) = errors(&tap_at(x));
        Row { x, errors, flags: quality.to_string() }
    };
    xs.into_iter().map(row).collect()
}

/// A row of the contact models, whose flags are not drawn.
fn modelled(x: f64, errors: Vec<f64>) -> Row {
    Row { x, errors, flags: String::new() }
}

fn on_both(x: f64, change: impl Fn(&mut [f64], f64)) -> Tap {
    let mut tap = Tap::sound();
    change(&mut tap.force_n, x);
    change(&mut tap.sound_v, x);
    tap
}

fn noise() -> Curve {
    let at = |x: f64| {
        let (mut squares, mut quality) = ([0.0; Discriminator::COUNT], Quality::default());
        for seed in 0..NOISE_RECORDS {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let mut tap = Tap::sound();
            add_noise(&mut tap.force_n, x, || StandardNormal.sample(&mut rng));
            add_noise(&mut tap.sound_v, x, || StandardNormal.sample(&mut rng));
            let (errors, flags) = errors(&tap);
            quality.insert(flags);
            for (square, error) in squares.iter_mut().zip(errors) {
                *square += error * error / NOISE_RECORDS as f64;
            }
        }
        Row { x, errors: squares.map(f64::sqrt).to_vec(), flags: quality.to_string() }
    };
    Curve {
        name: "snr",
        title: "White noise on both channels",
        x_label: "Standard deviation of the noise / peak (1 / SNR)",
        is_x_log: true,
        sentence: "Root mean square error over 8 records. At 1 % noise, A_2 is 60 % off, because it integrates the magnitude of the noise to the end of the record; P_f is 4 % off, all others less than 1.5 %. From 3 % on, the powers rise with the square of the noise; at 30 % no pulse is found.",
        columns: names(),
        rows: decades(1e-4, 0.3, 15).into_iter().map(at).collect(),
    }
}

pub(crate) fn clipping() -> Curve {
    Curve {
        name: "clipping",
        title: "Both channels clipped below their peak",
        x_label: "Clipping level / peak",
        is_x_log: false,
        sentence: "F_max loses the clipped part, and A_1 and the powers fall too; tau and PR stay within 5 %. No value shows the clipping, but the flag does: here, without noise, at any level.",
        columns: names(),
        rows: disturbed(steps(0.4, 1.0, 25), |x| on_both(x, clip)),
    }
}

pub(crate) fn offset() -> Curve {
    Curve {
        name: "offset",
        title: "Offset on both channels",
        x_label: "Offset / peak",
        is_x_log: true,
        sentence: "Subtracting the median of the pre-trigger samples removes an offset, except for the rounding of samples.",
        columns: names(),
        rows: disturbed(decades(1e-3, 1.0, 13), |x| on_both(x, add_offset)),
    }
}

fn hum() -> Curve {
    Curve {
        name: "hum",
        title: "Hum of 50 Hz on both channels",
        x_label: "Hum amplitude / peak",
        is_x_log: true,
        sentence: "The bands begin at 70 Hz. The 0.4 s of these taps hold a whole number of periods of 50 Hz, so the hum does not leak into the bands. Force and areas change, A_2 first.",
        columns: names(),
        rows: disturbed(decades(1e-4, 0.3, 15), |x| on_both(x, |samples, x| add_hum(samples, x, 50.0, 1.0))),
    }
}

fn trigger_shift() -> Curve {
    Curve {
        name: "trigger_shift",
        title: "Tap later or earlier in its record",
        x_label: "Contact after the trigger sample, ms",
        is_x_log: false,
        sentence: "No discriminator changes by more than 1e-3 as long as the ringing, which falls to 1e-5 of its peak in 100 ms, ends within the record. Near the end of the record the powers and A_2 are wrong, and no flag is raised. At -12 ms, where the contact lies in the baseline, the areas are wrong.",
        columns: names(),
        rows: disturbed(steps(-12.0, 390.0, 68), |x| Tap::clean(1e-3, 1e-3 * x)),
    }
}

/// Force, contact time and deflection of `rung` in `scene`.
fn contact(rung: Rung, scene: &Scene) -> [f64; 3] {
    rung.contact(scene, DampingLaw::Exact).map_or([f64::NAN; 3], |c| [c.f_max_n, c.contact_time_s, c.d_max_m])
}

pub(crate) fn velocity_drift() -> Curve {
    let at = |x: f64| {
        let drifted = |rung, drift: f64| {
            let v = Scene::default().velocity_m_per_s;
            contact(rung, &Scene { velocity_m_per_s: v * (1.0 + drift), ..Scene::default() })
        };
        let error =
            |rung| std::array::from_fn::<f64, 3, _>(|k| (drifted(rung, x)[k] / drifted(rung, 0.0)[k] - 1.0).abs());
        modelled(100.0 * x, [error(Rung::Closed), error(Rung::Full)].concat())
    };
    Curve {
        name: "velocity_drift",
        title: "Impact velocity other than planned",
        x_label: "Velocity error, %",
        is_x_log: false,
        sentence: "An error of 5 % in velocity changes force by 6 % and deflection by 4 % on both rungs, more than a crack 19 mm deep does; tau changes by 1 %.",
        columns: vec!["f_max_closed", "tau_closed", "d_max_closed", "f_max_full", "contact_time_full", "d_max_full"],
        rows: steps(-0.2, 0.2, 41).into_iter().map(at).collect(),
    }
}

pub(crate) fn restitution() -> Curve {
    const LAWS: [DampingLaw; 4] =
        [DampingLaw::Exact, DampingLaw::Gonthier, DampingLaw::Flores, DampingLaw::LankaraniNikravesh];
    let at = |e: f64| {
        let returned = |law: DampingLaw| law.chi(e).and_then(DampedContact::new).map_or(f64::NAN, |c| c.restitution);
        modelled(e, LAWS.map(|law| (returned(law) / e - 1.0).abs()).to_vec())
    };
    Curve {
        name: "restitution",
        title: "How well a damping law returns the restitution asked for",
        x_label: "Restitution asked for",
        is_x_log: false,
        sentence: "The exact law returns the restitution that is asked for, down to 0.1, where all laws end. Eq. 12 returns 0.66 for 0.1.",
        columns: vec!["exact", "gonthier", "flores", "lankarani_nikravesh"],
        rows: decades(0.1, 0.999, 25).into_iter().map(at).collect(),
    }
}

/// Errors of the peak force of the three cheaper rungs.
fn rungs(scene: &Scene) -> Vec<f64> {
    let truth = contact(Rung::Full, scene)[0];
    [Rung::Closed, Rung::Integral, Rung::Plate].map(|rung| (contact(rung, scene)[0] / truth - 1.0).abs()).to_vec()
}

fn depth() -> Curve {
    Curve {
        name: "depth",
        title: "Peak force over a crack, by its depth",
        x_label: "Depth h of the crack, mm (length l = 25.4 mm)",
        is_x_log: true,
        sentence: "Compared with the full rung, the closed form lacks half of the force below 2 mm and all of it at 0.1 mm. The integral model, which has no crack, gives up to seven times too much. The plate is within 12 % down to 0.8 mm, where the membrane begins to carry load.",
        columns: vec!["closed", "integral", "plate"],
        rows: decades(0.1, 25.4, 25)
            .into_iter()
            .map(|h| modelled(h, rungs(&Scene { h_m: 1e-3 * h, ..Scene::default() })))
            .collect(),
    }
}

fn length() -> Curve {
    let at = |l: f64| modelled(l, rungs(&Scene { l_m: 1e-3 * l, h_m: 2.54e-3, ..Scene::default() }));
    Curve {
        name: "length",
        title: "Peak force over a crack, by its length",
        x_label: "Length l of the crack, mm (depth h = 2.54 mm)",
        is_x_log: true,
        sentence: "As l goes to 0, all three approach the full rung, but slowly, because shear softens a layer that is shorter than it is thick (the flag of h/l is raised there). The closed form is within a tenth only where the curves cross.",
        columns: vec!["closed", "integral", "plate"],
        rows: decades(0.1, 50.8, 25).into_iter().map(at).collect(),
    }
}

impl Curve {
    /// The rows as CSV; an absent value is an empty cell.
    pub(crate) fn csv(&self) -> Result<String> {
        let columns = ["x"].into_iter().chain(self.columns.iter().copied()).chain(["flags"]);
        let mut table = Table::long("", "", columns);
        for Row { x, errors, flags } in &self.rows {
            let error = |e: &f64| if e.is_finite() { format!("{e:.4e}") } else { String::new() };
            table.push_texts([format!("{x:.6}")].into_iter().chain(errors.iter().map(error)).chain([flags.clone()]));
        }
        table.csv()
    }
}
