"""The data sheet of a range test: the range of a receiver in each coupling, as text, rows and values."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

from arva_hil.campaign.range_test.walk import (
    COUPLINGS,
    HOVER_LOAD,
    Coupling,
    RangePlan,
    Walk,
    detection,
    formula_m,
    walked,
)
from arva_hil.config import Scenario
from arva_hil.safe_text import table_lines

_LEAST_M: Final = 30.0  # least coaxial range that testers accept
_LEAST_SHARE: Final = 0.5  # least share of the coaxial range, turned by 90°


class Row(NamedTuple):
    """The walks in one coupling. `motors`: with running motors."""

    coupling: Coupling
    motors: bool
    walks: Sequence[Walk]

    @property
    def name(self) -> str:
        return self.coupling.name + (", motors on" if self.motors else "")

    @property
    def stable_m(self) -> list[float]:
        """The ranges of the walks that had a stable signal, metres."""
        return [walk.stable_m for walk in self.walks if walk.stable_m is not None]

    @property
    def first_m(self) -> list[float]:
        """The ranges of the first signals, metres."""
        return [walk.first_m for walk in self.walks if walk.first_m is not None]

    @property
    def mean_m(self) -> float | None:
        """Mean range of the first stable signals; None if a walk had none."""
        return statistics.fmean(self.stable_m) if len(self.stable_m) == len(self.walks) else None

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the same."""
        return statistics.stdev(self.stable_m) if len(self.stable_m) > 1 else 0.0


class DataSheet(NamedTuple):
    """The result for one receiver. `name`: its own in the scenario, "" if it is the only one."""

    name: str
    scenario: Scenario
    plan: RangePlan
    rows: Sequence[Row]

    def row(self, coupling: str, *, motors: bool = False) -> Row:
        return next(row for row in self.rows if row.coupling.name == coupling and row.motors == motors)


def measured(scenario: Scenario, plan: RangePlan, name: str = "") -> DataSheet:
    """Walk in every coupling; also with the motors on, if the scenario has their noise."""
    rows = [
        Row(coupling, motors, [walked(scenario, coupling, plan, n, motors=motors) for n in range(plan.walks)])
        for motors in ([False, True] if scenario.receiver.vehicle_noise else [False])
        for coupling in COUPLINGS
    ]
    return DataSheet(name, scenario, plan, rows)


def lines(sheet: DataSheet) -> Iterator[str]:
    """Yield the lines of the sheet."""
    receiver, transmitter, plan = sheet.scenario.receiver, sheet.scenario.transmitters[0], sheet.plan
    of = f" {sheet.name}" if sheet.name else ""
    keyed = f", {transmitter.keying.kind}" if transmitter.keying else ""
    yield (
        f"range test of receiver{of}: model {receiver.model}, {receiver.rate_hz:g} Hz; scenario {sheet.scenario.source}"
    )
    yield f"transmitter {transmitter.id}: strength {transmitter.strength:g}{keyed}"
    yield (
        f"{plan.walks} walks a coupling at {plan.speed_m_s:g} m/s, {plan.height_m:g} m above the transmitter; "
        f"stable: no gap for {plan.stable_s:g} s; seeds from {sheet.scenario.seed} on"
    )
    if any(row.motors for row in sheet.rows):
        yield f"motors on: at {HOVER_LOAD:.0%} of their load, as in a hover"
    yield ""
    head = ("coupling", "first signal", "first stable", "s.d.", "least", "most", "received in")
    yield from table_lines([head, *(_cells(row) for row in sheet.rows)])
    yield ""
    yield from _judged(sheet)


def _cells(row: Row) -> tuple[str, ...]:
    firsts, stables = row.first_m, row.stable_m
    return (
        row.name,
        f"{statistics.fmean(firsts):.1f} m" if firsts else "–",
        f"{statistics.fmean(stables):.1f} m" if stables else "–",
        f"{row.sigma_m:.1f} m" if len(stables) > 1 else "–",
        f"{min(stables):.1f} m" if stables else "–",
        f"{max(stables):.1f} m" if stables else "–",
        f"{len(stables)} of {len(row.walks)}",
    )


def _judged(sheet: DataSheet) -> Iterator[str]:
    """Yield the figures that testers require of a set."""
    for motors in dict.fromkeys(row.motors for row in sheet.rows):
        when = "motors on: " if motors else ""
        coaxial, turned = sheet.row("coaxial", motors=motors), sheet.row("90°", motors=motors)
        if coaxial.mean_m is None:
            yield f"{when}not every coaxial walk had a stable signal"
            continue
        verdict = "enough" if coaxial.mean_m >= _LEAST_M else "too little"
        yield f"{when}coaxial {coaxial.mean_m:.1f} m: {verdict} (testers want {_LEAST_M:g} m or more)"
        if turned.mean_m is None:
            yield f"{when}turned by 90°: not every walk had a stable signal"
        else:
            share = turned.mean_m / coaxial.mean_m
            verdict = "enough" if share >= _LEAST_SHARE else "too little"
            yield f"{when}turned by 90° {share:.0%} of that: {verdict} (testers want {_LEAST_SHARE:.0%} or more)"
        strip_m = formula_m(coaxial.walks)
        if strip_m is None:
            continue
        yield f"{when}search strips of {strip_m:.0f} m: 1.26 × (coaxial mean − 2 s.d.)"
        if sheet.plan.passes:
            widths = strip_m, 1.5 * strip_m, 2 * strip_m
            heard = [f"{detection(sheet.scenario, sheet.plan, w, motors=motors):.1%} at {w:.0f} m" for w in widths]
            yield f"{when}flights along strips that receive it, at random places and attitudes: {', '.join(heard)}"


def as_dict(sheet: DataSheet) -> dict[str, Any]:
    """Return the sheet for a program: ranges in metres, one for each walk, None without a stable signal."""
    return {
        "receiver": sheet.name or None,
        "model": sheet.scenario.receiver.model,
        "scenario": sheet.scenario.source,
        "transmitter": sheet.scenario.transmitters[0].id,
        "plan": sheet.plan.__dict__,
        "couplings": [
            {
                "coupling": row.coupling.name,
                "motors": row.motors,
                "mean_m": row.mean_m,
                "sigma_m": row.sigma_m,
                "stable_m": [walk.stable_m for walk in row.walks],
                "first_m": [walk.first_m for walk in row.walks],
            }
            for row in sheet.rows
        ],
    }


def table(sheets: Sequence[DataSheet]) -> Iterator[tuple[Any, ...]]:
    """Yield one row a walk, with a header."""
    yield "receiver", "coupling", "motors", "walk", "first_m", "stable_m"
    for sheet in sheets:
        for row in sheet.rows:
            for n, walk in enumerate(row.walks):
                yield sheet.name, row.coupling.name, int(row.motors), n, walk.first_m, walk.stable_m
