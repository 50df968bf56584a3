"""What the tests of all links share: none hangs, and what was opened is closed."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator

import pytest

from arva_hil.links import Link
from tests.links.links_waiting import DEADLINE_S


@pytest.fixture(autouse=True)
def no_test_hangs() -> Iterator[None]:
    """A link that blocks after all fails its test instead of stopping them all."""

    def alarm(number: int, frame: object) -> None:
        pytest.fail("the test hangs")

    before = signal.signal(signal.SIGALRM, alarm)
    signal.setitimer(signal.ITIMER_REAL, 2 * DEADLINE_S)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)


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
