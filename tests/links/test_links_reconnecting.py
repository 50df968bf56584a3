"""Links that are lost and come back."""

from __future__ import annotations

import errno
import glob
import os
import select
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import serial

from arva_hil.clock import RealClock, StepClock
from arva_hil.links import Address, Link, LinkEnded, LinkError, parse, reconnecting
from arva_hil.links.base import Absent
from arva_hil.links.memory import MemoryLink, pair
from arva_hil.links.processes import far_program, holders
from arva_hil.links.pty import PtyLink
from arva_hil.links.reconnecting import Barred, Job, ReconnectingLink, SerialOpener, open_reconnecting
from arva_hil.links.serial_ports import stable_name
from arva_hil.links.tcp import TcpLink, TcpServerLink
from tests.every import every
from tests.free_ports import free_port
from tests.links.links_waiting import Keep, receive, until


class Cable:
    """A link under test, its far end, and what opening it does: give a new pair, refuse, or fail."""

    def __init__(self, start: Callable[[Job], None] = lambda job: job()) -> None:
        self.clock = StepClock(100.0)
        self.tries: list[float] = []
        self.there = False
        self.fails: Exception = LinkError("cable", "is not there")
        self.made: list[MemoryLink] = []
        near, self.far = pair(capacity=1000)
        self.link = ReconnectingLink(near, self._open, self.clock, start=start)

    def _open(self) -> Link:
        self.tries.append(round(self.clock.now() - 100.0, 6))
        if not self.there:
            raise self.fails
        near, self.far = pair(capacity=1000)
        self.made.append(near)
        return near

    def pull(self) -> None:
        self.there = False
        self.far.close()

    def wait(self, seconds: float) -> bytes:
        """Let time pass, as a loop does; what was read."""
        read = b""
        for _ in range(round(seconds * 100)):
            read += self.link.read()
            self.clock.wait(self.clock.now() + 0.01)
        return read

    @property
    def counts(self) -> tuple[int, int]:
        return self.link.losses, self.link.returns


@pytest.fixture
def cable() -> Iterator[Cable]:
    made = Cable()
    yield made
    made.link.close()


# The wrapper, on memory links and a stepped clock


Step = Callable[[Cable], object]


def waits(seconds: float, read: bytes = b"") -> Step:
    """So long it is read, as by a loop."""

    def step(cable: Cable) -> None:
        assert cable.wait(seconds) == read

    return step


def writes(data: bytes, *, taken: bool = True) -> Step:
    def step(cable: Cable) -> None:
        assert cable.link.write(data) is taken
        assert not taken or cable.far.read() == data

    return step


def reads(data: bytes) -> Step:
    def step(cable: Cable) -> None:
        cable.far.write(data)
        assert cable.link.ready()
        assert cable.link.read() == data
        assert not cable.link.ready()

    return step


def is_away(losses: int, returns: int, **more: object) -> Step:
    """Its counts, and other attributes, while it is away."""

    def step(cable: Cable) -> None:
        assert cable.counts == (losses, returns)
        assert {name: getattr(cable.link, name) for name in more} == more

    return step


def is_there(losses: int, returns: int, **more: object) -> Step:
    return is_away(losses, returns, away=False, **more)


def fails(error: Exception) -> Step:
    return lambda cable: setattr(cable, "fails", error)


def plug(cable: Cable) -> None:
    cable.there = True


def asked(cable: Cable) -> None:
    assert cable.link.read() == b""
    assert not cable.link.ready()


pull = Cable.pull
LOST = "memory:a: lost: closed by the far end, searching for it"


@every(
    "story, steps",
    [
        (
            "a link that is there is just that",
            [writes(b"x"), reads(b"y"), waits(1.0), is_there(0, 0, name="memory:a")],
        ),
        (
            "a full link is not a lost one",
            [lambda cable: cable.link.write(b"x" * 1000), writes(b"y", taken=False), is_there(0, 0, dropped=1)],
        ),
        (
            "while it is away nothing is read",
            [pull, *[asked] * 5, is_away(1, 0, away=True, dropped=0, why=LOST)],
        ),
        (
            "while it is away writes are dropped",
            [pull, *[writes(b"x", taken=False)] * 5, is_away(1, 0, away=True, dropped=5, why=LOST)],
        ),
        (
            "it is found soon, and both ways work again",
            [
                step
                for n in range(1, 4)
                for step in (
                    *(pull, waits(3.0), plug, waits(0.45), writes(b"frame")),
                    *(reads(b"bytes"), is_there(n, n, renewals=n)),
                )
            ],
        ),
        (
            "bytes prove a connection, and so does time",
            [
                *(pull, plug, waits(0.1), is_away(1, 0, renewals=1), reads(b"x"), is_away(1, 1)),
                *(pull, plug, waits(0.1), is_away(2, 1), waits(0.4), is_away(2, 2)),
            ],
        ),
        (
            "an OSError while opening means not yet",
            [pull, fails(OSError(24, "Too many open files")), waits(1.0), plug, waits(0.8), is_away(1, 1)],
        ),
        (
            "why it cannot be opened is known, and it is tried on",
            [
                *(pull, waits(1.0), is_away(1, 0, why=LOST), fails(Barred("cable", "busy", "close the other program"))),
                *(waits(1.0), is_away(1, 0, why="cable: busy; close the other program"), plug, waits(0.8)),
                *(is_there(1, 1), pull, asked, is_away(2, 1, why=LOST)),
            ],
        ),
    ],
)
def test_a_cable_that_is_pulled_and_plugged(story: str, steps: list[Step]) -> None:
    cable = Cable()
    for step in steps:
        step(cable)
    cable.link.close()


def test_a_link_that_was_never_lost_is_not_opened_again(cable: Cable) -> None:
    cable.wait(1.0)
    assert cable.tries == []


def test_one_that_is_not_there_yet_is_away_from_the_start_and_that_is_no_loss() -> None:
    cable = Cable()
    absent = Absent("cable", "no such cable", "plug it in")
    cable.link = ReconnectingLink(absent, cable._open, cable.clock, start=lambda job: job())
    for step in (
        *(is_away(0, 0, name="cable", why="cable: no such cable; plug it in"), waits(3.0), writes(b"x", taken=False)),
        *(is_away(0, 0, away=True), plug, waits(0.45), is_there(0, 0, renewals=1), writes(b"frame")),
        *(pull, waits(0.1), is_away(1, 0, away=True)),
    ):
        step(cable)
    cable.link.close()


def test_once_pinned_a_loss_is_for_good(cable: Cable) -> None:
    cable.link.pin()
    cable.pull()
    with pytest.raises(LinkError, match=r"lost: closed by the far end$"):
        cable.link.read()
    assert cable.tries == []


def test_tries_are_frequent_at_first_and_never_far_apart(cable: Cable) -> None:
    cable.pull()
    cable.wait(5.0)
    gaps = [round(b - a, 3) for a, b in zip([0.0, *cable.tries], cable.tries, strict=False)]
    assert gaps[0] == pytest.approx(0.05, abs=0.011)
    assert gaps == sorted(gaps)
    assert 0.3 < max(gaps) <= 0.5
    cable.there = True
    cable.wait(1.0)
    before = len(cable.tries)
    cable.pull()
    lost = cable.clock.now() - 100.0
    cable.wait(0.2)
    assert cable.tries[before] - lost == pytest.approx(0.05, abs=0.011)  # a new absence starts anew


def test_a_door_that_opens_and_shuts_is_one_loss_and_tried_no_more_often(cable: Cable) -> None:
    cable.pull()
    cable.there = True
    for _ in range(1000):
        cable.link.read()
        cable.far.close()
        cable.clock.wait(cable.clock.now() + 0.01)
    assert cable.counts == (1, 0)
    assert cable.link.renewals == len(cable.tries)
    assert 20 < len(cable.tries) < 35


def test_the_end_of_a_log_is_no_loss(cable: Cable, monkeypatch: pytest.MonkeyPatch) -> None:
    def ended(self: MemoryLink) -> bytes:
        raise LinkEnded("a.tlog", "end of log")

    monkeypatch.setattr(MemoryLink, "read", ended)
    with pytest.raises(LinkEnded):
        cable.link.read()
    assert cable.counts == (0, 0)


@pytest.mark.parametrize("by", ["read", "write"])
def test_an_error_nobody_foresaw_is_not_swallowed(cable: Cable, by: str) -> None:
    cable.pull()
    cable.fails = ZeroDivisionError("a mistake")
    cable.link.read()
    cable.clock.wait(cable.clock.now() + 0.06)
    with pytest.raises(ZeroDivisionError, match="a mistake"):
        cable.link.read() if by == "read" else cable.link.write(b"x")


@pytest.mark.parametrize("by", ["read", "write"])
def test_one_that_is_not_wanted_any_more_raises_and_stays_lost(by: str) -> None:
    cable = Cable()
    wanted = [True]
    cable.link = ReconnectingLink(
        cable.link, cable._open, cable.clock, start=lambda job: job(), wanted=lambda: wanted[0]
    )
    use = cable.link.read if by == "read" else lambda: cable.link.write(b"x")
    cable.link._link.close()  # type: ignore[union-attr]
    assert not use()
    assert cable.link.away
    cable.there = True
    cable.wait(0.5)
    assert cable.counts == (1, 1)
    cable.far.close()
    wanted[0] = False
    with pytest.raises(LinkError, match=r"lost: closed by the far end$"):
        use()
    for again in (cable.link.read, lambda: cable.link.write(b"x")):
        with pytest.raises(LinkError, match="is closed"):
            again()
    assert len(cable.tries) == 1
    assert cable.link.fileno() is None


def test_closing_twice_and_using_a_closed_one(cable: Cable) -> None:
    cable.link.close()
    cable.link.close()
    for use in (cable.link.read, lambda: cable.link.write(b"x")):
        with pytest.raises(LinkError, match="closed"):
            use()
    assert cable.link.fileno() is None
    assert not cable.link.ready()


def test_opening_takes_its_time_elsewhere_and_select_tells_when_it_is_done() -> None:
    jobs: list[Job] = []
    cable = Cable(jobs.append)
    cable.pull()
    cable.there = True
    cable.wait(0.5)
    assert len(jobs) == 1  # one try at a time
    assert cable.link.fileno() is not None
    assert not select.select([cable.link.fileno()], [], [], 0)[0]
    assert not cable.link.ready()
    jobs[0]()
    assert select.select([cable.link.fileno()], [], [], 0)[0]
    assert cable.link.ready()
    cable.far.write(b"x")
    assert cable.link.read() == b"x"
    assert cable.counts == (1, 1)
    cable.pull()
    cable.link.read()
    assert not select.select([cable.link.fileno()], [], [], 0)[0]  # nothing is left over for the next time
    cable.link.close()


def test_what_is_opened_after_all_was_closed_is_closed_too() -> None:
    jobs: list[Job] = []
    cable = Cable(jobs.append)
    cable.pull()
    cable.there = True
    cable.wait(0.1)
    cable.link.close()
    jobs[0]()
    with pytest.raises(LinkError, match="is closed"):
        cable.made[0].read()


# Real links


@pytest.fixture
def port() -> int:
    return free_port(socket.SOCK_STREAM)


@pytest.fixture
def descriptors(port: int) -> Iterator[None]:
    """None stays open, but the mark of the port that is taken before."""
    before = sorted(os.listdir("/proc/self/fd"))
    yield
    assert sorted(os.listdir("/proc/self/fd")) == before


def plugs(kind: str, folder: Path, port: int) -> tuple[str, Callable[[], Link]]:
    """Where the near end goes, and what makes the far end there."""
    if kind == "serial":
        path = str(folder / "line")
        return path, lambda: PtyLink(path)
    return f"tcp:127.0.0.1:{port}", lambda: TcpServerLink("127.0.0.1", port)


@pytest.mark.usefixtures("descriptors")
@pytest.mark.parametrize("kind", ["serial", "tcp"])
def test_unplugged_and_plugged_again(kind: str, tmp_path: Path, port: int) -> None:
    url, plug = plugs(kind, tmp_path, port)
    far = plug()
    near = open_reconnecting(url, clock=RealClock())
    for n in range(1, 4):
        near.write(b"whole")
        assert receive(far, 5) == b"whole"
        while near.write(b"x" * 99_991):  # the next far end gets nothing of what this one did not take
            assert n < 4
        far.close()
        until(lambda: near.read() == b"" and near.away, near)
        assert f"{url}: lost" in near.why
        far = plug()
        until(lambda: near.read() == b"" and not near.away, near)
        assert near.losses == near.returns == n
        far.write(b"hello")
        assert receive(near, 5) == b"hello"
    near.write(b"last")
    assert receive(far, 4) == b"last"
    near.close()
    far.close()


def test_a_serial_port_is_looked_for_by_its_stable_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As when ttyACM0 comes back as ttyACM1, and something else is ttyACM0 now."""
    name = tmp_path / "usb-ArduPilot_fmuv3"
    monkeypatch.setattr("glob.glob", lambda pattern: [str(name)])
    far = PtyLink()
    name.symlink_to(far.path)
    near = open_reconnecting(far.path, clock=RealClock())
    first = far.path
    far.close()
    until(lambda: near.read() == b"" and near.away, near)
    assert f"{first}: lost" in near.why
    assert f"searching for {name}" in near.why
    other = PtyLink()
    far = PtyLink()
    name.unlink()
    name.symlink_to(far.path)
    until(lambda: near.read() == b"" and not near.away, near)
    far.write(b"it is me")
    assert receive(near, 8) == b"it is me"
    near.write(b"hello")
    assert receive(far, 5) == b"hello"
    assert other.read() == b""
    for link in (near, far, other):
        link.close()


def test_a_symlink_somebody_chose_is_the_stable_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (device := tmp_path / "ttyACM0").touch()
    (by_id := tmp_path / "by-id").symlink_to(device)
    (chosen := tmp_path / "pixhawk").symlink_to(device)
    monkeypatch.setattr("glob.glob", lambda pattern: [str(by_id)])
    assert stable_name(str(device)) == str(by_id)
    assert stable_name(str(chosen)) == str(chosen)
    assert stable_name("COM5") == "COM5"


def processes(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """All processes there are, for a test: this one, and what it adds. Others may have ptys of other containers."""
    seen = [f"/proc/{os.getpid()}"]
    everything = glob.glob
    monkeypatch.setattr(glob, "glob", lambda pattern: seen if pattern.startswith("/proc/") else everything(pattern))
    return seen


def unnamed(path: str, monkeypatch: pytest.MonkeyPatch) -> Link:
    """A link to a pseudo-terminal known by its number only, which here, unlike the system's, can be given away."""
    with monkeypatch.context() as patch:
        patch.setattr(os.path, "islink", lambda path: False)
        return open_reconnecting(path, clock=RealClock())


def test_the_number_of_a_pseudo_terminal_may_be_another_programs_now(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only the program that had it before is believed to have it again."""
    seen = processes(monkeypatch)
    number = tmp_path / "number"
    far = PtyLink(str(number))
    near = unnamed(str(number), monkeypatch)
    far.close()
    until(lambda: near.read() == b"" and near.away, near)
    pair = os.openpty()
    command = [sys.executable, "-c", "import sys; print('mine', flush=True); sys.stdin.read()"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, pass_fds=pair) as other:
        assert other.stdin
        assert other.stdout.readline() == b"mine\n"
        seen.append(f"/proc/{other.pid}")
        number.symlink_to(os.ttyname(pair[1]))
        os.close(pair[0])
        os.close(pair[1])
        assert "sys.stdin.read()" in far_program(str(number))
        until(
            lambda: near.read() == b"" and f"{number}: now belongs to another program: {sys.executable}" in near.why,
            near,
        )
        assert (near.away, near.renewals) == (True, 0)
        other.stdin.close()
    number.unlink()
    again = PtyLink(str(number))
    until(lambda: near.read() == b"" and not near.away, near)
    assert near.write(b"hello")
    assert receive(again, 5) == b"hello"
    for link in (near, again):
        link.close()


def test_one_that_is_not_there_is_nobodys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All processes are looked through only for a pseudo-terminal that is there."""
    far = PtyLink()
    opener = SerialOpener(parse(far.path), StepClock())
    assert opener.path == far.path
    far.close()
    asked: list[str] = []
    monkeypatch.setattr("arva_hil.links.reconnecting.far_program", lambda path: asked.append(path) or "")
    monkeypatch.setattr(os.path, "exists", lambda path: False)
    with pytest.raises(LinkError, match=f"{far.path}: no such port"):
        opener()
    assert not asked


class Tries:
    """A serial port's opener that is called ten times a second; what came of it, and how often it was looked into."""

    def __init__(self, path: str, monkeypatch: pytest.MonkeyPatch) -> None:
        self.clock = StepClock(50.0)
        self.opener = SerialOpener(parse(path), self.clock)
        self.diagnoses = 0
        self._holders = holders
        monkeypatch.setattr("arva_hil.links.serial.holders", self._count)

    def _count(self, device: str) -> list[str]:
        self.diagnoses += 1
        return self._holders(device)

    def go(self, seconds: float) -> list[tuple[float, str]]:
        """When it was Barred, from now, and why; every try has to fail."""
        start, barred = self.clock.now(), []
        while self.clock.now() < start + seconds:
            with pytest.raises(LinkError) as caught:
                self.opener().close()
            if isinstance(caught.value, Barred):
                barred.append((self.clock.now() - start, str(caught.value)))
            self.clock.wait(self.clock.now() + 0.1)
        return barred


def test_a_port_that_stays_busy_is_told_once_with_who_has_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = str(tmp_path / "line")
    far = PtyLink(path)
    tries = Tries(path, monkeypatch)
    holder = serial.Serial(path, exclusive=True)
    ((when, why),) = tries.go(20.0)
    assert 0.95 < when < 1.25  # not while somebody only has a look at what was plugged in
    assert why.startswith(f"{path}: busy: held by ")
    assert f" {os.getpid()} (" in why
    assert why.endswith("; close the other program")
    assert tries.diagnoses == 1
    holder.close()
    tries.opener().close()
    with serial.Serial(path, exclusive=True):
        assert tries.go(0.8) == []
    tries.opener().close()
    with serial.Serial(path, exclusive=True):
        assert len(tries.go(5.0)) == 1
    assert tries.diagnoses == 2
    far.close()
    assert tries.go(5.0) == []
    assert tries.diagnoses == 2


def test_one_that_is_free_when_it_is_looked_into_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = str(tmp_path / "line")
    far = PtyLink(path)
    tries = Tries(path, monkeypatch)
    whole = reconnecting.open_link

    def opens(address: Address, *, clock: StepClock, brief: bool) -> Link:
        if brief:
            raise LinkError(path, "cannot be opened") from OSError(errno.EBUSY, "Device or resource busy")
        return whole(address, clock=clock)

    monkeypatch.setattr(reconnecting, "open_link", opens)
    for _ in range(2):  # and the next absence is a new one
        assert tries.go(0.95) == []
        tries.opener().close()
    far.close()


@pytest.mark.parametrize(
    ("number", "what"),
    [(errno.EACCES, "permission denied"), (errno.ENOENT, ""), (errno.EIO, ""), (errno.ENXIO, "")],
)
def test_of_what_stands_in_the_way_only_what_a_person_can_remove_is_told(
    number: int, what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = str(tmp_path / "line")
    far = PtyLink(path)
    tries = Tries(path, monkeypatch)

    def refuses(*_: Any, **__: Any) -> None:
        raise serial.SerialException(number, f"could not open port: {os.strerror(number)}")

    monkeypatch.setattr(serial, "Serial", refuses)
    barred = tries.go(10.0)
    assert len(barred) == bool(what)
    assert all(f"{path}: {what}; " in why for _, why in barred)
    far.close()


def test_what_is_no_pseudo_terminal_has_no_far_program() -> None:
    for path in ("/dev/null", "/dev/pts/no-such", "/dev/pts/ptmx", "COM5", ""):
        assert far_program(path) == ""


def test_a_connection_to_itself_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who connects to a free port often enough gets that port for its own end, and meets itself."""
    made: list[socket.socket] = []

    def itself(address: Any, timeout: float) -> socket.socket:
        made.append(sock := socket.socket())
        sock.bind(("127.0.0.1", 0))
        sock.connect(sock.getsockname())
        return sock

    monkeypatch.setattr(socket, "create_connection", itself)
    with pytest.raises(LinkError, match="connection refused"):
        TcpLink("127.0.0.1", 1)
    assert made[0].fileno() == -1


def test_a_far_end_that_vanished_without_a_word_is_lost_before_long(keep: Keep) -> None:
    """An answered connection sooner: one that reads no more is no autopilot, but may be a consumer in a debugger."""
    for answered, limit_ms in ((True, 5000), (False, 10_000)):
        server = TcpServerLink(answered=answered)
        client = TcpLink("127.0.0.1", server.port, answered=answered)
        keep(server), keep(client)
        until(lambda: server.read() == b"" and server._clients, server)  # noqa: B023
        for link in (client, *server._clients.values()):
            assert link.sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == limit_ms
            assert link.sock.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
            probing = [getattr(socket, f"TCP_KEEP{what}") for what in ("IDLE", "INTVL", "CNT")]
            assert [link.sock.getsockopt(socket.IPPROTO_TCP, option) for option in probing] == [5, 1, 5]
