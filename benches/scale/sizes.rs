//! What many stations need, from the costs of one tap.

use std::fmt::Write as _;

use anyhow::Result;

use crate::costs::Costs;

/// Most taps of a rig.
const TAPS_PER_S: f64 = 2.5;

const STATIONS: [f64; 4] = [1.0, 30.0, 1000.0, 100_000.0];
const DAY_S: f64 = 86_400.0;
/// A network of 1 Gbit/s, less its frames.
const NETWORK_BYTES_PER_S: f64 = 118e6;
/// Cores of a host.
const CORES: f64 = 16.0;
/// Part of a core or server that is used at most, so that what has piled up can be worked off.
const USED: f64 = 0.5;

/// The tables of the page.
pub(crate) fn text(costs: &Costs) -> Result<String> {
    let rates = STATIONS.map(|stations| stations * TAPS_PER_S);
    let us = |step: usize| costs.steps.get(step).map_or(f64::NAN, |step| step.us());
    let mut text = format!(
        "## What stations need\n\nA station makes {TAPS_PER_S} taps/s, day and night: one every 0.4 s. Half of the stations' cores and of each server is kept free, to \
         work off what has piled up.\n\n| | {} |\n|---|{}\n",
        STATIONS.map(|stations| format!("{stations:.0} station{}", if stations > 1.0 { "s" } else { "" })).join(" | "),
        "--:|".repeat(STATIONS.len())
    );
    let mut row = |what: &str, of: &dyn Fn(f64) -> f64| -> Result<()> {
        writeln!(text, "| {what} | {} |", rates.map(|rate| shown(of(rate))).join(" | "))?;
        Ok(())
    };
    let bytes = costs.bytes_per_tap;
    row("taps/s", &|rate| rate)?;
    row("cores of the stations, all together", &|rate| rate * us(0) * 1e-6 / USED)?;
    row("network to the centre, MB/s", &|rate| rate * bytes / 1e6)?;
    row("disk, GB a day", &|rate| rate * bytes * DAY_S / 1e9)?;
    row("disk, TB a year", &|rate| rate * bytes * DAY_S * 365.0 / 1e12)?;
    if let Some(way) = &costs.way {
        row("servers of NATS, with the collector of each", &|rate| (rate / (way.taps_per_s * USED)).ceil())?;
        row("cores of servers and collectors", &|rate| rate * (way.us[1] + way.us[2]) * 1e-6 / USED)?;
    }
    row("cores that judge a year again in a day", &|rate| rate * 365.0 * us(3) * 1e-6)?;
    writeln!(
        text,
        "\nWhat limits first, as stations are added to one of each:\n\n| what | stations that use half of it |\n|---|--:|"
    )?;
    let mut limits = vec![
        (
            format!("a host of stations with {CORES} cores, without listening"),
            CORES * USED / (us(0) * 1e-6 * TAPS_PER_S),
        ),
        ("a network of 1 Gbit/s at the centre".to_owned(), NETWORK_BYTES_PER_S * USED / (bytes * TAPS_PER_S)),
    ];
    if let Some(way) = &costs.way {
        limits.push(("a server of NATS with its collector".to_owned(), way.taps_per_s * USED / TAPS_PER_S));
    }
    limits.sort_by(|a, b| a.1.total_cmp(&b.1));
    for (what, stations) in limits {
        writeln!(text, "| {what} | {} |", shown(stations))?;
    }
    text.push_str(
        "\nThe row of the host is for taps at full speed: at the pace of a rig a tap costs twice as much. Listening and memory set lower limits: \
         [operating.md](operating.md#how-many-stations).\n\nSites are independent of each other: beyond what one server or network can carry, a second server with its own bucket takes the next sites. \
         Nothing is shared by all stations.\n",
    );
    Ok(text)
}

/// Two or three digits that count.
fn shown(value: f64) -> String {
    match value {
        value if value < 0.01 => format!("{value:.4}"),
        value if value < 1.0 => format!("{value:.2}"),
        value if value < 10.0 => format!("{value:.1}"),
        value => format!("{value:.0}"),
    }
}
