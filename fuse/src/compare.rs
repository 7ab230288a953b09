//! Shoulders of a run and of a reference file are brought together and compared; what was computed once is kept.

use std::sync::Arc;

use tapline_wire::Discriminator;

use crate::condition::Conditions;
use crate::fusion::{Entering, Fusion};
use crate::level::Level;
use crate::ring::Ring;
use crate::shoulder::{Reading, Shoulder};
use crate::standard::{Casing, IndexMap, Standard};
use crate::velocity::{Normalisation, Struck};
use crate::verdict::View;

/// A shoulder beside its reference.
#[derive(Debug, Clone)]
pub(crate) struct Compared {
    pub(crate) standard: Arc<Standard>,
    pub(crate) casing: Arc<Casing>,
    /// Number of the shoulder in the casing.
    pub(crate) number: usize,
    pub(crate) ring: Ring,
    pub(crate) conditions: Conditions,
}

impl Compared {
    /// The index map of the shoulder.
    pub(crate) fn map(&self) -> &IndexMap {
        &self.casing.maps[self.number]
    }

    /// The map with all that the verdict rests on.
    pub(crate) fn view<'a>(&'a self, locations: &'a [(u32, Option<f64>)]) -> View<'a> {
        View {
            ring: &self.ring,
            locations,
            map: self.map(),
            limits: self.standard.limits,
            usual: self.standard.fit.usual(),
            usual_tap_count: self.standard.usual_tap_count,
            is_inverted: self.casing.is_inverted,
        }
    }

    /// Mean score of each discriminator where the index is highest, NaN where it says nothing.
    pub(crate) fn evidence(&self) -> [f64; Discriminator::COUNT] {
        let map = self.map();
        let index = |place: &usize| map.index[*place];
        let peak = (0..map.index.len()).filter(|p| index(p).is_some()).max_by(|a, b| {
            let value = |p| index(p).unwrap_or(f64::NEG_INFINITY);
            value(a).total_cmp(&value(b)).then(b.cmp(a))
        });
        let mut evidence = [f64::NAN; Discriminator::COUNT];
        let discriminators = self.standard.fit.yardstick().discriminators();
        for (score, &(which, _)) in
            peak.iter().flat_map(|&p| map.locations[p].by_discriminator.iter().zip(discriminators))
        {
            evidence[which as usize] = score.unwrap_or(f64::NAN);
        }
        evidence
    }
}

/// What a result was computed from: conditions, and of each scan how often what came of it has changed.
type Key = (Conditions, Vec<(usize, u64)>);

/// The last results; they serve the other shoulder of a casing, and a stated reference every casing.
#[derive(Debug, Clone, Default)]
pub(crate) struct Cache {
    standard: Option<(Key, Arc<Standard>)>,
    casing: Option<(Key, Arc<Casing>)>,
}

impl Fusion {
    /// Scan number `scan` beside its reference, with whatever has come so far.
    pub(crate) fn compared(&mut self, scan: usize) -> Compared {
        let involved = self.panel.involved(scan);
        let casing_scans = self.panel.casing(scan).to_vec();
        let reference_scans = self.panel.reference(scan).to_vec();
        let planned = involved.iter().flat_map(|&s| self.names[s].iter().copied());
        let conditions = Conditions::of(planned.chain(self.set.iter().flat_map(|set| set.taps())));
        let key =
            |scans: &[usize]| (conditions.clone(), scans.iter().map(|&s| (s, self.progress[s].changes)).collect());
        let (standard_key, casing_key): (Key, Key) = (key(&reference_scans), key(&involved));
        let cached = |cache: &Cache| {
            let (key, standard) = cache.standard.as_ref()?;
            (*key == standard_key).then(|| standard.clone())
        };
        let standard = cached(&self.cache);
        let casing = self.cache.casing.as_ref().filter(|(key, _)| *key == casing_key).map(|(_, c)| c.clone());
        let (standard, casing) = match (standard, casing) {
            (Some(standard), Some(casing)) => (standard, casing),
            (standard, _) => self.computed(&conditions, &reference_scans, &casing_scans, standard),
        };
        self.cache.standard = Some((standard_key, standard.clone()));
        self.cache.casing = Some((casing_key, casing.clone()));
        let number = casing_scans.iter().position(|&s| s == scan).unwrap_or(0);
        Compared { standard, casing, number, ring: self.rings[scan].clone(), conditions }
    }

    fn computed(
        &self,
        conditions: &Conditions,
        reference_scans: &[usize],
        casing_scans: &[usize],
        standard: Option<Arc<Standard>>,
    ) -> (Arc<Standard>, Arc<Casing>) {
        let normalisation = self.normalisation(conditions, reference_scans);
        let casing: Vec<Shoulder> =
            casing_scans.iter().map(|&scan| self.shoulder(conditions, &normalisation, scan, 0)).collect();
        if self.panel.is_own {
            let (standard, casing) = Standard::own(&self.config, conditions, &casing);
            return (Arc::new(standard), Arc::new(casing));
        }
        let scans = self.plan.scans();
        let mut tyres: Vec<_> = reference_scans.iter().map(|&scan| scans[scan].tyre).collect();
        tyres.dedup();
        let number_of = |scan: usize| tyres.iter().position(|&tyre| tyre == scans[scan].tyre);
        let location_count = scans.iter().map(|scan| scan.locations.len()).max().unwrap_or(0);
        let standard = standard.unwrap_or_else(|| {
            let of_run = reference_scans
                .iter()
                .filter_map(|&scan| Some(self.shoulder(conditions, &normalisation, scan, number_of(scan)?)));
            let of_set = self.set.iter().flat_map(|set| set.shoulders_by(conditions, &normalisation));
            let shoulders: Vec<Shoulder> = of_run.chain(of_set).collect();
            Arc::new(Standard::stated(&self.config, conditions, &shoulders, location_count))
        });
        // A casing of which a shoulder is stated to be sound is measured against that one.
        let of_casing = |&scan: &usize| casing_scans.iter().any(|&own| scans[own].tyre == scans[scan].tyre);
        let stated = reference_scans.iter().position(of_casing);
        let stated_level: Option<&Level> = stated.and_then(|number| standard.levels.get(number));
        let casing = standard.casing(&self.config, conditions, &casing, stated_level);
        (standard, Arc::new(casing))
    }

    /// What the reference's taps tell of the velocity, those of an offset together.
    fn normalisation(&self, conditions: &Conditions, reference_scans: &[usize]) -> Normalisation {
        if !self.config.normalise_velocity {
            return Normalisation::default();
        }
        let of_run = reference_scans.iter().flat_map(|&scan| self.entering(scan)).filter_map(|(row, id)| {
            let seen = self.seen[row as usize].as_ref().filter(|seen| !seen.is_refused)?;
            Some((conditions.offset_number(&id)?, seen.velocity_m_per_s, seen.values))
        });
        let of_set = self.set.iter().flat_map(|set| set.struck(conditions));
        let taps: Vec<Struck> = of_run.chain(of_set).collect();
        Normalisation::fitted(&taps)
    }

    fn shoulder(&self, conditions: &Conditions, normalisation: &Normalisation, scan: usize, tyre: usize) -> Shoulder {
        let planned = &self.plan.scans()[scan];
        let names = &self.names[scan];
        let numbers: Vec<Option<usize>> = names.iter().map(|name| conditions.number(name)).collect();
        let reading = |tap: &Entering| {
            let seen = self.seen[tap.row as usize].as_ref().filter(|seen| !seen.is_refused)?;
            let velocity_m_per_s = names[tap.name as usize].velocity_m_per_s();
            let values = normalisation.applied(seen.values, velocity_m_per_s, seen.velocity_m_per_s);
            Some(Reading { place: tap.place as usize, condition: numbers[tap.name as usize]?, values })
        };
        let mut taps = Vec::with_capacity(planned.taps.len());
        taps.extend(self.taps[scan].iter().filter_map(reading));
        Shoulder { ring: self.rings[scan].clone(), tyre, taps, is_cracked: vec![None; planned.locations.len()] }
    }
}
