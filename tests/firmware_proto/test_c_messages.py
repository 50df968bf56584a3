"""The C code of messages: what it is made of, vectors.json, its requests, and that sanitizers find nothing."""

import ctypes
import re

import pytest

from firmware_proto import Channel, Command, CommandAnswer, Frame, encode
from firmware_proto.commands import encode_answer, encode_command
from tests.every import every
from tests.firmware_proto.wire_vectors import MESSAGES, VECTORS, by_name, follow_messages
from tools.codecs.c_frames import CDecoder
from tools.codecs.c_messages import CMessageDecoder, Request, _Answer

MARK = Command(7, "mark", (3,))
DONE = CommandAnswer(7, "mark", "done")


@every("value", by_name(VECTORS["messages"]))
def test_message(code, value):
    raw, message = bytes.fromhex(value["hex"]), MESSAGES[value["name"]]
    assert CMessageDecoder(code).feed(raw, 0.0) == [message]
    if isinstance(message, Command | CommandAnswer):
        assert code.encode(message) == raw
        assert [code.encode(message, capacity) for capacity in range(len(raw))] == [b""] * len(raw)


@every("one_byte_a_call", [False, True])
@every("epoch_ms", [0, 2**32 - 100])
@every("value", by_name(VECTORS["message_streams"]))
def test_stream(code, value, epoch_ms, one_byte_a_call):
    decoder = CMessageDecoder(code, epoch_ms)
    follow_messages(decoder.feed, value, one_byte_a_call)
    assert {name: getattr(decoder, name) for name in value["counters"]} == value["counters"]


def test_only_what_is_wanted_comes(code):
    raw = encode_command(MARK) + encode_answer(DONE) + encode(Frame(1, 1, (Channel(1, 1, 300, 5),)))
    answers = CMessageDecoder(code, want=8)
    assert answers.feed(raw, 0.0) == [DONE]
    assert answers.dropped == len(raw) - len(encode_answer(DONE))
    assert CMessageDecoder(code, want=4).feed(raw, 0.0) == [MARK]
    assert CMessageDecoder(code, want=3).feed(raw, 0.0) == []


WRONG = [
    CommandAnswer(1, "mark", "done", (), "a\x01"),
    CommandAnswer(1, "mark", "done", (), "a,b"),
    CommandAnswer(1, "mark", "done", (1, 2, 3, 4, 5)),
    Command(1, "mark", (1, 2, 3, 4, 5)),
]


def test_the_decoder_of_frames_as_it_stands_delivers_every_frame_between_messages_at_once(codec):
    decoder, sent, skipped = CDecoder(codec), 0, 0
    for k, value in enumerate(VECTORS["messages"]):
        message, frame = bytes.fromhex(value["hex"]), Frame(k % 256, 1, (Channel(1, 1, 300, 5),))
        assert decoder.feed(message + encode(frame), 0.0) == [frame]
        sent, skipped = sent + 1, skipped + len(message)
    assert (decoder.good, decoder.bad_crc, decoder.dropped, decoder.lost) == (sent, 0, skipped, 0)


@pytest.mark.parametrize("wrong", WRONG)
def test_what_does_not_fit_is_not_written(code, wrong):
    assert code.encode(wrong) == b""


class Host:
    """A host with one request."""

    def __init__(self, code):
        self.library, self.request, self.out = code.library, Request(), ctypes.create_string_buffer(64)

    def send(self, now_ms, name_code, *values):
        array = (ctypes.c_int32 * 8)(*values)
        size = self.library.arva_command_send(ctypes.byref(self.request), name_code, array, len(values),
                                              ctypes.c_uint32(now_ms), self.out, ctypes.c_size_t(64))  # fmt: skip
        return self.out.raw[:size]

    def again(self, now_ms):
        size = self.library.arva_command_again(
            ctypes.byref(self.request), ctypes.c_uint32(now_ms), self.out, ctypes.c_size_t(64)
        )
        return self.out.raw[:size]

    def answered(self, number, code):
        answer = _Answer(number, code)
        return bool(self.library.arva_command_answered(ctypes.byref(self.request), ctypes.byref(answer)))


def test_a_request_is_sent_again_until_its_own_answer_comes(code):
    host, start = Host(code), 2**32 - 500
    raw = encode_command(Command(1, "mark", (3,)))
    assert host.again(start) == b""
    assert host.send(start, 2, 3) == raw
    assert host.again(start + 999) == b""
    assert host.again(start + 1000 & 0xFFFFFFFF) == raw
    assert host.again(start + 1999 & 0xFFFFFFFF) == b""
    assert not host.answered(2, 2)
    assert not host.answered(1, 3)
    assert host.answered(1, 2)
    assert not host.answered(1, 2)
    assert host.again(start + 5000 & 0xFFFFFFFF) == b""
    assert host.send(start, 7) == encode_command(Command(2, "scan"))


def test_a_restart_is_not_sent_again(code):
    host = Host(code)
    assert host.send(0, 5) == encode_command(Command(1, "restart"))
    assert host.again(5000) == b""
    assert host.answered(1, 5)


def test_too_many_values_change_nothing(code):
    host = Host(code)
    assert host.send(0, 2, 1, 2, 3, 4, 5) == b""
    assert host.send(0, 2, 3) == encode_command(Command(1, "mark", (3,)))


def test_python_and_c_make_the_same_of_the_same_bytes(run_tool):
    assert "2000 streams, no difference" in run_tool("tools", "fuzz", "codecs", "messages", "2000", "--no-lua")


def test_sanitizers_find_nothing(run_tool):
    output = run_tool("tools", "fuzz", "c", "messages", "--runs", "5000", "--without-clang")
    assert int(re.fullmatch(r"(\d+) delivered, nothing found\n", output)[1]) > 5000
