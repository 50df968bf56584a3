"""`run` as a service: what it tells the service manager, and that unit, environment and image name what exists."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import tomllib
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from arva_hil.cli.arguments import arguments_of
from arva_hil.cli.options import CommandParser
from arva_hil.cli.outcome import INTERRUPTED, USAGE
from tests.service_manager import Manager

from .far_ends import Autopilot, Start, until

ROOT = Path(__file__).parent.parent.parent
SYSTEMD = ROOT / "tools" / "systemd"
UNIT, ENVIRONMENT, RECORD = (SYSTEMD / name for name in ("arva-hil.service", "arva-hil.env", "record.conf"))
CONTAINER = ROOT / "tools" / "container" / "Containerfile"
ASSIGNMENT = re.compile(r"\bARVA_HIL_\w+=[^\s\"']*")


# -- what it says ------------------------------------------------------------------------------------------


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Manager]:
    with closing(Manager(str(tmp_path / "notify"))) as made:
        monkeypatch.setenv("NOTIFY_SOCKET", made.name)
        monkeypatch.setenv("WATCHDOG_USEC", "200000")
        monkeypatch.delenv("WATCHDOG_PID", raising=False)
        yield made


def test_a_service_is_ready_before_a_vehicle_is_heard_and_says_that_it_lives_until_it_is_stopped(
    start: Start, manager: Manager
) -> None:
    program = start("--autopilot", "pty", "--port", "pty", "--timeout", "inf")
    heard: list[str] = []
    until(lambda: heard.extend(manager.heard()) or heard.count("WATCHDOG=1") >= 3)
    assert [said for said in heard if not said.startswith("STATUS=")][:2] == ["READY=1", "WATCHDOG=1"]
    assert any(said.startswith("STATUS=") and said.endswith("no vehicle yet") for said in heard)
    program.process.terminate()
    assert program.ends() == INTERRUPTED
    assert manager.heard()[-1] == "STOPPING=1"


def test_a_service_whose_port_is_not_there_was_never_ready(start: Start, manager: Manager) -> None:
    program = start("--autopilot", "pty", "--port", "/dev/ttyNONE7")
    assert program.ends() == 3
    assert manager.heard() == []


def test_a_manager_that_is_gone_stops_nothing(
    start: Start, manager: Manager, autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", manager.name + ".gone")
    program = start("--autopilot", autopilot.address, "--port", "pty", "--rate", 20)
    program.says("there is a pose")
    program.stops()
    assert re.search(r"[1-9]\d* frames", program.err)


# -- what is installed -------------------------------------------------------------------------------------


def settings(path: Path) -> dict[str, list[str]]:
    """What a unit file sets, in order: a name may come again."""
    found: dict[str, list[str]] = {}
    for line in path.read_text().splitlines():
        if line and line[0] not in "#[":
            name, _, value = line.partition("=")
            found.setdefault(name, []).append(value)
    return found


def options(arguments: list[str], environment: dict[str, str]) -> dict[str, Any]:
    parser = CommandParser()
    arguments_of("run")(parser)
    return vars(parser.parse(arguments, environment))


@pytest.mark.parametrize("path", [UNIT, ENVIRONMENT, CONTAINER], ids=lambda path: path.name)
def test_every_name_in_the_environment_is_an_option_and_its_value_one_it_takes(path: Path) -> None:
    """Those that are commented out, too."""
    assignments = ASSIGNMENT.findall(path.read_text())
    assert assignments
    for assignment in assignments:
        name, _, value = assignment.partition("=")
        option = name.removeprefix("ARVA_HIL_").lower()
        assert options([], {name: value})[option] != options([], {})[option], assignment


def test_what_the_unit_runs_is_a_command_with_its_options() -> None:
    commands = settings(UNIT)["ExecStart"]
    assert [command.split()[:2] for command in commands] == [["/opt/arva-hil/bin/arva-hil", "run"]]
    assert options(commands[0].split()[2:], {})


def test_the_record_of_each_start_has_a_folder_of_its_own() -> None:
    empty, command = settings(RECORD)["ExecStart"]
    assert empty == ""  # or there would be two
    shell, flag, script = shlex.split(command)
    assert (shell, flag) == ("/bin/sh", "-c")
    script = script.replace("$$", "$").replace("%%", "%").removeprefix("exec /opt/arva-hil/bin/arva-hil run ")
    environment = {"STATE_DIRECTORY": "/var/lib/arva-hil", "INVOCATION_ID": "0123456789abcdef"}
    said = subprocess.run(
        [shell, flag, f"printf '%s\\n' {script}"], env=environment, capture_output=True, text=True, check=True
    )
    folder = options(said.stdout.splitlines(), {})["record"]
    assert re.fullmatch(r"/var/lib/arva-hil/\d{8}T\d{6}Z-01234567", folder)


def test_the_unit_knows_how_the_program_ends_and_waits_for_its_word() -> None:
    unit = settings(UNIT)
    assert unit["RestartPreventExitStatus"] == [str(USAGE)]
    assert unit["SuccessExitStatus"] == [str(INTERRUPTED)]
    assert unit["Type"] == ["notify"]
    assert int(unit["WatchdogSec"][0]) > 1
    assert "AF_UNIX" in unit["RestrictAddressFamilies"][0].split()
    assert unit["EnvironmentFile"] == [f"/etc/arva-hil/{ENVIRONMENT.name}"]


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="systemd is not installed")
def test_systemd_understands_the_unit(tmp_path: Path) -> None:
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("/opt/arva-hil/bin/arva-hil", "/bin/true"))
    said = subprocess.run(["systemd-analyze", "verify", "--man=no", unit], capture_output=True, text=True)
    assert (said.returncode, said.stderr) == (0, "")


def test_the_image_is_made_of_what_is_there() -> None:
    lines = [line.split() for line in CONTAINER.read_text().splitlines()]
    copied = [name for line in lines if line[:1] == ["COPY"] and "--from=build" not in line for name in line[1:-1]]
    assert all((ROOT / name).exists() for name in copied)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    project_files = {"pyproject.toml", "hatch_build.py", "README.md", *project["project"]["license-files"]}
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    packages = {*wheel["packages"], *wheel["force-include"]}
    assert set(copied) == project_files | packages
    assert ["ENTRYPOINT", *[f'["{name}"]' for name in project["project"]["scripts"]]] in lines
    bases = {line[1] for line in lines if line[:1] == ["FROM"]}
    assert len(bases) == 1
