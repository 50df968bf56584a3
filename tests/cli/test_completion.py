"""`arva-hil completion SHELL`, tried in the shells themselves."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from arva_hil.cli.main import COMMANDS

from .far_ends import Arva

LINES = [
    (["arva-hil", "re"], ["record", "replay", "report"]),
    (["arva-hil", "replay", "--sp"], ["--speed"]),
    (["arva-hil", "--autop"], ["--autopilot"]),  # run is the default command
    (["arva-hil", "listen", "--format", "t"], ["text", "tunnel"]),
    (["arva-hil", "demo", "--strategy", "e"], ["extremum", "estimate"]),
    (["arva-hil", "completion", ""], ["bash", "fish", "zsh"]),
    (["arva-hil", "check", "my_sc"], ["my_scenario.yaml"]),
    (["arva-hil", "replay", "--record", "my_f"], ["my_folder"]),
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
    code, out, err = arva("completion", request.param)
    assert (code, err) == (0, "")
    (tmp_path / "script").write_text(out)
    (tmp_path / "my_scenario.yaml").touch()
    (tmp_path / "my_folder").mkdir()
    return tmp_path


def said(command: list[str], folder: Path) -> list[str]:
    """What a shell answers, without descriptions; it must not have anything to complain of."""
    environment = {**os.environ, "HOME": str(folder)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=30)
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
    answered = said(["fish", "--no-config", "-c", FISH, " ".join(words)], folder)
    assert sorted(answered) == sorted(completed)


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
@pytest.mark.parametrize("folder", ["zsh"], indirect=True)
def test_zsh_understands_the_script(folder: Path) -> None:
    assert said(["zsh", "-n", "script"], folder) == []


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_command_is_in_the_script(arva: Arva, shell: str) -> None:
    out = arva("completion", shell).out
    assert not [command for command in COMMANDS if command not in out]


def test_another_shell_is_refused_and_the_three_are_named(arva: Arva) -> None:
    code, _, err = arva("completion", "csh")
    assert code == 2
    assert "invalid choice: 'csh'" in err
    assert all(shell in err for shell in ("bash", "zsh", "fish"))
