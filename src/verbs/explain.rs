//! `tapline explain`: where the numbers of an archive come from.

use std::fmt::{self, Write as _};
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use serde::Serialize;
use tapline_fuse::ReferenceSet;
use tapline_host::similar::did_you_mean;
use tapline_host::stdout::Stdout;
use tapline_host::table::{break_between_words, table};
use tapline_store::{Reader, hex_of, lineage_changes};
use tapline_wire::{Calibration, Certificate, Channel, Discriminator, Scan, TapState};

use crate::archives::work::Work;
use crate::archives::{Archives, Which};
use crate::config::Config;
use crate::config::lineage::{made_by, shown_value};
use crate::config::reference::fusion_of;
use crate::shown::verdict::ShoulderVerdict;

/// Prints where the results of the archives at `paths` come from; for one shoulder, and one location of it, also the numbers. Of
/// many archives only those that have that shoulder are explained.
pub(crate) fn explain(
    paths: &[PathBuf],
    which: Which,
    shoulder: Option<&str>,
    location: Option<u32>,
    as_json: bool,
) -> Result<bool> {
    let archives = Archives::find(paths, which)?;
    let mut work = Work::on(&archives);
    let mut explained_count = 0;
    let mut others: Vec<String> = Vec::new();
    for file in &archives.files {
        let Some(reader) = work.open(file)? else { continue };
        if archives.is_many && shoulder.is_some_and(|name| number_of(&reader, name).is_none()) {
            others.extend(reader.plan().scans().iter().map(Scan::to_string));
            continue;
        }
        let explained = Explanation::of(&reader, shoulder, location);
        let Some(explanation) = work.take(file, explained)? else { continue };
        let text = match as_json {
            true => format!("{}\n", serde_json::to_string(&explanation)?),
            false if explained_count > 0 => format!("\n{explanation}"),
            false => explanation.to_string(),
        };
        work.beside(|| print(&text))?;
        explained_count += 1;
    }
    let is_complete = work.end()?;
    match shoulder.filter(|_| explained_count == 0 && is_complete) {
        Some(name) => {
            let meant = shoulders_meant(name, &others);
            let example = others.first().map(|other| format!("shoulders are named like {other}"));
            let hint = meant.or(example).map_or_else(String::new, |hint| format!(": {hint}"));
            let of = match archives.files.len() {
                1 => "the archive has no".to_owned(),
                count => format!("none of the {count} archives has a"),
            };
            bail!("{of} shoulder {name:?}{hint}")
        }
        None => Ok(is_complete),
    }
}

/// Where the numbers of one archive come from.
#[derive(Debug, Serialize)]
struct Explanation {
    archive: String,
    lineage: String,
    archived: usize,
    refused: usize,
    missing: usize,
    codec: String,
    raw_digest: String,
    plan_digest: String,
    /// Digest of the reference file; absent where the reference is in none, or in one that this program cannot read.
    reference_digest: Option<String>,
    /// What the samples are worth, and where that comes from.
    calibration: Calibration,
    /// Parts of the program whose sources are not those of this one.
    other_sources: Vec<String>,
    options: Vec<OtherOption>,
    shoulder: Option<ShoulderExplanation>,
}

/// An option that does not have its default.
#[derive(Debug, Serialize)]
struct OtherOption {
    key: String,
    /// Empty where it is not set.
    value: String,
    default: String,
}

/// What is known of a shoulder.
#[derive(Debug, Serialize)]
struct ShoulderExplanation {
    name: String,
    /// `None` until it is judged.
    verdict: Option<ShoulderVerdict>,
    location: Option<LocationExplanation>,
}

#[derive(Debug, Serialize)]
struct LocationExplanation {
    location: u32,
    damage_index: Option<f64>,
    region: Option<u32>,
    /// What each discriminator says by itself, [`tapline_fuse::Fusion::alone`]; absent if it says nothing.
    scores: Vec<(&'static str, Option<f64>)>,
    taps: Vec<TapExplanation>,
}

/// What was found in a tap; `values` are in the order of [`Discriminator::ALL`].
#[derive(Debug, Serialize)]
struct TapExplanation {
    offset_mm: Option<f64>,
    velocity_m_per_s: Option<f64>,
    repetition: u16,
    attempt: Option<u32>,
    values: Vec<(&'static str, Option<f64>)>,
    /// Its flags; where nothing was found, what became of it.
    quality: String,
}

impl Explanation {
    fn of(reader: &Reader, shoulder: Option<&str>, location: Option<u32>) -> Result<Self> {
        let count = |state| reader.ledger().count(state);
        let here = made_by(&Config::default())?;
        let (sources, options): (Vec<_>, Vec<_>) = lineage_changes(&here, reader.made_by())
            .into_iter()
            .partition(|(key, ..)| !key.contains('.') || key.starts_with("sources."));
        let option = |(key, default, value): (String, String, String)| {
            let value = shown_value(&key, value, reader.plan());
            OtherOption { key, value, default }
        };
        Ok(Self {
            archive: reader.path().display().to_string(),
            lineage: reader.lineage_key()?,
            archived: count(TapState::Archived),
            refused: count(TapState::Refused),
            missing: count(TapState::Missing),
            codec: reader.codec().to_string(),
            raw_digest: hex_of(&reader.raw_digest()?),
            plan_digest: format!("{:016x}", reader.plan().digest()),
            reference_digest: reader
                .reference()
                .and_then(|text| Some(ReferenceSet::parse(text).ok()?.digest().to_owned())),
            calibration: reader.plan().recording.calibration.clone(),
            other_sources: sources.into_iter().map(|(key, ..)| key.trim_start_matches("sources.").to_owned()).collect(),
            options: options.into_iter().map(option).collect(),
            shoulder: shoulder.map(|name| ShoulderExplanation::of(reader, name, location)).transpose()?,
        })
    }
}

/// Number of the scan of the shoulder `name`.
fn number_of(reader: &Reader, name: &str) -> Option<usize> {
    reader.plan().scans().iter().position(|scan| scan.to_string() == name)
}

/// Which of the shoulders `known` were meant by `name`: those of a casing of that name, or the most similar.
fn shoulders_meant(name: &str, known: &[String]) -> Option<String> {
    let of_casing = |shoulder: &&String| shoulder.rsplit_once('/').is_some_and(|(casing, _)| casing == name);
    let of_casing: Vec<&str> = known.iter().filter(of_casing).map(String::as_str).collect();
    match of_casing.is_empty() {
        true => did_you_mean(name, known.iter().map(String::as_str)),
        false => Some(format!("that casing has {}", of_casing.join(" and "))),
    }
}

impl ShoulderExplanation {
    fn of(reader: &Reader, name: &str, location: Option<u32>) -> Result<Self> {
        let number = number_of(reader, name).with_context(|| {
            let known: Vec<String> = reader.plan().scans().iter().map(Scan::to_string).collect();
            let hint = shoulders_meant(name, &known).unwrap_or_else(|| format!("it has {}", known.join(", ")));
            format!("the archive has no shoulder {name:?}: {hint}")
        })?;
        let judged = &reader.judgements()?[number];
        let scan = &reader.plan().scans()[number];
        let verdict = judged.as_ref().map(|judged| ShoulderVerdict::new(reader, scan, judged));
        let explain = |location: u32| {
            let cells = judged.as_ref().map_or(&[][..], |(_, cells)| &cells[..]);
            let cell = cells.iter().find(|cell| cell.location == location);
            let taps = taps_at(reader, number, location)?;
            if taps.is_empty() {
                let known = reader.plan().scans()[number].locations.iter().map(|&(location, _)| location);
                let (first, last) = (known.clone().min().unwrap_or(0), known.max().unwrap_or(0));
                bail!("shoulder {name} has no location {location}: its locations are from {first} to {last}");
            }
            Ok(LocationExplanation {
                location,
                damage_index: cell.map(|cell| cell.damage_index).filter(|index| index.is_finite()),
                region: cell.map(|cell| cell.region),
                scores: scores_at(reader, number, location)?,
                taps,
            })
        };
        Ok(Self { name: name.to_owned(), verdict: verdict.transpose()?, location: location.map(explain).transpose()? })
    }
}

/// What each discriminator by itself says of a location of scan `number`; nothing if this program cannot read the
/// configuration or the reference.
fn scores_at(reader: &Reader, number: usize, location: u32) -> Result<Vec<(&'static str, Option<f64>)>> {
    let config = Config::parse(reader.config());
    let set = reader.reference().map(ReferenceSet::parse).transpose();
    let (Ok(config), Ok(set)) = (config, set) else { return Ok(Vec::new()) };
    let Some(mut fusion) = fusion_of(reader, &config.fuse, set.map(Arc::new))? else { return Ok(Vec::new()) };
    let place = reader.plan().scans()[number].locations.iter().position(|&(known, _)| known == location);
    let score = |which| -> Result<_> {
        let scores = fusion.alone(number, which)?;
        Ok((which.column(), place.map(|place| scores[place]).filter(|score| score.is_finite())))
    };
    Discriminator::ALL.into_iter().map(score).collect()
}

/// What was found in the taps of a location of the scan with this `number`.
fn taps_at(reader: &Reader, number: usize, location: u32) -> Result<Vec<TapExplanation>> {
    let (plan, found) = (reader.plan(), reader.discriminators()?);
    let rows = plan.scans()[number].taps.iter().copied();
    let of_row = |row: u32| {
        let (id, found) = (plan.taps()[row as usize].id, &found[row as usize]);
        let value = |which| found.as_ref().and_then(|found| found.values.get(which));
        TapExplanation {
            offset_mm: id.offset_mm(),
            velocity_m_per_s: id.velocity_m_per_s(),
            repetition: id.repetition,
            attempt: reader.attempt(row).map(Into::into),
            values: Discriminator::ALL.into_iter().map(|which| (which.column(), value(which))).collect(),
            quality: match found {
                Some(found) => found.quality.to_string(),
                None => reader.ledger().taps()[row as usize].name().to_owned(),
            },
        }
    };
    Ok(rows.filter(|&row| plan.taps()[row as usize].id.location == location).map(of_row).collect())
}

impl fmt::Display for Explanation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { archived, refused, missing, codec, .. } = self;
        writeln!(f, "{}", self.archive)?;
        writeln!(f, "lineage    {}", self.lineage)?;
        writeln!(f, "taps       {archived} archived, {refused} refused, {missing} missing; packed by {codec}")?;
        writeln!(f, "raw data   {}", self.raw_digest)?;
        writeln!(f, "plan       {}", self.plan_digest)?;
        match &self.reference_digest {
            Some(digest) => writeln!(f, "reference  a file with the digest {digest}")?,
            None => {
                let named = self.options.iter().find(|option| option.key == "fuse.reference");
                let named = named.map_or("none", |option| option.value.trim_matches('"'));
                writeln!(
                    f,
                    "reference  {named}{}",
                    if named == "a file" { " that cannot be read" } else { ", not from a file" }
                )?;
            }
        }
        for channel in Channel::BOTH {
            let unit = self.calibration.unit(channel).name();
            match &self.calibration.of(channel).certificate {
                None => writeln!(f, "{:<10} in {unit}, not calibrated", channel.name())?,
                Some(Certificate { method, date, valid_until, .. }) => {
                    // What is computed has neither a day nor an end.
                    let days = valid_until.as_ref().map(|until| format!(", {date}, valid until {until}"));
                    writeln!(f, "{:<10} in {unit}: {method}{}", channel.name(), days.unwrap_or_default())?;
                }
            }
        }
        match self.other_sources.is_empty() {
            true => writeln!(f, "made by    this program's own sources")?,
            false => writeln!(f, "made by    other sources than this program's: {}", self.other_sources.join(", "))?,
        }
        let how = if self.options.is_empty() { "all are defaults" } else { "other than the defaults:" };
        writeln!(f, "options    {how}")?;
        let set = |text: &str| if text.is_empty() { "not set".to_owned() } else { text.to_owned() };
        for OtherOption { key, value, default } in &self.options {
            writeln!(f, "           {key} = {} (default {})", set(value), set(default))?;
        }
        self.shoulder.iter().try_for_each(|shoulder| shoulder.fmt(f))
    }
}

impl fmt::Display for ShoulderExplanation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, verdict, location } = self;
        match verdict {
            None => writeln!(f, "shoulder   {name}: not judged")?,
            Some(verdict) => {
                let reasons = Some(verdict.why(", ", &[], &[])).filter(|reasons| !reasons.is_empty());
                let reasons = reasons.map_or_else(String::new, |reasons| format!(", for {reasons}"));
                writeln!(f, "shoulder   {name}: {}{reasons}", verdict.verdict)?;
                let number =
                    |value: Option<f64>| value.map_or_else(|| "none".to_owned(), |value| format!("{value:.3}"));
                let ShoulderVerdict { strongest_arc, limit_re_inspect, limit_reject, whole, .. } = verdict;
                let limits = format!("limits {} and {}", number(*limit_re_inspect), number(*limit_reject));
                writeln!(f, "arc        strongest {}, {limits}", number(*strongest_arc))?;
                for (what, times) in [("level  ", &whole.level), ("scatter", &whole.scatter)] {
                    let all: Vec<String> = times.iter().map(|(which, times)| format!("{which} {times:.2}")).collect();
                    if !all.is_empty() {
                        writeln!(f, "{what}    {} times the reference's", all.join(", "))?;
                    }
                }
            }
        }
        let Some(LocationExplanation { location, damage_index, region, scores, taps }) = location else {
            return Ok(());
        };
        match (damage_index, region) {
            (Some(index), Some(region)) => writeln!(f, "location   {location}: index {index:.4}, region {region}")?,
            (None, Some(_)) => writeln!(f, "location   {location}: it has no index")?,
            (_, None) => {}
        }
        write!(f, "{}", texts_of(taps, scores)?)
    }
}

/// Taps side by side in a table: as many as fit 80 columns.
const TAPS_SIDE_BY_SIDE: usize = 4;

/// The taps as tables, a column each, and the scores behind them.
fn texts_of(taps: &[TapExplanation], scores: &[(&str, Option<f64>)]) -> Result<String, fmt::Error> {
    let mut text = String::new();
    let short = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    for taps in taps.chunks(TAPS_SIDE_BY_SIDE) {
        let row = |name: &str, score: &str, cell: &dyn Fn(&TapExplanation) -> String| {
            let last = std::iter::once(score.to_owned()).filter(|_| !scores.is_empty());
            std::iter::once(name.to_owned()).chain(taps.iter().map(cell)).chain(last).collect::<Vec<_>>()
        };
        let mut table = table(row("offset_mm", "score", &|tap| short(tap.offset_mm)));
        table.add_row(row("velocity_m_per_s", "", &|tap| short(tap.velocity_m_per_s)));
        table.add_row(row("repetition", "", &|tap| tap.repetition.to_string()));
        table.add_row(row("attempt", "", &|tap| tap.attempt.map_or(String::new(), |attempt| attempt.to_string())));
        for (number, which) in Discriminator::ALL.into_iter().enumerate() {
            let value = |tap: &TapExplanation| tap.values.get(number).and_then(|(_, value)| *value);
            let score = scores.get(number).and_then(|(_, score)| *score);
            let score = score.map_or_else(String::new, |score| format!("{score:.2}"));
            let of_tap = |tap: &TapExplanation| value(tap).map_or(String::new(), |value| format!("{value:.4e}"));
            table.add_row(row(which.column(), &score, &of_tap));
        }
        table.add_row(row("quality", "", &|tap| tap.quality.clone()));
        break_between_words(&mut table);
        writeln!(text, "{table}")?;
    }
    if !scores.is_empty() {
        writeln!(text, "score: what each says by itself of the location and its neighbours; damage raises it")?;
    }
    Ok(text)
}

/// Prints `text`.
pub(super) fn print(text: &str) -> Result<()> {
    Ok(write!(Stdout, "{text}")?)
}
