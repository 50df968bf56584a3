"""Vehicles that transmitters follow: where each is, from what is heard of it on any link. Nothing is asked of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from arva_hil.config import Scenario
from arva_hil.events import Event, FollowedSystemHeard, FollowedSystemSilent
from arva_hil.field import LocalFrame, rotation
from arva_hil.mavlink.codec import Packet, Parser, dialect
from arva_hil.vehicle.navigation import Navigation
from arva_hil.vehicle.news import EventQueue

Array = NDArray[np.float64]

_SILENT_S: Final = 2.0  # without a pose
_POSITION: Final = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
_POSES: Final = frozenset({_POSITION, dialect.MAVLINK_MSG_ID_ATTITUDE, dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION})


class FollowedSystem:
    """Remembers where one system says that it is, by the component that has told a position first."""

    def __init__(self, system: int, start: float) -> None:
        self.system = system
        self._navigation = Navigation(EventQueue())
        self._parser = Parser()
        self._component: int | None = None
        self._newest: float | None = None  # pose, on its own clock
        self._heard_at = start
        self._silent = False
        self._was_heard = False

    def hear(self, packet: Packet, now: float) -> None:
        """One of its packets."""
        if packet.msgid not in _POSES or (message := self._parser.decode(packet)) is None:
            return
        if self._component is None and packet.msgid == _POSITION:
            self._component = packet.component
        if packet.component != self._component:
            return
        self._navigation.hear(message, now)
        newest = self._navigation.track.newest
        if newest is not None and newest != self._newest:
            self._heard_at, self._was_heard = now, True
        self._newest = newest

    def pose(self, t: float, frame: LocalFrame) -> tuple[Array, Array] | None:
        """Position (3,) NED in `frame`, metres, and body → NED (3, 3) at `t`; None when it is not heard."""
        boot = self._navigation.clock.boot(t)
        state = None if boot is None else self._navigation.track.at(boot, frame)
        if state is None or state.age_s > _SILENT_S:
            return None
        return state.position, rotation.to_matrix(state.attitude)

    def known_at(self, t: float) -> bool:
        """What there is to know of its pose at `t` is known."""
        boot = self._navigation.clock.boot(t)
        return boot is None or self._newest is None or self._newest >= boot

    def look(self, now: float) -> Event | None:
        """That it has fallen silent, or is heard again; None when nothing has changed."""
        silent = now - self._heard_at > _SILENT_S
        if silent == self._silent:
            return None
        self._silent = silent
        return (
            FollowedSystemSilent(now, self.system, self._was_heard) if silent else FollowedSystemHeard(now, self.system)
        )


class FollowedSystems:
    """Remembers every system that a transmitter of these scenarios follows."""

    def __init__(self, scenarios: Iterable[Scenario], start: float) -> None:
        followed = (t.follows.system for scenario in scenarios for t in scenario.transmitters if t.follows)
        self._by_id = {system: FollowedSystem(system, start) for system in followed}

    def __bool__(self) -> bool:
        return bool(self._by_id)

    def hear(self, packets: Sequence[Packet], now: float) -> None:
        """What was believed of a link's packets, whoever sent them."""
        for packet in packets:
            if (followed := self._by_id.get(packet.system)) is not None:
                followed.hear(packet, now)

    def pose(self, system: int, t: float, frame: LocalFrame) -> tuple[Array, Array] | None:
        """See `FollowedSystem.pose`."""
        return self._by_id[system].pose(t, frame)

    def known_at(self, t: float) -> bool:
        """See `FollowedSystem.known_at`, of all of them."""
        return all(followed.known_at(t) for followed in self._by_id.values())

    def look(self, now: float) -> list[Event]:
        """See `FollowedSystem.look`."""
        return [event for followed in self._by_id.values() if (event := followed.look(now))]
