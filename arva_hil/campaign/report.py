"""The report of a campaign: statistics of each strategy with their uncertainty, as text and as an HTML page."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator, Sequence
from typing import Final

from arva_hil.campaign import charts
from arva_hil.campaign.results import Errors, Pair, Summary, TrialRow, differences, groups, summary
from arva_hil.campaign.trial import FOUND
from arva_hil.records.report.html import render
from arva_hil.safe_text import table_lines

_COLUMNS: Final = {  # column → name of several values, name of the axis
    "strategy": ("strategies", ""),
    "seed": ("seeds", None),
    "scenario": ("scenarios", "scenario"),
    "noise": ("kinds of noise", "noise"),
    "wind_m_s": ("winds", "wind, m/s"),
    "gps_noise_m": ("levels of GPS noise", "GPS noise, m"),
    "take_off_m": ("take-off heights", "take-off height, m"),
    "drones": ("numbers of drones", "drones"),
}
_PLACES: Final = ("±, m", "in 1σ / 2σ", "false")
_EARTH, _VEHICLE = ("error on Earth, m", *_PLACES), ("error from the drone, m", *_PLACES)
_HEAD: Final = ("runs", "successes", "rate", "95 % confidence", "time, s", "path, m", *_EARTH, *_VEHICLE)


def text(rows: Sequence[TrialRow], success_m: float) -> str:
    """Return a short table for a terminal: one line for each strategy and number of drones."""
    lines = table_lines(_table(rows, success_m))
    far = found_far(rows, success_m)
    foot = (
        f"success: the place reported is within {success_m:g} m; time and path: of successes; a / b: median / 90 %; "
        "false: found, but more than 2 m / 3σ off"
    )
    return "\n".join([*lines, foot, *_compared(rows, success_m), *([far] if far else [])])


def _table(rows: Sequence[TrialRow], success_m: float) -> list[tuple[str, ...]]:
    """Return the head, and a line for each strategy and number of drones."""
    parts = groups(rows, "strategy", "drones")
    numbered = len({drones for _, drones in parts}) > 1
    each = (
        (f"{name}, {drones} drone{'s' * (drones > 1)}" if numbered else str(name), *_cells(summary(some, success_m)))
        for (name, drones), some in parts.items()
    )
    return [("strategy", *_HEAD), *each]


def latex(rows: Sequence[TrialRow], success_m: float) -> str:
    """Return the same table and the differences on the same trials, for LaTeX with booktabs."""
    lines = [" & ".join(map(_escaped, row)) + r" \\" for row in _table(rows, success_m)]
    made = [
        r"\begin{tabular}{l" + "r" * len(_HEAD) + "}",
        r"\toprule",
        lines[0],
        r"\midrule",
        *lines[1:],
        r"\bottomrule",
        r"\end{tabular}",
    ]
    made += [f"% {line}" for line in _compared(rows, success_m)]
    return "\n".join([*made, f"% success: the place reported is within {success_m:g} m; a / b: median / 90 %", ""])


def _compared(rows: Sequence[TrialRow], success_m: float) -> Iterator[str]:
    """Yield the difference of each strategy to the first one on the same trials, with 95 % intervals."""
    for one in differences(rows, success_m):
        rate = _interval(*(100 * x for x in one.success), form="+.1f", unit="points")
        time = _interval(*one.time_s, form="+.0f", unit="s") if one.time_s else "of fewer than two pairs of successes"
        yield f"{one.strategy} against {one.other} on {one.trials} trials: success {rate}, time {time}"


def _escaped(text: str) -> str:
    text = re.sub(r"([&%$#_{}])", r"\\\1", text).replace("–", "--").replace("<", "$<$")
    return text.replace("±", r"$\pm$").replace("σ", r"$\sigma$")


def _interval(mean: float, low: float, high: float, *, form: str, unit: str) -> str:
    return f"{mean:{form}} {unit}, 95 % from {low:{form}} to {high:{form}}"


def found_far(rows: Sequence[TrialRow], success_m: float) -> str:
    """Return the reason why some runs that ended with "found" are no success; "" without one."""
    found = [row for row in rows if row.outcome == FOUND]
    far = sum(not row.success(success_m) for row in found)
    return (
        f"{far} of {len(found)} runs that ended with found are no success: more than {success_m:g} m off" if far else ""
    )


def page(title: str, rows: Sequence[TrialRow], success_m: float) -> str:
    """Return the report as one self-contained HTML file."""
    count = {name: len(groups(rows, name)) for name in _COLUMNS}
    axes = [(name, label) for name, (_, label) in _COLUMNS.items() if label == "" or (label and count[name] > 1)]
    try:
        drawn = {name: base64.b64encode(svg).decode() for name, svg in charts.draw(rows, success_m).items()}
    except ImportError:  # no matplotlib
        drawn = None
    return render(
        "arva_hil.campaign",
        "report.html",
        title=title,
        trials=len(rows),
        crossed=" × ".join(f"{count[name]} {several}" for name, (several, _) in _COLUMNS.items() if count[name] > 1),
        success_m=success_m,
        found_far=found_far(rows, success_m),
        compared=list(_compared(rows, success_m)),
        head=_HEAD,
        cells=_cells,
        colours=charts.colours(row.strategy for row in rows),
        tables=[(label, list(_parts(rows, name, success_m))) for name, label in axes],
        charts=drawn,
        outcomes=sorted(groups(rows, "outcome").items(), key=lambda pair: -len(pair[1])),
        by_outcome=groups(rows, "outcome", "strategy"),
    )


def _parts(rows: Sequence[TrialRow], column: str, success_m: float) -> Iterator[tuple[str, dict[str, Summary]]]:
    """Yield each value of a column, with the summary of each strategy for it.

    The column `strategy` gives one part with all.
    """
    for (value,), some in ({("",): rows} if column == "strategy" else groups(rows, column)).items():
        name = f"{value:g}" if isinstance(value, float) else str(value)
        yield name, {strategy: summary(mine, success_m) for (strategy,), mine in groups(some, "strategy").items()}


def _cells(s: Summary) -> tuple[str, ...]:
    low, high = s.interval
    return (
        str(s.runs),
        str(s.successes),
        f"{100 * s.rate:.1f} %",
        f"{100 * low:.1f}–{100 * high:.1f} %",
        _pair(s.time_s, ".0f"),
        _pair(s.path_m, ".0f"),
        *_of_places(s.earth),
        *_of_places(s.vehicle),
    )


def _of_places(errors: Errors) -> tuple[str, ...]:
    return (
        _pair(errors.error_m, ".2f"),
        _pair(errors.sigma_m, ".2f"),
        "–" if errors.inside is None else " / ".join(f"{100 * share:.0f}" for share in errors.inside) + " %",
        f"{errors.false[0]} / {errors.false[1]}",
    )


def _pair(pair: Pair | None, form: str) -> str:
    return "–" if pair is None else f"{_figure(pair[0], form)} / {_figure(pair[1], form)}"


def _figure(value: float, form: str) -> str:
    """Return a number of at least 0, never as 0.00."""
    text = f"{value:{form}}"
    return "<0.01" if text == "0.00" else text
