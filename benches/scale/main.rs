//! What many stations take: unit costs of this machine, how they grow, and what 1 to 100 000 stations need. Writes `docs/scale.md`.
//!
//! Needs the built program (`cargo build --release -p tapline`), and `nats-server` for the way to a centre; without it that
//! part is left out.
//!
//! - `costs`: what a tap costs at each step, for different numbers of casings, stations and archives
//! - `sizes`: what many stations need
#![expect(clippy::print_stdout, reason = "the page is what this program is for")]

mod costs;
mod sizes;

use std::fmt::Write as _;
use std::fs;

use anyhow::Result;
use tapline_bench::root;

use crate::costs::Costs;

fn main() -> Result<()> {
    let costs = Costs::measure()?;
    let mut page = String::from(
        "# From one station to a hundred thousand\n\nFor IT people who plan a plant or a centre: what many stations need in cores, network and disk. \
         `cargo build --release -p tapline && cargo bench -p tapline-bench --bench scale` writes this page. \
         It measures what a tap costs on this machine, and computes what many stations need. Processor times \
         include the simulation of the taps, which a real rig does not need. A casing has 202 taps: one turn of each shoulder, and none is tapped again. \
         It is compared with itself, so judging takes more of a tap's time than in [performance.md](performance.md).\n\n",
    );
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let date = jiff::Zoned::now().strftime("%Y-%m-%d");
    writeln!(
        page,
        "Measured on {date} on {cores} {}; medians of {} rounds.\n",
        if cores == 1 { "core" } else { "cores" },
        costs::ROUNDS
    )?;
    page.push_str(&costs.text()?);
    page.push_str(&sizes::text(&costs)?);
    println!("{page}");
    fs::write(root().join("docs/scale.md"), page)?;
    Ok(())
}
