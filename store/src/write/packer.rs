//! Records made ready for the file, several at a time: digested, padded, packed, all outside the lock of the HDF5 library.
//!
//! The threads that do it, and the memory, are those of the process: there may be many writers, and one packs at a time.

use std::num::NonZeroUsize;
use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread;

use crossbeam::channel::bounded;
use rayon::{ThreadPool, ThreadPoolBuilder};
use tapline_codec::chunk_checksum;
use tapline_codec::{Codec, pack as pack_by_codec};

use crate::format::lineage::{Digest, digest_of};
use crate::h5::samples::padded;

/// Records, and packed samples, for which memory is kept from call to call.
const KEPT_MAX: usize = 128;

/// One record, ready to be written.
#[derive(Debug, Default)]
pub(crate) struct Packed {
    bytes: Vec<u8>,
    padded: Vec<u8>,
    planes: Vec<u8>,
    /// Whether the record goes to the file from where it lies.
    is_as_given: bool,
    pub(crate) samples_digest: Digest,
    pub(crate) stored_checksum: u64,
}

impl Packed {
    /// What goes to the file; `samples` are those that were packed.
    pub(crate) fn stored<'a>(&'a self, samples: &'a [u8]) -> &'a [u8] {
        if self.is_as_given { samples } else { &self.bytes }
    }

    /// The same, to be kept; [`give_back`] takes it when it is no longer needed.
    pub(crate) fn give(&mut self, samples: &[u8]) -> Vec<u8> {
        let mut room = lock(&ROOMS).pop().unwrap_or_default();
        if self.is_as_given {
            room.clear();
            room.extend_from_slice(samples);
            return room;
        }
        std::mem::replace(&mut self.bytes, room)
    }
}

/// The shape of what is packed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shape {
    pub codec: Codec,
    pub channel_count: usize,
    /// Bytes of one sample of one channel.
    pub element_bytes: usize,
    /// Bytes of the longest record there may be, which is a row of the file.
    pub row_bytes: usize,
}

/// Memory of records that are not being packed.
static BUFFERS: Mutex<Vec<Packed>> = Mutex::new(Vec::new());

/// Memory of packed samples: new memory costs as much as the copy into it.
static ROOMS: Mutex<Vec<Vec<u8>>> = Mutex::new(Vec::new());

fn lock<T>(kept: &Mutex<Vec<T>>) -> MutexGuard<'_, Vec<T>> {
    kept.lock().unwrap_or_else(PoisonError::into_inner)
}

fn keep<T>(kept: &Mutex<Vec<T>>, more: impl IntoIterator<Item = T>) {
    let mut kept = lock(kept);
    let left = KEPT_MAX.saturating_sub(kept.len());
    kept.extend(more.into_iter().take(left));
}

/// Takes back the memory of packed samples that were [given](Packed::give).
pub(crate) fn give_back(samples: impl IntoIterator<Item = Vec<u8>>) {
    keep(&ROOMS, samples);
}

/// Packed records; their memory is given back when this is dropped.
#[derive(Debug, Default)]
pub(crate) struct PackBuffers(Vec<Packed>);

impl PackBuffers {
    fn take(count: usize) -> Self {
        let mut buffers = lock(&BUFFERS);
        let left = buffers.len().saturating_sub(count);
        let mut taken = buffers.split_off(left);
        taken.resize_with(count, Packed::default);
        Self(taken)
    }
}

impl Drop for PackBuffers {
    fn drop(&mut self) {
        keep(&BUFFERS, self.0.drain(..));
    }
}

impl Deref for PackBuffers {
    type Target = [Packed];

    fn deref(&self) -> &[Packed] {
        &self.0
    }
}

impl DerefMut for PackBuffers {
    fn deref_mut(&mut self) -> &mut [Packed] {
        &mut self.0
    }
}

/// The threads beside whoever calls, once there is more than one record to pack; `None` where there are none, which is slower.
fn helpers() -> Option<&'static ThreadPool> {
    static HELPERS: OnceLock<Option<ThreadPool>> = OnceLock::new();
    HELPERS.get_or_init(|| begin(thread::available_parallelism().map_or(1, NonZeroUsize::get) - 1)).as_ref()
}

/// Packs `records`, the samples of one tap each, on as many threads as there are cores, and has each, in their order, taken by
/// `take`, which gets its number, while later ones are being packed; returns all of them. What comes of a record does not
/// depend on how many there are.
///
/// # Errors
/// The first that `take` returns; no more are taken then.
///
/// # Panics
/// If packing does: a bug.
pub(crate) fn pack<E>(
    records: &[(Shape, &[u8])],
    take: impl FnMut(usize, &Packed) -> Result<(), E>,
) -> Result<PackBuffers, E> {
    pack_on(if records.len() > 1 { helpers() } else { None }, records, take)
}

fn pack_on<E>(
    helpers: Option<&ThreadPool>,
    records: &[(Shape, &[u8])],
    mut take: impl FnMut(usize, &Packed) -> Result<(), E>,
) -> Result<PackBuffers, E> {
    let mut all = PackBuffers::take(records.len());
    let buffers = &mut all[..];
    let helper_count = helpers.map_or(0, ThreadPool::current_num_threads).min(records.len().saturating_sub(1));
    {
        let (give, jobs) = bounded(records.len());
        for job in buffers.iter_mut().zip(records).enumerate() {
            drop(give.send(job)); // room for all
        }
        drop(give);
        let (done, ready) = bounded(records.len());
        let mut here = || {
            let mut packed: Vec<Option<&Packed>> = vec![None; records.len()];
            for number in 0..records.len() {
                let this = loop {
                    ready.try_iter().for_each(|(number, buffer)| packed[number] = Some(buffer));
                    if let Some(this) = packed[number] {
                        break this;
                    }
                    // Whoever has nothing to take packs too, and waits when there is no more to pack.
                    if let Ok((number, (buffer, (shape, samples)))) = jobs.try_recv() {
                        shape.pack(samples, buffer);
                        packed[number] = Some(buffer);
                    } else {
                        // Where a thread has panicked, so does the scope.
                        let Ok((number, buffer)) = ready.recv() else { return Ok(()) };
                        packed[number] = Some(buffer);
                    }
                };
                if let Err(error) = take(number, this) {
                    // Nobody waits for the others.
                    jobs.try_iter().for_each(drop);
                    return Err(error);
                }
            }
            Ok(())
        };
        match helpers {
            None => {
                drop(done);
                here()?;
            }
            Some(helpers) => helpers.in_place_scope(|scope| {
                for _ in 0..helper_count {
                    let (jobs, done) = (jobs.clone(), done.clone());
                    scope.spawn(move |_| {
                        for (number, (buffer, (shape, samples))) in jobs {
                            shape.pack(samples, buffer);
                            if done.send((number, &*buffer)).is_err() {
                                return;
                            }
                        }
                    });
                }
                drop(done);
                here()
            })?,
        }
    }
    Ok(all)
}

fn begin(thread_count: usize) -> Option<ThreadPool> {
    if thread_count == 0 {
        return None;
    }
    let pool = ThreadPoolBuilder::new().num_threads(thread_count).thread_name(|number| format!("pack-{number}"));
    pool.build().inspect_err(|error| tracing::warn!(%error, "one thread packs alone, which is slower")).ok()
}

impl Shape {
    fn pack(&self, samples: &[u8], buffer: &mut Packed) {
        buffer.samples_digest = digest_of(samples);
        let padded = padded(samples, self.channel_count, self.row_bytes, &mut buffer.padded);
        buffer.is_as_given = self.codec.blosc().is_none() && padded.len() == samples.len();
        if !buffer.is_as_given {
            pack_by_codec(self.codec, self.element_bytes, padded, &mut buffer.planes, &mut buffer.bytes);
        }
        buffer.stored_checksum = chunk_checksum(self.codec, buffer.stored(samples));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches records taken in another order, packed otherwise than one by one, left out or taken after an error, and a
    /// call that goes wrong because the one before did; with helpers and without.
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
                    assert!(all.iter().map(of).eq(taken.iter().cloned()));
                }
                assert_eq!(taken.len(), bad);
                assert!(taken.into_iter().eq(records[..bad].iter().map(|(_, samples)| alone(samples))));
            }
        }
    }
}
