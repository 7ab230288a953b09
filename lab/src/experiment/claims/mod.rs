//! What chapter 5 claims, and what the simulated experiment finds.

mod contact;
mod discriminators;
mod effects;
mod inspection;

use std::fmt;

use anyhow::{Context as _, Result};
use tapline_fuse::auc;
use tapline_wire::Discriminator;

use super::dataset::{Experiment, Tap};
use crate::evaluation::Table;

/// Whether what is found is what is claimed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Agrees {
    Yes,
    No,
    /// The simulation does not decide it.
    NotTestable,
}

impl From<bool> for Agrees {
    fn from(is_so: bool) -> Self {
        if is_so { Self::Yes } else { Self::No }
    }
}

impl fmt::Display for Agrees {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(["yes", "no", "not testable"][*self as usize])
    }
}

/// A claim and what became of it.
#[derive(Debug, Clone)]
pub(super) struct Claim {
    pub id: &'static str,
    /// Section and figure.
    pub place: &'static str,
    /// The claim in our words.
    pub claim: &'static str,
    /// What is measured.
    pub quantity: &'static str,
    /// The dissertation's value of that; empty if it gives none.
    pub dissertation: &'static str,
    pub ours: String,
    pub agrees: Agrees,
    /// What agreement needs, and what of it was built into the simulation; true for any result.
    pub remark: &'static str,
}

impl Claim {
    /// A claim without a number in the dissertation that nothing here decides.
    fn new(id: &'static str, place: &'static str) -> Self {
        let (claim, quantity, dissertation, remark) = ("", "", "", "");
        Self { id, place, claim, quantity, dissertation, ours: String::new(), agrees: Agrees::NotTestable, remark }
    }

    fn claim(self, claim: &'static str) -> Self {
        Self { claim, ..self }
    }

    fn quantity(self, quantity: &'static str) -> Self {
        Self { quantity, ..self }
    }

    fn dissertation(self, dissertation: &'static str) -> Self {
        Self { dissertation, ..self }
    }

    fn ours(self, ours: String) -> Self {
        Self { ours, ..self }
    }

    fn agrees(self, agrees: impl Into<Agrees>) -> Self {
        Self { agrees: agrees.into(), ..self }
    }

    fn remark(self, remark: &'static str) -> Self {
        Self { remark, ..self }
    }
}

/// All claims, in the order of the chapter.
pub(super) fn claims(experiment: &Experiment) -> Result<Vec<Claim>> {
    let mut claims = contact::claims(experiment)?;
    claims.extend(effects::claims(experiment)?);
    claims.extend(discriminators::claims(experiment)?);
    claims.extend(inspection::claims(experiment)?);
    Ok(claims)
}

pub(super) fn csv(claims: &[Claim]) -> Result<String> {
    let mut table = Table::long("claims", "", ["claim", "where", "quantity", "dissertation", "ours", "agrees"]);
    for Claim { id, place, quantity, dissertation, ours, agrees, .. } in claims {
        table.push_texts([id, place, quantity, dissertation, ours.as_str(), &agrees.to_string()].map(str::to_owned));
    }
    table.csv()
}

/// The page above its table.
const HEAD: &str = include_str!("head.md");

/// The page: the head, what was drawn, and the table of claims; `folder` is that of the figures.
pub(super) fn page(claims: &[Claim], seed: u64, figures: &[(&str, &str)], folder: &str) -> String {
    let count = |agrees| claims.iter().filter(|claim| claim.agrees == agrees).count();
    let (yes, no, open) = (count(Agrees::Yes), count(Agrees::No), count(Agrees::NotTestable));
    let mut page = HEAD.replace("SEED", &seed.to_string());
    page.push_str(&format!(
        "\n## Claims\n\nOf {} claims {yes} agree, {no} do not, and {open} cannot be tested on a simulated tyre.\n\n\
         | claim | where | in the dissertation | here | agrees | what agreement needs, and why |\n|---|---|---|---|---|---|\n",
        claims.len()
    ));
    for Claim { id, place, claim, quantity, dissertation, ours, agrees, remark } in claims {
        let given = if dissertation.is_empty() { "no number" } else { dissertation };
        page.push_str(&format!("| `{id}`: {claim} | {place} | {given} | {quantity}: {ours} | {agrees} | {remark} |\n"));
    }
    page.push_str(
        "\n## Figures\n\nThe command writes the numbers of each picture beside it, as a CSV of the same name.\n",
    );
    for (name, title) in figures {
        page.push_str(&format!("\n![{title}]({folder}/{name}.svg)\n"));
    }
    page
}

/// `value` to three significant digits.
fn digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let places = (2.0 - value.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{value:.places$}")
}

/// Values to three digits each, joined by `joint`.
fn list(values: &[f64], joint: &str) -> String {
    values.iter().map(|&value| digits(value)).collect::<Vec<_>>().join(joint)
}

/// Values by name.
fn named(values: &[(Discriminator, f64)]) -> String {
    let named: Vec<String> =
        values.iter().map(|(which, value)| format!("{} {}", which.symbol(), digits(*value))).collect();
    named.join(", ")
}

/// The values that `value` has for the taps that `is_in` selects.
fn values(turn: &[&Tap], is_in: impl Fn(&Tap) -> bool, value: impl Fn(&Tap) -> Option<f64>) -> Vec<f64> {
    turn.iter().filter(|tap| is_in(tap)).filter_map(|tap| value(tap)).collect()
}

/// A statistic that must be there.
fn known(value: Option<f64>) -> Result<f64> {
    value.context("too few values for a claim")
}

/// Probability that a cracked place has the greater value: area under the ROC curve.
fn auc_of(sound: &[f64], cracked: &[f64]) -> Result<f64> {
    let scores: Vec<f64> = sound.iter().chain(cracked).copied().collect();
    let labels: Vec<bool> = sound.iter().map(|_| false).chain(cracked.iter().map(|_| true)).collect();
    known(auc(&scores, &labels))
}

/// The largest of `values`, or the least for `sign` -1.
fn extreme(values: impl IntoIterator<Item = f64>, sign: f64) -> Result<f64> {
    known(values.into_iter().max_by(|a, b| (sign * a).total_cmp(&(sign * b))))
}

/// Whether every value is above the one before.
fn rises(values: &[f64]) -> bool {
    values.windows(2).all(|pair| pair[1] > pair[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches lost or invented digits.
    #[test]
    fn numbers_have_three_digits() {
        assert_eq!(list(&[0.0, 1.2345, 12.345, 1234.5, 0.012_345, -0.5], " "), "0 1.23 12.3 1234 0.0123 -0.500");
    }

    /// Catches a table whose columns a claim can break, and a count that is not the table's.
    #[test]
    fn the_page_has_a_row_a_claim() {
        let claim = Claim::new("id", "5.4").claim("claim").quantity("quantity").ours("1 N".to_owned()).remark("remark");
        let page = page(&[claim.clone().agrees(false), claim], 7, &[("fig60", "Fig. 60")], "to");
        assert!(page.contains("This page has seed 7.") && !page.contains("SEED"), "{page}");
        assert!(page.contains("\n| `id`: claim | 5.4 | no number | quantity: 1 N | no | remark |\n"), "{page}");
        assert!(
            page.contains("Of 2 claims 0 agree, 1 do not, and 1 cannot") && page.contains("(to/fig60.svg)"),
            "{page}"
        );
    }
}
