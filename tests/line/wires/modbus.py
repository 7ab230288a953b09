"""A controller of a line, over Modbus TCP: acknowledges verdicts, and prints a line of JSON for each one and for each change of what stands
at a station. Every read is made with both functions, which must agree.

usage: modbus.py HOST:PORT STATIONS [--no-acknowledge]
"""
import argparse
import json
import struct
import time

from pymodbus.client import ModbusTcpClient

BLOCK, ACKNOWLEDGE = 64, 17
WORDS = {1: "PASS", 2: "RE-INSPECT", 3: "REJECT"}


def say(**what):
    print(json.dumps(what), flush=True)


def mail(block):
    raw = struct.pack(">64H", *block)
    return {
        "number": block[16],
        "verdict": WORDS[block[18]],
        "id": raw[40:48].hex(),
        "at_ms": struct.unpack(">Q", raw[48:56])[0],
        "casing": raw[56:88].rstrip(b"\0").decode(),
    }


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("address")
    parser.add_argument("stations", type=int)
    parser.add_argument("--no-acknowledge", action="store_true")
    arguments = parser.parse_args()
    host, port = arguments.address.rsplit(":", 1)
    client = ModbusTcpClient(host, port=int(port), timeout=3, retries=0)
    assert client.connect()
    # What is no register, and what may not be written.
    waiting = client.read_holding_registers(16, count=1).registers[0]
    for refused in [
        client.read_holding_registers(arguments.stations * BLOCK, count=1),
        client.write_register(4, 1),
        client.write_register(ACKNOWLEDGE, waiting % 65000 + 500),
        client.read_coils(0, count=1),
    ]:
        assert refused.isError(), refused
    say(connected=arguments.address)
    shown, told = {}, set()
    while True:
        for place in range(arguments.stations):
            start = place * BLOCK
            block = client.read_holding_registers(start, count=BLOCK)
            if block.isError():
                return say(lost=str(block))
            block = block.registers
            # The two halves of one read are of one moment: a verdict and its number belong together.
            if block[16] and (place, block[16]) not in told:
                told.add((place, block[16]))
                say(place=place, mail=mail(block))
            if block[16] and not arguments.no_acknowledge:
                answer = client.write_register(start + ACKNOWLEDGE, block[16])
                assert not answer.isError(), answer
                again = client.write_registers(start + ACKNOWLEDGE, [block[16]])
                assert not again.isError(), again
            now = dict(zip(["station", "ready", "busy", "ok", "re_inspect", "not_ok", "count"], [block[0], *block[2:8]]))
            now["beats"] = block[1] != 0
            if shown.get(place) != now:
                shown[place] = now
                say(place=place, now=now, heartbeat=block[1])
        time.sleep(0.02)


try:
    main()
except Exception as error:  # the connection was lost
    say(lost=f"{type(error).__name__}: {error}")
