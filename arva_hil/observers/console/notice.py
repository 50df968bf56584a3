"""What the program has to say to a person while it runs."""

from __future__ import annotations

from typing import Literal, NamedTuple

Level = Literal["info", "warning", "error"]


class Notice(NamedTuple):
    level: Level
    text: str
