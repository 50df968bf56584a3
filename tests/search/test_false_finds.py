"""Searches while something of configs/faults.yaml goes wrong: what is called found lies there."""

from __future__ import annotations

import pytest

from tools.bench.finds import flown


@pytest.mark.parametrize(
    ("strategy", "seed"),
    [
        ("estimate", 317),  # it goes back by 3 m while the vehicle is above the place: told 3.9 m off before
        ("estimate", 1042),  # antenna y dead, antennas saturated, and it moves by 8 m: 6.7 m
        ("flux", 205),  # it moves by 10 m, and readings are a second late: 11 m
    ],
)
def test_no_find_is_false(strategy: str, seed: int) -> None:
    assert flown(strategy, seed, most=3).kind != "false"


def test_a_dead_antenna_is_noticed_and_the_transmitter_found() -> None:
    one = flown("estimate", 69, most=3)
    assert "antenna_y=0" in one.faults
    assert one.kind == "found"
    assert one.error_m is not None
    assert one.error_m < 0.5
