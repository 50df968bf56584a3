"""The slots of a receiver that follows several transmitters: their order, and the host's marks and selection."""

from __future__ import annotations

import math

from arva_hil.model.receiver.listening import Listening
from arva_hil.model.receiver.reading import ChannelReading, PulseReading, Zone
from arva_hil.model.receiver.track import Mark, PulseTrack


class Slots:
    """Remembers a track of each transmitter received, lost marks, the selected transmitter, and the number of slots.

    `no_signal`: (d, δ) of an empty slot. `mark_within_m`: the largest distance for marking. `measures`: slots have the
    newest pulse.
    """

    def __init__(
        self, listening: Listening, channels: int, no_signal: tuple[int, int], mark_within_m: float, measures: bool
    ) -> None:
        self._listening = listening
        self._channels = self._usual_channels = channels
        self._no_signal = no_signal
        self._empty = ChannelReading(None, Zone.OUTER, *no_signal, None)
        self._mark_within_m = mark_within_m
        self._measures = measures
        self.restart()

    def restart(self) -> None:
        """Return to the state after switching on."""
        self._channels = self._usual_channels
        self.forget()

    def forget(self) -> None:
        """Forget all transmitters, marks and the selection."""
        self._selected: int | None = None
        self._lost: list[Mark] = []  # marks
        self._tracks: dict[int, PulseTrack] = {}  # by the transmitter's index

    def scan(self) -> None:
        """Search for all transmitters again. Those that come back keep their marks."""
        for track in self._tracks.values():
            track.lose_mark()
        self._tracks = {}

    def track(self, index: int, make: bool = False) -> PulseTrack | None:
        """Return the track of a transmitter. `make`: make a new one if necessary."""
        if make and index not in self._tracks:
            self._tracks[index] = PulseTrack(self._lost)
        return self._tracks.get(index)

    @property
    def overlapping(self) -> bool:
        """True if the newest pulse of any transmitter was disturbed by another one."""
        return any(track.touched for track in self._tracks.values())

    def shown(self, time_s: float) -> tuple[list[ChannelReading], bool, float]:
        """Return all slots, True if there are more transmitters than slots, and the end of its validity."""
        until_s, ids = math.inf, self._listening.ids
        rows: list[tuple[bool, bool, int, int, ChannelReading]] = []
        for index, track in self._tracks.items():
            track.pass_time(time_s)
            if track.shown is None:
                continue
            blank = time_s >= track.blank_s
            until_s = min(until_s, track.drops_s if blank else track.blank_s)
            slot = self._slot(ids[index], track, blank)
            rows.append((blank, track.marked, slot.d_cm, ids[index], slot))
        rows.sort(key=lambda row: row[:4])
        slots = [row[4] for row in rows]
        slots = [slot for slot in slots if slot.id == self._selected and slot.zone] or slots
        free = self._channels - len(slots)
        return slots[: self._channels] + [self._empty] * free, free < 0, until_s

    def mark(self, time_s: float, id_: int) -> bool:
        """Mark a transmitter as found. Returns False if it is too far away, not received, or overlapped."""
        track = self._heard(time_s, id_)
        if track is None or track.touched or not self._near(track):
            return False
        track.marked = True
        self._selected = None if self._selected == id_ else self._selected
        return True

    def unmark(self, time_s: float, id_: int | None) -> bool:
        """Remove the mark of a transmitter; None: all marks."""
        if id_ is None:
            for every in self._tracks.values():
                every.marked = False
            self._lost.clear()
            return True
        track = self._heard(time_s, id_)
        if track is None or not track.marked or not self._near(track):
            return False
        track.marked = False
        return True

    def select(self, time_s: float, id_: int | None) -> bool:
        """Report only this transmitter while it is received; None: all."""
        if id_ is not None and self._heard(time_s, id_) is None:
            return False
        self._selected = id_
        return True

    def set_channels(self, count: int) -> bool:
        """Set the number of slots, 1…16."""
        if not 1 <= count <= 16:
            return False
        self._channels = count
        return True

    def _slot(self, id_: int, track: PulseTrack, blank: bool) -> ChannelReading:
        shown = track.shown
        if blank or shown is None:
            return ChannelReading(id_, Zone.OUTER, *self._no_signal, None, track.marked)
        pulse = None
        if self._measures:
            pulse = PulseReading(track.heard_s, shown.signal_na_m, track.period_s, track.carrier_hz)
        return ChannelReading(id_, shown.zone, shown.d_cm, shown.delta_deg, None, track.marked, pulse)

    def _heard(self, time_s: float, id_: int) -> PulseTrack | None:
        """Return the track of a transmitter if it has a reading now."""
        ids = self._listening.ids
        track = self._tracks.get(ids.index(id_)) if id_ in ids else None
        return track if track is not None and track.shown is not None and time_s < track.blank_s else None

    def _near(self, track: PulseTrack) -> bool:
        return track.shown is not None and track.shown.d_cm <= 100 * self._mark_within_m
