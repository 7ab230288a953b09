//! Gauge studies.

use proptest::prelude::*;
use tapline_lab::statistics::{Crossed, Refusal, crossed, one_way};

use super::is_near;
use super::reference::{CROSSED, CROSSED_ANOVA};

/// Ten parts, three readings each by appraisers A, B and C: the worked example of AIAG, Measurement Systems Analysis,
/// 4th edition (2010), chapter III B, and of Minitab's "Example of a crossed gage R&R study" (support.minitab.com).
#[rustfmt::skip]
pub(crate) const AIAG: [[f64; 9]; 10] = [
    [0.29, 0.41, 0.64, 0.08, 0.25, 0.07, 0.04, -0.11, -0.15],
    [-0.56, -0.68, -0.58, -0.47, -1.22, -0.68, -1.38, -1.13, -0.96],
    [1.34, 1.17, 1.27, 1.19, 0.94, 1.34, 0.88, 1.09, 0.67],
    [0.47, 0.50, 0.64, 0.01, 1.03, 0.20, 0.14, 0.20, 0.11],
    [-0.80, -0.92, -0.84, -0.56, -1.20, -1.28, -1.46, -1.07, -1.45],
    [0.02, -0.11, -0.21, -0.20, 0.22, 0.06, -0.29, -0.67, -0.49],
    [0.59, 0.75, 0.66, 0.47, 0.55, 0.83, 0.02, 0.01, 0.21],
    [-0.31, -0.20, -0.17, -0.63, 0.08, -0.34, -0.46, -0.56, -0.49],
    [2.26, 1.99, 2.01, 1.80, 2.12, 2.19, 1.77, 1.45, 1.87],
    [-1.36, -1.25, -1.31, -1.68, -1.62, -1.50, -1.49, -1.77, -2.16],
];

const AIAG_STUDY: Crossed = Crossed { part_count: 10, operator_count: 3, repeat_count: 3 };

fn aiag() -> Vec<Option<f64>> {
    AIAG.as_flattened().iter().copied().map(Some).collect()
}

/// Whether `got` is what is printed with so many digits after the point.
fn is_printed(got: f64, printed: f64, digits: i32) -> bool {
    (got - printed).abs() <= 0.500_001 * 10_f64.powi(-digits)
}

#[test]
fn the_published_example_comes_out() {
    // Catches any slip of the method: degrees of freedom, what the operators are tested against, pooling, a variance
    // for a standard deviation, the categories rounded up (4.86 is 4).
    let gauge = crossed(&aiag(), AIAG_STUDY).unwrap();
    for (row, degrees, sum, mean) in [
        (gauge.parts, 9, 88.3619, 9.81799),
        (gauge.operators, 2, 3.1673, 1.58363),
        (gauge.interaction, 18, 0.3590, 0.01994),
        (gauge.repeats, 60, 2.7589, 0.04598),
        (gauge.error, 78, 3.1179, 0.03997),
    ] {
        assert_eq!(row.degrees, degrees);
        assert!(is_printed(row.sum_of_squares, sum, 4) && is_printed(row.mean_square, mean, 5), "{row:?}");
    }
    // F of Minitab's tables: with the interaction, then without.
    for (row, error, ratio) in [
        (gauge.parts, gauge.interaction, 492.291),
        (gauge.operators, gauge.interaction, 79.406),
        (gauge.interaction, gauge.repeats, 0.434),
        (gauge.parts, gauge.error, 245.614),
        (gauge.operators, gauge.error, 39.617),
    ] {
        assert!(is_printed(row.f_test(&error).unwrap().0, ratio, 3), "{row:?}");
    }
    assert!(is_printed(gauge.interaction_p.unwrap(), 0.974, 3) && gauge.is_pooled);
    // AIAG's standard deviations with their digits; that of the whole gauge is Minitab's, since AIAG's own does not
    // follow from its parts. Variances and per cents are Minitab's.
    for (component, (sd, digits), variance, contribution, study) in [
        (gauge.repeatability, (0.199_933, 6), 0.03997, 3.39, 18.42),
        (gauge.reproducibility, (0.226_838, 6), 0.05146, 4.37, 20.90),
        (gauge.operator, (0.226_838, 6), 0.05146, 4.37, 20.90),
        (gauge.gauge, (0.30237, 5), 0.09143, 7.76, 27.86),
        (gauge.part, (1.042_327, 6), 1.08645, 92.24, 96.04),
    ] {
        assert!(is_printed(component.sd, sd, digits), "{component:?}");
        assert!(is_printed(component.variance, variance, 5), "{component:?}");
        assert!(is_printed(component.contribution_percent, contribution, 2), "{component:?}");
        assert!(is_printed(component.study_percent, study, 2), "{component:?}");
    }
    assert!(is_printed(gauge.total.sd, 1.085, 3) && is_printed(gauge.total.variance, 1.17788, 5));
    assert_eq!(gauge.ndc, Some(4));
    assert_eq!(gauge.by_part.variance.to_bits(), 0.0_f64.to_bits());
}

#[test]
fn an_interaction_that_is_one_stays() {
    // Catches pooling whatever the chance, and operators told against the repeats alone. Sums and p are statsmodels'.
    let readings: Vec<Option<f64>> = CROSSED.iter().copied().map(Some).collect();
    let gauge = crossed(&readings, Crossed { part_count: 6, operator_count: 3, repeat_count: 2 }).unwrap();
    let sums = [gauge.parts, gauge.operators, gauge.interaction, gauge.repeats].map(|row| row.sum_of_squares);
    for (got, expected) in sums.iter().zip(CROSSED_ANOVA) {
        assert!(is_near(*got, expected, 1e-10), "{got} {expected}");
    }
    assert!(is_near(gauge.interaction.f_test(&gauge.repeats).unwrap().0, CROSSED_ANOVA[4], 1e-10));
    assert!(is_near(gauge.interaction_p.unwrap(), CROSSED_ANOVA[5], 1e-8) && !gauge.is_pooled);
    let mean_squares = [sums[0] / 5.0, sums[1] / 2.0, sums[2] / 10.0, sums[3] / 18.0];
    let by_part = (mean_squares[2] - mean_squares[3]) / 2.0;
    let operator = ((mean_squares[1] - mean_squares[2]) / 12.0).clamp(0.0, f64::MAX);
    assert!(is_near(gauge.by_part.variance, by_part, 1e-12));
    assert!(is_near(gauge.reproducibility.variance, by_part + operator, 1e-12));
    assert!(is_near(gauge.repeatability.variance, mean_squares[3], 1e-12));
    assert!(is_near(gauge.part.variance, (mean_squares[0] - mean_squares[2]) / 6.0, 1e-12));
}

#[test]
fn a_hole_is_named() {
    // Catches a design with a hole that is judged all the same, or one named by the wrong place.
    let mut readings = aiag();
    let place = (4 * 3 + 2) * 3 + 1;
    let hole = Refusal::Incomplete(4, 2, 1);
    for missing in [None, Some(f64::NAN), Some(f64::INFINITY)] {
        readings[place] = missing;
        assert_eq!(crossed(&readings, AIAG_STUDY).unwrap_err(), hole);
    }
    let of = |change: fn(&mut Crossed)| {
        let mut study = AIAG_STUDY;
        change(&mut study);
        crossed(&aiag(), study).unwrap_err()
    };
    assert!(matches!(of(|study| study.part_count = 9), Refusal::Lengths(_, 90, _, 81)));
    assert_eq!(of(|study| study.part_count = 1), Refusal::TooFew("parts", 1, 2));
    assert_eq!(of(|study| study.operator_count = 1), Refusal::TooFew("operators", 1, 2));
    assert_eq!(of(|study| study.repeat_count = 1), Refusal::TooFew("repeats", 1, 2));
    assert!(matches!(of(|study| study.part_count = usize::MAX), Refusal::Lengths(..)));
    assert_eq!(crossed(&[Some(0.1); 90], AIAG_STUDY).unwrap_err(), Refusal::NoScatter("readings"));
    assert!(matches!(one_way(&aiag()[..3], 2).unwrap_err(), Refusal::TooFew("repeats", 1, _)));
    assert!(matches!(one_way(&aiag()[..5], 2).unwrap_err(), Refusal::Lengths(_, 5, _, 4)));
}

#[test]
fn a_perfect_gauge_has_no_count_of_categories() {
    // Catches a division by zero that comes out as a very fine gauge, and rounding of equal readings taken for scatter.
    let readings: Vec<Option<f64>> = (0..18).map(|place| Some(0.1 + f64::from(place / 6) / 3.0)).collect();
    let gauge = crossed(&readings, Crossed { part_count: 3, operator_count: 2, repeat_count: 3 }).unwrap();
    assert_eq!((gauge.ndc, gauge.interaction_p), (None, None), "{gauge:?}");
    assert!(is_near(gauge.part.contribution_percent, 100.0, 1e-12), "{gauge:?}");
    assert_eq!(one_way(&readings, 3).unwrap().ndc, None);
}

#[test]
fn agreement_is_that_of_shrout_and_fleiss() {
    // Catches the forms exchanged. Six targets, four judges: Tables 2 to 4 of Psychological Bulletin 86 (1979) 420.
    let ratings = [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]];
    let readings: Vec<Option<f64>> = ratings.as_flattened().iter().map(|&rating| Some(f64::from(rating))).collect();
    let study = one_way(&readings, 6).unwrap();
    assert!(is_printed(study.parts.mean_square, 11.24, 2) && is_printed(study.repeats.mean_square, 6.26, 2));
    assert!(is_near(study.part.variance, (study.parts.mean_square - study.repeats.mean_square) / 4.0, 1e-12));
    // ICC(1,1) is the part's share of the variance.
    assert!(is_printed(0.01 * study.part.contribution_percent, 0.17, 2));
    assert_eq!(study.ndc, Some(0), "1.41 x sqrt(1.24/6.26) is 0.63");
}

proptest! {
    #[test]
    fn any_doubles_give_a_gauge_or_a_reason(
        readings in prop::collection::vec(prop::option::weighted(0.99, any::<f64>()), 12..13),
        tame in prop::collection::vec(-5.0_f64..5.0, 12..13),
    ) {
        // Catches NaN out of readings that overflow, and shares that do not add up.
        let tame: Vec<Option<f64>> = tame.into_iter().map(Some).collect();
        for readings in [readings, tame] {
            if let Ok(gauge) = crossed(&readings, Crossed { part_count: 3, operator_count: 2, repeat_count: 2 }) {
                let shares = [gauge.repeatability, gauge.operator, gauge.by_part, gauge.part];
                let shares: f64 = shares.iter().map(|component| component.contribution_percent).sum();
                prop_assert!((shares - 100.0).abs() < 1e-9 || shares == 0.0, "{:?}", gauge);
                prop_assert!(gauge.interaction_p.is_none_or(|p| (0.0..=1.0).contains(&p)), "{:?}", gauge);
            }
            if let Ok(study) = one_way(&readings, 3) {
                prop_assert!(study.total.variance.is_finite());
            }
        }
    }
}
