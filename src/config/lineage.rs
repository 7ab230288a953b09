//! What results are made by: the program's sources, and every option that affects results with its value.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context as _, Result};
use serde::Serialize;
use tapline_fuse::Reference;
use tapline_host::messages::counted;
use tapline_wire::Plan;

use crate::config::Config;

/// Digests of what this program computes with, by name.
const SOURCES: [(&str, &str); 6] = [
    ("acquire", env!("TAPLINE_SOURCE_ACQUIRE")),
    ("dependencies", env!("TAPLINE_SOURCE_DEPENDENCIES")),
    ("fuse", env!("TAPLINE_SOURCE_FUSE")),
    ("model", env!("TAPLINE_SOURCE_MODEL")),
    ("process", env!("TAPLINE_SOURCE_PROCESS")),
    ("wire", env!("TAPLINE_SOURCE_WIRE")),
];

/// Tables and keys that affect no result: where casings come from, how fast, how samples are
/// packed, where verdicts are published and what is printed with them.
const AFFECT_NO_RESULT: [&str; 5] = ["line", "station", "report", "store", "acquire.taps_per_s"];

/// Sources that affect the discriminators of a tap.
const OF_DISCRIMINATORS: [&str; 3] = ["dependencies", "process", "wire"];

#[derive(Debug, Serialize)]
struct MadeBy<'a> {
    program: &'a str,
    sources: BTreeMap<&'a str, &'a str>,
    #[serde(flatten)]
    config: Config,
}

/// The lines that an archive keeps of this program and of the options in `config` that affect results, with defaults.
pub(crate) fn made_by(config: &Config) -> Result<String> {
    let mut config = config.clone();
    // A reference file counts by its content, which the key of a lineage has beside these lines, and not by where it is.
    if let Some(Reference::File(path)) = &mut config.fuse.reference {
        *path = PathBuf::from("a file");
    }
    let made_by = MadeBy { program: env!("CARGO_PKG_VERSION"), sources: SOURCES.into_iter().collect(), config };
    let mut table = toml::Table::try_from(made_by).context("the options do not fit TOML")?;
    AFFECT_NO_RESULT.iter().for_each(|path| remove(&mut table, path));
    let mut lines = Vec::new();
    flatten("", &toml::Value::Table(table), &mut lines);
    lines.sort();
    Ok(lines.join("\n"))
}

/// Removes what is at `path`, as `table.key`.
fn remove(table: &mut toml::Table, path: &str) {
    match path.split_once('.') {
        None => drop(table.remove(path)),
        Some((name, rest)) => {
            if let Some(toml::Value::Table(inner)) = table.get_mut(name) {
                remove(inner, rest);
            }
        }
    }
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

/// The value of an option as it is shown for an archive with this `plan`. Of the simulated tyres, which may be hundreds, it
/// has the archive's own and the number of the others.
pub(crate) fn shown_value(key: &str, value: String, plan: &Plan) -> String {
    // An archive may come from a stranger, and a terminal obeys some characters.
    let value = value.replace(char::is_control, " ");
    let tyres = match toml::from_str::<toml::Table>(&format!("tyre = {value}")) {
        Ok(mut table) if key == "scan.tyre" => table.remove("tyre"),
        _ => None,
    };
    let Some(toml::Value::Array(tyres)) = tyres else { return value };
    let serial_of = |tyre: &toml::Value| Some(tyre.get("serial")?.as_str()?.to_owned());
    let is_own = |serial: String| plan.scans().iter().any(|scan| scan.tyre.as_str() == serial);
    let (own, others): (Vec<_>, Vec<_>) = tyres.into_iter().partition(|tyre| serial_of(tyre).is_some_and(is_own));
    match others.len() {
        0 => value,
        count => format!("{} and {}", toml::Value::Array(own), counted(count, "other", "others")),
    }
}

/// The lines of `made_by` that affect discriminators: archives that agree in them have the same discriminators.
pub(crate) fn of_discriminators(made_by: &str) -> Vec<&str> {
    let is_of = |line: &&str| {
        line.starts_with("process.")
            || OF_DISCRIMINATORS.iter().any(|name| line.strip_prefix("sources.").is_some_and(|of| of.starts_with(name)))
    };
    made_by.lines().filter(is_of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Words that some option takes.
    const WORDS: &[&str] = &[
        "f64", "dissertation", "mean", "reference", "keep", "drop", "retake", "none", "falls", "rises", "zstd", "line",
        "plate", "exact", "f32", "parabola", "raw", "impulse", "noise", "fractional", "self", "B/2",
    ];

    /// Every value of `value`, by its path, as others of the same kind.
    fn flips(value: &toml::Value) -> Vec<toml::Value> {
        use toml::Value;
        match value {
            Value::Boolean(flag) => vec![Value::Boolean(!flag)],
            Value::Integer(number) => [number + 1, number - 1, number + 2, 4096].map(Value::Integer).to_vec(),
            Value::Float(number) => [number * 1.01, number * 0.5, number + 0.25, 0.5].map(Value::Float).to_vec(),
            Value::String(_) => WORDS.iter().map(|&word| Value::String(word.to_owned())).collect(),
            // Lists that are empty by default: a tyre, a fault, a channel.
            Value::Array(all) if all.is_empty() => {
                let tables =
                    ["serial = \"B\"", "kind = \"double_hit\"\nfraction = 0.1", "kind = \"double_hit\"\nlocation = 3"]
                        .map(|text| Value::Array(vec![Value::Table(toml::from_str(text).unwrap())]));
                tables.into_iter().chain([Value::Array(vec![Value::String("force".to_owned())])]).collect()
            }
            Value::Array(all) => {
                let shorter = all.iter().skip(1).cloned().collect();
                let flipped = all
                    .first()
                    .into_iter()
                    .flat_map(flips)
                    .map(|first| Value::Array(std::iter::once(first).chain(all.iter().skip(1).cloned()).collect()));
                std::iter::once(Value::Array(shorter)).chain(flipped).collect()
            }
            Value::Table(_) | Value::Datetime(_) => Vec::new(),
        }
    }

    fn walk(path: &mut Vec<String>, table: &toml::Table, visit: &mut impl FnMut(&[String], &toml::Value)) {
        for (key, value) in table {
            path.push(key.clone());
            match value {
                toml::Value::Table(inner) => walk(path, inner, visit),
                value => visit(path, value),
            }
            path.pop();
        }
    }

    fn set(table: &mut toml::Table, path: &[String], value: toml::Value) {
        match (path, table.get_mut(&path[0])) {
            ([_], Some(place)) => *place = value,
            ([_, rest @ ..], Some(toml::Value::Table(inner))) => set(inner, rest, value),
            _ => panic!("no {path:?}"),
        }
    }

    /// Catches an option whose change leaves the key as it was.
    #[test]
    fn every_option_is_in_the_key() {
        let reference = Reference::Own;
        let mut config = Config::default();
        config.fuse.reference = Some(reference);
        let key = |config: &Config| tapline_store::lineage_key(&[7; 32], &made_by(config).unwrap(), None);
        let slow = || {
            let mut slow = config.clone();
            slow.acquire.taps_per_s = Some(50.0);
            slow
        };
        assert_eq!(key(&slow()), key(&config), "the pace affects no result");
        let mut usual = toml::Table::try_from(&config).unwrap();
        // Listed again, so that an addition there without a reason is found here.
        for table in ["line", "station", "report", "store"] {
            usual.remove(table);
        }
        usual["acquire"].as_table_mut().unwrap().remove("taps_per_s");
        let (mut count, mut stuck) = (0, Vec::new());
        walk(&mut Vec::new(), &usual, &mut |path, value| {
            let others = flips(value).into_iter().filter(|other| other != value).filter_map(|other| {
                let mut flipped = usual.clone();
                set(&mut flipped, path, other);
                toml::Value::Table(flipped).try_into::<Config>().ok()
            });
            let mut is_flipped = false;
            for other in others {
                is_flipped = true;
                assert_ne!(key(&other), key(&config), "{path:?}");
            }
            count += 1;
            if !is_flipped {
                stuck.push(path.join("."));
            }
        });
        assert!(count > 60, "only {count} options were flipped");
        assert_eq!(stuck, Vec::<String>::new(), "no other value of these was found");
    }

    /// Catches results of one reference that have another lineage because its path is spelled otherwise.
    #[test]
    fn the_place_of_a_reference_is_not_in_the_key() {
        let made_by = |reference| {
            let fuse = tapline_fuse::FuseConfig { reference, ..Config::default().fuse };
            made_by(&Config { fuse, ..Config::default() }).unwrap()
        };
        let of_file = |path: &str| made_by(Some(Reference::File(path.into())));
        assert_eq!(of_file("sound.json"), of_file("./sound.json"));
        assert_ne!(of_file("sound.json"), made_by(Some(Reference::Own)));
    }

    /// Catches keys that do not change with the taps, the sources or the reference.
    #[test]
    fn everything_else_is_in_the_key() {
        let lines = made_by(&Config::default()).unwrap();
        let key = tapline_store::lineage_key;
        let usual = key(&[7; 32], &lines, Some("a"));
        assert_ne!(usual, key(&[8; 32], &lines, Some("a")));
        assert_ne!(usual, key(&[7; 32], &lines, Some("b")));
        assert_ne!(usual, key(&[7; 32], &lines, None));
        assert_ne!(key(&[7; 32], &lines, None), key(&[7; 32], &lines, Some("")));
        for (name, digest) in SOURCES {
            let line = format!("sources.{name} = \"{digest}\"");
            assert!(lines.contains(&line) && digest.len() == 32, "{line}");
            assert_ne!(usual, key(&[7; 32], &lines.replace(&line, "sources.x = \"0\""), Some("a")));
        }
        let only = of_discriminators(&lines);
        assert!(only.contains(&"process.f_c_hz = 550.0") && !only.iter().any(|line| line.contains("fuse")), "{only:?}");
        assert_eq!(only.iter().filter(|line| line.starts_with("sources.")).count(), OF_DISCRIMINATORS.len());
    }
}
