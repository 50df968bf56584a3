"""One link for several users: each reads all of it, follows its own sender, and loses nothing to the others."""

from __future__ import annotations

import socket
from contextlib import closing

import pytest

from arva_hil.clock import StepClock
from arva_hil.events import LinkThere
from arva_hil.links import LinkError, memory
from arva_hil.links.base import Absent
from arva_hil.links.memory import SharedLink
from arva_hil.links.reconnecting import ReconnectingLink
from arva_hil.links.udp import UdpInLink
from arva_hil.runtime.link_monitor import LinkMonitor


def test_each_user_reads_everything_once_and_writes_go_out() -> None:
    near, far = memory.pair()
    link = SharedLink(near)
    one, other = link.user(), link.user()
    far.write(b"a")
    assert other.ready()
    assert one.read() == b"a"
    far.write(b"b")
    assert other.read() == b"ab"
    assert one.read() == b"b"
    assert not one.ready()
    assert other.write(b"order")
    assert far.read() == b"order"


def test_who_does_not_read_fills_no_memory_and_takes_nothing_from_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "_MOST", 100)
    near, far = memory.pair()
    link = SharedLink(near)
    reads, sleeps = link.user(), link.user()
    for n in range(50):
        far.write(bytes([n]) * 30)
        assert reads.read() == bytes([n]) * 30
    assert len(sleeps.read()) <= 100


def test_a_user_that_is_pinned_reads_its_own_sender_alone() -> None:
    with (
        closing(UdpInLink()) as near,
        socket.socket(type=socket.SOCK_DGRAM) as a,
        socket.socket(type=socket.SOCK_DGRAM) as b,
    ):
        link = SharedLink(near)
        one, other = link.user(), link.user()
        for sender in (a, b):
            sender.sendto(b"1", ("127.0.0.1", near.port))
        senders = [sender for sender, _ in one.receive()]
        assert [port for _, port in senders] == [a.getsockname()[1], b.getsockname()[1]]
        one.follow(senders[0])
        one.pin()
        one.follow(senders[1])
        other.receive()
        b.sendto(b"2", ("127.0.0.1", near.port))
        a.sendto(b"3", ("127.0.0.1", near.port))
        assert one.receive() == [(senders[0], b"3")]
        assert dict(other.receive()) == {senders[0]: b"3", senders[1]: b"2"}
        assert near.losses == 0  # another one's sender is no loss


def test_each_user_knows_of_a_link_that_is_not_there_yet() -> None:
    clock, (near, _) = StepClock(), memory.pair()
    shared = SharedLink(ReconnectingLink(Absent("tcp", "refused"), lambda: near, clock, start=lambda job: job()))
    users = [shared.user(), shared.user()]
    assert [(user.away, user.why) for user in users] == [(True, "tcp: refused")] * 2
    monitor = LinkMonitor("autopilot", users[0])
    clock.wait(1.0)
    assert users[0].receive() == []
    assert not any(user.away for user in users)
    assert [type(event) for event in monitor.poll(1.0)] == [LinkThere]


def test_the_end_of_the_link_is_said_to_each_user() -> None:
    near, far = memory.pair()
    link = SharedLink(near)
    users = [link.user(), link.user()]
    far.close()
    for user in users:
        assert user.ready()
        with pytest.raises(LinkError, match="closed by the far end"):
            user.receive()
