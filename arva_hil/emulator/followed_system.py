"""The vehicles that transmitters follow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from arva_hil.autopilot.following.navigation import Navigation
from arva_hil.events import Event, FollowedSystemHeard, FollowedSystemSilent
from arva_hil.mavlink.codec import Packet, decode, dialect
from arva_hil.model.field import LocalFrame, rotation
from arva_hil.model.field.arrays import Array

_SILENT_S: Final = 2.0  # without a pose
_POSITION: Final = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
_POSES: Final = frozenset({_POSITION, dialect.MAVLINK_MSG_ID_ATTITUDE, dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION})


class FollowedSystem:
    """Remembers the pose of one system, from the messages of the first component that sent a position."""

    def __init__(self, system: int, start: float) -> None:
        self.system = system
        self._navigation = Navigation("", lambda event: None)
        self._component: int | None = None
        self._newest: float | None = None  # pose, on its own clock
        self._heard_at = start
        self._silent = False
        self._was_heard = False

    def on_packets(self, packets: Sequence[Packet], now: float) -> None:
        """Use the system's packets of a chunk."""
        for packet in packets:
            if packet.system != self.system or packet.msgid not in _POSES or packet.refused:
                continue
            if (message := decode(packet)) is None:
                continue
            if self._component is None and packet.msgid == _POSITION:
                self._component = packet.component
            if packet.component == self._component:
                self._on_pose(message, now)

    def pose(self, t: float, frame: LocalFrame) -> tuple[Array, Array] | None:
        """Return position (3,) NED in `frame` [m] and body → NED (3, 3) at `t`; None if it is silent."""
        state = self._navigation.state_at(t, frame)
        if state is None or state.age_s > _SILENT_S:
            return None
        return state.position, rotation.to_matrix(state.attitude)

    def is_known(self, t: float) -> bool:
        """Return True if no later message can change its pose at `t`."""
        return self._navigation.is_known(t)

    def check(self, now: float) -> list[Event]:
        """Return an event if it has become silent, or sends again."""
        silent = now - self._heard_at > _SILENT_S
        if silent == self._silent:
            return []
        self._silent = silent
        back = FollowedSystemHeard(now, self.system)
        return [FollowedSystemSilent(now, self.system, self._was_heard) if silent else back]

    def _on_pose(self, message: object, now: float) -> None:
        self._navigation.on_message(message, now)
        newest = self._navigation.track.newest
        if newest is not None and newest != self._newest:
            self._heard_at, self._was_heard = now, True
        self._newest = newest
