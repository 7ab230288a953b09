//! `tapline devices`: the usable sound cards.

use std::io::Write as _;

use anyhow::{Context as _, Result};
use serde_json::json;
use tapline_acquire::{Abilities, SoundCardInfo, sound_cards};
use tapline_host::stdout::Stdout;
use tapline_host::table::{break_last_column, table};

/// Lists the sound cards of this machine, or those of these `names`; whether there is one.
pub(crate) fn devices(names: &[String], as_json: bool) -> Result<bool> {
    let cards = sound_cards(names).map_err(anyhow::Error::msg).context("ALSA cannot list its devices")?;
    let mut out = Stdout;
    if as_json {
        cards.iter().try_for_each(|card| writeln!(out, "{}", of(card)))?;
        return Ok(cards.iter().any(|card| card.abilities.is_ok()));
    }
    if cards.is_empty() {
        writeln!(out, "this machine has no sound card to listen to")?;
        return Ok(false);
    }
    let mut table = table(["device", "channels", "rate, Hz", "bits", "what it is"]);
    let range =
        |(least, most): (u32, u32)| if least == most { least.to_string() } else { format!("{least} to {most}") };
    for card in &cards {
        let [channels, rates, bits] = match &card.abilities {
            Ok(Abilities { channels, rates_hz, bits }) => {
                let bits: Vec<String> = bits.iter().map(u16::to_string).collect();
                [range(*channels), range(*rates_hz), bits.join(", ")]
            }
            Err(_) => Default::default(),
        };
        let what = card.abilities.as_ref().err().unwrap_or(&card.description).clone();
        table.add_row([card.name.clone(), channels, rates, bits, what]);
    }
    break_last_column(&mut table);
    writeln!(out, "{table}")?;
    Ok(cards.iter().any(|card| card.abilities.is_ok()))
}

/// A card as JSON.
fn of(card: &SoundCardInfo) -> serde_json::Value {
    let abilities = card.abilities.as_ref().ok();
    json!({
        "name": card.name,
        "description": card.description,
        "channels": abilities.map(|abilities| abilities.channels),
        "rates_hz": abilities.map(|abilities| abilities.rates_hz),
        "bits": abilities.map(|abilities| &abilities.bits),
        "problem": card.abilities.as_ref().err(),
    })
}
