"""The C code of frames and messages: vectors, promises, sanitizers; and bad lines, beside Python."""

from __future__ import annotations

import ctypes
import os
import re
import select
import shutil
import subprocess
import tty
from random import Random

import pytest

from firmware_proto import MAX_CHANNELS, Channel, Command, CommandAnswer, Decoder, Frame, encode
from firmware_proto.commands import encode_answer, encode_command
from tests.every import every
from tests.firmware_proto.wire_vectors import MESSAGES as BY_NAME
from tests.firmware_proto.wire_vectors import VECTORS, as_frame, by_name, follow, follow_messages
from tools.vectors.c_codec import (
    FOLDER,
    MESSAGES,
    NEVER,
    ON_FRAME,
    SOURCE,
    CDecoder,
    CMessageDecoder,
    FrameState,
    MessageState,
    Request,
    _Answer,
    compile_c,
    compiler,
)

ONE = Frame(1, 1, (Channel(1, 2, 300, 12),))
FALSE_LONG = bytes.fromhex("A4570163000010")
INSTALLED = {  # each once, though `cc` is one of them by another name
    os.path.realpath(path): name
    for name in (os.environ.get("CC", "cc"), "gcc", "clang", "arm-none-eabi-gcc")
    if (path := shutil.which(name))
}


def test_no_compiler_is_said_so(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(FileNotFoundError, match=r"no C compiler: none of .* is installed; .* apt-get install gcc"):
        compiler()


@pytest.mark.parametrize(
    ("name", "language"),
    [
        *((name, ("-std=c99",)) for name in list(INSTALLED.values()) or ["cc"]),
        (next(iter(INSTALLED.values()), "cc"), ("-x", "c++", "-std=c++11")),
    ],
)
def test_it_compiles_without_a_warning(tmp_path, name, language):
    for extra in ["-fsyntax-only"] if "clang" in name else ["-O2"]:  # clang warns before it optimizes
        for source in (SOURCE, MESSAGES):
            compile_c(name, tmp_path / "out.o", extra, "-Wshadow", "-c", *language, source)


@pytest.mark.parametrize(
    ("source", "crc", "includes", "state", "size"),  # the source refuses to compile with a larger state
    [(SOURCE, set(), {"stdint.h", "stddef.h"}, FrameState, 300), (MESSAGES, {"arva_crc"}, set(), MessageState, 560)],
)
def test_it_leans_on_three_functions_of_the_library_and_on_no_float(tmp_path, source, crc, includes, state, size):
    target = compile_c(compiler(), tmp_path / "out.o", "-std=c99", "-O2", "-fno-stack-protector", "-c", source)
    undefined = subprocess.run(["nm", "-u", target], check=True, capture_output=True, text=True).stdout.split()
    assert set(undefined) - {"U", "_GLOBAL_OFFSET_TABLE_"} <= {"memcpy", "memmove", "memset"} | crc
    code = re.sub(r"/\*.*?\*/", "", source.with_suffix(".h").read_text() + source.read_text(), flags=re.DOTALL)
    assert set(re.findall(r"#include <(.*?)>", code)) == includes | {"string.h"}
    assert not re.findall(r"float|double|\d\.\d", code)
    assert ctypes.sizeof(state) <= size


def test_crc(codec):
    for check in VECTORS["crc"]:
        assert codec.crc(bytes.fromhex(check["hex"])) == check["crc"]


@every("value", by_name(VECTORS["frames"]))
def test_frame(codec, value):
    raw, frame = bytes.fromhex(value["hex"]), as_frame(value)
    assert CDecoder(codec).feed(raw, 0.0) == [frame]
    assert codec.encode(frame) == (b"" if value["decode_only"] else raw)


@every("one_byte_a_call", [False, True])
@every("epoch_ms", [0, 2**32 - 100])
@every("value", by_name(VECTORS["streams"]))
def test_stream(codec, value, epoch_ms, one_byte_a_call):
    decoder = CDecoder(codec, epoch_ms)
    follow(decoder.feed, value, one_byte_a_call)
    assert {name: getattr(decoder, name) for name in value["counters"]} == value["counters"]


def test_exactly_100_ms_is_too_long(codec):
    for pause, frames in ((0.099, [ONE]), (0.1, [])):
        decoder = CDecoder(codec, 2**32 - 50)
        decoder.feed(encode(ONE)[:-1], 0.0)
        assert decoder.feed(encode(ONE)[-1:], pause) == frames


@pytest.mark.parametrize("n", [0, 17, 18])
def test_no_such_number_of_channels_is_encoded(codec, n):
    assert codec.encode(ONE._replace(channels=ONE.channels * n), capacity=9 + 6 * n) == b""


@pytest.mark.parametrize("n", [1, 4, 16])
def test_no_byte_is_written_beyond_the_capacity(codec, n):
    frame = ONE._replace(channels=ONE.channels * n)
    assert [len(codec.encode(frame, capacity)) for capacity in range(9 + 6 * n)] == [0] * (9 + 6 * n)
    assert codec.encode(frame, 9 + 6 * n) == encode(frame)


def test_age(codec):
    decoder = CDecoder(codec, 2**32 - 3000)
    assert decoder.age_ms(0.0) == NEVER
    decoder.feed(encode(ONE)[:-2], 1.0)
    assert decoder.age_ms(1.0) == NEVER
    decoder.feed(encode(ONE)[-2:], 1.05)
    assert [decoder.age_ms(t) for t in (1.05, 2.0, 9.0)] == [0, 950, 7950]
    decoder.feed(encode(ONE)[:-1] + b"\x00", 4.0)
    assert decoder.age_ms(4.0) == 2950  # a bad frame makes it no younger


@pytest.mark.parametrize("late", [0.105, 0.2, 0.4, 30.0])
def test_the_age_counts_from_the_last_byte_not_from_the_delivery(codec, late):
    decoder = CDecoder(codec, 2**32 - 50)
    decoder.feed(FALSE_LONG, 0.0)
    decoder.feed(encode(ONE)[:5], 0.02)
    decoder.feed(encode(ONE)[5:], 0.03)
    decoder.feed(encode(ONE)[:5], 0.04)
    assert decoder.feed(b"", late) == [ONE]
    assert decoder.age_ms(late) == round(1000 * late) - 30


def test_a_silence_of_weeks_does_not_look_fresh(codec):
    decoder, day = CDecoder(codec), 86_400.0
    decoder.feed(encode(ONE), 0.0)
    ages = []
    for days in range(1, 101):
        decoder.feed(b"", days * day)
        ages.append(decoder.age_ms(days * day))
    assert ages == [min(round(1000 * days * day), 2**31 - 1) for days in range(1, 101)]


def test_frames_are_counted_without_a_function_to_take_them(codec):
    state = FrameState()
    codec.library.arva_decoder_init(ctypes.byref(state), ON_FRAME(), None)
    raw = encode(ONE) + encode(ONE._replace(sequence=4))
    assert codec.library.arva_decoder_feed(ctypes.byref(state), raw, len(raw), 0) == 2
    assert (state.good, state.lost, state.dropped) == (2, 2, 0)


def test_python_and_c_make_the_same_of_the_same_bytes(run_tool):
    assert "700 streams, no difference" in run_tool("tools", "fuzz", "codecs", "frames", "700")


def test_sanitizers_find_nothing(run_tool):
    output = run_tool("tools", "fuzz", "c", "--runs", "3000", "--without-clang")
    assert int(re.fullmatch(r"(\d+) delivered, nothing found\n", output)[1]) > 3000


@pytest.mark.skipif(not shutil.which("clang"), reason="as above without libFuzzer")
def test_guided_by_coverage_they_find_nothing_either(run_tool):
    run_tool("tools", "fuzz", "c", "--runs", "2000")


def test_the_example_prints_what_comes_over_a_port(tmp_path):
    main = compile_c(compiler(), tmp_path / "example", "-std=c99", FOLDER / "example_main.c", SOURCE)
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    port = os.ttyname(theirs)
    with subprocess.Popen([main, port], stdout=subprocess.PIPE) as process:
        try:
            os.write(ours, encode(ONE) + encode(Frame(2, 1, (Channel(), Channel(7, 0, 5600, -35)))))
            text = b""
            while text.count(b"\n") < 2 and select.select([process.stdout], [], [], 20)[0]:
                text += os.read(process.stdout.fileno(), 4096)
            assert text.decode() == f"{port}, frame 1: [1: 300 cm, 12 deg]\n{port}, frame 2: - [7: 5600 cm, -35 deg]\n"
            os.close(theirs)
            os.close(ours)
            assert process.wait(20) == 0  # unplugged
        finally:
            process.kill()


# The C code of messages: what it is made of, vectors.json, its requests, and that sanitizers find nothing


MARK = Command(7, "mark", (3,))
DONE = CommandAnswer(7, "mark", "done")


@every("value", by_name(VECTORS["messages"]))
def test_message(code, value):
    raw, message = bytes.fromhex(value["hex"]), BY_NAME[value["name"]]
    assert CMessageDecoder(code).feed(raw, 0.0) == [message]
    if isinstance(message, Command | CommandAnswer):
        assert code.encode(message) == raw
        assert [code.encode(message, capacity) for capacity in range(len(raw))] == [b""] * len(raw)


@every("one_byte_a_call", [False, True])
@every("epoch_ms", [0, 2**32 - 100])
@every("value", by_name(VECTORS["message_streams"]))
def test_stream_of_messages(code, value, epoch_ms, one_byte_a_call):
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


def test_python_and_c_make_the_same_of_the_same_messages(run_tool):
    assert "700 streams, no difference" in run_tool("tools", "fuzz", "codecs", "messages", "700", "--no-lua")


def test_sanitizers_find_nothing_in_messages(run_tool):
    output = run_tool("tools", "fuzz", "c", "messages", "--runs", "2000", "--without-clang")
    assert int(re.fullmatch(r"(\d+) delivered, nothing found\n", output)[1]) > 2000


# -- What both decoders of binary frames promise about a bad line: the Python one and the C one -----------


BYTE_MS = 10 / 115.2
HEADS = [b"\xa4", b"\xa4\x57", b"\xa4\x57\x01", bytes.fromhex("A4570163"), bytes.fromhex("A4570163000010")]


@pytest.fixture(params=["Python", "C"])
def decoder(request, codec):
    return Decoder() if request.param == "Python" else CDecoder(codec)


def frames(random, count):
    """No two alike."""
    for k in range(count):
        channels = [
            Channel(random.choice((None, 0xA4, 7)), random.randrange(3), k, random.choice((-1, 0x57A4, 90)))
            for _ in range(random.choice((1, 4, random.randint(1, MAX_CHANNELS))))
        ]
        yield Frame(k % 256, 1, tuple(channels))


def damaged(random, raw):
    """2 % of the bytes dropped, given another before them, or changed."""
    out = bytearray()
    for byte in raw:
        fate = random.random() * 150
        if fate < 1:
            continue
        if fate < 2:
            out.append(random.randrange(256))
        out.append(byte ^ random.randrange(1, 256) if 2 <= fate < 3 else byte)
    return bytes(out)


def play(decoder, line):
    """Feed (ms, bytes) as they come, a call each millisecond for as long as a byte can be waited for; (ms, frame)."""
    heard = []
    for k, (at, data) in enumerate(line):
        heard += [(at, frame) for frame in decoder.feed(data, at / 1000)]
        end = line[k + 1][0] if k + 1 < len(line) else at + 1000
        for now in range(at + 1, min(end, at + 103)):
            heard += [(now, frame) for frame in decoder.feed(b"", now / 1000)]
    return heard


@pytest.mark.parametrize(("hertz", "count"), [(1, 100), (50, 600)])
def test_every_whole_frame_of_a_bad_line_comes_out_within_100_ms(decoder, hertz, count):
    """And nothing else does: with this seed no damaged frame has a right CRC by chance."""
    random = Random(457)
    arrivals: dict[int, bytearray] = {}
    last_ms = {}

    def put(at, data):
        for k, byte in enumerate(data):
            arrivals.setdefault(int(at + k * BYTE_MS), bytearray()).append(byte)

    sent = list(frames(random, count))
    for k, frame in enumerate(sent):
        start = 1000 * k / hertz
        raw = damaged(random, encode(frame))
        if (at := raw.find(encode(frame))) >= 0:
            last_ms[frame] = int(start + (at + len(encode(frame)) - 1) * BYTE_MS)
        put(start, raw)
        noise = random.choice([b"", random.randbytes(random.randrange(30)), random.choice(HEADS)])
        put(start + random.choice((10, 15, 1000 / hertz - 2.7)), noise)
    heard = play(decoder, sorted((at, bytes(data)) for at, data in arrivals.items()))
    assert [frame for _, frame in heard] == [frame for frame in sent if frame in last_ms]
    assert 0.4 * count < len(heard) < 0.8 * count
    assert max(at - last_ms[frame] for at, frame in heard) <= 100
    everything = sum(map(len, arrivals.values()))
    assert decoder.dropped == everything - sum(len(encode(frame)) for _, frame in heard)


def test_what_passes_of_damaged_frames_is_what_a_crc_of_16_bits_lets_pass(decoder):
    """One in 65536 of those that are damaged beyond three bits; here of frames with three random bytes."""
    random, passed, count = Random(1), 0, 15_000
    raw = encode(Frame(5, 1, (Channel(1, 2, 300, 12),)))
    for k in range(count):
        bad = bytearray(raw)
        for at in random.sample(range(7, len(raw)), 3):
            bad[at] ^= random.randrange(1, 256)
        passed += len(decoder.feed(bytes(bad), k)) + len(decoder.feed(b"", k + 0.5))
    assert passed <= 3  # 0.2 expected
    assert decoder.dropped == len(raw) * (count - passed)
