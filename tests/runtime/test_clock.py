"""The clock waits for what there is to read, whatever the number of its descriptor."""

from __future__ import annotations

import contextlib
import os
import resource
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from arva_hil import clock
from arva_hil.clock import RealClock, await_descriptors, punctual
from arva_hil.links import Link, open_link
from arva_hil.links.pty import PtyLink
from arva_hil.links.stdout import StdoutLink
from arva_hil.links.tcp import TcpLink, TcpServerLink
from arva_hil.links.udp import UdpInLink, UdpOutLink

LONG_S = 60.0


@pytest.fixture(params=["few", "many"])
def descriptors(request: pytest.FixtureRequest) -> Iterator[None]:
    """With `many`, what a test opens has a number that select cannot take."""
    if request.param == "few":
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 2048:
        pytest.skip("this system allows no 2048 descriptors")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 2048), hard))
    taken = []
    while not taken or taken[-1] < 1024:
        taken.append(os.open(os.devnull, os.O_RDONLY))
    yield
    for fd in taken:
        os.close(fd)
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.fixture
def keep() -> Iterator[Callable[[Link], Link]]:
    links: list[Link] = []
    yield lambda link: links.append(link) or link  # type: ignore[func-returns-value]
    for link in links:
        link.close()


@pytest.mark.usefixtures("descriptors")
@pytest.mark.parametrize("kind", ["pty", "serial", "udp", "tcp"])
def test_it_wakes_for_a_link_that_has_something_to_read(
    kind: str, keep: Callable[[Link], Link], tmp_path: Path
) -> None:
    near: Link
    far: Link
    if kind == "udp":
        near = keep(UdpInLink())
        assert isinstance(near, UdpInLink)
        far = keep(UdpOutLink("127.0.0.1", near.port))
    elif kind == "tcp":
        near = keep(TcpServerLink())
        assert isinstance(near, TcpServerLink)
        far = keep(TcpLink("127.0.0.1", near.port))
    else:
        far = keep(PtyLink(path := str(tmp_path / "line")))
        near = keep(open_link(path, clock=RealClock()))
        if kind == "pty":
            near, far = far, near
    clock = RealClock()
    far.write(b"frame")
    got = b""
    while not got:
        assert clock.now() < LONG_S / 2
        clock.wait(LONG_S, [near])
        assert near.ready() or kind == "tcp"  # a client that has come is no byte yet
        got = near.read()
    assert got == b"frame"
    near.write(b"answer")
    clock.wait(LONG_S, [far])
    assert far.read() == b"answer"


@pytest.mark.usefixtures("descriptors")
def test_it_waits_no_longer_than_told() -> None:
    reader, writer = os.pipe()
    assert await_descriptors([reader], [writer])
    assert not await_descriptors([reader])
    assert not await_descriptors([reader], timeout_s=0.0015)
    clock = RealClock()
    assert not await_descriptors([reader], timeout_s=0.0025)
    assert clock.now() >= 0.0025
    os.close(writer)
    assert await_descriptors([reader], timeout_s=None)  # hung up
    os.close(reader)


@pytest.mark.usefixtures("descriptors")
def test_standard_output_waits_for_its_reader() -> None:
    reader, writer = os.pipe()
    with open(writer, "wb", buffering=0) as file:
        link = StdoutLink(file)
        link.give_up = lambda: True
        while link.write(b"x" * 997):
            pass
        assert link.dropped == 1
        os.read(reader, 65536)
        assert link.write(b"frame")
    os.close(reader)


@pytest.mark.skipif(not Path(f"/proc/{os.getpid()}/timerslack_ns").exists(), reason="Linux has it")
@pytest.mark.parametrize("ends", [None, KeyboardInterrupt])
def test_within_it_the_thread_wakes_in_time_and_afterwards_as_before(ends: type[BaseException] | None) -> None:
    slack = Path(f"/proc/{threading.get_native_id()}/timerslack_ns")
    before = slack.read_text()
    with contextlib.suppress(KeyboardInterrupt), punctual():
        assert int(slack.read_text()) == 1
        if ends:
            raise ends
    assert slack.read_text() == before


def test_where_the_system_knows_no_such_setting_nothing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clock, "Path", lambda _: Path("/nonexistent/timerslack_ns"))
    with punctual():
        pass
