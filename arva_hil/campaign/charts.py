"""The charts of a campaign's report. Only `draw` needs matplotlib."""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from arva_hil.campaign.results import Difference, TrialRow, differences, groups, wilson
from arva_hil.records.pictures.style import GREY, PALETTE, SCREEN, Format, Print, plain, saved, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STYLE: Final = {
    "font.size": 10,
    "legend.fontsize": 10,
    "legend.frameon": False,
    "text.color": "#1d2733",
    "axes.labelcolor": "#1d2733",
    "xtick.color": GREY,
    "ytick.color": GREY,
}
_SIZE: Final = (5.2, 3.3)
_BANDS: Final = 6  # bands of a number with many values, with as many runs in each
_VALUES: Final = 12  # draw at most this many values one by one
_NUMBERS: Final = {
    "distance_m": "distance from take-off to the transmitter, m",
    "take_off_m": "take-off height, m",
    "wind_m_s": "wind, m/s",
    "gps_noise_m": "GPS noise, m",
}
_LEAST_ERROR_M: Final = 0.001  # smallest error on the logarithmic axis


def colours(strategies: Iterable[str]) -> dict[str, str]:
    """Return a colour for each strategy, also distinct for the colour-blind (M. Okabe, K. Ito, 2008)."""
    return {name: PALETTE[n % len(PALETTE)] for n, name in enumerate(dict.fromkeys(strategies))}


def draw(rows: Sequence[TrialRow], success_m: float, format: Format = "svg", form: Print = SCREEN) -> dict[str, bytes]:
    """Return the picture of each chart by its caption. Raises ImportError without matplotlib."""
    kinds: dict[str, Callable[[Axes, Sequence[TrialRow], float], None]] = {
        "Success, with its 95 % confidence interval": _success,
        "Time until the transmitter is found: share of all runs": _time,
        "Error of the place reported: share of all runs": _error,
    }
    for column, label in _NUMBERS.items():
        if len(groups(rows, column)) > (_VALUES if column == "distance_m" else 2):
            kinds[f"Success by {label.partition(',')[0]}"] = functools.partial(_by_number, column)
    if paired := differences(rows, success_m):
        kinds["Differences on the same trials, with 95 % intervals"] = functools.partial(_differences, paired)
    drawn = {}
    with styled({**_STYLE, **form.style}):
        for caption, plot in kinds.items():
            made = form.figure(*_SIZE)
            axes = made.add_subplot()
            plot(axes, rows, success_m)
            handles, labels = axes.get_legend_handles_labels()
            if labels:
                made.legend(
                    handles, labels, loc="outside upper center", ncols=min(len(labels), 2 if form.width_in else 4)
                )
            drawn[caption] = saved(made, format, transparent=format == "svg")  # the page may be dark
    return drawn


def _success(axes: Axes, rows: Sequence[TrialRow], success_m: float) -> None:
    """Draw a line for each scenario, and one for all of them if there are several."""
    lines = {str(name): some for (name,), some in groups(rows, "scenario").items()}
    if len(lines) > 1:
        lines["all"] = list(rows)
    shades = colours(row.strategy for row in rows)
    for n, (strategy, colour) in enumerate(shades.items()):
        each = [[row for row in some if row.strategy == strategy] for some in lines.values()]
        at = [line + _aside(n, len(shades)) for line, mine in enumerate(each) if mine]
        rates, *arms = zip(*(_rate(mine, success_m) for mine in each if mine), strict=True)
        axes.errorbar(rates, at, xerr=arms, fmt="o", ms=5, lw=2, color=colour, label=strategy)
    axes.set(xlim=(-2, 102), xlabel="success, %", ylim=(len(lines) - 0.5, -0.5))
    axes.set_yticks(range(len(lines)), ["\n".join(map(plain, textwrap.wrap(line, 20))) for line in lines])
    axes.grid(visible=False, axis="y")


def _time(axes: Axes, rows: Sequence[TrialRow], success_m: float) -> None:
    most = 1.1 * max((row.time_s for row in rows if row.success(success_m)), default=1.0)
    for strategy, colour, mine in _each(rows):
        _climb(axes, [row.time_s for row in mine if row.success(success_m)], len(mine), 0.0, most, strategy, colour)
    axes.set(xlim=(0, most), xlabel="time, s")


def _error(axes: Axes, rows: Sequence[TrialRow], success_m: float) -> None:
    most = max([2 * success_m, *(row.error_m for row in rows if row.error_m is not None)])
    axes.axvline(success_m, color=GREY, lw=1, ls=":")
    for strategy, colour, mine in _each(rows):
        errors = [max(row.error_m, _LEAST_ERROR_M) for row in mine if row.error_m is not None]
        _climb(axes, errors, len(mine), _LEAST_ERROR_M, most, strategy, colour)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set(xlim=(_LEAST_ERROR_M, most), xlabel=f"error, m (dotted: a success, {success_m:g} m)")


def _differences(paired: Sequence[Difference], axes: Axes, rows: Sequence[TrialRow], success_m: float) -> None:
    """Draw the difference of each strategy's success rate to that of the first strategy."""
    shades = colours(row.strategy for row in rows)
    axes.axvline(0, color=GREY, lw=1, ls=":")
    for n, one in enumerate(paired):
        mean, low, high = (100 * x for x in one.success)
        axes.errorbar(mean, n, xerr=[[mean - low], [high - mean]], fmt="o", ms=5, lw=2, color=shades[one.strategy])
    axes.set(ylim=(len(paired) - 0.5, -0.5), xlabel=f"success, points more than {paired[0].other}")
    axes.set_yticks(range(len(paired)), [one.strategy for one in paired])
    axes.grid(visible=False, axis="y")


def _by_number(column: str, axes: Axes, rows: Sequence[TrialRow], success_m: float) -> None:
    """Draw a point for each value of a column, or for each range of values if there are many."""
    known = [row for row in rows if getattr(row, column) is not None]
    values = np.unique([getattr(row, column) for row in known])
    if len(values) > _VALUES:
        edges = np.quantile([getattr(row, column) for row in known], np.linspace(0, 1, _BANDS + 1))
        values = (edges[:-1] + edges[1:]) / 2
        band = {id(row): int(np.searchsorted(edges[1:-1], getattr(row, column))) for row in known}
    else:
        band = {id(row): int(np.searchsorted(values, getattr(row, column))) for row in known}
    shades = colours(row.strategy for row in rows)
    width = float(np.diff(values).min()) / 3
    for n, (strategy, colour, mine) in enumerate(_each(known)):
        inside = [[row for row in mine if band[id(row)] == at] for at in range(len(values))]
        at = [value + _aside(n, len(shades)) * width for value, some in zip(values, inside, strict=True) if some]
        rates, *arms = zip(*(_rate(some, success_m) for some in inside if some), strict=True)
        axes.errorbar(at, rates, yerr=arms, fmt="o-", ms=5, lw=1.5, color=colour, label=strategy)
    axes.set(ylim=(-3, 103), ylabel="success, %", xlabel=_NUMBERS[column])


def _climb(axes: Axes, values: list[float], runs: int, low: float, high: float, strategy: str, colour: str) -> None:
    """Draw the percentage of all runs that have a value up to x, from `low` to `high`."""
    x = [low, *sorted(values), high]
    y = [100 * n / runs for n in (*range(len(values) + 1), len(values))]
    axes.step(x, y, where="post", color=colour, lw=2, label=strategy)
    axes.set(ylim=(0, 103), ylabel="runs, %")


def _each(rows: Sequence[TrialRow]) -> list[tuple[str, str, list[TrialRow]]]:
    shades = colours(row.strategy for row in rows)
    return [(str(name), shades[name], mine) for (name,), mine in groups(rows, "strategy").items()]


def _aside(n: int, count: int) -> float:
    """Return the offset of the n-th mark at one place, as a fraction of the distance between places."""
    return (n - (count - 1) / 2) * min(0.2, 0.8 / count)


def _rate(rows: Sequence[TrialRow], success_m: float) -> tuple[float, float, float]:
    """Return the success rate, and the lengths of its error bars: down and up to the ends of its interval.

    In percent.
    """
    successes = sum(row.success(success_m) for row in rows)
    low, high = wilson(successes, len(rows))
    rate = successes / len(rows)
    return 100 * rate, 100 * max(rate - low, 0.0), 100 * max(high - rate, 0.0)
