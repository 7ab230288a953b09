//! The arrays of a MATLAB file: numbers, texts, and structures of such.

use crate::error::{Fault, broken};
use crate::format::bytes::Bytes;
use crate::format::mat5::numbers::Numbers;

/// Deepest structure within structures.
const DEPTH_MAX: usize = 4;

/// Most axes of an array, and fields of a structure.
const AXES_MAX: usize = 32;
const FIELDS_MAX: usize = 4096;

/// An array, unpacked.
#[derive(Debug)]
pub(super) struct Array {
    pub class: u8,
    pub is_complex: bool,
    pub shape: Vec<u64>,
    /// Type and bytes of the numbers.
    pub numbers: Option<(u32, Vec<u8>)>,
    /// Of an array of characters.
    pub text: String,
    /// Of a structure of one element, its fields.
    pub fields: Vec<(String, Array)>,
}

pub(super) const MI_MATRIX: u32 = 14;
const MX_STRUCT: u8 = 2;
const MX_OBJECT: u8 = 3;
pub(super) const MX_CHAR: u8 = 4;
const COMPLEX: u32 = 0x0800;

/// Name of a class of arrays.
pub(super) fn class_name(class: u8) -> &'static str {
    const NAMES: [&str; 16] = [
        "unknown", "cell", "struct", "object", "char", "sparse", "double", "single", "int8", "uint8", "int16",
        "uint16", "int32", "uint32", "int64", "uint64",
    ];
    NAMES.get(usize::from(class)).copied().unwrap_or(NAMES[0])
}

impl Array {
    /// The name and the contents of an array.
    pub(super) fn parse(left: &[u8], is_big_endian: bool, depth: usize) -> Result<(String, Self), Fault> {
        let mut elements = Bytes { left, is_big_endian };
        let flags = elements.words(4, "flags")?.first().copied().unwrap_or(0);
        let shape: Vec<u64> = elements.words(AXES_MAX, "axes")?.into_iter().map(u64::from).collect();
        let (_, name) = elements.element()?;
        let name = String::from_utf8_lossy(name).into_owned();
        let class = flags.to_le_bytes()[0];
        let mut array = Self {
            class,
            is_complex: flags & COMPLEX != 0,
            shape,
            numbers: None,
            text: String::new(),
            fields: Vec::new(),
        };
        match class {
            MX_STRUCT | MX_OBJECT if depth < DEPTH_MAX => {
                if class == MX_OBJECT {
                    elements.element()?;
                }
                array.fields = fields(&mut elements, &array.shape, depth)?;
            }
            MX_CHAR => {
                let (kind, bytes) = elements.element()?;
                array.text = match kind {
                    // 16 bits a character, else UTF-8.
                    4 => String::from_utf16_lossy(&Numbers { kind, bytes, is_big_endian }.each(
                        bytes.len() / 2,
                        |k| k,
                        u16::from_le_bytes,
                    )?),
                    _ => String::from_utf8_lossy(bytes).into_owned(),
                };
            }
            6..=15 => {
                let (kind, numbers) = elements.element()?;
                array.numbers = Some((kind, numbers.to_vec()));
            }
            _ => {}
        }
        Ok((name, array))
    }

    /// The first number, if it is one.
    pub(super) fn double(&self, is_big_endian: bool) -> Option<f64> {
        let (kind, bytes) = self.numbers.as_ref()?;
        Numbers { kind: *kind, bytes, is_big_endian }.doubles(1, |_| 0).ok()?.first().copied()
    }
}

/// The fields of a structure with one element; those of more have no names of their own.
fn fields(elements: &mut Bytes<'_>, shape: &[u64], depth: usize) -> Result<Vec<(String, Array)>, Fault> {
    if shape.iter().any(|&n| n != 1) {
        return Ok(Vec::new());
    }
    let name_bytes = elements.words(1, "lengths of names")?.first().copied().unwrap_or(0) as usize;
    let (_, names) = elements.element()?;
    if name_bytes == 0 || names.len() / name_bytes > FIELDS_MAX {
        return broken(format!("a structure has names of {name_bytes} bytes in {} bytes", names.len()));
    }
    let mut fields = Vec::new();
    for name in names.chunks_exact(name_bytes) {
        let name = String::from_utf8_lossy(name.split(|&byte| byte == 0).next().unwrap_or_default()).into_owned();
        let (kind, bytes) = elements.element()?;
        if kind == MI_MATRIX && !bytes.is_empty() {
            fields.push((name, Array::parse(bytes, elements.is_big_endian, depth + 1)?.1));
        }
    }
    Ok(fields)
}
