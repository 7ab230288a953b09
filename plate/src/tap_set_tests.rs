use tapline_acquire::{Source as _, TapSet};
use tapline_process::{ProcessConfig, ProcessExtractor};
use tapline_wire::{CacheLine, Discriminator, Samples, Serial, TapHeader, cache_lines_for};

use super::*;
use crate::{Crack, ScanShape, discriminators};

/// Catches a tap set that the program does not read, or that gives it other discriminators or another truth.
#[test]
fn the_program_reads_the_same_taps() {
    let crack = Crack::default().over(3, 4, 20);
    let tyres = [Tyre { serial: Serial::new("A-1").unwrap(), cracks: vec![crack] }];
    let shape = ScanShape { offsets_mm: vec![0.0, 5.0], repetitions: 1, location_count: 20, ..ScanShape::default() };
    let plan = shape.plan(&tyres).unwrap();
    let folder = tempfile::tempdir().unwrap();
    write_tap_set(folder.path(), &Population::rough(), 9, &tyres, &plan).unwrap();
    let process = ProcessConfig::default();
    let here = discriminators(&Population::rough(), 9, &tyres, &plan, &process, 0).unwrap();

    let mut set = TapSet::open(folder.path(), 1).unwrap();
    assert_eq!(set.plan().truth(), plan.truth());
    assert_eq!(set.plan().taps().len(), plan.taps().len());
    let mut buffer = vec![CacheLine::default(); cache_lines_for(set.plan().recording.payload_bytes_max())];
    let mut extractor = ProcessExtractor::new(&process).unwrap();
    for row in 0..u32::try_from(here.len()).unwrap() {
        let mut header = TapHeader::default();
        set.render(row, 0, &mut header, &mut buffer).unwrap();
        let there = extractor.extract(&header, Samples::view(&header, &buffer).unwrap());
        let name = (header.id.shoulder, header.id.offset_mm(), header.id.location);
        let ours = here.iter().find(|d| (d.id.shoulder, d.id.offset_mm(), d.id.location) == name).unwrap();
        for which in Discriminator::ALL {
            assert_eq!(there.values.get(which), ours.values.get(which), "{which:?} of {}", header.id);
        }
    }
}
