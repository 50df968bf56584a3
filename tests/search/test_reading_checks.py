"""A receiver that repeats itself: frames that come again, and readings that stay the same."""

from __future__ import annotations

import pytest

from arva_hil.events.words.reasons import in_words
from arva_hil.links import memory
from arva_hil.search.flight.links import NewFrames, ReceiverLink
from arva_hil.search.mission.choice import StuckReadings
from firmware_proto import MID, Channel, Decoder, Frame, TextDecoder, encode


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
