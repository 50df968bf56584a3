"""Pictures of searches, as in figures 8–11 of the paper. Needs matplotlib: the extra `plots`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from arva_hil.links import files
from arva_hil.records.pictures.style import GREY, PALETTE, RED, figure, saved, styled
from arva_hil.search.mission.outcome import SearchStep

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Place = tuple[float, float]  # north, east of the take-off point, m


class Track(NamedTuple):
    """One search to draw: the steps of its log, and the place that it reported. Tracks of one name share a colour."""

    name: str
    rows: Sequence[SearchStep]
    found: Place | None = None


def draw_search(
    path: Path, tracks: Sequence[Track], truth: Mapping[int, Place], target: int | None, title: str = ""
) -> None:
    """Draw a PNG: trajectories seen from above, and the receiver's d and the true distance over time.

    `truth`: the transmitters by id, empty if they are not known. `target`: the id of the transmitter searched for.
    A file or symlink of this name is replaced. Raises ImportError without matplotlib, OSError if it cannot be written.
    """
    with styled():
        made = figure(9, 4.2)
        made.suptitle(title)
        above, time = made.subplots(1, 2)
        _draw(above, time, tracks, truth, target)
        png = saved(made, "png")
    files.replace(path, png)


def _draw(above: Axes, time: Axes, tracks: Sequence[Track], truth: Mapping[int, Place], target: int | None) -> None:
    """Draw the trajectories seen from above, and the distances over time."""
    names = list(dict.fromkeys(track.name for track in tracks))
    for track in tracks:
        colour = PALETTE[names.index(track.name) % len(PALETTE)]
        flown = [row for row in track.rows if row.phase == "flying"]
        _draw_path(above, flown, track.found, colour)
        _draw_distance(time, flown, truth.get(-1 if target is None else target), colour)
    for id_, (north, east) in truth.items():
        above.plot(east, north, "*", ms=13, color=RED, mec="white", zorder=4, label=f"transmitter {id_}")
    above.plot(0, 0, "s", ms=6, color=GREY, label="take-off")
    for at, name in enumerate(names):
        above.plot([], [], color=PALETTE[at % len(PALETTE)], label=name)
    marked = "; × is where it reports the victim" if any(track.found for track in tracks) else ""
    above.set(xlabel="east [m]", ylabel="north [m]", title="trajectory" + marked)
    above.set_aspect("equal", adjustable="datalim")
    above.legend()
    over = "dots: the receiver's d; line: true horizontal distance" if truth else "dots: the receiver's d"
    time.set(xlabel="time from the end of the take-off [s]", ylabel="[m]", title=over)
    time.set_ylim(bottom=0)


def _draw_path(axes: Axes, flown: Sequence[SearchStep], found: Place | None, colour: str) -> None:
    axes.plot([row.east_m for row in flown], [row.north_m for row in flown], lw=1.2, color=colour)
    if found is not None:
        axes.plot(found[1], found[0], "x", ms=8, mew=1.8, color=colour, zorder=5)


def _draw_distance(axes: Axes, flown: Sequence[SearchStep], target: Place | None, colour: str) -> None:
    start = flown[0].time_s if flown else 0.0
    heard = [(row.time_s - start, row.d_cm / 100) for row in flown if row.d_cm is not None and row.d_cm > 0]
    axes.plot([t for t, _ in heard], [d for _, d in heard], ".", ms=4, color=colour)
    if target is not None:
        away = [math.dist((row.north_m, row.east_m), target) for row in flown]
        axes.plot([row.time_s - start for row in flown], away, lw=1.0, color=colour)
