"""Values of JSON objects from outside: of the expected type, or None."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from arva_hil.clock import from_utc


def number(value: object) -> float | None:
    """Return a finite number, None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value) if math.isfinite(value) else None
    except OverflowError:
        return None


def pair(value: object) -> tuple[float, float] | None:
    """Return a list of two finite numbers, None for anything else."""
    every = _numbers(value)
    return (every[0], every[1]) if len(every) == 2 else None


def triple(value: object) -> tuple[float, float, float] | None:
    """Return a list of three finite numbers, None for anything else."""
    every = _numbers(value)
    return (every[0], every[1], every[2]) if len(every) == 3 else None


def _numbers(value: object) -> list[float]:
    """Return the numbers of a list, at most four; an empty list if it has anything else."""
    every = [number(one) for one in value[:4]] if isinstance(value, list) else []
    finite = [one for one in every if one is not None]
    return finite if len(finite) == len(every) else []


def text(value: object) -> str:
    """Return a text, "" for anything else."""
    return value if isinstance(value, str) else ""


def mapping(value: object) -> Mapping[str, Any]:
    """Return an object, an empty one for anything else."""
    return value if isinstance(value, dict) else {}


def seconds_of(utc: str) -> float | None:
    """Return seconds since 1970 of a UTC time of a record, e.g. 2026-01-31T15:45:00.000Z; else None."""
    try:
        return from_utc(utc) / 1e6
    except ValueError:
        return None
