//! Reads a configuration.

use anyhow::{Error, Result, bail};
use serde::Serialize;
use serde::de::DeserializeOwned;
use tapline_acquire::toml_in_words;
use toml::{Table, Value};

/// Reads the TOML `text`.
pub(super) fn parse<T: DeserializeOwned + Serialize + Default>(text: &str) -> Result<T> {
    if let (Ok(given), Ok(known)) = (toml::from_str(text), Table::try_from(T::default())) {
        check_shapes("", &given, &known)?;
    }
    toml::from_str(text).map_err(|error| Error::msg(toml_in_words(&error.to_string())))
}

/// Refuses a list in place of a table, because its values would be taken for keys by their positions, and a table in
/// place of a list of tables.
fn check_shapes(path: &str, given: &Table, known: &Table) -> Result<()> {
    for (key, given) in given {
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        match (given, known.get(key)) {
            (Value::Array(_), Some(Value::Table(_))) => {
                bail!("{path} is a list; it must be one table: write [{path}]")
            }
            (Value::Table(_), Some(Value::Array(_))) => {
                bail!("{path} is one table; it must be a list of them: write [[{path}]]")
            }
            (Value::Table(given), Some(Value::Table(known))) => check_shapes(&path, given, known)?,
            _ => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use tapline_host::similar::meant_instead;

    use super::*;
    use crate::config::Config;

    fn refusal(text: &str) -> String {
        format!("{:#}", parse::<Config>(text).unwrap_err())
    }

    /// Catches a bound or a kind that is given as a type of the program, and an error without its place.
    #[test]
    fn errors_are_in_words() {
        for (text, words) in [
            ("[scan]\nstations = 70000", "`70000`, expected a whole number from 0 to 65535"),
            ("[scan]\nlocations = -1", "`-1`, expected a whole number from 0 to 4294967295"),
            ("[line]\ntaps_max = -1", "`-1`, expected a whole number, not below 0"),
            ("[process]\nf_c_hz = \"x\"", "\"x\", expected a number"),
            ("scan = 3", "`3`, expected a table"),
            ("[[simulation.fault]]\nkind = \"hum\"\nfraction = \"x\"", "\"x\", expected a number"),
            ("[scan]\noffsets_mm = 1.0", "`1.0`, expected a list"),
            ("[line.modbus]\nlisten = \"host:1\"", "it must be an IP address with a port, like 127.0.0.1:PORT"),
        ] {
            let refusal = refusal(text);
            assert!(refusal.contains(words) && refusal.contains("line "), "{refusal}");
        }
    }

    /// Catches a list that is taken for a table, and a slip in brackets without advice on what to write.
    #[test]
    fn lists_and_tables_are_not_mixed() {
        for (text, words) in [
            ("scan = [7]", "scan is a list; it must be one table: write [scan]"),
            ("[[fuse]]", "fuse is a list; it must be one table: write [fuse]"),
            ("[[process.quality]]", "process.quality is a list; it must be one table: write [process.quality]"),
            ("[station]\nnumber = 1", "station is one table; it must be a list of them: write [[station]]"),
            (
                "[simulation.fault]",
                "simulation.fault is one table; it must be a list of them: write [[simulation.fault]]",
            ),
        ] {
            assert_eq!(refusal(text), words);
        }
        assert!(parse::<Config>("[[station]]\nnumber = 1\nsource = \"simulated\"\n[scan]\noffsets_mm = []").is_ok());
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
}
