"""Which of several links are read: those with bytes, and those that have to be asked."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator

import pytest

from arva_hil.clock import RealClock
from arva_hil.links import Link, memory
from arva_hil.runtime.drivers import ReadyLinks


class Wire(Link):
    """A link on one end of a socket pair; the other one is `far`."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.far, self.near = socket.socketpair()

    def fileno(self) -> int | None:
        return self.near.fileno() if self.near.fileno() >= 0 else None

    def read(self) -> bytes:
        return self.near.recv(100)

    def write(self, data: bytes) -> bool:
        return bool(self.near.send(data))

    def close(self) -> None:
        self.far.close()
        self.near.close()


@pytest.fixture
def wires() -> Iterator[dict[str, Wire]]:
    every = {name: Wire(name) for name in ("a", "b", "c")}
    yield every
    for wire in every.values():
        wire.close()


def test_those_with_bytes_are_named_in_their_order_and_no_other(wires: dict[str, Wire]) -> None:
    ready = ReadyLinks(wires)
    assert (ready.names(), ready.ready()) == ([], False)
    wires["c"].far.send(b"x")
    wires["a"].far.send(b"x")
    assert ready.ready()
    assert ready.names() == ["a", "c"]
    wires["a"].read()
    assert ready.names() == ["c"]


def test_a_clock_that_waits_for_them_wakes_when_bytes_come(wires: dict[str, Wire]) -> None:
    ready, clock = ReadyLinks(wires), RealClock()
    wires["b"].far.send(b"x")
    clock.wait(clock.now() + 60, ready.waitables)
    assert ready.names() == ["b"]


def test_a_new_descriptor_with_an_old_number_is_watched(wires: dict[str, Wire]) -> None:
    ready, wire = ReadyLinks(wires), wires["b"]
    number = wire.near.fileno()
    wire.close()
    wire.far, near = socket.socketpair()
    if near.fileno() != number:
        os.dup2(near.fileno(), number)
        near.close()
        near = socket.socket(fileno=number)
    wire.near = near
    wire.far.send(b"x")
    ready.renew()
    assert ready.names() == ["b"]


def test_one_without_a_descriptor_is_always_read(wires: dict[str, Wire]) -> None:
    far, near = memory.pair()
    ready = ReadyLinks({**wires, "memory": near})
    assert ready.names() == ["memory"]
    wires["c"].far.send(b"x")
    far.write(b"x")
    assert ready.names() == ["c", "memory"]
    assert near in ready.waitables


def test_one_that_is_away_is_read_so_that_it_can_come_back(wires: dict[str, Wire]) -> None:
    ready = ReadyLinks(wires)
    wires["b"].losses = 1
    ready.renew()
    assert ready.names() == ["b"]
    wires["b"].returns = 1
    ready.renew()
    assert ready.names() == []


def test_one_that_is_gone_for_good_is_not_read_any_more(wires: dict[str, Wire]) -> None:
    ready = ReadyLinks(wires)
    for wire in wires.values():
        wire.far.send(b"x")
    ready.forget("b")
    assert ready.names() == ["a", "c"]
