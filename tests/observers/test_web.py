"""The page: what it is told, its server, records on it, and the picture under its map."""

from __future__ import annotations

import http.client
import io
import json
import math
import socket
import threading
import tracemalloc
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from arva_hil.cli.main import main
from arva_hil.clock import StepClock, Waitable
from arva_hil.events import (
    DatumSet,
    Event,
    FrameMade,
    LinkBack,
    LinkLost,
    PacketsReceived,
    ReceiverStatus,
    StatusReport,
    VehicleStatus,
)
from arva_hil.events.searches import (
    BeliefChanged,
    FrameHeard,
    FromSearch,
    MarkLost,
    PlaceFound,
    SearchBegun,
    TakeOffPoint,
    TransmitterChosen,
    TransmitterLeft,
    VictimNoted,
    WaitingFor,
)
from arva_hil.events.vehicles import AutopilotText, VehicleFound, VehicleLost
from arva_hil.mavlink.codec import Encoder, Parser, dialect
from arva_hil.model.field import LocalFrame, rotation
from arva_hil.model.field.dipole import Transmitters
from arva_hil.model.field.terrain import TerrainGrid
from arva_hil.model.field_lines import field_lines
from arva_hil.model.receiver import ChannelReading, Look, PaperReceiver, Pose
from arva_hil.model.receiver.paper import Antennas
from arva_hil.observers.web.address import HostPort, parse_address
from arva_hil.observers.web.background import REACH_M, Background, map_file, terrain
from arva_hil.observers.web.health import CHECKS
from arva_hil.observers.web.jsons import TextHistory
from arva_hil.observers.web.page import WebPage
from arva_hil.observers.web.server import Server, WebError, pages
from arva_hil.observers.web.state import State
from arva_hil.observers.web.viewer import RecordedState
from arva_hil.records.reading import load
from firmware_proto import Channel, Frame
from tests.every import every
from tests.made_frames import frame_made
from tests.made_records import write_search, write_team
from tests.once import once
from tests.undrawn import undrawn

HOME = (46.0, 7.0, 1650.0)


def made(
    number: int, north: float = 0.0, d_cm: int = 1234, *, pose: bool = True, receiver: str = "receiver"
) -> FrameMade:
    where = Pose([north, 2.0, -3.0], np.eye(3)) if pose else None
    channels = ChannelReading(7, 1, d_cm, -12, 12.5), ChannelReading(None, 0, -1, -1, 80.0)
    return frame_made(number, *channels, pose=where, of=("vehicle", receiver), age_s=0.02, late_s=0.5)


def status(time_s: float = 1.0, transmitters: Transmitters | None = None, vehicle: str = "vehicle") -> StatusReport:
    receiver = ReceiverStatus("receiver", None, 10, 2, transmitters)
    rates = {"ATTITUDE": 49.6, "GLOBAL_POSITION_INT": 50.0, "OTHER": 0.0}
    counters, source = (("bad_checksums", 3),), ("autopilot", 1)
    return StatusReport(time_s, [VehicleStatus(vehicle, "quadrotor 1/1", rates, [receiver], counters, source)])


def transmitters(*places: tuple[float, float, float], roll: float = 0.0, pitch: float = 0.0) -> Transmitters:
    turned = rotation.to_matrix(rotation.from_euler(roll, pitch, 0.5))
    n = len(places)
    return Transmitters(tuple(range(1, n + 1)), np.array(places).reshape(n, 3), np.array([turned] * n), np.ones(n))


def state_of(events: list[Event], kind: str = "run", title: str = "", **options: Any) -> State:
    state = State(kind, title, **options)
    state.update(events)
    return state


def shown(state: State, since: int = 0) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(state.document(since), parse_constant=lambda name: pytest.fail(name))
    return document


def test_a_reading_is_shown_with_its_place_and_its_true_range() -> None:
    document = shown(state_of([made(3, 10.0)], "run", "victim.yaml"))
    assert (document["kind"], document["title"], document["known"]) == ("run", "victim.yaml", True)
    (receiver,) = document["receivers"]
    assert receiver["points"] == [
        [3.0, 10.0, 2.0, -3.0, 0.0, 20.0, 500.0, [[7, 1, 1234, -12, 12.5], [None, 0, -1, -1, 80.0]], 3]
    ]


def test_asked_again_it_tells_what_is_new() -> None:
    state = state_of([made(0), made(1)])
    first = shown(state)
    assert first["full"]
    state.update([made(2), AutopilotText(2.0, "vehicle", "low battery")])
    news = shown(state, first["version"])
    assert not news["full"]
    assert [point[0] for point in news["receivers"][0]["points"]] == [2.0]
    assert [event[2] for event in news["events"]] == ["the autopilot reports: low battery"]
    assert shown(state, news["version"])["receivers"][0]["points"] == []
    for unknown in (-5, 10**9):
        assert [point[0] for point in shown(state, unknown)["receivers"][0]["points"]] == [0.0, 1.0, 2.0]


def test_clients_that_ask_the_same_share_one_answer() -> None:
    state = state_of([made(0)])
    assert state.document(1) is state.document(1)
    state.update([])
    assert state.document(1) is state.document(1)
    assert all(len(state.document(since)) > 10 for since in range(200))


def test_without_anything_there_is_a_whole_document() -> None:
    state = State("replay", "")
    state.draw_field()
    document = shown(state)
    assert (document["receivers"], document["transmitters"], document["search"]) == ([], [], None)
    assert json.loads(state.field())["transmitters"] == []


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_pose_that_is_no_number_is_null(value: float) -> None:
    state = state_of(
        [made(0, value), made(1, pose=False), status(1.0, transmitters((value, 0.0, 0.0), (1.0, 2.0, 3.0)))]
    )
    state.draw_field()
    document = shown(state)
    assert [point[1] for point in document["receivers"][0]["points"]] == [None, None]
    assert [one["id"] for one in document["transmitters"]] == [2]


def test_many_readings_take_bounded_memory_and_the_newest_are_all_there() -> None:
    state = State("replay", "")
    version = 0
    for block in range(20):
        version = shown(state)["version"] if block == 19 else 0
        state.update([made(0, d_cm=block + 1)] * 10_000)
    document = state.document()
    assert len(document) < 1_000_000
    (receiver,) = json.loads(document)["receivers"]
    assert receiver["frames"] == 200_000
    assert len(receiver["points"]) <= 4500
    assert receiver["points"][-1][7][0][2] == 20
    assert shown(state, version)["full"]  # more than is kept came since


def test_a_history_keeps_everything_of_late_and_less_of_long_ago() -> None:
    history = TextHistory(recent=100, old=50)
    for number in range(10_000):
        history.extend([str(number)], number)
    whole = [int(text) for text in history.whole()]
    assert whole[-100:] == list(range(9900, 10_000))
    old = whole[:-100]
    assert 25 <= len(old) <= 51
    assert old[0] == 0
    assert len({b - a for a, b in pairwise(old)}) == 1
    assert history.since(9997) == ["9998", "9999"]
    assert history.since(9000) is None


def test_what_comes_from_outside_is_escaped() -> None:
    state = State("run", "<b>")
    state.update(
        [
            VehicleFound(1.0, "vehicle", "</script><img src=x>\u202e\x1b[2J", 2, False),
            AutopilotText(1.0, "vehicle", "a\nb & <i>"),
        ]
    )
    document = state.document()
    assert not {b"<", b">", b"&", b"\x1b", "\u202e".encode()} & {
        document[i : i + n] for i in range(len(document)) for n in (1, 3)
    }
    assert shown(state)["vehicles"][0]["label"] == "</script><img src=x>\\u202e\\x1b[2J"


def test_streams_counters_and_links_are_shown() -> None:
    state = state_of([status(), VehicleLost(2.0, "vehicle", "q", 3.0)], asked_hz={"ATTITUDE": 50.0})
    state.health.add_link("port", "/dev/ttyUSB0")
    state.update([LinkLost(2.0, "port", "/dev/ttyUSB0", "unplugged")])
    (vehicle,) = shown(state)["vehicles"]
    assert vehicle["streams"] == [
        {"name": "ATTITUDE", "hz": 49.6, "asked_hz": 50.0},
        {"name": "GLOBAL_POSITION_INT", "hz": 50.0, "asked_hz": None},
    ]
    assert vehicle["counters"] == {"bad_checksums": 3}
    assert vehicle["receivers"] == [{"name": "receiver", "frames": 10, "dropped": 2}]
    assert vehicle["silent"]
    (link,) = shown(state)["links"]
    assert (link["open"], link["losses"], link["why"]) == (False, 1, "unplugged")
    state.update([LinkBack(3.0, "port", "/dev/ttyUSB0", 1.0)])
    assert shown(state)["links"][0]["open"]


def packets(time_s: float, *messages: Any, link: str = "autopilot") -> PacketsReceived:
    parser, encoder = Parser(), Encoder(1, 1)
    return PacketsReceived(time_s, link, parser.feed(b"".join(map(encoder.pack, messages))))


def checks(state: State) -> dict[str, list[str]]:
    (vehicle,) = shown(state)["vehicles"]
    return {name: [level, value, cure] for level, name, value, cure in vehicle["checks"]}


def test_the_vehicle_s_own_state_is_shown_with_the_cure() -> None:
    state = State("run", "")
    beat = dialect.MAVLink_heartbeat_message(2, 3, 128, 4, 4, 3)  # of an ArduCopter: GUIDED, armed
    power = dialect.MAVLink_sys_status_message(0, 0, 0, 0, 15100, -1, 12, 0, 0, 0, 0, 0, 0)
    fix = dialect.MAVLink_gps_raw_int_message(0, 1, 0, 0, 0, 0, 0, 0, 0, 3)
    lost = dialect.MAVLink_ekf_status_report_message(0, 0, 0, 0, 0, 0)
    other = dialect.MAVLink_sys_status_message(0, 0, 0, 0, 15100, -1, 99, 0, 0, 0, 0, 0, 0)
    state.update([status(), packets(5.0, beat, power, fix, lost), packets(5.0, other, link="autopilot of another")])
    said = checks(state)
    assert said["mode"] == ["good", "GUIDED, armed", ""]
    assert said["battery"] == ["bad", "12 %, 15.1 V", "land, and change the battery"]
    assert (said["GPS"][:2], said["EKF"][:2]) == (["bad", "no fix, 3 satellites"], ["bad", "no position"])
    assert said["link"] == ["good", "0.0 s ago", ""]
    assert all(cure for level, _, cure in said.values() if level != "good")
    well = dialect.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 0, 0, 0, 0, 14)
    knows = dialect.MAVLink_ekf_status_report_message(dialect.EKF_POS_HORIZ_ABS, 0.1, 0.1, 0.1, 0.1, 0.1)
    state.update([packets(6.0, well, knows), status(12.5)])
    said = checks(state)
    assert (said["GPS"], said["EKF"]) == (["good", "3D fix, 14 satellites", ""], ["good", "position known", ""])
    assert said["link"][:2] == ["bad", "6.5 s ago"]
    turned = dialect.MAVLink_estimator_status_message(0, dialect.ESTIMATOR_POS_HORIZ_ABS, 0, 0, 0, 1.3, 0, 0, 0, 0)
    state.health.forget()
    state.update([status(13.0), packets(13.0, turned)])
    assert checks(state)["EKF"][:2] == ["warn", "compass 1.3"]


@every("msgid", CHECKS)
def test_a_packet_that_is_too_short_for_its_message_is_left_out_and_the_page_goes_on(msgid: int) -> None:
    head = bytes([1, 0, 1, 1, msgid, 7])  # MAVLink 1, whose payloads are never cut, with a payload of one byte
    crc = dialect.x25crc(head + bytes([dialect.mavlink_map[msgid].crc_extra])).crc
    (short,) = Parser().feed(b"\xfe" + head + crc.to_bytes(2, "little"))
    state = state_of([status(), PacketsReceived(1.0, "autopilot", [short])])
    assert checks(state) == {"link": ["good", "0.0 s ago", ""]}


def test_vehicles_with_their_own_home_are_on_one_map_and_one_transmitter_is_shown_once() -> None:
    state = state_of([DatumSet(0.0, "vehicle", *HOME, ()), DatumSet(0.0, "other", 46.0, 7.0, 1640.0, ())], named=True)
    here, there = transmitters((20.0, 5.0, 0.0)), transmitters((20.0, 5.0, -10.0))
    state.update([status(1.0, here), status(1.0, there, "other")])
    (one,) = shown(state)["transmitters"]
    assert (one["place"], one["of"]) == (pytest.approx([20.0, 5.0, 0.0], abs=0.01), ["vehicle", "other"])
    state.update([status(2.0, transmitters((25.0, 5.0, 0.0)), "other")])
    assert [one["of"] for one in shown(state)["transmitters"]] == [["vehicle"], ["other"]]
    assert shown(state)["origin"] == list(HOME)


def test_a_search_beside_an_emulator_shows_what_it_believes_in_the_same_map() -> None:
    state = state_of([DatumSet(0.0, "vehicle", *HOME, ())], "demo", "")
    events = [
        TakeOffPoint(1.0, 46.0 + 1 / 111.15e3, 7.0, 1650.0),
        TransmitterChosen(2.0, 7, 10.0),
        FrameHeard(2.0, Frame(1, 1, (Channel(7, 1, 100, 0),)), (0.0, 0.0, 0.0), 0.0),
        BeliefChanged(2.0, 7, ((4.0, 0.0, 0.75), (8.0, 4.0, 0.25)), (1.0, 0.0, 2.0), (5.0, 6.0)),
    ]
    state.update([FromSearch(event.time_s, event) for event in events])
    document = shown(state)
    assert document["receivers"] == []  # the emulator's own frames are shown
    search = document["search"]
    assert (search["phase"], search["target"], search["covariance"]) == ("homing in", 7, [1.0, 0.0, 2.0])
    assert search["take_off"] == pytest.approx([1.0, 0.0], abs=0.01)
    assert search["mean"] == pytest.approx([6.0, 1.0], abs=0.01)
    assert search["goal"] == pytest.approx([6.0, 6.0], abs=0.01)
    fine = (0.00063, 0.0, 0.0006)  # 3 cm
    place_found = PlaceFound(3.0, 7, 5.0, 1.0, None, False, relative_covariance=fine, autopilot_sigma_m=2.5)
    state.update([FromSearch(3.0, place_found)])
    found = shown(state)["search"]["found"]
    assert found["relative_covariance"] == [*fine]
    assert (found["place"], found["autopilot_sigma_m"]) == (pytest.approx([6.0, 1.0], abs=0.01), 2.5)
    noted = VictimNoted(4.0, 7, 1, 2, 5.0, 1.0, True, True, 1, False)
    state.update([FromSearch(event.time_s, event) for event in (noted, TransmitterChosen(5.0, 8, 20.0))])
    search = shown(state)["search"]  # of the next one, and the first is still there
    assert (search["found"], search["target"]) == (None, 8)
    (victim,) = search["victims"]
    assert victim["lat_lon"] == pytest.approx([HOME[0] + 6 / 111.15e3, HOME[1] + 1 / 77.4e3], abs=2e-7)
    assert (victim["id"], victim["sure"], victim["marked"], victim["left"]) == (7, True, True, 1)
    assert victim["place"] == [pytest.approx(6.0, abs=0.01), 1.0]
    assert (search["wanted"], search["begun"], victim["took_s"]) == (2, True, None)


def test_a_victim_has_its_time_from_the_start_of_the_search_and_loses_its_mark() -> None:
    state = State("search", "estimate", known=False)
    noted = VictimNoted(42.5, 7, 1, None, 5.0, 1.0, True, True, 0, False)  # the receiver took 2 s to mark it
    begun = SearchBegun(10.0, 3.0, None, (-5, -10, 5, 10), 20.0, 900.0)
    state.update([begun, PlaceFound(40.46, 7, 5.0, 1.0, None, True), noted])
    search = shown(state)["search"]
    assert (search["wanted"], search["area"], search["strip_m"]) == (None, [-5, -10, 5, 10], 20.0)
    assert search["left_s"] == round(900 - 32.5)
    (victim,) = search["victims"]
    assert victim["took_s"] == pytest.approx(30.46, abs=1e-9)  # the page rounds it, once
    assert (victim["marked"], victim["lat_lon"]) == (True, None)
    state.update([MarkLost(41.0, 7, 1)])
    assert not shown(state)["search"]["victims"][0]["marked"]


def test_a_place_is_the_terminal_s_and_has_a_qr_code_once_the_search_is_over() -> None:
    place = 5.0004, 1.0004
    found = PlaceFound(3.0, 7, *place, None, True)
    state = state_of([TakeOffPoint(1.0, *HOME), found], "search", "estimate", known=False)
    state.update([status(3.0, transmitters((5.0123456, 1.0, 0.0)))])
    assert shown(state)["transmitters"][0]["place"] == [5.012346, 1.0, 0.0]  # so that the error is the report's
    victim = shown(state)["search"]["victims"][0]
    assert victim["place"] == [*place]
    assert victim["qr"] is None
    assert victim["lat_lon"] == pytest.approx(LocalFrame(*HOME).lla([*place, 0.0])[:2], abs=1e-12)  # as in the terminal
    state.end("stopped")
    assert shown(state)["search"]["victims"][0]["qr"].startswith("data:image/svg+xml")


def heartbeat(mode: int) -> Any:
    return dialect.MAVLink_heartbeat_message(2, 3, 1, mode, 4, 3)  # of an ArduCopter


def test_two_vehicles_with_one_id_on_two_links_have_a_health_each() -> None:
    state = state_of([packets(1.0, heartbeat(mode), link=name) for name, mode in (("a", 4), ("b", 9))])
    every = [VehicleStatus(name, "quadrotor 1/1", {}, [], (), (name, 1)) for name in ("a", "b")]
    state.update([StatusReport(1.0, every)])
    modes = [vehicle["checks"][0][2] for vehicle in shown(state)["vehicles"]]
    assert modes == ["GUIDED, disarmed", "LAND, disarmed"]


def test_the_vehicle_of_a_search_has_its_health() -> None:
    state = state_of([VehicleFound(1.0, "vehicle", "quadrotor 1/1", 2, False)], "search", "estimate", known=False)
    state.update([packets(1.0, heartbeat(4), link="vehicle"), FrameHeard(6.0, Frame(1, 1, ()), None, None)])
    checks = {name: (level, value) for level, name, value, _ in shown(state)["vehicles"][0]["checks"]}
    assert checks == {"mode": ("good", "GUIDED, disarmed"), "link": ("bad", "5.0 s ago")}


def test_the_end_of_a_run_says_whether_it_failed() -> None:
    state = State("run", "")
    state.end("no frame", failed=True)
    assert (shown(state)["ended"], shown(state)["failed"]) == ("no frame", True)


def test_a_search_alone_shows_the_frames_that_it_hears() -> None:
    state = State("search", "estimate", known=False)
    channels = (Channel(None, 0, 100, 5), Channel())
    state.update([WaitingFor(0.0, "pose"), FrameHeard(1.0, Frame(9, 1, channels), None, None)])
    state.update([FrameHeard(2.0, Frame(10, 1, channels), (1.0, 2.0, -3.0), 90.0)])
    (receiver,) = shown(state)["receivers"]
    assert receiver["points"][0][:3] == [1.0, None, None]
    slots = [[None, 0, 100, 5, None], [None, 0, -1, -1, None]]
    assert receiver["points"][1] == [2.0, 1.0, 2.0, -3.0, 90.0, None, None, slots, 10]


def test_a_transmitter_that_is_left_to_another_search_is_no_target_any_more() -> None:
    state = state_of(
        [FromSearch(2.0, TransmitterChosen(2.0, 7, 10.0), "a")], "search", "estimate, 2 vehicles", known=False
    )
    state.update([FromSearch(3.0, TransmitterLeft(3.0, 7), "a")])
    (one,) = shown(state)["team"]
    assert (one["phase"], one["target"]) == ("searching", None)


def test_each_search_of_a_team_has_its_state_its_place_and_what_it_found() -> None:
    state = State("search", "estimate, 2 vehicles", known=False)
    for east, name in ((0.0, "a"), (3.0, "b")):
        heard = FrameHeard(2.0, Frame(1, 1, (Channel(7, 1, 100, 0),)), (1.0, 2.0, -3.0), 90.0)
        events = [TakeOffPoint(1.0, 46.0, 7.0 + east / 77.4e3, 1650.0), TransmitterChosen(2.0, 7, 10.0), heard]
        state.update([FromSearch(event.time_s, event, name) for event in events])
    state.update([FromSearch(3.0, PlaceFound(3.0, 7, 5.0, 1.0, None, True), "b")])
    document = shown(state)
    assert document["search"] is None
    first, second = document["team"]
    assert (first["vehicle"], first["phase"], first["found"]) == ("a", "homing in", None)
    assert (second["vehicle"], second["phase"], second["found"]["id"]) == ("b", "place found", 7)
    assert second["found"]["place"] == pytest.approx([5.0, 4.0], abs=0.02)
    places = {one["vehicle"]: one["points"][0][1:3] for one in document["receivers"]}
    assert places == {"a": [1.0, 2.0], "b": [pytest.approx(1.0, abs=0.02), pytest.approx(5.0, abs=0.02)]}
    assert [event[2][:2] for event in document["events"]] == ["a:", "b:"]


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.3, 0.8), (0.0, math.pi / 2)])
def test_the_lines_are_what_a_level_receiver_measures_there(roll: float, pitch: float) -> None:
    there = transmitters((3.0, -2.0, 1.0), roll=roll, pitch=pitch)
    (drawn,) = field_lines(there, -2.0, 1.542)
    receiver = PaperReceiver(Antennas(noise="off"))

    def look(north: float, east: float) -> ChannelReading:
        receiver.look(Look(0.0, Pose([north, east, -2.0], np.eye(3)), there))
        return receiver.show(0.0).channels[0]

    for d_m, line in drawn["equal_d"]:
        for north, east in np.array(line).reshape(-1, 2)[::9]:
            measured = look(north, east).d_cm
            assert measured == -1 if d_m == 50.0 and measured < 0 else measured / 100 == pytest.approx(d_m, rel=0.03)
    assert len(drawn["flux"]) >= 10
    for line in drawn["flux"]:
        for (n1, e1), (n2, e2) in list(pairwise(np.array(line).reshape(-1, 2)))[3:-3:7]:
            slot = look((n1 + n2) / 2, (e1 + e2) / 2)
            if slot.zone == 1:
                off = math.degrees(math.atan2(e2 - e1, n2 - n1)) - slot.delta_deg
                assert abs((off + 90) % 180 - 90) < 6


def test_the_lines_are_drawn_anew_only_when_something_has_moved() -> None:
    state = State("run", "")
    for north, version in ((20.0, 1), (20.1, 1), (21.0, 2)):
        state.update([status(1.0, transmitters((north, 5.0, 0.0)))])
        state.draw_field()
        assert json.loads(state.field())["version"] == shown(state)["field"] == version
    state.update([status(1.0, transmitters(*((float(i), 0.0, 0.0) for i in range(300))))])
    state.draw_field()
    field = json.loads(state.field())
    assert (len(field["transmitters"]), len(shown(state)["transmitters"])) == (8, 256)
    assert field["left_out"] == 248


def test_an_event_that_cannot_be_shown_is_told_and_the_page_goes_on() -> None:
    with closing(WebPage(HostPort("127.0.0.1", 0), State("run", ""))) as page:
        page.observe(VehicleStatus)  # type: ignore[arg-type]
        page.close()
        assert "the page could not display something" in page.state.document().decode()
        assert shown(page.state)["ended"] == "ended"


# -- a record on the page: at any time of it what there was to see then, also of records that are torn or strang--


MAX = ("demo", "--headless", "--speed", "max")


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return once(tmp_path_factory, "viewed", fly) / "record"


def fly(folder: Path) -> None:
    with undrawn():
        assert main([*MAX, "--fault", "drop=1@8-9.5", "--record", str(folder / "record")]) == 0


@pytest.fixture
def record(flown: Path, tmp_path: Path) -> Path:
    """A copy, to be damaged."""
    folder = tmp_path / "record"
    folder.mkdir()
    for file in flown.iterdir():
        if file.suffix in (".csv", ".json", ".jsonl"):
            (folder / file.name).write_bytes(file.read_bytes())
    return folder


def shown_at(state: RecordedState, time_s: float) -> dict[str, Any]:
    state.show(time_s)
    made: dict[str, Any] = json.loads(state.document(), parse_constant=lambda name: pytest.fail(name))
    return made


def test_at_every_time_there_is_what_there_was_in_any_order(flown: Path) -> None:
    recording = load(flown)
    state = RecordedState(recording)
    (receiver,) = recording.receivers
    for time_s in (12.0, 20.5, 3.0, 45.0, 0.0, 12.0):
        document = shown_at(state, time_s)
        points = document["receivers"][0]["points"]
        assert document["receivers"][0]["frames"] == len(points) == int(time_s) + 1
        i = int(time_s)
        d_cm, place = int(receiver.d_cm[receiver.begins[i]]), receiver.position[i].tolist()
        assert points[-1][7][0][2] == d_cm
        if i:
            assert points[-1][1:4] == pytest.approx(place, abs=0.001)
        assert all(event[0] <= time_s for event in document["events"])
        assert bool(document["search"] and document["search"]["found"]) == (time_s == 45.0)
    assert shown_at(state, 9.0)["receivers"][0]["faults"] == ["drop"]
    assert len(shown_at(state, 8.0)["search"]["hypotheses"]) >= 1
    document = shown_at(state, 12.0)
    assert document["receivers"][0]["faults"] == []
    assert document["transmitters"][0]["place"] == [20.0, 5.0, 0.0]
    assert document["vehicles"][0]["label"] == "quadrotor 1/1"
    texts = [event[2] for event in document["events"]]
    assert "search: going for transmitter 1, 19.2 m away" in texts


def test_at_every_time_a_vehicle_has_its_health_of_then(flown: Path) -> None:
    state = RecordedState(load(flown))
    for time_s, mode in ((12.0, "GUIDED, armed"), (1e9, "LAND, armed"), (12.0, "GUIDED, armed")):
        checks = {name: value for _, name, value, _ in shown_at(state, time_s)["vehicles"][0]["checks"]}
        assert (checks["mode"], checks["GPS"]) == (mode, "3D fix, 10 satellites")
        assert float(checks["link"].split()[0]) <= 1.0


def test_a_log_that_cannot_be_read_leaves_out_the_health_alone(record: Path) -> None:
    (record / "autopilot.tlog").mkdir()
    document = shown_at(RecordedState(load(record)), 12.0)
    assert (document["vehicles"][0]["checks"], len(document["receivers"][0]["points"])) == ([], 13)


@pytest.mark.parametrize("code", [0, 130])
def test_each_search_of_a_team_has_an_end_once_the_run_has_one(tmp_path: Path, code: int) -> None:
    """An interrupted search has no event of its end; without one the page has no outcome."""
    document = shown_at(RecordedState(load(write_team(tmp_path / "team", code=code))), math.inf)
    ends = {search["vehicle"]: search["ended"] for search in document["team"]}
    assert ends == {"drone-1": "found", "drone-2": "interrupted" if code else "it did not end"}


def test_before_and_after_the_record_are_its_ends(flown: Path) -> None:
    state = RecordedState(load(flown))
    assert shown_at(state, -1e9)["at"] == 0.0
    assert shown_at(state, float("nan"))["at"] == shown_at(state, 1e9)["at"] == state.span_s[1]


def test_asked_again_for_the_same_time_little_is_sent(flown: Path) -> None:
    state = RecordedState(load(flown))
    document = shown_at(state, 12.0)
    state.show(12.0)
    assert len(state.document(document["version"])) < 3000
    assert json.loads(state.document(document["version"]))["receivers"][0]["points"] == []


def test_of_a_long_record_no_more_is_sent_than_a_page_can_draw(record: Path) -> None:
    lines = (record / "readings.csv").read_text().splitlines()
    first = [line.split(",") for line in lines[5:9]]
    rows = [[cells[0], str(n / 20), *cells[2:]] for n in range(8_000) for cells in first]
    (record / "readings.csv").write_text("\n".join([lines[0], *(",".join(cells) for cells in rows)]) + "\n")
    points = shown_at(RecordedState(load(record)), 300.0)["receivers"][0]["points"]
    assert 1000 < len(points) <= 3100
    assert points[-1][0] == 300.0
    assert [point[0] for point in points] == sorted({point[0] for point in points})


def damaged(record: Path, name: str, change: Callable[[str], str]) -> dict[str, Any]:
    (record / name).write_text(change((record / name).read_text()))
    return shown_at(RecordedState(load(record)), 12.0)


def test_an_empty_run_and_one_reading(record: Path) -> None:
    document = damaged(record, "readings.csv", lambda text: text.splitlines()[0] + "\n")
    assert document["receivers"][0]["points"] == []
    document = damaged(record, "readings.csv", lambda text: text + "0,0.5,,,,,,,,,1,,0,-1,-1,,,,,,0.1\n")
    assert [point[:2] for point in document["receivers"][0]["points"]] == [[0.5, None]]


def test_the_log_of_a_search_alone(tmp_path: Path) -> None:
    state = RecordedState(load(write_search(tmp_path)))
    document = shown_at(state, 1e9)
    assert not document["known"]
    assert document["transmitters"] == []
    assert document["search"]["found"]["place"] == pytest.approx([18.5, 5.25])
    assert document["receivers"][0]["points"][-1][7][0][0] == 1


def test_a_search_alone_has_its_readings_of_every_time(tmp_path: Path) -> None:
    state = RecordedState(load(write_search(tmp_path / "search")))
    for time_s, count in ((0.0, 1), (3.3, 4), (2.5, 3), (5.0, 6)):
        document = shown_at(state, time_s)
        assert (document["at"], len(document["receivers"][0]["points"])) == (time_s, count)


@pytest.mark.parametrize(
    "line",
    [
        '{"event": "autopilot_text", "time_s": 1.0, "vehicle": ["a"], "text": {"b": 1}}',
        '{"event": "belief_changed", "time_s": 1.0, "transmitter": 1, "hypotheses": 7, "covariance": "x", "goal": []}',
        '{"event": "status", "time_s": 1.0, "vehicles": [{"name": 5, "rates": [1], "receivers": "x"}]}',
        '{"event": "unheard_of", "time_s": 1.0, "notice": {"level": "panic", "text": "<b>\\u202e"}}',
        '{"event": "place_found", "time_s": 1.0, "by": "search"}',
        '{"event": "transmitter_heard", "time_s": 1.0, "transmitter": [], "distance_m": 1, "north_m": {}, "east_m": 0}',
        '{"event": "link_lost", "time_s": 1.0, "link": {}, "address": 5, "reason": [1]}',
        '{"event": "waiting_for", "time_s": 1.0, "what": "pose", "by": "search", "of": ["a"]}',
        '{"event": "search_ended", "time_s": 1.0, "how": "x", "landing": true, "by": "search", "of": 5}',
        '{"event": "frame_heard", "time_s": 1.0, "frame": 3, "position": null, "heading_deg": null}',
        '{"event": "frame_made", "time_s": 1.0, "vehicle": "v", "receiver": "r", "number": 1, "instant_s": 1, '
        '"boot_s": 1, "pose": null, "age_s": null, "reading": 1, "frame": 1, "sent": true, "late_s": 0}',
    ],
)
def test_events_that_are_not_as_expected_do_no_harm(record: Path, line: str) -> None:
    document = damaged(record, "events.jsonl", lambda text: line + "\n" + text)
    assert len(document["receivers"][0]["points"]) == 13
    assert len(shown_at(RecordedState(load(record)), 1.5)["receivers"][0]["points"]) == 2


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (["{record}/nowhere"], "nowhere: no such folder; name one that --record has written"),
        (["{record}"], "readings.csv:3: "),
        (["{record}", "--web", "1.2.3.4.5:80"], "1.2.3.4.5:80: the page cannot be served: "),
        (["{record}", "--web", "none"], "none:8457: the page cannot be served: no address of that name"),
        (["{record}", "--scenario", "builtin:x"], "--scenario: a record has its own"),
        (["{record}/run.json"], "run.json"),
    ],
)
def test_what_cannot_be_shown_is_an_error_that_says_so(
    record: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], what: str
) -> None:
    if what.startswith("readings.csv"):
        text = (record / "readings.csv").read_text().splitlines(keepends=True)
        (record / "readings.csv").write_text("".join([text[0], text[1], "nonsense\n", *text[2:]]))
    assert main(["view", *(word.format(record=record) for word in arguments), "--duration", "0.01"]) == 2
    told = capsys.readouterr().err
    assert what in told
    assert "Traceback" not in told


# -- the picture under the map: where its pixels are on Earth, and what is no map ------------------------------


SUMMIT = (46.0123, 7.7456, 1650.0)


def pixel(made: Background, north_m: float, east_m: float) -> tuple[int, ...]:
    picture = Image.open(io.BytesIO(made.png)).convert("RGBA")
    x, y = (int((REACH_M + metres) / (2 * REACH_M) * picture.width) for metres in (east_m, -north_m))
    value: tuple[int, ...] = picture.getpixel((x, y))
    return value


def test_a_slope_is_bright_towards_the_sun_and_has_contour_lines() -> None:
    cell, n = 0.0002, 100  # 22 m from north to south; it rises to the south-east, so it faces the sun in the north-west
    rows, columns = np.mgrid[:n, :n]
    heights = 1500.0 + 2.0 * (rows + columns)
    grid = TerrainGrid("", SUMMIT[0] + n / 2 * cell, SUMMIT[1] - n / 2 * cell, cell, n, n, heights.tobytes())
    made = terrain(grid)(SUMMIT)
    grey, alpha = pixel(made, 100.5, 100.5)[::3]
    assert (grey, made.about) == (255, "contours 20 m")
    assert alpha > 0
    turned = TerrainGrid("", grid.north_deg, grid.west_deg, cell, n, n, heights[::-1, ::-1].tobytes())
    assert pixel(terrain(turned)(SUMMIT), 100.5, 100.5)[0] == 0
    assert pixel(terrain(grid)((47.0, 7.0, 0.0)), 0, 0)[3] == 0  # there is no height


@pytest.mark.parametrize("suffix", ["tif", "mbtiles"])
def test_a_map_file_lies_where_it_is_on_earth(tmp_path: Path, suffix: str) -> None:
    rasterio = pytest.importorskip("rasterio")
    from rasterio.shutil import copy
    from rasterio.transform import from_bounds
    from rasterio.warp import transform_bounds

    lat, lon, _ = (float(x) for x in LocalFrame(*SUMMIT).lla([100.0, 200.0, 0.0]))  # the corner of four colours
    bounds = transform_bounds("EPSG:4326", "EPSG:3857", lon - 0.01, lat - 0.01, lon + 0.01, lat + 0.01)
    colours = np.zeros((3, 500, 500), np.uint8)
    colours[0, :250, :250], colours[1, :250, 250:], colours[2, 250:, 250:] = 255, 255, 255
    where = {"crs": "EPSG:3857", "transform": from_bounds(*bounds, 500, 500)}
    with rasterio.open(tmp_path / "map.tif", "w", width=500, height=500, count=3, dtype="uint8", **where) as file:
        file.write(colours)
    if suffix == "mbtiles":
        copy(tmp_path / "map.tif", tmp_path / "map.mbtiles", driver="MBTiles", ZOOM_LEVEL_STRATEGY="UPPER")
    made = map_file(tmp_path / f"map.{suffix}")(SUMMIT)
    for north, east, colour in ((10, -10, 0), (10, 10, 1), (-10, 10, 2)):
        assert np.argmax(pixel(made, 100 + north, 200 + east)[:3]) == colour
        assert pixel(made, 100 + north, 200 + east)[3] == 255


def test_what_is_no_map_is_an_error(tmp_path: Path) -> None:
    pytest.importorskip("rasterio")
    (tmp_path / "map.tif").write_text("nothing")
    with pytest.raises(ValueError, match=r"map.tif: cannot be read as a GeoTIFF or MBTiles file: "):
        map_file(tmp_path / "map.tif")


# -- the page's server: who is answered, who is refused, and that nobody can keep others waiting ---------------


UNFINISHED = b"GET / HTTP/1.1\r\nHost: localhost\r\n"
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


def big(query: Mapping[str, str], client: int) -> bytes:
    """A document that no buffer of the system takes whole."""
    return b"x" * 20_000_000


@pytest.fixture
def server() -> Iterator[Server]:
    sources = {"/state.json": lambda query, client: json.dumps(dict(query)).encode(), "/big.json": big}
    server = Server(HostPort("127.0.0.1", 0), sources)
    yield server
    server.close()


def ask(
    server: Server, path: str = "/", method: str = "GET", headers: dict[str, str] | None = None, body: str | None = None
) -> tuple[http.client.HTTPResponse, bytes]:
    with closing(http.client.HTTPConnection("127.0.0.1", server.address.port, timeout=10)) as connection:
        connection.request(method, path, body=body, headers=headers or {})
        answer = connection.getresponse()
        return answer, answer.read()


def say(server: Server, data: bytes) -> bytes:
    """The answer to raw bytes, until the server hangs up."""
    with socket.create_connection(("127.0.0.1", server.address.port), timeout=10) as client:
        client.sendall(data)
        return until_closed(client)


def until_closed(client: socket.socket) -> bytes:
    """What comes until the server hangs up."""
    answer = b""
    while chunk := client.recv(65536):
        answer += chunk
    return answer


def test_every_file_of_the_page_is_there_with_headers_that_let_nothing_else_in(server: Server) -> None:
    for path, page in pages().items():
        answer, body = ask(server, path)
        assert (answer.status, body) == (200, page.body)
        assert answer.getheader("Content-Security-Policy") == POLICY
        assert answer.getheader("X-Content-Type-Options") == "nosniff"
        assert answer.getheader("Cache-Control") == "no-store"
        assert answer.getheader("Set-Cookie") is None
        assert answer.getheader("Server") is None
    assert ask(server, "/")[0].getheader("Content-Type") == "text/html; charset=utf-8"


def test_the_page_is_small() -> None:
    assert sum(len(page.body) for page in pages().values()) <= 180_000


def test_the_query_is_handed_on_once_each(server: Server) -> None:
    assert ask(server, "/state.json?since=12&since=13&at=1.5")[1] == b'{"since": "12", "at": "1.5"}'
    assert ask(server, "/state.json?" + "since=1&" * 50)[0].status == 400
    assert b" 400 " in say(server, b"GET http://[/state.json HTTP/1.1\r\nHost: localhost\r\n\r\n")


def test_head_has_the_headers_of_get_and_no_body(server: Server) -> None:
    answer, body = ask(server, "/style.css", "HEAD")
    assert (answer.status, body) == (200, b"")
    assert answer.getheader("Content-Length") == str(len(pages()["/style.css"].body))


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH", "TRACE", "CONNECT", "BREW"])
def test_another_method_is_not_allowed(server: Server, method: str) -> None:
    answer, _ = ask(server, "/state.json", method)
    assert (answer.status, answer.getheader("Allow")) == (405, "GET, HEAD")


@pytest.mark.parametrize(
    "path", ["/nothing", "/../server.py", "/page.py", "//etc/passwd", "/%2e%2e/state.py", "/index"]
)
def test_what_is_no_name_of_the_page_is_not_there(server: Server, path: str) -> None:
    answer, body = ask(server, path)
    assert answer.status == 404
    assert path.encode() not in body


def test_it_is_asked_by_its_address_or_as_localhost_and_by_no_other_name(server: Server) -> None:
    port = server.address.port
    for host in (f"127.0.0.1:{port}", f"localhost:{port}", f"LOCALHOST:{port}", "localhost", "localhost:9000"):
        assert ask(server, headers={"Host": host})[0].status == 200, host
    for host in (f"evil.example:{port}", "evil.example", f"127.0.0.2:{port}", "", "localhost.evil.example", "[::1]"):
        assert ask(server, headers={"Host": host})[0].status == 403, host
    assert b" 403 " in say(server, b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n")
    assert b" 403 " in say(server, b"GET / HTTP/1.0\r\n\r\n")


def test_a_page_of_another_origin_is_refused(server: Server) -> None:
    host = f"127.0.0.1:{server.address.port}"
    assert ask(server, "/state.json", headers={"Host": host, "Origin": f"http://{host}"})[0].status == 200
    for origin in ("http://evil.example", "null", f"https://{host}", "http://127.0.0.1:1"):
        assert ask(server, "/state.json", headers={"Host": host, "Origin": origin})[0].status == 403, origin


def test_a_body_is_not_taken_for_the_next_request(server: Server) -> None:
    answer, _ = ask(server, "/state.json", body="GET /nothing HTTP/1.1")
    assert answer.getheader("Connection") == "close"


@pytest.mark.parametrize(
    "data", [b"\x16\x03\x01\x02\x00\x01\r\n\r\n", b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b"<script>\r\n\r\n"]
)
def test_nonsense_is_refused_and_not_repeated(server: Server, data: bytes) -> None:
    assert b"script>" not in say(server, data)
    assert ask(server)[0].status == 200


def test_if_the_port_is_taken_it_is_the_next_free_one() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with closing(Server(HostPort("127.0.0.1", port), {})) as server:
            assert port < server.address.port < port + 20
            assert ask(server)[0].status == 200


@pytest.mark.parametrize("host", ["192.0.2.1", "nowhere.invalid"])
def test_an_address_that_is_not_of_this_computer_is_an_error_that_says_so(host: str) -> None:
    with pytest.raises(WebError, match=f"{host}:8457: the page cannot be served: "):
        Server(HostPort(host), {})


def test_an_address_of_version_6() -> None:
    try:
        server = Server(parse_address("[::1]:0"), {})
    except WebError:
        pytest.skip("no IPv6 here")
    try:
        with socket.create_connection(("::1", server.address.port), timeout=10) as client:
            client.sendall(f"GET / HTTP/1.1\r\nHost: [::1]:{server.address.port}\r\n\r\n".encode())
            assert client.recv(100).startswith(b"HTTP/1.1 200 ")
    finally:
        server.close()


def test_clients_that_say_nothing_keep_nobody_from_the_page(server: Server) -> None:
    silent = [socket.create_connection(("127.0.0.1", server.address.port), timeout=10) for _ in range(100)]
    try:
        assert ask(server)[0].status == 200
    finally:
        for client in silent:
            client.close()


def test_a_client_that_reads_nothing_keeps_nobody_from_the_page_and_not_the_program_from_ending() -> None:
    server = Server(HostPort("127.0.0.1", 0), {"/big.json": big})
    with socket.create_connection(("127.0.0.1", server.address.port), timeout=10) as slow:
        slow.sendall(b"GET /big.json HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert slow.recv(10) == b"HTTP/1.1 2"
        assert ask(server)[0].status == 200
        server.close()
    with pytest.raises(OSError, match="refused"):
        ask(server)


def opened(server: Server, data: bytes) -> socket.socket:
    """A connection that has said so much, and is being served."""
    client = socket.create_connection(("127.0.0.1", server.address.port), timeout=10)
    client.sendall(data)
    assert ask(server)[0].status == 200
    return client


def is_closed(client: socket.socket) -> bool:
    """Whether the server hangs up within the deadline."""
    client.settimeout(10)
    try:
        return client.recv(1) == b""
    except ConnectionResetError:
        return True


class SetClock(StepClock):
    """A clock that stands until the test moves it."""

    def wait(self, deadline: float, links: Iterable[Waitable] = ()) -> None:
        pass

    def pass_s(self, seconds: float) -> None:
        self._now += seconds


def test_a_request_that_does_not_end_is_closed_however_often_something_comes() -> None:
    clock = SetClock()
    with (
        closing(Server(HostPort("127.0.0.1", 0), {}, clock)) as server,
        opened(server, UNFINISHED) as slow,
        opened(server, b"") as silent,
        opened(server, b"") as page,
    ):
        for _ in range(3):
            clock.pass_s(1.6)
            slow.sendall(b"X: y\r\n")
            page.sendall(b"HEAD / HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert page.recv(1 << 20).startswith(b"HTTP/1.1 200 ")
        clock.pass_s(1.6)
        assert is_closed(slow)
        assert is_closed(silent)
        page.sendall(b"GET /nothing HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert b"HTTP/1.1 404 " in until_closed(page)


@pytest.mark.parametrize("line", [b"X: " + b"y" * 20_000 + b"\r\n", b"X: y\r\n" * 3000])
def test_headers_of_more_than_16_kib_are_refused_before_they_end(server: Server, line: bytes) -> None:
    assert say(server, UNFINISHED + line).startswith(b"HTTP/1.1 431 ")
    assert ask(server, headers={"Cookie": "c" * 16_000})[0].status == 200


def test_unfinished_headers_on_every_connection_take_some_1_mib_and_one_thread() -> None:
    threads = threading.active_count()
    tracemalloc.start()
    server = Server(HostPort("127.0.0.1", 0), {})
    clients = []
    try:
        for _ in range(100):
            clients.append(opened(server, UNFINISHED + b"X: " + b"y" * 16_000))
        peak = tracemalloc.get_traced_memory()[1]
        assert threading.active_count() == threads + 1
    finally:
        tracemalloc.stop()
        for client in clients:
            client.close()
        server.close()
    assert peak < 3 << 20


def test_answers_that_nobody_takes_are_bounded_and_the_page_goes_on(server: Server) -> None:
    clients = []
    tracemalloc.start()
    try:
        for _ in range(12):  # each waits for 20 MB of its own
            clients.append(opened(server, b"GET /big.json HTTP/1.1\r\nHost: localhost\r\n\r\n"))
        assert tracemalloc.get_traced_memory()[1] < 120 << 20
    finally:
        tracemalloc.stop()
        for client in clients:
            client.close()


def test_a_document_that_cannot_be_made_costs_its_connection_alone() -> None:
    with closing(
        Server(HostPort("127.0.0.1", 0), {"/state.json": lambda query, client: bytes(int(query["size"]))})
    ) as server:
        assert say(server, b"GET /state.json HTTP/1.1\r\nHost: localhost\r\n\r\n") == b""
        assert ask(server)[0].status == 200


def test_requests_that_come_together_are_answered_one_after_another(server: Server) -> None:
    each = "GET /state.json?since={} HTTP/1.1\r\nHost: localhost\r\n{}\r\n"
    answer = say(server, (each.format(1, "") + each.format(2, "Connection: close\r\n")).encode())
    assert [part.partition(b"\r\n\r\n")[2] for part in answer.split(b"HTTP/1.1 ")[1:]] == [
        b'{"since": "1"}',
        b'{"since": "2"}',
    ]


@every(
    "text, address",
    [
        ("127.0.0.1:8080", HostPort("127.0.0.1", 8080)),
        ("8080", HostPort("127.0.0.1", 8080)),
        ("0.0.0.0", HostPort("0.0.0.0", 8457)),
        ("localhost", HostPort("localhost", 8457)),
        ("[::1]:80", HostPort("::1", 80)),
        ("my-laptop.local:0", HostPort("my-laptop.local", 0)),
    ],
)
def test_addresses(text: str, address: HostPort) -> None:
    assert (parse_address(text), parse_address(str(address))) == (address, address)


@every(
    "text",
    ["", ":", "1.2.3.4:", "host:port", "host:99999", "99999", "a b", "http://x", "::1", "ü:1"],
)
def test_what_is_no_address_is_an_error_that_says_what_is_expected(text: str) -> None:
    with pytest.raises(ValueError, match=r"expected HOST:PORT, HOST or PORT, e\.g\. 127\.0\.0\.1:8457"):
        parse_address(text)
