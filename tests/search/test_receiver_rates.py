"""A slow and a fast receiver: a search finds with either, and hovers only where frames are too far apart."""

from __future__ import annotations

import pytest

from arva_hil.clock import StepClock
from arva_hil.config import parse
from arva_hil.events import Event
from arva_hil.events.searches import FromSearch, SearchPaused
from arva_hil.events.words.reasons import in_words
from arva_hil.links import Link, memory
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated.closed_loop import ClosedLoop, in_memory
from firmware_proto import Decoder, encode


class Paused:
    """An observer that counts how often the search hovered without frames."""

    def __init__(self) -> None:
        self.count = 0

    def observe(self, event: Event) -> None:
        self.count += isinstance(event, FromSearch) and isinstance(event.event, SearchPaused)


def doubled(link: Link) -> Link:
    """Send each frame twice, with sequence numbers of a receiver that is twice as fast."""
    decoder, write = Decoder(), link.write

    def twice(data: bytes) -> bool:
        for frame in decoder.feed(data, 0.0):
            number = 2 * frame.sequence
            for one in (number, number + 1):
                write(encode(frame._replace(sequence=one % 256)))
        return True

    link.write = twice  # type: ignore[method-assign]
    return link


@pytest.mark.parametrize(("rate_hz", "pauses"), [(0.2, True), (100.0, False)])
def test_a_transmitter_is_found_with_a_receiver_of_any_rate(rate_hz: float, pauses: bool) -> None:
    scenario = parse(
        f"spec: 1\ntransmitters: [{{id: 1, enu: [6, 8, -1]}}]\nreceiver: {{rate_hz: {min(rate_hz, 50.0)}}}", "field"
    )
    taken, given = memory.pair()
    wires = in_memory()._replace(port=(taken, doubled(given) if rate_hz > 50.0 else given))
    plan, paused, clock = SearchPlan(STRATEGIES["estimate"], area=(-30.0, -30.0, 30.0, 30.0)), Paused(), StepClock()
    loop = ClosedLoop(scenario, plan, start=0.0, wires=[wires], stream_hz=10.0, observers=[paused])
    run(loop.tasks, clock, until=400.0, stopped=lambda: loop.drones[0].search.outcome is not None)
    outcome, error_m = loop.drones[0].search.outcome, loop.drones[0].error()
    assert outcome is not None
    assert (outcome.kind, in_words(outcome.how)) == ("found", "found")
    assert error_m is not None
    assert error_m < 0.5
    assert (paused.count > 0) == pauses
    assert outcome.frames >= 0.8 * rate_hz * outcome.time_s
