//! Whether stations' disks suffice while networks and centres are away: a year of 1000 stations, minute by minute.

use std::fmt::Write as _;

use anyhow::Result;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

const MINUTE_S: f64 = 60.0;
const MINUTES: u32 = 365 * 24 * 60;
const DAY_S: f64 = 86_400.0;
const SEEDS: u64 = 5;
/// How often what is left of the centre's capacity is shared again in a minute.
const SHARED: usize = 4;

/// The stations, and what their centre can take.
pub(crate) struct Plant {
    pub stations: usize,
    /// What each makes.
    pub bytes_per_s: f64,
    /// How many times as much as all stations make the centre can take.
    pub headroom: f64,
}

/// How often what is away, and how long: both exponentially distributed.
pub(crate) struct Outages {
    /// Days between, and hours of, an outage of one site's network.
    pub site: (f64, f64),
    /// The same of the centre.
    pub centre: (f64, f64),
    /// Longest outage of the centre, which each year has once, in hours.
    pub longest_h: f64,
}

impl Default for Outages {
    fn default() -> Self {
        Self { site: (7.0, 2.0), centre: (90.0, 6.0), longest_h: 72.0 }
    }
}

/// Whether something is there, minute by minute.
struct State {
    is_up: bool,
    minutes_left: f64,
}

impl State {
    fn new(random: &mut ChaCha8Rng, (days, _): (f64, f64)) -> Self {
        Self { is_up: true, minutes_left: exponential(random, days * 24.0 * 60.0) }
    }

    fn step(&mut self, random: &mut ChaCha8Rng, (days, hours): (f64, f64)) -> bool {
        self.minutes_left -= 1.0;
        if self.minutes_left <= 0.0 {
            self.is_up = !self.is_up;
            self.minutes_left = exponential(random, if self.is_up { days * 24.0 * 60.0 } else { hours * 60.0 });
        }
        self.is_up
    }
}

fn exponential(random: &mut ChaCha8Rng, mean: f64) -> f64 {
    -mean * (1.0 - random.random::<f64>()).ln()
}

/// The largest amount that each station ever kept for the centre, in bytes.
fn peaks(plant: &Plant, outages: &Outages, seed: u64) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut sites: Vec<State> = (0..plant.stations).map(|_| State::new(&mut random, outages.site)).collect();
    let mut centre = State::new(&mut random, outages.centre);
    let made = plant.bytes_per_s * MINUTE_S;
    let capacity = made * plant.stations as f64 * plant.headroom;
    let longest_from = random.random_range(0..MINUTES / 2);
    let longest = longest_from..longest_from + (outages.longest_h * 60.0) as u32;
    let (mut kept, mut peaks) = (vec![0.0; plant.stations], vec![0.0_f64; plant.stations]);
    for minute in 0..MINUTES {
        kept.iter_mut().for_each(|kept| *kept += made);
        let is_up = centre.step(&mut random, outages.centre) && !longest.contains(&minute);
        let up: Vec<bool> = sites.iter_mut().map(|site| site.step(&mut random, outages.site)).collect();
        let mut left = if is_up { capacity } else { 0.0 };
        for _ in 0..SHARED {
            let waiting = kept.iter().zip(&up).filter(|&(&kept, &up)| up && kept > 0.0).count();
            if waiting == 0 || left <= 0.0 {
                break;
            }
            let share = left / waiting as f64;
            for (kept, _) in kept.iter_mut().zip(&up).filter(|(kept, up)| **up && **kept > 0.0) {
                let taken = if *kept < share { *kept } else { share };
                *kept -= taken;
                left -= taken;
            }
        }
        for (peak, kept) in peaks.iter_mut().zip(&kept) {
            if *kept > *peak {
                *peak = *kept;
            }
        }
    }
    peaks
}

/// The section of the page.
pub(crate) fn text(plant: &Plant, outages: &Outages) -> Result<String> {
    let mut all: Vec<f64> = (0..SEEDS).flat_map(|seed| peaks(plant, outages, seed)).collect();
    let day = plant.bytes_per_s * DAY_S;
    let stated = 7.0;
    let over = all.iter().filter(|&&peak| peak > stated * day).count();
    let [half, most_of_them, most] = [0.5, 0.99, 1.0].map(|q| tapline_bench::quantile(&mut all, q) / day);
    let mut text = String::from("## While the network is away\n\n");
    let Outages { site, centre, longest_h } = outages;
    writeln!(
        text,
        "{} stations for a year, {SEEDS} seeds, minute by minute. On average, a site's network is away every {} days for {} h, and the \
         centre every {} days for {} h. Once the centre is away for {longest_h} h. It can take {} times what the stations make. What a station has to \
         keep for the centre at most:\n\n| half of the stations | 99 of 100 | the most of any | room for {stated} days ({:.1} GB) overflows at |\n|--:|--:|--:|--:|\n\
         | {half:.1} days | {most_of_them:.1} days | {most:.1} days | {over} of {} stations |\n",
        plant.stations,
        site.0,
        site.1,
        centre.0,
        centre.1,
        plant.headroom,
        stated * day / 1e9,
        SEEDS as usize * plant.stations
    )?;
    text.push_str(
        "A station keeps its files until people remove them, so that its disk is far larger than that in any case.\n",
    );
    Ok(text)
}
