"""Files as tests write and read them."""

from __future__ import annotations

import csv
from pathlib import Path


def written(path: Path, text: str | bytes) -> Path:
    """The file, which has this content now."""
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def rows(path: Path) -> list[dict[str, str]]:
    """The rows of a table, each by the names of its columns."""
    with open(path, newline="") as file:
        return list(csv.DictReader(file))
