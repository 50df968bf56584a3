"""What a person sees of a reading: nothing that means nothing."""

import pytest

from arva_hil.events.words.text import in_metres, reading, sigma
from firmware_proto import INNER, MID, OUTER, Channel


@pytest.mark.parametrize(
    ("channels", "said"),
    [
        ([Channel(1, MID, 1046, 12)], "#1 mid 1046 cm +12°"),
        ([Channel(1, INNER, 85, 0)], "#1 inner 85 cm"),
        ([Channel(None, OUTER, 1234, -17)], "#? 1234 cm -17°"),  # plain text carries no zone
        ([Channel(3, 7, 400, 0)], "#3 zone 7 400 cm +0°"),
        ([Channel(), Channel(1, MID, 0, 5)], "no signal"),
        ([Channel(2, INNER, 90, 0), Channel(5, MID, 700, 0), Channel()], "#2 inner 90 cm, #5 mid 700 cm +0°"),
    ],
)
def test_a_direction_and_a_zone_are_shown_only_where_there_is_one(channels: list[Channel], said: str) -> None:
    assert reading(channels) == said


@pytest.mark.parametrize(
    ("metres", "error", "spread"),
    [
        (0.0, "less than 1 cm", "less than 1 cm"),
        (0.0099, "less than 1 cm", "less than 1 cm"),
        (0.01, "0.01 m", "1 cm"),
        (0.04, "0.04 m", "4 cm"),
        (0.55, "0.55 m", "0.6 m"),
    ],
)
def test_an_error_is_never_printed_as_zero(metres: float, error: str, spread: str) -> None:
    assert (in_metres(metres), sigma(metres)) == (error, spread)
