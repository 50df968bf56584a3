"""One vehicle as the engine has it: how it is set up, its datum, its true state, its receivers, its motors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arva_hil.config import Scenario
from arva_hil.emulator.datum import Datum
from arva_hil.emulator.followed_systems import FollowedSystems
from arva_hil.emulator.formats import encoder, host_form
from arva_hil.emulator.frame_source import FrameSource
from arva_hil.emulator.true_state import true_state
from arva_hil.events import DatumSet, Event, VehicleStatus
from arva_hil.registry import MAVLINK_FORMATS
from arva_hil.vehicle.motor_load import MotorLoad
from arva_hil.vehicle.pose_track import VehicleState
from arva_hil.vehicle.reasons import NoPose
from arva_hil.vehicle.session import Session

__all__ = ["EmulatedVehicle", "ReceiverSetup", "VehicleSetup", "one_vehicle"]


@dataclass(frozen=True)
class ReceiverSetup:
    """One receiver: its name, the link that takes its frames (the autopilot's own, if the format needs that)."""

    name: str
    sink: str
    scenario: Scenario


@dataclass(frozen=True)
class VehicleSetup:
    """One vehicle: its name, the link on which it is heard, the session that follows it there, and its receivers."""

    name: str
    link: str
    session: Session
    scenario: Scenario
    receivers: Sequence[ReceiverSetup]


def one_vehicle(scenario: Scenario, session: Session, *, link: str = "autopilot", sink: str = "port") -> VehicleSetup:
    """One vehicle with one receiver, as in a scenario that names none. Formats over MAVLink have no sink but `link`."""
    sink = link if scenario.output_format in MAVLINK_FORMATS else sink
    return VehicleSetup("vehicle", link, session, scenario, [ReceiverSetup("receiver", sink, scenario)])


class EmulatedVehicle:
    """Remembers one vehicle's datum and receivers; the session has the rest."""

    def __init__(self, setup: VehicleSetup, followed: FollowedSystems, *, start: float, max_age_s: float) -> None:
        self.name = setup.session.news.name = setup.name
        self.link = setup.link
        self.session = setup.session
        self.datum = Datum(setup.scenario, start)
        self.true_state = true_state(setup.scenario, setup.session, start)
        self.sources = [
            FrameSource(
                self.name,
                receiver.name,
                receiver.sink,
                receiver.scenario,
                encoder(receiver.scenario.output_format, setup.session),
                host=host_form(receiver.scenario.output_format),
                start=start,
                max_age_s=max_age_s,
            )
            for receiver in setup.receivers
        ]
        self.told_missing = False
        noisy = any(receiver.scenario.receiver.vehicle_noise for receiver in setup.receivers)
        self._motors = MotorLoad(setup.session) if noisy else None
        self._followed = followed
        self._scenario = setup.scenario
        if self.datum.frame:
            self._place()

    @property
    def known(self) -> bool:
        return self.session.vehicle is not None

    @property
    def next_due(self) -> float:
        """When there is something to do [s]."""
        return min([self.session.next_due, *[source.next_due for source in self.sources]])

    def hear(self, now: float) -> None:
        """The session has been fed."""
        self.true_state.hear(now)
        if self._motors:
            self._motors.hear()

    def load(self) -> float:
        return self._motors.load if self._motors else 0.0

    def boot(self, t: float) -> float | None:
        return self.session.clock.boot(t)

    def states(self, t: float) -> tuple[VehicleState | None, VehicleState | None]:
        if (frame := self.datum.frame) is None:
            return None, None
        reported = self.session.state_at(t, frame)
        return self.true_state.at(t, frame, reported), reported

    def pose_of(self, system: int, t: float) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        return self._followed.pose(system, t, self.datum.frame) if self.datum.frame else None

    def lacking(self) -> NoPose:
        if self.datum.frame is None and self.session.track.newest is not None:
            return NoPose("no home")
        return self.true_state.lacking() or self.session.why_no_pose()

    def place(self, now: float) -> Event:
        """The datum is another one: so are the places of the transmitters."""
        change = self.datum.changes[-1]
        self._place()
        return DatumSet(now, self.name, *change.lat_lon_alt, change.why)

    def status(self, now: float) -> VehicleStatus:
        session, receivers = self.session, [source.status() for source in self.sources]
        label = session.vehicle.short if session.vehicle else ""
        return VehicleStatus(self.name, label, session.rates(now), receivers, tuple(session.counts().items()))

    def _place(self) -> None:
        assert self.datum.frame is not None
        for source in self.sources:  # all hear the same transmitters
            source.place(self.datum.frame, self._scenario)
