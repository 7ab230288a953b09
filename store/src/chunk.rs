//! Samples straight from where they lie to the disk: the one place that calls the C library itself.
#![expect(unsafe_code, reason = "the safe crate has no direct chunk write")]

use hdf5::{Dataset, Error, sync::sync};
use hdf5_sys::h5::hsize_t;
use hdf5_sys::h5d::H5Dwrite_chunk;
use hdf5_sys::h5p::H5P_DEFAULT;

/// Rows of a `[row, channel, sample]` dataset whose chunks are one row each.
#[derive(Debug)]
pub(crate) struct ChunkRows {
    dataset: Dataset,
    row_bytes: usize,
}

impl ChunkRows {
    /// The rows of `dataset`, of `row_bytes` bytes each; `None` when it has another layout or filters its chunks.
    pub(crate) fn new(dataset: Dataset, row_bytes: usize) -> Option<Self> {
        let &[_, channels, samples] = dataset.shape().as_slice() else { return None };
        let element_bytes = dataset.dtype().ok()?.size();
        let is_plain = dataset.chunk()? == [1, channels, samples]
            && dataset.filters().is_empty()
            && channels.checked_mul(samples).and_then(|n| n.checked_mul(element_bytes)) == Some(row_bytes);
        is_plain.then_some(Self { dataset, row_bytes })
    }

    /// The dataset, for reading.
    pub(crate) fn dataset(&self) -> &Dataset {
        &self.dataset
    }

    /// Bytes of a row.
    pub(crate) fn row_bytes(&self) -> usize {
        self.row_bytes
    }

    /// Writes `bytes`, in the machine's byte order, as row `row`, without a copy.
    ///
    /// # Errors
    /// What the library says, for one when `row` does not exist or the disk is full.
    ///
    /// # Panics
    /// If `bytes` is not one row long.
    #[expect(clippy::panic_in_result_fn, reason = "a wrong length is a bug of the caller")]
    pub(crate) fn write(&self, row: u32, bytes: &[u8]) -> hdf5::Result<()> {
        assert_eq!(bytes.len(), self.row_bytes, "length of a row of samples");
        let offset: [hsize_t; 3] = [row.into(), 0, 0];
        sync(|| {
            // SAFETY: the lock of the library is held; the dataset's identifier is valid while `self.dataset` lives;
            // `offset` has one entry for each of the three dimensions checked in `new`; `bytes` is readable for
            // `bytes.len()` bytes during the call, which keeps no pointer.
            let status = unsafe {
                H5Dwrite_chunk(self.dataset.id(), H5P_DEFAULT, 0, offset.as_ptr(), bytes.len(), bytes.as_ptr().cast())
            };
            if status < 0 { Err(Error::query()?) } else { Ok(()) }
        })
    }
}

/// `samples` of `channel_count` channels as a row of `row_bytes`: themselves if they fill it, else a copy in `scratch`
/// in which each channel is followed by zeros.
pub(crate) fn padded<'a>(
    samples: &'a [u8],
    channel_count: usize,
    row_bytes: usize,
    scratch: &'a mut Vec<u8>,
) -> &'a [u8] {
    if samples.len() == row_bytes {
        return samples;
    }
    scratch.clear();
    scratch.resize(row_bytes, 0);
    let (from, to) = (samples.len() / channel_count, row_bytes / channel_count);
    for channel in 0..channel_count {
        scratch[channel * to..][..from].copy_from_slice(&samples[channel * from..][..from]);
    }
    scratch
}
