"""A receiver with one antenna that sends only the strength of the newest pulse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from annotated_types import Ge, Gt

from arva_hil.model.field.keying import SentPulse
from arva_hil.model.receiver.display import Frames, PulsedOptions, Steps
from arva_hil.model.receiver.listening import ListeningReceiver, Signals
from arva_hil.model.receiver.reading import ChannelReading, PulseReading, Reading, Zone, with_true_ranges
from arva_hil.model.receiver.receiver_model import Answer, Look, ReceiverSettings, obey

_HOLD_S: Final = 1.5


@dataclass(frozen=True)
class RssiOptions(PulsedOptions):
    """The keys of `model: rssi`: those of `pulsed`, with other defaults, and the strength that is 0 dBFS."""

    antennas: Annotated[Literal[1], "x alone"] = 1
    start_s: Annotated[float, Ge(0), "from switching on until it receives [s]"] = 0.0
    steps: Steps = "cm"
    frames: Frames = "pulses"
    full_scale_na_m: Annotated[float, Gt(0), "the signal that is 0 dBFS [nA/m]"] = 1e6

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in "self_test_m", "revert_s", "lag_s":
            if getattr(self, name):
                raise ValueError(f"{name} {getattr(self, name):g}: expected model: pulsed or vector, which have it")


class RssiReceiver(ListeningReceiver):
    """A `ReceiverModel` with one channel: the strength of the newest pulse of any transmitter, for 1.5 s.

    It cannot distinguish transmitters: the powers of simultaneous pulses are added. The only command is `restart`.
    Remembers the next pulses and the newest one.
    """

    Options = RssiOptions
    _options: RssiOptions

    def __init__(self, settings: ReceiverSettings, options: RssiOptions, seed: int) -> None:
        super().__init__(settings, options, seed)
        self._empty = ChannelReading(None, Zone.OUTER, *settings.no_signal, None)
        self._newest: ChannelReading | None = None
        self._restart(0.0)

    def look(self, look: Look) -> bool:
        """See `ReceiverModel`. It requests a frame with each pulse, unless `frames: rate` is set."""
        self._listening.look(look)
        signals = self._listening.signals() if look.time_s >= self._listens_s else None
        news = [self._hear(pulse, signals) for pulse in self._listening.pulses()]
        return any(news) and self._options.frames == "pulses"

    def show(self, time_s: float) -> Reading:
        channel, newest = self._empty, self._newest
        if newest is not None and newest.pulse is not None and time_s - newest.pulse.time_s < _HOLD_S:
            channel = newest
        return Reading(with_true_ranges([channel], self._listening.ranges()), self._listening.interference, False)

    def command(self, time_s: float, name: str, values: Sequence[float]) -> Answer:
        return obey({"restart": (range(1), lambda: self._restart(time_s))}, name, values)

    def _restart(self, time_s: float) -> None:
        self._listens_s, self._newest = time_s + self._options.start_s, None

    def _hear(self, sent: SentPulse, signals: Signals | None) -> bool:
        """Use one pulse. Return True if it is above the threshold."""
        listening = self._listening
        noise, _, _ = listening.noise(sent.pulse.sender)
        if signals is None:
            return False
        together = [pulse.amplitude * signals(pulse.sender)[0] for pulse in (sent.pulse, *sent.touching)]
        x, _, _ = listening.limited((math.hypot(*together) + noise, 0.0, 0.0))
        shown = self._display.shown(0, (x, 0.0, 0.0))
        if shown is None:
            return False
        strength = abs(shown.signal_na_m[0])
        level_dbfs = 20 * math.log10(strength / self._options.full_scale_na_m)
        pulse = PulseReading(sent.pulse.end_s, (strength, 0.0, 0.0), None, None, level_dbfs)
        self._newest = ChannelReading(None, Zone.MID, shown.d_cm, 0, None, pulse=pulse)
        return True
