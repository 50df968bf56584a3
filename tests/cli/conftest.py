"""What the command line's tests share: the program in this process or as its own, and what is closed afterwards."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Final

import pytest

from arva_hil.links.pty import PtyLink
from arva_hil.mavlink.codec import Parser, dialect
from tests.undrawn import undrawn

from .far_ends import Arva, Autopilot, Beacon, Keep, Program, Start

TRUTHS = (dialect.MAVLINK_MSG_ID_SIMSTATE, dialect.MAVLINK_MSG_ID_SIM_STATE)


@pytest.fixture(autouse=True)
def _plain_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No option comes from the environment of whoever runs the tests, and no time stamp of an earlier test's key."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / ".state"))
    for name in os.environ:
        if name.startswith("ARVA_HIL_") or name in ("NO_COLOR", "COLUMNS"):
            monkeypatch.delenv(name)


@pytest.fixture(autouse=True)
def _numbers_are_not_given_away(monkeypatch: pytest.MonkeyPatch) -> None:
    """No test closes a pseudo-terminal without a symlink while a program runs. The program would look for it by its
    number, which the system gives to another test's terminal, of a process with the same command; and would open that.
    """
    close = PtyLink.close

    def checked(link: PtyLink) -> None:
        looked_for = link._open and not link.symlink and bool(Program.running())
        close(link)
        assert not looked_for, f"a program may look for {link.path}: give it a symlink, PtyLink(str(tmp_path / 'line'))"

    monkeypatch.setattr(PtyLink, "close", checked)


_KEPT: Final = pytest.StashKey[list[Any]]()


@pytest.fixture
def keep(request: pytest.FixtureRequest) -> Iterator[Keep]:
    """`keep(thing)` gives the thing back and closes it after the test: programs first, then the last one first."""
    kept = request.node.stash.setdefault(_KEPT, [])

    def remember(thing: Any) -> Any:
        kept.append(thing)
        return thing

    yield remember
    programs = [thing for thing in kept if isinstance(thing, Program)]
    for thing in (*reversed(programs), *reversed([thing for thing in kept if thing not in programs])):
        thing.close()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """The report of a test that fails has the story of each program that it started, and of each autopilot."""
    report = yield
    if report.failed:
        told = [thing for thing in item.stash.get(_KEPT, []) if isinstance(thing, Program | Autopilot)]
        report.sections += [(f"{type(thing).__name__} {n}", thing.story()) for n, thing in enumerate(told, 1)]
    return report


@pytest.fixture
def arva(request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]) -> Arva:
    """The program, in this process."""
    return Arva(capsys, undrawn if request.node.get_closest_marker("undrawn") else nullcontext)


@pytest.fixture
def start(keep: Callable[..., Any]) -> Start:
    """The program, as a process that is gone after the test."""
    return lambda *arguments, **options: keep(Program(*arguments, **options))


@pytest.fixture
def autopilot(keep: Callable[..., Any]) -> Autopilot:
    """The built-in vehicle behind a pseudo-terminal."""
    return keep(Autopilot(keep(PtyLink())))


@pytest.fixture
def line(keep: Callable[..., Any]) -> PtyLink:
    """A pseudo-terminal to send frames to; this is the consumer's end."""
    return keep(PtyLink())


@pytest.fixture
def beacon(keep: Keep) -> Beacon:
    return keep(Beacon())


@pytest.fixture
def real(autopilot: Autopilot) -> Autopilot:
    """A vehicle that does not know its own truth, as real ones do not."""
    write, parser = autopilot.link.write, Parser()

    def truthless(data: bytes) -> bool:
        return write(b"".join(packet.raw for packet in parser.feed(data) if packet.msgid not in TRUTHS))

    autopilot.link.write = truthless  # type: ignore[method-assign]
    return autopilot
