//! The physics of a tap: contact, crack and sound, in closed form, as a differential equation and as a simulated tyre.
//!
//! `contact` is the impact on a block with or without a crack, `tyre` builds on it: a simulated tyre on its rig. Nothing
//! here does input or output. The numbers of equations and tables are those of Shen, *Impact-Acoustic
//! Evaluation Method of Internal Crack in Rubber Composite Structure*. Formulas use its letters:
//!
//! | letter | quantity | name, unit |
//! |---|---|---|
//! | V | velocity of the impactor at first touch | `velocity_m_per_s` |
//! | m_1, m_2 | masses of impactor and target | `m_1_kg`, `m_2_kg` |
//! | E, nu, rho | Young's modulus, Poisson's ratio, density | `e_1_pa`, `nu_1`, `rho_1_kg_per_m3`, ... |
//! | h, l, w | depth and length of the crack, width of the block | `h_m`, `l_m`, `w_m` |
//! | l_e | effective length of the crack (Table 1) | [`Scene::l_e_m`] |
//! | K_c | contact stiffness (Eq. 9) | [`Scene::k_c_n_per_m1_5`] |
//! | K_f | bending stiffness of the layer above the crack (Eq. 23) | [`Scene::k_f_n_per_m`] |
//! | M | mass factor 1/m_1 + 1/m_2 (Eq. 14) | [`Scene::mass_factor_per_kg`] |
//! | tan d | loss tangent (Eq. 26) | [`Scene::loss_tangent`] |
//! | e, chi | restitution, and the damping that returns it | `restitution`, [`chi_for_restitution`] |
//! | F_max, tau | peak force, duration | `f_max_n`, `tau_s` |
//! | alpha, d_max | local deformation, deflection of the surface | `alpha_max_m`, `d_max_m` |
//! | lambda_f | fraction of energy lost to bending (Eq. 34) | `lambda_f` |
//!
//! A crack 2.54 mm deep reduces the peak force by four fifths in the closed form, and by two thirds in the plate's
//! equation of motion, in which the layer has mass:
//!
//! ```
//! use tapline_model::{Impact, Scene, defect_contact, integral_contact};
//!
//! let scene = Scene { h_m: 2.54e-3, ..Scene::default() };
//! assert!((integral_contact(&scene)?.f_max_n - 34.149).abs() < 1e-3);
//! assert!((defect_contact(&scene)?.f_max_n - 6.613).abs() < 1e-3);
//! assert!((Impact::plate(&scene)?.outcome()?.f_max_n - 11.246).abs() < 1e-3);
//! # Ok::<(), tapline_model::Error>(())
//! ```
//!
//! [`Rung`] is a ladder of four models: closed form, integral table, plate and full, each with the [`Flags`] of
//! its domain. [`choose_by_trial`] picks the cheapest rung that is accurate enough.

mod contact;
mod error;
mod tyre;

pub use contact::choice::{Choice, RungErrors, choose_by_trial};
pub use contact::damped::DampedContact;
pub use contact::damping::{DampingLaw, chi_for_restitution};
pub use contact::defect::{DefectContact, defect_contact};
pub use contact::domain::{DomainCheck, Flags};
pub use contact::impact::{Impact, Outcome, Plate};
pub use contact::integral::{IntegralContact, integral_contact};
pub use contact::ladder::Contact;
pub use contact::rung::Rung;
pub use contact::scene::{EffectiveLength, Scene};
pub use contact::tables::{FACTORS, Field, Table, table};
pub use error::Error;
pub use tyre::crack::{Crack, plant_cracks, truth};
pub use tyre::simulated::{SimulatedRig, SimulatedTap, SimulatedTyre};
pub use tyre::simulation_config::{FaultKind, PlantedFault, SimulationConfig};
