"""Autopilots to fly a search on: the built-in vehicle, ArduCopter's and PX4's simulators, each on loopback."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final, Protocol

from arva_hil.clock import RealClock
from arva_hil.links.pty import PtyLink
from arva_hil.mavlink.codec import dialect
from arva_hil.runtime.loop import run
from arva_hil.simulated.vehicle import SimulatedVehicle, Simulator
from tests.cli.far_ends import until

from .truth import Place, Witness, rough

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
