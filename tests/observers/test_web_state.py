"""What the page is told: JSON of bounded size, whatever the run is like."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from arva_hil.events import (
    DatumSet,
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
from arva_hil.model.field import rotation
from arva_hil.model.field.dipole import Transmitters
from arva_hil.model.field_lines import field_lines
from arva_hil.model.receiver import ChannelReading, Look, PaperReceiver, Pose, Reading
from arva_hil.model.receiver.paper import Antennas
from arva_hil.observers.web.address import HostPort
from arva_hil.observers.web.history import TextHistory
from arva_hil.observers.web.page import WebPage
from arva_hil.observers.web.state import State
from firmware_proto import Channel, Frame

HOME = (46.0, 7.0, 1650.0)


def made(
    number: int, north: float = 0.0, d_cm: int = 1234, *, pose: bool = True, receiver: str = "receiver"
) -> FrameMade:
    where = Pose([north, 2.0, -3.0], np.eye(3)) if pose else None
    reading = Reading((ChannelReading(7, 1, d_cm, -12, 12.5), ChannelReading(None, 0, -1, -1, 80.0)), False, False)
    frame = Frame(number % 256, 1, (Channel(7, 1, d_cm, -12), Channel()))
    return FrameMade(
        number + 0.5, "vehicle", receiver, number, float(number), None, where, 0.02, reading, frame, True, 0.5
    )


def status(time_s: float = 1.0, transmitters: Transmitters | None = None, vehicle: str = "vehicle") -> StatusReport:
    receiver = ReceiverStatus("receiver", None, 10, 2, transmitters)
    rates = {"ATTITUDE": 49.6, "GLOBAL_POSITION_INT": 50.0, "OTHER": 0.0}
    counters, source = (("bad_checksums", 3),), ("autopilot", 1)
    return StatusReport(time_s, [VehicleStatus(vehicle, "quadrotor 1/1", rates, [receiver], counters, source)])


def transmitters(*places: tuple[float, float, float], roll: float = 0.0, pitch: float = 0.0) -> Transmitters:
    turned = rotation.to_matrix(rotation.from_euler(roll, pitch, 0.5))
    n = len(places)
    return Transmitters(tuple(range(1, n + 1)), np.array(places).reshape(n, 3), np.array([turned] * n), np.ones(n))


def shown(state: State, since: int = 0) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(state.document(since), parse_constant=lambda name: pytest.fail(name))
    return document


def test_a_reading_is_shown_with_its_place_and_its_true_range() -> None:
    state = State("run", "victim.yaml")
    state.update([made(3, 10.0)])
    document = shown(state)
    assert (document["kind"], document["title"], document["known"]) == ("run", "victim.yaml", True)
    (receiver,) = document["receivers"]
    assert receiver["points"] == [
        [3.0, 10.0, 2.0, -3.0, 0.0, 20.0, 500.0, [[7, 1, 1234, -12, 12.5], [None, 0, -1, -1, 80.0]], 3]
    ]


def test_asked_again_it_tells_what_is_new() -> None:
    state = State("run", "")
    state.update([made(0), made(1)])
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
    state = State("run", "")
    state.update([made(0)])
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
    state = State("run", "")
    state.update([made(0, value), made(1, pose=False), status(1.0, transmitters((value, 0.0, 0.0), (1.0, 2.0, 3.0)))])
    state.draw_field()
    document = shown(state)
    assert [point[1] for point in document["receivers"][0]["points"]] == [None, None]
    assert [one["id"] for one in document["transmitters"]] == [2]


def test_a_million_readings_take_bounded_memory_and_the_newest_are_all_there() -> None:
    state = State("replay", "")
    version = 0
    for block in range(20):
        version = shown(state)["version"] if block == 19 else 0
        state.update([made(0, d_cm=block + 1)] * 50_000)
    document = state.document()
    assert len(document) < 1_000_000
    (receiver,) = json.loads(document)["receivers"]
    assert receiver["frames"] == 1_000_000
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
    steps = {b - a for a, b in pairwise(old)}
    assert len(steps) == 1
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
    label = shown(state)["vehicles"][0]["label"]
    assert label == "</script><img src=x>\\u202e\\x1b[2J"


def test_streams_counters_and_links_are_shown() -> None:
    state = State("run", "", asked_hz={"ATTITUDE": 50.0}, links={"port": "/dev/ttyUSB0"})
    state.update([status(), LinkLost(2.0, "port", "/dev/ttyUSB0", "unplugged"), VehicleLost(2.0, "vehicle", "q", 3.0)])
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
    assert said["GPS"][:2] == ["bad", "no fix, 3 satellites"]
    assert said["EKF"][:2] == ["bad", "no position"]
    assert said["link"] == ["good", "0.0 s ago", ""]
    assert all(cure for level, _, cure in said.values() if level != "good")
    well = dialect.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 0, 0, 0, 0, 14)
    knows = dialect.MAVLink_ekf_status_report_message(dialect.EKF_POS_HORIZ_ABS, 0.1, 0.1, 0.1, 0.1, 0.1)
    state.update([packets(6.0, well, knows), status(12.5)])
    said = checks(state)
    assert said["GPS"] == ["good", "3D fix, 14 satellites", ""]
    assert said["EKF"] == ["good", "position known", ""]
    assert said["link"][:2] == ["bad", "6.5 s ago"]
    turned = dialect.MAVLink_estimator_status_message(0, dialect.ESTIMATOR_POS_HORIZ_ABS, 0, 0, 0, 1.3, 0, 0, 0, 0)
    state.health.forget()
    state.update([status(13.0), packets(13.0, turned)])
    assert checks(state)["EKF"][:2] == ["warn", "compass 1.3"]


def test_vehicles_with_their_own_home_are_on_one_map_and_one_transmitter_is_shown_once() -> None:
    state = State("run", "", named=True)
    state.update([DatumSet(0.0, "vehicle", *HOME, ()), DatumSet(0.0, "other", 46.0, 7.0, 1640.0, ())])
    here, there = transmitters((20.0, 5.0, 0.0)), transmitters((20.0, 5.0, -10.0))
    state.update([status(1.0, here), status(1.0, there, "other")])
    (one,) = shown(state)["transmitters"]
    assert one["place"] == pytest.approx([20.0, 5.0, 0.0], abs=0.01)
    assert one["of"] == ["vehicle", "other"]
    state.update([status(2.0, transmitters((25.0, 5.0, 0.0)), "other")])
    assert [one["of"] for one in shown(state)["transmitters"]] == [["vehicle"], ["other"]]
    assert shown(state)["origin"] == list(HOME)


def test_a_search_beside_an_emulator_shows_what_it_believes_in_the_same_map() -> None:
    state = State("demo", "")
    state.update([DatumSet(0.0, "vehicle", *HOME, ())])
    north = 46.0 + 1 / 111.15e3
    events = [
        TakeOffPoint(1.0, north, 7.0, 1650.0),
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
    state.update([FromSearch(3.0, PlaceFound(3.0, 7, 5.0, 1.0, None, False))])
    assert shown(state)["search"]["found"]["place"] == pytest.approx([6.0, 1.0], abs=0.01)
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
    noted = VictimNoted(40.5, 7, 1, None, 5.0, 1.0, True, True, 0, False)
    state.update([SearchBegun(10.0, 3.0, None, (-5, -10, 5, 10), 20.0, 900.0), noted])
    search = shown(state)["search"]
    assert (search["wanted"], search["area"], search["strip_m"]) == (None, [-5, -10, 5, 10], 20.0)
    assert search["left_s"] == round(900 - 30.5)
    assert [(one["took_s"], one["marked"], one["lat_lon"]) for one in search["victims"]] == [(30.5, True, None)]
    state.update([MarkLost(41.0, 7, 1)])
    assert not shown(state)["search"]["victims"][0]["marked"]


def test_a_place_has_a_qr_code_once_the_search_is_over() -> None:
    state = State("search", "estimate", known=False)
    state.update([TakeOffPoint(1.0, *HOME), PlaceFound(3.0, 7, 5.0, 1.0, None, True)])
    assert shown(state)["search"]["victims"][0]["qr"] is None
    state.end("stopped")
    assert shown(state)["search"]["victims"][0]["qr"].startswith("data:image/svg+xml")


def heartbeat(mode: int) -> Any:
    return dialect.MAVLink_heartbeat_message(2, 3, 1, mode, 4, 3)  # of an ArduCopter


def test_two_vehicles_with_one_id_on_two_links_have_a_health_each() -> None:
    state = State("run", "")
    state.update([packets(1.0, heartbeat(mode), link=name) for name, mode in (("a", 4), ("b", 9))])
    every = [VehicleStatus(name, "quadrotor 1/1", {}, [], (), (name, 1)) for name in ("a", "b")]
    state.update([StatusReport(1.0, every)])
    modes = [vehicle["checks"][0][2] for vehicle in shown(state)["vehicles"]]
    assert modes == ["GUIDED, disarmed", "LAND, disarmed"]


def test_the_vehicle_of_a_search_has_its_health() -> None:
    state = State("search", "estimate", known=False)
    state.update([VehicleFound(1.0, "vehicle", "quadrotor 1/1", 2, False)])
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
    state = State("search", "estimate, 2 vehicles", known=False)
    state.update([FromSearch(2.0, TransmitterChosen(2.0, 7, 10.0), "a")])
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
        path = np.array(line).reshape(-1, 2)
        for (n1, e1), (n2, e2) in list(pairwise(path))[3:-3:7]:
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
    many = transmitters(*((float(i), 0.0, 0.0) for i in range(300)))
    state.update([status(1.0, many)])
    state.draw_field()
    field = json.loads(state.field())
    assert (len(field["transmitters"]), len(shown(state)["transmitters"])) == (8, 256)
    assert field["left_out"] == 248


def test_an_event_that_cannot_be_shown_is_told_and_the_page_goes_on() -> None:
    page = WebPage(HostPort("127.0.0.1", 0), State("run", ""))
    try:
        page.observe(VehicleStatus)  # type: ignore[arg-type]
        page.close()
        assert "the page could not display something" in page.state.document().decode()
        assert shown(page.state)["ended"] == "ended"
    finally:
        page.close()
