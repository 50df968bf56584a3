"""What a service manager hears of a run: a socket like systemd's, and a stepped clock."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from arva_hil.clock import Clock, StepClock
from arva_hil.events import ReceiverStatus, StatusReport, VehicleStatus
from arva_hil.observers.systemd import Watchdog
from arva_hil.runtime.loop import run
from tests.service_manager import Manager

USEC = "10000000"


class Diary:
    """A task that notes, at every turn of the loop, what the manager has heard by then."""

    links = ()

    def __init__(self, manager: Manager) -> None:
        self._manager = manager
        self.heard: list[tuple[float, str]] = []

    def service(self, clock: Clock) -> float:
        now = clock.now()
        self.heard += [(now, message) for message in self._manager.heard()]
        return now + 0.1


class Holder:
    """A task that calls `does` at its turn number `turn`."""

    links = ()

    def __init__(self, does: Callable[[], None], turn: int) -> None:
        self._does = does
        self._left = turn

    def service(self, clock: Clock) -> float:
        self._left -= 1
        if self._left == 0:
            self._does()
        return clock.now() + 0.1


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Manager]:
    name = str(tmp_path / "notify") if request.param == "path" else f"@arva-hil-test-{os.getpid()}"
    with closing(Manager(name)) as made:
        yield made


def status(time_s: float, vehicle: str = "") -> StatusReport:
    receiver = ReceiverStatus("receiver", None, 7, 2)
    return StatusReport(time_s, [VehicleStatus("vehicle", vehicle, {"ATTITUDE": 50.0}, [receiver])])


def test_ready_then_the_watchdog_twice_an_interval_then_stopping(manager: Manager) -> None:
    diary = Diary(manager)
    with closing(
        Watchdog({"NOTIFY_SOCKET": manager.name, "WATCHDOG_USEC": USEC, "WATCHDOG_PID": str(os.getpid())})
    ) as watchdog:
        run([watchdog, diary], StepClock(100.0), until=122.0)
    times, messages = zip(*diary.heard, strict=True)
    assert messages == ("READY=1", *["WATCHDOG=1"] * 4)
    assert times == pytest.approx((100, 105, 110, 115, 120), abs=0.101)  # the diary looks every 0.1 s
    assert manager.heard() == ["STOPPING=1"]


def test_it_is_ready_only_after_the_others_had_their_turn(manager: Manager) -> None:
    def fail() -> None:
        raise RuntimeError

    watchdog = Watchdog({"NOTIFY_SOCKET": manager.name})
    with pytest.raises(RuntimeError), closing(watchdog):
        run([Holder(fail, turn=1), watchdog], StepClock())
    assert manager.heard() == ["STOPPING=1"]


def test_a_loop_that_is_held_up_says_nothing(manager: Manager) -> None:
    clock = StepClock()
    watchdog = Watchdog({"NOTIFY_SOCKET": manager.name, "WATCHDOG_USEC": USEC})
    during: list[str] = []

    def hang() -> None:
        manager.heard()
        clock.wait(60.0)
        during.extend(manager.heard())

    run([Holder(hang, turn=2), watchdog], clock, until=61.0)
    assert during == []
    assert manager.heard() == ["WATCHDOG=1"]
    watchdog.close()


@pytest.mark.parametrize(
    "environment",
    [{}, {"WATCHDOG_USEC": "0"}, {"WATCHDOG_USEC": "soon"}, {"WATCHDOG_USEC": USEC, "WATCHDOG_PID": "1"}],
)
def test_no_watchdog_waits_or_it_waits_for_another(manager: Manager, environment: dict[str, str]) -> None:
    with closing(Watchdog({"NOTIFY_SOCKET": manager.name, **environment})) as watchdog:
        run([watchdog], StepClock(), until=100.0)
    assert manager.heard() == ["READY=1", "STOPPING=1"]


@pytest.mark.parametrize("name", [None, "", "vsock:2:1", "relative/path"])
def test_without_a_socket_nothing_happens(name: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "socket", lambda *_: pytest.fail("a socket was made"))
    with closing(Watchdog({"WATCHDOG_USEC": USEC} | ({} if name is None else {"NOTIFY_SOCKET": name}))) as watchdog:
        run([watchdog], StepClock(), until=100.0)
        watchdog.observe(status(0.0))


def test_a_socket_that_goes_does_not_stop_the_run_and_one_that_comes_is_told(tmp_path: Path) -> None:
    path = str(tmp_path / "notify")
    clock = StepClock()
    watchdog = Watchdog({"NOTIFY_SOCKET": path, "WATCHDOG_USEC": USEC})

    def go_on(seconds: float) -> None:
        watchdog.observe(status(clock.now()))
        run([watchdog], clock, until=clock.now() + seconds)

    go_on(20.0)
    assert clock.now() == 20.0
    with closing(Manager(path)) as manager:
        go_on(1.0)
        assert manager.heard()[1:] == ["READY=1"]
        go_on(10.0)
        assert manager.heard().count("WATCHDOG=1") == 2
    go_on(20.0)
    with closing(Manager(path)) as manager:
        go_on(1.0)
        assert "WATCHDOG=1" in manager.heard()
    watchdog.close()


def test_one_that_does_not_read_holds_nothing_up(manager: Manager) -> None:
    clock = StepClock()
    with closing(Watchdog({"NOTIFY_SOCKET": manager.name, "WATCHDOG_USEC": "200000"})) as watchdog:
        run([watchdog], clock, until=200.0)  # 2000 datagrams, more than any queue takes
        heard = manager.heard()
        assert heard[0] == "READY=1"
        assert len(heard) < 1900
        run([watchdog], clock, until=201.0)
    assert manager.heard().count("WATCHDOG=1") in (10, 11)


def test_no_socket_can_be_had(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError

    monkeypatch.setattr(socket, "socket", refuse)
    with closing(Watchdog({"NOTIFY_SOCKET": "/run/notify", "WATCHDOG_USEC": USEC})) as watchdog:
        run([watchdog], StepClock(), until=100.0)
        watchdog.observe(status(0.0))


def test_the_status_is_one_line_now_and_then(manager: Manager) -> None:
    with closing(Watchdog({"NOTIFY_SOCKET": manager.name})) as watchdog:
        for n in range(41):
            watchdog.observe(status(n / 4, "px4 1/1"))
    lines = manager.heard()[:-1]
    assert lines == ["STATUS=no frame yet | 5 sent, 2 dropped | att 50 Hz | px4 1/1"] * 3  # 0, 5 and 10 s


def test_the_status_of_many_vehicles_is_cut_to_what_is_read(manager: Manager) -> None:
    of_one = status(0.0, "größer").vehicles[0]
    with closing(Watchdog({"NOTIFY_SOCKET": manager.name})) as watchdog:
        watchdog.observe(StatusReport(0.0, [of_one] * 250))
    line = manager.heard()[0]
    assert line.startswith("STATUS=vehicle/receiver: no frame yet | 5 sent")
    assert line.endswith("…")
