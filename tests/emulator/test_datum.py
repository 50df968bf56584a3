"""Where the scenario's origin lies: a place in the file, the vehicle's home, or its first position."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.config import DEFAULT, Lla
from arva_hil.emulator.datum import HOME_WAIT_S, Datum
from arva_hil.events import Event, FrameMade, TooFar
from arva_hil.events.words.reasons import in_words
from arva_hil.events.words.sentences import sentence
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.model.field import LocalFrame
from arva_hil.model.receiver import ChannelReading, Pose, Reading, Zone
from firmware_proto import Frame

Place = tuple[float, float, float]
A, B, C = (46.5, 11.35, 1800.0), (46.5, 11.35, 1801.3), (46.6, 11.4, 1700.0)


class Told:
    """A session that is told what the test says, and the datum that looks at it after each."""

    def __init__(self, fixed: Lla | None = None) -> None:
        self.session = Session(passive=True)
        self.datum = Datum(replace(DEFAULT, datum=fixed or "home"))

    def _tell(self, message: Any, now: float) -> bool:
        self.session.feed(Encoder(1, 1).pack(message), now)
        return self.datum.update(self.session, now)

    def heartbeat(self, now: float, *, armed: bool = False) -> bool:
        return self._tell(dialect.MAVLink_heartbeat_message(2, 3, 128 if armed else 0, 0, 3, 3), now)

    def home(self, place: Place, now: float) -> bool:
        where = round(place[0] * 1e7), round(place[1] * 1e7), round(place[2] * 1e3)
        return self._tell(dialect.MAVLink_home_position_message(*where, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0), now)

    def position(self, place: Place, now: float, boot: float | None = None) -> bool:
        where = round(place[0] * 1e7), round(place[1] * 1e7), round(place[2] * 1e3)
        boot_ms = round((now if boot is None else boot) * 1e3)
        return self._tell(dialect.MAVLink_global_position_int_message(boot_ms, *where, 0, 0, 0, 0, 0), now)

    def lies_at(self, place: Place | None) -> bool:
        frame = self.datum.frame
        if frame is None or place is None:
            return frame is None and place is None
        return bool(abs(frame.ned(*place)).max() < 1e-6)


@pytest.fixture
def told() -> Told:
    told = Told()
    told.heartbeat(0.0)
    return told


def test_a_fixed_datum_stays_whatever_the_vehicle_says() -> None:
    told = Told(Lla(*C))
    assert told.lies_at(C)
    changes = [told.heartbeat(0.0), told.home(A, 1.0), told.position(A, 2.0), told.position(A, 20.0)]
    assert changes == [False] * 4
    assert told.lies_at(C)


def test_without_a_vehicle_there_is_none() -> None:
    told = Told()
    assert not told.datum.update(told.session, 100.0)
    assert told.lies_at(None)
    assert told.datum.lla is None


def test_home_is_the_datum_at_once(told: Told) -> None:
    assert told.home(A, 0.1)
    assert told.lies_at(A)
    assert told.datum.lla == A
    assert not told.home(A, 0.2)  # nothing new


def test_home_is_followed_until_the_vehicle_arms_and_again_after_it_has_landed(told: Told) -> None:
    told.home(A, 0.1)
    assert told.home(B, 1.0)
    assert told.lies_at(B)
    told.heartbeat(2.0, armed=True)
    assert not told.home(C, 3.0)
    assert not told.home(B, 3.5)
    assert told.lies_at(B)
    assert not told.heartbeat(4.0)
    assert told.home(C, 5.0)
    assert told.lies_at(C)
    assert [in_words(change.why) for change in told.datum.changes] == ["", "home has moved", "a new home after landing"]
    assert [change.time_s for change in told.datum.changes] == [0.1, 1.0, 5.0]
    assert told.datum.of_the_flight == pytest.approx(B)


def test_a_home_that_was_moved_in_flight_is_the_datum_once_the_vehicle_is_disarmed(told: Told) -> None:
    told.home(A, 0.1)
    told.heartbeat(2.0, armed=True)
    assert not told.home(C, 3.0)
    assert told.heartbeat(4.0)
    assert told.lies_at(C)


def test_every_flight_keeps_the_datum_it_began_with(told: Told) -> None:
    for n, (home, elsewhere) in enumerate([(A, B), (C, A), (B, C)]):
        told.home(home, 10.0 * n)
        told.heartbeat(10.0 * n + 1, armed=True)
        assert not told.home(elsewhere, 10.0 * n + 4)
        assert told.lies_at(home)
        assert told.datum.of_the_flight == pytest.approx(home)
        told.heartbeat(10.0 * n + 5)


def test_home_where_the_vehicle_has_landed_is_the_datum_when_it_arms_again(told: Told) -> None:
    """PX4 moves its home there as soon as it is disarmed, beside the transmitter that it has found."""
    told.home(A, 0.1)
    told.heartbeat(1.0, armed=True)
    told.heartbeat(60.0)
    landed = (46.5005, 11.3505, 1790.0)  # 68 m away
    assert not told.home(landed, 61.0)
    assert not told.heartbeat(62.0)
    assert told.lies_at(A)
    assert told.datum.of_the_flight == pytest.approx(A)
    assert told.heartbeat(100.0, armed=True)
    assert told.lies_at(landed)
    assert told.datum.of_the_flight == pytest.approx(landed)
    assert in_words(told.datum.changes[-1].why) == "a new home after landing"


def test_home_that_is_set_by_arming_again_may_come_just_after_it(told: Told) -> None:
    told.home(A, 0.1)
    told.heartbeat(1.0, armed=True)
    assert not told.home(B, 1.5)  # the first flight has its datum
    told.heartbeat(60.0)
    told.home(A, 61.0)
    told.heartbeat(100.0, armed=True)
    assert told.home(B, 101.0)
    assert not told.home(A, 103.0)
    assert told.lies_at(B)


def test_after_a_reboot_home_is_followed_by_the_metre_again(told: Told) -> None:
    told.home(A, 0.1)
    told.heartbeat(1.0, armed=True)
    told.position(A, 60.0)
    told.heartbeat(61.0)
    for n in range(2):
        told.position(A, 70.0 + n / 10, boot=1.0 + n / 10)
    assert told.session.navigation.reboots == 1
    assert told.home(B, 71.0)
    assert told.lies_at(B)


def test_the_home_of_a_vehicle_already_in_flight_is_the_datum(told: Told) -> None:
    told.heartbeat(0.5, armed=True)
    assert told.home(A, 1.0)
    assert not told.home(B, 2.0)
    assert told.lies_at(A)


def test_without_home_the_first_position_serves_after_five_seconds(told: Told) -> None:
    assert not told.position(A, 10.0)
    assert not told.position(B, 10.0 + HOME_WAIT_S - 0.01)
    assert told.lies_at(None)
    assert told.position(B, 10.0 + HOME_WAIT_S)
    assert told.lies_at(A)
    assert HOME_WAIT_S == 5.0


def test_it_does_not_follow_the_positions(told: Told) -> None:
    changes = [told.position((46.5 + i * 1e-5, 11.35, 1800.0), float(i)) for i in range(1, 60)]
    assert changes.count(True) == 1
    assert told.lies_at((46.50001, 11.35, 1800.0))


def test_the_wait_is_for_a_valid_position(told: Told) -> None:
    for i in range(20):
        assert not told.position((0.0, 0.0, 0.0), float(i))
    assert not told.position(A, 20.0)
    assert not told.position(A, 24.9)
    assert told.position(A, 25.0)


def test_a_home_that_comes_later_wins_while_disarmed(told: Told) -> None:
    told.position(C, 1.0)
    told.position(C, 7.0)
    assert told.lies_at(C)
    assert told.home(A, 8.0)
    assert told.lies_at(A)
    assert not told.position(C, 9.0)


def test_a_reboot_on_the_ground_keeps_the_datum_until_there_is_a_new_home(told: Told) -> None:
    told.home(A, 0.1)
    told.position(A, 60.0)
    assert not told.position(C, 61.0, boot=1.0)
    assert not told.position(C, 61.1, boot=1.1)
    assert told.session.navigation.reboots == 1
    assert not told.position(C, 70.0, boot=10.0)
    assert told.lies_at(A)
    assert told.home(B, 71.0)
    assert told.lies_at(B)


def test_a_reboot_keeps_the_datum_while_the_vehicle_is_armed_and_a_home_elsewhere_is_the_next_one(told: Told) -> None:
    told.home(A, 0.1)
    told.heartbeat(1.0, armed=True)
    told.position(A, 60.0)
    told.position(C, 61.0, boot=1.0)
    told.position(C, 61.1, boot=1.1)
    assert not told.home(C, 61.5)
    assert told.session.navigation.reboots == 1
    assert told.lies_at(A)
    assert told.heartbeat(62.0)
    assert told.lies_at(C)


def test_without_home_a_reboot_elsewhere_begins_anew_after_the_wait_for_home(told: Told) -> None:
    told.position(A, 60.0)
    assert told.position(A, 65.0)
    told.position(C, 66.0, boot=1.0)
    told.position(C, 66.1, boot=1.1)
    assert not told.position(C, 70.0, boot=5.0)
    assert told.lies_at(A)
    assert told.position(C, 71.2, boot=6.2)
    assert told.lies_at(C)
    assert in_words(told.datum.changes[-1].why) == "the vehicle has rebooted"


# -- positions that jump -------------------------------------------------------------------------------------------

LOW, ORIGIN = (46.5, 11.35, 1.25), (46.5, 11.35, 588.0)  # before the estimator has an origin, and then


def test_without_home_a_jump_before_arming_is_a_new_datum(told: Told) -> None:
    for n in range(7):
        told.position(LOW, float(n))
    assert told.lies_at(LOW)
    assert not told.position(ORIGIN, 7.0)  # not believed yet
    assert told.position(ORIGIN, 8.0)
    assert told.lies_at(ORIGIN)
    assert in_words(told.datum.changes[-1].why) == "its position has jumped"
    assert not told.position((46.5001, 11.35, 589.0), 9.0)


def test_a_jump_during_the_wait_for_home_is_no_second_wait(told: Told) -> None:
    told.position(LOW, 0.0)
    told.position(ORIGIN, 1.0)
    assert not told.position(ORIGIN, 2.0)
    assert told.position(ORIGIN, 5.0)
    assert told.lies_at(ORIGIN)
    assert len(told.datum.changes) == 1


def test_a_jump_in_flight_leaves_the_datum_where_it_is_until_the_vehicle_is_disarmed(told: Told) -> None:
    for n in range(7):
        told.position(LOW, float(n))
    told.heartbeat(7.0, armed=True)
    for n in range(8, 12):
        assert not told.position(ORIGIN, float(n))
    assert told.lies_at(LOW)
    assert told.heartbeat(12.0)
    assert told.lies_at(ORIGIN)


def test_a_jump_does_not_take_the_datum_from_a_home(told: Told) -> None:
    told.home(A, 0.1)
    for n in range(10):
        assert not told.position(LOW if n < 5 else ORIGIN, 1.0 + n)
    assert told.session.navigation.jumps == 1
    assert told.lies_at(A)


def test_a_reboot_starts_the_wait_for_home_again(told: Told) -> None:
    told.position(A, 60.0)
    told.position((0.0, 0.0, 0.0), 63.9, boot=0.9)
    told.position((0.0, 0.0, 0.0), 64.0, boot=1.0)
    assert not told.position(B, 66.0, boot=3.0)
    assert told.lies_at(None)
    assert told.home(C, 70.0)
    assert told.lies_at(C)


def test_the_frame_is_north_east_down_from_there(told: Told) -> None:
    told.home(A, 0.1)
    frame = told.datum.frame
    assert isinstance(frame, LocalFrame)
    north, east, down = frame.ned(46.501, 11.351, 1790.0)
    assert (north, east) == pytest.approx((111.2, 76.8), abs=0.3)
    assert down == pytest.approx(10.0, abs=0.01)


def test_in_flight_a_home_that_comes_late_does_not_move_the_transmitters(told: Told) -> None:
    told.position(C, 1.0)
    told.position(C, 7.0)
    told.heartbeat(8.0, armed=True)
    assert not told.home(A, 9.0)
    assert told.lies_at(C)
    assert told.heartbeat(10.0)
    assert told.lies_at(A)


# -- too far away --------------------------------------------------------------------------------------------------


def test_a_vehicle_far_from_everything_is_said_once_for_each_place_of_the_datum(told: Told) -> None:
    told.home(A, 0.1)
    away = Pose(np.array([100_000.0, 55_000.0, -10.0]), np.eye(3))
    frame = Frame(0, 0, ())

    def too_far(id_: int | None, true_range_m: float | None) -> list[Event]:
        what = Reading((ChannelReading(id_, Zone.OUTER, -1, -1, true_range_m),), False, False)
        return told.datum.check_distance(FrameMade(0.0, "v", "r", 0, 0.0, None, away, None, what, frame, True, 0.0))

    assert too_far(None, 900.0) == []
    assert too_far(None, None) == []  # no transmitter at all
    assert too_far(3, 5000.0) == []  # heard
    (event,) = too_far(None, 114_130.0)
    assert isinstance(event, TooFar)
    assert (event.from_datum_m, event.nearest_m) == pytest.approx((114_127.0, 114_130.0), abs=1)
    assert too_far(None, 114_131.0) == []
    told.home(C, 1.0)
    assert too_far(None, 114_131.0)


@pytest.mark.parametrize(
    ("fixed", "cure"), [(True, "correct `datum` and `transmitters`"), (False, "datum: {lat: …, lon: …, alt: …}")]
)
def test_far_from_everything_the_cure_fits_the_datum(fixed: bool, cure: str) -> None:
    said = sentence(TooFar(1.0, "vehicle", "receiver", 114_127.0, 114_130.0, fixed))
    assert said is not None
    assert said.text.startswith("the vehicle is 114.1 km from the datum and 114.1 km from the nearest transmitter")
    assert cure in said.text
