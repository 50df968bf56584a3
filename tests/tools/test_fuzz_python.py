"""tools/fuzz: what its targets try holds on its seeds and a few hundred damaged ones; what it says."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tools.fuzz import decoder, loader, session
from tools.fuzz import python as tool


@pytest.mark.parametrize(
    ("target", "count"),
    [("loader", 120), ("session", 150), ("decoder", 1000), ("commands", 1000), ("log", 150), ("team", 200)],
)
def test_what_has_to_hold_holds_on_the_seeds_and_on_damaged_ones(target: str, count: int) -> None:
    module = tool.module(target)
    every = list(module.seeds())
    assert len(every) >= 5
    for data in every + list(tool.damaged(every, count, 457)):
        try:
            module.fuzz(data)
        except Exception as error:
            raise AssertionError(f"{target}: {data.hex()}") from error


FOUND = [  # inputs that once failed
    ("loader", b"transmitters: []\rseed: 1 # caf\xe9\r"),
    ("decoder", bytes.fromhex("08 00 1f 02 d204000000000000 0000c07f 00000000 00000000 61 000000000000000000 00")),
    ("decoder", bytes.fromhex("08 00 1f 02 d204000000000000 0000807f 00000000 00000000 61 000000000000000000 00")),
    ("decoder", bytes.fromhex("06 00 13 01 01000000 01000000 41525641315f58000000 00 13 01 01000000 01000000")
     + b"ARVA1_D\0\0\0"),
    ("team", bytes.fromhex("00000000471f00000000000000000094000000002e68")),  # a transmitter heard far outside the area
    ("team", bytes.fromhex(  # two vehicles: out of the way of the second one is the way to the first one
        "0032" + 19 * "00" + "ae" + 11 * "00" + "c0" + 35 * "00" + "a7a6a9f10087" + 4 * "00" + "65" + 8 * "00"
        "0c00ceb36f55000100000000b5ef00000000005e000000f100000000000000000000006a00000000000000008e000087000a2700ba0910a1"
        "00000017" + 8 * "00" + "98")),
]  # fmt: skip


@pytest.mark.parametrize(("target", "data"), FOUND)
def test_what_was_found_once(target: str, data: bytes) -> None:
    tool.module(target).fuzz(data)


def wrong_session(monkeypatch: pytest.MonkeyPatch) -> str:
    """Knows more than its twin, as if it had listened to somebody else."""
    monkeypatch.setattr(session.Bench, "_alone", lambda self, twin, packet: [packet])
    return "session"


def wrong_loader(monkeypatch: pytest.MonkeyPatch) -> str:
    """Reads back another seed than was written."""
    plain = loader.to_dict
    monkeypatch.setattr(loader, "to_dict", lambda scenario: {**plain(scenario), "seed": 7})
    return "loader"


def wrong_decoder(monkeypatch: pytest.MonkeyPatch) -> str:
    """Says another distance than was sent."""

    class Wrong(decoder.DECODERS["binary"]):  # type: ignore[misc]
        def feed(self, chunk: bytes, now: float) -> Any:
            return [f._replace(channels=(f.channels[0]._replace(d=5),)) for f in super().feed(chunk, now)]

    monkeypatch.setitem(decoder.DECODERS, "binary", Wrong)
    return "decoder"


@pytest.mark.parametrize("make", [wrong_session, wrong_loader, wrong_decoder])
def test_what_is_wrong_is_found(make: Callable[[pytest.MonkeyPatch], str], monkeypatch: pytest.MonkeyPatch) -> None:
    module = tool.module(make(monkeypatch))
    failed = 0
    for data in module.seeds():
        try:
            module.fuzz(data)
        except AssertionError:
            failed += 1
    assert failed


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tools", "fuzz", "python", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


def test_an_input_is_tried_again(tmp_path: Path) -> None:
    good = tmp_path / "good"
    good.write_bytes(b"seed: 1")
    done = run("loader", "--reproduce", good)
    assert (done.returncode, done.stdout) == (0, f"{good}: passes\n")


def test_without_atheris_damaged_seeds_are_tried_and_what_fails_is_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert tool.run_damaged("team", 3, 1) == 0
    assert capsys.readouterr().out == "team: 43 runs, seed 1, 0 findings\n"
    assert tool.run_damaged(wrong_decoder(monkeypatch), 3, 1) == 1
    assert len(list(tmp_path.glob("crash-decoder-1-*"))) == 1


def test_without_atheris_it_says_what_to_install() -> None:
    hide = "import runpy, sys; sys.modules['atheris'] = None; "
    hide += "runpy.run_module('tools', run_name='__main__')"
    command = [sys.executable, "-c", hide, "fuzz", "python", "loader", "--seconds", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert re.search(r"atheris is not installed: pip install 'arva-hil\[fuzz\]'", done.stderr)


def test_a_wrong_target_is_refused() -> None:
    done = run("lodaer")
    assert done.returncode == 2
    assert "invalid choice: 'lodaer'" in done.stderr
