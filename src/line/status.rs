//! `tapline status`: the state of a running line.

use std::fmt::Write as _;
use std::io::{self, IsTerminal as _, Write as _};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use jiff::{Timestamp, tz::TimeZone};
use tapline_host::messages::counted;
use tapline_host::signals::stop_flag;
use tapline_host::table::{break_last_column, table};
use tapline_wire::{Line, Role, StatusTopic, Subscriber, Verdict, now_ns};

use crate::cli::line::StatusArgs;
use crate::line::out_folder::OutFolder;
use crate::line::setup::Setup;
use crate::shown::casing::CasingStatus;
use crate::shown::status::Status;
use tapline_host::stdout::Stdout;

/// How long a running line may take to show its status.
const ANSWERS_WITHIN: Duration = Duration::from_secs(15);

/// A line that has shown nothing for this long is stuck.
const STANDS_AFTER_NS: i64 = 30_000_000_000;

/// `tapline status`: shows the state of a running line, once or until it ends.
pub(crate) fn status(args: &StatusArgs) -> Result<bool> {
    let Some(found) = OutFolder::find_line(&args.out)? else {
        bail!("no line runs on {}", args.out.display());
    };
    let setup = Setup::read(&found.address)?;
    let stop = stop_flag().context("cannot listen for signals")?;
    let line = Line::join(&found.address, Role::Viewer(std::process::id()), &setup.limits, Arc::clone(&stop))?;
    let shown = match Subscriber::<StatusTopic>::open(&line) {
        Ok(shown) => shown,
        Err(_) => {
            // The places of viewers that were killed are free once somebody clears them.
            line.clear_dead();
            let most = StatusTopic::VIEWERS_MAX;
            Subscriber::<StatusTopic>::open(&line).with_context(|| {
                format!("at most {most} programs may watch the line on {} at once", args.out.display())
            })?
        }
    };
    let since = Instant::now();
    let mut last = None;
    loop {
        if let Some(record) = shown.receive_newest()? {
            let status: Status = serde_json::from_slice(&record).context("what the line shows cannot be read")?;
            drop(record);
            print(&status, args)?;
            last = Some(status);
            if !args.follow {
                return Ok(true);
            }
        }
        if stop.load(Ordering::Relaxed) {
            return Ok(true);
        }
        // If the folder cannot be read because its disk is away, the line has not necessarily ended.
        if matches!(OutFolder::find_line(&args.out), Ok(None)) {
            ensure!(last.is_some(), "the line on {} has just ended", args.out.display());
            writeln!(io::stderr(), "the line has ended").context("cannot write to standard error")?;
            return Ok(true);
        }
        if last.is_none() && since.elapsed() > ANSWERS_WITHIN {
            bail!("the line (process {}) does not show its status: it may be held up", found.pid);
        }
        std::thread::sleep(Duration::from_millis(100));
    }
}

fn print(status: &Status, args: &StatusArgs) -> Result<()> {
    let mut out = Stdout;
    if args.json {
        writeln!(out, "{}", serde_json::to_string(status)?)?;
    } else {
        if args.follow && io::stdout().is_terminal() {
            write!(out, "\x1b[H\x1b[2J")?;
        }
        writeln!(out, "{}", text(status))?;
    }
    Ok(out.flush()?)
}

fn text(status: &Status) -> String {
    let mut text = format!(
        "Line on {} (process {}): {:.1} taps/s, {} closed",
        status.out.display(),
        status.pid,
        status.taps_per_s,
        counted(status.closed_count as usize, "casing", "casings")
    );
    let mut add = |line: &str| text.push_str(line);
    for trouble in &status.troubles {
        add(&format!("\nTROUBLE {trouble}"));
    }
    if status.lost_count > 0 {
        let lost = counted(status.lost_count as usize, "record was", "records were");
        add(&format!("\n{lost} lost in transit; the taps are taken again."));
    }
    let age_ns = now_ns().saturating_sub(status.at_ns);
    if age_ns > STANDS_AFTER_NS {
        add(&format!("\nIt has shown nothing for {} s.", age_ns / 1_000_000_000));
    }
    let mut table = table(["station", "casing", "taps", "refused", "waits for"]);
    for station in &status.stations {
        let of = |value: &dyn Fn(&CasingStatus) -> String| station.casing.as_ref().map_or_else(String::new, value);
        table.add_row([
            station.number.to_string(),
            of(&|casing| casing.name.clone()),
            of(&|casing| format!("{} of {}", casing.archived + casing.refused, casing.planned)),
            of(&|casing| if casing.refused > 0 { casing.refused.to_string() } else { String::new() }),
            station.waits_for.clone(),
        ]);
    }
    break_last_column(&mut table);
    let written = write!(text, "\n{table}");
    debug_assert!(written.is_ok(), "texts take all that is written to them");
    for (station, sign) in status.stations.iter().flat_map(|of| of.signs.iter().map(move |sign| (of.number, sign))) {
        text.push_str(&format!("\nCHECK station {station}: {sign}"));
    }
    let restarts: Vec<String> = status
        .stages
        .iter()
        .filter(|stage| stage.restarts > 0)
        .map(|stage| format!("{} {}", stage.name, stage.restarts))
        .collect();
    if !restarts.is_empty() {
        text.push_str(&format!("\nRestarts: {}", restarts.join(", ")));
    }
    let waiting = status.receivers.iter().filter(|receiver| receiver.waiting > 0);
    let waiting: Vec<String> = waiting.map(|receiver| format!("{} {}", receiver.name, receiver.waiting)).collect();
    if !waiting.is_empty() {
        text.push_str(&format!("\nVerdicts that wait to be acknowledged: {}", waiting.join(", ")));
    }
    for alarm in &status.alarms {
        text.push_str(&format!("\nALARM {} {}", moment(alarm.at_ns), alarm.text));
    }
    if !status.verdicts.is_empty() {
        text.push_str("\nLast verdicts:");
    }
    for verdict in &status.verdicts {
        text.push_str(&format!(
            "\n  {}  {:<10} station {}  {}",
            moment(verdict.at_ns),
            verdict.verdict.to_string(),
            verdict.station,
            verdict.file.strip_prefix(&status.out).unwrap_or(&verdict.file).display()
        ));
        for shoulder in verdict.shoulders.iter().filter(|shoulder| shoulder.verdict != Verdict::Pass) {
            let why = shoulder.why(", ", &["extrapolated"]);
            let words = [shoulder.places(), why].into_iter().filter(|words| !words.is_empty()).collect::<Vec<_>>();
            text.push_str(&format!(
                "\n    {}/{} {}  {}",
                shoulder.tyre,
                shoulder.shoulder,
                shoulder.verdict,
                words.join(", ")
            ));
        }
    }
    text
}

/// The local time `at_ns` after the Unix epoch, to the second.
fn moment(at_ns: i64) -> String {
    let time = Timestamp::from_nanosecond(at_ns.into()).map(|time| time.to_zoned(TimeZone::system()));
    time.map_or_else(|_| "at an unknown time".to_owned(), |time| time.strftime("%Y-%m-%d %H:%M:%S").to_string())
}
