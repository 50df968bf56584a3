"""Set-points do not wait for a processor where the system lets a program run before others."""

from __future__ import annotations

import os
import threading

import pytest

from arva_hil.cli import common


def test_the_calling_thread_alone_runs_first_until_the_end_and_a_refusal_is_no_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ran: list[int] = []

    def refuse(*_: object) -> None:
        raise PermissionError

    def policy() -> int:
        return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK

    def search() -> None:
        with common.run_first():
            ran.append(policy())
            thread = threading.Thread(target=lambda: ran.append(os.sched_getscheduler(0)))
            thread.start()
            thread.join(10)
        ran.append(policy())

    main = threading.Thread(target=search)
    main.start()
    main.join(20)
    assert ran[0] in (os.SCHED_RR, os.SCHED_OTHER)  # by what is permitted here
    assert ran[1:] == [os.SCHED_OTHER, os.SCHED_OTHER]
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with common.run_first():
        assert policy() == os.SCHED_OTHER
