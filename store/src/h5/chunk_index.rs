//! The index of a dataset's chunks, read from the file itself.
//!
//! Debian 12 has HDF5 1.10.8, whose only way to a chunk's address searches the whole index for each chunk; `H5Dchunk_iter`,
//! which would list all of them, came with HDF5 1.14. The index is also read here before the library sees an unfinished file,
//! because the library trusts what it reads.
//!
//! Only what tapline writes is understood: object headers of version 1, data layouts of version 3, B-trees of version 1, and
//! addresses of eight bytes (HDF5 File Format Specification, III.A.1, IV.A.1.a, IV.A.2.i). For anything else the functions
//! return `None`.

use std::fs::File;
use std::os::unix::fs::FileExt as _;

use crate::h5::extent::Extent;

/// A file's signature, the versions of its superblock, and the sizes of addresses and lengths.
const SUPERBLOCK: [u8; 16] = *b"\x89HDF\r\n\x1a\n\0\0\0\0\0\x08\x08\0";

/// Types of messages in an object header.
const LAYOUT: u16 = 8;
const CONTINUATION: u16 = 16;

/// Limits that no archive reaches: blocks of messages in an object header, and levels of a tree.
const BLOCKS_MAX: usize = 64;
const LEVELS_MAX: u8 = 16;

/// A chunk: its location, and a mask of the filters that it did not go through.
pub(crate) type Chunk = (Extent, u32);

/// The index of a dataset's chunks.
#[derive(Debug, PartialEq)]
pub(crate) struct Index {
    /// The chunk of each row; `None` if it was never written.
    pub chunks: Vec<Option<Chunk>>,
    /// Addresses of its nodes.
    pub nodes: Vec<u64>,
}

/// The index of a dataset whose object header is at `header` of `file`, and which has `rank` dimensions and at most one chunk for each
/// of `row_count` rows. `None` if it is of an unknown kind.
pub(crate) fn index(file: &File, header: u64, row_count: usize, rank: usize) -> Option<Index> {
    if read(file, 0, SUPERBLOCK.len())? != SUPERBLOCK || u64_at(&read(file, 24, 8)?, 0)? != 0 {
        return None;
    }
    let nodes_left = 2 * row_count + BLOCKS_MAX;
    let mut walk = Walk { file, rank, chunks: vec![None; row_count], nodes: Vec::new(), nodes_left };
    let tree = tree_of(file, header, rank)?;
    // Before the first chunk is written there is no tree.
    if tree != u64::MAX {
        walk.node(tree, LEVELS_MAX)?;
    }
    Some(Index { chunks: walk.chunks, nodes: walk.nodes })
}

/// The bytes of the node at `address`, with zeros for what changes as chunks are written: the lengths of chunks, which nodes
/// above repeat, and their addresses.
pub(crate) fn node_with_changes_left_out(file: &File, address: u64, rank: usize) -> Option<Vec<u8>> {
    let head = read(file, address, NODE_HEAD_BYTES)?;
    let (is_leaf, entry_count) = (head[5] == 0, u16_at(&head, 6)? as usize);
    let (key_bytes, entry_bytes) = (key_bytes(rank), key_bytes(rank) + 8);
    let mut node = read(file, address, NODE_HEAD_BYTES + entry_count * entry_bytes + key_bytes)?;
    // The last entry is only a key.
    for entry in node[NODE_HEAD_BYTES..].chunks_mut(entry_bytes) {
        entry[..4].fill(0);
        if is_leaf {
            entry[key_bytes..].fill(0);
        }
    }
    Some(node)
}

/// Bytes of a node before its entries.
const NODE_HEAD_BYTES: usize = 24;

/// Bytes of a key: a chunk's length, its filter mask, and its offset in every dimension and in the element.
fn key_bytes(rank: usize) -> usize {
    8 + 8 * (rank + 1)
}

/// Address of the tree of chunks, from the object header at `header`.
fn tree_of(file: &File, header: u64, rank: usize) -> Option<u64> {
    let prefix = read(file, header, 16)?;
    if prefix[0] != 1 {
        return None;
    }
    let mut blocks = vec![(header + 16, u32_at(&prefix, 8)? as usize)];
    let mut done = 0;
    while let Some(&(address, length)) = blocks.get(done).filter(|_| done < BLOCKS_MAX) {
        let block = read(file, address, length)?;
        let mut at = 0;
        while at + 8 <= block.len() {
            let (kind, size) = (u16_at(&block, at)?, u16_at(&block, at + 2)? as usize);
            let message = block.get(at + 8..at + 8 + size)?;
            match kind {
                // Version 3, chunked; one more dimension holds the size of an element.
                LAYOUT if message.get(..3)? == [3, 2, u8::try_from(rank + 1).ok()?] => return u64_at(message, 3),
                LAYOUT => return None,
                CONTINUATION => blocks.push((u64_at(message, 0)?, usize::try_from(u64_at(message, 8)?).ok()?)),
                _ => {}
            }
            at += 8 + size;
        }
        done += 1;
    }
    None
}

struct Walk<'a> {
    file: &'a File,
    rank: usize,
    chunks: Vec<Option<Chunk>>,
    nodes: Vec<u64>,
    nodes_left: usize,
}

impl Walk<'_> {
    /// Collects the chunks below the node at `address`, whose level must be below `above`.
    fn node(&mut self, address: u64, above: u8) -> Option<()> {
        self.nodes_left = self.nodes_left.checked_sub(1)?;
        let head = read(self.file, address, NODE_HEAD_BYTES)?;
        let (level, entry_count) = (head[5], u16_at(&head, 6)? as usize);
        if head[..5] != *b"TREE\x01" || level >= above {
            return None;
        }
        let key_bytes = key_bytes(self.rank);
        let entries = read(self.file, address.checked_add(24)?, entry_count * (key_bytes + 8))?;
        self.nodes.push(address);
        for entry in entries.chunks_exact(key_bytes + 8) {
            let child = u64_at(entry, key_bytes)?;
            if level > 0 {
                self.node(child, level)?;
                continue;
            }
            let (bytes, mask, row) = (u32_at(entry, 0)?.into(), u32_at(entry, 4)?, u64_at(entry, 8)?);
            let chunk = self.chunks.get_mut(usize::try_from(row).ok()?)?;
            if chunk.replace((Extent { begin: child, bytes }, mask)).is_some() {
                return None;
            }
        }
        Some(())
    }
}

/// `length` bytes at `address`; `None` if the file is too short.
fn read(file: &File, address: u64, length: usize) -> Option<Vec<u8>> {
    // A damaged length must not allocate more memory than the file has bytes.
    if length as u64 > file.metadata().ok()?.len() {
        return None;
    }
    let mut bytes = vec![0; length];
    file.read_exact_at(&mut bytes, address).ok()?;
    Some(bytes)
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

#[cfg(test)]
mod tests {
    use std::fs::OpenOptions;

    use hdf5::filters::BloscShuffle;
    use tapline_codec::Codec;

    use super::*;
    use crate::h5::samples::ChunkRows;

    const ROW: [usize; 2] = [2, 16];

    /// A file with a dataset of `row_count` chunks, written in a mixed order.
    fn dataset(path: &std::path::Path, codec: Codec, row_count: usize) -> hdf5::Dataset {
        let file = hdf5::File::create(path).unwrap();
        let builder = file.new_dataset::<i16>().shape((row_count, ROW[0], ROW[1])).chunk((1, ROW[0], ROW[1]));
        let dataset = match codec {
            Codec::Lz4 => builder.blosc_lz4(5, BloscShuffle::Bit).create("rows").unwrap(),
            Codec::Gzip => builder.shuffle().deflate(4).create("rows").unwrap(),
            _ => builder.create("rows").unwrap(),
        };
        for k in 0..row_count {
            let row = k * 7919 % row_count;
            let samples = ndarray::Array2::from_shape_fn(ROW, |(a, b)| (row * 37 + a * 11 + b * b) as i16);
            dataset.write_slice(&samples, ndarray::s![row, .., ..]).unwrap();
        }
        file.flush().unwrap();
        dataset
    }

    /// Catches a chunk that is not where the library finds it, in trees of one level and of several.
    #[test]
    fn chunks_are_where_the_library_says() {
        let folder = tempfile::tempdir().unwrap();
        for codec in [Codec::None, Codec::Lz4, Codec::Gzip] {
            for row_count in [1, 63, 65, 3001] {
                let path = folder.path().join(format!("{codec}-{row_count}.h5"));
                let dataset = dataset(&path, codec, row_count);
                let rows = ChunkRows::new(dataset.clone(), codec, 64).unwrap();
                let locations = rows.locations(&File::open(&path).unwrap()).unwrap();
                let mut known: Vec<Option<Extent>> = vec![None; row_count];
                for number in 0..row_count {
                    let chunk = dataset.chunk_info(number).unwrap();
                    // Blosc gains nothing on so few samples, so the library skips it for some chunks.
                    assert!(chunk.filter_mask == 0 || codec == Codec::Lz4);
                    let location = Extent { begin: chunk.addr, bytes: chunk.size };
                    known[usize::try_from(chunk.offset[0]).unwrap()] =
                        Some(location).filter(|_| chunk.filter_mask == 0);
                }
                assert_eq!(locations, known, "{codec}, {row_count} rows");
            }
        }
    }

    /// Catches a damaged index that ends in a panic, an endless loop or unbounded memory, and a row that is found where there is none.
    #[test]
    fn a_damaged_index_is_not_known() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.h5");
        let rows = ChunkRows::new(dataset(&path, Codec::None, 300), Codec::None, 64).unwrap();
        let header = rows.header_address().unwrap();
        drop(rows);
        let file = OpenOptions::new().read(true).write(true).open(&path).unwrap();
        let bytes = file.metadata().unwrap().len();
        let intact = index(&file, header, 300, 3).unwrap();
        let mut damaged = 0;
        for at in 0..bytes {
            for byte in [0xff, 0] {
                let before = read(&file, at, 1).unwrap();
                file.write_all_at(&[byte], at).unwrap();
                damaged += usize::from(index(&file, header, 300, 3).is_none_or(|found| found != intact));
                file.write_all_at(&before, at).unwrap();
            }
        }
        assert!(damaged > 1000, "{damaged}");
        assert_eq!(index(&file, header, 301, 3).unwrap().chunks[300], None, "a row has no chunk");
        assert_eq!(index(&file, header, 299, 3), None, "a row is beyond");
        assert_eq!(index(&file, header, 300, 2), None);
        assert_eq!(index(&file, bytes, 300, 3), None);
    }
}
