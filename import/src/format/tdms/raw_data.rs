//! The samples of a TDMS channel, wherever they lie in the chunks of its segments.

use std::fs::File;
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};

use crate::error::Fault;
use crate::format::tdms::segments::Segment;

/// Bytes that are read at once.
const BLOCK_BYTES: usize = 1 << 20;

/// All samples of the object at `place`, `count` numbers of `N` bytes, in the order of the segments.
pub(super) fn samples<const N: usize, T>(
    file: &mut BufReader<File>,
    segments: &[Segment],
    place: usize,
    count: usize,
    number: impl Fn([u8; N]) -> T,
) -> Result<Vec<T>, Fault> {
    let mut samples = Vec::with_capacity(count);
    let mut block = Vec::new();
    for segment in segments {
        let mut before = 0;
        let Some(&piece) = segment.pieces.iter().find(|piece| {
            let is_it = piece.object == place;
            if !is_it {
                before += if segment.is_interleaved { piece.bytes / piece.count.max(1) } else { piece.bytes };
            }
            is_it
        }) else {
            continue;
        };
        // Samples of all channels lie side by side, or those of each channel one after the other.
        let stride = match segment.is_interleaved {
            true => segment.pieces.iter().map(|piece| piece.bytes / piece.count.max(1)).sum(),
            false => N as u64,
        };
        let stride = usize::try_from(stride).unwrap_or(usize::MAX).max(N);
        for chunk in 0..segment.chunk_count {
            file.seek(SeekFrom::Start(segment.at + chunk * segment.chunk_bytes + before))?;
            let mut left = usize::try_from(piece.count).unwrap_or(usize::MAX);
            while left > 0 {
                let now = left.min((BLOCK_BYTES / stride).max(1));
                // Behind the last sample there may be nothing.
                block.resize((now - 1) * stride + N, 0);
                file.read_exact(&mut block)?;
                if now < left {
                    file.seek_relative((stride - N) as i64)?;
                }
                for sample in block.chunks(stride) {
                    let Some(&bytes) = sample.first_chunk::<N>() else { continue };
                    let mut bytes: [u8; N] = bytes;
                    if segment.is_big_endian {
                        bytes.reverse();
                    }
                    samples.push(number(bytes));
                }
                left -= now;
            }
        }
    }
    Ok(samples)
}
