"""Draws the paper's figures from the model: 2 (the dipole), 3 (distance shown), 5 (directions shown).

    python -m tools figures paper [--out tools/figures]

A figure is a function that draws into an empty `Figure`; it is entered in FIGURES under the name of its file and
takes its looks from STYLE, colours C0 … C3 included, so that it may live in a file that imports nothing from here.

In all of them the transmitter is at the origin, its dipole points east (the paper's x), and the places drawn are
(east, north), metres. The data are the same on every run.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from arva_hil.model.field import Transmitters, dipole_field
from arva_hil.model.field.rotation import from_euler, to_matrix
from arva_hil.model.receiver import Antennas, Zone, maps
from tools.options import parser

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

EAST: Final = to_matrix(from_euler(0, 0, math.pi / 2))  # R_t of a dipole that points east
TRANSMITTER: Final = Transmitters((1,), np.zeros((1, 3)), EAST[None], np.ones(1))
ANTENNAS: Final = Antennas()
SEED: Final = 457


# Figure 2


def field(places: ArrayLike) -> Array:
    """Return the field (..., 2), east and north, at places (..., 2) of the horizontal plane."""
    h: Array = _field(_ned(places))[..., 1::-1]
    return h


def flux_lines(apexes: ArrayLike) -> Array:
    """Return flux lines (K, N, 2) that cross the equator `apexes` (K,) metres north of the transmitter, end to end.

    On a flux line of a dipole the distance is apex · sin² of the angle from the axis.
    """
    angle = np.linspace(0.05, np.pi - 0.05, 701)
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    lines: Array = np.asarray(apexes, float)[:, None, None] * np.sin(angle)[:, None] ** 2 * unit
    return lines


def iso_power_line(d: float, count: int = 361) -> Array:
    """Return the line on which a level receiver without noise reads `d` metres: (count, 2), closed."""
    bearing = np.linspace(0, 2 * np.pi, count)
    unit = np.stack([np.sin(bearing), np.cos(bearing)], axis=-1)
    power = np.linalg.norm(field(unit), axis=-1, keepdims=True)
    line: Array = d * np.cbrt(4 * np.pi / ANTENNAS.kappa_eq * power) * unit
    return line


# Figure 3


def poses(n: int, rng: np.random.Generator, level: bool, farthest: float = 90.0) -> tuple[Array, Array]:
    """Return places (n, 3) in NED and R_r (n, 3, 3) of n receivers, true distances uniform up to `farthest` metres.

    `level`: in the dipole's horizontal plane, at any bearing, level, with any heading. Otherwise in any direction
    in space and turned in any way, both uniform on their sphere.
    """
    distance = rng.uniform(0, farthest, (n, 1))
    if level:
        bearing, heading = rng.uniform(0, 2 * np.pi, (2, n))
        places = _ned(distance * np.stack([np.sin(bearing), np.cos(bearing)], axis=-1))
        return places, to_matrix(from_euler(0, 0, heading))
    way, attitude = rng.normal(size=(n, 3)), rng.normal(size=(n, 4))
    return distance * way / np.linalg.norm(way, axis=-1, keepdims=True), to_matrix(attitude)


def readings(places: Array, R_r: Array, seed: int, antennas: Antennas = ANTENNAS) -> tuple[Ints, Ints, Ints]:
    """Return (d in cm, δ in degrees, `Zone`), each (n,), at places (n, 3) and attitudes (n, 3, 3), with noise.

    They are those of a `Receiver` with the same seed at these places in turn.
    """
    d_cm, delta_deg, zone = maps.readings(places, R_r, TRANSMITTER, antennas, seed=seed)
    return d_cm[:, 0], delta_deg[:, 0], zone[:, 0]


def distances(n: int, level: bool, seed: int = SEED) -> tuple[Array, Array]:
    """Return (true distance, d), each (n,), metres, of n random poses; d is −1 without a signal."""
    places, R_r = poses(n, np.random.default_rng(seed), level)
    d_cm, _, zone = readings(places, R_r, seed)
    return np.linalg.norm(places, axis=-1), np.where(zone == Zone.OUTER, -1.0, d_cm / 100)


def share_heard(distance: Array, d: Array, edges: Array) -> Array:
    """Return the share of poses with a signal between each two edges, metres; NaN without a pose."""
    every, heard = (np.histogram(x, edges)[0] for x in (distance, distance[d >= 0]))
    share: Array = np.divide(heard, every, out=np.full(len(every), np.nan), where=every > 0)
    return share


# Figure 5


@dataclass(frozen=True, eq=False)
class Shown:
    """The readings of level receivers, each with its own heading, at N places of the horizontal plane."""

    places: Array  # (N, 2) east, north
    ways: Array  # (N, 2) of length 1: heading and δ; 0 where no δ is given
    d: Array  # (N,) metres; −1 without a signal
    zones: Ints  # (N,)


def grid(east: float, north: float, step: float) -> Array:
    """Return places (N, 2), `step` metres apart, out to ± `east` and ± `north`."""
    x, y = (np.arange(-(half // step), half // step + 1) * step for half in (east, north))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def directions(places: Array, seed: int = SEED, antennas: Antennas = ANTENNAS) -> Shown:
    """Return the directions at places (N, 2), with noise; of the two senses that of the field."""
    heading = np.random.default_rng(seed).uniform(0, 2 * np.pi, len(places))
    d_cm, delta, zones = readings(_ned(places), to_matrix(from_euler(0, 0, heading)), seed, antennas)
    azimuth = heading + np.radians(delta)
    ways = np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
    ways *= np.where((ways * field(places)).sum(axis=-1) < 0, -1.0, 1.0)[:, None]
    ways[zones != Zone.MID] = 0
    return Shown(places, ways, np.where(zones == Zone.OUTER, -1.0, d_cm / 100), zones)


def _ned(places: ArrayLike) -> Array:
    """Return NED (..., 3) of places (..., 2)."""
    places = np.asarray(places, float)
    return np.stack([places[..., 1], places[..., 0], np.zeros(places.shape[:-1])], axis=-1)


def _field(points: Array) -> Array:
    t = TRANSMITTER
    h: Array = dipole_field(points, t.positions, t.rotations, t.strengths)[..., 0, :]
    return h


# The drawings

INK, MUTED, FAINT = "#222222", "#6b6b6b", "#d0d0d0"
STYLE: Final = {
    "axes.axisbelow": True,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.prop_cycle": "cycler('color', ['0072B2', 'D55E00', '009E73', 'CC79A7'])",  # Okabe and Ito
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 13,
    "figure.constrained_layout.use": True,
    "figure.dpi": 100,
    "font.family": "DejaVu Sans",
    "font.size": 11,
    "legend.frameon": False,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
}
WIDTH_PX: Final = 900
PALETTE: Final = 96  # colours of a file: what keeps it small

DRAWS: Final = 4000  # of each kind of pose in figure 3
INNER_M, MID_M, PAPER_M = 3.0, 50.0, 60.0  # the zones' limits in d; the paper's in true distance


def title(axes: Axes, text: str, under: str) -> None:
    axes.set_title(text, pad=22)
    axes.text(0, 1.015, under, color=MUTED, fontsize=10, transform=axes.transAxes, in_layout=False)


def plan(axes: Axes, east: float, north: float) -> None:
    """A map: metres, to scale, the transmitter in the middle."""
    axes.set(xlim=(-east, east), ylim=(-north, north), aspect="equal", xlabel="east, m", ylabel="north, m")
    arrow = {"arrowstyle": "-|>,head_width=0.3,head_length=0.55", "color": INK, "lw": 2.5, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (3, 0), (-3, 0), arrowprops=arrow, zorder=5)


def figure2(figure: Figure) -> None:
    figure.set_figheight(7.3)
    axes = figure.add_subplot()
    plan(axes, 66, 46)
    title(
        axes,
        "A transmitter's field in its horizontal plane",
        "The black arrow is the dipole. An iso-power line bears the d that a level receiver shows there without noise.",
    )
    for mirror in (1, -1):
        for line in flux_lines([5.5, 13, 30, 65, 150, 500]) * [1, mirror]:
            axes.plot(*line.T, color="C1", lw=1.3)
            apex, arrow = len(line) // 2, {"arrowstyle": "-|>,head_width=0.22,head_length=0.45", "color": "C1", "lw": 0}
            axes.annotate("", line[apex + 2], line[apex - 2], arrowprops=arrow)
    axes.axhline(0, color="C1", lw=1.3, label="flux lines")
    for d in (10, 20, 30, 40, 50):
        x, y = iso_power_line(d).T
        axes.plot(x, y, color="C0", lw=1.6, ls=(0, (5, 2)), label="iso-power lines" if d == 10 else None)
        box = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none"}
        axes.text(0, y.min(), f"{d} m", color="C0", ha="center", va="center", bbox=box)
    figure.legend(loc="outside lower center", ncols=2)


def figure3(figure: Figure) -> None:
    figure.set_figheight(8)
    top, bottom = figure.subplots(2, sharex=True, height_ratios=[3.4, 1])
    title(
        top,
        "Distance shown over true distance, with the environment's noise",
        f"{DRAWS} receivers of each kind, at true distances uniform up to 90 m. A tick at −1: nothing heard.",
    )
    edges, last = np.arange(0, 91, 2.0), []
    kinds = {
        True: "level, in the dipole's plane, at any bearing and heading",
        False: "anywhere around, turned in any way",
    }
    for n, (level, label) in enumerate(kinds.items()):
        distance, d = distances(DRAWS, level)
        heard, colour = d >= 0, f"C{n}"
        last.append(distance[heard].max())
        top.scatter(distance[heard], d[heard], 6, lw=0, alpha=0.6, color=colour, label=label, zorder=2 - n)
        top.scatter(distance[~heard], d[~heard], 30, lw=0.4, alpha=0.5, marker="|", color=colour, zorder=2 - n)
        bottom.stairs(100 * share_heard(distance, d, edges), edges, baseline=None, color=colour, lw=2, zorder=2 - n)
    for power, name in ((2, "axis"), (1, "equator")):
        reach = MID_M / math.cbrt(ANTENNAS.kappa_eq / power)
        top.plot([0, reach], [0, MID_M], color=INK, lw=1, zorder=3)
        top.text(reach, MID_M + 1, name, ha="center", va="bottom")
    top.plot([], [], color=INK, lw=1, label="level, without noise, on the dipole's axis and on its equator")
    for limit, name in ((INNER_M, "inner zone ends: 3 m"), (MID_M, "mid zone ends: 50 m")):
        top.axhline(limit, color=MUTED, lw=1, ls=(0, (4, 3)))
        top.text(89.5, limit + 0.6, name, color=MUTED, ha="right", va="bottom")
    for axes in (top, bottom):
        axes.axvspan(PAPER_M, 90, color=FAINT, alpha=0.45, lw=0, zorder=0)
    top.text(75, 27, "the paper: beyond about\n60 m, −1 and nothing else", ha="center", va="center")
    bottom.text(75, 50, "last heard at\n" + " and ".join(f"{m:.1f} m" for m in last), ha="center", va="center")
    top.set(xlim=(0, 90), ylim=(-3, 56), ylabel="d, m")
    top.set_yticks([-1, *range(10, 51, 10)], ["−1", *map(str, range(10, 51, 10))])
    bottom.set(ylim=(0, 105), yticks=(0, 50, 100), ylabel="heard, %", xlabel="true distance, m")
    figure.legend(loc="outside lower center", markerscale=3)


def figure5(figure: Figure) -> None:
    figure.set_figheight(6.7)
    axes = figure.add_subplot()
    plan(axes, 68, 48)
    title(
        axes,
        "Directions shown around a transmitter, with the environment's noise",
        "Heading and δ of level receivers, each with a heading of its own. Of δ's two senses the field's is drawn.",
    )
    shown = directions(grid(65, 45, 5))
    mid, silent = shown.zones == Zone.MID, shown.zones == Zone.OUTER
    x, y = shown.places[silent].T
    axes.scatter(x, y, 7, lw=0, color=MUTED, label="nothing heard")
    arrows = axes.quiver(
        *shown.places[mid].T,
        *shown.ways[mid].T,
        shown.d[mid],
        cmap=ListedColormap(colormaps["viridis"](np.linspace(0, 0.88, 10))),
        clim=(0, MID_M),
        pivot="middle",
        angles="xy",
        scale_units="xy",
        scale=1 / 4,
        width=0.0035,
    )
    for limit, label in ((INNER_M, None), (MID_M, "the zones' ends without noise")):
        axes.plot(*iso_power_line(limit).T, color=MUTED, lw=1, ls=(0, (4, 3)), label=label)
    figure.colorbar(arrows, ax=axes, label="d, m", shrink=0.8, pad=0.01).outline.set_visible(False)
    figure.legend(loc="outside lower center", ncols=2)


FIGURES: Final[dict[str, Callable[[Figure], None]]] = {"figure2": figure2, "figure3": figure3, "figure5": figure5}


def save(draw: Callable[[Figure], None], path: Path) -> None:
    """Draw one figure in the style, and write it as a PNG of few colours."""
    with rc_context(STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=(WIDTH_PX / 100, WIDTH_PX / 150))
        canvas = FigureCanvasAgg(figure)
        draw(figure)
        canvas.print_figure(pixels := io.BytesIO(), format="png")
    image = Image.open(pixels).convert("RGB").quantize(PALETTE, dither=Image.Dither.NONE)
    image.save(path, optimize=True)


def main() -> None:
    draw_all(FIGURES, __doc__)


def draw_all(figures: Mapping[str, Callable[[Figure], None]], said: str | None) -> None:
    """The command that draws these figures; `said`: its help."""
    folder: Path = parser(said, out=(Path(__file__).parent, "folder")).parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in figures.items():
        path = folder / f"{name}.png"
        save(draw, path)
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")
