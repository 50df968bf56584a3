"""North, east, down and forward, right, down become ROS's frames: east, north, up and forward, left, up."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arva_hil.model.field import LocalFrame, rotation
from arva_hil.records.ros_messages import geometry
from arva_hil.records.ros_messages.types import Point, Quaternion, Vector3

NED_TO_ENU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
FLU_TO_FRD = np.diag([1, -1, -1])
ANGLES = st.floats(-math.pi, math.pi)


def matrix(q: Quaternion) -> np.ndarray:
    return rotation.to_matrix([q.w, q.x, q.y, q.z])


def test_places_and_vectors() -> None:
    assert geometry.point([20.0, 5.0, -3.0]) == Point(5.0, 20.0, 3.0)
    assert geometry.body_vector([1.0, 2.0, 3.0]) == Vector3(1.0, -2.0, -3.0)


@pytest.mark.parametrize(("heading", "yaw"), [(0, 90), (90, 0), (180, -90), (-90, 180), (30, 60)])
def test_a_level_vehicle_heading_north_has_the_yaw_90_of_ros(heading: float, yaw: float) -> None:
    turned = matrix(geometry.orientation(rotation.to_matrix(rotation.from_euler(0, 0, math.radians(heading)))))
    forward = [math.cos(math.radians(yaw)), math.sin(math.radians(yaw)), 0]
    assert turned @ [1, 0, 0] == pytest.approx(forward, abs=1e-12)
    assert turned @ [0, 0, 1] == pytest.approx([0, 0, 1], abs=1e-12)  # up is up


@given(ANGLES, st.floats(-math.pi / 2, math.pi / 2), ANGLES)
def test_an_orientation_turns_every_vector_as_before(roll: float, pitch: float, yaw: float) -> None:
    frd_to_ned = rotation.to_matrix(rotation.from_euler(roll, pitch, yaw))
    flu_to_enu = matrix(geometry.orientation(frd_to_ned))
    assert flu_to_enu == pytest.approx(NED_TO_ENU @ frd_to_ned @ FLU_TO_FRD, abs=1e-9)


def test_the_map_of_one_vehicle_lies_in_that_of_another_as_their_datums_do() -> None:
    world, own = LocalFrame(46.0, 7.0, 1650.0), LocalFrame(46.01, 7.02, 1700.0)
    there = geometry.between(world, own)
    place = [12.0, -7.0, -30.0]  # in the other's NED
    north, east, down = world.ned(*own.lla(place)).tolist()
    at = there.translation
    shown = matrix(there.rotation) @ (NED_TO_ENU @ place) + [at.x, at.y, at.z]
    assert shown == pytest.approx([east, north, -down], abs=1e-6)
