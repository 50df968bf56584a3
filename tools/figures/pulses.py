"""Draws the pictures of docs/explanation/pulsed.md into tools/figures.

python -m tools figures pulses [--out DIR]
"""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.figure import Figure

from arva_hil.model.field.keying import KEYING_CLASSES
from arva_hil.model.receiver.display import Display
from arva_hil.model.receiver.listening import normals
from tools.figures.paper import MUTED, draw_all, title
from tools.figures.sets import AXIS, EQUATOR, KAPPA_EQ, field, options, sets

SIGMA_NA_M: Final = 0.65
THRESHOLD_NA_M: Final = 2.25


def bounce(figure: Figure) -> None:
    """Draw the readings of single pulses, on the axis and beside it."""
    figure.set_figheight(6)
    axes = figure.add_subplot()
    chosen = options(noise_na_m=SIGMA_NA_M, threshold_na_m=THRESHOLD_NA_M)
    display, draws, random = Display(chosen, KAPPA_EQ), normals(1), np.random.default_rng(1)
    for n, (name, way) in enumerate((("on the axis", AXIS), ("beside", EQUATOR))):
        places = random.uniform(2, 90, 2000)
        shown = []
        for metres in places.tolist():
            signal = field(metres * np.asarray(way))
            x, y, z = (signal + SIGMA_NA_M / chosen.scale_na_m * np.array(next(draws))).tolist()
            one = display.shown(0, (x, y, z))
            shown.append(one.d_cm / 100 if one else -1.0 - n)
        axes.scatter(places, shown, 5, lw=0, alpha=0.6, color=f"C{n}", label=name)
    axes.plot([0, 90], [0, 90], color=MUTED, lw=1, ls=(0, (4, 3)))
    axes.set(xlim=(0, 90), ylim=(-4, 80), xlabel="true distance, m", ylabel="d, m")
    title(
        axes, "d of single pulses with noise of 0.65 nA/m", "Below zero: nothing shown. The line is d = true distance."
    )
    figure.legend(loc="outside lower center", ncols=2, markerscale=4)


def overlap(figure: Figure) -> None:
    """Draw the pulses of four people's sets, of two classes."""
    figure.set_figheight(5)
    for axes, name in zip(figure.subplots(2, sharex=True), ("analogue", "modern"), strict=True):
        every = [one.pulses(0.0, 20.0) for one in sets(KEYING_CLASSES[name], 4, 3)]
        for n, pulses in enumerate(every):
            lengths = pulses.ends - pulses.starts
            axes.broken_barh(list(zip(pulses.starts, lengths, strict=True)), (n + 0.6, 0.8), color=f"C{n}")
        axes.set(xlim=(0, 20), yticks=range(1, 5), ylabel=name)
    axes.set_xlabel("time, s")
    figure.suptitle("Pulses of four sets", x=0.01, ha="left")


PICTURES: Final = {"pulsed_distance": bounce, "pulsed_overlap": overlap}


def main() -> None:
    draw_all(PICTURES, __doc__)
