"""An OPC UA client of a line: prints a line of JSON for each event, each result and each change of what stands at a station.

usage: opcua.py URL [--no-acknowledge] [--user NAME PASSWORD] [--pki FOLDER]
With --pki it makes a certificate in FOLDER for itself, prints its path, and waits for a line of input before it connects.
"""
import argparse
import asyncio
import json
import pathlib
import sys

from asyncua import Client, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

RESULT = "http://opcfoundation.org/UA/Machinery/Result/"
LINE = "urn:tapline:line"


def say(**what):
    print(json.dumps(what), flush=True)


def meta(data):
    return {
        "id": data.ResultId,
        "casing": data.PartId,
        "evaluation": int(data.ResultEvaluation),
        "code": data.ResultEvaluationCode,
        "at_ms": int(data.CreationTime.timestamp() * 1000),
        "uri": data.ResultUri[0],
    }


class Events:
    def __init__(self):
        self.ready = asyncio.Event()

    def event_notification(self, event):
        result = event.Result
        say(event=result.ResultMetaData.ResultId, message=event.Message.Text, severity=event.Severity)
        self.ready.set()

    def datachange_notification(self, _node, _value, _data):
        """That the notifier exists; it has no value."""


async def standing(nodes):
    """What a station's nodes have, read one after the other."""
    values = []
    for node in nodes:
        value = await node.read_data_value(raise_on_bad_status=False)
        values.append(value.Value.Value if value.StatusCode.is_good() else value.StatusCode.name)
    state, evaluation, result = values
    shows = result if isinstance(result, str) else result.ResultMetaData.ResultId
    return {"state": state, "evaluation": evaluation, "shows": shows}


async def follow(client, arguments):
    await client.load_data_type_definitions()
    ns, own = await client.get_namespace_index(RESULT), await client.get_namespace_index(LINE)
    line = await client.nodes.objects.get_child(f"{own}:tapline")
    management = await line.get_child(f"{ns}:ResultManagement")
    stations = {}
    for node in await line.get_children():
        name = (await node.read_browse_name()).Name
        if name.startswith("Station"):
            stations[name] = [await node.get_child(f"{own}:{part}") for part in ("State", "ResultEvaluation")]
            stations[name].append(await management.get_child([f"{ns}:Results", f"{own}:{name}"]))
    events = Events()
    subscription = await client.create_subscription(50, events)
    event_type = client.get_node(ua.NodeId(1002, ns))
    # The server does not know the operator InList, which the client would ask for types with.
    await subscription.subscribe_events(management, evtypes=[event_type], queuesize=100, where_clause_generation=False)
    say(connected=sorted(stations), type=(await (await management.get_child(f"{ns}:Results")).read_browse_name()).Name)
    call = lambda name, *values: management.call_method(f"{ns}:{name}", *values)
    no_filter = ua.Variant(ua.ContentFilter(), ua.VariantType.ExtensionObject)
    no_order = ua.Variant([], ua.VariantType.ExtensionObject, is_array=True)
    shown, seen = {}, set()
    while True:
        for name, nodes in stations.items():
            now = await standing(nodes)
            # A verdict may come between two reads.
            if now != await standing(nodes):
                continue
            if shown.get(name) != now:
                shown[name] = now
                say(station=name, **now)
        _handle, ids, error = await call("GetResultIdListFiltered", no_filter, no_order, ua.UInt32(0), ua.Int32(0))
        assert error == 0, error
        for one in ids or []:
            if one in seen and arguments.no_acknowledge:
                continue
            seen.add(one)
            _handle, result, error = await call("GetResultById", one, ua.Int32(0))
            assert error == 0, error
            say(result=meta(result.ResultMetaData), verdict=json.loads(result.ResultContent[0].Value if hasattr(result.ResultContent[0], "Value") else result.ResultContent[0]))
            if not arguments.no_acknowledge:
                # As after an answer that was lost: the second one is refused, and changes nothing.
                first = await call("AcknowledgeResults", [one])
                second = await call("AcknowledgeResults", [one])
                say(acknowledged=one, first=first, second=second)
        _handle, latest, error = await call("GetLatestResult", ua.Int32(0))
        latest = meta(latest.ResultMetaData)["id"] if error == 0 else None
        if shown.get("latest", "") != latest:
            shown["latest"] = latest
            say(latest=latest)
        unknown = await call("GetResultById", "0123456789abcdef", ua.Int32(0))
        assert unknown[2] == -1, unknown
        events.ready.clear()
        try:
            await asyncio.wait_for(events.ready.wait(), 0.1)
        except asyncio.TimeoutError:
            pass


async def secure(client, folder):
    """Sets up encryption, with a certificate of its own."""
    from cryptography.x509.oid import ExtendedKeyUsageOID
    from asyncua.crypto.cert_gen import setup_self_signed_certificate

    key, certificate = folder / "client-key.pem", folder / "client.der"
    uri = "urn:tapline:test-client"
    await setup_self_signed_certificate(key, certificate, uri, "localhost", [ExtendedKeyUsageOID.CLIENT_AUTH], {})
    say(certificate=str(certificate))
    sys.stdin.readline()
    client.application_uri = uri
    await client.set_security(SecurityPolicyBasic256Sha256, certificate=str(certificate), private_key=str(key))


async def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("url")
    parser.add_argument("--no-acknowledge", action="store_true")
    parser.add_argument("--user", nargs=2)
    parser.add_argument("--pki", type=pathlib.Path)
    arguments = parser.parse_args()
    client = Client(arguments.url, timeout=5)
    if arguments.user:
        client.set_user(arguments.user[0])
        client.set_password(arguments.user[1])
    try:
        if arguments.pki:
            await secure(client, arguments.pki)
        async with client:
            await follow(client, arguments)
    except (ConnectionError, asyncio.TimeoutError, asyncio.CancelledError, ua.UaError) as error:
        say(lost=f"{type(error).__name__}: {error}")


asyncio.run(main())
