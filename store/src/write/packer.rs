//! Prepares records for the file: hashes, pads and packs them in several threads, outside the lock of the HDF5 library.
//!
//! All writers of the process share the threads and the buffers.

use std::num::NonZeroUsize;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread;

use rayon::{ThreadPool, ThreadPoolBuilder};
use tapline_codec::chunk_checksum;
use tapline_codec::{Codec, pack as pack_by_codec};

use crate::archive::Archive;
use crate::format::lineage::{Digest, digest_of};
use crate::h5::samples::padded;

/// Maximum number of buffers kept between calls: those of a flush at full speed.
const KEPT_MAX: usize = 1024;

/// Bytes from which several threads pack records: waking them, and their search for more work, takes as much processor
/// time as packing half of that with LZ4.
const HELPED_BYTES: usize = 512 * 1024;

/// One record, packed.
#[derive(Debug, Default)]
pub(crate) struct Packed {
    bytes: Vec<u8>,
    padded: Vec<u8>,
    planes: Vec<u8>,
    /// Whether the record is written as it was given.
    is_as_given: bool,
    pub(crate) samples_digest: Digest,
    pub(crate) stored_checksum: u64,
}

impl Packed {
    /// The bytes to be written; `samples` are those that were packed.
    pub(crate) fn stored<'a>(&'a self, samples: &'a [u8]) -> &'a [u8] {
        if self.is_as_given { samples } else { &self.bytes }
    }

    /// The bytes to be written, for the caller to keep; [`recycle`] takes the buffer back.
    pub(crate) fn take_bytes(&mut self, samples: &[u8]) -> Vec<u8> {
        let mut buffer = lock(&CHUNK_BUFFERS).pop().unwrap_or_default();
        if self.is_as_given {
            buffer.clear();
            buffer.extend_from_slice(samples);
            return buffer;
        }
        std::mem::replace(&mut self.bytes, buffer)
    }
}

/// The shape of the records of an archive, and its codec.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shape {
    pub codec: Codec,
    pub channel_count: usize,
    /// Bytes of one sample of one channel.
    pub element_bytes: usize,
    /// Bytes of a row, which is the longest record.
    pub row_bytes: usize,
}

/// Buffers of records that are not in use.
static BUFFERS: Mutex<Vec<Packed>> = Mutex::new(Vec::new());

/// Buffers of packed chunks that are not in use: allocating one costs as much as the copy into it.
static CHUNK_BUFFERS: Mutex<Vec<Vec<u8>>> = Mutex::new(Vec::new());

fn lock<T>(kept: &Mutex<Vec<T>>) -> MutexGuard<'_, Vec<T>> {
    kept.lock().unwrap_or_else(PoisonError::into_inner)
}

fn keep<T>(kept: &Mutex<Vec<T>>, more: impl IntoIterator<Item = T>) {
    let mut kept = lock(kept);
    let left = KEPT_MAX.saturating_sub(kept.len());
    kept.extend(more.into_iter().take(left));
}

/// Takes back buffers of [`Packed::take_bytes`].
pub(crate) fn recycle(samples: impl IntoIterator<Item = Vec<u8>>) {
    keep(&CHUNK_BUFFERS, samples);
}

/// Packed records; their buffers are kept for later calls when this is dropped.
#[derive(Debug)]
pub(crate) struct PackBuffers(pub(crate) Vec<Packed>);

impl Drop for PackBuffers {
    fn drop(&mut self) {
        keep(&BUFFERS, self.0.drain(..));
    }
}

/// The threads that pack besides the caller; `None` if there are none.
fn helpers() -> Option<&'static ThreadPool> {
    static HELPERS: OnceLock<Option<ThreadPool>> = OnceLock::new();
    HELPERS.get_or_init(|| begin(thread::available_parallelism().map_or(1, NonZeroUsize::get) - 1)).as_ref()
}

/// Packs `records`, the samples of one tap each; many on as many threads as there are cores. Calls `take` with the number of each
/// and the packed record, in their order, while later ones are being packed; returns all of them. The bytes of a record do not
/// depend on the number of threads or of records.
///
/// # Errors
/// The first error of `take`, which is then not called again.
///
/// # Panics
/// If packing panics, which is a bug.
pub(crate) fn pack<E>(
    records: &[(Shape, &[u8])],
    take: impl FnMut(usize, &Packed) -> Result<(), E>,
) -> Result<PackBuffers, E> {
    // Zstandard and Deflate take at least ten times as long for the same bytes.
    let is_slow = |codec| matches!(codec, Codec::Zstd | Codec::Gzip);
    let work = |&(shape, samples): &(Shape, &[u8])| samples.len() * if is_slow(shape.codec) { 10 } else { 1 };
    let is_much = records.len() > 1 && records.iter().map(work).sum::<usize>() >= HELPED_BYTES;
    pack_on(if is_much { helpers() } else { None }, records, take)
}

fn pack_on<E>(
    helpers: Option<&ThreadPool>,
    records: &[(Shape, &[u8])],
    mut take: impl FnMut(usize, &Packed) -> Result<(), E>,
) -> Result<PackBuffers, E> {
    // `None` where packing has panicked.
    let slots: Vec<OnceLock<Option<Packed>>> = records.iter().map(|_| OnceLock::new()).collect();
    let next = AtomicUsize::new(0);
    // Packs the record that is next; false if none is left.
    let pack_one = || {
        let number = next.fetch_add(1, Ordering::Relaxed);
        let Some((shape, samples)) = records.get(number) else { return false };
        let mut buffer = lock(&BUFFERS).pop().unwrap_or_default();
        let outcome = catch_unwind(AssertUnwindSafe(|| shape.pack(samples, &mut buffer)));
        drop(slots[number].set(outcome.is_ok().then_some(buffer)));
        outcome.map(|()| true).unwrap_or_else(|panic| resume_unwind(panic))
    };
    let mut here = || {
        for (number, slot) in slots.iter().enumerate() {
            // Until it is ready this thread packs too, and waits when none is left.
            while slot.get().is_none() && pack_one() {}
            // If a thread has panicked, the scope passes that on.
            let Some(packed) = slot.wait() else { break };
            take(number, packed)?;
        }
        Ok(())
    };
    match helpers {
        None => here()?,
        Some(helpers) => helpers.in_place_scope(|scope| {
            for _ in 1..records.len().min(helpers.current_num_threads() + 1) {
                scope.spawn(|_| while pack_one() {});
            }
            // After an error the other records are not needed.
            here().inspect_err(|_| next.store(records.len(), Ordering::Relaxed))
        })?,
    }
    Ok(PackBuffers(slots.into_iter().filter_map(|slot| slot.into_inner().flatten()).collect()))
}

fn begin(thread_count: usize) -> Option<ThreadPool> {
    if thread_count == 0 {
        return None;
    }
    let pool = ThreadPoolBuilder::new().num_threads(thread_count).thread_name(|number| format!("pack-{number}"));
    pool.build().inspect_err(|error| tracing::warn!(%error, "only one thread packs, which is slower")).ok()
}

impl Shape {
    /// That of the records of `archive`.
    pub(crate) fn of(archive: &Archive) -> Self {
        let recording = &archive.plan.recording;
        Self {
            codec: archive.samples.codec(),
            channel_count: recording.channels.len(),
            element_bytes: recording.sample_format.bytes(),
            row_bytes: archive.samples.row_bytes(),
        }
    }

    fn pack(&self, samples: &[u8], buffer: &mut Packed) {
        buffer.samples_digest = digest_of(samples);
        let padded = padded(samples, self.channel_count, self.row_bytes, &mut buffer.padded);
        buffer.is_as_given = self.codec == Codec::None && padded.len() == samples.len();
        if !buffer.is_as_given {
            pack_by_codec(self.codec, self.element_bytes, padded, &mut buffer.planes, &mut buffer.bytes);
        }
        buffer.stored_checksum = chunk_checksum(self.codec, buffer.stored(samples));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches records in another order, packed to other bytes than alone, left out or taken after an error, and a call that
    /// fails because the one before did; with helpers and without.
    #[test]
    fn records_are_taken_in_their_order() {
        let shape = Shape { codec: Codec::Lz4, channel_count: 2, element_bytes: 2, row_bytes: 4000 };
        // Some of them shorter than a row.
        let samples: Vec<Vec<u8>> = (0..40_u32)
            .map(|tap| (0..4000 - 40 * (tap % 3)).map(|k| (k.wrapping_mul(tap + 7) >> 3) as u8).collect())
            .collect();
        let records: Vec<(Shape, &[u8])> = samples.iter().map(|samples| (shape, samples.as_slice())).collect();
        let alone = |samples: &[u8]| {
            let mut buffer = Packed::default();
            shape.pack(samples, &mut buffer);
            (buffer.stored(samples).to_vec(), buffer.samples_digest, buffer.stored_checksum)
        };
        let of = |buffer: &Packed| (buffer.stored(&[]).to_vec(), buffer.samples_digest, buffer.stored_checksum);
        for thread_count in [1, 2, 5] {
            let helpers = begin(thread_count - 1);
            for (record_count, bad) in [(40, 40), (40, 11), (1, 1), (0, 0), (7, 0), (40, 39), (40, 40)] {
                let mut taken = Vec::new();
                let packed = pack_on(helpers.as_ref(), &records[..record_count], |number, buffer| {
                    if number == bad {
                        return Err("enough");
                    }
                    assert_eq!(number, taken.len(), "another order");
                    taken.push(of(buffer));
                    Ok(())
                });
                assert_eq!(packed.is_err(), bad < record_count);
                if let Ok(all) = packed {
                    assert!(all.0.iter().map(of).eq(taken.iter().cloned()));
                }
                assert_eq!(taken.len(), bad);
                assert!(taken.into_iter().eq(records[..bad].iter().map(|(_, samples)| alone(samples))));
            }
        }
    }
}
