"""The scenario as the model wants it: degrees to radians, places to NED, keys to arguments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arva_hil import config
from arva_hil.field import Following, LocalFrame, Mount, MovingTransmitters, Transmitters, Waypoints, rotation
from arva_hil.field.keying import KEYING_CLASSES, draw_keying
from arva_hil.receiver import ReceiverModel
from arva_hil.registry import RECEIVERS


def transmitters(scenario: config.Scenario, frame: LocalFrame) -> Transmitters:
    """The scenario's transmitters in the NED frame `frame`, those that move where they begin."""
    every = scenario.transmitters
    return Transmitters(
        tuple(t.id for t in every),
        np.array([_place(t, frame) for t in every]),
        np.array([rotation.to_matrix(_quaternion(t.attitude)) for t in every]),
        np.array([t.strength for t in every]),
        keyings=tuple(draw_keying(KEYING_CLASSES["modern"], scenario.seed, t.id) for t in every),
    )


def moving_transmitters(scenario: config.Scenario, frame: LocalFrame) -> MovingTransmitters:
    """The same at any time."""
    motions = {index: motion for index, t in enumerate(scenario.transmitters) if (motion := _motion(t))}
    return MovingTransmitters(transmitters(scenario, frame), motions)


def mount(scenario: config.Scenario) -> Mount:
    """Where the scenario's receiver sits on its vehicle."""
    m = scenario.receiver.mount
    return Mount(m.position, _quaternion(m.attitude))


def receiver(scenario: config.Scenario) -> ReceiverModel:
    """The scenario's receiver, without its faults."""
    model: ReceiverModel = RECEIVERS[scenario.receiver.model].from_settings(scenario.receiver, scenario.seed)
    return model


def _quaternion(degrees: tuple[float, float, float]) -> NDArray[np.float64]:
    return rotation.from_euler(*np.radians(degrees))


def _place(transmitter: config.Transmitter, frame: LocalFrame) -> Sequence[float]:
    """NED, metres; of one that follows a vehicle the origin, which nobody asks for."""
    if transmitter.ned is not None:
        return transmitter.ned
    if transmitter.path is not None:
        return transmitter.path.points_ned[0][1:]
    lla = transmitter.lla
    return tuple(frame.ned(lla.lat, lla.lon, lla.alt)) if lla else (0.0, 0.0, 0.0)


def _motion(transmitter: config.Transmitter) -> Waypoints | Following | None:
    """How it moves, None for one at rest."""
    if (path := transmitter.path) is not None:
        points = np.array(path.points_ned)
        return Waypoints(points[:, 0], points[:, 1:], path.end)
    if (follows := transmitter.follows) is not None:
        return Following(follows.system, np.array(follows.offset))
    return None
