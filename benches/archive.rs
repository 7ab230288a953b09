//! The cost of archiving and of reprocessing: the writer with each codec compared with plain writes, reprocessing compared
//! with a Python program.
//!
//! Everything is measured in one run, in turns, on a simulated tyre. The Python program is `benches/peer.py`; it is run
//! by the Python that `TAPLINE_BENCH_PYTHON` names, or by `python3`, if that has h5py, Blosc and scipy.

use std::fs::{self, File};
use std::hint::black_box;
use std::io::Write as _;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context as _, Result};
use tapline_acquire::{ScanConfig, SimulatedLine, Source as _};
use tapline_fuse::{FuseConfig, Fusion, Reference};
use tapline_lab::in_memory::Record;
use tapline_model::SimulationConfig;
use tapline_process::{ProcessConfig, ProcessExtractor};
use tapline_store::{Codec, Lineage, ReadBuffer, Reader, Writer};
use tapline_wire::{Discriminators, Plan, RecordKind, TapHeader, TapTopic, Topic as _};

use tapline_bench::{Row, Sheet, Spread, quantile, root};

const ROUNDS: usize = 15;

/// Beginning of a record, with the pulse and most of the ringing.
const BEGINNING_S: f64 = 0.1;

struct Scan {
    plan: Plan,
    taps: Vec<Record>,
    found: Vec<Discriminators>,
}

impl Scan {
    fn simulate() -> Result<Self> {
        let scan = ScanConfig { offsets_mm: vec![0.0, 5.0, 10.0, 15.0], repetitions: 2, ..ScanConfig::default() };
        // Records of 0.4 s, whose beginning can be read.
        let simulation = SimulationConfig { sample_count: 16_384, ..SimulationConfig::default() };
        let mut line = SimulatedLine::new(&scan, &simulation)?;
        let plan = line.plan().clone();
        let (mut taps, mut found) = (Vec::new(), Vec::new());
        let mut extractor = ProcessExtractor::new(&ProcessConfig::default())?;
        for row in 0..u32::try_from(plan.taps().len())? {
            let mut tap = Record::render(&mut line, row)?;
            // What a publisher would set.
            tap.header.stamp.kind = RecordKind::Data.code();
            found.push(extractor.extract(&tap.header, tap.samples()));
            taps.push(tap);
        }
        Ok(Self { plan, taps, found })
    }

    /// Seconds to write every tap into a new archive and sync it to the disk.
    fn write(&self, path: &Path, codec: Codec) -> Result<f64> {
        drop(fs::remove_file(path));
        let mut writer = Writer::create(path, &self.plan, 0, Lineage { codec, .."[store]\n".into() })?;
        let begin = Instant::now();
        // As the stage does if taps come faster than it can write them.
        for (flushed, found) in self.taps.chunks(64).zip(self.found.chunks(64)) {
            for batch in flushed.chunks(TapTopic::BORROWED) {
                let taps: Vec<_> = batch.iter().map(|tap| (&tap.header, tap.bytes())).collect();
                writer.put_taps(&taps)?;
            }
            found.iter().try_for_each(|found| writer.put_discriminators(found).map(drop))?;
            writer.flush()?;
        }
        writer.finish()?;
        Ok(begin.elapsed().as_secs_f64())
    }
}

fn main() -> Result<()> {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR"))?;
    let scan = Scan::simulate()?;
    let mut rows = codecs(&scan, folder.path())?;
    let archive = judged(&scan, &folder.path().join("judged.h5"))?;
    rows.extend(reprocessing(&scan, &archive, 0.0, "4")?);
    rows.extend(reprocessing(&scan, &archive, BEGINNING_S, "6")?);
    let sheet = Sheet {
        title: "The disk".to_owned(),
        command: "cargo bench -p tapline-bench --bench archive".to_owned(),
        notes: vec![
            format!(
                "{} simulated taps of 0.4 s (64 KiB), {ROUNDS} rounds. The plain write writes only the archive's packed chunks, one \
                 after another, with one fdatasync; the archive packs, digests, writes its tables and discriminators, and syncs at the end.",
                scan.taps.len()
            ),
            "Judging again: reading, checking, unpacking, discriminators and verdicts on one core; the Python program \
             (`benches/peer.py`: h5py, scipy) reads the same file and computes only the discriminators. \
             For both, the second of two passes counts."
                .to_owned(),
        ],
        rows,
    };
    sheet.keep("archive")
}

/// Seconds to write `chunks` one after another and sync them to the disk.
fn plain_write(path: &Path, chunks: &[Vec<u8>]) -> Result<f64> {
    let mut file = File::create(path)?;
    let begin = Instant::now();
    for chunk in chunks {
        file.write_all(chunk)?;
    }
    file.sync_data()?;
    Ok(begin.elapsed().as_secs_f64())
}

/// The chunks of an archive as they are stored.
fn chunks_of(path: &Path) -> Result<Vec<Vec<u8>>> {
    let file = hdf5::File::open(path)?;
    let samples = file.dataset("taps/samples")?;
    let bytes = fs::read(path)?;
    let mut chunks = Vec::new();
    for k in 0..samples.num_chunks().context("samples have chunks")? {
        let chunk = samples.chunk_info(k).context("a chunk has a place")?;
        let start = usize::try_from(chunk.addr)?;
        chunks.push(bytes[start..start + usize::try_from(chunk.size)?].to_vec());
    }
    Ok(chunks)
}

/// Each codec of the archive, compared with a plain write of the packed chunks.
#[expect(clippy::cast_precision_loss, reason = "a count of taps")]
fn codecs(scan: &Scan, folder: &Path) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for codec in [Codec::None, Codec::Lz4, Codec::Zstd] {
        let (path, plain) = (folder.join(format!("{codec}.h5")), folder.join("plain"));
        scan.write(&path, codec)?;
        let chunks = chunks_of(&path)?;
        let (mut ours, mut theirs) = (Vec::new(), Vec::new());
        for _ in 0..ROUNDS {
            ours.push(scan.write(&path, codec)?);
            theirs.push(plain_write(&plain, &chunks)?);
        }
        let us = |s: f64| s * 1e6 / scan.taps.len() as f64;
        let of_tap = |all: &[f64]| all.iter().map(|&s| us(s)).collect::<Vec<f64>>();
        let mut ratios: Vec<f64> = ours.iter().zip(&theirs).map(|(ours, theirs)| theirs / ours).collect();
        let least = quantile(&mut ratios, 0.0);
        let aim = if codec == Codec::Lz4 { ">= 0.9" } else { "" };
        rows.push(
            Row::new(format!("archive, `{codec}`"), "us per tap", &of_tap(&ours))
                .beside("of the speed of write and fdatasync", Spread::of_ratio(&theirs, &ours), aim)
                .beside("of it in the slowest round", Spread { median: least, low: least, high: least }, aim),
        );
    }
    Ok(rows)
}

/// A finished archive with verdicts.
fn judged(scan: &Scan, path: &Path) -> Result<Reader> {
    drop(fs::remove_file(path));
    let mut writer = Writer::create(path, &scan.plan, 0, "[store]\n")?;
    let mut fusion = Fusion::new(&FuseConfig::by(Reference::Own), &scan.plan)?;
    for (tap, found) in scan.taps.iter().zip(&scan.found) {
        writer.put_tap(&tap.header, tap.bytes())?;
        writer.put_discriminators(found)?;
        fusion.push(found)?;
    }
    for scan in 0..scan.plan.scans().len() {
        fusion.end(scan)?;
    }
    for number in 0..scan.plan.scans().len() {
        let (judgement, cells) = fusion.judge(number)?;
        let scan = u32::try_from(number)?;
        writer.end_scan(scan)?;
        writer.put_judgement(scan, &judgement, &cells)?;
    }
    writer.finish()?;
    Ok(Reader::open(path)?)
}

/// Judging the taps again on one core, compared with the Python program on the same taps and core; with `record_s` of
/// each tap, or all of it.
#[expect(clippy::cast_precision_loss, reason = "a count of taps")]
fn reprocessing(scan: &Scan, archive: &Reader, record_s: f64, aim: &str) -> Result<Vec<Row>> {
    let config = ProcessConfig { record_s, ..ProcessConfig::default() };
    let used = |header: &TapHeader| config.samples_looked_at(header.sample_count, header.sample_rate_hz);
    let rows = 0..u32::try_from(scan.taps.len())?;
    let us = |begin: Instant| begin.elapsed().as_secs_f64() * 1e6 / scan.taps.len() as f64;
    let mut room = ReadBuffer::default();
    // Times of opening, of reading with extracting, and of judging.
    let mut judge_again = || -> Result<[f64; 3]> {
        let begin = Instant::now();
        let reader = Reader::open(archive.path())?;
        let taps = reader.taps()?;
        let open = us(begin);
        // One record after the other, as reprocessing does, so that the samples are still in the cache when they are used.
        let mut extractor = ProcessExtractor::new(&config)?;
        let begin = Instant::now();
        let mut found: Vec<Discriminators> = Vec::new();
        for row in rows.clone() {
            let (header, samples) = taps.read_beginning(row, used, &mut room)?.context("every tap is archived")?;
            found.push(extractor.extract(&header, samples));
        }
        let both = us(begin);
        let begin = Instant::now();
        let mut fusion = Fusion::new(&FuseConfig::by(Reference::Own), reader.plan())?;
        found.iter().try_for_each(|found| fusion.push(found))?;
        for number in 0..scan.plan.scans().len() {
            fusion.end(number)?;
        }
        for number in 0..scan.plan.scans().len() {
            black_box(fusion.judge(number)?);
        }
        Ok([open, both, us(begin)])
    };
    let (mut open, mut both, mut fuse, mut peer) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        // Untimed first, like Python's.
        judge_again()?;
        let [of_open, of_both, of_fuse] = judge_again()?;
        open.push(of_open);
        both.push(of_both);
        fuse.push(of_fuse);
        peer.extend(python(archive.path(), record_s).map(|s| s * 1e6 / scan.taps.len() as f64));
    }
    let what = if record_s > 0.0 { format!(" from the first {record_s} s") } else { String::new() };
    let found: Vec<f64> = open.iter().zip(&both).map(|(open, both)| open + both).collect();
    let all: Vec<f64> = found.iter().zip(&fuse).map(|(found, fuse)| found + fuse).collect();
    Ok(vec![
        Row::new(format!("judging a casing again{what}"), "us per tap", &all)
            .beside(
                "times as fast as h5py and scipy, discriminators alone",
                Spread::of_ratio(&peer, &found),
                &format!(">= {aim}"),
            )
            .beside(
                "of it neither unpacking nor discriminators",
                Spread::of_ratio(&open.iter().zip(&fuse).map(|(a, b)| a + b).collect::<Vec<_>>(), &all),
                "",
            ),
    ])
}

/// Seconds that the Python program takes; `None` if it cannot run.
fn python(archive: &Path, record_s: f64) -> Option<f64> {
    let named = std::env::var("TAPLINE_BENCH_PYTHON").ok();
    let script = root().join("benches/peer.py");
    let run = |python: &str| {
        let mut command = Command::new(python);
        command.arg(&script).arg(archive).arg(record_s.to_string()).env("OMP_NUM_THREADS", "1").output().ok()
    };
    let out = named.iter().map(String::as_str).chain(["python3"]).filter_map(run).find(|out| out.status.success())?;
    String::from_utf8_lossy(&out.stdout).split_whitespace().next()?.parse().ok()
}
