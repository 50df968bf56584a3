"""The C codec: what it is made of, vectors.json, its own promises, and that sanitizers find nothing."""

import ctypes
import os
import re
import select
import shutil
import subprocess
import tty

import pytest

from firmware_proto import Channel, Frame, encode
from tests.every import every
from tests.firmware_proto.wire_vectors import VECTORS, as_frame, by_name, follow
from tools.codecs.c_code import FOLDER, MESSAGES, NEVER, SOURCE, compile_c, compiler
from tools.codecs.c_frames import ON_FRAME, CDecoder, State
from tools.codecs.c_messages import State as MessageState

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


@pytest.mark.parametrize("language", [("-std=c99",), ("-x", "c++", "-std=c++11")], ids=["C99", "C++"])
@pytest.mark.parametrize("name", list(INSTALLED.values()) or ["cc"])
def test_it_compiles_without_a_warning(tmp_path, name, language):
    for extra in ["-fsyntax-only"] if "clang" in name else ["-O2", "-Os"]:  # clang warns before it optimizes
        for source in (SOURCE, MESSAGES):
            compile_c(name, tmp_path / "out.o", extra, "-Wshadow", "-c", *language, source)


@pytest.mark.parametrize(
    ("source", "crc", "includes", "state", "size"),  # the source refuses to compile with a larger state
    [(SOURCE, set(), {"stdint.h", "stddef.h"}, State, 300), (MESSAGES, {"arva_crc"}, set(), MessageState, 560)],
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
    state = State()
    codec.library.arva_decoder_init(ctypes.byref(state), ON_FRAME(), None)
    raw = encode(ONE) + encode(ONE._replace(sequence=4))
    assert codec.library.arva_decoder_feed(ctypes.byref(state), raw, len(raw), 0) == 2
    assert (state.good, state.lost, state.dropped) == (2, 2, 0)


def test_python_and_c_make_the_same_of_the_same_bytes(run_tool):
    assert "2000 streams, no difference" in run_tool("tools", "fuzz", "codecs", "frames", "2000")


def test_sanitizers_find_nothing(run_tool):
    output = run_tool("tools", "fuzz", "c", "--runs", "10000", "--without-clang")
    assert int(re.fullmatch(r"(\d+) delivered, nothing found\n", output)[1]) > 10_000


def test_guided_by_coverage_they_find_nothing_either(run_tool):
    run_tool("tools", "fuzz", "c", "--runs", "2000")  # as above if there is no libFuzzer


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
