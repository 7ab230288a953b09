#!/usr/bin/env python3
"""Stations that listen in real time: taps lost, overruns, and CPU of each station.

Usage: listen.py TAPLINE [STATIONS] [SECONDS]

Each station has a sound card that is a pipe, into which a simulated rig plays its hits. At the end every hit that was made must be
in the archive or under way, and nothing may have been refused or lost.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import time

CAPTURE = """
[capture]
sample_rate_hz = 40960
[capture.trigger]
level = 0.02
[scan]
confirm = false
"""


def cpu_s(pid):
    """CPU time of a process so far, and its name."""
    with open(f"/proc/{pid}/stat") as file:
        name, rest = re.search(r"\((.*)\) (.*)", file.read()).groups()
    fields = rest.split()
    return name, (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def children(pid):
    with open(f"/proc/{pid}/task/{pid}/children") as file:
        return [int(child) for child in file.read().split()]


def main():
    tapline = os.path.realpath(sys.argv[1])
    stations = int(sys.argv[2]) if len(sys.argv) > 2 else 2
    seconds = float(sys.argv[3]) if len(sys.argv) > 3 else 600.0
    with tempfile.TemporaryDirectory() as folder:
        cards, plant, rigs = ["pcm.null { type null }"], [CAPTURE], []
        for number in range(1, stations + 1):
            pipe = os.path.join(folder, f"card{number}.pcm")
            os.mkfifo(pipe)
            cards.append(
                f'pcm.card{number} {{ type file slave.pcm null file /dev/null infile "{pipe}" format raw }}'
            )
            script = os.path.join(folder, f"rig{number}.toml")
            with open(script, "w") as file:
                file.write(f'play = "{pipe}"\npattern = "C{number}-{{}}"\nhit_s = 0.12\n[simulation]\nsample_count = 2600\n')
            rig = subprocess.Popen(
                [tapline, "rig", "--listen", "127.0.0.1:0", "--config", script], stdout=subprocess.PIPE, text=True
            )
            rigs.append(rig)
            address = rig.stdout.readline().split()[-1]
            plant.append(
                f'[[station]]\nnumber = {number}\nsource = "alsa"\ndevice = "card{number}"\nrig = "{address}"\n'
            )
        with open(os.path.join(folder, "asound.conf"), "w") as file:
            file.write("\n".join(cards))
        with open(os.path.join(folder, "plant.toml"), "w") as file:
            file.write("\n".join(plant))
        env = dict(os.environ, ALSA_CONFIG_PATH=os.path.join(folder, "asound.conf"), XDG_RUNTIME_DIR=folder)
        with open(os.path.join(folder, "log"), "w") as log:
            line = subprocess.Popen(
                [tapline, "line", "--config", "plant.toml", "--out", "out", "--reference", "self", "--json"],
                cwd=folder, env=env, stdout=subprocess.PIPE, stderr=log, text=True,
            )
            time.sleep(3)
            before = {pid: cpu_s(pid) for pid in children(line.pid)}
            start = time.monotonic()
            time.sleep(seconds)
            took = time.monotonic() - start
            after = {pid: cpu_s(pid) for pid in children(line.pid)}
            status = subprocess.run(
                [tapline, "status", "--out", os.path.join(folder, "out"), "--json"], env=env, capture_output=True, text=True
            )
            line.terminate()
            verdicts = [json.loads(text) for text in line.stdout if text.startswith("{")]
            line.wait()
        for rig in rigs:
            rig.terminate()
            report = rig.stdout.read()
            print("rig:", report.strip())
        with open(os.path.join(folder, "log")) as log:
            text = log.read()
        archived = sum(verdict.get("archived", 0) for verdict in verdicts if verdict.get("kind") == "verdict")
        refused = sum(verdict.get("refused", 0) for verdict in verdicts if verdict.get("kind") == "verdict")
        print(f"{took:.0f} s, {stations} stations: {len(verdicts)} casings, {archived} taps in them, {refused} refused")
        for what in ["has lost", "nothing was heard", "more than once", "not asked for", "not taken in time"]:
            print(f"  {what!r}: {text.count(what)} times in the log")
        for pid, (name, cpu) in after.items():
            if pid in before:
                print(f"  {name:20} {100 * (cpu - before[pid][1]) / took:6.2f} % of a core")
        print("status:", status.stdout.strip()[:300])


if __name__ == "__main__":
    main()
