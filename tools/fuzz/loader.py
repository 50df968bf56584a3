"""Scenario files and faults: a valid one can be written and read again; a mistake is reported with its place."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import yaml

from arva_hil.config import ScenarioError, load, parse, parse_fault, to_dict
from tools.fuzz.script import ROOT

_FOLDER: Final = tempfile.TemporaryDirectory(prefix="arva-fuzz-")
_FILE: Final = Path(_FOLDER.name, "f.yaml")
_BREAK: Final = re.compile("\r\n|[\n\r\x85\u2028\u2029]")


def fuzz(data: bytes) -> None:
    """A scenario file, or, behind `--fault `, a fault on the command line."""
    if data.startswith(b"--fault "):
        _fault(data.removeprefix(b"--fault ").decode(errors="surrogateescape"))
        return
    _FILE.write_bytes(data)
    try:
        scenario = load(_FILE)
    except ScenarioError as error:
        _refused(error, data)
        return
    plain = to_dict(scenario)
    assert parse(json.dumps(plain), "") == scenario
    assert parse(yaml.safe_dump(plain), "") == scenario
    for fault in scenario.faults:
        parse_fault(str(fault))


def _fault(text: str) -> None:
    try:
        str(parse_fault(text))
    except ValueError as error:
        if not str(error).startswith(repr(text)):
            raise AssertionError("not said which") from error


def _refused(error: ScenarioError, data: bytes) -> None:
    problems = error.problems
    assert problems
    assert str(error) == "\n".join(map(str, problems))
    assert len(str(error).splitlines()) == len(problems), "a message of more than one line"
    places = [(p.line, p.column) for p in problems]
    assert places == sorted(places), "not sorted by place"
    lines = _BREAK.split(data.decode(errors="replace"))
    for line, column in places:
        assert 1 <= line <= len(lines), f"line {line} of {len(lines)}"
        assert 1 <= column <= len(lines[line - 1]) + 1, f"column {column} of line {line}"


def seeds() -> Iterator[bytes]:
    for path in sorted(ROOT.glob("configs/*.yaml")):
        yield path.read_bytes()
    for path in sorted(ROOT.glob("tests/broken/files/*.yaml")):
        yield path.read_bytes()
    for path in sorted(ROOT.glob("tests/broken/scenarios/*.txt")):
        yield from re.split(rb"(?m)^=== .*\n(?:#> .*\n)*", path.read_bytes())[1:]
    yield b"--fault drop=0.02@10-60"
    yield b"--fault transmitter_moved=1,by_ned=[5,0,0],every_s=3,for_s=1@10"
