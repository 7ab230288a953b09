//! Samples of taps as chunks of their dataset, written without a copy and found without the library.
#![expect(unsafe_code, reason = "the safe crate has no direct access to chunks")]

use std::fs::File;

use hdf5::{Dataset, Error, sync::sync};
use hdf5_sys::h5::hsize_t;
use hdf5_sys::h5d::H5Dwrite_chunk;
use hdf5_sys::h5o::{H5O_INFO_BASIC, H5O_info1_t, H5Oget_info2};
use hdf5_sys::h5p::H5P_DEFAULT;
use tapline_codec::Codec;

use crate::h5::chunk_index::{Chunk, index};
use crate::h5::extent::Extent;

/// Rows of a `[row, channel, sample]` dataset whose chunks are one row each.
#[derive(Debug, Clone)]
pub(crate) struct ChunkRows {
    dataset: Dataset,
    codec: Codec,
    row_bytes: usize,
}

impl ChunkRows {
    /// The rows of `dataset`, of `row_bytes` bytes each, packed with `codec`; `None` if it has another layout.
    pub(crate) fn new(dataset: Dataset, codec: Codec, row_bytes: usize) -> Option<Self> {
        let &[_, channels, samples] = dataset.shape().as_slice() else { return None };
        let element_bytes = dataset.dtype().ok()?.size();
        let is_known = dataset.chunk()? == [1, channels, samples]
            && dataset.filters().is_empty() == (codec == Codec::None)
            && channels.checked_mul(samples).and_then(|n| n.checked_mul(element_bytes)) == Some(row_bytes);
        is_known.then_some(Self { dataset, codec, row_bytes })
    }

    /// The dataset.
    pub(crate) fn dataset(&self) -> &Dataset {
        &self.dataset
    }

    /// The codec.
    pub(crate) fn codec(&self) -> Codec {
        self.codec
    }

    /// Bytes of an unpacked row.
    pub(crate) fn row_bytes(&self) -> usize {
        self.row_bytes
    }

    /// Writes `stored`, packed with the codec, as row `row`, without a copy.
    ///
    /// # Errors
    /// What the library returns, for example if `row` does not exist or the disk is full.
    pub(crate) fn write(&self, row: u32, stored: &[u8]) -> hdf5::Result<()> {
        let offset: [hsize_t; 3] = [row.into(), 0, 0];
        sync(|| {
            // SAFETY: the lock of the library is held; the dataset's identifier is valid while `self.dataset` lives;
            // `offset` has one entry for each of the three dimensions checked in `new`; `stored` is readable for its
            // length during the call, which keeps no pointer.
            let status = unsafe {
                H5Dwrite_chunk(self.dataset.id(), H5P_DEFAULT, 0, offset.as_ptr(), stored.len(), stored.as_ptr().cast())
            };
            if status < 0 { Err(Error::query()?) } else { Ok(()) }
        })
    }

    /// The location of every row in `file`, which nobody may write meanwhile; `None` for a row that was never written, or by another
    /// filter.
    ///
    /// # Errors
    /// If the index cannot be read.
    pub(crate) fn locations(&self, file: &File) -> hdf5::Result<Vec<Option<Extent>>> {
        let index = self.header_address().and_then(|header| index(file, header, self.row_count(), self.dataset.ndim()));
        let chunks = index.ok_or("the index of the samples cannot be read")?.chunks;
        // The library skips a filter that gains nothing, and notes that in the mask.
        let known = |(location, mask): Chunk| Some(location).filter(|_| mask == 0);
        Ok(chunks.into_iter().map(|chunk| chunk.and_then(known)).collect())
    }

    /// Number of rows.
    pub(crate) fn row_count(&self) -> usize {
        self.dataset.shape().first().copied().unwrap_or(0)
    }

    /// Address of the dataset's object header; `None` if the library does not find it.
    pub(crate) fn header_address(&self) -> Option<u64> {
        let mut info = H5O_info1_t::default();
        // SAFETY: the lock of the library is held; the dataset's identifier is valid while `self.dataset` lives; the library
        // fills the structure that it declares.
        let status = sync(|| unsafe { H5Oget_info2(self.dataset.id(), &raw mut info, H5O_INFO_BASIC) });
        (status >= 0).then_some(info.addr)
    }
}

/// `samples` of `channel_count` channels as a row of `row_bytes`: the samples themselves if they fill it, else a copy in
/// `scratch` in which zeros follow each channel.
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

/// The inverse of [`padded`]: moves the first `sample_bytes` of each of `channel_count` channels to the front of `row`.
pub(crate) fn unpadded(row: &mut [u8], channel_count: usize, sample_bytes: usize) {
    let stride = row.len() / channel_count;
    if sample_bytes < stride {
        for channel in 1..channel_count {
            row.copy_within(channel * stride..channel * stride + sample_bytes, channel * sample_bytes);
        }
    }
}
