"""Pictures of timing: the lateness of the frames, and the rates of the vehicle's messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from arva_hil.records.pictures.style import BLUE, GREY, PALETTE, RED, thinned
from arva_hil.records.reading import RecordedReceiver
from arva_hil.records.reading.streams import RecordedStream

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_STREAMS: Final = 6
_BINS: Final = 60
_ON_TIME_MS: Final = 1e-3


def draw_lateness(axes: Axes, receiver: RecordedReceiver | None) -> None:
    """Draw a histogram of how long after its instant each frame was made, with the median and the 99th percentile."""
    axes.set(xlabel="lateness of a frame, ms", ylabel="frames", title="How punctual the frames were")
    late = np.array([]) if receiver is None else receiver.late_ms[np.isfinite(receiver.late_ms)]
    if not len(late) or late.max() < _ON_TIME_MS:
        _say(axes, "every frame was made at its instant" if len(late) else "no lateness is recorded")
        return
    edges = np.linspace(0.0, float(late.max()) * 1.001, _BINS + 1)
    axes.hist(late, bins=edges.tolist(), color=BLUE)
    for share, colour, dashes in ((50, GREY, "-"), (99, RED, "--")):
        value = float(np.percentile(late, share))
        axes.axvline(value, color=colour, ls=dashes, lw=1.2, label=f"{share} % of the frames: up to {value:.3g} ms")
    axes.set_yscale("log")
    axes.set_ylim(bottom=0.7)
    axes.legend(loc="best")


def draw_streams(axes: Axes, streams: Sequence[RecordedStream]) -> None:
    """Draw the most frequent messages that came in each second."""
    axes.set(xlabel="time from the start of the run, s", ylabel="messages a second", title="Rates of the streams")
    for n, stream in enumerate(streams[:_MOST_STREAMS]):
        rows = thinned(len(stream.hz))
        label = f"{stream.name}, {stream.mean_hz:.3g} Hz"
        style = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)))[n % 6]
        axes.plot(
            stream.time_s[rows], stream.hz[rows], color=PALETTE[n], lw=1.2, ls=style, label=label, ds="steps-post"
        )
    if not streams:
        _say(axes, "no packets are recorded")
        return
    axes.set_ylim(bottom=0)
    axes.legend(loc="best")


def _say(axes: Axes, words: str) -> None:
    axes.text(0.5, 0.5, words, ha="center", va="center", transform=axes.transAxes, color=GREY)
