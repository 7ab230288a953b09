#!/usr/bin/env python3
"""Sends many casings through one line, and fits memory, descriptors, shared memory and CPU against their number.

usage: flat.py TAPLINE [CASINGS] [STATIONS]
Prints the slope for 1000 casings with its 95 % interval, by stage; exits with 1 if a slope is significant and too large.
"""
import json
import math
import os
import subprocess
import sys
import tempfile
import time

from quiet import cpu_s, tree

CONFIG = """
[simulation]
sample_count = 2048
[scan]
offsets_mm = [0.0]
velocities_m_per_s = [1.85]
repetitions = 1
locations = 20
[fuse]
reference = "self"
"""

# A significant slope is a trend if it exceeds this for 1000 casings.
MATTERS = {"resident MB": 0.5, "descriptors": 0.5, "shared MB": 0.5, "CPU ms a tap": 0.05}


def status_of(tapline, out):
    said = subprocess.run([tapline, "status", "--out", out, "--json"], capture_output=True, text=True, check=False)
    return json.loads(said.stdout) if said.returncode == 0 else None


def resident_mb(pid):
    with open(f"/proc/{pid}/status", encoding="utf-8") as file:
        return sum(int(line.split()[1]) for line in file if line.startswith("RssAnon")) / 1e3


def shared_mb():
    files = [entry for entry in os.scandir("/dev/shm") if entry.name.startswith("tapline_")]
    return sum(entry.stat().st_blocks * 512 for entry in files) / 1e6


def fit(points):
    """Slope for 1000 of x, and half the width of its 95 % interval."""
    n = len(points)
    mean_x, mean_y = (sum(p[k] for p in points) / n for k in (0, 1))
    sxx = sum((x - mean_x) ** 2 for x, _ in points)
    slope = sum((x - mean_x) * (y - mean_y) for x, y in points) / sxx
    rest = sum((y - mean_y - slope * (x - mean_x)) ** 2 for x, y in points)
    return 1e3 * slope, 1e3 * 1.96 * math.sqrt(rest / max(n - 2, 1) / sxx)


def main():
    tapline = os.path.abspath(sys.argv[1])
    casings = int(sys.argv[2]) if len(sys.argv) > 2 else 2000
    stations = int(sys.argv[3]) if len(sys.argv) > 3 else 4
    with tempfile.TemporaryDirectory() as folder:
        config, out = os.path.join(folder, "c.toml"), os.path.join(folder, "out")
        with open(config, "w", encoding="utf-8") as file:
            file.write(CONFIG)
            for number in range(1, stations + 1):
                file.write(f'[[station]]\nnumber = {number}\nsource = "simulated"\n')
        command = [tapline, "line", "--config", config, "--out", out, "--casings", str(casings)]
        begun = time.time()
        line = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        points, last = {}, None
        while line.poll() is None:
            time.sleep(1)
            status = status_of(tapline, out)
            if not status or status["closed_count"] < casings / 10:
                continue
            done, taps = status["closed_count"], status["settled_count"]
            pids = tree(line.pid)
            try:
                names = {pid: open(f"/proc/{pid}/cmdline", "rb").read().split(b"\0")[0].decode() for pid in pids}
                cpu = cpu_s(pids)
                for pid, name in names.items():
                    name = os.path.basename(name)
                    points.setdefault((name, "resident MB"), []).append((done, resident_mb(pid)))
                    points.setdefault((name, "descriptors"), []).append((done, len(os.listdir(f"/proc/{pid}/fd"))))
            except (FileNotFoundError, ProcessLookupError):
                continue
            points.setdefault(("all", "shared MB"), []).append((done, shared_mb()))
            if last and taps > last[1]:
                points.setdefault(("all", "CPU ms a tap"), []).append((done, 1e3 * (cpu - last[0]) / (taps - last[1])))
            last = (cpu, taps)
        print(f"{casings} casings on {stations} stations in {time.time() - begun:.0f} s, exit {line.returncode}")
    is_trend = False
    for (name, what), samples in sorted(points.items()):
        if len(samples) < 5:
            continue
        slope, half = fit(samples)
        stands_out = slope - half > 0 and slope > MATTERS[what]
        is_trend |= stands_out
        mean = sum(y for _, y in samples) / len(samples)
        print(f"{name:18} {what:13} mean {mean:8.2f}, {slope:+7.3f} +- {half:.3f} for 1000 casings{'  TREND' if stands_out else ''}")
    return 1 if is_trend or line.returncode else 0


if __name__ == "__main__":
    sys.exit(main())
