//! The three tyres of the experiment, what is scanned of them, and how severe a planted crack is at a place.

use anyhow::{Context as _, Result};
use tapline_acquire::{ScanConfig, TyreConfig};
use tapline_model::{Crack, SimulatedRig, SimulatedTap, SimulatedTyre, SimulationConfig};
use tapline_wire::TapId;

/// Extensive cracks at the belt edge of shoulder 1; shoulder 2 is sound.
pub(super) const REPRESENTATIVE: &str = "REPRESENTATIVE";
/// No cracks.
pub(super) const NEW: &str = "NEW";
/// Short, deep cracks with gaps between them in shoulder 1, about 180 degrees.
pub(super) const SLIGHT: &str = "SLIGHT";
/// One sound place, struck again and again.
pub(super) const SOUND_SPOT: &str = "SOUND-SPOT";
/// One place over a crack.
pub(super) const CRACKED_SPOT: &str = "CRACKED-SPOT";

/// Locations of a ring, as in section 5.2.
pub(super) const LOCATIONS: u32 = 100;
/// The velocity of all scans but those that vary it.
pub(super) const VELOCITY_M_PER_S: f64 = 1.5;
/// For the effect of velocity around the ring (Fig. 62).
pub(super) const VELOCITIES_M_PER_S: [f64; 3] = [1.2, 1.5, 1.85];
/// For the effect of the location of impact (Fig. 60).
pub(super) const OFFSETS_MM: [f64; 4] = [0.0, 5.0, 10.0, 15.0];
/// Lowest velocity V_0 of the effect of velocity at one place (Fig. 61).
pub(super) const SLOWEST_M_PER_S: f64 = 1.0;
/// Velocities there, each a tenth of V_0 above the last.
const VELOCITY_STEPS: u32 = 18;
/// Taps at each of them.
const SPOT_REPETITIONS: u16 = 10;

/// Depth and length of a crack, and the locations it covers.
type Arc = (u32, u32, f64, f64);

/// The representative tyre, after what section 5.4.1 says of it: worst near 200 degrees, sound near 250 degrees, and
/// faint from 75 to 110 degrees, where shearography saw nothing.
const EXTENSIVE: [Arc; 6] = [
    (5, 9, 9.0, 22.0),
    (21, 10, 12.7, 20.0),
    (36, 8, 8.0, 22.0),
    (46, 17, 4.0, 25.0),
    (76, 9, 7.0, 24.0),
    (88, 6, 12.0, 20.0),
];
const SMALL: [Arc; 4] = [(43, 2, 8.0, 12.0), (47, 3, 8.0, 14.0), (51, 3, 8.0, 14.0), (57, 2, 8.0, 12.0)];

fn cracks(arcs: &[Arc]) -> Vec<Crack> {
    let crack = |&(first_location, location_count, depth_mm, length_mm): &Arc| Crack {
        shoulder: 1,
        first_location,
        location_count,
        depth_mm,
        length_mm,
        offset_mm: 0.0,
    };
    arcs.iter().map(crack).collect()
}

fn tyre(serial: &str, arcs: &[Arc]) -> TyreConfig {
    TyreConfig { serial: serial.to_owned(), station: 1, crack: cracks(arcs) }
}

fn at_one_offset_and_velocity(seed: u64, tyre: Vec<TyreConfig>) -> ScanConfig {
    ScanConfig {
        seed,
        offsets_mm: vec![0.0],
        velocities_m_per_s: vec![VELOCITY_M_PER_S],
        repetitions: 2,
        locations: LOCATIONS,
        tyre,
        ..ScanConfig::default()
    }
}

/// Both shoulders of the three tyres, 101 taps, twice around (Figs. 63 to 76).
pub(super) fn inspection(seed: u64) -> ScanConfig {
    let tyres = vec![tyre(REPRESENTATIVE, &EXTENSIVE), tyre(NEW, &[]), tyre(SLIGHT, &SMALL)];
    at_one_offset_and_velocity(seed, tyres)
}

/// Shoulder 1 of the representative tyre at every offset (Fig. 60).
pub(super) fn over_offsets(seed: u64) -> ScanConfig {
    let scan = at_one_offset_and_velocity(seed, vec![tyre(REPRESENTATIVE, &EXTENSIVE)]);
    ScanConfig { offsets_mm: OFFSETS_MM.to_vec(), shoulders: 1, repetitions: 1, ..scan }
}

/// Shoulder 1 of the representative tyre at every velocity (Fig. 62).
pub(super) fn over_velocities(seed: u64) -> ScanConfig {
    let scan = at_one_offset_and_velocity(seed, vec![tyre(REPRESENTATIVE, &EXTENSIVE)]);
    ScanConfig { velocities_m_per_s: VELOCITIES_M_PER_S.to_vec(), shoulders: 1, repetitions: 1, ..scan }
}

/// A sound place and one over a crack 6 mm deep, from V_0 up (Fig. 61): rings of one location.
pub(super) fn at_one_place(seed: u64) -> ScanConfig {
    let tyres = vec![tyre(SOUND_SPOT, &[]), tyre(CRACKED_SPOT, &[(0, 1, 6.0, 22.0)])];
    let velocity = |step: u32| SLOWEST_M_PER_S * (1.0 + 0.1 * f64::from(step));
    ScanConfig {
        velocities_m_per_s: (0..VELOCITY_STEPS).map(velocity).collect(),
        repetitions: SPOT_REPETITIONS,
        locations: 1,
        shoulders: 1,
        closing_tap: false,
        ..at_one_offset_and_velocity(seed, tyres)
    }
}

/// Compliance, in m/N, from which a crack is of severity 2, and from which of severity 3.
pub(super) const SEVERE_FROM_M_PER_N: [f64; 2] = [4e-6, 8e-6];

/// Tells how severe the planted crack is where a tap lands.
#[derive(Debug)]
pub(super) struct Severity {
    rig: SimulatedRig,
    location_count: u32,
}

impl Severity {
    /// For the tyres of `scan`.
    pub(super) fn new(scan: &ScanConfig) -> Result<Self> {
        let on_rig = |tyre: &TyreConfig| SimulatedTyre { serial: tyre.serial.clone(), cracks: tyre.crack.clone() };
        let tyres: Vec<_> = scan.tyre.iter().map(on_rig).collect();
        let rig = SimulatedRig::new(&SimulationConfig::default(), scan.seed, &tyres)?;
        Ok(Self { rig, location_count: scan.locations })
    }

    /// 0 where no crack is felt, then 1 to 3 by the compliance of the layer above it.
    pub(super) fn at(&self, id: &TapId) -> Result<u8> {
        let compliance_m_per_n = self.rig.layer_compliance_m_per_n(&SimulatedTap {
            tyre_serial: id.tyre.as_str(),
            shoulder: id.shoulder,
            offset_mm: id.offset_mm().context("a simulated tap has an offset")?,
            velocity_m_per_s: id.velocity_m_per_s().context("a simulated tap has a velocity")?,
            location: id.location,
            location_count: self.location_count,
            repetition: id.repetition,
            attempt: id.attempt,
        });
        let steps = [f64::MIN_POSITIVE].into_iter().chain(SEVERE_FROM_M_PER_N);
        Ok(steps.map(|from| u8::from(compliance_m_per_n >= from)).sum())
    }
}

#[cfg(test)]
mod tests {
    use tapline_wire::Serial;

    use super::*;

    /// Catches limits or planted cracks that leave a severity empty, and a closing tap that is not location 0 again.
    #[test]
    fn every_severity_is_planted() {
        let severity = Severity::new(&inspection(1)).unwrap();
        let at = |tyre: &str, shoulder, location| {
            let id = TapId::new(1, Serial::new(tyre).unwrap(), shoulder, location);
            let id = id.with_offset_mm(Some(0.0)).unwrap().with_velocity_m_per_s(Some(VELOCITY_M_PER_S)).unwrap();
            severity.at(&id).unwrap()
        };
        assert_eq!([70, 25, 10, 54].map(|location| at(REPRESENTATIVE, 1, location)), [0, 1, 2, 3]);
        assert_eq!(at(REPRESENTATIVE, 1, 76), 2, "an arc is felt less at its end");
        assert!((0..=LOCATIONS).all(|location| at(NEW, 1, location) == 0 && at(REPRESENTATIVE, 2, location) == 0));
        assert_eq!((0..LOCATIONS).filter(|&location| at(SLIGHT, 1, location) == 1).count(), 10);
        let extensive = (0..LOCATIONS).filter(|&location| at(REPRESENTATIVE, 1, location) > 0).count();
        assert_eq!(extensive, 59, "as the page says");
        assert_eq!(at(REPRESENTATIVE, 1, LOCATIONS), at(REPRESENTATIVE, 1, 0));
    }
}
