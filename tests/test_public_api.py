"""`import arva_hil`: what is public is documented and tried; mistakes are named; registered parts; safe text."""

from __future__ import annotations

import doctest
import gc
import importlib
import inspect
import math
import os
import pkgutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import arva_hil
from arva_hil.config.transmitter import Transmitter
from arva_hil.errors import KindError
from arva_hil.links.pty import PtyLink
from arva_hil.registry import FORMATS, RECEIVERS, STRATEGIES, Registry
from arva_hil.safe_text import cell, one_line
from tests.cli.far_ends import Autopilot
from tests.every import every

ROOT = Path(__file__).parent.parent
PINNED = (  # in the order of the project's interface
    "Scenario load_scenario Emulator run_live replay SimulatedVehicle Transmitters dipole_field ReceiverModel "
    "PaperReceiver Reading LocalFrame Strategy ArvaError"
).split()
LEVEL = np.eye(3)
ONE = arva_hil.Transmitters((1,), [[20, 5, 0]], [LEVEL], [1])  # type: ignore[arg-type, list-item]


def test_every_pinned_name_is_public() -> None:
    assert set(PINNED) <= set(arva_hil.__all__)
    assert set(arva_hil.__all__) <= set(dir(arva_hil))


def test_importing_the_package_imports_nothing_slow() -> None:
    program = "import arva_hil, sys; print(sorted({'numpy', 'pymavlink', 'yaml', 'serial'} & set(sys.modules)))"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert ran.stdout == "[]\n"


def test_a_name_that_is_not_public_is_not_there() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        arva_hil.Nothing  # type: ignore[attr-defined]  # noqa: B018


@every("name", arva_hil.__all__)
def test_every_public_name_is_documented_and_so_is_what_it_can_do(name: str) -> None:
    thing = getattr(arva_hil, name)
    assert inspect.getdoc(thing)
    if inspect.isclass(thing):
        own = {key: value for key, value in vars(thing).items() if not key.startswith("_")}
        undocumented = [key for key, value in own.items() if inspect.isfunction(value) and not inspect.getdoc(value)]
        assert undocumented == []


@every("name", arva_hil.__all__)
def test_the_examples_of_public_names_are_true(name: str) -> None:
    thing = getattr(arva_hil, name)
    home = importlib.import_module(getattr(thing, "__module__", "builtins"))
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    for example in doctest.DocTestFinder(recurse=False).find(thing, name, globs=vars(home) | {name: thing}):
        assert runner.run(example).failed == 0


def test_the_examples_of_the_page_are_true(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    line, port = PtyLink(), PtyLink()
    autopilot = Autopilot(line, speed=1.0)
    text = (ROOT / "docs" / "howto" / "python.md").read_text(encoding="utf-8")
    text = text.replace("udpin:127.0.0.1:14550", autopilot.address).replace("/dev/ttyUSB0", port.path)
    text = text.replace("flight.tlog", str(ROOT / "tests" / "data" / "arducopter.tlog")).replace("```", "")
    try:
        examples = doctest.DocTestParser().get_doctest(text, {}, "docs/howto/python.md", None, None)
        assert len(examples.examples) > 20
        assert doctest.DocTestRunner().run(examples).failed == 0
    finally:
        for link in autopilot, line, port:
            link.close()


def test_every_error_of_the_package_has_the_one_root() -> None:
    ours = set()
    for module in pkgutil.walk_packages(arva_hil.__path__, "arva_hil."):
        if module.name != "arva_hil.__main__":
            every = vars(importlib.import_module(module.name)).values()
            ours |= {x for x in every if inspect.isclass(x) and issubclass(x, BaseException)}
    ours = {error for error in ours if error.__module__.startswith("arva_hil")}
    assert len(ours) > 10
    assert {error for error in ours if not issubclass(error, arva_hil.ArvaError)} == set()


MISTAKES: list[tuple[Callable[[], Any], str]] = [
    (lambda: arva_hil.dipole_field([1, 2], [[0, 0, 0]], [LEVEL], [1]), "points: the shape (2,), expected numbers"),
    (lambda: arva_hil.dipole_field("here", [[0, 0, 0]], [LEVEL], [1]), "points: 'here', expected numbers"),
    (lambda: arva_hil.dipole_field([0, 0, 0], [0, 0, 0], [LEVEL], [1]), "positions: the shape (3,), expected"),
    (
        lambda: arva_hil.dipole_field([0, 0, 0], [[0, 0, 0]], LEVEL, [1]),
        "rotations: the shape (3, 3), expected (1, 3, 3)",
    ),
    (lambda: arva_hil.dipole_field([0, 0, 0], [[0, 0, 0]], [LEVEL], 1), "strengths: the shape (), expected (1,)"),
    (lambda: arva_hil.Transmitters((1, 2), [[0, 0, 0]], [LEVEL], [1]), "positions: the shape (1, 3), expected (2, 3)"),
    (lambda: ONE.ranges([1, 2]), "point: the shape (2,), expected (3,)"),
    (lambda: arva_hil.Pose([0, 0], LEVEL), "position: the shape (2,), expected (3,)"),
    (lambda: arva_hil.Pose([0, 0, 0], [1, 0, 0, 0]), "rotation: the shape (4,), expected (3, 3)"),
    (lambda: arva_hil.LocalFrame("46 N", 7, 0), "lat_deg: '46 N', expected numbers"),
    (lambda: arva_hil.LocalFrame(46, [7, 8], 0), "lon_deg: the shape (2,), expected ()"),
    (lambda: arva_hil.LocalFrame(46, 7, 0).ned(46, None, "x"), "alt_m: 'x', expected numbers"),
    (lambda: arva_hil.LocalFrame(46, 7, 0).lla([1, 2]), "ned: the shape (2,), expected numbers of the shape (..., 3)"),
    (lambda: arva_hil.Antennas(sensitivity=1.0), "sensitivity 1.0: expected three values in (0, 1]"),
    (lambda: arva_hil.Antennas(sensitivity=["a", "b", "c"]), "sensitivity ['a', 'b', 'c']: expected three values"),
    (lambda: arva_hil.SimulatedVehicle((46.0, 7.7)), "home: the shape (2,), expected (3,)"),
    (lambda: arva_hil.SimulatedVehicle("home"), "home: 'home', expected numbers"),
    (lambda: arva_hil.SimulatedVehicle((46.0, 7.7, 0.0), wind=3.0), "wind: the shape (), expected (3,)"),
    (lambda: arva_hil.LocalFrame(46, 460, 0), "lon_deg: 460 is out of range (-180…180)"),
    (lambda: arva_hil.LocalFrame(-91, 7, 0), "lat_deg: -91 is out of range (-90…90)"),
    (lambda: arva_hil.SimulatedVehicle((46.0, 460.0, 0.0)), "lon_deg: 460 is out of range"),
    (
        lambda: arva_hil.run_live("s.yaml", autopilot="pty", port="pty"),  # type: ignore[arg-type]
        "scenario: 's.yaml', expected a Scenario: write load_scenario('s.yaml')",
    ),
    (
        lambda: arva_hil.replay("flight.tlog", "s.yaml"),  # type: ignore[arg-type]
        "scenario: 's.yaml', expected a Scenario: write load_scenario('s.yaml')",
    ),
    (lambda: arva_hil.Emulator([], start=0.0), "vehicles: none, expected one VehicleSetup at least"),
    (lambda: _emulator().receive("autopilto", b"", 0.0), "link: 'autopilto', expected one of autopilot, port"),
    (lambda: _emulator().link_lost("autopilto", "gone", 0.0), "link: 'autopilto', expected one of autopilot, port"),
    (lambda: _back_in_time(), "now: 4, expected 5 s or later: time does not go back"),
    (lambda: arva_hil.run_live(_scenario(), autopilot="pty"), "port: None, expected a port for frames of the format"),
    (
        lambda: arva_hil.run_live(_scenario(), autopilot="pty", port="out.tlog", timeout_s=0.01),
        "port: 'out.tlog' is a log: frames cannot be sent there",
    ),
    (
        lambda: arva_hil.replay("flight.tlog", _scenario(), port="out.tlog"),
        "port: 'out.tlog' is a log: frames cannot be sent there",
    ),
    (
        lambda: arva_hil.replay("flight.tlog", _scenario(), target_system=300),
        "target_system: 300 is out of range (1…255)",
    ),
    (lambda: arva_hil.replay("flight.tlog", _scenario(), max_age_s=math.nan), "max_age_s: nan is out of range (0…inf)"),
    (
        lambda: arva_hil.run_live(_scenario(), autopilot="pty", port="pty", duration_s=math.nan),
        "duration_s: nan is out of range (0…inf)",
    ),
    (
        lambda: arva_hil.run_live(_scenario(), autopilot="pty", port="pty", stream_hz=0, timeout_s=0.01),
        "stream_hz: 0 is out of range (1…200)",
    ),
    (lambda: arva_hil.run_live(_scenario(), port="pty"), "autopilot: None, expected the connection string"),
    (
        lambda: arva_hil.run_live(_scenario(), autopilot="-", port="pty", timeout_s=0.01),
        "autopilot: '-', expected the connection string of the autopilot's link",
    ),
    (
        lambda: arva_hil.run_live(_fleet(), autopilot="pty", port="pty"),
        "port: 'pty', expected None: fleet has vehicles",
    ),
    (lambda: arva_hil.run_live(_fleet()), "fleet: b: its autopilot is missing"),
    (lambda: arva_hil.run_live(_scenario(), autopilot="nonsense", port="pty"), "'nonsense' is no connection"),
]


FLEET = """
spec: 2
transmitters: [{id: 7, ned: [20, 5, 0]}]
vehicles:
  - {name: a, autopilot: %s, receivers: [{name: r, port: %s}]}
  - {name: b, receivers: [{name: r, port: pty}]}
"""


def _fleet(autopilot: str = "pty", port: str = "pty") -> arva_hil.Scenario:
    from arva_hil.config import parse

    return parse(FLEET % (autopilot, port), "fleet")


def _scenario() -> arva_hil.Scenario:
    from arva_hil.config import DEFAULT

    return DEFAULT


def _emulator() -> arva_hil.Emulator:
    return arva_hil.Emulator([arva_hil.one_vehicle(_scenario(), arva_hil.Session())], start=0.0)


def _back_in_time() -> None:
    emulator = _emulator()
    emulator.advance(5.0)
    emulator.advance(5.0)
    emulator.advance(4.0)


@every("call, said", MISTAKES)
def test_a_caller_s_mistake_is_a_value_error_that_names_the_argument(call: Callable[[], Any], said: str) -> None:
    with pytest.raises(ValueError) as error:  # noqa: PT011
        call()
    assert said in str(error.value)


def test_a_file_that_is_no_log_is_a_link_error(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text("transmitters: [{id: 1, enu: [5, 20, 0]}]")
    with pytest.raises(arva_hil.LinkError, match=r"s\.yaml: no MAVLink packet in this file; is it a telemetry log"):
        arva_hil.replay(tmp_path / "s.yaml", _scenario())


def test_a_scenario_is_loaded_from_text_and_from_a_mapping() -> None:
    wanted = arva_hil.Scenario((Transmitter(1, ned=(20.0, 5.0, 0.0)),), seed=3)
    assert arva_hil.load_scenario("transmitters: [{id: 1, enu: [5, 20, 0]}]\nseed: 3") == wanted
    place = np.array([5.0, 20.0, 0.0])
    assert arva_hil.load_scenario({"transmitters": [{"id": 1, "enu": place}], "seed": 3}) == wanted
    with pytest.raises(arva_hil.ScenarioError, match=r"^text:1:23: enu: 1 number, expected 3 \(east, north, up\)$"):
        arva_hil.load_scenario("{transmitters: [{enu: [5], id: 1}]}")
    with pytest.raises(arva_hil.ScenarioError, match="seed: '-1', expected a whole number"):
        arva_hil.load_scenario({"transmitters": [{"id": 1, "enu": [5, 20, 0]}], "seed": -1})


def test_lists_are_taken_as_arrays() -> None:
    receiver = arva_hil.PaperReceiver(arva_hil.Antennas(sensitivity=[1.0, 0.8, 0.6]))  # type: ignore[arg-type]
    receiver.look(arva_hil.Look(0.0, arva_hil.Pose([0, 0, 0], LEVEL.tolist()), ONE))  # type: ignore[arg-type]
    assert receiver.show(0.0).channels[0].true_range_m == pytest.approx(20.6155, abs=1e-3)
    assert arva_hil.SimulatedVehicle([46.0, 7.7, 1650.0], wind=[1, 2, 0]).poll(0.0)  # type: ignore[arg-type]


def test_what_a_caller_s_function_raises_ends_a_replay_and_a_live_run() -> None:
    def fail(event: arva_hil.Event) -> None:
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        arva_hil.replay(ROOT / "tests" / "data" / "px4.tlog", _scenario(), on_event=fail)
    line, port = PtyLink(), PtyLink()
    try:
        with pytest.raises(KeyError, match="mine"):
            arva_hil.run_live(_scenario(), autopilot=line.path, port=port.path, on_event=fail)
    finally:
        line.close()
        port.close()


def test_a_live_run_leaves_no_descriptor_open() -> None:
    """Without waiting for the garbage collector: a program may make many runs."""
    with closing(PtyLink()) as line, closing(PtyLink()) as port:
        gc.collect()
        gc.disable()
        try:
            before = len(os.listdir("/dev/fd"))
            for _ in range(3):
                with pytest.raises(arva_hil.LinkError, match="no byte came"):
                    arva_hil.run_live(_scenario(), autopilot=line.path, port=port.path, timeout_s=0.01)
            assert len(os.listdir("/dev/fd")) == before
        finally:
            gc.enable()


def test_a_live_run_serves_every_vehicle_of_a_scenario() -> None:
    """One says so by its own link, the other by the caller's; only when none is heard that is an error."""
    with closing(PtyLink()) as mine, closing(PtyLink()) as others, closing(PtyLink()) as port:
        fleet, made = _fleet(mine.path, port.path), set[str]()

        def note(event: arva_hil.Event) -> None:
            made.add(event.vehicle if isinstance(event, arva_hil.FrameMade) else "")

        with pytest.raises(arva_hil.LinkError, match="no byte came"):
            arva_hil.run_live(fleet, autopilot=others.path, timeout_s=2.0, on_event=note)
        assert {"a", "b"} <= made
        with closing(Autopilot(mine, speed=1.0)):
            arva_hil.run_live(fleet, autopilot=others.path, timeout_s=2.0, duration_s=2.2)


def test_a_live_run_without_a_heartbeat_is_a_link_error() -> None:
    line, port = PtyLink(), PtyLink()
    try:
        with pytest.raises(arva_hil.LinkError, match=f"{line.path}: no byte came"):
            arva_hil.run_live(_scenario(), autopilot=line.path, port=port.path, timeout_s=0.3)
    finally:
        line.close()
        port.close()


# Kinds by name: what is built in is there and has what it needs, and what has gone wrong with others is said


FIX = "fix the error and try again"
REGISTRIES = [RECEIVERS, FORMATS, STRATEGIES]


def names(of: Registry) -> str:
    return of.group


def toys(**built_in: str) -> Registry:
    return Registry("toy", "arva_hil.toys", built_in, ("play",), references=True)


@every("registry", REGISTRIES)
def test_everything_built_in_is_there_and_has_what_it_needs(registry: Registry) -> None:
    for name in registry:
        assert registry._unfit(registry[name]) == ""


def test_listing_what_there_is_imports_none_of_it() -> None:
    listing = "import sys; from arva_hil import registry; list(registry.FORMATS); 'flux' in registry.STRATEGIES; "
    heavy = "print([m for m in ('numpy', 'pymavlink', 'importlib.metadata') if m in sys.modules])"
    ran = subprocess.run(
        [sys.executable, "-c", listing + heavy], capture_output=True, text=True, check=True, timeout=60
    )
    assert ran.stdout == "[]\n"


def test_an_unknown_name_is_answered_with_the_nearest_and_all_there_are() -> None:
    with pytest.raises(KindError) as error:
        STRATEGIES["fluks"]
    assert (
        str(error.value)
        == "no strategy 'fluks': did you mean flux? there are flux, extremum, estimate, or MODULE:CLASS"
    )
    assert "fluks" not in STRATEGIES


@pytest.mark.parametrize(
    ("reference", "what"),
    [
        ("no_such_module:Toy", "there is no module no_such_module: install it, or run this where the file is"),
        ("mine:Nothing", "mine has no Nothing: write MODULE:CLASS"),
        ("mine:Tou", "did you mean Toy?"),
        ("mine:Broken", "'mine:Broken' lacks play: " + FIX),
        ("mine:Asked", "'mine:Asked' lacks play: " + FIX),
        ("raises:Toy", r"cannot be imported (RuntimeError: not today): " + FIX),
        ("needs:Toy", "cannot be imported (ModuleNotFoundError: No module named 'no_such_thing'): " + FIX),
        ("exits:Toy", "cannot be imported (SystemExit: 5)"),
        ("half written", "no toy 'half written'"),
        ("mine:", "is no name of a class: write MODULE:CLASS"),
        ("../mine:Toy", "is no name of a class"),
    ],
)
def test_a_reference_that_cannot_be_used_says_why(
    reference: str, what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(
        "from typing import Protocol\n"
        "class Toy:\n    def play(self): ...\n"
        "class Broken: ...\n"
        "class Player(Protocol):\n    def play(self): ...\n"
        "class Asked(Player): ...\n"
    )
    Path("raises.py").write_text("raise RuntimeError('not today')\n")
    Path("needs.py").write_text("import no_such_thing\n")
    Path("exits.py").write_text("raise SystemExit(5)\n")
    try:
        assert toys()["mine:Toy"].__name__ == "Toy"
        with pytest.raises(KindError) as error:
            toys()[reference]
        assert what in str(error.value)
        assert "" not in sys.path[-1:]
    finally:
        for module in ("mine", "raises", "needs", "exits"):
            sys.modules.pop(module, None)


# Text from outside that is shown: nothing of it is an order to a terminal, a second line, or a formula


@every(
    "text, shown",
    [
        ("d 1234 cm +17° … → 'ok'", "d 1234 cm +17° … → 'ok'"),
        ("\x1b]0;title\x07", r"\x1b]0;title\x07"),
        ("\x1b[2J\rgone", r"\x1b[2J\rgone"),
        ("one\ntwo\r\nthree\x0b\x0c\x85\u2028\u2029", r"one\ntwo\r\nthree\x0b\x0c\x85\u2028\u2029"),
        ("\x9b31m\x7f\0", r"\x9b31m\x7f\x00"),
        ("a\u202eb\u2066c\u200f\u200b\ufeff", r"a\u202eb\u2066c\u200f\u200b\ufeff"),
        ("name\udcff\ud800", r"name\udcff\ud800"),
        ("\U000e0001\ue000", r"\U000e0001\ue000"),
    ],
)
def test_what_is_not_printable_is_escaped(text: str, shown: str) -> None:
    assert one_line(text) == shown


@given(st.text(st.characters(exclude_categories=())))
def test_every_text_is_one_printable_line(text: str) -> None:
    shown = one_line(text)
    assert shown.isprintable()
    assert one_line(shown) == shown
    assert shown.encode().decode() == shown


@every("text", ["=1+1", "+1", "-1", "@SUM(A1)", " =1", "\t=1", "\r=1", "\n@a"])
def test_a_cell_is_no_formula(text: str) -> None:
    assert cell(text)[0] not in "=+-@"
    assert cell(text).endswith(one_line(text))
    assert "\n" not in cell(text)


def test_a_harmless_cell_stays_as_it_is() -> None:
    assert cell("configs/paper_case_1.yaml") == "configs/paper_case_1.yaml"
