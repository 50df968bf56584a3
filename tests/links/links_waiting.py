"""Waiting for links, always with a deadline."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from arva_hil.clock import RealClock
from arva_hil.links import Link

Keep = Callable[[Any], Any]  # the fixture
DEADLINE_S = 60.0  # none is reached but by a mistake, however slow the machine


def receive(link: Link, size: int, writer: Link | None = None) -> bytes:
    """Read until `size` bytes are there or the deadline is; reading the writer sends what it kept."""
    clock = RealClock()
    data = b""
    while len(data) < size and clock.now() < DEADLINE_S:
        if writer is not None:
            writer.read()
        clock.wait(clock.now() + 0.05, [link])
        data += link.read()
    return data


def until(condition: Callable[[], object], link: Link) -> None:
    """Wait on a link, with a deadline, until a condition holds."""
    clock = RealClock()
    while not condition():
        assert clock.now() < DEADLINE_S, "the deadline passed"
        clock.wait(clock.now() + 0.01, [link])
