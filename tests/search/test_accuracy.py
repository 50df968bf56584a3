"""The uncertainty of a position on Earth has the accuracy of the autopilot's own position in it."""

from __future__ import annotations

import math
from typing import Any

import pytest

from arva_hil.autopilot.following.session import Received, Session
from arva_hil.mavlink.codec import Encoder, Parser, dialect
from arva_hil.search.mission.accuracy import Accuracy, PositionAccuracy
from arva_hil.search.strategies.strategy import Found

FLOOR_M = 2.1  # without corrections


def gps(h_acc_mm: int = 0, eph: int = 100, fix: int = dialect.GPS_FIX_TYPE_3D_FIX) -> Any:
    return dialect.MAVLink_gps_raw_int_message(0, fix, 0, 0, 0, eph, 150, 0, 0, 10, h_acc=h_acc_mm)


def estimator(metres: float) -> Any:
    return dialect.MAVLink_estimator_status_message(0, 0, 0, 0, 0, 0, 0, 0, metres, 1.0)


def after(*messages: Any) -> Accuracy:
    accuracy, data = PositionAccuracy(Session()), b"".join(map(Encoder(1, 1).pack, messages))
    accuracy.on_packets(Received(own=list(Parser().feed(data))))
    return accuracy.worst


@pytest.mark.parametrize(
    ("messages", "sigma_m", "reported"),
    [
        ([], FLOOR_M, False),
        ([gps()], FLOOR_M, False),  # 0 is unknown, and not perfect
        ([gps(eph=0)], FLOOR_M, False),
        ([gps(eph=0xFFFF)], FLOOR_M, False),
        ([gps(eph=300)], 3 * FLOOR_M, False),
        ([gps(h_acc_mm=400)], FLOOR_M, True),  # a slow drift is not in it
        ([gps(h_acc_mm=5000)], 5.0, True),
        ([gps(h_acc_mm=20, fix=dialect.GPS_FIX_TYPE_RTK_FIXED)], 0.02, True),
        ([gps(fix=dialect.GPS_FIX_TYPE_RTK_FIXED)], FLOOR_M, False),
        ([gps(), estimator(4.0)], 4.0, True),
        ([gps(), estimator(0.1)], FLOOR_M, True),
        ([estimator(0.0)], FLOOR_M, False),
        ([estimator(math.nan), estimator(math.inf), estimator(-1.0)], FLOOR_M, False),
    ],
)
def test_accuracy_is_what_the_autopilot_reports_and_no_better_than_the_floor(
    messages: list[Any], sigma_m: float, reported: bool
) -> None:
    assert after(*messages) == (pytest.approx(sigma_m), reported)


def test_the_covariance_on_earth_has_both() -> None:
    place = Found(1.0, 2.0, covariance=(0.25, 0.1, 0.04))
    assert Accuracy(2.0).on_earth(place) == pytest.approx((4.25, 0.1, 4.04))
    assert Accuracy(2.0).on_earth(Found(1.0, 2.0)) is None


def test_the_covariance_relative_to_the_drone_has_only_what_changes_near_the_place() -> None:
    place = Found(1.0, 2.0, covariance=(4.0, 0.0, 4.0), now=(1.5, 2.0), now_covariance=(0.25, 0.1, 0.04))
    nn, ne, ee = Accuracy(2.1).relative(place) or (0.0, 0.0, 0.0)
    assert (0.25 < nn < 0.3, 0.04 < ee < 0.09, ne) == (True, True, 0.1)
    assert Accuracy(0.01).relative(place) == pytest.approx((0.25, 0.1, 0.04), abs=1e-5)
