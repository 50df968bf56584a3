"""One body of tests over every kind of link that has two ends."""

from __future__ import annotations

import os
import random
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import NamedTuple

import pytest

from arva_hil.clock import RealClock, StepClock
from arva_hil.links import Address, Link, LinkError, open_link
from arva_hil.links.memory import pair
from arva_hil.links.pty import PtyLink
from arva_hil.links.serial import SerialLink, open_serial
from arva_hil.links.stdout import StdoutLink
from arva_hil.links.tcp import TcpLink, TcpServerLink
from arva_hil.links.tlog import TlogLink, tlog_record
from arva_hil.links.udp import UdpInLink, UdpOutLink
from tests.links.links_waiting import DEADLINE_S, receive, until


class Ends(NamedTuple):
    """`near` is the end under test."""

    near: Link
    far: Link


def memory() -> Ends:
    return Ends(*pair(capacity=60_000))


def pty() -> Ends:
    master = PtyLink()
    return Ends(master, open_serial(master.path))


def udpin() -> Ends:
    near = UdpInLink()
    far = UdpOutLink("127.0.0.1", near.port)
    far.write(b"hello")
    assert receive(near, 5) == b"hello"
    return Ends(near, far)


def tcpin() -> Ends:
    near = TcpServerLink()
    far = TcpLink("127.0.0.1", near.port)
    far.write(b"hello")
    assert receive(near, 5) == b"hello"
    return Ends(near, far)


def swapped(make: Callable[[], Ends]) -> Callable[[], Ends]:
    return lambda: Ends(*reversed(make()))


KINDS: dict[str, Callable[[], Ends]] = {
    "memory": memory,
    "pty": pty,
    "serial": swapped(pty),
    "udpin": udpin,
    "udpout": swapped(udpin),
    "tcpin": tcpin,
    "tcp": swapped(tcpin),
}
STREAMS = ["memory", "pty", "serial", "tcpin", "tcp"]
ENDING = ["memory", "serial", "tcp"]  # lost for good when the far end goes


@pytest.fixture(params=KINDS)
def ends(request: pytest.FixtureRequest) -> Iterator[Ends]:
    made = KINDS[request.param]()
    yield made
    for link in made:
        link.close()


def some(kinds: list[str]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("ends", kinds, indirect=True)


def fill(link: Link, chunk: bytes = b"x" * 997, limit: int = 50_000_000) -> int:
    """Write until the link drops; how many writes were taken."""
    for taken in range(limit // len(chunk)):
        if not link.write(chunk):
            return taken
    pytest.fail(f"{limit} unread bytes were taken")


def test_bytes_arrive_whole_and_in_order_both_ways(ends: Ends) -> None:
    numbers = random.Random(1)
    for size in [1, 256, 50_000, *(numbers.randrange(1, 50_000) for _ in range(12))]:
        for sender, receiver in (ends, reversed(ends)):
            chunk = numbers.randbytes(size)  # with 3, 10, 13, 17 and 19, which terminals may act on
            assert sender.write(chunk)
            assert receive(receiver, size, sender) == chunk
    assert ends.near.dropped == ends.far.dropped == 0


def test_idle_reads_nothing(ends: Ends) -> None:
    for link in ends:
        assert not link.ready()
        assert link.read() == b""


def test_waiting_ends_when_data_comes(ends: Ends) -> None:
    clock = RealClock()
    for sender, receiver in (ends, reversed(ends)):
        clock.wait(clock.now() + 0.02, [receiver])  # nothing there: until the deadline
        assert not receiver.ready()
        start = clock.now()
        assert sender.write(b"x")
        clock.wait(start + DEADLINE_S, [receiver])
        assert clock.now() - start < DEADLINE_S / 2
        assert receiver.ready()
        assert receiver.read() == b"x"
        assert not receiver.ready()


def test_select_has_what_it_needs(ends: Ends) -> None:
    for link in ends:
        assert (link.fileno() is None) == link.name.startswith("memory")


@some(STREAMS)
def test_a_full_link_drops_whole_writes_and_never_blocks(ends: Ends) -> None:
    clock = RealClock()
    taken: list[bytes] = []
    slowest = 0.0
    for _ in range(100_000):
        if ends.near.dropped == 3:
            break
        frame = struct.pack(">I", len(taken)) * 249 + b"\r"  # 997 bytes: no buffer's size is a multiple
        start = clock.now()
        if ends.near.write(frame):
            taken.append(frame)
        slowest = max(slowest, clock.now() - start)
    assert ends.near.dropped == 3
    assert slowest < 1.0
    sent = b"".join(taken)
    assert receive(ends.far, len(sent), ends.near) == sent
    assert ends.near.write(b"and on")
    assert receive(ends.far, 6) == b"and on"
    assert ends.far.read() == b""
    assert ends.near.dropped == 3


@some(["pty", "serial", "tcp"])
def test_the_rest_of_a_write_goes_before_the_next_write(ends: Ends) -> None:
    taken = fill(ends.near)
    got = receive(ends.far, taken * 997 - 996)  # all but what is left of the last write, or nothing is left
    assert ends.near.write(b"next")
    expected = b"x" * (taken * 997) + b"next"
    assert got + receive(ends.far, len(expected) - len(got)) == expected


@some(["udpin", "udpout"])
def test_datagrams_nobody_reads_never_block(ends: Ends) -> None:
    clock = RealClock()
    for _ in range(1000):
        ends.near.write(b"x" * 997)
    assert clock.now() < DEADLINE_S / 2


def test_closing_twice_and_using_a_closed_link(ends: Ends) -> None:
    ends.near.close()
    ends.near.close()
    for use in (ends.near.read, lambda: ends.near.write(b"x")):
        with pytest.raises(LinkError, match="closed"):
            use()
    assert ends.near.fileno() is None
    assert not ends.near.ready()


@some(ENDING)
def test_a_far_end_that_went_is_lost_after_its_last_bytes(ends: Ends) -> None:
    if not isinstance(ends.near, SerialLink):  # a terminal that hangs up takes its unread bytes with it
        assert ends.far.write(b"last")
        until(ends.near.ready, ends.near)
        ends.far.close()
        assert ends.near.read() == b"last"
    ends.far.close()
    until(ends.near.ready, ends.near)
    with pytest.raises(LinkError, match="lost") as caught:
        ends.near.read()
    assert caught.value.link == ends.near.name
    with pytest.raises(LinkError, match="lost"):
        until(lambda: not ends.near.write(b"x"), ends.near)  # TCP may take one write before it knows


@some(["udpin", "udpout"])
def test_udp_cannot_be_lost(ends: Ends) -> None:
    ends.far.close()
    for reading in (False, True):
        for _ in range(10):
            assert ends.near.write(b"x")
            assert not reading or ends.near.read() == b""
    assert ends.near.dropped == 0


def test_memory_keeps_what_it_was_given_not_the_buffer() -> None:
    a, b = pair()
    buffer = bytearray(b"before")
    a.write(buffer)  # type: ignore[arg-type]
    buffer[:] = b"after!"
    assert b.read() == b"before"


@pytest.mark.parametrize(
    ("address", "kind"),
    [
        ("pty", PtyLink),
        (Address("udpin", "127.0.0.1", 0), UdpInLink),
        ("udpout:127.0.0.1:14550", UdpOutLink),
        (Address("tcpin", "127.0.0.1", 0), TcpServerLink),
        ("-", StdoutLink),
    ],
)
def test_open_link(address: str | Address, kind: type[Link], keep: Callable[[Link], Link]) -> None:
    assert type(keep(open_link(address, clock=StepClock()))) is kind


def test_open_link_of_what_must_exist(tmp_path: object, keep: Callable[[Link], Link]) -> None:
    master, server = keep(PtyLink()), keep(TcpServerLink())
    assert isinstance(master, PtyLink)
    assert isinstance(server, TcpServerLink)
    serial = keep(open_link(f"{master.path},57600", clock=StepClock()))
    assert isinstance(serial, SerialLink)
    assert serial._port.baudrate == 57600
    serial.close()
    serial = keep(open_link(master.path, clock=StepClock()))
    assert isinstance(serial, SerialLink)
    assert serial._port.baudrate == 115200
    assert isinstance(keep(open_link(f"tcp:127.0.0.1:{server.port}", clock=StepClock())), TcpLink)
    path = os.path.join(str(tmp_path), "a.tlog")
    with open(path, "wb") as file:
        file.write(tlog_record(1_700_000_000_000_000, bytes([0xFE, 0, 0, 0, 0, 0, 0, 0])))
    link = keep(open_link(path, clock=StepClock()))
    assert isinstance(link, TlogLink)
    assert link.reader.size == 16


def test_importing_links_imports_nothing_heavy() -> None:
    program = "import sys; had = set(sys.modules); import arva_hil.links; print(*set(sys.modules) - had)"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert "arva_hil.links.url" in loaded
    assert not loaded & {
        "serial",
        "socket",
        "dataclasses",
        "inspect",
        "numpy",
        "yaml",
        "arva_hil.links.serial",
    }
