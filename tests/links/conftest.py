"""What the tests of all links share: a deadline, and closing what was opened."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from arva_hil.clock import RealClock
from arva_hil.links import Link

DEADLINE_S = 10.0


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


@pytest.fixture
def keep() -> Iterator[Callable[[Link], Link]]:
    """`keep(link)` gives the link back and closes it after the test."""
    links: list[Link] = []

    def remember(link: Link) -> Link:
        links.append(link)
        return link

    yield remember
    for link in links:
        link.close()
