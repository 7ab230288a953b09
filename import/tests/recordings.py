"""Writes recordings in every format that is imported, a folder a case: what the tests compare with is computed anew by them.

Tap k has sample i of the force ((7919 i + 31 k) mod 65536) - 32768 and of the sound ((104729 i + 17 k) mod 65536) - 32768; cases
of other widths say how they follow from these.
"""

import csv, os, struct, sys, wave
import h5py, numpy as np, pyuff, scipy.io
from nptdms import ChannelObject, GroupObject, TdmsFile, TdmsWriter

RATE_HZ, COUNT, TAPS = 51200, 200, 3
out = sys.argv[1]


def counts(k):
    i = np.arange(COUNT, dtype=np.int64)
    return ((7919 * i + 31 * k) % 65536 - 32768), ((104729 * i + 17 * k) % 65536 - 32768)


def case(name, config):
    folder = os.path.join(out, name)
    os.makedirs(folder)
    with open(os.path.join(folder, "import.toml"), "w") as file:
        file.write("pre_trigger_samples = 20\n" + config + "\n")
    return lambda file: os.path.join(folder, file)


TAP = 'tap = { tyre = "A-17", shoulder = 1 }\n'
RATE = f"sample_rate_hz = {RATE_HZ}\n"
NUMBERS = "channels = { force = 1, sound = 2 }\n"
NAMES = 'channels = { force = "force", sound = "sound" }\n'


def wav(path, width, channels, odd_chunk=False):
    with wave.open(path, "wb") as file:
        file.setparams((len(channels), width, RATE_HZ, 0, "NONE", ""))
        frames = np.stack(channels, axis=1).reshape(-1)
        file.writeframes(b"".join(int(v).to_bytes(4, "little", signed=True)[:width] for v in frames))
    if odd_chunk:
        whole = open(path, "rb").read()
        chunk = b"LIST" + struct.pack("<I", 3) + b"abc\0"
        whole = whole[:12] + chunk + whole[12:]
        open(path, "wb").write(whole[:4] + struct.pack("<I", len(whole) - 8) + whole[8:])


for name, width, factor in [("wav16", 2, 1), ("wav24", 3, 256), ("wav32", 4, 65536)]:
    path = case(name, 'name = "{tyre}_{shoulder}_{location}.wav"\n' + NUMBERS)
    for k in range(TAPS):
        # The lower digits of wider integers are those of k.
        wav(path(f"A-17_1_{k:02}.wav"), width, [v * factor + (k if factor > 1 else 0) for v in counts(k)])
path = case("wav_odd_chunk_swapped", 'name = "{tyre}_{shoulder}_{location}.wav"\nchannels = { force = 3, sound = 1 }\n')
for k in range(TAPS):
    force, sound = counts(k)
    wav(path(f"A-17_1_{k}.wav"), 2, [sound, sound * 0, force], odd_chunk=True)
path = case("wav_float", 'name = "{location}.wav"\n' + TAP + NUMBERS)
for k in range(TAPS):
    frames = np.stack(counts(k), axis=1).astype("<f4") / np.float32(1000)
    form = struct.pack("<HHIIHH", 3, 2, RATE_HZ, RATE_HZ * 8, 8, 32)
    data = frames.tobytes()
    whole = b"WAVEfmt " + struct.pack("<I", 16) + form + b"data" + struct.pack("<I", len(data)) + data
    open(path(f"{k}.wav"), "wb").write(b"RIFF" + struct.pack("<I", len(whole)) + whole)

for name, delimiter, comma in [("csv", ",", "."), ("csv_semicolon", ";", ","), ("csv_tab", "\t", ".")]:
    path = case(name, 'table = "taps.csv"\n' + TAP + RATE + 'channels = { force = "Force (N)", sound = 3 }\n')
    with open(path("taps.csv"), "w", newline="") as table:
        rows = csv.writer(table)
        rows.writerow(["location", "file"])
        for k in range(TAPS):
            rows.writerow([k, f"tap {k}.csv"])
            with open(path(f"tap {k}.csv"), "w", newline="", encoding="utf-8-sig") as file:
                lines = csv.writer(file, delimiter=delimiter)
                lines.writerow(["Time (s)", "Force (N)", "Sound (V)"])
                for i, (force, sound) in enumerate(zip(*counts(k))):
                    lines.writerow([i / RATE_HZ, str(force / 1000).replace(".", comma), str(sound / 1000).replace(".", comma)])

path = case("hdf5_files", 'name = "{location}.h5"\n' + TAP + NAMES)
for k in range(TAPS):
    with h5py.File(path(f"{k}.h5"), "w") as file:
        force, sound = counts(k)
        file["force"], file["sound"] = force.astype("i2"), sound.astype("i2")
        file.attrs["sample_rate_hz"] = float(RATE_HZ)
path = case("hdf5_groups", 'name = "{tyre}.h5/{shoulder}/{location}"\n' + NAMES + RATE)
with h5py.File(path("A-17.h5"), "w") as file:
    file["1/about"] = "text that is no tap"
    for k in range(TAPS):
        force, sound = counts(k)
        # Big-endian, chunked and packed: the library's affair.
        file.create_dataset(f"1/{k}/force", data=force.astype(">i4"), chunks=(64,), compression="gzip")
        file.create_dataset(f"1/{k}/sound", data=sound.astype("<i4"))
path = case("hdf5_matrix", 'table = "taps.csv"\n' + TAP + NAMES + RATE)
with h5py.File(path("taps.h5"), "w") as file:
    for place, name in enumerate(["force", "sound"]):
        file[name] = np.stack([counts(k)[place] / 1000 for k in range(TAPS)])
        file[name].attrs["unit"] = "N" if name == "force" else "mV"
with open(path("taps.csv"), "w") as table:
    table.write("file,part,location\n" + "".join(f"taps.h5,{k + 1},{k}\n" for k in range(TAPS)))
path = case("hdf5_columns", 'name = "{tyre}.hdf5/tap{location}"\ntap = { shoulder = 1 }\n' + NUMBERS + RATE)
with h5py.File(path("A-17.hdf5"), "w") as file:
    for k in range(TAPS):
        file[f"tap{k}"] = np.stack(counts(k), axis=1).astype("f4") / np.float32(1000)

for name, kind, pack in [("mat5_int16", "i2", False), ("mat7_int16", "i2", True), ("mat7_int32", "i4", True)]:
    path = case(name, 'name = "{location}.mat"\n' + TAP + NAMES)
    for k in range(TAPS):
        force, sound = (v.astype(kind) for v in counts(k))
        about = {"fs": float(RATE_HZ), "remark": "tyre of \xe9", "cells": np.array([["a", 1]], dtype=object)}
        scipy.io.savemat(path(f"{k}.mat"), {**about, "force": force, "sound": sound[:, None]}, do_compression=pack)
path = case("mat7_doubles_matrix", 'table = "taps.csv"\n' + TAP + NAMES + RATE)
scipy.io.savemat(path("a.mat"), {n: np.stack([counts(k)[p] / 1000 for k in range(TAPS)], axis=1) for p, n in enumerate(["force", "sound"])}, do_compression=True)
with open(path("taps.csv"), "w") as table:
    table.write("file,part,location\n" + "".join(f"a.mat,{k + 1},{k}\n" for k in range(TAPS)))
# More columns than samples: as an export states it, and as MATLAB 7.3 turns it.
wide = {n: np.pad(np.stack([counts(k)[p] / 1000 for k in range(TAPS)], axis=1), ((0, 0), (0, COUNT))) for p, n in enumerate(["force", "sound"])}
for name, axis in [("mat7_wide", ""), ("mat73_wide", "time_axis = 1\n")]:
    path = case(name, 'table = "taps.csv"\n' + axis + TAP + NAMES + RATE)
    if not axis:
        scipy.io.savemat(path("a.mat"), {**wide, "time_axis": 1.0})
    else:
        with h5py.File(path("a.mat"), "w", userblock_size=512) as file:
            for n, matrix in wide.items():
                file[n] = matrix.T
                file[n].attrs["MATLAB_class"] = np.bytes_("double")
        with open(path("a.mat"), "r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + b"\x00\x02IM")
    with open(path("taps.csv"), "w") as table:
        table.write("file,part,location\n" + "".join(f"a.mat,{k + 1},{k}\n" for k in range(TAPS)))
# MATLAB stores doubles that are whole numbers as the narrowest integers.
path = case("mat5_structs", 'name = "{tyre}.mat/tap_{location}"\ntap = { shoulder = 1 }\n' + NAMES)
taps = {f"tap_{k}": {n: counts(k)[p] / 1000 for p, n in enumerate(["force", "sound"])} | {"fs": float(RATE_HZ)} for k in range(TAPS)}
scipy.io.savemat(path("A-17.mat"), taps)
path = case("mat73", 'name = "{location}.mat"\n' + TAP + NAMES)
for k in range(TAPS):
    with h5py.File(path(f"{k}.mat"), "w", userblock_size=512) as file:
        force, sound = counts(k)
        # A column of MATLAB is a row of HDF5.
        file["force"], file["sound"], file["Fs"] = force[None, :].astype("i2"), sound[:, None].astype("i2"), [[float(RATE_HZ)]]
    with open(path(f"{k}.mat"), "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + b"\x00\x02IM")

for name, binary in [("uff58", 0), ("uff58b", 1)]:
    path = case(name, 'name = "{location}.uff"\n' + TAP + 'channels = { force = "Force", sound = 2 }\n')
    for k in range(TAPS):
        file = pyuff.UFF(path(f"{k}.uff"))
        for place, (label, unit, kind) in enumerate([("Force", "N", 13), ("Sound", "mV", 0)]):
            values = counts(k)[place] / 1000
            sets = dict(
                type=58, binary=binary, func_type=1, rsp_node=k, rsp_dir=0, ref_node=0, ref_dir=0, data=values,
                x=(np.arange(COUNT) - 20) / RATE_HZ, id1=f"{label} of tap {k}",
                abscissa_spacing=1, abscissa_min=-20 / RATE_HZ, abscissa_inc=1 / RATE_HZ, orddenom_spec_data_type=0,
                z_axis_spec_data_type=0,
                ordinate_spec_data_type=kind, ordinate_axis_lab=label, ordinate_axis_units_lab=unit,
                abscissa_spec_data_type=17, abscissa_axis_lab="Time", abscissa_axis_units_lab="s")
            file.write_sets(sets, "add")

GROUPS = 'name = "{tyre}.tdms/{shoulder}-{location}"\n' + NAMES
path = case("tdms_groups", GROUPS)
with TdmsWriter(path("A-17.tdms")) as file:
    for k in range(TAPS):
        for part in np.split(np.stack(counts(k)), [50, 51], axis=1):
            about = {"wf_increment": 1 / RATE_HZ, "unit_string": "N"}
            file.write_segment([GroupObject(f"1-{k}"), ChannelObject(f"1-{k}", "force", part[0].astype("i2"), about), ChannelObject(f"1-{k}", "sound", part[1].astype("i2"))])
path = case("tdms_scaled", 'name = "{location}.tdms"\n' + TAP + NAMES + RATE)
for k in range(TAPS):
    # Stored counts are the physical values times 1000, less 500.
    scale = {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Linear", "NI_Scale[0]_Linear_Slope": 1e-3, "NI_Scale[0]_Linear_Y_Intercept": 0.0, "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF}
    with TdmsWriter(path(f"{k}.tdms")) as file:
        force, sound = counts(k)
        file.write_segment([ChannelObject("g", "force", force.astype("i2"), scale), ChannelObject("g", "sound", sound.astype("i4"), scale)])
    read = TdmsFile.read(path(f"{k}.tdms"))["g"]["force"][:]
    assert np.allclose(read, force / 1000)


def by_hand(path, order, interleaved, chunks, k):
    """A file of one group as programs other than npTDMS write them."""
    pack = lambda form, *values: struct.pack(order + form, *values)
    text = lambda value: pack("I", len(value)) + value.encode()
    channels = [v.astype(order + "i2") for v in counts(k)]
    each = COUNT // chunks
    about = b"".join(text(f"/'g'/'{name}'") + pack("IIIQ", 20, 2, 1, each) + pack("I", 0) for name in ["force", "sound"])
    about = pack("I", 2) + about
    raw = b""
    for chunk in range(chunks):
        parts = [v[chunk * each : (chunk + 1) * each] for v in channels]
        raw += np.stack(parts, axis=1).astype(order + "i2").tobytes() if interleaved else b"".join(part.tobytes() for part in parts)
    contents = (1 << 1) | (1 << 2) | (1 << 3) | (interleaved << 5) | ((order == ">") << 6)
    lead = b"TDSm" + struct.pack("<I", contents) + pack("I", 4713)
    with open(path, "wb") as file:
        file.write(lead + pack("QQ", len(about) + len(raw), len(about)) + about + raw)
    read = TdmsFile.read(path)["g"]
    assert (read["force"][:] == channels[0]).all() and (read["sound"][:] == channels[1]).all()


path = case("tdms_layouts", 'name = "{location}.tdms"\n' + TAP + NAMES + RATE)
for k, (order, interleaved, chunks) in enumerate([("<", True, 1), (">", False, 4), (">", True, 2)]):
    by_hand(path(f"{k}.tdms"), order, interleaved, chunks, k)

# Records of all taps, one after the other, 1000 samples from tap to tap; each is a pulse of the force and a ring of the sound.
def record():
    force, sound = np.zeros(4000), np.zeros(4000)
    for k in range(TAPS):
        at = 700 + 1000 * k
        force[at : at + 60] = 20000 * np.sin(np.arange(60) / 59 * np.pi) * (1 - 0.1 * k)
        sound[at + 10 : at + 400] = 9000 * np.sin(np.arange(390) / (3 + k)) * np.exp(-np.arange(390) / 90)
    return force.round().astype("i2"), sound.round().astype("i2")


CUT = NUMBERS + "cut = { sample_count = 200, trigger = { hold_off_s = 0.005 } }\n"
path = case("record_plan", 'name = "{tyre}_{shoulder}.wav"\nplan = { locations = 3, offsets_mm = [5.0] }\n' + CUT)
wav(path("A-17_1.wav"), 2, record())
np.stack(record()).tofile(path("../record.i16"))
path = case("record_table", 'table = "taps.csv"\n' + TAP + RATE + CUT.replace("1", '"force"', 1).replace("2 }", '"sound" }', 1))
with TdmsWriter(path("record.tdms")) as file:
    file.write_segment([ChannelObject("g", name, v) for name, v in zip(["force", "sound"], record())])
with open(path("taps.csv"), "w") as table:
    table.write("file,location\n" + "".join(f"record.tdms,{k}\n" for k in range(TAPS)))
