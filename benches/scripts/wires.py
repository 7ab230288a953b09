#!/usr/bin/env python3
"""Runs a line of eight simulated stations with an MQTT broker, an OPC UA client and a Modbus controller at once, kills the broker and
the line at random, and compares the verdicts that each client received with those in the archives.

usage: wires.py TAPLINE [SECONDS] [SEED] [WORK_FOLDER]
Needs mosquitto, and asyncua, paho-mqtt and pymodbus (tests/python.txt). Prints how many verdicts each client has, how many came
again, and what is lost or wrong; exits with 1 if anything is.
"""
import asyncio
import csv
import io
import json
import os
import random
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time

from asyncua import Client, ua
from paho.mqtt import client as mqtt
from pymodbus.client import AsyncModbusTcpClient

STATIONS = 8
HEAD = """
[line]
on_verdict = '''cat >> {folder}/hook.txt'''
[line.mqtt]
broker = "127.0.0.1:{mqtt}"
[line.opcua]
listen = "127.0.0.1:{opcua}"
[line.modbus]
listen = "127.0.0.1:{modbus}"
[fuse]
reference = "self"
[simulation]
sample_count = 4096
[acquire]
taps_per_s = 60
[scan]
locations = 24
confirm = false
"""
RESULT = "http://opcfoundation.org/UA/Machinery/Result/"
WORDS = {1: "PASS", 2: "RE-INSPECT", 3: "REJECT"}


class Received:
    """What one client has received: the verdict of each id; how often one came again; what contradicts."""

    def __init__(self):
        self.verdicts, self.again, self.wrong = {}, 0, []

    def take(self, one, verdict):
        before = self.verdicts.setdefault(one, verdict)
        if before != verdict:
            self.wrong.append((one, before, verdict))
        return before is verdict

    def take_or_count(self, one, verdict):
        self.again += one in self.verdicts
        self.take(one, verdict)


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def subscribe(port, received, doubts):
    """A subscriber that starts anew with each connection: what it has missed the line must tell it."""
    client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, client_id="plant", protocol=mqtt.MQTTv5)
    client.reconnect_delay_set(0.1, 0.5)

    def on_message(_client, _data, message):
        payload = json.loads(message.payload)
        if payload["kind"] == "verdict":
            received.take_or_count(payload["id"], (payload["casing"], payload["verdict"]))
        elif (payload["state"] == "judged") != (payload["verdict"] is not None):
            doubts.append(payload)

    client.on_connect = lambda client, *_: client.subscribe("tapline/#", qos=1)
    client.on_message = on_message
    while True:
        try:
            client.connect("127.0.0.1", port, keepalive=5)
            break
        except OSError:
            time.sleep(0.1)
    client.loop_start()
    return client


async def follow_opcua(port, received, over):
    while not over.is_set():
        try:
            async with Client(f"opc.tcp://127.0.0.1:{port}", timeout=4) as client:
                await client.load_data_type_definitions()
                ns, own = await client.get_namespace_index(RESULT), await client.get_namespace_index("urn:tapline:line")
                management = await client.nodes.objects.get_child([f"{own}:tapline", f"{ns}:ResultManagement"])
                call = lambda name, *values: management.call_method(f"{ns}:{name}", *values)
                no_filter = ua.Variant(ua.ContentFilter(), ua.VariantType.ExtensionObject)
                no_order = ua.Variant([], ua.VariantType.ExtensionObject, is_array=True)
                while not over.is_set():
                    _, ids, _ = await call("GetResultIdListFiltered", no_filter, no_order, ua.UInt32(0), ua.Int32(0))
                    for one in ids or []:
                        _, result, error = await call("GetResultById", one, ua.Int32(0))
                        if error == 0:
                            meta = result.ResultMetaData
                            received.take_or_count(meta.ResultId, (meta.PartId, WORDS[meta.ResultEvaluationCode]))
                            await call("AcknowledgeResults", [one])
                    await asyncio.sleep(0.1)
        except (OSError, asyncio.TimeoutError, asyncio.CancelledError, ua.UaError, RuntimeError):
            await asyncio.sleep(0.2)


async def follow_modbus(port, received, over, doubts):
    while not over.is_set():
        client = AsyncModbusTcpClient("127.0.0.1", port=port, timeout=2, retries=0, reconnect_delay=0)
        try:
            if not await client.connect():
                raise OSError("not there")
            while not over.is_set():
                for place in range(STATIONS):
                    block = await client.read_holding_registers(place * 64, count=64)
                    if block.isError():
                        raise OSError(str(block))
                    block = block.registers
                    if sum(block[4:7]) > block[2] or block[2] + block[3] != (block[1] != 0):
                        doubts.append(block[:8])
                    if block[16]:
                        raw = struct.pack(">64H", *block)
                        casing = raw[56:88].rstrip(b"\0").decode()
                        received.take_or_count(raw[40:48].hex(), (casing, WORDS[block[18]]))
                        await client.write_register(place * 64 + 17, block[16])
                await asyncio.sleep(0.05)
        except Exception:  # the line was killed
            await asyncio.sleep(0.2)
        finally:
            client.close()


class Plant:
    def __init__(self, tapline, folder):
        self.tapline, self.folder = tapline, folder
        self.ports = {name: free_port() for name in ["mqtt", "opcua", "modbus"]}
        head = HEAD.format(folder=folder, **self.ports)
        station = '[[station]]\nnumber = {}\nsource = "{}"\n{}\n'
        os.makedirs(f"{folder}/inbox")
        busy = "".join(station.format(k + 1, "simulated", "") for k in range(STATIONS))
        idle = "".join(station.format(k + 1, "folder", f'folder = "{folder}/inbox/{k + 1}"') for k in range(STATIONS))
        for name, stations in [("busy", busy), ("idle", idle)]:
            with open(f"{folder}/{name}.toml", "w", encoding="utf-8") as file:
                file.write(head + stations)
        with open(f"{folder}/mosquitto.conf", "w", encoding="utf-8") as file:
            file.write(f"listener {self.ports['mqtt']} 127.0.0.1\nallow_anonymous true\npersistence false\nuser root\n")
        self.broker = self.line = None

    def start_broker(self):
        program = shutil.which("mosquitto", path=os.environ["PATH"] + ":/usr/sbin")
        command = [program, "-c", f"{self.folder}/mosquitto.conf"]
        self.broker = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def start_line(self, name):
        command = [self.tapline, "line", "--config", f"{self.folder}/{name}.toml", "--out", f"{self.folder}/out", "--json"]
        log = open(f"{self.folder}/line.log", "ab")
        printed = open(f"{self.folder}/printed.txt", "ab")
        self.line = subprocess.Popen(command, stdout=printed, stderr=log, stdin=subprocess.DEVNULL)

    def unreported(self):
        return len(os.listdir(f"{self.folder}/out/unreported"))

    def archived(self):
        """Casing and verdict of each archive, by its path."""
        days = [day for day in sorted(os.listdir(f"{self.folder}/out")) if day[0].isdigit()]
        found = {}
        for day in days:
            folder = f"{self.folder}/out/{day}"
            table = subprocess.run([self.tapline, "export", folder, "verdicts"], capture_output=True, text=True, check=True).stdout
            order = ["PASS", "RE-INSPECT", "REJECT"]
            for row in csv.DictReader(io.StringIO(table)):
                path = os.path.join(folder, os.path.basename(row["file"]))
                path = path if path.endswith(".h5") else path + ".h5"
                found[path] = max(found.get(path, "PASS"), row["verdict"], key=order.index)
        return found


def harm(plant, seconds, chance):
    """Kills the broker every few seconds, and the line now and then; returns how often."""
    until, brokers, lines = time.time() + seconds, 0, 0
    while time.time() < until:
        time.sleep(chance.uniform(2, 6))
        if chance.random() < 0.25:
            plant.line.kill()
            plant.line.wait()
            lines += 1
            plant.start_line("busy")
        else:
            plant.broker.kill()
            plant.broker.wait()
            brokers += 1
            time.sleep(chance.uniform(0, 2))
            plant.start_broker()
        if plant.line.poll() is not None:
            raise SystemExit(f"the line has ended with {plant.line.returncode}: see {plant.folder}/line.log")
    return brokers, lines


def drain(plant, patience=120):
    """Ends the line, and starts it without casings until everyone has what is left."""
    plant.line.send_signal(signal.SIGINT)
    plant.line.wait(timeout=180)
    left = plant.unreported()
    plant.start_line("idle")
    until = time.time() + patience
    while plant.unreported() and time.time() < until:
        time.sleep(0.2)
    plant.line.send_signal(signal.SIGINT)
    plant.line.wait(timeout=60)
    return left


def lines_of(path):
    """The verdicts of a file with a line of JSON each; a line that a kill has cut short is left out."""
    with open(path, encoding="utf-8", errors="replace") as file:
        for line in file:
            try:
                yield json.loads(line)
            except ValueError:
                continue


def compare(plant, clients):
    archived = plant.archived()
    hook = Received()
    told = {}
    for verdict in lines_of(f"{plant.folder}/hook.txt"):
        hook.take_or_count(verdict["id"], (verdict["casing"], verdict["verdict"]))
        told[verdict["id"]] = verdict["file"]
    printed = Received()
    for verdict in lines_of(f"{plant.folder}/printed.txt"):
        printed.take_or_count(verdict["id"], (verdict["casing"], verdict["verdict"]))
    # By the hook's lines an id is known to be that of a file.
    expected = {one: archived[path] for one, path in told.items() if path in archived}
    failed = len(expected) != len(archived)
    print(f"{len(archived)} archives, {len(expected)} of them told to on_verdict")
    for name, received in [("printed", printed), ("on_verdict", hook), *clients.items()]:
        got = {one: verdict for one, (_casing, verdict) in received.verdicts.items()}
        lost = expected.keys() - got.keys()
        wrong = [one for one in got if got[one] != expected.get(one)] + received.wrong
        print(f"{name}: {len(got)} verdicts, {received.again} came again with the same id, {len(lost)} lost, {len(wrong)} wrong")
        failed |= bool(lost or wrong)
    return failed


def main():
    tapline = os.path.abspath(sys.argv[1])
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 60
    chance = random.Random(int(sys.argv[3]) if len(sys.argv) > 3 else 1)
    folder = os.path.abspath(sys.argv[4]) if len(sys.argv) > 4 else tempfile.mkdtemp(prefix="wires-")
    os.makedirs(folder, exist_ok=True)
    plant = Plant(tapline, folder)
    clients, doubts, over = {name: Received() for name in ["mqtt", "opcua", "modbus"]}, [], threading.Event()
    plant.start_broker()
    subscriber = subscribe(plant.ports["mqtt"], clients["mqtt"], doubts)
    plant.start_line("busy")

    async def follow():
        opcua = follow_opcua(plant.ports["opcua"], clients["opcua"], over)
        modbus = follow_modbus(plant.ports["modbus"], clients["modbus"], over, doubts)
        await asyncio.gather(opcua, modbus)

    thread = threading.Thread(target=lambda: asyncio.run(follow()), daemon=True)
    thread.start()
    brokers, lines = harm(plant, seconds, chance)
    left = drain(plant)
    over.set()
    thread.join(timeout=10)
    subscriber.loop_stop()
    plant.broker.kill()
    print(f"{seconds:.0f} s, {STATIONS} stations: broker killed {brokers} times, line killed {lines} times; {left} verdicts told after the end")
    failed = compare(plant, clients)
    print(f"{plant.unreported()} verdicts still wait; {len(doubts)} times a verdict stood in doubt")
    failed |= bool(plant.unreported() or doubts)
    print("failed" if failed else "every verdict was received by everyone, none is wrong")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
