//! A second simulator of tapped casings, for tests and for the lab.
//!
//! What is true on one simulator may be a property of that simulator. This one shares no code with
//! `tapline-model`, and of the physics two ideas: Hertz's law with a damping, and a layer over a crack that is heard in addition. So what both
//! agree on in these is no evidence. All else differs, so that a method tuned on one can be tested on the other.
//!
//! | | here | `tapline-model` |
//! |---|---|---|
//! | contact | Hertz with the damping of Hunt and Crossley, b a constant: restitution falls with velocity | damping from a given restitution, by a table |
//! | target | an infinite plate, which absorbs energy by its impedance 8 sqrt(D m) | a mass at rest |
//! | crack | a round clamped plate that bends and shears, on the plate's impedance; a smaller effect makes it stiffer at the same mass | a beam over a block, with cords beside it; a smaller effect makes it stiffer and heavier |
//! | sound | eight modes of the casing and three of the layer, which sound with their deflection | five modes, which sound with their velocity, and one of the layer |
//! | properties of a place | stiffness correlated along the ring, an independent level of each mode, in part shared by the offsets | a wave around the ring, and a random part per location |
//! | gain | of microphone and force sensor; by casing and turn, with drift within a turn | of the microphone, with drift within a turn |
//! | faults | bounces, and taps beside their place | faults of the rig |
//!
//! # Sources
//!
//! - Contact: H. Hertz, *Ueber die Beruehrung fester elastischer Koerper* (1881): F = K d^1.5, contact time 2.9432 d/V. K. H. Hunt and
//!   F. R. E. Crossley, *Coefficient of restitution interpreted as damping in vibroimpact* (J. Appl. Mech. 42, 1975):
//!   F = K d^1.5 (1 + 1.5 a d'), with restitution 1 - a V for small a V.
//! - Plate: C. Zener, *The intrinsic inelasticity of large plates* (Phys. Rev. 59, 1941): an infinite plate gives way to a
//!   force with the velocity F/(8 sqrt(D m)).
//! - Layer: S. Timoshenko and S. Woinowsky-Krieger, *Theory of Plates and Shells* (1959): deflection P a^2/(16 pi D) of a round
//!   clamped plate.
//! - Impactor of 4.5 g, bands, offsets and velocities: Shen's dissertation, as elsewhere in tapline.
//!
//! # What is assumed
//!
//! Stiffness and density of the layer beyond those of rubber, the mass that moves with it, all modes, all of [`Population`],
//! how a crack's effect falls towards the ends of its arc and of its reach, and how loud it is. The force drives the layer's
//! modes like the casing's, and they do not act back on the contact; only the first of them is part of the contact. An
//! infinite plate returns nothing to the impactor: no reflection from bead or rim arrives during the contact. The sound has
//! no direct part, no room and no hum. Noise is white. Results show what a method does with such casings, not what a plant
//! will see.
//!
//! # Example
//!
//! ```
//! use tapline_plate::{Crack, Population, ScanShape, Tyre, discriminators};
//! use tapline_process::ProcessConfig;
//! use tapline_wire::{Discriminator, Serial};
//!
//! let shape = ScanShape { offsets_mm: vec![0.0], repetitions: 1, ..ScanShape::default() };
//! let crack = Crack { depth_mm: 6.0, ..Crack::default() }.over(40, 5, 100);
//! let tyres = [Tyre { serial: Serial::new("T1")?, cracks: vec![crack] }];
//! let plan = shape.plan(&tyres)?;
//! let taps = discriminators(&Population::smooth(), 1, &tyres, &plan, &ProcessConfig::default(), 2)?;
//! let f_max = |location: usize| taps[location].values.get(Discriminator::FMax);
//! assert!(f_max(42) < f_max(20));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod casing;
mod contact;
mod crack;
mod error;
mod modes;
mod population;
mod random;
mod rig;
mod scan;

pub use casing::Casing;
pub use contact::Layer;
pub use crack::Crack;
pub use error::Error;
pub use population::Population;
pub use rig::{Rig, Tap};
pub use scan::{Line, ScanShape, Tyre, discriminators};
