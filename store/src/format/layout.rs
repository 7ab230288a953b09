//! Names, rows and units of the tables in an archive.
//!
//! Codes and flags are plain integers, never Rust enums or booleans: a damaged file could give those invalid values. No
//! row has padding: its bytes in memory, all of them defined, are written as they are. The library's conversion of padded
//! rows would clear a megabyte at every write.

#![expect(unsafe_code, reason = "the derived description cannot name the elements of an array")]

use std::borrow::Cow;
use std::mem::offset_of;

use hdf5::H5Type;
use hdf5::types::{CompoundField, CompoundType, FixedAscii, FixedUnicode, TypeDescriptor};
use tapline_wire::{CHANNELS_MAX, Calibration, Discriminator, Recording, SERIAL_BYTES};

use crate::format::lineage::Digest;

/// Version of the layout that is written, and the only version that is read.
pub const FORMAT_VERSION: u32 = 1;

/// Longest reason of a refusal in bytes of UTF-8; a longer one ends in an ellipsis.
pub const REASON_BYTES: usize = 256;

/// Value of the root attribute [`attribute::FORMAT`].
pub(crate) const FORMAT: &str = "tapline";

/// The plan row in a table row that was never written.
pub(crate) const UNWRITTEN: u32 = u32::MAX;

/// A lineage key, empty until it is known.
pub(crate) type Key = FixedAscii<64>;

/// Paths of the tables.
pub(crate) mod table {
    pub(crate) const CONFIG: &str = "config";
    /// What computed the results, as lines of text.
    pub(crate) const MADE_BY: &str = "made_by";
    /// What the channels' samples are worth, as JSON.
    pub(crate) const CALIBRATION: &str = "calibration";
    /// Bytes of the reference file, UTF-8; only if the run had one.
    pub(crate) const REFERENCE: &str = "reference";
    pub(crate) const PLAN: &str = "plan";
    pub(crate) const TAPS: &str = "taps";
    pub(crate) const HEADER: &str = "taps/header";
    pub(crate) const SAMPLES: &str = "taps/samples";
    pub(crate) const DISCRIMINATORS: &str = "discriminators";
    pub(crate) const LEDGER: &str = "ledger";
    pub(crate) const REFUSALS: &str = "refusals";
    pub(crate) const SCANS: &str = "scans";
    pub(crate) const DAMAGE: &str = "damage";
    pub(crate) const TRUTH: &str = "truth";
    /// Key of the results, zeros until all scans are judged.
    pub(crate) const LINEAGE_KEY: &str = "lineage_key";
    /// The record of what must not change while the archive is written: see [`crate::h5::structure`].
    pub(crate) const STRUCTURE: &str = "structure";
}

/// Names of the attributes.
pub(crate) mod attribute {
    pub(crate) const FORMAT: &str = "format";
    pub(crate) const FORMAT_VERSION: &str = "format_version";
    pub(crate) const TAPLINE_VERSION: &str = "tapline_version";
    pub(crate) const GEOMETRY: &str = "geometry";
    pub(crate) const PLAN_DIGEST: &str = "plan_digest";
    pub(crate) const SOURCE_DIGEST: &str = "source_digest";
    pub(crate) const CHANNELS: &str = "channels";
    /// Name of the codec.
    pub(crate) const CODEC: &str = "codec";
    /// With only results: name of the archive of their taps, as seen from their folder.
    pub(crate) const RAW: &str = "raw";
    /// With only results: digest of their taps, as hexadecimal digits.
    pub(crate) const RAW_DIGEST: &str = "raw_digest";
    /// Taps planned when the archive was begun.
    pub(crate) const BEGUN_TAPS: &str = "begun_taps";
    /// BLAKE3 of what never changes after creation, as hexadecimal digits.
    pub(crate) const DIGEST: &str = "digest";
    pub(crate) const SAMPLE_FORMAT: &str = "sample_format";
    pub(crate) const SAMPLE_RATE_HZ: &str = "sample_rate_hz";
    pub(crate) const PRE_TRIGGER_SAMPLES: &str = "pre_trigger_samples";
    pub(crate) const NOTE: &str = "note";
    /// Units of a table's fields as one list, or the unit of a dataset of plain numbers.
    pub(crate) const UNITS: &str = "units";
    /// Prefix of the attribute that has the unit of one field.
    pub(crate) const UNITS_OF_FIELD: &str = "units_";
    /// Units of the channels once they are scaled, in the order of [`CHANNELS`].
    pub(crate) const CHANNEL_UNITS: &str = "channel_units";
    /// Class of a group in NeXus: a hint for programs that know NeXus.
    pub(crate) const NX_CLASS: &str = "NX_class";
    /// The group, and in it the dataset, that such a program shows first, and its axes.
    pub(crate) const NX_DEFAULT: &str = "default";
    pub(crate) const NX_SIGNAL: &str = "signal";
    pub(crate) const NX_AXES: &str = "axes";
}

/// The units of `table` as a list: of its fields, or of the dataset's own numbers. `noted` is its list in [`NOTES`], to which
/// those of the discriminators are added for taps of `calibration`.
pub(crate) fn units_of(table: &str, noted: &'static str, calibration: &Calibration) -> Cow<'static, str> {
    if table != table::DISCRIMINATORS {
        return noted.into();
    }
    let each = Discriminator::ALL.map(|which| format!("{} {}", which.column(), which.unit(calibration)));
    format!("{noted}, {}", each.join(", ")).into()
}

/// What a reader without this program must know of each table: (table, note, units except those of the discriminators).
pub(crate) const NOTES: [(&str, &str, &str); 8] = [
    (
        table::PLAN,
        "row k of every table of taps is row k here; NaN is unknown; grown_to 0 is room for a tap that was not asked for; purpose 0 scan, 1 closing tap, 2 second reading of a suspect place, 3 second reading of a control",
        "offset_mm mm, velocity_m_per_s m/s, angle_deg deg",
    ),
    (
        table::HEADER,
        "a sample times unit_per_count is in channel_units; plan_index 4294967295 is a tap that is not there; source 1 simulated, 2 tap set, 3 captured; samples_digest is the BLAKE3 of the valid samples",
        "sample_rate_hz Hz, velocity_measured_m_per_s m/s, microphone_distance_m m, tap_time_ns ns, sent_ns ns, epoch_ns ns",
    ),
    (
        table::DISCRIMINATORS,
        "NaN is absent; plan_index 4294967295 is a tap that is not there; quality is a set of flags",
        "velocity_measured_m_per_s m/s",
    ),
    (
        table::LEDGER,
        "state 0 missing, 1 archived, 2 refused; only an archived tap's other rows are valid; a missing tap was lost at 1 acquire, 2 process, 3 store, 0 not said; attempts before this one were retaken for the flags of retaken_quality",
        "",
    ),
    (table::REFUSALS, "reason of a refused tap, UTF-8", ""),
    (
        table::SCANS,
        "state 0 open, 1 ended, 2 judged; verdict 0 none, 1 PASS, 2 RE-INSPECT, 3 REJECT; reasons is a set of flags; its cells are rows first_cell.. of damage; evidence, scatter, level and drift are by discriminator, in the order of that table's columns",
        "",
    ),
    (
        table::DAMAGE,
        "valid where the scan is judged; NaN is none; region 0 is none; scan 4294967295 is room that is not used",
        "angle_deg deg, offset_best_mm mm, offset_low_mm mm, offset_high_mm mm",
    ),
    (
        table::SAMPLES,
        "[tap, channel, sample]; the first sample_count samples, as the header has it, are valid; the rest is 0",
        "counts",
    ),
];

/// A planned tap.
#[repr(C)]
#[derive(Debug, Clone, Copy, H5Type)]
pub(crate) struct PlanRow {
    pub tyre: FixedUnicode<SERIAL_BYTES>,
    pub station: u16,
    pub shoulder: u16,
    pub scan: u32,
    pub offset_mm: f64,
    pub velocity_m_per_s: f64,
    pub angle_deg: f64,
    pub location: u32,
    pub repetition: u16,
    /// What the tap is for: [`tapline_wire::Purpose`].
    pub purpose: u16,
    /// Rows of the plan after this row and those with it were added; 0 in a row without a tap.
    pub grown_to: u64,
    /// Digest of the plan with these rows.
    pub plan_digest: u64,
    pub checksum: u64,
}

/// What is known of a tap apart from its samples, its plan row and the shape that all records share.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, H5Type)]
pub(crate) struct HeaderRow {
    pub plan_index: u32,
    pub attempt: u16,
    pub channel_count: u16,
    pub sample_rate_hz: f64,
    pub sample_count: u32,
    pub pre_trigger_samples: u32,
    pub unit_per_count: [f64; CHANNELS_MAX],
    pub velocity_measured_m_per_s: f64,
    pub microphone_distance_m: f64,
    pub tap_time_ns: i64,
    pub sent_ns: i64,
    pub epoch_ns: i64,
    pub sequence: u64,
    pub mark: u64,
    pub sender: u32,
    pub source: u32,
    /// BLAKE3 of the samples without padding, channel by channel, in the file's byte order.
    pub samples_digest: Digest,
    /// Checksum of the packed chunk.
    pub stored_checksum: u64,
    pub checksum: u64,
}

/// The discriminators of a tap; the columns of the values are named by [`tapline_wire::Discriminator::column`].
///
/// Shoulder and location repeat the plan, so that the table can be plotted by itself.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub(crate) struct DiscriminatorsRow {
    pub plan_index: u32,
    pub attempt: u16,
    pub shoulder: u16,
    pub location: u32,
    pub quality: u32,
    pub velocity_measured_m_per_s: f64,
    /// In the order of [`Discriminator::ALL`]; in the file each is a column.
    pub values: [f64; Discriminator::COUNT],
    pub checksum: u64,
}

// SAFETY: every field, and every element of `values`, is described with its own type, offset and size.
unsafe impl H5Type for DiscriminatorsRow {
    fn type_descriptor() -> TypeDescriptor {
        let values = Discriminator::ALL.map(|which| (which.column(), offset_of!(Self, values) + 8 * which as usize));
        let columns = [
            CompoundField::typed::<u32>("plan_index", offset_of!(Self, plan_index), 0),
            CompoundField::typed::<u16>("attempt", offset_of!(Self, attempt), 1),
            CompoundField::typed::<u16>("shoulder", offset_of!(Self, shoulder), 2),
            CompoundField::typed::<u32>("location", offset_of!(Self, location), 3),
            CompoundField::typed::<u32>("quality", offset_of!(Self, quality), 4),
            CompoundField::typed::<f64>("velocity_measured_m_per_s", offset_of!(Self, velocity_measured_m_per_s), 5),
        ];
        let checksum = ("checksum", offset_of!(Self, checksum));
        let mut fields = Vec::from(columns);
        for (name, offset) in values {
            fields.push(CompoundField::typed::<f64>(name, offset, fields.len()));
        }
        fields.push(CompoundField::typed::<u64>(checksum.0, checksum.1, fields.len()));
        TypeDescriptor::Compound(CompoundType { fields, size: size_of::<Self>() })
    }
}

/// State of a planned tap.
#[repr(C)]
#[derive(Debug, Clone, Copy, H5Type)]
pub(crate) struct LedgerRow {
    /// Flags of the last unusable attempt.
    pub retaken_quality: u32,
    /// Unusable attempts.
    pub retaken_count: u32,
    pub attempt: u16,
    /// Where a missing tap was lost: a code of [`crate::Lost`].
    pub lost_at: u16,
    pub state: u32,
    pub checksum: u64,
}

/// Reason of a refusal.
#[repr(C)]
#[derive(Debug, Clone, Copy, H5Type)]
pub(crate) struct ReasonRow {
    pub reason: FixedUnicode<REASON_BYTES>,
    pub checksum: u64,
}

/// One scan and its verdict.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, H5Type)]
pub(crate) struct ScanRow {
    pub tyre: FixedUnicode<SERIAL_BYTES>,
    pub station: u16,
    pub shoulder: u16,
    pub first_cell: u32,
    pub cell_count: u32,
    pub verdict: u32,
    pub limit_re_inspect: f64,
    pub limit_reject: f64,
    pub strongest_arc: f64,
    pub first_strongest_arc: f64,
    pub re_inspect_rate: f64,
    pub reject_rate: f64,
    pub p_value: f64,
    pub evidence: [f64; Discriminator::COUNT],
    pub scatter: [f64; Discriminator::COUNT],
    pub level: [f64; Discriminator::COUNT],
    pub drift: [f64; Discriminator::COUNT],
    pub reasons: u32,
    pub planned_count: u32,
    pub received_count: u32,
    pub refused_count: u32,
    pub absent_count: u32,
    pub state: u32,
    pub checksum: u64,
}

/// Damage at one location.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, H5Type)]
pub(crate) struct CellRow {
    pub tyre: FixedUnicode<SERIAL_BYTES>,
    pub station: u16,
    pub shoulder: u16,
    pub scan: u32,
    pub angle_deg: f64,
    pub damage_index: f64,
    pub first_index: f64,
    pub p_value: f64,
    pub region_index: f64,
    pub region_p_value: f64,
    pub offset_best_mm: f64,
    pub offset_low_mm: f64,
    pub offset_high_mm: f64,
    pub location: u32,
    pub region: u32,
    pub tap_count: u32,
    pub absent_count: u32,
    pub checksum: u64,
}

/// What is known of a crack at one location.
#[repr(C)]
#[derive(Debug, Clone, Copy, H5Type)]
pub(crate) struct TruthRow {
    pub tyre: FixedUnicode<SERIAL_BYTES>,
    pub location: u32,
    pub shoulder: u16,
    pub cracked: u16,
}

/// Units of the channels' samples once they are scaled, in their order.
pub(crate) fn channel_units(recording: &Recording) -> String {
    let units: Vec<&str> = recording.channels.iter().map(|&c| recording.calibration.unit(c).name()).collect();
    units.join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Catches a column that is renamed, dropped or moved away from what every other table calls it.
    #[test]
    fn discriminators_have_their_columns() {
        let TypeDescriptor::Compound(row) = DiscriminatorsRow::type_descriptor() else { panic!("not a compound") };
        let names: Vec<&str> = row.fields.iter().map(|f| f.name.as_str()).skip(6).take(Discriminator::COUNT).collect();
        assert_eq!(names, Discriminator::ALL.map(Discriminator::column));
    }

    /// Catches a field that makes the compiler pad a row.
    #[test]
    fn rows_have_no_padding() {
        for row in [
            PlanRow::type_descriptor(),
            HeaderRow::type_descriptor(),
            DiscriminatorsRow::type_descriptor(),
            LedgerRow::type_descriptor(),
            ScanRow::type_descriptor(),
            ReasonRow::type_descriptor(),
            CellRow::type_descriptor(),
            TruthRow::type_descriptor(),
        ] {
            assert_eq!(row.size(), row.to_packed_repr().size(), "{row:?}");
        }
    }
}
