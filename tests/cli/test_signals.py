"""A signal at any line of a command: what was begun is put away, and the exit code says how it ended."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
from pathlib import Path
from typing import Any

import pytest

from arva_hil.cli import common, outcome, run, summary
from arva_hil.cli.outcome import SignalGuard, interrupting
from arva_hil.clock import StepClock
from arva_hil.links import pty
from arva_hil.records.writing import growing_files
from arva_hil.runtime import drivers
from tests.free_ports import free_port
from tests.signal_at import signalled

from .far_ends import Arva

DATA = Path(__file__).parent.parent / "data"
SAMPLES = 8  # lines, spread over all that are run


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """The first seconds of a flight."""
    path = tmp_path / "short.tlog"
    path.write_bytes((DATA / "arducopter.tlog").read_bytes()[:8000])
    return path


def test_a_run_closes_what_it_has_begun(arva: Arva, tmp_path: Path) -> None:
    link, record = tmp_path / "arva0", tmp_path / "record"
    autopilot = f"udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    words = ["--port", f"pty:{link}", "--autopilot", autopilot, "--record", record, "--duration", 0.01]
    modules = (common, run, pty, growing_files)

    def ended(line: int) -> tuple[Any, int]:
        shutil.rmtree(record, ignore_errors=True)
        return signalled(line, modules, lambda: arva(*words), signal.SIGTERM)

    (whole, *_), lines = ended(0)
    assert lines > 200
    for line in range(lines // SAMPLES, lines, lines // SAMPLES):
        (code, _, err), _ = ended(line)
        assert not {"Traceback", "unexpected"} & set(err.split()), f"line {line}"
        assert not os.path.lexists(link), f"line {line}"
        if record.exists():
            said = json.loads((record / "run.json").read_bytes())
            assert said["exit_code"] == code, f"line {line}"
            assert (said["ended"] == "SIGTERM") == (code == 130), f"line {line}"
        assert code == 130 or (code == whole and record.exists()), f"line {line}"


def test_a_replay_for_the_page_is_interrupted_as_any_other(arva: Arva, log: Path) -> None:
    (code, _, err), _ = signalled(
        20, [drivers], lambda: arva("view", log, "--web", 0, "--duration", 0.01), signal.SIGTERM
    )
    assert (code, "cannot be replayed" in err) == (130, False)


def test_a_signal_at_the_end_of_the_replay_ends_the_page_too(arva: Arva, log: Path) -> None:
    (code, *_), _ = signalled(1, [summary], lambda: arva("view", log, "--web", 0), signal.SIGTERM)
    assert code == 130


def test_what_a_signal_has_interrupted_is_put_away_whatever_follows_within_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = StepClock()
    monkeypatch.setattr(outcome, "RealClock", lambda: clock)
    with interrupting():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGHUP)
        clock.wait(0.9)
        signal.raise_signal(signal.SIGTERM)
        clock.wait(1.1)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_after_the_loop_a_signal_interrupts_nothing_any_more(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = StepClock()
    monkeypatch.setattr(outcome, "RealClock", lambda: clock)
    with interrupting():
        with SignalGuard():
            pass
        signal.raise_signal(signal.SIGTERM)
        clock.wait(1.1)
        with pytest.raises(KeyboardInterrupt):  # it is stuck
            signal.raise_signal(signal.SIGTERM)
