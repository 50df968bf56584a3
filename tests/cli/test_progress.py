"""How long something still takes."""

import pytest

from arva_hil.cli.terminal import time_left


@pytest.mark.parametrize(
    ("done", "more", "after_s", "said"),
    [
        (10, 90, 10.0, "about 0:01:30 left"),
        (1, 10_000, 3.6, "about 10:00:00 left"),
        (0, 90, 10.0, ""),  # nobody knows yet
        (90, 0, 10.0, ""),
    ],
)
def test_the_time_left_follows_from_what_was_done(done: int, more: int, after_s: float, said: str) -> None:
    assert time_left(done, more, after_s) == said
