"""The picture of a comparison: readings over time, residuals over range, and over the angle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arva_hil.records.comparing.comparison import Comparison, wrapped_half
from arva_hil.records.pictures.style import BLUE, GREY, RED, Format, figure, plain, saved, styled, thinned


def drawn(comparisons: Sequence[Comparison], names: tuple[str, str], format: Format) -> bytes:
    """Draw a row of three pictures for each transmitter. Raises ModuleNotFoundError without matplotlib."""
    with styled():
        made = figure(13.0, 3.6 * max(len(comparisons), 1))
        for row, c in zip(made.subplots(max(len(comparisons), 1), 3, squeeze=False), comparisons, strict=False):
            over_time, over_range, over_angle = row
            some = thinned(len(c.time_s))
            for values, colour, marker, name in (
                (c.first_m, BLUE, "o", names[0]),
                (c.second_m, RED, "x", names[1]),
            ):
                over_time.plot(c.time_s[some], values[some], marker, ms=2.5, ls="none", color=colour, label=plain(name))
            of = "" if c.id is None else f" of transmitter {c.id}"
            over_time.set(xlabel="time, s", ylabel="m", title=f"d{of}")
            over_time.set_ylim(bottom=0)
            over_time.legend(loc="best")
            away = np.where(np.isfinite(c.range_m), c.range_m, c.second_m)[some]
            over_range.axhline(0, color=GREY, lw=0.8)
            over_range.plot(away, (c.first_m - c.second_m)[some], "o", ms=2.5, ls="none", color=BLUE)
            over_range.set(xlabel="true range, m", ylabel="m", title="d: first minus second")
            turn = wrapped_half(c.first_deg - c.second_deg)[some]
            over_angle.axhline(0, color=GREY, lw=0.8)
            over_angle.plot(c.second_deg[some], turn, "o", ms=2.5, ls="none", color=BLUE)
            over_angle.set(xlabel="δ of the second, degrees", ylabel="degrees", title="δ: first minus second")
        return saved(made, format)
