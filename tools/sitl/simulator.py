"""ArduPilot's and PX4's simulators and the built-in vehicle, each with a relay for the search, and its own truth."""

from __future__ import annotations

import contextlib
import math
import os
import random
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from arva_hil.clock import RealClock
from arva_hil.links import Link, LinkError, open_link
from arva_hil.links.tcp import TcpServerLink
from arva_hil.links.udp import UdpInLink, UdpOutLink
from arva_hil.mavlink.codec import dialect
from arva_hil.runtime.loop import run
from arva_hil.simulated import vehicle as simulated
from arva_hil.simulated.autopilot import Mode
from tests import simulated_px4
from tests.free_ports import free_port
from tools.sitl.relay import PER_DEGREE_M, SPACING_M, Place, Relay, Slope, Weather, run_as_others

HOME: Final = (47.397742, 8.545594, 488.0)
COPTER: Final = 7  # the instance, away from that of somebody who flies one
PX4: Final = 3
SPEEDUP: Final = 8  # until ArduPilot knows its place
NEW_M: Final = 60.0  # another vehicle begins at most so far in the north
FENCE: Final = "FENCE_ENABLE 1\nFENCE_TYPE 2\nFENCE_RADIUS 10\nFENCE_ACTION 0\n"
PX4_FENCE: Final = {"PX4_PARAM_GF_MAX_HOR_DIST": "10", "PX4_PARAM_GF_ACTION": "1"}
_SIM_STATE: Final = dialect.MAVLINK_MSG_ID_SIM_STATE
_CLOCK: Final = RealClock()


class Simulator:
    """A simulator. `telemetry`: the emulator's link. `pilots`, `still`: the modes of a pilot, and of who hovers."""

    relay: Relay
    telemetry: str
    copter = True
    system = 1
    slope = 0.0
    pilots, still = 5, 4

    def switch(self) -> float:
        """Let the pilot choose a mode. Returns the time."""
        now, mode = time.monotonic(), self.pilots
        main, sub = (mode, 0) if self.copter else (mode >> 16 & 255, mode >> 24)
        self.relay.order(dialect.MAV_CMD_DO_SET_MODE, 1, main, sub)
        return now

    def heights(self, places: Sequence[Place]) -> list[float]:
        """Return the true heights [m] above the ground, where it stood at first."""
        level = min((place.alt for place in self.relay.places[:10]), default=math.nan)
        return [place.alt - level - self.slope * (place.lat - HOME[0]) * PER_DEGREE_M for place in places]

    def close(self) -> None:
        self.relay.close()


class _Process(Simulator):
    """A simulator as a process, in a folder of its own."""

    def __init__(self, folder: Path, *arguments: object, environment: dict[str, str] | None = None) -> None:
        self._log = (folder / "autopilot.log").open("wb")
        self._folder = folder
        self._process = subprocess.Popen(
            list(map(str, arguments)),
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            env=environment,
            preexec_fn=run_as_others,
        )

    def _waits(self, text: str) -> None:
        wait(lambda: text.encode() in (self._folder / "autopilot.log").read_bytes(), 60)

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        super().close()
        self._log.close()


class ArduCopter(_Process):
    """`build/sitl/bin/arducopter` of an ArduPilot tree, which has the parameters of its simulated frame too.

    `slope`: of the ground, m a metre to the north. `receiver`: a serial port for scripts.
    """

    def __init__(
        self,
        binary: Path,
        folder: Path,
        *,
        weather: Weather | None = None,
        slope: float = 0.0,
        rangefinder: bool = False,
        receiver: Path | None = None,
        parameters: str = "",
    ) -> None:
        self.slope = slope
        port = 5760 + 10 * COPTER
        usual = binary.parents[3] / "Tools/autotest/default_params/copter.parm"
        own = folder / "own.parm"
        own.write_text(
            f"TERRAIN_ENABLE {int(slope != 0)}\nTERRAIN_SPACING {SPACING_M}\n"
            f"RNGFND1_TYPE {100 * rangefinder}\nRNGFND1_ORIENT 25\n"
            + ("SCR_ENABLE 1\nSERIAL5_PROTOCOL 28\n" if receiver else "")
            + parameters
        )
        super().__init__(
            *(folder, binary, f"-I{COPTER}", "--model", "quad", "--serial0", "tcp:0", "--speedup", SPEEDUP),
            *("--home", "{},{},{},0".format(*HOME), "--defaults", f"{usual},{own}"),
            *(("--serial5", f"uart:{receiver}:57600") if receiver else ()),
        )
        self.telemetry = f"tcp:127.0.0.1:{port + 2}"
        self.relay = _relayed(_opened(f"tcp:127.0.0.1:{port}"))  # it waits for that
        self.relay.slope = Slope(slope, HOME[0], HOME[2]) if slope else None
        self._waits("SERIAL1 on TCP port")
        self._settle()
        self.relay.weather = weather

    def _settle(self) -> None:
        """Wait until ArduPilot knows its place: 40 s of its time, faster than real time."""
        terrain = dialect.MAVLINK_MSG_ID_TERRAIN_REQUEST, dialect.MAVLINK_MSG_ID_TERRAIN_REPORT
        asked = [dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT, *(terrain if self.slope else ())]
        end = time.monotonic() + 90
        while not self.relay.ready or (self.slope and not self.relay.surveyed):
            if time.monotonic() > end:
                raise TimeoutError("ArduPilot does not find its place")
            for kind in asked:
                self.relay.order(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, kind, 100_000)
            time.sleep(0.3)
        for kind in asked:
            self.relay.order(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, kind, -1)
        self.relay.set("SIM_SPEEDUP", 1.0)
        time.sleep(1)


class Px4(_Process):
    """`build/px4_sitl_default/bin/px4` with its own simulator (SIH). It has no wind; its EKF errs by itself."""

    copter = False
    system = PX4 + 1
    pilots, still = simulated_px4.HOLD, simulated_px4.HOLD

    def __init__(self, binary: Path, folder: Path, parameters: dict[str, str]) -> None:
        truth = dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION
        self.relay = _relayed(UdpInLink(port=14540 + PX4), self.system, truth, udp=True)
        own = {name: value for name, value in os.environ.items() if name.startswith("PX4_PARAM_")} | parameters
        super().__init__(
            *(folder, binary, "-i", PX4, "-d", "-w", folder, binary.parents[1] / "etc"),
            environment={"PX4_SIM_MODEL": "sihsim_quadx", "PATH": "/usr/bin:/bin"} | own,
        )
        self._waits("Startup script returned successfully")
        client = [str(binary.with_name("px4-mavlink")), "--instance", str(PX4), "start", "-x", "-u", "14593"]
        client += ["-o", "14594", "-r", "4000000", "-m", "onboard"]
        subprocess.run(client, check=True, stdout=self._log, stderr=self._log, cwd=folder, timeout=20)
        self.telemetry = "udpin:127.0.0.1:14594"


class BuiltIn(Simulator):
    """The built-in vehicle, served by a thread: with wind and an error of its GPS, or with PX4's modes.

    `drawn`: the seed draws the modes, and whether the search uses UDP.
    """

    def __init__(self, seed: int, *, drawn: bool) -> None:
        draw = random.Random(f"built-in {seed}")
        px4, udp = (drawn and draw.random() < 0.5 for _ in range(2))
        self._links = [TcpServerLink(), TcpServerLink()]
        self.telemetry, address = (f"tcp:127.0.0.1:{link.port}" for link in self._links)
        self._boot_s = _CLOCK.now()
        if px4:
            self.copter, self.pilots, self.still = False, simulated_px4.HOLD, simulated_px4.HOLD
            self._serve(simulated_px4.Px4(HOME, boot_time=self._boot_s))
        else:
            weather: dict[str, Any] = {"wind": (4.0, 3.0, 0.0), "gps_noise_m": 1.5, "seed": seed}
            self._serve(simulated.SimulatedVehicle(HOME, boot_time=self._boot_s, **weather))
        self.relay = _relayed(_opened(address), udp=udp)

    def _serve(self, one: Any) -> None:
        """Serve a vehicle until `vanish`."""
        self._stop = threading.Event()
        stopped, tasks = self._stop.is_set, [simulated.Simulator([one], self._links)]
        self._thread = threading.Thread(target=lambda: run(tasks, _CLOCK, stopped=stopped))
        self._thread.start()

    def vanish(self) -> None:
        """Let the vehicle send and receive nothing more."""
        self._stop.set()
        self._thread.join()

    def replace(self, draw: random.Random) -> float:
        """Put another vehicle in its place, in the air, with its ids and another clock. Returns the time."""
        now, booted = _CLOCK.now(), self._boot_s
        boot_s = draw.choice((booted - draw.uniform(2.0, 20.0), draw.uniform(booted + 2.0, now - 0.5)))
        home = HOME[0] + draw.uniform(0.0, NEW_M) / PER_DEGREE_M, *HOME[1:]
        other = simulated.SimulatedVehicle(home, streams=simulated_px4.STREAMS, boot_time=boot_s)
        other.poll(now)
        other._pilot.set_mode(Mode.GUIDED)
        other._pilot.arm()
        other._pilot.take_off(2.0)
        at = time.monotonic()
        self.relay.silent = False
        self._serve(other)
        return at

    def close(self) -> None:
        self.vanish()
        super().close()
        for link in self._links:
            link.close()


def _relayed(vehicle: Link, system: int = 1, truth: int = _SIM_STATE, *, udp: bool = False) -> Relay:
    """Return the relay of a vehicle to a search over TCP or UDP."""
    if udp:
        port = free_port(socket.SOCK_DGRAM)
        return Relay(vehicle, UdpOutLink("127.0.0.1", port), f"udpin:127.0.0.1:{port}", system, truth)
    server = TcpServerLink()
    return Relay(vehicle, server, f"tcp:127.0.0.1:{server.port}", system, truth)


def _opened(address: str) -> Link:
    """Open a link as soon as a program listens there."""
    links: list[Link] = []

    def opens() -> bool:
        with contextlib.suppress(LinkError):
            links.append(open_link(address, clock=_CLOCK))
        return bool(links)

    wait(opens, 60)
    return links[0]


def wait(condition: Callable[[], object], within_s: float) -> None:
    end = time.monotonic() + within_s
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError
        time.sleep(0.005)
