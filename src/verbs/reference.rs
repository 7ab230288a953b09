//! `tapline reference`: shoulders of archives become a reference for later runs.

use std::collections::BTreeSet;
use std::io::Write as _;
use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use serde_json::{Value, json};
use tapline_fuse::{Built, Direction, KnownShoulder, Origin, ReferenceSet, build_reference};
use tapline_host::atomic_file::{check_writable, write_atomically};
use tapline_host::messages::{counted, say};
use tapline_host::similar::did_you_mean;
use tapline_host::stdout::Stdout;
use tapline_host::table::table;
use tapline_store::Reader;
use tapline_wire::{Discriminator, Discriminators, Reasons, Verdict};

use crate::archives::Archives;
use crate::archives::work::Work;
use crate::cli::archives::ReferenceArgs;
use crate::config::Config;
use crate::config::reference::{differences, process_of};

pub(crate) fn reference(args: &ReferenceArgs) -> Result<bool> {
    if args.out.extension().is_none_or(|extension| extension != "json") {
        bail!(
            "--out is {}; the name of a reference must end in .json, so that configurations recognise it",
            args.out.display()
        );
    }
    check_writable(&args.out, args.force.existing())?;
    let archives = Archives::find(&args.archives, args.results.which())?;
    let mut work = Work::on(&archives);
    let mut taken = Taken::new(args);
    for file in &archives.files {
        let Some(reader) = work.take(file, Reader::open(&file.path))? else { continue };
        let Some(records) = work.take(file, reader.discriminators())? else { continue };
        let foreign = || format!("{}: its configuration is not one of this program", file.path.display());
        let config = Config::parse(reader.config()).with_context(foreign);
        let Some(config) = work.take(file, config)? else { continue };
        let Some(judgements) = work.take(file, reader.judgements())? else { continue };
        let doubts = Reasons::NOT_CALIBRATED | Reasons::CALIBRATION_OUT_OF_DATE;
        let is_doubtful = judgements.iter().flatten().any(|(judgement, _)| judgement.reasons.intersects(doubts));
        let records: Vec<_> = records.into_iter().flatten().collect();
        taken.add(&file.path, &reader, &config, &records, is_doubtful)?;
    }
    taken.check_found(work.has_failed())?;
    let is_complete = work.end()?;
    let set = taken.build()?;
    let text = set.text()?;
    write_atomically(&args.out, args.force.existing(), |mut file| file.write_all(text.as_bytes()))?;
    match args.json {
        true => writeln!(Stdout, "{}", of(&args.out, &set))?,
        false => print(&args.out, &set)?,
    }
    Ok(is_complete)
}

/// Most casings of a reference: its file would be larger than is read, and fitting it would take minutes of each program that uses it.
const CASINGS_MAX: usize = 1000;

/// A limit so many times that of noise is remarked on. Those of 16 references of 8 sound casings, smooth and rough, of both simulators are
/// 0.7 to 1.0 times; of 12 casings with one cracked shoulder each it is 2.0 times.
const UNEVEN: f64 = 1.5;

/// What is taken of the archives.
struct Taken<'a> {
    args: &'a ReferenceArgs,
    /// Shoulders that are asked for by name and were not in an archive yet.
    wanted: BTreeSet<&'a str>,
    /// The names of all shoulders of the archives.
    there: BTreeSet<String>,
    shoulders: Vec<KnownShoulder>,
    /// The archives that they are from, each with the name of its casing.
    lineage: Vec<(String, Origin)>,
    /// Casings whose newtons are not certain.
    uncalibrated: BTreeSet<String>,
    /// Days on which casings were tapped, as far as they are known.
    days: BTreeSet<String>,
    /// What the reference is made with, and the first archive, which decides that.
    built: Option<(Built, &'a Path)>,
}

impl<'a> Taken<'a> {
    fn new(args: &'a ReferenceArgs) -> Self {
        Self {
            args,
            wanted: args.shoulders.iter().map(String::as_str).collect(),
            there: BTreeSet::new(),
            shoulders: Vec::new(),
            lineage: Vec::new(),
            uncalibrated: BTreeSet::new(),
            days: BTreeSet::new(),
            built: None,
        }
    }

    /// Whether shoulders are asked for by name.
    fn has_names(&self) -> bool {
        !self.args.shoulders.is_empty()
    }

    /// Takes the wanted shoulders of the archive at `path`, unless its taps cannot be compared with those of the first.
    /// `is_doubtful`: whether a calibration is missing or out of date.
    fn add(
        &mut self,
        path: &'a Path,
        reader: &Reader,
        config: &Config,
        records: &[Discriminators],
        is_doubtful: bool,
    ) -> Result<()> {
        let process = process_of(&config.process, &reader.plan().recording)?;
        let shoulders = self.wanted_of(path, reader, records)?;
        let Some(casing) = shoulders.first().map(|shoulder| shoulder.tyre.clone()) else { return Ok(()) };
        match &self.built {
            None => self.built = Some((start(self.args, config, process)?, path)),
            Some((built, first)) if built.process != process => {
                let why = format!(
                    "{}: its taps were recorded or analysed differently from those of {}: {}",
                    path.display(),
                    first.display(),
                    differences(&built.process, &process)
                );
                // What was asked for by name is not left out.
                ensure!(!self.has_names() && !self.args.archives.iter().any(|named| named == path), why);
                say(&format!("{why}; it is left out"));
                return Ok(());
            }
            Some(_) => {}
        }
        let origin = Origin {
            archive: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            plan_digest: format!("{:016x}", reader.plan().digest()),
            config: reader.config().to_owned(),
        };
        if is_doubtful {
            self.uncalibrated.insert(casing.clone());
        }
        self.days.extend(reader.plan().recording.calibration.tapped_on.clone());
        self.lineage.push((casing, origin));
        self.shoulders.extend(shoulders);
        Ok(())
    }

    /// The shoulders of the archive at `path` that are wanted.
    fn wanted_of(&mut self, path: &Path, reader: &Reader, records: &[Discriminators]) -> Result<Vec<KnownShoulder>> {
        let is_labelled = self.args.labelled;
        let truth = is_labelled.then(|| reader.truth());
        let mut shoulders = Vec::new();
        for (number, (scan, judged)) in reader.plan().scans().iter().zip(reader.judgements()?).enumerate() {
            let name = scan.to_string();
            let has_passed = judged.is_some_and(|(judgement, _)| judgement.verdict == Verdict::Pass.code());
            if !self.is_wanted(path, &name, has_passed) {
                continue;
            }
            let shoulder = KnownShoulder::of(reader.plan(), records, number, truth);
            let shoulder = shoulder.with_context(|| format!("{} has no scan {number}", path.display()))?;
            let is_known_cracked = |&(location, _): &(u32, Option<f64>)| {
                reader.truth().get(&(scan.tyre, scan.shoulder, location)) == Some(&true)
            };
            if !is_labelled && scan.locations.iter().any(is_known_cracked) {
                ensure!(
                    !self.has_names(),
                    "{}: {name} is known to be cracked; --labelled uses what is known of each location",
                    path.display()
                );
                say(&format!(
                    "{}: {name} passed although it is known to be cracked, and is left out; --labelled uses what is known of each location",
                    path.display()
                ));
                continue;
            }
            ensure!(
                !is_labelled || shoulder.is_cracked.is_some(),
                "{}: it is not known for every location of {name} whether it is cracked",
                path.display()
            );
            if self.shoulders.iter().any(|s| s.tyre == shoulder.tyre && s.shoulder == shoulder.shoulder) {
                ensure!(
                    !self.has_names(),
                    "{}: another of the archives has --shoulder {name} too: name only the file that is meant",
                    path.display()
                );
                say(&format!(
                    "{}: {name} is left out, as another file has it too; to take this one, name the files instead",
                    path.display()
                ));
                continue;
            }
            shoulders.push(shoulder);
        }
        Ok(shoulders)
    }

    /// Whether the shoulder `name` of the archive at `path` is taken. A named one counts as sound whatever its verdict was; others only if
    /// they passed.
    fn is_wanted(&mut self, path: &Path, name: &str, has_passed: bool) -> bool {
        self.there.insert(name.to_owned());
        if self.has_names() {
            self.wanted.remove(name);
            return self.args.shoulders.iter().any(|wanted| wanted == name);
        }
        if !has_passed && !self.args.labelled {
            say(&format!(
                "{}: {name} did not pass and is left out; name it with --shoulder if known to be sound",
                path.display()
            ));
        }
        has_passed || self.args.labelled
    }

    /// Refuses a name that no archive has; `has_failed` says whether one could not be read.
    fn check_found(&self, has_failed: bool) -> Result<()> {
        let Some(missing) = self.wanted.first() else { return Ok(()) };
        let names = || self.there.iter().map(String::as_str);
        let of_casing: Vec<&str> = names().filter(|name| name.starts_with(&format!("{missing}/"))).collect();
        let meant = match () {
            () if !of_casing.is_empty() => format!("; that casing has {}", of_casing.join(", ")),
            // It may be in an archive that could not be read.
            () if has_failed => String::new(),
            () => did_you_mean(missing, names()).map(|meant| format!("; {meant}")).unwrap_or_default(),
        };
        bail!("--shoulder {missing} is in none of the archives that could be read{meant}")
    }

    /// The reference. Casings that stand out from the others are left out, unless they are stated to be sound.
    fn build(mut self) -> Result<ReferenceSet> {
        let is_stated = self.has_names() || self.args.labelled;
        ensure!(
            !self.shoulders.is_empty(),
            "no shoulder passed that could be taken: name those that are known to be sound with --shoulder; if the rig has changed, first judge them by themselves \
             (`tapline reprocess FOLDER --reference self`, then `tapline reference FOLDER --results`)"
        );
        let casings: BTreeSet<&str> = self.shoulders.iter().map(|shoulder| shoulder.tyre.as_str()).collect();
        ensure!(
            casings.len() <= CASINGS_MAX,
            "{} casings are given; a reference is made of {CASINGS_MAX} at most, and a few dozen of several days serve as well",
            casings.len()
        );
        let (mut built, _) = self.built.context("no archive is named")?;
        loop {
            built.lineage = self.lineage.iter().map(|(_, origin)| origin.clone()).collect();
            let set = build_reference(&built, self.shoulders.clone())?;
            let standing_out = &set.summary.standing_out;
            for casing in standing_out {
                let what = match is_stated {
                    true => "limits based on it may let cracks pass",
                    false => "it is left out; name its shoulders with --shoulder if they are known to be sound",
                };
                say(&format!("{casing} stands out from the other casings and may be cracked: {what}"));
            }
            if is_stated || standing_out.is_empty() {
                if !self.uncalibrated.is_empty() {
                    let casings = counted(self.uncalibrated.len(), "casing has", "casings have");
                    let names: Vec<&str> = self.uncalibrated.iter().map(String::as_str).collect();
                    say(&format!(
                        "{casings} no calibration that was valid when it was tapped: whether a sensor has changed since does not show ({})",
                        names.join(", ")
                    ));
                }
                let limit = set.summary.limit_re_inspect;
                if let Some(noise) = set.summary.limit_of_noise.filter(|noise| limit > UNEVEN * noise) {
                    say(&format!(
                        "a shoulder must stand out by {limit:.2} to be inspected again; noise alone would give {noise:.2}: many of these \
                         casings are cracked or very uneven, and cracks that stand out less will pass"
                    ));
                }
                if let (Some(day), 1) = (self.days.first(), self.days.len()) {
                    say(&format!(
                        "all casings were tapped on {day}: by this reference sound ones that are some degrees warmer or colder may be level_off; \
                         take casings of several days"
                    ));
                }
                return Ok(set);
            }
            self.shoulders.retain(|shoulder| !standing_out.contains(&shoulder.tyre));
            self.uncalibrated.retain(|casing| !standing_out.contains(casing));
            self.lineage.retain(|(casing, _)| !standing_out.contains(casing));
        }
    }
}

/// What a reference is made with, if its first archive was made with this configuration.
fn start(args: &ReferenceArgs, of_archive: &Config, process: String) -> Result<Built> {
    let config = match &args.config {
        Some(path) => Config::read(path)?.0.fuse,
        None => of_archive.fuse.clone(),
    };
    Ok(Built { config, lineage: Vec::new(), process, learns_directions: args.learn_directions })
}

/// Which way `which` moves with damage.
fn moves(set: &ReferenceSet, which: Discriminator) -> &'static str {
    if set.directions.of(which) == Direction::Rises { "rises" } else { "falls" }
}

/// What a reference is, as JSON.
fn of(path: &Path, set: &ReferenceSet) -> Value {
    let summary = &set.summary;
    let discriminators: Vec<Value> = Discriminator::ALL
        .into_iter()
        .map(|which| {
            json!({
                "name": which.name(), "moves": moves(set, which), "is_learned": set.learned.contains(&which),
                "auc_if_rising": set.auc.get(which.name()),
            })
        })
        .collect();
    json!({
        "out": path.display().to_string(),
        "digest": set.digest(),
        "shoulders": set.shoulders.iter().map(|s| format!("{}/{}", s.tyre, s.shoulder)).collect::<Vec<_>>(),
        "discriminators": discriminators,
        "sound_count": summary.sound_count,
        "cracked_count": summary.cracked_count,
        "casing_count": summary.casing_count,
        "limit_re_inspect": summary.limit_re_inspect,
        "re_inspect_rate": summary.re_inspect_rate,
        "limit_reject": summary.limit_reject,
        "limit_of_noise": summary.limit_of_noise,
        "reject_rate": summary.reject_rate,
        "supported_rate": summary.supported_rate,
        "standing_out": summary.standing_out,
    })
}

fn print(path: &Path, set: &ReferenceSet) -> Result<()> {
    let mut out = Stdout;
    let mut table =
        table(["discriminator", "moves with damage", "its AUC", "spread of a tap, %", "between casings, %"]);
    for which in Discriminator::ALL {
        let of_it = || set.summary.scales.iter().filter(move |line| line.discriminator == which);
        let mean = |values: Vec<f64>| {
            let count = values.len() as f64;
            if values.is_empty() { String::new() } else { format!("{:.2}", 100.0 * values.iter().sum::<f64>() / count) }
        };
        table.add_row([
            which.name().to_owned(),
            format!("{}, {}", moves(set, which), if set.learned.contains(&which) { "learned" } else { "given" }),
            set.auc.get(which.name()).map_or_else(String::new, |&rising| {
                let falls = set.directions.of(which) == Direction::Falls;
                format!("{:.4}", if falls { 1.0 - rising } else { rising })
            }),
            mean(of_it().map(|line| line.spread).collect()),
            mean(of_it().filter_map(|line| line.level_spread).collect()),
        ]);
    }
    writeln!(out, "{table}")?;
    let summary = &set.summary;
    let names: Vec<String> = set.shoulders.iter().map(|s| format!("{}/{}", s.tyre, s.shoulder)).collect();
    writeln!(
        out,
        "{}: {}; {} sound and {} cracked locations",
        counted(names.len(), "shoulder", "shoulders"),
        names.join(", "),
        summary.sound_count,
        summary.cracked_count
    )?;
    let percent = |rate: f64| format!("{:.2} %", 100.0 * rate);
    writeln!(
        out,
        "Limits of a scan with as many turns: {:.2} for RE-INSPECT, which {} of sound shoulders reach, and {:.2} for REJECT, which {} \
         reach; {} {}",
        summary.limit_re_inspect,
        percent(summary.re_inspect_rate),
        summary.limit_reject,
        percent(summary.reject_rate),
        counted(summary.casing_count, "casing supports", "casings support"),
        summary.supported_rate.map_or_else(|| "no rate".to_owned(), percent)
    )?;
    writeln!(out, "Written to {} (digest {})", path.display(), &set.digest()[..16])?;
    Ok(())
}
