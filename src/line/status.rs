//! `tapline status`: the state of a running line.

use std::fmt::{self, Write as _};
use std::fs;
use std::io::{self, IsTerminal as _, Write as _};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use jiff::{Timestamp, tz::TimeZone};
use rustix::termios::tcgetwinsize;
use tapline_host::messages::counted;
use tapline_host::signals::stop_flag;
use tapline_host::stdout::Stdout;
use tapline_host::table::{break_last_column, table};
use tapline_wire::{Verdict, now_ns};

use crate::cli::line::StatusArgs;
use crate::line::out_folder::OutFolder;
use crate::line::setup::status_file;
use crate::shown::casing::CasingStatus;
use crate::shown::status::Status;
use crate::shown::verdict::{CasingVerdict, ShoulderVerdict};

/// How long a running line may take to show its status.
const ANSWERS_WITHIN: Duration = Duration::from_secs(15);

/// A line that has shown nothing for this long is held up, here as on its page.
const STANDS_AFTER_NS: i64 = 3_000_000_000;

/// `tapline status`: shows the state of a running line, once or until it ends.
pub(crate) fn status(args: &StatusArgs) -> Result<bool> {
    let Some(found) = OutFolder::find_line(&args.out)? else {
        bail!("no line runs on {}", args.out.display());
    };
    // Nothing is read of a folder that somebody else has made.
    found.address.verify()?;
    let file = status_file(&found.address);
    let stop = stop_flag().context("cannot listen for signals")?;
    let since = Instant::now();
    let mut last: Option<(String, bool)> = None;
    loop {
        if let Ok(text) = fs::read_to_string(&file) {
            let status: Status = serde_json::from_str(&text).context("what the line shows cannot be read")?;
            // What has changed, and once that nothing changes any more.
            let is_held_up = held_up_since(&status).is_some();
            let shown = (text, is_held_up && !args.json);
            if last.as_ref() != Some(&shown) {
                print(&status, args)?;
                last = Some(shown);
            }
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
        let window = Some(io::stdout()).filter(|out| args.follow && out.is_terminal());
        if window.is_some() {
            write!(out, "\x1b[H\x1b[2J")?;
        }
        let size =
            window.and_then(|window| tcgetwinsize(window).ok()).filter(|size| size.ws_row > 0 && size.ws_col > 0);
        let text = text(status)?;
        write!(
            out,
            "{}",
            match size {
                Some(size) => cut(&text, size.ws_row.into(), size.ws_col.into()),
                None => text,
            }
        )?;
    }
    Ok(out.flush()?)
}

/// The status for people, what matters most first.
fn text(status: &Status) -> Result<String, fmt::Error> {
    let mut text = String::new();
    write_line(&mut text, status)?;
    write_stations(&mut text, status)?;
    write_verdicts(&mut text, status)?;
    Ok(text)
}

/// The beginning of `text` that fits a window of so many `rows` and `columns`, whose last row says how many lines do not. A window that is
/// followed must not scroll: its first lines say what keeps the line from working.
fn cut(text: &str, rows: usize, columns: usize) -> String {
    let rows_of = |line: &str| line.chars().count().div_ceil(columns).max(1);
    // The cursor stays in the last row.
    let (all, room) = (text.lines().map(rows_of).sum::<usize>(), rows.saturating_sub(1));
    if all <= room {
        return text.to_owned();
    }
    let (mut shown, mut used) = (Vec::new(), 1);
    for line in text.lines() {
        used += rows_of(line);
        if used > room {
            break;
        }
        shown.push(line);
    }
    let left = counted(text.lines().count() - shown.len(), "line", "lines");
    format!("{}\n... and {left} more\n", shown.join("\n"))
}

/// When the line showed its last status, if that is too long ago.
fn held_up_since(status: &Status) -> Option<String> {
    let is_old = now_ns().saturating_sub(status.at_ns) > STANDS_AFTER_NS;
    // While it ends, it waits for what is under way, and shows nothing new.
    (is_old && !status.is_ending).then(|| moment(status.at_ns))
}

/// How the line as a whole is.
fn write_line(text: &mut String, status: &Status) -> fmt::Result {
    if let Some(since) = held_up_since(status) {
        writeln!(text, "TROUBLE nothing from the line since {since}: what follows is old")?;
    }
    let Status { out, pid, taps_per_s, .. } = status;
    let closed = counted(status.closed_count as usize, "casing", "casings");
    writeln!(text, "Line on {} (process {pid}): {taps_per_s:.1} taps/s, {closed} closed", out.display())?;
    for trouble in &status.troubles {
        writeln!(text, "TROUBLE {trouble}")?;
    }
    if status.lost_count > 0 {
        let lost = counted(status.lost_count as usize, "record was", "records were");
        writeln!(text, "{lost} lost in transit; the taps are taken again.")?;
    }
    Ok(())
}

/// Its stations, the signs of their rigs, restarts of stages, and receivers that wait.
fn write_stations(text: &mut String, status: &Status) -> fmt::Result {
    let mut table = table(["station", "casing", "taps", "again", "refused", "waits for"]);
    for station in &status.stations {
        let of = |value: &dyn Fn(&CasingStatus) -> String| station.casing.as_ref().map_or_else(String::new, value);
        table.add_row([
            station.number.to_string(),
            of(&|casing| casing.name.clone()),
            of(&|casing| format!("{} of {}", casing.archived + casing.refused, casing.planned)),
            of(&|casing| if casing.retaken > 0 { casing.retaken.to_string() } else { String::new() }),
            of(&|casing| if casing.refused > 0 { casing.refused.to_string() } else { String::new() }),
            station.waits_for.clone(),
        ]);
    }
    break_last_column(&mut table);
    writeln!(text, "{table}")?;
    for station in &status.stations {
        for sign in &station.signs {
            writeln!(text, "CHECK station {}: {sign}", station.number)?;
        }
    }
    let restarted = status.stages.iter().filter(|stage| stage.restarts > 0);
    let restarts: Vec<String> = restarted.map(|stage| format!("{} {}", stage.name, stage.restarts)).collect();
    if !restarts.is_empty() {
        writeln!(text, "Restarts: {}", restarts.join(", "))?;
    }
    let waiting = status.receivers.iter().filter(|receiver| receiver.waiting > 0);
    let waiting: Vec<String> = waiting.map(|receiver| format!("{} {}", receiver.name, receiver.waiting)).collect();
    if !waiting.is_empty() {
        writeln!(text, "Verdicts that wait to be acknowledged: {}", waiting.join(", "))?;
    }
    Ok(())
}

/// The last alarms and verdicts.
fn write_verdicts(text: &mut String, status: &Status) -> fmt::Result {
    for alarm in &status.alarms {
        writeln!(text, "ALARM {} {}", moment(alarm.at_ns), alarm.text)?;
    }
    if !status.verdicts.is_empty() {
        writeln!(text, "Last verdicts:")?;
    }
    for of_casing in &status.verdicts {
        let CasingVerdict { verdict, station, file, .. } = of_casing;
        let file = file.strip_prefix(&status.out).unwrap_or(file).display();
        writeln!(text, "  {}  {verdict:<10} station {station}  {file}", moment(of_casing.at_ns))?;
        for shoulder in of_casing.shoulders.iter().filter(|shoulder| shoulder.verdict != Verdict::Pass) {
            let why = shoulder.why(", ", &["extrapolated"], &[]);
            let words = [shoulder.places(), why].into_iter().filter(|words| !words.is_empty()).collect::<Vec<_>>();
            let ShoulderVerdict { tyre, shoulder, verdict, .. } = shoulder;
            writeln!(text, "    {tyre}/{shoulder} {verdict}  {}", words.join(", "))?;
        }
    }
    Ok(())
}

/// The local time `at_ns` after the Unix epoch, to the second.
fn moment(at_ns: i64) -> String {
    let time = Timestamp::from_nanosecond(at_ns.into()).map(|time| time.to_zoned(TimeZone::system()));
    time.map_or_else(|_| "at an unknown time".to_owned(), |time| time.strftime("%Y-%m-%d %H:%M:%S").to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a window that scrolls, so that its first lines are gone, and one that hides how much it hides.
    #[test]
    fn what_does_not_fit_a_window_is_counted() {
        let text = "Line\nTROUBLE\nstations\na long alarm\nverdict\n";
        assert_eq!(cut(text, 6, 80), text);
        assert_eq!(cut(text, 5, 80), "Line\nTROUBLE\nstations\n... and 2 lines more\n");
        // The alarm takes two rows.
        assert_eq!(cut(text, 6, 8), "Line\nTROUBLE\nstations\n... and 2 lines more\n");
        assert_eq!(cut(text, 7, 8), text);
        for (rows, columns) in [(1, 1), (2, 4), (3, 3)] {
            assert!(cut(text, rows, columns).ends_with("... and 5 lines more\n"));
        }
    }

    /// Catches a line that hangs and looks well, and one that ends, or has just shown itself, and is said to hang.
    #[test]
    fn a_line_is_held_up_if_it_shows_nothing() {
        let is_held_up = |age_ns: i64, is_ending| {
            let status = Status { at_ns: now_ns() - age_ns, is_ending, ..Status::default() };
            held_up_since(&status).is_some()
        };
        assert!(is_held_up(2 * STANDS_AFTER_NS, false));
        assert!(!is_held_up(2 * STANDS_AFTER_NS, true) && !is_held_up(0, false));
    }
}
