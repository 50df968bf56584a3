"""The flight seen from above, over the flux lines and lines of equal d of the transmitters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from arva_hil.model.field import Transmitters
from arva_hil.model.field_lines import field_lines
from arva_hil.records.pictures.style import BLUE, GREY, ORANGE, PALE, RED, look_of, some
from arva_hil.records.reading import RecordedReceiver, Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ZONES: Final = {0: ("no signal", GREY, "."), 1: ("mid zone", BLUE, "o"), 2: ("inner zone", RED, "s")}
_MARGIN_M: Final = 5.0
_HEIGHT_M: Final = 3.0  # of the flux lines' plane, if no height is known


def draw_map(axes: Axes, recording: Recording, receiver: RecordedReceiver | None) -> None:
    """Draw the map, north up, metres from the datum, or from the take-off point for the log of a search alone."""
    seen: list[np.ndarray[Any, Any]] = []
    vehicle = receiver.vehicle if receiver is not None else ""
    if receiver is not None:
        seen += _draw_track(axes, receiver)
    seen += _draw_search(axes, recording, vehicle)
    transmitters = recording.transmitters(vehicle, recording.span_s[1])
    if transmitters is None or receiver is None or recording.scenario is None:
        _frame(axes, seen)
    else:
        _frame(axes, seen + _draw_transmitters(axes, transmitters))
        heights = receiver.position[:, 2]
        down_m = float(np.nanmedian(heights)) if np.isfinite(heights).any() else -_HEIGHT_M
        _draw_field(axes, transmitters, down_m, recording.scenario.receiver.kappa_eq)
    of = "the datum" if receiver is not None else "the take-off point"
    axes.set(xlabel=f"east of {of}, m", ylabel="north, m", title="Flight over flux lines and lines of equal d")
    axes.set_aspect("equal")
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="best")


def _draw_track(axes: Axes, receiver: RecordedReceiver) -> list[Any]:
    rows = some(np.isfinite(receiver.position[:, :2]).all(axis=1))
    if not len(rows):
        return []
    north, east = receiver.position[rows, 0], receiver.position[rows, 1]
    axes.plot(east, north, color=BLUE, lw=1.0, alpha=0.6, zorder=3)
    zone = receiver.nearest_zone[rows]
    for number, (label, colour, marker) in _ZONES.items():
        here = zone == number
        if here.any():
            size = 3.5 if len(rows) < 500 else 1.5
            axes.plot(east[here], north[here], marker, ms=size, color=colour, label=label, zorder=4, ls="none")
    return [np.stack([east, north], axis=1)]


def _draw_search(axes: Axes, recording: Recording, vehicle: str) -> list[Any]:
    """Draw the path that the search estimates, and the place that it reports with its ellipse."""
    search = recording.search_of(vehicle)
    if search is None:
        return []
    steps = search.position[some(np.isfinite(search.position).all(axis=1))]
    moved = recording.of_search(steps, vehicle) if recording.receivers else steps
    seen = []
    if moved is not None and len(moved):
        label = "search: its own position" if recording.receivers else "flown"
        axes.plot(moved[:, 1], moved[:, 0], color=ORANGE, lw=1.2, ls=(0, (4, 2)), label=label, zorder=3)
        seen.append(moved[:, 1::-1])
    for number, found in enumerate(search.places, 1):
        edge = np.array([(north, east, 0.0) for north, east in [(found.north, found.east), *found.outline()]])
        places = recording.of_search(edge, vehicle) if recording.receivers else edge
        if places is not None:
            name = "place found, 95 % on Earth" if number == 1 else None
            axes.plot(*places[0, 1::-1], "x", ms=9, mew=2, color=RED, label=name, zorder=6)
            axes.plot(places[1:, 1], places[1:, 0], color=RED, lw=1.2, zorder=6)
            if len(search.places) > 1:
                at = places[0, 1::-1].tolist()
                axes.annotate(f"victim {number}", at, (-8, -12), textcoords="offset points", color=RED, zorder=7)
            seen.append(places[:1, 1::-1])
    return seen


def _draw_transmitters(axes: Axes, transmitters: Transmitters) -> list[Any]:
    seen: list[Any] = []
    for n, id_ in enumerate(transmitters.ids):
        place = transmitters.positions[n]
        if id_ in transmitters.unplaced or not np.isfinite(place).all():
            continue
        along = transmitters.rotations[n, :2, 0] * 2.0
        colour, marker = look_of(id_)
        axes.plot(
            place[1], place[0], marker, ms=9, color=colour, mec="white", zorder=5, label=f"transmitter {id_}, dipole"
        )
        axes.plot(
            [place[1] - along[1], place[1] + along[1]],
            [place[0] - along[0], place[0] + along[0]],
            color=colour,
            lw=2,
            zorder=5,
        )
        axes.annotate(str(id_), (place[1], place[0]), (7, 6), textcoords="offset points", color=colour, zorder=7)
        seen.append(place[None, 1::-1])
    return seen


def _draw_field(axes: Axes, transmitters: Transmitters, down_m: float, kappa_eq: float) -> None:
    """Draw the field under all else, without moving the frame."""
    axes.set_autoscale_on(False)
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    middle, half = np.array([(south + north) / 2, (west + east) / 2]), (north - south) / 2
    every = field_lines(transmitters, down_m, kappa_eq)
    for lines in every:
        for flat in lines["flux"]:
            line = np.reshape(flat, (-1, 2))
            axes.plot(line[:, 1], line[:, 0], color=PALE, lw=0.7, zorder=1)
        for d, flat in lines["equal_d"]:
            line = np.reshape(flat, (-1, 2))
            axes.plot(line[:, 1], line[:, 0], color=GREY, lw=0.6, ls=":", zorder=2)
            inside = line[(np.abs(line - middle) < 0.94 * half).all(axis=1)]
            if len(inside) and len(every) == 1:  # labels of several would cover each other
                north, east = inside[len(inside) // 3]
                axes.text(east, north, f"{d:g} m", fontsize=7, color=GREY, ha="center", va="center", zorder=2)
        if lines["inner"]:
            line = np.reshape(lines["inner"], (-1, 2))
            axes.plot(line[:, 1], line[:, 0], color=RED, lw=0.8, ls="--", zorder=2)


def _frame(axes: Axes, seen: list[Any]) -> None:
    """Set the limits of the map: all that is drawn with a margin; 20 m if it is empty."""
    points = np.concatenate(seen) if seen else np.array([[-20.0, -20.0], [20.0, 20.0]])
    low, high = points.min(axis=0), points.max(axis=0)
    half = _MARGIN_M + 0.55 * float((high - low).max())
    east, north = ((low + high) / 2).tolist()
    axes.set_xlim(east - half, east + half)
    axes.set_ylim(north - half, north + half)
