"""Where the scenario's origin lies: a place in the file, the vehicle's home, or its first position."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from arva_hil.autopilot.following.session import Session
from arva_hil.config import DEFAULT, Lla
from arva_hil.emulator.datum import HOME_WAIT_S, Datum
from arva_hil.events import Event, TooFar
from arva_hil.events.words.reasons import in_words
from arva_hil.events.words.sentences import sentence
from arva_hil.mavlink.codec import Encoder, dialect
from arva_hil.model.field import LocalFrame
from arva_hil.model.receiver import ChannelReading, Pose, Zone
from tests.every import every
from tests.made_frames import frame_made

Place = tuple[float, float, float]
A, B, C = (46.5, 11.35, 1800.0), (46.5, 11.35, 1801.3), (46.6, 11.4, 1700.0)


class Told:
    """A session that is told what the test says, and the datum that looks at it after each. `heard`: a heartbeat."""

    def __init__(self, fixed: Lla | None = None, *, heard: bool = True) -> None:
        self.session = Session(passive=True)
        self.datum = Datum(replace(DEFAULT, datum=fixed or "home"))
        if heard:
            self.heartbeat(0.0)

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


Step = Callable[[Told], None]


def _expect(got: bool, moved: bool | None) -> None:
    assert moved in (None, got), f"moved: {got}"


def home(place: Place, now: float, moved: bool | None = None) -> Step:
    """It sends a home; `moved`: whether the datum is another then."""
    return lambda told: _expect(told.home(place, now), moved)


def position(place: Place, now: float, moved: bool | None = None, boot: float | None = None) -> Step:
    return lambda told: _expect(told.position(place, now, boot), moved)


def beat(now: float, moved: bool | None = None, *, armed: bool = False) -> Step:
    return lambda told: _expect(told.heartbeat(now, armed=armed), moved)


arm = partial(beat, armed=True)


def at(place: Place | None, *, flight: Place | None = None, why: Sequence[str] = ()) -> Step:
    """There it lies; the last flight's; the reasons for its last changes."""

    def step(told: Told) -> None:
        assert told.lies_at(place)
        assert flight is None or told.datum.of_the_flight == pytest.approx(flight)
        assert [in_words(change.why) for change in told.datum.changes[-len(why) :]] == list(why) or not why

    return step


def went(*, reboots: int = 0, jumps: int = 0, changes: Sequence[float] = ()) -> Step:
    """So often it rebooted and jumped; the times at which the datum changed."""

    def step(told: Told) -> None:
        assert (told.session.navigation.reboots, told.session.navigation.jumps) == (reboots, jumps)
        assert not changes or [change.time_s for change in told.datum.changes] == list(changes)

    return step


LANDED = (46.5005, 11.3505, 1790.0)  # 68 m from A
LOW, ORIGIN = (46.5, 11.35, 1.25), (46.5, 11.35, 588.0)  # before the estimator has an origin, and then
NOWHERE = (0.0, 0.0, 0.0)
WAIT = HOME_WAIT_S


@every(
    "story, steps",
    [
        ("home is the datum at once", [home(A, 0.1, True), at(A), home(A, 0.2, False)]),
        (
            "home is followed until the vehicle arms, and again after it has landed",
            [
                *(home(A, 0.1), home(B, 1.0, True), at(B), arm(2.0), home(C, 3.0, False), home(B, 3.5, False), at(B)),
                *(beat(4.0, False), home(C, 5.0, True)),
                at(C, flight=B, why=["", "home has moved", "a new home after landing"]),
                went(changes=[0.1, 1.0, 5.0]),
            ],
        ),
        (
            "a home that was moved in flight is the datum once the vehicle is disarmed",
            [home(A, 0.1), arm(2.0), home(C, 3.0, False), beat(4.0, True), at(C)],
        ),
        (
            "every flight keeps the datum it began with",
            [
                step
                for n, (begun, other) in enumerate([(A, B), (C, A), (B, C)])
                for step in (
                    *(home(begun, 10.0 * n), arm(10.0 * n + 1), home(other, 10.0 * n + 4, False)),
                    *(at(begun, flight=begun), beat(10.0 * n + 5)),
                )
            ],
        ),
        (  # PX4 moves its home there as soon as it is disarmed, beside the transmitter that it has found
            "home where the vehicle has landed is the datum when it arms again",
            [
                *(home(A, 0.1), arm(1.0), beat(60.0), home(LANDED, 61.0, False), beat(62.0, False), at(A, flight=A)),
                *(arm(100.0, True), at(LANDED, flight=LANDED, why=["a new home after landing"])),
            ],
        ),
        (
            "home that is set by arming again may come just after it; the first flight has its datum",
            [
                *(home(A, 0.1), arm(1.0), home(B, 1.5, False), beat(60.0), home(A, 61.0), arm(100.0)),
                *(home(B, 101.0, True), home(A, 103.0, False), at(B)),
            ],
        ),
        (
            "after a reboot home is followed by the metre again",
            [
                *(home(A, 0.1), arm(1.0), position(A, 60.0), beat(61.0)),
                *(position(A, 70.0, boot=1.0), position(A, 70.1, boot=1.1), went(reboots=1)),
                *(home(B, 71.0, True), at(B)),
            ],
        ),
        (
            "the home of a vehicle already in flight is the datum",
            [arm(0.5), home(A, 1.0, True), home(B, 2.0, False), at(A)],
        ),
        (
            "without home the first position serves after five seconds",
            [
                position(A, 10.0, False),
                position(B, 9.99 + WAIT, False),
                at(None),
                position(B, 10.0 + WAIT, True),
                at(A),
            ],
        ),
        (
            "it does not follow the positions",
            [
                *(position((46.5 + i * 1e-5, 11.35, 1800.0), float(i), i == 1 + WAIT) for i in range(1, 60)),
                at((46.50001, 11.35, 1800.0)),
            ],
        ),
        (
            "the wait is for a valid position",
            [
                *(position(NOWHERE, float(i), False) for i in range(20)),
                *(position(A, 20.0, False), position(A, 24.9, False), position(A, 25.0, True)),
            ],
        ),
        (
            "a home that comes later wins while disarmed",
            [position(C, 1.0), position(C, 7.0), at(C), home(A, 8.0, True), at(A), position(C, 9.0, False)],
        ),
        (
            "in flight a home that comes late does not move the transmitters",
            [position(C, 1.0), position(C, 7.0), arm(8.0), home(A, 9.0, False), at(C), beat(10.0, True), at(A)],
        ),
        (
            "a reboot on the ground keeps the datum until there is a new home",
            [
                *(home(A, 0.1), position(A, 60.0), position(C, 61.0, False, 1.0), position(C, 61.1, False, 1.1)),
                *(went(reboots=1), position(C, 70.0, False, 10.0), at(A), home(B, 71.0, True), at(B)),
            ],
        ),
        (
            "a reboot keeps the datum while the vehicle is armed, and a home elsewhere is the next one",
            [
                *(home(A, 0.1), arm(1.0), position(A, 60.0), position(C, 61.0, boot=1.0), position(C, 61.1, boot=1.1)),
                *(home(C, 61.5, False), went(reboots=1), at(A), beat(62.0, True), at(C)),
            ],
        ),
        (  # its streams came before its heartbeat, which says that it is not armed any more
            "a reboot of an armed vehicle is no landing: home is followed by the metre again",
            [
                *(home(A, 0.1), arm(1.0), position(A, 60.0), position(A, 61.0, boot=1.0), position(A, 61.1, boot=1.1)),
                *(went(reboots=1), home(LANDED, 61.5, False), at(A), beat(62.0, True), at(LANDED)),
                *(arm(70.0), beat(80.0), home(A, 81.0, False), at(LANDED)),
            ],
        ),
        (
            "without home a reboot elsewhere begins anew after the wait for home",
            [
                *(position(A, 60.0), position(A, 65.0, True), position(C, 66.0, boot=1.0), position(C, 66.1, boot=1.1)),
                *(position(C, 70.0, False, 5.0), at(A), position(C, 71.2, True, 6.2)),
                at(C, why=["the vehicle has rebooted"]),
            ],
        ),
        (
            "a reboot starts the wait for home again",
            [
                *(position(A, 60.0), position(NOWHERE, 63.9, boot=0.9), position(NOWHERE, 64.0, boot=1.0)),
                *(position(B, 66.0, False, 3.0), at(None), home(C, 70.0, True), at(C)),
            ],
        ),
        (
            "without home a jump before arming is a new datum, but not at once",
            [
                *(position(LOW, float(n)) for n in range(7)),
                *(at(LOW), position(ORIGIN, 7.0, False), position(ORIGIN, 8.0, True)),
                *(at(ORIGIN, why=["its position has jumped"]), position((46.5001, 11.35, 589.0), 9.0, False)),
            ],
        ),
        (
            "a jump during the wait for home is no second wait",
            [
                *(position(LOW, 0.0), position(ORIGIN, 1.0), position(ORIGIN, 2.0, False), position(ORIGIN, 5.0, True)),
                *(at(ORIGIN, why=[""]), went(jumps=1, changes=[5.0])),
            ],
        ),
        (
            "a jump in flight leaves the datum where it is until the vehicle is disarmed",
            [
                *(position(LOW, float(n)) for n in range(7)),
                *(arm(7.0), *(position(ORIGIN, float(n), False) for n in range(8, 12)), at(LOW)),
                *(beat(12.0, True), at(ORIGIN)),
            ],
        ),
        (
            "a jump does not take the datum from a home",
            [
                home(A, 0.1),
                *(position(LOW if n < 5 else ORIGIN, 1.0 + n, False) for n in range(10)),
                *(went(jumps=1), at(A)),
            ],
        ),
    ],
)
def test_the_datum_follows_home_or_the_first_position(story: str, steps: list[Step]) -> None:
    told = Told()
    for step in steps:
        step(told)


def test_a_fixed_datum_stays_whatever_the_vehicle_says() -> None:
    told = Told(Lla(*C), heard=False)
    assert told.lies_at(C)
    for step in (beat(0.0, False), home(A, 1.0, False), position(A, 2.0, False), position(A, 20.0, False), at(C)):
        step(told)


def test_without_a_vehicle_there_is_none() -> None:
    told = Told(heard=False)
    assert not told.datum.update(told.session, 100.0)
    assert told.lies_at(None)
    assert told.datum.lla is None
    assert HOME_WAIT_S == 5.0


def test_the_frame_is_north_east_down_from_there() -> None:
    told = Told()
    told.home(A, 0.1)
    frame = told.datum.frame
    assert isinstance(frame, LocalFrame)
    assert told.datum.lla == A
    north, east, down = frame.ned(46.501, 11.351, 1790.0)
    assert (north, east) == pytest.approx((111.2, 76.8), abs=0.3)
    assert down == pytest.approx(10.0, abs=0.01)


# -- too far away --------------------------------------------------------------------------------------------------


def test_a_vehicle_far_from_everything_is_said_once_for_each_place_of_the_datum() -> None:
    told = Told()
    told.home(A, 0.1)
    away = Pose(np.array([100_000.0, 55_000.0, -10.0]), np.eye(3))

    def too_far(id_: int | None, true_range_m: float | None) -> list[Event]:
        channel = ChannelReading(id_, Zone.OUTER, -1, -1, true_range_m)
        return told.datum.check_distance(frame_made(0, channel, pose=away, of=("v", "r")))

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
    assert said.text.startswith("the vehicle is 114.1 km from the datum and 114.1 km from the nearest transmitter")
    assert cure in said.text
