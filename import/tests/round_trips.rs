//! What other programs write is what a tap set holds.

use std::fs;

use tapline_import::{Imported, import};
use tapline_store::OwnedSamples;

use crate::{SAMPLE_COUNT, TAP_COUNT, counts, files, recordings, taps_of};

/// What a case's samples are in the tap set.
#[derive(Debug, Clone, Copy)]
enum Stored {
    /// The counts themselves.
    Counts,
    /// Counts of so many bits, with the tap's number in the lower digits.
    Wide(u32),
    /// Counts of so many bits, without more digits.
    Narrow(u32),
    /// A thousandth of the counts, rounded once, or from doubles.
    Thousandths,
}

impl Stored {
    fn samples(self, k: u32) -> OwnedSamples {
        #[expect(clippy::cast_possible_truncation, reason = "the rounding that is stated")]
        let floats =
            |of: &dyn Fn(f64) -> f64| OwnedSamples::F32(counts(k).iter().map(|&v| of(v as f64) as f32).collect());
        match self {
            Self::Counts => OwnedSamples::I16(counts(k).iter().map(|&v| i16::try_from(v).unwrap()).collect()),
            Self::Wide(bits) => {
                let factor = f64::from(bits - 16).exp2();
                floats(&|count| (count * factor + f64::from(k)) / f64::from(bits - 1).exp2())
            }
            Self::Narrow(bits) => floats(&|count| count / f64::from(bits - 1).exp2()),
            Self::Thousandths => floats(&|count| count / 1000.0),
        }
    }
}

/// Catches a sample that changes, a channel taken for another, and a tap in another's place, in any format: every sample in the
/// tap set is the one that another program wrote.
#[test]
fn every_format_comes_back() {
    let Some(folder) = recordings() else { return };
    let cases = [
        ("wav16", Stored::Counts),
        ("wav24", Stored::Wide(24)),
        ("wav32", Stored::Wide(32)),
        ("wav_odd_chunk_swapped", Stored::Counts),
        ("wav_float", Stored::Thousandths),
        ("csv", Stored::Thousandths),
        ("csv_semicolon", Stored::Thousandths),
        ("csv_tab", Stored::Thousandths),
        ("hdf5_files", Stored::Counts),
        ("hdf5_groups", Stored::Narrow(32)),
        ("hdf5_matrix", Stored::Thousandths),
        ("hdf5_columns", Stored::Thousandths),
        ("mat5_int16", Stored::Counts),
        ("mat7_int16", Stored::Counts),
        ("mat7_int32", Stored::Narrow(32)),
        ("mat7_doubles_matrix", Stored::Thousandths),
        ("mat7_wide", Stored::Thousandths),
        ("mat73_wide", Stored::Thousandths),
        ("mat5_structs", Stored::Thousandths),
        ("mat73", Stored::Counts),
        ("uff58", Stored::Thousandths),
        ("uff58b", Stored::Thousandths),
        ("tdms_groups", Stored::Counts),
        ("tdms_scaled", Stored::Thousandths),
        ("tdms_layouts", Stored::Counts),
    ];
    for (name, stored) in cases {
        let (case, set) = (folder.path().join(name), folder.path().join(format!("{name}.set")));
        let imported =
            import(&files(&case), &case.join("import.toml"), &set, |_, _| ()).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!((imported.written, imported.refused.len()), (TAP_COUNT as usize, 0), "{name}: {imported:?}");
        let taps = taps_of(&set);
        for (k, (header, samples)) in (0..).zip(&taps) {
            assert_eq!((header.id.tyre.as_str(), header.id.shoulder, header.id.location), ("A-17", 1, k), "{name}");
            assert_eq!(header.sample_count as usize, SAMPLE_COUNT, "{name}");
            assert_eq!(
                (header.sample_rate_hz.to_bits(), header.pre_trigger_samples),
                (51_200_f64.to_bits(), 20),
                "{name}"
            );
            assert_eq!(*samples, stored.samples(k), "{name}, tap {k}");
        }
        assert_eq!(taps.len(), TAP_COUNT as usize, "{name}");
    }
}

/// Catches a unit that is invented where the file names none, lost where it does, and a scale that is given and not kept.
#[test]
fn scales_are_those_that_are_known() {
    let Some(folder) = recordings() else { return };
    let scan = |name: &str, more: &str| {
        let case = folder.path().join(name);
        let config = fs::read_to_string(case.join("import.toml")).unwrap();
        fs::write(case.join("import.toml"), format!("{more}{config}")).unwrap();
        let set = folder.path().join("set");
        let Imported { unscaled, .. } = import(&files(&case), &case.join("import.toml"), &set, |_, _| ()).unwrap();
        let scan = fs::read_to_string(set.join("scan.toml")).unwrap();
        let scales = taps_of(&set)[0].0.channels().map(|(_, scale)| scale).collect::<Vec<_>>();
        fs::remove_dir_all(set).unwrap();
        (unscaled.into_iter().map(|(channel, _)| channel).collect::<Vec<_>>(), scan, scales)
    };
    let (unscaled, text, _) = scan("wav16", "");
    assert!(unscaled == ["force", "sound"] && !text.contains("full_scale"), "{text}");
    let (unscaled, _, scales) = scan("wav16", "force_full_scale_n = 222.0\n");
    assert!(unscaled == ["sound"] && scales == [222.0 / 32_768.0, 1.0 / 32_768.0], "{scales:?}");
    // Floats in N and in mV; counts in N.
    assert_eq!(scan("uff58b", "").2, [1.0, 1e-3]);
    assert_eq!(scan("hdf5_matrix", "").2, [1.0, 1e-3]);
    let (unscaled, _, scales) = scan("tdms_groups", "");
    assert!(unscaled == ["sound"] && scales == [1.0, 1.0 / 32_768.0], "{scales:?}");
}

/// Catches a record that is cut in the wrong places, and taps that are given to their neighbours.
#[test]
fn continuous_records_are_cut() {
    let Some(folder) = recordings() else { return };
    let bytes = fs::read(folder.path().join("record.i16")).unwrap();
    let record: Vec<i16> = bytes.as_chunks().0.iter().map(|&sample| i16::from_le_bytes(sample)).collect();
    let (force, sound) = record.split_at(record.len() / 2);
    for name in ["record_plan", "record_table"] {
        let (case, set) = (folder.path().join(name), folder.path().join(format!("{name}.set")));
        let imported =
            import(&files(&case), &case.join("import.toml"), &set, |_, _| ()).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(imported.written, TAP_COUNT as usize, "{name}: {imported:?}");
        for (k, (header, samples)) in taps_of(&set).into_iter().enumerate() {
            let OwnedSamples::I16(samples) = samples else { panic!("{name}: floats") };
            assert_eq!(
                (header.id.location as usize, header.id.offset_mm()),
                (k, (name == "record_plan").then_some(5.0))
            );
            // The level of 5 % of full scale is reached within two samples of the pulse's beginning.
            let from = (700 + 1000 * k - 20..).take(4).find(|&at| force[at..at + 200] == samples[..200]);
            let from = from.unwrap_or_else(|| panic!("{name}: tap {k} is not where its pulse is"));
            assert_eq!(&samples[200..], &sound[from..from + 200], "{name}");
        }
    }
    // One tap more than there are: nothing is imported, as none can be identified.
    let case = folder.path().join("record_plan");
    let text = fs::read_to_string(case.join("import.toml")).unwrap().replace("locations = 3", "locations = 4");
    fs::write(case.join("import.toml"), text).unwrap();
    let error = import(&files(&case), &case.join("import.toml"), &folder.path().join("none"), |_, _| ())
        .unwrap_err()
        .to_string();
    let want = "the number of its taps is 3 (the longest pause lies at 0.033 to 0.053 s); 4 are planned";
    assert_eq!(error.matches(want).count(), 1, "{error}");
    assert!(!folder.path().join("none").exists());
}

/// Catches an example that does not import.
#[test]
fn the_example_is_imported() {
    let folder = tempfile::TempDir::new().unwrap();
    let (files, config) = tapline_import::write_example(&folder.path().join("example")).unwrap();
    let imported = import(&files, &config, &folder.path().join("set"), |_, _| ()).unwrap();
    assert_eq!(imported, Imported { written: 100, ..Imported::default() });
    let taps = taps_of(&folder.path().join("set"));
    assert!(taps.iter().any(|(header, _)| header.id.location == 99 && header.id.velocity_m_per_s() == Some(1.85)));
    assert!(tapline_import::write_example(&folder.path().join("example")).unwrap_err().to_string().contains("empty"));
}
