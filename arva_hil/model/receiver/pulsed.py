"""Receivers that listen to pulses: one sample for each pulse, a rhythm for each transmitter, slots, marks.

A slot opens after two pulses in rhythm. After that a pulse counts if it is within 3 ms of the rhythm, and within 10 Hz
of the carrier. If pulses between those two were missed, the rhythm is too slow: the first pulse in between corrects it.
Without pulses the slot becomes blank, then it is dropped; later its mark is lost.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from random import Random
from typing import Annotated, ClassVar, Final, NamedTuple

from annotated_types import Ge, Gt

from arva_hil.model.field.keying import SentPulse
from arva_hil.model.receiver.display import Frames, PulsedOptions, Shown, Steps
from arva_hil.model.receiver.listening import Listening, ListeningReceiver, SeparatedPulse, Signals, separate
from arva_hil.model.receiver.reading import ChannelReading, PulseReading, Reading, Vector, Zone, with_true_ranges
from arva_hil.model.receiver.receiver_model import Answer, Commands, Look, ReceiverSettings, obey

_GATE_S: Final = 3e-3
_GATE_HZ: Final = 10.0
_PERIODS_S: Final = (0.4, 2.0)  # of two pulses in rhythm
_SMOOTHING: Final = 0.5  # of the period
_HOLD, _DROP, _FORGET = 1.5, 5.5, 8.5  # assumed: periods without a pulse until a slot is blank, dropped, unmarked


class Mark(NamedTuple):
    """A marked transmitter that was lost."""

    period_s: float
    carrier_hz: float


class PulseTrack:
    """Remembers one transmitter's last pulse, its rhythm and values, and whether it is marked.

    `shown`: the values of the last pulse in rhythm, None while there is no slot. `heard_s`: the end of that pulse.
    `touched`: the newest pulse was disturbed by another transmitter's. `lost`: the lost marks of all.
    """

    def __init__(self, lost: list[Mark]) -> None:
        self.shown: Shown | None = None
        self.heard_s = -math.inf
        self.period_s = 1.0
        self.carrier_hz = math.nan
        self.marked = False
        self.touched = False
        self._lost = lost
        self._start_s = -math.inf  # of the last pulse in rhythm, or of a first one

    def hear(self, event: SeparatedPulse, end_s: float, shown: Shown) -> bool:
        """Use a pulse above the threshold. Return True if it is in rhythm. `end_s`: its end."""
        self.touched = event.touched
        self.pass_time(end_s)
        if self.shown is None:
            return self._open(event, end_s, shown)
        if abs(event.carrier_hz - self.carrier_hz) > _GATE_HZ:
            return False
        gap_s = event.start_s - self._start_s
        periods = max(1, round(gap_s / self.period_s))
        late = gap_s - periods * self.period_s
        if abs(late) <= _GATE_S:
            self.period_s += _SMOOTHING * late / periods
        elif self._divides(gap_s):
            self.period_s = gap_s
            self._regain_mark()
        else:
            return False
        self._take(event, end_s, shown)
        return True

    def miss(self, end_s: float, touched: bool) -> None:
        """Handle a pulse that was not received."""
        self.touched = touched
        self.pass_time(end_s)

    def pass_time(self, time_s: float) -> None:
        """Drop the slot, and lose the mark, after too many missed pulses."""
        if time_s < self.drops_s:
            return
        self.shown = None
        if time_s >= self.heard_s + _FORGET * self.period_s:
            self.lose_mark()

    def lose_mark(self) -> None:
        """Allow another transmitter to get the mark from now on."""
        if self.marked:
            self.marked = False
            self._lost.append(Mark(self.period_s, self.carrier_hz))

    @property
    def blank_s(self) -> float:
        """The time from which the slot is blank."""
        return self.heard_s + _HOLD * self.period_s

    @property
    def drops_s(self) -> float:
        """The time from which there is no slot."""
        return self.heard_s + _DROP * self.period_s

    def _open(self, event: SeparatedPulse, end_s: float, shown: Shown) -> bool:
        """Open a slot with the second pulse of a rhythm; otherwise the pulse may be the first one."""
        period_s = event.start_s - self._start_s
        if not _PERIODS_S[0] <= period_s <= _PERIODS_S[1]:
            self._start_s = event.start_s
            return False
        self.period_s, self.carrier_hz = period_s, event.carrier_hz
        self._regain_mark()
        self._take(event, end_s, shown)
        return True

    def _divides(self, gap_s: float) -> bool:
        """Return True if the period is a multiple of this time: a half or a third of it."""
        parts = round(self.period_s / gap_s)
        return parts > 1 and gap_s >= _PERIODS_S[0] and abs(gap_s - self.period_s / parts) <= _GATE_S

    def _regain_mark(self) -> None:
        """Take over a lost mark of the same rhythm and carrier."""
        for mark in self._lost if not self.marked else ():
            near_hz = abs(mark.carrier_hz - self.carrier_hz) <= _GATE_HZ
            if near_hz and abs(mark.period_s - self.period_s) <= _GATE_S:
                self._lost.remove(mark)
                self.marked = True
                return

    def _take(self, event: SeparatedPulse, end_s: float, shown: Shown) -> None:
        self.shown, self.heard_s, self._start_s = shown, end_s, event.start_s


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


_MOVED_M: Final = 1.0  # a smaller distance is no motion


class PulsedReceiver(ListeningReceiver):
    """A `ReceiverModel` with a sample at the end of each pulse. It follows the rhythm of every transmitter received.

    Remembers the next pulses, slots and marks, its last motion, and whether it has returned to sending.

    Commands: `mark ID`, refused if it is too far away, not received, or overlapped; `unmark ID`, `unmark`; `select ID`,
    `select`; `channels N`; `scan`; `restart`; `search` after it has returned to sending.
    """

    _MEASURES: ClassVar[bool] = False

    def __init__(self, settings: ReceiverSettings, options: PulsedOptions, seed: int) -> None:
        super().__init__(settings, options, seed)
        self._slots = Slots(
            self._listening, settings.channels, settings.no_signal, options.mark_within_m, self._MEASURES
        )
        self._random = Random(seed)
        self._shown: tuple[float, Reading] | None = None  # valid until this time
        self._coming: deque[tuple[float, Reading]] = deque()  # to the display, and when
        self._displayed: Reading | None = None
        self._switch_on(0.0)

    def look(self, look: Look) -> bool:
        """See `ReceiverModel`. It requests a frame if a slot has changed and `frames: pulses` is set."""
        if self._listening.look(look):
            self._slots.forget()
        self._shown = None
        self._displayed = self._displayed or self._reading(look.time_s)
        self._note_motion(look)
        self._test_itself(look)
        pulses = self._listening.pulses()
        if not pulses:
            return False
        searching = self.searching and look.time_s >= self._listens_s
        signals = self._listening.signals() if searching else None
        news = [self._hear(pulse, signals) for pulse in pulses]
        if self._options.lag_s:
            self._coming.append((look.time_s + self._options.lag_s, self._reading(look.time_s)))
        return any(news) and self._options.frames == "pulses"

    def show(self, time_s: float) -> Reading:
        if not self._options.lag_s:
            return self._reading(time_s)
        while self._coming and self._coming[0][0] <= time_s:
            self._displayed = self._coming.popleft()[1]
        late = self._displayed or self._reading(time_s)
        return replace(late, channels=with_true_ranges(late.channels, self._listening.ranges()))

    def _reading(self, time_s: float) -> Reading:
        if self._shown is None or time_s >= self._shown[0]:
            slots, more, until_s = self._slots.shown(time_s)
            channels = with_true_ranges(slots, self._listening.ranges())
            disturbed = self._listening.interference, more, self._slots.overlapping
            self._shown = until_s, Reading(channels, *disturbed, self.searching, self._failed)
        return self._shown[1]

    def command(self, time_s: float, name: str, values: Sequence[float]) -> Answer:
        slots, self._shown = self._slots, None
        commands: Commands = {
            "mark": (range(1, 2), lambda id_: slots.mark(time_s, id_)),
            "unmark": (range(2), lambda id_=None: slots.unmark(time_s, id_)),
            "select": (range(2), lambda id_=None: slots.select(time_s, id_)),
            "channels": (range(1, 2), slots.set_channels),
            "scan": (range(1), slots.scan),
            "restart": (range(1), lambda: self._switch_on(time_s)),
            "search": (range(1), self._search),
        }
        return obey(commands, name, values)

    def _switch_on(self, time_s: float) -> None:
        self._slots.restart()
        self._coming.clear()
        self._displayed = None
        self._listens_s = time_s + self._options.start_s
        self._failed = False
        self._search()

    def _search(self) -> None:
        self._moved: tuple[float, Vector] | None = None  # time and place of its last motion
        self.searching = True

    def _hear(self, sent: SentPulse, signals: Signals | None) -> bool:
        """Use one pulse. Return True if a slot has it."""
        index, end_s = sent.pulse.sender, sent.pulse.end_s
        listening = self._listening
        u, v, w = listening.noise(index)
        event = separate(sent, signals, listening.keyings, self._random) if signals is not None else None
        if event is not None:
            x, y, z = event.signal
            signal = self._display.antennas(listening.limited((x + u, y + v, z + w)))
            if (shown := self._display.shown(index, signal)) and (track := self._slots.track(index, make=True)):
                return track.hear(event, end_s, shown)
        if track := self._slots.track(index):
            track.miss(end_s, signals is not None and (event is None or event.touched))
        return False

    def _note_motion(self, look: Look) -> None:
        """Return to sending after a long time without motion."""
        if self._options.revert_s is None or look.pose is None or not self.searching:
            return
        x, y, z = look.pose.position.tolist()
        if self._moved is None or math.dist(self._moved[1], (x, y, z)) > _MOVED_M:
            self._moved = look.time_s, (x, y, z)
        elif look.time_s - self._moved[0] >= self._options.revert_s:
            self.searching = False
            self._slots.forget()

    def _test_itself(self, look: Look) -> None:
        """Run the self-test at the start; it fails near a transmitter or electronics."""
        within_m = self._options.self_test_m
        if within_m is None or look.time_s > self._listens_s or self._failed:
            return
        beside = look.impairment is not None and look.impairment.noise_na_m > 0
        self._failed = beside or any(metres < within_m for metres in self._listening.ranges().values())


@dataclass(frozen=True)
class VectorOptions(PulsedOptions):
    """The keys of `model: vector`: those of `pulsed`, with other defaults."""

    start_s: Annotated[float, Ge(0), "from switching on until it receives [s]"] = 0.0
    steps: Steps = "cm"
    frames: Frames = "pulses"
    mark_within_m: Annotated[float, Gt(0), "a transmitter farther away cannot be marked [m]"] = 1000.0


class VectorReceiver(PulsedReceiver):
    """A receiver that sends its measurements: signed signals of three antennas, period, carrier, and time of the pulse.

    Estimators need them; rescuers' sets do not send them.
    """

    Options = VectorOptions
    _MEASURES = True
