"""Checks that version, tag, CHANGELOG and CITATION.cff agree, before `make dist` builds.

    python -m tools release

The version stands in `arva_hil/__init__.py` alone. Where git and tags are there, a tagged commit has to be of that very
version, and any other commit of a version after the newest tag. In a source archive, or a clone without tags, the
CHANGELOG and CITATION.cff are compared.
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parent.parent


class Tags(NamedTuple):
    """Tags of versions, without their `v`. `here`: that of this commit; `newest`: the newest before it, or it."""

    here: str | None = None
    newest: str | None = None


class Said(NamedTuple):
    """The files' contents. `changelog`: its first heading; `source`: the project's address; `news`: in changelog.d."""

    version: str
    changelog: str
    citation: str
    source: str
    news: tuple[str, ...] = ()


def disagreements(said: Said, tags: Tags) -> list[str]:
    """Return the disagreements, each with its cure."""
    found = []
    heading = said.changelog.partition(" ")[0]
    if heading != said.version:
        found.append(f"CHANGELOG.md begins with {heading}, the version is {said.version}: name it there")
    if said.citation != said.version:
        found.append(f"CITATION.cff says {said.citation}, the version is {said.version}: change it there")
    if tags.here is not None:
        if tags.here != said.version:
            found.append(f"this commit is tagged v{tags.here}, the version is {said.version}: tag it v{said.version}")
        if "unreleased" in said.changelog:
            found.append("this commit is tagged, and CHANGELOG.md says (unreleased): write the date there")
        if not said.source:
            found.append("this commit is tagged, and the project has no address: set `source` in pyproject.toml")
        if said.news:
            found.append(f"this commit is tagged, and changelog.d has {', '.join(said.news)}: move it to CHANGELOG.md")
    elif tags.newest is not None and _numbers(said.version) <= _numbers(tags.newest):
        found.append(f"v{tags.newest} is tagged already: raise __version__ in arva_hil/__init__.py")
    return found


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(map(int, re.findall(r"\d+", version)))


def said(root: Path = ROOT) -> Said:
    """Raises ValueError naming the file that lacks its line."""

    def line(name: str, pattern: str) -> str:
        found = re.search(pattern, (root / name).read_text(encoding="utf-8"), re.M)
        if not found:
            raise ValueError(f"{name}: no line like {pattern}")
        return found[1]

    return Said(
        line("arva_hil/__init__.py", r'^__version__ = "([^"]+)"$'),
        line("CHANGELOG.md", r"^## (.+)$"),
        line("CITATION.cff", r"^version: (\S+)$"),
        line("pyproject.toml", r'^source = "([^"]*)"'),
        tuple(sorted(path.name for path in (root / "changelog.d").glob("*.md"))),
    )


def tags(root: Path = ROOT) -> Tags:
    """None where there is no git, no repository or no tag."""

    def described(*options: str) -> str | None:
        command = ["git", "-C", str(root), "describe", "--tags", "--match", "v[0-9]*", *options]
        try:
            done = subprocess.run(command, capture_output=True, text=True)
        except FileNotFoundError:
            return None
        return done.stdout.strip().removeprefix("v") or None

    if not (root / ".git").exists():  # the archive lies in another project's folder, perhaps
        return Tags()
    return Tags(described("--exact-match"), described("--abbrev=0"))


def main() -> int:
    found = disagreements(said(), tags())
    print("\n".join(found) or f"version {said().version}: all agree")
    return 1 if found else 0
