"""The figures of the receiver that listens to pulses are those of the literature, or those that we say are ours."""

from __future__ import annotations

import pytest

from tools.figures.receivers import FIGURES, OURS, novices, overlaps

QUICK = {name: figure for name, figure in FIGURES.items() if name != "overlaps"}


@pytest.mark.parametrize("name", QUICK)
def test_a_figure_is_within_its_tolerance(name: str) -> None:
    rows = list(QUICK[name]())
    assert rows
    assert [row for row in rows if not row.good] == []
    assert all(row.source for row in rows)


def test_pulses_of_several_sets_touch_as_often_as_the_table_says() -> None:
    """Of some of the trials of the tool, with its tolerances."""
    rows = list(overlaps(400))
    assert [row for row in rows if not row.good] == []
    assert all(row.source.startswith(OURS) for row in rows)


def test_marks_fail_for_one_who_follows_the_nearest_of_four_old_sets_now_and_then() -> None:
    missed = int(novices(12).split(": ")[1].split(" of")[0])
    assert 1 <= missed <= 11
