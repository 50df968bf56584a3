"""`--foxglove` of a whole program: what a client is told is what the record says."""

from __future__ import annotations

import importlib.util
import math
from argparse import Namespace
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from arva_hil.cli.watchers import live_observers
from arva_hil.config import load
from arva_hil.links.pty import PtyLink
from arva_hil.observers.web.address import HostPort
from tests.files import rows as table

from .far_ends import Autopilot, Beacon, Program, Start, until

pytestmark = pytest.mark.skipif(importlib.util.find_spec("foxglove") is None, reason="foxglove-sdk is not installed")

if importlib.util.find_spec("foxglove"):
    from tests.foxglove_client import FoxgloveClient


ROOT = Path(__file__).parents[2]


def client(program: Program) -> FoxgloveClient:
    return FoxgloveClient(int(program.says(r"messages for Foxglove: ws://127\.0\.0\.1:(\d+)")[1]))


def readings(folder: Path) -> dict[int, list[dict[str, str]]]:
    """The rows of each frame, by its instant in milliseconds since 1970."""
    rows: dict[str, list[dict[str, str]]] = {}
    for row in table(folder / "readings.csv"):
        rows.setdefault(row["time_s"], []).append(row)
    frames = table(folder / "frames.csv")
    return {round(datetime.fromisoformat(f["utc"]).timestamp() * 1e3): rows[f["time_s"]] for f in frames}


def agree(told: Any, rows: list[dict[str, str]]) -> None:
    """A message and the rows of readings.csv say the same."""
    for slot, row in zip(told.message["arva_signals"], rows, strict=True):
        assert slot["id"] == int(row["id"] or -1)
        assert (slot["distance"], slot["delta"], slot["zone"]) == (
            float(row["d_cm"]),
            int(row["delta_deg"]),
            int(row["zone"]),
        )


def all_agree(watcher: FoxgloveClient, folder: Path) -> int:
    """From the first reading told on every one is told once, with its values and pose. How many have a pose."""
    recorded = readings(folder)
    told = watcher.of("/arva")
    first = min(recorded, key=lambda ms: abs(ms - told[0].stamp_ns / 1e6))
    expected = [ms for ms in recorded if ms >= first]
    assert [round(one.stamp_ns / 1e6) for one in told] == pytest.approx(expected[: len(told)], abs=1)
    assert len(expected) - len(told) <= 1  # the last one, if the program was ended while it was sent
    rows = [recorded[ms] for ms in expected]
    for one, of_frame in zip(told, rows, strict=False):
        agree(one, of_frame)
    poses = [(float(r["east_m"]), float(r["north_m"]), -float(r["down_m"])) for r, *_ in rows if r["north_m"]]
    positions = [one.message["pose"]["position"] for one in watcher.of("/arva/pose")]
    assert [(p["x"], p["y"], p["z"]) for p in positions] == poses[: len(positions)]
    return len(positions)


def test_a_run_tells_every_reading_and_ends_though_a_client_listens(
    start: Start, autopilot: Autopilot, line: PtyLink, tmp_path: Path
) -> None:
    program = start(
        *("run", "--autopilot", autopilot.address, "--port", line.path, "--rate", 10, "--foxglove", 0),
        *("--record", tmp_path / "run"),
    )
    watcher = client(program)
    until(lambda: len(watcher.of("/arva/pose")) >= 10)
    until(lambda: watcher.of("/diagnostics"))
    program.stops()
    watcher.until_closed()
    assert all_agree(watcher, tmp_path / "run") >= 10


def test_a_replay_tells_the_readings_of_the_log(start: Start, tmp_path: Path) -> None:
    log = ROOT / "tests" / "data" / "arducopter.tlog"
    program = start("replay", log, "--speed", 20, "--rate", 5, "--foxglove", 0, "--record", tmp_path / "run")
    watcher = client(program)
    program.ends()
    watcher.until_closed()
    assert all_agree(watcher, tmp_path / "run") >= 10


def test_a_demo_tells_what_the_receiver_says_and_what_the_search_believes(start: Start, tmp_path: Path) -> None:
    program = start(
        *("demo", "--headless", "--rate", 10, "--foxglove", 0, "--record", tmp_path / "run"),
    )
    watcher = client(program)
    until(lambda: {"hypotheses", "95 %", "goal"} <= drawn(watcher))
    program.stops()
    watcher.until_closed()
    assert all_agree(watcher, tmp_path / "run") >= 10


def drawn(watcher: FoxgloveClient) -> set[str]:
    return {shape["ns"] for told in watcher.of("/search/visualization") for shape in told.message["markers"]}


def test_a_search_tells_what_it_reads(start: Start, autopilot: Autopilot, keep: Callable[[Any], Any]) -> None:
    beacon = keep(Beacon())
    program = start(
        *("search", "--autopilot", autopilot.address, "--receiver", beacon.link.path, "--dry-run", "--yes"),
        *("--foxglove", 0, "--countdown", 0),
    )
    watcher = client(program)
    until(lambda: len(watcher.of("/search/arva")) >= 5 or program.process.poll() is not None)
    program.send(2)
    program.ends(0, 130)
    watcher.until_closed()
    slots = watcher.of("/search/arva")[-1].message["arva_signals"]
    assert [(slot["id"], slot["distance"], slot["delta"], slot["zone"]) for slot in slots] == [
        (4, 2000.0, 10, 1),
        (9, 4500.0, -40, 1),
    ]
    assert (slots[0]["direction"]["x"], slots[0]["direction"]["y"]) == pytest.approx(
        (math.cos(math.radians(10)), -math.sin(math.radians(10)))
    )


def test_an_address_that_is_none_ends_with_2(arva: Callable[..., Any], flight: Path) -> None:
    assert "expected HOST:PORT, HOST or PORT, e.g. 127.0.0.1:8765" in arva.refused(
        "replay", flight, "--foxglove", "a:b"
    )


@pytest.mark.parametrize(("name", "told"), [("four_close", True), ("eight_drones", False)])
def test_a_team_has_no_topics_of_a_search_whose_take_off_point_would_be_another_drones(
    name: str, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Any] = []

    def server(messages: Any, wanted: HostPort) -> Any:
        made.append(messages)
        return SimpleNamespace(url="", port=wanted.port)

    monkeypatch.setattr("arva_hil.observers.foxglove.FoxgloveServer", server)
    options = Namespace(foxglove=HostPort(), ros2=False, strategy="flux")
    live_observers(options, load(ROOT / "configs" / f"{name}.yaml"), 0)
    assert ("/search/found" in made[0].topics) == told
