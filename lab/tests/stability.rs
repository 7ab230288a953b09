//! The stability catalogue: 44 cases in which a plain reading of the method gives a wrong number without saying so.
//!
//! A test per case, named by number. Each has a **naive** twin, which is computed and asserted to be about as wrong as
//! the comment says, so that the failure is shown as real; the limit that our kernels **hold**, which is asserted; and
//! what is **measured**, which shows the margin to the limit. If only a flag holds a case, the limit says so.

mod archive;
mod contact;
mod estimators;
mod flags;
mod fuzz;
mod index;
mod ring;
mod scatter;
mod sound;

#[path = "../src/chart/panels/contact/small_steps.rs"]
mod small_steps;
#[path = "../src/stability/tap.rs"]
mod tap;
