//! The extractor in the precision that the configuration asks for.

use tapline_wire::{Discriminators, Samples, TapHeader};

use crate::extractor::Extractor;
use crate::{Error, Precision, ProcessConfig};

/// An [`Extractor`] of the precision that the configuration asks for.
#[derive(Debug)]
pub enum ProcessExtractor {
    /// Single precision. Taps with a faint flexural band are repeated in double precision: beside a sound 50 dB above
    /// the band, single precision does not keep 1e-4.
    F32(Box<Extractor<f32>>, Box<Extractor<f64>>),
    /// Double precision.
    F64(Box<Extractor<f64>>),
}

impl ProcessExtractor {
    /// An extractor for `config`, in its precision.
    ///
    /// # Errors
    /// What [`ProcessConfig::validate`] finds.
    pub fn new(config: &ProcessConfig) -> Result<Self, Error> {
        Ok(match config.precision {
            Precision::F32 => Self::F32(Box::new(Extractor::new(config)?), Box::new(Extractor::new(config)?)),
            Precision::F64 => Self::F64(Box::new(Extractor::new(config)?)),
        })
    }

    /// The discriminators of one tap; see [`Extractor::extract`].
    pub fn extract(&mut self, header: &TapHeader, samples: Samples<'_>) -> Discriminators {
        match self {
            Self::F32(single, double) => {
                let found = single.extract(header, samples);
                if single.is_faint { double.extract(header, samples) } else { found }
            }
            Self::F64(extractor) => extractor.extract(header, samples),
        }
    }
}
