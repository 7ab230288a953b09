//! Hosts of a network, as namespaces of this machine.

use std::process::{Command, Stdio};

use crate::skip;

/// Runs `ip` with `arguments`, which are split at spaces; returns whether it succeeded.
pub fn ip(arguments: &str) -> bool {
    let mut command = Command::new("ip");
    command.args(arguments.split_whitespace()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

/// A command that runs its arguments at the host `name`.
pub fn at(name: &str) -> Command {
    let mut command = Command::new("ip");
    command.args(["netns", "exec", name]);
    command
}

/// A host, by its name; it goes when this is dropped.
#[derive(Debug)]
pub struct Host(pub String);

impl Host {
    /// Makes it; `None`, and a skip, where that is not allowed.
    pub fn new(name: String) -> Option<Self> {
        let is_made = ip(&format!("netns add {name}"));
        if !is_made {
            skip("no network namespaces here (they take root, and iproute2)");
        }
        is_made.then(|| Self(name))
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        ip(&format!("netns del {}", self.0));
    }
}
