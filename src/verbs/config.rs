//! `tapline config --example`: a complete configuration to start from.

use std::io::Write as _;

use anyhow::Result;
use tapline_host::stdout::Stdout;

/// Every key of a configuration with its default and what it means.
pub(crate) const EXAMPLE: &str = include_str!("../config/example.toml");

/// Prints the example.
pub(crate) fn example() -> Result<bool> {
    write!(Stdout, "{EXAMPLE}")?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use tapline_testing::documents::{docs, text};

    use super::*;
    use crate::config::Config;

    /// The example with every key that it only shows.
    fn whole() -> String {
        let shown = |line: &str| match line.strip_prefix('#') {
            Some(rest) if rest.starts_with(|c: char| c == '[' || c.is_ascii_lowercase()) => rest.to_owned(),
            _ => line.to_owned(),
        };
        EXAMPLE.lines().map(|line| shown(line) + "\n").collect()
    }

    /// The names of keys and tables of `value`, each after the table that it is in; entries of an array are one table.
    fn keys(value: &toml::Value, name: &str, found: &mut BTreeSet<String>) {
        match value {
            toml::Value::Table(table) => table.iter().for_each(|(key, value)| {
                let key = if name.is_empty() { key.clone() } else { format!("{name}.{key}") };
                found.insert(key.clone());
                keys(value, &key, found);
            }),
            toml::Value::Array(entries) => entries.iter().for_each(|entry| keys(entry, name, found)),
            _ => {}
        }
    }

    fn keys_of(text: &str) -> BTreeSet<String> {
        let mut found = BTreeSet::new();
        keys(&toml::from_str(text).unwrap(), "", &mut found);
        found
    }

    /// Catches a default that differs from the example's, and a key that is no longer read.
    #[test]
    fn the_example_states_the_defaults() {
        assert_eq!(Config::parse(EXAMPLE).unwrap(), Config::default());
        let defaults = keys_of(&toml::to_string(&Config::default()).unwrap());
        let missing: Vec<_> = defaults.difference(&keys_of(EXAMPLE)).filter(|key| *key != "station").cloned().collect();
        // The example shows empty lists by what could be in them.
        assert_eq!(missing, ["scan.tyre", "simulation.fault"]);
    }

    /// Catches a key without a default that the example does not show, or shows with a value that is refused: the reader lists
    /// the keys of a table when it is given one that is none.
    #[test]
    fn the_example_shows_every_key_there_is() {
        let whole = whole();
        let config = Config::parse(&whole).unwrap_or_else(|error| panic!("{error:#}"));
        config.validate().unwrap();
        let shown = keys_of(&whole);
        let tables: BTreeSet<&str> = shown.iter().filter_map(|key| Some(key.rsplit_once('.')?.0)).collect();
        assert!(tables.len() > 15, "{tables:?}");
        for table in tables.into_iter().filter(|table| !table.starts_with("fuse.directions")) {
            let mut root: toml::Value = toml::from_str(&whole).unwrap();
            let mut place = &mut root;
            for key in table.split('.') {
                place = place.get_mut(key).unwrap();
                if place.is_array() {
                    place = place.get_mut(0).unwrap();
                }
            }
            place.as_table_mut().unwrap().insert("no_such_key".to_owned(), 1.into());
            let error = toml::from_str::<Config>(&toml::to_string(&root).unwrap()).unwrap_err();
            let known: Vec<&str> = error.message().split('`').skip(1).step_by(2).skip(1).collect();
            assert!(!known.is_empty(), "{table}: {error}");
            for key in known {
                assert!(shown.contains(&format!("{table}.{key}")), "the example does not show {table}.{key}");
            }
        }
    }

    /// Catches a page that names a key which the example, and with it the program, does not have.
    #[test]
    fn the_pages_keys_are_those_of_the_example() {
        let page = text(&docs("configuration.md"));
        let (shown, mut count) = (keys_of(&whole()), 0);
        for block in page.split("```toml\n").skip(1).filter_map(|rest| rest.split("```").next()) {
            for key in keys_of(block) {
                assert!(shown.contains(&key), "docs/configuration.md has {key}");
                count += 1;
            }
        }
        assert!(count > 40, "{count}");
    }
}
