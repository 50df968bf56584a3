"""A receiver that listens to pulses: one look a pulse, a rhythm for each transmitter, slots, marks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from random import Random
from typing import Final, Self

from arva_hil.field.dipole import Transmitters
from arva_hil.field.keying import KEYING_CLASSES, draw_keying
from arva_hil.field.pulse_timeline import PulseTimeline, SentPulse
from arva_hil.receiver.antennas import Display, NoiseDraws
from arva_hil.receiver.paper import noise_bound
from arva_hil.receiver.pulsed_options import PulsedOptions
from arva_hil.receiver.reading import ChannelReading, PulseReading, Reading, Zone, with_true_ranges
from arva_hil.receiver.receiver_model import Answer, Look, ReceiverSettings
from arva_hil.receiver.separation import Vector, separate
from arva_hil.receiver.track import Marks, Reach, Track

__all__ = ["PulsedReceiver"]

_IDLE_S: Final = 1.0  # a look is never longer than this after the one before
_FLOOR_RANGE_M: Final = 80.0  # the noise that a receiver is made for is the reference transmitter's field from there
_MOVED_M: Final = 1.0  # less is no motion
_REACH: Final = Reach()


class PulsedReceiver:
    """A `ReceiverModel` that looks at the end of each pulse. It follows the rhythm of every transmitter it hears.

    Remembers the transmitters' pulses to come, a track of each transmitter, lost marks, and its noise. Commands:
    `restart`; `mark` and `unmark` with a transmitter's id; `search` after it went back to sending.
    """

    Options = PulsedOptions

    def __init__(self, settings: ReceiverSettings, options: PulsedOptions, seed: int) -> None:
        self._options = options
        self._display = Display(options, settings.kappa_eq)
        self._empty = ChannelReading(None, Zone.OUTER, *settings.no_signal, None)
        self._channels = settings.channels
        off = settings.noise.kind == "off"
        sigma = 0.0 if off else options.sigma_na_m(settings.noise.floor_range_m) / options.scale_na_m
        limit = noise_bound((1.0,), _FLOOR_RANGE_M)
        self._noise_limit, self._noisy = limit, 3 * sigma > limit * (1 + 1e-9)
        self._noise = NoiseDraws(sigma, seed)
        self._random = Random(seed)
        self._seed = seed
        self._transmitters: Transmitters | None = None
        self._timeline = PulseTimeline((), 0.0)
        self._leaks = False
        self._interference = self._noisy
        self._listens_s = options.start_s
        self._moved: tuple[float, Vector] | None = None  # when and where it was when it moved last
        self._reverted = False
        self._look: Look | None = None
        self._shown: tuple[float, Reading] | None = None  # until when it holds
        self._forget()

    @classmethod
    def from_settings(cls, settings: ReceiverSettings, seed: int) -> Self:
        """See `ReceiverModel`."""
        return cls(settings, settings.options, seed)

    def next_look(self, after_s: float, frame_s: float) -> float:
        """See `ReceiverModel`: when a pulse ends."""
        if self._transmitters is None:
            return max(0.0, math.nextafter(after_s, math.inf))
        return self._timeline.next_end(after_s, after_s + _IDLE_S)

    def look(self, look: Look) -> bool:
        """See `ReceiverModel`. It asks for a frame when a slot has changed and `frames: pulses` is set."""
        if self._transmitters is None or look.transmitters.keyings != self._transmitters.keyings:
            self._adopt(look)
        self._look, self._transmitters = look, look.transmitters
        self._shown = None
        self._note_motion(look)
        pulses = list(self._timeline.take(look.time_s))
        if not pulses:
            return False
        signals = self._signals(look)
        news = [self._hear(pulse, signals) for pulse in pulses]
        return any(news) and self._options.frames == "pulses"

    def show(self, time_s: float) -> Reading:
        """See `ReceiverModel`."""
        if self._shown is None or time_s >= self._shown[0]:
            self._shown = self._reading(time_s)
        return self._shown[1]

    def command(self, time_s: float, name: str, values: Sequence[float]) -> Answer:
        """See `ReceiverModel`."""
        self._shown = None
        match name, [int(value) for value in values]:
            case "restart", []:
                self._forget()
                self._listens_s = time_s + self._options.start_s
                self._moved, self._reverted = None, False
                return Answer.DONE
            case "search", []:
                self._moved, self._reverted = None, False
                return Answer.DONE
            case (("mark" | "unmark"), [id_]):
                return self._mark(id_, time_s, name == "mark")
            case (("mark" | "unmark" | "restart" | "search"), _):
                return Answer.REFUSED
        return Answer.UNKNOWN

    def _forget(self) -> None:
        self._marks = Marks()
        self._tracks: dict[int, Track] = {}  # by the transmitter's index

    def _adopt(self, look: Look) -> None:
        """Other transmitters than before, or the first ones."""
        there = look.transmitters
        kind = KEYING_CLASSES["modern"]
        self._keyings = there.keyings or tuple(draw_keying(kind, 0, id_) for id_ in there.ids)
        self._timeline = PulseTimeline(self._keyings, look.time_s)
        self._forget()

    def _signals(self, look: Look) -> list[Vector] | None:
        """The signal of each transmitter's full pulse at the antennas, None while nothing is heard."""
        if look.pose is None or self._reverted or look.time_s < self._listens_s:
            return None
        there = look.transmitters
        R_r = look.pose.rotation
        h_r = there.field_at(look.pose.position) @ R_r
        gains = self._options.gains
        return [(x * gains[0], y * gains[1], z * gains[2]) for x, y, z in h_r.tolist()]

    def _hear(self, sent: SentPulse, signals: list[Vector] | None) -> bool:
        """One pulse; whether a slot shows it."""
        index, end_s = sent.pulse.sender, sent.pulse.end_s
        noise = self._noise_of(index)
        track = self._tracks.get(index)
        event = separate(sent, signals, self._keyings, self._random) if signals is not None else None
        if event is not None:
            signal = self._display.heard(event.signal, noise)
            shown = self._display.shown(index, signal)
            if shown is not None:
                if track is None:
                    track = self._tracks[index] = Track(_REACH, self._marks)
                return track.hear(event, end_s, shown)
        if track is not None:
            track.miss(end_s, signals is not None and (event is None or event.touched))
        return False

    def _noise_of(self, index: int) -> Vector:
        """The noise of one pulse: its own, or that of a burst of interference."""
        own = self._noise.draw()
        look = self._look
        assert look is not None
        if look.noise is None or look.pose is None:
            self._interference = self._noisy
            return own
        x, y, z = (look.noise[index] @ look.pose.rotation).tolist()
        self._interference = math.hypot(x, y, z) > self._noise_limit
        return x, y, z

    def _reading(self, time_s: float) -> tuple[float, Reading]:
        """What it shows, and until when that holds."""
        until_s = math.inf
        slots: list[tuple[bool, bool, int, int, ChannelReading]] = []
        look, ids = self._look, self._transmitters.ids if self._transmitters else ()
        for index, track in () if self._reverted else self._tracks.items():
            track.pass_time(time_s)
            shown, id_ = track.shown, ids[index]
            if shown is None:
                continue
            blank = time_s >= track.blank_s
            until_s = min(until_s, track.drops_s if blank else track.blank_s)
            if blank:
                slot = ChannelReading(id_, Zone.OUTER, self._empty.d_cm, self._empty.delta_deg, None, track.marked)
            else:
                pulse = PulseReading(track.heard_s, shown.signal_na_m, track.period_s, track.carrier_hz)
                slot = ChannelReading(id_, shown.zone, shown.d_cm, shown.delta_deg, None, track.marked, pulse)
            slots.append((blank, track.marked, slot.d_cm, id_, slot))
        slots.sort(key=lambda row: row[:4])
        channels = [row[4] for row in slots][: self._channels]
        more, overlapping = len(slots) > len(channels), any(track.touched for track in self._tracks.values())
        channels += [self._empty] * (self._channels - len(channels))
        every: tuple[ChannelReading, ...] = tuple(channels)
        if look is not None and look.pose is not None:
            every = with_true_ranges(every, look.transmitters.ranges(look.pose.position))
        return until_s, Reading(every, self._interference, more, overlapping, not self._reverted)

    def _mark(self, id_: int, time_s: float, marked: bool) -> Answer:
        """Mark a transmitter as found, or not. Refused where rescuers fail: too far away, not heard, or overlapped."""
        ids = self._transmitters.ids if self._transmitters else ()
        track = self._tracks.get(ids.index(id_)) if id_ in ids else None
        if track is None or track.shown is None or time_s >= track.blank_s or track.touched:
            return Answer.REFUSED
        if track.shown.d_cm > 100 * self._options.mark_within_m:
            return Answer.REFUSED
        track.marked = marked
        return Answer.DONE

    def _note_motion(self, look: Look) -> None:
        """Without motion for long, it sends instead of searching."""
        if self._options.revert_s is None or look.pose is None:
            return
        x, y, z = look.pose.position.tolist()
        if self._moved is None or math.dist(self._moved[1], (x, y, z)) > _MOVED_M:
            self._moved = look.time_s, (x, y, z)
        elif look.time_s - self._moved[0] >= self._options.revert_s and not self._reverted:
            self._reverted = True
            self._forget()
