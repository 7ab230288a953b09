//! Where the parts of an archive are in its file.

use std::ops::Range;

/// The range of bytes of a table in an archive's `file`.
pub(crate) fn table_bytes(file: &hdf5::File, name: &str) -> Range<usize> {
    let table = file.dataset(name).unwrap();
    let start = table.offset().unwrap() as usize;
    start..start + table.storage_size() as usize
}

/// The range of bytes of each chunk of samples.
pub(crate) fn chunk_bytes(file: &hdf5::File) -> Vec<Range<usize>> {
    let samples = file.dataset("taps/samples").unwrap();
    let chunks = (0..samples.num_chunks().unwrap()).map(|k| samples.chunk_info(k).unwrap());
    chunks.map(|chunk| chunk.addr as usize..(chunk.addr + chunk.size) as usize).collect()
}
