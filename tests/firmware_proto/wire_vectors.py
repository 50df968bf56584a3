"""vectors.json as the tests of every codec want it."""

import json
from pathlib import Path

import pytest

import firmware_proto
from firmware_proto import Channel, Command, CommandAnswer, Frame, LevelChannel, Measured, VectorChannel
from firmware_proto.measured import MeasuredMessage

VECTORS = json.loads((Path(firmware_proto.__file__).parent / "vectors.json").read_text(encoding="utf-8"))


def by_name(values):
    return [pytest.param(value, id=value["name"]) for value in values]


def as_frame(value):
    return Frame(value["sequence"], value["status"], tuple(Channel(**c) for c in value["channels"]))


FRAMES = {value["name"]: as_frame(value) for value in VECTORS["frames"]}


def as_message(value):
    if value["type"] == "command":
        return Command(value["number"], value["command"], tuple(value["values"]))
    if value["type"] == "answer":
        return CommandAnswer(value["number"], value["command"], value["result"], tuple(value["values"]), value["text"])
    kind = VectorChannel if value["type"] == "vector" else LevelChannel
    channels = tuple(kind(**c) for c in value["channels"])
    return MeasuredMessage(value["sequence"], value["status"], Measured(value["time_ms"], channels))


MESSAGES = {value["name"]: as_message(value) for value in VECTORS["messages"]}


def follow(feed, stream, one_byte_a_call, kind="frames", known=FRAMES):
    """Feed a stream's steps, whole or byte by byte; each has to bring the frames that it says."""
    for step in stream["steps"]:
        data = bytes.fromhex(step["hex"])
        chunks = [data[k : k + 1] for k in range(len(data))] if one_byte_a_call and data else [data]
        came = [one for chunk in chunks for one in feed(chunk, step["t"])]
        assert came == [known[name] for name in step[kind]]


def follow_messages(feed, stream, one_byte_a_call):
    """As `follow`, of message_streams."""
    follow(feed, stream, one_byte_a_call, "messages", MESSAGES)
