//! What results are made by: the program's sources, and every option with its value.

use std::collections::BTreeMap;

use anyhow::{Context as _, Result};
use serde::Serialize;

use crate::config::Config;

/// Digests of the sources that this program was built from, by name.
const SOURCES: [(&str, &str); 7] = [
    ("acquire", env!("TAPLINE_SOURCE_ACQUIRE")),
    ("dependencies", env!("TAPLINE_SOURCE_DEPENDENCIES")),
    ("fuse", env!("TAPLINE_SOURCE_FUSE")),
    ("model", env!("TAPLINE_SOURCE_MODEL")),
    ("process", env!("TAPLINE_SOURCE_PROCESS")),
    ("store", env!("TAPLINE_SOURCE_STORE")),
    ("wire", env!("TAPLINE_SOURCE_WIRE")),
];

/// Sources that decide what is found in a tap.
const OF_DISCRIMINATORS: [&str; 3] = ["dependencies", "process", "wire"];

#[derive(Debug, Serialize)]
struct MadeBy<'a> {
    program: &'a str,
    sources: BTreeMap<&'a str, &'a str>,
    #[serde(flatten)]
    config: &'a Config,
}

/// The lines that an archive keeps of this program and `config`, every default spelled out.
pub(crate) fn made_by(config: &Config) -> Result<String> {
    let made_by = MadeBy { program: env!("CARGO_PKG_VERSION"), sources: SOURCES.into_iter().collect(), config };
    let table = toml::Table::try_from(made_by).context("the options do not fit TOML")?;
    let mut lines = Vec::new();
    flatten("", &toml::Value::Table(table), &mut lines);
    lines.sort();
    Ok(lines.join("\n"))
}

/// One line a value: `process.f_c_hz = 550.0`.
fn flatten(path: &str, value: &toml::Value, lines: &mut Vec<String>) {
    match value {
        toml::Value::Table(table) => {
            for (key, value) in table {
                flatten(&if path.is_empty() { key.clone() } else { format!("{path}.{key}") }, value, lines);
            }
        }
        value => lines.push(format!("{path} = {value}")),
    }
}

/// Of the lines `made_by` those that decide what is found in a tap: two archives that agree in them have the same
/// discriminators.
pub(crate) fn of_discriminators(made_by: &str) -> Vec<&str> {
    let is_of = |line: &&str| {
        line.starts_with("process.")
            || OF_DISCRIMINATORS.iter().any(|name| line.strip_prefix("sources.").is_some_and(|of| of.starts_with(name)))
    };
    made_by.lines().filter(is_of).collect()
}

/// The lines of two lineages that differ, as (key, there, here); an option that is not there is empty.
pub(crate) fn changes(there: &str, here: &str) -> Vec<(String, String, String)> {
    let lines = |text: &str| -> BTreeMap<String, String> {
        text.lines().filter_map(|line| line.split_once(" = ")).map(|(k, v)| (k.to_owned(), v.to_owned())).collect()
    };
    let (there, here) = (lines(there), lines(here));
    let keys: std::collections::BTreeSet<&String> = there.keys().chain(here.keys()).collect();
    let of = |lines: &BTreeMap<String, String>, key: &String| lines.get(key).cloned().unwrap_or_default();
    let pairs = keys.into_iter().map(|key| (key.clone(), of(&there, key), of(&here, key)));
    pairs.filter(|(_, there, here)| there != here).collect()
}
