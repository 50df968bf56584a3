"""What the search found against the truth."""

from __future__ import annotations

import math

from arva_hil.recordings import Recording


def error_m(recording: Recording) -> float | None:
    """How far the place found is from the transmitter that was searched for, horizontally; None if that is not known.

    Without an id in the frames: from the nearest transmitter.
    """
    search = recording.search
    if search is None or search.found is None or not recording.receivers:
        return None
    vehicle = recording.receivers[0].vehicle
    place = recording.of_search([search.found.north, search.found.east, search.found.down or 0.0], vehicle)
    end_s = recording.span_s[1]
    moving = recording.transmitters(vehicle, end_s)
    if place is None or moving is None:
        return None
    there = moving.at(end_s, lambda system: None)
    away = {
        id_: math.dist(place[:2].tolist(), position[:2])
        for id_, position in zip(there.ids, there.positions.tolist(), strict=True)
        if id_ not in there.unplaced
    }
    return away[search.target] if search.target in away else min(away.values(), default=None)
