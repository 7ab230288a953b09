//! `tapline devices`: what can be listened to.

use std::io::Write as _;

use anyhow::{Context as _, Result};
use comfy_table::Table;
use comfy_table::presets::UTF8_HORIZONTAL_ONLY;
use tapline_acquire::{Abilities, sound_cards};

/// Lists the sound cards of this machine, or those of these `names`; whether there is one.
pub(crate) fn devices(names: &[String]) -> Result<bool> {
    let cards = sound_cards(names).map_err(anyhow::Error::msg).context("ALSA cannot list its devices")?;
    let mut out = std::io::stdout();
    if cards.is_empty() {
        writeln!(out, "no sound card can be listened to here")?;
        return Ok(false);
    }
    let mut table = Table::new();
    table.load_style(UTF8_HORIZONTAL_ONLY).set_header(["device", "channels", "rate, Hz", "bits", "what it is"]);
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
    writeln!(out, "{table}")?;
    Ok(cards.iter().any(|card| card.abilities.is_ok()))
}
