//! `tapline explain` and `diff`: where numbers come from, and what changed between two archives.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use comfy_table::Table;
use comfy_table::presets::UTF8_HORIZONTAL_ONLY;
use tapline_store::{Judged, Reader, digest_of, hex_of};
use tapline_wire::{Discriminator, Discriminators, Scan, TapState, Verdict};

use crate::archives::{ArchiveFile, Archives, Outcome, Which, of_archive};
use crate::config::Config;
use crate::config::lineage::{changes, made_by};

/// Prints where the results of the archives at `paths` come from; for one shoulder, and one location of it, also the numbers. Of many archives only those that have that shoulder are explained.
pub(crate) fn explain(paths: &[PathBuf], which: Which, shoulder: Option<&str>, location: Option<u32>) -> Result<bool> {
    if shoulder.is_none() && location.is_some() {
        bail!("--location needs --shoulder TYRE/SHOULDER");
    }
    let archives = Archives::find(paths, which)?;
    let mut outcome = Outcome::new(&archives);
    let mut explained_count = 0;
    for file in &archives.files {
        let Some(reader) = outcome.take(file, Reader::open(&file.path))? else { continue };
        if archives.is_many && shoulder.is_some_and(|name| number_of(&reader, name).is_none()) {
            continue;
        }
        let Some(text) = outcome.take(file, explained(&reader, shoulder, location))? else { continue };
        print(&if explained_count > 0 { format!("\n{text}") } else { text })?;
        explained_count += 1;
    }
    let is_complete = outcome.end()?;
    match shoulder.filter(|_| explained_count == 0 && is_complete) {
        Some(name) => bail!("none of the {} archives has a shoulder {name:?}", archives.files.len()),
        None => Ok(is_complete),
    }
}

/// The explanation of one archive.
fn explained(reader: &Reader, shoulder: Option<&str>, location: Option<u32>) -> Result<String> {
    let mut text = String::new();
    let count = |state| reader.ledger().count(state);
    writeln!(text, "{}", reader.path().display())?;
    writeln!(text, "lineage    {}", reader.lineage_key()?)?;
    let (archived, refused, missing) = (count(TapState::Archived), count(TapState::Refused), count(TapState::Missing));
    writeln!(
        text,
        "taps       {archived} archived, {refused} refused, {missing} missing; packed by {}",
        reader.codec()
    )?;
    writeln!(text, "raw data   {}", hex_of(&reader.raw_digest()?))?;
    writeln!(text, "plan       {:016x}", reader.plan().digest())?;
    let reference = reader.reference().map_or("no file; fuse.reference names it".to_owned(), |text| {
        format!("a file, BLAKE3 {}", hex_of(&digest_of(text.as_bytes())))
    });
    writeln!(text, "reference  {reference}")?;
    let here = made_by(&Config::default())?;
    let (sources, options): (Vec<_>, Vec<_>) = changes(&here, reader.made_by())
        .into_iter()
        .partition(|(key, ..)| !key.contains('.') || key.starts_with("sources."));
    let sources: Vec<&str> = sources.iter().map(|(key, ..)| key.trim_start_matches("sources.")).collect();
    match sources.is_empty() {
        true => writeln!(text, "made by    this program's own sources")?,
        false => writeln!(text, "made by    other sources than this program's: {}", sources.join(", "))?,
    }
    writeln!(text, "options    {}", if options.is_empty() { "all as by default" } else { "other than by default:" })?;
    for (key, default, value) in options {
        let default = if default.is_empty() { "not set" } else { &default };
        let value = if value.is_empty() { "not set" } else { &value };
        writeln!(text, "           {key} = {value} (default {default})")?;
    }
    if let Some(name) = shoulder {
        shoulder_of(reader, name, location, &mut text)?;
    }
    Ok(text)
}

/// Number of the scan of the shoulder `name`.
fn number_of(reader: &Reader, name: &str) -> Option<usize> {
    let named = |scan: &Scan| format!("{}/{}", scan.tyre, scan.shoulder);
    reader.plan().scans().iter().position(|scan| named(scan) == name)
}

/// Adds what is known of the shoulder `name`, and of the taps of its location `location`.
fn shoulder_of(reader: &Reader, name: &str, location: Option<u32>, text: &mut String) -> Result<()> {
    let number = number_of(reader, name).with_context(|| format!("the archive has no shoulder {name:?}"))?;
    let scan = &reader.plan().scans()[number];
    match &reader.judgements()?[number] {
        None => writeln!(text, "shoulder   {name}: not judged")?,
        Some((judgement, cells)) => {
            let verdict = Verdict::from_code(judgement.verdict).map_or("unknown".to_owned(), |v| v.to_string());
            let (first, second) = (judgement.limit_re_inspect, judgement.limit_reject);
            writeln!(
                text,
                "shoulder   {name}: {verdict}, for {}; limits {first:.3} and {second:.3}",
                judgement.reasons
            )?;
            let cell = location.and_then(|location| cells.iter().find(|cell| cell.location == location));
            if let Some(cell) = cell {
                writeln!(text, "location   {}: index {:.4}, region {}", cell.location, cell.damage_index, cell.region)?;
            }
        }
    }
    let Some(location) = location else { return Ok(()) };
    let rows: Vec<u32> =
        scan.taps.iter().copied().filter(|&row| reader.plan().taps()[row as usize].id.location == location).collect();
    if rows.is_empty() {
        bail!("shoulder {name} has no location {location}");
    }
    let found = reader.discriminators()?;
    let mut table = Table::new();
    table.load_style(UTF8_HORIZONTAL_ONLY);
    let columns = Discriminator::ALL.map(Discriminator::column);
    table.set_header(
        ["offset_mm", "velocity_m_per_s", "repetition", "attempt"].into_iter().chain(columns).chain(["quality"]),
    );
    for row in rows {
        let id = reader.plan().taps()[row as usize].id;
        let number = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.4e}"));
        let short = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
        let mut cells = vec![short(id.offset_mm()), short(id.velocity_m_per_s()), id.repetition.to_string()];
        cells.push(reader.attempt(row).map_or(String::new(), |attempt| attempt.to_string()));
        match &found[row as usize] {
            Some(found) => {
                cells.extend(Discriminator::ALL.map(|which| number(found.values.get(which))));
                cells.push(found.quality.to_string());
            }
            None => {
                cells.extend(Discriminator::ALL.map(|_| String::new()));
                cells.push(reader.ledger().taps()[row as usize].name().to_owned());
            }
        }
        table.add_row(cells);
    }
    writeln!(text, "{table}")?;
    Ok(())
}

/// Prints what changed from the results at `before` to those at `after`: lineage first, then numbers. Where one is a folder,
/// the casings are paired by name; `which` files of the folder `after` are meant.
pub(crate) fn diff(before: &Path, after: &Path, which: Which) -> Result<bool> {
    if !before.is_dir() && !after.is_dir() {
        return print(&difference(before, after)?);
    }
    let (befores, afters) = (Archives::find(&[before], Which::Casings)?, Archives::find(&[after], which)?);
    let mut partners: BTreeMap<String, &ArchiveFile> =
        afters.files.iter().map(|file| (casing_of(file), file)).collect();
    let mut outcome = Outcome::new(&Archives { is_many: true, ..befores.clone() });
    let alone = |file: &ArchiveFile| print(&format!("{}: without a partner\n", file.path.display()));
    for file in &befores.files {
        match partners.remove(&casing_of(file)) {
            None => outcome.note(!alone(file)?),
            Some(other) => {
                let text = outcome.take(file, difference(&file.path, &other.path))?;
                let named = |text| format!("{} -> {}\n{text}", file.path.display(), other.path.display());
                print(&text.map(named).unwrap_or_default())?;
            }
        }
    }
    // Beside a single file, the other casings of the folder do not count.
    if before.is_dir() && after.is_dir() {
        for file in partners.values() {
            outcome.note(!alone(file)?);
        }
    }
    outcome.end()
}

/// Name of the casing of an archive, or of a file of results.
fn casing_of(file: &ArchiveFile) -> String {
    let name = file.casing();
    match of_archive(&file.path) {
        Some(of) => of.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        None => name,
    }
}

/// What changed from one file to another.
fn difference(before: &Path, after: &Path) -> Result<String> {
    let (a, b) = (Reader::open(before)?, Reader::open(after)?);
    if a.plan().digest() != b.plan().digest() {
        bail!(
            "{} holds scan plan {:016x} and {} {:016x}: their taps cannot be compared one by one",
            before.display(),
            a.plan().digest(),
            after.display(),
            b.plan().digest()
        );
    }
    let mut text = String::new();
    writeln!(text, "lineage    {}", if a.lineage_key()? == b.lineage_key()? { "the same" } else { "another:" })?;
    for (key, before, after) in changes(a.made_by(), b.made_by()) {
        writeln!(text, "           {key}: {before} -> {after}")?;
    }
    if a.raw_digest()? != b.raw_digest()? {
        writeln!(text, "           what was recorded differs, samples or headers")?;
    }
    if a.reference() != b.reference() {
        writeln!(text, "           the reference files differ")?;
    }
    discriminators(&a.discriminators()?, &b.discriminators()?, &mut text)?;
    for ((scan, a), b) in a.plan().scans().iter().zip(a.judgements()?).zip(b.judgements()?) {
        writeln!(text, "{}/{}  {}", scan.tyre, scan.shoulder, judged(a.as_ref(), b.as_ref()))?;
    }
    Ok(text)
}

fn discriminators(a: &[Option<Discriminators>], b: &[Option<Discriminators>], text: &mut String) -> Result<()> {
    let both = || a.iter().zip(b).filter_map(|(a, b)| Some((a.as_ref()?, b.as_ref()?)));
    let only = a.iter().zip(b).filter(|(a, b)| a.is_some() != b.is_some()).count();
    if only > 0 {
        writeln!(text, "taps       {only} are in one of them alone")?;
    }
    for which in Discriminator::ALL {
        let (mut count, mut most) = (0, 0.0);
        for (a, b) in both() {
            let (a, b) = (a.values.get(which), b.values.get(which));
            if a.map(f64::to_bits) != b.map(f64::to_bits) {
                count += 1;
                if let (Some(a), Some(b)) = (a, b) {
                    let relative = (b - a).abs() / a.abs();
                    most = if relative > most { relative } else { most };
                }
            }
        }
        let change = if count == 0 {
            "the same".to_owned()
        } else {
            format!("{count} differ, by {most:.1e} of their value at most")
        };
        writeln!(text, "{:<10} {change}", which.name())?;
    }
    let flags = both().filter(|(a, b)| a.quality != b.quality).count();
    if flags > 0 {
        writeln!(text, "quality    {flags} taps have other flags")?;
    }
    Ok(())
}

/// How a verdict changed.
fn judged(a: Option<&Judged>, b: Option<&Judged>) -> String {
    let (Some((a, map_a)), Some((b, map_b))) = (a, b) else {
        return match (a.is_some(), b.is_some()) {
            (false, false) => "not judged in either".to_owned(),
            (is_there, _) => format!("judged in the {} alone", if is_there { "first" } else { "second" }),
        };
    };
    let verdict = |code| Verdict::from_code(code).map_or("unknown".to_owned(), |verdict| verdict.to_string());
    let (was, is) = (verdict(a.verdict), verdict(b.verdict));
    let mut change = if was == is { was } else { format!("{was} -> {is}") };
    if a.reasons != b.reasons {
        let _infallible = write!(change, ", reasons {} -> {}", a.reasons, b.reasons);
    }
    let differences = map_a.iter().zip(map_b).filter(|(a, b)| a.damage_index.to_bits() != b.damage_index.to_bits());
    let count = differences.clone().count();
    let largest = differences.map(|(a, b)| (b.damage_index - a.damage_index).abs()).max_by(f64::total_cmp);
    let _infallible = match largest {
        None => write!(change, ", index the same"),
        Some(largest) => write!(change, ", index differs at {count} locations, by {largest:.2e} at most"),
    };
    change
}

fn print(text: &str) -> Result<bool> {
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(true),
    }
}
