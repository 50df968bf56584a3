"""What `make test-fast` leaves out is there."""

from __future__ import annotations

from pathlib import Path

from tests import slow


def test_what_is_called_slow_is_a_test() -> None:
    assert slow.strangers(Path(__file__).parent) == []
