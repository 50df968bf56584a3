"""A search uses what the receiver has: integers, or the signed signals of its antennas and the age of the pulse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from arva_hil.model.field import dipole_field, rotation
from arva_hil.search.mission.choice import observations, pulses
from arva_hil.search.strategies.estimate import Estimate
from arva_hil.search.strategies.strategy import Observation
from firmware_proto import INNER, MID, Channel, Frame, LevelChannel, Measured, VectorChannel
from firmware_proto.measured import VECTOR

KAPPA_EQ = 1.542


@pytest.mark.parametrize("place", [(12.0, 5.0, -4.0), (2.0, -1.0, -1.5)])
@pytest.mark.parametrize("inner", [False, True])
def test_signals_tell_d_of_two_antennas_with_its_direction_and_d_of_three(
    place: tuple[float, float, float], inner: bool
) -> None:
    x, y, z = dipole_field(place, [[0, 0, 0]], [np.eye(3)], [1.0])[0].tolist()
    of_two, of_three = (math.cbrt(KAPPA_EQ / (4 * math.pi * h)) for h in (math.hypot(x, y), math.hypot(x, y, z)))
    shown = round(100 * (of_three if inner else of_two))
    o = Observation(0.0, place, np.eye(3), shown, 0, inner, signal=(1e5 * x, 1e5 * y, 1e5 * z))
    (d, delta, all_antennas), (d_3, _, all_3) = o.measurements
    assert (d, d_3) == pytest.approx((of_two, of_three), abs=0.01)
    assert (delta, all_antennas, all_3) == (pytest.approx(math.atan2(y, x)), False, True)


@pytest.mark.parametrize("signal", [None, (0.0, 0.0, 7.0), (3.0, 4.0, 0.0)])  # integers alone, no x and y, no antenna z
def test_otherwise_it_tells_what_its_integers_say(signal: tuple[float, float, float] | None) -> None:
    o = Observation(0.0, (0.0, 0.0, -3.0), np.eye(3), 250, 30, False, signal=signal)
    assert o.measurements == [(2.5, math.radians(30), False)]
    assert Observation(0.0, (0.0, 0.0, -3.0), np.eye(3), -1, -1, False, signal=signal).measurements[0][0] < 0


def test_what_was_measured_comes_with_the_reading_of_its_channel() -> None:
    channels = Channel(7, MID, 900, 10), Channel(9, INNER, 200, 0), Channel(None, 0, -1, -1)
    vectors = VectorChannel(7, MID, x=100, y=-20, z=3, age_ms=40), VectorChannel(9, INNER, age_ms=None), VectorChannel()
    frame = Frame(1, 0, channels, Measured(5000, vectors))
    (came,) = VECTOR.decoder().feed(VECTOR.encode(frame), 0.0)
    heard = observations(pulses(came), 8.0, (0.0, 0.0, -3.0), np.eye(3), None)
    assert list(heard) == [9, 7]
    assert (heard[7].signal, heard[7].age_s) == ((100, -20, 3), 0.04)
    assert (heard[9].signal, heard[9].age_s) == (None, 0.0)
    levels = frame._replace(measured=Measured(5000, tuple(LevelChannel(c.id, level=-100) for c in channels)))
    assert observations(pulses(levels), 8.0, (0.0, 0.0, -3.0), np.eye(3), None)[7].signal is None


@pytest.mark.parametrize("turn", [(0.0, 0.1, 0.4), (2.0, -0.5, 2.5)])
def test_the_same_readings_with_signals_tell_the_place_better(turn: tuple[float, float, float]) -> None:
    sent = [[0.0, 0.0, 1.0]], [rotation.to_matrix(rotation.from_euler(*turn))], [1.0]
    sigmas = []
    for with_signals in (True, False):
        strategy = Estimate(1.0)
        for k in range(8):
            at = (-14.0 + 1.5 * k, 4.0, -3.0)
            x, y, z = (1e6 * dipole_field(at, *sent)[0]).tolist()
            d_cm = round(100 * math.cbrt(1e6 * KAPPA_EQ / (4 * math.pi * math.hypot(x, y))))
            delta_deg = round(math.degrees(math.atan(y / x)))
            signal = (x, y, z) if with_signals else None
            strategy.observe(Observation(float(k), at, np.eye(3), d_cm, delta_deg, False, signal=signal))
        nn, _, ee = strategy.belief.covariance or (math.inf,) * 3
        sigmas.append(math.hypot(nn, ee) ** 0.5)
    assert sigmas[0] < 0.7 * sigmas[1]
