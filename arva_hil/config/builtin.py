"""The scenarios and plans that come with the program, by name: `builtin:four_transmitters`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from arva_hil.config.errors import Problem, ScenarioError, any_of, nearest

PREFIX: Final = "builtin:"


def builtin_files() -> dict[str, Path]:
    """The files by name, those of campaigns behind `campaigns/`; sorted."""
    package = Path(__file__).resolve().parents[1]
    installed, checkout = package / "configs", package.parent / "configs"
    folder = installed if installed.is_dir() else checkout
    return {path.relative_to(folder).with_suffix("").as_posix(): path for path in sorted(folder.rglob("*.yaml"))}


def located(path: str | os.PathLike[str]) -> str:
    """The path of a scenario: of a built-in one for `builtin:NAME`, else `path` itself. Raises ScenarioError."""
    name = os.fspath(path)
    if not name.startswith(PREFIX):
        return name
    files, wanted = builtin_files(), name.removeprefix(PREFIX)
    if wanted not in files:
        close = nearest(wanted.lower().removesuffix(".yaml"), list(files))
        raise ScenarioError([Problem(name, 1, 1, "no such file is built in", any_of(list(files)), close)])
    return str(files[wanted])
