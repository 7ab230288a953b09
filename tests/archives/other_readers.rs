//! Exported taps as other programs read them: pyuff and SciPy.

use tapline_store::Reader;

use crate::archives::export_taps::run;

/// Prints types and units of each Universal File, and the identification of its functions; compares every sample with
/// what h5py reads.
const PYUFF: &str = r#"
import csv, sys, hdf5plugin, h5py, numpy as np, pyuff
archive, folder = h5py.File(sys.argv[1]), sys.argv[2]
samples, header = archive["taps/samples"], archive["taps/header"]
files, largest = {}, 0.0
rows = list(csv.DictReader(open(folder + "/taps.csv", encoding="utf-8")))
for row in rows:
    if row["file"] not in files:
        files[row["file"]] = pyuff.UFF(folder + "/" + row["file"])
for k, row in enumerate(rows):
    uff = files[row["file"]]
    for channel, (unit, kind) in enumerate([("N", 13), ("V", 0)]):
        function = uff.read_sets(int(row["part"]) + 1 + channel)
        want = samples[k, channel] * header[k]["unit_per_count"][channel]
        assert len(function["data"]) == len(want) == function["num_pts"]
        largest = max(largest, np.abs(function["data"] - want).max() / np.abs(want).max())
        assert function["ordinate_axis_units_lab"] == unit and function["ordinate_spec_data_type"] == kind
        assert function["func_type"] == 1 and function["abscissa_spacing"] == 1 and function["binary"]
        rate_hz = header[k]["sample_rate_hz"]
        assert abs(function["abscissa_inc"] * rate_hz - 1) < 1e-5
        assert abs(function["x"][header[k]["pre_trigger_samples"]]) < 1e-6
        assert function["rsp_node"] == int(row["location"]) and function["ver_num"] == int(row["repetition"])
about = files[rows[0]["file"]].read_sets(0)
print(about["type"], about["description"], about["date_db_created"], about["program"].split()[0])
units = files[rows[0]["file"]].read_sets(1)
print(units["type"], units["units_code"], units["length"], units["force"], units["temp_offset"])
print(largest < 6e-8)
first = files[rows[0]["file"]].read_sets(3)
print(first["id1"]); print(first["id2"]); print(first["id3"]); print(first["id4"]); print(first["id5"])
print(sorted(files), [len(uff.get_set_types()) for uff in files.values()])
"#;

/// Catches a Universal File that other programs cannot read, or read differently: values, units, axes, names.
#[test]
fn pyuff_reads_what_was_recorded() {
    let Some(python) = tapline_testing::python_with("hdf5plugin, h5py, pyuff") else { return };
    let sandbox = run();
    let reader = Reader::open(sandbox.path("run.h5")).unwrap();
    let (header, _) = reader.tap(0).unwrap().unwrap();
    let plan = format!("{:016x}", reader.plan().digest());
    drop(reader);
    let done = sandbox.run("export run.h5 taps --format uff --out uff").expect(0);
    assert_eq!(done.out, "uff: 124 taps written, 0 refused, 0 missing\n");
    let said = sandbox.python(&python, PYUFF, &["run.h5", "uff"]);
    let said: Vec<&str> = said.lines().collect();
    assert_eq!(said[0], "151 taps of tyre CRACKED shoulder 1 01-JAN-26 tapline");
    let said = &said[1..];
    assert_eq!(said[..2], ["164 1 1.0 1.0 273.15", "True"]);
    assert_eq!(said[2], "sound tyre CRACKED shoulder 1 location 0");
    assert_eq!(said[3], "offset_mm 0 velocity_m_per_s 1.85 angle_deg 0 repetition 0");
    assert_eq!(said[4], "01-JAN-26 00:00:00");
    let measured = header.velocity_measured_m_per_s;
    assert_eq!(said[5], format!("station 1 attempt {} velocity_measured_m_per_s {measured}", header.id.attempt));
    let (rate, distance) = (header.sample_rate_hz, header.microphone_distance_m);
    assert_eq!(said[6], format!("sample_rate_hz {rate} microphone_distance_m {distance} plan {plan}"));
    let names = ["CRACKED-1", "CRACKED-2"].map(|name| format!("'{name}.uff'"));
    assert_eq!(said[7], format!("[{}] [126, 126]", names.join(", ")));
}

/// Compares the matrices of each MATLAB file with what h5py reads of the archive.
const SCIPY: &str = r#"
import csv, hdf5plugin, h5py, numpy as np, scipy.io
archive = h5py.File("run.h5")
samples, header = archive["taps/samples"], archive["taps/header"]
files, count = {}, 0
for k, row in enumerate(csv.DictReader(open("mat/taps.csv", encoding="utf-8"))):
    if row["file"] not in files:
        files[row["file"]] = scipy.io.loadmat("mat/" + row["file"])
    mat, column = files[row["file"]], int(row["part"]) - 1
    for channel, name in enumerate(["force", "sound"]):
        want = samples[k, channel] * header[k]["unit_per_count"][channel]
        assert mat[name].dtype == np.float32 and (mat[name][:, column] == want.astype("f4")).all()
    for name in ["location", "angle_deg", "offset_mm", "velocity_m_per_s", "velocity_measured_m_per_s", "repetition"]:
        assert mat[name][0, column] == float(row[name]), name
    assert abs(mat["tap_time_s"][0, column] - header[k]["tap_time_ns"] * 1e-9) < 1e-6
    assert mat["tyre"] == row["tyre"] and mat["shoulder"] == float(row["shoulder"])
    assert mat["sample_count"][0, column] == samples.shape[2]
    assert mat["sample_rate_hz"] == header[k]["sample_rate_hz"]
    assert mat["time_axis"] == 1
    assert mat["pre_trigger_samples"] == header[k]["pre_trigger_samples"]
    count += 1
print(sorted(files), count, [mat["force"].shape for mat in files.values()])
"#;

/// Catches a MATLAB file that other programs cannot read, or read differently: values, columns, names, scalars.
#[test]
fn scipy_reads_what_was_recorded() {
    let Some(python) = tapline_testing::python_with("hdf5plugin, h5py, scipy") else { return };
    let sandbox = run();
    let done = sandbox.run("export run.h5 taps --format mat --out mat").expect(0);
    assert_eq!(done.out, "mat: 124 taps written, 0 refused, 0 missing\n");
    let said = sandbox.python(&python, SCIPY, &[]);
    assert_eq!(said.trim(), "['CRACKED-1.mat', 'CRACKED-2.mat'] 124 [(4096, 62), (4096, 62)]");
}
