//! The options of `tapline model`.

use clap::Args;
use tapline_model::{DampingLaw, EffectiveLength, Rung, Scene};

use crate::cli::one_of;

/// The rules of [`EffectiveLength`].
pub(crate) const LENGTHS: [&str; 2] = ["published", "table1"];

/// One contact.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
pub(crate) struct ContactArgs {
    /// Impact velocity.
    #[arg(long, default_value_t = Scene::default().velocity_m_per_s)]
    pub velocity_m_per_s: f64,
    /// Depth of the crack.
    #[arg(long, default_value_t = 25.4)]
    pub depth_mm: f64,
    /// Length of the crack.
    #[arg(long, default_value_t = 25.4)]
    pub length_mm: f64,
    /// Width of the block.
    #[arg(long, default_value_t = 50.8)]
    pub width_mm: f64,
    /// Restitution asked of the contact, 0.1 to 1.
    #[arg(long, default_value_t = Scene::default().restitution)]
    pub restitution: f64,
    /// Mass of the impactor.
    #[arg(long, default_value_t = 4.5)]
    pub mass_g: f64,
    /// Mass of the target.
    #[arg(long, default_value_t = Scene::default().m_2_kg)]
    pub target_mass_kg: f64,
    /// Young's modulus of the target.
    #[arg(long, default_value_t = 17.9)]
    pub e2_mpa: f64,
    /// Rebound resilience of the target, for its loss tangent.
    #[arg(long, default_value_t = Scene::default().resilience)]
    pub resilience: f64,
    /// How the effective length of a crack is computed: as the printed tables used it, or as the text describes it.
    #[arg(long, value_parser = one_of::<EffectiveLength>(&LENGTHS), default_value = "published")]
    pub effective_length: EffectiveLength,
    /// How damping follows from the restitution.
    #[arg(
        long,
        value_parser = one_of::<DampingLaw>(&["exact", "lankarani-nikravesh", "flores", "gonthier"]),
        default_value = "exact"
    )]
    pub damping: DampingLaw,
    /// The model: closed form, damped contact without a crack, plate in time, or the same with shear and membrane. Without this
    /// option the tolerance decides.
    #[arg(long, value_parser = one_of::<Rung>(&["closed", "integral", "plate", "full"]), conflicts_with = "tolerance")]
    pub rung: Option<Rung>,
    /// Take the cheapest rung whose quantities are all within this relative difference from the full rung's, and print why.
    #[arg(long, default_value_t = 0.05)]
    pub tolerance: f64,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}
