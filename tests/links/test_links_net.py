"""What only UDP, TCP and standard output do."""

from __future__ import annotations

import errno
import io
import os
import re
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from arva_hil.clock import StepClock
from arva_hil.links import Link, LinkError
from arva_hil.links.stdout import StdoutLink, open_stdout
from arva_hil.links.tcp import TcpLink, TcpServerLink
from arva_hil.links.udp import UdpInLink, UdpOutLink
from tests.every import every
from tests.free_ports import free_port
from tests.links.links_waiting import DEADLINE_S, Keep, receive, until


@pytest.fixture
def udpin(keep: Keep) -> UdpInLink:
    return keep(UdpInLink())


@pytest.fixture
def tcpin(keep: Keep) -> TcpServerLink:
    return keep(TcpServerLink())


# UDP


def come(link: Link) -> list[tuple[Any, bytes]]:
    """What several senders sent, once something is there."""
    until(link.ready, link)
    return link.receive()


class Several:
    """A link, and the ends of two that send to it: `ends` by name, and `senders`, as the link knows them."""

    def __init__(self, kind: type[UdpInLink] | type[TcpServerLink], keep: Keep) -> None:
        self.link = keep(kind())
        assert (self.link.read(), self.link.write(b"to nobody"), self.link.dropped) == (b"", False, 1)
        end = UdpOutLink if kind is UdpInLink else TcpLink
        self.ends = {name: keep(end("127.0.0.1", self.link.port)) for name in ("one", "other")}
        self.senders: dict[Any, str] = {}
        for name, there in self.ends.items():
            there.write(name.encode())
            ((sender, data),) = come(self.link)
            assert (sender not in self.senders, data) == (True, name.encode())
            self.senders[sender] = name

    def sender(self, name: str | None) -> Any:
        return next((sender for sender, known in self.senders.items() if known == name), None)


Step = Callable[[Several], object]


def sends(name: str, data: bytes) -> Step:
    return lambda of: of.ends[name].write(data)


def comes(*wanted: tuple[str, bytes]) -> Step:
    """Something is there, and this is read; nothing if nobody is named."""

    def step(of: Several) -> None:
        until(of.link.ready, of.link)
        assert [(of.senders[sender], data) for sender, data in of.link.receive()] == [*wanted]

    return step


def follows(peer: str | None, *others: str) -> Step:
    return lambda of: of.link.follow(of.sender(peer), [of.sender(one) for one in others])


def writes(data: bytes, *names: str) -> Step:
    """All of these get it, and no other end."""

    def step(of: Several) -> None:
        assert of.link.write(data) == bool(names)
        assert all(receive(of.ends[name], len(data)) == data for name in names)
        assert all(there.read() == b"" for name, there in of.ends.items() if name not in names)

    return step


def pins(of: Several) -> None:
    of.link.pin()


def leaves(name: str) -> Step:
    def step(of: Several) -> None:
        of.ends.pop(name).close()
        until(lambda: of.link.read() == b"" and of.link.away, of.link)

    return step


def lost(name: str) -> Step:
    """It leaves, and that is for good."""

    def step(of: Several) -> None:
        of.ends.pop(name).close()
        with pytest.raises(LinkError, match=r"lost: closed by the far end$"):
            until(lambda: of.link.receive() and False, of.link)

    return step


def counts(**wanted: object) -> Step:
    def step(of: Several) -> None:
        assert {name: getattr(of.link, name) for name in wanted} == wanted

    return step


def silent_is(name: str) -> Step:
    def step(of: Several) -> None:
        assert f"lost: {'{}:{}'.format(*of.sender(name))} is silent" in of.link.why

    return step


def stranger_is(name: str) -> Step:
    def step(of: Several) -> None:
        assert of.link.stranger == "{}:{}".format(*of.sender(name))

    return step


ONE, OTHER = ("one", b"first"), ("other", b"second")


@pytest.mark.parametrize("kind", [UdpInLink, TcpServerLink])
@every(
    "story, steps",
    [
        (
            "every write goes to all, until there is a peer, which alone is answered",
            [
                *(writes(b"frame", "one", "other"), sends(*OTHER), comes(OTHER), sends(*ONE), comes(ONE)),
                *(follows("one"), sends(*OTHER), comes(OTHER), counts(strangers=1, losses=0), stranger_is("other")),
                *(sends(*ONE), comes(ONE), writes(b"answer", "one")),
            ],
        ),
        (
            "before there is a peer it answers only whom it is told to",
            [follows(None, "one"), writes(b"hello", "one"), follows(None), writes(b"to nobody"), counts(dropped=2)],
        ),
        (
            "another peer in the place of one is a loss and a return",
            [
                *(follows(None, "one"), follows("one"), counts(losses=0, renewals=0), follows("other")),
                *(counts(losses=1, renewals=1, returns=1), silent_is("one"), writes(b"answer", "other")),
            ],
        ),
        (
            "once pinned nobody takes the peer's place",
            [
                *(follows("one"), pins, follows("other"), sends(*OTHER), comes(), sends(*ONE), comes(ONE)),
                *(writes(b"answer", "one"), counts(losses=0, strangers=1)),
            ],
        ),
    ],
)
def test_of_several_that_send(story: str, steps: list[Step], kind: type[Any], keep: Keep) -> None:
    of = Several(kind, keep)
    for step in steps:
        step(of)


@every(
    "story, steps",
    [
        (  # the session does not know yet that the peer has left when it names it again
            "a vehicle that leaves is lost, whoever else is connected",
            [
                *(follows("one"), leaves("one"), follows("one"), writes(b"to nobody"), sends(*OTHER), comes(OTHER)),
                *(follows("other"), counts(losses=1, renewals=1, away=False), writes(b"answer", "other")),
            ],
        ),
        (
            "once pinned a vehicle that leaves is lost for good",
            [follows("one"), pins, sends(*OTHER), comes(), lost("one"), sends(*OTHER), comes(), writes(b"to nobody")],
        ),
    ],
)
def test_of_several_clients_one_leaves(story: str, steps: list[Step], keep: Keep) -> None:
    of = Several(TcpServerLink, keep)
    for step in steps:
        step(of)


def test_udpin_joins_what_each_sent_in_the_order_of_their_first(keep: Keep) -> None:
    of = Several(UdpInLink, keep)
    for step in (
        sends("other", b"a"),
        sends("one", b"b"),
        sends("other", b"c"),
        comes(("other", b"ac"), ("one", b"b")),
    ):
        step(of)


def test_what_the_vehicle_sent_comes_before_all_else(keep: Keep) -> None:
    of = Several(UdpInLink, keep)
    for step in (
        follows("one"),
        sends("other", b"a"),
        sends("one", b"b"),
        comes(("one", b"b"), ("other", b"a")),
    ):
        step(of)


def test_every_consumer_that_sent_a_datagram_gets_the_frames(udpin: UdpInLink, keep: Keep) -> None:
    consumers = [keep(UdpOutLink("127.0.0.1", udpin.port)) for _ in range(9)]
    for consumer in consumers:
        consumer.write(b"!")
        assert receive(udpin, 1) == b"!"
    assert udpin.write(b"frame")
    assert [receive(consumer, 5) for consumer in consumers[1:]] == [b"frame"] * 8  # the eight heard last
    assert consumers[0].read() == b""


def test_one_write_is_one_datagram_and_several_are_read_joined(udpin: UdpInLink) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as far:
        far.settimeout(DEADLINE_S)
        far.connect(("127.0.0.1", udpin.port))
        for datagram in (b"a", b"", b"bb", b"c" * 60_000):  # an empty datagram is no end
            far.send(datagram)
        until(udpin.ready, udpin)
        assert udpin.read() == b"abb" + b"c" * 60_000  # the loopback delivers at once
        for data in (b"x" * 1000, b"y"):
            assert udpin.write(data)
        assert [far.recv(65536), far.recv(65536)] == [b"x" * 1000, b"y"]


def test_what_a_fleet_sends_while_the_program_is_held_up_is_not_lost(udpin: UdpInLink) -> None:
    """64 vehicles send 500 packets in 80 ms; the system keeps 256 of them unless it is asked for more."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        for _ in range(500):
            vehicle.sendto(b"x" * 40, ("127.0.0.1", udpin.port))
    came = b"".join(iter(udpin.read, b""))
    assert len(came) == 500 * 40


def test_udpout_does_not_mind_that_nobody_listens_yet(keep: Keep) -> None:
    port = free_port(socket.SOCK_DGRAM)
    link = keep(UdpOutLink("127.0.0.1", port))
    for _ in range(5):
        assert link.write(b"lost")
        assert link.read() == b""
    late = keep(UdpInLink("127.0.0.1", port))
    assert link.write(b"heard")  # the refusal of the one before costs no datagram
    assert receive(late, 5) == b"heard"
    assert link.dropped == 0


@pytest.mark.parametrize("number", [errno.ENETUNREACH, errno.EPERM, errno.ENOBUFS, errno.EADDRNOTAVAIL])
def test_a_datagram_that_cannot_go_is_counted(udpin: UdpInLink, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    """No network, a firewall, no memory, an address that is gone: all of them may pass."""

    def unreachable(data: bytes) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(udpin, "_transmit", unreachable)
    assert not udpin.write(b"x")
    assert udpin.dropped == 1


@pytest.mark.parametrize("followed", [True, False])
def test_a_closed_udpin_that_nobody_wrote_to_takes_no_bytes(udpin: UdpInLink, followed: bool) -> None:
    if followed:
        udpin.follow(None)
    udpin.close()
    with pytest.raises(LinkError, match="is closed"):
        udpin.write(b"x")


@pytest.mark.parametrize("size", [70_000])
def test_a_datagram_too_long_is_the_callers_mistake(keep: Keep, size: int) -> None:
    link = keep(UdpOutLink("127.0.0.1", 14550))
    with pytest.raises(ValueError, match="70000 bytes do not fit in one datagram"):
        link.write(b"x" * size)


def test_listening_is_on_the_loopback_unless_told(udpin: UdpInLink, tcpin: TcpServerLink) -> None:
    assert udpin._socket.getsockname()[0] == "127.0.0.1"
    assert tcpin._listener.getsockname()[0] == "127.0.0.1"
    assert udpin.name == f"udpin:127.0.0.1:{udpin.port}"
    assert tcpin.name == f"tcpin:127.0.0.1:{tcpin.port}"


def test_an_address_in_use_says_who_has_it(
    udpin: UdpInLink, tcpin: TcpServerLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = r"another program listens there, held by 1 \(init\); "
    monkeypatch.setattr("arva_hil.links.tcp.listeners", lambda port, protocol: ["1 (init)"])
    with pytest.raises(LinkError, match=held + "let it forward, as QGroundControl can .* to udpin:127.0.0.1:14445"):
        UdpInLink("127.0.0.1", udpin.port)
    with pytest.raises(LinkError, match=held + "take another port"):
        TcpServerLink("127.0.0.1", tcpin.port)


def test_an_address_that_this_program_has_itself_is_no_other_programs(udpin: UdpInLink, tcpin: TcpServerLink) -> None:
    for kind, taken in ((UdpInLink, udpin), (TcpServerLink, tcpin)):
        with pytest.raises(LinkError, match="this program listens at that port already; give each link its own"):
            kind("0.0.0.0", taken.port)


def test_an_address_in_use_says_how_to_find_who_where_that_cannot_be_seen(
    udpin: UdpInLink, tcpin: TcpServerLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("arva_hil.links.tcp.listeners", lambda port, protocol: [])
    with pytest.raises(LinkError, match=f"another program listens there; .*ss -lunp 'sport = :{udpin.port}'"):
        UdpInLink("127.0.0.1", udpin.port)
    with pytest.raises(LinkError, match=f"another program listens there; .*ss -ltnp 'sport = :{tcpin.port}'"):
        TcpServerLink("127.0.0.1", tcpin.port)


@pytest.mark.parametrize("kind", [UdpInLink, TcpServerLink])
def test_an_address_that_is_not_ours(kind: Callable[[str, int], Link]) -> None:
    with pytest.raises(LinkError, match="is not an address of this machine"):
        kind("192.0.2.1", 14550)


@pytest.mark.parametrize("kind", [UdpInLink, UdpOutLink, TcpServerLink, TcpLink])
def test_an_unknown_host(kind: Callable[[str, int], Link], monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*args: Any, **kwargs: Any) -> None:
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    with pytest.raises(LinkError, match="unknown host 'drone'; Name or service not known"):
        kind("drone", 14550)


@pytest.mark.skipif(not socket.has_ipv6, reason="no IPv6")
@pytest.mark.parametrize(("server", "client"), [(UdpInLink, UdpOutLink), (TcpServerLink, TcpLink)])
def test_ipv6(server: Any, client: Any, keep: Keep) -> None:
    try:
        near = keep(server("::1"))
    except LinkError as error:
        pytest.skip(str(error))
    assert keep(client("::1", near.port)).write(b"six")
    assert receive(near, 3) == b"six"
    assert "[::1]:" in near.name


# TCP


@pytest.mark.parametrize(("answered", "who"), [(True, "the autopilot"), (False, "the program that listens there")])
def test_nobody_there(answered: bool, who: str) -> None:
    """A consumer of frames is no autopilot."""
    with pytest.raises(LinkError, match=rf"^tcp:127.0.0.1:1: connection refused; is {who} running\?$"):
        TcpLink("127.0.0.1", 1, answered=answered)


def test_the_later_ports_of_a_simulator_say_when_they_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuses(*_: Any) -> None:
        raise ConnectionRefusedError

    monkeypatch.setattr(socket, "create_connection", refuses)
    for port in (5762, 5763):
        with pytest.raises(LinkError, match=r"listens there only once a client is connected to 5760$"):
            TcpLink("127.0.0.1", port)


def test_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def silent(*args: Any) -> None:
        asked.append(args)
        raise TimeoutError("timed out")

    monkeypatch.setattr(socket, "create_connection", silent)
    with pytest.raises(LinkError, match="no answer in 5 s"):
        TcpLink("192.0.2.1", 5760)
    assert asked == [(("192.0.2.1", 5760), 5.0)]


def test_small_writes_go_at_once(tcpin: TcpServerLink, keep: Keep) -> None:
    client = keep(TcpLink("127.0.0.1", tcpin.port))
    until(lambda: tcpin.read() == b"" and tcpin._clients, tcpin)
    for link in (client, *tcpin._clients.values()):
        assert link.sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_a_server_that_only_writes_finds_its_client(tcpin: TcpServerLink, keep: Keep) -> None:
    client = keep(TcpLink("127.0.0.1", tcpin.port))
    until(tcpin.ready, tcpin)
    assert tcpin.write(b"frame")
    assert receive(client, 5) == b"frame"
    client.close()
    for _ in range(1000):
        if not tcpin.write(b"frame"):
            break
    assert tcpin.dropped == 1
    second = keep(TcpLink("127.0.0.1", tcpin.port))
    until(tcpin.ready, tcpin)
    assert tcpin.write(b"again")
    assert receive(second, 5) == b"again"


def clients(server: TcpServerLink, keep: Keep, count: int) -> list[Link]:
    """So many that the server has taken in, in this order."""
    made = []
    for n in range(1, count + 1):
        made.append(keep(TcpLink("127.0.0.1", server.port)))
        until(lambda: server.receive() is not None and len(server._clients) == n, server)  # noqa: B023
    return made


def test_a_slow_client_delays_no_other_gets_whole_writes_only_and_is_dropped_in_the_end(keep: Keep) -> None:
    clock = StepClock(50.0)
    server = TcpServerLink(clock=clock)
    keep(server)
    slow, quick = clients(server, keep, 2)
    stuck = next(iter(server._clients.values()))

    def write(data: bytes) -> None:
        assert server.write(data)
        assert receive(quick, len(data)) == data

    def fill() -> None:
        before = stuck.dropped
        while stuck.dropped == before:
            write(b"x" * 99_991)

    fill()
    for _ in range(10):
        clock.wait(clock.now() + 0.9)
        write(b"frame")
    got = b""
    while stuck._rest or not got.endswith(b"next"):  # held up for 9 s only, it goes on where it stopped
        got += slow.read()
        server.read()
        if not stuck._rest and b"next" not in got:
            write(b"next")
            got += receive(slow, 4)
    assert re.fullmatch(rb"(x{99991}|frame|next)+", got)
    for _ in range(60):  # 12 are enough, unless the system has taken some more in the meantime
        fill()
        clock.wait(clock.now() + 0.9)
        if len(server._clients) == 1:
            break
    assert len(server._clients) == 1
    assert server.dropped == server.losses == 0


def test_a_ninth_client_waits_until_another_has_left(tcpin: TcpServerLink, keep: Keep) -> None:
    eight = clients(tcpin, keep, 8)
    ninth = keep(TcpLink("127.0.0.1", tcpin.port))
    assert tcpin.read() == b""
    assert not tcpin.ready()  # or no loop would ever wait again
    eight[3].close()
    until(lambda: tcpin.read() == b"" and tcpin.write(b"frame") and ninth.read() == b"frame", tcpin)
    assert len(tcpin._clients) == 8
    assert tcpin.losses == 0


def test_of_many_clients_that_are_not_the_vehicle_one_gives_way_to_the_next(tcpin: TcpServerLink, keep: Keep) -> None:
    vehicle, *_ = clients(tcpin, keep, 8)
    vehicle.write(b"heartbeat")
    ((peer, _),) = come(tcpin)
    tcpin.follow(peer)
    for _ in range(20):
        keep(TcpLink("127.0.0.1", tcpin.port)).write(b"?")
        until(lambda: b"?" in tcpin.read(), tcpin)
    vehicle.write(b"still here")
    assert come(tcpin) == [(peer, b"still here")]
    assert (len(tcpin._clients), tcpin.losses) == (8, 0)


def test_the_link_is_lost_with_the_last_client_and_back_with_the_next(tcpin: TcpServerLink, keep: Keep) -> None:
    for n in range(1, 4):
        pair = clients(tcpin, keep, 2)
        assert (tcpin.losses, tcpin.returns, tcpin.away) == (n - 1, n - 1, False)
        for client in pair:
            assert not tcpin.away
            client.write(b"hello")
            assert receive(tcpin, 5) == b"hello"
            client.close()
            until(lambda: tcpin.read() == b"" and client.name and len(tcpin._clients) < 2, tcpin)  # noqa: B023
        until(lambda: tcpin.read() == b"" and tcpin.away, tcpin)
        assert "lost: closed by the far end, waiting for the next client" in tcpin.why
    assert not tcpin.write(b"to nobody")


def resetting(server: TcpServerLink, port: int = 0) -> socket.socket:
    """A client from this port, whose `close` resets the connection."""
    sock = socket.socket()
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    sock.bind(("127.0.0.1", port))
    sock.connect(("127.0.0.1", server.port))
    return sock


def test_a_client_that_resets_and_comes_again_from_the_same_port_is_a_new_one(tcpin: TcpServerLink) -> None:
    with resetting(tcpin) as first:
        first.sendall(b"half a pack")
        ((peer, _),) = come(tcpin)
        tcpin.follow(peer)
    with resetting(tcpin, peer[1]) as second:
        until(tcpin.ready, tcpin)
        assert tcpin.receive() == []
        assert not tcpin.ready()  # or no loop would ever wait again
        assert (tcpin.losses, tcpin.peer, len(tcpin._clients)) == (1, None, 1)
        assert "lost: it has connected again, waiting for the next client" in tcpin.why
        second.sendall(b"a packet")
        assert come(tcpin) == [(peer, b"a packet")]
        tcpin.follow(peer)
        assert (tcpin.losses, tcpin.returns) == (1, 1)


def test_a_pinned_client_that_resets_and_comes_again_from_the_same_port_has_left(tcpin: TcpServerLink) -> None:
    with resetting(tcpin) as first:
        first.sendall(b"a packet")
        ((peer, _),) = come(tcpin)
        tcpin.follow(peer)
        tcpin.pin()
    with resetting(tcpin, peer[1]) as second:
        until(tcpin.ready, tcpin)
        with pytest.raises(LinkError, match="lost: it has connected again"):
            tcpin.receive()
        assert second.recv(1) == b""


def test_a_client_that_only_listens_may_close_its_sending_side(tcpin: TcpServerLink, keep: Keep) -> None:
    """As `ncat HOST PORT < /dev/null` does; it gives way when its place is needed."""
    first = socket.create_connection(("127.0.0.1", tcpin.port), DEADLINE_S)
    first.shutdown(socket.SHUT_WR)
    until(lambda: tcpin.read() == b"" and any(client.mute for client in tcpin._clients.values()), tcpin)
    assert not tcpin.ready()  # or no loop would ever wait again
    assert tcpin.write(b"frame")
    assert first.recv(5) == b"frame"
    for _ in range(8):
        keep(TcpLink("127.0.0.1", tcpin.port))
        until(tcpin.ready, tcpin)
        assert tcpin.read() == b""
    assert first.recv(1) == b""
    assert (len(tcpin._clients), tcpin.losses) == (8, 0)
    first.close()


# Standard output


def test_stdout_writes_everything_even_to_a_slow_non_blocking_pipe() -> None:
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    got = bytearray()

    def drain() -> None:
        while chunk := os.read(reader, 1000):
            got.extend(chunk)

    thread = threading.Thread(target=drain, daemon=True)
    thread.start()
    with open(writer, "wb", buffering=0) as file:
        link = StdoutLink(file)
        for _ in range(5):
            assert link.write(bytes(range(256)) * 400)
    thread.join(DEADLINE_S)
    os.close(reader)
    assert bytes(got) == bytes(range(256)) * 2000
    assert link.dropped == 0


@pytest.mark.parametrize("buffering", [0, -1])
def test_stdout_whose_reader_went(buffering: int) -> None:
    reader, writer = os.pipe()
    file = open(writer, "wb", buffering=buffering)  # noqa: SIM115
    link = StdoutLink(file)
    assert link.write(b"x")
    assert os.read(reader, 10) == b"x"  # it is not kept in a buffer
    os.close(reader)
    with pytest.raises(LinkError, match="the reader of this pipe went away"):
        link.write(b"x")
    try:
        file.close()
    except BrokenPipeError:
        assert buffering


def test_stdout_of_a_full_disk_and_of_a_closed_link() -> None:
    with open("/dev/full", "wb", buffering=0) as file, pytest.raises(LinkError, match="No space left"):
        StdoutLink(file).write(b"x")
    link = StdoutLink(memory := io.BytesIO())
    assert link.write(b"kept")
    assert link.read() == b""
    assert not link.ready()
    link.close()
    link.close()
    with pytest.raises(LinkError, match="closed"):
        link.write(b"x")
    assert memory.getvalue() == b"kept"  # closing the link leaves the file open


def test_a_disk_that_fills_up_keeps_whole_writes_only(tmp_path: Path) -> None:
    class Full(io.FileIO):
        room = 12

        def write(self, data: Any) -> int:
            if not self.room:
                raise OSError(28, "No space left on device")
            taken = super().write(bytes(data)[: self.room])
            self.room -= taken
            return taken

    path = tmp_path / "frames.bin"
    with Full(path, "w") as file:
        link = StdoutLink(file)
        assert link.write(b"frame one")
        with pytest.raises(LinkError, match="cannot be written: No space left"):
            link.write(b"frame two")
    assert path.read_bytes() == b"frame one"


def test_stdout_whose_reader_stands_still_drops_whole_writes_when_told_to() -> None:
    reader, writer = os.pipe()
    asked = 0

    def give_up() -> bool:
        nonlocal asked
        asked += 1
        return asked % 3 == 0

    with open(writer, "wb", buffering=0) as file:
        link = StdoutLink(file)
        link.give_up = give_up
        taken = 0
        while link.write(b"x" * 997):
            taken += 1
        assert (link.dropped, asked) == (1, 3)
        os.set_blocking(reader, False)
        got = b""
        while len(got) < taken * 997:
            got += os.read(reader, 65536)
        assert link.write(b"next")
        assert os.read(reader, 65536) == b"next"
    os.close(reader)


def test_a_program_whose_reader_went_chooses_its_own_exit_code() -> None:
    program = (
        "import sys; from arva_hil.links.stdout import *\n"
        "try: open_stdout().write(b'x')\n"
        "except LinkError: sys.exit(3)"  # what a buffer kept would fail once more now: exit code 120
    )
    reader, writer = os.pipe()
    os.close(reader)
    buffered = {**os.environ, "PYTHONUNBUFFERED": ""}
    run = subprocess.run([sys.executable, "-c", program], stdout=writer, stderr=subprocess.PIPE, env=buffered)
    os.close(writer)
    assert (run.returncode, run.stderr) == (3, b"")


def test_open_stdout_of_a_replaced_stdout(monkeypatch: pytest.MonkeyPatch) -> None:
    buffer = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(buffer))
    open_stdout().write(b"frame")
    assert buffer.getvalue() == b"frame"
