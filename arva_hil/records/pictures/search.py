"""Pictures of searches, as in figures 8–11 of the paper. Needs matplotlib: the extra `plots`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from arva_hil.links import files
from arva_hil.records.pictures.style import BLUE, GREY, RED, figure, look_of, saved, styled
from arva_hil.search.mission.outcome import SearchStep

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Place = tuple[float, float, float]
"""North, east, down of the take-off point [m]."""


def draw_search(
    path: Path, steps: Sequence[SearchStep], found: Sequence[tuple[float, float]], truth: Mapping[int, Place]
) -> None:
    """Write a PNG: the trajectory seen from above, and the receiver's d and the true range over time.

    Args:
        path: The file. A file or symlink of this name is replaced.
        steps: The steps of the flight.
        found: The places reported, north and east of the take-off point, in the order of the report.
        truth: The transmitters by id, empty if they are not known.

    Raises:
        ImportError: There is no matplotlib.
        OSError: The file cannot be written.
    """
    with styled():
        made = figure(9, 4.2)
        above, time = made.subplots(1, 2)
        flown = [step for step in steps if step.phase == "flying"]
        _draw_above(above, flown, found, truth)
        _draw_distances(time, flown, truth)
        png = saved(made, "png")
    files.replace(path, png)


def _draw_above(
    axes: Axes, flown: Sequence[SearchStep], found: Sequence[tuple[float, float]], truth: Mapping[int, Place]
) -> None:
    axes.plot([step.east_m for step in flown], [step.north_m for step in flown], lw=1.2, color=BLUE, label="search")
    for id_, (north, east, _) in truth.items():
        colour, marker = look_of(id_)
        axes.plot(east, north, marker, ms=9, color=colour, mec="white", zorder=4, ls="none", label=f"transmitter {id_}")
    axes.plot(0, 0, "s", ms=6, color=GREY, mfc="none", ls="none", label="take-off")
    for number, (north, east) in enumerate(found, 1):
        axes.plot(
            east, north, "x", ms=8, mew=1.8, color=RED, zorder=5, ls="none", label="reported" if number == 1 else None
        )
        if len(found) > 1:
            axes.annotate(str(number), (east, north), (6, -10), textcoords="offset points", color=RED, zorder=6)
    axes.set(xlabel="east [m]", ylabel="north [m]", title="trajectory")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend()


def _draw_distances(axes: Axes, flown: Sequence[SearchStep], truth: Mapping[int, Place]) -> None:
    """Draw d of each transmitter as points, and its true range as a line."""
    start = flown[0].time_s if flown else 0.0
    times = [step.time_s - start for step in flown]
    heard = [step for step in flown if step.d_cm is not None and step.d_cm > 0]
    for id_ in dict.fromkeys([*truth, *(-1 if step.id is None else step.id for step in heard)]):
        colour, marker = look_of(id_)
        if id_ in truth:
            away = [math.dist((step.north_m, step.east_m, step.down_m), truth[id_]) for step in flown]
            axes.plot(times, away, lw=1.0, color=colour)
        of_id = [step for step in heard if (-1 if step.id is None else step.id) == id_]
        d_m = [(step.d_cm or 0) / 100 for step in of_id]
        axes.plot([step.time_s - start for step in of_id], d_m, marker, ms=3, color=colour, ls="none")
    over = "points: the receiver's d; lines: true range" if truth else "points: the receiver's d"
    axes.set(xlabel="time from the end of the take-off [s]", ylabel="[m]", title=over)
    axes.set_ylim(bottom=0)
