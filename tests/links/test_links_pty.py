"""What consumers leave behind on a pseudo-terminal, and what killed programs leave in its place."""

from __future__ import annotations

import contextlib
import fcntl
import gc
import os
import signal
import subprocess
import sys
import termios
import time
import tty
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from arva_hil.clock import RealClock
from arva_hil.links import LinkError, pty
from arva_hil.links.base import Absent
from arva_hil.links.pty import PtyLink
from arva_hil.links.reconnecting import open_reconnecting
from arva_hil.links.serial import open_serial
from tests.links.links_waiting import DEADLINE_S, Keep, receive, until
from tests.signal_at import signalled

FRAME = bytes(range(256))  # with all that a cooked terminal would change, take for itself or keep back


def cook(fd: int) -> None:
    """As a shell leaves its terminal."""
    mode = termios.tcgetattr(fd)
    mode[0] |= termios.ICRNL | termios.IXON
    mode[1] |= termios.OPOST
    mode[3] |= termios.ICANON | termios.ECHO | termios.ISIG | termios.IEXTEN
    termios.tcsetattr(fd, termios.TCSANOW, mode)


def exclusive(fd: int) -> bool:
    return any(fcntl.ioctl(fd, 0x80045440, bytes(4)))  # TIOCGEXCL


def consumer(link: PtyLink) -> int:
    """A program that opens the terminal and sets nothing."""
    return os.open(link.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)


@pytest.fixture
def line(keep: Keep) -> PtyLink:
    return keep(PtyLink())


def test_a_terminal_left_cooked_is_raw_for_the_next(line: PtyLink) -> None:
    for _ in range(3):
        fd = consumer(line)
        cook(fd)
        os.close(fd)
        assert line.write(FRAME)
        fd = consumer(line)
        os.set_blocking(fd, True)
        assert os.read(fd, 1000) == FRAME
        os.close(fd)
    assert line.read() == b""  # nor is anything sent back


def test_a_reader_may_also_open_it_before_anything_is_written(line: PtyLink) -> None:
    fd = consumer(line)
    cook(fd)
    os.close(fd)
    fd = consumer(line)
    os.set_blocking(fd, True)
    assert line.write(FRAME)
    assert os.read(fd, 1000) == FRAME
    os.close(fd)


def test_while_a_consumer_has_it_open_its_settings_are_its_own(line: PtyLink) -> None:
    fd = consumer(line)
    cook(fd)
    assert line.write(b"$PARVA,1\nrest")
    until(lambda: line.read() == b"" and fcntl.ioctl(fd, termios.FIONREAD, bytes(4)).strip(b"\0"), line)
    assert os.read(fd, 1000) == b"$PARVA,1\n"  # a line at a time, as it wants it
    os.close(fd)


def test_the_loop_wakes_when_a_consumer_goes(line: PtyLink) -> None:
    clock = RealClock()
    fd = consumer(line)
    cook(fd)
    clock.wait(0.0, [line])
    line.read()
    os.close(fd)
    clock.wait(60.0, [line])
    assert clock.now() < DEADLINE_S
    assert line.read() == b""
    assert not line.ready()
    settings = termios.tcgetattr(line._slave)
    assert not settings[3] & (termios.ICANON | termios.ECHO)


@pytest.mark.parametrize("use", ["read", "write"])
def test_a_consumer_that_wanted_it_alone_and_died_bars_nobody(line: PtyLink, use: str) -> None:
    program = (
        "import fcntl, os, sys, termios\n"
        "fcntl.ioctl(os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY), termios.TIOCEXCL)\n"
        "print('alone', flush=True); sys.stdin.read()\n"
    )
    command = [sys.executable, "-c", program, line.path]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout.readline() == b"alone\n"
        line.read()
        line.write(b"frame")
        assert exclusive(line._slave)  # while it lives, that is its right
        child.kill()
    line.read() if use == "read" else line.write(b"frame")
    assert not exclusive(line._slave)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may hang up")
def test_a_hang_up_leaves_it_usable_and_raw(line: PtyLink) -> None:
    """As a login program does before it begins."""
    program = (
        "import ctypes, os, signal, sys\n"
        "signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "os.open(sys.argv[1], os.O_RDWR)\n"  # it leads its session: this is its controlling terminal now
        "sys.exit(ctypes.CDLL(None).vhangup())\n"
    )
    if subprocess.run([sys.executable, "-c", program, line.path], start_new_session=True).returncode:
        pytest.skip("hanging up is not allowed here")
    line.read()
    fd = consumer(line)
    os.set_blocking(fd, True)
    assert line.write(FRAME)
    assert os.read(fd, 1000) == FRAME
    os.write(fd, b"answer")
    assert receive(line, 6) == b"answer"
    os.close(fd)


@pytest.mark.parametrize("use", ["read", "write"])
def test_a_terminal_that_cannot_be_had_again_is_lost(line: PtyLink, use: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def hung_up(fd: int) -> None:
        raise termios.error(5, "Input/output error")

    def refuses(*_: Any) -> int:
        raise OSError(16, "Device or resource busy")

    os.close(fd := consumer(line))
    assert fd >= 0
    monkeypatch.setattr(termios, "tcgetattr", hung_up)
    monkeypatch.setattr(os, "open", refuses)
    with pytest.raises(LinkError, match=r"lost: the terminal cannot be set up again: .*busy"):
        line.read() if use == "read" else line.write(b"frame")


def test_where_the_system_does_not_tell_who_closes_it_works_as_ever(
    keep: Keep, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ctypes", None)
    line = keep(PtyLink())
    fd = consumer(line)
    tty.setraw(fd)
    assert line.write(b"frame")
    until(lambda: fcntl.ioctl(fd, termios.FIONREAD, bytes(4)).strip(b"\0"), line)
    assert os.read(fd, 1000) == b"frame"
    os.close(fd)
    assert line.read() == b""


# -- symlinks ------------------------------------------------------------------------------------------------


class Killed:
    """Pseudo-terminals of this machine for a test: `number` is one that a killed program had, and its link's target."""

    def __init__(self, folder: Path) -> None:
        self.link = folder / "arva0"
        program = (
            "import sys; from arva_hil.links.pty import PtyLink\n"
            "link = PtyLink(sys.argv[1]); print(link.path, flush=True); sys.stdin.read()"
        )
        command = [sys.executable, "-c", program, str(self.link)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
            self.number = child.stdout.readline().decode().strip()
            assert pty.is_in_use(str(self.link))
            child.send_signal(signal.SIGKILL)
        assert os.readlink(self.link) == self.number


@pytest.fixture
def killed(tmp_path: Path) -> Killed:
    return Killed(tmp_path)


@pytest.fixture
def stranger(killed: Killed) -> Iterator[Any]:
    """Another program's pseudo-terminal that was given the number, as (master, slave)."""
    taken = []
    while not os.path.exists(killed.number):
        taken.append(os.openpty())
        assert len(taken) < 100
    for pair in taken[:-1]:
        os.close(pair[0])
        os.close(pair[1])
    if not taken:
        pytest.skip("somebody was quicker")
    later = time.time_ns() + 10**9  # the clock of files is coarse
    os.utime(killed.link, ns=(later - 2 * 10**9, later - 2 * 10**9), follow_symlinks=False)
    yield taken[-1]
    os.close(taken[-1][0])
    os.close(taken[-1][1])


@pytest.mark.usefixtures("stranger")
def test_a_link_of_a_killed_program_that_leads_to_a_strangers_terminal_is_replaced(killed: Killed, keep: Keep) -> None:
    near = keep(PtyLink(str(killed.link)))
    assert os.readlink(killed.link) == near.path != killed.number
    assert [path.name for path in killed.link.parent.iterdir()] == ["arva0"]
    near.close()
    assert not killed.link.is_symlink()


def test_a_stranger_is_not_read_by_the_link_of_a_killed_program(killed: Killed, stranger: Any, keep: Keep) -> None:
    os.write(stranger[0], b"929 foreign bytes")
    with pytest.raises(Absent, match=f"leads to {killed.number}, which another program has opened since"):
        open_serial(str(killed.link))
    os.set_blocking(stranger[1], False)
    tty.setraw(stranger[1])
    os.write(stranger[0], b"\n")
    assert open_serial(killed.number) is not None  # by its own name it may be read


def test_who_waits_for_the_link_takes_the_next_program_that_makes_it(killed: Killed, stranger: Any, keep: Keep) -> None:
    os.write(stranger[0], b"929 foreign bytes")
    near = keep(open_reconnecting(str(killed.link), clock=RealClock(), patient=True))
    assert near.away
    assert near.read() == b""
    again = keep(PtyLink(str(killed.link)))
    until(lambda: near.read() == b"" and not near.away, near)
    again.write(b"frame")
    assert receive(near, 5) == b"frame"


def test_a_link_somebody_else_made_to_a_living_terminal_is_followed_and_not_replaced(
    tmp_path: Path, keep: Keep
) -> None:
    """As socat makes one; whoever later changes who may use the terminal does not make it stale."""
    far = keep(PtyLink())
    (link := tmp_path / "line").symlink_to(far.path)
    keep(open_serial(str(link)))
    with pytest.raises(
        LinkError, match=rf"is a symlink to {far.path}, which is in use: held by .*; take another name$"
    ):
        PtyLink(str(link))
    assert os.readlink(link) == far.path


def test_our_own_living_link_is_followed_whoever_changed_the_terminals_permissions(tmp_path: Path, keep: Keep) -> None:
    link = tmp_path / "arva0"
    near = keep(PtyLink(str(link)))
    os.utime(link, ns=(0, 0), follow_symlinks=False)
    os.chmod(near.path, 0o666)
    assert pty.is_in_use(str(link))
    keep(open_serial(str(link))).close()
    (chain := tmp_path / "chain").symlink_to("arva0")
    keep(open_serial(str(chain)))
    with pytest.raises(LinkError, match="in use"):
        PtyLink(str(link))
    assert os.readlink(link) == near.path


def test_a_link_is_vouched_for_until_its_program_closes_it(tmp_path: Path, keep: Keep) -> None:
    link, other = tmp_path / "arva0", tmp_path / "other"
    near = keep(PtyLink(str(link)))
    other.symlink_to(near.path)
    assert pty.is_in_use(str(link))
    assert not pty.is_in_use(str(other))
    near.close()
    assert not pty.is_in_use(str(link))


def test_what_is_no_symlink_is_not_stale(tmp_path: Path, line: PtyLink) -> None:
    (file := tmp_path / "file").touch()
    (loop := tmp_path / "loop").symlink_to(loop)
    for path in (file, loop, line.path, "/dev/stdin", tmp_path / "none", "COM5", f"/proc/self/fd/{line._slave}"):
        assert not pty.stale(str(path))


@pytest.mark.parametrize("killed_before", [False, True])
def test_a_signal_at_any_moment_of_the_opening_is_passed_on_and_leaves_no_symlink(
    tmp_path: Path, killed_before: bool
) -> None:
    """`killed_before`: a killed program has left its symlink there."""
    link = tmp_path / "arva0"
    opened: list[PtyLink] = []
    line = 0
    while not opened:
        line += 1
        if killed_before and not link.is_symlink():
            link.symlink_to("/dev/pts/none")
        with contextlib.suppress(KeyboardInterrupt):
            signalled(
                line,
                [pty, weakref],
                lambda: opened.append(PtyLink(str(link))),
                signal.SIGINT,
                since=pty.make_symlink,
            )
        gc.collect()
        left = {str(path.readlink()) for path in tmp_path.iterdir()} - {"/dev/pts/none"}
        assert left == {one.path for one in opened}, f"after a signal at line {line}"
    assert line > 15
    opened.pop().close()


def test_a_link_that_nobody_has_leaves_no_symlink(tmp_path: Path) -> None:
    path = tmp_path / "arva0"
    link = PtyLink(str(path))
    assert path.is_symlink()
    del link  # a signal came before its owner had it
    gc.collect()
    assert not os.path.lexists(path)
