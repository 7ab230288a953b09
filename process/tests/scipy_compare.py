"""Compares the extractor with scipy on folders of recorded taps (tap sets) and prints the worst disagreement.

    cargo build --release -p tapline-process --example recorded
    python3 scipy_compare.py ../../target/release/examples/recorded TAP_SET...
"""
import csv
import io
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.io import wavfile

from scipy_definitions import NAMES, discriminators


def setting(text, key):
    return json.loads(re.search(rf"^{key}\s*=\s*(.+?)\s*(#.*)?$", text, re.M).group(1))


def compare(program, folder):
    scan = (folder / "scan.toml").read_text()
    fs, p, channels = (setting(scan, key) for key in ["sample_rate_hz", "pre_trigger_samples", "channels"])
    paths = sorted(str(path) for path in folder.glob("*.wav"))
    expected = {}
    for path in paths:
        _, samples = wavfile.read(path)
        scale = 1 / 32768 if samples.dtype == np.int16 else 1.0
        planar = samples.reshape(len(samples), -1).T.astype(np.float64) * scale
        by_kind = dict(zip(channels, planar))
        expected[path] = discriminators(by_kind.get("force"), by_kind.get("sound"), float(fs), p)
    for precision in ["f64", "f32"]:
        out = subprocess.run([program, precision, str(fs), str(p), ",".join(channels), *paths], text=True,
                             capture_output=True, check=True).stdout
        worst, differing, flags = dict.fromkeys(NAMES, 0.0), 0, {}
        for row in csv.reader(io.StringIO(out.split("\n", 1)[1])):
            flags[row[8]] = flags.get(row[8], 0) + 1
            for name, cell in zip(NAMES, row[1:8]):
                known = expected[row[0]].get(name)
                if (known is None) != (cell == ""):
                    differing += 1
                    print(f"  {row[0]}: {name} is {cell or 'absent'}, scipy {known}")
                elif known is not None:
                    worst[name] = max(worst[name], abs(float(cell) / known - 1))
        errors = "  ".join(f"{name} {error:.1e}" for name, error in worst.items())
        print(f"{folder.name} {precision}: {len(paths)} taps, {differing} present on one side only; {errors}; {flags}")


for name in sys.argv[2:]:
    compare(sys.argv[1], Path(name))
