"""The picture of a data sheet: share of frames with a signal, and d, over the true range."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from arva_hil.campaign.range_test.data_sheet import DataSheet, Row
from arva_hil.records.pictures.style import MOST_POINTS, PALETTE, figure, plain, saved, styled, thinned

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BINS: Final = 60
_DASHES: Final = ("-", "--", "-.")
_MARKERS: Final = ("o", "s", "^", "v", "D", "x")


def drawn(sheets: Sequence[DataSheet]) -> bytes:
    """Return a PNG with a row of pictures for each receiver. Raises ModuleNotFoundError without matplotlib."""
    with styled():
        made = figure(11.0, 4.2 * len(sheets))
        for (left, right), sheet in zip(made.subplots(len(sheets), 2, squeeze=False), sheets, strict=True):
            draw_heard(left, sheet)
            draw_distances(right, sheet)
        return saved(made, "png")


def draw_heard(axes: Axes, sheet: DataSheet) -> None:
    """Draw the share of frames with a signal of the transmitter, over its true range; lines where it is stable."""
    farthest = max([1.0, *(m for row in sheet.rows for m in (*row.first_m, *row.stable_m))]) * 1.1
    edges = np.linspace(0.0, farthest, _BINS + 1)
    for n, row in enumerate(sheet.rows):
        range_m, heard = _frames(row)[0], np.isfinite(_frames(row)[1])
        all_, _ = np.histogram(range_m, edges)
        some, _ = np.histogram(range_m[heard], edges)
        there = all_ > 0
        middle = (edges[:-1] + edges[1:])[there] / 2
        colour = PALETTE[n % len(PALETTE)]
        style = _DASHES[n % len(_DASHES)]
        axes.plot(middle, 100 * some[there] / all_[there], color=colour, ls=style, label=row.name)
        if row.mean_m is not None:
            axes.axvline(row.mean_m, color=colour, ls=style, lw=0.9, alpha=0.6)
    of = f" of {plain(sheet.name)}" if sheet.name else ""
    axes.set(xlabel="true range, m", ylabel="frames that contain it, %", ylim=(-3, 103), xlim=(0, farthest))
    axes.set_title(f"Range{of}: vertical lines are first stable signals")
    axes.legend(loc="best")


def draw_distances(axes: Axes, sheet: DataSheet) -> None:
    """Draw d over the true range."""
    highest = 1.0
    for n, row in enumerate(sheet.rows):
        range_m, d_m = _frames(row)
        heard = np.flatnonzero(np.isfinite(d_m))
        heard = heard[thinned(len(heard), MOST_POINTS // len(sheet.rows))]
        marker = _MARKERS[n % len(_MARKERS)]
        axes.plot(
            range_m[heard], d_m[heard], marker, ms=2.5, color=PALETTE[n % len(PALETTE)], ls="none", label=row.name
        )
        highest = max(highest, *range_m[heard].tolist(), 1.0)
    axes.plot([0, highest], [0, highest], color=PALETTE[-1], lw=0.8, label="d = true range")
    axes.set(xlabel="true range, m", ylabel="d, m", title="d in the frames")
    axes.legend(loc="best")


def _frames(row: Row) -> tuple[np.ndarray, np.ndarray]:
    """Return true ranges and d of all frames of all walks."""
    return np.concatenate([w.range_m for w in row.walks]), np.concatenate([w.d_m for w in row.walks])
