"""The PX4 module: its array against vectors.json and its README, and what it does on a stand-in for PX4."""

import ctypes
import re
import shutil
from itertools import pairwise
from pathlib import Path

import pytest

import firmware_proto
from firmware_proto import MID, Channel, Command, CommandAnswer, Frame, encode
from firmware_proto.commands import encode_answer, encode_command
from tests.every import every
from tests.firmware_proto.px4_stand_in import (
    CONSTANTS,
    DRIVER,
    FOLDER,
    HEADERS,
    LAYOUT,
    MODULE,
    SIZE,
    STAND_IN,
    Px4,
    c_struct,
)
from tests.firmware_proto.wire_vectors import VECTORS, by_name
from tests.once import once
from tools.vectors.c_codec import FOLDER as CODEC
from tools.vectors.c_codec import MESSAGES, SOURCE, compile_c, compiler

CHANNELS, PASS_MS = 13, 10
FOUR = (Channel(3, 2, 85, 0), Channel(1, MID, 1250, -35), Channel(2, MID, 4020, 17, True), Channel())


@pytest.fixture(scope="module")
def stand_in(tmp_path_factory):
    """A folder with the headers of PX4 that the module includes."""
    return once(tmp_path_factory, "px4", write_headers)


def write_headers(folder):
    for name in HEADERS.split():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text('#include "stand_in.hpp"\n')
    (folder / "stand_in.hpp").write_text(STAND_IN.replace("ARVA_READING", c_struct()))


@pytest.fixture(scope="module")
def binary(tmp_path_factory):
    return once(tmp_path_factory, "px4-module", build) / "px4.so"


def build(folder):
    write_headers(folder)
    (folder / "driver.cpp").write_text(DRIVER)
    codec = compile_c(compiler(), folder / "codec.o", "-std=c99", "-fPIC", "-c", SOURCE)
    board = ("-include", folder / "board.h", "-Wno-conversion")
    (folder / "board.h").write_text("#include <stdint.h>\n#define int32_t long\n")  # as the stand-in has it
    messages = compile_c(compiler(), folder / "messages.o", "-std=c99", "-fPIC", *board, "-c", MESSAGES)
    command = compiler("g++", "clang++", "c++")
    options = ("-std=c++14", "-Wno-conversion", "-Wno-unused-parameter", "-Wno-format-security", "-fPIC", "-shared")
    include = (f"-I{folder}", f"-I{MODULE}")
    compile_c(command, folder / "px4.so", *options, *include, folder / "driver.cpp", codec, messages)


@pytest.fixture
def px4(binary, tmp_path):
    return Px4(binary, tmp_path)


@pytest.fixture
def started(px4):
    px4.plug()
    assert px4.command("start", "-d", "/dev/ttyS3") == 0
    px4.run(PASS_MS)
    return px4


def raw(sequence, channels=FOUR):
    return encode(Frame(sequence % 256, 1, channels))


def value(data, name, k=0):
    step, offset = LAYOUT[name]
    return data[step * k + offset]


@every("vector", by_name(VECTORS["frames"]))
def test_the_array_is_the_frame_in_the_layout_of_the_readme(px4, vector):
    assert sorted(LAYOUT) == sorted("d delta id zone n sequence status lost bad_crc dropped".split())
    data = (ctypes.c_float * SIZE)(*[0.5] * SIZE)
    bytes_ = bytes.fromhex(vector["hex"])
    assert px4.library.pack(bytes_, len(bytes_), data) == 1
    channels = vector["channels"]
    assert [value(data, name) for name in ("n", "sequence", "status")] == [
        len(channels), vector["sequence"], vector["status"],
    ]  # fmt: skip
    assert [value(data, name) for name in ("lost", "bad_crc", "dropped")] == [0, 0, 0]
    nothing = {"id": None, "zone": 0, "marked": False, "d": -1, "delta": -1}
    for k, c in enumerate((channels + CHANNELS * [nothing])[:CHANNELS]):
        assert value(data, "d", k) == c["d"]
        assert value(data, "delta", k) == c["delta"]
        assert value(data, "id", k) == (255 if c["id"] is None else c["id"])
        assert value(data, "zone", k) == c["zone"] + 128 * c["marked"]


def test_the_build_files_name_what_there_is():
    assert f"modules/{MODULE.name}" in (FOLDER / "src" / "CMakeLists.txt").read_text()
    cmake = (MODULE / "CMakeLists.txt").read_text()
    for name in re.findall(r"[\w./]+\.(?:cpp|c|yaml)\b", cmake):
        assert (MODULE / name).is_file() or (FOLDER.parent / "c" / Path(name).name).is_file()
    assert (MODULE / "../../../../c/arva_frame.c").is_file()
    assert "../../../../c" in cmake


@pytest.mark.parametrize(("hertz", "n"), [(1, 4), (50, 1), (50, 16)])
def test_no_frame_is_lost(started, hertz, n):
    for k in range(6 * hertz):
        data = raw(k, (FOUR * 4)[:n])
        for at in range(0, 105, 53):
            started.give(data[at : at + 53], PASS_MS)
        started.run(1000 // hertz - 2 * PASS_MS)
    assert started.sequences == [k % 256 for k in range(6 * hertz)]
    assert {(m.id, m.name) for m in started.published} == {(457, b"arva")}
    assert started.said() == [f"i ARVA: receiver found, channels: {n}"]


def test_of_several_frames_at_once_each_is_published_in_a_pass_of_its_own(started):
    assert started.library.is_advertised() == 4  # before the first frame, for the logger
    started.give(b"".join(raw(k) for k in range(20)), 30 * PASS_MS)
    assert started.sequences == list(range(20))
    times = [message.timestamp for message in started.published]
    assert min(b - a for a, b in pairwise(times)) == started.library.interval_us()


def test_each_frame_is_a_reading_of_the_modules_own_topic_too(started):
    started.give(raw(5) + raw(7, (Channel(9, 2, -32768, 32767, True),) * 16), 30 * PASS_MS)
    four, sixteen = started.readings
    assert (four.sequence, four.status, four.n) == (5, 1, 4)
    assert list(zip(four.id, four.zone, four.marked, four.d_cm, four.delta_deg, strict=True)) == [
        (3, 2, False, 85, 0),
        (1, 1, False, 1250, -35),
        (2, 1, True, 4020, 17),
        *[(255, 0, False, -1, -1)] * 13,
    ]
    assert (sixteen.sequence, sixteen.n, sixteen.lost, sixteen.bad_crc, sixteen.dropped) == (7, 16, 1, 0, 0)
    assert (sixteen.id[15], sixteen.marked[15], sixteen.d_cm[15], sixteen.delta_deg[15]) == (9, True, -32768, 32767)
    assert [reading.timestamp for reading in started.readings] == [array.timestamp for array in started.published]


def test_the_modules_own_topic_has_a_queue_and_the_constants_of_the_wire():
    assert CONSTANTS["ORB_QUEUE_LENGTH"] >= 8
    assert (FOLDER / "msg" / "CMakeLists.txt").read_text().split() == [
        "set(config_msg_list_external", "ArvaAnswer.msg", "ArvaPulses.msg", "ArvaReading.msg", "PARENT_SCOPE", ")",
    ]  # fmt: skip
    assert {name: number for name, number in CONSTANTS.items() if name != "ORB_QUEUE_LENGTH"} == {
        "NO_ID": 255, "ZONE_OUTER": firmware_proto.OUTER, "ZONE_MID": MID, "ZONE_INNER": firmware_proto.INNER,
        "STATUS_SYNTHETIC": firmware_proto.SYNTHETIC, "STATUS_INTERFERENCE": firmware_proto.INTERFERENCE,
        "STATUS_MORE_TRANSMITTERS": firmware_proto.MORE_TRANSMITTERS,
        "STATUS_SELF_TEST_FAULT": firmware_proto.SELF_TEST_FAULT,
        "STATUS_OVERLAP": firmware_proto.OVERLAP, "STATUS_NOT_SEARCHING": firmware_proto.NOT_SEARCHING,
    }  # fmt: skip


def test_an_emulator_that_restarts_has_lost_no_frames(started):
    for sequence in (27, 28, 0, 1):
        started.give(raw(sequence), 100)
    assert [reading.lost for reading in started.readings] == [0, 0, 0, 0]


def test_frames_thrown_away_when_the_port_is_opened_again_are_not_lost(started):
    for sequence in (183, 184):
        started.give(raw(sequence), 100)
    started.unplug()
    started.run(3000)
    started.plug()
    started.receive(raw(0) + raw(1))  # before the module has opened it: thrown away
    started.run(500)
    for sequence in (21, 22, 24):
        started.give(raw(sequence), 100)
    assert [(reading.sequence, reading.lost) for reading in started.readings] == [
        (183, 0), (184, 0), (21, 0), (22, 0), (24, 1),
    ]  # fmt: skip


def test_counters_are_in_the_array(started):
    broken = bytearray(raw(1))
    broken[-1] ^= 1
    for data in (raw(0), b"x", bytes(broken), raw(5)):
        started.give(data, 100)
    data = started.published[-1].data
    assert (value(data, "lost"), value(data, "bad_crc"), value(data, "dropped")) == (4, 1, 34)


@pytest.mark.parametrize("noisy", [True, False], ids=["error", "silence"])
def test_a_receiver_is_lost_after_two_seconds_and_comes_back(started, noisy):
    started.give(raw(0), PASS_MS)
    started.unplug(noisy)
    started.said()
    started.run(2000)
    assert started.said() == []
    started.run(PASS_MS)
    assert started.said() == ["w ARVA: receiver lost"]
    started.run(60_000)
    assert started.said() == []
    started.plug()
    started.run(500)
    started.give(raw(1), PASS_MS)
    assert started.said() == ["i ARVA: receiver found, channels: 4"]
    assert started.sequences == [0, 1]


def test_a_port_that_appears_later_is_opened(px4):
    px4.command("start", "-d", "/dev/ttyS3")
    px4.run(2000 + PASS_MS)
    assert px4.said() == ["w ARVA: no receiver"]
    px4.plug()
    px4.run(500)
    px4.give(raw(0), PASS_MS)
    assert px4.sequences == [0]


def test_a_port_that_fails_is_opened_again_within_half_a_second(started):
    started.unplug(noisy=True)
    started.run(PASS_MS)
    started.plug()
    started.run(500)
    started.give(raw(0), PASS_MS)
    assert started.sequences == [0]


def test_what_waited_in_the_port_is_thrown_away(px4):
    px4.plug()
    px4.receive(raw(0))
    px4.command("start", "-d", "/dev/ttyS3")
    px4.run(100)
    assert px4.sequences == []


def test_bytes_that_are_no_frames_are_said(started):
    for _ in range(20):
        started.give(b"85,0\r\n", 100)
    assert started.said() == ["w ARVA: no frames, only 120 bytes: baud rate?"]


def test_status(started):
    started.give(raw(7), 40)
    started.said()
    started.command("status")
    assert started.said() == [
        "I port /dev/ttyS3 at 57600 baud: open",
        "I receiver: found",
        "I frames: 1 good, 0 lost, 0 with a wrong CRC; bytes in none: 0",
        "I last frame: 30 ms ago, sequence 7, status 0x01, channels 4",
        "I channel 1: transmitter 3, zone 2, 85 cm, 0 degrees",
        "I channel 2: transmitter 1, zone 1, 1250 cm, -35 degrees",
        "I channel 3: transmitter 2, zone 1 (marked), 4020 cm, 17 degrees",
        "I channel 4: no signal",
    ]


def test_status_is_of_one_moment_though_the_next_frame_comes_while_it_is_printed(started):
    started.give(raw(7), 40)
    started.said()
    started.receive(raw(8, FOUR[:1]))
    started.library.run_in_next_line()
    started.command("status")
    said = started.said()
    assert [line for line in said if "good" in line or "last" in line] == [
        "I frames: 1 good, 0 lost, 0 with a wrong CRC; bytes in none: 0",
        "I last frame: 30 ms ago, sequence 7, status 0x01, channels 4",
    ]
    assert said[-1] == "I channel 4: no signal"
    started.command("status")
    assert started.said()[2].startswith("I frames: 2 good")


ARM = "arm-none-eabi-g++"


@pytest.mark.skipif(not shutil.which(ARM), reason=f"no {ARM}; on Debian: apt-get install gcc-arm-none-eabi")
def test_the_sources_compile_for_a_flight_controller(stand_in, tmp_path):
    board = ("-mcpu=cortex-m7", "-mthumb", "-Os", "-c")
    compile_c(ARM.replace("g++", "gcc"), tmp_path / "codec.o", "-std=c99", *board, SOURCE)
    options = ("-std=gnu++14", "-fno-exceptions", "-fno-rtti", "-Wno-conversion", "-Wno-unused", "-Wno-format-security")
    include = (f"-I{stand_in}", f"-I{MODULE}", f"-I{CODEC}")
    options += ("-Wno-unused-parameter",)
    compile_c(ARM, tmp_path / "module.o", *options, *board, *include, MODULE / "arva_receiver.cpp")


def test_start_and_stop(px4):
    assert px4.command("start") != 0
    assert px4.command("start", "-d", "/dev/" + 27 * "x") != 0
    assert px4.command("start", "-d", "/dev/ttyS3", "-b", "x") != 0
    assert px4.command("start", "-d", "/dev/ttyS3", "-x", "1") != 0
    assert not px4.run(PASS_MS)
    assert px4.command("start", "-d", "/dev/ttyS3", "-b", "19200") == 0
    assert px4.library.baudrate() == 19200
    assert px4.run(PASS_MS)
    px4.command("stop")
    assert not px4.run(PASS_MS)


def answer(number, name, result, *values, text=""):
    return encode_answer(CommandAnswer(number, name, result, values, text))


def test_a_command_of_the_shell_is_sent_and_its_answer_published(started):
    started.give(raw(1), PASS_MS)
    started.said()
    assert started.command("command", "mark", "3") == 0
    assert started.sent() == b""  # the work queue writes it
    started.run(PASS_MS)
    assert started.sent() == encode_command(Command(1, "mark", (3,)))
    assert started.command("command", "scan") == -1
    assert started.said() == ["E the command before still waits for its answer"]
    started.give(
        answer(9, "mark", "busy") + raw(2) + answer(1, "mark", "done", 3, -4, text="a text") + raw(3), 5 * PASS_MS
    )
    assert started.said() == ["i ARVA: mark: done a text"]
    (got,) = started.answers
    assert (got.code, got.result, got.count, list(got.values), got.text) == (2, 0, 2, [3, -4, 0, 0], b"a text")
    assert started.sequences == [1, 2, 3]
    assert started.command("command", "scan") == 0


def test_a_command_is_sent_three_times_and_a_restart_once(started):
    for name, times in (("scan", 3), ("restart", 1)):
        assert started.command("command", name) == 0
        started.run(6000)
        assert started.sent().count(b"\xa4\x57\x02") == times
        assert [line for line in started.said() if name in line] == [f"i ARVA: {name}: no answer "]
    assert [a.result for a in started.answers] == [255, 255]


WRONG = ("command", "command mrak", "command mark x", "command mark 1 2 3 4 5", "comand scan")


@every("words", WRONG)
def test_a_wrong_command_of_the_shell_is_refused(started, words):
    assert started.command(*words.split()) == 0  # the usage was printed
    assert started.said()[0].startswith("W ")
    started.run(PASS_MS)
    assert started.sent() == b""


@every("vector", [v for v in by_name(VECTORS["messages"]) if v.values[0]["type"] in ("vector", "level")])
def test_what_was_measured_is_published_in_its_units(started, vector):
    before = len(started.pulses)
    started.give(bytes.fromhex(vector["hex"]), 3 * PASS_MS)
    (got,) = started.pulses[before:]
    channels = vector["channels"]
    assert (got.sequence, got.status, got.n) == (vector["sequence"], vector["status"], len(channels))
    assert got.time_ms == vector["time_ms"]
    for k, c in enumerate(channels):
        assert (got.id[k], got.zone[k], got.marked[k]) == (255 if c["id"] is None else c["id"], c["zone"], c["marked"])
        assert got.age_ms[k] == (65535 if c["age_ms"] is None else c["age_ms"])
        said = [got.x_na_m[k], got.y_na_m[k], got.z_na_m[k], got.period_s[k], got.carrier_hz[k], got.level_dbfs[k]]
        wanted = [None] * 6
        if vector["type"] == "vector":
            heard = c["age_ms"] is not None
            wanted[:3] = [c[axis] / 100 if heard else None for axis in "xyz"]
            wanted[3] = c["period"] / 1e4 if c["period"] else None
            wanted[4] = None if c["carrier"] is None else c["carrier"] / 10
        else:
            wanted[5] = None if c["level"] is None else c["level"] / 100
        assert [None if x != x else x for x in said] == [
            None if x is None else pytest.approx(x, rel=1e-6) for x in wanted
        ]
    assert all(got.id[k] == 255 and got.x_na_m[k] != got.x_na_m[k] for k in range(len(channels), 16))
