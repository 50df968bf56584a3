"""A message for a person while the program runs."""

from __future__ import annotations

from typing import Literal, NamedTuple

Level = Literal["info", "warning", "error"]


class Notice(NamedTuple):
    level: Level
    text: str
