"""Discovery of the vehicle to follow among several senders, and checks that it is still the same one."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any, Final

from arva_hil.autopilot.following.navigation import ClockMap, Place, is_zero, offset_m, place_of
from arva_hil.events.reasons import HeardSource, Reason, Why, because
from arva_hil.mavlink.codec import Packet, dialect
from arva_hil.mavlink.dialect import Verdict

_MOST_SOURCES: Final = 32  # a hostile link may have 65,536
_NOT_VEHICLES: Final = {
    dialect.MAV_TYPE_GCS,
    dialect.MAV_TYPE_GIMBAL,
    dialect.MAV_TYPE_ADSB,
    dialect.MAV_TYPE_CAMERA,
    dialect.MAV_TYPE_ONBOARD_CONTROLLER,
    dialect.MAV_TYPE_ANTENNA_TRACKER,
}


@dataclass(frozen=True)
class Vehicle:
    """The autopilot that is followed."""

    system: int
    component: int
    autopilot: int  # MAV_AUTOPILOT
    kind: int  # MAV_TYPE
    armed: bool
    version: int  # of MAVLink in its heartbeats

    def __str__(self) -> str:
        return f"{short_name('MAV_AUTOPILOT', self.autopilot)} {self.short}"

    @property
    def short(self) -> str:
        """Its kind and ids, e.g. 'quadrotor 1/1'."""
        return f"{short_name('MAV_TYPE', self.kind)} {self.system}/{self.component}"

    def sent(self, packet: Packet) -> bool:
        """Return True if a packet has this vehicle's ids."""
        return packet.system == self.system and packet.component == self.component

    def is_like(self, heartbeat: Any) -> bool:
        """Return True if a heartbeat may be from this vehicle."""
        return bool(heartbeat.autopilot == self.autopilot and heartbeat.type not in _NOT_VEHICLES)


class VehicleDiscovery:
    """Remembers the sources received. `system`, `component`: accept only these (default: any system, component 1).

    `ignored`: packets of other systems and components, and of senders that only claim to be the vehicle.
    """

    def __init__(self, system: int | None, component: int | None) -> None:
        self.system = system
        self.ignored = 0
        self.refusals: set[Verdict] = set()  # the reasons for which packets were refused
        self._component = dialect.MAV_COMP_ID_AUTOPILOT1 if component is None else component
        self._heard: dict[tuple[int, int, str], int] = {}
        self.refused_vehicle = False  # an autopilot with other ids was received

    def vehicle(self, packet: Packet, heartbeat: Any) -> Vehicle | None:
        """Return the vehicle that sent a heartbeat; None if it is not an autopilot, or not the one asked for."""
        asked = packet.system == (self.system or packet.system or -1) and packet.component == self._component
        if asked and is_autopilot(heartbeat):
            armed = bool(heartbeat.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
            return Vehicle(packet.system, packet.component, heartbeat.autopilot, heartbeat.type, armed, packet.version)
        self.refused_vehicle |= is_autopilot(heartbeat)
        self.count(packet, f"heartbeats of {short_name('MAV_TYPE', heartbeat.type)}")
        return None

    def count(self, packet: Packet, kind: str) -> bool:
        """Count a source. Returns whether it is new."""
        key = (packet.system, packet.component, kind)
        if key not in self._heard and len(self._heard) >= _MOST_SOURCES:
            return False
        self._heard[key] = self._heard.get(key, 0) + 1
        return self._heard[key] == 1

    @property
    def sources(self) -> tuple[HeardSource, ...]:
        """The sources received."""
        return tuple(HeardSource(kind, s, c, n) for (s, c, kind), n in self._heard.items())


def is_autopilot(heartbeat: Any) -> bool:
    """Return True if a heartbeat is from an autopilot, not from a ground station or a gimbal."""
    return heartbeat.autopilot != dialect.MAV_AUTOPILOT_INVALID and heartbeat.type not in _NOT_VEHICLES


def short_name(enum: str, value: int) -> str:
    """Return the name of an enum entry without the prefix of its enum, e.g. 'quadrotor'."""
    entry = dialect.enums[enum].get(value)
    return entry.name.removeprefix(enum + "_").lower() if entry else f"{enum} {value}"


_SILENT_S: Final = 3.0  # three heartbeats: after this silence another sender may replace the vehicle's
_ASLEEP_S: Final = 1.0  # after a pause in reading of this length, silence means nothing
_MOST: Final = 8  # senders that are answered while the vehicle is unknown


class Senders:
    """Remembers the sender of the vehicle's packets, and when it last sent one. Times are host seconds.

    The sender of a link with only one is None, and is always the vehicle.
    """

    def __init__(self) -> None:
        self.vehicle: Hashable = None
        self.candidates: list[Hashable] = []  # to answer while no vehicle is known: those that may be the vehicle
        self._met: dict[Hashable, bool] = {}  # sender → whether it may be the vehicle
        self._heard_at = -math.inf
        self._looked_at = -math.inf
        self._pinned = False

    def on_read(self, now: float) -> None:
        """Register a read of the link at `now`. After a pause, the vehicle's silence counts from now."""
        if now - self._looked_at > _ASLEEP_S:
            self._heard_at = max(self._heard_at, now)
        self._looked_at = now

    def meet(self, sender: Hashable, *, candidate: bool) -> None:
        """Remember the sender of a packet. `candidate`: the vehicle could have sent it."""
        if sender in self._met or len(self._met) < _MOST:
            self._met[sender] = candidate and self._met.get(sender, True)
            self.candidates = [sender for sender, candidate in self._met.items() if candidate]

    def on_packet(self, sender: Hashable, now: float) -> None:
        """Remember the sender of a packet of the vehicle."""
        self.vehicle, self._heard_at = sender, now
        if self._met:
            self._met.clear()
            self.candidates = []

    def accepts(self, sender: Hashable, now: float) -> bool:
        """Return True for the vehicle's sender, and after a silence of it for every sender."""
        return sender == self.vehicle or (now - self._heard_at > _SILENT_S and not self._pinned)

    def pin(self) -> None:
        """Keep the vehicle's sender from now on."""
        self._pinned = True

    def release(self) -> None:
        """Handle a lost link: the vehicle may come back from any sender, at once."""
        self._heard_at = -math.inf

    def resume(self, now: float) -> None:
        """Handle a link that is back: the last sender's silence counts from now."""
        self._heard_at = now


Velocity = tuple[float, float, float]  # NED, m/s

_WINDOW_S: Final = 30.0  # of the clock: a vehicle's clock may be slow, and packets may come late
_AHEAD_S: Final = 1.0  # of the expected clock, plus 5 % of a silence
_AHEAD: Final = 0.05
_BEHIND_S: Final = 0.5  # a packet may be older than the newest one by this much
_JUMP_M: Final = 10.0  # an estimator may correct itself by this much, plus 5 m per second
_JUMP_MS: Final = 5.0
_LASTING: Final = 3  # values in a row, so that one wrong value does not count


class Identity:
    """Remembers the clock and the position of one vehicle. `rate`: of its clock relative to ours.

    `why`: the reason, once several messages in a row are of another vehicle. `doubtful`: the last value did
    not fit this vehicle.
    """

    def __init__(self, rate: float) -> None:
        self.why: Reason | None = None
        self.doubtful = False
        self._rate = rate
        self._clock = ClockMap(_WINDOW_S)
        self._last: tuple[float, float] | None = None  # boot time, and host time of its arrival
        self._place: tuple[float, Place, Velocity] | None = None
        # values in a row that did not fit: times by the kind of message, because one kind may be late; and places
        self._strange = Counter[int | str]()

    def owns(self, message: Any, now: float) -> bool:
        """Return True if a message that navigation handles may be from this vehicle."""
        if message.id == dialect.MAVLINK_MSG_ID_HOME_POSITION:
            return True
        boot = message.time_boot_ms / 1e3
        if not self.time(message.id, boot, now):
            return False
        if message.id != dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT or is_zero(message):
            return True
        return self.place(boot, *place_of(message))

    def time(self, msgid: int, boot: float, now: float) -> bool:
        """Return True if the boot time in a message of this kind may be `boot` [s] now."""
        strange = None
        if self._last is not None:
            boot_before, before = self._last
            should = self._clock.boot(before)
            assert should is not None
            ahead = boot - should - self._rate * (now - before) * (1 + _AHEAD)
            if ahead > _AHEAD_S:
                strange = because(Why.CLOCK_AHEAD, seconds=ahead)
            elif boot < boot_before - _BEHIND_S:
                strange = because(Why.CLOCK_BACK)
        if not self._fits(msgid, strange):
            return False
        self._last = max(boot, self._last[0]) if self._last else boot, now
        self._clock.add(now, boot)
        return True

    def place(self, boot: float, place: Place, velocity: Velocity) -> bool:
        """Return True if it may be at this place at this boot time."""
        strange = None
        if self._place is not None:
            before, there, (north, east, down) = self._place
            gap = max(boot - before, 0.0)
            moved = math.dist(offset_m(there, place), (north * gap, east * gap, down * gap))
            if not (off := moved - _JUMP_MS * gap) <= _JUMP_M:  # also NaN
                strange = because(Why.PLACE_JUMPED, metres=off)
        if not self._fits("place", strange):
            return False
        self._place = boot, place, velocity
        return True

    def _fits(self, what: int | str, strange: Reason | None) -> bool:
        """Count the values in a row that do not fit. Return True if this one fits: there is no reason against it."""
        self._strange[what] = self._strange[what] + 1 if strange else 0
        if self._strange[what] >= _LASTING:
            self.why = self.why or strange
        self.doubtful = strange is not None or self._strange["place"] > 0
        return strange is None
