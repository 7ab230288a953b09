//! Codecs: processor time of packing against the packed size, on simulated and on recorded taps.

use std::io::Write as _;

use anyhow::{Result, ensure};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use tapline_acquire::{ScanConfig, SimulatedLine, Source};
use tapline_codec::{Codec, pack, unpack, unpack_gzip};
use tapline_model::SimulationConfig;

use crate::chart::Bench;
use crate::chart::cost::{Workload, by_turns};
use crate::chart::front::Tolerance;
use crate::chart::panel::{Facet, Panel, Quantity};
use crate::chart::point::{Cost, Error, Point};
use crate::evaluation::{Table, cell};
use crate::in_memory::Record;

/// Bytes to which costs refer: those of a tap of 0.4 s.
const UNIT_BYTES: f64 = 65_536.0;

/// Parts of a set of taps that are compared in pairs.
const PARTS: usize = 8;

/// A recorded set: folder, name of the facet, and what it is.
const RECORDED: [(&str, &str, &str); 3] = [
    ("fhwa-slab-bj", "fhwa", "Recorded: FHWA slab, 200 kHz, 32-bit numbers"),
    ("ntu-slab-06cm", "ntu-06", "Recorded: NTU slab, 6 cm, 1 MHz, 32-bit numbers"),
    ("ntu-slab-10cm", "ntu-10", "Recorded: NTU slab, 10 cm, 625 kHz, 32-bit numbers"),
];

/// Taps of one source, as bytes.
struct Taps {
    element_bytes: usize,
    all: Vec<Vec<u8>>,
}

pub(super) fn measure(bench: &Bench) -> Result<Panel> {
    let scan = ScanConfig { seed: bench.seed, ..ScanConfig::default() };
    let mut line = SimulatedLine::new(&scan, &SimulationConfig::default())?;
    let mut table = Table::new(
        "codecs",
        "Ratio of bytes before and after packing, and processor time in us of packing and unpacking 64 KiB, medians",
        ["taps", "codec", "ratio", "pack_us", "unpack_us", "n"],
    );
    let mut facets = vec![facet(
        bench,
        "simulated",
        "Simulated: 41 kHz, 16-bit counts",
        &taps(&mut line, bench.size.taps)?,
        &mut table,
    )?];
    for (folder, name, title) in RECORDED {
        if let Some(mut set) = bench.recorded("codecs", folder)? {
            facets.push(facet(bench, name, title, &taps(&mut set, bench.size.taps)?, &mut table)?);
        }
    }
    let panel = Panel::new(
        "How are samples packed?",
        "Archived bytes against the processor time of packing them: simulated taps flatter every codec.",
        [
            "How well a tap packs depends on the converter that recorded it. Simulated counts have quiet high bits; recorded 32-bit \
             numbers have full ones, unless they come from a coarse converter, as the NTU slabs' do. The FHWA slab shows what to expect of \
             recorded taps.",
            "`gzip` is deflate of level 4 over shuffled bytes, as HDF5's own filter; a line does not offer it. Every tap is unpacked \
             and compared bit for bit.",
        ],
        facets,
    );
    Ok(Panel { tables: vec![table], ..panel })
}

/// Some taps of `source`, from all over its plan.
fn taps(source: &mut impl Source, count: usize) -> Result<Taps> {
    let source_count = source.plan().taps().len();
    let every = (source_count / count).max(1);
    let records = Record::render_all(source, (0..count.min(source_count)).map(|k| k * every))?;
    let all = records.iter().map(|record| record.bytes().to_vec()).collect();
    Ok(Taps { element_bytes: source.plan().recording.sample_format.bytes(), all })
}

fn facet(bench: &Bench, name: &str, title: &str, taps: &Taps, table: &mut Table) -> Result<Facet> {
    let packed: Vec<Vec<Vec<u8>>> =
        Codec::ALL.map(|codec| taps.all.iter().map(|tap| pack_by(codec, taps.element_bytes, tap)).collect()).into();
    for (codec, packed) in Codec::ALL.into_iter().zip(&packed) {
        let mut back = Vec::new();
        for (tap, packed) in taps.all.iter().zip(packed) {
            unpack_by(codec, taps.element_bytes, packed, tap.len(), &mut back);
            ensure!(back == *tap, "{codec} did not return a tap of {name} bit for bit");
        }
    }
    let units = taps.all.iter().map(Vec::len).sum::<usize>() as f64 / UNIT_BYTES;
    let scaled = |cost: Cost| {
        let scale = taps.all.len() as f64 / units;
        Cost { median: scale * cost.median, low: scale * cost.low, high: scale * cost.high }
    };
    let mut workloads: Vec<Workload<'_>> = Codec::ALL
        .map(|codec| Workload::each(&taps.all, move |tap| pack_by(codec, taps.element_bytes, tap).len() as f64))
        .into();
    for (codec, packed) in Codec::ALL.into_iter().zip(&packed) {
        let (length, mut back) = (taps.all[0].len(), Vec::new());
        workloads.push(Workload::each(packed, move |packed| {
            unpack_by(codec, taps.element_bytes, packed, length, &mut back);
            back.len() as f64
        }));
    }
    let costs = by_turns(workloads, bench.size.rounds.div_ceil(2));
    let mut points = Vec::new();
    for (place, (codec, packed)) in Codec::ALL.into_iter().zip(&packed).enumerate() {
        let (pack_cost, unpack_cost) = (scaled(costs[place]), scaled(costs[place + Codec::ALL.len()]));
        let left = |tap: &[Vec<u8>], packed: &[Vec<u8>]| {
            let bytes = |all: &[Vec<u8>]| all.iter().map(Vec::len).sum::<usize>() as f64;
            100.0 * bytes(packed) / bytes(tap)
        };
        let of_part = taps.all.len().div_ceil(PARTS);
        let by_part =
            taps.all.chunks(of_part).zip(packed.chunks(of_part)).map(|(taps, packed)| left(taps, packed)).collect();
        let all = left(&taps.all, packed);
        let error = Error { value: all, ..Error::mean_of(by_part) };
        points.push(
            Point::new(format!("codec = \"{codec}\""), codec.name(), pack_cost, error, taps.all.len())
                .default_if(codec == Codec::default())
                .family(usize::from(!codec.is_for_lines()))
                .remark(format!("unpacks 64 KiB in {:.1} us", unpack_cost.median)),
        );
        table.push([
            name.into(),
            codec.name().into(),
            cell(100.0 / all),
            cell(pack_cost.median),
            cell(unpack_cost.median),
            taps.all.len().into(),
        ]);
    }
    Ok(Facet {
        cost: Quantity::log("Processor time of packing 64 KiB", "\u{b5}s"),
        error: Quantity::linear("What is left of the bytes", "%"),
        tolerance: Tolerance { cost: 0.15, error: 2.0 },
        truth: "the samples, bit for bit".to_owned(),
        seeds: vec![bench.seed],
        families: vec!["for lines", "for archives that are repacked"],
        points,
        ..bench.facet(name, title)
    })
}

/// `tap` as the archive stores it.
fn pack_by(codec: Codec, element_bytes: usize, tap: &[u8]) -> Vec<u8> {
    let (mut planes, mut packed) = (Vec::new(), Vec::new());
    if codec == Codec::Gzip {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(codec.level().into()));
        let written = encoder.write_all(&shuffled(element_bytes, tap));
        return written.and_then(|()| encoder.finish()).unwrap_or_default();
    }
    pack(codec, element_bytes, tap, &mut planes, &mut packed);
    packed
}

fn unpack_by(codec: Codec, element_bytes: usize, packed: &[u8], length: usize, back: &mut Vec<u8>) {
    back.clear();
    back.resize(length, 0);
    let planes = &mut Vec::new();
    let is_valid = match codec {
        Codec::Gzip => unpack_gzip(element_bytes, packed, back, planes),
        codec => unpack(codec, packed, std::iter::once(0..length), back, planes),
    };
    if !is_valid {
        back.clear();
    }
}

/// First the first bytes of all elements, then the second ones, and so on, like HDF5's filter `shuffle`.
fn shuffled(element_bytes: usize, bytes: &[u8]) -> Vec<u8> {
    (0..element_bytes).flat_map(|k| bytes.iter().skip(k).step_by(element_bytes).copied()).collect()
}
