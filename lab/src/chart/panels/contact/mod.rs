//! The rungs of the contact model: what a contact costs, and how far it is from the equations solved in small steps.

mod small_steps;

use anyhow::{Context as _, Result};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use tapline_draw::stats::quantile;
use tapline_model::{DampedContact, DampingLaw, Impact, Rung, Scene};

use self::small_steps::Solved;
use crate::chart::Bench;
use crate::chart::cost::{Workload, by_turns};
use crate::chart::front::Tolerance;
use crate::chart::panel::{Facet, Panel, Quantity};
use crate::chart::point::{Cost, Error, Failure, Point, exceeds};

/// The simulated rig's own tolerance: a layer that changes less is left out.
const RIG_TOLERANCE: f64 = 1e-3;

/// The quantile of a seed's errors that is shown: nine in ten contacts have less.
const SHARE: f64 = 0.9;

/// Which contacts are drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Layers {
    /// Over cracks 2 to 12 mm deep.
    Shallow,
    /// As in casings: layers of 4 to 250 mm, mostly thick, because most places are sound.
    Any,
}

impl Layers {
    fn scenes(self, seed: u64, count: usize) -> Vec<Scene> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(self as u64);
        let mut scene = || {
            let (u, l, v): (f64, f64, f64) = (rng.random(), rng.random(), rng.random());
            let h_m = match self {
                Self::Shallow => 2e-3 * 6.0_f64.powf(u),
                Self::Any => 4e-3 * 62.0_f64.powf(u.sqrt()),
            };
            Scene { h_m, l_m: 0.018 + 0.008 * l, velocity_m_per_s: 1.0 + v, ..Scene::default() }
        };
        (0..count).map(|_| scene()).collect()
    }
}

/// Peak force, contact time, deepest position and restitution; NaN where the model has none.
fn quantities(rung: Rung, scene: &Scene) -> [f64; 4] {
    let contact = rung.contact(scene, DampingLaw::Exact);
    contact.map_or([f64::NAN; 4], |c| [c.f_max_n, c.contact_time_s, c.d_max_m, c.restitution])
}

/// The largest relative error of `found`; infinite where a number is missing.
fn error<const N: usize>(found: [f64; N], truth: [f64; N]) -> f64 {
    let each = found.iter().zip(truth).map(|(x, truth)| (x / truth - 1.0).abs());
    each.map(|error| if error.is_nan() { f64::INFINITY } else { error }).max_by(f64::total_cmp).unwrap_or(f64::NAN)
}

pub(super) fn measure(bench: &Bench) -> Result<Panel> {
    let facets = vec![
        ladder(bench, Layers::Shallow, "cracks", "Over cracks 2 to 12 mm deep")?,
        ladder(bench, Layers::Any, "places", "At places as casings have them, most of them sound")?,
        histories(bench)?,
    ];
    Ok(Panel::new(
        "How much of the contact must be modelled?",
        "A contact can be computed from a closed form, from a table, or from an equation of motion with more or less in it. \
         Which is enough for a scene?",
        [
            "The error is the largest relative difference in peak force, contact time, deepest position and restitution; nine \
             in ten contacts have less. The closed form has no damping, so that its restitution is 1 where 0.5 is meant: that \
             is most of its error.",
            "The simulated rig needs the whole course of the force. It leaves out a layer that is known to change nothing by \
             more than 0.001, which is its default.",
        ],
        facets,
    ))
}

/// For each of `models` its error in each seed: the quantile over `places`. `truth` is what a model should find in a scene.
fn errors<M: Copy, const N: usize>(
    bench: &Bench,
    places: Layers,
    models: &[M],
    truth: impl Fn(&Scene) -> Result<[f64; N]>,
    found: impl Fn(M, &Scene) -> [f64; N],
) -> Result<Vec<Vec<f64>>> {
    let mut by_seed = vec![Vec::new(); models.len()];
    for seed in bench.seeds() {
        let scenes = places.scenes(seed, bench.size.contacts);
        let truths: Vec<[f64; N]> = scenes.iter().map(&truth).collect::<Result<_>>()?;
        for (&model, by_seed) in models.iter().zip(&mut by_seed) {
            let errors = scenes.iter().zip(&truths).map(|(scene, truth)| error(found(model, scene), *truth));
            by_seed.push(quantile(&errors.collect::<Vec<_>>(), SHARE).context("there are contacts")?);
        }
    }
    Ok(by_seed)
}

fn ladder(bench: &Bench, places: Layers, name: &str, title: &str) -> Result<Facet> {
    let size = &bench.size;
    let truth = |scene: &Scene| Ok(Solved::new(&Impact::full(scene)?).quantities());
    let by_seed = errors(bench, places, &Rung::ALL, truth, quantities)?;
    let scenes = places.scenes(bench.seed, size.taps);
    let each = |rung: Rung| Workload::each(&scenes, move |scene| quantities(rung, scene)[0]);
    let costs = by_turns(Rung::ALL.map(each).into(), size.rounds);
    let points = Rung::ALL.into_iter().zip(costs).zip(by_seed).map(|((rung, cost), by_seed)| {
        let n = size.contacts * size.seed_count as usize;
        let name = format!("the {} rung", rung.name());
        let label = if rung == Rung::Closed { "closed form" } else { rung.name() };
        Ok(Point::new(name, label, cost, Error::mean_of(by_seed), n).failing(failures(rung)?))
    });
    Ok(Facet {
        cost: Quantity::log("Processor time of a contact", "\u{b5}s"),
        error: Quantity::log("Largest relative error, nine in ten contacts", ""),
        tolerance: Tolerance { cost: 0.15, error: 1e-3 },
        truth: "the equations of the full rung, solved in small steps of equal length by another program text"
            .to_owned(),
        families: vec!["rungs"],
        points: points.collect::<Result<_>>()?,
        ..bench.facet(name, title)
    })
}

/// What `rung` fails where models end.
fn failures(rung: Rung) -> Result<Vec<Failure>> {
    let film = Scene { h_m: 1e-3, ..Scene::default() };
    let truth = Solved::new(&Impact::full(&film)?).quantities()[0];
    let thin = (quantities(rung, &film)[0] / truth - 1.0).abs();
    let damped = Scene { h_m: 80e-3, l_m: 20e-3, restitution: 0.3, ..Scene::default() };
    let truth = Solved::new(&Impact::full(&damped)?).quantities()[3];
    let returned = (quantities(rung, &damped)[3] / truth - 1.0).abs();
    Ok([
        exceeds("C29: peak force over a crack 1 mm deep, relative error", thin, 0.25),
        exceeds("C33: restitution where 0.3 is asked for, relative error", returned, 0.25),
    ]
    .into_iter()
    .flatten()
    .collect())
}

/// How the simulated rig decides which layers it leaves out.
#[derive(Debug, Clone, Copy, PartialEq)]
enum LayerRule {
    /// It computes every layer.
    Every,
    /// It leaves out layers known to change nothing by more.
    Within(f64),
    /// It leaves out all.
    None,
}

const RULES: [LayerRule; 6] = [
    LayerRule::Every,
    LayerRule::Within(1e-4),
    LayerRule::Within(RIG_TOLERANCE),
    LayerRule::Within(1e-2),
    LayerRule::Within(1e-1),
    LayerRule::None,
];

impl LayerRule {
    fn label(self) -> String {
        match self {
            Self::Every => "every layer".to_owned(),
            Self::Within(tolerance) => format!("within {tolerance}"),
            Self::None => "no layer".to_owned(),
        }
    }

    fn name(self) -> String {
        match self {
            Self::Every => "every layer is computed".to_owned(),
            Self::Within(tolerance) => format!("layers that change nothing by more than {tolerance} are left out"),
            Self::None => "no layer is computed".to_owned(),
        }
    }

    fn applied(self, impact: Impact, rigid: &DampedContact, loss_tangent: f64) -> Impact {
        match self {
            Self::Every => impact,
            Self::Within(tolerance) => impact.without_rigid_layer(rigid, loss_tangent, tolerance),
            Self::None => Impact { plate: None, ..impact },
        }
    }

    /// The course of the force in N and its step in s.
    fn history(self, scene: &Scene, rigid: &DampedContact, force_n: &mut Vec<f64>) -> f64 {
        let impact = Impact::plate(scene).map(|impact| self.applied(impact, rigid, scene.loss_tangent()));
        impact.map_or(f64::NAN, |impact| impact.force_history(force_n))
    }
}

fn histories(bench: &Bench) -> Result<Facet> {
    let size = &bench.size;
    let rigid = DampedContact::new(DampingLaw::Exact.chi(Scene::default().restitution)?)?;
    // Peak and impulse.
    let found = |rule: LayerRule, scene: &Scene| {
        let mut force_n = Vec::new();
        let step_s = rule.history(scene, &rigid, &mut force_n);
        let peak_n = force_n.iter().copied().max_by(f64::total_cmp).unwrap_or(f64::NAN);
        [peak_n, force_n.iter().sum::<f64>() * step_s]
    };
    let truth = |scene: &Scene| {
        let [f_max_n, ..] = Solved::new(&Impact::plate(scene)?).quantities();
        Ok([f_max_n, found(LayerRule::Every, scene)[1]])
    };
    let by_seed = errors(bench, Layers::Any, &RULES, truth, found)?;
    let scenes = Layers::Any.scenes(bench.seed, size.taps);
    let each = |rule: LayerRule| {
        let (mut force_n, rigid) = (Vec::new(), &rigid);
        Workload::each(&scenes, move |scene| rule.history(scene, rigid, &mut force_n))
    };
    let costs = by_turns(RULES.map(each).into(), size.rounds);
    let point = |((rule, cost), by_seed): ((LayerRule, Cost), Vec<f64>)| {
        let n = size.contacts * size.seed_count as usize;
        Point::new(rule.name(), rule.label(), cost, Error::mean_of(by_seed), n)
            .default_if(rule == LayerRule::Within(RIG_TOLERANCE))
    };
    Ok(Facet {
        cost: Quantity::log("Processor time of a contact", "\u{b5}s"),
        error: Quantity::log("Relative error of peak or impulse, nine in ten contacts", ""),
        tolerance: Tolerance { cost: 0.15, error: RIG_TOLERANCE },
        truth: "the peak by small steps, and the impulse with every layer".to_owned(),
        families: vec!["layers left out"],
        points: RULES.into_iter().zip(costs).zip(by_seed).map(point).collect(),
        ..bench.facet("history", "The course of the force, as the simulated rig needs it")
    })
}
