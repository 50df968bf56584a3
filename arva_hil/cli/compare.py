"""`arva-hil compare`: a record beside the emulator on the same flight, or beside another record."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np

from arva_hil.cli.outcome import FAILED, Failure, UsageError
from arva_hil.cli.recorded import loaded, needing, output
from arva_hil.cli.terminal import show, show_json, tell
from arva_hil.config import Scenario, load
from arva_hil.records.comparing import (
    Comparison,
    NotComparable,
    Paired,
    Spread,
    compared,
    emulated_again,
    paired_frames,
)
from arva_hil.records.pictures.style import FORMATS
from arva_hil.records.reading import RecordedReceiver, Recording

_CLOCKS_S = 0.1  # report a larger difference of clocks


def main(options: argparse.Namespace) -> None:
    if bool(options.other) == bool(options.scenario):
        raise UsageError("name one to compare with: --scenario FILE, or another record")
    if options.other and "seed" in options.typed:
        raise UsageError("--seed: of the emulator: it goes with --scenario, not with another record")
    picture = next((one for one in FORMATS if options.out and Path(options.out).suffix.lower() == f".{one}"), None)
    if options.out and picture is None:
        raise UsageError(f"--out {options.out}: expected a file name that ends with .png, .svg or .pdf")
    record = loaded(options.run)
    with output(options.out, record) if options.out else nullcontext() as out:
        result, names = _compare(options, record)
        if out and picture:
            with needing("plots", "the picture of --out"):
                from arva_hil.records.comparing.picture import drawn

                out.write(drawn(result, names, picture))


def _compare(options: argparse.Namespace, record: Recording) -> tuple[Sequence[Comparison], tuple[str, str]]:
    """Compare, and print the result. Returns it, with the names of the two."""
    receiver = only_receiver(record)
    if options.scenario:
        emulated = emulated_again(record, receiver, emulated_scenario(options.scenario, options.seed))
        names = ("recorded", "emulated")
        pairs = emulated.pairs
        result = compared(receiver, emulated.receiver, pairs, emulated.ranges)
    else:
        other = loaded(options.other)
        names = (record.title, other.title)
        second = only_receiver(other)
        pairs = _paired(record, other)
        result = compared(receiver, second, pairs)
    tell(*_clocks(pairs))
    if not result:
        raise Failure(FAILED, "no signal in either record: is the format right?")
    if options.json:
        show_json(*({**one.as_json(), "paired_by": pairs.how, "clock_offset_s": pairs.offset_s} for one in result))
    else:
        show(*lines(result, names))
    return result, names


def only_receiver(recording: Recording) -> RecordedReceiver:
    """Return the only receiver of a record with frames and poses. Raises Failure."""
    if len(recording.receivers) != 1:
        raise Failure(
            FAILED, f"{recording.folder}: expected a record of one receiver, found {len(recording.receivers)}"
        )
    (receiver,) = recording.receivers
    if not len(receiver):
        raise Failure(FAILED, f"{recording.folder}: poses without frames: the record has no reading")
    if not np.isfinite(receiver.position).all(axis=1).any():
        raise Failure(
            FAILED, f"{recording.folder}: frames without poses: the emulator cannot know where they were read"
        )
    return receiver


def emulated_scenario(name: str, seed: int | None) -> Scenario:
    """Return the scenario of one receiver. Raises UsageError for one with vehicles."""
    scenario = load(name)
    if scenario.vehicles:
        raise UsageError(f"{scenario.source}: vehicles: name a scenario of one receiver")
    return scenario if seed is None else replace(scenario, seed=seed)


def _paired(a: Recording, b: Recording) -> Paired:
    try:
        return paired_frames(a, b)
    except NotComparable as error:
        raise Failure(FAILED, error) from None


def _clocks(pairs: Paired) -> list[str]:
    if pairs.how == "place":
        return [f"note: two flights: {len(pairs.first)} frames are paired by their places"]
    if pairs.offset_s is None or abs(pairs.offset_s) < _CLOCKS_S:
        return []
    return [
        f"note: the computer's clock of the second record is {pairs.offset_s:+.1f} s ahead of the first: frames are "
        "paired by the autopilot's clock"
    ]


def lines(result: Sequence[Comparison], names: tuple[str, str]) -> list[str]:
    """Return the lines of the table."""
    said = [f"d and δ: {names[0]} minus {names[1]}; bias is the median, scatter 1.48 times the median deviation"]
    for c in result:
        who = "the transmitter" if c.id is None else f"transmitter {c.id}"
        said += [
            "",
            f"{who}: {c.both} of {c.frames} frames in both, {c.first_only} only {names[0]}, {c.second_only} only "
            f"{names[1]}; frames lost: {c.first_lost}, {c.second_lost}",
        ]
        lag = "unknown from this flight" if c.lag_s is None else f"{c.lag_s:+.2f} s"
        said.append(f"lag of {names[0]}: {lag}")
        said += [f"warning: {hint}" for hint in c.hints]
        if c.all:
            said.append(f"{'':16}{'n':>6}{'d bias m':>10}{'scatter':>9}{'ratio':>7}{'δ bias °':>10}{'scatter':>9}")
            said.append(_row(c.all))
        for name, group in c.groups.items():
            said += [f"by {name}", *(_row(one) for one in group)] if group else []
    return said


def _row(s: Spread) -> str:
    turn = f"{'':>10}{'':>9}"
    if s.delta_bias_deg is not None and s.delta_scatter_deg is not None:
        turn = f"{s.delta_bias_deg:>10.1f}{s.delta_scatter_deg:>9.1f}"
    return f"  {s.label:14}{s.count:>6}{s.d_bias_m:>10.2f}{s.d_scatter_m:>9.2f}{s.ratio:>7.3f}{turn}".rstrip()
