"""The ArduPilot driver of the receiver: what it sends, logs and says, and how little it costs."""

import re
import shutil
from random import Random

import pytest

from firmware_proto import MID, Channel, Command, CommandAnswer, Decoder, Frame, encode
from firmware_proto.commands import encode_answer, encode_command
from tests.every import every
from tests.firmware_proto.lua_stubs import FOLDER, Autopilot, as_frame

NAME = "arva_receiver"
FOUR = (Channel(3, 2, 85, 0), Channel(1, MID, 1250, -35), Channel(2, MID, 4020, 17, True), Channel())
PREFIX = "ARVA: "


def raw(sequence, channels=FOUR[:1]):
    return encode(Frame(sequence % 256, 1, channels))


@pytest.fixture
def alone(tmp_path):
    """A folder of scripts with the driver and no search."""
    shutil.copy(FOLDER / f"{NAME}.lua", tmp_path)
    return tmp_path


@pytest.fixture
def autopilot(alone):
    return started(alone)


def started(alone):
    autopilot = Autopilot(alone).start(NAME)
    autopilot.said()
    return autopilot


def feed(autopilot, hertz, seconds, channels=FOUR[:1], first=0):
    """Frames as they come at 115200 baud, in pieces of 4 ms."""
    for k in range(round(hertz * seconds)):
        start = autopilot.time_ms
        data = raw(first + k, channels)
        for at in range(0, len(data), 46):
            autopilot.give(data[at : at + 46], 4)
        autopilot.run(start + round(1000 / hertz))


def rows(autopilot, name):
    return [fields for row, fields in autopilot.rows if row == name]


@pytest.mark.parametrize(("hertz", "n"), [(1, 4), (50, 1), (50, 4), (50, 16)])
def test_no_frame_is_lost(autopilot, hertz, n):
    feed(autopilot, hertz, 6, (FOUR * 4)[:n])
    assert [row["Seq"] for row in rows(autopilot, "ARVA")[::n]] == [k % 256 for k in range(6 * hertz)]
    last = rows(autopilot, "ARVC")[-1]
    assert (last["Crc"], last["Drop"], last["Lost"], last["Up"]) == (0, 0, 0, 1)
    assert autopilot.said() == [PREFIX + f"receiver found, channels: {n}"]


def test_the_first_channel_goes_to_the_ground_station_with_each_frame(autopilot):
    for k, (channel, *values) in enumerate(
        [(FOUR[0], 85, 0, 3, 2), (FOUR[1], 1250, -35, 1, 1), (FOUR[2], 4020, 17, 2, 1), (FOUR[3], -1, -1, 255, 0)]
    ):
        autopilot.give(raw(k, (channel, *FOUR)), 20)
        assert dict(autopilot.floats) == dict(
            zip(("ARVA1_D", "ARVA1_DIR", "ARVA1_ID", "ARVA1_ZONE"), values, strict=True)
        )
        assert len(autopilot.floats) == 4
        autopilot.floats.clear()


def test_every_channel_is_logged(autopilot):
    autopilot.give(encode(Frame(7, 3, FOUR)), 20)
    logged = [(r["Ch"], r["Id"], r["Zone"], r["Mark"], r["D"], r["Dir"]) for r in rows(autopilot, "ARVA")]
    expected = [(c.id if c.id is not None else 255, c.zone, int(c.marked), c.d, c.delta) for c in FOUR]
    assert logged == [(k + 1, *row) for k, row in enumerate(expected)]
    assert {(r["Seq"], r["Stat"], r["N"]) for r in rows(autopilot, "ARVA")} == {(7, 3, 4)}


def test_counters_are_logged_once_a_second(autopilot):
    autopilot.receive(raw(1)[:-1] + b"\x00" + raw(2) + raw(9) + b"junk")
    autopilot.run(autopilot.time_ms + 5100)
    assert rows(autopilot, "ARVC")[0] == {"Good": 2, "Crc": 1, "Drop": 15 + 4, "Lost": 6, "Up": 1}
    assert len(rows(autopilot, "ARVC")) == 5


def test_appears_is_lost_and_comes_back(autopilot):
    feed(autopilot, 1, 3)
    assert autopilot.said() == [PREFIX + "receiver found, channels: 1"]
    heard = autopilot.time_ms - 1000
    autopilot.run(heard + 2980)
    assert autopilot.said() == []
    autopilot.run(heard + 3020)
    assert autopilot.texts[0][0] == 4  # a warning
    assert autopilot.said() == [PREFIX + "receiver lost"]
    autopilot.run(heard + 60_000)
    assert autopilot.said() == []
    feed(autopilot, 1, 2)
    assert autopilot.said() == [PREFIX + "receiver is back after 60 s"]


def test_a_frame_without_a_signal_is_a_good_frame(autopilot):
    feed(autopilot, 1, 10, FOUR[3:])
    assert autopilot.said() == [PREFIX + "receiver found, channels: 1"]


def test_a_port_where_nothing_comes(autopilot):
    autopilot.run(autopilot.time_ms + 60_000)
    assert autopilot.said() == [PREFIX + "no receiver"]
    assert rows(autopilot, "ARVC")[-1]["Up"] == 0


def test_a_port_where_only_noise_comes(autopilot):
    autopilot.give(bytes(500), 5000)
    assert autopilot.said() == [PREFIX + "no receiver", PREFIX + "500 bytes in no frame: baud rate?"]


def test_knocks_at_a_silent_port_and_at_no_other(autopilot):
    """A port on USB is opened again, after it was unplugged, once a write has failed."""
    feed(autopilot, 1, 10)
    assert autopilot.written == []
    silent_since = autopilot.time_ms - 1000
    autopilot.run(silent_since + 6005)
    assert [(ms - silent_since) // 1000 for ms, _ in autopilot.written] == [2, 3, 4, 5]
    assert {byte for _, byte in autopilot.written} == {0}


@every("cut", range(1, 33))
def test_unplugged_inside_a_frame_and_plugged_in_again_inside_another(alone, cut):
    autopilot = started(alone)
    autopilot.give(raw(1, FOUR) + raw(2, FOUR)[:cut], 8000)
    autopilot.give(raw(10, FOUR)[cut:], 1000)
    feed(autopilot, 1, 2, FOUR, first=11)
    assert [row["Seq"] for row in rows(autopilot, "ARVA")[::4]] == [1, 11, 12]
    assert autopilot.said()[1:] == [
        PREFIX + "receiver lost",
        PREFIX + f"{cut} bytes in no frame: baud rate?",
        PREFIX + "receiver is back after 9 s",
    ]


def garbage():
    """Streams that cost a decoder most: heads of false frames inside each other, good ones without a pause."""
    random = Random(457)
    heads = ("A4", "A457", "A45701", "A4570109", "A4570163000010", "A457010F00", "00", "A45702350011")
    pieces = [bytes.fromhex(h) for h in heads]
    for k, piece in enumerate(pieces):
        yield f"heads {k}", piece * (3000 // len(piece))
    yield "mixed", b"".join(random.choice(pieces) for _ in range(1200))
    yield "random", random.randbytes(3000)
    for n in (1, 2, 4, 16):
        yield f"n = {n}", b"".join(raw(k, (FOUR * 4)[:n]) for k in range(3000 // (9 + 6 * n)))
        heads = (bytes.fromhex("A4570163000010") + raw(k, (FOUR * 4)[:n]) for k in range(3000 // (16 + 6 * n)))
        yield f"n = {n} behind false heads", b"".join(heads)


@every("asking", [False, True])
@every("data", [pytest.param(data, id=name) for name, data in garbage()])
def test_a_pass_costs_less_than_the_scripting_engine_allows(alone, data, asking):
    """Also when bytes come as fast as 921600 baud brings them; what is left waits in the port and is not lost."""
    autopilot = Autopilot(alone, **({"ARVA_CMD": 7} if asking else {}))
    autopilot.limit = 8000
    autopilot.start(NAME)
    for at in range(0, len(data), 920):
        autopilot.give(data[at : at + 920], 10)
    autopilot.run(autopilot.time_ms + (6000 if asking else 3000))
    autopilot.give(raw(200), 20)
    assert rows(autopilot, "ARVA")[-1]["Seq"] == 200
    python = Decoder()
    frames = [frame for ms, byte in autopilot.read_log for frame in python.feed(bytes([byte]), ms * (1 + 1e-9) / 1000)]
    assert len(frames) == sum(row["Ch"] == 1 for row in rows(autopilot, "ARVA"))


ANSWERS = encode_answer(CommandAnswer(1, "identify", "done", (4,), "x" * 32))


def ask(autopilot, code, value=-1):
    autopilot.params |= {"ARVA_CMD": code, "ARVA_CMD_VAL": value}
    autopilot.written.clear()
    autopilot.run(autopilot.time_ms + 20)
    return bytes(byte for _, byte in autopilot.written)


def test_a_command_is_sent_once_and_its_answer_said(autopilot):
    feed(autopilot, 1, 2)
    autopilot.said()
    assert ask(autopilot, 2, 3) == encode_command(Command(1, "mark", (3,)))
    assert autopilot.params["ARVA_CMD"] == 0
    autopilot.receive(
        encode_answer(CommandAnswer(9, "mark", "busy")) + raw(2) + encode_answer(CommandAnswer(1, "mark", "done", (3,)))
    )
    autopilot.give(raw(3), 50)
    assert autopilot.said() == [PREFIX + "mark 3: done 3"]
    assert [row["Seq"] for row in rows(autopilot, "ARVA")] == [0, 1, 2, 3]
    assert ask(autopilot, 1) == encode_command(Command(2, "identify"))
    autopilot.give(encode_answer(CommandAnswer(2, "identify", "done", (4,), "paper 1.0 binary")), 50)
    assert autopilot.said() == [PREFIX + "identify: done 4 paper 1.0 binary"]


def test_a_command_is_repeated_twice_and_then_given_up(autopilot):
    data = encode_command(Command(1, "scan"))
    start = autopilot.time_ms
    assert ask(autopilot, 7) == data
    autopilot.run(autopilot.time_ms + 5000)
    times = sorted({ms for ms, byte in autopilot.written if byte == 0xA4})
    assert [round((ms - start) / 1000, 1) for ms in times] == [0, 1, 2]
    for at in times[1:]:  # a knock may come in the same pass
        assert data in bytes(byte for ms, byte in autopilot.written if ms == at)
    assert PREFIX + "scan: no answer" in autopilot.said()


def test_the_answer_to_another_command_of_this_number_is_none(autopilot):
    ask(autopilot, 7)
    autopilot.give(encode_answer(CommandAnswer(1, "mark", "done")), 50)
    assert autopilot.said() == []
    autopilot.give(encode_answer(CommandAnswer(1, "scan", "refused")), 50)
    assert autopilot.said() == [PREFIX + "scan: refused"]


def test_a_restart_is_not_repeated_and_a_second_command_waits(autopilot):
    ask(autopilot, 5)
    autopilot.written.clear()
    autopilot.params |= {"ARVA_CMD": 8, "ARVA_CMD_VAL": -1}
    autopilot.run(autopilot.time_ms + 500)
    assert (autopilot.written, autopilot.params["ARVA_CMD"]) == ([], 8)
    autopilot.run(autopilot.time_ms + 600)
    assert PREFIX + "restart: no answer" in autopilot.said()
    assert bytes(byte for _, byte in autopilot.written) == encode_command(Command(2, "search"))


def test_the_longest_answer_fits_a_text(autopilot):
    ask(autopilot, 1)
    autopilot.give(ANSWERS, 50)
    assert autopilot.said() == [PREFIX + f"identify: done 4 {'x' * 32}"[:44]]


def test_the_table_of_a_frame_holds_no_channel_of_the_one_before():
    autopilot, frames = Autopilot(), []
    receiver = autopilot.require(NAME).start(autopilot.time_ms, lambda frame: frames.append(as_frame(frame)))
    autopilot.receive(raw(1, FOUR) + raw(2, FOUR[3:]) + raw(3, FOUR))
    for _ in range(3):
        receiver.update(autopilot.time_ms)
    assert [len(frame.channels) for frame in frames] == [4, 1, 4]


def test_parameters_choose_the_port(alone):
    autopilot = Autopilot(alone, port=2, ARVA_PORT=3, ARVA_BAUD=57600).start(NAME)
    assert autopilot.baud == 57600
    assert autopilot.said() == [PREFIX + "driver started on scripting port 3"]
    assert autopilot.running


@pytest.mark.parametrize(
    ("port", "params", "text"),
    [
        (None, {}, "no port 1 with SERIALn_PROTOCOL 28"),
        (0, {"ARVA_PORT": 2}, "no port 2 with SERIALn_PROTOCOL 28"),
        (0, {"ARVA_ENABLE": 0}, "disabled"),
    ],
)
def test_it_says_why_it_does_not_run(alone, port, params, text):
    autopilot = Autopilot(alone, port=port, **params).start(NAME)
    assert autopilot.said() == [PREFIX + text]
    assert not autopilot.running


def test_a_fault_is_said_and_the_driver_goes_on(autopilot):
    autopilot.no_room_for = "ARVA"
    feed(autopilot, 1, 2)
    assert len([text for text in autopilot.said() if "internal error: " in text and "no room" in text]) == 2
    autopilot.no_room_for = ""
    feed(autopilot, 1, 2)
    assert len(rows(autopilot, "ARVA")) == 2


def test_it_leaves_the_port_to_the_search_that_lies_beside_it():
    autopilot = Autopilot().start(NAME)
    assert autopilot.said() == [PREFIX + "the receiver is read by arva_search.lua"]
    assert not autopilot.running
    assert autopilot.baud is None


@every("name", ["arva_receiver", "arva_search", "arva_victim"])
def test_every_parameter_is_documented_as_ardupilot_does_it(name):
    source = (FOLDER / f"{name}.lua").read_text(encoding="ascii")
    page = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    blocks = re.findall(r"--\[\[\n((?:  // @.*\n)+)--\]\]\nlocal (\w+) = bind_add_param\(\"(\w+)\", (\d+), ", source)
    assert len(blocks) == source.count("= bind_add_param(")
    (prefix,) = re.findall(r"PARAM_TABLE_PREFIX = \"(\w+)\"", source)
    for number, (block, variable, short, index) in enumerate(blocks, 1):
        fields = dict(re.findall(r"  // @(\w+): (.+)\n", block))
        assert fields["Param"] == variable == prefix + short
        assert {"DisplayName", "Description", "User"} <= set(fields)
        assert {"Values", "Range", "Bitmask"} & set(fields)
        assert int(index) == number
        assert f"## {variable}\n" in page
