//! `tapline-lab`: tools for researchers, apart from the everyday program.
//!
//! - [`study`]: how good each index and reference is on hundreds of simulated tyres.
//! - [`pod`]: the same for casings that a plant has scanned and inspected.
//! - [`chart`]: the atlas: speed against accuracy of every choice.
//! - [`experiment`]: chapter 5 of the dissertation repeated on three simulated tyres.
//! - [`figures`]: the figures of the dissertation's contact theory.
//! - [`estimators`]: bias and spread of every estimator on taps whose truth is known.
//! - [`stability`]: breakdown curves: how wrong a number gets as a disturbance grows.
//! - [`headroom`]: how many stations a host supports, and what limits them.
//! - [`line_cost`]: what a run of the built program cost.
//! - [`in_memory`]: taps rendered and read within this process.
//! - [`hop`]: records sent between processes, through shared memory and in other ways.
//! - [`simulated`]: casings of two simulators, tapped and judged.
//! - [`written`]: the files that a verb writes.
//! - [`statistics`]: probability of detection, rates, gauge studies.
//!
//! # The crates as libraries
//!
//! Every tool here uses the same few calls: a tap is recorded, its discriminators are extracted, both are archived, and the casing is
//! judged. No process is started for it.
//!
//! ```
//! use tapline_fuse::{FuseConfig, Fusion, Reference};
//! use tapline_plate::{Crack, Line, Population, ScanShape, Tyre};
//! use tapline_process::{ProcessConfig, ProcessExtractor};
//! use tapline_store::{ReadBuffer, Reader, Writer};
//! use tapline_wire::{Samples, Serial, TapHeader, Verdict};
//!
//! let crack = Crack {
//!     shoulder: 1, angle_deg: 90.0, arc_deg: 30.0, depth_mm: 6.0, length_mm: 20.0, reach_mm: 12.0, severity: 1.0,
//! };
//! let tyres = [Tyre { serial: Serial::new("A-17")?, cracks: vec![crack] }];
//! let shape = ScanShape { offsets_mm: vec![0.0], repetitions: 1, ..ScanShape::default() };
//! let plan = shape.plan(&tyres)?; // two shoulders, 100 locations each
//!
//! let mut rig = Line::new(&Population::smooth(), 1, &tyres, &plan)?;
//! let mut extractor = ProcessExtractor::new(&ProcessConfig::default())?;
//! let mut fusion = Fusion::new(&FuseConfig::by(Reference::Own), &plan)?;
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("A-17.h5");
//! let mut writer = Writer::create(&path, &plan, plan.taps().len(), "[store]\n")?;
//!
//! let of = &plan.recording;
//! let mut samples = vec![0.0; of.channels.len() * of.sample_count_max as usize]; // force, then sound
//! for (plan_index, tap) in (0..).zip(plan.taps()) {
//!     let header = TapHeader::in_units(of.sample_rate_hz, of.pre_trigger_samples, of.sample_count_max, &of.channels);
//!     let mut header = TapHeader { id: tap.id, plan_index, ..header };
//!     rig.record(&mut header, &mut samples);
//!     writer.put_tap(&header, Samples::F32(&samples).as_bytes())?;
//!     let found = extractor.extract(&header, Samples::F32(&samples));
//!     writer.put_discriminators(&found)?;
//!     fusion.push(&found)?;
//! }
//! for scan in 0..plan.scans().len() {
//!     fusion.end(scan)?; // each, before one is judged: together they are the reference
//! }
//! for scan in 0..plan.scans().len() {
//!     let (judgement, cells) = fusion.judge(scan)?;
//!     writer.end_scan(scan as u32)?;
//!     writer.put_judgement(scan as u32, &judgement, &cells)?;
//! }
//! writer.finish()?;
//!
//! let reader = Reader::open(&path)?;
//! let judged = reader.judgements()?;
//! let verdicts: Vec<Verdict> = (0..2).map(|scan| reader.verdict(scan, judged[scan].as_ref()).0).collect();
//! assert_eq!(verdicts, [Verdict::Reject, Verdict::Pass]);
//! let mut buffer = ReadBuffer::default();
//! let (header, samples) = reader.taps()?.read(199, &mut buffer)?.ok_or("tap 199 is not archived")?;
//! let again = extractor.extract(&header, samples);
//! assert_eq!(Some(again.values), reader.discriminators()?[199].map(|found| found.values));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod chart;
pub mod estimators;
mod evaluation;
pub mod experiment;
pub mod figures;
pub mod headroom;
pub mod hop;
pub mod in_memory;
pub mod line_cost;
pub mod pod;
mod shoulder_result;
pub mod simulated;
pub mod stability;
pub mod statistics;
pub mod study;
pub mod written;
