//! The cost of each kernel per tap, compared with bare transforms of the same record and a read of memory.
//!
//! All kernels take turns, and the fastest turn of each round counts, so that what slows the machine down is left out; ratios
//! are from one run. Words on the command line are parts of kernel names: then only those are measured, with their
//! yardsticks, and the costs are printed and not kept.
//!
//! Two Python programs with batched transforms run too (`benches/kernels.py`), if `TAPLINE_BENCH_PYTHON` names a Python
//! that has what `benches/python.txt` lists.

use std::fs;
use std::hint::black_box;
use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, anyhow};
use realfft::num_complex::Complex;
use realfft::{RealFftPlanner, RealToComplex};
use tapline_acquire::{ScanConfig, SimulatedLine, Source as _};
use tapline_fuse::{Built, FuseConfig, Fusion, KnownShoulder, Reference, build_reference};
use tapline_lab::in_memory::Record;
use tapline_model::SimulationConfig;
use tapline_process::{ProcessConfig, ProcessExtractor, without_avx512};
use tapline_wire::{Discriminators, Samples};

use tapline_bench::{Row, Sheet, Spread, root};
use tempfile::TempDir;

const ROUNDS: usize = 12;
/// Turns of a round, of which each kernel's fastest counts: what else the host does comes and goes in tenths of a second, only ever
/// slows down, and slows arithmetic more than memory.
const TURNS: usize = 10;
/// How long a kernel runs untimed before each turn: the first calls after another kernel's take longer, until caches, clock and
/// branch predictor have settled.
const WARM_FOR: Duration = Duration::from_millis(10);
/// Samples of all taps of a turn, from all over the tyre: 4 MiB of records, more than the inner caches hold.
const SAMPLES: usize = 1 << 21;
/// Records that are streamed from memory, bytes: more than any cache holds.
const STREAMED: usize = 1 << 29;
/// Taps that Python transforms at a time; the fastest counts.
const BATCHES: [usize; 3] = [8, 16, 64];
/// Samples of one channel: of the default record, and of one of 0.4 s.
const COUNTS: [usize; 2] = [2048, 16_384];

/// The name of the main kernel.
const SEVEN: &str = "seven discriminators";
const NARROW: &str = "the same without AVX-512";
const STREAM: &str = "the same, streamed from memory";
const READ: &str = "yardstick: read from memory";
const ZAFT: &str = "yardstick: bare transform by zaft";
const RUSTFFT: &str = "yardstick: bare transform by rustfft (realfft)";

/// Unit of all rows.
const UNIT: &str = "us per tap";

/// One tap as on the line, and its sound alone as floats, for bare transforms.
struct Tap {
    record: Record,
    sound_v: Vec<f32>,
}

impl Tap {
    fn new(record: Record) -> Self {
        let header = &record.header;
        let unit = header.channels[1].unit_per_count;
        #[expect(clippy::cast_possible_truncation, reason = "a converter that gives f32 does the same")]
        let volts = |&count: &i16| (f64::from(count) * unit) as f32;
        let sound_v = record.counts()[header.sample_count as usize..].iter().map(volts).collect();
        Self { record, sound_v }
    }
}

/// A kernel, the number of taps per call, and its times per tap in us.
struct Kernel<'a> {
    name: String,
    taps_per_call: usize,
    call: Box<dyn FnMut() -> f64 + 'a>,
    /// How long it runs untimed before each turn, at least once; `None` if caches must be empty.
    warm_for: Option<Duration>,
    us_per_tap: Vec<f64>,
}

impl<'a> Kernel<'a> {
    fn new(name: impl Into<String>, taps_per_call: usize, call: impl FnMut() -> f64 + 'a) -> Self {
        Self {
            name: name.into(),
            taps_per_call,
            call: Box::new(call),
            warm_for: Some(WARM_FOR),
            us_per_tap: Vec::new(),
        }
    }

    /// A kernel that is called for one tap at a time.
    fn per_tap(name: &str, taps: &'a [Tap], mut each: impl FnMut(&'a Tap) -> f64 + 'a) -> Self {
        Self::new(name, taps.len(), move || taps.iter().map(&mut each).sum())
    }

    /// Times a call; the fastest of a round is kept. Untimed calls come first where the kernel is warm, because the other kernels
    /// empty the caches.
    #[expect(clippy::cast_precision_loss, reason = "a count of taps")]
    fn time(&mut self, is_first_of_round: bool) {
        let begin = Instant::now();
        while let Some(warm_for) = self.warm_for {
            black_box((self.call)());
            if begin.elapsed() >= warm_for {
                break;
            }
        }
        let begin = Instant::now();
        black_box((self.call)());
        let found = begin.elapsed().as_secs_f64() * 1e6 / self.taps_per_call as f64;
        match self.us_per_tap.last_mut().filter(|_| !is_first_of_round) {
            Some(fastest) => *fastest = if found < *fastest { found } else { *fastest },
            None => self.us_per_tap.push(found),
        }
    }
}

fn main() -> Result<()> {
    let mut rows = Vec::new();
    for count in COUNTS {
        rows.extend(of_records(count)?);
    }
    rows.extend(of_judging()?);
    let sheet = Sheet {
        title: "Kernels".to_owned(),
        command: "cargo bench -p tapline-bench --bench kernels".to_owned(),
        notes: vec![
            format!(
                "One core, {ROUNDS} rounds of {TURNS} turns each. The fastest turn of a round counts, because other work of the host only slows down. \
                 Before each turn a kernel (Python's too, but not a streamed one) runs untimed for 10 ms. Simulated taps of the dissertation's scan and the default seed, \
                 4 MiB of records per turn."
            ),
            "The seven discriminators of the method with all quality flags, from force and sound of 16 bits. The Python programs \
             (`benches/discriminators.py`) compute the same values without flags, in the batch of 8, 16 or 64 taps that is fastest; \
             versions are pinned in `benches/python.txt`.".to_owned(),
            "A bare transform is the real transform of the sound alone, from samples that are floats already.".to_owned(),
            "Without AVX-512 the transform is rustfft's, and the rest uses AVX2 at most.".to_owned(),
            "Judging reads all discriminators of a casing, ends its scans and judges them. Nothing is known of a new casing. For the \
             others every tap comes as a further attempt, so that no earlier result can be used."
                .to_owned(),
        ],
        rows,
    };
    // Some kernels alone make no page.
    if !asked().is_empty() {
        sheet.print();
        return Ok(());
    }
    sheet.keep("kernels")
}

/// The kernels that the command line names by a part of their names; none for all. Cargo adds arguments that begin with a dash.
fn asked() -> Vec<String> {
    std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect()
}

/// The kernels that are asked for, timed alternately with their yardsticks; the others are left out.
fn measured(mut kernels: Vec<Kernel<'_>>) -> Vec<Kernel<'_>> {
    let asked = asked();
    let is_asked = |name: &str| asked.is_empty() || asked.iter().any(|word| name.contains(word));
    let is_any = kernels.iter().any(|kernel| is_asked(&kernel.name));
    // The streamed kernel stays: its yardstick is only for it, and it runs after Python, while the processor may be slow.
    let is_beside = |name: &str| name.starts_with("yardstick") || name == STREAM;
    kernels.retain(|Kernel { name, .. }| is_any && (is_asked(name) || is_beside(name)));
    for turn in 0..ROUNDS * TURNS {
        for kernel in &mut kernels {
            kernel.time(turn.is_multiple_of(TURNS));
        }
    }
    kernels
}

/// The scan of the dissertation: two turns at each of four offsets and three velocities.
fn dissertation() -> ScanConfig {
    ScanConfig {
        offsets_mm: vec![0.0, 5.0, 10.0, 15.0],
        velocities_m_per_s: vec![1.2, 1.5, 1.85],
        repetitions: 2,
        ..ScanConfig::default()
    }
}

/// The rows of records of `count` samples.
fn of_records(count: usize) -> Result<Vec<Row>> {
    let simulation = SimulationConfig { sample_count: u32::try_from(count)?, ..SimulationConfig::default() };
    let mut line = SimulatedLine::new(&dissertation(), &simulation)?;
    let (taps, _) = tyre(&mut line, &mut extractor()?)?;
    let folder = TempDir::new()?;
    let streamed = Streamed::new(&taps);
    // Waiting for Python lets the processor slow down for some milliseconds, which would count against the next kernel if that
    // were short; the first that streams takes more than 100.
    let mut kernels = Vec::from(streamed.kernels(&taps, extractor()?));
    kernels.extend(yardsticks(&taps, count)?);
    kernels.push(extract(SEVEN, &taps, extractor()?));
    kernels.push(narrow(extract(NARROW, &taps, extractor()?)));
    kernels.extend(python(&taps, count, &folder)?);
    Ok(rows(&measured(kernels), count))
}

/// The rows of judging, for which the length of records does not matter.
fn of_judging() -> Result<Vec<Row>> {
    let mut extractor = extractor()?;
    let mut kernels = vec![judge(&mut extractor)?];
    kernels.extend(judge_again(&mut extractor)?);
    let row = |kernel: &Kernel<'_>| Row::new(kernel.name.as_str(), UNIT, &kernel.us_per_tap);
    Ok(measured(kernels).iter().map(row).collect())
}

/// The rows of kernels of records, if measured.
fn rows(kernels: &[Kernel<'_>], count: usize) -> Vec<Row> {
    let of = |name: &str| Some(kernels.iter().find(|kernel| kernel.name == name)?.us_per_tap.as_slice());
    let fastest = |library: &str| {
        let all = kernels.iter().filter(|kernel| kernel.name.contains(library));
        let medians = all.map(|kernel| (Spread::of(&kernel.us_per_tap).median, kernel.us_per_tap.as_slice()));
        medians.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, times)| times)
    };
    let (ours, narrow, streamed, read) = (of(SEVEN), of(NARROW), of(STREAM), of(READ));
    let (scipy, mkl, zaft, rustfft) = (fastest("scipy"), fastest("mkl"), of(ZAFT), of(RUSTFFT));
    let rows = [
        row(
            &format!("{SEVEN}, records of {count} samples"),
            ours,
            &[
                (scipy, ours, "times as fast as batched scipy f32", ">= 6"),
                (mkl, ours, "times as fast as batched MKL f32", ">= 5"),
                (ours, zaft, "of a bare transform by zaft", "< 1"),
                (ours, rustfft, "of a bare transform by rustfft (realfft)", ""),
            ],
        ),
        row(NARROW, narrow, &[(narrow, ours, "of the time with it", "<= 2")]),
        row(
            &format!("the same, {} MiB streamed from memory", STREAMED >> 20),
            streamed,
            &[(read, streamed, "of the rate at which memory can be read", ">= 0.5")],
        ),
        row("yardstick: scipy f32, batched", scipy, &[]),
        row("yardstick: MKL f32, batched", mkl, &[]),
        row(ZAFT, zaft, &[]),
        row(RUSTFFT, rustfft, &[]),
    ];
    rows.into_iter().flatten().collect()
}

/// A comparison: the numerator's and the denominator's times, if measured; what the ratio is, and its aim.
type Compared<'a> = (Option<&'a [f64]>, Option<&'a [f64]>, &'static str, &'static str);

/// A row of what took `times`, if measured, with the comparisons that were measured.
fn row(what: &str, times: Option<&[f64]>, compared: &[Compared<'_>]) -> Option<Row> {
    let row = Row::new(what, UNIT, times?);
    Some(compared.iter().fold(row, |row, &(above, below, what, aim)| match above.zip(below) {
        Some((above, below)) => row.beside(what, Spread::of_ratio(above, below), aim),
        None => row,
    }))
}

/// The records of many taps one after another, more than caches hold.
struct Streamed {
    counts: Vec<i16>,
    per_tap: usize,
}

impl Streamed {
    fn new(taps: &[Tap]) -> Self {
        let per_tap = taps[0].record.counts().len();
        let count = STREAMED / (2 * per_tap);
        let counts = (0..count).flat_map(|k| taps[k % taps.len()].record.counts().iter().copied()).collect();
        Self { counts, per_tap }
    }

    fn kernels<'a>(&'a self, taps: &'a [Tap], mut extractor: ProcessExtractor) -> [Kernel<'a>; 2] {
        let records = || self.counts.chunks_exact(self.per_tap);
        let taps_per_call = records().len();
        let extract = move || {
            let found = |(counts, tap): (&[i16], &Tap)| extractor.extract(&tap.record.header, Samples::I16(counts));
            let flagged = records().zip(taps.iter().cycle()).map(found).filter(|found| found.quality.is_empty());
            flagged.count() as f64
        };
        let read = move || {
            let words: &[u64] = bytemuck::cast_slice(&self.counts);
            let mut sums = [0_u64; 32];
            for words in words.as_chunks::<32>().0 {
                sums.iter_mut().zip(words).for_each(|(sum, word)| *sum = sum.wrapping_add(*word));
            }
            sums.iter().fold(0, |all, sum| all ^ sum) as f64
        };
        let kernels = [Kernel::new(STREAM, taps_per_call, extract), Kernel::new(READ, taps_per_call, read)];
        kernels.map(|kernel| Kernel { warm_for: None, ..kernel })
    }
}

/// A Python program that computes the discriminators of all taps each time it is asked.
struct Python {
    child: Child,
    ask: ChildStdin,
    answer: BufReader<ChildStdout>,
}

impl Python {
    /// Starts it, and waits until it is ready; `None` if it cannot run.
    fn begin(taps: &[Tap], count: usize, folder: &TempDir, library: &str, batch: usize) -> Result<Option<Self>> {
        let Ok(python) = std::env::var("TAPLINE_BENCH_PYTHON") else { return Ok(None) };
        let (counts, units) = (folder.path().join("counts"), folder.path().join("units"));
        let all: Vec<i16> = taps.iter().flat_map(|tap| tap.record.counts().iter().copied()).collect();
        fs::write(&counts, bytemuck::cast_slice(&all))?;
        let of = |tap: &Tap| [0, 1].map(|channel| tap.record.header.channels[channel].unit_per_count);
        let all: Vec<f64> = taps.iter().flat_map(of).collect();
        fs::write(&units, bytemuck::cast_slice(&all))?;
        let header = &taps[0].record.header;
        let words = [
            count.to_string(),
            header.sample_rate_hz.to_string(),
            header.pre_trigger_samples.to_string(),
            header.microphone_distance_m.to_string(),
        ];
        let mut child = Command::new(python)
            .arg(root().join("benches/kernels.py"))
            .args([&counts, &units])
            .args(words)
            .args([library, &batch.to_string()])
            .envs(["OMP_NUM_THREADS", "MKL_NUM_THREADS"].map(|name| (name, "1")))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let (ask, answer) = (child.stdin.take(), child.stdout.take());
        let (ask, answer) = ask.zip(answer).context("a pipe was asked for")?;
        let mut begun = Self { child, ask, answer: BufReader::new(answer) };
        begun.compute().context("benches/kernels.py does not run")?;
        Ok(Some(begun))
    }

    /// Has it compute everything once.
    fn compute(&mut self) -> Result<f64> {
        writeln!(self.ask, "go")?;
        let mut line = String::new();
        self.answer.read_line(&mut line)?;
        Ok(line.trim().parse()?)
    }
}

impl Drop for Python {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// The Python programs, if there is a Python.
fn python(taps: &[Tap], count: usize, folder: &TempDir) -> Result<Vec<Kernel<'static>>> {
    let mut kernels = Vec::new();
    for library in ["scipy", "mkl"] {
        for batch in BATCHES {
            let Some(mut python) = Python::begin(taps, count, folder, library, batch)? else { return Ok(kernels) };
            let call = move || python.compute().unwrap_or(f64::NAN);
            kernels.push(Kernel::new(format!("yardstick: {library}, {batch} taps"), taps.len(), call));
        }
    }
    Ok(kernels)
}

fn extractor() -> Result<ProcessExtractor> {
    Ok(ProcessExtractor::new(&ProcessConfig::default())?)
}

/// Some taps of a simulated tyre, and the discriminators of all of them.
fn tyre(line: &mut SimulatedLine, extractor: &mut ProcessExtractor) -> Result<(Vec<Tap>, Vec<Discriminators>)> {
    let plan = line.plan().clone();
    let tap_count = SAMPLES / (2 * plan.recording.sample_count_max as usize);
    let every = plan.taps().len() / tap_count;
    let (mut taps, mut records) = (Vec::new(), Vec::new());
    for row in 0..u32::try_from(plan.taps().len())? {
        let record = Record::render(line, row)?;
        records.push(extractor.extract(&record.header, record.samples()));
        if (row as usize).is_multiple_of(every) && taps.len() < tap_count {
            taps.push(Tap::new(record));
        }
    }
    Ok((taps, records))
}

/// Bare transforms of the sound.
fn yardsticks(taps: &[Tap], count: usize) -> Result<[Kernel<'_>; 2]> {
    let zaft = zaft::Zaft::make_r2c_fft_f32(count).map_err(|error| anyhow!("zaft: {error:?}"))?;
    let mut bins_of_zaft = vec![Complex::<f32>::default(); count / 2 + 1];
    let fft = RealFftPlanner::<f32>::new().plan_fft_forward(count);
    let (mut signal, mut bins) = (fft.make_input_vec(), fft.make_output_vec());
    let mut scratch = fft.make_scratch_vec();
    let transform = move |tap: &Tap| {
        signal.copy_from_slice(&tap.sound_v);
        transform(fft.as_ref(), &mut signal, &mut bins, &mut scratch)
    };
    let by_zaft = move |tap: &Tap| {
        // Lengths are the plan's own; an error would show as a time of NaN.
        zaft.execute(&tap.sound_v, &mut bins_of_zaft)
            .map_or(f64::NAN, |()| f64::from(black_box(&mut bins_of_zaft)[1].re))
    };
    Ok([Kernel::per_tap(RUSTFFT, taps, transform), Kernel::per_tap(ZAFT, taps, by_zaft)])
}

fn transform(
    fft: &dyn RealToComplex<f32>,
    signal: &mut [f32],
    bins: &mut [Complex<f32>],
    scratch: &mut [Complex<f32>],
) -> f64 {
    assert!(fft.process_with_scratch(signal, bins, scratch).is_ok(), "the lengths are the plan's own");
    f64::from(black_box(bins)[1].re)
}

fn extract<'a>(name: &str, taps: &'a [Tap], mut extractor: ProcessExtractor) -> Kernel<'a> {
    Kernel::per_tap(name, taps, move |tap| {
        let found = extractor.extract(&tap.record.header, tap.record.samples());
        f64::from(u8::from(black_box(found).quality.is_empty()))
    })
}

/// The kernel without AVX-512.
fn narrow(mut kernel: Kernel<'_>) -> Kernel<'_> {
    let mut call = kernel.call;
    kernel.call = Box::new(move || {
        without_avx512(true);
        let found = call();
        without_avx512(false);
        found
    });
    kernel
}

/// A whole casing of which nothing is known: adds all records, and ends and judges all scans.
fn judge(extractor: &mut ProcessExtractor) -> Result<Kernel<'static>> {
    let mut line = SimulatedLine::new(&dissertation(), &SimulationConfig::default())?;
    let (_, records) = tyre(&mut line, extractor)?;
    let count = records.len();
    let mut fresh = vec![Fusion::new(&FuseConfig::by(Reference::Own), line.plan())?; 2 * ROUNDS * TURNS];
    let call = move || judged(&mut fresh.pop().expect("two a turn"), &records);
    let kernel = Kernel::new(format!("judging a new casing of {count} taps by itself"), count, call);
    // Only once: every call needs a new one.
    Ok(Kernel { warm_for: Some(Duration::ZERO), ..kernel })
}

fn judged(fusion: &mut Fusion, records: &[Discriminators]) -> f64 {
    let is_taken = records.iter().all(|record| fusion.push(record).is_ok());
    let ended = (0..).take_while(|&scan| fusion.end(scan).is_ok()).count();
    let judged = (0..ended).filter_map(|scan| fusion.judge(scan).ok()).map(|(_, cells)| cells.len());
    assert!(is_taken && judged.sum::<usize>() == 200, "a tyre has two shoulders of 100 locations");
    0.0
}

/// One tyre after the other from stored discriminators, as when an archive is judged again with a new configuration.
/// Each call adds the records as a further attempt, so that no work on the previous tyre can be reused.
fn judge_again(extractor: &mut ProcessExtractor) -> Result<Vec<Kernel<'static>>> {
    let mut kernels = Vec::new();
    for (offsets_mm, repetitions) in [(vec![0.0], 1), (vec![0.0], 2), (vec![0.0, 5.0, 10.0, 15.0], 2)] {
        let scan = ScanConfig { offsets_mm, velocities_m_per_s: vec![1.5], repetitions, ..ScanConfig::default() };
        let mut line = SimulatedLine::new(&scan, &SimulationConfig::default())?;
        let (_, records) = tyre(&mut line, extractor)?;
        let plan = line.plan();
        let known = |scan| KnownShoulder::of(plan, &records, scan, Some(plan.truth()));
        let set = build_reference(&Built::default(), (0..plan.scans().len()).filter_map(known).collect())?;
        let fusions = [
            Fusion::new(&FuseConfig::by(Reference::Own), plan)?,
            Fusion::by(&FuseConfig::default(), plan, Some(Arc::new(set)))?,
        ];
        for (by, mut fusion) in ["itself", "a reference"].into_iter().zip(fusions) {
            let mut records = records.clone();
            let count = records.len();
            let call = move || {
                records.iter_mut().for_each(|record| record.id.attempt += 1);
                judged(&mut fusion, &records)
            };
            kernels.push(Kernel::new(format!("judging a casing of {count} taps by {by}"), count, call));
        }
    }
    Ok(kernels)
}
