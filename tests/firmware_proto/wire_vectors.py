"""vectors.json as the tests of every codec want it."""

import json
from pathlib import Path

import pytest

import firmware_proto
from firmware_proto import Channel, Frame

VECTORS = json.loads((Path(firmware_proto.__file__).parent / "vectors.json").read_text(encoding="utf-8"))


def by_name(values):
    return [pytest.param(value, id=value["name"]) for value in values]


def as_frame(value):
    return Frame(value["sequence"], value["status"], tuple(Channel(**c) for c in value["channels"]))


FRAMES = {value["name"]: as_frame(value) for value in VECTORS["frames"]}


def follow(feed, stream, one_byte_a_call):
    """Feed a stream's steps, whole or byte by byte; each has to bring the frames that it says."""
    for step in stream["steps"]:
        data = bytes.fromhex(step["hex"])
        chunks = [data[k : k + 1] for k in range(len(data))] if one_byte_a_call and data else [data]
        frames = [frame for chunk in chunks for frame in feed(chunk, step["t"])]
        assert frames == [FRAMES[name] for name in step["frames"]]
