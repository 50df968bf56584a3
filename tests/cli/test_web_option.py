"""--web on the command line: what is said of the page, and what of wrong addresses."""

from __future__ import annotations

import re
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from .far_ends import Arva

LOG = Path(__file__).parent.parent / "data" / "arducopter.tlog"


@pytest.fixture
def taken() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as other:
        yield other.getsockname()[1]


def replay(arva: Arva, *arguments: object) -> Any:
    return arva("replay", LOG, "--rate", 0.1, "--out", "/dev/null", *arguments)


def test_the_address_is_said_and_the_page_is_off_unless_it_is_asked_for(arva: Arva) -> None:
    code, _, err = replay(arva, "--web", "127.0.0.1:0")
    assert code == 0
    assert re.search(r"^page: http://127\.0\.0\.1:\d+/$", err, re.MULTILINE)
    for off in ([], ["--web", "off"]):
        assert "page: " not in replay(arva, *off).err


def test_the_environment_asks_for_it_too(arva: Arva, monkeypatch: pytest.MonkeyPatch, taken: int) -> None:
    monkeypatch.setenv("ARVA_HIL_WEB", f"127.0.0.1:{taken}")
    assert re.search(rf"^page: http://127\.0\.0\.1:\d+/ \(port {taken} is taken\)$", replay(arva).err, re.MULTILINE)


def test_who_else_can_see_it_is_said(arva: Arva) -> None:
    err = replay(arva, "--web", "0.0.0.0:0").err
    assert re.search(r"^page: http://127\.0\.0\.1:\d+/$", err, re.MULTILINE)
    assert "warning: everybody in this network can open the page; --web 127.0.0.1 offers it here only" in err


@pytest.mark.parametrize(
    ("address", "what"),
    [
        (
            "127.0.0.1:99999",
            "--web: '127.0.0.1:99999': expected HOST:PORT, HOST or PORT, e.g. 127.0.0.1:8457, on or off",
        ),
        ("a b", "--web: 'a b': expected HOST:PORT"),
        ("192.0.2.1:80", "192.0.2.1:80: the page cannot be served: "),
        ("nowhere.invalid", "nowhere.invalid:8457: the page cannot be served: no address of that name"),
    ],
)
def test_a_wrong_address_is_an_error_with_the_cure(arva: Arva, address: str, what: str) -> None:
    code, _, err = replay(arva, "--web", address)
    assert code == 2
    assert what in err
    assert "Traceback" not in err


@pytest.mark.parametrize("command", ["run", "search"])
def test_a_command_whose_page_cannot_be_served_leaves_no_record(arva: Arva, tmp_path: Path, command: str) -> None:
    """So that the same one with another address is not told that there is a record already."""
    where = {"run": "--port", "search": "--receiver"}[command]
    links = ("--autopilot", f"pty:{tmp_path / 'fc'}", where, "pty")
    code, _, err = arva(command, *links, "--record", tmp_path / "record", "--web", "192.0.2.1:80")
    assert (code, "the page cannot be served" in err) == (2, True)
    assert list(tmp_path.iterdir()) == []


def test_the_demo_has_it_by_itself_and_says_how_to_see_it_again(arva: Arva, tmp_path: Path) -> None:
    fly = ("demo", "--speed", "max", "--limit", 1, "--record")  # it does not find anything in a second
    err = arva(*fly, tmp_path / "a").err
    assert re.search(r"^page: http://127\.0\.0\.1:\d+/", err, re.MULTILINE)
    assert f"to see it again: arva-hil view {tmp_path / 'a'}" in err
    for word, folder in (("--headless", "b"), ("--web=off", "c")):
        assert "page" not in arva(*fly, tmp_path / folder, word).err
