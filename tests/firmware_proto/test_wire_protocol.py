"""PROTOCOL.md against the code: its worked bytes, its checks and its numbers."""

import re
from pathlib import Path

import pytest
from fastcrc import crc16

import firmware_proto
from firmware_proto import (
    ENCODERS,
    INNER,
    MAX_FRAME_BYTES,
    MID,
    Channel,
    Decoder,
    Frame,
    encode,
    encode_nmea,
    encode_text,
)

PAGE = (Path(firmware_proto.__file__).parent / "PROTOCOL.md").read_text(encoding="utf-8")
ONE = Frame(1, 1, (Channel(1, MID, 1234, 17),))
FOUR = Frame(7, 1, (Channel(3, INNER, 85, 0), Channel(1, MID, 1250, -35), Channel(2, MID, 4020, 17), Channel()))


def section(title):
    return re.split(r"\n#+ ", PAGE.split(f"# {title}\n")[1])[0]


def block(kind):
    return re.search(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)[1].replace("\n", "\r\n").encode()


@pytest.mark.parametrize(
    ("title", "frame"), [("One channel, byte by byte", ONE), ("Four channels, byte by byte", FOUR)]
)
def test_worked_bytes(title, frame):
    data = b""
    for offset, column in re.findall(r"\| (\d+) \| ([0-9A-F ]+) \|", section(title)):
        assert int(offset) == len(data)
        data += bytes.fromhex(column)
    assert data == encode(frame)
    assert Decoder().feed(data, 0.0) == [frame]
    crc = crc16.mcrf4xx(data[2:-2])
    assert f"CRC 0x{crc:04X}" in section(title)
    if frame is ONE:
        assert f"of `{data[2:-2].hex(' ').upper()}`" in section(title)


def test_crc():
    assert crc16.mcrf4xx(b"123456789") == 0x6F91
    assert '"123456789" → 0x6F91' in section("CRC")


def test_nmea_and_text():
    assert block("nmea") == encode_nmea(FOUR)
    assert block("text") == encode_text(FOUR)


def test_status_bits():
    rows = re.findall(r"\| (\d) \| (\d) \| ([^|]+)", section("Status"))
    names = ("SYNTHETIC", "INTERFERENCE", "MORE_TRANSMITTERS", "SELF_TEST_FAULT")
    assert [int(value) for _, value, _ in rows] == [getattr(firmware_proto, name) for name in names]
    assert [1 << int(bit) for bit, _, _ in rows] == [int(value) for _, value, _ in rows]
    for name, (_, _, meaning) in zip(names, rows, strict=True):
        assert meaning.replace("-", " ").startswith(name.lower().replace("_", " "))


@pytest.mark.parametrize("form", ENCODERS)
def test_sizes_and_times(form):
    longest = Channel(254, INNER, -0x8000, -0x8000, True)
    sizes = [len(ENCODERS[form](Frame(255, 255, (longest,) * n))) for n in (1, 4, 16)]
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
