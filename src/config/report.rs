//! What a plant has printed on its reports: the table `[report]`. It changes no result.

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};

/// Longest text in characters.
const TEXT_MAX: usize = 120;

/// Who made a report, of what, and how to read it at the casing.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct ReportConfig {
    /// Name of the plant.
    pub plant: Option<String>,
    /// Name of the line.
    pub line: Option<String>,
    /// Who watched the line.
    pub operator: Option<String>,
    /// The procedure that was followed, as the plant calls it.
    pub procedure: Option<String>,
    /// What marks 0 degrees on a casing, such as its valve or serial number.
    pub start_mark: Option<String>,
    /// From which side angles run clockwise, such as that of the serial number.
    pub seen_from: Option<String>,
    /// Way round the tread, by which angles become millimetres.
    pub tread_circumference_mm: Option<f64>,
    /// Length of a crack from which on nine in ten are found, with 95 % confidence.
    pub a90_95_mm: Option<f64>,
    /// The study that says so.
    pub a90_95_source: Option<String>,
}

impl ReportConfig {
    /// Checks every value against its bounds.
    pub(crate) fn validate(&self) -> Result<()> {
        for (key, text) in [
            ("plant", &self.plant),
            ("line", &self.line),
            ("operator", &self.operator),
            ("procedure", &self.procedure),
            ("start_mark", &self.start_mark),
            ("seen_from", &self.seen_from),
            ("a90_95_source", &self.a90_95_source),
        ] {
            let fits = text.as_ref().is_none_or(|text| {
                (1..=TEXT_MAX).contains(&text.chars().count()) && !text.chars().any(char::is_control)
            });
            ensure!(fits, "report.{key} = {text:?}: must be from 1 to {TEXT_MAX} characters in one line, or left out");
        }
        for (key, value, least, most) in [
            ("tread_circumference_mm", self.tread_circumference_mm, 500.0, 20_000.0),
            ("a90_95_mm", self.a90_95_mm, 0.1, 1e4),
        ] {
            let fits = value.is_none_or(|value| (least..=most).contains(&value));
            ensure!(fits, "report.{key} = {}: must be from {least} to {most}, or left out", value.unwrap_or_default());
        }
        ensure!(
            self.a90_95_mm.is_none() || self.a90_95_source.is_some(),
            "report.a90_95_source is left out: it must name the study that a90_95_mm is from"
        );
        Ok(())
    }

    /// How angles on a casing are counted, on both its shoulders.
    pub(crate) fn angles(&self) -> String {
        format!("clockwise from the {}, seen from {}", self.mark(), self.side())
    }

    /// What marks 0 degrees on a casing.
    pub(crate) fn mark(&self) -> &str {
        self.start_mark.as_deref().unwrap_or("start mark")
    }

    /// From where angles run clockwise.
    pub(crate) fn side(&self) -> &str {
        self.seen_from.as_deref().unwrap_or("the side of shoulder 1")
    }

    /// Plant and line, as far as they are named.
    pub(crate) fn place(&self) -> String {
        let line = self.line.as_ref().map(|line| format!("line {line}"));
        self.plant.iter().cloned().chain(line).collect::<Vec<_>>().join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a value that a page could not show, and one that is refused without its name.
    #[test]
    fn what_cannot_be_printed_is_refused() {
        let parsed = |text: &str| toml::from_str::<ReportConfig>(text).unwrap().validate().map_err(|e| e.to_string());
        assert_eq!(
            parsed("plant = \"P\"\ntread_circumference_mm = 3300.0\na90_95_mm = 12\na90_95_source = \"s\""),
            Ok(())
        );
        for (text, named) in [
            ("plant = \"\"", "report.plant"),
            ("operator = \"a\\nb\"", "report.operator"),
            ("tread_circumference_mm = 0.0", "report.tread_circumference_mm = 0: must be from 500"),
            ("a90_95_mm = 12.0", "report.a90_95_source is left out"),
        ] {
            let error = parsed(text).unwrap_err();
            assert!(error.contains(named), "{text}: {error}");
        }
    }
}
