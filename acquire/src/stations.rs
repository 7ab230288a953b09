//! The stations of a line: entries `[[station]]` of a configuration.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use tapline_model::SimulationConfig;

use crate::simulated::listed::SimulatedTyres;
use crate::{AcquireConfig, Arrivals, Error, FolderArrivals, RigArrivals, RigConfig, ScanConfig, Wake};

/// Longest time that a rig may be given, in s: a day.
const TIME_MAX_S: f64 = 86_400.0;

/// Where a station's casings come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StationSource {
    /// Tap sets that are moved into a folder.
    Folder,
    /// A rig, over TCP.
    Rig,
    /// Simulated tyres, one after another.
    Simulated,
}

impl StationSource {
    fn name(self) -> &'static str {
        match self {
            Self::Folder => "folder",
            Self::Rig => "rig",
            Self::Simulated => "simulated",
        }
    }
}

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
    /// Host and port of the rig.
    pub rig: Option<String>,
    /// How long a rig may be away with a casing under way before that is given up, in s.
    #[serde(default = "rig_patience_s")]
    pub rig_patience_s: f64,
    /// How long a rig may take to answer before the connection is made anew, in s.
    #[serde(default = "rig_timeout_s")]
    pub rig_timeout_s: f64,
    /// How many simulated tyres come; without end when left out.
    pub casings: Option<u64>,
    /// Number of the first simulated tyre.
    #[serde(default = "first_casing")]
    pub first_casing: u64,
}

fn rig_patience_s() -> f64 {
    30.0
}

fn rig_timeout_s() -> f64 {
    10.0
}

fn first_casing() -> u64 {
    1
}

impl StationConfig {
    /// Checks every value against its bounds.
    ///
    /// # Errors
    /// [`Error::Setting`] for the first value out of bounds, missing, or of another source.
    pub fn validate(&self) -> Result<(), Error> {
        let refuse = |key: &str, value: String, bound: String| {
            Err(Error::Setting { key: format!("station.{key}"), value, bound })
        };
        if self.number == 0 {
            return refuse("number", "0".to_owned(), "from 1 to 65535".to_owned());
        }
        let is = |source: StationSource| self.source == source;
        let folder = self.folder.as_ref().map(|folder| folder.display().to_string());
        for (key, value, source) in [
            ("folder", &folder, StationSource::Folder),
            ("rig", &self.rig, StationSource::Rig),
            ("casings", &self.casings.map(|casings| casings.to_string()), StationSource::Simulated),
        ] {
            let is_needed = is(source) && source != StationSource::Simulated;
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
        if let Some(rig) = self.rig.as_deref().filter(|rig| !is_address(rig)) {
            return refuse("rig", format!("{rig:?}"), "HOST:PORT, the port from 1 to 65535".to_owned());
        }
        for (key, time_s) in [("rig_patience_s", self.rig_patience_s), ("rig_timeout_s", self.rig_timeout_s)] {
            if !(0.001..=TIME_MAX_S).contains(&time_s) {
                return refuse(key, time_s.to_string(), format!("from 0.001 to {TIME_MAX_S}"));
            }
        }
        if self.first_casing == 0 {
            return refuse("first_casing", "0".to_owned(), "at least 1".to_owned());
        }
        Ok(())
    }
}

fn is_address(text: &str) -> bool {
    text.rsplit_once(':').is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok_and(|port| port > 0))
}

/// Checks every one of `stations`, and that no two have the same number, folder or rig.
///
/// # Errors
/// [`Error::Setting`] for the first that cannot be.
pub fn validate_stations(stations: &[StationConfig]) -> Result<(), Error> {
    let mut numbers = BTreeMap::new();
    let mut sources: BTreeMap<(bool, &Path), u16> = BTreeMap::new();
    for (place, station) in stations.iter().enumerate() {
        station.validate()?;
        let key = |field: &str| format!("station[{place}].{field}");
        if let Some(first) = numbers.insert(station.number, place) {
            let bound = format!("another number than that of station[{first}]");
            return Err(Error::Setting { key: key("number"), value: station.number.to_string(), bound });
        }
        let folder = station.folder.as_deref().map(|folder| (false, folder));
        for source in folder.into_iter().chain(station.rig.as_deref().map(|rig| (true, Path::new(rig)))) {
            if let Some(first) = sources.insert(source, station.number) {
                let (is_rig, of) = source;
                let bound = format!("another than that of the station with number {first}");
                let field = if is_rig { "rig" } else { "folder" };
                return Err(Error::Setting { key: key(field), value: of.display().to_string(), bound });
            }
        }
    }
    Ok(())
}

/// Opens where the casings of `station` come from; `wake` is called when a rig has answered.
///
/// # Errors
/// [`Error`] for a value out of its bounds, a folder that cannot be made, or a thread that cannot be had.
pub fn open_station(
    station: &StationConfig,
    acquire: &AcquireConfig,
    scan: &ScanConfig,
    simulation: &SimulationConfig,
    wake: Wake,
) -> Result<Box<dyn Arrivals>, Error> {
    station.validate()?;
    let number = station.number;
    Ok(match (station.source, &station.folder, &station.rig) {
        (StationSource::Folder, Some(folder), _) => Box::new(FolderArrivals::open(folder, number)?),
        (StationSource::Rig, _, Some(address)) => {
            let rig = RigConfig {
                address: address.clone(),
                patience_s: station.rig_patience_s,
                timeout_s: station.rig_timeout_s,
                retakes: acquire.retakes,
            };
            Box::new(RigArrivals::open(&rig, number, scan, simulation, wake)?)
        }
        _ => Box::new(SimulatedTyres::unlisted(scan, simulation, number, (station.first_casing, station.casings))?),
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::Arrival;

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
            (one("source = \"folder\""), "station.folder is left out; it must be given, as source is \"folder\""),
            (one("source = \"rig\""), "station.rig is left out; it must be given"),
            (one("source = \"rig\"\nrig = \"h:0\""), "station.rig is \"h:0\"; it must be HOST:PORT"),
            (one("source = \"rig\"\nrig = \"\""), "station.rig is \"\""),
            (
                one("source = \"rig\"\nrig = \"h:1\"\nfolder = \"x\""),
                "station.folder is x; it must be left out, as source is not \"folder\"",
            ),
            (one("source = \"rig\"\nrig = \"h:1\"\ncasings = 2"), "station.casings is 2; it must be left out"),
            (
                one("source = \"rig\"\nrig = \"h:1\"\nrig_patience_s = nan"),
                "station.rig_patience_s is NaN; it must be from 0.001",
            ),
            (one("source = \"simulated\"\nfirst_casing = 0"), "station.first_casing is 0"),
            (one("source = \"simulated\"").replace("= 1", "= 0"), "station.number is 0; it must be from 1 to 65535"),
            (
                one("source = \"simulated\"").repeat(2),
                "station[1].number is 1; it must be another number than that of station[0]",
            ),
            (two, "station[1].rig is h:1; it must be another than that of the station with number 1"),
        ] {
            let error = stations(&text).unwrap_err();
            assert!(error.contains(want), "{error:?} lacks {want:?}");
        }
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
            open_station(station, &AcquireConfig::default(), &scan, &simulation, Arc::new(|| {})).unwrap()
        };
        let mut opened: Vec<_> = stations.iter().map(open).collect();
        assert_eq!(opened.iter().map(|arrivals| arrivals.station()).collect::<Vec<_>>(), [4, 5, 6]);
        assert!(matches!(opened[0].next().unwrap(), Arrival::NotYet) && inbox.join("done").is_dir());
        assert!(matches!(opened[1].next().unwrap(), Arrival::NotYet) && opened[1].waits_for().contains("127.0.0.1:1"));
        assert!(matches!(opened[2].next().unwrap(), Arrival::Casing(casing) if casing.name == "S6-1"));
        assert!(matches!(opened[2].next().unwrap(), Arrival::Ended));
    }
}
