//! A source of taps: asked for a tap by its row in the plan, it renders that tap in place.

pub(crate) mod arrivals;

use std::fmt;

use tapline_wire::{CHANNELS_MAX, CacheLine, ChannelHeader, Plan, Recording, Serial, SourceKind, TapHeader};

use crate::Error;

/// What must be known of a source before any of its taps.
#[derive(Debug)]
pub struct About {
    /// Every tap there is to render.
    pub plan: Plan,
    /// What kind of source this is.
    pub kind: SourceKind,
    /// Whether a tap that is requested again is struck again, or is the same record.
    pub can_retake: bool,
    /// How many additional taps it can give, of the same scans as its plan.
    pub room: u32,
}

/// A source of taps: those of one casing at one station.
///
/// A tap depends only on its plan row and attempt, never on what was rendered before it: a run that is resumed,
/// retaken or split over stations gets the same bytes.
pub trait Source: Send + fmt::Debug {
    /// What must be known of it before any of its taps.
    fn about(&self) -> &About;

    /// Every tap there is to render.
    fn plan(&self) -> &Plan {
        &self.about().plan
    }

    /// Replaces its plan with `plan`, which has additional taps; never more than its [room](About::room).
    fn grow(&mut self, plan: Plan) {
        let _recorded = plan;
    }

    /// Whether the tap in plan row `row` can be rendered now; this call commands a rig to move and hit.
    ///
    /// Never blocks. A source whose taps exist already is always ready.
    fn poll(&mut self, row: u32, attempt: u16) -> Readiness {
        let _whichever = (row, attempt);
        Readiness::Ready
    }

    /// Renders the tap in plan row `row` into `buffer`, and all that is known of it into `header`.
    ///
    /// If its source knows of earlier takes, the tap may be of a later attempt than `attempt`. Of `header`
    /// - `id` and `plan_index` are filled in always;
    /// - `stamp`, `sent_ns` and `retakes_left` never: who sends the tap fills them in;
    /// - the rest unless the tap is refused.
    ///
    /// Of `buffer` the first [`TapHeader::payload_bytes`] bytes are written; it must have room for
    /// [`Recording::payload_bytes_max`].
    ///
    /// # Errors
    /// [`Refusal`] if this tap is unavailable; others may still be available.
    fn render(
        &mut self,
        row: u32,
        attempt: u16,
        header: &mut TapHeader,
        buffer: &mut [CacheLine],
    ) -> Result<(), Refusal> {
        let About { plan, kind, .. } = self.about();
        *header = named(plan, row, attempt, *kind, header)?;
        let (need_bytes, got_bytes) = (plan.recording.payload_bytes_max(), size_of_val(buffer));
        // The caller's mistake, but no reason to stop a line.
        if got_bytes < need_bytes {
            let reason = format!("the loan has {got_bytes} bytes; the samples need {need_bytes}");
            return Err(Refusal { file: "plan".to_owned(), line: 0, reason });
        }
        self.fill(header, buffer)
    }

    /// Fills in the samples and the rest of `header`, which names the tap already; `buffer` has room for them.
    ///
    /// # Errors
    /// As [`Source::render`].
    fn fill(&mut self, header: &mut TapHeader, buffer: &mut [CacheLine]) -> Result<(), Refusal>;
}

/// Whether a tap can be rendered now.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Readiness {
    /// It can.
    Ready,
    /// It is on its way: ask again when woken, or after [`crate::Arrivals::look_every`].
    NotYet,
    /// Only this tap will not come.
    Refused(Refusal),
    /// The casing was taken away, for the reason given: no more of its taps will come.
    Gone(String),
}

/// Why a planned tap will not come.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// Recording of the tap as `taps.csv` names it, or its counterpart in a source without files; empty if the reason
    /// needs none.
    pub file: String,
    /// Line of `taps.csv`, from 1; 0 where there is no such file.
    pub line: usize,
    /// What is wrong with it.
    pub reason: String,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, line, reason } = self;
        match line {
            _ if file.is_empty() => f.write_str(reason),
            0 => write!(f, "{file}: {reason}"),
            _ => write!(f, "{file} (taps.csv line {line}): {reason}"),
        }
    }
}

impl std::error::Error for Refusal {}

/// Everything of a header that is the same for all taps of `plan`, plus the tap's name.
pub(crate) fn named(
    plan: &Plan,
    row: u32,
    attempt: u16,
    kind: SourceKind,
    old: &TapHeader,
) -> Result<TapHeader, Refusal> {
    let mut id = plan.taps().get(row as usize).ok_or_else(|| no_such_row(plan, row))?.id;
    id.attempt = attempt;
    let recording = &plan.recording;
    Ok(TapHeader {
        stamp: old.stamp,
        sent_ns: old.sent_ns,
        id,
        plan_index: row,
        tap_time_ns: 0,
        sample_rate_hz: recording.sample_rate_hz,
        velocity_measured_m_per_s: f64::NAN,
        velocity_nominal_m_per_s: plan.velocity_nominal_m_per_s(row).unwrap_or(f64::NAN),
        microphone_distance_m: 0.0,
        pre_trigger_samples: recording.pre_trigger_samples,
        sample_count: 0,
        text_bytes: 0,
        sample_format: recording.sample_format.code(),
        channel_count: u32::try_from(recording.channels.len()).unwrap_or(0),
        source: kind.code(),
        retakes_left: 0,
        planned_sample_count: recording.sample_count_max,
        channels: Default::default(),
    })
}

/// The channel headers of `recording`, each with its scale in physical units per count.
pub(crate) fn channel_headers(recording: &Recording, unit_per_count: &[f64]) -> [ChannelHeader; CHANNELS_MAX] {
    let mut headers = [ChannelHeader::default(); CHANNELS_MAX];
    for ((header, channel), &unit_per_count) in headers.iter_mut().zip(&recording.channels).zip(unit_per_count) {
        *header = ChannelHeader { code: channel.code(), reserved: 0, unit_per_count };
    }
    headers
}

/// The refusal of a row that the plan does not have: a caller's mistake, but no reason to stop a line.
pub(crate) fn no_such_row(plan: &Plan, row: u32) -> Refusal {
    Refusal {
        file: "plan".to_owned(),
        line: 0,
        reason: format!("row {row} does not exist; the plan has {} rows", plan.taps().len()),
    }
}

/// The serial `text`, which `key` states.
pub(crate) fn serial_of(key: &str, text: &str) -> Result<Serial, Error> {
    Serial::new(text).map_err(|error| Error::setting(key, format!("{text:?}"), error.bound()))
}

/// A name for a casing whose serial could not be read at `now_ns`; never `last`.
pub(crate) fn unknown_name(station: u16, now_ns: i64, last: &str) -> String {
    let mut second = now_ns.div_euclid(1_000_000_000);
    loop {
        let name = format!("unknown-{station}-{}", utc(second));
        // Names stay different if two casings come within a second, or if the clock is set back.
        if name.as_str() > last || name.len() != last.len() {
            return name;
        }
        second += 1;
    }
}

/// A time of day in UTC, from seconds since the Unix epoch: `20261123T064628Z`.
fn utc(second: i64) -> String {
    let time = jiff::Timestamp::from_second(second).unwrap_or(jiff::Timestamp::UNIX_EPOCH);
    time.strftime("%Y%m%dT%H%M%SZ").to_string()
}
