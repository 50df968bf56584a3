"""The receiver as a search has it: what came, and what there is to say when nothing does."""

from __future__ import annotations

import pytest

from arva_hil.events import Event
from arva_hil.events.searches import ReceiverGone
from arva_hil.events.words.reasons import in_words
from arva_hil.links import memory
from arva_hil.search.flight.links import ReceiverLink
from firmware_proto import Channel, Decoder, Frame, encode, encode_nmea

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
