"""Events are frozen dataclasses, though only their root has the decorator."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, asdict, replace

import pytest

from arva_hil.events import LinkBack, LinkEvent, LinkLost


def test_an_event_is_a_frozen_dataclass_with_the_fields_of_its_bases_first() -> None:
    lost, back = LinkLost(1.0, "autopilot", "pty", "gone"), LinkBack(1.0, "autopilot", "pty", 2.0)
    assert asdict(lost) == {"time_s": 1.0, "link": "autopilot", "address": "pty", "reason": "gone"}
    assert len({lost, back, replace(lost)}) == 2
    assert isinstance(lost, LinkEvent)
    with pytest.raises(FrozenInstanceError):
        lost.reason = "another"  # type: ignore[misc]
