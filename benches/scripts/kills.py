#!/usr/bin/env python3
"""Kills stages of a line, and the line itself, at random times, and compares every casing's file with that of an undisturbed run.

usage: kills.py TAPLINE [KILLS] [SEED] [WORK_FOLDER]
Prints how many taps are lost, doubled or different; exits with 1 if there are any.
"""
import os
import random
import signal
import subprocess
import sys
import tempfile
import time

CONFIG = """
[scan]
stations = 4
offsets_mm = [0.0, 5.0]
velocities_m_per_s = [1.85]
repetitions = 1
locations = 60
[fuse]
reference = "self"
[[simulation.fault]]
kind = "double_hit"
fraction = 0.02
""" + "".join(
    f"""
[[scan.tyre]]
serial = "K-{k:02}"
station = {1 + k % 4}
"""
    for k in range(12)
)


def run(tapline, folder, out):
    config = os.path.join(folder, "kills.toml")
    with open(config, "w", encoding="utf-8") as file:
        file.write(CONFIG)
    command = [tapline, "run", "--config", config, "--out", out]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=open(out + ".log", "ab"))


def children(pid):
    try:
        with open(f"/proc/{pid}/task/{pid}/children", encoding="utf-8") as file:
            return [int(child) for child in file.read().split()]
    except FileNotFoundError:
        return []


def content(tapline, out):
    files = {}
    for name in sorted(os.listdir(out)):
        if name.endswith(".h5"):
            tables = ["discriminators", "damage", "verdicts", "ledger"]
            path = os.path.join(out, name)
            files[name] = [subprocess.run([tapline, "export", path, t], capture_output=True, check=True).stdout for t in tables]
            checked = subprocess.run([tapline, "verify", path], capture_output=True, text=True)
            if checked.returncode != 0:
                print(f"{name}: verify: {checked.stdout}{checked.stderr}")
                files[name].append(b"not whole")
    return files


def main():
    tapline = os.path.abspath(sys.argv[1])
    kills = int(sys.argv[2]) if len(sys.argv) > 2 else 150
    chance = random.Random(int(sys.argv[3]) if len(sys.argv) > 3 else 1)
    folder = sys.argv[4] if len(sys.argv) > 4 else tempfile.mkdtemp(prefix="kills-")
    calm = os.path.join(folder, "calm")
    assert run(tapline, folder, calm).wait() in (0, 3), "the undisturbed run failed"
    expected = content(tapline, calm)
    done = runs = different = 0
    while done < kills:
        runs += 1
        out = os.path.join(folder, f"killed-{runs}")
        line = run(tapline, folder, out)
        begun = time.time()
        # At most eight per run, because a run without progress shows nothing.
        left = min(8, kills - done)
        while line.poll() is None:
            if time.time() - begun > 180:
                print(f"run {runs} hangs")
                line.kill()
                return 1
            time.sleep(chance.uniform(0.02, 0.4))
            stages = children(line.pid)
            if not left or not stages:
                continue
            target = chance.choice([*stages, line.pid])
            try:
                os.kill(target, signal.SIGKILL)
            except ProcessLookupError:
                continue
            done, left = done + 1, left - 1
            if target == line.pid:
                line.wait()
                line = run(tapline, folder, out)
        if line.returncode not in (0, 3):
            print(f"run {runs} ended with {line.returncode}: see {out}.log")
            return 1
        got = content(tapline, out)
        wrong = [name for name in expected.keys() | got.keys() if expected.get(name) != got.get(name)]
        different += len(wrong)
        print(f"run {runs}: {done} kills, {len(got)} of {len(expected)} files, different: {wrong or 'none'}", flush=True)
    print(f"{done} kills in {runs} runs: {different} files different")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
