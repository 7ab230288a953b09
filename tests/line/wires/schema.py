"""Checks messages, a line of JSON each on standard input, by a JSON schema, and the schema by messages that are wrong.

usage: schema.py SCHEMA
"""
import copy
import json
import sys

import jsonschema

with open(sys.argv[1], encoding="utf-8") as file:
    schema = json.load(file)
jsonschema.Draft202012Validator.check_schema(schema)
check = jsonschema.Draft202012Validator(schema)
messages = [json.loads(line) for line in sys.stdin if line.strip()]
for message in messages:
    check.validate(message)


def wrong(message):
    """What a message must not be."""
    for key in message:
        yield {name: value for name, value in message.items() if name != key}
    yield {**message, "more": 1}
    yield {**message, "verdict": "MAYBE"}
    if message["kind"] == "station":
        # A verdict in doubt.
        yield {**message, "state": "judged" if message["verdict"] is None else "busy"}
    else:
        inner = copy.deepcopy(message)
        inner["shoulders"][0]["verdict"] = "pass"
        yield inner
        inner = copy.deepcopy(message)
        del inner["shoulders"][0]["limit_reject"]
        yield inner


for message in messages:
    for altered in wrong(message):
        assert not check.is_valid(altered), altered
print(f"{len(messages)} messages")
