"""What the command line's tests share: the program in this process or as its own, and what is closed afterwards."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

import pytest

from arva_hil.cli.main import main
from arva_hil.links.pty import PtyLink

from .far_ends import Autopilot, Program


class Ended(NamedTuple):
    code: int
    out: str
    err: str


class Closes(Protocol):
    def close(self) -> None: ...


_C = TypeVar("_C", bound=Closes)


@pytest.fixture(autouse=True)
def _plain_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No option comes from the environment of whoever runs the tests, and no time stamp of an earlier test's key."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / ".state"))
    for name in os.environ:
        if name.startswith("ARVA_HIL_") or name in ("NO_COLOR", "COLUMNS"):
            monkeypatch.delenv(name)


@pytest.fixture
def keep() -> Iterator[Callable[[_C], _C]]:
    """`keep(thing)` gives the thing back and closes it after the test, the last one first."""
    kept: list[Closes] = []

    def remember(thing: _C) -> _C:
        kept.append(thing)
        return thing

    yield remember
    for thing in reversed(kept):
        thing.close()


@pytest.fixture
def arva(capsys: pytest.CaptureFixture[str]) -> Callable[..., Ended]:
    """The program, in this process."""

    def call(*arguments: object) -> Ended:
        capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        return Ended(code, *capsys.readouterr())

    return call


@pytest.fixture
def start(keep: Callable[..., Any]) -> Callable[..., Program]:
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
