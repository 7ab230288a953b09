//! The stations of a line: entries `[[station]]` of a configuration.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tapline_model::SimulationConfig;
use tapline_wire::Channel;

use crate::capture::DeviceName;
use crate::capture::by_hand::ByHand;
use crate::config::calibration::CalibrationFile;
use crate::config::{refuse, within};
use crate::rig::stream::fault_of;
use crate::simulated::listed::SimulatedTyres;
use crate::{
    AcquireConfig, Arrivals, CaptureConfig, Error, FolderArrivals, RigArrivals, RigConfig, ScanConfig, Wake,
    last_on_rig,
};

/// Longest time that a rig may be given, in s: a day.
const TIME_MAX_S: f64 = 86_400.0;

/// Where a station's casings come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StationSource {
    /// Tap sets that are moved into a folder.
    Folder,
    /// A rig, over TCP or a serial port; its taps are simulated.
    Rig,
    /// A sound card that hears taps made by a rig or by hand.
    Alsa,
    /// A data acquisition module that hears them.
    Uldaq,
    /// Simulated tyres, one after another.
    Simulated,
}

tapline_wire::named!(
    StationSource,
    Folder = "folder",
    Rig = "rig",
    Alsa = "alsa",
    Uldaq = "uldaq",
    Simulated = "simulated"
);

/// One station of a line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StationConfig {
    /// The station, from 1.
    pub number: u16,
    /// Where its casings come from.
    pub source: StationSource,
    /// The watched folder.
    pub folder: Option<PathBuf>,
    /// Host and port of the rig, or `serial:PATH`; without a rig, a device hears taps in the order of the plan.
    pub rig: Option<String>,
    /// The sound card, as ALSA names it, or the data acquisition module.
    pub device: Option<String>,
    /// A file with the serial of the casing that is tapped without a rig.
    pub serial_file: Option<PathBuf>,
    /// A file with the values of full-scale samples of the device, made by `tapline calibrate`; unknown if left out.
    pub calibration: Option<PathBuf>,
    /// How long a rig may be away during a casing before the casing is given up, in s.
    #[serde(default = "rig_patience_s")]
    pub rig_patience_s: f64,
    /// How long a rig may take to answer before the station reconnects, in s.
    #[serde(default = "rig_timeout_s")]
    pub rig_timeout_s: f64,
    /// The same for finding its home, in s.
    #[serde(default = "rig_home_timeout_s")]
    pub rig_home_timeout_s: f64,
    /// How many simulated tyres come; endless if left out.
    pub casings: Option<u64>,
}

fn rig_patience_s() -> f64 {
    30.0
}

fn rig_timeout_s() -> f64 {
    10.0
}

fn rig_home_timeout_s() -> f64 {
    60.0
}

impl StationConfig {
    /// The table `capture` with the scales of this station's samples.
    ///
    /// # Errors
    /// As [`CalibrationFile::read`], and [`Error::Setting`] for a calibration at another range of a module, or for what the device
    /// cannot give.
    pub fn heard_with(&self, capture: &CaptureConfig) -> Result<CaptureConfig, Error> {
        let calibration = self.calibration.as_deref().map(CalibrationFile::read).transpose()?.unwrap_or_default();
        let range_v = capture.uldaq.range_v;
        for channel in Channel::BOTH.into_iter().filter(|_| self.source == StationSource::Uldaq) {
            let kept_v = calibration.of(channel).and_then(|scale| scale.full_scale_v);
            if let Some(kept_v) = kept_v.filter(|kept_v| (kept_v / range_v - 1.0).abs() > 1e-9) {
                let file = self.calibration.as_deref().unwrap_or(Path::new("")).display();
                let key = format!("{}.full_scale_v in {file}", channel.name());
                refuse(&key, kept_v, &format!("capture.uldaq.range_v, {range_v}: calibrate again"))?;
            }
        }
        let capture = CaptureConfig { calibration, ..capture.clone() };
        if let Some(device) = &self.device_name() {
            capture.validate_for(device)?;
        }
        Ok(capture)
    }

    /// Checks every value against its bounds.
    ///
    /// # Errors
    /// [`Error::Setting`] for the first value out of bounds, missing, or of another source.
    pub fn validate(&self) -> Result<(), Error> {
        let refuse = |key: &str, value: String, bound: String| Err(Error::setting(self.key(key), value, bound));
        within(&self.key("number"), self.number, 1..=u16::MAX)?;
        let is = |source: StationSource| self.source == source;
        let folder = self.folder.as_ref().map(|folder| folder.display().to_string());
        let serial_file = self.serial_file.as_ref().map(|file| file.display().to_string());
        let calibration = self.calibration.as_ref().map(|file| file.display().to_string());
        let casings = self.casings.map(|casings| casings.to_string());
        let device = if is(StationSource::Uldaq) { StationSource::Uldaq } else { StationSource::Alsa };
        let is_rig_free = is(device) && self.rig.is_some();
        for (key, value, source, is_needed) in [
            ("folder", &folder, StationSource::Folder, is(StationSource::Folder)),
            ("rig", &self.rig, if is_rig_free { device } else { StationSource::Rig }, is(StationSource::Rig)),
            ("device", &self.device, device, is(device)),
            ("serial_file", &serial_file, device, false),
            ("calibration", &calibration, device, false),
            ("casings", &casings, StationSource::Simulated, false),
        ] {
            match value.as_deref() {
                Some("") => return refuse(key, "\"\"".to_owned(), "a name".to_owned()),
                Some(value) if !is(source) => {
                    return refuse(key, value.to_owned(), format!("left out, as source is not {:?}", source.name()));
                }
                None if is_needed => {
                    let bound = format!("given, as source is {:?}", source.name());
                    return refuse(key, "left out".to_owned(), bound);
                }
                _ => {}
            }
        }
        if self.rig.is_some() && self.serial_file.is_some() {
            let bound = "left out, as the rig reports the serial".to_owned();
            return refuse("serial_file", serial_file.unwrap_or_default(), bound);
        }
        if let Some(rig) = self.rig.as_deref().filter(|rig| fault_of(rig).is_some()) {
            let bound = "HOST:PORT, the port from 1 to 65535, or serial:PATH or serial:PATH@BAUD".to_owned();
            return refuse("rig", format!("{rig:?}"), bound);
        }
        self.rig_times()?;
        if self.casings == Some(0) {
            return refuse("casings", "0".to_owned(), "at least 1, or left out".to_owned());
        }
        Ok(())
    }

    /// The name of a key of this station, for people: by its number, as its place among the stations is hard to count.
    fn key(&self, key: &str) -> String {
        format!("station {}: {key}", self.number)
    }

    /// How long its rig may be away, take to answer, and take to find its home.
    fn rig_times(&self) -> Result<[Duration; 3], Error> {
        let time = |key: &str, time_s: f64| {
            let time = Duration::try_from_secs_f64(time_s).ok().filter(|_| (0.001..=TIME_MAX_S).contains(&time_s));
            time.ok_or_else(|| Error::setting(self.key(key), time_s, format!("from 0.001 to {TIME_MAX_S}")))
        };
        Ok([
            time("rig_patience_s", self.rig_patience_s)?,
            time("rig_timeout_s", self.rig_timeout_s)?,
            time("rig_home_timeout_s", self.rig_home_timeout_s)?,
        ])
    }

    /// Whether `path` is its watched folder, or within it.
    pub fn watches(&self, path: &Path) -> bool {
        self.folder.as_ref().is_some_and(|folder| resolved(path).starts_with(resolved(folder)))
    }

    /// What it listens to, if it does.
    pub fn device_name(&self) -> Option<DeviceName> {
        let name = self.device.clone()?;
        Some(if self.source == StationSource::Uldaq { DeviceName::Uldaq(name) } else { DeviceName::Alsa(name) })
    }
}

/// Checks every one of `stations`, and that no two have the same number, folder, rig or device.
///
/// # Errors
/// [`Error::Setting`] for the first that cannot be.
pub fn validate_stations(stations: &[StationConfig]) -> Result<(), Error> {
    let mut numbers = BTreeSet::new();
    let mut sources: BTreeMap<(&str, &Path), u16> = BTreeMap::new();
    let mut folders: Vec<(PathBuf, u16)> = Vec::new();
    for station in stations {
        station.validate()?;
        if !numbers.insert(station.number) {
            return Err(Error::setting(
                station.key("number"),
                station.number,
                "different from that of every other station",
            ));
        }
        if let Some(folder) = &station.folder {
            let resolved = resolved(folder);
            // One station would take what the other moves within its folder for casings.
            let is_shared = |other: &Path| resolved.starts_with(other) || other.starts_with(&resolved);
            if let Some((_, first)) = folders.iter().find(|(other, _)| is_shared(other)) {
                let bound = format!("neither that of the station with number {first}, nor within it, nor around it");
                return Err(Error::setting(station.key("folder"), folder.display(), bound));
            }
            folders.push((resolved, station.number));
        }
        let named =
            [("rig", station.rig.as_deref().map(Path::new)), ("device", station.device.as_deref().map(Path::new))];
        for (field, of) in named.into_iter().filter_map(|(field, of)| Some((field, of?))) {
            if let Some(first) = sources.insert((field, of), station.number) {
                let bound = format!("different from that of the station with number {first}");
                return Err(Error::setting(station.key(field), of.display(), bound));
            }
        }
    }
    Ok(())
}

/// The absolute path of a folder, without links as far as it exists.
fn resolved(folder: &Path) -> PathBuf {
    let whole = std::path::absolute(folder).unwrap_or_else(|_| folder.to_path_buf());
    let there = whole.ancestors().find_map(|part| Some((part.canonicalize().ok()?, whole.strip_prefix(part).ok()?)));
    there.map_or_else(|| whole.clone(), |(there, rest)| there.join(rest))
}

/// Opens the source of casings of `station`; `wake` is called when a rig has answered or a tap was heard.
///
/// The folder `out` of the line has the last casing that was finished ([`last_on_rig`]).
///
/// # Errors
/// [`Error`] for a value out of its bounds, a folder that cannot be made, or a thread that cannot be had.
pub fn open_station(
    station: &StationConfig,
    acquire: &AcquireConfig,
    scan: &ScanConfig,
    simulation: &SimulationConfig,
    capture: &CaptureConfig,
    out: &Path,
    wake: Wake,
) -> Result<Box<dyn Arrivals>, Error> {
    station.validate()?;
    let number = station.number;
    let capture = station.heard_with(capture)?;
    let device = station.device_name();
    Ok(match (station.source, &station.folder, &station.rig, &device) {
        (StationSource::Folder, Some(folder), ..) => Box::new(FolderArrivals::open(folder, number)?),
        (StationSource::Alsa | StationSource::Uldaq, _, None, Some(device)) => {
            Box::new(ByHand::open(device, station.serial_file.clone(), number, scan, &capture, wake)?)
        }
        (StationSource::Rig | StationSource::Alsa | StationSource::Uldaq, _, Some(address), _) => {
            let [patience, timeout, home_timeout] = station.rig_times()?;
            let rig = RigConfig {
                station: number,
                address: address.clone(),
                patience,
                timeout,
                home_timeout,
                last_end: Some(last_on_rig(out, number)),
                retakes: acquire.retakes,
                device: device.map(|device| (device, capture.clone())),
            };
            Box::new(RigArrivals::open(rig, scan, simulation, wake)?)
        }
        _ => Box::new(SimulatedTyres::unlisted(scan, simulation, number, station.casings)?),
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::{Arrival, Monitor, UldaqConfig};

    #[derive(Deserialize)]
    struct Plant {
        station: Vec<StationConfig>,
    }

    fn stations(text: &str) -> Result<Vec<StationConfig>, String> {
        let plant: Plant = toml::from_str(text).map_err(|e| e.message().to_owned())?;
        validate_stations(&plant.station).map_err(|e| e.to_string())?;
        Ok(plant.station)
    }

    /// Catches a station that is let through, or refused without its key, value and bound.
    #[test]
    fn what_is_no_station_is_refused() {
        let one = |text: &str| format!("[[station]]\nnumber = 1\n{text}\n");
        for text in
            ["source = \"folder\"\nfolder = \"in\"", "source = \"rig\"\nrig = \"[::1]:7001\"", "source = \"simulated\""]
        {
            assert_eq!(stations(&one(text)).unwrap().len(), 1);
        }
        let two = format!(
            "{}[[station]]\nnumber = 2\nsource = \"rig\"\nrig = \"h:1\"\n",
            one("source = \"rig\"\nrig = \"h:1\"")
        );
        for (text, want) in [
            (one("source = \"usb\""), "unknown variant `usb`"),
            (one("source = \"rig\"\nrig = \"h:1\"\nspeed = 1"), "unknown field `speed`"),
            (one("source = \"folder\""), "station 1: folder is left out; it must be given, as source is \"folder\""),
            (one("source = \"rig\""), "station 1: rig is left out; it must be given"),
            (one("source = \"rig\"\nrig = \"h:0\""), "station 1: rig is \"h:0\"; it must be HOST:PORT"),
            (one("source = \"rig\"\nrig = \"serial:/dev/ttyUSB0@fast\""), "or serial:PATH@BAUD"),
            (one("source = \"rig\"\nrig = \"\""), "station 1: rig is \"\""),
            (
                one("source = \"rig\"\nrig = \"h:1\"\nfolder = \"x\""),
                "station 1: folder is x; it must be left out, as source is not \"folder\"",
            ),
            (one("source = \"alsa\""), "station 1: device is left out; it must be given, as source is \"alsa\""),
            (
                one("source = \"alsa\"\ndevice = \"hw:0\"\nrig = \"h:1\"\nserial_file = \"x\""),
                "station 1: serial_file is x; it must be left out, as the rig reports the serial",
            ),
            (one("source = \"uldaq\""), "station 1: device is left out; it must be given, as source is \"uldaq\""),
            (
                one("source = \"rig\"\nrig = \"h:1\"\ndevice = \"hw:0\""),
                "station 1: device is hw:0; it must be left out, as source is not \"alsa\"",
            ),
            (one("source = \"rig\"\nrig = \"h:1\"\ncasings = 2"), "station 1: casings is 2; it must be left out"),
            (
                one("source = \"rig\"\nrig = \"h:1\"\nrig_patience_s = nan"),
                "station 1: rig_patience_s is NaN; it must be from 0.001",
            ),
            (one("source = \"simulated\"").replace("= 1", "= 0"), "station 0: number is 0; it must be from 1 to 65535"),
            (
                one("source = \"simulated\"").repeat(2),
                "station 1: number is 1; it must be different from that of every other station",
            ),
            (two, "station 2: rig is h:1; it must be different from that of the station with number 1"),
        ] {
            let error = stations(&text).unwrap_err();
            assert!(error.contains(want), "{error:?} lacks {want:?}");
        }
    }

    /// Catches a folder of two stations that is named in two ways, and one within another.
    #[test]
    fn no_two_stations_share_a_folder() {
        let dir = tempfile::tempdir().unwrap();
        let inbox = dir.path().join("in");
        std::fs::create_dir(&inbox).unwrap();
        std::os::unix::fs::symlink(&inbox, dir.path().join("link")).unwrap();
        let two = |first: &str, second: &str| {
            let table = |number: u8, folder: &str| {
                // Relative paths of what is not there stay as they are.
                let folder = if folder.contains("not") { PathBuf::from(folder) } else { dir.path().join(folder) };
                format!("[[station]]\nnumber = {number}\nsource = \"folder\"\nfolder = {folder:?}\n")
            };
            stations(&(table(1, first) + &table(2, second)))
        };
        for second in ["in", "./in/", "in/../in", "link", "in/done"] {
            let error = two("in", second).unwrap_err();
            assert!(error.contains("neither that of the station with number 1"), "{second}: {error}");
        }
        assert!(two("in/done", "in").is_err());
        assert!(two("not/there", "./not/there").is_err());
        assert!(two("in", "in-2").is_ok());
        let station = &two("link", "in-2").unwrap()[0];
        let watches = |path: &str| station.watches(&dir.path().join(path));
        assert!(watches("in") && watches("link/done") && !watches("in-2") && !watches("."));
    }

    /// Catches a source that is taken for another.
    #[test]
    fn every_source_opens() {
        let dir = tempfile::tempdir().unwrap();
        let inbox = dir.path().join("in");
        let text = format!(
            "[[station]]\nnumber = 4\nsource = \"folder\"\nfolder = {inbox:?}\n\
             [[station]]\nnumber = 5\nsource = \"rig\"\nrig = \"127.0.0.1:1\"\n\
             [[station]]\nnumber = 6\nsource = \"simulated\"\ncasings = 1\n"
        );
        let stations = stations(&text).unwrap();
        let open = |station| {
            let (scan, simulation) = (ScanConfig::default(), SimulationConfig::default());
            let capture = CaptureConfig::default();
            let out = dir.path();
            open_station(station, &AcquireConfig::default(), &scan, &simulation, &capture, out, Arc::new(|| {}))
                .unwrap()
        };
        let mut opened: Vec<_> = stations.iter().map(open).collect();
        assert_eq!(opened.iter().map(|arrivals| arrivals.station()).collect::<Vec<_>>(), [4, 5, 6]);
        assert!(matches!(opened[0].next().unwrap(), Arrival::NotYet) && inbox.join("done").is_dir());
        assert!(matches!(opened[1].next().unwrap(), Arrival::NotYet) && opened[1].waits_for().contains("127.0.0.1:1"));
        assert!(matches!(opened[2].next().unwrap(), Arrival::Casing(casing) if casing.name == "S6-1"));
        assert!(matches!(opened[2].next().unwrap(), Arrival::Ended));
    }

    /// Catches samples of 24 bits that are cut to 16, and a source that is taken for a sound card.
    #[test]
    fn a_module_gives_more_than_16_bits() {
        let text = "[[station]]\nnumber = 1\nsource = \"uldaq\"\ndevice = \"DT9837A\"\n";
        let station = stations(text).unwrap().remove(0);
        assert_eq!(station.device_name(), Some(DeviceName::Uldaq("DT9837A".to_owned())));
        let (scan, simulation) = (ScanConfig::default(), SimulationConfig::default());
        let (acquire, capture) = (AcquireConfig::default(), CaptureConfig::default());
        let error = open_station(&station, &acquire, &scan, &simulation, &capture, Path::new("."), Arc::new(|| {}))
            .unwrap_err();
        let want = "capture.bits is 16; it must be 24 or 32, as source is \"uldaq\"";
        assert_eq!(error.to_string(), want);
        // Who sets the station up would see silence.
        let device = station.device_name().unwrap();
        assert_eq!(Monitor::listen(&device, &capture, 1, Arc::new(|| {})).unwrap_err().to_string(), want);
    }

    /// Catches newtons that are ten times as many: a calibration at one range that is used at another.
    #[test]
    fn a_calibration_at_another_range_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("c.toml");
        let certificate = "[force.certificate]\nmethod = \"5 blows\"\ndate = \"2026-11-24\"\n";
        for (source, kept_v, range_v, is_refused) in [
            ("uldaq", "full_scale_v = 10.0\n", 1.0, true),
            ("uldaq", "full_scale_v = 10.0\n", 10.0, false),
            ("uldaq", "", 1.0, false),
            ("alsa", "full_scale_v = 5.0\n", 1.0, false),
        ] {
            std::fs::write(&file, format!("[force]\nunit = \"N\"\nfull_scale = 222.0\n{kept_v}{certificate}")).unwrap();
            let text =
                format!("[[station]]\nnumber = 1\nsource = {source:?}\ndevice = \"D\"\ncalibration = {file:?}\n");
            let station = stations(&text).unwrap().remove(0);
            let uldaq = UldaqConfig { range_v, ..UldaqConfig::default() };
            let read = station.heard_with(&CaptureConfig { uldaq, bits: 24, ..CaptureConfig::default() });
            let want = format!(
                "force.full_scale_v in {} is 10; it must be capture.uldaq.range_v, 1: calibrate again",
                file.display()
            );
            assert_eq!(
                read.err().map(|error| error.to_string()),
                is_refused.then_some(want),
                "{source} {kept_v} {range_v}"
            );
        }
    }
}
