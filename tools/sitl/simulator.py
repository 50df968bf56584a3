"""ArduPilot's and PX4's simulators, each with a relay for the search, weather, and its own truth."""

from __future__ import annotations

import math
import os
import random
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from arva_hil.mavlink.codec import command, dialect
from tests.sitl.truth import Place, Witness, ground_m
from tools.sitl.relay import PER_DEGREE_M, SPACING_M, Relay, Slope, TcpRelay, UdpRelay, run_as_others

HOME: Final = (47.397742, 8.545594, 488.0)
COPTER: Final = 7  # the instance, away from that of tests/sitl
PX4: Final = 3
SPEEDUP: Final = 8  # until ArduPilot knows its place
WIND_M_S, GPS_M, GPS_S = 5.0, 1.5, 30.0
SCRIPT_WEATHER: Final = 7.0, 0.0  # wind and GPS error of searches by a script


class Weather:
    """For ArduPilot's simulator. Once `begun`, the error of its GPS walks: a Gauss-Markov process on each axis."""

    def __init__(self, seed: int, wind: float = WIND_M_S, gps: float = GPS_M) -> None:
        self.begun = False
        self._wind, self._gps = wind, gps
        self._draw = random.Random(f"weather {seed}")
        self._direction = self._draw.uniform(0, 360)
        self._error = [0.0, 0.0, 0.0]

    def __call__(self, now: float) -> Mapping[str, float]:
        keep = math.exp(-1 / GPS_S)
        if self.begun:
            self._error = [e * keep + self._draw.gauss(0, self._gps) * math.sqrt(1 - keep**2) for e in self._error]
        north, east, up = self._error
        return {
            "SIM_WIND_SPD": self._wind,
            "SIM_WIND_DIR": self._direction,
            "SIM_WIND_TURB": 1.0,
            "SIM_GPS1_GLTCH_X": north / 111_200,
            "SIM_GPS1_GLTCH_Y": east / 75_300,
            "SIM_GPS1_GLTCH_Z": up,
        }


class Simulator:
    """A simulator as a process. `telemetry`: the emulator's link. ArduPilot's may have ground that rises to the north,
    `slope` m a metre, a rangefinder, a receiver on the serial port `receiver`, for scripts, and more `parameters`."""

    def __init__(
        self,
        binary: Path,
        folder: Path,
        kind: str,
        seed: int,
        slope: float = 0.0,
        rangefinder: bool = False,
        receiver: Path | None = None,
        parameters: str = "",
    ) -> None:
        self.slope = slope
        self.copter = binary.name == "arducopter"
        self.system = 1 if self.copter else PX4 + 1
        self.weather = Weather(seed) if self.copter and kind in ("anywhere", "busy") else None
        if receiver:
            self.weather = Weather(seed, *SCRIPT_WEATHER)
        self.pilots, self.still = (5, 4) if self.copter else (3 << 24 | 4 << 16, 3 << 24 | 4 << 16)
        self._log = (folder / "autopilot.log").open("wb")
        self._folder, self._binary = folder, binary
        self.relay: Relay
        if self.copter:
            port = 5760 + 10 * COPTER
            usual = binary.parents[3] / "Tools/autotest/default_params/copter.parm"
            home = "{},{},{},0".format(*HOME)
            own = folder / "own.parm"
            own.write_text(
                f"TERRAIN_ENABLE {int(slope != 0)}\nTERRAIN_SPACING {SPACING_M}\n"
                f"RNGFND1_TYPE {100 * rangefinder}\nRNGFND1_ORIENT 25\n"
                + ("SCR_ENABLE 1\nSERIAL5_PROTOCOL 28\n" if receiver else "")
                + parameters
                + ("FENCE_ENABLE 1\nFENCE_TYPE 2\nFENCE_RADIUS 10\nFENCE_ACTION 0\n" if kind == "fence" else "")
            )
            self._start(
                *(binary, f"-I{COPTER}", "--model", "quad", "--serial0", "tcp:0", "--speedup", SPEEDUP),
                *("--home", home, "--defaults", f"{usual},{own}"),
                *(("--serial5", f"uart:{receiver}:57600") if receiver else ()),
            )
            self.telemetry = f"tcp:127.0.0.1:{port + 2}"
            self.relay = TcpRelay(port)
            self.relay.slope = Slope(slope, HOME[0], HOME[2]) if slope else None
            self._waits("SERIAL1 on TCP port")
            self._settle()
            self.witness = Witness(f"tcp:127.0.0.1:{port + 3}", dialect.MAVLINK_MSG_ID_SIM_STATE, self.weather)
        else:
            self.relay = UdpRelay(14540 + PX4)
            others = {name: value for name, value in os.environ.items() if name.startswith("PX4_PARAM_")}
            if kind == "fence":
                others |= {"PX4_PARAM_GF_MAX_HOR_DIST": "10", "PX4_PARAM_GF_ACTION": "1"}
            etc = binary.parents[1] / "etc"
            self._start(
                *(binary, "-i", PX4, "-d", "-w", folder, etc),
                PX4_SIM_MODEL="sihsim_quadx",
                PATH="/usr/bin:/bin",
                **others,
            )
            self._waits("Startup script returned successfully")
            self._tell_px4("mavlink", "start", "-x", "-u", "14593", "-o", "14594", "-r", "4000000", "-m", "onboard")
            self.telemetry = "udpin:127.0.0.1:14594"
            hil_state = dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION
            self.witness = Witness(f"udpin:127.0.0.1:{19410 + PX4}", hil_state)

    def _settle(self) -> None:
        """Wait until ArduPilot knows its place: 40 s of its time, faster than real time."""
        interval, status = dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT
        end = time.monotonic() + 90
        terrain = dialect.MAVLINK_MSG_ID_TERRAIN_REQUEST, dialect.MAVLINK_MSG_ID_TERRAIN_REPORT
        asked = [status, *terrain] if self.slope else [status]
        while not self.relay.ready or (self.slope and not self.relay.surveyed):
            if time.monotonic() > end:
                raise TimeoutError("ArduPilot does not find its place")
            for kind in asked:
                self.relay.say(command(1, 1, interval, kind, 100_000))
            time.sleep(0.3)
        for kind in asked:
            self.relay.say(command(1, 1, interval, kind, -1))
        real = dialect.MAV_PARAM_TYPE_REAL32
        self.relay.say(dialect.MAVLink_param_set_message(1, 1, b"SIM_SPEEDUP", 1.0, real))
        time.sleep(1)

    @property
    def places(self) -> list[Place]:
        """The true places, by the clock of this program."""
        clock = self.witness._clock
        zero = time.monotonic() - clock.now()
        return [place._replace(time_s=place.time_s + zero) for place in list(self.witness.places)]

    def heights(self, places: Sequence[Place]) -> list[float]:
        """Return the true heights [m] above the ground."""
        level = ground_m(self.witness.places) if self.witness.places else math.nan
        return [place.alt - level - self.slope * (place.lat - HOME[0]) * PER_DEGREE_M for place in places]

    def _start(self, *arguments: object, **environment: str) -> None:
        self.process = subprocess.Popen(
            list(map(str, arguments)),
            cwd=self._folder,
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            env=environment or None,
            preexec_fn=run_as_others,
        )

    def _waits(self, text: str) -> None:
        wait(lambda: text.encode() in (self._folder / "autopilot.log").read_bytes(), 60)

    def _tell_px4(self, module: str, *arguments: str) -> None:
        client = [str(self._binary.with_name(f"px4-{module}")), "--instance", str(PX4), *arguments]
        subprocess.run(client, check=True, stdout=self._log, stderr=self._log, cwd=self._folder, timeout=20)

    def close(self) -> None:
        self.witness.close()
        self.process.kill()
        self.process.wait()
        self.relay.close()
        self._log.close()


def wait(condition: Callable[[], object], within_s: float) -> None:
    end = time.monotonic() + within_s
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError
        time.sleep(0.005)
