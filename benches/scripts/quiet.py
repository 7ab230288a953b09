#!/usr/bin/env python3
"""Cost of a line in real time: CPU per tap, and the time from a tap to its discriminators, by the number of stations.

usage: quiet.py TAPLINE [STATIONS ...]
Every station takes 2.5 taps a second for 24 s. CPU is the sum over all processes of the line, from 8 s to 20 s after its start.
"""
import json
import os
import subprocess
import sys
import tempfile
import time

CONFIG = """
[scan]
offsets_mm = [0.0]
velocities_m_per_s = [1.85]
repetitions = 1
locations = 30
closing_tap = false
[acquire]
taps_per_s = 2.5
[fuse]
reference = "self"
"""


def tree(pid):
    pids = [pid]
    for pid in pids:
        try:
            with open(f"/proc/{pid}/task/{pid}/children", encoding="utf-8") as file:
                pids += [int(child) for child in file.read().split()]
        except FileNotFoundError:
            pass
    return pids


def cpu_s(pids):
    ticks = 0
    for pid in pids:
        try:
            with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
                fields = file.read().rsplit(")", 1)[1].split()
            ticks += int(fields[11]) + int(fields[12])
        except FileNotFoundError:
            pass
    return ticks / os.sysconf("SC_CLK_TCK")


def switches(pids):
    count = 0
    for pid in pids:
        for task in os.listdir(f"/proc/{pid}/task"):
            with open(f"/proc/{pid}/task/{task}/status", encoding="utf-8") as file:
                count += sum(int(line.split()[1]) for line in file if "voluntary_ctxt" in line)
    return count


def main():
    tapline = os.path.abspath(sys.argv[1])
    for stations in [int(n) for n in sys.argv[2:]] or [1, 8, 32, 128]:
        with tempfile.TemporaryDirectory() as folder:
            config = os.path.join(folder, "c.toml")
            with open(config, "w", encoding="utf-8") as file:
                file.write(CONFIG)
            command = [tapline, "run", "--config", config, "--stations", str(stations), "--json"]
            command += ["--out", os.path.join(folder, "out.h5")]
            line = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
            time.sleep(8)
            pids, before, switched, at = tree(line.pid), cpu_s(tree(line.pid)), switches(tree(line.pid)), time.time()
            time.sleep(12)
            after, switched_after, took = cpu_s(pids), switches(pids), time.time() - at
            taps = stations * 2.5 * took
            said, _ = line.communicate(timeout=300)
            text = said.strip().splitlines()
            summary = json.loads(text[-1] if text[-1].startswith('{"kind') else said)
            pace = summary["pace"]
            print(
                f"{stations:4} stations: {len(pids):4} processes, {100 * (after - before) / took:6.1f} % of a core, "
                f"{1e3 * (after - before) / taps:6.2f} ms a tap, {(switched_after - switched) / took:7.0f} switches/s; "
                f"tap to discriminators p50 {pace['latency_p50_us'] / 1e3:.2f} ms, p99 {pace['latency_p99_us'] / 1e3:.1f} ms; "
                f"{pace['taps_per_s']:.1f} taps/s",
                flush=True,
            )


if __name__ == "__main__":
    main()
