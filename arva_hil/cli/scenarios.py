"""`arva-hil scenarios`: lists the built-in scenarios."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from arva_hil.cli.terminal import show_one
from arva_hil.config.profiles import PREFIX, builtin_files


def main(options: argparse.Namespace) -> None:
    for name, path in builtin_files().items():
        about = _about(path)
        value = {"name": f"{PREFIX}{name}", "path": str(path), "about": about}
        show_one(value, f"{PREFIX}{name:<20} {about}", as_json=options.json)


def _about(path: Path) -> str:
    """Return the first sentence of the comment that a file begins with."""
    comment: list[str] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        comment.append(line.removeprefix("#").strip())
    return re.split(r"(?<=\.)\s", " ".join(comment))[0]
