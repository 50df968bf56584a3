"""The server that forks programs serves all workers, whatever one of them does."""

from __future__ import annotations

import os
import select
import socket

import pytest

from . import forked
from .far_ends import DEADLINE_S
from .forked import Forked

pytestmark = pytest.mark.skipif(not forked.possible({}), reason="nothing is forked here")


def ends_well() -> None:
    null = {"stdin": forked._DEVNULL, "stdout": forked._DEVNULL, "stderr": forked._DEVNULL}
    assert Forked(["--version"], env=None, **null).wait(DEADLINE_S) == 0


def test_nobody_wants_to_know_how_a_program_ended() -> None:
    null = {"stdin": forked._DEVNULL, "stdout": forked._DEVNULL, "stderr": forked._DEVNULL}
    program = Forked(["vehicle", "--link", "pty"], env=None, **null)
    os.close(program._status)
    program._status, status = os.pipe()  # `kill` asks there
    program.kill()
    assert select.select([program._pidfd], [], [], DEADLINE_S)[0]
    for fd in (program._pidfd, program._status, status):
        os.close(fd)
    for _ in range(3):
        ends_well()


def test_a_worker_leaves_in_the_middle_of_a_request() -> None:
    ends_well()
    with socket.socket(socket.AF_UNIX) as leaves:
        leaves.connect(forked._server().getpeername())
        leaves.send((1000).to_bytes(4, "big") + b'{"arguments"')
    for _ in range(3):
        ends_well()


def test_a_server_that_ended_as_this_worker_came_is_followed_by_another(monkeypatch: pytest.MonkeyPatch) -> None:
    near, far = socket.socketpair(socket.AF_UNIX)
    far.close()
    servers = iter([near])
    real = forked._server

    def server() -> socket.socket:
        return next(servers, None) or real()

    server.cache_clear = lambda: near.close()  # type: ignore[attr-defined]
    monkeypatch.setattr(forked, "_server", server)
    ends_well()
