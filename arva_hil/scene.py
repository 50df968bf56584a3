"""The scenario as the model wants it: degrees to radians, places to NED, keys to arguments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arva_hil import config
from arva_hil.model import Antennas, LocalFrame, Receiver, Transmitters, rotation


def transmitters(scenario: config.Scenario, frame: LocalFrame) -> Transmitters:
    """The scenario's transmitters in the NED frame `frame`."""
    every = scenario.transmitters
    return Transmitters(
        tuple(t.id for t in every),
        np.array([_place(t, frame) for t in every]),
        np.array([rotation.to_matrix(_quaternion(t.attitude)) for t in every]),
        np.array([t.strength for t in every]),
    )


def receiver(scenario: config.Scenario) -> Receiver:
    """The scenario's receiver, its transmitters not yet in their places when the datum is the vehicle's home."""
    r = scenario.receiver
    return Receiver(
        transmitters(scenario, LocalFrame(0.0, 0.0, 0.0)),
        Antennas(r.sensitivity, r.kappa_eq, r.noise.floor_range_m, r.noise.kind),
        r.channels,
        r.no_signal,
        r.mount.position,
        _quaternion(r.mount.attitude),
        scenario.seed,
    )


def _quaternion(degrees: tuple[float, float, float]) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return rotation.from_euler(*np.radians(degrees))


def _place(transmitter: config.Transmitter, frame: LocalFrame) -> Sequence[float]:
    """NED, metres; a transmitter has either `ned` or `lla`."""
    if transmitter.ned is not None:
        return transmitter.ned
    lla = transmitter.lla
    assert lla is not None
    return tuple(frame.ned(lla.lat, lla.lon, lla.alt))
