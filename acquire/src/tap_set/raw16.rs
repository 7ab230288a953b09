//! Recordings without a header: 16-bit samples, little-endian, with the channels interleaved.
//!
//! Rate and channels are those of `scan.toml`; the file has nothing to check them against.

use tapline_wire::SampleFormat;

use super::scan_toml::ScanToml;
use super::wav::{SAMPLE_COUNT_MAX, WavFault, WavHeader};

/// Extension of such files.
pub(super) const ENDING: &str = "raw";

/// Bytes of a sample.
const SAMPLE_BYTES: u64 = 2;

/// The header that a file of `file_bytes` bytes would have.
pub(super) fn header(file_bytes: u64, scan: &ScanToml) -> Result<WavHeader, WavFault> {
    let channel_count = scan.channels.len();
    let frame_bytes = SAMPLE_BYTES * channel_count as u64;
    let sample_count = file_bytes / frame_bytes;
    match () {
        () if file_bytes == 0 => Err(WavFault::Empty),
        () if !file_bytes.is_multiple_of(frame_bytes) => Err(WavFault::Ragged { data_bytes: file_bytes, frame_bytes }),
        () if sample_count > SAMPLE_COUNT_MAX => Err(WavFault::TooLong { got: sample_count }),
        () => Ok(WavHeader {
            format: SampleFormat::I16,
            channel_count: channel_count as u16,
            sample_rate_hz: scan.sample_rate_hz.round() as u32,
            sample_count: sample_count as u32,
            data_at: 0,
            data_bytes: file_bytes as usize,
        }),
    }
}
