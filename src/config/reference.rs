//! The reference of a run, and whether it was recorded and analysed like the taps of the run.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, Result, ensure};
use tapline_fuse::{FuseConfig, Fusion, Reference, ReferenceSet};
use tapline_process::ProcessConfig;
use tapline_store::Reader;
use tapline_wire::{Channel, Plan, Recording};

use crate::config::text_of;

/// A reference as it was read.
#[derive(Debug)]
pub(crate) struct ReferenceFile {
    pub text: String,
    pub set: Arc<ReferenceSet>,
}

impl ReferenceFile {
    /// Reads the reference at `path`.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let text = text_of(path).with_context(|| format!("cannot read the reference {}", path.display()))?;
        Self::of(text).with_context(|| format!("cannot use the reference {}", path.display()))
    }

    /// Of a `text` that was read before.
    pub(crate) fn of(text: String) -> Result<Self> {
        let set = Arc::new(ReferenceSet::parse(&text)?);
        Ok(Self { text, set })
    }
}

/// The references that archives keep. Archives of one line have the same one, which is read and fitted once.
#[derive(Debug, Default)]
pub(crate) struct KeptReferences {
    last: Option<ReferenceFile>,
}

impl KeptReferences {
    /// The reference of the archive behind `reader`; `None` if it keeps none.
    pub(crate) fn of(&mut self, reader: &Reader) -> Result<Option<Arc<ReferenceSet>>> {
        reader.reference().map(|text| self.of_text(text)).transpose()
    }

    /// The reference whose text is `text`.
    pub(crate) fn of_text(&mut self, text: &str) -> Result<Arc<ReferenceSet>> {
        let last = match self.last.take().filter(|last| last.text == text) {
            Some(last) => last,
            None => ReferenceFile::of(text.to_owned()).context("cannot use the reference")?,
        };
        Ok(Arc::clone(&self.last.insert(last).set))
    }
}

/// The fusion of an archive's taps, by its `fuse` and its reference; `None` if this program cannot make it.
pub(crate) fn fusion_of(reader: &Reader, fuse: &FuseConfig, set: Option<Arc<ReferenceSet>>) -> Result<Option<Fusion>> {
    let Ok(mut fusion) = Fusion::by(fuse, reader.plan(), set) else { return Ok(None) };
    for record in reader.discriminators()?.iter().flatten() {
        fusion.push(record)?;
    }
    Ok(Some(fusion))
}

/// Makes the fusion of each casing, with the reference that the configuration names.
#[derive(Debug)]
pub(crate) struct Fusions {
    fuse: FuseConfig,
    process: ProcessConfig,
    set: Option<Arc<ReferenceSet>>,
}

impl Fusions {
    /// With the tables `[fuse]` and `[process]`, and the reference file where there is one.
    pub(crate) fn new(fuse: FuseConfig, process: ProcessConfig, set: Option<Arc<ReferenceSet>>) -> Self {
        Self { fuse, process, set }
    }

    /// The fusion of the taps of `plan`.
    pub(crate) fn for_plan(&self, plan: &Plan) -> Result<Fusion, tapline_fuse::Error> {
        self.set.iter().try_for_each(|set| check_reference(set, &self.process, &plan.recording))?;
        Fusion::by(&self.fuse, plan, self.set.clone())
    }

    /// Checks that taps are analysed like those of the reference, as far as the configuration shows.
    pub(crate) fn check_process(&self) -> Result<()> {
        let Some(set) = &self.set else { return Ok(()) };
        let here = options_of(&self.process)?;
        let of_options = |line: &&str| OF_RECORDING.iter().all(|key| !line.starts_with(key));
        let there: Vec<&str> = set.process.lines().filter(of_options).collect();
        let difference = differences(&there.join("\n"), &here);
        ensure!(there.iter().copied().eq(here.lines()), tapline_fuse::Error::ReferenceMadeOtherwise { difference });
        Ok(())
    }

    /// Which of the stated rates the reference does not support, for people to read.
    pub(crate) fn unsupported(&self) -> Vec<String> {
        tapline_fuse::unsupported(&self.fuse, self.set.as_deref())
    }

    /// Which taps of `plan` have none to compare with in the reference, for people to read.
    pub(crate) fn remark_on_conditions(&self, plan: &Plan) -> Option<String> {
        let lacking = self.set.as_ref()?.lacks(plan);
        (!lacking.is_empty()).then(|| {
            format!(
                "the reference has no taps at {}: a shoulder that is tapped there does not pass (condition_unknown)",
                lacking.join("; ")
            )
        })
    }

    /// The fusion of the taps of `plan`, if they are recorded and analysed like those of the reference.
    pub(crate) fn check(&self, plan: &Plan) -> Result<Fusion> {
        check_record_s(&self.process, &plan.recording)?;
        self.check_shoulder(plan)?;
        Ok(self.for_plan(plan)?)
    }

    /// Checks that the casing of `plan` has the shoulder that the reference names: it must be one of the same casing.
    pub(crate) fn check_shoulder(&self, plan: &Plan) -> Result<()> {
        let Some(Reference::Shoulder { tyre, shoulder }) = &self.fuse.reference else { return Ok(()) };
        let has_it = plan.scans().iter().any(|scan| scan.tyre == *tyre && scan.shoulder == *shoulder);
        ensure!(
            has_it,
            "the reference is {tyre}/{shoulder}, and such a shoulder is one of the same casing, but {} does not have \
             it. To compare casings with a sound one, make a reference file of its archive (`tapline reference FOLDER \
             --shoulder {tyre}/{shoulder} --out sound.json`) and give `--reference sound.json`; to compare each with \
             itself, give `--reference self`",
            plan.scans().first().map_or_else(|| "a casing".to_owned(), |scan| format!("casing {}", scan.tyre))
        );
        let is_cracked = plan.truth().iter().any(|(&(of, side, _), &is)| is && of == *tyre && side == *shoulder);
        ensure!(
            !is_cracked,
            "the reference is {tyre}/{shoulder}, which is known to be cracked: give --reference self, or a file"
        );
        Ok(())
    }
}

/// All that discriminators depend on: rate, channels, units, analysed length and pre-trigger time of the records, and
/// the table `[process]` with every default. `record_s` is in the analysed length.
pub(crate) fn process_of(config: &ProcessConfig, recording: &Recording) -> Result<String> {
    let channels: Vec<&str> = recording.channels.iter().map(|channel| channel.name()).collect();
    let units: Vec<&str> = recording.channels.iter().map(|&c| recording.calibration.unit(c).name()).collect();
    let rate_hz = recording.sample_rate_hz;
    let analysed_s = f64::from(config.samples_looked_at(recording.sample_count_max, rate_hz)) / rate_hz;
    let pre_trigger_s = f64::from(recording.pre_trigger_samples) / rate_hz;
    let config = options_of(config)?;
    Ok(format!(
        "sample_rate_hz = {rate_hz:?}\nchannels = {channels:?}\nunits = {units:?}\nanalysed_s = {analysed_s:?}\npre_trigger_s = \
         {pre_trigger_s:?}\n{config}"
    ))
}

/// Keys of [`process_of`] that depend on how taps are recorded.
const OF_RECORDING: [&str; 5] = ["sample_rate_hz", "channels", "units", "analysed_s", "pre_trigger_s"];

/// The table `[process]` without `record_s`.
fn options_of(config: &ProcessConfig) -> Result<String> {
    let mut config = toml::Table::try_from(config).context("the configuration of process does not fit TOML")?;
    config.remove("record_s");
    Ok(config.to_string())
}

/// What is doubtful about analysing taps recorded like this: a band extends beyond the end of their spectrum.
pub(crate) fn remark_on_bands(config: &ProcessConfig, recording: &Recording) -> Option<String> {
    let half_hz = recording.sample_rate_hz / 2.0;
    let (f_top_hz, rate_hz) = (config.f_top_hz, recording.sample_rate_hz);
    let is_beyond = f_top_hz > half_hz && recording.channels.contains(&Channel::Sound);
    is_beyond.then(|| {
        format!("process.f_top_hz = {f_top_hz} Hz: the band ends at {half_hz} Hz, half the sample rate of {rate_hz} Hz")
    })
}

/// Checks that the analysed part of each record extends beyond its trigger.
pub(crate) fn check_record_s(config: &ProcessConfig, recording: &Recording) -> Result<()> {
    let (pre_trigger, rate_hz) = (recording.pre_trigger_samples, recording.sample_rate_hz);
    ensure!(
        config.samples_looked_at(u32::MAX, rate_hz) > pre_trigger,
        "process.record_s = {} s: must be 0, or above the {:.4} s of each record before the trigger",
        config.record_s,
        f64::from(pre_trigger) / rate_hz
    );
    Ok(())
}

/// Checks that the taps of `set` were recorded and analysed like those of a run.
pub(crate) fn check_reference(
    set: &ReferenceSet,
    config: &ProcessConfig,
    recording: &Recording,
) -> Result<(), tapline_fuse::Error> {
    // No reference was made with a configuration that cannot be written as TOML.
    let (there, here) = (&set.process, process_of(config, recording).unwrap_or_default());
    match *there == here {
        true => Ok(()),
        false => Err(tapline_fuse::Error::ReferenceMadeOtherwise { difference: differences(there, &here) }),
    }
}

/// The lines of two texts that differ.
pub(crate) fn differences(was: &str, is: &str) -> String {
    let only = |of: &str, other: &str| -> Vec<String> {
        of.lines().filter(|line| !other.lines().any(|l| l == *line)).map(str::to_owned).collect()
    };
    let listed = |lines: Vec<String>| if lines.is_empty() { "nothing".to_owned() } else { lines.join(", ") };
    format!("{} there, {} here", listed(only(was, is)), listed(only(is, was)))
}

#[cfg(test)]
mod tests {
    use tapline_wire::{Calibration, SampleFormat};

    use super::*;

    #[test]
    fn what_differs_is_named() {
        // Catches a difference that is not looked at, as of the rate or the channels, one that is not named, and lines that
        // are alike and named.
        let recording = Recording {
            sample_rate_hz: 40_960.0,
            pre_trigger_samples: 512,
            sample_count_max: 16_384,
            sample_format: SampleFormat::I16,
            channels: Channel::BOTH.to_vec(),
            calibration: Calibration::stated(),
        };
        let config = ProcessConfig::default();
        let was = process_of(&config, &recording).unwrap();
        let difference =
            |config: &ProcessConfig, recording: &Recording| differences(&was, &process_of(config, recording).unwrap());
        let faster = Recording { sample_rate_hz: 48_000.0, ..recording.clone() };
        assert_eq!(
            difference(&config, &faster),
            "sample_rate_hz = 40960.0, analysed_s = 0.4, pre_trigger_s = 0.0125 there, sample_rate_hz = 48000.0, \
             analysed_s = 0.3413333333333333, pre_trigger_s = 0.010666666666666666 here"
        );
        let deaf = Recording { channels: vec![Channel::Force], ..recording.clone() };
        assert_eq!(
            difference(&config, &deaf),
            "channels = [\"force\", \"sound\"], units = [\"N\", \"V\"] there, channels = [\"force\"], units = [\"N\"] here"
        );
        let later = Recording { pre_trigger_samples: 1024, ..recording.clone() };
        assert_eq!(difference(&config, &later), "pre_trigger_s = 0.0125 there, pre_trigger_s = 0.025 here");
        assert_eq!(differences("a\nb", "a"), "b there, nothing here");
        let unscaled = Recording { calibration: Calibration::default(), ..recording.clone() };
        assert_eq!(difference(&config, &unscaled), "units = [\"N\", \"V\"] there, units = [\"FS\", \"FS\"] here");
        let other = ProcessConfig { f_c_hz: 600.0, f_hi_hz: 1900.0, ..config };
        assert_eq!(
            difference(&other, &recording),
            "f_c_hz = 550.0, f_hi_hz = 2000.0 there, f_c_hz = 600.0, f_hi_hz = 1900.0 here"
        );
        let longer = Recording { sample_count_max: 32_768, sample_format: SampleFormat::F32, ..recording.clone() };
        assert_eq!(difference(&config, &longer), "analysed_s = 0.4 there, analysed_s = 0.8 here");
        // What is not analysed of longer records, and the type of their samples, do not count.
        let short = ProcessConfig { record_s: 0.2, ..config };
        assert_eq!(process_of(&short, &longer).unwrap(), process_of(&short, &recording).unwrap());
        let as_long = ProcessConfig { record_s: 0.4, ..config };
        assert_eq!(process_of(&as_long, &longer).unwrap(), was);
        assert!(check_record_s(&config, &longer).is_ok());
        let refused = check_record_s(&ProcessConfig { record_s: 0.0125, ..config }, &longer).unwrap_err().to_string();
        assert_eq!(
            refused,
            "process.record_s = 0.0125 s: must be 0, or above the 0.0125 s of each record before the trigger"
        );
        let force_alone = Recording { channels: vec![Channel::Force], ..longer.clone() };
        let high = ProcessConfig { f_top_hz: 20_481.0, ..config };
        let remark = "process.f_top_hz = 20481 Hz: the band ends at 20480 Hz, half the sample rate of 40960 Hz";
        assert_eq!(remark_on_bands(&high, &longer).as_deref(), Some(remark));
        assert_eq!((remark_on_bands(&config, &longer), remark_on_bands(&high, &force_alone)), (None, None));
    }
}
