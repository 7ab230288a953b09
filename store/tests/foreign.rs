//! The archive as other people's programs see it.

use std::ffi::OsString;
use std::process::Command;

use tapline_store::{Reader, Writer};
use tapline_wire::{Discriminator, SampleFormat};

use crate::common::{CONFIG, bytes, plan, put};

/// Reads what a stranger would, by name, and prints it.
const SCRIPT: &str = r#"
import sys, h5py, numpy as np
try:
    import hdf5plugin
except ImportError:
    pass # the system's own plugin of Blosc serves as well
with h5py.File(sys.argv[1], "r") as f:
    text = lambda v: v.decode() if isinstance(v, bytes) else str(v)
    print(text(f.attrs["format"]), int(f.attrs["format_version"]), text(f.attrs["geometry"]), int(f.attrs["plan_digest"]))
    print(repr(f["config"][:].tobytes().decode()))
    print(text(f["plan"]["tyre"][6]), f["plan"]["angle_deg"][1], np.isnan(f["plan"]["offset_mm"][6]), f["plan"]["purpose"].tolist())
    print(f["ledger"]["state"].tolist(), f["taps/header"]["tap_time_ns"][6], f["taps/header"]["unit_per_count"][6, 1].hex())
    print(f["taps/samples"].shape, f["taps/samples"].dtype, f["taps/samples"][6].tobytes().hex())
    print(f["discriminators"]["pr"][6], np.isnan(f["discriminators"]["tau_s"][5]), text(f["refusals"]["reason"][9]))
    print(text(f["taps/samples"].attrs["channels"]), float(f["taps/samples"].attrs["sample_rate_hz"]), f["damage"]["location"].tolist())
"#;

/// Fails where h5py is not there, or cannot unpack Blosc.
const HAS_ALL: &str = "
import sys, h5py
try:
    import hdf5plugin
except ImportError:
    pass
sys.exit(not h5py.h5z.filter_avail(32001))";

/// A Python that can read packed samples.
fn python() -> Option<OsString> {
    tapline_testing::python_that(HAS_ALL)
}

/// Catches an archive that only this program can read, or reads differently.
#[test]
fn h5py_reads_the_same() {
    let _guard = crate::common::alone();
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.h5");
    let plan = plan(SampleFormat::F32);
    let mut writer = Writer::create(&path, &plan, plan.taps().len(), CONFIG).unwrap();
    put(&mut writer, 5).unwrap();
    put(&mut writer, 6).unwrap();
    writer.put_refusal(9, &plan.taps()[9].id, "caf\u{e9}").unwrap();
    writer.finish().unwrap();

    let reader = Reader::open(&path).unwrap();
    let (tap, samples) = reader.tap(6).unwrap().unwrap();
    let hex: String = bytes(samples.as_samples()).iter().map(|byte| format!("{byte:02x}")).collect();
    let found = reader.discriminators().unwrap()[6].unwrap();
    let scale = Command::new(&python)
        .args(["-c", &format!("print(({:?}).hex())", tap.channels[1].unit_per_count)])
        .output()
        .unwrap();
    let expected = [
        format!("tapline 1 ring {}", plan.digest()),
        "'[process]\\nf_c_hz = 550.0 # \u{b5}\\n'".to_owned(),
        "A\u{e9}-1 90.0 True [0, 0, 0, 0, 1, 0, 0, 0, 0, 1]".to_owned(),
        format!("[0, 0, 0, 0, 0, 1, 1, 0, 0, 2] {} {}", tap.tap_time_ns, String::from_utf8_lossy(&scale.stdout).trim()),
        format!("(10, 2, 32) float32 {hex}"),
        format!("{} True caf\u{e9}", found.values.get(Discriminator::Pr).unwrap()),
        "force,sound 40960.0 [0, 1, 2, 3, 0, 1, 2, 3]".to_owned(),
    ];
    let out = Command::new(&python).env("PYTHONIOENCODING", "utf-8").args(["-c", SCRIPT]).arg(&path).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    assert_eq!(String::from_utf8_lossy(&out.stdout).lines().collect::<Vec<_>>(), expected);
}

/// Prints the samples of one tap of each archive, as another program unpacks them.
const UNPACK: &str = r#"
import sys, h5py
try:
    import hdf5plugin
except ImportError:
    pass
for path in sys.argv[1:]:
    with h5py.File(path, "r") as f:
        samples = f["taps/samples"]
        filters = samples.id.get_create_plist()
        print([filters.get_filter(k)[0] for k in range(filters.get_nfilters())], samples[6].tobytes().hex())
"#;

/// Catches a codec that is not a registered filter, or that others unpack differently.
#[test]
fn h5py_unpacks_every_codec() {
    let _guard = crate::common::alone();
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut writer = Writer::create(path("run.h5"), &plan(SampleFormat::I16), 0, CONFIG).unwrap();
    put(&mut writer, 6).unwrap();
    writer.finish().unwrap();
    let (_, samples) = Reader::open(path("run.h5")).unwrap().tap(6).unwrap().unwrap();
    let hex: String = bytes(samples.as_samples()).iter().map(|byte| format!("{byte:02x}")).collect();
    // Numbers of filters as they are registered: 1 Deflate, 2 bytes shuffled, 32001 Blosc.
    let filters = [("none", "[]"), ("lz4", "[32001]"), ("zstd", "[32001]"), ("gzip", "[2, 1]")];
    let mut command = Command::new(python);
    command.args(["-c", UNPACK]);
    for (name, _) in filters {
        let to = path(&format!("{name}.h5"));
        tapline_store::repack(path("run.h5"), &to, tapline_store::Codec::from_name(name).unwrap(), |_part| ()).unwrap();
        command.arg(to);
    }
    let out = command.output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let expected: Vec<String> = filters.iter().map(|(_, numbers)| format!("{numbers} {hex}")).collect();
    assert_eq!(String::from_utf8_lossy(&out.stdout).lines().collect::<Vec<_>>(), expected);
}
