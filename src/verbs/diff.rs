//! `tapline diff`: what changed between the numbers of two archives of the same taps.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use serde::Serialize;
use serde_json::json;
use tapline_host::messages::counted;
use tapline_store::{Judged, Reader, lineage_changes};
use tapline_wire::{Discriminator, Discriminators, Plan, Recording, Scan, TapId, Verdict};

use crate::archives::work::Work;
use crate::archives::{ArchiveFile, Archives, Which};
use crate::config::lineage::shown_value;
use crate::verbs::explain::print;

/// Prints what changed from the results at `before` to those at `after`, two files or two folders: lineage first, then numbers. Casings of
/// folders are paired by their paths in these, because serials repeat, and only counted if nothing differs, or if `is_summary`. `which` says
/// which files of the folder `after` are taken.
pub(crate) fn diff(before: &Path, after: &Path, which: Which, is_summary: bool, as_json: bool) -> Result<bool> {
    if !before.is_dir() && !after.is_dir() {
        let difference = Difference::between(before, after)?;
        print(&if as_json { line_of(&difference)? } else { difference.to_string() })?;
        return Ok(true);
    }
    ensure!(
        before.is_dir() && after.is_dir(),
        "{} and {}: two files are compared, or two folders",
        before.display(),
        after.display()
    );
    let (befores, afters) = (Archives::find(&[before], Which::Casings)?, Archives::find(&[after], which)?);
    let mut partners: BTreeMap<PathBuf, &ArchiveFile> =
        afters.files.iter().map(|file| (file.archive(), file)).collect();
    let alone = |file: &ArchiveFile| {
        let path = file.path.display().to_string();
        print(&if as_json { format!("{}\n", json!({ "alone": path })) } else { format!("{path}: without a partner\n") })
    };
    let mut work = Work::on(&befores);
    let (mut compared_count, mut same_count, mut changed) = (0, 0, Vec::new());
    for file in &befores.files {
        work.begin(file);
        let Some(other) = partners.remove(&file.archive()) else {
            work.beside(|| alone(file))?;
            work.note(false);
            continue;
        };
        let Some(difference) = work.take(file, Difference::between(&file.path, &other.path))? else { continue };
        compared_count += 1;
        same_count += usize::from(difference.has_same_results());
        let of_verdicts = difference.shoulders.iter().filter_map(ShoulderDifference::verdict_change);
        changed.extend(of_verdicts.map(|change| (file.path.display().to_string(), change)));
        let text = match as_json {
            _ if is_summary => continue,
            true => line_of(&difference)?,
            false if difference.is_none() => continue,
            false => format!("{} -> {}\n{difference}", file.path.display(), other.path.display()),
        };
        work.beside(|| print(&text))?;
    }
    for file in partners.values() {
        work.beside(|| alone(file))?;
        work.note(false);
    }
    let text = match as_json {
        true => {
            let of = |(file, change): &(String, VerdictChange)| json!({ "file": file, "shoulder": change.shoulder, "before": change.before, "after": change.after });
            let of_all = json!({
                "kind": "summary", "compared": compared_count, "same": same_count, "changes": ways(&changed),
                "verdicts_differ": changed.iter().map(of).collect::<Vec<_>>(),
            });
            format!("{of_all}\n")
        }
        false => {
            let casings = counted(compared_count, "casing", "casings");
            let same = counted(same_count, "has the same numbers", "have the same numbers");
            let verdicts = counted(changed.len(), "verdict differs", "verdicts differ");
            let lines: String = changed.iter().map(|(file, change)| format!("{file}: {change}\n")).collect();
            let ways: Vec<String> = ways(&changed).into_iter().map(|(way, count)| format!("{count} {way}")).collect();
            let ways = if ways.is_empty() { String::new() } else { format!(": {}", ways.join(", ")) };
            format!("{casings} compared: {same}, {verdicts}{ways}\n{lines}")
        }
    };
    work.beside(|| print(&text))?;
    work.end()
}

/// How many verdicts changed in each way, as `PASS -> REJECT`.
fn ways(changed: &[(String, VerdictChange)]) -> BTreeMap<String, usize> {
    let mut ways = BTreeMap::new();
    for (_, VerdictChange { before, after, .. }) in changed {
        *ways.entry(format!("{before} -> {after}")).or_default() += 1;
    }
    ways
}

fn line_of(difference: &Difference) -> Result<String> {
    Ok(format!("{}\n", serde_json::to_string(difference)?))
}

/// What changed from one archive to another.
#[derive(Debug, Serialize)]
struct Difference {
    before: String,
    after: String,
    is_lineage_same: bool,
    /// Options and sources: key, and its value before and after.
    lineage: Vec<(String, String, String)>,
    is_raw_same: bool,
    /// Whether sample rate, time before the trigger, channels, their units and all angles are the same.
    is_recorded_alike: bool,
    is_reference_same: bool,
    /// Taps that only one of them has.
    taps_alone: usize,
    discriminators: Vec<DiscriminatorDifference>,
    /// Taps whose flags differ.
    flags_differ: usize,
    shoulders: Vec<ShoulderDifference>,
}

#[derive(Debug, Serialize)]
struct DiscriminatorDifference {
    name: &'static str,
    /// Taps whose values differ.
    differ: usize,
    /// At most by which part of the value before; `None` if none of them had one other than 0 before, and has one after.
    relative_max: Option<f64>,
}

/// How a verdict changed; absent where a shoulder is not judged.
#[derive(Debug, Serialize)]
struct ShoulderDifference {
    shoulder: String,
    verdict_before: Option<String>,
    verdict_after: Option<String>,
    reasons_before: Option<String>,
    reasons_after: Option<String>,
    /// How far its strongest arc stands out, and from where on it is inspected again, and rejected.
    arc_and_limits_before: Option<[f64; 3]>,
    arc_and_limits_after: Option<[f64; 3]>,
    /// Locations whose damage index differs.
    locations_differ: usize,
    /// How many of them have an index in only one of the two.
    locations_absent: usize,
    /// Largest difference of the others.
    index_max: Option<f64>,
}

impl ShoulderDifference {
    /// Whether nothing differs.
    fn is_none(&self) -> bool {
        self.verdict_before == self.verdict_after
            && self.reasons_before == self.reasons_after
            && same_bits(self.arc_and_limits_before, self.arc_and_limits_after)
            && self.locations_differ == 0
    }

    /// How its verdict changed; `None` if it did not.
    fn verdict_change(&self) -> Option<VerdictChange> {
        let word = |verdict: &Option<String>| verdict.clone().unwrap_or_else(|| "not judged".to_owned());
        let (before, after) = (word(&self.verdict_before), word(&self.verdict_after));
        (before != after).then(|| VerdictChange { shoulder: self.shoulder.clone(), before, after })
    }
}

/// A verdict that changed.
struct VerdictChange {
    /// The casing and its shoulder.
    shoulder: String,
    before: String,
    after: String,
}

impl fmt::Display for VerdictChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} -> {}", self.shoulder, self.before, self.after)
    }
}

impl Difference {
    fn between(before: &Path, after: &Path) -> Result<Self> {
        let (a, b) = (Reader::open(before)?, Reader::open(after)?);
        // At whichever station they were made.
        let without_station = |mut id: TapId| {
            id.station = 0;
            id
        };
        let ids = |reader: &Reader| reader.plan().taps().iter().map(|tap| without_station(tap.id)).collect::<Vec<_>>();
        let (ids_a, ids_b) = (ids(&a), ids(&b));
        if ids_a != ids_b {
            let (before, after) = (before.display(), after.display());
            bail!("{before} and {after} cannot be compared tap by tap: {}", what_differs(&ids_a, &ids_b));
        }
        let (found_a, found_b) = (a.discriminators()?, b.discriminators()?);
        let both = || found_a.iter().zip(&found_b).filter_map(|(a, b)| Some((a.as_ref()?, b.as_ref()?)));
        let shown = |(key, before, after): (String, String, String)| match [(before, &a), (after, &b)]
            .map(|(value, of)| shown_value(&key, value, of.plan()))
        {
            [before, after] if before == after => (key, "entries of other casings".to_owned(), "changed".to_owned()),
            [before, after] => (key, before, after),
        };
        let judged = a.plan().scans().iter().zip(a.judgements()?).zip(b.judgements()?);
        Ok(Self {
            before: before.display().to_string(),
            after: after.display().to_string(),
            is_lineage_same: a.lineage_key()? == b.lineage_key()?,
            lineage: lineage_changes(a.made_by(), b.made_by()).into_iter().map(shown).collect(),
            is_raw_same: a.raw_digest()? == b.raw_digest()?,
            is_recorded_alike: are_recorded_alike(a.plan(), b.plan()),
            is_reference_same: a.reference() == b.reference(),
            taps_alone: found_a.iter().zip(&found_b).filter(|(a, b)| a.is_some() != b.is_some()).count(),
            discriminators: Discriminator::ALL.map(|which| DiscriminatorDifference::of(which, both())).into(),
            flags_differ: both().filter(|(a, b)| a.quality != b.quality).count(),
            shoulders: judged.map(|((scan, a), b)| ShoulderDifference::of(scan, a.as_ref(), b.as_ref())).collect(),
        })
    }

    /// Whether nothing differs but what made it.
    fn is_none(&self) -> bool {
        self.is_raw_same && self.is_recorded_alike && self.has_same_results()
    }

    /// Whether no number and no verdict differs, wherever and whenever the taps were made.
    fn has_same_results(&self) -> bool {
        self.taps_alone == 0
            && self.flags_differ == 0
            && self.discriminators.iter().all(|discriminator| discriminator.differ == 0)
            && self.shoulders.iter().all(ShoulderDifference::is_none)
    }
}

fn are_recorded_alike(a: &Plan, b: &Plan) -> bool {
    let how = |plan: &Plan| {
        let Recording { sample_rate_hz, pre_trigger_samples, channels, calibration, .. } = &plan.recording;
        let units: Vec<_> = channels.iter().map(|&channel| (channel, calibration.unit(channel))).collect();
        let angles: Vec<_> = plan.taps().iter().map(|tap| tap.angle_deg.map(f64::to_bits)).collect();
        (plan.geometry, sample_rate_hz.to_bits(), *pre_trigger_samples, units, angles)
    };
    how(a) == how(b)
}

/// How the taps of two plans differ.
fn what_differs(a: &[TapId], b: &[TapId]) -> String {
    let (of_a, of_b): (BTreeSet<_>, BTreeSet<_>) = (a.iter().collect(), b.iter().collect());
    let alone = [of_a.difference(&of_b).count(), of_b.difference(&of_a).count()];
    match alone {
        [0, 0] => "they have the same taps in another order".to_owned(),
        [first, second] => format!("{first} taps are planned only in the first, {second} only in the second"),
    }
}

impl DiscriminatorDifference {
    fn of<'a>(which: Discriminator, both: impl Iterator<Item = (&'a Discriminators, &'a Discriminators)>) -> Self {
        let (mut differ, mut relative_max) = (0, None);
        for (a, b) in both {
            let (a, b) = (a.values.get(which), b.values.get(which));
            if a.map(f64::to_bits) != b.map(f64::to_bits) {
                differ += 1;
                if let (Some(a), Some(b)) = (a, b)
                    && a.abs() > 0.0
                {
                    let relative = (b - a).abs() / a.abs();
                    relative_max =
                        Some(relative_max.map_or(relative, |max| if relative > max { relative } else { max }));
                }
            }
        }
        Self { name: which.name(), differ, relative_max }
    }
}

impl ShoulderDifference {
    fn of(scan: &Scan, a: Option<&Judged>, b: Option<&Judged>) -> Self {
        let verdict = |judged: Option<&Judged>| {
            judged.map(|(judgement, _)| {
                Verdict::from_code(judgement.verdict).map_or("unknown".to_owned(), |verdict| verdict.to_string())
            })
        };
        let reasons = |judged: Option<&Judged>| judged.map(|(judgement, _)| judgement.reasons.to_string());
        let arc_and_limits =
            |judged: Option<&Judged>| judged.map(|(of, _)| [of.strongest_arc, of.limit_re_inspect, of.limit_reject]);
        let cells = |judged: Option<&Judged>| judged.map(|(_, cells)| cells.clone()).unwrap_or_default();
        let (cells_a, cells_b) = (cells(a), cells(b));
        let indices = cells_a.iter().zip(&cells_b).map(|(a, b)| (a.damage_index, b.damage_index));
        let (locations_differ, locations_absent, index_max) = index_differences(indices);
        Self {
            shoulder: scan.to_string(),
            verdict_before: verdict(a),
            verdict_after: verdict(b),
            reasons_before: reasons(a),
            reasons_after: reasons(b),
            arc_and_limits_before: arc_and_limits(a),
            arc_and_limits_after: arc_and_limits(b),
            locations_differ,
            locations_absent,
            index_max,
        }
    }
}

fn same_bits(a: Option<[f64; 3]>, b: Option<[f64; 3]>) -> bool {
    a.map(|a| a.map(f64::to_bits)) == b.map(|b| b.map(f64::to_bits))
}

/// How many of the `indices` of two archives differ, how many of them only one has, and the largest other difference.
fn index_differences(indices: impl Iterator<Item = (f64, f64)>) -> (usize, usize, Option<f64>) {
    let differ = indices.filter(|(a, b)| a.to_bits() != b.to_bits());
    let differences: Vec<f64> = differ.map(|(a, b)| (b - a).abs()).collect();
    let absent = differences.iter().filter(|difference| difference.is_nan()).count();
    (
        differences.len(),
        absent,
        differences.into_iter().filter(|difference| !difference.is_nan()).max_by(f64::total_cmp),
    )
}

/// A difference to three digits; only a tiny one, which rounding may cause, needs an exponent.
fn plain(value: f64) -> String {
    let rounded = format!("{value:.2e}");
    match rounded.parse::<f64>() {
        Ok(value) if (1e-4..1e9).contains(&value.abs()) => value.to_string(),
        _ => rounded,
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "lineage    {}", if self.is_lineage_same { "the same" } else { "differs:" })?;
        for (key, before, after) in &self.lineage {
            writeln!(f, "           {key}: {before} -> {after}")?;
        }
        if !self.is_raw_same {
            writeln!(
                f,
                "           the recordings differ: in their samples, in a tap's time, velocity, scale, distance or attempt, or in their \
                 station, plan or kind of source"
            )?;
        }
        if !self.is_recorded_alike {
            writeln!(f, "           sample rate, time before the trigger, channels, units or angles differ")?;
        }
        if !self.is_reference_same {
            writeln!(f, "           the reference files differ")?;
        }
        if self.taps_alone > 0 {
            writeln!(f, "taps       {} are in only one of them", self.taps_alone)?;
        }
        for DiscriminatorDifference { name, differ, relative_max } in &self.discriminators {
            match (differ, relative_max) {
                (0, _) => writeln!(f, "{name:<10} the same")?,
                (_, None) => writeln!(f, "{name:<10} {differ} differ")?,
                (_, Some(max)) => writeln!(f, "{name:<10} {differ} differ, by {} of their value at most", plain(*max))?,
            }
        }
        if self.flags_differ > 0 {
            writeln!(f, "quality    {} different flags", counted(self.flags_differ, "tap has", "taps have"))?;
        }
        self.shoulders.iter().try_for_each(|shoulder| writeln!(f, "{}  {shoulder}", shoulder.shoulder))
    }
}

impl fmt::Display for ShoulderDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (was, is) = match (&self.verdict_before, &self.verdict_after) {
            (None, None) => return f.write_str("not judged in either"),
            (Some(_), None) => return f.write_str("judged only in the first"),
            (None, Some(_)) => return f.write_str("judged only in the second"),
            (Some(was), Some(is)) => (was, is),
        };
        match was == is {
            true => f.write_str(was)?,
            false => write!(f, "{was} -> {is}")?,
        }
        if let (Some(was), Some(is)) = (&self.reasons_before, &self.reasons_after)
            && was != is
        {
            write!(f, ", reasons {was} -> {is}")?;
        }
        if let (Some(was), Some(is)) = (self.arc_and_limits_before, self.arc_and_limits_after) {
            let names = ["strongest arc", "re-inspect limit", "reject limit"];
            for ((name, was), is) in
                names.into_iter().zip(was).zip(is).filter(|((_, was), is)| was.to_bits() != is.to_bits())
            {
                write!(f, ", {name} {was:.2} -> {is:.2}")?;
            }
        }
        let locations = counted(self.locations_differ, "location", "locations");
        match self.index_max {
            None if self.locations_differ == 0 => f.write_str(", index the same"),
            None => write!(f, ", index at {locations} in only one of them"),
            Some(largest) => {
                write!(f, ", index differs at {locations}, by {} at most", plain(largest))?;
                match self.locations_absent {
                    0 => Ok(()),
                    absent => write!(f, "; {absent} of them have it in only one"),
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches an index that only one archive has and that is left out, called the same, or printed as a number; and a verdict that
    /// differs unnoticed.
    #[test]
    fn an_index_in_one_archive_alone_is_counted() {
        let of = |locations_differ, locations_absent, index_max| ShoulderDifference {
            shoulder: "T/1".to_owned(),
            verdict_before: Some("PASS".to_owned()),
            verdict_after: Some("PASS".to_owned()),
            reasons_before: None,
            reasons_after: None,
            arc_and_limits_before: Some([3.0, 5.0, 7.0]),
            arc_and_limits_after: Some([3.0, 5.0, 7.0]),
            locations_differ,
            locations_absent,
            index_max,
        };
        for (difference, words) in [
            (of(0, 0, None), "PASS, index the same"),
            (of(1, 1, None), "PASS, index at 1 location in only one of them"),
            (of(9, 0, Some(2.375)), "PASS, index differs at 9 locations, by 2.38 at most"),
            (of(9, 0, Some(3.0e-12)), "PASS, index differs at 9 locations, by 3.00e-12 at most"),
            (of(9, 8, Some(0.5)), "PASS, index differs at 9 locations, by 0.5 at most; 8 of them have it in only one"),
        ] {
            assert!(difference.to_string().ends_with(words), "{difference}");
        }
        let narrower = ShoulderDifference { arc_and_limits_after: Some([3.0, 4.5, 7.0]), ..of(0, 0, None) };
        assert!(!narrower.is_none() && of(0, 0, None).is_none());
        assert_eq!(narrower.to_string(), "PASS, re-inspect limit 5.00 -> 4.50, index the same");
        let rejected = ShoulderDifference { verdict_after: Some("REJECT".to_owned()), ..of(0, 0, None) };
        assert_eq!(rejected.verdict_change().map(|change| change.to_string()).as_deref(), Some("T/1 PASS -> REJECT"));
        let unjudged = ShoulderDifference { verdict_before: None, ..of(0, 0, None) };
        assert_eq!(
            unjudged.verdict_change().map(|change| change.to_string()).as_deref(),
            Some("T/1 not judged -> PASS")
        );
        assert!(of(9, 0, Some(2.375)).verdict_change().is_none());
        let indices = [(0.0, 0.5), (f64::NAN, 1.0), (2.0, 2.0), (f64::NAN, f64::NAN)];
        assert_eq!(index_differences(indices.into_iter()), (2, 1, Some(0.5)));
    }
}
