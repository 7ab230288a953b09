//! `tapline rig`: a simulated rig for a station of a line.

use std::io::Write as _;
use std::net::TcpListener;
use std::path::Path;

use anyhow::{Context as _, Result};
use serde_json::json;
use tapline_acquire::{RigReport, RigScript, read_toml, serve_rig};
use tapline_host::signals::stop_flag;
use tapline_host::stdout::Stdout;

/// Serves stations that connect to `listen`, by the script in `config`, until it is asked to stop or the script ends.
pub(crate) fn rig(listen: &str, config: Option<&Path>, as_json: bool) -> Result<bool> {
    let script: RigScript = match config {
        Some(path) => read_toml(path)?,
        None => RigScript::default(),
    };
    script.validate()?;
    let listener = TcpListener::bind(listen).with_context(|| format!("cannot listen at {listen}"))?;
    let address = listener.local_addr().context("cannot find the address to listen at")?;
    // Before anybody knows of the rig, and may end it.
    let stop = stop_flag().context("cannot listen for signals")?;
    let listening = json!({ "kind": "listening", "address": address.to_string() });
    print(if as_json { listening.to_string() } else { format!("listening at {address}") })?;
    let report = serve_rig(&listener, &script, &stop)?;
    let counts = counts_of(&report);
    print(match as_json {
        true => {
            let mut text = json!({ "kind": "report" });
            counts.into_iter().for_each(|(name, count)| text[name] = count.into());
            text.to_string()
        }
        false => counts.map(|(name, count)| format!("{} {count}", name.replace('_', " "))).join(", "),
    })?;
    Ok(true)
}

fn print(text: String) -> Result<()> {
    Ok(writeln!(Stdout, "{text}")?)
}

/// What the rig did, each count by its name.
fn counts_of(report: &RigReport) -> [(&'static str, u64); 11] {
    let RigReport { casings, closed, refused, removed, switched_off, stopped, homed, .. } = *report;
    let RigReport { hits, failed_hits, missed_hits, double_hits, .. } = *report;
    [
        ("casings", casings),
        ("closed", closed),
        ("refused", refused),
        ("removed", removed),
        ("switched_off", switched_off),
        ("stopped", stopped),
        ("homed", homed),
        ("hits", hits),
        ("failed_hits", failed_hits),
        ("missed_hits", missed_hits),
        ("double_hits", double_hits),
    ]
}
