"""What is wrong on the command line, in the environment or in a file: exit 2, and a message that helps."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from arva_hil.cli.main import COMMANDS
from tests.every import every

from .far_ends import Arva

DATA = Path(__file__).parent.parent / "data"
LOG = str(DATA / "px4.tlog")


@every(
    "arguments, what, cure",
    [
        ("replya x.tlog", "no command 'replya'", "did you mean replay?"),
        ("lisen pty", "no command 'lisen'", "did you mean listen?"),
        ("frobnicate", "no command 'frobnicate'", "the commands are run, replay, demo, search,"),
        ("", "--port is missing", "--port /dev/ttyUSB0, --port pty, or --format tunnel"),
        ("run", "--port is missing", "--port /dev/ttyUSB0, --port pty, or --format tunnel"),
        ("--prot pty", "--prot pty", "arva-hil run --help"),
        ("--por pty", "--por pty", "arva-hil run --help"),
        ("--port", "--port", "expected one argument\n"),
        ("--port --json", "--port", "expected one argument\n"),
        ("search --area -x,-9,9,9", "--area: expected one argument", "begins with a dash after =: --area=-x,-9,9,9"),
        ("--port pty --rate 0", "--rate: '0'", "a number of Hz 0.1…50"),
        ("--port pty --rate 51", "--rate: '51'", "a number of Hz 0.1…50"),
        ("--port pty --rate nan", "--rate: 'nan'", "a number of Hz 0.1…50"),
        ("--port pty --rate fast", "--rate: 'fast'", "a number of Hz 0.1…50"),
        ("--port pty --seed -1", "--seed: '-1'", "a whole number 0…9223372036854775807"),
        ("--port pty --seed 1.5", "--seed: '1.5'", "a whole number 0…"),
        ("--port pty --duration 0", "--duration: '0'", "a number of s of at least 0.001"),
        ("--port pty --timeout -3", "--timeout: '-3'", "a number of s of at least 0.1"),
        ("--port pty --target-system 0", "--target-system: '0'", "a whole number 1…255"),
        ("--port pty --target-component 256", "--target-component: '256'", "a whole number 1…255"),
        ("--port pty --max-age 0", "--max-age: '0'", "a number of s 0.05…60"),
        ("--port pty --stream-rate 500", "--stream-rate: '500'", "a number of Hz 1…200"),
        ("--port pty --format morse", "--format: no format 'morse'", "binary"),
        ("--port pty --format tunnel", "--format tunnel goes over the autopilot's own link", "leave out --port"),
        ("--port /dev/ttyS9 --autopilot /dev/ttyS9,57600", "are both /dev/ttyS9", "each side needs its own"),
        ("--port udpin:127.0.0.1:5 --autopilot udpin:0.0.0.0:5", "cannot both listen there", "choose another port"),
        ("--port udpout:1.2.3.4:5 --autopilot udpout:1.2.3.4:5", "are both udpout:1.2.3.4:5", "--format tunnel"),
        (
            f"--autopilot {LOG} --format tunnel",
            "is a log: frames with --format tunnel cannot be sent there",
            "--autopilot",
        ),
        ("--port - --json", "--json and --port - both go to stdout", "choose one"),
        ("--port udp:10.0.0.1:5", "--port: 'udp:10.0.0.1:5' does not say which side", "udpin:10.0.0.1:5 or udpout"),
        ("--port 127.0.0.1:5760", "--port: '127.0.0.1:5760' could be UDP or TCP", "tcp:127.0.0.1:5760"),
        ("--port tcp:host", "--port: 'tcp:host' has no port", "tcp:host:5760"),
        ("--port ttyUSB0", "--port: 'ttyUSB0' is no connection", "/dev/ttyUSB0"),
        ("--port /dev/ttyUSB0:57600", "--port: '/dev/ttyUSB0:57600' has a colon", "/dev/ttyUSB0,57600"),
        ("--port pty --autopilot tcp:1.2.3.4:99999", "--autopilot/--master: 'tcp:1.2.3.4:99999'", "1…65535"),
        ("listen nowhere", "'nowhere' is no connection", "/dev/ttyACM0,57600"),
        ("listen pty --count 0", "--count: '0'", "a whole number 1…"),
        ("listen", "required: URL", "arva-hil listen --help"),
        ("check", "required: FILE", "arva-hil check --help"),
        ("replay", "required: LOG.tlog", "arva-hil replay --help"),
        ("ports now", "unrecognized arguments: now", "arva-hil ports --help"),
        ("doctor --listen 0", "--listen: '0'", "a number of s 0.2…3600"),
        ("doctor --format tunnel --port pty", "--format tunnel goes over the autopilot's own link", "leave out --port"),
        ("doctor --autopilot -", "--autopilot -: this is stdout", "cannot be read"),
        ("doctor --autopilot pty --port -", "--port -: this is stdout, where the findings go", "`run` can"),
        ("doctor --port 127.0.0.1:5760", "could be UDP or TCP", "tcp:127.0.0.1:5760"),
        ("doctor --autopilot pty --port x.tlog", "--port x.tlog: this is a log", "frames cannot be sent there"),
        (
            "doctor --autopilot x.tlog --format named",
            "--autopilot x.tlog: this is a log",
            "frames with --format named cannot be sent there",
        ),
        ("doctor --autopilot /dev/ttyS9 --port /dev/ttyS9,9600", "are both /dev/ttyS9", "--format tunnel"),
        ("doctor --autopilot tcp:a:1 --port tcpout://a:1", "are both tcpout://a:1", "each side needs its own"),
        ("demo --speed 0", "--speed: '0'", "a number 0.01…1000"),
        ("demo --speed nan", "--speed: 'nan'", "a number 0.01…1000"),
        (f"replay {LOG} --port pty --out x", "--port and --out", "choose one"),
        (f"replay {LOG} --out - --json", "--json and the frames both go to stdout", "choose one"),
        (f"replay {LOG} --out /none/x", "/none/x: cannot be written", "No such file"),
        (f"replay {LOG} --port udp:1", "--port: 'udp:1' does not say which side", "udpin:"),
    ],
)
def test_wrong_arguments_are_refused(arva: Arva, arguments: str, what: str, cure: str) -> None:
    code, out, err = arva(*arguments.split())
    assert (code, out) == (2, "")
    assert err.startswith("arva-hil: ")
    assert what in err
    assert cure in err


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("RATE", "0", "ARVA_HIL_RATE=0: '0': expected a number of Hz 0.1…50"),
        ("FORMAT", "morse", "ARVA_HIL_FORMAT=morse: no format 'morse'"),
        ("JSON", "perhaps", "ARVA_HIL_JSON=perhaps: expected 1 or 0"),
        ("PORT", "udp:1.2.3.4:5", "ARVA_HIL_PORT=udp:1.2.3.4:5: 'udp:1.2.3.4:5' does not say which side listens"),
    ],
)
def test_a_wrong_value_in_the_environment_is_named(
    arva: Arva, monkeypatch: pytest.MonkeyPatch, name: str, value: str, message: str
) -> None:
    monkeypatch.setenv(f"ARVA_HIL_{name}", value)
    code, _, err = arva("run")
    assert code == 2
    assert message in err


def test_a_missing_scenario_is_refused(arva: Arva, tmp_path: Path) -> None:
    code, _, err = arva("--port", "pty", "--scenario", tmp_path / "none.yaml")
    assert code == 2
    assert f"{tmp_path / 'none.yaml'}:1:1: No such file or directory, expected a scenario file" in err


def test_a_folder_is_no_scenario(arva: Arva, tmp_path: Path) -> None:
    code, _, err = arva("demo", "--scenario", tmp_path)
    assert code == 2
    assert f"{tmp_path}:1:1: Is a directory, expected a scenario file" in err


@pytest.mark.parametrize("command", [["--port", "pty"], ["replay", LOG], ["demo"]])
def test_every_mistake_in_a_scenario_is_shown_at_its_place(arva: Arva, tmp_path: Path, command: list[str]) -> None:
    file = tmp_path / "broken.yaml"
    file.write_text("transmitters: []\nreceiver: {rate_hz: 99}\n")
    code, _, err = arva(*command, "--scenario", file)
    assert code == 2
    assert f"{file}:1:15: " in err
    assert f"{file}:2:21: " in err
    assert "from 0.1 to 50" in err


def test_a_rate_must_leave_room_for_the_scenarios_jitter(arva: Arva, tmp_path: Path) -> None:
    file = tmp_path / "jitter.yaml"
    file.write_text("transmitters: [{id: 1, enu: [0, 0, 0]}]\nreceiver: {jitter_s: 0.1}\n")
    code, _, err = arva("replay", LOG, "--scenario", file, "--rate", 10)
    assert code == 2
    assert "--rate 10: the scenario's jitter_s of 0.1 is not less than half the period" in err


HELPS = [(), *((command,) for command in COMMANDS)]


@pytest.mark.parametrize("command", HELPS)
@pytest.mark.parametrize("flag", ["--help", "--help-all"])
def test_help_has_80_columns_and_whole_words(arva: Arva, command: tuple[str, ...], flag: str) -> None:
    if not command and flag == "--help-all":
        return
    code, out, err = arva(*command, flag)
    assert (code, err) == (0, "")
    assert [line for line in out.splitlines() if len(line) > 80] == []
    assert not re.search(r"\w-$", out, re.MULTILINE), "a word is broken at its hyphen"


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
    ran = arva(*line.split())
    assert (ran.code, f"pip install 'arva-hil[{extra}]'" in ran.err) == (2, True), ran.err
    assert list(tmp_path.iterdir()) == []
