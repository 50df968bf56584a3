"""--web and `view` in a real browser: what a person sees is what the record of the same run says."""

from __future__ import annotations

import itertools
import json
import math
import re
import signal
import socket
import urllib.request
from collections.abc import Callable, Iterator
from decimal import ROUND_HALF_UP, Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arva_hil.cli.main import main
from arva_hil.events import DatumSet, Event, FrameMade, ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.events.reasons import Why, because
from arva_hil.events.searches import (
    FromSearch,
    PlaceFound,
    SearchBegun,
    SearchEnded,
    TakeOffPoint,
    TransmitterChosen,
    TransmitterHeard,
    VictimNoted,
)
from arva_hil.events.vehicles import AutopilotText, VehicleFound
from arva_hil.links.pty import PtyLink
from arva_hil.model.field.dipole import Transmitters
from arva_hil.model.receiver import ChannelReading, Pose
from arva_hil.observers.web.address import HostPort
from arva_hil.observers.web.page import WebPage
from arva_hil.observers.web.state import State
from firmware_proto import Frame, encode
from tests.browser import Tab
from tests.every import every
from tests.files import rows as table
from tests.made_frames import frame_made
from tests.said import says

from . import flown
from .far_ends import Arva, Autopilot, Beacon, Keep, Program, Start

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
BEEPING = """window.beeps = 0; window.AudioContext = class {
  state = "running"; currentTime = 0; resume() {} suspend() {}
  createGain() { return { gain: { setValueAtTime() {}, exponentialRampToValueAtTime() {} }, connect() {} }; }
  createOscillator() { beeps += 1; return { frequency: {}, connect: (to) => to, start() {}, stop() {} }; }
}; null"""
LATER = "new Promise((done) => { const before = beeps; setTimeout(() => done(beeps - before), 700); })"
DRAWN = """window.uPlot = class extends uPlot { constructor(...all) {
  super(...all);
  const set = this.setData;
  this.setData = (data) => { if (data[2]) window.drawn ??= data; set.call(this, data); };
} }; null"""
TURNED = """[Number(document.getElementById("arrow").style.transform.match(/-?\\d+/)[0]),
  document.getElementById("heads").getAttribute("transform")]"""


@pytest.fixture
def tab(browser: Any) -> Iterator[Tab]:
    tab = Tab(browser)
    yield tab
    tab.close()


def until(tab: Tab, condition: str) -> None:
    """Wait for a condition in JavaScript; the page's policy forbids `wait_for_function`."""
    looking = f"() => {{ if ({condition}) done(); else setTimeout(look, 50); }}"
    tab.page.evaluate(f"new Promise((done) => {{ const look = {looking}; look(); }})")


def url_of(program: Program) -> str:
    return program.says(r"page: (http://127\.0\.0\.1:\d+/)")[1]


def readings(folder: Path) -> list[dict[str, str]]:
    return table(folder / "readings.csv")


def frame_at(rows: list[dict[str, str]], time_s: float = math.inf) -> list[dict[str, str]]:
    """The slots of the last frame until then."""
    last = max(float(row["time_s"]) for row in rows if float(row["time_s"]) <= time_s)
    return [row for row in rows if float(row["time_s"]) == last]


def minus(degrees: str) -> str:
    return f"{'−' if int(degrees) < 0 else '+'}{abs(int(degrees))}°"


def in_metres(cm: int) -> str:
    """As the page shows it: there a half is rounded up, by Python to an even digit."""
    return str(Decimal(cm / 100).quantize(Decimal("0.1" if cm >= 1000 else "0.01"), ROUND_HALF_UP))


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
                f"{in_metres(int(slot['d_cm']))} m" if heard else "–",
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
    assert tab.text("#distance") == (in_metres(d_cm) if d_cm else "––")
    assert tab.text("#heard") == str(sum(int(slot["d_cm"]) > 0 for slot in slots))


def test_a_run(start: Start, autopilot: Autopilot, line: PtyLink, tab: Tab, tmp_path: Path) -> None:
    program = start(
        *("run", "--autopilot", autopilot.address, "--port", line.path, "--rate", 10),
        *(*WEB, "--record", tmp_path / "record"),
    )
    tab.moves()
    tab.open(url_of(program))
    tab.shows("#events", re.compile("there is a pose"))
    program.stops(signal.SIGINT)
    tab.shows("#banner", OVER)
    rows = readings(tmp_path / "record")
    is_shown(tab, frame_at(rows))
    health = tab.text("#checks")
    assert re.search(r"position\n\d+ Hz of 50", health)
    assert "quadrotor 1/1" in health
    assert line.path not in health  # only what is wrong says where
    assert "there is a pose" in tab.text("#events")
    last = frame_at(rows)[0]
    place = f"vehicle at {float(last['north_m']):.1f} m north, {float(last['east_m']):.1f} m east"
    assert place.replace("-0.0", "0.0") in str(tab.page.locator("#map").get_attribute("aria-label")).replace(
        "-0.0", "0.0"
    )


def test_a_demo_shows_truth_and_search_and_hides_the_truth(start: Start, tab: Tab, tmp_path: Path) -> None:
    program = start("demo", "--headless", *WEB, "--record", tmp_path / "record")
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
    program.stops(signal.SIGINT)
    tab.shows("#outcome-title", "Not found")
    is_shown(tab, frame_at(readings(tmp_path / "record")))


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
    program.ends()
    shown = d_cm(int(tab.page.locator("#number").get_attribute("data-seq") or -1))
    assert tab.rows("#channels tbody tr") == [
        ["4", f"{in_metres(shown)} m", "+10°", "mid", "–"],
        ["9", "45.0 m", "−40°", "mid", "–"],
    ]
    logged = [int(row["d_cm"]) for row in table(tmp_path / "record" / "search.csv") if row["d_cm"]]
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
    events = tab.page.locator("#events li").all_inner_texts()
    for text in events:  # it is the newest at its own time, and keeps the focus
        tab.page.locator("#events li", has_text=text.split("\n")[-1]).last.get_by_role("button").press("Enter")
        assert text in tab.page.locator("#events li").all_inner_texts()
        assert tab.page.evaluate("document.activeElement.className") == "when"
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


def test_the_place_found_is_shown_and_can_be_handed_on(start: Start, tab: Tab, record: Path) -> None:
    program = start("view", record, *WEB)
    tab.open(url_of(program))
    tab.shows("#outcome-title", "Found")
    tab.shows("#phase", "ended")
    found = json.loads((record / "search.json").read_text())["found"]
    assert f"place found\n{found['north']:.1f} m N, {found['east']:.1f} m E" in tab.text("#belief")
    assert "place found at" in str(tab.page.locator("#map").get_attribute("aria-label"))
    assert tab.page.locator("#outcome").get_attribute("data-level") == "good"
    lat, lon = map(float, tab.text("#outcome code").split(","))
    assert [lat, lon] == pytest.approx(found["lat_lon"], abs=1.1e-7)
    tab.page.get_by_role("button", name="QR code").press("Enter")
    assert tab.page.locator("[popover]").evaluate("(code) => code.naturalWidth > 0 && code.clientWidth > 300")
    tab.page.keyboard.press("Escape")
    assert not tab.page.locator("[popover]").is_visible()
    assert not tab.page.locator("#banner").is_visible()
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
    tab.page.keyboard.press("r")
    assert axe.Axe().run(tab.page).violations_count == 0  # of the receiver alone
    program.stops()


@pytest.fixture
def serve(tab: Tab, keep: Keep) -> Callable[[State], WebPage]:
    """`serve(state)`: a page that shows it, open in the tab."""

    def opened(state: State) -> WebPage:
        page = keep(WebPage(HostPort("127.0.0.1", 0), state))
        tab.open(page.address.url)
        return page

    return opened


Serve = Callable[[State], WebPage]  # it is a fixture


def made(
    number: int,
    north: float = 0.0,
    east: float = 0.0,
    *,
    pose: bool = True,
    d_cm: int = 1234,
    delta: int = -12,
    late_s: float = 0.0,
    of: tuple[str, str] = ("vehicle", "receiver"),
    faults: tuple[str, ...] = (),
) -> FrameMade:
    """A frame of this number, made at as many seconds, 3 m high."""
    where = Pose([north, east, -3.0], np.eye(3)) if pose else None
    values = {"time_s": float(number), "age_s": 0.1, "faults": faults}
    return frame_made(number, ChannelReading(1, 1, d_cm, delta, 9.75), pose=where, of=of, late_s=late_s, **values)


def two_buried(state: State) -> State:
    """The same with a vehicle, and transmitters 1 and 2 at 10 m and 20 m north."""
    there = Transmitters((1, 2), np.array([[10.0, 0.0, 1.0], [20.0, 0.0, 1.0]]), np.array([np.eye(3)] * 2), np.ones(2))
    reports = [ReceiverStatus("receiver", None, 5, 0, there)]
    state.update([StatusReport(1.0, [VehicleStatus("vehicle", "quadrotor 1/1", {}, reports)])])
    return state


def test_several_receivers_strange_texts_and_a_pose_that_is_no_number(tab: Tab, serve: Serve) -> None:
    page = serve(State("run", "<i>", named=True))
    assert tab.text("#distance") == "––"
    for name, d_cm in (("front", 1234), ("rear", 250)):
        page.observe(made(5, math.nan, d_cm=d_cm, of=("alpha", name), faults=("drop",)))
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
    says(tab.text("#checks"), "2 dropped", "faults on\ndrop")
    assert tab.page.locator("#pill").get_attribute("data-level") == "bad"


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


@every("events, level, title, rows", ENDS)
def test_a_find_and_a_failure_never_look_alike(
    tab: Tab, serve: Serve, events: tuple[Event, ...], level: str, title: str, rows: list[str]
) -> None:
    state = two_buried(State("demo", ""))
    begun = TakeOffPoint(1.0, 46.0123, 7.7456, 1650.0), SearchBegun(2.0, 3.0, 2)
    state.update([DatumSet(0.0, "vehicle", 46.0123, 7.7456, 1650.0, ())])
    state.update([FromSearch(event.time_s, event) for event in (*begun, *events)])
    page = serve(state)
    assert not tab.page.locator("#outcome").is_visible()
    tab.shows("#count", title if events else "0 of 2 found")
    page.observe(FromSearch(90.0, TIME_UP))
    tab.shows("#outcome-title", title)
    assert tab.page.locator("#outcome").get_attribute("data-level") == level
    shown = tab.page.locator("#outcome-list li").all_inner_texts()
    assert [wanted for wanted, row in zip(rows, shown, strict=True) if not re.search(wanted, row)] == []
    states = [STATES[one.sure, one.marked] for one in events if isinstance(one, VictimNoted)]
    assert [row.get_attribute("data-state") for row in tab.page.locator("#victims li").all()] == states
    page.close()


def test_one_key_shows_the_receiver_alone_and_its_arrow_turns_the_short_way(tab: Tab, serve: Serve) -> None:
    page = serve(State("run", "field.yaml"))
    for number, delta in enumerate((0, 60, 85, -85, -60, 0)):
        page.observe(made(number, d_cm=1234 + number, delta=delta))
        tab.shows("#number", str(number + 1))
        turned, heads = tab.page.evaluate(TURNED)
        assert turned == delta + 180 * (number > 2)
        assert bool(heads) == (number > 2)  # the solid head is in front
    for width in (390, 1280):
        tab.page.set_viewport_size({"width": width, "height": 844})
        tab.page.keyboard.press("r")
        assert not tab.page.locator("#map").is_visible()
        assert tab.page.locator("#distance").bounding_box()["height"] >= 95  # pixels: 25 mm of a usual screen
        tab.page.keyboard.press("Escape")
        assert tab.page.locator("#map").is_visible()


def test_a_lesson_hides_the_truth_and_has_a_score_at_the_end(tab: Tab, serve: Serve) -> None:
    page = serve(two_buried(State("run", "lesson.yaml", hidden=True)))
    for n, north in ((30, 10.6), (50, 14.0)):
        page.observe(made(n, north, 0.8))
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
    first, second = tab.page.locator("#outcome-list li").all_inner_texts()
    assert re.search(r"Victim 1 \(transmitter 1\)\s.*1\.0 m off, 30 s", first)
    assert re.search(r"Victim 2 \(transmitter 2\)\s.*6\.1 m off, 50 s, more than 2 m from the next transmitter", second)


def test_late_frames_are_no_good_health(tab: Tab, serve: Serve) -> None:
    state = State("run", "field.yaml")
    state.update([VehicleFound(1.0, "vehicle", "quadrotor 1/1", 2, False)])
    state.update([made(n, 30.0, 30.0, late_s=late_s) for n, late_s in ((1, 0.001), (2, 0.330))])
    serve(state)
    assert tab.text("#pill-text") == "frames late: up to 330 ms"
    assert "end other programs" in tab.text("#checks")


def test_another_run_at_the_address_has_its_own_receivers_and_field(tab: Tab, serve: Serve) -> None:
    one, other = (two_buried(State("run", "field.yaml")) for _ in range(2))
    for state, name in ((one, "alpha"), (other, "beta")):
        state.update([made(1, of=(name, side)) for side in ("front", "rear")])
        state.draw_field()
    page = serve(one)
    fields = sum("field.json" in url for url in tab.asked)
    page.state = other  # as a new program does
    tab.shows("#device-name", "beta/front")
    until(tab, f"performance.getEntriesByName(location.origin + '/field.json').length > {fields}")
    assert tab.page.locator("#receiver option").all_inner_texts() == ["beta/front", "beta/rear"]


def test_another_record_at_the_address_has_its_own_time_line(start: Start, tab: Tab, record: Path) -> None:
    program = start("view", record, *WEB)
    tab.open(url_of(program))
    end = float(tab.page.locator("#slider").get_attribute("max") or 0)
    port = url_of(program).rsplit(":", 1)[1].strip("/")
    program.stops()
    program = start("view", LOG, "--web", port)
    tab.shows("#title", re.compile("arducopter"))
    assert float(tab.page.locator("#slider").get_attribute("max") or 0) < end
    assert tab.page.locator("#line .phases").count() == 0  # no search
    program.stops()


def test_the_tone_ends_with_the_run(tab: Tab, serve: Serve) -> None:
    page = serve(State("run", "field.yaml"))
    tab.page.evaluate(BEEPING)
    page.observe(made(1, d_cm=30))
    tab.shows("#number", "1")
    tab.page.keyboard.press("t")
    assert tab.page.evaluate(LATER) > 0
    page.close("stopped")
    tab.shows("#banner", OVER)
    assert tab.page.evaluate(LATER) == 0


def test_a_low_window_has_a_map(tab: Tab, serve: Serve) -> None:
    serve(two_buried(State("run", "field.yaml")))
    tab.page.set_viewport_size({"width": 1210, "height": 200})
    until(tab, "document.getElementById('map').height < 150")
    assert tab.page.evaluate("import('/map.js').then(({ view }) => view.scale)") > 0


def test_the_range_of_an_empty_slot_is_not_drawn_as_that_of_another_transmitter(tab: Tab, serve: Serve) -> None:
    page = serve(State("run", "field.yaml"))
    tab.page.evaluate(DRAWN)
    state = two_buried(State("run", "field.yaml"))
    empty = frame_made(2, ChannelReading(None, 0, -1, -1, 8.9), pose=Pose([0.0, 0.0, -3.0], np.eye(3)), time_s=2.0)
    state.update([made(1), empty])
    page.state = state
    tab.shows("#number", "2")
    until(tab, "window.drawn")
    assert tab.page.evaluate("drawn[2]") == [9.75, None]


def test_a_vehicle_that_is_lost_stays_where_it_was_last(tab: Tab, serve: Serve) -> None:
    state = State("run", "field.yaml")
    state.update([made(1, 30.0, 30.0), made(2, pose=False), made(43, pose=False)])
    serve(state)
    assert "vehicle last known 42 s ago, 42 m NE of home" in str(tab.page.locator("#map").get_attribute("aria-label"))
    assert tab.page.evaluate(PLACED) == ["21.9 m S, 0.0 m E", "0.0 m N, 3.0 m W"]
    assert "last known place" in tab.text("#legend")


def test_a_team_is_on_one_map_and_each_drone_is_chosen_there(tab: Tab, serve: Serve) -> None:
    state, home = State("demo", "", named=True), (46.0123, 7.7456, 1650.0)
    for number, name in enumerate(("drone-1", "drone-2")):
        events = [TakeOffPoint(1.0, *home), TransmitterChosen(2.0, 1, 9.0)]
        state.update([DatumSet(0.0, name, *home, ()), made(3, 5.0 * number, of=(name, "receiver"))])
        state.update([FromSearch(event.time_s, event, name) for event in events])
    state.update([FromSearch(4.0, PlaceFound(4.0, 1, 9.0, 3.0, None, True), "drone-2")])
    page = serve(state)
    tab.shows("#kind", "demo")
    assert tab.page.locator("#team-rows tr").filter(has_text="1 found").locator("th").inner_text() == "drone-2"
    for name, choose in (("drone-2", lambda place: place.click()), ("drone-1", lambda place: place.press("Enter"))):
        choose(tab.page.locator(f'[data-key="{name}/receiver"]'))
        assert tab.page.locator("#receiver").input_value() == f"{name}/receiver"
        assert tab.page.locator("#device-name").bounding_box()["height"] < 24  # in one line
        page.observe(made(4, 9.0, of=(name, "receiver")))


def overlap(a: list[float], b: list[float]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def test_the_names_of_drones_that_are_close_hide_nothing_and_are_whole(tab: Tab, serve: Serve) -> None:
    serve(State("run", "field.yaml", named=True))
    line = [[f"drone-{i + 1}", 60 + 45 * i, 100] for i in range(4)]  # a name is 56 wide
    at_the_edge = [["drone-5", 385, 30], ["drone-6", 390, 395]]
    boxes = tab.page.evaluate(ARRANGED, [[*line, *at_the_edge], 400, 400])
    drones = [[x - 12, y - 12, x + 12, y + 12] for _, x, y in [*line, *at_the_edge]]
    assert [pair for pair in itertools.combinations(boxes, 2) if overlap(*pair)] == []
    assert [pair for pair in itertools.product(boxes, drones) if overlap(*pair)] == []
    assert [box for box in boxes if box[0] < 0 or box[1] < 0 or box[2] > 400 or box[3] > 400] == []


# -- --web on the command line: what is said of the page, and what of wrong addresses --------------------------


@pytest.fixture
def taken() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as other:
        yield other.getsockname()[1]


def replay(arva: Arva, *arguments: object) -> Any:
    return arva("replay", LOG, "--rate", 0.1, "--out", "/dev/null", *arguments)


def test_the_address_is_said_and_the_page_is_off_unless_it_is_asked_for(arva: Arva) -> None:
    assert re.search(r"^page: http://127\.0\.0\.1:\d+/$", replay(arva, "--web", "127.0.0.1:0").err, re.MULTILINE)
    for off in ([], ["--web", "off"]):
        assert "page: " not in replay(arva, *off).err


def test_the_environment_asks_for_it_too(arva: Arva, monkeypatch: pytest.MonkeyPatch, taken: int) -> None:
    monkeypatch.setenv("ARVA_HIL_WEB", f"127.0.0.1:{taken}")
    assert re.search(rf"^page: http://127\.0\.0\.1:\d+/ \(port {taken} is taken\)$", replay(arva).err, re.MULTILINE)


def test_who_else_can_see_it_is_said(arva: Arva) -> None:
    err = replay(arva, "--web", "0.0.0.0:0").err
    assert re.search(r"^page: http://127\.0\.0\.1:\d+/$", err, re.MULTILINE)
    assert "warning: everybody in this network can open the page; --web 127.0.0.1 offers it here only" in err


@pytest.mark.parametrize("command", ["run", "search"])
def test_a_command_whose_page_cannot_be_served_leaves_no_record(arva: Arva, tmp_path: Path, command: str) -> None:
    """So that the same one with another address is not told that there is a record already."""
    links = ("--autopilot", f"pty:{tmp_path / 'fc'}", {"run": "--port", "search": "--receiver"}[command], "pty")
    assert "the page cannot be served" in arva.refused(
        command, *links, "--record", tmp_path / "record", "--web", "192.0.2.1:80"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.undrawn
def test_the_demo_has_it_by_itself_and_says_how_to_see_it_again(arva: Arva, tmp_path: Path) -> None:
    fly = ("demo", "--speed", "max", "--limit", 1, "--record")  # it does not find anything in a second
    err = arva(*fly, tmp_path / "a", code=1).err
    assert re.search(r"^page: http://127\.0\.0\.1:\d+/", err, re.MULTILINE)
    assert f"to see it again: arva-hil view {tmp_path / 'a'}" in err
    for word, folder in (("--headless", "b"), ("--web=off", "c")):
        assert "page" not in arva(*fly, tmp_path / folder, word, code=1).err
