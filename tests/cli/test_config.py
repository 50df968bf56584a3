"""`arva-hil config`: what holds, where it comes from, and that its output is a scenario that says the same."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest

from arva_hil.config import load, parse
from arva_hil.config.profiles import builtin_files

from .far_ends import Arva

SCENARIO = """\
transmitters:
  - {id: 3, enu: [9, 5, 0]}
  - id: 4
    ned: [1, 2, 3]
    strength: 0.5
receiver:
  rate_hz: 2
faults: [{drop: 0.02, from_s: 10, until_s: 60}]
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.yaml"
    path.write_text(SCENARIO)
    return path


def origins(out: str) -> dict[str, tuple[Any, str]]:
    """Value and origin by key."""
    return {said["key"]: (said["value"], said["from"]) for said in map(json.loads, out.splitlines())}


def test_each_value_says_where_it_comes_from(arva: Arva, file: Path) -> None:
    code, out, err = arva("config", "--scenario", file, "--json")
    assert (code, err) == (0, "")
    said = origins(out)
    assert said["transmitters.0.id"] == (3, f"{file}:2")
    assert said["transmitters.0.ned"] == ([5, 9, 0], f"{file}:2")  # the file says it as enu
    assert said["transmitters.1.strength"] == (0.5, f"{file}:5")
    assert said["transmitters.0.strength"] == (1.0, "default")
    assert said["receiver.rate_hz"] == (2.0, f"{file}:7")
    assert said["faults.0.drop"] == (0.02, f"{file}:8")
    assert said["seed"] == (1, "default")
    assert said["--timeout"] == (10.0, "default")


def test_the_environment_is_stronger_than_the_file_and_the_command_line_stronger_than_both(
    arva: Arva, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in {"RATE": "5", "SEED": "7", "PORT": "pty", "TIMEOUT": "3", "FAULT": "drop=0.5"}.items():
        monkeypatch.setenv(f"ARVA_HIL_{name}", value)
    said = origins(arva("config", "--scenario", file, "--seed", 9, "--timeout", 4, "--json").out)
    assert said["receiver.rate_hz"] == (5.0, "environment, ARVA_HIL_RATE")
    assert said["seed"] == (9, "command line")
    assert said["--timeout"] == (4.0, "command line")
    assert said["--port"] == ("pty", "environment, ARVA_HIL_PORT")
    assert said["--scenario"] == (str(file), "command line")
    assert said["faults.0.drop"] == (0.02, f"{file}:8")
    assert said["faults.1.drop"] == (0.5, "environment, ARVA_HIL_FAULT")


def test_faults_that_are_taken_away_are_gone(arva: Arva, file: Path) -> None:
    said = origins(arva("config", "--scenario", file, "--fault", "none", "--json").out)
    assert said["faults"] == ([], "command line")
    said = origins(arva("config", "--scenario", file, "--fault", "none", "--fault", "drop=0.5", "--json").out)
    assert said["faults.0.drop"] == (0.5, "command line")


def test_where_a_value_of_a_receiver_stands_for_all_that_line_is_named(arva: Arva) -> None:
    said = origins(arva("config", "--scenario", "builtin:two_vehicles", "--json").out)
    source = str(builtin_files()["two_vehicles"])
    lines = Path(source).read_text().splitlines()
    (line,) = (number for number, text in enumerate(lines, 1) if text.startswith("receiver:"))
    assert said["vehicles.0.receivers.0.rate_hz"] == (1.0, f"{source}:{line}")


NO_SCENARIOS = ("campaigns/", "receivers/", "transmitters/")


@pytest.mark.parametrize("name", [name for name in builtin_files() if not name.startswith(NO_SCENARIOS)])
def test_what_it_prints_is_a_scenario_that_says_the_same(arva: Arva, name: str) -> None:
    code, out, _ = arva("config", "--scenario", f"builtin:{name}")
    assert code == 0
    again = parse(out, "config")
    assert dataclasses.replace(again, source="") == dataclasses.replace(load(f"builtin:{name}"), source="")


def test_without_anything_the_defaults_are_printed_beside_their_values(arva: Arva) -> None:
    code, out, _ = arva("config")
    assert code == 0
    lines = [" ".join(line.split()) for line in out.splitlines()]
    assert "rate_hz: 1.0 # default" in lines
    assert "# --autopilot udpin:127.0.0.1:14550 # default" in lines


def test_a_mistake_in_the_file_is_told_as_by_run(arva: Arva, file: Path) -> None:
    file.write_text("transmitters: []\n")
    code, out, err = arva("config", "--scenario", file)
    assert (code, out) == (2, "")
    assert f"{file}:1:15: " in err
