"""Draws pictures of the concepts, the wiring and the lessons into docs/pictures.

python tools/page_pictures.py [--out docs/pictures]
"""

from __future__ import annotations

import csv
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, FancyBboxPatch

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent.parent))

from arva_hil.model.field import dipole_field
from arva_hil.model.receiver import outputs
from firmware_proto import MID, SYNTHETIC, Channel, Frame, encode
from tools.paper.data import flux_lines, iso_power_line
from tools.paper_figures import FAINT, INK, MUTED, draw_all

BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"
DRONE: Final = np.array([-25.0, -29.0])  # east, north of the transmitter, m
HEADING_DEG: Final = 0.0
KAPPA_EQ: Final = 1.542


def reading() -> tuple[float, float, float]:
    """Return d in metres, δ in degrees and the bearing of the flux line, of a level receiver at DRONE."""
    place = np.array([DRONE[1], DRONE[0], 0.0])
    dipole_east = np.array([[[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]])
    field = dipole_field(place, np.zeros((1, 3)), dipole_east, np.ones(1))
    d, delta, _ = (float(one[0]) for one in outputs(field, KAPPA_EQ))
    return d / 100, delta, HEADING_DEG + delta


def ray(bearing_deg: float, length: float) -> np.ndarray:
    """Return a step east and north."""
    return length * np.array([math.sin(math.radians(bearing_deg)), math.cos(math.radians(bearing_deg))])


def label(axes: Axes, place: tuple[float, float], text: str, colour: str = INK, **how: object) -> None:
    axes.text(*place, text, color=colour, ha=how.get("ha", "center"), va="center", fontsize=how.get("size", 10.5),
              bbox={"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.85}, zorder=8)  # fmt: skip


def arrow(axes: Axes, start: np.ndarray, end: np.ndarray, colour: str, **how: object) -> None:
    style = {"arrowstyle": "-|>,head_width=0.25,head_length=0.5", "color": colour, "lw": 2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops={**style, **how}, zorder=6)


def plan(axes: Axes) -> None:
    """Draw the map: transmitter, flux lines, zones, receiver with d and δ."""
    axes.set(xlim=(-62, 62), ylim=(-50, 50), aspect="equal", xticks=[], yticks=[])
    axes.spines[["left", "bottom"]].set_visible(False)
    mid, inner = iso_power_line(50), iso_power_line(3)
    axes.fill(*mid.T, color="#e3eff7", lw=0)
    axes.plot(*mid.T, color=MUTED, lw=1, ls=(0, (4, 3)))
    axes.fill(*inner.T, color="#f6dfa6", lw=0, zorder=3)
    for mirror in (1, -1):
        for line in flux_lines([13, 30, 65, 150]) * [1, mirror]:
            axes.plot(*line.T, color=ORANGE, lw=0.9, alpha=0.7)
    arrow(axes, np.array([-3.5, 0]), np.array([3.5, 0]), INK, lw=2.6)
    d_m, delta, line_deg = reading()
    arrow(axes, DRONE, DRONE + ray(HEADING_DEG, 20), INK)
    arrow(axes, DRONE, DRONE + ray(line_deg, 20), BLUE, lw=2.6)
    arrow(axes, DRONE, DRONE - ray(line_deg, 12), BLUE, lw=1.6, ls=(0, (2, 2)))
    axes.plot(*np.array([DRONE, [0, 0]]).T, color=GREEN, lw=1.4, ls=(0, (5, 3)))
    first, second = sorted((90 - HEADING_DEG, 90 - line_deg))
    axes.add_patch(Arc(tuple(DRONE), 28, 28, theta1=first, theta2=second, color=BLUE, lw=1.6))
    axes.scatter(*DRONE, s=120, color=INK, zorder=7)
    tip = DRONE + ray(line_deg, 20)
    label(axes, (float(tip[0]) + 2, float(tip[1]) + 2.5), f"δ = {delta:+.0f}°, along the flux line", BLUE)
    label(axes, (DRONE[0] - 6.5, DRONE[1] + 17), "heading")
    label(axes, (DRONE[0] - 10, DRONE[1] - 1), f"receiver\nd = {d_m:.1f} m")
    label(axes, (-9, -16), f"true range {math.hypot(*DRONE):.1f} m", GREEN, ha="left")
    label(axes, (10, 4.5), "transmitter (dipole)")
    label(axes, (0, 33), "flux line", ORANGE)
    label(axes, (36, -17), "mid zone: d and δ", MUTED)
    label(axes, (5.5, -3.6), "inner zone: d alone", MUTED, ha="left")
    label(axes, (44, 46), "outer zone: nothing heard", MUTED)


def frame(axes: Axes) -> None:
    """Draw one frame with its four slots."""
    axes.set(xlim=(0, 100), ylim=(0, 24), xticks=[], yticks=[])
    axes.spines[["left", "bottom"]].set_visible(False)
    axes.add_patch(FancyBboxPatch((1, 1), 98, 14, boxstyle="round,pad=0,rounding_size=1.5", fc="none", ec=MUTED))
    d_m, delta, _ = reading()
    texts = [
        f"id 1, mid\n{100 * d_m:.0f} cm, {delta:+.0f}°",
        "id 4, mid\n4410 cm, −12°",
        "empty\n−1, −1",
        "empty\n−1, −1",
    ]
    label(axes, (9, 8), "one frame:\nnumber, status", MUTED, size=9.5)
    for n, text in enumerate(texts):
        colour = FAINT if n > 1 else BLUE
        axes.add_patch(
            FancyBboxPatch(
                (18 + 20.3 * n, 2.5), 18.5, 11, boxstyle="round,pad=0,rounding_size=1", fc="white", ec=colour, lw=1.5
            )
        )
        axes.text(27.2 + 20.3 * n, 8, text, ha="center", va="center", fontsize=9.5, color=MUTED if n > 1 else INK)
        axes.text(27.2 + 20.3 * n, 18, f"slot {n + 1}", ha="center", va="center", fontsize=10, color=MUTED)
    axes.text(1, 18, "4 channels:", fontsize=10, color=MUTED, va="center")


def concepts(figure: Figure) -> None:
    figure.set_figheight(8.4)
    above, below = figure.subplots(2, height_ratios=[5.2, 1.1])
    plan(above)
    frame(below)


def wiring(figure: Figure) -> None:
    """Draw computer, adapter and flight controller, with the wires between them."""
    figure.set_figheight(4.1)
    axes = figure.add_subplot()
    axes.set(xlim=(0, 100), ylim=(0, 44), xticks=[], yticks=[])
    axes.spines[["left", "bottom"]].set_visible(False)
    boxes = {"computer\nwith arva-hil": (2, 10, 20, 26), "USB-serial\nadapter, 3.3 V": (38, 4, 22, 16),
             "flight controller": (76, 2, 22, 38)}  # fmt: skip
    for text, (x, y, w, h) in boxes.items():
        axes.add_patch(
            FancyBboxPatch((x, y), w, h, boxstyle="round,pad=0,rounding_size=1.5", fc="#f4f6f8", ec=INK, lw=1.4)
        )
        axes.text(
            x + w / 2 - 2 * ("adapter" in text),
            y + h - 4.5 if "flight" in text else y + h / 2,
            text,
            ha="center",
            va="center",
            fontsize=10.5,
        )
    axes.plot([22, 76], [32, 32], color=INK, lw=3)
    label(axes, (49, 35), "USB: MAVLink (position, attitude)")
    label(axes, (87, 30), "USB", MUTED)
    axes.plot([22, 38], [12, 12], color=INK, lw=3)
    label(axes, (30, 15), "USB")
    for y, ours, theirs, colour, ls in (
        (16, "TX", "RX", BLUE, "-"),
        (12, "RX", "TX", MUTED, (0, (3, 2))),
        (8, "GND", "GND", INK, "-"),
    ):
        axes.plot([60, 76], [y, y], color=colour, lw=2.2, ls=ls)
        axes.text(59.2, y, ours, ha="right", va="center", fontsize=9, color=colour)
        axes.text(76.8, y, theirs, ha="left", va="center", fontsize=9, color=colour)
    label(axes, (68, 18.6), "frames", BLUE, size=9.5)
    label(axes, (68, 3.6), "dashed: only for\ncommands", MUTED, size=9)
    label(axes, (88.5, 12), "TELEM2 or\nanother UART", MUTED, size=9.5)
    axes.text(2, 1, "VCC stays open", color=MUTED, fontsize=9.5)


def frame_bytes(figure: Figure) -> None:
    """Draw the bytes of a frame with one channel."""
    figure.set_figheight(2.1)
    axes = figure.add_subplot()
    sent = encode(Frame(sequence=42, status=SYNTHETIC, channels=(Channel(id=1, zone=MID, d=1234, delta=17),)))
    axes.set(xlim=(-0.2, len(sent) + 0.2), ylim=(-2.3, 2.4), xticks=[], yticks=[])
    axes.spines[["left", "bottom"]].set_visible(False)
    parts = [("sync", 2), ("version", 1), ("length", 1), ("number", 1), ("status", 1), ("n", 1), ("id", 1),
             ("zone", 1), ("d", 2), ("δ", 2), ("CRC", 2)]  # fmt: skip
    values = ["", "1", "9", "42", "synthetic", "1 channel", "1", "mid", "1234 cm", "17°", ""]
    at = 0
    for n, ((name, size), value) in enumerate(zip(parts, values, strict=True)):
        colour = BLUE if 6 <= n <= 9 else MUTED
        for k in range(at, at + size):
            box = FancyBboxPatch(
                (k + 0.06, 0), 0.88, 1, boxstyle="round,pad=0,rounding_size=0.12", fc="white", ec=colour
            )
            axes.add_patch(box)
            axes.text(k + 0.5, 0.5, f"{sent[k]:02X}", ha="center", va="center", family="DejaVu Sans Mono", fontsize=11)
        axes.text(at + size / 2, 1.5, name, ha="center", va="center", color=colour, fontsize=10)
        axes.text(at + size / 2, -0.5 - 0.7 * (n % 2), value, ha="center", va="center", color=colour, fontsize=9.5)
        at += size
    axes.text(9.5, -2.0, "slot 1", ha="center", va="center", color=BLUE, fontsize=10)
    axes.plot([7.1, 12.9], [-1.65, -1.65], color=BLUE, lw=1)


def flown(strategy: str) -> list[tuple[float, float]]:
    """Fly the demo with a strategy; return the places flown over, east and north of the take-off point, m."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "arva_hil", "demo", "--speed", "max", "--strategy", strategy]
        path = {**os.environ, "PYTHONPATH": str(Path(__file__).parent.parent / "docs/examples")}
        subprocess.run([*command, "--record", f"{folder}/record"], env=path, capture_output=True, check=True)
        with open(f"{folder}/record/search.csv", encoding="utf-8", newline="") as table:
            return [(float(row["east_m"]), float(row["north_m"])) for row in csv.DictReader(table)]


def paths(figure: Figure) -> None:
    """Draw the paths of the lesson's strategy and of the default one."""
    figure.set_figheight(5.6)
    axes = figure.add_subplot()
    axes.set(aspect="equal", xlabel="east, m", ylabel="north, m", xlim=(-12, 22), ylim=(-2, 26))
    for name in ("follow:Follow", "estimate"):
        axes.plot(*zip(*flown(name), strict=True), lw=1.8, label=name)
    axes.plot(0, 0, "s", color=MUTED, label="take-off point")
    axes.plot(5, 20, "*", ms=14, color=INK, label="transmitter", zorder=5)
    axes.legend(loc="lower right")


FIGURES: Final[dict[str, Callable[[Figure], None]]] = {
    "concepts": concepts,
    "wiring": wiring,
    "frame": frame_bytes,
    "paths": paths,
}

if __name__ == "__main__":
    draw_all(FIGURES, __doc__)
