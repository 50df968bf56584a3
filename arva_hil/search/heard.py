"""The transmitters that a search has heard."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from arva_hil.search.agreement import Evidence
from arva_hil.search.strategy import Observation
from firmware_proto import MORE_TRANSMITTERS, OVERLAP, Channel, Frame

NO_ID: Final = -1  # in place of an id, if the frames have none
_REMEMBERED: Final = 256  # observations of each transmitter


@dataclass
class HeardTransmitter:
    """What is known of one transmitter."""

    nearest_m: float = math.inf
    nearest_at: tuple[float, float] = (0.0, 0.0)  # north, east of the receiver
    last_m: float = math.inf
    last_s: float = -math.inf
    past: deque[Observation] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))
    evidence: Evidence = field(default_factory=Evidence)

    def add(self, observation: Observation) -> None:
        """Use a new reading of it."""
        self.last_m, self.last_s = observation.d_m, observation.time_s
        if self.last_m < self.nearest_m:
            self.nearest_m, self.nearest_at = self.last_m, observation.position[:2]
        self.past.append(observation)
        self.evidence.add(observation)


def id_of(id_: int | None) -> int | None:
    """As a frame has it."""
    return None if id_ == NO_ID else id_


def nearest(frame: Frame) -> dict[int, Channel]:
    """The channels with a signal, one for each id (or none): the nearest if there are several."""
    best: dict[int, Channel] = {}
    for channel in sorted(frame.channels, key=lambda channel: channel.d):
        if channel.valid:
            best.setdefault(NO_ID if channel.id is None else channel.id, channel)
    return best


def hidden(frame: Frame, id_: int | None) -> bool:
    """Whether a transmitter may be heard though the frame has no reading of it: others are in its way."""
    more = frame.status & (OVERLAP | MORE_TRANSMITTERS) or all(channel.valid for channel in frame.channels)
    return bool(more) or any(channel.id == id_ for channel in frame.channels)
