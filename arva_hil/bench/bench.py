"""A bench: an emulated receiver on a simulated vehicle, its port, its faults, and the clock."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal, Self

import numpy as np

from arva_hil.autopilot.following.navigation import VehicleState
from arva_hil.autopilot.following.session import Session
from arva_hil.bench.path_vehicle import PathPoint, PathVehicle
from arva_hil.bench.ports import BenchError, BenchPort
from arva_hil.clock import RealClock, StepClock
from arva_hil.config import DEFAULT, Scenario, load, misfit
from arva_hil.config.faults import parse_fault
from arva_hil.emulator.engine import Emulator
from arva_hil.emulator.faults.plan import Faults
from arva_hil.emulator.ports import Counters
from arva_hil.emulator.receivers import Mounting
from arva_hil.emulator.setup import ReceiverSetup, VehicleSetup
from arva_hil.events import FrameMade
from arva_hil.links import Link, open_link
from arva_hil.model.field import rotation
from arva_hil.simulated import HOME
from arva_hil.simulated.vehicle import SimulatedVehicle

HOVERS_AT: Final = (0.0, 0.0, -3.0)  # NED from home, m, before the first `place_vehicle`
LONGEST_S: Final = 1_000_000.0  # longest time of one `advance`

_MOST: Final = 1_000_000.0  # metres, seconds or degrees of a point
_BOOTED_S: Final = -1.0  # the vehicle is switched on before the receiver
_SAME_S: Final = 1e-7  # times closer than this are the same
_LOOK_S: Final = 0.02  # of real time, between checks for a `close`


@dataclass(frozen=True)
class BenchTruth:
    """The true state at one instant, without the wire. Lengths are in metres."""

    time_s: float
    """Time on the bench's clock, from 0 at its start."""
    ned: tuple[float, float, float]
    """Position of the vehicle from home: north, east, down [m]."""
    yaw_deg: float
    """Heading of the vehicle, clockwise from north."""
    quaternion: tuple[float, float, float, float]
    """Attitude of the vehicle (w, x, y, z), body FRD to NED."""
    ranges_m: dict[int, float]
    """True distance from the receiver to each transmitter, by id."""


class Bench:
    """One emulated receiver for a test. Remembers its frames, its faults and the time; usable in a `with` statement.

    - `scenario`: a `Scenario`, the path of a file, or None for the default one.
    - `port`: "pty", "tcp", "udp", "memory", or the connection string of a real port.
    - `clock`: "virtual": time passes in `advance` only, at once; "real": a thread sends frames in real time.
    - `autopilot`: a connection string to fly the built-in vehicle by MAVLink. Without it `place_vehicle` and `fly` move
      the vehicle, which begins 3 m above home.

    Raises ScenarioError for a wrong scenario, LinkError or AddressError for a port that cannot be opened.
    """

    def __init__(
        self,
        scenario: Scenario | str | os.PathLike[str] | None = None,
        *,
        port: str = "pty",
        clock: Literal["virtual", "real"] = "virtual",
        autopilot: str | None = None,
    ) -> None:
        if clock not in ("virtual", "real"):
            raise BenchError(f"clock: {clock!r}, expected 'virtual' or 'real'")
        self.scenario = _scenario(scenario)
        self.frames: list[FrameMade] = []
        datum = self.scenario.datum
        home = HOME if datum == "home" else (datum.lat, datum.lon, datum.alt)
        self._clock: StepClock | RealClock = StepClock() if clock == "virtual" else RealClock()
        self._commands: Link | None = None
        self._vehicle: PathVehicle | SimulatedVehicle
        if autopilot is None:
            self._vehicle = PathVehicle(home, boot_time=_BOOTED_S, start=0.0, rate_hz=self.scenario.receiver.rate_hz)
        else:
            self._vehicle = SimulatedVehicle(home, boot_time=_BOOTED_S, seed=self.scenario.seed)
            self._commands = open_link(autopilot, clock=self._clock)
        vehicle = VehicleSetup(
            "vehicle",
            "autopilot",
            Session(passive=autopilot is None),
            self.scenario,
            [ReceiverSetup("receiver", "port", self.scenario, faults_change=True)],
        )
        self._emulator = Emulator([vehicle], start=0.0, tell_status=False)
        (self._followed,) = self._emulator.vehicles
        self._lock = threading.RLock()
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None
        self._error: Exception | None = None
        try:
            self._port = BenchPort(port, self._clock)
        except BaseException:
            self._close_commands()
            raise
        if isinstance(self._vehicle, PathVehicle):
            self.place_vehicle(*HOVERS_AT)
        self._receive(self._vehicle.poll(_BOOTED_S), _BOOTED_S)
        if clock == "real":
            self._thread = threading.Thread(target=self._live, name="arva-bench", daemon=True)
            self._thread.start()

    # the clock

    def now(self) -> float:
        """Return the time in seconds from the start of the bench."""
        return self._clock.now()

    def advance(self, seconds: float) -> list[FrameMade]:
        """Let `seconds` of virtual time pass, and return their frames. Raises BenchError on a real clock.

        A frame due exactly at the end belongs to the next call: 30 s at 1 Hz are 30 frames.
        """
        if self._thread is not None:
            raise BenchError("advance: this bench has a real clock: use sleep, or make it with clock='virtual'")
        if not 0 <= seconds <= LONGEST_S:
            raise BenchError(f"advance: {seconds!r}, expected 0…{LONGEST_S:g} seconds")
        before = len(self.frames)
        self._wait(seconds, lambda: False)
        return self.frames[before:]

    def sleep(self, seconds: float) -> None:
        """Advance a virtual clock, or wait on a real one. For drivers that take a `sleep`."""
        self._wait(seconds, lambda: False)

    # the program under test

    @property
    def port(self) -> str:
        """The path or URL that the program under test opens."""
        return self._port.name

    def serial(self, timeout: float | None = 0.0, **options: Any) -> Any:
        """Return the port, opened by pyserial with these options. `close` closes it.

        A port in memory has the methods of `serial.Serial`; its `timeout` passes on the bench's clock.
        """
        return self._port.serial(timeout, self._wait, **options)

    def unplug(self) -> None:
        """Unplug the receiver. Its frames are dropped."""
        with self._lock:
            self._port.unplug()

    def replug(self) -> None:
        """Plug the receiver in again, at the same `port`."""
        with self._lock:
            self._port.plug()

    def power_cycle(self) -> None:
        """Switch the receiver off and on. It counts its frames from 0."""
        with self._lock:
            self._followed.units[0].receiver.command(self.now(), "restart", ())

    # the world

    def truth(self) -> BenchTruth:
        """Return the true pose of the vehicle and the true ranges now."""
        with self._lock:
            now = self.now()
            motion = self._vehicle.truth(now)
            state = VehicleState(now, np.array(motion.ned), np.array(motion.velocity), motion.quaternion, 0.0)
            pose = Mounting(self.scenario).pose(state, now, swings=False)
            there = self._followed.world.at(now).transmitters
            yaw_deg = math.degrees(rotation.heading(motion.quaternion)) % 360
            ranges = {id_: float(one) for id_, one in there.ranges(pose.position).items()} if pose else {}
            return BenchTruth(now, motion.ned, yaw_deg, motion.quaternion, ranges)

    def place_vehicle(self, north: float, east: float, down: float, yaw: float = 0.0) -> None:
        """Put the vehicle at a place, in metres from home, where it hovers with the heading `yaw` in degrees."""
        with self._lock:
            _check("place_vehicle", [(north, east, down, yaw)])
            self._follow("place_vehicle", [(self.now(), north, east, down, yaw)])

    def fly(self, points: Sequence[Sequence[float]]) -> None:
        """Fly from point to point: (seconds from now, north, east, down), and a heading in degrees as a fifth number.

        The vehicle jumps to the first point, and hovers at the last one.
        """
        with self._lock:
            if any(len(point) not in (4, 5) for point in points):
                raise BenchError("fly: each point is (seconds, north, east, down) or (…, yaw)")
            _check("fly", points)
            now, yaw, path = self.now(), self.truth().yaw_deg, []
            for time_s, north, east, down, *more in points:
                yaw = more[0] if more else yaw
                path.append((now + time_s, north, east, down, yaw))
            self._follow("fly", path)

    # faults

    def inject(self, fault: str) -> None:
        """Switch a fault on, written as on the command line: "drop=0.3", "silence", "corrupt=0.1@10-60".

        Without a time it is on from now. Raises ValueError for an unknown fault, or one that the scenario cannot have.
        """
        one = parse_fault(fault)
        if wrong := misfit(one, [t.id for t in self.scenario.transmitters], self.scenario.output_format):
            raise BenchError(f"inject: {wrong[0]}, expected {wrong[1]}")
        with self._lock:
            now = self.now()
            if not one.from_s and one.until_s > now:
                one = replace(one, from_s=now)
            self._faults.change([*self._faults.present, one])

    def clear(self) -> None:
        """Switch all faults off, also those of the scenario."""
        with self._lock:
            self._faults.change([])

    @property
    def counters(self) -> Counters:
        """The numbers of frames that were made, delivered, damaged, withheld and dropped."""
        return self._followed.units[0].port.counters

    # the end

    def close(self) -> None:
        """Stop the bench and close everything that it opened. Raises an error of its thread."""
        self._stopped.set()
        if self._thread is not None:
            self._thread.join()
        self._port.close()
        self._close_commands()
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # inside

    @property
    def _faults(self) -> Faults:
        faults = self._followed.units[0].port.faults
        assert faults is not None  # they may change
        return faults

    def _follow(self, what: str, points: Sequence[Sequence[float]]) -> None:
        if not isinstance(self._vehicle, PathVehicle):
            raise BenchError(f"{what}: the built-in vehicle flies itself: make the bench without `autopilot`")
        path = [PathPoint(t, (north, east, down), math.radians(yaw)) for t, north, east, down, yaw in points]
        try:
            self._vehicle.follow(path, self.now())
        except ValueError as error:
            raise BenchError(f"{what}: {error}") from None
        navigation = self._followed.session.navigation
        navigation.track.positions.clear()  # its place is not known any more
        navigation.places.forget()

    def _wait(self, seconds: float, enough: Callable[[], bool]) -> None:
        """Let time pass, less if `enough()` is true before."""
        if self._error is not None:
            raise self._error
        if self._thread is not None:
            until = self._clock.now() + seconds
            while self._clock.now() < until and not enough():
                self._clock.wait(min(until, self._clock.now() + _LOOK_S))
            return
        until = round(self.now() + seconds, 6)
        unread, sent = self._port.unread(), self._port.sent
        while not enough() and (due := self._next_due()) < until - _SAME_S:
            self._clock.wait(due)
            self._service()
        if not enough():
            self._clock.wait(until)
        self._port.settle(unread + self._port.sent - sent)

    def _next_due(self) -> float:
        return max(self.now(), min(self._vehicle.next_due, self._followed.next_due))

    def _service(self) -> None:
        """Do what is due now."""
        now, emulator = self._clock.now(), self._emulator
        if data := self._port.read():
            emulator.receive("port", data, now)
        vehicle = self._vehicle
        if self._commands is not None and isinstance(vehicle, SimulatedVehicle):
            vehicle.feed(self._commands.read(), now, 1)
        self._receive(vehicle.poll(now), now)
        emulator.advance(now)
        for output in emulator.output():
            if output.link == "port":
                emulator.written(output.id, self._port.write(output.data), now)
            elif isinstance(vehicle, SimulatedVehicle):
                vehicle.feed(output.data, now)
        self.frames += [event for event in emulator.events() if isinstance(event, FrameMade)]

    def _receive(self, said: bytes, now: float) -> None:
        """Give messages of the vehicle to the receiver, and to the program that flies it."""
        if said:
            self._emulator.receive("autopilot", said, now, whole=True)
            if self._commands is not None:
                self._commands.write(said)

    def _live(self) -> None:
        try:
            while not self._stopped.is_set():
                with self._lock:
                    self._service()
                    links = [link for link in (self._port.link, self._commands) if link is not None]
                    due = min(self._next_due(), self._clock.now() + _LOOK_S)
                self._clock.wait(due, links)
        except Exception as error:
            self._error = error

    def _close_commands(self) -> None:
        if self._commands is not None:
            self._commands.close()


def _scenario(given: Scenario | str | os.PathLike[str] | None) -> Scenario:
    """Return the scenario of a bench. Raises BenchError if it has several vehicles."""
    if given is None:
        return DEFAULT
    scenario = given if isinstance(given, Scenario) else load(given)
    if scenario.vehicles:
        raise BenchError(f"{scenario.source}: vehicles: a bench has one vehicle with one receiver: leave them out")
    return scenario


def _check(what: str, points: Sequence[Sequence[float]]) -> None:
    """Raise BenchError if a number of a point is NaN or too large."""
    for value in (value for point in points for value in point):
        if not abs(value) <= _MOST:
            raise BenchError(f"{what}: {value!r}, expected -{_MOST:g}…{_MOST:g}")
