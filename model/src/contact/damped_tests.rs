use std::f64::consts::PI;

use super::*;
use crate::contact::damped_table::ORDER;
use crate::contact::ode::{State, Stepping, integrate, locate};
use crate::{DampingLaw, chi_for_restitution};

/// The slow twin: the differential equation itself.
fn by_integration(chi: f64) -> DampedContact {
    let force = |y: &State<2>| if y[0] > 0.0 { y[0] * y[0].sqrt() * (1.0 + chi * y[1]) } else { 0.0 };
    let rate = |y: &State<2>| [y[1], -force(y)];
    // The derivative of a^1.5 (1 + chi a'), divided by sqrt(a).
    let is_rising = |y: &State<2>| 1.5 * y[1] * (1.0 + chi * y[1]) - chi * y[0] * force(y) > 0.0;
    let stepping = Stepping { tolerance: 1e-14, dt_max: 0.01, dt_first: 1e-6, steps_max: 1_000_000 };
    let mut found = DampedContact { f_max: 0.0, contact_time: 0.0, alpha_max: 0.0, restitution: 0.0 };
    integrate(rate, [0.0, 1.0], 1e3, &stepping, |step| {
        if step.from[0] > 0.0 && is_rising(&step.from) && !is_rising(&step.to) {
            found.f_max = force(&locate(rate, step, is_rising).1);
        }
        if step.from[1] > 0.0 && step.to[1] <= 0.0 {
            found.alpha_max = locate(rate, step, |y| y[1] > 0.0).1[0];
        }
        if step.to[0] <= 0.0 {
            let (t, y) = locate(rate, step, |y| y[0] > 0.0);
            (found.contact_time, found.restitution) = (t, -y[1]);
        }
        step.to[0] > 0.0
    });
    found
}

fn values(c: &DampedContact) -> [f64; 4] {
    [c.f_max, c.contact_time, c.alpha_max, c.restitution]
}

#[expect(clippy::cast_precision_loss, reason = "a small index")]
fn node(k: usize) -> f64 {
    (PI * (k as f64 + 0.5) / ORDER as f64).cos()
}

/// The four series, from the differential equation at the nodes.
#[expect(clippy::cast_precision_loss, reason = "a small index")]
fn series() -> [[f64; 4]; ORDER] {
    let at_nodes: Vec<[f64; 4]> = (0..ORDER)
        .map(|k| values(&by_integration(CHI_MIN * (0.5 * (node(k) + 1.0) * (CHI_MAX / CHI_MIN).ln()).exp())))
        .collect();
    std::array::from_fn(|j| {
        std::array::from_fn(|quantity| {
            let weight = if j == 0 { 1.0 } else { 2.0 } / ORDER as f64;
            let term = |k: usize| at_nodes[k][quantity] * (PI * j as f64 * (k as f64 + 0.5) / ORDER as f64).cos();
            weight * (0..ORDER).map(term).sum::<f64>()
        })
    })
}

/// Prints the rows of `damped_table.rs`; run with `--ignored --nocapture`.
#[test]
#[ignore = "prints the table"]
fn print_the_table() {
    for row in series() {
        println!("    [{}],", row.map(|c| format!("{c:.12e}")).join(", "));
    }
}

/// Catches a table that its generator does not give.
#[test]
fn the_table_is_that_of_the_differential_equation() {
    for (kept, made) in SERIES.as_flattened().iter().zip(series().as_flattened()) {
        assert!((kept - made).abs() < 1e-10, "{kept} {made}");
    }
}

/// Catches too few terms, a wrong mapping of chi, and a jump towards elastic contact: within 1e-7 of the differential
/// equation for any restitution from 0.1 to 1, also between the nodes.
#[test]
fn the_table_holds_between_its_nodes() {
    for i in 0..=180 {
        let e = 0.1 + 0.005 * f64::from(i);
        let chi = chi_for_restitution(e.clamp(0.1, 1.0)).unwrap();
        compare(chi, e);
    }
    for chi in [1e-9, 1e-5, 3e-5, 9.9e-5, 1.1e-4, 1e-3, 12.0, 14.4, 16.0] {
        compare(chi, f64::NAN);
    }
}

fn compare(chi: f64, e: f64) {
    let (fast, slow) = (DampedContact::new(chi).unwrap(), by_integration(chi));
    for (fast, slow) in values(&fast).into_iter().zip(values(&slow)) {
        assert!((fast / slow - 1.0).abs() < 1e-7, "chi = {chi}: {fast} for {slow}");
    }
    assert!(e.is_nan() || (fast.restitution - e).abs() < 1e-7, "{} for {e}", fast.restitution);
}

/// Catches a wrong constant of elastic contact.
#[test]
fn elastic_contact_is_hertzs() {
    let elastic = DampedContact::new(0.0).unwrap();
    for (got, known) in values(&elastic).into_iter().zip(values(&by_integration(0.0))) {
        assert!((got / known - 1.0).abs() < 1e-10, "{got} for {known}");
    }
    assert!((elastic.f_max - 1.25_f64.powf(0.6)).abs() < 1e-15);
    assert!((elastic.alpha_max - 1.25_f64.powf(0.4)).abs() < 1e-15);
}

/// Catches a law that needs a chi beyond the table, and a chi outside the table that is accepted.
#[test]
fn the_table_covers_every_law() {
    for law in [DampingLaw::Exact, DampingLaw::LankaraniNikravesh, DampingLaw::Flores, DampingLaw::Gonthier] {
        assert!(DampedContact::new(law.chi(0.1).unwrap()).is_ok(), "{law:?}");
        assert!(DampedContact::new(law.chi(1.0).unwrap()).is_ok(), "{law:?}");
    }
    for chi in [-1e-300, 16.1, f64::NAN, f64::INFINITY] {
        assert!(matches!(DampedContact::new(chi), Err(Error::OutOfRange { name: "chi", .. })));
    }
}
