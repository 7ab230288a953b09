//! Strength of response over size.

use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, StandardNormal};
use tapline_lab::statistics::{Refusal, a_hat};

use super::reference::A_HAT;
use super::{is_near, is_near_covariance};

/// A study and what statsmodels' OLS, and for the bound scipy, finds in it.
#[derive(Debug)]
pub(crate) struct AHatCase {
    pub name: &'static str,
    pub sizes: &'static [f64],
    pub responses: &'static [f64],
    pub threshold: f64,
    pub line: [f64; 3],
    pub covariance: [f64; 9],
    pub mu: f64,
    pub sigma: f64,
    pub a90: f64,
    pub a90_95_likelihood: f64,
    pub first_pod: f64,
    pub first_pod_lower: f64,
}

#[test]
fn a_fit_is_that_of_statsmodels_and_scipy() {
    // Catches n - 2 for n, a covariance of the standardised sizes, one without that of intercept and slope, and a bound
    // that leaves the scatter as it is.
    for case in A_HAT {
        let fit = a_hat(case.sizes, case.responses, case.threshold).unwrap();
        let name = case.name;
        for (got, expected) in [fit.intercept, fit.slope, fit.scatter].into_iter().zip(case.line) {
            assert!(is_near(got, expected, 1e-8), "{name}: {fit:?}");
        }
        assert!(is_near_covariance(&fit.covariance, &case.covariance, 1e-8), "{name}: {fit:?} {:?}", case.covariance);
        assert!(is_near(fit.mu, case.mu, 1e-8) && is_near(fit.sigma, case.sigma, 1e-8), "{name}: {fit:?}");
        assert!(is_near(fit.a50.unwrap(), case.mu.exp(), 1e-8), "{name}: {fit:?}");
        assert!(is_near(fit.a90.unwrap(), case.a90, 1e-8), "{name}: {fit:?}");
        let (got, expected) = (fit.a90_95_likelihood.unwrap(), case.a90_95_likelihood);
        assert!(is_near(got, expected, 1e-8), "{name}: {got} {expected}");
        assert!(is_near(fit.pod(case.sizes[0]).unwrap(), case.first_pod, 1e-7), "{name}: {fit:?}");
        assert!(is_near(fit.pod_lower_95(case.sizes[0]).unwrap(), case.first_pod_lower, 1e-7), "{name}: {fit:?}");
        assert!((fit.pod(fit.a90.unwrap()).unwrap() - 0.9).abs() < 1e-10, "{name}");
        assert_eq!(fit.targets, case.sizes.len());
    }
}

#[test]
fn what_has_no_line_says_why() {
    // Catches a slope of one size, and a scatter of 0 that makes a step of the curve.
    let sizes = [1.0, 2.0, 3.0, 4.0, 5.0];
    let of = |responses: [f64; 5]| a_hat(&sizes, &responses, 2.0).unwrap_err();
    assert_eq!(a_hat(&sizes[..2], &[2.0, 3.0], 2.0).unwrap_err(), Refusal::TooFew("responses", 2, 3));
    assert_eq!(a_hat(&[], &[], 2.0).unwrap_err(), Refusal::TooFew("responses", 0, 3));
    assert_eq!(a_hat(&sizes, &[2.0; 4], 2.0).unwrap_err(), Refusal::Lengths("sizes", 5, "responses", 4));
    assert_eq!(a_hat(&[1.0, 0.0, 2.0], &[2.0; 3], 2.0).unwrap_err(), Refusal::Size(1, 0.0));
    for threshold in [f64::NAN, f64::INFINITY] {
        let error = a_hat(&sizes, &[1.5, 2.0, 3.0, 4.0, 4.5], threshold).unwrap_err();
        assert!(matches!(error, Refusal::OutOfRange("threshold", ..)), "{error:?}");
    }
    assert_eq!(of([1.5, f64::INFINITY, 3.0, 4.0, 4.5]), Refusal::Response(1, f64::INFINITY));
    assert_eq!(a_hat(&[2.0; 4], &[1.5, 2.0, 2.5, 3.0], 2.0).unwrap_err(), Refusal::OneSize(2.0));
    assert!(matches!(of([4.0, 3.5, 3.0, 2.2, 2.0]), Refusal::NotRising(slope) if slope < 0.0));
    assert_eq!(of([3.0; 5]), Refusal::NoScatter("responses"));
    let on_line = sizes.map(|size: f64| 1.0 + 2.0 * size.ln());
    assert_eq!(of(on_line), Refusal::NoScatter("responses about their line"));
}

#[test]
fn what_may_not_rise_has_no_bound() {
    // Catches a bound of data that a flat line fits about as well. By numpy the line loses 0.45 of log likelihood without
    // its slope, and a bound may lose 1.35.
    let fit = a_hat(&[1.0, 2.0, 3.0, 4.0, 5.0], &[2.0, 1.0, 3.0, 1.5, 3.2], 2.0).unwrap();
    assert!(fit.a90.is_some() && fit.a90_95_likelihood.is_none(), "{fit:?}");
}

proptest! {
    #[test]
    fn any_doubles_give_a_line_or_a_reason(
        targets in prop::collection::vec((any::<f64>(), any::<f64>()), 0..20),
        tame in prop::collection::vec((0.1_f64..9.0, -3.0_f64..9.0), 0..20),
        threshold in any::<f64>(),
    ) {
        // Catches NaN and infinity out of responses, sizes and thresholds that are none or too large.
        for targets in [&targets, &tame] {
            let (sizes, responses): (Vec<f64>, Vec<f64>) = targets.iter().map(|&(a, y)| (a.abs(), y)).unzip();
            for threshold in [2.0, threshold] {
                if let Ok(fit) = a_hat(&sizes, &responses, threshold) {
                    prop_assert!(fit.sigma > 0.0 && fit.sigma.is_finite() && !fit.mu.is_nan(), "{:?}", fit);
                    let numbers = [fit.a50, fit.a90, fit.a90_95_likelihood];
                    prop_assert!(numbers.into_iter().flatten().all(f64::is_normal), "{:?}", fit);
                }
            }
        }
    }
}

#[test]
fn the_likelihood_bound_holds_as_often_as_it_says() {
    // Catches a bound of the wrong side or level, whatever the formula: 2000 studies of 60 targets. Of 100 000 the bound
    // holds in 93.0 %, that of the delta method in 90.2 %; here are three standard deviations about the first.
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    // 0.2 + 0.9 ln(a90) - 1.2816 x 0.4 = ln(2).
    let a90 = ((2.0_f64.ln() - 0.2 + 0.4 * 1.281_551_565_544_600_4) / 0.9).exp();
    let (mut held, mut uneven) = (0, 0);
    for _ in 0..2000 {
        let sizes: Vec<f64> = (0..60).map(|_| rng.random_range(-0.7..2.0_f64).exp()).collect();
        let mut response = |size: &f64| {
            let noise: f64 = StandardNormal.sample(&mut rng);
            0.2 + 0.9 * size.ln() + 0.4 * noise
        };
        let responses: Vec<f64> = sizes.iter().map(&mut response).collect();
        let fit = a_hat(&sizes, &responses, 2.0_f64.ln()).unwrap();
        held += u32::from(fit.a90_95_likelihood.is_none_or(|bound| bound >= a90));
        uneven += u32::from(!fit.has_even_scatter);
    }
    assert!((1826..=1894).contains(&held), "{held} of 2000");
    // One in a hundred is taken to scatter unevenly by chance.
    assert!((4..=40).contains(&uneven), "{uneven} of 2000");
}

#[test]
fn scatter_that_grows_with_size_is_noticed() {
    // Catches a line over responses whose scatter grows, as those of an index do, that is taken for a good one.
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let mut noticed = 0;
    for _ in 0..200 {
        let sizes: Vec<f64> = (0..80).map(|_| rng.random_range(1.4..3.0_f64).exp()).collect();
        let mut response = |size: &f64| {
            let noise: f64 = StandardNormal.sample(&mut rng);
            size.ln() + 0.05 * size * noise
        };
        let responses: Vec<f64> = sizes.iter().map(&mut response).collect();
        noticed += u32::from(a_hat(&sizes, &responses, 2.0).is_ok_and(|fit| !fit.has_even_scatter));
    }
    assert!(noticed > 150, "{noticed} of 200");
}
