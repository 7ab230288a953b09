//! Checks of the options of a run or a line that need neither its machine nor its folder.

use std::io::Write as _;
use std::path::Path;

use anyhow::{Result, bail, ensure};
use jiff::ToSpan as _;
use tapline_acquire::{ScanConfig, StationConfig, StationSource};
use tapline_fuse::Reference;
use tapline_host::stdout::Stdout;
use tapline_wire::{Certificate, Recording};

use crate::cli::built_without;
use crate::config::Config;
use crate::config::job::Job;
use crate::config::reference::{check_record_s, remark_on_bands};
use crate::line::listed::Listed;
use crate::line::setup::{Arriving, Setup, absolute};
use crate::wires;

/// References that a line can use.
const OTHER_REFERENCES: &str = "Make a reference file of casings that are known to be sound (`tapline reference FOLDER --out \
     sound.json`) and give `--reference sound.json`; to compare each casing with itself, give `--reference self` (damage all \
     round does not show then)";

/// How long before its end a calibration is called for, in days.
const CALIBRATION_ENDS_SOON: i64 = 15;

/// `tapline config --check`: checks the configuration at `path`, and prints what else a run or a line needs.
pub(crate) fn check_config(path: &Path) -> Result<bool> {
    let mut job = Job::of_config(path)?;
    let Config { scan, station, fuse, .. } = &mut job.config;
    // The number of a run's stations may be left to its options.
    let given = scan.stations;
    scan.stations = scan.for_line().stations;
    let (lacks_station, lacks_reference) = (station.is_empty(), fuse.reference.is_none());
    let is_few = lacks_station && scan.stations > given;
    let of_run = is_few.then(|| format!("`tapline run` needs --stations {}", scan.stations));
    let of_simulated = match lacks_station {
        true => {
            // As if `--reference self` were given.
            fuse.reference.get_or_insert(Reference::Own);
            check_run(&job)?
        }
        false => check_line(&job).map(|_setup| None)?,
    };
    writeln!(Stdout, "{} is a configuration", path.display())?;
    let of_simulated = of_simulated.map(|why| format!("`tapline run` takes it only for recorded taps: {why}"));
    let of_line = [(lacks_station, "at least one [[station]]"), (lacks_reference, "a [fuse] reference")];
    let of_line =
        of_line.into_iter().filter(|(is_so, _)| *is_so).map(|(_, what)| format!("`tapline line` needs {what}"));
    for remark in of_run.into_iter().chain(of_simulated).chain(of_line) {
        writeln!(Stdout, "{remark}")?;
    }
    Ok(true)
}

/// Refuses to judge without a reference.
pub(super) fn require_reference(job: &Job) -> Result<()> {
    ensure!(
        job.config.fuse.reference.is_some(),
        "no reference is named, and nothing can be judged without one. {OTHER_REFERENCES}"
    );
    Ok(())
}

/// Checks the options of a line without its machine and its folder; it may still lack a reference. Returns its setup.
pub(super) fn check_line(job: &Job) -> Result<Setup> {
    let Config { station: stations, fuse, scan, process, .. } = &job.config;
    ensure!(
        !stations.is_empty(),
        "the configuration has no [[station]]: a line needs at least one, with its number and source"
    );
    if let Some(Reference::Shoulder { tyre, shoulder }) = &fuse.reference {
        bail!(
            "the reference is {tyre}/{shoulder}, and such a shoulder is one of the same casing, which no casing of a \
             line is known to have. {OTHER_REFERENCES}"
        );
    }
    let setup = Setup::new(job, Arriving::Stations, &absolute(&job.out)?)?;
    let fusions = job.fusions();
    check_calibrations(job)?;
    if stations.iter().any(|of| of.source != StationSource::Folder) {
        remark_on_scan(scan);
    }
    let is_simulated = |of: &StationConfig| of.source == StationSource::Simulated;
    if let Some(station) = stations.iter().find(|of| is_simulated(of) && !scan.tyre.is_empty()) {
        tracing::warn!("station {} simulates its own tyres: none of [[scan.tyre]] comes to it", station.number);
    }
    wires::check(&job.config.line)?;
    // How recordings in folders were made is not yet known, but how they will be analysed is.
    fusions.check_process()?;
    for plan in setup.plans_of_stations(job)? {
        remark_on_bands(process, &plan.recording).iter().for_each(|text| tracing::warn!("{text}"));
        match fuse.reference {
            Some(_) => {
                drop(fusions.check(&plan)?);
                fusions.remark_on_conditions(&plan).iter().for_each(|text| tracing::warn!("{text}"));
            }
            None => check_record_s(process, &plan.recording)?,
        }
    }
    for StationConfig { number, source, .. } in stations {
        let is_built = match source {
            StationSource::Alsa => cfg!(feature = "alsa"),
            StationSource::Uldaq => cfg!(feature = "uldaq"),
            StationSource::Folder | StationSource::Rig | StationSource::Simulated => true,
        };
        if !is_built {
            return built_without(&format!("{:?}, the source of station {number}", source.name()), source.name());
        }
    }
    Ok(setup)
}

/// Checks the options of a run without its machine and its folder; returns why it can have no simulated tyres,
/// if it could still have recorded ones.
fn check_run(job: &Job) -> Result<Option<String>> {
    let setup = Setup::new(job, Arriving::Simulated, &job.out)?;
    let refusal = Listed::check(job, &setup).err();
    remark_on_scan(&job.config.scan);
    Ok(refusal.map(|why| format!("{why:#}")))
}

/// Refuses results that a station would take for tap sets.
pub(super) fn refuse_watched_results(job: &Job) -> Result<()> {
    match job.config.station.iter().find(|of| of.watches(&job.out)) {
        Some(of) => bail!(
            "--out {} is within the folder that station {} watches, which would take the results for tap sets",
            job.out.display(),
            of.number
        ),
        None => Ok(()),
    }
}

/// Warns of what in a `scan` lets cracks pass.
pub(super) fn remark_on_scan(scan: &ScanConfig) {
    scan.remark().iter().for_each(|text| tracing::warn!("{text}"));
}

/// Checks that stations that listen have a valid calibration if no casing passes without one; otherwise only warns.
fn check_calibrations(job: &Job) -> Result<()> {
    let today = jiff::Timestamp::now().to_zoned(jiff::tz::TimeZone::UTC).date();
    let soon = today.saturating_add(CALIBRATION_ENDS_SOON.days()).to_string();
    let today = today.to_string();
    for station in job.config.station.iter().filter(|station| station.device.is_some()) {
        let Recording { channels, calibration, .. } = station.heard_with(&job.config.capture)?.recording();
        for channel in channels {
            let fault = match &calibration.of(channel).certificate {
                None => "has no calibration".to_owned(),
                Some(certificate) if certificate.date > today => {
                    format!("has a calibration of {}; today is {today}", certificate.date)
                }
                Some(Certificate { valid_until: Some(until), .. }) if *until < today => {
                    format!("has a calibration that was valid until {until}; today is {today}")
                }
                Some(Certificate { valid_until: Some(until), .. }) if *until < soon => {
                    let (channel, number) = (channel.name(), station.number);
                    tracing::warn!("the {channel} of station {number} has a calibration that ends on {until}");
                    continue;
                }
                Some(_) => continue,
            };
            let fault = format!("the {} of station {} {fault}", channel.name(), station.number);
            ensure!(!job.config.fuse.requires_calibration, "{fault}, and fuse.requires_calibration is set");
            tracing::warn!("{fault}");
        }
    }
    Ok(())
}
