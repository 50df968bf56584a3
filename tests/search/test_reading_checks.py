"""A receiver that repeats itself: frames that come again, and readings that stay the same."""

from __future__ import annotations

import math

import numpy as np
import pytest

from arva_hil.events import Event
from arva_hil.events.searches import ReceiverGone
from arva_hil.events.words.reasons import in_words
from arva_hil.links import memory
from arva_hil.model.field import dipole_field, rotation
from arva_hil.search.flight.links import NewFrames, ReceiverLink
from arva_hil.search.mission.choice import StuckReadings, observations, pulses
from arva_hil.search.strategies.estimate import Estimate
from arva_hil.search.strategies.strategy import Observation
from firmware_proto import (
    INNER,
    MID,
    Channel,
    Decoder,
    Frame,
    LevelChannel,
    Measured,
    TextDecoder,
    VectorChannel,
    encode,
    encode_nmea,
)
from firmware_proto.measured import VECTOR


def frame(sequence: int, *channels: Channel) -> Frame:
    return Frame(sequence, 1, channels or (Channel(1, MID, 400, 20),))


@pytest.mark.parametrize(
    ("came", "new"),
    [
        ([0, 1, 2, 3], [0, 1, 2, 3]),
        ([254, 255, 0, 1], [254, 255, 0, 1]),
        ([7, 7, 7, 8], [7, 8]),
        ([7, 9, 8, 10], [7, 9, 10]),  # one was overtaken
        ([255, 0, 255, 1], [255, 0, 1]),
        ([200, 0, 1], [200, 0, 1]),  # it has started anew
        ([5, 100, 101], [5, 100, 101]),
    ],
)
def test_a_frame_is_new_once(came: list[int], new: list[int]) -> None:
    fresh = NewFrames()
    assert [number for number in came if fresh.new(frame(number))] == new


def test_a_receiver_that_repeats_one_frame_is_silent_and_that_is_explained() -> None:
    near, far = memory.pair()
    receiver = ReceiverLink(near, Decoder(), emit=lambda event: None)
    for n in range(50):
        far.write(encode(frame(42)))
        assert len(receiver.read(100.0 + n * 0.1)) == (n == 0)
    assert receiver.silent(104.9)
    silence = in_words(receiver.why_silent(104.9))
    assert "the last one came 5 s ago, and its sequence number 42 again and again since" in silence


def test_lines_of_text_have_no_number_and_are_all_new() -> None:
    near, far = memory.pair()
    receiver = ReceiverLink(near, TextDecoder(), emit=lambda event: None)
    for n in range(5):
        far.write(b"900,20\r\n")
        assert len(receiver.read(100.0 + n)) == 1


def after(*frames: tuple[Frame, float], every_s: float = 1.0) -> StuckReadings:
    """What it knows after those frames, heard so far north."""
    standstill = StuckReadings()
    for n, (frame, north) in enumerate(frames):
        standstill.observe([c for c in frame.channels if c.valid], (north, 0.0, -1.0), 100.0 + n * every_s)
    return standstill


def test_the_same_reading_over_some_metres_is_stuck() -> None:
    assert after(*((frame(n), 0.5 * n) for n in range(8)), every_s=0.1).whole.stuck


def test_the_same_reading_half_a_metre_farther_is_none_of_here() -> None:
    assert not after((frame(0), 0.0), (frame(1), 0.4)).whole.old
    assert after((frame(0), 0.0), (frame(1), 0.6)).whole.old
    assert after((frame(0), 0.0), (frame(1), 0.6), (frame(2), 0.0)).whole.old  # back again


@pytest.mark.parametrize(("d", "same_m"), [(810, 0.8), (1300, 1.3), (6000, 1.5)])
def test_farther_from_a_transmitter_the_same_reading_is_of_more_places(d: int, same_m: float) -> None:
    far = Channel(1, MID, d, 20)
    hovering = [(frame(n, far), same_m * (n > 2)) for n in range(30)]
    assert (after(*hovering).whole.old, after(*hovering).whole.stuck) == (False, False)
    assert after((frame(0, far), 0.0), (frame(1, far), same_m + 0.1)).whole.old


def test_the_same_reading_for_long_off_the_place_where_it_was_right_is_stuck() -> None:
    """A search that believes itself above the transmitter hovers there."""
    places = [0.0, 0.6, 1.2, 1.3, 1.3, 1.3, 1.3, 1.3]
    assert not after(*((frame(n), north) for n, north in enumerate(places[:-1]))).whole.stuck
    assert after(*((frame(n), north) for n, north in enumerate(places))).whole.stuck


def test_it_is_not_while_the_vehicle_stands_or_anything_changes_or_nothing_is_heard() -> None:
    for standstill in (
        after(*((frame(n), 0.002 * n) for n in range(200))),
        after(*((frame(n, Channel(1, MID, 900 + n % 2, 20)), float(n)) for n in range(30))),
        after(*((frame(n, Channel(1, MID, 900, n)), float(n)) for n in range(30))),
        after(*((frame(n, Channel()), float(n)) for n in range(30))),
    ):
        assert not standstill.whole.old
        assert not standstill.whole.stuck
    assert not after((frame(0), 0.0), (frame(1), 50.0)).whole.stuck


def test_a_change_frees_it() -> None:
    same = [(frame(n), 1.0 * n) for n in range(8)]
    standstill = after(*same, (frame(9, Channel(1, MID, 901, 20)), 8.0))
    assert (standstill.whole.old, standstill.whole.stuck, standstill.whole.moved_m) == (False, False, 0.0)


def test_a_stuck_reading_is_noticed_though_another_transmitter_s_changes() -> None:
    frames = [(frame(n, Channel(1, MID, 900, 20), Channel(2, MID, 1500 - n, 40)), 1.0 * n) for n in range(8)]
    standstill = after(*frames)
    assert standstill.repeats(1)
    assert not standstill.repeats(2)
    assert not standstill.repeats(3)
    assert not standstill.whole.old
    assert not standstill.whole.stuck


def test_an_empty_channel_that_changes_hides_no_stuck_reading() -> None:
    frames = [(frame(n, Channel(1, MID, 900, 20), Channel(n, MID, -1, -1)), 1.0 * n) for n in range(8)]
    assert after(*frames).whole.stuck


# -- The receiver as a search has it: what came, and what there is to say when nothing does ---------------


FRAME = Frame(3, 1, (Channel(1, 1, 1234, -15),))


def test_frames_are_read_as_they_come() -> None:
    near, far = memory.pair()
    receiver = ReceiverLink(near, Decoder(), [].append)
    assert receiver.silent(100.0)
    far.write(encode(FRAME)[:7])
    assert receiver.read(100.0) == []
    next_one = FRAME._replace(sequence=4)
    far.write(encode(FRAME)[7:] + encode(next_one))
    assert receiver.read(100.01) == [FRAME, next_one]
    assert receiver.last == next_one
    assert not receiver.silent(102.0)
    assert receiver.silent(102.1)


@pytest.mark.parametrize(
    ("came", "why"),
    [
        (b"", "nothing came"),
        (b"\x00", r"bytes came that are none, first b'\x00': is the format right, and the baud rate?"),
        (encode_nmea(FRAME), "bytes came that are none, first b'$PARVA,3,1,1,1,1': is the format right"),
        (encode(FRAME), "the last one came 60 s ago"),
    ],
)
def test_silence_is_explained(came: bytes, why: str) -> None:
    near, far = memory.pair()
    receiver = ReceiverLink(near, Decoder(), [].append)
    for byte in came:
        far.write(bytes([byte]))
        receiver.read(0.0)
    assert in_words(receiver.why_silent(60.0)).startswith("no frame from the receiver at memory:a: ")
    assert why in in_words(receiver.why_silent(60.0))


def test_one_that_is_unplugged_is_silent_and_says_so_once() -> None:
    near, far = memory.pair()
    events: list[Event] = []
    receiver = ReceiverLink(near, Decoder(), events.append)
    far.write(encode(FRAME))
    far.close()
    assert receiver.read(0.0) == [FRAME]
    for now in (1.0, 2.0, 3.0):
        assert receiver.read(now) == []
    assert events == [ReceiverGone(1.0, "memory:a: lost: closed by the far end")]
    assert not receiver.links
    assert receiver.silent(3.0)


# A search uses what the receiver has: integers, or the signed signals of its antennas and the age of the pulse


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
