//! `tapline rig`: a simulated rig for a station of a line.

use std::io::Write as _;
use std::net::TcpListener;
use std::path::Path;

use anyhow::{Context as _, Result};
use tapline_acquire::{RigScript, serve_rig};

use crate::host::signals::stop_flag;

/// Serves stations that connect to `listen`, by the script in `config`, until it is asked to stop or the script ends.
pub(crate) fn rig(listen: &str, config: Option<&Path>) -> Result<bool> {
    let script: RigScript = match config {
        Some(path) => {
            let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
            toml::from_str(&text).with_context(|| format!("{} is no script of a rig", path.display()))?
        }
        None => RigScript::default(),
    };
    script.validate()?;
    let listener = TcpListener::bind(listen).with_context(|| format!("cannot listen at {listen}"))?;
    let address = listener.local_addr().context("cannot find the address that is listened at")?;
    writeln!(std::io::stdout(), "listening at {address}").context("cannot write to standard output")?;
    let stop = stop_flag()?;
    let report = serve_rig(&listener, &script, &stop)?;
    writeln!(std::io::stdout(), "{report:?}").context("cannot write to standard output")?;
    Ok(true)
}
