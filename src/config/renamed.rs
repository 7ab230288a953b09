//! Names that configurations once had: refused with the name to write instead.

use anyhow::{Error, Result};
use serde::de::DeserializeOwned;

/// One name that is no longer read.
struct Renamed {
    /// The table, as `a.b`; of an array of tables every entry is meant.
    table: &'static str,
    /// The key.
    key: &'static str,
    /// The value of `key` that was renamed; `None` where the key itself was.
    value: Option<&'static str>,
    /// The new name of the key, or of the value.
    now: &'static str,
}

const fn key(table: &'static str, key: &'static str, now: &'static str) -> Renamed {
    Renamed { table, key, value: None, now }
}

const fn value(table: &'static str, key: &'static str, value: &'static str, now: &'static str) -> Renamed {
    Renamed { table, key, value: Some(value), now }
}

/// All of them; a renamed value is an entry with `value: Some(..)`.
const RENAMED: [Renamed; 16] = [
    key("process.quality", "double_hit_share", "double_hit_ratio_max"),
    key("process.quality", "hum_share_most", "hum_ratio_max"),
    key("process.quality", "neighbour_share", "neighbour_ratio_max"),
    key("process.quality", "snr_least", "snr_min"),
    key("process.quality", "tau_least_s", "tau_min_s"),
    key("process.quality", "tau_most_s", "tau_max_s"),
    key("process.quality", "velocity_error_most", "velocity_error_max"),
    key("simulation.fault", "share", "fraction"),
    key("fuse", "false_call_rate", "re_inspect_rate"),
    value("fuse", "index", "repeatability", "fused"),
    value("fuse", "index", "robust", "fused"),
    value("fuse", "index", "percentile", "fused"),
    value("fuse", "index", "auc", "fused"),
    value("fuse", "index", "lda", "fused"),
    value("fuse", "index", "mahalanobis", "fused"),
    value("fuse", "index", "log_odds", "fused"),
];

/// Reads the TOML `text`.
///
/// # Errors
/// What is wrong and where; for each name that was renamed also the new one.
pub(super) fn parse<T: DeserializeOwned>(text: &str) -> Result<T> {
    toml::from_str(text).map_err(|error| {
        let hints = hints(text, &RENAMED);
        let error = Error::msg(in_words(&error.to_string()));
        if hints.is_empty() { error } else { error.context(hints.join("; ")) }
    })
}

/// What people call the types of numbers that an error says it expected.
const TYPES: [(&str, &str); 7] = [
    ("u8", "a whole number from 0 to 255"),
    ("u16", "a whole number from 0 to 65535"),
    ("u32", "a whole number from 0 to 4294967295"),
    ("u64", "a whole number, not below 0"),
    ("usize", "a whole number, not below 0"),
    ("i64", "a whole number"),
    ("f64", "a number"),
];

/// `error` with the types of numbers in words.
fn in_words(error: &str) -> String {
    let of = |(name, words): &(&str, &str)| {
        Some(format!("{}expected {words}", error.trim_end().strip_suffix(&format!("expected {name}"))?))
    };
    TYPES.iter().find_map(of).unwrap_or_else(|| error.to_owned())
}

/// What to write in place of each name of `renamed` that is in `text`.
fn hints(text: &str, renamed: &[Renamed]) -> Vec<String> {
    let Ok(root) = toml::from_str::<toml::Value>(text) else { return Vec::new() };
    let hint = |entry: &Renamed| {
        let Renamed { table, key, value, now } = *entry;
        let is_it = |found: &toml::Value| value.is_none_or(|value| found.as_str() == Some(value));
        let is_in = tables(&root, table).into_iter().filter_map(|table| table.get(key)).any(is_it);
        is_in.then(|| match value {
            None => format!("{table}.{key} is now {table}.{now}"),
            Some(value) => format!("{table}.{key} = {value:?} is now {now:?}"),
        })
    };
    renamed.iter().filter_map(hint).collect()
}

/// The tables at `path`: one, or the entries of an array.
fn tables<'a>(root: &'a toml::Value, path: &str) -> Vec<&'a toml::Value> {
    let found = path.split('.').try_fold(root, |table, key| table.get(key));
    match found {
        Some(toml::Value::Array(entries)) => entries.iter().collect(),
        found => found.into_iter().collect(),
    }
}

#[cfg(test)]
mod tests {
    use tapline_host::similar::meant_instead;

    use super::*;
    use crate::config::Config;

    fn refusal(text: &str) -> String {
        format!("{:#}", parse::<Config>(text).unwrap_err())
    }

    /// Catches an old name that is read again, one that is refused without the new one, and an entry whose new name is
    /// none.
    #[test]
    fn each_old_key_is_refused_with_the_new_one() {
        let known = toml::Value::try_from(Config::default()).unwrap();
        for Renamed { table, key, value, now } in &RENAMED {
            let header = if *table == "simulation.fault" { format!("[[{table}]]") } else { format!("[{table}]") };
            let written = value.map_or("1.0".to_owned(), |value| format!("{value:?}"));
            let error = refusal(&format!("{header}\n{key} = {written}\n"));
            assert!(error.contains(&format!("is now {table}.{now}")) || value.is_some(), "{error}");
            let is_known = tables(&known, table).iter().any(|table| table.get(value.map_or(now, |_| key)).is_some());
            assert!(is_known || *table == "simulation.fault", "{table}.{now}");
        }
        let fault = |key: &str| format!("[[simulation.fault]]\nkind = \"hum\"\n{key} = 0.1\n");
        assert!(parse::<Config>(&fault("fraction")).is_ok());
        assert!(refusal(&fault("share")).contains("simulation.fault.share is now simulation.fault.fraction"));
    }

    /// Catches a bound that is told as the name of a type.
    #[test]
    fn bounds_are_told_in_words() {
        for (text, words) in [
            ("[scan]\nstations = 70000", "`70000`, expected a whole number from 0 to 65535"),
            ("[scan]\nlocations = -1", "`-1`, expected a whole number from 0 to 4294967295"),
            ("[process]\nworkers = -1", "`-1`, expected a whole number, not below 0"),
            ("[process]\nf_c_hz = \"x\"", "\"x\", expected a number"),
        ] {
            assert!(refusal(text).ends_with(words), "{}", refusal(text));
        }
    }

    /// Catches a slip in a key, an index or a discriminator without the name that was meant, and a hint that leads astray.
    #[test]
    fn what_was_meant_by_a_slip_is_said() {
        for (text, meant) in [
            ("[process]\nf_hi = 1.0", Some("did you mean \"f_hi_hz\"?")),
            ("[fuse]\nindex = \"fusde\"", Some("did you mean \"fused\"?")),
            ("[fuse]\ndiscriminators = [\"f_max\", \"tua\"]", Some("did you mean \"tau\"?")),
            ("[fusion]", Some("did you mean \"fuse\"?")),
            ("[process]\ncolour = 1.0", None),
        ] {
            assert_eq!(meant_instead(&refusal(text)).as_deref(), meant, "{}", refusal(text));
        }
    }

    /// Catches a value whose new name is not named, a hint for a value that was not renamed, and one for another table.
    #[test]
    fn a_renamed_value_is_named_too() {
        let renamed = [Renamed { table: "fuse", key: "combine", value: Some("largest"), now: "max" }];
        assert_eq!(hints("[fuse]\ncombine = \"largest\"", &renamed), ["fuse.combine = \"largest\" is now \"max\""]);
        assert_eq!(hints("[fuse]\ncombine = \"mean\"", &renamed), Vec::<String>::new());
        assert_eq!(hints("[store]\ncombine = \"largest\"", &renamed), Vec::<String>::new());
        assert!(!refusal("[process]\nsnr_least = 1.0").contains("is now"), "it was never in that table");
    }
}
