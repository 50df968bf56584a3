"""Receivers that listen to pulses: one sample for each pulse, a rhythm for each transmitter, slots, marks."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from random import Random
from typing import Annotated, ClassVar, Final

from annotated_types import Gt

from arva_hil.model.field.pulse_timeline import SentPulse
from arva_hil.model.receiver.listening import ListeningReceiver
from arva_hil.model.receiver.pulsed_options import Frames, PulsedOptions, Steps
from arva_hil.model.receiver.reading import Reading, with_true_ranges
from arva_hil.model.receiver.receiver_model import Answer, Commands, Look, ReceiverSettings, obey
from arva_hil.model.receiver.separation import Signals, Vector, separate
from arva_hil.model.receiver.slots import Slots

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

    start_s: Annotated[float, "from switching on until it receives [s]"] = 0.0
    steps: Steps = "cm"
    frames: Frames = "pulses"
    mark_within_m: Annotated[float, Gt(0), "a transmitter farther away cannot be marked [m]"] = 1000.0


class VectorReceiver(PulsedReceiver):
    """A receiver that sends its measurements: signed signals of three antennas, period, carrier, and time of the pulse.

    Estimators need them; rescuers' sets do not send them.
    """

    Options = VectorOptions
    _MEASURES = True
