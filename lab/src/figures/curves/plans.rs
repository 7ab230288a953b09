//! Which scenes each figure of the dissertation draws.

use super::quantity::Subject::{self, Cracked, Sound};
use super::quantity::{DEFORMATION, DURATION, FORCE, LOCAL, LOSS, Quantity};
use super::{Axis, Point};
use tapline_model::{Error, Rung, Scene};
use tapline_model::{FACTORS, Field};

/// A figure before it is computed.
pub(super) struct Plan {
    pub title: &'static str,
    pub x: Abscissa,
    pub y: Axis,
    pub families: Vec<Family>,
}

/// Curves that differ in their rung only.
pub(super) struct Family {
    pub(super) name: &'static str,
    pub(super) subject: Subject,
    quantity: Quantity,
    scene: Scene,
    /// What the abscissa varies.
    field: Field,
}

/// What is varied, and how far.
#[derive(Debug, Clone, Copy)]
pub(super) enum Abscissa {
    /// Factor N on one quantity of the baseline, 0.1 to 2 as in the tables.
    Factor,
    /// Impact velocity, up to 10 m/s: the text reads 8 m/s off Fig. 22.
    Velocity,
    /// Depth of the crack, from a tenth of the baseline's to twice that.
    Depth,
    /// Length of the crack, up to where it is as long as the block is wide: there Table 1 ends.
    Length,
}

impl Abscissa {
    pub(super) fn axis(self) -> Axis {
        match self {
            Self::Factor => Axis { name: "factor", label: "Factor N upon the baseline", unit: "", per_si: 1.0 },
            Self::Velocity => Axis { name: "v_m_per_s", label: "Impact velocity V", unit: "m/s", per_si: 1.0 },
            Self::Depth => Axis { name: "h_m", label: "Depth of the crack h", unit: "mm", per_si: 1e3 },
            Self::Length => Axis { name: "l_m", label: "Length of the crack l", unit: "mm", per_si: 1e3 },
        }
    }

    /// Its values, quotients of whole numbers: the tables' factors and the samples' cracks are met exactly.
    pub(super) fn values(self) -> impl Iterator<Item = f64> {
        let (first, last, step, per_unit) = match self {
            Self::Factor => (100, 2000, 25, 1e3),
            Self::Velocity => (200, 10_000, 100, 1e3),
            Self::Depth => (2540, 50_800, 635, 1e6),
            Self::Length => (635, 50_800, 635, 1e6),
        };
        (first..=last).step_by(step).map(move |n: i32| f64::from(n) / per_unit)
    }
}

impl Family {
    pub(super) fn point(&self, abscissa: Abscissa, rung: Rung, x: f64) -> Result<Point, Error> {
        let mut scene = self.scene;
        let field = (self.field)(&mut scene);
        *field = if matches!(abscissa, Abscissa::Factor) { *field * x } else { x };
        let y = self.subject.value(self.quantity, rung, &scene)?;
        Ok(Point { x, y, in_domain: self.subject.is_in_domain(rung, &scene) })
    }
}

/// Figure `number`, if the dissertation has it.
pub(super) fn plan(number: u8) -> Option<Plan> {
    let (title, x, y, families) = match number {
        11 => ("Peak force without a crack", Abscissa::Factor, FORCE, factors(Sound, Quantity::Force, &INTEGRAL)),
        12 => ("Duration without a crack", Abscissa::Factor, DURATION, factors(Sound, Quantity::Duration, &INTEGRAL)),
        13 => ("Deformation without a crack", Abscissa::Factor, LOCAL, factors(Sound, Quantity::Local, &INTEGRAL)),
        16 => ("Peak force over a crack", Abscissa::Factor, FORCE, factors(Cracked, Quantity::Force, &DEFECT)),
        17 => ("Duration over a crack", Abscissa::Factor, DURATION, factors(Cracked, Quantity::Duration, &DEFECT)),
        18 => {
            let families = factors(Cracked, Quantity::Deformation, &DEFECT);
            ("Deformation over a crack", Abscissa::Factor, DEFORMATION, families)
        }
        19 => ("Loss to bending, by the impact", Abscissa::Factor, LOSS, factors(Cracked, Quantity::Loss, &INTEGRAL)),
        20 => ("Loss to bending, by the crack", Abscissa::Factor, LOSS, factors(Cracked, Quantity::Loss, &["h", "l"])),
        22 => ("Peak force, l = 25.4 mm", Abscissa::Velocity, FORCE, depths(Quantity::Force)),
        23 => ("Duration, l = 25.4 mm", Abscissa::Velocity, DURATION, depths(Quantity::Duration)),
        24 => ("Peak force, h = 12.7 mm", Abscissa::Velocity, FORCE, lengths(Quantity::Force)),
        25 => ("Duration, h = 12.7 mm", Abscissa::Velocity, DURATION, lengths(Quantity::Duration)),
        26 => ("Peak force by depth", Abscissa::Depth, FORCE, over_depth(Quantity::Force)),
        27 => ("Duration by depth", Abscissa::Depth, DURATION, over_depth(Quantity::Duration)),
        31 => ("Peak force by length, 152.4 mm block", Abscissa::Length, FORCE, long_block(Quantity::Force)),
        32 => ("Duration by length, 152.4 mm block", Abscissa::Length, DURATION, long_block(Quantity::Duration)),
        36 => ("Parts of the deformation, l = 25.4 mm", Abscissa::Depth, DEFORMATION, parts()),
        37 => ("Deformation by depth", Abscissa::Depth, DEFORMATION, over_depth(Quantity::Deformation)),
        38 => {
            let families = over_length(&[DEEPEST, DEEP, SHALLOW], Quantity::Deformation, Scene::default());
            ("Deformation by length", Abscissa::Length, DEFORMATION, families)
        }
        _ => return None,
    };
    Some(Plan { title, x, y, families })
}

/// Factors of the model without a crack.
const INTEGRAL: [&str; 5] = ["v_i", "m_1", "m_2", "e_1", "e_2"];
/// Factors of Figs. 16 to 18, from which the text omits the two without effect.
const DEFECT: [&str; 5] = ["v_i", "m_1", "e_2", "h", "l"];
/// Depths and lengths of the samples' cracks (section 4.2.1), named as the figures name them.
const SHALLOW: (&str, f64) = ("h = 12.7 mm", 12.7e-3);
const DEEP: (&str, f64) = ("h = 19.05 mm", 19.05e-3);
const DEEPEST: (&str, f64) = ("h = 25.4 mm", 25.4e-3);
const SHORT: (&str, f64) = ("l = 25.4 mm", 25.4e-3);
const LONG: (&str, f64) = ("l = 50.8 mm", 50.8e-3);

const VELOCITY: Field = |s| &mut s.velocity_m_per_s;
const DEPTH: Field = |s| &mut s.h_m;
const LENGTH: Field = |s| &mut s.l_m;

/// Each of `names` varied alone, all else being the baseline.
fn factors(subject: Subject, quantity: Quantity, names: &[&str]) -> Vec<Family> {
    let family = |&(name, field): &(&'static str, Field)| {
        names.contains(&name).then(|| Family { name, subject, quantity, scene: Scene::default(), field })
    };
    FACTORS.iter().filter_map(family).collect()
}

/// No crack, and cracks of three depths, over velocity.
fn depths(quantity: Quantity) -> Vec<Family> {
    let scene = |h_m| Scene { h_m, ..Scene::default() };
    let cracked = [DEEPEST, DEEP, SHALLOW].map(|(name, h_m)| (name, scene(h_m)));
    over_velocity(&cracked, quantity)
}

/// No crack, and cracks of two lengths at 12.7 mm, over velocity.
fn lengths(quantity: Quantity) -> Vec<Family> {
    let cracked = [SHORT, LONG].map(|(name, l_m)| (name, Scene { h_m: SHALLOW.1, l_m, ..Scene::default() }));
    over_velocity(&cracked, quantity)
}

fn over_velocity(cracked: &[(&'static str, Scene)], quantity: Quantity) -> Vec<Family> {
    let sound = Family { name: "no crack", subject: Sound, quantity, scene: Scene::default(), field: VELOCITY };
    let cracked =
        cracked.iter().map(|&(name, scene)| Family { name, subject: Cracked, quantity, scene, field: VELOCITY });
    std::iter::once(sound).chain(cracked).collect()
}

/// Cracks of two lengths over their depth.
fn over_depth(quantity: Quantity) -> Vec<Family> {
    let family = |(name, l_m)| {
        let scene = Scene { l_m, ..Scene::default() };
        Family { name, subject: Cracked, quantity, scene, field: DEPTH }
    };
    [SHORT, LONG].map(family).into()
}

/// Cracks of some depths in the block of `scene` over their length.
fn over_length(depths: &[(&'static str, f64)], quantity: Quantity, scene: Scene) -> Vec<Family> {
    let family = |&(name, h_m): &(&'static str, f64)| {
        let scene = Scene { h_m, ..scene };
        Family { name, subject: Cracked, quantity, scene, field: LENGTH }
    };
    depths.iter().map(family).collect()
}

/// Cracks in the block of 152.4 mm, half as heavy again as that of 101.6 mm.
fn long_block(quantity: Quantity) -> Vec<Family> {
    let scene = Scene::default();
    over_length(&[SHALLOW, DEEP], quantity, Scene { m_2_kg: 1.5 * scene.m_2_kg, ..scene })
}

/// Contact, bending and both together.
fn parts() -> Vec<Family> {
    let part = |(name, quantity)| Family { name, subject: Cracked, quantity, scene: Scene::default(), field: DEPTH };
    let parts = [("contact", Quantity::Local), ("bending", Quantity::Bending), ("together", Quantity::Deformation)];
    parts.map(part).into()
}
