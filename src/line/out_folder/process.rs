//! A process as the lock names it: a later process may have the same number.

use anyhow::{Context as _, Result};
use serde::{Deserialize, Serialize};

/// A process, distinct from a later one with the same number.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct ProcessName {
    pub pid: u32,
    /// When it started, in clock ticks since the system did.
    pub started: u64,
    /// Identifies the boot of the system.
    pub boot: String,
}

impl ProcessName {
    /// This process.
    pub(super) fn own() -> Result<Self> {
        Self::with_number(std::process::id()).context("cannot read /proc, which a line needs")
    }

    fn with_number(pid: u32) -> Option<Self> {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        // The name comes second and may hold anything; what follows starts with the third field, and 22 is wanted.
        let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
        // A zombie does nothing any more.
        if matches!(*fields.first()?, "Z" | "X") {
            return None;
        }
        let started = fields.get(19)?.parse().ok()?;
        let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").ok()?.trim().to_owned();
        Some(Self { pid, started, boot })
    }

    pub(super) fn is_alive(&self) -> bool {
        Self::with_number(self.pid).as_ref() == Some(self)
    }
}
