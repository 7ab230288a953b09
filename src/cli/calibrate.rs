//! Arguments of `tapline calibrate`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use jiff::civil::Date;
use tapline_wire::Channel;

use crate::cli::one_of;

/// How a channel is calibrated.
#[derive(Debug, Subcommand)]
pub(crate) enum CalibrateVerb {
    /// Force, by blows on a sensor that reports their peak.
    Blows {
        /// Peaks that the other sensor reported, N: one for all blows, or one for each, separated by commas.
        #[arg(long, value_delimiter = ',', required = true, allow_negative_numbers = true)]
        known_n: Vec<f64>,
        /// Number of blows, if one peak is given for all.
        #[arg(long, default_value_t = 10)]
        count: usize,
        #[command(flatten)]
        heard: HeardArgs,
        #[command(flatten)]
        written: CalibrationFileArgs,
    },
    /// Sound, by the tone of an acoustic calibrator.
    Tone {
        /// Sound pressure of the tone, Pa (root of the mean square): 1.0024 is 94 dB.
        #[arg(long, allow_negative_numbers = true)]
        known_pa: f64,
        /// Its frequency, Hz; it is looked for within 2 %.
        #[arg(long, default_value_t = 1000.0)]
        frequency_hz: f64,
        /// How long to listen, s.
        #[arg(long, default_value_t = 2.0)]
        listen_s: f64,
        #[command(flatten)]
        heard: HeardArgs,
        #[command(flatten)]
        written: CalibrationFileArgs,
    },
    /// Either channel, by data sheets: sensitivity of the sensor, gain, and voltage of a full-scale sample.
    State {
        /// The channel: the impactor's force, or the microphone's sound.
        #[arg(long, value_parser = one_of::<Channel>(&["force", "sound"]))]
        channel: Channel,
        /// Voltage of a full-scale sample at the input of the sound card or converter.
        #[arg(long, allow_negative_numbers = true)]
        full_scale_v: f64,
        /// Sensitivity of the sensor, mV/N or mV/Pa. A sound without it is in volts.
        #[arg(long, allow_negative_numbers = true)]
        sensitivity_mv: Option<f64>,
        /// Gain between sensor and input.
        #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
        gain: f64,
        /// Day of the data sheet or of the sensor's calibration, as 2026-11-24; today if left out.
        #[arg(long)]
        date: Option<Date>,
        #[command(flatten)]
        written: CalibrationFileArgs,
    },
}

/// What is listened to.
#[derive(Debug, Args)]
pub(crate) struct HeardArgs {
    /// The configuration with the station.
    #[arg(long)]
    pub config: PathBuf,
    /// Number of the station, where several listen.
    #[arg(long)]
    pub station: Option<u16>,
    /// How long to wait for the blows or the tone, s.
    #[arg(long, default_value_t = 60.0)]
    pub patience_s: f64,
}

/// Where the calibration is kept.
#[derive(Debug, Args)]
pub(crate) struct CalibrationFileArgs {
    /// The calibration file of the station; its other channel stays as it is.
    #[arg(long)]
    pub out: PathBuf,
    /// For how many days it is valid.
    #[arg(long, default_value_t = 365, allow_negative_numbers = true)]
    pub valid_days: u16,
    /// What else an audit asks for, as serial numbers of sensor and standard, certificates, and who has done it.
    #[arg(long)]
    pub note: Option<String>,
    /// Replace this channel's calibration in the file.
    #[arg(long)]
    pub force: bool,
    /// Print the calibration as JSON.
    #[arg(long)]
    pub json: bool,
}
