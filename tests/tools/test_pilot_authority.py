"""tools/pilot_authority.py, a run or two of each kind: a real search, and a pilot who takes over at a random moment."""

from __future__ import annotations

import pytest

from tools import pilot_authority as tool


@pytest.mark.parametrize(("kind", "seed"), [("pause", 22), ("other", 1)])
def test_no_order_comes_later_than_the_bound(kind: str, seed: int) -> None:
    result = tool.fly(kind, seed)
    assert result.late == 0, result
    assert result.kept, result


def test_nor_in_the_climb_and_the_table_names_every_kind(capsys: pytest.CaptureFixture[str]) -> None:
    """In the climb, in real time, the order for the next mode may be under way while the pilot switches, more likely
    the slower the machine is. That it is left to the pilot there is tests/search/test_client.py's, in stepped time.
    """
    assert tool.main(["--runs", "1", "--jobs", "1", "--kinds", "climb"]) == 0
    heading, columns, *_, row = capsys.readouterr().out.splitlines()
    assert heading == f"bound: {tool.BOUND_MS} ms"
    assert columns.split()[:2] == ["kind", "runs"]
    assert row.split()[:3] == ["climb", "1", "0"]
