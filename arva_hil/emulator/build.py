"""Makes transmitters, mount and receiver of a scenario: degrees to radians, positions to NED, keys to arguments."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from arva_hil import config
from arva_hil.autopilot.following.on_request import LatLon
from arva_hil.model.field import (
    Following,
    LocalFrame,
    Mount,
    MovingTransmitters,
    Transmitters,
    Waypoints,
    keying,
    rotation,
)
from arva_hil.model.field.medium import AIR, Medium, skin_depth_m
from arva_hil.model.field.vehicle_noise import VehicleNoise
from arva_hil.model.receiver import ReceiverModel
from arva_hil.registry import RECEIVERS

# EN 282: a field of 80 nA/m must be received, 4.7 dB above the noise
_NORM_NA_M: Final = {"threshold_na_m": 80.0, "noise_na_m": 46.0}

_KEYING: Final = config.KeyingOptions()  # of a transmitter without keying


def transmitters(
    scenario: config.Scenario, frame: LocalFrame, heights: Mapping[LatLon, float] | None = None
) -> Transmitters:
    """Return the scenario's transmitters in the NED frame `frame`; moving ones at their start.

    Those with a depth are below the `ScenarioGround` of `heights`; without a known ground they are unplaced.
    """
    ground, seed = ScenarioGround(scenario, frame, heights), scenario.seed
    ids, places, rotations, strengths, keyings, surfaces, lost = [], [], [], [], [], [], []
    for t in scenario.transmitters:
        place, surface = (_place(t, frame), None) if t.depth_m is None else ground.place(t)
        unplaced = surface is not None and math.isnan(surface)
        if unplaced:
            lost.append(t.id)
        ids.append(t.id)
        places.append((0.0, 0.0, 0.0) if unplaced else place)
        rotations.append(rotation.matrix(*_quaternion(t.attitude)))
        strengths.append(0.0 if unplaced else t.strength * _strength(t))
        keyings.append(_keying(t, seed))
        surfaces.append(surface)
    return Transmitters(
        tuple(ids),
        np.array(places, float).reshape(-1, 3),
        np.array(rotations).reshape(-1, 3, 3),
        np.array(strengths, float),
        frozenset(lost),
        tuple(keyings),
        _medium(scenario.medium, surfaces) if scenario.medium else AIR,
    )


def moving_transmitters(
    scenario: config.Scenario, frame: LocalFrame, heights: Mapping[LatLon, float] | None = None
) -> MovingTransmitters:
    """Return the scenario's transmitters at any time, in the NED frame `frame`."""
    motions = ((index, _motion(t)) for index, t in enumerate(scenario.transmitters) if t.path or t.follows)
    return MovingTransmitters(transmitters(scenario, frame, heights), dict(motions))


def mount(scenario: config.Scenario) -> Mount:
    """Return position and attitude of the scenario's receiver on its vehicle."""
    m = scenario.receiver.mount
    return Mount(m.position, _quaternion(m.attitude))


def receiver(scenario: config.Scenario) -> ReceiverModel:
    """Return the scenario's receiver, without its faults."""
    model: ReceiverModel = RECEIVERS[scenario.receiver.model].from_settings(scenario.receiver, scenario.seed)
    return model


def sling(scenario: config.Scenario) -> rotation.Sling | None:
    """Return the rope under the vehicle on which the receiver hangs; None if it is mounted."""
    options = scenario.receiver.mount.sling
    return rotation.Sling(options.length_m, options.damping) if options else None


def vehicle_noise(scenario: config.Scenario) -> VehicleNoise | None:
    """Return the motors' noise at the scenario's receiver; None if there is none."""
    options = scenario.receiver.vehicle_noise
    return VehicleNoise(options.motors, options.motor_na_m, options.line_na_m, options.levels) if options else None


def outside_norm(scenario: config.Scenario) -> list[str]:
    """Return a sentence for each value of a transmitter or receiver outside the norm, with the norm's limit."""
    of_vehicles = [one.receiver for vehicle in scenario.vehicles for one in vehicle.receivers]
    receivers = [one.options for one in of_vehicles or [scenario.receiver]]
    of_pulses = [one.reference_ua_m for one in receivers if hasattr(one, "reference_ua_m")]
    ua_m = max(of_pulses, default=1.0)
    remarks = [
        f"transmitter {t.id}: {what}"
        for t in scenario.transmitters
        if t.keying is not None or of_pulses
        for what in keying.outside_norm(_keying(t, scenario.seed), t.strength * _strength(t) * ua_m)
    ]
    for one, (name, limit) in product(receivers, _NORM_NA_M.items()):
        value = getattr(one, name, None)
        if value is not None and value > limit:
            remarks.append(f"receiver: {name} {value:g}: the norm has at most {limit:g} nA/m")
    return remarks


def _strength(transmitter: config.Transmitter) -> float:
    options = transmitter.keying
    return keying.KEYING_CLASSES[options.kind].strength if options else 1.0


def _keying(transmitter: config.Transmitter, seed: int) -> keying.Keying:
    """Return the keying of a set of its class, with the values of the scenario."""
    options = transmitter.keying or _KEYING
    names = "period_s", "pulse_s", "phase_s", "jitter_s", "carrier_hz", "leak_db", "from_s"
    given = {name: value for name in names if (value := getattr(options, name)) is not None}
    given |= {"battery": options.battery, "battery_life_s": 3600 * options.battery_life_h}
    kind = keying.KEYING_CLASSES[options.kind]
    return keying.draw_keying(kind, seed, transmitter.id, options.temperature_c, **given)


def _medium(options: config.MediumOptions, ground: Sequence[float | None]) -> Medium:
    """Return the medium. `ground`: down, at each transmitter with a depth: snow begins there."""
    depth_m = skin_depth_m(options.snow_conductivity_s_m, options.snow_permittivity)
    surface = np.array([options.surface_m if down is None else down for down in ground])
    return Medium(options.dipole, depth_m, np.nan_to_num(surface))


def _quaternion(degrees: tuple[float, float, float]) -> rotation.Quaternion:
    roll, pitch, yaw = degrees
    return rotation.from_angles(math.radians(roll), math.radians(pitch), math.radians(yaw))


def _place(transmitter: config.Transmitter, frame: LocalFrame) -> Sequence[float]:
    """Return the place, NED [m]; the origin for one that follows a vehicle, where it is not used."""
    if transmitter.ned is not None:
        return transmitter.ned
    if transmitter.path is not None:
        return transmitter.path.points_ned[0][1:]
    lla = transmitter.lla
    return tuple(frame.ned(lla.lat, lla.lon, lla.alt)) if lla else (0.0, 0.0, 0.0)


def _motion(transmitter: config.Transmitter) -> Waypoints | Following:
    """Return the motion of a transmitter that is not at rest."""
    if (path := transmitter.path) is not None:
        points = np.array(path.points_ned)
        return Waypoints(points[:, 0], points[:, 1:], path.end)
    assert transmitter.follows is not None
    return Following(transmitter.follows.system, np.array(transmitter.follows.offset))


class ScenarioGround:
    """The scenario's grid, or the `heights` [m AMSL] that an autopilot reported for `ground_places`; else level ground.

    With `datum: home` the vehicle stands on the ground there, at any reported altitude.
    """

    def __init__(
        self, scenario: config.Scenario, frame: LocalFrame, heights: Mapping[LatLon, float] | None = None
    ) -> None:
        self._grid = scenario.terrain
        self._frame = frame
        self._heights = heights
        self._at_home = scenario.datum == "home"
        self._level = self._grid is None or (self._grid == "autopilot" and heights is None)

    def place(self, transmitter: config.Transmitter) -> tuple[tuple[float, float, float], float]:
        """Return the place of a transmitter with a depth, NED [m], and the ground there, down [m]; NaN if unknown."""
        lat, lon = lat_lon(transmitter, self._frame)
        north, east, ground = self._frame.ned(lat, lon, self._alt((lat, lon))).tolist()
        if transmitter.ned is not None:
            north, east, level = transmitter.ned
            ground = level if self._level else ground
        return (north, east, ground + (transmitter.depth_m or 0.0)), ground

    def _alt(self, place: LatLon) -> float:
        home = self._frame.lla((0.0, 0.0, 0.0))
        if self._level:
            return float(home[2])
        return self._height(place) + (float(home[2]) - self._height(_rounded(home)) if self._at_home else 0.0)

    def _height(self, place: LatLon) -> float:
        told = (self._heights or {}).get(place) if self._grid == "autopilot" else self._grid.height(*place)
        return math.nan if told is None else told


def ground_places(scenario: config.Scenario, frame: LocalFrame) -> list[LatLon]:
    """Return the places with a needed height: each transmitter with a depth, and the datum if it is home."""
    places = [lat_lon(t, frame) for t in scenario.transmitters if t.depth_m is not None]
    return [_rounded(frame.lla((0.0, 0.0, 0.0))), *places] if places and scenario.datum == "home" else places


def lat_lon(transmitter: config.Transmitter, frame: LocalFrame) -> LatLon:
    """Return the place of a transmitter at rest."""
    lla = transmitter.lla
    return _rounded((lla.lat, lla.lon) if lla else frame.lla(transmitter.ned or (0.0, 0.0, 0.0)))


def _rounded(place: Sequence[ArrayLike]) -> LatLon:
    lat, lon = (round(float(value), 7) for value in place[:2])  # type: ignore[arg-type]
    return lat, lon
