"""--web and `view` in a real browser: what a person sees is what the record of the same run says."""

from __future__ import annotations

import csv
import itertools
import json
import math
import re
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arva_hil.cli.main import main
from arva_hil.events import DatumSet, Event, FrameMade, ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import FromSearch, SearchBegun, SearchEnded, TakeOffPoint, TransmitterHeard, VictimNoted
from arva_hil.events.vehicles import AutopilotText, VehicleFound
from arva_hil.links.pty import PtyLink
from arva_hil.model.field.dipole import Transmitters
from arva_hil.model.receiver import ChannelReading, Pose, Reading
from arva_hil.observers.web.address import HostPort
from arva_hil.observers.web.page import WebPage
from arva_hil.observers.web.state import State
from firmware_proto import Channel, Frame, encode
from tests.browser import Tab

from . import flown
from .far_ends import Autopilot, Beacon, Keep, Program, Start

LOG = Path(__file__).parent.parent / "data" / "arducopter.tlog"
WEB = ("--web", "127.0.0.1:0")
ZONES = ("–", "mid", "inner")
OVER = re.compile("The run is over")

ARRANGED = """async ([things, width, height]) => {
  const { BESIDE, Names } = await import("/labels.js");
  const names = new Names();
  for (const [name, x, y] of things) { names.avoid(x, y, 12); names.add(name, x, y, "", 0, BESIDE(17)); }
  return names.arranged(width, height, (text) => 8 * text.length).map(({ box }) => box);
}"""


PLACED = """async () => {
  const { placed } = await import("/store.js");
  return [placed([-21.9, -0.01]), placed([0.04, -3])];
}"""
TURNED = """[Number(document.getElementById("arrow").style.transform.match(/-?\\d+/)[0]),
  document.getElementById("heads").getAttribute("transform")]"""


@pytest.fixture
def tab(browser: Any) -> Iterator[Tab]:
    tab = Tab(browser)
    yield tab
    tab.close()


def url_of(program: Program) -> str:
    return program.says(r"page: (http://127\.0\.0\.1:\d+/)")[1]


def readings(folder: Path) -> list[dict[str, str]]:
    with open(folder / "readings.csv", newline="") as file:
        return list(csv.DictReader(file))


def frame_at(rows: list[dict[str, str]], time_s: float = math.inf) -> list[dict[str, str]]:
    """The slots of the last frame until then."""
    last = max(float(row["time_s"]) for row in rows if float(row["time_s"]) <= time_s)
    return [row for row in rows if float(row["time_s"]) == last]


def minus(degrees: str) -> str:
    return f"{'−' if int(degrees) < 0 else '+'}{abs(int(degrees))}°"


def in_metres(cm: str) -> str:
    return f"{int(cm) / 100:.{1 if int(cm) >= 1000 else 2}f} m"


def is_shown(tab: Tab, slots: list[dict[str, str]], *, true: bool = True) -> None:
    """The display says what the slots of a frame say."""
    tab.page.wait_for_selector(f'#number[data-seq="{slots[0]["seq"]}"]')
    expected = []
    for slot in slots:
        heard, zone = int(slot["d_cm"]) > 0, int(slot["zone"])
        delta = minus(slot["delta_deg"]) if heard and zone == 1 else "–"
        expected.append(
            [
                slot["id"] if heard else "–",
                in_metres(slot["d_cm"]) if heard else "–",
                delta,
                ZONES[zone],
                f"{float(slot['true_range_m']):.2f} m" if true and heard and slot["true_range_m"] else "–",
            ]
        )
    shown = tab.rows("#channels tbody tr")
    for row, wanted in zip(shown, expected, strict=True):
        assert row[:4] == wanted[:4]
        if true and wanted[4] != "–":
            assert float(row[4].removesuffix(" m")) == pytest.approx(float(wanted[4].removesuffix(" m")), abs=0.011)
    d_cm = min((int(slot["d_cm"]) for slot in slots if int(slot["d_cm"]) > 0), default=0)
    assert tab.text("#distance") == (f"{d_cm / 100:.{1 if d_cm >= 1000 else 2}f}" if d_cm else "––")
    assert tab.text("#heard") == str(sum(int(slot["d_cm"]) > 0 for slot in slots))


def test_a_replay(start: Start, tab: Tab, tmp_path: Path) -> None:
    program = start("replay", LOG, "--speed", 15, *WEB, "--record", tmp_path / "record")
    tab.open(url_of(program))
    tab.shows("#banner", OVER)
    assert program.ends() == 0
    rows = readings(tmp_path / "record")
    is_shown(tab, frame_at(rows))
    frames = len({row["time_s"] for row in rows})
    assert tab.text("#number") == str(frames)
    assert tab.page.locator(".plot").first.get_attribute("data-points") == str(frames)
    assert tab.text("#kind") == "replay"


def test_a_run(start: Start, autopilot: Autopilot, line: PtyLink, tab: Tab, tmp_path: Path) -> None:
    program = start(
        *("run", "--autopilot", autopilot.address, "--port", line.path, "--rate", 10, "--duration", 3),
        *(*WEB, "--record", tmp_path / "record"),
    )
    tab.open(url_of(program))
    tab.shows("#banner", OVER)
    assert program.ends() == 0
    rows = readings(tmp_path / "record")
    is_shown(tab, frame_at(rows))
    health = tab.text("#checks")
    assert re.search(r"position\n\d+ Hz of 50", health)
    assert "quadrotor 1/1" in health
    assert line.path not in health  # only what is wrong says where
    assert "there is a pose" in tab.text("#events")
    last = frame_at(rows)[0]
    place = f"vehicle at {float(last['north_m']):.1f} m north, {float(last['east_m']):.1f} m east"
    label = str(tab.page.locator("#map").get_attribute("aria-label"))
    assert place.replace("-0.0", "0.0") in label.replace("-0.0", "0.0")


def test_a_demo_shows_truth_and_search_and_hides_the_truth(start: Start, tab: Tab, tmp_path: Path) -> None:
    program = start("demo", "--headless", "--speed", 3, *WEB, "--record", tmp_path / "record")
    tab.open(url_of(program))
    label = tab.page.locator("#map")
    tab.shows("#phase", "homing in")
    assert "transmitter 1 at 20.0 m north, 5.0 m east" in str(label.get_attribute("aria-label"))
    tab.page.locator("#truth").click()
    assert "transmitter" not in str(label.get_attribute("aria-label"))
    assert not tab.page.locator("#channels .true").first.is_visible()
    assert "true range" not in tab.text("#plots")
    assert "off the truth" not in tab.text("#belief")
    tab.page.locator("#truth").click()
    tab.shows("#outcome-title", "Found")
    assert program.ends() == 0
    tab.shows("#phase", "ended")
    is_shown(tab, frame_at(readings(tmp_path / "record")))
    found = json.loads((tmp_path / "record" / "search.json").read_text())["found"]
    place = f"place found\n{found['north']:.1f} m N, {found['east']:.1f} m E"
    assert place in tab.text("#belief")
    assert "place found at" in str(label.get_attribute("aria-label"))
    assert tab.page.locator("#outcome").get_attribute("data-level") == "good"
    lat, lon = map(float, tab.text("#outcome code").split(","))
    assert [lat, lon] == pytest.approx(found["lat_lon"], abs=1.1e-7)
    tab.page.get_by_role("button", name="QR code").press("Enter")
    assert tab.page.locator("[popover]").evaluate("(code) => code.naturalWidth > 0 && code.clientWidth > 300")
    tab.page.keyboard.press("Escape")
    assert not tab.page.locator("[popover]").is_visible()
    assert not tab.page.locator("#banner").is_visible()


def d_cm(sequence: int) -> int:
    """The distance in a frame of this number."""
    return 2000 + 7 * sequence


def each_another(frame: Frame) -> bytes:
    """The frame with a distance of its own."""
    first, second = frame.channels
    return encode(frame._replace(channels=(first._replace(d=d_cm(frame.sequence)), second)))


def test_a_search(start: Start, autopilot: Autopilot, keep: Keep, tab: Tab, tmp_path: Path) -> None:
    beacon = keep(Beacon(each_another))
    program = start(
        *("search", "--autopilot", autopilot.address, "--receiver", beacon.link.path, "--dry-run"),
        *(*WEB, "--record", tmp_path / "record"),
    )
    tab.open(url_of(program))
    tab.shows("#outcome-title", "No search")
    assert program.ends() == 0
    shown = d_cm(int(tab.page.locator("#number").get_attribute("data-seq") or -1))
    assert tab.rows("#channels tbody tr") == [
        ["4", in_metres(str(shown)), "+10°", "mid", "–"],
        ["9", "45.0 m", "−40°", "mid", "–"],
    ]
    with open(tmp_path / "record" / "search.csv", newline="") as file:
        logged = [int(row["d_cm"]) for row in csv.DictReader(file) if row["d_cm"]]
    assert abs(shown - logged[-1]) <= 7 * 50  # the log has fewer rows, and on a slow machine the page is behind
    assert re.search(r"mode\n.*armed", tab.text("#checks"))
    assert not tab.page.locator("#truth").is_visible()  # there is none to show
    assert "transmitter 4" in tab.text("#belief")
    assert int(tab.text("#belief").split("hypotheses\n")[1].split("\n")[0]) > 0


@pytest.fixture
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown.demo(tmp_path_factory).record


def test_a_record_at_any_time(start: Start, tab: Tab, record: Path) -> None:
    program = start("view", record, *WEB)
    tab.open(url_of(program))
    rows = readings(record)
    is_shown(tab, frame_at(rows))
    assert tab.page.locator("#events .when").count() == tab.page.locator("#events li").count() > 0
    slider = tab.page.locator("#slider")
    for time_s in (12.34, 3.3, 20.0):
        slider.fill(str(time_s))
        tab.shows("#clock", f"0:{int(time_s):02}")
        is_shown(tab, frame_at(rows, time_s))
    tab.page.locator("#title").click()
    tab.page.keyboard.press("ArrowLeft")
    tab.shows("#clock", "0:19")
    is_shown(tab, frame_at(rows, 19.0))
    link = tab.page.url
    assert "#t=19.0" in link
    tab.page.locator("#events .when", has_text=re.compile(r"0:0\d")).last.click()
    tab.shows("#clock", re.compile(r"0:0\d"))
    tab.page.goto("about:blank")
    tab.open(link)
    tab.shows("#clock", "0:19")
    is_shown(tab, frame_at(rows, 19.0))
    tab.page.keyboard.press(" ")
    tab.shows("#play", "Pause")
    tab.page.keyboard.press(" ")
    tab.shows("#play", "Play")
    tab.page.locator("#speed").select_option("20")
    tab.page.locator("#play").click()
    tab.shows("#play", "Play")  # at the end it stops
    is_shown(tab, frame_at(rows))
    assert "place found" in tab.text("#belief")
    line = tab.page.locator("#line")
    assert "homing in" in line.locator(".phases").all_inner_texts()
    assert line.locator(".marks").count() == 1
    tab.page.locator("#shorter").click()
    assert float(tab.page.locator("#slider").get_attribute("min") or 0) > 0
    tab.page.locator("#longer").click()
    line.click(position={"x": 1, "y": 30})
    tab.shows("#clock", "0:00")
    program.stops()


def test_a_record_in_one_file_plays_without_a_server(tab: Tab, record: Path, tmp_path: Path) -> None:
    file = tmp_path / "record.html"
    assert main(["view", str(record), "--out", str(file)]) == 0
    tab.open(file.as_uri())
    rows = readings(record)
    is_shown(tab, frame_at(rows))
    tab.shows("#outcome-title", "Found")
    found = tab.text("#events")
    for time_s in (12.34, 3.3):
        tab.page.locator("#slider").fill(str(time_s))
        is_shown(tab, frame_at(rows, time_s))
    assert len(tab.text("#events")) < len(found)
    assert "homing in" in tab.page.locator("#line .phases").all_inner_texts()


def test_nothing_keeps_anybody_from_using_it(start: Start, tab: Tab, record: Path) -> None:
    """By axe-core, in light and dark and on a phone; and with the keyboard alone."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    program = start("view", record, *WEB)
    tab.open(url_of(program))
    tab.shows("#phase", "ended")
    reached = []
    for _ in range(66):  # the time of each event is a button
        tab.page.keyboard.press("Tab")
        reached.append(tab.page.evaluate("document.activeElement.id || document.activeElement.textContent"))
    wanted = {"truth", "sound", "map", "fit", "follow", "closer", "wider", "play", "slider", "speed", "events"}
    assert wanted | {"search", "longer", "shorter"} <= set(reached)
    tab.page.locator("#map").focus()
    for key, fit, follow in (("ArrowLeft", "false", "false"), ("0", "true", "false"), ("f", "false", "true")):
        tab.page.keyboard.press(key)
        assert tab.page.locator("#fit").get_attribute("aria-pressed") == fit
        assert tab.page.locator("#follow").get_attribute("aria-pressed") == follow
    for scheme, width in (("light", 1280), ("dark", 1280), ("light", 390)):
        tab.page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
        tab.page.set_viewport_size({"width": width, "height": 844})
        result = axe.Axe().run(tab.page)
        assert result.violations_count == 0, result.generate_report()
        assert tab.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    program.stops()


def test_several_receivers_strange_texts_and_a_pose_that_is_no_number(tab: Tab) -> None:
    page = WebPage(HostPort("127.0.0.1", 0), State("run", "<i>", named=True))
    try:
        tab.open(page.address.url)
        assert tab.text("#distance") == "––"
        for name, d_cm in (("front", 1234), ("rear", 250)):
            reading = Reading((ChannelReading(7, 1, d_cm, -12, None),), False, False)
            where = Pose([math.nan, 0.0, 0.0], [[1, 0, 0], [0, 1, 0], [0, 0, 1]])
            frame = Frame(5, 1, (Channel(7, 1, d_cm, -12),))
            page.observe(FrameMade(1.0, "alpha", name, 5, 1.0, None, where, 0.1, reading, frame, True, 0.0, ("drop",)))
        hostile = "<img src=x onerror=alert(1)>\u202e"
        page.observe(VehicleFound(1.0, "alpha", hostile, 2, False))
        page.observe(AutopilotText(1.0, "alpha", hostile))
        status = [ReceiverStatus(name, None, 5, 2, None) for name in ("front", "rear")]
        page.observe(StatusReport(1.0, [VehicleStatus("alpha", hostile, {"ATTITUDE": 1.0}, status)]))
        tab.shows("#distance", "12.3")
        tab.page.locator("#receiver").select_option("alpha/rear")
        tab.shows("#distance", "2.50")
        assert "<img src=x onerror=alert(1)>\\u202e" in tab.text("#events")
        assert tab.page.locator("img").count() == 1
        health = tab.text("#checks")
        assert "2 dropped" in health
        assert "faults on\ndrop" in health
        assert tab.page.locator("#pill").get_attribute("data-level") == "bad"
    finally:
        page.close()


def flight(*events: Event) -> State:
    """A search for two transmitters, at 10 m and 20 m north of the take-off point, and what happened in it."""
    state = State("demo", "")
    places = np.array([[10.0, 0.0, 1.0], [20.0, 0.0, 1.0]])
    there = Transmitters((1, 2), places, np.array([np.eye(3)] * 2), np.ones(2))
    reports = [ReceiverStatus("receiver", None, 5, 0, there)]
    state.update([DatumSet(0.0, "vehicle", 46.0123, 7.7456, 1650.0, ())])
    state.update([StatusReport(1.0, [VehicleStatus("vehicle", "quadrotor 1/1", {}, reports)])])
    begun = TakeOffPoint(1.0, 46.0123, 7.7456, 1650.0), SearchBegun(2.0, 3.0, 2)
    state.update([FromSearch(event.time_s, event) for event in (*begun, *events)])
    return state


def noted(number: int, id_: int, off_m: float, *, sure: bool = True, marked: bool = True) -> VictimNoted:
    return VictimNoted(2.0 + 33 * number, id_, number, 2, 10.0 * id_ + off_m, 0.0, sure, marked, 2 - number, False)


TIME_UP = SearchEnded(90.0, (because(Why.TIME_UP, limit_s=90.0, found=1, wanted=2, more=1),), True)
HEARD = TransmitterHeard(20.0, 2, 9.0, 0.0, 20.0)
STATES = {(True, True): "marked", (True, False): "found", (False, True): "not sure"}
ENDS = [
    ((noted(1, 1, 0.4), noted(2, 2, 0.0)), "good", "2 of 2 found", ["0.4 m off, 33 s, marked", "less than 1 cm off"]),
    ((noted(1, 1, 0.4),), "warn", "1 of 2 found", ["0.4 m off", "Transmitter 2\nnot found: not received"]),
    ((HEARD, noted(1, 1, 0.4, marked=False)), "warn", "1 of 2 found", ["33 s", "2\nnot found, but received"]),
    ((noted(1, 1, 0.4), noted(2, 2, 6.0, sure=False)), "warn", "1 of 2 found, 1 not sure", ["marked", "not sure: the"]),
    ((), "bad", "Not found", ["1\nnot found: not received", "2\nnot found: not received"]),
]


@pytest.mark.parametrize(("events", "level", "title", "rows"), ENDS)
def test_a_find_and_a_failure_never_look_alike(
    tab: Tab, events: tuple[Event, ...], level: str, title: str, rows: list[str]
) -> None:
    page = WebPage(HostPort("127.0.0.1", 0), flight(*events))
    try:
        tab.open(page.address.url)
        assert not tab.page.locator("#outcome").is_visible()
        tab.shows("#count", title if events else "0 of 2 found")
        page.observe(FromSearch(90.0, TIME_UP))
        tab.shows("#outcome-title", title)
        assert tab.page.locator("#outcome").get_attribute("data-level") == level
        shown = tab.page.locator("#outcome-list li").all_inner_texts()
        assert [wanted for wanted, row in zip(rows, shown, strict=True) if not re.search(wanted, row)] == []
        noted = [event for event in events if isinstance(event, VictimNoted)]
        states = [STATES[one.sure, one.marked] for one in noted]
        assert [row.get_attribute("data-state") for row in tab.page.locator("#victims li").all()] == states
    finally:
        page.close()


def test_one_key_shows_the_receiver_alone_and_its_arrow_turns_the_short_way(tab: Tab) -> None:
    page = WebPage(HostPort("127.0.0.1", 0), State("run", "field.yaml"))
    where = Pose([0.0, 0.0, -3.0], np.eye(3))
    try:
        tab.open(page.address.url)
        for number, delta in enumerate((0, 60, 85, -85, -60, 0)):
            reading = Reading((ChannelReading(1, 1, 1234 + number, delta, None),), False, False)
            frame = Frame(number, 1, (Channel(1, 1, 1234 + number, delta),))
            made = FrameMade(
                1.0, "vehicle", "receiver", number, 1.0 + number, None, where, 0.1, reading, frame, True, 0.0
            )
            page.observe(made)
            tab.shows("#number", str(number + 1))
            turned, heads = tab.page.evaluate(TURNED)
            assert turned == delta + 180 * (number > 2)
            assert bool(heads) == (number > 2)  # the solid head is in front
        for width in (390, 1280):
            tab.page.set_viewport_size({"width": width, "height": 844})
            tab.page.keyboard.press("r")
            assert not tab.page.locator("#map").is_visible()
            box = tab.page.locator("#distance").bounding_box()
            assert box is not None
            assert box["height"] >= 95  # pixels: 25 mm of a usual screen
            tab.page.keyboard.press("Escape")
            assert tab.page.locator("#map").is_visible()
    finally:
        page.close()


def test_a_lesson_hides_the_truth_and_has_a_score_at_the_end(tab: Tab) -> None:
    state = State("run", "lesson.yaml", hidden=True)
    places = np.array([[10.0, 0.0, 1.0], [20.0, 0.0, 1.0]])
    there = Transmitters((1, 2), places, np.array([np.eye(3)] * 2), np.ones(2))
    state.update(
        [StatusReport(1.0, [VehicleStatus("vehicle", "", {}, [ReceiverStatus("receiver", None, 5, 0, there)])])]
    )
    page = WebPage(HostPort("127.0.0.1", 0), state)
    reading = Reading((ChannelReading(1, 1, 1234, -12, 9.75),), False, False)
    frame = Frame(5, 1, (Channel(1, 1, 1234, -12),))
    try:
        tab.open(page.address.url)
        for n, north in ((30, 10.6), (50, 14.0)):
            where = Pose([north, 0.8, -3.0], np.eye(3))
            page.observe(
                FrameMade(float(n), "vehicle", "receiver", n, float(n), None, where, 0.1, reading, frame, True, 0.0)
            )
            tab.page.wait_for_selector(f'#number[data-time="{n}"]')
            tab.page.keyboard.press("m")
        with urllib.request.urlopen(f"{page.address.url}state.json") as answer:
            text = answer.read().decode()
        assert "9.75" not in text
        assert json.loads(text)["transmitters"] == []
        assert not tab.page.locator("#truth").is_visible()
        page.close("stopped")
        tab.shows("#outcome-title", "1 of 2 found, 1 not sure")
        assert "mean error 3.5 m, 50 s" in tab.text("#outcome-why")
        rows = tab.page.locator("#outcome-list li").all_inner_texts()
        assert "Victim 1 (transmitter 1)" in rows[0]
        assert "1.0 m off, 30 s" in rows[0]
        assert "Victim 2 (transmitter 2)" in rows[1]
        assert "6.1 m off, 50 s, more than 2 m from the next transmitter" in rows[1]
    finally:
        page.close()


def test_late_frames_are_no_good_health(tab: Tab) -> None:
    state = State("run", "field.yaml")
    state.update([VehicleFound(1.0, "vehicle", "quadrotor 1/1", 2, False)])
    reading, where = Reading((), False, False), Pose([30.0, 30.0, -3.0], np.eye(3))
    for n, late_s in ((1, 0.001), (2, 0.330)):
        made = FrameMade(
            float(n), "vehicle", "receiver", n, float(n), None, where, 0.1, reading, Frame(n, 1, ()), True, late_s
        )
        state.update([made])
    page = WebPage(HostPort("127.0.0.1", 0), state)
    try:
        tab.open(page.address.url)
        assert tab.text("#pill-text") == "frames late: up to 330 ms"
        assert "end other programs" in tab.text("#checks")
    finally:
        page.close()


def test_a_vehicle_that_is_lost_stays_where_it_was_last(tab: Tab) -> None:
    state = State("run", "field.yaml")
    reading = Reading((ChannelReading(1, 1, 1234, -12, None),), False, False)
    frame = Frame(5, 1, (Channel(1, 1, 1234, -12),))
    for n, where in ((1, Pose([30.0, 30.0, -3.0], np.eye(3))), (2, None), (43, None)):
        state.update(
            [FrameMade(float(n), "vehicle", "receiver", n, float(n), None, where, 0.1, reading, frame, True, 0.0)]
        )
    page = WebPage(HostPort("127.0.0.1", 0), state)
    try:
        tab.open(page.address.url)
        label = str(tab.page.locator("#map").get_attribute("aria-label"))
        assert "vehicle last known 42 s ago, 42 m NE of home" in label
        assert tab.page.evaluate(PLACED) == ["21.9 m S, 0.0 m E", "0.0 m N, 3.0 m W"]
        assert "last known place" in tab.text("#legend")
    finally:
        page.close()


def overlap(a: list[float], b: list[float]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def test_the_names_of_drones_that_are_close_hide_nothing_and_are_whole(tab: Tab) -> None:
    page = WebPage(HostPort("127.0.0.1", 0), State("run", "field.yaml", named=True))
    try:
        tab.open(page.address.url)
        line = [[f"drone-{i + 1}", 60 + 45 * i, 100] for i in range(4)]  # a name is 56 wide
        at_the_edge = [["drone-5", 385, 30], ["drone-6", 390, 395]]
        boxes = tab.page.evaluate(ARRANGED, [[*line, *at_the_edge], 400, 400])
    finally:
        page.close()
    drones = [[x - 12, y - 12, x + 12, y + 12] for _, x, y in [*line, *at_the_edge]]
    assert [pair for pair in itertools.combinations(boxes, 2) if overlap(*pair)] == []
    assert [pair for pair in itertools.product(boxes, drones) if overlap(*pair)] == []
    assert [box for box in boxes if box[0] < 0 or box[1] < 0 or box[2] > 400 or box[3] > 400] == []


def test_a_demo_of_several_drones_is_one_and_its_places_are_from_the_datum(start: Start, tab: Tab) -> None:
    program = start("demo", "--count", 2, "--headless", "--speed", 3, *WEB)
    tab.open(url_of(program))
    tab.shows("#kind", "demo")
    team = tab.page.locator("#team-rows tr")
    found = team.filter(has_text="1 found")
    found.wait_for()
    tab.page.locator("#receiver").select_option(f"{found.locator('th').inner_text()}/receiver")
    other = tab.page.locator("#receiver option:not(:checked)").first.get_attribute("value") or ""
    mine = str(tab.page.locator("#receiver").input_value())
    tab.page.locator(f'[data-key="{other}"]').click()
    assert tab.page.locator("#receiver").input_value() == other
    tab.page.locator(f'[data-key="{mine}"]').press("Enter")
    assert tab.page.locator("#receiver").input_value() == mine
    tab.shows("#belief", re.compile(r"place found\s*(19\.\d|20\.\d) m N, [45]\.\d m E"))
    program.stops()
