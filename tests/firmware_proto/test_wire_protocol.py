"""PROTOCOL.md against the code: its worked bytes, its checks and its numbers."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from fastcrc import crc16

import firmware_proto
from arva_hil.model.field import dipole_field
from arva_hil.model.receiver import outputs
from firmware_proto import (
    INNER,
    MAX_FRAME_BYTES,
    MID,
    Channel,
    Command,
    CommandAnswer,
    Decoder,
    Frame,
    Measured,
    VectorChannel,
    encode,
    encode_nmea,
    encode_text,
)
from firmware_proto.command_lines import LINE_HOST
from firmware_proto.commands import NAMES, RESULTS, encode_answer, encode_command
from firmware_proto.measured import encode_rssi, encode_vector

PAGE = (Path(firmware_proto.__file__).parent / "PROTOCOL.md").read_text(encoding="utf-8")
ONE = Frame(1, 1, (Channel(1, MID, 1234, 17),))
FOUR = Frame(7, 1, (Channel(3, INNER, 85, 0), Channel(1, MID, 1250, -35), Channel(2, MID, 4020, 17), Channel()))
PULSE = VectorChannel(1, MID, False, 77100, -12300, 400, 10130, -125, 240)
MEASURED = ONE._replace(measured=Measured(12345, (PULSE,)))


def section(title):
    return re.split(r"\n#+ ", PAGE.split(f"# {title}\n")[1])[0]


def block(kind):
    return re.search(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)[1].replace("\n", "\r\n").encode()


def test_worked_bytes():
    title, frame, data = "Four channels, byte by byte", FOUR, b""
    for offset, column in re.findall(r"\| (\d+) \| ([0-9A-F ]+) \|", section(title)):
        assert int(offset) == len(data)
        data += bytes.fromhex(column)
    assert data == encode(frame)
    assert Decoder().feed(data, 0.0) == [frame]
    crc = crc16.mcrf4xx(data[2:-2])
    assert f"CRC 0x{crc:04X}" in section(title)


@pytest.mark.parametrize("data", [encode(ONE), encode_answer(CommandAnswer(7, "mark", "done"))])
def test_worked_bytes_in_a_line(data):
    assert f": `{data.hex(' ').upper()}`." in PAGE


@pytest.mark.parametrize(
    ("title", "data"),
    [
        ("A command, byte by byte", encode_command(Command(7, "mark", (3,)))),
        ("A command with a mask, byte by byte", encode_command(Command(0xA4, "scan"))),
        ("A vector, byte by byte", encode_vector(MEASURED)[: -len(encode(MEASURED))]),
    ],
)
def test_worked_bytes_of_messages(title, data):
    worked = b""
    for offset, column in re.findall(r"\| (\d+) \| ([0-9A-F ]+) \|", section(title)):
        assert int(offset) == len(worked)
        worked += bytes.fromhex(column)
    assert worked == data


def test_commands_and_results():
    rows = re.findall(r"\| (\d) \| ([a-z]+) \| [^|]*\| [^|]*\| [^|]*\|\n", section("Commands"))
    assert [name for _, name in rows] == list(NAMES)
    assert [int(code) for code, _ in rows] == list(range(1, len(NAMES) + 1))
    for code, result in enumerate(RESULTS):
        assert re.search(rf"\b{code} {result}\b", section("Commands"))


def test_commands_in_lines():
    said = [
        LINE_HOST.command(Command(7, "mark", (3,))),
        LINE_HOST.answer(CommandAnswer(7, "mark", "done")),
        LINE_HOST.command(Command(8, "identify")),
        LINE_HOST.answer(CommandAnswer(8, "identify", "done", (4,), "paper 1.0 nmea")),
    ]
    assert block("commands") == b"".join(said)


def test_the_approach_is_what_the_paper_s_receiver_says_on_its_way():
    rows = re.findall(r"\| ([−\d.]+) " * 7 + r"\|", section("An approach"))
    assert len(rows) == 8
    north, east, heading = -25.0, 20.0, 0
    flat = np.eye(3)[None]  # the dipole points north
    for row in rows:
        said = [float(value.replace("−", "-")) for value in row]
        place = np.array([north, east, -1.5])
        field = dipole_field(place, np.zeros((1, 3)), flat, np.ones(1))
        d, delta, zone = (int(one[0]) for one in outputs(field @ turned(heading), 1.542))
        behind = outputs(field @ turned(heading + 180), 1.542)
        assert [int(one[0]) for one in behind] == [d, delta, zone]
        assert said == [
            round(north, 1),
            round(east, 1),
            heading,
            round(float(np.linalg.norm(place)), 1),
            d,
            delta,
            zone,
        ]
        heading += delta
        north += d / 300 * math.cos(math.radians(heading))
        east += d / 300 * math.sin(math.radians(heading))


def turned(degrees):
    """Receiver → NED, level, with a heading."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def test_crc():
    assert crc16.mcrf4xx(b"123456789") == 0x6F91
    assert '"123456789" → 0x6F91' in section("CRC")


def test_nmea_and_text():
    assert block("nmea") == encode_nmea(FOUR)
    assert block("text") == encode_text(FOUR)


def test_status_bits():
    rows = re.findall(r"\| (\d) \| (\d+) \| ([^|]+)", section("Status"))
    names = ("SYNTHETIC", "INTERFERENCE", "MORE_TRANSMITTERS", "SELF_TEST_FAULT", "OVERLAP", "NOT_SEARCHING")
    assert [int(value) for _, value, _ in rows] == [getattr(firmware_proto, name) for name in names]
    assert [1 << int(bit) for bit, _, _ in rows] == [int(value) for _, value, _ in rows]
    for name, (_, _, meaning) in zip(names, rows, strict=True):
        assert meaning.replace("-", " ").startswith(name.lower().replace("_", " "))


@pytest.mark.parametrize(
    ("form", "encode"),
    [
        ("binary", encode),
        ("nmea", encode_nmea),
        ("text", encode_text),
        ("vector", encode_vector),
        ("rssi", encode_rssi),
    ],
)
def test_sizes_and_times(form, encode):
    longest = Channel(254, INNER, -0x8000, -0x8000, True)
    sizes = [len(encode(Frame(255, 255, (longest,) * n))) for n in (1, 4, 16)]
    row = " | ".join(map(str, sizes))
    assert f"| {form}, bytes | {row} |" in section("Timing")
    row = " | ".join(f"{size * 10 / 115.2:.1f}" for size in sizes)
    assert f"| {form}, ms | {row} |" in section("Timing")


def test_the_lowest_baud_rate():
    def milliseconds(n):
        return (len(encode(Frame(1, 1, (Channel(),) * n))) - 1) * 10 / 9.6

    assert milliseconds(14) < 100 < milliseconds(15)
    assert f"16 channels take {milliseconds(16):.0f} ms" in PAGE
    assert f"at most 14 channels fit ({milliseconds(14):.0f} ms)" in PAGE
    assert f"One fixed buffer of {MAX_FRAME_BYTES} bytes" in PAGE


def test_mavlink_fits():
    assert MAX_FRAME_BYTES <= 128  # TUNNEL's payload
    assert len("ARVA16_DIR") == 10  # a name of NAMED_VALUE_INT
    assert f"{0xA457} (0xA457;" in PAGE
    assert encode(ONE)[:2].hex() == "a457"
