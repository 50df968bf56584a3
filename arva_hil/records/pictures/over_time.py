"""Pictures over time: d beside the true range; zones, poses, faults and phases; lateness and rates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.model.field.arrays import Array
from arva_hil.records.pictures.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    PALETTE,
    PINK,
    RED,
    SKY,
    look_of,
    plain,
    some,
    thinned,
)
from arva_hil.records.reading import RecordedReceiver, RecordedStream, Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_MOST_IDS: Final = 8
_MOST_FAULTS: Final = 8
_BINS: Final = 1500  # a state that lasts shorter is drawn this part of the time long
_PHASES: Final = {"arming": PALE, "climbing": SKY, "flying": PINK, "landing": ORANGE}


def draw_distance(axes: Axes, recording: Recording, receiver: RecordedReceiver | None) -> None:
    """Draw d of each transmitter as points, and its true range as a line, over the time of the frames."""
    axes.set(xlabel="time from the start of the run, s", ylabel="m", title="d that was read, and the true range")
    if receiver is None:
        _draw_search_distance(axes, recording)
        return
    for n, id_ in enumerate(_ids(recording, receiver)):
        colour, _ = look_of(id_)
        rows = thinned(len(receiver))
        ranges = true_range(recording, receiver, id_, rows)
        axes.plot(receiver.time_s[rows], ranges, color=colour, lw=1.0, label=f"transmitter {id_}: true range")
        d_m, _, zone, _ = receiver.of_transmitter(id_)
        for in_zone, marker, words in ((1, "o", "d, mid zone"), (2, "s", "d, inner zone")):
            here = some(zone == in_zone)
            if len(here):
                size = 3 if len(here) < 500 else 1.2
                label = words if n == 0 else None
                axes.plot(receiver.time_s[here], d_m[here], marker, ms=size, color=colour, ls="none", label=label)
    for begin_s, end_s in _spans(receiver.time_s, receiver.fault_set > 0, _end_s(receiver)):
        axes.axvspan(begin_s, end_s, color=PALE, alpha=0.5, lw=0, zorder=0)
    if receiver.faults:
        axes.plot([], [], color=PALE, lw=6, alpha=0.5, label="a fault on")
    axes.set_ylim(bottom=0)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="best")


def true_range(recording: Recording, receiver: RecordedReceiver, id_: int, rows: NDArray[np.int64]) -> Array:
    """Return the true range of the transmitter at some frames, m: from a slot, else by the scenario; NaN if unknown."""
    ranges = receiver.of_transmitter(id_)[3][rows]
    for n in np.flatnonzero(np.isnan(ranges)):
        time_s = float(receiver.time_s[rows[n]])
        there = recording.transmitters(receiver.vehicle, time_s)
        if there is None:
            break
        ranges[n] = there.ranges(receiver.position[rows[n]]).get(id_, np.nan)
    return ranges


Lane = tuple[str, Sequence[tuple[float, float, str]]]
"""One row of the timeline: its label; begin and end [s] and colour of its spans."""


def draw_timeline(axes: Axes, recording: Recording, receiver: RecordedReceiver | None) -> None:
    """Draw a row for the pose, one for the zone of the nearest transmitter, one for each fault, one for the search."""
    lanes = list(_lanes(recording, receiver)) or [("no frame", [])]
    for row, (_, spans) in enumerate(lanes):
        for begin_s, end_s, colour in spans:
            axes.broken_barh([(begin_s, end_s - begin_s)], (row - 0.38, 0.76), color=colour, lw=0)
    axes.set_yticks(range(len(lanes)), [label for label, _ in lanes])
    axes.set_ylim(len(lanes) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    begin_s, end_s = recording.span_s
    axes.set_xlim(begin_s, max(end_s, begin_s + 1))
    axes.set(xlabel="time from the start of the run, s", title="Timeline")
    for colour, label in _legend(lanes):
        axes.plot([], [], color=colour, lw=6, label=label)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=4)


def _lanes(recording: Recording, receiver: RecordedReceiver | None) -> Iterator[Lane]:
    if receiver is not None and len(receiver):
        end_s, time_s = _end_s(receiver), receiver.time_s
        has_pose = np.asarray(np.isfinite(receiver.position).all(axis=1))
        yield "pose", [(*span, GREEN) for span in _spans(time_s, has_pose, end_s)]
        zone = receiver.nearest_zone
        spans = [(*span, BLUE) for span in _spans(time_s, zone == 1, end_s)]
        yield "zone", spans + [(*span, RED) for span in _spans(time_s, zone == 2, end_s)]
        for name in receiver.faults[:_MOST_FAULTS]:
            yield plain(name), [(*span, ORANGE) for span in _spans(time_s, receiver.with_fault(name), end_s)]
    if (search := recording.search) and len(search.time_s):
        yield "search", list(_phases(search.time_s + search.start_s, search.phase))


def _phases(time_s: Array, phases: Sequence[str]) -> Iterator[tuple[float, float, str]]:
    begins = [0, *(n for n in range(1, len(phases)) if phases[n] != phases[n - 1]), len(phases) - 1]
    for a, b in pairwise(begins):
        yield float(time_s[a]), float(time_s[b]), _PHASES.get(phases[a], GREY)


def _legend(lanes: Sequence[Lane]) -> Iterator[tuple[str, str]]:
    labels = {label for label, _ in lanes}
    if "zone" in labels:
        yield from ((GREEN, "pose known"), (BLUE, "mid zone"), (RED, "inner zone"))
    if "search" in labels:
        yield from ((SKY, "climbing"), (PINK, "flying"), (ORANGE, "landing, or a fault"))
    elif len(labels) > 2:
        yield (ORANGE, "fault")


def _spans(time_s: Array, on: NDArray[np.bool_], end_s: float) -> list[tuple[float, float]]:
    """Return the spans of time in which something was on, from frame to frame; a bounded number of them."""
    if not on.any():
        return []
    if len(on) > _BINS:
        edges = np.linspace(0, len(on), _BINS + 1).astype(int)[:-1]
        on, time_s = np.logical_or.reduceat(on, edges), time_s[edges]
    steps = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(int), [0]])))
    times = np.append(time_s, end_s)
    return [(float(times[a]), float(times[b])) for a, b in steps.reshape(-1, 2)]


def _end_s(receiver: RecordedReceiver) -> float:
    """Return the time at which the frame after the last one would have been due."""
    if len(receiver) < 2:
        return float(receiver.time_s[-1]) + 1.0 if len(receiver) else 1.0
    return float(receiver.time_s[-1] + np.median(np.diff(receiver.time_s)))


def _ids(recording: Recording, receiver: RecordedReceiver) -> list[int]:
    """Return the transmitters to draw: those of the scenario, then others received; not too many."""
    every = [transmitter.id for transmitter in recording.scenario.transmitters] if recording.scenario else []
    heard = set(receiver.ids)
    ordered = [id_ for id_ in every if id_ in heard] + sorted(heard - set(every)) + [i for i in every if i not in heard]
    return ordered[:_MOST_IDS]


def _draw_search_distance(axes: Axes, recording: Recording) -> None:
    search = recording.search
    if search is None:
        return
    here = some(search.d_cm > 0)
    axes.plot(search.time_s[here], search.d_cm[here] / 100, "o", ms=3, color=BLUE, ls="none", label="d")
    axes.set(xlabel="time from the start of the search, s")
    axes.set_ylim(bottom=0)
    axes.legend(loc="best")


_MOST_STREAMS: Final = 6
_TIMING_BINS: Final = 60
_ON_TIME_MS: Final = 1e-3


def draw_lateness(axes: Axes, receiver: RecordedReceiver | None) -> None:
    """Draw a histogram of how long after its instant each frame was made, with the median and the 99th percentile."""
    axes.set(xlabel="lateness of a frame, ms", ylabel="frames", title="How punctual the frames were")
    late = np.array([]) if receiver is None else receiver.late_ms[np.isfinite(receiver.late_ms)]
    if not len(late) or late.max() < _ON_TIME_MS:
        _say(axes, "every frame was made at its instant" if len(late) else "no lateness is recorded")
        return
    axes.hist(late, bins=np.linspace(0.0, float(late.max()) * 1.001, _TIMING_BINS + 1).tolist(), color=BLUE)
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
