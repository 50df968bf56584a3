"""What is wrong on the command line, in the environment or in a file: exit 2, and a message that helps."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from arva_hil.cli.main import COMMANDS
from arva_hil.config import load, parse
from arva_hil.config.profiles import builtin_files
from tests.files import written
from tests.said import says

from .far_ends import Arva

DATA = Path(__file__).parent.parent / "data"
LOG = str(DATA / "px4.tlog")


def test_a_rate_must_leave_room_for_the_scenarios_jitter(arva: Arva, tmp_path: Path) -> None:
    file = written(tmp_path / "jitter.yaml", "transmitters: [{id: 1, enu: [0, 0, 0]}]\nreceiver: {jitter_s: 0.1}\n")
    assert "--rate 10: the scenario's jitter_s of 0.1 is not less than half the period" in arva.refused(
        "replay", LOG, "--scenario", file, "--rate", 10
    )


HELPS = [(), *((command,) for command in COMMANDS)]


@pytest.mark.parametrize("command", HELPS)
@pytest.mark.parametrize("flag", ["--help", "--help-all"])
def test_help_has_80_columns_and_whole_words(arva: Arva, command: tuple[str, ...], flag: str) -> None:
    if not command and flag == "--help-all":
        return
    _, out, err = arva(*command, flag)
    assert err == ""
    assert out.startswith(" ".join(["usage: arva-hil", *command]))
    assert [line for line in out.splitlines() if len(line) > 80] == []
    assert not re.search(r"\w-$", out, re.MULTILINE), "a word is broken at its hyphen"


def test_help_before_a_command_is_that_of_the_command(arva: Arva) -> None:
    assert arva("help", "plot").out == arva("plot", "--help").out
    assert "no command 'plt'; did you mean plot?" in arva.refused("help", "plt")


def options_in(text: str) -> list[str]:
    """The options that a help explains."""
    return re.findall(r"^  (?:-\w.*, )?(--[a-z-]+)", text, re.MULTILINE)


@pytest.mark.parametrize("command", ["run", "replay", "demo", "search"])
def test_help_shows_the_ten_usual_options_and_help_all_the_rest_in_groups(arva: Arva, command: str) -> None:
    few, every = arva(command, "--help").out, arva(command, "--help-all").out
    usual = options_in(few)
    assert len(usual) == 12  # with --help and --help-all
    assert options_in(every)[:12] == usual, "they come first"
    rest = len(options_in(every)) - len(usual)
    assert few.endswith(f"\n{rest} more options: arva-hil {command} --help-all\n")
    assert "\noutput:\n" in every
    assert len(few.splitlines()) <= 60


@pytest.mark.parametrize(
    ("package", "line", "extra"),
    [
        ("scipy", "fit nowhere --out made/p.yaml", "fit"),
        ("distributed", "campaign builtin:campaigns/paper --scheduler tcp://127.0.0.1:1 --out made", "dask"),
        ("foxglove", "demo --speed max --foxglove 127.0.0.1:0 --record made", "foxglove"),
    ],
)
def test_a_missing_extra_is_reported_before_a_folder_is_made(
    arva: Arva, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str, line: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.chdir(tmp_path)
    assert f"pip install 'arva-hil[{extra}]'" in arva.refused(*line.split())
    assert list(tmp_path.iterdir()) == []


# -- `arva-hil config`: what holds, where it comes from, and that its output is a scenario that says the same --


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
    return written(tmp_path / "mine.yaml", SCENARIO)


def origins(out: str) -> dict[str, tuple[Any, str]]:
    """Value and origin by key."""
    return {said["key"]: (said["value"], said["from"]) for said in map(json.loads, out.splitlines())}


def test_each_value_says_where_it_comes_from(arva: Arva, file: Path) -> None:
    _, out, err = arva("config", "--scenario", file, "--json")
    assert err == ""
    said = origins(out)
    assert (
        said
        | {
            "transmitters.0.id": (3, f"{file}:2"),
            "transmitters.0.ned": ([5, 9, 0], f"{file}:2"),  # the file says it as enu
            "transmitters.1.strength": (0.5, f"{file}:5"),
            "transmitters.0.strength": (1.0, "default"),
            "receiver.rate_hz": (2.0, f"{file}:7"),
            "faults.0.drop": (0.02, f"{file}:8"),
            "seed": (1, "default"),
            "--timeout": (10.0, "default"),
        }
        == said
    )


def test_the_environment_is_stronger_than_the_file_and_the_command_line_stronger_than_both(
    arva: Arva, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in {"RATE": "5", "SEED": "7", "PORT": "pty", "TIMEOUT": "3", "FAULT": "drop=0.5"}.items():
        monkeypatch.setenv(f"ARVA_HIL_{name}", value)
    said = origins(arva("config", "--scenario", file, "--seed", 9, "--timeout", 4, "--json").out)
    assert (
        said
        | {
            "receiver.rate_hz": (5.0, "environment, ARVA_HIL_RATE"),
            "seed": (9, "command line"),
            "--timeout": (4.0, "command line"),
            "--port": ("pty", "environment, ARVA_HIL_PORT"),
            "--scenario": (str(file), "command line"),
            "faults.0.drop": (0.02, f"{file}:8"),
            "faults.1.drop": (0.5, "environment, ARVA_HIL_FAULT"),
        }
        == said
    )


@pytest.mark.skipif(sys.platform == "win32", reason="pipes as Unix has them")
def test_a_scenario_that_comes_from_a_pipe_is_printed(arva: Arva) -> None:
    read, write = os.pipe()
    os.write(write, SCENARIO.encode())
    os.close(write)
    try:
        said = origins(arva("config", "--scenario", f"/dev/fd/{read}", "--seed", 9, "--json").out)
    finally:
        os.close(read)
    assert said["faults.0.drop"] == (0.02, f"/dev/fd/{read}")
    assert said["seed"] == (9, "command line")


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
    again = parse(arva("config", "--scenario", f"builtin:{name}").out, "config")
    assert dataclasses.replace(again, source="") == dataclasses.replace(load(f"builtin:{name}"), source="")


def test_without_anything_the_defaults_are_printed_beside_their_values(arva: Arva) -> None:
    out = arva("config").out
    lines = [" ".join(line.split()) for line in out.splitlines()]
    says(lines, "rate_hz: 1.0 # default", "# --autopilot udpin:127.0.0.1:14550 # default")


def test_a_mistake_in_the_file_is_told_as_by_run(arva: Arva, file: Path) -> None:
    file.write_text("transmitters: []\n")
    assert f"{file}:1:15: " in arva.refused("config", "--scenario", file)


# -- `arva-hil completion SHELL`, tried in the shells themselves -----------------------------------------------


LINES = [
    (["arva-hil", "re"], ["record", "replay", "report"]),
    (["arva-hil", "replay", "--sp"], ["--speed"]),
    (["arva-hil", "--autop"], ["--autopilot"]),  # run is the default command
    (["arva-hil", "listen", "--format", "t"], ["text", "tunnel"]),
    (["arva-hil", "demo", "--strategy", "e"], ["extremum", "estimate"]),
    (["arva-hil", "completion", ""], ["bash", "fish", "zsh"]),
    (["arva-hil", "check", "my_sc"], ["my_scenario.yaml"]),
    (["arva-hil", "replay", "--record", "my_f"], ["my_folder"]),
    (["arva-hil", "compare", "my_"], ["my_folder"]),
    (["arva-hil", "view", "my_s"], ["my_scenario.yaml"]),
    (["arva-hil", "fit", "--out", "my_s"], ["my_scenario.yaml"]),
]
BASH = """
eval "$(cat script)"
complete -p arva-hil >/dev/null || exit 9
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=()
$(complete -p arva-hil | sed 's/.*-F \\([^ ]*\\).*/\\1/') arva-hil "${@: -1}" "${@: -2:1}"
printf '%s\\n' "${COMPREPLY[@]}"
"""
FISH = 'source script; complete -C "$argv"'


@pytest.fixture
def folder(arva: Arva, tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """Some files to complete, and the script for the shell that the test is for."""
    _, out, err = arva("completion", request.param)
    assert err == ""
    (tmp_path / "script").write_text(out)
    (tmp_path / "my_scenario.yaml").touch()
    (tmp_path / "my_folder").mkdir()
    return tmp_path


def said(command: list[str], folder: Path) -> list[str]:
    """What a shell answers, without descriptions; it must not have anything to complain of."""
    done = subprocess.run(
        command, cwd=folder, env={**os.environ, "HOME": str(folder)}, capture_output=True, text=True, timeout=30
    )
    assert (done.returncode, done.stderr) == (0, "")
    return [line.partition("\t")[0].rstrip("/") for line in done.stdout.splitlines()]


@pytest.mark.parametrize("folder", ["bash"], indirect=True)
@pytest.mark.parametrize(("words", "completed"), LINES, ids=lambda value: " ".join(value))
def test_bash_completes(folder: Path, words: list[str], completed: list[str]) -> None:
    assert sorted(said(["bash", "--norc", "-c", BASH, "bash", *words], folder)) == sorted(completed)


@pytest.mark.skipif(shutil.which("fish") is None, reason="fish is not installed")
@pytest.mark.parametrize("folder", ["fish"], indirect=True)
@pytest.mark.parametrize(("words", "completed"), LINES, ids=lambda value: " ".join(value))
def test_fish_completes(folder: Path, words: list[str], completed: list[str]) -> None:
    assert sorted(said(["fish", "--no-config", "-c", FISH, " ".join(words)], folder)) == sorted(completed)


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
@pytest.mark.parametrize("folder", ["zsh"], indirect=True)
def test_zsh_understands_the_script(folder: Path) -> None:
    assert said(["zsh", "-n", "script"], folder) == []


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_command_is_in_the_script(arva: Arva, shell: str) -> None:
    out = arva("completion", shell).out
    assert not [command for command in COMMANDS if command not in out]


def test_another_shell_is_refused_and_the_three_are_named(arva: Arva) -> None:
    err = arva.refused("completion", "csh")
    assert "invalid choice: 'csh'" in err
    assert all(shell in err for shell in ("bash", "zsh", "fish"))
