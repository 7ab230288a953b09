//! The verbs, one file each; `run`, `line` and `status` are in `crate::line`, `report` is in `crate::report`.

pub(crate) mod calibrate;
pub(crate) mod config;
#[cfg(feature = "alsa")]
pub(crate) mod devices;
pub(crate) mod diff;
pub(crate) mod explain;
pub(crate) mod export;
pub(crate) mod import;
pub(crate) mod model_contact;
pub(crate) mod model_table;
#[cfg(feature = "alsa")]
pub(crate) mod monitor;
pub(crate) mod reference;
pub(crate) mod repack;
pub(crate) mod reprocess;
pub(crate) mod rig;
#[cfg(feature = "uplink")]
pub(crate) mod uplink;
pub(crate) mod verify;
