//! The metadata of TDMS segments, as bytes: numbers, texts, properties, and the paths of objects.

use crate::error::{Fault, broken};
use crate::format::bytes::Bytes;

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Property {
    Number(f64),
    Text(String),
    Other,
}

/// Bytes of a value; `None` of texts and of what is not a number.
pub(super) fn value_bytes(kind: u32) -> Option<u64> {
    Some(match kind {
        1 | 5 | 0x21 => 1,
        2 | 6 => 2,
        3 | 7 | 9 | 0x19 => 4,
        4 | 8 | 10 | 0x1a | 0x0008_000c => 8,
        0x44 | 0x0010_000d => 16,
        _ => return None,
    })
}

pub(super) fn kind_name(kind: u32) -> String {
    match kind {
        5..=8 => format!("unsigned integers of {} bits", 8 << (kind - 5)),
        0x20 => "texts".to_owned(),
        0x21 => "truth values".to_owned(),
        0x44 => "times".to_owned(),
        0x0008_000c | 0x0010_000d => "complex numbers".to_owned(),
        kind => format!("values of type {kind:#x}"),
    }
}

impl Bytes<'_> {
    pub(super) fn text(&mut self) -> Result<String, Fault> {
        let count = self.u32()? as usize;
        Ok(String::from_utf8_lossy(self.take(count)?).into_owned())
    }

    #[expect(clippy::cast_precision_loss, reason = "rates and factors")]
    pub(super) fn property(&mut self) -> Result<Property, Fault> {
        let kind = self.u32()?;
        let number = match kind {
            1 => i8::from_le_bytes(self.array()?).into(),
            2 => i16::from_le_bytes(self.array()?).into(),
            3 => i32::from_le_bytes(self.array()?).into(),
            4 => i64::from_le_bytes(self.array()?) as f64,
            5 => u8::from_le_bytes(self.array()?).into(),
            6 => u16::from_le_bytes(self.array()?).into(),
            7 => self.u32()?.into(),
            8 => self.u64()? as f64,
            9 | 0x19 => f32::from_le_bytes(self.array()?).into(),
            10 | 0x1a => f64::from_le_bytes(self.array()?),
            0x20 => return Ok(Property::Text(self.text()?)),
            kind => {
                let Some(bytes) = value_bytes(kind) else {
                    return broken(format!("a property is of type {kind:#x}, which is unknown"));
                };
                self.take(usize::try_from(bytes).unwrap_or(usize::MAX))?;
                return Ok(Property::Other);
            }
        };
        Ok(Property::Number(number))
    }
}

/// The steps of an object's path: `/'group'/'channel'`, with quotes in names doubled.
pub(super) fn steps(path: &str) -> Result<Vec<String>, Fault> {
    let mut steps = Vec::new();
    let mut rest = path;
    while let Some(inner) = rest.strip_prefix("/'") {
        let (mut name, mut letters) = (String::new(), inner.char_indices().peekable());
        rest = loop {
            match letters.next() {
                Some((_, '\'')) if letters.next_if(|(_, next)| *next == '\'').is_some() => name.push('\''),
                Some((at, '\'')) => break &inner[at + 1..],
                Some((_, letter)) => name.push(letter),
                None => return broken(format!("an object is called {path:?}, which is not a path")),
            }
        };
        steps.push(name);
    }
    if rest.is_empty() || path == "/" {
        Ok(steps)
    } else {
        broken(format!("an object is called {path:?}, which is not a path"))
    }
}
