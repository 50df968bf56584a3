"""Searches over the built-in vehicle with one sensor that lies: the true height, and the end of each flight.

    python -m tools fuzz sensors [--runs 500] [--seed 0]

Each flight has one lie (offset, factor, stuck, noise, limit, dropouts, late, drift, reset) in one sensor (rangefinder,
barometer, altitude, gps) from a random moment on. The true height must not fall below half of the one wanted before the
search has ended. Then the vehicle must land and disarm.
Failures are printed with the seed. The exit code is 1 after a failure.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from arva_hil.clock import StepClock
from arva_hil.config import parse
from arva_hil.events import Event
from arva_hil.events.searches import FromSearch, SensorsDisagree
from arva_hil.events.words.reasons import in_words
from arva_hil.links import memory
from arva_hil.mavlink.codec import Encoder, Parser, decode, dialect
from arva_hil.registry import STRATEGIES
from arva_hil.runtime.loop import run
from arva_hil.search.mission.outcome import SearchStep
from arva_hil.search.strategies.plan import SearchPlan
from arva_hil.simulated import HOME
from arva_hil.simulated.closed_loop import ClosedLoop, in_memory
from arva_hil.simulated.messages import SENSORS
from tools.options import parser

BAROMETER = dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
RANGE_M = 10.0
KINDS = ("offset", "factor", "stuck", "noise", "dropouts", "late", "drift", "reset")
WAYS = [(sensor, kind) for sensor in ("rangefinder", "barometer", "altitude", "gps") for kind in KINDS]
WAYS += [("rangefinder", "limit")]
SCALE_M = 29.27 * 273.0  # of the air
REACHED = 0.75  # of the height wanted
LONGEST_S = 700.0
_NED = dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
_SENSORS = {
    dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR: "rangefinder",
    dialect.MAVLINK_MSG_ID_RANGEFINDER: "rangefinder",
    dialect.MAVLINK_MSG_ID_SCALED_PRESSURE: "barometer",
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: "altitude",
    _NED: "altitude",
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: "gps",
}
QUICK = ("flux", "extremum")  # strategies that compute little
LIE_S = 120.0  # limit of a search
GUIDED_S = 3.0  # on the ground in GUIDED


@dataclass(frozen=True)
class Lie:
    """One lie of one sensor. `size`: metres, factor, seconds or metres a second."""

    sensor: str
    kind: str
    size: float = 0.0
    from_s: float = 0.0
    seed: int = 0


class Liar:
    """Remembers the values of one sensor. Values are metres. `home_m`: altitude of the take-off point."""

    def __init__(self, lie: Lie | None, home_m: float) -> None:
        self.lie = lie
        self._home_m = home_m
        self._random = random.Random(lie.seed if lie else 0)
        self._past: list[tuple[float, float]] = []
        self._away_until = self._here_until = 0.0

    def changed(self, message: Any, now: float, up: float, height: float) -> Any:
        """Return the message with the lie; None: it is not sent.

        `up`, `height`: of the vehicle above the take-off point and above the ground.
        """
        msgid = type(message).id
        if (sensor := _SENSORS.get(msgid)) is None:
            return message
        altitude = getattr(message, "alt", 0) / 1e3 - self._home_m
        true = {"rangefinder": height, "barometer": up, "altitude": altitude, "gps": altitude}[sensor]
        if msgid == _NED:
            true = -message.z
        if (metres := self.value(sensor, now, true)) is None:
            return None
        if msgid == dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR:
            cm = max(0, min(round(100 * metres), round(100 * RANGE_M) + 50))
            message.current_distance, message.max_distance = cm, round(100 * RANGE_M)
        elif msgid == dialect.MAVLINK_MSG_ID_RANGEFINDER:
            message.distance = metres
        elif sensor == "barometer":
            message.press_abs *= math.exp((up - metres) / SCALE_M)
        elif msgid == _NED:
            message.z = -metres
        else:
            message.alt += round((metres - true) * 1e3)
            if sensor == "altitude":
                message.relative_alt += round((metres - true) * 1e3)
        return message

    def value(self, sensor: str, now: float, true: float) -> float | None:
        """The value that is reported. None: no message."""
        lie = self.lie
        if lie is None or sensor != lie.sensor:
            return true
        self._past.append((now, true))
        if now < lie.from_s:
            return true
        of: dict[str, Callable[[], float | None]] = {
            "offset": lambda: true + lie.size,
            "reset": lambda: true + lie.size,
            "affine": lambda: 1.5 * true + 1,
            "factor": lambda: true * lie.size,
            "stuck": lambda: next((past for at, past in self._past if at >= lie.from_s), true),
            "noise": lambda: true + self._random.gauss(0, lie.size),
            "limit": lambda: RANGE_M + self._random.gauss(0, 0.03),
            "drift": lambda: true + lie.size * (now - lie.from_s),
            "late": lambda: [past for at, past in self._past if at <= max(now - lie.size, self._past[0][0])][-1],
            "dropouts": lambda: self._dropped(now, true),
        }
        return of[lie.kind]()

    def _dropped(self, now: float, true: float) -> float | None:
        if now > self._away_until:
            self._here_until = now + self._random.uniform(0, 3)
            self._away_until = self._here_until + self._random.uniform(0, 6)
        return true if now < self._here_until else None


Ground = Callable[[float, float], float]  # its height above the take-off point, by north and east


def level(north: float, east: float) -> float:
    return 0.0


class LyingLink:
    """The vehicle's end of a link, on which one sensor lies. `true`: north, east, height above the take-off point."""

    def __init__(self, link: Any, lie: Lie | None, now: Callable[[], float], ground: Ground) -> None:
        self._link = link
        self._now = now
        self._ground = ground
        self._liar = Liar(lie, HOME[2])
        self._parser, self._encoder = Parser(), Encoder(1, 1)
        self.true: Callable[[], tuple[float, float, float]] = lambda: (0.0, 0.0, 0.0)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)

    def write(self, data: bytes) -> bool:
        out = b""
        for packet in self._parser.feed(data):
            north, east, up = self.true()
            message = self._liar.changed(decode(packet), self._now(), up, up - self._ground(north, east))
            out += self._encoder.pack(message) if message is not None else b""
        return bool(self._link.write(out)) if out else True


class Report(NamedTuple):
    """The outcome of one flight. `lowest`: the least true height while it searches [m]; `fault`: "" if all is well."""

    kind: str
    how: str
    lowest: float
    highest: float
    fault: str
    disagreements: Sequence[SensorsDisagree]
    seconds: float


class Flight:
    """One search with its judge. `rows`: time, true height, and velocity ordered while it searches."""

    def __init__(
        self,
        lie: Lie | None = None,
        *,
        ground: Ground = level,
        victim: str = "{id: 1, ned: [34, 29, 1], attitude: {pitch: 20, yaw: 70}}",
        seed: int = 1,
        sensors: int = SENSORS,
        gps_noise_m: float = 0.0,
        wind: tuple[float, float, float] = (0.0, 0.0, 0.0),
        strategy: str = "estimate",
        **plan: Any,
    ) -> None:
        self.clock = StepClock()
        self.ground = ground
        self.wanted = plan.setdefault("height", 3.0)
        self.heights: list[tuple[float, float]] = []
        self.events: list[Event] = []
        self.faults: list[str] = []
        self.stood_s = 0.0
        near, far = memory.pair()
        link = LyingLink(far, lie, self.clock.now, ground)
        self.loop = ClosedLoop(
            parse(f"spec: 1\nseed: {seed}\ntransmitters: [{victim}]\n", "flight"),
            SearchPlan(STRATEGIES[strategy], **plan),
            start=self.clock.now(),
            wires=[in_memory()._replace(commands=(near, link))],  # type: ignore[arg-type]
            stream_hz=10.0,
            wind=wind,
            gps_noise_m=gps_noise_m,
            sensors=sensors,
            observers=[self],
            log=self._judge,
        )
        link.true = self._true
        run(
            self.loop.tasks, self.clock, until=LONGEST_S, stopped=lambda: self.loop.drones[0].search.outcome is not None
        )

    def _true(self) -> tuple[float, float, float]:
        north, east, down = self.loop.drones[0].vehicle.truth(self.clock.now()).ned
        return north, east, -down

    def observe(self, event: Event) -> None:
        if isinstance(event, FromSearch):
            self.events.append(event.event)

    def _judge(self, row: SearchStep) -> None:
        north, east, up = self._true()
        height = up - self.ground(north, east)
        state = self.loop.drones[0].vehicle.state
        if row.phase != "flying":
            return
        if not self.loop.drones[0].decided:
            self.heights.append((self.clock.now(), height))
        self.stood_s = self.stood_s + 0.2 if height < 0.05 and state.startswith("GUIDED, armed") else 0.0
        if self.stood_s > GUIDED_S:
            self.faults.append("it stands on the ground in GUIDED, armed")
        if height < 0.3 and math.hypot(row.v_north, row.v_east) > 0.01:
            self.faults.append(f"it is ordered to fly aside {height:.1f} m above the ground")

    def report(self) -> Report:
        heights = [height for _, height in self.heights]
        reached = next((n for n, h in enumerate(heights) if h >= REACHED * self.wanted), len(heights))
        lowest = min(heights[reached:], default=math.inf)
        outcome = self.loop.drones[0].search.outcome
        faults = list(dict.fromkeys(self.faults))
        if lowest < self.wanted / 2:
            faults.append(f"only {lowest:.2f} m above the ground")
        if outcome is None:
            faults.append(f"it flies on after {LONGEST_S:g} s")
        elif not self.loop.drones[0].vehicle.state.endswith("disarmed, on the ground"):
            faults.append(f"at the end: {self.loop.drones[0].vehicle.state}")
        elif outcome.kind != "found" and not outcome.how:
            faults.append("it does not say why")
        return Report(
            outcome.kind if outcome else "",
            in_words(outcome.how) if outcome else "",
            lowest,
            max(heights, default=0.0),
            "; ".join(faults),
            [event for event in self.events if isinstance(event, SensorsDisagree)],
            self.clock.now(),
        )


def random_lie(r: random.Random, way: tuple[str, str]) -> Lie:
    sensor, kind = way
    sizes = {
        "offset": [r.choice((-1, 1)) * r.uniform(1, 8)],
        "factor": [0.5, 1.5, 2.0, 3.0],
        "noise": [0.1, 0.5, 1.0, 2.0],
        "late": [r.uniform(0.5, 3.0)],
        "drift": [0.02, 0.05, 0.1, 0.3, -0.05] if sensor == "rangefinder" else [0.05, -0.05],
        "reset": [r.choice((-1, 1)) * metres for metres in (5.0, 7.0, 9.0)],
    }
    moments = r.choice([0.0, r.uniform(0, 8), r.uniform(8, 20), r.uniform(8, 60)])
    return Lie(sensor, kind, r.choice(sizes.get(kind, [0.0])), moments, r.randrange(1000))


def victim(r: random.Random) -> str:
    place = f"{r.uniform(-45, 45):.1f}, {r.uniform(-45, 45):.1f}, 1"
    attitude = f"{{roll: {r.uniform(-90, 90):.0f}, pitch: {r.uniform(-90, 90):.0f}, yaw: {r.uniform(-180, 180):.0f}}}"
    return f"{{id: 1, ned: [{place}], attitude: {attitude}}}"


def lying(seed: int) -> tuple[str, Report]:
    """A flight with one lie above level ground; the others are its rangefinder, or none and a barometer."""
    r = random.Random(seed)
    lie = random_lie(r, WAYS[seed % len(WAYS)])
    sensors = SENSORS if lie.sensor == "rangefinder" else r.choice([SENSORS, BAROMETER])
    gps = r.choice([0.0, 0.5])
    strategy = r.choice(QUICK)
    flight = Flight(
        lie, victim=victim(r), seed=seed, sensors=sensors, gps_noise_m=gps, strategy=strategy, limit_s=LIE_S
    )
    which = "" if sensors == SENSORS else " without a rangefinder"
    return f"{lie.sensor} {lie.kind} {lie.size:.3g} from {lie.from_s:.0f} s{which}, gps {gps:g}", flight.report()


def main(arguments: Sequence[str] | None = None) -> int:
    made = parser(
        __doc__, runs=(500, "flights"), seed=(0, "of the first flight"), verbose=(False, "print every flight")
    )
    options = made.parse_args(arguments)
    kinds: Counter[str] = Counter()
    failed = 0
    for seed in range(options.seed, options.seed + options.runs):
        label, report = lying(seed)
        kinds[report.kind] += 1
        failed += bool(report.fault)
        if report.fault or options.verbose:
            said = "; ".join(f"{e.sensor} {e.value_m:.1f}, {e.other} {e.other_m:.1f}" for e in report.disagreements)
            print(
                f"{seed}: {label}: {report.fault or 'ok'}; least {report.lowest:.2f} m, most {report.highest:.1f} m; "
                f"{report.kind}: {report.how} ({report.seconds:.0f} s) [{said}]",
                flush=True,
            )
    outcomes = ", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items()))
    print(f"{options.runs} flights, {failed} failures; {outcomes}")
    return int(failed > 0)
