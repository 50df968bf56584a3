"""One search on one autopilot, in real time and over real links, judged by the simulator's own truth."""

from __future__ import annotations

import json
import math
import re
import subprocess
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

from arva_hil.clock import RealClock
from arva_hil.links.pty import PtyLink
from arva_hil.mavlink.codec import dialect
from arva_hil.model.field import LocalFrame
from arva_hil.runtime.loop import run
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator
from tests.cli.far_ends import Program, until

from .truth import Place, Witness, ground_m, rough

HOME: Final = (47.397742, 8.545594, 488.0)
_INSTANCE: Final = 6  # of ArduCopter: away from the ports of one that somebody is flying


class Running(Protocol):
    """An autopilot that runs. `telemetry`, `commands`: connection strings for the emulator and for the search.

    `places`: where it truly was, in order. `seed` draws the weather, where the simulator has any.
    """

    telemetry: str
    commands: str

    @property
    def places(self) -> list[Place]: ...

    def close(self) -> None: ...


Maker = Callable[[Path, Path, int], Running]  # its binary, a folder to run in, a seed


class BuiltIn:
    """The simulated vehicle, on two pseudo-terminals, served by a thread."""

    def __init__(self, binary: Path, folder: Path, seed: int) -> None:
        self.places: list[Place] = []
        self._seed = seed
        self._links = [PtyLink(), PtyLink()]
        self.telemetry, self.commands = (link.path for link in self._links)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._fly)
        self._thread.start()

    def _fly(self) -> None:
        clock = RealClock()
        vehicle = SimulatedVehicle(HOME, wind=(4.0, 3.0, 0.0), gps_noise_m=1.5, seed=self._seed, boot_time=clock.now())

        def stopped() -> bool:
            now = clock.now()
            self.places.append(Place(now, *vehicle.truth(now).lla))
            return self._stop.is_set()

        run([Simulator([vehicle], self._links)], clock, stopped=stopped)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        for link in self._links:
            link.close()


class _Process:
    """A simulator as a process, in a folder of its own; what it prints goes to `autopilot.log` there."""

    witness: Witness

    def __init__(self, folder: Path, *arguments: object, **environment: str) -> None:
        self._log = (folder / "autopilot.log").open("wb")
        self._process = subprocess.Popen(
            list(map(str, arguments)),
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            env=environment or None,
        )

    @property
    def places(self) -> list[Place]:
        return self.witness.places

    def close(self) -> None:
        self.witness.close()
        self._process.kill()
        self._process.wait()
        self._log.close()


class ArduCopter(_Process):
    """`build/sitl/bin/arducopter` of an ArduPilot tree, which holds the parameters of its simulated frame too."""

    def __init__(self, binary: Path, folder: Path, seed: int) -> None:
        self.telemetry, self.commands, truth = (f"tcp:127.0.0.1:{5760 + 10 * _INSTANCE + n}" for n in (2, 0, 3))
        parameters = binary.parents[3] / "Tools/autotest/default_params/copter.parm"
        home = "{},{},{},0".format(*HOME)
        options = ("--model", "quad", "--serial0", "tcp:0", "--home", home, "--defaults", parameters)
        super().__init__(folder, binary, f"-I{_INSTANCE}", *options)
        until(lambda: b"SERIAL1 on TCP port" in (folder / "autopilot.log").read_bytes())
        self.witness = Witness(truth, dialect.MAVLINK_MSG_ID_SIM_STATE, rough(seed))


class Px4(_Process):
    """`build/px4_sitl_default/bin/px4` with its own simulator (SIH), which sends to these ports.

    It has neither wind nor a GPS that walks; its EKF errs by itself.
    """

    def __init__(self, binary: Path, folder: Path, seed: int) -> None:
        self.telemetry, self.commands = "udpin:127.0.0.1:14550", "udpin:127.0.0.1:14540"
        etc = binary.parents[1] / "etc"
        super().__init__(folder, binary, "-d", "-w", folder, etc, PX4_SIM_MODEL="sihsim_quadx", PATH="/usr/bin:/bin")
        self.witness = Witness("udpin:127.0.0.1:19410", dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION)


# -- one search on one of them ----------------------------------------------------------------------

_BEGINS: Final = "the search begins"
_ENDS: Final = "descending to|; landing|; hovering|the pilot or a failsafe"
_ITS_OWN: Final = ("--target-system", 1)  # every PX4 of a machine sends to port 14550
_NOT_LANDED: Final = "does not report that it has landed"
_CONTACT_M: Final = 0.2
_PATIENCE_S: Final = 700.0


@dataclass(frozen=True)
class Flown:
    """What came of a search. Errors are horizontal, m, from where the transmitter truly is."""

    outcome: dict[str, Any]  # what --json says
    said: str
    lowest_m: float  # true height above the ground, from the beginning of the search to the way down
    reported_m: float | None  # error of the place reported
    touchdown_m: float | None  # error of where the vehicle truly came down first
    landed: bool  # the autopilot has noticed, too

    def __str__(self) -> str:
        reported, touchdown = ("-" if off is None else f"{off:.2f} m" for off in (self.reported_m, self.touchdown_m))
        return (
            f"{self.outcome['outcome']}{'' if self.landed else ', still armed'}; {self.outcome['time_s']:.0f} s, "
            f"place reported {reported} off, true touchdown {touchdown} off, lowest true height {self.lowest_m:.2f} m"
        )


def fly(autopilot: Maker, binary: Path, folder: Path, transmitter: str, seed: int, *options: object) -> Flown:
    """Fly to a transmitter as in a scenario file, its place NED from `HOME`; `options` are those of `search`."""
    scenario, port, record = folder / "scenario.yaml", folder / "receiver", folder / "record"
    lat, lon, alt = HOME
    datum = f"datum: {{lat: {lat}, lon: {lon}, alt: {alt}}}"
    scenario.write_text(f"spec: 1\nseed: {seed}\n{datum}\ntransmitters: [{transmitter}]\n")
    flown = autopilot(binary, folder, seed)
    programs: list[Program] = []
    try:
        emulator = Program(
            *("run", "--scenario", scenario, "--record", record, "--timeout", 60),
            *("--autopilot", flown.telemetry, "--port", f"pty:{port}", *_ITS_OWN),
            speed=1.0,
        )
        programs.append(emulator)
        emulator.says("frames to")
        search = Program(
            *("search", "--json", "--timeout", 90, "--arm-timeout", 120, "--record", record, *options),
            *("--autopilot", flown.commands, "--receiver", port, *_ITS_OWN),
            speed=1.0,
        )
        programs.append(search)
        begun, ended = _wait(search, _BEGINS, flown), _wait(search, _ENDS, flown)
        search.ends(0, 1, 3, 130, within_s=_PATIENCE_S)
        outcome = json.loads(search.out)
        emulator.process.terminate()
        emulator.ends(130)
    finally:
        for program in programs:
            program.close()
        flown.close()
    places = flown.places
    assert places[begun:ended], f"no truth of a search: {search.err}"
    ground = ground_m(places)
    heights = [place.alt - ground for place in places[begun:ended]]
    found = outcome["found"]
    reported = None if found is None else _off(found["lat_lon"][0], found["lat_lon"][1], transmitter)
    contact = next((place for place in places[ended:] if place.alt - ground < _CONTACT_M), None)
    touchdown = None if contact is None else _off(contact.lat, contact.lon, transmitter)
    landed = _NOT_LANDED not in outcome["how"]
    return Flown(outcome, search.err, min(heights), reported, touchdown, landed)


def _wait(search: Program, pattern: str, flown: Running) -> int:
    """Wait until it was said; how much truth there was by then. The end of the program is an end, too."""
    while not re.search(pattern, search.err) and search._listen(_PATIENCE_S):
        pass
    return len(flown.places)


def _off(lat: float, lon: float, transmitter: str) -> float:
    north, east, _ = LocalFrame(*HOME).ned(lat, lon, HOME[2])
    found = re.search(r"ned: \[([-\d.]+), ([-\d.]+)", transmitter)
    assert found
    return math.dist((north, east), tuple(map(float, found.groups())))
