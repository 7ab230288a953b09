use super::*;

/// V, e, h, l, and F_max, contact time, d_max, restitution.
type Row = (f64, f64, f64, f64, [f64; 4]);

/// The full rung (tests/full_reference.py 16).
const FULL: [Row; 16] = [
    (1.426, 0.91, 0.002408, 0.047843, [1.209467715e+01, 4.768385768e-03, 1.919564405e-03, 5.548271275e-01]),
    (0.986, 0.489, 0.022718, 0.025186, [1.272475619e+01, 1.187502772e-03, 2.806807677e-04, 5.465825232e-01]),
    (1.509, 0.172, 0.017806, 0.030602, [2.564832332e+01, 8.694435465e-04, 3.232339564e-04, 3.160638496e-01]),
    (1.025, 0.781, 0.004059, 0.027047, [7.159568693e+00, 2.746672109e-03, 6.640587618e-04, 6.349238987e-01]),
    (0.595, 0.472, 0.002926, 0.019017, [2.757271880e+00, 3.098417976e-03, 4.785391201e-04, 7.238356827e-01]),
    (1.951, 0.374, 0.007378, 0.049191, [2.518887086e+01, 2.319904960e-03, 6.642870021e-04, 4.091457468e-01]),
    (2.416, 0.73, 0.008869, 0.019629, [2.619940784e+01, 1.190225914e-03, 7.548036154e-04, 7.422243406e-01]),
    (0.653, 0.926, 0.008166, 0.012866, [7.413443519e+00, 1.295711236e-03, 2.652051265e-04, 9.021237576e-01]),
    (1.672, 0.771, 0.011226, 0.046527, [2.164032450e+01, 1.191399869e-03, 5.075410136e-04, 3.681993193e-01]),
    (0.387, 0.573, 0.006778, 0.010619, [3.924001119e+00, 1.470073008e-03, 1.578975812e-04, 6.848957372e-01]),
    (1.711, 0.832, 0.01051, 0.018924, [1.989911694e+01, 1.141152428e-03, 5.545399873e-04, 8.050626815e-01]),
    (2.148, 0.558, 0.008028, 0.039627, [2.560618047e+01, 1.849476116e-03, 6.704131728e-04, 4.937662391e-01]),
    (0.625, 0.806, 0.01414, 0.041058, [7.081840159e+00, 1.355572839e-03, 2.289173286e-04, 6.601132873e-01]),
    (0.722, 0.792, 0.002811, 0.011425, [4.272768474e+00, 2.211340916e-03, 4.608801584e-04, 8.302932643e-01]),
    (2.181, 0.839, 0.026669, 0.02782, [3.446245659e+01, 9.576051634e-04, 6.180914057e-04, 7.978303992e-01]),
    (0.903, 0.156, 0.012499, 0.038236, [1.368608576e+01, 1.215624974e-03, 2.316885615e-04, 3.409036968e-01]),
];

fn scene(&(velocity_m_per_s, restitution, h_m, l_m, _): &Row) -> Scene {
    Scene { velocity_m_per_s, restitution, h_m, l_m, ..Scene::default() }
}

/// Catches a wrong shear factor, membrane, damping of the softened layer, or a further contact that is not counted.
#[test]
fn full_rung_agrees_with_scipy() {
    for row in &FULL {
        let contact = Rung::Full.contact(&scene(row), DampingLaw::Exact).unwrap();
        for (got, wanted) in contact.quantities().into_iter().zip(row.4) {
            assert!((got / wanted - 1.0).abs() < 1e-6, "{contact:?} for {row:?}");
        }
    }
}

/// Catches a table scaled by the wrong mass, length or time: the table must agree with its own equation.
#[test]
fn integral_table_is_the_equation_of_motion() {
    for row in &FULL {
        let scene = Scene { m_1_kg: 0.02, m_2_kg: 0.3, ..scene(row) };
        let contact = Rung::Integral.contact(&scene, DampingLaw::Exact).unwrap();
        let outcome = Impact::integral(&scene).unwrap().outcome().unwrap();
        let twin = Contact::from_outcome(Rung::Integral, DampingLaw::Exact, &scene, &outcome);
        assert!(contact.error_against(&twin) < 1e-7, "{contact:?} {twin:?}");
    }
}

/// Catches a law that is not passed on: for e = 0.5, Lankarani's gives 0.725 and less damping.
#[test]
fn the_law_is_used_on_every_damped_rung() {
    let law = DampingLaw::LankaraniNikravesh;
    let scene = Scene { h_m: 0.5, l_m: 0.1, ..Scene::default() };
    for rung in [Rung::Integral, Rung::Plate, Rung::Full] {
        let (exact, other) = (rung.contact(&scene, DampingLaw::Exact).unwrap(), rung.contact(&scene, law).unwrap());
        assert_eq!((exact.rung, other.rung), (rung, rung));
        assert!((exact.restitution - 0.5).abs() < 0.02 && (other.restitution - 0.725).abs() < 0.02, "{other:?}");
        assert!(other.f_max_n < exact.f_max_n, "{other:?} {exact:?}");
        assert!(other.flags.raised().any(|check| check.name == "restitution"));
    }
}

/// Catches a closed form other than that of the tables, and its tau presented as Hertz's time.
#[test]
fn closed_rung_is_that_of_the_tables() {
    let contact = Rung::Closed.contact(&Scene::default(), DampingLaw::Exact).unwrap();
    assert!((contact.f_max_n / 33.650_495 - 1.0).abs() < 1e-6);
    assert!((contact.contact_time_s / 0.777_217_7e-3 - 1.0).abs() < 1e-6);
    assert!((contact.d_max_m / 0.569_934_7e-3 - 1.0).abs() < 1e-6);
    assert!((contact.restitution - 1.0).abs() < 1e-15);
}

/// Catches rungs that are not in the order of their cost, and wrong names.
#[test]
fn rungs_know_themselves() {
    assert!(Rung::ALL.is_sorted());
    assert_eq!(Rung::ALL.map(Rung::name), ["closed", "integral", "plate", "full"]);
    for rung in Rung::ALL {
        assert_eq!(rung.contact(&Scene::default(), DampingLaw::Exact).unwrap().rung, rung);
    }
}

/// Catches a rung that accepts a meaningless scene, or names the wrong quantity.
#[test]
fn every_rung_refuses_what_means_nothing() {
    type Field = fn(&mut Scene) -> &mut f64;
    let fields: [(&str, Field); 7] = [
        ("velocity_m_per_s", |s| &mut s.velocity_m_per_s),
        ("m_1_kg", |s| &mut s.m_1_kg),
        ("m_2_kg", |s| &mut s.m_2_kg),
        ("e_2_pa", |s| &mut s.e_2_pa),
        ("h_m", |s| &mut s.h_m),
        ("l_m", |s| &mut s.l_m),
        ("restitution", |s| &mut s.restitution),
    ];
    for (name, field) in fields {
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let mut scene = Scene::default();
            *field(&mut scene) = bad;
            for rung in Rung::ALL {
                let refused = rung.contact(&scene, DampingLaw::Exact);
                assert!(
                    matches!(refused, Err(Error::OutOfRange { name: n, .. }) if n == name),
                    "{name} = {bad}: {refused:?}"
                );
            }
        }
    }
}
