//! The samples of one channel, from any kind of file.

use tapline_store::OwnedSamples;

use crate::error::Fault;

/// Most samples of one channel of a file: 87 minutes at 51.2 kHz, a gibibyte of floats.
pub(crate) const SAMPLES_MAX: u64 = 1 << 28;

/// Samples of one channel, and what their file says of them.
#[derive(Debug, Clone)]
pub(crate) struct Series {
    /// 16-bit counts, or floats; integers of another width are floats from -1 to 1.
    pub samples: OwnedSamples,
    /// What a full-scale sample is in the file's unit: 1 for floats, 2^(bits - 1) for integers.
    pub full_scale: f64,
    pub sample_rate_hz: Option<f64>,
    /// Samples before time 0.
    pub pre_trigger_samples: Option<u32>,
    pub unit: Option<String>,
}

/// How many `samples` there are.
pub(crate) fn count_of(samples: &OwnedSamples) -> usize {
    match samples {
        OwnedSamples::I16(samples) => samples.len(),
        OwnedSamples::F32(samples) => samples.len(),
    }
}

/// `samples` as floats: counts as fractions of a full-scale sample, which a float holds exactly.
pub(crate) fn to_floats(samples: &OwnedSamples) -> Vec<f32> {
    match samples {
        OwnedSamples::I16(samples) => samples.iter().map(|&count| f32::from(count) / 32_768.0).collect(),
        OwnedSamples::F32(samples) => samples.clone(),
    }
}

/// `count` of `samples` from sample `from` on; `None` if there are not so many.
pub(crate) fn cut(samples: &OwnedSamples, from: usize, count: usize) -> Option<OwnedSamples> {
    let range = from..from.checked_add(count)?;
    Some(match samples {
        OwnedSamples::I16(samples) => OwnedSamples::I16(samples.get(range)?.to_vec()),
        OwnedSamples::F32(samples) => OwnedSamples::F32(samples.get(range)?.to_vec()),
    })
}

/// The channels of a tap, planar; counts if all of them are counts.
pub(crate) fn planes(channels: &[OwnedSamples]) -> OwnedSamples {
    let counts = channels.iter().map(|samples| match samples {
        OwnedSamples::I16(counts) => Some(counts.as_slice()),
        OwnedSamples::F32(_) => None,
    });
    match counts.collect::<Option<Vec<_>>>() {
        Some(counts) => OwnedSamples::I16(counts.concat()),
        None => OwnedSamples::F32(channels.iter().flat_map(to_floats).collect()),
    }
}

impl Series {
    /// A series of only `samples`.
    fn of(samples: OwnedSamples, full_scale: f64) -> Self {
        Self { samples, full_scale, sample_rate_hz: None, pre_trigger_samples: None, unit: None }
    }

    /// Integers of `bits` bits. A float holds those of 24 bits exactly, and of wider ones the first 24 bits.
    pub(crate) fn of_integers(integers: impl IntoIterator<Item = i64>, bits: u32) -> Self {
        let full_scale = (f64::from(bits) - 1.0).exp2();
        if bits == 16 {
            let count = |integer: i64| i16::try_from(integer).unwrap_or(if integer < 0 { i16::MIN } else { i16::MAX });
            return Self::of(OwnedSamples::I16(integers.into_iter().map(count).collect()), full_scale);
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_precision_loss,
            reason = "as exact as the float that is stored"
        )]
        let float = |integer: i64| (integer as f64 / full_scale) as f32;
        Self::of(OwnedSamples::F32(integers.into_iter().map(float).collect()), full_scale)
    }

    pub(crate) fn of_floats(floats: Vec<f32>) -> Result<Self, Fault> {
        if let Some(at) = floats.iter().position(|value| !value.is_finite()) {
            return Err(Fault::NotFinite { sample: at, value: floats[at].to_string() });
        }
        Ok(Self::of(OwnedSamples::F32(floats), 1.0))
    }

    /// Doubles, rounded to floats.
    pub(crate) fn of_doubles(doubles: &[f64]) -> Result<Self, Fault> {
        #[expect(clippy::cast_possible_truncation, reason = "a tap set holds floats; what is too large is refused")]
        let float = |(sample, &value): (usize, &f64)| {
            let float = value as f32;
            if float.is_finite() { Ok(float) } else { Err(Fault::NotFinite { sample, value: value.to_string() }) }
        };
        let floats = doubles.iter().enumerate().map(float).collect::<Result<_, _>>()?;
        Ok(Self::of(OwnedSamples::F32(floats), 1.0))
    }
}

/// Checks a number of samples before any memory is asked for.
pub(crate) fn checked_count(samples: u64) -> Result<usize, Fault> {
    match usize::try_from(samples) {
        Ok(0) => Err(Fault::Empty),
        Ok(count) if samples <= SAMPLES_MAX => Ok(count),
        _ => Err(Fault::TooMany { samples, most: SAMPLES_MAX }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches integers that change: every one of 16 and 24 bits must come back from what is stored.
    #[test]
    fn integers_are_kept() {
        let all = [-32_768, -1, 0, 1, 32_767];
        assert_eq!(Series::of_integers(all, 16).samples, OwnedSamples::I16(vec![i16::MIN, -1, 0, 1, i16::MAX]));
        let wide = [-8_388_608, -8_388_607, -1, 0, 1, 8_388_607];
        let OwnedSamples::F32(stored) = Series::of_integers(wide, 24).samples else { panic!("counts of 24 bits") };
        assert_eq!(stored.iter().map(|&s| (f64::from(s) * 8_388_608.0) as i64).collect::<Vec<_>>(), wide);
        let mixed = planes(&[OwnedSamples::I16(vec![-32_768, 1]), OwnedSamples::F32(vec![0.5, 2.0])]);
        assert_eq!(mixed, OwnedSamples::F32(vec![-1.0, 1.0 / 32_768.0, 0.5, 2.0]));
    }

    /// Catches a value that a float cannot hold, stored as infinity.
    #[test]
    fn what_no_float_holds_is_refused() {
        assert!(Series::of_doubles(&[1.0, 1e39]).unwrap_err().to_string().starts_with("sample 1 (from 0) is 1000000"));
        assert!(Series::of_floats(vec![f32::NAN]).is_err());
        assert!(checked_count(1_000_000_000_000).unwrap_err().to_string().contains("1000000000000 samples"));
    }
}
