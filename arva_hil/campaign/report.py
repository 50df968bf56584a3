"""What a campaign says of each strategy: sums with their uncertainty, as text and as one page of HTML."""

from __future__ import annotations

import base64
import html
from collections.abc import Callable, Sequence
from typing import Final

from arva_hil import __version__
from arva_hil.campaign import charts
from arva_hil.campaign.results import Row
from arva_hil.campaign.summary import Pair, Summary, groups, summary

__all__ = ["GENERATOR", "page", "text"]

GENERATOR: Final = '<meta name="generator" content="arva-hil campaign">'

_AXES: Final = {
    "scenario": "scenario",
    "noise": "noise",
    "wind_m_s": "wind, m/s",
    "gps_noise_m": "GPS noise, m",
    "take_off_m": "take-off height, m",
}
_SEVERAL: Final = {
    "strategy": "strategies",
    "seed": "seeds",
    "scenario": "scenarios",
    "noise": "kinds of noise",
    "wind_m_s": "winds",
    "gps_noise_m": "levels of GPS noise",
    "take_off_m": "take-off heights",
}
_HEAD: Final = ("runs", "successes", "rate", "95 % confidence", "time, s", "path, m", "error, m")


def text(rows: Sequence[Row], success_m: float) -> str:
    """A short table for a terminal: one line a strategy."""
    table: list[tuple[str, ...]] = [("strategy", *_HEAD)]
    table += [(str(name), *_cells(summary(some, success_m))) for (name,), some in groups(rows, "strategy").items()]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = []
    for first, *others in table:
        cells = [first.ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True))]
        lines.append("  ".join(cells).rstrip())
    foot = f"success: the place reported is within {success_m:g} m; time and path: of successes; a / b: median / 90 %"
    return "\n".join([*lines, foot])


def page(title: str, rows: Sequence[Row], success_m: float) -> str:
    """The report, one HTML file with all that belongs to it."""
    colours = charts.colours(row.strategy for row in rows)
    axes = {name: label for name, label in _AXES.items() if len(groups(rows, name)) > 1}
    counts = {what: len(groups(rows, name)) for name, what in _SEVERAL.items()}
    crossed = " × ".join(f"{count} {what}" for what, count in counts.items() if count > 1)
    parts = [
        f"<h1>{html.escape(title)}</h1>",
        f"<p class=sub>{len(rows)} trials{crossed and ': ' + crossed}. "
        f"Success: the place reported is within {success_m:g} m of the transmitter.</p>",
        _table("By strategy", ["strategy"], rows, success_m, colours),
        _charts(rows, success_m),
        *(_table(f"By {label}", [name, "strategy"], rows, success_m, colours) for name, label in axes.items()),
        _outcomes(rows),
        f"<p class=foot>a / b: median / 90th percentile; time and path of successful runs, from the end of take-off; "
        "error of every place reported. Confidence: Wilson's interval. A run that failed by an error of the program "
        f"counts as no success. arva-hil {__version__}</p>",
    ]
    return _PAGE.format(title=html.escape(title), generator=GENERATOR, body="\n".join(parts))


def _cells(s: Summary) -> tuple[str, ...]:
    low, high = s.interval
    return (
        str(s.runs),
        str(s.successes),
        f"{100 * s.rate:.1f} %",
        f"{100 * low:.1f}–{100 * high:.1f} %",
        _pair(s.time_s, ".0f"),
        _pair(s.path_m, ".0f"),
        _pair(s.error_m, ".2f"),
    )


def _table(title: str, columns: list[str], rows: Sequence[Row], success_m: float, colours: dict[str, str]) -> str:
    head = "".join(f"<th>{html.escape(_AXES.get(name, name))}</th>" for name in columns)
    head += "".join(f"<th class=n>{name}</th>" for name in _HEAD[:4]) + "<th></th>"
    head += "".join(f"<th class=n>{name}</th>" for name in _HEAD[4:])
    by = groups(sorted(rows, key=_rank(rows, columns)), *columns)
    body, above = [], None
    for values, some in by.items():
        s = summary(some, success_m)
        colour = colours[values[-1]]
        first = "".join(f"<td>{html.escape(_say(value)) if value != above else ''}</td>" for value in values[:-1])
        first += f'<td><i style="background:{colour}"></i>{html.escape(values[-1])}</td>'
        cells = [f"<td class=n>{cell}</td>" for cell in _cells(s)]
        rule = " class=rule" if len(values) > 1 and values[0] != above else ""
        body.append(f"<tr{rule}>{first}{''.join(cells[:4])}<td>{_bar(s, colour)}</td>{''.join(cells[4:])}</tr>")
        above = values[0] if len(values) > 1 else None
    return f"<h2>{html.escape(title)}</h2><table><tr>{head}</tr>{''.join(body)}</table>"


def _charts(rows: Sequence[Row], success_m: float) -> str:
    try:
        drawn = charts.draw(rows, success_m)
    except ImportError:
        return (
            "<p class=note>Charts need matplotlib: <code>pip install 'arva-hil[plots]'</code>, then run it again.</p>"
        )
    figures = [
        f'<figure><img alt="{name}" src="data:image/svg+xml;base64,{base64.b64encode(svg).decode()}">'
        f"<figcaption>{name}</figcaption></figure>"
        for name, svg in drawn.items()
    ]
    return f"<div class=charts>{''.join(figures)}</div>"


def _outcomes(rows: Sequence[Row]) -> str:
    """How the runs ended, with how many of each strategy."""
    names = [name for (name,) in groups(rows, "strategy")]
    head = "<th>outcome</th>" + "".join(f"<th class=n>{html.escape(name)}</th>" for name in names)
    by = groups(rows, "outcome", "strategy")
    body = [
        f"<tr><td>{html.escape(outcome)}</td>"
        + "".join(f"<td class=n>{len(by.get((outcome, name), ())) or ''}</td>" for name in names)
        + "</tr>"
        for (outcome,), _ in sorted(groups(rows, "outcome").items(), key=lambda pair: -len(pair[1]))
    ]
    return f"<h2>How the runs ended</h2><table class=long><tr>{head}</tr>{''.join(body)}</table>"


def _bar(s: Summary, colour: str) -> str:
    """A success rate as a point on a line from 0 to 100 %, its interval beside it."""
    low, high = (100 * end for end in s.interval)
    return (
        f'<svg class=bar viewBox="-2 0 104 10" preserveAspectRatio="none"><path d="M0 5H100" stroke="#e3e6ea"/>'
        f'<path d="M{low:.2f} 5H{high:.2f}" stroke="{colour}" stroke-width="5" opacity=".35"/>'
        f'<path d="M{100 * s.rate:.2f} 1V9" stroke="{colour}" stroke-width="1.6"/></svg>'
    )


def _rank(rows: Sequence[Row], columns: list[str]) -> Callable[[Row], tuple[int, ...]]:
    """A key that sorts rows by the first appearance of their value in each column."""
    first = [{value: n for n, (value,) in enumerate(groups(rows, column))} for column in columns]
    return lambda row: tuple(order[getattr(row, column)] for order, column in zip(first, columns, strict=True))


def _say(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _pair(pair: Pair | None, form: str) -> str:
    return "–" if pair is None else f"{pair[0]:{form}} / {pair[1]:{form}}"


_PAGE: Final = """\
<!doctype html>
<html lang="en"><head><meta charset="utf-8">{generator}
<meta name="viewport" content="width=device-width, initial-scale=1"><title>{title}</title>
<style>
body {{ font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: #1d2733; max-width: 72rem;
  margin: 2.5rem auto; padding: 0 1.5rem }}
h1 {{ font-size: 1.7rem; margin: 0 }} h2 {{ font-size: 1.1rem; margin: 2.4rem 0 .6rem }}
.sub, .foot {{ color: #5b6876; margin: .3rem 0 0 }} .foot {{ font-size: .85rem; margin-top: 2.5rem }}
.note {{ background: #fff6dc; padding: .6rem 1rem; border-radius: .4rem }}
table {{ border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums }}
th {{ text-align: left; font-weight: 500; font-size: .85rem; color: #5b6876; border-bottom: 1px solid #b9c1ca }}
th, td {{ padding: .28rem .6rem; white-space: nowrap }} .n {{ text-align: right }}
.long td:first-child {{ white-space: normal }} .rule td {{ border-top: 1px solid #e3e6ea }}
i {{ display: inline-block; width: .7rem; height: .7rem; border-radius: .2rem; margin-right: .5rem }}
.bar {{ width: 9rem; height: .9rem; vertical-align: middle }}
.charts {{ display: grid; grid-template-columns: repeat(auto-fit, minmax(28rem, 1fr)); gap: 1.2rem; margin-top: 2rem }}
figure:last-child:nth-child(odd) {{ grid-column: 1 / -1; width: 50%; justify-self: center }}
figure {{ box-sizing: border-box; margin: 0; border: 1px solid #e3e6ea; border-radius: .5rem; padding: .8rem }}
img {{ width: 100% }}
figcaption {{ color: #5b6876; font-size: .9rem; text-align: center }}
</style></head><body>
{body}
</body></html>
"""
