"""What the tests share: the recorded flights, and links whose far ends are in the same process."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import settings

DATA = Path(__file__).parent / "data"

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


@pytest.fixture(params=["arducopter", "px4"])
def flight(request: pytest.FixtureRequest) -> Path:
    """A piece of a recorded flight, of either autopilot: take-off and the first corner of the square."""
    return DATA / f"{request.param}.tlog"
