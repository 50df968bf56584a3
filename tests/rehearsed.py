"""Rehearsed flights: the same one again is not flown again, but a copy of its record."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from arva_hil.config import Scenario
from tools.figures import rehearsal

_FLOWN: Final[dict[str, dict[str, bytes]]] = {}


def rehearse(folder: Path, scenario: Scenario, points: Sequence[rehearsal.Waypoint], **options: Any) -> Path:
    """The record of `rehearsal.rehearse`, in `folder`, which is made and may be changed."""
    key = repr((scenario, points, options))
    if key not in _FLOWN:
        rehearsal.rehearse(folder, scenario, points, **options)
        _FLOWN[key] = {path.name: path.read_bytes() for path in folder.iterdir()}
    else:
        folder.mkdir(parents=True)
        for name, data in _FLOWN[key].items():
            (folder / name).write_bytes(data)
    return folder
