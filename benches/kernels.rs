//! The cost of each kernel per tap, compared with a bare transform, a conversion and a copy of the same record.
//!
//! All kernels take turns, and the fastest turn of each round counts, so that what slows the machine down is left out; ratios
//! are from one run.
//!
//! Beside them work two Python programs with batched transforms (`benches/kernels.py`), if `TAPLINE_BENCH_PYTHON` names a Python
//! that has what `benches/python.txt` lists.

use std::fs;
use std::hint::black_box;
use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result, anyhow};
use realfft::num_complex::Complex;
use realfft::{RealFftPlanner, RealToComplex};
use tapline_acquire::{ScanConfig, SimulatedLine, Source as _};
use tapline_fuse::{Built, FuseConfig, Fusion, KnownShoulder, Reference, build_reference};
use tapline_model::{DampingLaw, Rung, Scene, SimulationConfig, choose};
use tapline_process::{Precision, ProcessConfig, ProcessExtractor, without_avx512};
use tapline_wire::{
    CacheLine, Channel, ChannelHeader, Discriminators, SampleFormat, Samples, TapHeader, cache_lines_for,
};

use tapline_bench::{Row, Sheet, Spread, print_table, quantile, root};
use tempfile::TempDir;

const ROUNDS: usize = 12;
/// Turns of a round, of which each kernel's fastest counts: what else the host does comes and goes in tenths of a second, only ever
/// slows down, and slows arithmetic more than memory.
const TURNS: usize = 10;
/// Samples of all taps of a turn, from all over the tyre: 4 MiB of records, more than the inner caches hold.
const SAMPLES: usize = 1 << 21;
/// Records that are streamed from memory, bytes: more than any cache holds.
const STREAMED: usize = 1 << 28;
/// Contacts of a turn.
const TAPS: usize = 64;
/// Taps that Python transforms at a time; the fastest counts.
const BATCHES: [usize; 3] = [8, 16, 64];
/// The name of what all of this is about.
const SEVEN: &str = "extract f32, force and sound i16";
/// Samples of one channel: of the default record, and of one of 0.4 s.
const COUNTS: [usize; 2] = [2048, 16_384];

/// One tap as the line has it, and its sound alone as another converter would record it.
struct Tap {
    row: u32,
    header: TapHeader,
    buffer: Vec<CacheLine>,
    mono_header: TapHeader,
    mono: Vec<f32>,
}

impl Tap {
    fn counts(&self) -> &[i16] {
        match Samples::view(&self.header, &self.buffer) {
            Some(Samples::I16(counts)) => counts,
            _ => &[],
        }
    }
}

/// A kernel, the number of taps per call, and its times per tap in us.
struct Kernel<'a> {
    name: &'static str,
    taps_per_call: usize,
    call: Box<dyn FnMut() -> f64 + 'a>,
    us_per_tap: Vec<f64>,
}

impl<'a> Kernel<'a> {
    /// A kernel that is called for one tap at a time.
    fn per_tap(name: &'static str, taps: &'a [Tap], mut each: impl FnMut(&'a Tap) -> f64 + 'a) -> Self {
        let call = move || taps.iter().map(&mut each).sum();
        Self { name, taps_per_call: taps.len(), call: Box::new(call), us_per_tap: Vec::new() }
    }

    /// Times a call; the fastest of a round is kept. An untimed call comes first, because the other kernels empty the caches, and
    /// what has to come from memory is a row of its own.
    #[expect(clippy::cast_precision_loss, reason = "a count of taps")]
    fn time(&mut self, is_first_of_round: bool) {
        black_box((self.call)());
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
    let sheet = Sheet {
        title: "Kernels".to_owned(),
        command: "cargo bench -p tapline-bench --bench kernels".to_owned(),
        notes: vec![
            format!(
                "One core, {ROUNDS} rounds of {TURNS} turns each; of a round the fastest turn counts, because what else the host does comes and \
                 goes, and only slows down. An untimed call comes before each timed one. Simulated taps of the default scan and seed, 4 MiB of records a turn."
            ),
            "The seven discriminators of the method with all quality flags, from force and sound of 16 bits. The Python programs \
             (`benches/discriminators.py`) compute the same values without flags, in the batch of 8, 16 or 64 taps that is fastest; \
             versions are pinned in `benches/python.txt`.".to_owned(),
            "A bare transform is the real transform of the sound alone, from samples that are floats already.".to_owned(),
            "Without AVX-512 the transform is rustfft's, and the rest uses AVX2 at most.".to_owned(),
        ],
        rows,
    };
    if asked().is_empty() {
        sheet.keep("kernels")?;
    }
    Ok(())
}

/// The kernels that the command line names by a part of their names; none for all. Cargo adds arguments that begin with a dash.
fn asked() -> Vec<String> {
    std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect()
}

/// The table for records of `count` samples.
fn of_records(count: usize) -> Result<Vec<Row>> {
    let simulation = SimulationConfig { sample_count: u32::try_from(count)?, ..SimulationConfig::default() };
    let mut line = SimulatedLine::new(&ScanConfig::default(), &simulation)?;
    let mut extractor = extractor(Precision::F32)?;
    let again = judge_again(&mut extractor)?;
    let (taps, records) = tyre(&mut line, &mut extractor)?;
    let fusion = Fusion::new(&FuseConfig::by(Reference::Own), line.plan())?;
    let folder = TempDir::new()?;
    let streamed = Streamed::new(&taps);
    // Waiting for Python lets the processor slow down for some milliseconds, which would count against the next kernel if that
    // were short; those that stream take hundreds.
    let mut kernels = Vec::from(streamed.kernels(&taps, self::extractor(Precision::F32)?));
    kernels.extend(yardsticks(&taps, count)?);
    kernels.push(render(line, &taps));
    kernels.push(extract(SEVEN, &taps, extractor, false));
    kernels.push(narrow(extract("the same without AVX-512", &taps, self::extractor(Precision::F32)?, false)));
    kernels.push(extract("extract f64, force and sound i16", &taps, self::extractor(Precision::F64)?, false));
    kernels.push(extract("extract f32, sound alone f32", &taps, self::extractor(Precision::F32)?, true));
    kernels.push(extract("extract f64, sound alone f32", &taps, self::extractor(Precision::F64)?, true));
    kernels.push(judge(fusion, &records));
    kernels.extend(again);
    kernels.extend(ladder());
    kernels.extend(python(&taps, count, &folder)?);
    let asked = asked();
    kernels.retain(|kernel| {
        asked.is_empty()
            || kernel.name.starts_with("yardstick")
            || kernel.name == STREAM
            || asked.iter().any(|word| kernel.name.contains(word))
    });
    for turn in 0..ROUNDS * TURNS {
        for kernel in &mut kernels {
            kernel.time(turn.is_multiple_of(TURNS));
        }
    }
    let rows = rows(&kernels, count);
    report(&mut kernels, count);
    Ok(rows)
}

/// The rows of the page, where the kernels that they compare are there.
fn rows(kernels: &[Kernel<'_>], count: usize) -> Vec<Row> {
    let of = |name: &str| Some(kernels.iter().find(|kernel| kernel.name == name)?.us_per_tap.as_slice());
    let fastest = |library: &str| {
        let all = kernels.iter().filter(|kernel| kernel.name.contains(library) && !kernel.us_per_tap.is_empty());
        let medians = all.map(|kernel| (Spread::of(&kernel.us_per_tap).median, kernel.us_per_tap.as_slice()));
        medians.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, times)| times)
    };
    let Some(ours) = of(SEVEN) else { return Vec::new() };
    let mut seven = Row::new(format!("seven discriminators, records of {count} samples"), "us a tap", ours);
    for (library, what, aim) in
        [("scipy", "times as fast as batched scipy f32", ">= 6"), ("MKL", "times as fast as batched MKL f32", ">= 5")]
    {
        if let Some(theirs) = fastest(library) {
            seven = seven.beside(what, Spread::of_ratio(theirs, ours), aim);
        }
    }
    let mut rows = Vec::new();
    if let Some(zaft) = of(ZAFT) {
        seven = seven.beside("of a bare transform by zaft", Spread::of_ratio(ours, zaft), "< 1");
    }
    if let Some(rustfft) = of(RUSTFFT) {
        seven = seven.beside("of a bare transform by rustfft (realfft)", Spread::of_ratio(ours, rustfft), "");
    }
    rows.push(seven);
    if let Some(portable) = of("the same without AVX-512") {
        let row = Row::new("the same without AVX-512", "us a tap", portable);
        rows.push(row.beside("of the time with it", Spread::of_ratio(portable, ours), "<= 2"));
    }
    if let (Some(streamed), Some(read)) = (of(STREAM), of(READ)) {
        let row = Row::new(format!("the same, {} MiB streamed from memory", STREAMED >> 20), "us a tap", streamed);
        rows.push(row.beside("of the rate at which memory can be read", Spread::of_ratio(read, streamed), ">= 0.5"));
    }
    for (library, what) in [("scipy", "scipy f32, batched"), ("MKL", "MKL f32, batched")] {
        rows.extend(fastest(library).map(|times| Row::new(format!("yardstick: {what}"), "us a tap", times)));
    }
    for (name, what) in [(ZAFT, "bare transform by zaft"), (RUSTFFT, "bare transform by rustfft (realfft)")] {
        rows.extend(of(name).map(|times| Row::new(format!("yardstick: {what}"), "us a tap", times)));
    }
    rows
}

const RUSTFFT: &str = "yardstick: bare f32 transform";
const ZAFT: &str = "yardstick: the same by zaft";
const STREAM: &str = "extract f32, streamed from memory";
const READ: &str = "yardstick: read from memory";

/// The records of many taps one after another, more than caches hold.
struct Streamed {
    counts: Vec<i16>,
    per_tap: usize,
}

impl Streamed {
    fn new(taps: &[Tap]) -> Self {
        let per_tap = taps[0].counts().len();
        let count = STREAMED / (2 * per_tap);
        let counts = (0..count).flat_map(|k| taps[k % taps.len()].counts().iter().copied()).collect();
        Self { counts, per_tap }
    }

    fn kernels<'a>(&'a self, taps: &'a [Tap], mut extractor: ProcessExtractor) -> [Kernel<'a>; 2] {
        let records = || self.counts.chunks_exact(self.per_tap);
        let taps_per_call = records().len();
        let extract = move || {
            let found = |(counts, tap): (&[i16], &Tap)| extractor.extract(&tap.header, Samples::I16(counts));
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
        let kernel =
            |name, call: Box<dyn FnMut() -> f64 + 'a>| Kernel { name, taps_per_call, call, us_per_tap: Vec::new() };
        [kernel(STREAM, Box::new(extract)), kernel(READ, Box::new(read))]
    }
}

/// A Python program that computes the discriminators of all taps each time it is asked.
struct Python {
    child: Child,
    ask: ChildStdin,
    answer: BufReader<ChildStdout>,
}

impl Python {
    /// Has it begin, and wait for it to be ready; `None` if it cannot.
    fn begin(taps: &[Tap], count: usize, folder: &TempDir, library: &str, batch: usize) -> Result<Option<Self>> {
        let Ok(python) = std::env::var("TAPLINE_BENCH_PYTHON") else { return Ok(None) };
        let (counts, units) = (folder.path().join("counts"), folder.path().join("units"));
        let all: Vec<i16> = taps.iter().flat_map(|tap| tap.counts().iter().copied()).collect();
        fs::write(&counts, bytemuck::cast_slice(&all))?;
        let of = |tap: &Tap| [tap.header.channels[0].unit_per_count, tap.header.channels[1].unit_per_count];
        let all: Vec<f64> = taps.iter().flat_map(of).collect();
        fs::write(&units, bytemuck::cast_slice(&all))?;
        let header = &taps[0].header;
        let words = [count.to_string(), header.sample_rate_hz.to_string(), header.pre_trigger_samples.to_string()];
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
    for (library, names) in [
        ("scipy", ["yardstick: scipy, 8 taps", "yardstick: scipy, 16 taps", "yardstick: scipy, 64 taps"]),
        ("mkl", ["yardstick: MKL, 8 taps", "yardstick: MKL, 16 taps", "yardstick: MKL, 64 taps"]),
    ] {
        for (batch, name) in BATCHES.into_iter().zip(names) {
            let Some(mut python) = Python::begin(taps, count, folder, library, batch)? else { return Ok(kernels) };
            let call = move || python.compute().unwrap_or(f64::NAN);
            kernels.push(Kernel { name, taps_per_call: taps.len(), call: Box::new(call), us_per_tap: Vec::new() });
        }
    }
    Ok(kernels)
}

fn extractor(precision: Precision) -> Result<ProcessExtractor> {
    Ok(ProcessExtractor::new(&ProcessConfig { precision, ..ProcessConfig::default() })?)
}

/// Some taps of a simulated tyre, and the discriminators of all of them.
fn tyre(line: &mut SimulatedLine, extractor: &mut ProcessExtractor) -> Result<(Vec<Tap>, Vec<Discriminators>)> {
    let plan = line.plan().clone();
    let tap_count = SAMPLES / (2 * plan.recording.sample_count_max as usize);
    let every = plan.taps().len() / tap_count;
    let (mut taps, mut records) = (Vec::new(), Vec::new());
    for row in 0..u32::try_from(plan.taps().len())? {
        let mut header = TapHeader::default();
        let mut buffer = vec![CacheLine::default(); cache_lines_for(plan.recording.payload_bytes_max())];
        line.render(row, 0, &mut header, &mut buffer)?;
        let samples = Samples::view(&header, &buffer).context("a simulated tap describes itself")?;
        records.push(extractor.extract(&header, samples));
        if (row as usize).is_multiple_of(every) && taps.len() < tap_count {
            taps.push(with_mono(Tap { row, header, buffer, mono_header: header, mono: Vec::new() }));
        }
    }
    Ok((taps, records))
}

/// Adds a record of the sound alone, in volts.
fn with_mono(mut tap: Tap) -> Tap {
    let sound = tap.header.channels[1];
    #[expect(clippy::cast_possible_truncation, reason = "a converter that gives f32 does the same")]
    let volts = |&count: &i16| (f64::from(count) * sound.unit_per_count) as f32;
    tap.mono = tap.counts()[tap.header.sample_count as usize..].iter().map(volts).collect();
    tap.mono_header.channel_count = 1;
    tap.mono_header.sample_format = SampleFormat::F32.code();
    tap.mono_header.channels[0] =
        ChannelHeader { code: Channel::Sound.code(), unit_per_count: 1.0, ..ChannelHeader::default() };
    tap
}

fn yardsticks(taps: &[Tap], count: usize) -> Result<Vec<Kernel<'_>>> {
    let zaft = zaft::Zaft::make_r2c_fft_f32(count).map_err(|error| anyhow!("zaft: {error:?}"))?;
    let mut bins_of_zaft = vec![Complex::<f32>::default(); count / 2 + 1];
    let fft = RealFftPlanner::<f32>::new().plan_fft_forward(count);
    let (mut signal, mut bins) = (fft.make_input_vec(), fft.make_output_vec());
    let mut scratch = fft.make_scratch_vec();
    let transform = move |tap: &Tap| {
        signal.copy_from_slice(&tap.mono);
        transform(fft.as_ref(), &mut signal, &mut bins, &mut scratch)
    };
    let mut floats = vec![0.0_f32; 2 * count];
    let convert = move |tap: &Tap| {
        for (to, &from) in floats.iter_mut().zip(tap.counts()) {
            *to = f32::from(from);
        }
        f64::from(black_box(&mut floats)[count])
    };
    let mut copied = vec![0_i16; 2 * count];
    let copy = move |tap: &Tap| {
        copied.copy_from_slice(tap.counts());
        f64::from(black_box(&mut copied)[count])
    };
    let by_zaft = move |tap: &Tap| {
        // Lengths are the plan's own; an error would show as a time that is no number.
        zaft.execute(&tap.mono, &mut bins_of_zaft).map_or(f64::NAN, |()| f64::from(black_box(&mut bins_of_zaft)[1].re))
    };
    Ok(vec![
        Kernel::per_tap(RUSTFFT, taps, transform),
        Kernel::per_tap(ZAFT, taps, by_zaft),
        Kernel::per_tap("yardstick: i16 to f32 of the record", taps, convert),
        Kernel::per_tap(COPY, taps, copy),
    ])
}

const COPY: &str = "yardstick: copy of the record";

fn transform(
    fft: &dyn RealToComplex<f32>,
    signal: &mut [f32],
    bins: &mut [Complex<f32>],
    scratch: &mut [Complex<f32>],
) -> f64 {
    assert!(fft.process_with_scratch(signal, bins, scratch).is_ok(), "the lengths are the plan's own");
    f64::from(black_box(bins)[1].re)
}

fn render(mut line: SimulatedLine, taps: &[Tap]) -> Kernel<'_> {
    let mut buffer = taps[0].buffer.clone();
    Kernel::per_tap("simulate a tap, force and sound i16", taps, move |tap| {
        let mut header = TapHeader::default();
        assert!(line.render(tap.row, 0, &mut header, &mut buffer).is_ok(), "the row was rendered before");
        header.velocity_measured_m_per_s
    })
}

fn extract<'a>(name: &'static str, taps: &'a [Tap], mut extractor: ProcessExtractor, is_mono: bool) -> Kernel<'a> {
    Kernel::per_tap(name, taps, move |tap| {
        let found = match is_mono {
            true => extractor.extract(&tap.mono_header, Samples::F32(&tap.mono)),
            false => extractor.extract(&tap.header, Samples::I16(tap.counts())),
        };
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

/// The whole tyre: all records are added, and all scans are ended and judged.
fn judge(fusion: Fusion, records: &[Discriminators]) -> Kernel<'_> {
    let mut fresh = vec![fusion; 2 * ROUNDS * TURNS];
    let call = move || judged(&mut fresh.pop().expect("two a turn"), records);
    Kernel {
        name: "fuse a tyre: take in, end, judge",
        taps_per_call: records.len(),
        call: Box::new(call),
        us_per_tap: Vec::new(),
    }
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
    for (offsets_mm, repetitions, names) in [
        (vec![0.0], 1, ["fuse again 202 taps, by itself", "fuse again 202 taps, by a reference"]),
        (vec![0.0], 2, ["fuse again 404 taps, by itself", "fuse again 404 taps, by a reference"]),
        (vec![0.0, 5.0, 10.0, 15.0], 2, ["fuse again 1616 taps, by itself", "fuse again 1616 taps, by a reference"]),
    ] {
        let scan = ScanConfig { offsets_mm, velocities_m_per_s: vec![1.5], repetitions, ..ScanConfig::default() };
        let mut line = SimulatedLine::new(&scan, &SimulationConfig::default())?;
        let (_, records) = tyre(&mut line, extractor)?;
        let plan = line.plan();
        let known = |scan| KnownShoulder::of(plan, &records, scan, Some(plan.truth()));
        let built = Built {
            config: FuseConfig::default(),
            lineage: Vec::new(),
            process: String::new(),
            learns_directions: false,
        };
        let set = build_reference(&built, (0..plan.scans().len()).filter_map(known).collect())?;
        let fusions = [
            Fusion::new(&FuseConfig::by(Reference::Own), plan)?,
            Fusion::with_reference(&FuseConfig::default(), plan, Arc::new(set))?,
        ];
        for (name, mut fusion) in names.into_iter().zip(fusions) {
            let mut records = records.clone();
            let taps_per_call = records.len();
            let call = move || {
                records.iter_mut().for_each(|record| record.id.attempt += 1);
                judged(&mut fusion, &records)
            };
            kernels.push(Kernel { name, taps_per_call, call: Box::new(call), us_per_tap: Vec::new() });
        }
    }
    Ok(kernels)
}

/// One contact on each rung of the ladder, and on the one that a tolerance chooses. The cracks are 4 to 250 mm deep,
/// mostly deep, because most locations of a casing are sound.
fn ladder() -> Vec<Kernel<'static>> {
    #[expect(clippy::cast_precision_loss, reason = "a small index")]
    let scenes: Vec<Scene> = (0..TAPS)
        .map(|i| i as f64 / TAPS as f64)
        .map(|fraction| Scene {
            h_m: 4e-3 * 62.0_f64.powf(fraction.sqrt()),
            l_m: 0.018 + 0.008 * (fraction * 37.0).fract(),
            velocity_m_per_s: 1.0 + (fraction * 23.0).fract(),
            ..Scene::default()
        })
        .collect();
    let kernel = |name, f_max: fn(&Scene) -> Option<f64>| {
        let scenes = scenes.clone();
        let call = move || scenes.iter().map(|scene| f_max(black_box(scene)).unwrap_or(f64::NAN)).sum();
        Kernel { name, taps_per_call: TAPS, call: Box::new(call), us_per_tap: Vec::new() }
    };
    fn on(rung: Rung, scene: &Scene) -> Option<f64> {
        rung.contact(scene, DampingLaw::Exact).ok().map(|contact| contact.f_max_n)
    }
    fn within(tolerance: f64, scene: &Scene) -> Option<f64> {
        choose(scene, DampingLaw::Exact, tolerance).ok().map(|choice| choice.contact.f_max_n)
    }
    vec![
        kernel("contact: closed form", |scene| on(Rung::Closed, scene)),
        kernel("contact: integral table", |scene| on(Rung::Integral, scene)),
        kernel("contact: plate in time", |scene| on(Rung::Plate, scene)),
        kernel("contact: full, to be beaten by the next", |scene| on(Rung::Full, scene)),
        kernel("contact: chosen, within 0.001 of full", |scene| within(1e-3, scene)),
        kernel("contact: chosen, within 0.05 of full", |scene| within(0.05, scene)),
        kernel("contact: chosen, within 0.2 of full", |scene| within(0.2, scene)),
    ]
}

fn report(kernels: &mut [Kernel<'_>], count: usize) {
    let rows: Vec<(&str, f64, f64)> = kernels
        .iter_mut()
        .map(|k| (k.name, quantile(&mut k.us_per_tap, 0.5), quantile(&mut k.us_per_tap, 0.25)))
        .collect();
    let of = |name: &str| rows.iter().find(|row| row.0 == name).map_or(f64::NAN, |row| row.2);
    let (transform, copy) = (of(RUSTFFT), of(COPY));
    let text: Vec<[String; 5]> = rows
        .iter()
        .map(|&(name, median, quartile)| {
            let ratio = |to: f64| format!("{:.2}", quartile / to);
            [name.to_owned(), format!("{median:.2}"), format!("{quartile:.2}"), ratio(transform), ratio(copy)]
        })
        .collect();
    let title = format!(
        "kernels, records of {count} samples, us per tap, fastest of {TURNS} turns in {ROUNDS} rounds; ratios of lower quartiles"
    );
    print_table(&title, ["kernel", "median", "lower quartile", "/ transform", "/ copy"], &text);
}
