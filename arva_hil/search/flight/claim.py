"""The other searches: the news of the team, and claims to the same vehicle.

A search announces its claim to its vehicle to other searches of this vehicle by a broadcast TUNNEL message.

All searches of a vehicle have the same system and component. ArduPilot does not forward a heartbeat between two links
that send the same ids, but both autopilots forward a broadcast TUNNEL.

A payload has the version, flags (1: launched), the vehicle's boot time at the start of the search [ms], a random number
that distinguishes searches, and the name in ASCII. All numbers are little-endian.
"""

from __future__ import annotations

import math
import os
import platform
import secrets
import struct
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from arva_hil.autopilot.following.discovery import Vehicle
from arva_hil.autopilot.following.navigation import ClockMap
from arva_hil.autopilot.following.session import Received
from arva_hil.mavlink.codec import Packet, decode, dialect, tunnel, untunnel
from arva_hil.search.team.team import Teammate
from arva_hil.search.team.team_tunnel import TeamTunnel

CLAIM_TYPE: Final = 42073  # the payload type, in MAVLink's private range; a team's news have the one before
QUIET_S: Final = 1.5  # arm after this time without an objection to the first announcement
_VERSION: Final = 1
_HEAD: Final = struct.Struct("<BBqQ")
_LAUNCHED: Final = 1
_LONGEST: Final = 64  # bytes of a name
_LATEST: Final = 2**63 - 1  # ms, before the own first announcement: every other search precedes
_EVERY_S: Final = 0.5


class Claim(NamedTuple):
    """One search that wants the vehicle. `since_ms`: the vehicle's boot time at which it began; `number`: random."""

    launched: bool
    since_ms: int
    number: int
    name: str

    def precedes(self, other: Claim) -> bool:
        """Return True if this search gets the vehicle: it flies it already, or it began first."""
        return (not self.launched, *self[1:3]) < (not other.launched, *other[1:3])


def encode(claim: Claim) -> bytes:
    """Return the payload of a claim."""
    name = claim.name.encode("ascii", "replace")[:_LONGEST]
    return _HEAD.pack(_VERSION, claim.launched, claim.since_ms, claim.number) + name


def parse(payload: bytes) -> Claim | None:
    """Return the claim in a payload, None if it is something else."""
    if not _HEAD.size <= len(payload) <= _HEAD.size + _LONGEST:
        return None
    version, flags, since_ms, number = _HEAD.unpack_from(payload)
    name = payload[_HEAD.size :].decode("ascii", "replace")
    if version != _VERSION or flags > _LAUNCHED or not name.isprintable():
        return None
    return Claim(bool(flags), since_ms, number, name)


class OtherSearches:
    """The other searches: those of the team, and those that claim the vehicle of this one.

    `component`: of all searches. `team`: if this search is one of several; `tunnel`: to them, if they are other
    programs. `first`: the claim of another search that gets the vehicle; None without one.
    """

    def __init__(self, component: int, team: Teammate | None, tunnel: TeamTunnel | None) -> None:
        self.first: Claim | None = None
        name = f"process {os.getpid()} on {platform.node() or 'an unknown computer'}"
        self._own = Claim(False, _LATEST, secrets.randbits(64), name)
        self._component = component
        self._team = team
        self._tunnel = tunnel
        self._first_s: float | None = None  # of the own announcements
        self._next_s = -math.inf

    def is_settled(self, now: float) -> bool:
        """Return True if other searches have had the time to object to the own claim."""
        return self._first_s is not None and now - self._first_s >= QUIET_S

    def on_packets(self, received: Received, vehicle: Vehicle | None, now: float) -> None:
        """Use what the session received."""
        if self._tunnel and self._team:
            for packet in received.accepted:
                if news := self._tunnel.on_packet(packet, now):
                    self._team.on_news(news)
        if vehicle and not self.first:
            self.first = self._find_first(received.others, vehicle.system)

    def poll(self, now: float, clock: ClockMap | None, *, launched: bool) -> list[Any]:
        """Return the news and the claim to send now. `clock`: the vehicle's; None: claim nothing."""
        messages = self._tunnel.poll() if self._tunnel else []
        due = now >= self._next_s or launched != self._own.launched
        boot_s = clock.boot(now) if clock and due else None
        if boot_s is None:
            return messages
        if self._first_s is None:
            self._first_s = now
            self._own = self._own._replace(since_ms=round(boot_s * 1e3))
        self._own = self._own._replace(launched=launched)
        self._next_s = now + _EVERY_S
        return [*messages, tunnel(CLAIM_TYPE, encode(self._own))]

    def _find_first(self, packets: Sequence[Packet], system: int) -> Claim | None:
        """Return the claim of another search that gets the vehicle of this system, None if there is none."""
        for packet in packets:
            if packet.msgid != dialect.MAVLINK_MSG_ID_TUNNEL or (packet.system, packet.component) != (
                system,
                self._component,
            ):
                continue
            message = decode(packet)
            if message is None or message.payload_type != CLAIM_TYPE:
                continue
            claim = parse(untunnel(message))
            if claim and claim.number != self._own.number and claim.precedes(self._own):
                return claim
        return None
