"""The tutorial, typed line by line, and the examples of the pages that no lesson runs."""

from __future__ import annotations

import json
import math
import os
import re
import runpy
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from arva_hil.config import parse
from arva_hil.events import LinkLost, PoseLost
from arva_hil.events.event_json import event_json
from arva_hil.events.reasons import NoPose
from arva_hil.events.vehicles import VehicleFound
from arva_hil.links.pty import PtyLink
from firmware_proto import INNER, MID, OUTER, Channel, Frame, encode
from tests.cli.far_ends import UNDER_TEST
from tests.cli.forked import Forked, possible

from .pages import FENCE, ROOT, Typed, console, pattern

LESSONS = ["first-victim", "own-client", "own-search", "driver-in-ci"]
DEADLINE_S = 180.0  # of a command, on a machine that others use too


class Terminal:
    """Types commands in a folder, one after the other; the last one may still run."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self._folder = folder
        self._environment = environment
        self._running: subprocess.Popen[bytes] | Forked | None = None
        self._said = tempfile.TemporaryFile("a+b")  # noqa: SIM115 (closed in `close`); its writer appends, whoever reads

    def type(self, typed: Typed, *, stays: bool) -> None:
        """Type a command, and wait for its end, or until it has answered when it stays; compare what it said."""
        self._said.seek(0)
        self._said.truncate()
        self._running = self._begin(typed.command)
        wanted = pattern(typed.answer)
        end = time.monotonic() + DEADLINE_S
        while time.monotonic() < end:
            ended = self._running.poll() is not None
            said = self.said()
            if stays and not ended and said.endswith("\n") and wanted.match(said):
                return
            if ended:
                assert not stays, f"{typed.place}: it has ended:\n{said}"
                break
            try:
                self._running.wait(0.1)
            except subprocess.TimeoutExpired:
                continue
        assert not stays, f"{typed.place}: {typed.command}: expected\n{typed.answer}\nit said\n{self.said()}"
        assert self._running.wait(0) == 0, f"{typed.place}: {self.said()}"
        assert wanted.fullmatch(self.said()), f"{typed.place}: expected\n{typed.answer}\nit said\n{self.said()}"

    def _begin(self, command: str) -> subprocess.Popen[bytes] | Forked:
        """A command of the program alone is forked, for that is the same; the rest is for a shell."""
        streams: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": self._said, "stderr": subprocess.STDOUT}
        where: dict[str, Any] = {"cwd": self._folder, "env": self._environment}
        alone = re.fullmatch(r"(PYTHONPATH=(\S+) )?arva-hil( [a-z-]+[^&;|]*)", command)
        if alone and not UNDER_TEST and possible(where):
            where["env"] = self._environment | {"PYTHONPATH": alone[2] or ""}
            return Forked(shlex.split(alone[3]), **streams | {"stderr": self._said}, **where)
        return subprocess.Popen(["bash", "-c", command], start_new_session=True, **streams, **where)

    def said(self) -> str:
        self._said.seek(0)
        return self._said.read().decode()

    def interrupt(self) -> None:
        """Type Ctrl-C."""
        self._send(signal.SIGINT)
        self._running.wait(DEADLINE_S)
        assert "Traceback" not in self.said(), self.said()

    def _send(self, number: signal.Signals) -> None:
        if isinstance(self._running, Forked):
            self._running.send_signal(number)
        else:
            os.killpg(self._running.pid, number)

    def close(self) -> None:
        if self._running is not None and self._running.poll() is None:
            self._send(signal.SIGKILL)
            self._running.wait()
        self._said.close()


@pytest.fixture
def terminals(tmp_path: Path) -> Iterator[dict[str, Terminal]]:
    """Terminals, opened when they are first typed in, in a folder like this project's, of a user with an empty home."""
    import matplotlib

    folder, home = tmp_path / "arva-hil", tmp_path / "home"
    folder.mkdir()
    home.mkdir()
    for name in ("configs", "docs", "firmware_proto", "tests"):
        (folder / name).symlink_to(ROOT / name)
    programs = f"{Path(UNDER_TEST or sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {"HOME": str(home), "PATH": programs, "TMPDIR": str(tmp_path), "LANG": "C.UTF-8"}
    environment |= {"ARVA_HIL_JOBS": "1", "MPLCONFIGDIR": matplotlib.get_cachedir()}  # with the fonts, found once
    opened: dict[str, Terminal] = defaultdict(lambda: Terminal(folder, environment))
    yield opened
    for terminal in opened.values():
        terminal.close()


@pytest.mark.parametrize("lesson", LESSONS)
def test_a_lesson_answers_what_its_page_says(lesson: str, terminals: dict[str, Terminal], tmp_path: Path) -> None:
    lines = console(ROOT / f"docs/tutorial/{lesson}.md")
    assert lines
    for i, typed in enumerate(lines):
        if typed.command == "^C":
            terminals[typed.terminal].interrupt()
            continue
        after = next((later.command for later in lines[i + 1 :] if later.terminal == typed.terminal), "")
        here = typed._replace(command=typed.command.replace("/tmp/", f"{tmp_path}/"))
        terminals[typed.terminal].type(here, stays=after == "^C")


# -- the examples of the pages that no lesson of the tutorial runs ---------------------------------------------


class Node:
    """A stand-in for rclpy's node: remembers what was published, and the timer's call."""

    published: dict[str, list[float]]

    def __init__(self, name: str) -> None:
        self.published = {}

    def create_publisher(self, kind: object, topic: str, depth: int) -> Any:
        said = self.published.setdefault(topic, [])
        return type("Publisher", (), {"publish": lambda _, message: said.append(message.data)})()

    def create_timer(self, period_s: float, call: object) -> None:
        self.call = call


class Float32:
    def __init__(self, data: float) -> None:
        self.data = data


def test_the_ros_node_publishes_what_is_heard_and_no_direction_in_the_inner_zone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name, contents in {
        "rclpy": {},
        "rclpy.node": {"Node": Node},
        "std_msgs": {},
        "std_msgs.msg": {"Float32": Float32},
    }.items():
        module = ModuleType(name)
        module.__dict__.update(contents)
        monkeypatch.setitem(sys.modules, name, module)
    with closing(PtyLink()) as line:
        node = runpy.run_path(str(ROOT / "docs/examples/ros_node.py"))["Receiver"](line.path)
        for sequence, channel in enumerate([Channel(1, MID, 1234, -30), Channel(1, INNER, 85, 0), Channel()]):
            line.write(encode(Frame(sequence, 1, (channel,))))
        while len(node.published["~/distance"]) < 2:
            node.read()
        node.read()
    assert node.published == {"~/distance": [12.34, 0.85], "~/direction": [math.radians(-30)]}


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        (
            Frame(0, 1, (Channel(7, MID, 1234, -30),)),
            "transmitter 7: d 12.34 m: turn 30 degrees left, or in the opposite direction",
        ),
        (Frame(0, 1, (Channel(7, INNER, 85, 0),)), "transmitter 7: d 0.85 m: go slowly, find the smallest d"),
        (Frame(0, 1, (Channel(None, OUTER, -1, -1),)), "no signal"),
        (Frame(0, 3, (Channel(7, MID, 1234, 17),)), "transmitter 7: d 12.34 m: disturbed, wait for the next reading"),
        (Frame(0, 9, (Channel(7, MID, 1234, 17),)), "the receiver is broken: do not search with it"),
    ],
)
def test_the_client_says_what_the_protocol_says(frame: Frame, said: str) -> None:
    assert runpy.run_path(str(ROOT / "docs/examples/client.py"))["advice"](frame) == said


def blocks(kind: str) -> list[Any]:
    """The code of one kind in the pages, each with its place."""
    found = []
    for page in sorted((ROOT / "docs").rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        for block in FENCE.finditer(text):
            if block["kind"] == kind:
                place = f"{page.relative_to(ROOT)}:{text.count(chr(10), 0, block.start()) + 2}"
                found.append(pytest.param(block["text"], id=place))
    return found


@pytest.mark.parametrize("text", blocks("yaml"))
def test_what_a_page_shows_of_a_scenario_is_one(text: str) -> None:
    """Where a page shows a part alone, the transmitters are added that every scenario has."""
    whole = text if "transmitters:" in text else f"transmitters: [{{id: 1, enu: [20, 5, 0]}}]\n{text}"
    assert parse(whole, "page").transmitters


def test_the_events_that_a_page_shows_are_what_the_program_writes() -> None:
    happened = [
        VehicleFound(0.21, "vehicle", "px4 quadrotor 1/1", 2, False),
        PoseLost(31.4, "vehicle", "receiver", 2.02, NoPose("streams stopped")),
        LinkLost(40.0, "port", "/dev/ttyUSB0", "/dev/ttyUSB0: lost: …"),
    ]
    (shown,) = (block.values[0] for block in blocks("json"))
    assert [json.loads(line) for line in str(shown).splitlines()] == [
        json.loads(event_json(event) or "") for event in happened
    ]
