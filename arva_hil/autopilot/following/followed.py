"""The known state of one vehicle and of its link. These methods change nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from arva_hil.autopilot.following.discovery import Identity, Senders, Vehicle, VehicleDiscovery
from arva_hil.autopilot.following.navigation import Navigation, Place
from arva_hil.autopilot.following.pose_track import ClockMap, PoseTrack
from arva_hil.autopilot.following.streams import Stream, Streams
from arva_hil.events import Event
from arva_hil.events.reasons import NoPose, NoVehicle, NoVehicleReason, Reason, SilentStream
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.mavlink.packet import Verdict
from arva_hil.mavlink.packet_reader import PacketReader
from arva_hil.mavlink.signing import Signing

COMPONENT: Final = dialect.MAV_COMP_ID_ONBOARD_COMPUTER  # 191


class FollowedVehicle:
    """The state of a `Session`, which explains the arguments."""

    def __init__(
        self,
        *,
        target_system: int | None = None,
        target_component: int | None = None,
        rate_hz: float = 50.0,
        passive: bool = False,
        component: int = COMPONENT,
        signing: Signing | None = None,
        reader: PacketReader | None = None,
        name: str = "vehicle",
    ) -> None:
        self.name = name
        self.reader = reader = reader or PacketReader(signing)
        self.target_system = target_system
        self.senders = Senders()
        self.encoder = Encoder(target_system or 1, component, signing=reader.signing)
        self.vehicle: Vehicle | None = None
        self._events: list[Event] = []  # since the last `receive` or `poll`
        self.navigation = Navigation(name, self._events.append)
        self.ignored = 0  # packets of other systems and components, and of senders with the vehicle's ids
        self.rate_hz = rate_hz
        self.next_due = -math.inf
        self._finder = VehicleDiscovery(target_system, target_component)
        self._passive = passive
        self._disbelieved: set[Verdict] = set()
        self._streams: Streams | None = None
        self._identity: Identity | None = None  # of the pinned vehicle
        self._extras: dict[int, float] = {}
        self._next_heartbeat = self._last_heartbeat = -math.inf
        self.lost = False  # its heartbeat has stopped
        self._interrupted = ""  # why the link is lost

    @property
    def usurped(self) -> Reason | None:
        """The reason why the sender is not the pinned vehicle any more; None while it is."""
        return self._identity.why if self._identity else None

    @property
    def doubtful(self) -> bool:
        """True if the last message may be from another vehicle than the pinned one."""
        return self._identity is not None and self._identity.doubtful

    @property
    def track(self) -> PoseTrack:
        """The vehicle's pose over the last seconds."""
        return self.navigation.track

    @property
    def clock(self) -> ClockMap:
        """The vehicle's clock."""
        return self.navigation.clock

    @property
    def home(self) -> Place | None:
        """The vehicle's home; None before it has sent it."""
        return self.navigation.home

    @property
    def reachable(self) -> bool:
        """True if something can be sent to the vehicle."""
        return self.vehicle is not None and not (self.lost or self._passive or self._interrupted)

    def rates(self, now: float) -> dict[str, float]:
        """Return measured rates [Hz] of the pose streams."""
        return self._streams.rates(now) if self._streams else {}

    @property
    def streams(self) -> Sequence[Stream]:
        """The pose streams; none before there is a vehicle."""
        return self._streams.wanted if self._streams else ()

    def answers_us(self, message: Any) -> bool:
        """Return True if a COMMAND_ACK is for us, or without an addressee, as older autopilots send it."""
        addressee = (message.target_system, message.target_component)
        return addressee in ((self.encoder.system, self.encoder.component), (0, 0))

    def counts(self) -> dict[str, int]:
        """Return counters of what was received and not used."""
        return {
            "bytes_received": self.reader.bytes,
            "packets_received": self.reader.parser.packets,
            "bad_checksums": self.reader.parser.bad_crc,
            "bytes_skipped": self.reader.parser.skipped,
            "packets_ignored": self.ignored,
            **self.disbelieved(),
            "positions_before_fix": self.navigation.unpositioned,
            "reboots": self.navigation.reboots,
            "clock_leaps": self.navigation.leaps,
            "position_jumps": self.navigation.jumps,
        }

    def disbelieved(self) -> dict[str, int]:
        """Return counters of complete packets and values that were not used."""
        signatures = self.disbelieved_signatures() or {}
        return {
            "packets_incompatible": self.reader.parser.incompatible,
            "packets_malformed": self.reader.parser.malformed,
            **{f"packets_{why}": count for why, count in signatures.items()},
            "values_refused": self.navigation.refused,
            "stray_times": self.navigation.times.strays,
            "stray_positions": self.navigation.places.strays,
        }

    def disbelieved_signatures(self) -> dict[str, int] | None:
        """Return the number of packets refused for their signature, by reason; None without a key."""
        return dict(self.reader.signing.refused) if self.reader.signing else None

    def why_no_vehicle(self) -> NoVehicle:
        """Return the traffic received, in words, if no vehicle was found."""
        if self._interrupted:
            return NoVehicle("link lost", self._interrupted)
        packets, refused = (
            self.reader.parser.packets,
            tuple(self.reader.signing.refused.items()) if self.reader.signing else (),
        )
        if not packets:
            return NoVehicle("no packets" if self.reader.bytes else "silence", bytes=self.reader.bytes)
        reason: NoVehicleReason = "no heartbeat"
        if self._disbelieved or self._finder.refused_vehicle:
            reason = "no signature" if self._disbelieved else "other vehicles"
        return NoVehicle(reason, "", self.reader.bytes, packets, refused, self._finder.sources)

    def why_no_pose(self) -> NoPose:
        """Return the reason why there is a vehicle but no pose."""
        if self._streams is None:
            return NoPose("no vehicle")
        nowhere = self.track.first_position is None
        zeros = nowhere and self.navigation.unpositioned > 0
        missing = []
        for stream in self._streams.wanted:
            is_position = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT in stream.ids
            if not any(stream.seen.values()) and not (zeros and is_position):
                promised = is_position and stream.promised
                missing.append(SilentStream(stream.name, *stream.asked, self._passive, promised))
        if zeros:
            return NoPose("zero position", tuple(missing))
        if missing:
            return NoPose("streams missing", tuple(missing))
        return NoPose("impossible position" if nowhere else "streams stopped")
