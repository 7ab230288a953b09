use super::*;
use tapline_model::{DampingLaw, EffectiveLength, Scene, table};

/// Figures over the factor N, and the table of the same quantity with its unit in SI.
const TABLES: [(u8, u8, f64); 8] = [
    (11, 4, 1.0),
    (12, 5, 1e-3),
    (13, 6, 1e-3),
    (16, 8, 1.0),
    (17, 9, 1e-3),
    (18, 10, 1e-3),
    (19, 11, 1e-2),
    (20, 11, 1e-2),
];

fn near(a: f64, b: f64, relative: f64) -> bool {
    (a / b - 1.0).abs() <= relative
}

/// The value at `x` of the curve `name` on `rung`.
fn at(number: u8, name: &str, rung: Rung, x: f64) -> f64 {
    let figure = figure(number).unwrap();
    let curve = figure.curves.iter().find(|c| c.name == name && c.rung == rung).unwrap();
    curve.points.iter().find(|p| near(p.x, x, 1e-12)).unwrap_or_else(|| panic!("no point at {x}")).y
}

/// Catches a figure that draws another quantity, factor or unit than its table: all rows of all tables.
#[test]
fn closed_curves_hold_the_tables() {
    let mut compared = 0;
    for (number, of_table, unit) in TABLES {
        let table = table(of_table, EffectiveLength::Published).unwrap();
        for curve in figure(number).unwrap().curves.iter().filter(|c| c.rung == Rung::Closed) {
            let column = table.columns.iter().position(|&c| c == curve.name).unwrap();
            for row in &table.rows {
                let point = curve.points.iter().find(|p| near(p.x, row[0], 1e-12)).unwrap();
                assert!(near(point.y, row[column] * unit, 1e-12), "Fig. {number} {} at {}", curve.name, row[0]);
                compared += 1;
            }
        }
    }
    assert_eq!(compared, 20 * (3 * 5 + 3 * 5 + 5 + 2));
}

/// Catches a dashed line that is not the rung that it is said to be, or is of another scene.
#[test]
fn other_curves_are_their_rungs() {
    let at_depth = |h_m: f64, l_m: f64| Scene { h_m, l_m, ..Scene::default() };
    for rung in [Rung::Plate, Rung::Full] {
        let of = |scene: Scene| rung.contact(&scene, DampingLaw::Exact).unwrap();
        let cases = [
            (16, "v_i", 2.0, of(Scene { velocity_m_per_s: 3.7, ..Scene::default() }).f_max_n),
            (17, "h", 0.5, of(at_depth(12.7e-3, 25.4e-3)).contact_time_s),
            (18, "l", 2.0, of(at_depth(25.4e-3, 50.8e-3)).d_max_m),
            (22, "h = 19.05 mm", 3.0, of(Scene { velocity_m_per_s: 3.0, ..at_depth(19.05e-3, 25.4e-3) }).f_max_n),
            (25, "l = 50.8 mm", 2.0, of(Scene { velocity_m_per_s: 2.0, ..at_depth(12.7e-3, 50.8e-3) }).contact_time_s),
            (26, "l = 50.8 mm", 12.7e-3, of(at_depth(12.7e-3, 50.8e-3)).f_max_n),
            (32, "h = 12.7 mm", 25.4e-3, of(Scene { m_2_kg: 2.47245, ..at_depth(12.7e-3, 25.4e-3) }).contact_time_s),
            (38, "h = 25.4 mm", 12.7e-3, of(at_depth(25.4e-3, 12.7e-3)).d_max_m),
        ];
        for (number, name, x, wanted) in cases {
            let drawn = at(number, name, rung, x);
            assert!(near(drawn, wanted, 1e-9), "Fig. {number} {name} {rung}: {drawn} for {wanted}");
        }
    }
    let damped =
        Rung::Integral.contact(&Scene { e_2_pa: 2.0 * 17.9e6, ..Scene::default() }, DampingLaw::Exact).unwrap();
    for (number, wanted) in [(11, damped.f_max_n), (12, damped.contact_time_s), (13, damped.d_max_m)] {
        assert!(near(at(number, "e_2", Rung::Integral, 2.0), wanted, 1e-9), "Fig. {number}");
    }
}

/// Catches a block of the wrong mass: the closed form of Fig. 31 without a crack is that of 2.47 kg.
#[test]
fn the_long_block_is_half_as_heavy_again() {
    let scene =
        Scene { m_2_kg: 1143.0 * 50.8e-3 * 279.4e-3 * 152.4e-3, h_m: 12.7e-3, l_m: 25.4e-3, ..Scene::default() };
    let wanted = Rung::Closed.contact(&scene, DampingLaw::Exact).unwrap().f_max_n;
    assert!(near(at(31, "h = 12.7 mm", Rung::Closed, 25.4e-3), wanted, 1e-6));
}

/// Catches a figure that is missing, has gaps, runs backwards, is negative, or mixes its curves.
#[test]
fn figures_are_whole() {
    for number in Figure::NUMBERS {
        let figure = figure(number).unwrap();
        assert_eq!(figure.number, number);
        assert!(figure.curves.len() >= 4, "Fig. {number}");
        let names: Vec<&str> = figure.curves.iter().map(|c| c.name).collect();
        let mut grouped = names.clone();
        grouped.dedup();
        let firsts = grouped.iter().map(|name| figure.curves.iter().find(|c| c.name == *name).unwrap().rung);
        assert!(firsts.into_iter().all(|rung| rung == Rung::Closed), "Fig. {number}: {names:?}");
        grouped.sort_unstable();
        assert!(grouped.windows(2).all(|pair| pair[0] != pair[1]), "Fig. {number}: {names:?}");
        for curve in &figure.curves {
            assert!(curve.points.windows(2).all(|pair| pair[0].x < pair[1].x), "Fig. {number}");
            assert!(curve.points.iter().all(|p| p.y.is_finite() && p.y >= 0.0), "Fig. {number} {}", curve.name);
        }
    }
    for number in [0, 10, 14, 21, 28, 35, 39, 255] {
        assert!(
            figure(number).is_err_and(|error| error.to_string().starts_with(&format!("there is no figure {number};")))
        );
    }
}

/// Catches a share of energy above 1, a loss without bending, and a domain put on its head.
#[test]
fn losses_and_domains_make_sense() {
    for number in [19, 20] {
        for curve in figure(number).unwrap().curves {
            assert!(curve.points.iter().all(|p| p.y < 1.0), "Fig. {number} {}", curve.name);
        }
    }
    // A layer of twice the baseline's depth hardly bends, and by Eq. 3 next to nothing is lost.
    assert!(at(20, "h", Rung::Plate, 2.0) < 1e-3 && at(20, "h", Rung::Plate, 0.1) > 0.5);
    for (rung, h_per_l) in [(Rung::Plate, 0.2), (Rung::Full, 0.5)] {
        for curve in figure(26).unwrap().curves.into_iter().filter(|c| c.rung == rung && c.name == "l = 25.4 mm") {
            assert!(curve.points.iter().all(|p| p.in_domain == (p.x / 25.4e-3 <= h_per_l)), "{rung}");
        }
    }
}
