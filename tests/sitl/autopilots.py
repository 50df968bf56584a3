"""Autopilots to fly a search on: the built-in vehicle, ArduCopter's and PX4's simulators, each on loopback."""

from __future__ import annotations

import subprocess
import threading
from pathlib import Path
from typing import Final, Protocol

from cli.far_ends import until

from arva_hil.autopilot.vehicle import SimulatedVehicle
from arva_hil.clock import RealClock
from arva_hil.links.pty import PtyLink
from arva_hil.loop import run
from arva_hil.simulator import Simulator

HOME: Final = (47.397742, 8.545594, 488.0)
_INSTANCE: Final = 6  # of ArduCopter: away from the ports of one that somebody is flying


class Running(Protocol):
    """An autopilot that runs. `telemetry`, `commands`: connection strings for the emulator and for the search."""

    telemetry: str
    commands: str

    def close(self) -> None: ...


class BuiltIn:
    """The simulated vehicle, on two pseudo-terminals, served by a thread."""

    def __init__(self, binary: Path, folder: Path) -> None:
        self._links = [PtyLink(), PtyLink()]
        self.telemetry, self.commands = (link.path for link in self._links)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._fly)
        self._thread.start()

    def _fly(self) -> None:
        clock = RealClock()
        vehicle = SimulatedVehicle(HOME, boot_time=clock.now())
        run([Simulator(vehicle, self._links)], clock, stopped=self._stop.is_set)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        for link in self._links:
            link.close()


class _Process:
    """A simulator as a process, in a folder of its own; what it prints goes to `autopilot.log` there."""

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

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        self._log.close()


class ArduCopter(_Process):
    """`build/sitl/bin/arducopter` of an ArduPilot tree, which holds the parameters of its simulated frame too."""

    def __init__(self, binary: Path, folder: Path) -> None:
        self.telemetry, self.commands = (f"tcp:127.0.0.1:{5760 + 10 * _INSTANCE + n}" for n in (2, 0))
        parameters = binary.parents[3] / "Tools/autotest/default_params/copter.parm"
        home = "{},{},{},0".format(*HOME)
        options = ("--model", "quad", "--serial0", "tcp:0", "--home", home, "--defaults", parameters)
        super().__init__(folder, binary, f"-I{_INSTANCE}", *options)
        until(lambda: b"SERIAL1 on TCP port" in (folder / "autopilot.log").read_bytes())


class Px4(_Process):
    """`build/px4_sitl_default/bin/px4` with its own simulator (SIH), which sends to these two ports."""

    def __init__(self, binary: Path, folder: Path) -> None:
        self.telemetry, self.commands = "udpin:127.0.0.1:14550", "udpin:127.0.0.1:14540"
        etc = binary.parents[1] / "etc"
        super().__init__(folder, binary, "-d", "-w", folder, etc, PX4_SIM_MODEL="sihsim_quadx", PATH="/usr/bin:/bin")
