//! A station without a rig: a person taps by hand, or a machine on its own, in the order of the plan.
//!
//! Each tap that is heard counts as the next one. So no tap is requested again: the person would be one place ahead.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use tapline_wire::{CacheLine, PlannedTap, RecordKind, Serial, TapHeader, now_ns};

use crate::capture::ear::Ear;
use crate::capture::heard::HeardCasing;
use crate::capture::{CaptureConfig, DeviceName};
use crate::source::{serial_of, unknown_name};
use crate::{About, Arrival, Arrivals, Casing, Error, Readiness, Refusal, ScanConfig, Source, Wake};

/// The casings tapped at a station without a rig, one after the other; each begins with its first tap.
#[derive(Debug)]
pub(crate) struct ByHand {
    ear: Arc<Ear>,
    station: u16,
    scan: ScanConfig,
    /// The file with the serial of the present casing.
    serial_file: Option<PathBuf>,
    /// When that file was last written for an earlier casing.
    serial_written: Option<SystemTime>,
    last_unknown_name: String,
    /// Why casings have no serial, or end early, for people.
    alarms: Alarms,
    /// The next tap, in words.
    next_tap: Arc<Mutex<String>>,
}

impl ByHand {
    /// Listens to `device` for `station`; `wake` is called when a tap was heard.
    pub(crate) fn open(
        device: &DeviceName,
        serial_file: Option<PathBuf>,
        station: u16,
        scan: &ScanConfig,
        capture: &CaptureConfig,
        wake: Wake,
    ) -> Result<Self, Error> {
        scan.validate()?;
        let ear = Ear::listen(device, capture, station, wake)
            .map_err(|source| Error::Thread { what: format!("the device of station {station}"), source })?;
        Ok(Self::of(ear, serial_file, station, scan))
    }

    /// The station that hears with `ear`.
    fn of(ear: Arc<Ear>, serial_file: Option<PathBuf>, station: u16, scan: &ScanConfig) -> Self {
        // The file may still hold the serial of the previous casing, which was judged or left before a restart.
        let serial_written = serial_file.as_deref().and_then(written);
        let (scan, last_unknown_name, next_tap) = (scan.clone(), String::new(), Arc::default());
        Self { ear, station, scan, serial_file, serial_written, last_unknown_name, alarms: Alarms::default(), next_tap }
    }

    /// The serial in the file, or a made-up name if there is none.
    fn name(&mut self) -> String {
        let mut why = None;
        if let Some(file) = &self.serial_file {
            let written = written(file);
            why = Some(match std::fs::read_to_string(file) {
                Ok(_) if written == self.serial_written => {
                    "it still has the serial of the previous casing, or one from before the line was started".to_owned()
                }
                Ok(text) => {
                    self.serial_written = written;
                    let text = serial_in(&text);
                    if Serial::new(text).is_ok() {
                        return text.to_owned();
                    }
                    no_serial(text)
                }
                Err(error) => error.to_string(),
            });
        }
        self.last_unknown_name = unknown_name(self.station, now_ns(), &self.last_unknown_name);
        if let (Some(file), Some(why)) = (&self.serial_file, why) {
            let text = format!("{}: {why}; the casing is called {}", file.display(), self.last_unknown_name);
            tracing::error!("station {}: {text}", self.station);
            raise(&self.alarms, text);
        }
        self.last_unknown_name.clone()
    }
}

impl Drop for ByHand {
    fn drop(&mut self) {
        self.ear.stop();
    }
}

impl Arrivals for ByHand {
    fn station(&self) -> u16 {
        self.station
    }

    fn next(&mut self) -> Result<Arrival, Error> {
        if !self.ear.has_tap() {
            let stale = self.serial_file.as_ref().filter(|file| written(file) == self.serial_written);
            let serial = stale.map_or_else(String::new, |file| format!(" (and its serial in {})", file.display()));
            *self.next_tap.lock().unwrap_or_else(PoisonError::into_inner) =
                format!("the first tap of a casing{serial}");
            return Ok(Arrival::NotYet);
        }
        // They would end this casing once they are taken.
        self.ear.forget_lost();
        let name = self.name();
        let serial = serial_of("the serial of a casing", &name)?;
        let mut heard = HeardCasing::new(Arc::clone(&self.ear), &self.scan, serial, self.station)?;
        (heard.about.can_retake, heard.about.room) = (false, 0);
        Ok(Arrival::Casing(Casing {
            name,
            taps: Box::new(TappedByHand {
                losses_before: self.ear.loss_count(),
                heard,
                serial: self.serial_file.clone().map(|file| (written(&file), file)),
                alarms: Arc::clone(&self.alarms),
                made: BTreeSet::new(),
                next_tap: Arc::clone(&self.next_tap),
            }),
        }))
    }

    fn waits_for(&self) -> String {
        let next_tap = self.next_tap.lock().unwrap_or_else(PoisonError::into_inner);
        self.ear.fault().unwrap_or_else(|| format!("{next_tap}, at {}", self.ear.device))
    }

    fn fault(&self) -> Option<String> {
        self.ear.fault()
    }

    /// A casing that was left half tapped cannot be recognised later.
    fn patience(&self) -> Option<Duration> {
        Some(Duration::ZERO)
    }

    fn take_messages(&mut self) -> Vec<(RecordKind, String)> {
        let alarms = std::mem::take(&mut *self.alarms.lock().unwrap_or_else(PoisonError::into_inner));
        alarms.into_iter().chain(self.ear.take_alarms()).map(|text| (RecordKind::Alarm, text)).collect()
    }
}

/// A casing that is tapped in the order of its plan.
#[derive(Debug)]
struct TappedByHand {
    heard: HeardCasing,
    /// The file of serials, and when it was last written as this casing began; `None` if it was not there.
    serial: Option<(Option<SystemTime>, PathBuf)>,
    alarms: Alarms,
    /// Rows that were tapped.
    made: BTreeSet<u32>,
    /// The loss count when it began.
    losses_before: u64,
    next_tap: Arc<Mutex<String>>,
}

impl Source for TappedByHand {
    fn about(&self) -> &About {
        self.heard.about()
    }

    fn poll(&mut self, row: u32, attempt: u16) -> Readiness {
        if self.heard.ear.loss_count() != self.losses_before {
            return Readiness::Gone(
                "samples were lost while it was tapped: nobody knows which tap is missing".to_owned(),
            );
        }
        if self.made.contains(&row) && !self.heard.has_taken(row) {
            return Readiness::Refused(self.heard.refusal("its samples are no longer kept"));
        }
        let readiness = self.heard.poll(row, attempt);
        if readiness == Readiness::Ready {
            self.made.insert(row);
        }
        if readiness == Readiness::NotYet
            && let Some(next) = self.next_serial()
        {
            let why = format!("the serial {next} was written before its last tap");
            let own = self.serial();
            raise(&self.alarms, format!("casing {own} has ended: {why}; tap {next} from its first place"));
            return Readiness::Gone(why);
        }
        if readiness == Readiness::NotYet
            && let Some(tap) = self.heard.plan().taps().get(row as usize)
        {
            *self.next_tap.lock().unwrap_or_else(PoisonError::into_inner) = place_of(tap);
        }
        readiness
    }

    fn fill(&mut self, header: &mut TapHeader, buffer: &mut [CacheLine]) -> Result<(), Refusal> {
        self.heard.fill(header, buffer)
    }
}

impl TappedByHand {
    fn serial(&self) -> &str {
        self.heard.plan().scans().first().map_or("", |scan| scan.tyre.as_str())
    }

    /// The serial in the file of serials, if it was written since this casing began, and is another than its own. A text that is no
    /// serial is one alarm, and ends nothing: nobody wanted to begin a casing of that name.
    fn next_serial(&mut self) -> Option<String> {
        let (at, file) = self.serial.as_ref()?;
        let now = written(file).filter(|&now| Some(now) != *at)?;
        let text = std::fs::read_to_string(file).ok()?;
        let next = serial_in(&text);
        if next.is_empty() {
            return None;
        }
        if Serial::new(next).is_err() {
            raise(&self.alarms, format!("{}: {}; casing {} goes on", file.display(), no_serial(next), self.serial()));
            self.serial = Some((Some(now), file.clone()));
            return None;
        }
        Some(next).filter(|next| *next != self.serial()).map(str::to_owned)
    }
}

/// Says that `text` is no serial, on one line: control characters are written as escapes.
fn no_serial(text: &str) -> String {
    /// As long as a serial may be, and a little more, to show what is wrong.
    const SHOWN_MAX: usize = 40;
    let shown: String = text.chars().take(SHOWN_MAX).collect();
    format!("{shown:?}{} is not a serial", if shown == text { "" } else { "..." })
}

/// Messages for people that were not taken yet.
type Alarms = Arc<Mutex<Vec<String>>>;

fn raise(alarms: &Alarms, text: String) {
    alarms.lock().unwrap_or_else(PoisonError::into_inner).push(text);
}

/// The serial in the text of a file, as editors and scanners write it.
fn serial_in(text: &str) -> &str {
    text.trim_start_matches('\u{feff}').trim()
}

/// When `file` was written last; `None` where it is not there.
fn written(file: &Path) -> Option<SystemTime> {
    std::fs::metadata(file).and_then(|metadata| metadata.modified()).ok()
}

/// Where to tap, in words.
fn place_of(tap: &PlannedTap) -> String {
    let angle = tap.angle_deg.map_or_else(String::new, |angle| format!(" ({angle} degrees)"));
    let offset = tap.id.offset_mm().map_or_else(String::new, |offset| format!(", {offset} mm from the belt edge"));
    format!("the tap at location {}{angle} of shoulder {}{offset}", tap.id.location, tap.id.shoulder)
}

#[cfg(test)]
mod tests {
    use tapline_wire::{OVER, cache_lines_for};

    use super::*;
    use crate::capture::fake::{Cable, Step, config, frames, frames_of, record};

    /// Whether the tap of `row` is there, with the samples of the one that began at frame `tap`.
    fn is_tap(casing: &mut Casing, row: u32, tap: u64) -> bool {
        let mut samples = vec![CacheLine::default(); cache_lines_for(config(16).recording().payload_bytes_max())];
        casing.taps.poll(row, 0) == Readiness::Ready
            && casing.taps.render(row, 0, &mut TapHeader::default(), &mut samples).is_ok()
            && frames_of(&mut samples, 16) == record(tap)
    }

    fn casing(station: &mut ByHand) -> Casing {
        match station.next().unwrap() {
            Arrival::Casing(casing) => casing,
            other => panic!("{other:?}"),
        }
    }

    /// Writes `text` into the file of serials, as if at this time.
    fn write_at(file: &Path, text: &str, at_s: u64) {
        std::fs::write(file, text).unwrap();
        let at = SystemTime::UNIX_EPOCH + Duration::from_secs(at_s);
        std::fs::File::options().write(true).open(file).unwrap().set_modified(at).unwrap();
    }

    fn station(cable: &Cable, serial_file: Option<PathBuf>) -> ByHand {
        ByHand::of(Arc::clone(&cable.ear), serial_file, 3, &ScanConfig::default())
    }

    /// Catches the serial of a casing from before the line was started that is taken for that of the next one.
    #[test]
    fn a_serial_is_used_once_also_where_the_line_was_started_again() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("serial.txt");
        let write = |text: &str, at_s: u64| write_at(&file, text, at_s);
        write("A", 1_000_000_000);
        for at_s in [1_000_000_001, 1_000_000_003] {
            let cable = Cable::new(&config(16));
            let mut station = station(&cable, Some(file.clone()));
            assert!(station.name().starts_with("unknown-3-"));
            assert!(matches!(station.next().unwrap(), Arrival::NotYet));
            assert!(station.waits_for().contains("its serial in "), "{}", station.waits_for());
            write("B", at_s);
            assert!(matches!(station.next().unwrap(), Arrival::NotYet));
            assert!(!station.waits_for().contains("its serial in "), "{}", station.waits_for());
            assert_eq!(station.name(), "B");
            assert!(station.name().starts_with("unknown-3-"));
            write("B", at_s + 1);
            assert_eq!(station.name(), "B", "it was written anew");
        }
    }

    /// Catches two casings that are judged as one: the second is begun although taps of the first are missing. And a serial as some editors
    /// write it, which is not taken.
    #[test]
    fn the_serial_of_the_next_casing_ends_this_one() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("serial.txt");
        let write = |text: &str, at_s: u64| write_at(&file, text, at_s);
        let cable = Cable::new(&config(16));
        let mut station = station(&cable, Some(file.clone()));
        write("\u{feff}A\r\n", 1_000_000_000);
        cable.play([Step::Frames(frames(0..4000, &[1000, 2000]))]);
        let mut first = casing(&mut station);
        assert_eq!(first.name, "A");
        assert!(is_tap(&mut first, 0, 1000));
        write("A", 1_000_000_001);
        assert!(is_tap(&mut first, 1, 2000));
        assert_eq!(first.taps.poll(2, 0), Readiness::NotYet, "the same serial, written again");
        write("B", 1_000_000_002);
        assert!(matches!(first.taps.poll(2, 0), Readiness::Gone(why) if why.contains("the serial B was written")));
        let alarms = station.take_messages();
        assert!(alarms[0].1.contains("casing A has ended") && alarms[0].1.contains("tap B from its first place"));
        cable.play([Step::Frames(frames(4000..6000, &[5000]))]);
        let mut second = casing(&mut station);
        assert!(second.name == "B" && is_tap(&mut second, 0, 5000));
        // Some scanners remove the file between two serials.
        std::fs::remove_file(&file).unwrap();
        cable.play([Step::Frames(frames(6000..8000, &[7000]))]);
        let mut third = casing(&mut station);
        assert!(third.name.starts_with("unknown-3-") && is_tap(&mut third, 0, 7000));
        assert_eq!(third.taps.poll(1, 0), Readiness::NotYet);
        write("C", 1_000_000_003);
        assert!(matches!(third.taps.poll(1, 0), Readiness::Gone(_)));
        station.take_messages();
        write("no/serial", 1_000_000_004);
        assert!(station.name().starts_with("unknown-3-"));
        let [(RecordKind::Alarm, alarm)] = &station.take_messages()[..] else { panic!("one alarm") };
        assert!(alarm.contains("\"no/serial\" is not a serial; the casing is called unknown-3-"), "{alarm}");
    }

    /// Catches a casing that ends because a text that is no serial was written, an alarm of it in two lines, one at each look, and a
    /// serial after it that does not end the casing.
    #[test]
    fn a_text_that_is_no_serial_ends_no_casing() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("serial.txt");
        let cable = Cable::new(&config(16));
        let mut station = station(&cable, Some(file.clone()));
        write_at(&file, "A", 1_000_000_000);
        cable.play([Step::Frames(frames(0..4000, &[1000, 2000]))]);
        let mut first = casing(&mut station);
        assert!(is_tap(&mut first, 0, 1000));
        write_at(&file, "M-5\nM-6\u{1b}[31m\n", 1_000_000_001);
        assert!(is_tap(&mut first, 1, 2000));
        for _ in 0..2 {
            assert_eq!(first.taps.poll(2, 0), Readiness::NotYet);
        }
        let alarms = station.take_messages();
        let want = format!("{}: \"M-5\\nM-6\\u{{1b}}[31m\" is not a serial; casing A goes on", file.display());
        assert_eq!(alarms, [(RecordKind::Alarm, want)]);
        write_at(&file, &"x".repeat(1000), 1_000_000_002);
        assert_eq!(first.taps.poll(2, 0), Readiness::NotYet);
        let alarm = station.take_messages().remove(0).1;
        assert!(alarm.ends_with(&format!("\"{}\"... is not a serial; casing A goes on", "x".repeat(40))), "{alarm}");
        write_at(&file, "M-5", 1_000_000_003);
        assert!(matches!(first.taps.poll(2, 0), Readiness::Gone(why) if why.contains("the serial M-5 was written")));
    }

    /// Catches a tap from before a gap, that nobody had taken, which ends the casing behind the gap.
    #[test]
    fn a_tap_that_was_lost_in_waiting_ends_no_other_casing() {
        let cable = Cable::new(&config(16));
        let mut station = station(&cable, None);
        cable.play([Step::Frames(frames(0..4000, &[1000, 2000, 3000]))]);
        let mut first = casing(&mut station);
        assert!(is_tap(&mut first, 0, 1000));
        cable.play([Step::Lost(1000), Step::Frames(frames(5000..8000, &[6000, 7000]))]);
        assert!(matches!(first.taps.poll(1, 0), Readiness::Gone(_)));
        let mut second = casing(&mut station);
        assert!(is_tap(&mut second, 0, 6000) && is_tap(&mut second, 1, 7000));
        assert_eq!(second.taps.poll(2, 0), Readiness::NotYet);
    }

    /// Catches taps behind a gap that are taken for those of other places, and a casing that is never ended.
    #[test]
    fn the_scan_ends_where_samples_are_lost() {
        for gap in [vec![Step::Lost(1000)], vec![Step::Fails("it was pulled out"), Step::Opens]] {
            let cable = Cable::new(&config(16));
            let mut station = station(&cable, None);
            assert!(matches!(station.next().unwrap(), Arrival::NotYet));
            // Of the third tap only the pulse comes before the gap.
            cable.play([Step::Frames(frames(0..3100, &[1000, 2000, 3000]))]);
            let mut first = casing(&mut station);
            assert!(is_tap(&mut first, 0, 1000) && is_tap(&mut first, 1, 2000));
            assert_eq!(first.taps.poll(2, 0), Readiness::NotYet);
            cable.play(gap.into_iter().chain([Step::Frames(frames(4100..6000, &[5000]))]));
            let why = "samples were lost while it was tapped: nobody knows which tap is missing";
            for row in 0..4 {
                assert_eq!(first.taps.poll(row, 0), Readiness::Gone(why.to_owned()));
            }
            // What is tapped from now on is another casing's.
            assert!(is_tap(&mut casing(&mut station), 0, 5000));
            let alarms = cable.ear.take_alarms();
            assert_eq!(alarms.iter().filter(|alarm| !alarm.starts_with(OVER)).count(), 1, "{alarms:?}");
        }
    }
}
