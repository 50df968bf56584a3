"""`arva-hil search` as a pilot meets it: what it says, how it ends, and what it then leaves behind."""

from __future__ import annotations

import gc
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from arva_hil.cli import search
from arva_hil.cli.outcome import UsageError
from arva_hil.cli.search_plan import far_end
from arva_hil.cli.search_report import exit_code, found_by, result
from arva_hil.cli.terminal import TerminalQuestion
from arva_hil.clock import RealClock
from arva_hil.events.reasons import Why, because
from arva_hil.links import Link
from arva_hil.links.memory import pair
from arva_hil.links.pty import PtyLink
from arva_hil.links.tcp import TcpServerLink
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.search.mission.choice import HeardTransmitter
from arva_hil.search.mission.outcome import Outcome
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated.autopilot import Mode
from firmware_proto import encode_nmea
from tests.files import rows as table
from tests.files import written
from tests.free_ports import free_port
from tests.said import says

from .far_ends import Arva, Autopilot, Beacon, Keep, Start
from .test_terminal import Terminal

LOW = ("--take-off", 0.5, "--height", 0.5)
ARM, SET_MODE = dialect.MAV_CMD_COMPONENT_ARM_DISARM, dialect.MAV_CMD_DO_SET_MODE
FLYING = "going for transmitter 4"
NOWHERE = ("search", "--autopilot", "pty", "--receiver", "pty")
QUESTION = r"is not known to be a simulator: propellers will turn\. Type yes to let it fly"
QUESTIONS = {
    dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
    dialect.MAV_CMD_REQUEST_MESSAGE,
    dialect.MAV_CMD_GET_HOME_POSITION,
}


@pytest.fixture(autouse=True)
def _no_countdown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARVA_HIL_COUNTDOWN", "0")


def arguments(autopilot: Autopilot, receiver: Beacon | PtyLink | str) -> tuple[str, ...]:
    """A search for this vehicle with the receiver at this place."""
    link = receiver.link if isinstance(receiver, Beacon) else receiver
    return "search", "--autopilot", autopilot.address, "--receiver", link.path if isinstance(link, PtyLink) else link


def heard(autopilot: Autopilot) -> list[Any]:
    """The messages that were sent to it."""
    messages = map(decode, Parser().feed(bytes(autopilot.heard)))
    return [message for message in messages if message is not None]


def orders(autopilot: Autopilot) -> list[int]:
    """The commands it was sent that have an influence on a flight."""
    commands = [message.command for message in heard(autopilot) if message.get_type() == "COMMAND_LONG"]
    return [c for c in commands if c in (ARM, SET_MODE, dialect.MAV_CMD_NAV_TAKEOFF, dialect.MAV_CMD_NAV_LAND)]


def nothing_moves(autopilot: Autopilot) -> None:
    """Of all bytes that were sent to it, none moves it."""
    messages = heard(autopilot)
    assert {m.get_type() for m in messages} <= {"HEARTBEAT", "COMMAND_LONG", "PARAM_REQUEST_READ", "TIMESYNC"}
    assert {m.command for m in messages if m.get_type() == "COMMAND_LONG"} <= QUESTIONS
    assert messages


def pilot(autopilot: Autopilot, mode: Mode) -> None:
    """Somebody else changes the mode."""
    order = dialect.MAVLink_command_long_message(1, 1, SET_MODE, 0, 1, mode, 0, 0, 0, 0, 0)
    read, once = autopilot.link.read, [Encoder(255, 190).pack(order)]
    autopilot.link.read = lambda: read() + (once.pop() if once else b"")  # type: ignore[method-assign]


def test_it_finds_what_an_emulator_hears_and_lands(start: Start, tmp_path: Path) -> None:
    scenario = written(tmp_path / "near.yaml", "transmitters: [{id: 4, ned: [2, -3, 0]}]\n")
    ours, theirs, port = (f"{tmp_path}/{name}" for name in ("ours", "theirs", "arva0"))
    start("vehicle", "--link", f"pty:{ours}", "--link", f"pty:{theirs}").says("on the ground")
    emulator = start("run", "--autopilot", theirs, "--port", f"pty:{port}", "--scenario", scenario)
    emulator.says("readings are real")
    program = start("search", "--autopilot", ours, "--receiver", port, "--json", *LOW)
    program.ends()
    found = json.loads(program.out)
    assert (found["outcome"], found["id"]) == ("found", 4)
    assert [found["found"][axis] for axis in ("north", "east")] == pytest.approx([2, -3], abs=0.5)


# -- before anything flies ---------------------------------------------------------------------------------


def test_the_way_is_told_before_anything_flies(arva: Arva) -> None:
    first, second, *_ = arva(*NOWHERE, "--timeout", 0.3, "--area=-100,-100,100,100", code=3).err.splitlines()
    assert first.startswith("autopilot: pty (/dev/")
    assert second.startswith("strategy estimate; strips of ")
    assert second.endswith(" at 1 m/s, more than the 900 s there are")


def test_without_an_autopilot_there_is_a_log_and_without_matplotlib_the_cure(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    _, out, err = arva(*NOWHERE, "--timeout", 0.3, "--json", "--record", tmp_path, code=3)
    assert "error: no autopilot: no byte came: is the autopilot powered" in err
    assert err.endswith(f"log: {tmp_path}/search.csv; for a picture: pip install 'arva-hil[plots]'\n")
    assert json.loads(out)["outcome"] == "no link"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["search.csv", "search.json", "search.jsonl"]
    assert json.loads((tmp_path / "search.json").read_text())["exit_code"] == 3


def test_a_port_that_is_none_leaves_no_record_and_one_port_cannot_be_both(
    arva: Arva, line: PtyLink, tmp_path: Path
) -> None:
    err = arva("search", "--autopilot", "pty", "--receiver", tmp_path, "--record", tmp_path / "record", code=3).err
    assert f"{tmp_path}: is a directory" in err
    assert not (tmp_path / "record").exists()
    assert f"{line.path}: busy" in arva("search", "--autopilot", line.path, "--receiver", line.path, code=3).err


def test_a_receiver_whose_port_is_not_there_in_time_is_the_reason_given(start: Start, autopilot: Autopilot) -> None:
    program = start(*arguments(autopilot, "/dev/ttyNONE7"), "--timeout", 1).after(
        "waiting for /dev/ttyNONE7: no such port; "
    )
    assert "error: no frame from the receiver: /dev/ttyNONE7: no such port" in program.ends(3)


def test_links_that_come_later_or_are_lost_on_the_ground_are_waited_for(
    start: Start, keep: Keep, tmp_path: Path
) -> None:
    port, path = free_port(socket.SOCK_STREAM), str(tmp_path / "receiver")
    url = f"tcp:127.0.0.1:{port}"
    program = start("search", "--autopilot", url, "--receiver", path, *LOW).after(
        f"waiting for {url}: connection refused", f"waiting for {path}: no such port"
    )
    first, line = Autopilot(TcpServerLink("127.0.0.1", port)), PtyLink(path)
    try:
        program.says(f"{url}: is open", f"{path}: is open", "waiting for a frame from the receiver")
    finally:
        first.close()
        line.close()
    program.says(*(rf"\nwarning: {name}: lost" for name in (url, path)))
    assert orders(first) == []
    keep(Autopilot(keep(TcpServerLink("127.0.0.1", port))))
    keep(Beacon(symlink=path))
    program.says("arming ardupilotmega quadrotor 1/1")
    for name in (url, path):
        assert f"\n{name}: back after " in program.err
    program.says(FLYING)
    program.stops(signal.SIGINT)


def test_in_flight_the_garbage_collector_does_not_visit_the_objects_of_the_start(
    arva: Arva, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[list[object]] = []
    monkeypatch.setattr(search, "describe", lambda plan: begun.append([object()]) or "as planned")
    monkeypatch.setattr(search, "run", lambda *_, **options: begun.append(gc.get_objects()))
    arva(*NOWHERE, code=1)
    assert not any(one is begun[0] for one in begun[1])


def test_a_lost_link_of_an_autopilot_is_opened_again_until_a_search_on_it_has_launched(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    openers: dict[str, Any] = {}

    def opened(url: str, clock: Any, opener: Any, patient: bool) -> Link:
        openers[url] = opener.keywords["wanted"]
        return pair()[0]

    monkeypatch.setattr(search.common, "open_or_fail", opened)
    options = SimpleNamespace(target_component=None, stream_rate=10.0)
    members = [search.Member("a", 1, "both", "a", "binary"), search.Member("b", 2, "both", "b", "binary")]
    with ExitStack() as stack:
        searchers = search._searchers(options, members, [None, None], None, RealClock(), stack)  # type: ignore[arg-type, list-item]
        assert [wanted() for wanted in openers.values()] == [True, True, True]
        searchers[1].client = SimpleNamespace(launched=True)  # type: ignore[assignment]
        assert {url for url, wanted in openers.items() if not wanted()} == {"both"}


def test_a_search_is_never_overwritten(arva: Arva, tmp_path: Path) -> None:
    (tmp_path / "search.csv").write_text("of yesterday")
    assert f"{tmp_path}: holds a search already (search.csv); name another folder" in arva.refused(
        *NOWHERE, "--record", tmp_path
    )
    assert (tmp_path / "search.csv").read_text() == "of yesterday"


def test_without_frames_nothing_is_armed(start: Start, autopilot: Autopilot, line: PtyLink) -> None:
    err = start(*arguments(autopilot, line), "--timeout", 2).ends(3)
    assert err.endswith(f"\nerror: no frame from the receiver at {line.path}: nothing came\n")
    assert orders(autopilot) == []


def test_frames_of_another_format_are_shown(start: Start, autopilot: Autopilot, keep: Keep) -> None:
    err = start(*arguments(autopilot, keep(Beacon(encode_nmea))), "--timeout", 2).ends(3)
    says(err, "bytes came that are none, first b'", "PARVA")
    assert orders(autopilot) == []


def test_on_the_ground_there_is_nothing_to_take_over(start: Start, autopilot: Autopilot, beacon: Beacon) -> None:
    err = start(*arguments(autopilot, beacon), "--take-over", "--timeout", 3).ends(1)
    assert err.endswith("\nerror: the vehicle is not taken over: it is not armed\n")
    assert orders(autopilot) == []


def test_a_port_that_another_program_listens_to_is_busy(start: Start, autopilot: Autopilot, beacon: Beacon) -> None:
    listener = start("listen", beacon.link.path).after("listening")
    err = start(*arguments(autopilot, beacon)).ends(3)
    says(err, f"arva-hil: {beacon.link.path}: busy: held by ", f"{listener.process.pid} (")
    assert orders(autopilot) == []


def test_nothing_is_armed_while_somebody_else_reads_the_receiver(
    start: Start, autopilot: Autopilot, beacon: Beacon
) -> None:
    """One who heeds no lock, and opens the port after the search has."""
    beacon.quiet.set()
    program = start(*arguments(autopilot, beacon)).after("waiting for a frame from the receiver")
    with open(beacon.link.path, "rb", buffering=0) as port, subprocess.Popen(["sleep", "60"], stdin=port) as other:
        beacon.quiet.clear()
        program.ends(3)
        other.kill()
    said = f"error: {beacon.link.path} is read by {other.pid} (sleep 60) too, and each gets a part of the frames; "
    assert said + "close the other program\n" in program.err
    assert orders(autopilot) == []


# -- in the air --------------------------------------------------------------------------------------------


def test_it_counts_down_and_ctrl_c_leaves_it_hovering(
    start: Start, autopilot: Autopilot, beacon: Beacon, tmp_path: Path
) -> None:
    program = start(
        *arguments(autopilot, beacon), *LOW, "--countdown", 3, "--json", "--record", tmp_path / "record", draws=True
    ).after("is a simulator: it answers with SIMSTATE", "arming in 3 s")
    assert orders(autopilot) == []
    program.says("going for transmitter 4, 20.0 m away")
    says(
        program.err,
        "arming in 1 s",
        "without set-points it stops after 3 s (GUID_TIMEOUT), and hovers in GUIDED, armed",
    )
    assert "interrupted; nothing found\n" in program.stops(signal.SIGINT)
    assert "transmitter 9 was received, but not found; nearest, 45.0 m away, at " in program.err
    said = json.loads(program.out)
    assert (said["outcome"], said["how"], said["found"]) == ("failed", "interrupted", None)
    assert [other["id"] for other in said["others"]] == [4, 9]
    assert orders(autopilot)[-1] == dialect.MAV_CMD_NAV_TAKEOFF  # nothing lands it
    recorded = json.loads((tmp_path / "record" / "search.json").read_text())
    assert recorded == recorded | said | {"exit_code": 130}
    rows = table(tmp_path / "record" / "search.csv")
    assert {row["phase"] for row in rows} >= {"climbing", "flying"}
    assert {(row["id"], row["d_cm"]) for row in rows if row["id"]} == {("4", "2000")}
    assert (tmp_path / "record" / "search.png").read_bytes().startswith(b"\x89PNG")


def test_the_pilot_takes_over(start: Start, autopilot: Autopilot, beacon: Beacon) -> None:
    program = start(*arguments(autopilot, beacon), *LOW).after(FLYING)
    pilot(autopilot, Mode.LOITER)
    program.ends(1)
    assert (
        "error: the mode is LOITER: the pilot or a failsafe has taken over; nothing found" in program.err.splitlines()
    )
    assert orders(autopilot) == [SET_MODE, ARM, dialect.MAV_CMD_NAV_TAKEOFF]


def test_the_receiver_is_unplugged(start: Start, autopilot: Autopilot, tmp_path: Path) -> None:
    path = str(tmp_path / "arva0")
    with closing(Beacon(symlink=path)):
        program = start(*arguments(autopilot, path), *LOW, "--patience", 3).after(FLYING)
    program.ends(1)
    for line in (
        f"warning: {path}: lost: closed by the far end, searching for it",
        "warning: no frame for 2 s: hovering",
        "no good frame from the receiver for 3 s; landing",
        "error: no good frame from the receiver for 3 s; nothing found",
    ):
        assert f"\n{line}" in program.err
    assert orders(autopilot)[-1] == dialect.MAV_CMD_NAV_LAND


def test_the_autopilots_link_is_lost(start: Start, beacon: Beacon, tmp_path: Path) -> None:
    with closing(Autopilot(PtyLink(path := str(tmp_path / "fc")))):
        program = start("search", "--autopilot", path, "--receiver", beacon.link.path, *LOW).after(FLYING)
    assert f"error: {path}: lost" in program.ends(1)
    assert "searching for it" not in program.err
    assert "the vehicle is left to its own failsafe: it stops after 3 s (GUID_TIMEOUT), and hovers" in program.err


def test_two_ctrl_c_end_it_at_once(start: Start, autopilot: Autopilot, beacon: Beacon) -> None:
    program = start(*arguments(autopilot, beacon)).after("arming")
    autopilot.pause()  # it will never say that it is disarmed
    program.send(signal.SIGINT)
    program.says("interrupted: the vehicle ")
    program.stops(signal.SIGINT)


# -- a vehicle that is not known to be a simulator: --yes, a typed yes, or exit code 2 -------------------------


def test_without_a_terminal_and_a_yes_it_is_refused(start: Start, real: Autopilot, beacon: Beacon) -> None:
    program = start(*arguments(real, beacon), "--json", env=os.environ | {"ARVA_HIL_YES": "1"})
    assert "is not known to be a simulator: to let it fly, write --yes\n" in program.ends(2)
    assert "warning: ARVA_HIL_YES is not read: type --yes each time" in program.err
    assert b'"outcome": "refused"' in program.out
    assert orders(real) == []


def test_yes_on_the_command_line(start: Start, real: Autopilot, beacon: Beacon) -> None:
    program = start(*arguments(real, beacon), "--yes").after(
        "warning: .* is not known to be a simulator; --yes", "arming"
    )
    program.stops(signal.SIGINT)


@pytest.mark.parametrize("typed", [b"yes\n", b"no\n", b"\x03"])
def test_the_answer_is_typed_at_the_terminal(
    start: Start, real: Autopilot, beacon: Beacon, keep: Keep, typed: bytes
) -> None:
    terminal = keep(Terminal(160))
    terminal.types(b"yes\n")  # before the question: no answer
    program = start(*arguments(real, beacon), stdin=terminal.slave, stderr=terminal.slave)
    terminal.shows(QUESTION)
    assert ARM not in orders(real)
    if typed == b"\x03":  # this is not the terminal that controls the program
        program.stops(signal.SIGINT)
        assert orders(real) == []
        return
    terminal.types(typed)
    if typed == b"yes\n":
        terminal.shows("arming")
        program.stops(signal.SIGINT)
        return
    terminal.shows("the answer was not yes: nothing was done")
    program.ends(2)
    assert orders(real) == []


def test_no_question_is_asked_that_nobody_sees(start: Start, real: Autopilot, beacon: Beacon, keep: Keep) -> None:
    assert "to let it fly, write --yes" in start(*arguments(real, beacon), stdin=keep(Terminal(160)).slave).ends(2)


@pytest.mark.parametrize(("typed", "answer"), [(b"yes\n", "yes"), (b"\x04", ""), (b"ye\x7fs\n", "ys")])
def test_in_the_background_nothing_is_read_for_that_would_stop_the_program(
    keep: Keep, monkeypatch: pytest.MonkeyPatch, typed: bytes, answer: str
) -> None:
    terminal = keep(Terminal(80))
    question = TerminalQuestion(lambda text: None, terminal.slave)
    terminal.types(typed)
    monkeypatch.setattr(os, "tcgetpgrp", lambda fd: os.getpgrp() + 1)
    assert question.answer() is None
    monkeypatch.setattr(os, "tcgetpgrp", lambda fd: os.getpgrp())
    assert question.answer() == answer


# -- all but arming and moving -------------------------------------------------------------------------------


def test_a_dry_run_says_what_it_would_order_and_orders_nothing(
    start: Start, autopilot: Autopilot, beacon: Beacon, tmp_path: Path
) -> None:
    folder = tmp_path / "record"
    program = start(*arguments(autopilot, beacon), "--dry-run", "--json", "--record", folder)
    told = program.ends()
    nothing_moves(autopilot)
    steps = ["DO_SET_MODE: GUIDED", "COMPONENT_ARM_DISARM: arm", "NAV_TAKEOFF: to 3 m above the take-off point"]
    steps += ["SET_POSITION_TARGET_LOCAL_NED: ", "NAV_LAND: at the end"]
    places = [told.index(step) for step in steps]
    assert places == sorted(places)
    assert "arming" not in told
    assert told.count("SET_POSITION_TARGET_LOCAL_NED: ") >= 4
    assert "dry run: nothing was ordered; it would have flown" in told
    made = json.loads(program.out)
    assert made["outcome"] == "would fly"
    assert [order["order"] for order in made["would_order"]][:3] == [step.partition(":")[0] for step in steps[:3]]
    assert "dry run" in (folder / "search.csv").read_text()


def test_a_dry_run_needs_neither_yes_nor_a_terminal(start: Start, real: Autopilot, beacon: Beacon) -> None:
    """A variable that is left in a shell makes it safer, and so it counts."""
    program = start(*arguments(real, beacon), env=os.environ | {"ARVA_HIL_DRY_RUN": "1"})
    program.says("is not known to be a simulator: before it flies, it would need --yes")
    program.says("SET_POSITION_TARGET_LOCAL_NED: ")
    program.stops(signal.SIGINT)
    nothing_moves(real)


# -- beside it -----------------------------------------------------------------------------------------------


def test_a_ground_station_gets_what_the_search_reads_on_a_link_of_its_own(
    start: Start, autopilot: Autopilot, beacon: Beacon
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(60)
        program = start(
            *(*arguments(autopilot, beacon), "--dry-run", "--yes"),
            *("--gcs", f"udpout:127.0.0.1:{station.getsockname()[1]}"),
        )
        parser, types, values = dialect.MAVLink(None), set(), {}
        while len(values) < 4:
            for message in parser.parse_buffer(bytearray(station.recv(65536))) or []:
                types.add(message.get_type())
                if message.get_type() == "NAMED_VALUE_FLOAT":
                    values[message.name] = message.value
        program.send(signal.SIGINT)
        program.ends(0, 130)
    assert values == {"arva_d": 20.0, "arva_delta": 10.0, "arva_zone": 1.0, "arva_id": 4.0}
    heard = dialect.MAVLink(None).parse_buffer(bytearray(autopilot.heard)) or []
    assert not {message.get_type() for message in heard} & {"NAMED_VALUE_FLOAT", "ADSB_VEHICLE"}


# -- `arva-hil search` with the vehicles of a scenario: what it refuses, and that each vehicle has its own searc--


DATUM = "datum: {lat: 46.0123, lon: 7.7456, alt: 1650}\n"
FIELD = f"spec: 2\n{DATUM}transmitters: [{{id: 4, ned: [14, -10, 0.5]}}]\nvehicles:\n"
ONE = "  - {name: a, system: 1, receivers: [{name: r, port: 'pty:/tmp/none-a'}]}\n"
TWO = "  - {name: b, system: 2, receivers: [{name: r, port: 'pty:/tmp/none-b'}]}\n"


@pytest.fixture
def field(tmp_path: Path) -> Path:
    return written(tmp_path / "field.yaml", FIELD + ONE + TWO)


@pytest.mark.parametrize(
    ("old", "new", "words", "what"),
    [
        (DATUM, "", "", "datum: home: several searches need one in common: datum: {lat, lon, alt}"),
        ("vehicles:\n" + ONE + TWO, "", "", "0 vehicles, expected 1 to 64 that search"),
        ("system: 2", "system: 1, autopilot: /dev/b", "", "system 1 twice: each vehicle that searches needs its own"),
        ("system: 2", "autopilot: /dev/b", "", "b: its system is missing"),
        ("pty:/tmp/none-b", "pty", "", "b: its port is a new pseudo-terminal each time: name it, e.g. pty:/tmp/NAME"),
        ("[{name: r, port: 'pty:/tmp/none-b'}]", "[{name: r, port: pty}, {name: s, port: pty}]", "", "b: 2 receivers"),
        ("none-b'", "none-b', format: text", "", "format text: several drones need binary or nmea"),
        ("", "", "--victims 2", "--victims: several drones share the transmitters"),
        ("", "", "--receiver /tmp/x", "--receiver: of one search: with --scenario, name its --vehicle"),
        ("", "", "--gcs udpout:127.0.0.1:1", "--gcs: of one search"),
        ("", "", "--foxglove on", "--foxglove: of one search"),
        ("", "", "--area=-20,-3,20,3", "2 drones would have 3.0 m each"),
        ("", "", "--vehicle c", "--vehicle c: "),
        ("pty:/tmp/none-b", "pty:/tmp/../tmp/none-a", "", "its port /tmp/../tmp/none-a is also the port of a: each"),
        (
            "pty:/tmp/none-b",
            "pty:/dev/none",
            "",
            "b: its port /dev/none is also the autopilot of b: each needs its own",
        ),
        ("pty:/tmp/none-b", "log.tlog", "", "b: its port log.tlog is a log"),
        ("pty:/tmp/none-b", "-", "", "b: its port is stdout, where no frames can be read: name a port"),
        ("", "", "--autopilot -", "a: its autopilot is stdout, which cannot be read"),
        (
            "pty:/tmp/none-b",
            "udpout:127.0.0.1:1",
            "--autopilot udpin:0.0.0.0:1",
            "udpin:127.0.0.1:1, the port of b, cannot",
        ),
    ],
)
def test_what_is_no_team_is_refused(arva: Arva, field: Path, old: str, new: str, words: str, what: str) -> None:
    field.write_text(field.read_text().replace(old, new))
    assert what in arva.refused("search", "--scenario", field, "--autopilot", "/dev/none", *words.split())


@pytest.mark.parametrize(("words", "places"), [((), ([0.3, 0, 0.1], [0, 0, 0])), (["--mount=1,2,3"], ([1, 2, 3],) * 2)])
def test_each_drone_knows_where_the_scenario_has_mounted_its_receiver(
    arva: Arva, field: Path, monkeypatch: pytest.MonkeyPatch, words: Sequence[str], places: Sequence[Sequence[float]]
) -> None:
    plans: list[SearchPlan] = []

    def client(plan: SearchPlan, *_: object, **__: object) -> None:
        plans.append(plan)
        if len(plans) == len(places):
            raise UsageError("enough")

    monkeypatch.setattr(search, "SearchClient", client)
    field.write_text(
        field.read_text().replace("none-a'", "none-a', mount: {position: [0.3, 0, 0.1], sling: {length_m: 6}}")
    )
    err = arva("search", "--scenario", field, "--autopilot", "pty", *words, code=2).err
    assert "a receiver hangs on a rope, which the search does not know: places are up to 6 m too high" in err
    assert [plan.mount.pose((0, 0, 0), (1, 0, 0, 0))[0].tolist() for plan in plans] == list(places)


def test_two_links_that_listen_at_one_port_are_refused(arva: Arva, field: Path) -> None:
    on = "system: {}, autopilot: 'udpin:{}:14990'"
    field.write_text(
        field.read_text().replace("system: 1", on.format(1, "127.0.0.1")).replace("system: 2", on.format(2, "0.0.0.0"))
    )
    assert "so udpin:127.0.0.1:14990, the autopilot of a, cannot listen there too: choose another port" in arva.refused(
        "search", "--scenario", field
    )


@pytest.mark.parametrize("there", ["b/search.csv", "b", "a symlink"])
def test_a_record_that_cannot_be_made_for_one_is_begun_for_none(
    arva: Arva, field: Path, tmp_path: Path, there: str
) -> None:
    record, elsewhere = tmp_path / "record", tmp_path / "elsewhere"
    elsewhere.mkdir()
    if there == "a symlink":
        record.mkdir()
        (record / "b").symlink_to(elsewhere)
    else:
        (record / there).parent.mkdir(parents=True)
        (record / there).touch()
    err = arva.refused("search", "--scenario", field, "--autopilot", "/dev/none", "--record", record)
    assert f"{record / 'b'}: " in err
    assert "waiting for" not in err
    assert there != "a symlink" or "is no folder of its own; name another folder" in err
    assert [*elsewhere.iterdir(), *record.iterdir()] == [record / "b"]


@pytest.mark.parametrize(
    ("port", "read"),
    [
        ("pty:/tmp/a", "/tmp/a"),
        ("/dev/ttyUSB0,115200", "/dev/ttyUSB0,115200"),
        ("udpout:[::1]:5", "udpin:[::1]:5"),
        ("tcpin:5", "tcp:127.0.0.1:5"),
    ],
)
def test_frames_are_read_where_they_come_out(port: str, read: str) -> None:
    assert far_end(port, "a") == read


def test_without_links_and_without_a_scenario_it_says_what_is_missing(arva: Arva, field: Path) -> None:
    assert "a: its autopilot is missing: name its link, or --autopilot" in arva.refused("search", "--scenario", field)
    assert "--vehicle a: one of the vehicles of --scenario FILE, which is missing" in arva.refused(
        "search", "--vehicle", "a"
    )


def test_two_searches_on_one_link_have_a_vehicle_each(start: Start, field: Path, keep: Keep, tmp_path: Path) -> None:
    ports = {name: f"{tmp_path}/{name}" for name in "ab"}
    for port in ports.values():
        keep(Beacon(symlink=port))
    port = free_port(socket.SOCK_DGRAM)
    text = field.read_text().replace("/tmp/none-a", ports["a"]).replace("/tmp/none-b", ports["b"])
    for system, host in ((1, "127.0.0.1"), (2, "localhost")):  # two spellings of one link
        text = text.replace(f"system: {system}", f"system: {system}, autopilot: 'udpin:{host}:{port}'")
    field.write_text(text)
    start("vehicle", "--count", 2, "--link", f"udpout:127.0.0.1:{port}")
    words = ("--dry-run", "--json")
    search = start("search", "--scenario", field, *words, "--record", tmp_path / "record")
    search.ends()
    made = {one["vehicle"]: one for one in map(json.loads, search.out.decode().splitlines())}
    for name, system in (("a", 1), ("b", 2)):
        orders = [order["order"] for order in made[name]["would_order"]]
        assert orders[:3] == ["DO_SET_MODE", "COMPONENT_ARM_DISARM", "NAV_TAKEOFF"]
        says(
            search.err,
            f"{name}: vehicle ardupilotmega quadrotor {system}/1",
            f"{name}: system {system}, autopilot: udpin:127.0.0.1:{port}",
        )
        assert '"vehicle_found"' in (tmp_path / "record" / name / "search.jsonl").read_text()
    alone = start("search", "--scenario", field, "--vehicle", "b", *words)
    alone.says("vehicle ardupilotmega quadrotor 2/1")
    assert "quadrotor 1/1" not in alone.stops(signal.SIGINT).replace("ignored", "")


@pytest.mark.parametrize(
    ("kinds", "code"),
    [
        (["found", "not found"], 0),
        (["not found", "not found"], 1),
        (["not sure"], 1),
        (["found", "failed"], 1),
        (["found", "refused"], 2),
        (["no link", "found"], 3),
        (["would fly", "would fly"], 0),
    ],
)
def test_a_team_succeeds_if_something_was_found_and_nothing_failed(kinds: list[Any], code: int) -> None:
    assert exit_code([Outcome(kind, ()) for kind in kinds]) == code


def test_a_search_that_did_not_begin_reports_no_frames() -> None:
    assert len(result(Outcome("failed", (because(Why.INTERRUPTED),)))) == 1


def test_what_another_drone_has_found_is_not_said_to_be_lacking() -> None:
    heard = ((2, HeardTransmitter(18.0, (0.7, 0.8))), (3, HeardTransmitter(31.0, (4.0, 5.0))))
    found = Outcome("found", (because(Why.FOUND),), id=1, others=heard)
    outcomes = {
        "a": found,
        "b": Outcome("found", (because(Why.FOUND),), id=2),
        "c": Outcome("not sure", (because(Why.NOT_SURE),), id=3),
    }
    assert found_by(outcomes) == {1: "a", 2: "b"}
    *_, second, third = result(found, found_by(outcomes))
    assert second == "transmitter 2 was received, and found by b"
    assert third.startswith("transmitter 3 was received, but not found; nearest, 31.0 m away, at 4.0 m north")
