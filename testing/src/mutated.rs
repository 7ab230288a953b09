//! Damaged files for tests of readers: noise, and valid files with a few changes, which get further.

use proptest::prelude::*;

/// One change to a file. Positions are fractions of its length in 1/65536, so that they fit any length.
#[derive(Debug, Clone)]
enum Edit {
    Replace(u16, u8),
    Insert(u16, Vec<u8>),
    Delete(u16, u16),
    Repeat(u16, u16),
    Cut(u16),
}

/// What may be put in: bytes, and words that mean something to one of the readers.
fn word() -> impl Strategy<Value = Vec<u8>> {
    let known = prop::sample::select(vec![
        "NaN", "inf", "-0", "1e999", "9007199254740993", "4294967296", "-1", "\"", "\"\"", ",", ",,", "\n", "\r\n",
        "..", "/", "\0", "\u{feff}", "true", "[", "]", "[[", "{", "}", "=", "'''", "0x10", "1979-05-27", "ring",
        "data", "fmt ", "\u{1F6DE}", "360", "359.9999",
    ]);
    prop_oneof![
        3 => known.prop_map(|word| word.as_bytes().to_vec()),
        1 => prop::collection::vec(any::<u8>(), 0..9),
        1 => prop::sample::select(vec![0_u32, 1, 0x7fff_ffff, 0xffff_ffff]).prop_map(|n| n.to_le_bytes().to_vec()),
    ]
}

fn edit() -> impl Strategy<Value = Edit> {
    prop_oneof![
        4 => (any::<u16>(), any::<u8>()).prop_map(|(at, byte)| Edit::Replace(at, byte)),
        3 => (any::<u16>(), word()).prop_map(|(at, word)| Edit::Insert(at, word)),
        2 => (any::<u16>(), 0..2000_u16).prop_map(|(at, length)| Edit::Delete(at, length)),
        1 => (any::<u16>(), 0..9000_u16).prop_map(|(at, length)| Edit::Repeat(at, length)),
        1 => any::<u16>().prop_map(Edit::Cut),
    ]
}

fn apply(bytes: &mut Vec<u8>, edit: Edit) {
    let length = bytes.len();
    let place = |part: u16| usize::from(part) * length / 65536;
    let span = |at, part| place(at)..(place(at) + place(part)).min(length);
    match edit {
        Edit::Replace(at, byte) if length > 0 => bytes[place(at)] = byte,
        Edit::Replace(_, byte) => bytes.push(byte),
        Edit::Insert(at, word) => drop(bytes.splice(place(at)..place(at), word)),
        Edit::Delete(at, part) => drop(bytes.drain(span(at, part))),
        Edit::Repeat(at, part) => {
            let again = bytes[span(at, part)].to_vec();
            drop(bytes.splice(place(at)..place(at), again));
        }
        Edit::Cut(at) => bytes.truncate(place(at)),
    }
}

/// Noise, or one of `seeds` with up to five changes.
pub fn mutated(seeds: Vec<Vec<u8>>) -> impl Strategy<Value = Vec<u8>> {
    let changed = (prop::sample::select(seeds), prop::collection::vec(edit(), 0..6)).prop_map(|(mut bytes, edits)| {
        edits.into_iter().for_each(|edit| apply(&mut bytes, edit));
        bytes
    });
    prop_oneof![1 => prop::collection::vec(any::<u8>(), 0..300), 9 => changed]
}
