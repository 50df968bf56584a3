"""Options are read before anything slow is imported."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

from arva_hil.cli.arguments import arguments_of
from arva_hil.cli.main import COMMANDS
from arva_hil.cli.options import module_name
from arva_hil.links.tlog import tlog_record
from arva_hil.mavlink.codec import Encoder, dialect

SLOW = ["dask", "importlib.metadata", "jinja2", "matplotlib", "numpy", "pymavlink", "yaml"]
PROGRAM = """
import json, sys
from arva_hil.cli.main import main
codes = [main(arguments) for arguments in json.loads(sys.argv[1])]
print("imported:", json.dumps([codes, sorted(set(sys.modules) & set(json.loads(sys.argv[2])))]))
"""


def start(calls: list[list[str]], environment: dict[str, str]) -> tuple[list[int], list[str]]:
    """The exit codes of some calls of the program, one after the other in one process, and what slow it imported."""
    command = [sys.executable, "-c", PROGRAM, json.dumps(calls), json.dumps(SLOW)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=60)
    codes, imported = json.loads(done.stdout.rpartition("imported: ")[2])
    return codes, imported


def test_the_help_of_a_command_imports_nothing_slow() -> None:
    assert start([[command, "--help"] for command in COMMANDS], {}) == ([0] * len(COMMANDS), [])


def test_the_help_names_commands_of_other_packages_and_imports_nothing_else() -> None:
    assert start([["--help"]], {}) == ([0], ["importlib.metadata"])


def test_a_mistake_in_an_option_is_found_before_anything_slow_is_imported() -> None:
    calls = [
        ["run", "--rate", "99"],
        ["replay", "--seed", "-1", "flight.tlog"],
        ["search", "--mount", "1,2"],
        ["listen", "--count", "0"],
        ["doctor", "--autopilot", "udpin:nowhere"],
        ["campaign", "--jobs", "0"],
    ]
    assert start(calls, {"ARVA_HIL_TYPO": "1"}) == ([2] * len(calls), [])


def test_a_name_that_is_not_built_in_is_looked_for_in_other_packages_and_imports_nothing_else() -> None:
    calls = [["demo", "--format", "morse"], ["search", "--strategy", "luck"], ["flight.tlog"]]
    assert start(calls, {}) == ([2] * len(calls), ["importlib.metadata"])


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_its_arguments_and_what_it_does(command: str) -> None:
    assert arguments_of(command).__doc__
    assert callable(importlib.import_module(f"arva_hil.cli.{module_name(command)}").main)


def test_a_scenario_that_is_no_file_needs_no_yaml(tmp_path: Path) -> None:
    log = tmp_path / "one.tlog"
    log.write_bytes(
        tlog_record(1_700_000_000_000_000, Encoder(1, 1).pack(dialect.MAVLink_heartbeat_message(2, 3, 0x81, 4, 4, 3)))
    )
    codes, imported = start([["replay", str(log), "--out", str(tmp_path / "out"), "--rate", "5", "--seed", "7"]], {})
    assert codes == [0]
    assert "yaml" not in imported
