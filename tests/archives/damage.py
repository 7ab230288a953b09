#!/usr/bin/env python3
"""Damages copies of archives and runs every verb on each: no signal, no hang, no success with a different outcome.

    tests/archives/damage.py --program target/debug/tapline --copies 1000 --jobs 2

Finished archives, results of `tapline reprocess` and archives under way are damaged by flipped bits, runs of zeros and
truncation. On a damaged copy, every verb must end by itself within --limit seconds, not by a signal. If it exits with 0, its
output and files must be those for the undamaged archive. With an archive under way, `tapline run` must reach the verdicts of
an undisturbed run, or end with an error. Needs only Python 3.9.
"""

import argparse
import concurrent.futures
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CONFIG = """
[scan]
locations = 12
offsets_mm = [0.0]
velocities_m_per_s = [1.85]
repetitions = 2
[[scan.tyre]]
serial = "A"
[fuse]
reference = "self"
"""

TABLES = ["discriminators", "damage", "regions", "verdicts", "ledger"]


def verbs(results):
    """The arguments of each command that is run on `A.h5`, or on the results beside it."""
    name = results or "A.h5"
    commands = [["export", name, table] for table in TABLES]
    commands.append(["export", name, "verdicts", "--format", "parquet", "--out", "out/t.parquet"])
    commands += [
        ["verify", name],
        ["verify", "."],
        ["explain", name, "--shoulder", "A/1", "--location", "3"],
        ["diff", "whole.h5", name],
        ["report", name, "--out", "out/report"],
        ["reference", name, "--shoulder", "A/1", "--shoulder", "A/2", "--out", "out/r.json"],
        ["export", ".", "damage"],
    ]
    if not results:
        commands += [
            ["export", name, "taps", "--out", "out/taps"],
            ["export", name, "taps", "--format", "uff", "--out", "out/uff"],
            ["reprocess", name, "--from-samples", "--jobs", "1"],
            ["repack", name, "--codec", "zstd", "--out", "out/packed.h5"],
        ]
    return commands


def run(program, arguments, folder, limit):
    """Exit code, or what went wrong; standard output and standard error."""
    child = subprocess.Popen(
        [program, *arguments], cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        said, told = child.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        os.killpg(child.pid, signal.SIGKILL)
        child.communicate()
        return "hang", b"", b""
    return (child.returncode if child.returncode >= 0 else f"signal {-child.returncode}"), said, told


def outcome(folder, said, before):
    """A digest of the output, and of every new file."""
    digest = hashlib.sha256(said)
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.relative_to(folder).as_posix() not in before:
            digest.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def lay_out(folder, files):
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "out").mkdir(parents=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)


def damaged(content, dice):
    """A copy, damaged in one of several ways, and the way."""
    content = bytearray(content)
    kind = dice.choice(["flip", "flips", "zeros", "zeros at the beginning", "ones", "noise", "cut", "flip at the beginning"])
    place = dice.randrange(len(content))
    if kind == "cut":
        place = dice.choice([place, dice.randrange(4096), len(content) - 1 - dice.randrange(600)])
        del content[place:]
    elif kind == "flip":
        content[place] ^= 1 << dice.randrange(8)
    elif kind == "flip at the beginning":
        place = dice.randrange(min(len(content), 65536))
        content[place] ^= 1 << dice.randrange(8)
    elif kind == "flips":
        for _ in range(dice.randrange(2, 200)):
            content[dice.randrange(len(content))] = dice.randrange(256)
    else:
        if "beginning" in kind:
            place = dice.randrange(min(len(content), 65536))
        length = min(dice.choice([1, 8, 64, 512, 4096, 65536]), len(content) - place)
        fill = {"noise": dice.randbytes(length), "ones": b"\xff" * length}.get(kind, bytes(length))
        content[place : place + length] = fill
    return bytes(content), f"{kind} at {place}"


class Trial:
    def __init__(self, options, work):
        self.program, self.limit, self.work = str(Path(options.program).resolve()), options.limit, work
        base = work / "base"
        base.mkdir()
        (base / "small.toml").write_text(CONFIG)
        self.must(["run", "--config", "small.toml", "--out", "whole"], base)
        self.must(["reprocess", "whole/A.h5", "--from-samples"], base)
        finished = (base / "whole/A.h5").read_bytes()
        self.results_name = next(path.name for path in (base / "whole").glob("A.*.h5"))
        results = (base / "whole" / self.results_name).read_bytes()
        self.unfinished = self.make_unfinished(base)
        self.kinds = {
            "finished": ("A.h5", None, {"A.h5": finished, "whole.h5": finished}),
            "results": (
                self.results_name, self.results_name, {"A.h5": finished, "whole.h5": finished, self.results_name: results}
            ),
            "unfinished": ("A.h5", None, {"A.h5": self.unfinished, "whole.h5": finished}),
        }
        self.expected = {kind: self.expect(kind) for kind in self.kinds}
        self.verdicts = self.must(["export", "whole/A.h5", "damage"], base)

    def must(self, arguments, folder):
        code, said, told = run(self.program, arguments, folder, 120)
        if code != 0:
            sys.exit(f"{arguments} ended with {code}: {told.decode()}")
        return said

    def make_unfinished(self, base):
        slow = base / "slow"
        arguments = [self.program, "run", "--config", "slow.toml", "--out", "slow"]
        (base / "slow.toml").write_text(CONFIG + "[acquire]\ntaps_per_s = 20.0\n")
        child = subprocess.Popen(arguments, cwd=base, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        time.sleep(2.0)
        child.send_signal(signal.SIGINT)
        child.wait()
        (path,) = (slow / "open").glob("*.h5")
        self.open_name = path.name
        self.run_toml = (slow / "run.toml").read_bytes()
        return path.read_bytes()

    def expect(self, kind):
        name, results, files = self.kinds[kind]
        found = []
        folder = self.work / "expected"
        for arguments in verbs(results):
            twice = set()
            for _ in range(2):
                lay_out(folder, files)
                code, said, _told = run(self.program, arguments, folder, 120)
                twice.add((code, outcome(folder, said, files)))
            if len(twice) != 1:
                print(f"note: `{' '.join(arguments)}` of the undamaged {kind} differs from time to time; only its end is looked at")
            found.append(next(iter(twice)) if len(twice) == 1 else (0, None))
        return found

    def verb_trial(self, number):
        """What goes wrong with one damaged copy, for every verb."""
        dice = random.Random(number)
        kind = ["finished", "finished", "results", "unfinished"][number % 4]
        name, results, files = self.kinds[kind]
        content, how = damaged(files[name], dice)
        folder = self.work / f"copy-{os.getpid()}"
        faults = []
        for arguments, (whole_code, whole_outcome) in zip(verbs(results), self.expected[kind]):
            lay_out(folder, {**files, name: content})
            code, said, told = run(self.program, arguments, folder, self.limit)
            what = None
            if isinstance(code, str):
                what = code
            elif code == 101 or b"panicked" in told:
                what = "panic"
            elif code not in (0, 1, 3):
                what = f"exit code {code}"
            elif code == 0 and whole_code != 0:
                what = "success, where the undamaged one has none"
            elif code == 0 and whole_outcome and outcome(folder, said, files) != whole_outcome:
                what = "success with another outcome"
            elif code != 0 and not told and not said:
                what = f"exit code {code} without a word"
            if what:
                faults.append(f"{number} {kind}, {how}: `{' '.join(arguments)}`: {what}: {told.decode(errors='replace')[:300]}")
        shutil.rmtree(folder, ignore_errors=True)
        return faults

    def run_trial(self, number):
        """What goes wrong if `tapline run` finds a damaged archive under way."""
        content, how = damaged(self.unfinished, random.Random(-1 - number))
        folder = self.work / f"run-{os.getpid()}"
        lay_out(folder, {"slow.toml": (CONFIG + "[acquire]\ntaps_per_s = 20.0\n").encode()})
        (folder / "x/open").mkdir(parents=True)
        (folder / "x/run.toml").write_bytes(self.run_toml)
        (folder / "x/open" / self.open_name).write_bytes(content)
        code, _said, told = run(self.program, ["run", "--config", "slow.toml", "--out", "x"], folder, 60)
        what = None
        if isinstance(code, str):
            what = code
        elif code not in (0, 1, 3) or b"panicked" in told:
            what = f"exit code {code}, or a panic"
        elif code == 0:
            _code, said, _told = run(self.program, ["export", "x/A.h5", "damage"], folder, 60)
            what = None if said == self.verdicts else "success with other numbers"
        shutil.rmtree(folder, ignore_errors=True)
        return [f"{number} under way, {how}: `run`: {what}: {told.decode(errors='replace')[-400:]}"] if what else []


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="target/debug/tapline")
    parser.add_argument("--copies", type=int, default=1000, help="damaged copies that go through every verb")
    parser.add_argument("--runs", type=int, default=50, help="runs that find a damaged archive under way")
    parser.add_argument("--first", type=int, default=0, help="number of the first: the same number is the same damage")
    parser.add_argument("--limit", type=float, default=30.0, help="seconds that a verb may take")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="tapline-damage-") as work:
        trial = Trial(options, Path(work))
        fault_count = 0
        numbers = range(options.first, options.first + options.copies)
        with concurrent.futures.ProcessPoolExecutor(options.jobs) as pool:
            for what, found in (("copies", pool.map(trial.verb_trial, numbers)), ("runs", pool.map(trial.run_trial, range(options.runs)))):
                for done, faults in enumerate(found, 1):
                    fault_count += len(faults)
                    for fault in faults:
                        print(fault, flush=True)
                    if done % 50 == 0:
                        print(f"{done} {what}, {fault_count} faults", flush=True)
        print(f"{options.copies} damaged copies and {options.runs} runs: {fault_count} faults")
        sys.exit(fault_count > 0)


if __name__ == "__main__":
    main()
