//! Wrong configurations, tables and names: errors that name the file, the thing, its value and its bound.

use std::fs;
use std::path::{Path, PathBuf};

use hound::{SampleFormat, WavSpec, WavWriter};
use tapline_import::import;
use tempfile::TempDir;

const CONFIG: &str =
    "name = \"{tyre}_{shoulder}_{location}.wav\"\nchannels = { force = 1, sound = 2 }\npre_trigger_samples = 4\n";

/// A WAV of two channels.
fn wav(path: &Path, sample_rate: u32, sample_count: u32) {
    let spec = WavSpec { channels: 2, sample_rate, bits_per_sample: 16, sample_format: SampleFormat::Int };
    let mut out = WavWriter::create(path, spec).unwrap();
    for k in 0..sample_count {
        out.write_sample(i16::try_from(k % 100).unwrap()).unwrap();
        out.write_sample(-5_i16).unwrap();
    }
    out.finalize().unwrap();
}

struct Case {
    folder: TempDir,
    files: Vec<PathBuf>,
}

impl Case {
    /// Recordings of these names, and a configuration.
    fn new(config: &str, names: &[&str]) -> Self {
        let folder = TempDir::new().unwrap();
        fs::write(folder.path().join("import.toml"), config).unwrap();
        let files: Vec<PathBuf> = names.iter().map(|name| folder.path().join(name)).collect();
        files.iter().for_each(|file| wav(file, 40_960, 32));
        Self { folder, files }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn import(&self) -> Result<tapline_import::Imported, String> {
        import(&self.files, &self.path("import.toml"), &self.path("set"), |_, _| ()).map_err(|error| error.to_string())
    }

    fn fails(&self, parts: &[&str]) {
        let error = self.import().unwrap_err();
        for part in parts {
            assert!(error.contains(part), "{error:?} lacks {part:?}");
        }
        assert!(!self.path("set").exists(), "a set is left behind: {error}");
        let drafts = fs::read_dir(self.folder.path())
            .unwrap()
            .flatten()
            .filter(|f| f.file_name().to_string_lossy().ends_with(".new"));
        assert_eq!(drafts.count(), 0, "a draft is left behind");
    }
}

/// Catches a fault of the configuration that is let through, or reported without its key, value and bound.
#[test]
fn faults_of_the_configuration_are_reported() {
    for (from, to, parts) in [
        ("channels", "chanels", &["import.toml line 2: `chanels = ", ": unknown field `chanels`"][..]),
        ("force = 1, sound = 2", "", &["import.toml: channels is empty; it must name force, sound or both"]),
        ("sound = 2", "light = 2", &["import.toml line 2: `channels = ", ": unknown field `light`"]),
        ("sound = 2", "sound = -2", &["import.toml line 2: ", "a channel is its number, from 1, or its name"]),
        ("sound = 2", "sound = 3", &["A_1_0.wav: has no channel number 3 (from 1); it has \"1\", \"2\""]),
        ("sound = 2", "sound = \"mic\"", &["A_1_0.wav: has no channel \"mic\"; it has \"1\", \"2\""]),
        ("sound = 2", "sound = 0", &["has no channel number 0"]),
        ("= 4", "= 4\nsample_rate_hz = 0", &["sample_rate_hz is 0; it must be from 1 to 500000000"]),
        (
            "= 4",
            "= 4\nsample_rate_hz = 44100",
            &["A_1_0.wav: the sample rate is 40960 Hz; in the configuration it is 44100 Hz"],
        ),
        ("= 4", "= 4\nforce_full_scale_n = -1", &["force_full_scale_n is -1; it must be above 0"]),
        ("= 4", "= 4\ntime_axis = 3", &["time_axis is 3; it must be 1"]),
        ("= 4", "= 4\ntable = \"taps.csv\"", &["there are both name and table"]),
        ("= 4", "= 4\nplan = { locations = 3 }", &["there is a plan, but no [cut]"]),
        (
            "= 4",
            "= 4\ncut = { sample_count = 4 }",
            &["cut.sample_count is 4; it must be above pre_trigger_samples = 4"],
        ),
        (
            "= 4",
            "= 4\ncut = { sample_count = 9, trigger = { level = 2.0 } }",
            &["cut.trigger.level is 2; it must be from"],
        ),
        ("= 4", "= 40", &["A_1_0.wav: the number of samples is 32; the trigger is at sample 40"]),
        (
            "pre_trigger_samples = 4",
            "",
            &["A_1_0.wav: does not say which sample is the trigger: set pre_trigger_samples in"],
        ),
        ("= 4", "= 4\ntap = { speed = 1 }", &["import.toml: tap.speed is unknown; it must be one of file,tyre,"]),
        (
            "= 4",
            "= 4\ntap = { offset_mm = \"5 mm\" }",
            &["import.toml: tap.offset_mm is \"5 mm\"; it must be a number"],
        ),
        (
            "= 4",
            "= 4\ntap = { offset_mm = true }",
            &["import.toml: tap.offset_mm is true; it must be a text or a number"],
        ),
        ("{shoulder}", "{_}", &["A_1_0.wav: a tap has no shoulder; it must come from"]),
        (
            "{location}.wav",
            "{location}.txt",
            &["A_1_0.wav: \"A_1_0.wav\" does not fit name = \"{tyre}_{shoulder}_{location}.txt\""],
        ),
        ("{tyre}", "{colour}", &["{colour} must be one of tyre, shoulder"]),
    ] {
        assert!(CONFIG.contains(from));
        Case::new(&CONFIG.replace(from, to), &["A_1_0.wav", "A_1_1.wav"]).fails(parts);
    }
    let mut folder = Case::new(CONFIG, &["A_1_0.wav"]);
    folder.files = vec![folder.path("taps")];
    fs::create_dir(folder.path("taps")).unwrap();
    folder.fails(&["taps: is a folder; give the files in it instead, as ", "taps/*"]);
    Case::new(CONFIG, &["A_3_0.wav"]).fails(&["A_3_0.wav: shoulder is \"3\"; it must be a whole number from 1 to 2"]);
    Case::new(CONFIG, &["A_1_0.wav", "A_1_00.wav"]).fails(&[
        "A_1_00.wav: is the tap tyre A shoulder 1",
        "again, after",
        "A_1_0.wav",
    ]);
}

/// Catches a table whose faults have no line, a recording that no row names, and a row without a recording.
#[test]
fn faults_of_a_table_are_reported() {
    let config = "table = \"taps.csv\"\nchannels = { force = 1, sound = 2 }\npre_trigger_samples = 4\ntap = { tyre = \"A\", shoulder = 1 }\n";
    for (table, parts) in [
        ("file,location\na.wav,0\nb.wav,x\n", &["taps.csv line 3: location is \"x\"; it must be a whole number"][..]),
        ("file,location\n\na.wav,0\nc.wav,1\n", &["taps.csv line 4: file is \"c.wav\"; it must be one of the 2 files"]),
        ("file,location\na.wav,0\n", &["taps.csv: has no row for ", "b.wav"]),
        ("file,location\na.wav,0\nb.wav,\n", &["taps.csv line 3: a tap has no location"]),
        (
            "file,location\na.wav,0\nb.wav,1\na.wav,2\n",
            &["taps.csv line 4: names ", "a.wav again; a recording is one tap, unless [cut]"],
        ),
        (
            "file,location\na.wav,0\nb.wav,0\n",
            &["taps.csv line 3: is the tap tyre A shoulder 1", "again, after line 2"],
        ),
        (
            "file,location,colour\na.wav,0,red\nb.wav,1,red\n",
            &["taps.csv line 1: unknown column \"colour\"; the columns are part,file,"],
        ),
        ("file,location\na.wav\n", &["taps.csv line 2: "]),
        ("file,location,part\na.wav,0,x\nb.wav,1,\n", &["a WAV has no parts, and so no \"x\""]),
        ("", &["taps.csv"]),
    ] {
        let case = Case::new(config, &["a.wav", "b.wav"]);
        fs::write(case.path("taps.csv"), table).unwrap();
        match case.import() {
            // A part that is not there concerns one tap; the other is imported.
            Ok(imported) => assert!(imported.refused.iter().any(|reason| reason.contains(parts[0])), "{imported:?}"),
            Err(_) => case.fails(parts),
        }
    }
}

/// Catches a table of a spreadsheet whose semicolons or decimal commas are not read.
#[test]
fn a_table_may_have_semicolons_and_decimal_commas() {
    let config = "table = \"taps.csv\"\nchannels = { force = 1, sound = 2 }\npre_trigger_samples = 4\ntap = { tyre = \"A\", shoulder = 1 }\n";
    let case = Case::new(config, &["a.wav", "b.wav"]);
    fs::write(case.path("taps.csv"), "file;location;offset_mm\na.wav;0;2,5\nb.wav;1;2.5\n").unwrap();
    assert_eq!(case.import().unwrap().written, 2);
    let listed = fs::read_to_string(case.path("set/taps.csv")).unwrap();
    assert_eq!(listed.lines().skip(1).filter(|row| row.contains(",A,1,2.5,")).count(), 2, "{listed}");
}

/// Catches a refused row of a cut record that takes no piece of it, so that every tap below gets its neighbour's samples.
#[test]
fn a_refused_row_of_a_cut_record_takes_its_piece() {
    let config = "table = \"taps.csv\"\nchannels = { force = 1, sound = 2 }\npre_trigger_samples = 4\n\
        tap = { tyre = \"A\", shoulder = 1 }\ncut = { sample_count = 32 }\n";
    let case = Case::new(config, &["a.wav"]);
    let spec = WavSpec { channels: 2, sample_rate: 40_960, bits_per_sample: 16, sample_format: SampleFormat::Int };
    let mut out = WavWriter::create(case.path("a.wav"), spec).unwrap();
    // A tap each 8000 samples, of 40, and its number in the sound.
    for k in 0..24_000_i16 {
        let (tap, at) = (k / 8_000, k % 8_000);
        out.write_sample(if (1_000..1_040).contains(&at) { 20_000_i16 } else { 0 }).unwrap();
        out.write_sample(tap).unwrap();
    }
    out.finalize().unwrap();
    fs::write(case.path("taps.csv"), "file,location,refused\na.wav,0,\na.wav,1,a double tap\na.wav,2,\n").unwrap();
    let imported = case.import().unwrap();
    assert_eq!((imported.written, imported.refused), (2, vec!["a double tap".to_owned()]));
    let set = fs::read_dir(case.path("set/A-1")).unwrap().map(|file| file.unwrap().path());
    let mut files: Vec<PathBuf> = set.collect();
    files.sort();
    let sounds = |file: &PathBuf| hound::WavReader::open(file).unwrap().samples::<i16>().nth(1).unwrap().unwrap();
    assert_eq!(files.iter().map(sounds).collect::<Vec<_>>(), [0, 2], "{files:?}");
}

/// Catches one recording that cannot be read and stops all others, or is left out without a word; and one of another rate.
#[test]
fn a_recording_that_cannot_be_read_is_refused_in_the_set() {
    let case = Case::new(CONFIG, &["A_1_0.wav", "A_1_1.wav", "A_1_2.wav", "A_1_3.wav"]);
    fs::write(case.path("A_1_1.wav"), "no WAV at all").unwrap();
    wav(&case.path("A_1_2.wav"), 44_100, 32);
    let imported = case.import().unwrap();
    assert_eq!(imported.written, 2);
    let [one, two] = imported.refused.as_slice() else { panic!("{imported:?}") };
    assert!(one.contains("A_1_1.wav: not a WAV file: it does not start with RIFF and WAVE"), "{one}");
    assert!(two.contains("A_1_2.wav: the sample rate is 44100 Hz; in what was read before it is 40960 Hz"), "{two}");
    let list = fs::read_to_string(case.path("set/taps.csv")).unwrap();
    assert!(list.lines().nth(2).unwrap().contains("not a WAV file"), "{list}");
    case_again(&case);
}

/// A set is not mixed with another.
fn case_again(case: &Case) {
    let error = case.import().unwrap_err();
    assert!(error.contains("set is a folder with files in it"), "{error}");
}

/// Catches data that are read as something else because nothing here reads them: each is refused by its name.
#[test]
fn what_is_not_read_is_refused_by_name() {
    let text = |text: &str| [&u32::try_from(text.len()).unwrap().to_le_bytes(), text.as_bytes()].concat();
    let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    let tdms = |index: Vec<u8>, properties: Vec<u8>| {
        let about = [words(&[1]), text("/'g'/'force'"), index, properties].concat();
        let offsets = [about.len() as u64 + 64, about.len() as u64].map(u64::to_le_bytes).concat();
        [b"TDSm".to_vec(), words(&[14, 4713]), offsets, about, vec![0; 64]].concat()
    };
    let daqmx = words(&[0x1269, 0xffff_ffff, 1, 32, 0, 1, 3, 0, 0, 0, 0, 1, 2]);
    let integers = |kind: u32, count: u32| words(&[20, kind, 1, count, 0]);
    let scale = |kind: &str| {
        let count = [text("NI_Number_Of_Scales"), words(&[7, 1])].concat();
        [words(&[2]), count, text("NI_Scale[0]_Scale_Type"), words(&[0x20]), text(kind)].concat()
    };
    let mat = [b"MATLAB 5.0 MAT-file".to_vec(), vec![b' '; 105], vec![0, 3], b"IM".to_vec()].concat();
    for (file, bytes, want) in [
        ("0.tdms", tdms(daqmx, words(&[0])), "\"force\" holds raw data of DAQmx"),
        (
            "0.tdms",
            tdms(integers(2, 32), scale("Thermocouple")),
            "channel \"force\" has 1 scales, the first Thermocouple; one,",
        ),
        ("0.tdms", tdms(integers(6, 32), words(&[0])), "channel \"force\" holds unsigned integers of 16 bits; signed"),
        ("0.tdms", tdms(integers(2, 32), words(&[0])), "does not say its sample rate: set sample_rate_hz in"),
        ("0.mat", mat, "its version is not 5 to 7.3"),
        ("0.mat", vec![0; 200], "(version 4 is not read: save it again in MATLAB)"),
        ("0.h5", vec![7; 200], "is not valid HDF5: "),
        ("0.uff", b"    -1\n    15\n    -1\n".to_vec(), "has no dataset 58"),
        ("0.csv", b"1,2\n3,4\n".to_vec(), "its first line has numbers, not names"),
        ("0.csv", b"t,force\n0,1\n1,x\n".to_vec(), "line 3: force is \"x\"; it must be a number"),
        ("0.wav", b"RF64    WAVE".to_vec(), "RF64 and RIFX are not read"),
        ("0.ogg", vec![1], "its ending is not one that is read: wav, csv"),
        ("0.csv", vec![], "has no samples"),
    ] {
        let case = Case::new(
            "name = \"{location}.{_}\"\nchannels = { force = \"force\" }\npre_trigger_samples = 1\ntap = { tyre = \"A\", shoulder = 1 }\n",
            &[],
        );
        fs::write(case.path(file), bytes).unwrap();
        let done = import(&[case.path(file)], &case.path("import.toml"), &case.path("set"), |_, _| ());
        let error = done.unwrap_err().to_string();
        assert!(error.contains(want) && error.contains(file), "{error:?} lacks {want:?}");
    }
}

/// A MATLAB file of version 5: each variable by its name, the class and type of its values, and those as bytes.
fn mat5(variables: &[(&str, u32, u32, Vec<u8>)]) -> Vec<u8> {
    let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    let element = |kind: u32, bytes: &[u8]| {
        let padding = vec![0; bytes.len().next_multiple_of(8) - bytes.len()];
        [words(&[kind, u32::try_from(bytes.len()).unwrap()]), bytes.to_vec(), padding].concat()
    };
    let mut file = [b"MATLAB 5.0 MAT-file".to_vec(), vec![b' '; 105], vec![0, 1], b"IM".to_vec()].concat();
    for (name, class, kind, values) in variables {
        let width = match kind {
            9 => 8,
            _ => 1,
        };
        let columns = u32::try_from(values.len() / width).unwrap();
        let about = [element(6, &words(&[*class, 0])), element(5, &words(&[1, columns])), element(1, name.as_bytes())];
        file.extend(element(14, &[about.concat(), element(*kind, values)].concat()));
    }
    file
}

/// A Universal File with one function in time, whose ordinate is called `label`; it states `count` values and has four.
pub(crate) fn uff(label: &str, count: u32) -> Vec<u8> {
    let blank = "NONE\n".repeat(5);
    let form = format!("{:>10}{:>10}{:>10}{:>13}{:>13}{:>13}", 2, count, 1, 0.0, 0.001, 0.0);
    let ordinate = format!("{:>10}{:>5}{:>5}{:>5} {label:<20} {:<20}", 0, 0, 0, 0, "N");
    let text = format!(
        "    -1\n    58\n{blank}{:>5}\n{form}\n{:>10}\n{ordinate}\n{:>10}\n{:>10}\n{:>13}{:>13}{:>13}{:>13}\n    -1\n",
        1, 17, 0, 0, 1.0, 2.0, 3.0, 4.0
    );
    text.into_bytes()
}

/// The same, whose first ID line is `Hammer 7`.
fn with_id_line(uff: Vec<u8>) -> Vec<u8> {
    String::from_utf8(uff).unwrap().replacen("NONE", "Hammer 7", 1).into_bytes()
}

/// `[tap]` of the files that name no taps, and the force by a name.
const ONE: &str = "channels = { force = \"force\" }\nsample_rate_hz = 1000\npre_trigger_samples = 1\ntap = { tyre = \"A\", shoulder = 1, location = 0, offset_mm = 0.0, velocity_m_per_s = 1.85 }\n";

fn doubles(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

#[test]
fn a_channel_is_found_whatever_the_case_of_its_name() {
    // Catches `Force` that is not found as `force`, one of two that is taken for the other, and a name as it is written that is
    // passed over for another.
    let of = |values: &[f64]| doubles(values);
    let one = [1.0, 2.0, 3.0, 4.0];
    let csv = |header: &str| format!("{header}\n1,5\n2,6\n3,7\n4,8\n").into_bytes();
    let hdf5 = |names: &[&str]| {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("h.h5");
        let file = hdf5::File::create(&path).unwrap();
        for (k, name) in names.iter().enumerate() {
            let values: Vec<f32> = one.iter().map(|value| *value as f32 + 4.0 * k as f32).collect();
            file.new_dataset_builder().with_data(&values).create(*name).unwrap();
        }
        drop(file);
        fs::read(path).unwrap()
    };
    for (file, bytes, first) in [
        ("0.mat", mat5(&[("Force", 6, 9, of(&one))]), Ok(1.0)),
        ("0.mat", mat5(&[("FORCE", 6, 9, of(&[5.0; 4])), ("force", 6, 9, of(&one))]), Ok(1.0)),
        ("0.mat", mat5(&[("FORCE", 6, 9, of(&one)), ("Force", 6, 9, of(&one))]), Err("no channel \"force\"; it has")),
        ("0.uff", uff("Force", 4), Ok(1.0)),
        // By every name that it may be called.
        ("0.uff", with_id_line(uff("Blow", 4)), Err("no channel \"force\"; it has \"Blow\" or \"Hammer 7\"")),
        ("0.csv", csv("FORCE,sound"), Ok(1.0)),
        ("0.csv", csv("Force,FORCE"), Err("no channel \"force\"; it has \"Force\", \"FORCE\"")),
        ("0.h5", hdf5(&["Force", "Sound"]), Ok(1.0)),
        ("0.h5", hdf5(&["FORCE", "force"]), Ok(5.0)),
        ("0.h5", hdf5(&["FORCE", "Force"]), Err("no channel \"force\"; it has")),
    ] {
        let case = Case::new(ONE, &[]);
        fs::write(case.path(file), bytes).unwrap();
        let done = import(&[case.path(file)], &case.path("import.toml"), &case.path("set"), |_, _| ());
        match (done, first) {
            (Ok(_), Ok(first)) => {
                let samples = crate::taps_of(&case.path("set")).remove(0).1;
                let tapline_store::OwnedSamples::F32(samples) = samples else { panic!("{file}: counts") };
                assert!((f64::from(samples[0]) - first).abs() < 1e-6, "{file}: {samples:?}");
            }
            (Err(error), Err(want)) => {
                let error = error.to_string();
                assert!(
                    error.starts_with("the only tap cannot be imported: ") && error.contains(want),
                    "{file}: {error} lacks {want}"
                );
            }
            (done, first) => panic!("{file}: {done:?} where {first:?} was wanted"),
        }
    }
}

#[test]
fn a_unit_that_is_no_text_is_reported() {
    // Catches newtons that are lost without a word because the variable with their unit is a number, and an error of it that
    // names neither the file nor the variable, nor what it must be.
    let samples = || ("force", 6, 9, doubles(&[1.0, 2.0, 3.0, 4.0]));
    for (unit, want) in [
        (
            ("force_unit", 6, 9, doubles(&[1.0])),
            Some("0.mat: \"force_unit\" is an array of class double; it must be a text"),
        ),
        (("force_unit", 1, 1, Vec::new()), Some("0.mat: \"force_unit\" is an array of class cell; it must be a text")),
        (("force_unit", 4, 16, b"N".to_vec()), None),
    ] {
        let case = Case::new(ONE, &[]);
        fs::write(case.path("0.mat"), mat5(&[samples(), unit])).unwrap();
        let done = import(&[case.path("0.mat")], &case.path("import.toml"), &case.path("set"), |_, _| ());
        match want {
            Some(want) => {
                let error = done.unwrap_err().to_string();
                assert!(error.contains(want) && error.contains("\"N\""), "{error:?} lacks {want:?}");
            }
            None => assert!(done.unwrap().unscaled.is_empty()),
        }
    }
}

/// A file of HDF5 with a tap in the group `1`; with `unit`, as MATLAB 7.3 writes a variable and the text beside it.
fn hdf5_bytes(unit: Option<&str>) -> Vec<u8> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("h.h5");
    let file = hdf5::File::create(&path).unwrap();
    let group = file.create_group("1").unwrap();
    let force = group.new_dataset_builder().with_data(&[1.0_f64, 2.0, 3.0, 4.0]).create("force").unwrap();
    if let Some(unit) = unit {
        force.new_attr::<u8>().create("MATLAB_class").unwrap().write_scalar(&0_u8).unwrap();
        let text: Vec<u16> = unit.encode_utf16().collect();
        let class = |dataset: hdf5::Dataset, name: &str| {
            dataset.new_attr::<u8>().create(name).unwrap().write_scalar(&1_u8).unwrap();
        };
        if text.is_empty() {
            class(group.new_dataset_builder().with_data(&[0_u64, 0]).create("force_unit").unwrap(), "MATLAB_empty");
        } else {
            class(group.new_dataset_builder().with_data(&text).create("force_unit").unwrap(), "MATLAB_class");
        }
    }
    drop((force, group, file));
    fs::read(path).unwrap()
}

const GROUPS: &str = "name = \"{tyre}.h5/{location}\"\nchannels = { force = \"force\" }\nsample_rate_hz = 40960.0
pre_trigger_samples = 1\ntap = { shoulder = 1, offset_mm = 0.0, velocity_m_per_s = 1.5 }\n";

/// Catches newtons of MATLAB 7.3 that are lost, and another unit that is not reported.
#[test]
fn matlab_7_3_names_units_as_earlier_versions_do() {
    for (unit, want) in [("N ", None), ("kg", Some(("force", Some("kg".to_owned())))), ("", Some(("force", None)))] {
        let case = Case::new(GROUPS, &[]);
        fs::write(case.path("A.h5"), hdf5_bytes(Some(unit))).unwrap();
        let done = import(&[case.path("A.h5")], &case.path("import.toml"), &case.path("set"), |_, _| ()).unwrap();
        assert_eq!((done.written, done.unscaled), (1, want.into_iter().collect()), "{unit}");
    }
}

/// Catches a tap whose unit is not known, and that gets the scale of the others.
#[test]
fn taps_of_other_units_are_refused() {
    for (units, want) in [
        (["N", "kg"], "the unit of the force is not known, and that of the taps before is N"),
        (["kg", "N"], "the unit of the force is N, and that of the taps before is not known"),
    ] {
        let case = Case::new(GROUPS, &[]);
        let files = ["A.h5", "B.h5"].map(|name| case.path(name));
        files.iter().zip(units).for_each(|(file, unit)| fs::write(file, hdf5_bytes(Some(unit))).unwrap());
        let done = import(&files, &case.path("import.toml"), &case.path("set"), |_, _| ()).unwrap();
        assert_eq!((done.written, done.refused.len()), (1, 1), "{done:?}");
        assert!(done.refused[0].contains("B.h5") && done.refused[0].contains(want), "{:?}", done.refused);
    }
}

/// Catches a variable of MATLAB that vanishes without a word because a bit of its kind has changed.
#[test]
fn a_variable_of_an_unknown_kind_is_damage() {
    let case = Case::new(ONE, &[]);
    let mut bytes = mat5(&[("force", 6, 9, doubles(&[1.0, 2.0, 3.0, 4.0]))]);
    bytes[128] ^= 2;
    fs::write(case.path("0.mat"), bytes).unwrap();
    let done = import(&[case.path("0.mat")], &case.path("import.toml"), &case.path("set"), |_, _| ());
    assert!(done.unwrap_err().to_string().contains("a variable at byte 128 has the unknown kind 12"));
}

/// Catches one damaged file that stops the import of all others because its parts would name its taps.
#[test]
fn a_file_whose_parts_cannot_be_read_is_left_out() {
    let case = Case::new(GROUPS, &[]);
    let whole = hdf5_bytes(None);
    fs::write(case.path("A.h5"), &whole).unwrap();
    fs::write(case.path("B.h5"), &whole[..100]).unwrap();
    let files = [case.path("A.h5"), case.path("B.h5")];
    let done = import(&files, &case.path("import.toml"), &case.path("set"), |_, _| ()).unwrap();
    assert_eq!((done.written, done.unread.len()), (1, 1));
    assert!(done.unread[0].contains("B.h5: is not valid HDF5"), "{:?}", done.unread);
    let case = Case { files: vec![files[1].clone()], ..case };
    fs::remove_dir_all(case.path("set")).unwrap();
    case.fails(&["B.h5"]);
}
