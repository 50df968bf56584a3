"""The demonstration as it is without options, flown once for all tests of a run that look at what it left."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import NamedTuple

import pytest

from arva_hil.cli.main import main
from tests.once import once


class Flown(NamedTuple):
    code: int
    out: str
    err: str
    record: Path


def demo(factory: pytest.TempPathFactory) -> Flown:
    """What it said, and its record: not to be changed."""
    folder = once(factory, "demo", _keep)
    return Flown(*json.loads((folder / "said.json").read_text()), folder / "record")


def fly(folder: Path) -> Flown:
    """The same flight again, its record in `folder`."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["demo", "--speed", "max", "--headless", "--record", str(folder / "record")])
    return Flown(code, out.getvalue(), err.getvalue(), folder / "record")


def _keep(folder: Path) -> None:
    (folder / "said.json").write_text(json.dumps(fly(folder)[:3]))
