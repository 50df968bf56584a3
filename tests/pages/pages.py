"""What the pages show a reader to type: their shell lines and their consoles."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
FENCE = re.compile(r"^(?P<indent> *)```(?P<kind>\w+)\n(?P<text>.*?)^(?P=indent)```$", re.M | re.S)


class Typed(NamedTuple):
    """One command of a page. `terminal`: in consoles, what stands before `$`. `answer`: what it says."""

    place: str
    terminal: str
    command: str
    answer: str = ""


def pages() -> list[Path]:
    """Every page with lines to type."""
    found = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]
    return sorted([*found, *(ROOT / "firmware_proto").rglob("*.md")])


def shell_lines(page: Path) -> Iterator[Typed]:
    """The lines of `sh` blocks, continued ones joined, comments left out."""
    text = page.read_text(encoding="utf-8")
    for block in FENCE.finditer(text):
        if block["kind"] == "sh":
            number = text.count("\n", 0, block.start()) + 2
            for line in re.sub(r"\\\n\s*", "", block["text"]).splitlines():
                command = re.sub(r"(^|\s)#.*", "", line).strip()
                if command:
                    yield Typed(f"{page.relative_to(ROOT)}:{number}", "", command)


def console(page: Path) -> list[Typed]:
    """The commands of `console` blocks with what the page says they answer."""
    text = page.read_text(encoding="utf-8")
    typed: list[Typed] = []
    for block in FENCE.finditer(text):
        if block["kind"] != "console":
            continue
        number = text.count("\n", 0, block.start()) + 2
        for line in block["text"].splitlines():
            if prompt := re.match(r"(\w*)\$ (.*)", line):
                typed.append(Typed(f"{page.relative_to(ROOT)}:{number}", prompt[1], prompt[2]))
            else:
                typed[-1] = typed[-1]._replace(answer=f"{typed[-1].answer}{line}\n")
    return typed


def pattern(answer: str) -> re.Pattern[str]:
    """`…` alone on a line stands for any lines; within a line, for any text."""
    lines = ("(?:.*\n)*?" if line == "…" else re.escape(line).replace("…", ".*") + "\n" for line in answer.splitlines())
    return re.compile("".join(lines))
