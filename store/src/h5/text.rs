//! Texts in archives: attributes of a fixed length, and datasets of bytes.
//!
//! None is of variable length: such texts lie in the library's global heap, in which one changed byte makes it crash.

use hdf5::types::{FixedUnicode, TypeDescriptor};
use hdf5::{Dataset, Group, H5Type, Location};

use crate::format::layout::attribute;

/// Note of a dataset whose bytes are a text.
pub(crate) const TEXT_NOTE: &str = "a text, UTF-8";

macro_rules! by_length {
    ($($bytes:literal)*) => {
        /// Writes `text` as attribute `name`, padded with zeros to the next of the known lengths.
        pub(crate) fn write_text(place: &Location, name: &str, text: &str) -> hdf5::Result<()> {
            match text.len() {
                $(..=$bytes => write_number(place, name, &fixed::<$bytes>(text)?),)*
                bytes => Err(format!("an attribute of {bytes} bytes is too long").into()),
            }
        }

        /// The text of attribute `name`; an error if it is not UTF-8 of a known length.
        pub(crate) fn read_text(place: &Location, name: &str) -> hdf5::Result<String> {
            let attribute = place.attr(name)?;
            match attribute.dtype()?.to_descriptor()? {
                $(TypeDescriptor::FixedUnicode($bytes) => {
                    utf8(attribute.read_scalar::<FixedUnicode<$bytes>>()?.as_bytes())
                })*
                other => Err(format!("attribute {name:?} is {other}, not a text of a known length").into()),
            }
        }
    };
}

by_length! { 32 128 512 1024 }

fn fixed<const N: usize>(text: &str) -> hdf5::Result<FixedUnicode<N>> {
    text.parse().map_err(|_error| hdf5::Error::from("a text contains a NUL character"))
}

fn utf8(bytes: &[u8]) -> hdf5::Result<String> {
    std::str::from_utf8(bytes).map(str::to_owned).map_err(|_error| hdf5::Error::from("a text is not UTF-8"))
}

/// Writes short `texts` as one attribute.
pub(crate) fn write_texts(place: &Location, name: &str, texts: &[&str]) -> hdf5::Result<()> {
    let texts: Vec<FixedUnicode<32>> = texts.iter().map(|text| fixed(text)).collect::<hdf5::Result<_>>()?;
    place.new_attr::<FixedUnicode<32>>().shape(texts.len()).create(name)?.write_raw(&texts)
}

pub(crate) fn write_number<T: H5Type>(place: &Location, name: &str, value: &T) -> hdf5::Result<()> {
    place.new_attr::<T>().create(name)?.write_scalar(value)
}

pub(crate) fn read_number<T: H5Type>(place: &Location, name: &str) -> hdf5::Result<T> {
    place.attr(name)?.read_scalar()
}

/// A new dataset of the bytes of `text`.
pub(crate) fn create_text(group: &Group, name: &str, text: &str) -> hdf5::Result<Dataset> {
    let dataset = group.new_dataset::<u8>().shape(text.len()).obj_track_times(false).create(name)?;
    dataset.write_raw(text.as_bytes())?;
    write_text(&dataset, attribute::NOTE, TEXT_NOTE)?;
    Ok(dataset)
}
