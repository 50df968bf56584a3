"""Which readings without an id the transmitters found explain, and a search for two of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from arva_hil.model.field import dipole_field, rotation
from arva_hil.model.receiver import Zone
from arva_hil.model.receiver.paper import outputs
from arva_hil.search.mission.choice import NO_ID
from arva_hil.search.strategies.dipole import MOMENT
from arva_hil.search.strategies.explained import dipole_at, explains
from arva_hil.search.strategies.strategy import Found, Observation
from tests.search.test_flights import Flight

PLACE = (6.0, -4.0, 1.0)
TURNED = rotation.to_matrix(rotation.from_euler(0.0, 0.3, 1.1))  # the transmitter
FOUND = np.array([*PLACE, *MOMENT * TURNED[:, 0], 0.0])
away = st.floats(-20.0, 20.0)


def reading(north: float, east: float, height: float, yaw: float = 0.0) -> Observation:
    """What the paper's receiver displays there of the transmitter at `PLACE`."""
    at, turned = (north, east, -height), rotation.to_matrix(rotation.from_euler(0.1, -0.1, yaw))
    field = dipole_field(np.array(at), [PLACE], TURNED[None], np.ones(1))
    (d_cm,), (delta_deg,), (zone,) = outputs(field @ turned, 1.542)
    return Observation(0.0, at, turned, int(d_cm), int(delta_deg), zone == Zone.INNER)


@given(north=away, east=away, height=st.floats(0.5, 5.0), yaw=st.floats(-math.pi, math.pi))
def test_the_readings_of_a_transmitter_found_are_explained_and_nearer_ones_are_of_another(
    north: float, east: float, height: float, yaw: float
) -> None:
    o = reading(north, east, height, yaw)
    assume(o.heard)
    assert explains(FOUND, o)
    assert not explains(FOUND, o._replace(d_cm=o.d_cm // 2))


def test_a_direction_that_is_not_its_own_is_of_another_as_near() -> None:
    o = reading(0.0, 0.0, 2.0)
    assert not o.inner
    other = o._replace(delta_deg=(o.delta_deg + 60 + 90) % 180 - 90)
    assert not explains(FOUND, other)
    assert explains(FOUND, other._replace(d_cm=2 * o.d_cm))  # none is as near


def test_the_dipole_at_a_place_found_is_that_of_its_readings() -> None:
    past = [reading(8 - k, 5 * math.sin(k), 2.0, 0.4 * k) for k in range(16)]
    x = dipole_at(Found(*PLACE[:2]), [*past, past[0]._replace(d_cm=-1)])
    moment = x[3:6] * math.copysign(1.0, x[3:6] @ FOUND[3:6])  # m and −m give equal readings
    assert [*x[:3], *moment] == pytest.approx([*FOUND[:6]], abs=0.05)


def test_two_transmitters_without_ids_are_found_one_after_the_other() -> None:
    two = "{id: 1, ned: [6, 3, 1]}, {id: 2, ned: [-4, -5, 1]}"
    flight = Flight("estimate", "output: {format: text}", victim=two, victims=2, area=(-8.0, -8.0, 8.0, 8.0))
    assert flight.outcome.kind == "found"
    assert [victim.id for victim in flight.outcome.victims] == [NO_ID, NO_ID]
    places = sorted(victim.found[:2] for victim in flight.outcome.victims)
    assert places == [pytest.approx((-4.0, -5.0), abs=0.1), pytest.approx((6.0, 3.0), abs=0.1)]
